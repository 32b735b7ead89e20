//! Prints what the recordings of a session say about themselves, and the corrections that follow.

use crate::args::PipelineArgs;
use crate::next;
use crate::render::{command, note, out};
use crate::screen::table;
use crate::stop::Stop;
use aloft_analysis::corrections;
use aloft_analysis::explanations::{self, Explanation, Reason};
use aloft_analysis::session_check::{LineStatus, SessionCheck};
use aloft_study::quote::visible;
use aloft_study::recordings::SessionId;

/// The session check, where the recordings have been processed.
pub fn session_check(checked: &SessionCheck) -> Result<(), Stop> {
    if checked.lines.is_empty() {
        return Ok(());
    }
    // a long name takes a second line, so that value and verdict stay in one row
    let mut t = table(&["session check", "value", "95 %", "expected", "n", ""]).wrapped(0);
    for line in &checked.lines {
        t.add_row([
            visible(&line.what),
            line.value_words(),
            line.interval_words(),
            line.expected.map_or("–".to_owned(), |e| line.number(e)),
            line.n.to_string(),
            line.status.word().to_owned(),
        ]);
    }
    out(t)?;
    for line in checked.lines.iter().filter(|l| l.status == LineStatus::Differs || l.id == "contact_measured") {
        note(format!("{}: {}", line.what, visible(&line.words)));
    }
    Ok(())
}

/// Corrections that the measurements offer, as lines of a pipeline.
pub fn offers(offers: &[corrections::Offer]) -> Result<(), Stop> {
    if offers.is_empty() {
        return Ok(());
    }
    note("these corrections are offered; nothing is corrected unless the pipeline says so:");
    out(fitted(&corrections::to_yaml(offers)))
}

/// What explains the lines that differ, and the commands that add the effects among it.
pub fn explanations(all: &[Explanation], id: &SessionId, args: &PipelineArgs) {
    let Some(words) = explanations::in_words(all) else { return };
    note(words);
    for found in all.iter().filter(|e| e.reason == Reason::Found) {
        command("effect", &next::add(&found.key, id, args));
    }
}

/// YAML with control characters of names made visible, and comments wrapped to the terminal's
/// width.
fn fitted(text: &str) -> String {
    let lines = text.trim_end().lines().map(|line| {
        let line = visible(line);
        match line.split_once("# ") {
            Some((indent, comment)) if indent.trim().is_empty() => {
                let start = format!("{indent}# ");
                comment_lines(&start, comment)
            }
            _ => line,
        }
    });
    lines.collect::<Vec<_>>().join("\n")
}

fn comment_lines(start: &str, comment: &str) -> String {
    let options = textwrap::Options::new(crate::screen::width())
        .initial_indent(start)
        .subsequent_indent(start)
        .break_words(false)
        .word_splitter(textwrap::WordSplitter::NoHyphenation);
    textwrap::fill(comment, options)
}
