//! Results as tables.

use crate::render::{half, out, plus_minus, significant, table};
use crate::stop::Stop;
use aloft_analysis::compare::{ComparisonView, errors_of, judged_on, mean};
use aloft_analysis::parameters::ParametersView;
use aloft_compare::Comparison;

pub(crate) fn three(v: &[f64; 3]) -> String {
    v.iter().map(|x| significant(*x, 3)).collect::<Vec<_>>().join(" ")
}

/// Base parameters, links, singular values, and how far they can be trusted.
pub fn parameters(view: &ParametersView) -> Result<(), Stop> {
    let p = &view.parameters;
    out(format!(
        "{}: {} flights of {} trials, {} {} rows, {} ({})",
        view.subject,
        p.n_stretches,
        p.n_trials,
        p.n_rows,
        view.rows_used,
        p.estimator.name(),
        p.se_from
    ))?;
    out(format!(
        "singular values: σ_1 {}  σ_N-1 {}  σ_N {}  σ_N-1/σ_N {}\n",
        significant(p.sigma.max, 5),
        significant(p.sigma.second, 4),
        significant(p.sigma.min, 4),
        significant(p.sigma.ratio, 3)
    ))?;
    let mut t = table(&["parameter", "value", "± 95 %", "prior", "unit", "seen", "regrouping"]);
    for b in &p.base {
        t.add_row([
            b.name.clone(),
            significant(b.value, 4),
            half(b.ci95),
            b.prior.map_or("–".to_owned(), |v| significant(v, 3)),
            b.unit.clone(),
            b.standing().to_owned(),
            if b.formula.chars().count() > 60 {
                format!("{}…", b.formula.chars().take(59).collect::<String>())
            } else {
                b.formula.clone()
            },
        ]);
    }
    out(t)?;
    for e in &p.effects {
        match &e.not_determined {
            Some(why) => out(format!("effect {}: not determined, {why}", e.name))?,
            None => out(format!("effect {}: {}{} (95 %)", e.name, significant(e.value, 4), plus_minus(e.ci95, false)))?,
        }
    }
    if !p.links.is_empty() {
        let mut t =
            table(&["link", "mass kg", "prior kg", "centre of mass m", "prior m", "principal inertias kg·m²", "from"]);
        for l in &p.links {
            let inertia = l.inertia().inertia_com_kgm2.symmetric_eigenvalues();
            let mut principal = [inertia[0], inertia[1], inertia[2]];
            principal.sort_by(f64::total_cmp);
            t.add_row([
                l.name.clone(),
                significant(l.mass_kg, 4),
                significant(l.prior.mass_kg, 4),
                three(&l.com_m),
                three(&l.prior.com_m.into()),
                three(&principal),
                l.from.describe(),
            ]);
        }
        out(format!("\nphysically consistent links\n{t}"))?;
    }
    for reason in p.gate.reasons.iter().chain(&p.gate.advice) {
        out(reason)?;
    }
    match &view.assessment {
        Some(assessment) => crate::show_estimators::assessment(assessment),
        None => Ok(()),
    }
}

/// The short summary at the end of a run.
pub fn brief(view: &ComparisonView) -> Result<(), Stop> {
    let c = &view.comparison;
    out(format!(
        "{}: {} flights, {} rows, σ_N-1/σ_N {}",
        view.subject,
        view.parameters.flights,
        view.parameters.rows,
        significant(view.parameters.sigma_ratio, 3)
    ))?;
    let mut t = table(&["mean absolute error", "force x y z N", "moment x y z N·m", "windows N", "windows N·m"]);
    for m in c.models() {
        let (f, n, wf, wn) = errors_of(m);
        t.add_row([m.model.clone(), three(&f), three(&n), significant(mean(&wf), 3), significant(mean(&wn), 3)]);
    }
    if let Some(floor) = &c.noise_floor {
        let (frames, windows) = if c.first.held_out.frames > 0 {
            (&floor.contact, &floor.contact_weak)
        } else {
            (&floor.flight, &floor.flight_weak)
        };
        t.add_row([
            "noise floor".to_owned(),
            three(&frames.force_n.mae),
            three(&frames.moment_nm.mae),
            significant(mean(&windows.force_n.mae), 3),
            significant(mean(&windows.moment_nm.mae), 3),
        ]);
    }
    out(format!("on {} (frames; windows of {} s)\n{t}", judged_on(c), c.options.window_s))?;
    against_floor(c)
}

/// The held-out error over weak windows compared with the noise floor, in flight and in contact.
pub fn against_floor(c: &Comparison) -> Result<(), Stop> {
    for a in &c.against_floor {
        let Some(floor) = &a.floor else { continue };
        out(format!(
            "held out in {}: {} N over windows; noise floor {}; {}",
            a.judged_on,
            significant(a.held_out_error, 3),
            crate::findings::floor_in_words(floor.noise_floor, floor.ci95),
            match (a.times_floor, a.at_floor) {
                (_, Some(true)) => "at the floor".to_owned(),
                (Some(times), _) => format!("{} times the floor", significant(times, 2)),
                _ => "not compared".to_owned(),
            }
        ))?;
    }
    Ok(())
}

/// One line for a subject or session among several.
pub fn one_line(view: &ComparisonView) -> Result<(), Stop> {
    let c = &view.comparison;
    let (f, n, wf, wn) = errors_of(&c.first);
    out(format!(
        "{}: {} flights, σ_N-1/σ_N {}; {}: {} N, {} N·m on frames, {} N, {} N·m over windows",
        view.subject,
        view.parameters.flights,
        significant(view.parameters.sigma_ratio, 3),
        judged_on(c),
        significant(mean(&f), 3),
        significant(mean(&n), 3),
        significant(mean(&wf), 3),
        significant(mean(&wn), 3)
    ))
}
