//! `regressor`: one triangular factor a flight and a contact stretch, from weak rows. They use the
//! motion as the cameras recorded it: the filter has no part in them.

use super::calibrate::geometry_errors;
use super::shared::fit_options;
use crate::factors::{FactorsAndRemarks, save_factors, save_repeated};
use crate::graph::{Need, Scope, Stage, StageInputs, StageReport, StageWork, parameters_of, run_of};
use crate::results::Results;
use crate::trial_rows::{TrialRows, each_stretch, effect_columns, effect_columns_along};
use aloft_body::{BaseParameters, Motion, Subject};
use aloft_ik::MarkerErrors;
use aloft_regressor::matrix_noise::EffectsAt;
use aloft_regressor::{
    Acting, CoordinateNoise, EffectColumns, MatrixNoise, MotionErrors, Noise, RegressorError, RepeatedErrors, Seen,
    SeenBody, Stretch, StretchKind, WeakOptions, carried, overlays, weak_factor, weak_factor_with_noise,
    weak_factor_with_repeated,
};
use aloft_study::config::{Estimator, IkConfig, Weighting};
use aloft_study::effects::ModelEffects;
use aloft_study::robot::RobotSetup;
use aloft_study::subject_session::{Role, SubjectSession, TrialEntry};
use aloft_trial::SessionSource;
use aloft_workspace::error::StageFailure;
use aloft_workspace::json::write_json;
use serde::Serialize;
use serde_json::json;

/// The stage.
pub static STAGE: Stage = Stage {
    name: "regressor",
    version: 12,
    scope: Scope::Trial(&[Role::Identify, Role::Validate]),
    seconds: 0.15,
    reads: "`Motion`, flights, plates",
    gives: "weak rows: one triangular factor a flight and contact stretch",
    needs: &[
        Need::Same("import"),
        Need::Same("ik"),
        Need::Same("flight"),
        // coordinates that no marker observes, needed for the errors of the markers
        Need::Once("scale"),
        Need::Once("calibrate"),
        // for effects that grow over the session
        Need::Times,
    ],
    parameters: parameters_of::<Work>,
    run: run_of::<Work>,
};

/// File with what the model adds to the noise of an object's markers, in words.
pub const MISFITS_FILE: &str = "misfits.json";

/// Parameters of the stage.
#[derive(Debug, Serialize)]
pub struct Params {
    /// Window length of weak rows, s; 0 chooses it from the flight.
    pub window_s: f64,
    /// Weighting of weak rows.
    pub weighting: Weighting,
    /// Slow part of the noise used for whitening.
    pub slow_noise: f64,
    /// White noise of a marker coordinate, m.
    pub marker_sd_m: f64,
    /// Whether contact is used for identification.
    pub contact: bool,
    /// True for objects and robots, which have no soft tissue.
    pub is_object: bool,
    /// The robot; its motion states its own noise, and its joints' torques give rows of their own.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub robot: Option<RobotSetup>,
    /// Role of the trial.
    pub role: Option<Role>,
    /// Whether the errors of the rows' matrix are computed, for `estimator: noise_metric`.
    #[serde(skip_serializing_if = "std::ops::Not::not")]
    pub matrix_noise: bool,
    /// Inverse kinematics of a person, whose markers' errors are drawn.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub ik: Option<IkConfig>,
    /// Effects of the model.
    pub effects: ModelEffects,
}

impl Params {
    /// Parameters for a study; `trial` gives the role.
    pub fn of(session: &SubjectSession, trial: Option<&TrialEntry>) -> Self {
        let regressor = &session.config.regressor;
        Self {
            window_s: regressor.window_s,
            weighting: regressor.weighting,
            slow_noise: regressor.slow_noise,
            marker_sd_m: session.config.ik.marker_sd_m,
            contact: session.identifies_from_contact(),
            is_object: session.is_rigid(),
            robot: session.robot.clone(),
            role: trial.map(|t| t.role),
            matrix_noise: match session.config.identify.estimator {
                Estimator::NoiseMetric => true,
                Estimator::Auto => session.is_rigid(),
                _ => false,
            },
            ik: (!session.is_rigid() && trial.is_some_and(|t| t.role == Role::Identify))
                .then(|| session.ik_of(trial).clone()),
            effects: session.model_effects(),
        }
    }
    /// True for a stretch that takes part in identification.
    fn uses(&self, stretch: &Stretch) -> bool {
        stretch.kind == StretchKind::Flight || self.contact
    }
}

/// Work of the stage.
#[derive(Debug)]
pub struct Work;

impl StageWork for Work {
    type Params = Params;
    fn params(session: &SubjectSession, trial: Option<&TrialEntry>) -> Params {
        Params::of(session, trial)
    }
    fn run(params: &Params, inputs: &StageInputs<'_>) -> Result<StageReport, StageFailure> {
        run(params, inputs)
    }
}

/// Weak factors of every stretch of a trial, with remarks.
pub fn weak_factors(params: &Params, rows: &TrialRows) -> Result<FactorsAndRemarks, StageFailure> {
    factors_beside(params, rows, effect_columns(&params.effects, rows)?.as_ref(), &mut Vec::new(), None)
}

/// The same with columns of effects that were formed before.
pub fn weak_factors_with(
    params: &Params,
    rows: &TrialRows,
    effects: Option<&EffectColumns>,
) -> Result<FactorsAndRemarks, StageFailure> {
    factors_beside(params, rows, effects, &mut Vec::new(), None)
}

/// Number of draws of the markers' errors, for which a standard error is known to 15 %.
const DRAWS: u64 = 24;

/// Seed of these draws. The floor of a comparison has another one: it judges an estimate, and does
/// not share the chance of its intervals.
const REPEATED_SEED: u64 = 0x7265_7065_6174;

/// What the kinematics of a trial may have wrong.
struct Drawn {
    markers: Vec<Motion>,
    geometry: Vec<SeenBody>,
}

impl Drawn {
    /// Draws for the stretches that take part in identification; `None` without a solved frame.
    fn of(
        params: &Params,
        ik: &IkConfig,
        results: Results<'_>,
        rows: &TrialRows,
    ) -> Result<Option<Self>, StageFailure> {
        let mut subject = rows.subject.clone();
        let options = fit_options(ik, results, &mut subject)?;
        let (trial, _) = results.load_labelled_markers(&rows.trial.name)?;
        let failed = |e: aloft_ik::IkError| StageFailure::new(e.to_string());
        let Some(errors) = MarkerErrors::of(&subject, &trial, &rows.motion, &options).map_err(failed)? else {
            return Ok(None);
        };
        let used: Vec<&Stretch> = rows.stretches.iter().filter(|s| params.uses(s)).collect();
        let wanted = |frame: usize| used.iter().any(|s| (s.first_frame..s.end_frame).contains(&frame));
        let markers = errors.draw_each(&rows.motion, &|_, f| wanted(f), REPEATED_SEED, 0..DRAWS);
        let others: Vec<Subject> =
            geometry_errors(results)?.iter().map(|e| e.applied(&subject)).collect::<Result<_, _>>().map_err(failed)?;
        let seen = errors.with_geometry(&rows.motion, &wanted, &others);
        let (phi, from) = (subject.prior_phi(), (&subject.model, subject.markers.as_slice()));
        let body = |(other, motion): (Subject, Motion)| SeenBody {
            phi: carried(&overlays(from, (&other.model, &other.markers)), &phi),
            model: other.model,
            motion,
        };
        Ok(Some(Self { markers, geometry: others.into_iter().zip(seen).map(body).collect() }))
    }
}

/// The same, with what the draws do to the rows where these are given.
fn factors_beside(
    params: &Params,
    rows: &TrialRows,
    effects: Option<&EffectColumns>,
    repeated: &mut Vec<(Stretch, RepeatedErrors)>,
    drawn: Option<&Drawn>,
) -> Result<FactorsAndRemarks, StageFailure> {
    let subject = &rows.subject;
    let base = BaseParameters::of(&subject.model);
    let prior = subject.prior_phi();
    let weak = weak_options(params.window_s);
    let marker_sd_m = rows.segments.as_ref().map_or(params.marker_sd_m, |s| s.sd_m);
    let noise = row_noise(params, subject, marker_sd_m);
    let (model, motion) = (&subject.model, &rows.motion);
    let acting = Acting { measured: rows.wrench.as_deref(), effects };
    let pairs = if params.matrix_noise { rows.sensors.as_ref() } else { None };
    let pairs = pairs.map(|sensors| sensors.pairs(motion, MATRIX_SEED, MatrixNoise::DRAWS));
    let of_matrix = matrix_noise(params, subject, marker_sd_m, pairs.as_deref());
    let effects_at = |disturbed: &Motion| {
        effect_columns_along(&params.effects, rows, disturbed).map_err(|failure| RegressorError::Numeric {
            trial: rows.trial.name.clone(),
            stretch: 0,
            problem: failure.problem,
        })
    };
    let no_effects = |_: &Motion| Ok(None);
    let effects_at: EffectsAt<'_> = if effects.is_some() { &effects_at } else { &no_effects };
    each_stretch(rows, |stretch| {
        if let Some(errors) = of_matrix {
            let of_matrix = MatrixNoise { motion: errors, effects_at };
            let noise = noise.as_ref();
            return weak_factor_with_noise(model, &base, &prior, motion, stretch, acting, &weak, noise, &of_matrix);
        }
        let Some(drawn) = drawn.filter(|_| params.uses(stretch)) else {
            return weak_factor(model, &base, &prior, motion, stretch, acting, &weak, noise.as_ref());
        };
        let seen = Seen { markers: &drawn.markers, geometry: &drawn.geometry };
        let (factor, found) =
            weak_factor_with_repeated(model, &base, &prior, motion, stretch, acting, &weak, noise.as_ref(), &seen)?;
        repeated.push((stretch.clone(), found));
        Ok(factor)
    })
}

/// Settings of weak rows from the pipeline.
pub fn weak_options(window_s: f64) -> WeakOptions {
    WeakOptions { window_s: (window_s > 0.0).then_some(window_s), ..WeakOptions::default() }
}

/// Noise for whitening weak rows, if the pipeline asks for it: marker noise, and a slow part for
/// soft tissue. `marker_sd_m` is that of the segments' own fits where they have one.
pub fn row_noise<'a>(params: &Params, subject: &'a Subject, marker_sd_m: f64) -> Option<Noise<'a>> {
    (params.weighting == Weighting::Whitened).then(|| Noise {
        coordinates: if params.robot.is_some() {
            CoordinateNoise::FromMotion
        } else {
            CoordinateNoise::Markers { markers: &subject.markers, sd_m: marker_sd_m }
        },
        slow: params.slow_noise,
        slow_time_s: 0.1,
    })
}

/// Seed of the sensors' errors in the rows' matrix. The floor of a comparison draws from others, so
/// that it is not judged by the noise that the estimate was corrected for.
pub(crate) const MATRIX_SEED: u64 = 0x6d61_7472_6978;

/// Errors of the motion from which those of the rows' matrix are drawn, where the estimator asks
/// for them: of a robot's sensors through its smoother, or of markers through inverse kinematics.
fn matrix_noise<'a>(
    params: &Params,
    subject: &'a Subject,
    marker_sd_m: f64,
    drawn: Option<&'a [[Motion; 2]]>,
) -> Option<MotionErrors<'a>> {
    params.matrix_noise.then(|| match drawn {
        Some(pairs) => MotionErrors::Drawn(pairs),
        None if params.robot.is_some() => MotionErrors::White(CoordinateNoise::FromMotion),
        None => MotionErrors::White(CoordinateNoise::Markers { markers: &subject.markers, sd_m: marker_sd_m }),
    })
}

fn run(params: &Params, inputs: &StageInputs<'_>) -> Result<StageReport, StageFailure> {
    let results = inputs.results;
    let subject = results.load_subject("calibrate")?;
    let rows = TrialRows::load(results, None, &|| inputs.calendar(), inputs.trial()?, &subject)?;
    let mut repeated = Vec::new();
    let effects = effect_columns(&params.effects, &rows)?;
    // only identification of people uses them
    let drawn = params.ik.as_ref().map(|ik| Drawn::of(params, ik, results, &rows)).transpose()?.flatten();
    let (factors, warnings) = factors_beside(params, &rows, effects.as_ref(), &mut repeated, drawn.as_ref())?;
    let mut done = StageReport { warnings: warnings.into(), ..StageReport::default() };
    save_factors(inputs.out, &factors)?;
    if let Some(segments) = &rows.segments {
        write_json(&inputs.out.join(MISFITS_FILE), &super::ik::misfits(segments))?;
    }
    if let Some(robot) = &params.robot {
        super::robot_torques::save_torque_rows(robot, inputs, &rows, &params.effects, effects.as_ref(), &mut done)?;
    }
    if drawn.is_some() {
        save_repeated(inputs.out, &repeated)?;
    }
    done.note("weak_rows", factors.iter().map(|(_, f)| f.n_rows).sum::<usize>());
    if let Some(calendar) = &rows.calendar {
        done.note("session_time_s", rows.session_time_s);
        done.note("session_time_source", json!(calendar.source));
        // remark on this only if the results depend on it
        if calendar.source == SessionSource::OrderAndLengths && params.effects.recordings.is_some() {
            done.warnings.push(format!("times of the session: {}", calendar.words));
        }
    }
    Ok(done)
}
