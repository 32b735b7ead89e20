//! Tables and messages as text. Data goes to stdout, messages to stderr.

use crate::stop::Stop;
use aloft_analysis::parameters::half_of;
use aloft_study::quote::visible;
use std::io::Write;

pub use crate::screen::table;
pub use aloft_analysis::wording::unit;
pub use aloft_compare::significant;

/// Prints to stdout; a closed pipe ends the command without a message.
pub fn out(text: impl std::fmt::Display) -> Result<(), Stop> {
    writeln!(std::io::stdout(), "{text}").map_err(|e| match e.kind() {
        std::io::ErrorKind::BrokenPipe => Stop::PipeClosed,
        _ => Stop::Error(miette::miette!("cannot write to the standard output: {e}")),
    })
}

/// Prints a message to stderr, wrapped to the width. Line breaks and control characters in names
/// are escaped, so that they cannot act on the terminal.
pub fn note(text: impl std::fmt::Display) {
    let text = visible(&text.to_string());
    let indent: String = text.chars().take_while(|c| *c == ' ').chain("  ".chars()).collect();
    let options = textwrap::Options::new(crate::screen::width())
        .subsequent_indent(&indent)
        .break_words(false)
        .word_splitter(textwrap::WordSplitter::NoHyphenation);
    let _ = writeln!(std::io::stderr(), "{}", textwrap::fill(&text, options));
}

/// Prints one line to stderr, cut at the width.
pub fn brief_note(text: impl std::fmt::Display) {
    let _ = writeln!(std::io::stderr(), "{}", crate::screen::one_line("", &visible(&text.to_string())));
}

/// Prints a command that can be copied to a shell: line breaks in names are inside quotes, a long
/// command continues on the next line.
pub fn command(label: &str, text: &str) {
    let _ = writeln!(std::io::stderr(), "{}", crate::screen::command_lines(&format!("{label}: "), &words_of(text)));
}

/// The words of a command, as a shell separates them; their quotes are kept.
fn words_of(command: &str) -> Vec<String> {
    let (mut words, mut word, mut quoted, mut escaped) = (Vec::new(), String::new(), false, false);
    for c in command.chars() {
        match c {
            _ if escaped => escaped = false,
            '\\' if !quoted => escaped = true,
            '\'' => quoted = !quoted,
            ' ' if !quoted => {
                words.push(std::mem::take(&mut word));
                continue;
            }
            _ => {}
        }
        word.push(c);
    }
    words.push(word);
    words.retain(|w| !w.is_empty());
    words
}

/// Prints an error with its location and hint.
pub fn error(report: &miette::Report) {
    let _ = writeln!(std::io::stderr(), "{report:?}");
}

/// Half-width of a 95 % interval with two significant digits; a dash if there is none.
pub fn half(ci95: Option<[f64; 2]>) -> String {
    significant(half_of(ci95).unwrap_or(f64::NAN), 2)
}

/// A value with the digits that its 95 % interval warrants: two digits of the half-width, and the
/// same decimals of the value. Three digits where there is no interval.
pub fn beside(value: f64, ci95: Option<[f64; 2]>) -> String {
    match half_of(ci95).filter(|h| h.is_finite() && *h > 0.0) {
        Some(half) => {
            let decimals = (1 - half.log10().floor() as i32).clamp(0, 9) as usize;
            format!("{value:.decimals$}")
        }
        None => significant(value, 3),
    }
}

/// Prints a value as JSON.
pub fn json<T: serde::Serialize>(value: &T) -> Result<(), Stop> {
    let text =
        serde_json::to_string_pretty(value).map_err(|e| Stop::Error(miette::miette!("cannot write JSON: {e}")))?;
    out(text)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_command_is_split_where_a_shell_splits_it() {
        let words = words_of(r"aloft effect add 'my lab/p.yaml' 'tether[pelvis]' 'it'\''s a trial'");
        assert_eq!(words, ["aloft", "effect", "add", "'my lab/p.yaml'", "'tether[pelvis]'", r"'it'\''s a trial'"]);
    }

    #[test]
    fn values_have_the_digits_of_their_interval() {
        for (value, ci95, text) in [
            (51.82, Some([29.8, 73.8]), "52"),
            (-1.332, Some([-9.93, 7.27]), "-1.3"),
            (0.018_31, Some([0.017_45, 0.019_17]), "0.01831"),
            (0.018_31, None, "0.0183"),
        ] {
            assert_eq!(beside(value, ci95), text);
        }
    }
}
