//! Ranking of the candidate effects with their intervals, and which of them are hard to tell apart.

use super::wording::{number, plus_minus, unit};
use aloft_discover::{Candidate, Discovery};
use aloft_effects::EffectKind;
use aloft_page::{Block, Cell, Columns, Dots, Figure, HeatMap, Line, Scale, Section, Table, Words};

/// Number of candidates drawn.
const SHOWN: usize = 14;

/// The ranking; `suffix` keeps the identifiers unique if the page has several rankings.
pub fn ranking(d: &Discovery, suffix: &str) -> Section {
    let real: Vec<&Candidate> = d.candidates.iter().filter(|c| !c.placebo).collect();
    let shown: Vec<&Candidate> = real.iter().take(SHOWN).copied().collect();
    let mut blocks = vec![dots(d, &shown), table(d, &real).into()];
    blocks.extend(confusions(&shown));
    Section::new(
        format!("ranking{suffix}"),
        "The ranking",
        "Physics and artefacts of measurement in one list, best first.",
        blocks,
    )
}

fn kind(c: &Candidate) -> &'static str {
    if c.placebo {
        return "placebo";
    }
    match c.kind {
        EffectKind::Artefact => "artefact",
        _ => "physics",
    }
}

fn dots(d: &Discovery, shown: &[&Candidate]) -> Block {
    let mut rows = shown.to_vec();
    let placebos: Vec<&Candidate> = d.candidates.iter().filter(|c| c.placebo).take(2).collect();
    rows.extend(&placebos);
    let names: Vec<String> =
        rows.iter().map(|c| if c.placebo { format!("{} (placebo)", c.key) } else { c.key.clone() }).collect();
    let of = |wanted: &dyn Fn(&Candidate) -> bool, name: &str| Dots {
        name: name.to_owned(),
        values: rows.iter().map(|c| if wanted(c) { c.held_out_ratio } else { f64::NAN }).collect(),
        intervals: rows.iter().map(|c| if wanted(c) { c.ci95 } else { [f64::NAN; 2] }).collect(),
    };
    let kinds = [of(&|c| c.believed, "passes the tests by itself"), of(&|c| !c.believed, "does not")];
    let mut lines = vec![Line { at: 1.0, upright: true, label: "explains nothing".into() }];
    let floor = d.noise_floor / d.held_out_error;
    if floor.is_finite() && floor < 0.98 {
        lines.push(Line { at: floor, upright: true, label: "noise floor".into() });
    }
    let words = Words::new(
        "Held-out error with each effect over that without",
        "Points with 95 % intervals over flights or recordings. Left of 1 the effect improves the prediction of held-out motion; an interval that \
         reaches 1 is not significant. Placebos have no physical basis; an effect that does no better than a placebo is not supported.",
    );
    Figure::dots(words, "held-out ratio", &names, &kinds, &lines).into()
}

fn table(d: &Discovery, real: &[&Candidate]) -> Table {
    let rows = real
        .iter()
        .map(|c| {
            let first = aloft_analysis::verdict::shown_coefficient(c);
            let alike: Vec<String> =
                c.confused_with.iter().filter(|x| x.p_value > 0.05).map(|x| x.effect.clone()).collect();
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
                number(c.family_wise_p).into(),
                if alike.is_empty() { "–".into() } else { alike.join(", ").into() },
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
            "chance of the best",
            "cannot be told from",
            "decided",
        ],
        rows,
    )
}

/// How similar the signals of the best candidates are.
fn confusions(shown: &[&Candidate]) -> Option<Block> {
    let rows: Vec<&Candidate> = shown.iter().copied().filter(|c| !c.confused_with.is_empty()).take(8).collect();
    if rows.is_empty() {
        return None;
    }
    let mut columns: Vec<String> = Vec::new();
    for c in &rows {
        for x in &c.confused_with {
            if !columns.contains(&x.effect) && columns.len() < 12 {
                columns.push(x.effect.clone());
            }
        }
    }
    let z = rows
        .iter()
        .map(|c| {
            columns
                .iter()
                .map(|name| c.confused_with.iter().find(|x| &x.effect == name).map_or(f64::NAN, |x| x.cosine))
                .collect()
        })
        .collect();
    let map = HeatMap {
        x_title: "alternative effect".into(),
        x: Columns::Names(columns),
        y: rows.iter().map(|c| c.key.clone()).collect(),
        z,
        unit: "cosine".into(),
        step: 1e-3,
        scale: Scale::To(1.0),
        ..HeatMap::default()
    };
    let words = Words::new(
        "What looks alike",
        "Cosine between the signal of an effect (rows) and its best reproduction by another effect (columns), after projecting out the inertial parameters. Near 1 these recordings cannot distinguish the two, and the verdict names both.",
    );
    let advice: Vec<String> = rows
        .iter()
        .flat_map(|c| {
            c.confused_with.iter().filter(|x| x.p_value > 0.05 && !x.separate_by.is_empty()).map(move |x| (c, x))
        })
        .take(4)
        .map(|(c, x)| format!("{} and {}: {}", c.key, x.effect, x.separate_by))
        .collect();
    let mut blocks = vec![Figure::heat_map(words, &map).into()];
    if !advice.is_empty() {
        blocks.push(Block::text("What would separate them:"));
        blocks.push(Block::List { items: advice });
    }
    Some(Block::Folded { title: "What looks alike".into(), blocks })
}
