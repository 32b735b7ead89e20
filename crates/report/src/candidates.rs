//! Ranking of the candidate effects with their intervals and their odds.

use super::wording::{number, plus_minus, unit};
use aloft_discover::{Candidate, Discovery};
use aloft_effects::EffectKind;
use aloft_page::{Block, Cell, Dots, Figure, Line, Section, Table, Words};

/// Number of candidates drawn.
const SHOWN: usize = 14;

/// The ranking; `suffix` keeps the identifiers unique if the page has several rankings.
pub fn ranking(d: &Discovery, suffix: &str) -> Section {
    let real: Vec<&Candidate> = d.candidates.iter().collect();
    let shown: Vec<&Candidate> = real.iter().take(SHOWN).copied().collect();
    let blocks = vec![dots(d, &shown), table(d, &real).into()];
    Section::new(
        format!("ranking{suffix}"),
        "The ranking",
        "Physics and artefacts of measurement in one list, best first.",
        blocks,
    )
}

fn kind(c: &Candidate) -> &'static str {
    match c.kind {
        EffectKind::Artefact => "artefact",
        _ => "physics",
    }
}

fn dots(d: &Discovery, shown: &[&Candidate]) -> Block {
    let names: Vec<String> = shown.iter().map(|c| c.key.clone()).collect();
    let of = |wanted: &dyn Fn(&Candidate) -> bool, name: &str| Dots {
        name: name.to_owned(),
        values: shown.iter().map(|c| if wanted(c) { c.held_out_ratio } else { f64::NAN }).collect(),
        intervals: shown.iter().map(|c| if wanted(c) { c.ci95 } else { [f64::NAN; 2] }).collect(),
    };
    let kinds = [of(&|c| c.believed, "named"), of(&|c| !c.believed, "not named")];
    let mut lines = vec![Line { at: 1.0, upright: true, label: "explains nothing".into() }];
    let floor = d.noise_floor / d.held_out_error;
    if floor.is_finite() && floor < 0.98 {
        lines.push(Line { at: floor, upright: true, label: "noise floor".into() });
    }
    let words = Words::new(
        "Held-out error with each effect over that without",
        "Points with 95 % intervals over flights or recordings. Left of 1 the effect improves the prediction of held-out motion; the odds \
         in the table decide which is named.",
    );
    Figure::dots(words, "held-out ratio", &names, &kinds, &lines).into()
}

fn table(d: &Discovery, real: &[&Candidate]) -> Table {
    let rows = real
        .iter()
        .map(|c| {
            let first = aloft_analysis::verdict::shown_coefficient(c);
            vec![
                Cell::from(c.key.clone()),
                kind(c).into(),
                format!("{:.3} ({:.2} to {:.2})", c.held_out_ratio, c.ci95[0], c.ci95[1]).into(),
                first
                    .map_or("–".to_owned(), |e| {
                        let bound = if e.at_bound { " (at its bound)" } else { "" };
                        format!("{} = {} {}{bound}", e.name, plus_minus(e.value, e.ci95), unit(&e.unit))
                    })
                    .into(),
                number(c.minimum_detectable).into(),
                aloft_analysis::verdict::odds_of(c).into(),
                aloft_analysis::verdict::probability_of(c, d).into(),
                aloft_analysis::verdict::decided(c, d).into(),
            ]
        })
        .collect();
    Table::new(
        "Candidates",
        "Coefficients with 95 % intervals; of several, the one farthest from zero, whose interval does not allow for that choice. The minimum detectable size (found in four of five such sessions) is listed beside them: \
         an effect that was not found may still be there below it.",
        &[
            "effect",
            "kind",
            "held-out ratio (95 %)",
            "first coefficient",
            "minimum detectable, same unit",
            "odds by rows alone",
            "probability",
            "decided",
        ],
        rows,
    )
}
