//! Consistency of the recordings, before any model is judged: the session check.

use super::headline::sentence_of;
use super::place_errors::asked;
use super::story::Story;
use aloft_analysis::corrections::to_yaml;
use aloft_analysis::explanations::{explanations, in_words};
use aloft_analysis::session_check::LineStatus;
use aloft_page::{Block, Cell, Light, Section, Table};

/// The section of the first chapter; none before a run.
pub fn section(story: &Story<'_>) -> Option<Section> {
    let checked = &story.checked;
    if checked.lines.is_empty() {
        return None;
    }
    let rows = checked
        .lines
        .iter()
        .map(|line| {
            let light = match line.status {
                LineStatus::Agrees => Light::Good,
                LineStatus::Differs => Light::Fair,
                LineStatus::Reading => Light::Neutral,
            };
            vec![
                Cell::from(line.what.clone()).with_note(line.words.clone()),
                line.value_words().into(),
                line.interval_words().into(),
                line.expected.map_or("–".to_owned(), |e| line.number(e)).into(),
                Cell::sign(light, line.status.word()),
            ]
        })
        .collect();
    let header = ["measured", "value", "95 % interval", "expected", "judged"];
    let caption =
        "From the recordings alone; no identified model is used. Lines without an interval are plain readings.";
    let mut blocks = vec![Table::new("Session check", caption, &header, rows).into()];
    let offered = &story.offered;
    if !offered.is_empty() {
        blocks.push(Block::text(
            "These measurements offer corrections. Nothing is corrected unless the pipeline says so; each is then a rung of the ladder. A force \
             that acts on the body in flight (a rope, a draught) changes mass, rate and vertical as measured here, too: `discover` ranks such \
             effects.",
        ));
        blocks.push(Block::code(to_yaml(offered)));
    }
    if let Some(words) = in_words(&explanations(story.session, checked, offered, asked(story))) {
        blocks.push(Block::text(sentence_of(&words)));
    }
    Some(Section::new("session", "Consistency of the recordings", "", blocks))
}

/// Most measurements that the first screen names.
const SHOWN: usize = 3;

/// What the recordings say that differs from what was expected, in a sentence; none where nothing
/// does.
pub fn brief(story: &Story<'_>) -> Option<String> {
    let checked = &story.checked;
    let differs: Vec<String> = checked
        .lines
        .iter()
        .filter(|l| l.status == LineStatus::Differs)
        .map(|l| {
            let interval = l.ci95.map_or(String::new(), |_| format!(" ({})", l.interval_words()));
            let expected =
                l.expected.filter(|e| *e != 0.0).map_or(String::new(), |e| format!(", {} expected", l.number(e)));
            format!("{} {}{interval}{expected}", l.what, l.value_words())
        })
        .collect();
    let more = match differs.len().saturating_sub(SHOWN) {
        0 => String::new(),
        n => format!("; {n} more"),
    };
    let text = differs.iter().take(SHOWN).map(String::as_str).collect::<Vec<_>>().join("; ");
    let offered = &story.offered;
    let why = in_words(&explanations(story.session, checked, offered, asked(story)));
    let why = why.map_or(String::new(), |words| format!(" {}", sentence_of(&words)));
    (!differs.is_empty()).then(|| sentence_of(&format!("{text}{more}")) + &why + " The session check below says more.")
}
