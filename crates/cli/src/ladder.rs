//! Output of `history`, `effect add` and `effect remove`: the revisions of the model with the error
//! that each of them reached.

use crate::errors::{figure, judgement};
use crate::render::{beside, half, out, significant, unit};
use crate::screen::{Cell, labelled, table};
use crate::stop::Stop;
use aloft_analysis::history::{HeldValue, History, HistoryRow};
use aloft_compare::Signal;

/// The revisions of the model.
pub fn history(h: &History, details: bool) -> Result<(), Stop> {
    rungs(&h.revisions)?;
    for r in &h.revisions {
        remarks(r)?;
    }
    for r in &h.revisions {
        joints(r)?;
    }
    if let Some(last) = h.revisions.last() {
        coefficients(last)?;
    }
    if details { whole(&h.revisions) } else { Ok(()) }
}

/// What an `effect add` or `effect remove` reached: the last two revisions.
pub fn change(h: &History, details: bool) -> Result<(), Stop> {
    let from = h.revisions.len().saturating_sub(2);
    rungs(&h.revisions[from..])?;
    if let Some(last) = h.revisions.last() {
        remarks(last)?;
        joints(last)?;
        coefficients(last)?;
    }
    if details { whole(&h.revisions) } else { Ok(()) }
}

fn rungs(rows: &[HistoryRow]) -> Result<(), Stop> {
    let any = |place: &str| rows.iter().any(|r| r.errors.iter().any(|e| e.judged_on == place));
    for place in ["flight", "contact"].into_iter().filter(|p| any(p)) {
        let head = format!("held out in {place}");
        let header =
            ["rev", &head, "error N", "force N", "moment N·m", "floor N", "floor 95 %", "times floor", "judged"];
        let mut t = table(&header).left(&[1, 8]).optional(&[6, 3, 4]);
        for r in rows {
            let e = r.errors.iter().find(|e| e.judged_on == place);
            let interval = e
                .and_then(|e| e.noise_floor_ci95)
                .map_or("–".to_owned(), |[a, b]| format!("{} to {}", significant(a, 3), significant(b, 3)));
            t.add_row([
                Cell::from(r.revision.to_string()),
                r.action.clone().into(),
                figure(e.map(|e| e.held_out_error)).into(),
                figure(e.and_then(|e| e.held_out_force_n)).into(),
                figure(e.and_then(|e| e.held_out_moment_nm)).into(),
                figure(e.and_then(|e| e.noise_floor)).into(),
                interval.into(),
                e.and_then(|e| e.times_floor).map_or("–".to_owned(), |t| significant(t, 2)).into(),
                e.map_or_else(|| Cell::from("–"), judgement),
            ]);
        }
        out(t)?;
    }
    if !any("flight") && !any("contact") {
        out("no revision has an error yet: run the pipeline first")?;
    }
    Ok(())
}

/// What has to be known before two revisions are compared.
fn remarks(r: &HistoryRow) -> Result<(), Stop> {
    let label = format!("revision {}: ", r.revision);
    for text in [&r.trials_changed, &r.void].into_iter().flatten() {
        out(labelled(&label, &crate::screen::paint(text, Signal::Fair)))?;
    }
    Ok(())
}

/// Torques of the joints whose laws a revision changed, before and after.
fn joints(r: &HistoryRow) -> Result<(), Stop> {
    if r.joints.is_empty() {
        return Ok(());
    }
    let head = format!("torques held out, revision {}", r.revision);
    let mut t = table(&[head.as_str(), "error before", "error", "floor", "unit", "times floor"]).left(&[4]);
    for j in &r.joints {
        t.add_row([
            format!("  {}", j.now.joint),
            figure(j.held_out_error_before),
            figure(Some(j.now.held_out_error)),
            figure(j.now.noise_floor),
            j.now.unit.clone(),
            j.times_floor.map_or("–".to_owned(), |t| significant(t, 2)),
        ]);
    }
    out(t)
}

fn coefficients(r: &HistoryRow) -> Result<(), Stop> {
    if r.coefficients.is_empty() {
        return Ok(());
    }
    let head = format!("revision {}", r.revision);
    let mut t = table(&[head.as_str(), "value", "± 95 %", "unit"]).left(&[3]);
    for c in &r.coefficients {
        t.add_row([format!("  {}", c.name), beside(c.value, c.ci95), half(c.ci95), unit(&c.unit)]);
    }
    out(t)?;
    if !r.held.is_empty() {
        out(labelled("held: ", &held(&r.held).join(", ")))?;
    }
    for caution in &r.cautions {
        out(labelled("caution: ", &crate::screen::paint(caution, Signal::Fair)))?;
    }
    Ok(())
}

/// Values that effects hold; the three coordinates of a vector stand together.
fn held(values: &[HeldValue]) -> Vec<String> {
    let mut out = Vec::new();
    let mut rest = values;
    while let [first, others @ ..] = rest {
        let vector = first.name.strip_suffix("_x").zip(others.get(..2)).filter(|(name, yz)| {
            yz[0].name.strip_suffix("_y") == Some(*name) && yz[1].name.strip_suffix("_z") == Some(*name)
        });
        let (words, taken) = match vector {
            Some((name, yz)) => {
                let all = [first, &yz[0], &yz[1]].map(|h| significant(h.value, 3)).join(", ");
                (format!("{name} ({all}) {}", unit(&first.unit)), 3)
            }
            None => (format!("{} {} {}", first.name, significant(first.value, 3), unit(&first.unit)), 1),
        };
        out.push(words.trim_end().to_owned());
        rest = &rest[taken..];
    }
    out
}

fn whole(rows: &[HistoryRow]) -> Result<(), Stop> {
    out("")?;
    let mut t = table(&[
        "rev",
        "effects",
        "judged on",
        "explainable %",
        "σ_N-1/σ_N",
        "marker RMS mm",
        "largest change of a base parameter",
    ])
    .left(&[2])
    .wrapped(1);
    for r in rows {
        t.add_row([
            r.revision.to_string(),
            if r.effects.is_empty() { "none".into() } else { r.effects.join(", ") },
            r.judged_on.map_or("–".to_owned(), |j| j.describe().to_owned()),
            r.explainable.map_or("–".to_owned(), |x| format!("{:.0}", 100.0 * x)),
            figure(r.sigma_ratio),
            figure(r.marker_rms_mm),
            r.largest_change.as_ref().map_or("–".to_owned(), |(name, x)| {
                format!("{name} {}{}", if *x < 0.0 { "" } else { "+" }, significant(*x, 2))
            }),
        ]);
    }
    out(t)
}
