//! Two subjects side by side: errors, ladder, parameters.

use super::ladder;
use super::place_errors::errors_by_place;
use super::story::Story;
use super::wording::{count, maybe, number};
use aloft_page::{Block, Cell, Section, Table};
use aloft_study::subject_session::SubjectSession;
use aloft_workspace::error::PipelineError;
use rayon::prelude::*;

/// Names and values of one subject.
type Lines = Vec<(String, String)>;

/// Words of a rung with its judgement.
fn spoken(words: &str, judged: &str) -> String {
    if judged.is_empty() { words.to_owned() } else { format!("{words}, {judged}") }
}

/// What is set side by side of one subject, by name, in the order of reading.
pub(super) fn lines(story: &Story<'_>) -> Lines {
    let mut out = Vec::new();
    let mut add = |name: &str, value: String| out.push((name.to_owned(), value));
    let all = errors_by_place(story);
    for place in ["flight", "contact"] {
        let of = all.iter().find(|s| s.place == place);
        let words = of.map_or("–".to_owned(), |s| format!("{} N · {}", number(s.error_n), s.ratio_words()));
        add(&format!("held-out error in {place}"), words);
    }
    if let Some(picture) = ladder::picture(story) {
        let rungs: Vec<String> =
            picture.rungs.iter().map(|r| format!("{}: {}", r.name, spoken(&r.words, &r.judged))).collect();
        add("ladder", rungs.join("; "));
    }
    let person = &story.session.facts.person;
    add("body mass, kg", number(person.mass_kg));
    add("stature, m", maybe(person.height_m));
    if let Some(p) = story.comparison.as_ref().map(|v| &v.parameters).filter(|p| p.in_all > 0) {
        let gate = match (p.gate_passed, &p.misfit) {
            (true, _) => p.reservation.map_or(String::new(), |words| format!("; {words}")),
            (false, Some(_)) => "; joints or markers are not where the model has them".to_owned(),
            (false, None) => "; too few flights to determine the body".to_owned(),
        };
        add(
            "parameters from motion",
            format!("{} of {}, {}{gate}", p.from_motion, p.in_all, count(p.flights, "flight")),
        );
    }
    let rms: Vec<f64> = story.dynamic().filter_map(|t| t.kinematics.as_ref()?.marker_rms_mm).collect();
    if !rms.is_empty() {
        add("marker error, mm (RMS)", number(rms.iter().sum::<f64>() / rms.len() as f64));
    }
    if let Some(found) = &story.found {
        for e in found.parameters.effects.iter().filter(|e| e.not_determined.is_none()) {
            add(&format!("`{}`", e.name), super::wording::plus_minus(e.value, e.ci95));
        }
        for l in &found.parameters.links {
            let words = format!("{} ({} from tables)", number(l.mass_kg), number(l.prior.mass_kg));
            add(&format!("mass of `{}`, kg", l.name), words);
        }
    }
    out
}

/// Subjects of a study as one table, of which a reader chooses two columns, as HTML for a page that
/// has the scripts of this one; and why subjects are not in it. No table for fewer than two
/// subjects with results.
///
/// # Errors
/// The table cannot be drawn.
pub fn side_by_side(members: &[SubjectSession]) -> Result<(Option<String>, Vec<String>), PipelineError> {
    let read = |m: &SubjectSession| {
        let made = aloft_pipeline::made::as_made(m)?;
        let story = Story::read(&made, m)?;
        Ok((m.id.to_string(), lines(&story)))
    };
    let all: Vec<Result<(String, Lines), PipelineError>> = members.par_iter().map(read).collect();
    let without = members.iter().zip(&all).filter_map(|(m, one)| match one {
        Ok((name, lines)) if lines.is_empty() => Some(format!("{name}: no results")),
        Ok(_) => None,
        Err(e) => Some(format!("{}: {e}", m.id)),
    });
    let without = without.collect();
    let known = all.iter().flatten().map(|(name, lines)| (name.as_str(), lines.as_slice()));
    let html = table(known).map(|t| aloft_page::render_blocks(&[Block::from(t)]));
    Ok((html.transpose().map_err(|e| PipelineError::request(e.to_string()))?, without))
}

/// The section; none for a study of one subject with results.
pub(super) fn section<'a>(columns: impl Iterator<Item = Column<'a>>) -> Option<Section> {
    let lead = "Choose two of the subjects.";
    Some(Section::new("side-by-side", "Side by side", lead, vec![table(columns)?.into()]))
}

/// Name of a subject and its lines.
type Column<'a> = (&'a str, &'a [(String, String)]);

fn table<'a>(columns: impl Iterator<Item = Column<'a>>) -> Option<Table> {
    let with: Vec<Column<'_>> = columns.filter(|c| !c.1.is_empty()).collect();
    if with.len() < 2 {
        return None;
    }
    // every line that some subject has, in the order in which they are met
    let mut names: Vec<&str> = Vec::new();
    for (name, _) in with.iter().flat_map(|c| c.1) {
        if !names.contains(&name.as_str()) {
            names.push(name);
        }
    }
    let of = |c: &Column<'_>, name: &str| c.1.iter().find(|l| l.0 == name).map_or("–".to_owned(), |l| l.1.clone());
    let row = |name: &str| -> Vec<Cell> {
        std::iter::once(name.to_owned()).chain(with.iter().map(|c| of(c, name))).map(Cell::from).collect()
    };
    let header: Vec<&str> = std::iter::once("").chain(with.iter().map(|c| c.0)).collect();
    let caption = "Errors over held-out weak windows. Masses of single links are of the physically consistent body; motion determines combinations of them.";
    Some(
        Table::new("Two subjects side by side", caption, &header, names.into_iter().map(row).collect()).two_at_a_time(),
    )
}
