//! Tables and messages as text. Data goes to stdout, messages to stderr.

use crate::stop::Stop;
use aloft_analysis::parameters::half_of;
use aloft_study::quote::{acts_on_terminal, visible};
use std::borrow::Cow;
use std::io::{IsTerminal, Write};

pub use crate::screen::table;
pub use aloft_analysis::wording::unit;
pub use aloft_compare::significant;

/// A text for the screen: every character that acts on a terminal is escaped, except line breaks,
/// tabs and, where colour is shown, sequences of colour. Names of files, markers and links come
/// from others; nothing that they contain may move the cursor or change what was printed.
fn harmless(text: &str, colour: bool) -> Cow<'_, str> {
    let acts = |c: char| acts_on_terminal(c) && !matches!(c, '\n' | '\t');
    if !text.contains(acts) {
        return text.into();
    }
    let mut out = String::with_capacity(text.len());
    let mut rest = text;
    while let Some(at) = rest.find(acts) {
        out.push_str(&rest[..at]);
        rest = &rest[at..];
        let length = if colour { colour_sequence(rest) } else { None };
        match (length, rest.chars().next()) {
            (Some(length), _) => {
                out.push_str(&rest[..length]);
                rest = &rest[length..];
            }
            (None, Some(c)) => {
                out.extend(c.escape_default());
                rest = &rest[c.len_utf8()..];
            }
            (None, None) => break,
        }
    }
    out.push_str(rest);
    out.into()
}

/// Length of the sequence that sets colour or weight at the beginning of a text, if there is one.
fn colour_sequence(text: &str) -> Option<usize> {
    let codes = text.strip_prefix("\u{1b}[")?;
    let end = codes.find(|c: char| !c.is_ascii_digit() && c != ';')?;
    codes[end..].starts_with('m').then_some(2 + end + 1)
}

/// Prints to stdout; a closed pipe ends the command without a message.
pub fn out(text: impl std::fmt::Display) -> Result<(), Stop> {
    let text = text.to_string();
    let text = harmless(&text, std::io::stdout().is_terminal());
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
    let lines = crate::screen::command_lines(&format!("{label}: "), &words_of(text));
    let _ = writeln!(std::io::stderr(), "{}", harmless(&lines, false));
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
    let text = format!("{report:?}");
    let _ = writeln!(std::io::stderr(), "{}", harmless(&text, std::io::stderr().is_terminal()));
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
    out(escaped_json(&text))
}

/// The same JSON with characters that act on a terminal as escapes of JSON: serde escapes only
/// those below U+0020.
fn escaped_json(text: &str) -> Cow<'_, str> {
    let acts = |c: char| acts_on_terminal(c) && c != '\n';
    if !text.contains(acts) {
        return text.into();
    }
    let escaped = |c: char| if acts(c) { format!("\\u{:04x}", u32::from(c)) } else { c.to_string() };
    text.chars().map(escaped).collect::<String>().into()
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
    fn nothing_in_a_name_acts_on_the_terminal() {
        let name = "a\u{1b}[2J\u{9b}1m\u{202e}\u{7}b\n\tc";
        assert_eq!(harmless(name, true), "a\\u{1b}[2J\\u{9b}1m\\u{202e}\\u{7}b\n\tc");
        assert_eq!(harmless("\u{1b}[31;1mred\u{1b}[0m", true), "\u{1b}[31;1mred\u{1b}[0m");
        assert_eq!(harmless("\u{1b}[31mred", false), "\\u{1b}[31mred");
        for cut in ["\u{1b}", "\u{1b}[", "\u{1b}[3", "\u{1b}]0;title\u{7}"] {
            assert!(!harmless(cut, true).contains(['\u{1b}', '\u{7}']), "{cut:?}");
        }
        let json = escaped_json("{\"a\u{9b}\": 1}\n").into_owned();
        assert_eq!(json, "{\"a\\u009b\": 1}\n");
        assert!(serde_json::from_str::<serde_json::Value>(&json).is_ok());
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
