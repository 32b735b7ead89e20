//! `compare`: model against measurement, read from the results of the stage `compare`.

use crate::held_out::{HeldOutError, best_grades, weight_n};
use crate::impulse_mass::{ImpulseMassView, impulse_mass};
use crate::kinematics::{KinematicsRow, failed_stage, kinematics};
use crate::to_correct::{LOUD, ToCorrect, of_static, to_correct};
use aloft_body::{EstimatedPoints, Subject};
use aloft_compare::{Comparison, Grade, ModelComparison};
use aloft_identify::{Determination, Origin, Parameters, Sigma};
use aloft_ik::CalibrationReport;
use aloft_pipeline::results::parameters_file;
use aloft_pipeline::stages::compare::is_of_earlier_method;
use aloft_pipeline::stages::identify::NOTHING_IDENTIFIED;
use aloft_study::commands::command;
use aloft_study::subject_session::SubjectSession;
use aloft_workspace::disk::is_there;
use aloft_workspace::error::PipelineError;
use aloft_workspace::json::read_json_if_there;
use aloft_workspace::manifest::WHOLE_STUDY;
use aloft_workspace::workspace::Workspace;
use serde::Serialize;

/// The comparison as `--json` shows it.
#[derive(Debug, Clone, Serialize)]
pub struct ComparisonView {
    /// Version of this structure.
    pub version: u32,
    /// Subject name.
    pub subject: String,
    /// The comparison: `held_out`, `flight`, `trials`, `beside`, `noise_floor`, `words` …
    #[serde(flatten)]
    pub comparison: Comparison,
    /// Held-out error, noise floor and their ratio, in flight and in held-out contact: the numbers
    /// that every surface shows by these names.
    pub errors: Vec<HeldOutError>,
    /// Trials of the study that are not in the comparison, with the reason.
    pub left_out: Vec<LeftOut>,
    /// Summary of the compared parameters.
    pub parameters: ParametersBrief,
    /// What the comparison cannot say because parts of the body move unseen; empty for a whole
    /// body.
    pub limits: Vec<String>,
    /// Kinematics: marker RMS and flights of each trial.
    pub kinematics: Vec<KinematicsRow>,
    /// Landmark against calibrated geometry; none for objects, or if nothing was calibrated.
    pub calibration: Option<CalibrationView>,
    /// Body mass from the impulse of the force plates between flights; none without such contacts.
    pub impulse_mass: Option<ImpulseMassView>,
    /// What the recordings contradict, to be corrected before a model is judged.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub to_correct: Option<ToCorrect>,
}

impl ComparisonView {
    /// The sentences of the comparison. That on the earlier method stands in the details only: its
    /// error is of no use to judge this model, and without bound where few flights determine it.
    pub fn sentences(&self, details: bool) -> Vec<String> {
        let mut out = self.comparison.words.clone();
        for other in &self.comparison.words_beside {
            if !is_of_earlier_method(&other.model) {
                out.push(other.words.clone());
            } else if details {
                let stem = other.words.trim_end_matches('.');
                out.push(format!(
                    "{stem} (the earlier method: parameters from accelerations frame by frame, without tables; it may fail with few flights)."
                ));
            }
        }
        out
    }

    /// True where a search for what is missing has nothing to hold out: one flight or recording
    /// alone.
    pub fn too_few_to_ask(&self) -> bool {
        let trials = &self.comparison.first.trials;
        let judged = trials.iter().filter(|t| t.flight_weak.windows + t.contact_weak.windows > 0).count();
        self.parameters.flights < 2 && judged < 2
    }
}

/// A trial that should be in the comparison and is not.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct LeftOut {
    /// Trial name.
    pub trial: String,
    /// Stage that failed; none if its results are only missing.
    pub stage: Option<&'static str>,
    /// Reason.
    pub because: String,
}

/// What calibration changed in the geometry and how much it reduced the marker error.
#[derive(Debug, Clone, Serialize)]
pub struct CalibrationView {
    /// Whether the calibrated geometry is used (`calibrate: {enabled: auto}` keeps it when held-out
    /// marker error falls).
    pub used: bool,
    /// Marker RMS on frames that were not used for calibration: landmark geometry, calibrated
    /// geometry; m.
    pub held_out_rms_m: [f64; 2],
    /// Joints and markers, landmarks against calibration.
    pub report: CalibrationReport,
}

/// Summary of the parameters.
#[derive(Debug, Clone, Serialize)]
pub struct ParametersBrief {
    /// Kind of rows.
    pub rows: &'static str,
    /// σ_{N−1}/σ_N.
    pub sigma_ratio: f64,
    /// Singular values.
    pub sigma: Sigma,
    /// Number of flights used.
    pub flights: usize,
    /// Flights, and stretches of contact where these were used, in words.
    pub identified_from: String,
    /// Number of trials used.
    pub trials: usize,
    /// Base parameters whose values come from motion.
    pub from_motion: usize,
    /// Base parameters that follow from the stated mass: the mass itself.
    pub from_scale: usize,
    /// Base parameters in all.
    pub in_all: usize,
    /// Whether the gate passed: the numbers may be reported as identified.
    pub gate_passed: bool,
    /// What to do where the gate did not pass, or where noise alone makes a large error, in one
    /// sentence; none otherwise.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub to_do: Option<String>,
    /// True if the gate did not pass while the error is far above its floor: the
    /// error is too large to determine the body.
    #[serde(skip_serializing_if = "std::ops::Not::not")]
    pub hidden_by_error: bool,
    /// True if the gate did not pass and the pipeline states a weight of the prior that leaves the
    /// motion no say.
    #[serde(skip_serializing_if = "std::ops::Not::not")]
    pub held_by_prior: bool,
    /// What the model's joints and marker places add to the noise of the markers, where that keeps
    /// the gate from passing.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub misfit: Option<String>,
    /// What the parameters rest on where the gate passed and an error is poor; none otherwise.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub reservation: Option<&'static str>,
    /// Body mass, kg.
    pub mass_kg: f64,
    /// Why nothing was identified, so that the compared model is the table's body; none if
    /// something was.
    pub nothing: Option<String>,
}

impl ParametersBrief {
    fn of(rows: &'static str, p: &Parameters) -> Self {
        Self {
            rows,
            trials: p.n_trials,
            from_motion: p
                .base
                .iter()
                .filter(|b| b.from != Origin::Scale && b.determination != Determination::Hardly)
                .count(),
            from_scale: p.base.iter().filter(|b| b.from == Origin::Scale).count(),
            in_all: p.base.len(),
            gate_passed: p.gate.passed,
            to_do: to_do(p),
            hidden_by_error: false,
            held_by_prior: false,
            misfit: p.gate.misfit.clone(),
            reservation: None,
            mass_kg: p.mass_kg,
            sigma_ratio: p.sigma.ratio,
            sigma: p.sigma,
            flights: p.n_flights(),
            identified_from: p.stretches(),
            nothing: None,
        }
    }
    fn nothing(rows: &'static str, mass_kg: f64, why: String) -> Self {
        let none = f64::NAN;
        Self {
            rows,
            trials: 0,
            from_motion: 0,
            from_scale: 0,
            in_all: 0,
            gate_passed: false,
            to_do: None,
            hidden_by_error: false,
            held_by_prior: false,
            misfit: None,
            reservation: None,
            mass_kg,
            sigma_ratio: none,
            sigma: Sigma { max: none, second: none, min: none, ratio: none },
            flights: 0,
            identified_from: String::new(),
            nothing: Some(why),
        }
    }
}

/// Ratio of the error in flight to its floor from which the error, and not too little motion, keeps
/// parameters undetermined; none below.
fn far_above(comparison: &Comparison) -> Option<f64> {
    const FAR: f64 = 10.0;
    let flight = comparison.against_floor.iter().find(|a| a.judged_on == "flight")?;
    Some(flight.held_out_error / flight.floor?.noise_floor).filter(|times| *times > FAR)
}

/// Stated weight of the prior above which a gate that does not pass is put down to it. With 1 the
/// prior counts as its standard deviations say.
const HEAVY_PRIOR: f64 = 10.0;

/// What to do about noise that alone makes a large error in flight: it enters the rows on the side
/// of the unknowns and biases parameters, most of all inertias, which no interval shows.
fn noisy(comparison: &Comparison, weight_n: f64) -> Option<String> {
    let floor = comparison.against_floor.iter().find(|a| a.judged_on == "flight")?.floor?.noise_floor;
    let share = floor / weight_n;
    (share > LOUD).then(|| {
        format!(
            "check the markers (noise, labels, static trial, placement): their errors alone leave {:.0} % of the weight, and may move parameters \
             by more than their intervals (estimate: aloft parameters --assess)",
            100.0 * share
        )
    })
}

/// What to record where the motion determined too little; none where the gate passed.
fn to_do(p: &Parameters) -> Option<String> {
    let flights = format!("record more flights ({} now)", p.n_flights());
    (!p.gate.passed).then(|| match &p.gate.next_motion {
        Some(motion) => format!("{flights}, first: {motion}"),
        None => format!("{flights}, with faster motion of all limbs"),
    })
}

/// Why nothing was identified, as the stage `identify` said it.
///
/// # Errors
/// Its words are there and cannot be read.
pub fn nothing_identified(ws: &Workspace) -> Result<String, PipelineError> {
    let words = read_json_if_there(&ws.place("identify", WHOLE_STUDY).join(NOTHING_IDENTIFIED))?;
    Ok(words.unwrap_or_else(|| "nothing was identified; the masses are from tables".to_owned()))
}

/// What the comparison cannot say, because the model is not the whole body.
fn limits(ws: &Workspace, comparison: &Comparison) -> Result<Vec<String>, PipelineError> {
    let path = ws.place("calibrate", WHOLE_STUDY).join("subject.json");
    let Some(subject) = read_json_if_there::<Subject>(&path)? else { return Ok(Vec::new()) };
    if let (None, Some(points)) = (subject.model.unseen_parts(), &subject.estimated) {
        return Ok(of_estimates(points, smoothed_hz(ws, comparison)?, comparison));
    }
    let Some(unseen) = subject.model.unseen_parts() else { return Ok(Vec::new()) };
    let mut out = vec![format!(
        "{unseen} move unseen; their mass is fixed to the neighbouring link as in the static posture: the difference from the plates contains \
         their motion, so it is no test of masses or plates"
    )];
    if comparison.first.held_out.frames > 0 {
        out.push(
            "still valid: joint angles, the plates' times and zeros, contact beside the plates, and the mean vertical force \
             over whole strides or from rest to rest, which is the body's weight"
                .to_owned(),
        );
    }
    Ok(out)
}

/// What markerless recordings cannot say, and what they can.
fn of_estimates(points: &EstimatedPoints, smoothed_hz: Option<f64>, comparison: &Comparison) -> Vec<String> {
    let smooth = smoothed_hz.map_or(String::new(), |hz| {
        format!(", and forces of movement faster than about {hz:.0} Hz were smoothed away before import")
    });
    let plates = if comparison.first.held_out.frames > 0 { ", the plates' times and zeros" } else { "" };
    vec![
        format!(
            "{} estimates joints from videos: they lie about {:.0} mm off the true ones, by the same amount in every recording{smooth}. The \
             difference from plates or free fall judges neither masses nor effects",
            points.source,
            1e3 * points.position_sd_m
        ),
        format!(
            "still valid: joint angles within some degrees{plates}, times of flights, and the mean vertical force over whole \
             strides or from rest to rest, which is the body's weight"
        ),
    ]
}

/// Smallest frequency at which the recordings were smoothed before import; none if they were not.
fn smoothed_hz(ws: &Workspace, comparison: &Comparison) -> Result<Option<f64>, PipelineError> {
    let mut all = Vec::new();
    for t in &comparison.first.trials {
        all.extend(ws.manifest("import", &t.trial)?.and_then(|m| m.summary.get("smoothed_hz")?.as_f64()));
    }
    Ok(all.into_iter().min_by(f64::total_cmp))
}

/// Stages whose results the comparison is read from.
pub const READS: [&str; 5] = ["compare", "identify", "calibrate", "flight", "ik"];

/// The same; none if nothing was compared. A comparison that is there and cannot be read is an
/// error.
pub fn compare_if_made(session: &SubjectSession) -> Result<Option<ComparisonView>, PipelineError> {
    let place = Workspace::open(&session.workspace).place("compare", WHOLE_STUDY);
    if is_there(&place.join("comparison.json"))? { compare(session).map(Some) } else { Ok(None) }
}

/// Reads the results of the stage `compare`.
pub fn compare(session: &SubjectSession) -> Result<ComparisonView, PipelineError> {
    let session = &aloft_pipeline::made::as_made(session)?;
    let ws = Workspace::open(&session.workspace);
    let path = ws.place("compare", WHOLE_STUDY).join("comparison.json");
    let comparison: Comparison = read_json_if_there(&path)?.ok_or_else(|| {
        PipelineError::request_hint(
            format!("nothing was compared in {}", session.workspace.display()),
            format!("run `{}` first", command(session, "run", None)),
        )
    })?;
    let rows = session.config.regressor.rows;
    let place = ws.place("identify", WHOLE_STUDY);
    let parameters: Option<Parameters> = read_json_if_there(&place.join(parameters_file(rows)))?;
    let gate_passed = parameters.as_ref().is_some_and(|p| p.gate.passed);
    let limits = limits(&ws, &comparison)?;
    let weight = weight_n(session);
    let mut brief = match &parameters {
        Some(p) => ParametersBrief::of(rows.word(), p),
        None => ParametersBrief::nothing(rows.word(), session.facts.person.mass_kg, nothing_identified(&ws)?),
    };
    if gate_passed && brief.to_do.is_none() {
        brief.to_do = noisy(&comparison, weight);
    }
    if let Some(times) = far_above(&comparison).filter(|_| !gate_passed && brief.to_do.is_some()) {
        brief.hidden_by_error = true;
        brief.to_do = Some(format!(
            "ask `discover` first: an error of {times:.0} times its floor is too large to determine the body; then record more flights ({} \
             now) if the gate still does not pass",
            brief.flights
        ));
    }
    let stated = session.config.identify.prior_weight;
    if stated > HEAVY_PRIOR && brief.to_do.is_some() && !gate_passed {
        brief.hidden_by_error = false;
        brief.held_by_prior = true;
        brief.to_do = Some(format!(
            "the weight of the prior (`identify: {{prior_weight: {stated}}}`) holds the parameters at the tables: remove it, then run again"
        ));
    }
    if brief.misfit.is_some() {
        // what is to be corrected says it
        (brief.hidden_by_error, brief.held_by_prior, brief.to_do) = (false, false, None);
    }
    let rows_of_trials = kinematics(session, &ws)?;
    let impulse_mass = impulse_mass(session, &ws, &rows_of_trials)?;
    // without the whole body only the labels of the static trial can be judged
    let to_correct = match limits.is_empty() {
        true => to_correct(
            session,
            &ws,
            &comparison,
            &rows_of_trials,
            impulse_mass.as_ref(),
            brief.misfit.as_deref(),
            weight,
        )?,
        false => of_static(&ws)?,
    };
    let best = best_grades(gate_passed, to_correct.as_ref());
    let against = comparison.against_floor.iter().map(|a| HeldOutError::of(a, &comparison.beside, weight));
    let errors: Vec<HeldOutError> = against.map(|e| e.at_best(&best)).collect();
    brief.reservation = errors.iter().find(|e| gate_passed && e.grade == Grade::Poor).map(|poor| match poor.because {
        None => "something is missing from the model and may bias the parameters",
        Some(_) => "the parameters depend on an error that has to be corrected first",
    });
    Ok(ComparisonView {
        version: 1,
        subject: session.facts.person.name.clone(),
        errors,
        left_out: left_out(session, &ws, &comparison)?,
        parameters: brief,
        limits,
        kinematics: rows_of_trials,
        calibration: calibration(&ws)?,
        impulse_mass,
        to_correct,
        comparison,
    })
}

/// Dynamic trials of the study that the comparison does not contain.
fn left_out(session: &SubjectSession, ws: &Workspace, comparison: &Comparison) -> Result<Vec<LeftOut>, PipelineError> {
    let compared = |name: &str| comparison.first.trials.iter().any(|t| t.trial == name);
    session
        .included()
        .filter(|t| t.role.is_dynamic())
        .filter_map(|t| {
            let of = |stage, because| Some(LeftOut { trial: t.name.clone(), stage, because });
            let without = "it was not in the recordings when the comparison was made, or has no rows";
            let failed = failed_stage(ws, &t.name).map(|failed| match failed {
                Some((stage, failure)) => of(Some(stage), failure.problem),
                None if compared(&t.name) => None,
                None => of(None, without.to_owned()),
            });
            failed.transpose()
        })
        .collect()
}

/// The calibration report, and whether the calibrated geometry is used.
///
/// # Errors
/// The report exists and cannot be read.
pub fn calibration(ws: &Workspace) -> Result<Option<CalibrationView>, PipelineError> {
    let manifest = ws.manifest("calibrate", WHOLE_STUDY)?;
    let used = manifest.and_then(|m| m.summary.get("used").and_then(serde_json::Value::as_bool));
    let path = ws.place("calibrate", WHOLE_STUDY).join("report.json");
    let report: Option<CalibrationReport> = if used.is_some() { read_json_if_there(&path)? } else { None };
    Ok(used.zip(report).map(|(used, report)| CalibrationView {
        used,
        held_out_rms_m: [report.held_out_rms_before_m, report.held_out_rms_after_m],
        report,
    }))
}

/// Held-out motion on which an error is judged.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
pub enum JudgedOn {
    /// Held-out contact.
    #[serde(rename = "held-out contact")]
    Contact,
    /// Held-out flight.
    #[serde(rename = "held-out flight")]
    Flight,
}

impl JudgedOn {
    /// The words of tables and of JSON.
    pub fn describe(self) -> &'static str {
        match self {
            Self::Contact => "held-out contact",
            Self::Flight => "held-out flight",
        }
    }
}

impl std::fmt::Display for JudgedOn {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.pad(self.describe())
    }
}

/// Motion on which a model's error is judged: held-out contact if there is any, else flight.
pub fn judged_on(c: &Comparison) -> JudgedOn {
    if c.first.held_out.frames > 0 { JudgedOn::Contact } else { JudgedOn::Flight }
}

/// Force (N) and moment (N·m) on frames, force and moment over weak windows, by axis.
pub type ErrorsByAxis = ([f64; 3], [f64; 3], [f64; 3], [f64; 3]);

/// Mean absolute error of a model on the motion on which it is judged: frames (N, N·m by axis) and
/// weak windows.
pub fn errors_of(model: &ModelComparison) -> ErrorsByAxis {
    if model.held_out.frames > 0 {
        let (f, w) = (&model.held_out, &model.held_out_weak);
        (f.force_n.mae, f.moment_nm.mae, w.force_n.mae, w.moment_nm.mae)
    } else {
        let (f, w) = (&model.flight_wrench, &model.flight_weak);
        (f.force_n.mae, f.moment_nm.mae, w.force_n.mae, w.moment_nm.mae)
    }
}

/// Mean over the axes.
pub fn mean(v: &[f64; 3]) -> f64 {
    v.iter().sum::<f64>() / 3.0
}
