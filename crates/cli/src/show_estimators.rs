//! Tables on how far results can be trusted: the table of estimators, leaving trials out, the
//! assessment, the calibration.

use crate::render::{out, significant, table};
use crate::screen::labelled;
use crate::stop::Stop;
use aloft_analysis::assess::Assessment;
use aloft_analysis::compare::CalibrationView;
use aloft_analysis::estimators::{ErrorsBrief, EstimatorsView, LeaveOneOutView};
use aloft_analysis::impulse_mass::ImpulseMassView;
use aloft_analysis::next_flights::{Expected, NextFlights};
use aloft_analysis::wording::model_word;

fn number(value: Option<f64>) -> String {
    value.map_or("–".to_owned(), |x| significant(x, 3))
}

fn by_axis(values: Option<[Option<f64>; 3]>) -> String {
    values.map_or("–".to_owned(), |v| v.map(number).join(" "))
}

fn means(errors: Option<&ErrorsBrief>) -> [String; 2] {
    [number(errors.and_then(|e| e.force_mean_n)), number(errors.and_then(|e| e.moment_mean_nm))]
}

/// Table of rows × estimators × geometry.
pub fn estimators(view: &EstimatorsView) -> Result<(), Stop> {
    out(labelled("", &format!("{}: {}: {}", view.subject, view.judged_on, view.held_out)))?;
    let window = format!("{} s windows N", view.window_s);
    let mut t = table(&[
        "geometry",
        "rows",
        "estimator",
        "force x y z N",
        "moment x y z N·m",
        &window,
        "N·m",
        "σ_N-1/σ_N",
        "gate",
    ])
    .left(&[1, 2])
    .optional(&[3, 4]);
    for row in &view.table {
        let gate = match (&row.gate, &row.failed) {
            (Some(gate), _) if gate.passed => "passed",
            (Some(_), _) => "refused",
            (None, Some(_)) => "failed",
            (None, None) => "–",
        };
        let [force, moment] = means(row.windows.as_ref());
        t.add_row([
            row.geometry.to_owned(),
            row.rows.unwrap_or("–").to_owned(),
            format!("{}{}", model_word(row.estimator.unwrap_or("prior")), if row.chosen { " *" } else { "" }),
            by_axis(row.frames.map(|e| e.force_n)),
            by_axis(row.frames.map(|e| e.moment_nm)),
            force,
            moment,
            number(row.sigma_ratio),
            gate.to_owned(),
        ]);
    }
    if view.noise_frames.is_some() {
        let [force, moment] = means(view.noise_windows.as_ref());
        t.add_row([
            "–".to_owned(),
            "–".to_owned(),
            "noise floor".to_owned(),
            by_axis(view.noise_frames.map(|e| e.force_n)),
            by_axis(view.noise_frames.map(|e| e.moment_nm)),
            force,
            moment,
            "–".to_owned(),
            "–".to_owned(),
        ]);
    }
    out(t)?;
    out("mean absolute error; * the pipeline's choice")?;
    for row in &view.table {
        let name = format!(
            "{}, {} rows, {}",
            row.geometry,
            row.rows.unwrap_or("no"),
            model_word(row.estimator.unwrap_or("prior"))
        );
        if let Some(reason) = row.gate.as_ref().filter(|g| !g.passed).and_then(|g| g.reasons.last()) {
            out(labelled("refused: ", &format!("{name}: {reason}")))?;
        }
        if let Some(problem) = &row.failed {
            out(labelled("failed: ", &format!("{name}: {problem}")))?;
        }
    }
    for note in &view.notes {
        out(labelled("", note))?;
    }
    Ok(())
}

/// Each trial predicted from the others.
pub fn leave_one_out(view: &LeaveOneOutView) -> Result<(), Stop> {
    out(labelled(&format!("{}: ", view.subject), &view.words))?;
    let mut t = table(&[
        "trial",
        "model",
        "contact force x y z N",
        "moment x y z N·m",
        "windows N",
        "N·m",
        "flight force x y z N",
        "moment x y z N·m",
    ])
    .left(&[1]);
    let trials = view.models.first().map_or(0, |m| m.trials.len());
    for i in 0..trials {
        for model in &view.models {
            let Some(trial) = model.trials.get(i) else { continue };
            let [force, moment] = means(trial.contact_windows.as_ref());
            t.add_row([
                trial.trial.clone(),
                model_word(model.model).to_owned(),
                by_axis(trial.contact.map(|e| e.force_n)),
                by_axis(trial.contact.map(|e| e.moment_nm)),
                force,
                moment,
                by_axis(trial.flight.map(|e| e.force_n)),
                by_axis(trial.flight.map(|e| e.moment_nm)),
            ]);
        }
    }
    out(t)?;
    out("mean absolute error, root axes")?;
    for model in &view.models {
        if let Some(b) = &model.balance {
            out(labelled(
                "",
                &format!(
                    "{}: rows of contact count {} of a row of flight (held-out error {} against {})",
                    model_word(model.model),
                    significant(b.contact_weight, 2),
                    significant(b.contact_rms, 2),
                    significant(b.flight_rms, 2)
                ),
            ))?;
        }
        if let Some(problem) = &model.failed {
            out(labelled(&format!("{}: ", model_word(model.model)), problem))?;
        }
    }
    Ok(())
}

/// Number of parameters listed with a plan.
const WORST: usize = 8;

/// Window lengths, errors in variables, motions to add.
pub fn assessment(a: &Assessment) -> Result<(), Stop> {
    if let Some(window) = &a.window {
        out("")?;
        out(labelled("window of weak rows: ", &window.words))?;
    }
    for e in &a.errors_in_variables {
        out(labelled("errors in variables: ", &format!("{} ({} flights, {})", e.words, e.flights, e.estimator)))?;
    }
    if !a.motions.is_empty() {
        out("\nmotions that would improve the worst parameters most, if recorded next")?;
        let mut t =
            table(&["motion", "worst parameters, error falls by", "standard errors that improve most"]).wrapped(2);
        for m in &a.motions {
            let best: Vec<String> = m
                .best
                .iter()
                .take(3)
                .map(|(name, now, then)| format!("{name} {} to {}", significant(*now, 2), significant(*then, 2)))
                .collect();
            t.add_row([m.motion.clone(), format!("{:.0} %", 100.0 * m.gain), best.join("; ")]);
        }
        out(t)?;
    }
    if let Some(plan) = &a.next_flights {
        next_flights(plan)?;
    }
    for note in &a.notes {
        out(labelled("", note))?;
    }
    Ok(())
}

/// Flights for a robot to record next.
fn next_flights(plan: &NextFlights) -> Result<(), Stop> {
    out("\nflights to record next: hold the first posture of the file, let go, and play the file from that moment")?;
    let mut t = table(&["file", "s", "m/s up", "turn of the base rad/s", "fastest joint", "most torque"]);
    for f in &plan.flights {
        let [x, y, z] = f.turn_rad_s.map(|w| significant(w, 2));
        let effort = f.effort.as_ref().map_or_else(
            || "not checked".to_owned(),
            |(joint, share)| format!("{joint}, {:.0} % of the limit", 100.0 * share),
        );
        t.add_row([
            f.file.clone(),
            significant(f.duration_s, 2),
            significant(f.speed_up_m_s, 2),
            format!("{x}, {y}, {z}"),
            format!("{}, {}/s", f.fastest.0, significant(f.fastest.1, 2)),
            effort,
        ]);
    }
    out(t)?;
    for f in &plan.flights {
        let shows: Vec<String> = f
            .shows
            .iter()
            .take(4)
            .map(|(name, now, then)| format!("{name} ({} to {})", significant(*now, 2), significant(*then, 2)))
            .collect();
        out(labelled(&format!("{} shows: ", f.file), &shows.join(", ")))?;
    }
    let mut t = table(&["worst parameters", "unit", "standard error now", "after repeats", "after these flights"]);
    for p in plan.parameters[..plan.worst.min(plan.parameters.len())].iter().take(WORST) {
        let sd = [p.now, p.repeated, p.then].map(|x| significant(x, 2));
        let [now, repeated, then] = sd;
        t.add_row([p.name.clone(), p.unit.clone(), now, repeated, then]);
    }
    out(format!("\n{t}"))?;
    let worst = &plan.parameters[..plan.worst.min(plan.parameters.len())];
    let change = |of: &dyn Fn(&Expected) -> f64| {
        let logs = worst.iter().map(|p| (of(p) / p.now).ln()).sum::<f64>();
        100.0 * (1.0 - (logs / worst.len().max(1) as f64).exp())
    };
    let unmoved = worst.iter().filter(|p| p.then > 0.9 * p.now).count();
    let limit = if unmoved == 0 {
        String::new()
    } else {
        format!(
            "; {unmoved} of these {} improve by less than 10 %: no planned flight within the limits excites them",
            worst.len()
        )
    };
    out(labelled(
        "expected: ",
        &format!(
            "the worst quarter of the standard errors falls by {:.0} %, and by {:.0} % after {} repeats of {}, the best of \
             the recorded flights{limit}",
            change(&|p| p.then),
            change(&|p| p.repeated),
            plan.flights.len(),
            plan.repeated
        ),
    ))?;
    for note in &plan.notes {
        out(labelled("", note))?;
    }
    Ok(())
}

/// Landmark geometry compared with calibrated geometry.
pub fn calibration(c: &CalibrationView) -> Result<(), Stop> {
    let r = &c.report;
    let [before, after] = c.held_out_rms_m;
    out(labelled(
        "",
        &format!(
            "calibration {}: marker RMS {:.2} to {:.2} mm on {} frames that took no part ({} took part)",
            if c.used { "used" } else { "not used" },
            1e3 * before,
            1e3 * after,
            r.frames_held_out,
            r.frames_used
        ),
    ))?;
    let mut t = table(&["joint", "centre moved mm", "SD mm", "axis turned °", "SD °"]);
    for j in &r.joints {
        let degrees = |v: Option<f64>| v.map_or("–".to_owned(), |x| significant(x.to_degrees(), 2));
        t.add_row([
            j.link.clone(),
            significant(1e3 * j.moved_m, 2),
            significant(1e3 * j.sd_m, 2),
            degrees(j.axis_turned_rad),
            degrees(j.axis_sd_rad),
        ]);
    }
    out(format!("{t}\n"))
}

/// Body mass from the impulse of the plates between flights.
pub fn impulse_mass(w: &ImpulseMassView) -> Result<(), Stop> {
    out(labelled(
        "mass by impulse: ",
        &format!(
            "{:.1} kg ({:.1} to {:.1} over {} contacts){}",
            w.mass_kg,
            w.range_kg[0],
            w.range_kg[1],
            w.contacts,
            w.doubt.as_ref().map_or(String::new(), |d| format!("; {d}"))
        ),
    ))
}
