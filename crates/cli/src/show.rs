//! Results as tables.

use crate::render::{beside, half, out, significant, table};
use crate::screen::{Cell, labelled};
use crate::stop::Stop;
use aloft_analysis::compare::{ComparisonView, errors_of, judged_on, mean};
use aloft_analysis::parameters::{ParametersView, half_of};
use aloft_analysis::summary::Summary;
use aloft_analysis::wording::model_word;
use aloft_compare::Signal;
use aloft_study::quote::visible;

/// Number of the smallest singular values that are printed in units of the noise.
const SMALLEST_IN_NOISE: usize = 4;

pub(crate) fn three(v: &[f64; 3]) -> String {
    v.iter().map(|x| significant(*x, 3)).collect::<Vec<_>>().join(" ")
}

/// Base parameters, links, singular values, and how far they can be trusted.
pub fn parameters(view: &ParametersView) -> Result<(), Stop> {
    let p = &view.parameters;
    let words = format!(
        "{}: {} in {} trials, {} {} rows, {} ({})",
        crate::errors::short(&view.subject),
        p.stretches(),
        p.n_trials,
        p.n_rows,
        view.rows_used,
        p.estimator.name(),
        p.se_from
    );
    out(labelled("", &words))?;
    out(format!(
        "singular values: σ_1 {}  σ_N-1 {}  σ_N {}  σ_N-1/σ_N {}\n",
        significant(p.sigma.max, 5),
        significant(p.sigma.second, 4),
        significant(p.sigma.min, 4),
        significant(p.sigma.ratio, 3)
    ))?;
    if let Some(units) = &p.noise_units {
        let smallest: Vec<String> = units.sigma.iter().take(SMALLEST_IN_NOISE).map(|s| significant(*s, 3)).collect();
        let names = units.of_table.join(", ");
        let left = match units.undetermined {
            0 => "the motion determines every direction but the scale".to_owned(),
            1 if units.ratios => {
                format!("the motion fixes the ratios of {names}, not their size: that is the tables'")
            }
            1 => format!("the motion leaves one direction to the tables ({names})"),
            n => format!("the motion leaves {n} directions to the tables ({names})"),
        };
        let residual = significant(units.residual, 3);
        let words = format!("{} …, residual {residual} (1 if nothing is missing): {left}", smallest.join("  "));
        out(labelled("in units of the noise: ", &words) + "\n")?;
    }
    let mut t = table(&["parameter", "value", "± 95 %", "tables", "unit", "seen", "regrouping"]).left(&[5]).wrapped(6);
    for b in &p.base {
        t.add_row([
            b.name.clone(),
            beside(b.value, b.ci95),
            // the total mass is not measured: it fixes the scale
            if b.ci95.is_some_and(|[low, high]| low == high) { "as stated".to_owned() } else { half(b.ci95) },
            b.prior.map_or("–".to_owned(), |v| significant(v, 3)),
            b.unit.clone(),
            b.determined_by().to_owned(),
            crate::screen::cut(&b.formula, 60),
        ]);
    }
    out(t)?;
    for e in &p.effects {
        match &e.not_determined {
            Some(why) => out(labelled("effect ", &format!("{}: not determined, {why}", e.name)))?,
            None => {
                out(labelled("effect ", &format!("{}: {} ± {} (95 %)", e.name, beside(e.value, e.ci95), half(e.ci95))))?
            }
        }
    }
    if !p.links.is_empty() {
        let mut t = table(&[
            "link",
            "mass kg",
            "± 95 %",
            "tables kg",
            "centre of mass m",
            "± mm",
            "tables m",
            "principal inertias kg·m²",
            "from",
        ])
        .wrapped(8);
        for l in &p.links {
            let inertia = l.inertia().inertia_com_kgm2.symmetric_eigenvalues();
            let mut principal = [inertia[0], inertia[1], inertia[2]];
            principal.sort_by(f64::total_cmp);
            t.add_row([
                l.name.clone(),
                beside(l.mass_kg, l.ci95.mass_kg),
                half(l.ci95.mass_kg),
                significant(l.prior.mass_kg, 4),
                three(&l.com_m),
                distance_mm(&l.ci95.com_m),
                three(&l.prior.com_m.into()),
                three(&principal),
                l.from.describe(),
            ]);
        }
        out(format!("\nphysically consistent links\n{t}"))?;
    }
    out(labelled("±: ", p.intervals_hold()))?;

    for reason in p.gate.reasons.iter().chain(&p.gate.advice) {
        out(labelled("- ", reason))?;
    }
    match &view.assessment {
        Some(assessment) => crate::show_estimators::assessment(assessment),
        None => Ok(()),
    }
}

/// Half of the intervals of a point's coordinates as a distance, mm; a dash if one is not known.
fn distance_mm(ci95: &[Option<[f64; 2]>; 3]) -> String {
    let square = |ci: &Option<[f64; 2]>| half_of(*ci).map(|h| h * h);
    let sum: Option<f64> = ci95.iter().map(square).sum();
    sum.map_or("–".to_owned(), |s| significant(1000.0 * s.sqrt(), 2))
}

/// Single frames and windows axis by axis: details.
pub fn frames(view: &ComparisonView) -> Result<(), Stop> {
    let c = &view.comparison;
    let p = &view.parameters;
    out(format!("\n{} rows, σ_N-1/σ_N {}", p.rows, significant(p.sigma_ratio, 3)))?;
    let header = [
        "mean absolute error",
        "force x N",
        "y N",
        "z N",
        "moment x N·m",
        "y N·m",
        "z N·m",
        "windows N",
        "windows N·m",
    ];
    let mut t = table(&header);
    let mut row = |name: &str, f: &[f64; 3], n: &[f64; 3], wf: &[f64; 3], wn: &[f64; 3]| {
        let mut cells = vec![name.to_owned()];
        cells.extend(f.iter().chain(n).map(|x| significant(*x, 3)));
        cells.extend([significant(mean(wf), 3), significant(mean(wn), 3)]);
        t.add_row(cells);
    };
    for m in c.models() {
        let (f, n, wf, wn) = errors_of(m);
        row(model_word(&m.model), &f, &n, &wf, &wn);
    }
    if let Some(floor) = &c.noise_floor {
        let (frames, windows) = if c.first.held_out.frames > 0 {
            (&floor.contact, &floor.contact_weak)
        } else {
            (&floor.flight, &floor.flight_weak)
        };
        row("noise floor", &frames.force_n.mae, &frames.moment_nm.mae, &windows.force_n.mae, &windows.moment_nm.mae);
    }
    out(labelled(
        "",
        &format!(
            "details on {}: mean absolute error on single frames, axes of the root; windows of {} s, mean of the world axes",
            judged_on(c),
            c.options.window_s
        ),
    ))?;
    out(t)
}

/// The table of all recordings.
pub fn summary(s: &Summary) -> String {
    let several = s.rows.iter().any(|r| r.session.is_some() || r.subject != s.rows[0].subject);
    let header =
        ["trial", "role", "markers", "gaps", "IK mm", "flights", "fall %", "flight N", "contact N", "qc", "reasons"];
    let mut t = table(&header).left(&[1, 9]).wrapped(10).optional(&[3, 2, 6]);
    let number = |v: Option<f64>, decimals: usize| v.map_or("–".to_owned(), |v| format!("{v:.decimals$}"));
    for r in &s.rows {
        let whose = [Some(&r.subject), r.session.as_ref()].into_iter().flatten().cloned().collect::<Vec<_>>().join(" ");
        let name = if several { format!("{whose} {}", r.trial) } else { r.trial.clone() };
        let codes: Vec<&str> = r.reasons.iter().map(|q| q.code()).collect();
        let signal = match r.qc.as_str() {
            "ok" => Signal::Good,
            "warning" => Signal::Fair,
            "failed" => Signal::Poor,
            _ => Signal::Unknown,
        };
        t.add_row([
            Cell::from(visible(&name)),
            r.role.clone().into(),
            match (r.markers, r.missing_markers) {
                (Some(m), Some(n)) => format!("{m}/{}", m + n),
                _ => "–".to_owned(),
            }
            .into(),
            r.gaps.map_or("–".to_owned(), |n| n.to_string()).into(),
            number(r.ik_error_mm, 1).into(),
            r.flights.map_or("–".to_owned(), |n| n.to_string()).into(),
            number(r.free_fall_error_percent, 1).into(),
            crate::errors::figure(r.flight_error_n).into(),
            crate::errors::figure(r.contact_error_n).into(),
            Cell::judged(r.qc.clone(), signal),
            codes.join(" ").into(),
        ]);
    }
    let of = |word: &str| s.rows.iter().filter(|r| r.qc == word).count();
    let mut lines = vec![t.to_string()];
    lines.push(format!(
        "{} trials: {} ok, {} with warnings, {} failed, {} excluded",
        s.rows.len(),
        of("ok"),
        of("warning"),
        of("failed"),
        of("excluded")
    ));
    for r in &s.reasons {
        lines.push(labelled("  ", &format!("{} ({}): {} {}", r.reason, r.trials, r.meaning, r.advice)));
    }
    lines.join("\n")
}
