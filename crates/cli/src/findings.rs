//! Output of `discover`, `effect` and `history` as tables and text.

use crate::args::PipelineArgs;
use crate::open::description_of;
use crate::render::{half, out, plus_minus, significant, table};
use crate::stop::Stop;
use aloft_analysis::compare::JudgedOn;
use aloft_analysis::effect::{EffectLine, History};
use aloft_discover::{Candidate, Discovery, SelfTest, Verdict};
use aloft_effects::EffectKind;
use aloft_study::quote;
use comfy_table::CellAlignment;

/// The catalogue of effects.
pub fn effects(list: &[EffectLine]) -> Result<(), Stop> {
    let mut t = table(&["effect", "what", "kind", "acts in", "from"]);
    for e in list {
        let word = |x: String| x.to_lowercase();
        t.add_row([
            e.id.clone(),
            e.title.clone(),
            word(format!("{:?}", e.kind)),
            word(format!("{:?}", e.acts)),
            e.from.clone(),
        ]);
    }
    for column in 1..5 {
        if let Some(column) = t.column_mut(column) {
            column.set_cell_alignment(CellAlignment::Left);
        }
    }
    out(t)
}

fn names(list: &[String]) -> String {
    list.join(", ")
}

/// The verdict in its documented wording.
fn verdict(d: &Discovery) -> String {
    let kind = |id: &String| d.candidates.iter().find(|c| c.effect == *id).map(|c| c.kind);
    let artefact = !d.effects.is_empty() && d.effects.iter().all(|e| kind(e) == Some(EffectKind::Artefact));
    match d.verdict {
        Verdict::Supported if artefact => format!("artefact more likely: {}", names(&d.effects)),
        Verdict::Supported => format!("supported: {}", names(&d.effects)),
        Verdict::OneOf => format!("one of {{{}}}", names(&d.effects)),
        Verdict::NothingMissing if !d.not_tried.is_empty() => {
            let left: Vec<&str> = d.not_tried.iter().map(|n| n.effect.as_str()).collect();
            format!("nothing missing among what could be tried (not tried: {})", left.join(", "))
        }
        Verdict::NothingMissing => "nothing missing".to_owned(),
        Verdict::Unexplained => "unexplained".to_owned(),
        Verdict::NotDetectable => {
            let below = d.candidates.iter().find(|c| !c.placebo).map_or(String::new(), |c| {
                let unit = c.coefficients.first().map_or("", |e| e.unit.as_str());
                format!(" (below {} {unit} of {})", significant(c.minimum_detectable, 2), c.key)
            });
            format!("not detectable{below}")
        }
    }
}

/// The noise floor with its interval, as part of a sentence.
pub fn floor_in_words(noise_floor: f64, ci95: Option<[f64; 2]>) -> String {
    if !noise_floor.is_finite() {
        return "unknown (no comparison was made)".to_owned();
    }
    let interval = ci95.map_or(String::new(), |[a, b]| format!(" ({} to {})", significant(a, 3), significant(b, 3)));
    format!("{} N{interval}", significant(noise_floor, 3))
}

/// The discovery as text.
pub fn discovery(d: &Discovery, at: &PipelineArgs) -> Result<(), Stop> {
    out(format!("verdict: {}", verdict(d)))?;
    out(&d.words)?;
    out(format!(
        "held-out error {} N ({} % of body weight), noise floor {}, with the effects found {} N",
        significant(d.held_out_error, 3),
        significant(100.0 * d.held_out_error_of_weight, 2),
        floor_in_words(d.noise_floor, d.noise_floor_ci95),
        significant(d.held_out_error_after, 3)
    ))?;
    for (i, r) in d.rounds.iter().enumerate() {
        let (share, chance) = r.by_chance();
        out(format!(
            "round {}, judged in {} on {} flights or trials, model {}: {}; a ratio below {:.3} is believed (by chance {:.0} % of the best ratios fall \
             below {:.3})",
            i + 1,
            r.judged_on,
            r.clusters,
            if r.model.is_empty() { "without effects".to_owned() } else { format!("with {}", names(&r.model)) },
            r.words,
            r.threshold,
            100.0 * share,
            chance
        ))?;
    }
    for found in &d.found {
        for c in found.nonlinear.iter().chain(&found.coefficients) {
            out(format!(
                "  {} {}: {}{} {}",
                found.key,
                c.name,
                significant(c.value, 4),
                plus_minus(c.ci95, c.at_bound),
                c.unit
            ))?;
        }
        if !found.trials.is_empty() {
            out(format!("  {} acts in {}", found.key, names(&found.trials)))?;
        }
    }
    let mut t = table(&[
        "effect",
        "held-out ratio",
        "95 %",
        "chosen",
        "coefficient",
        "± 95 %",
        "minimum detectable",
        "unit",
        "confusable with",
    ]);
    for c in d.candidates.iter().filter(|c| !c.placebo).take(15) {
        let first = c.coefficients.first();
        t.add_row([
            c.key.clone(),
            format!("{:.3}", c.held_out_ratio),
            format!("{:.2}–{:.2}", c.ci95[0], c.ci95[1]),
            format!("{:.0} %", 100.0 * c.chosen_share),
            first.map_or("–".into(), |e| significant(e.value, 3)),
            first.map_or("–".into(), |e| if e.at_bound { "at its bound".to_owned() } else { half(e.ci95) }),
            significant(c.minimum_detectable, 2),
            first.map_or(String::new(), |e| e.unit.clone()),
            like(c).join(" "),
        ]);
    }
    out(format!("\n{t}"))?;
    if let Some(open) = &d.open {
        crate::laws::laws(open, at)?;
    }
    for w in &d.warnings {
        out(format!("left out: {w}"))?;
    }
    for n in &d.not_tried {
        out(format!("left out: {n}"))?;
    }
    for a in &d.advice {
        out(format!("next: {a}"))?;
    }
    for found in &d.found {
        let chosen = |flag: &str, names: &[String]| {
            names
                .iter()
                .flat_map(|n| quote::option(flag, n))
                .map(|w| format!(" {}", quote::word(&w)))
                .collect::<String>()
        };
        out(format!(
            "add it: aloft effect add {} {}{}{}",
            description_of(at),
            quote::word(&found.key),
            chosen("subject", &at.subject),
            chosen("session", &at.session)
        ))?;
    }
    Ok(())
}

/// Effects that cannot be told from this one: chance could explain the difference in rank (p >
/// 0.05).
fn like(c: &Candidate) -> Vec<&str> {
    c.confused_with.iter().filter(|x| x.p_value > 0.05).map(|x| x.effect.as_str()).take(3).collect()
}

/// How often injected effects are identified correctly.
pub fn self_test(s: &SelfTest) -> Result<(), Stop> {
    out("effects injected into these recordings, at multiples of the smallest size that could be seen")?;
    let mut t = table(&["times smallest", "injected", "right name", "right name or class", "wrong name", "missed"]);
    let percent = |x: f64| format!("{:.0} %", 100.0 * x);
    for row in &s.summary {
        t.add_row([
            significant(row.multiple, 2),
            row.injections.to_string(),
            percent(row.hit),
            percent(row.right),
            percent(row.wrong),
            percent((1.0 - row.right - row.wrong).max(0.0)),
        ]);
    }
    out(format!("{t}\n"))?;
    let mut t = table(&["effect", "times smallest", "size", "outcome", "named"]);
    for i in &s.injections {
        t.add_row([
            i.key.clone(),
            significant(i.multiple, 2),
            significant(i.size, 3),
            i.outcome.clone(),
            names(&i.named),
        ]);
    }
    if let Some(column) = t.column_mut(4) {
        column.set_cell_alignment(CellAlignment::Left);
    }
    out(t)
}

/// The revisions of the model.
pub fn history(h: &History) -> Result<(), Stop> {
    let mut t = table(&[
        "revision",
        "what",
        "effects",
        "held-out error N",
        "before",
        "noise floor N",
        "times floor",
        "explainable",
        "judged on",
        "flight N",
        "contact N",
        "σ_N-1/σ_N",
        "marker RMS mm",
        "largest change of a base parameter",
    ]);
    let number = |v: Option<f64>| v.map_or("–".to_owned(), |x| significant(x, 3));
    for r in &h.revisions {
        t.add_row([
            r.revision.to_string(),
            r.action.clone(),
            if r.effects.is_empty() { "none".into() } else { r.effects.join(", ") },
            number(r.held_out_error),
            number(r.held_out_error_before),
            number(r.noise_floor),
            match (r.times_floor, r.at_floor) {
                (Some(t), Some(true)) => format!("{} (at the floor)", significant(t, 2)),
                (Some(t), _) => significant(t, 2),
                _ => "–".to_owned(),
            },
            r.explainable.map_or("–".to_owned(), |x| format!("{:.0} %", 100.0 * x)),
            r.judged_on.map_or("–", JudgedOn::words).to_owned(),
            number(r.flight.map(|j| j.error_n)),
            number(r.contact.map(|j| j.error_n)),
            number(r.sigma_ratio),
            number(r.marker_rms_mm),
            r.largest_change.as_ref().map_or("–".to_owned(), |(name, x)| {
                format!("{name} {}{}", if *x < 0.0 { "" } else { "+" }, significant(*x, 2))
            }),
        ]);
    }
    out(t)?;
    for r in &h.revisions {
        for c in &r.coefficients {
            out(format!(
                "revision {}: {} {}{} (95 %)",
                r.revision,
                c.name,
                significant(c.value, 4),
                plus_minus(c.ci95, false)
            ))?;
        }
        if let Some(void) = &r.void {
            out(format!("revision {}: {void}", r.revision))?;
        }
    }
    Ok(())
}
