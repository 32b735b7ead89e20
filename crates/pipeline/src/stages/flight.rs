//! `flight`: the intervals in which nothing touches the body, and what the plates read when nothing
//! stands on them.

use crate::graph::{Need, Scope, Stage, StageInputs, StageReport, StageWork, parameters_of, run_of};
use crate::stages::robot::CONTACT;
use aloft_body::{Motion, Subject};
use aloft_flight::{
    ContactSensor, Coverage, FlightError, FlightMethod, FlightOptions, FlightReport, FlightWarning, ImpulseMass,
    PlateDelay, PlateTare, TareSource, bounded_by_contact, coverage, find_flights, impulse_masses, plate_delays,
    plate_wrench_at_marker_rate, tare, total_wrench,
};
use aloft_study::config::{FlightConfig, FlightSource};
use aloft_study::subject_session::{Role, SubjectSession, TrialEntry};
use aloft_trial::Trial;
use aloft_workspace::disk::is_there;
use aloft_workspace::error::StageFailure;
use aloft_workspace::json::write_json;
use aloft_workspace::qc::QcReason;
use aloft_workspace::table::Table;
use aloft_workspace::warning::StageWarning;
use serde::Serialize;
use serde_json::json;

/// The stage.
pub static STAGE: Stage = Stage {
    name: "flight",
    version: 8,
    scope: Scope::Trial(&[Role::Identify, Role::Validate]),
    seconds: 0.03,
    reads: "`Motion`, plates, prior",
    gives: "flights (nothing touches the body); tare of the plates; contact that they measure completely",
    needs: &[Need::Same("import"), Need::Same("ik"), Need::Once("calibrate")],
    parameters: parameters_of::<Work>,
    run: run_of::<Work>,
};

/// Parameters of the stage.
#[derive(Debug, Serialize)]
pub struct Params {
    flight: FlightConfig,
    gravity_mps2: f64,
    role: Option<Role>,
    is_object: bool,
}

/// Work of the stage.
#[derive(Debug)]
pub struct Work;

impl StageWork for Work {
    type Params = Params;
    fn params(session: &SubjectSession, trial: Option<&TrialEntry>) -> Params {
        Params {
            flight: session.flight_of(trial).clone(),
            gravity_mps2: session.facts.gravity_mps2,
            role: trial.map(|t| t.role),
            is_object: session.is_rigid(),
        }
    }
    fn run(params: &Params, inputs: &StageInputs<'_>) -> Result<StageReport, StageFailure> {
        run(params, inputs)
    }
}

/// Standard deviation, common to the flights of a trial, of the ratio between measured and stated
/// free acceleration: for people (table masses, soft tissue) and for rigid objects.
const PERSON_RATIO_SD: f64 = 0.01;
const RIGID_RATIO_SD: f64 = 0.003;

/// Mean vertical acceleration of the centre of mass in flight over −g, minus one, percent; none
/// without flights or gravity.
pub fn gravity_error_percent(report: &FlightReport, gravity_mps2: f64) -> Option<f64> {
    let used: Vec<(f64, f64)> = report
        .flights
        .iter()
        .map(|f| (f.mean_acceleration_mps2[2], f.n_frames() as f64))
        .filter(|(a, _)| a.is_finite())
        .collect();
    let frames: f64 = used.iter().map(|u| u.1).sum();
    (frames > 0.0 && gravity_mps2 > 0.0)
        .then(|| (-used.iter().map(|u| u.0 * u.1).sum::<f64>() / frames / gravity_mps2 - 1.0) * 100.0)
}

/// A warning of the search with its reason.
fn with_reason(warning: &FlightWarning) -> StageWarning {
    let reason = match warning {
        FlightWarning::NotTared { .. } => QcReason::UntaredPlate,
        FlightWarning::FreeFall { .. } => QcReason::FreeFallOff,
        _ => QcReason::Remarks,
    };
    StageWarning::new(reason, warning.to_string())
}

fn run(params: &Params, inputs: &StageInputs<'_>) -> Result<StageReport, StageFailure> {
    let (name, config) = (inputs.trial()?, &params.flight);
    let mut trial = inputs.results.load_trial(name)?;
    let subject = inputs.results.load_subject("calibrate")?;
    let motion = inputs.results.load_motion("ik", name)?;
    let length_s = motion.n_frames() as f64 / motion.rate_hz;
    if let Some(wrong) = config.stated.iter().find(|f| f.from_s >= f.to_s.min(length_s)) {
        return Err(StageFailure::with_hint(
            format!(
                "the stated flight from {} to {} s is not inside the recording of {length_s:.3} s",
                wrong.from_s, wrong.to_s
            ),
            "`flight: {stated: [{from_s: …, to_s: …}]}` counts from the first frame; state it for one recording under `overrides`",
        ));
    }
    let options = FlightOptions {
        method: match config.source {
            _ if !config.stated.is_empty() => FlightMethod::Stated,
            FlightSource::Whole => FlightMethod::Stated,
            FlightSource::Auto => FlightMethod::Auto,
            FlightSource::Plates => FlightMethod::Plates,
            FlightSource::Motion => FlightMethod::Motion,
        },
        stated_s: config.stated.iter().map(|f| [f.from_s, f.to_s]).collect(),
        threshold_n: config.threshold_n,
        min_duration_s: config.min_duration_s,
        stature_m: subject.facts.height_m,
        ratio_sd: if params.is_object { RIGID_RATIO_SD } else { PERSON_RATIO_SD },
        ..FlightOptions::default()
    };
    let report = if subject.model.is_whole() {
        let prior = subject.prior_phi();
        find_flights(&trial, Some((&subject.model, &prior, &motion)), &options)
            .map_err(|e| StageFailure::new(e.to_string()))?
    } else {
        unloaded_only(&trial, &motion, &options).map_err(|e| StageFailure::new(e.to_string()))?
    };
    let sensors = contact_sensors(inputs, name)?;
    let report = if sensors.is_empty() { report } else { bounded_by_contact(report, &sensors, config.min_duration_s) };
    let tares = tare(&mut trial, &report.flights);
    write_json(&inputs.out.join("flights.json"), &report)?;
    write_json(&inputs.out.join("tare.json"), &tares)?;
    let covered = coverage(&trial, &subject, &motion, &report.flights, config.threshold_n)
        .map_err(|e| StageFailure::new(e.to_string()))?;
    write_json(&inputs.out.join("coverage.json"), &covered)?;
    let (weighed, delays) = between_flights(&trial, &subject, &motion, &report, &covered)?;
    write_json(&inputs.out.join("impulse_mass.json"), &weighed)?;
    write_json(&inputs.out.join("plate_delay.json"), &delays)?;
    let mut done = StageReport::default();
    done.note("flights", report.flights.len());
    done.note("flight_s", report.flight_frames() as f64 / report.rate_hz);
    if let Some(percent) = gravity_error_percent(&report, params.gravity_mps2) {
        done.note("gravity_error_percent", percent);
    }
    done.warnings.extend(report.warnings.iter().map(with_reason));
    let mut reasons = Vec::new();
    if let Some(fall) = &report.free_fall {
        done.note("free_fall_ratio", json!(fall.ratio));
        done.note("free_fall_ratio_ci95", json!(fall.ratio_ci95));
        done.note("free_fall_tilt_deg", json!(fall.tilt_deg));
        if fall.differs {
            done.note("free_fall_explanations", json!(fall.explanations));
            reasons.push(QcReason::FreeFallOff);
        }
    }
    if tares.iter().any(|t| t.source == TareSource::None) {
        reasons.push(QcReason::UntaredPlate);
    }
    if !tares.is_empty() {
        let of = |t: &PlateTare| t.force_n.iter().map(|f| f.z).sum::<f64>() / t.force_n.len().max(1) as f64;
        let known = tares.iter().map(|t| (t.plate.clone(), (t.source != TareSource::None).then(|| of(t))));
        done.note("tare_n", json!(known.collect::<std::collections::BTreeMap<_, _>>()));
        done.note("contact_measured_s", covered.complete_s());
        done.note("contact_left_out_s", covered.lost_s());
    }
    if let Some(sentence) = covered.sentence() {
        done.warnings.push(StageWarning::new(QcReason::PartlyMeasured, sentence));
        reasons.push(QcReason::PartlyMeasured);
    }
    let expected = params.role == Some(Role::Identify) && subject.model.is_whole();
    if expected && report.flights.is_empty() {
        reasons.push(QcReason::NoFlight);
    }
    done.note("qc", json!(reasons));
    if expected && report.flights.is_empty() {
        let why: Vec<String> =
            report.rejected.iter().take(3).map(|r| format!("frames {} to {}: {}", r.start, r.end, r.reason)).collect();
        let why = if why.is_empty() { seen_instead(&motion, config.min_duration_s) } else { why.join("; ") };
        done.warnings.push(format!("no flight found ({why})"));
    }
    Ok(done)
}

/// What a motion without flights shows.
fn seen_instead(motion: &Motion, min_duration_s: f64) -> String {
    let heights: Vec<f64> =
        motion.q.iter().skip(2).step_by(motion.nq.max(1)).copied().filter(|z| z.is_finite()).collect();
    let (low, high) = heights.iter().fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), z| (l.min(*z), h.max(*z)));
    match heights.len() {
        0 => "the motion is solved in no frame".to_owned(),
        n => format!(
            "{:.2} s of motion, in which the body's root rises and falls by {:.2} m, and its centre of mass never falls freely for {min_duration_s} s",
            n as f64 / motion.rate_hz,
            high - low
        ),
    }
}

/// Contact sensors of a robot's log; none where it has none.
fn contact_sensors(inputs: &StageInputs<'_>, name: &str) -> Result<Vec<ContactSensor>, StageFailure> {
    let path = inputs.results.place("import", name)?.join(CONTACT);
    if !is_there(&path)? {
        return Ok(Vec::new());
    }
    let columns = Table::read(&path)?.into_columns();
    let of = |(name, values): (String, Vec<f64>)| ContactSensor {
        name,
        touching: values.iter().map(|v| *v > 0.5).collect(),
    };
    Ok(columns.into_iter().map(of).collect())
}

/// Stretches between loads of the plates in which the markers fall, for the plates' tare: all that
/// a model says that is not the whole body. Its centre of mass is not the body's, so that neither
/// flights without plates nor free fall can be judged.
fn unloaded_only(trial: &Trial, motion: &Motion, options: &FlightOptions) -> Result<FlightReport, FlightError> {
    if trial.plates.is_empty() {
        let (trial, rate_hz) = (trial.name.clone(), motion.rate_hz);
        return Ok(FlightReport { trial, rate_hz, ..FlightReport::default() });
    }
    let mut report = find_flights(trial, None, &FlightOptions { method: FlightMethod::Plates, ..options.clone() })?;
    report.free_fall = None;
    report.warnings.retain(|w| !matches!(w, FlightWarning::FreeFall { .. }));
    Ok(report)
}

/// The body's mass and the delay of the tared plates from the impulse between flights.
fn between_flights(
    trial: &Trial,
    subject: &Subject,
    motion: &Motion,
    report: &FlightReport,
    covered: &Coverage,
) -> Result<(Vec<ImpulseMass>, Vec<PlateDelay>), StageFailure> {
    if trial.plates.is_empty() || report.flights.len() < 2 || !subject.model.is_whole() {
        return Ok((Vec::new(), Vec::new()));
    }
    let fail = |e: FlightError| StageFailure::new(e.to_string());
    let total = total_wrench(&plate_wrench_at_marker_rate(trial, None).map_err(fail)?);
    let (model, phi) = (&subject.model, subject.prior_phi());
    let mask = covered.mask();
    let measured = |f: usize| mask.get(f).copied().unwrap_or(false);
    Ok((
        impulse_masses(model, &phi, motion, &report.flights, &total).map_err(fail)?,
        plate_delays(model, &phi, motion, &report.flights, &total, measured).map_err(fail)?,
    ))
}
