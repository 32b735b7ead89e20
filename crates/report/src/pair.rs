//! Two subjects side by side: errors, ladder, parameters.

use super::group::Row;
use super::ladder;
use super::standing::standings;
use super::story::Story;
use super::wording::{count, maybe, number};
use aloft_page::{Cell, Section, Table};

/// What is set side by side of one subject, by name, in the order of reading.
pub(super) fn lines(story: &Story<'_>) -> Vec<(String, String)> {
    let mut out = Vec::new();
    let mut add = |name: &str, value: String| out.push((name.to_owned(), value));
    let all = standings(story);
    for place in ["flight", "contact"] {
        let of = all.iter().find(|s| s.place == place);
        let words = of.map_or("–".to_owned(), |s| format!("{} N · {}", number(s.error_n), s.ratio_words()));
        add(&format!("held-out error in {place}"), words);
    }
    if let Some(picture) = ladder::picture(story) {
        let rungs: Vec<String> = picture.rungs.iter().map(|r| format!("{}: {}", r.name, r.words)).collect();
        add("ladder", rungs.join("; "));
    }
    let person = &story.session.facts.person;
    add("body mass, kg", number(person.mass_kg));
    add("stature, m", maybe(person.height_m));
    if let Some(p) = story.comparison.as_ref().map(|v| &v.parameters).filter(|p| p.in_all > 0) {
        let gate = if p.gate_passed { "" } else { "; too few flights to determine the body" };
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

/// The section; none for a study of one subject with results.
pub(super) fn section(rows: &[Row]) -> Option<Section> {
    let with: Vec<&Row> = rows.iter().filter(|r| !r.lines.is_empty()).collect();
    if with.len() < 2 {
        return None;
    }
    // every line that some subject has, in the order in which they are met
    let mut names: Vec<&str> = Vec::new();
    for (name, _) in with.iter().flat_map(|r| &r.lines) {
        if !names.contains(&name.as_str()) {
            names.push(name);
        }
    }
    let of = |r: &Row, name: &str| r.lines.iter().find(|l| l.0 == name).map_or("–".to_owned(), |l| l.1.clone());
    let row = |name: &str| -> Vec<Cell> {
        std::iter::once(name.to_owned()).chain(with.iter().map(|r| of(r, name))).map(Cell::from).collect()
    };
    let header: Vec<&str> = std::iter::once("").chain(with.iter().map(|r| r.name.as_str())).collect();
    let caption = "Errors over held-out weak windows. Masses of single links are of the physically consistent body; motion determines combinations of them.";
    let table = Table::new("Two subjects side by side", caption, &header, names.into_iter().map(row).collect());
    let lead = "Choose two of the subjects.";
    Some(Section::new("side-by-side", "Side by side", lead, vec![table.two_at_a_time().into()]))
}
