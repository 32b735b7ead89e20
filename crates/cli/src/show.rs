//! Results as tables for people.

use crate::commands::Stop;
use crate::render::{out, significant, table};
use aloft_pipeline::command::compare::{ComparisonView, errors_of, judged_on, mean};
use aloft_pipeline::command::parameters::ParametersView;

fn three(v: &[f64; 3]) -> String {
    v.iter().map(|x| significant(*x, 3)).collect::<Vec<_>>().join(" ")
}

/// Base parameters, links, singular values, and how far they may be believed.
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
            significant(1.96 * b.se, 2),
            b.prior.map_or("–".to_owned(), |v| significant(v, 3)),
            b.unit.clone(),
            format!("{:?}", b.seen).to_lowercase(),
            if b.formula.chars().count() > 60 {
                format!("{}…", b.formula.chars().take(59).collect::<String>())
            } else {
                b.formula.clone()
            },
        ]);
    }
    out(t)?;
    for e in &p.effects {
        out(format!("effect {}: {} ± {}", e.name, significant(e.value, 4), significant(1.96 * e.se, 2)))?;
    }
    if !p.links.is_empty() {
        let mut t =
            table(&["link", "mass kg", "prior kg", "centre of mass m", "prior m", "principal inertias kg·m²", "seen"]);
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
                format!("{:?}", l.seen).to_lowercase(),
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

/// The few lines that end a run.
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
            "noise alone".to_owned(),
            three(&frames.force_n.mae),
            three(&frames.moment_nm.mae),
            significant(mean(&windows.force_n.mae), 3),
            significant(mean(&windows.moment_nm.mae), 3),
        ]);
    }
    out(format!("on {} (frames; windows of {} s)\n{t}", judged_on(c), c.options.window_s))
}

/// The whole comparison.
pub fn comparison(view: &ComparisonView) -> Result<(), Stop> {
    brief(view)?;
    let c = &view.comparison;
    let mut t =
        table(&["trial", "role", "marker RMS mm", "flights", "fall vs g %", "contact N", "N·m", "flight N", "N·m"]);
    for row in &view.kinematics {
        let errors = c.first.trials.iter().find(|t| t.trial == row.trial);
        let number = |v: Option<f64>| v.map_or("–".to_owned(), |x| significant(x, 3));
        t.add_row([
            row.trial.clone(),
            row.role.to_owned(),
            number(row.marker_rms_mm),
            row.flights.map_or("–".to_owned(), |n| n.to_string()),
            number(row.gravity_error_percent),
            number(errors.map(|e| e.contact.force_n.mean_mae())),
            number(errors.map(|e| e.contact.moment_nm.mean_mae())),
            number(errors.map(|e| e.flight.force_n.mean_mae())),
            number(errors.map(|e| e.flight.moment_nm.mean_mae())),
        ]);
    }
    out(format!("\n{t}"))?;
    if let Some(calibration) = &view.calibration {
        crate::show_estimators::calibration(calibration)?;
    }
    if let Some(weighed) = &view.impulse_mass {
        crate::show_estimators::impulse_mass(weighed)?;
    }
    let f = &c.first.flight;
    out(format!(
        "residual wrench in flight, RMS: force {} N, moment {} N·m ({} frames)\n",
        three(&f.residual_force_n.rms),
        three(&f.residual_moment_nm.rms),
        f.frames
    ))?;
    let mut t = table(&["by", "group", "frames", "force MAE N", "moment MAE N·m"]);
    for g in &c.first.breakdown {
        t.add_row([
            format!("{:?}", g.by),
            g.name.clone(),
            g.errors.frames.to_string(),
            significant(g.errors.force_n.mean_mae(), 3),
            significant(g.errors.moment_nm.mean_mae(), 3),
        ]);
    }
    out(t)?;
    for line in &c.words {
        out(line)?;
    }
    Ok(())
}

/// The catalogue of effects.
pub fn effects(list: &[&aloft_effects::EffectDefinition]) -> Result<(), Stop> {
    let mut t = table(&["effect", "what", "kind"]);
    for e in list {
        t.add_row([e.id.to_owned(), e.title.to_owned(), format!("{:?}", e.kind).to_lowercase()]);
    }
    if let Some(column) = t.column_mut(1) {
        column.set_cell_alignment(comfy_table::CellAlignment::Left);
    }
    out(t)
}

/// What is missing.
pub fn discovery(d: &aloft_discover::Discovery) -> Result<(), Stop> {
    let verdict = match d.verdict {
        aloft_discover::Verdict::Supported => "supported",
        aloft_discover::Verdict::OneOf => "one of",
        aloft_discover::Verdict::NothingMissing => "nothing missing",
        aloft_discover::Verdict::NotDetectable => "not detectable",
    };
    out(format!(
        "verdict: {verdict}{}",
        if d.effects.is_empty() { String::new() } else { format!(": {}", d.effects.join(", ")) }
    ))?;
    out(&d.words)?;
    out(format!(
        "held-out error {} N ({} % of body weight), noise alone {} N, with the effects found {} N\n",
        significant(d.held_out_error, 3),
        significant(100.0 * d.held_out_error_of_weight, 2),
        significant(d.noise_floor, 3),
        significant(d.held_out_error_after, 3)
    ))?;
    for found in &d.found {
        for c in found.nonlinear.iter().chain(&found.coefficients) {
            out(format!(
                "  {} {}: {} ± {} {}",
                found.key,
                c.name,
                significant(c.value, 4),
                significant(1.96 * c.se, 2),
                c.unit
            ))?;
        }
    }
    let mut t =
        table(&["effect", "held-out ratio", "95 %", "coefficient", "± 95 %", "smallest seen", "unit", "like it"]);
    for c in d.candidates.iter().filter(|c| !c.placebo).take(15) {
        let first = c.coefficients.first();
        let like: Vec<&str> =
            c.confused_with.iter().filter(|x| x.p_value > 0.05).map(|x| x.effect.as_str()).take(3).collect();
        t.add_row([
            c.key.clone(),
            format!("{:.3}", c.held_out_ratio),
            format!("{:.2}–{:.2}", c.ci95[0], c.ci95[1]),
            first.map_or("–".into(), |e| significant(e.value, 3)),
            first.map_or("–".into(), |e| significant(1.96 * e.se, 2)),
            significant(c.minimum_detectable, 2),
            first.map_or(String::new(), |e| e.unit.clone()),
            like.join(" "),
        ]);
    }
    out(t)?;
    for a in &d.advice {
        out(format!("next: {a}"))?;
    }
    if let Some(found) = d.found.first() {
        out(format!("add it: aloft effect add P.yaml {}", found.key))?;
    }
    Ok(())
}

/// The ladder.
pub fn history(h: &aloft_pipeline::command::effect::History) -> Result<(), Stop> {
    let mut t = table(&[
        "revision",
        "what",
        "effects",
        "held-out error N",
        "noise N",
        "in flight N",
        "σ_N-1/σ_N",
        "coefficients",
    ]);
    let number = |v: Option<f64>| v.map_or("–".to_owned(), |x| significant(x, 3));
    for r in &h.revisions {
        let coefficients: Vec<String> = r
            .coefficients
            .iter()
            .map(|c| format!("{} {} ± {}", c.name, significant(c.value, 4), significant(1.96 * c.se, 2)))
            .collect();
        t.add_row([
            r.revision.to_string(),
            r.action.clone(),
            if r.effects.is_empty() { "none".into() } else { r.effects.join(", ") },
            number(r.held_out_error),
            number(r.noise_floor),
            number(r.flight_error),
            number(r.sigma_ratio),
            coefficients.join("; "),
        ]);
        if let Some(void) = &r.void {
            out(format!("revision {}: {void}", r.revision))?;
        }
    }
    out(t)
}
