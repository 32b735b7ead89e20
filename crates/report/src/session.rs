//! What the recordings say about themselves, before any model is judged: the session check.

use super::story::Story;
use aloft_analysis::corrections::{offers, to_yaml};
use aloft_analysis::session_check::{LineStanding, session_check};
use aloft_page::{Block, Cell, Light, Section, Table};

/// The section of the first chapter; none before a run.
pub fn section(story: &Story<'_>) -> Option<Section> {
    let checked = session_check(story.session);
    if checked.lines.is_empty() {
        return None;
    }
    let rows = checked
        .lines
        .iter()
        .map(|line| {
            let digits = line.digits();
            let number = |x: f64| if x.is_finite() { format!("{x:.digits$}") } else { "–".to_owned() };
            let light = match line.standing {
                LineStanding::Agrees => Light::Good,
                LineStanding::Differs => Light::Fair,
                LineStanding::Reading => Light::Neutral,
            };
            let interval =
                line.ci95.map_or("–".to_owned(), |[low, high]| format!("{} to {}", number(low), number(high)));
            vec![
                Cell::from(line.what.clone()),
                format!("{} {}", number(line.value), line.unit).into(),
                interval.into(),
                line.expected.map_or("–".to_owned(), number).into(),
                Cell::light(light, line.standing.word()),
                line.words.clone().into(),
            ]
        })
        .collect();
    let header = ["measured", "value", "95 %", "expected", "", "from"];
    let caption = "From the recordings alone; no identified model is in it. A line without an interval is a reading.";
    let mut blocks = vec![Table::new("Session check", caption, &header, rows).into()];
    let offered = offers(story.session, &checked);
    if !offered.is_empty() {
        blocks.push(Block::text(
            "These measurements offer corrections. Nothing is corrected unless the pipeline says so; each is then a rung of the ladder. A force \
             that acts on the body in flight (a rope, a draught) changes mass, rate and vertical as measured here, too: if `discover` names one, \
             add it first and check again.",
        ));
        blocks.push(Block::code(to_yaml(&offered)));
    }
    Some(Section::new("session", "What the recordings say about themselves", "", blocks))
}
