//! The methods paragraph: describes the processing with the figures of this study, ready to paste
//! into a paper.

use crate::compare::compare_if_made;
use crate::history::history;
use crate::parameters::parameters_if_made;
use crate::wording::unit;
use aloft_body::Subject;
use aloft_flight::FlightReport;
use aloft_pipeline::stages::filter::low_pass;
use aloft_signal::mean_and_deviation;
use aloft_study::subject_session::SubjectSession;
use aloft_workspace::error::PipelineError;
use aloft_workspace::json::read_json_if_there;
use aloft_workspace::manifest::WHOLE_STUDY;
use aloft_workspace::workspace::Workspace;
use std::collections::BTreeSet;

/// Mean and standard deviation as text.
fn mean_sd(values: &[f64], decimals: usize) -> String {
    match mean_and_deviation(values) {
        Some((mean, sd)) if sd.is_finite() => format!("{mean:.decimals$} ± {sd:.decimals$}"),
        Some((mean, _)) => format!("{mean:.decimals$}"),
        None => "–".to_owned(),
    }
}

fn listed(values: &BTreeSet<String>) -> String {
    values.iter().cloned().collect::<Vec<_>>().join(" and ")
}

/// The paragraph; `subject` is the model after calibration.
///
/// # Errors
/// Results that are damaged.
pub fn paragraph(session: &SubjectSession, ws: &Workspace, subject: &Subject) -> Result<String, PipelineError> {
    let mut t = match (&session.robot, &session.osim) {
        (Some(robot), _) => robot.kinematics_in_words() + &filtering(session, ""),
        (None, Some(osim)) => {
            recordings(session, ws, subject)? + " " + osim.kinematics_in_words().trim_end() + &filtering(session, "")
        }
        (None, None) => recordings(session, ws, subject)? + &kinematics(session, ws, subject)?,
    };
    t.push_str(&crate::methods_measured::corrected(session));
    t.push_str(&crate::methods_measured::tared(session, ws)?);
    t.push_str(&identification(session)?);
    for difference in aloft_pipeline::made::differences(session, ws)? {
        t.push_str(&format!(" {difference}."));
    }
    Ok(t)
}

/// Filter of the frame-wise comparison; `more` stands before the closing bracket.
fn filtering(session: &SubjectSession, more: &str) -> String {
    let spec = low_pass(&session.config.filter);
    format!(
        " For frame-wise comparison joint motion was filtered forward and backward with a Butterworth low-pass (order {} a pass, {} Hz{more}).",
        spec.order, spec.cutoff_hz
    )
}

fn recordings(session: &SubjectSession, ws: &Workspace, subject: &Subject) -> Result<String, PipelineError> {
    let (mut rates, mut plates, mut frames) = (BTreeSet::new(), 0, 0);
    let mut trials = 0;
    for trial in session.included().filter(|t| t.role.is_dynamic()) {
        let Some(m) = ws.usable("import", &trial.name)? else { continue };
        trials += 1;
        let number = |key: &str| m.summary.get(key).and_then(serde_json::Value::as_f64);
        rates.extend(number("rate_hz").map(|r| format!("{r}")));
        plates = plates.max(number("plates").unwrap_or(0.0) as usize);
        frames += number("frames").unwrap_or(0.0) as usize;
    }
    let with = match plates {
        0 => "no force plates".to_owned(),
        1 => "one force plate".to_owned(),
        n => format!("{n} force plates"),
    };
    Ok(format!(
        "{trials} dynamic trials ({frames} frames at {} Hz) of {} markers were recorded with {with}. Marker trajectories were brought to SI units and one world frame \
         with Z up; gaps of up to {} s were filled by cubic curves and of up to {} s from the other markers of the segment.",
        listed(&rates),
        subject.markers.len(),
        session.config.import.fill_gaps_s,
        session.config.import.rigid_fill_s
    ))
}

fn kinematics(session: &SubjectSession, ws: &Workspace, subject: &Subject) -> Result<String, PipelineError> {
    let model = &subject.model;
    let degrees = model.nv.saturating_sub(6);
    let mut t = if session.object.is_some() {
        format!(
            " A model of {} links and {degrees} joint degrees of freedom followed the object's description; its hinges were found from motion.",
            model.n_links()
        )
    } else {
        format!(
            " A model of {} links and {degrees} joint degrees of freedom was scaled to the static trial (hip joint centres after {}; inertias from tables: {}).",
            model.n_links(),
            capital(&session.config.scale.hip),
            session.anthropometry.title
        )
    };
    let calibrated = ws.manifest("calibrate", WHOLE_STUDY)?;
    let figure = |key: &str| calibrated.as_ref().and_then(|m| m.summary.get(key)).cloned();
    if figure("used").is_some_and(|v| v == true) {
        t.push_str(
            " Joint centres, hinge axes and marker places were refined over the dynamic trials on markers alone",
        );
        if let (Some(before), Some(after)) =
            (figure("rms_before_mm").and_then(|v| v.as_f64()), figure("rms_after_mm").and_then(|v| v.as_f64()))
        {
            t.push_str(&format!(" (held-out marker error {before:.1} to {after:.1} mm RMS)"));
        }
        t.push('.');
    }
    let (mut rms, mut durations, mut rates) = (Vec::new(), Vec::new(), BTreeSet::new());
    for trial in session.included().filter(|t| t.role.is_dynamic()) {
        if let Some(value) = ws.manifest("ik", &trial.name)?.and_then(|m| m.summary.get("marker_rms_mm")?.as_f64()) {
            rms.push(value);
        }
        let path = ws.place("flight", &trial.name).join("flights.json");
        if let Some(report) = read_json_if_there::<FlightReport>(&path)? {
            durations.extend(report.flights.iter().map(|f| f.duration_s(report.rate_hz)));
            rates.insert((report.rate_hz * 1e3).round() as u64);
        }
    }
    t.push_str(" Joint coordinates were found frame by frame by weighted non-linear least squares");
    if !rms.is_empty() {
        t.push_str(&format!(" (marker RMS {} mm over trials)", mean_sd(&rms, 1)));
    }
    t.push('.');
    let spec = low_pass(&session.config.filter);
    let described = |r: &u64| spec.describe(*r as f64 / 1e3).map_err(|e| PipelineError::request(e.to_string()));
    let facts = rates.first().map(described).transpose()?;
    let facts =
        facts.map(|f| format!("; effective order {}, −3 dB at {:.2} Hz", f.effective_order, f.true_minus3db_hz));
    t.push_str(&filtering(session, &facts.unwrap_or_default()));
    let mut has_plates = false;
    for t in session.included() {
        let imported = ws.manifest("import", &t.name)?;
        has_plates |= imported.and_then(|m| m.summary.get("plates")?.as_u64()).is_some_and(|n| n > 0);
    }
    if has_plates {
        t.push_str(" Plate forces went through the same filter.");
    }
    if !durations.is_empty() {
        t.push_str(&format!(
            " {} flights of {} s, in which {}, were found from {}.",
            durations.len(),
            mean_sd(&durations, 2),
            if session.effects.is_empty() { "gravity alone was taken to act" } else { "nothing touched the ground" },
            if has_plates { "plates and motion" } else { "motion" }
        ));
    }
    Ok(t)
}

fn identification(session: &SubjectSession) -> Result<String, PipelineError> {
    let mut t = String::new();
    if let Some(found) = parameters_if_made(session)? {
        let p = &found.parameters;
        t.push_str(&format!(
            " Base parameters ({}) were identified from {} in {} trials with {} rows ({} estimator), after Ayusawa, Venture and Nakamura (2010); \
             the body mass of {} kg fixed the scale, and σ(N−1)/σ(N) was {:.1}.",
            p.base.len(),
            p.stretches(),
            p.n_trials,
            if found.rows_used == "weak" { "weak-form momentum" } else { "acceleration" },
            p.estimator.name().replace('_', " "),
            p.mass_kg,
            p.sigma.ratio
        ));
        if !p.effects.is_empty() {
            t.push_str(&effects(session)?);
        }
    }
    if let Some(view) = compare_if_made(session)? {
        for e in view.errors {
            let mut parts = Vec::new();
            let figure = |x: f64| aloft_compare::significant(x, 3);
            if let (Some(force), Some(moment)) = (e.held_out_force_n, e.held_out_moment_nm) {
                parts.push(format!("force {} N, moment {} N·m", figure(force), figure(moment)));
            }
            if let Some(share) = e.held_out_error_of_weight {
                parts.push(format!("{} % of body weight", aloft_compare::significant(100.0 * share, 2)));
            }
            t.push_str(&format!(
                " In held-out {} the error of the predicted wrench over {} weak windows was {} N (root mean square of force, and of moment over a lever of \
                 0.1 m; {})",
                e.judged_on,
                e.windows,
                figure(e.held_out_error),
                parts.join("; ")
            ));
            let Some(floor) = e.noise_floor else {
                t.push('.');
                continue;
            };
            let floor = aloft_compare::floor_in_words(floor, e.noise_floor_ci95);
            let ratio = e.times_floor.map_or_else(
                || format!("; the noise floor is {floor}"),
                |times| format!(", {} times the noise floor of {floor}", aloft_compare::significant(times, 2)),
            );
            t.push_str(&format!("{ratio}: {}.", e.judged));
        }
        t.push_str(&crate::methods_measured::subtracted(&view.comparison));
    }
    Ok(t)
}

/// Effects of the model with their sizes, how they were chosen, and what is not certain of them.
fn effects(session: &SubjectSession) -> Result<String, PipelineError> {
    let figure = |x: f64| aloft_compare::significant(x, 3);
    let Some(now) = history(session)?.revisions.pop() else { return Ok(String::new()) };
    let sizes: Vec<String> = now
        .coefficients
        .iter()
        .map(|c| {
            let interval = c.ci95.map_or("no interval".to_owned(), |[low, high]| {
                format!("95 % interval {} to {}", figure(low), figure(high))
            });
            format!("{} {} {} ({interval})", c.name, figure(c.value), unit(&c.unit))
        })
        .collect();
    let names: BTreeSet<String> = now.effects.iter().cloned().collect();
    let mut t = format!(
        " The model includes {}: {}. These effects were chosen on the same recordings.",
        listed(&names),
        sizes.join("; ")
    );
    for caution in now.cautions {
        t.push_str(&format!(" Caution: {}.", caution.trim_end_matches('.')));
    }
    Ok(t)
}

/// An author's name, capitalised.
fn capital(name: &str) -> String {
    let mut letters = name.chars();
    letters.next().map_or(String::new(), |c| c.to_uppercase().chain(letters).collect())
}
