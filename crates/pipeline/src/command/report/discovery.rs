//! What is missing, and the ladder of revisions.

use super::words::{card, number};
use crate::command::effect::{HistoryRow, history};
use crate::error::PipelineError;
use crate::study::Study;
use crate::workspace::read_json;
use aloft_discover::{Discovery, Verdict};
use aloft_report::{Block, Figure, Light, Section, Series, Table};

/// What the last `discover` said, where there was one.
pub fn missing(study: &Study) -> Option<Section> {
    let d: Discovery = read_json(&study.workspace.join("discovery.json")).ok()?;
    let light = match d.verdict {
        Verdict::NothingMissing => Light::Good,
        Verdict::Supported | Verdict::OneOf => Light::Fair,
        Verdict::NotDetectable => Light::Neutral,
    };
    let ranked: Vec<_> = d.candidates.iter().filter(|c| !c.placebo).take(12).collect();
    let names: Vec<String> = ranked.iter().map(|c| c.key.clone()).collect();
    let ratios = ranked.iter().map(|c| c.held_out_ratio).collect();
    let halves = ranked.iter().map(|c| (c.ci95[1] - c.ci95[0]) / 2.0).collect();
    let mut blocks = vec![
        Block::Remark { text: d.words.clone(), light },
        Block::Cards {
            cards: vec![
                card(
                    "Held-out error before",
                    format!("{} N", number(d.held_out_error)),
                    format!("{:.2} % of body weight", 100.0 * d.held_out_error_of_weight),
                    Light::Neutral,
                ),
                card(
                    "With the effects found",
                    format!("{} N", number(d.held_out_error_after)),
                    String::new(),
                    Light::Neutral,
                ),
                card(
                    "Noise of the markers alone",
                    format!("{} N", number(d.noise_floor)),
                    "what no model can remove".into(),
                    Light::Neutral,
                ),
            ],
        },
        Block::Figure {
            figure: Figure::bars(
                "Held-out error with each effect over that without (95 % interval); 1 means that it explains nothing",
                "ratio",
                &names,
                &[("held-out ratio".to_owned(), ratios, halves)],
            ),
        },
    ];
    let rows = ranked
        .iter()
        .map(|c| {
            let first = c.coefficients.first();
            let like: Vec<&str> =
                c.confused_with.iter().filter(|x| x.p_value > 0.05).map(|x| x.effect.as_str()).collect();
            vec![
                c.key.clone(),
                format!("{:.3} ({:.2} to {:.2})", c.held_out_ratio, c.ci95[0], c.ci95[1]),
                first.map_or("–".into(), |e| {
                    format!("{} {} ± {} {}", e.name, number(e.value), number(1.96 * e.se), e.unit)
                }),
                number(c.minimum_detectable),
                if like.is_empty() { "–".into() } else { like.join(", ") },
                if c.believed { "yes".into() } else { "no".into() },
            ]
        })
        .collect();
    blocks.push(Block::Table {
        table: Table {
            caption: "Candidates: physics and measurement artefacts in one ranking".into(),
            header: [
                "effect",
                "held-out ratio",
                "coefficient",
                "smallest that would be seen",
                "cannot be told from",
                "believed",
            ]
            .map(str::to_owned)
            .to_vec(),
            rows,
        },
    });
    blocks.extend(d.advice.iter().map(|a| Block::Text { text: format!("Next recording: {a}") }));
    Some(Section {
        id: "missing".into(),
        title: "What is missing".into(),
        lead: "Every effect was refitted together with the inertial parameters and judged on flights or trials that took no part.".into(),
        blocks,
    })
}

/// The revisions of the model, where there is more than one.
pub fn ladder(study: &Study) -> Result<Option<Section>, PipelineError> {
    let h = history(study)?;
    if h.revisions.len() < 2 {
        return Ok(None);
    }
    let x: Vec<f64> = h.revisions.iter().map(|r| r.revision as f64).collect();
    let of = |get: &dyn Fn(&HistoryRow) -> Option<f64>| {
        h.revisions.iter().map(|r| get(r).unwrap_or(f64::NAN)).collect::<Vec<f64>>()
    };
    let mut error = Series::line("held-out error", x.clone(), of(&|r| r.held_out_error));
    error.mode = "lines+markers";
    let floor = Series::line("noise alone", x, of(&|r| r.noise_floor)).dashed();
    let rows = h
        .revisions
        .iter()
        .map(|r| {
            vec![
                format!("{} ({})", r.revision, r.action),
                if r.effects.is_empty() { "none".into() } else { r.effects.join(", ") },
                r.held_out_error.map_or("–".into(), number),
                r.noise_floor.map_or("–".into(), number),
                r.coefficients
                    .iter()
                    .map(|c| format!("{} {} ± {}", c.name, number(c.value), number(1.96 * c.se)))
                    .collect::<Vec<_>>()
                    .join("; "),
                r.void.clone().unwrap_or_default(),
            ]
        })
        .collect();
    Ok(Some(Section {
        id: "ladder".into(),
        title: "The ladder".into(),
        lead: "Each revision of the model and the error that it left on held-out motion.".into(),
        blocks: vec![
            Block::Figure {
                figure: Figure::lines(
                    "Held-out error (weak windows) of each model revision",
                    "revision",
                    "N",
                    vec![error, floor],
                ),
            },
            Block::Table {
                table: Table {
                    caption: "Revisions".into(),
                    header: ["revision", "effects", "held-out error, N", "noise, N", "coefficients", "remark"]
                        .map(str::to_owned)
                        .to_vec(),
                    rows,
                },
            },
        ],
    }))
}
