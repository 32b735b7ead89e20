//! `compare --estimators` and `compare --leave-one-out`: predictions of the same held-out motion by
//! every identification method.
//!
//! Both read the results of the stages (motion, flights, plates, factors) and change nothing. If
//! the pipeline calibrated the geometry, the table of estimators repeats inverse kinematics with
//! the landmark geometry, so that the gain from calibration can be compared with the gain from rows
//! and estimators.

use crate::compare::{JudgedOn, mean};
use crate::results::{Made, with_results};
use aloft_body::{BaseParameters, Subject};
use aloft_compare::{Candidate, Comparison, ModelComparison, NoiseFloor, WindowErrors, WrenchErrors};
use aloft_filter::smooth;
use aloft_identify::{ColumnScaling, Estimator, Gate, KindBalance, Parameters};
use aloft_pipeline::factors::{load_factors, row_kind};
use aloft_pipeline::plate_zeros::SessionZeros;
use aloft_pipeline::stages::acceleration::{self, acceleration_factors};
use aloft_pipeline::stages::compare::{
    self, ComparedTrial, Floor, HeldOut, compare_models, has_validation, load_trials, without_each_trial,
};
use aloft_pipeline::stages::filter::low_pass;
use aloft_pipeline::stages::identify::{self, estimator as default_estimator, identify_from};
use aloft_pipeline::stages::ik::track;
use aloft_pipeline::stages::regressor::{self, weak_factors};
use aloft_pipeline::stages::stage_of;
use aloft_pipeline::trial_rows::TrialRows;
use aloft_regressor::{Factor, Stretch, StretchKind};
use aloft_study::config::Rows;
use aloft_study::subject_session::{Role, SubjectSession};
use aloft_workspace::error::{PipelineError, StageFailure};
use aloft_workspace::json::read_json_if_there;
use aloft_workspace::manifest::WHOLE_STUDY;
use nalgebra::DVector;
use rayon::prelude::*;
use serde::Serialize;

/// Mean absolute errors of a wrench: predicted minus measured.
#[derive(Debug, Clone, Copy, Serialize)]
pub struct ErrorsBrief {
    /// Number of frames or windows.
    pub count: usize,
    /// Force by axis, N.
    pub force_n: [Option<f64>; 3],
    /// Moment by axis, N·m.
    pub moment_nm: [Option<f64>; 3],
    /// Mean over axes, N.
    pub force_mean_n: Option<f64>,
    /// Mean over axes, N·m.
    pub moment_mean_nm: Option<f64>,
}

impl ErrorsBrief {
    fn new(count: usize, force_n: [f64; 3], moment_nm: [f64; 3]) -> Self {
        let finite = |x: f64| x.is_finite().then_some(x);
        Self {
            count,
            force_n: force_n.map(finite),
            moment_nm: moment_nm.map(finite),
            force_mean_n: finite(mean(&force_n)),
            moment_mean_nm: finite(mean(&moment_nm)),
        }
    }
}

impl From<&WrenchErrors> for ErrorsBrief {
    /// Errors in root axes, about the root origin.
    fn from(e: &WrenchErrors) -> Self {
        Self::new(e.frames, e.force_n.mae, e.moment_nm.mae)
    }
}

impl From<&WindowErrors> for ErrorsBrief {
    fn from(e: &WindowErrors) -> Self {
        Self::new(e.windows, e.force_n.mae, e.moment_nm.mae)
    }
}

/// One identification method and its prediction errors.
#[derive(Debug, Clone, Serialize)]
pub struct EstimatorRow {
    /// `calibrated` or `landmarks`; `as scaled` where the pipeline does not calibrate.
    pub geometry: &'static str,
    /// `weak` or `paper`; none for the prior.
    pub rows: Option<&'static str>,
    /// `null_vector`, `noise_metric`, `mass_constrained`, `regularised`; none for the prior.
    pub estimator: Option<&'static str>,
    /// True for the pipeline's own choice.
    pub chosen: bool,
    /// Errors on frames.
    pub frames: Option<ErrorsBrief>,
    /// Errors over weak windows.
    pub windows: Option<ErrorsBrief>,
    /// Errors on frames without removing the constant offset of plates that were never unloaded;
    /// none if all plates were tared.
    pub frames_as_measured: Option<ErrorsBrief>,
    /// σ_{N−1}/σ_N of the flights' rows.
    pub sigma_ratio: Option<f64>,
    /// Whether the numbers may be shown as identified, and if not, why.
    pub gate: Option<Gate>,
    /// Weight of the prior.
    pub prior_weight: Option<f64>,
    /// Reason if there are no figures.
    pub failed: Option<String>,
}

/// The table of estimators.
#[derive(Debug, Clone, Serialize)]
pub struct EstimatorsView {
    /// Version of this structure.
    pub version: u32,
    /// Subject name.
    pub subject: String,
    /// Motion on which the errors are computed.
    pub judged_on: JudgedOn,
    /// Trials that the errors come from, and why these count as held out.
    pub held_out: String,
    /// Length of the windows, s.
    pub window_s: f64,
    /// Rows, the best geometry first.
    pub table: Vec<EstimatorRow>,
    /// Noise floor on frames.
    pub noise_frames: Option<ErrorsBrief>,
    /// The same over windows.
    pub noise_windows: Option<ErrorsBrief>,
    /// Notes for reading the table.
    pub notes: Vec<String>,
}

/// Rows × estimators × geometry, on the same held-out motion.
pub fn estimators(session: &SubjectSession) -> Result<EstimatorsView, PipelineError> {
    let session = &aloft_pipeline::made::as_made(session)?;
    with_results(session, |made| {
        let subject = made.results.load_subject("calibrate")?;
        let trials = load_trials(&compare::Params::of(made.session), made.results, &|| made.calendar(), &made.trials)?;
        let factors = all_factors(made)?;
        let landmarks = landmarks(made, &subject)?;
        let validated = has_validation(&trials);
        let geometry = if landmarks.is_some() { "calibrated" } else { "as scaled" };
        let (mut table, comparison) = of_geometry(made, geometry, &subject, &trials, &factors, true)?;
        let mut notes = Vec::new();
        match landmarks {
            Some(l) => table.extend(of_geometry(made, "landmarks", &l.0, &l.1, &l.2, false)?.0),
            None => notes.push("the geometry was not calibrated: there is no other one to compare with".to_owned()),
        }
        if trials.iter().any(|t| t.untared && (t.role == Role::Validate || !validated)) {
            notes.push(
                "plates that were never unloaded: a constant wrench of each recording is taken off, for each model its own; \
                 `frames_as_measured` (JSON) has the errors with it"
                    .to_owned(),
            );
        }
        let floor = comparison.noise_floor.as_ref();
        let contact = comparison.first.held_out.frames > 0;
        Ok(EstimatorsView {
            version: 1,
            subject: session.facts.person.name.clone(),
            judged_on: crate::compare::judged_on(&comparison),
            held_out: held_out_words(&trials, validated),
            window_s: session.config.compare.window_s,
            table,
            noise_frames: floor.map(|f| if contact { (&f.contact).into() } else { (&f.flight).into() }),
            noise_windows: floor.map(|f| if contact { (&f.contact_weak).into() } else { (&f.flight_weak).into() }),
            notes,
        })
    })
}

fn held_out_words(trials: &[ComparedTrial], validated: bool) -> String {
    if validated {
        let names: Vec<&str> = trials.iter().filter(|t| t.role == Role::Validate).map(|t| t.name.as_str()).collect();
        format!("{}, which took no part in identification", names.join(", "))
    } else {
        "every trial in turn, predicted from all others".to_owned()
    }
}

/// Factors of every dynamic trial, both kinds of rows.
fn all_factors(made: &Made<'_>) -> Result<Vec<(Stretch, Factor)>, StageFailure> {
    let mut out = Vec::new();
    for (name, _) in &made.trials {
        for rows in Rows::ALL {
            out.extend(load_factors(&made.results.place(stage_of(rows), name)?)?);
        }
    }
    Ok(out)
}

type Tracked = (Subject, Vec<ComparedTrial>, Vec<(Stretch, Factor)>);

/// Motion and factors with the landmark geometry; none if the pipeline uses it anyway.
fn landmarks(made: &Made<'_>, used: &Subject) -> Result<Option<Tracked>, StageFailure> {
    let subject = made.results.load_subject("scale")?;
    if subject.model == used.model && subject.markers == used.markers {
        return Ok(None);
    }
    let (session, results) = (made.session, made.results);
    let (weak, acceleration) = (regressor::Params::of(session, None), acceleration::Params::of(session));
    let compared = compare::Params::of(session);
    let names: Vec<String> = made.trials.iter().map(|(name, _)| name.clone()).collect();
    let zeros = SessionZeros::new(results, &names);
    let each: Vec<(ComparedTrial, Vec<(Stretch, Factor)>)> = made
        .trials
        .par_iter()
        .map(|(name, role)| {
            let ik = session.ik_of(session.trial(name));
            let (with_weights, motion, ..) = track(ik, results, subject.clone(), name)?;
            let filtered = smooth(&with_weights.model, &motion, Some(low_pass(&acceleration.filter)))
                .map_err(|e| StageFailure::new(e.to_string()))?;
            let calendar = || made.calendar();
            let rows = TrialRows::of(
                results,
                Some(&acceleration.filter),
                &calendar,
                name,
                subject.clone(),
                motion,
                Some(filtered),
            )?;
            let mut factors = weak_factors(&weak, &rows)?.0;
            factors.extend(acceleration_factors(&acceleration, &rows)?.0);
            Ok((ComparedTrial::of(&compared, results, *role, name, &zeros, rows)?, factors))
        })
        .collect::<Result<_, StageFailure>>()?;
    let (trials, factors): (Vec<_>, Vec<_>) = each.into_iter().unzip();
    Ok(Some((subject, trials, factors.into_iter().flatten().collect())))
}

fn is_training(session: &SubjectSession, stretch: &Stretch, contact: bool) -> bool {
    session.trial(&stretch.trial).is_some_and(|t| t.role == Role::Identify)
        && (contact || stretch.kind != StretchKind::Contact)
}

/// The noise floor found by the stage `compare`.
fn known_floor(made: &Made<'_>) -> Result<Option<NoiseFloor>, PipelineError> {
    let place = made.workspace.place("compare", WHOLE_STUDY);
    Ok(read_json_if_there::<Comparison>(&place.join("comparison.json"))?.and_then(|c| c.noise_floor))
}

/// Every estimator from every kind of rows, and the prior, with one geometry.
fn of_geometry(
    made: &Made<'_>,
    geometry: &'static str,
    subject: &Subject,
    trials: &[ComparedTrial],
    factors: &[(Stretch, Factor)],
    noise: bool,
) -> Result<(Vec<EstimatorRow>, Comparison), StageFailure> {
    let session = made.session;
    let (identification, compared) = (identify::Params::of(session), compare::Params::of(session));
    let validated = has_validation(trials);
    let weight = (session.config.identify.prior_weight > 0.0).then_some(session.config.identify.prior_weight);
    let estimators = [
        Estimator::Regularised { weight },
        Estimator::MassConstrained,
        Estimator::NoiseMetric,
        Estimator::NullVector(ColumnScaling::default()),
    ];
    // only some rows come with their noise
    let with_noise = |rows: Rows| factors.iter().any(|(_, f)| f.rows == row_kind(rows) && f.noise().is_some());
    let ways: Vec<(Rows, &'static str, Estimator)> = Rows::ALL
        .iter()
        .flat_map(|r| estimators.iter().map(|e| (*r, e.name(), *e)))
        .filter(|(rows, _, e)| *e != Estimator::NoiseMetric || with_noise(*rows))
        .collect();
    let found: Vec<Result<(Parameters, Candidate), StageFailure>> = ways
        .par_iter()
        .map(|(rows, _, estimator)| {
            let own: Vec<(Stretch, Factor)> = factors
                .iter()
                .filter(|(s, f)| {
                    f.rows == row_kind(*rows) && is_training(session, s, session.identifies_from_contact())
                })
                .cloned()
                .collect();
            if own.is_empty() {
                return Err(StageFailure::new(format!("no flight gave {} rows", rows.word())));
            }
            let parameters = identify_from(&identification, subject, &own, *estimator, 0)?;
            let all = parameters.base_values();
            let effects = parameters.coefficients();
            let candidate = if validated {
                Candidate::base("", all)
            } else {
                let each = without_each_trial(&identification, subject, trials, &own, *estimator, &all)?.0;
                Candidate::per_trial("", each)
            };
            Ok((parameters, candidate.with_effects(effects)))
        })
        .collect();
    let base = BaseParameters::of(&subject.model);
    // the prior comes first: it always exists
    let mut candidates = vec![Candidate::links("prior", &base, &subject.prior_phi())];
    // none: an estimator that fails has its reason in its row of the table
    candidates.extend(found.iter().filter_map(|f| f.as_ref().ok().map(|(_, c)| c.clone())));
    // take the noise floor from the pipeline's own comparison, so that it is the same number
    // everywhere
    let known = if noise { known_floor(made)? } else { None };
    let floor = known.as_ref().map_or(Floor::Drawn(0, None), Floor::Known);
    let (comparison, _) = compare_models(&compared, subject, trials, &candidates, HeldOut::Validation, None, floor)?;
    let chosen = session.config.regressor.rows;
    let own_way = default_estimator(&identification, chosen).name();
    let mut models = comparison.models().collect::<Vec<_>>().into_iter();
    let prior = models.next().map(|m| row(geometry, None, None, false, m));
    let mut table = Vec::new();
    for ((rows, name, _), result) in ways.iter().zip(&found) {
        let is_chosen = noise && *rows == chosen && *name == own_way;
        match result {
            Ok((parameters, _)) => {
                let Some(model) = models.next() else { continue };
                let mut line = row(geometry, Some(rows.word()), Some(name), is_chosen, model);
                line.sigma_ratio = Some(parameters.sigma.ratio).filter(|r| r.is_finite());
                line.gate = Some(parameters.gate.clone());
                line.prior_weight = (parameters.prior_weight > 0.0).then_some(parameters.prior_weight);
                table.push(line);
            }
            Err(failure) => table.push(EstimatorRow {
                failed: Some(failure.problem.clone()),
                ..EstimatorRow::empty(geometry, Some(rows.word()), Some(name), is_chosen)
            }),
        }
    }
    table.extend(prior);
    Ok((table, comparison))
}

impl EstimatorRow {
    fn empty(
        geometry: &'static str,
        rows: Option<&'static str>,
        estimator: Option<&'static str>,
        chosen: bool,
    ) -> Self {
        Self {
            geometry,
            rows,
            estimator,
            chosen,
            frames: None,
            windows: None,
            frames_as_measured: None,
            sigma_ratio: None,
            gate: None,
            prior_weight: None,
            failed: None,
        }
    }
}

fn row(
    geometry: &'static str,
    rows: Option<&'static str>,
    estimator: Option<&'static str>,
    chosen: bool,
    model: &ModelComparison,
) -> EstimatorRow {
    let mut out = EstimatorRow::empty(geometry, rows, estimator, chosen);
    if model.held_out.frames > 0 {
        out.frames = Some((&model.held_out).into());
        out.windows = Some((&model.held_out_weak).into());
        let untared = model.trials.iter().any(|t| t.held_out_contact && t.offset.is_some());
        out.frames_as_measured = untared.then(|| (&model.held_out_as_measured).into());
    } else {
        out.frames = Some((&model.flight_wrench).into());
        out.windows = Some((&model.flight_weak).into());
    }
    out
}

/// Prediction errors of one model for one left-out trial.
#[derive(Debug, Clone, Serialize)]
pub struct LeftOutTrial {
    /// Trial; `all` for the mean over frames of all trials.
    pub trial: String,
    /// Role in the pipeline.
    pub role: &'static str,
    /// Errors on contact frames; none without plates.
    pub contact: Option<ErrorsBrief>,
    /// Errors over weak windows in contact.
    pub contact_windows: Option<ErrorsBrief>,
    /// Errors on flight frames, where no external force should act.
    pub flight: Option<ErrorsBrief>,
    /// Errors over weak windows in flight.
    pub flight_windows: Option<ErrorsBrief>,
}

/// One model of the leave-one-trial-out table.
#[derive(Debug, Clone, Serialize)]
pub struct LeftOutModel {
    /// `prior`, `flights`, `contact`, `flights and contact`.
    pub model: &'static str,
    /// Weight of contact relative to flights, determined with all trials included.
    pub balance: Option<KindBalance>,
    /// Reason if there are no figures.
    pub failed: Option<String>,
    /// One entry per trial; the last is the mean over all.
    pub trials: Vec<LeftOutTrial>,
}

/// The leave-one-trial-out table.
#[derive(Debug, Clone, Serialize)]
pub struct LeaveOneOutView {
    /// Version of this structure.
    pub version: u32,
    /// Subject name.
    pub subject: String,
    /// Data that take part, in words.
    pub words: String,
    /// Models.
    pub models: Vec<LeftOutModel>,
}

/// Predicts each dynamic trial from all others by four models: the prior, flights, contact, and
/// both. Uses stored factors.
pub fn leave_one_out(session: &SubjectSession) -> Result<LeaveOneOutView, PipelineError> {
    let session = &aloft_pipeline::made::as_made(session)?;
    with_results(session, |made| {
        let subject = made.results.load_subject("calibrate")?;
        let trials = load_trials(&compare::Params::of(made.session), made.results, &|| made.calendar(), &made.trials)?;
        let rows = session.config.regressor.rows;
        let factors: Vec<(Stretch, Factor)> =
            all_factors(made)?.into_iter().filter(|(_, f)| f.rows == row_kind(rows)).collect();
        let base = BaseParameters::of(&subject.model);
        let prior = base.regroup(&subject.prior_phi());
        let (identification, compared) = (identify::Params::of(session), compare::Params::of(session));
        let estimator = default_estimator(&identification, rows);
        type Takes = fn(StretchKind) -> bool;
        let ways: [(&'static str, Takes); 3] = [
            ("flights", |k| k != StretchKind::Contact),
            ("contact", |k| k == StretchKind::Contact),
            ("flights and contact", |_| true),
        ];
        type Found = (Option<KindBalance>, Vec<DVector<f64>>, Vec<(String, f64)>);
        let found: Vec<(&'static str, Result<Found, StageFailure>)> = ways
            .par_iter()
            .map(|(name, wanted)| {
                let own: Vec<(Stretch, Factor)> = factors.iter().filter(|(s, _)| wanted(s.kind)).cloned().collect();
                if own.is_empty() {
                    return (*name, Err(StageFailure::new("no such stretch was recorded")));
                }
                let result = identify_from(&identification, &subject, &own, estimator, 0).and_then(|all| {
                    let each =
                        without_each_trial(&identification, &subject, &trials, &own, estimator, &all.base_values())?.0;
                    let effects = all.coefficients();
                    Ok((all.contact, each, effects))
                });
                (*name, result)
            })
            .collect();
        let mut candidates = vec![Candidate::base("prior", prior)];
        for (name, result) in &found {
            // none: a model that fails has its reason in its row of the table
            if let Ok((_, each, effects)) = result {
                candidates.push(Candidate::per_trial(*name, each.clone()).with_effects(effects.clone()));
            }
        }
        let (comparison, _) = compare_models(
            &compared,
            &subject,
            &trials,
            &candidates,
            HeldOut::EveryTrial,
            None,
            Floor::Drawn(0, None),
        )?;
        let mut models = comparison.models().collect::<Vec<_>>().into_iter();
        let mut out: Vec<LeftOutModel> = models
            .next()
            .map(|m| LeftOutModel { model: "prior", balance: None, failed: None, trials: left_out(session, m) })
            .into_iter()
            .collect();
        for (name, result) in found {
            match result {
                Ok((balance, _, _)) => {
                    if let Some(m) = models.next() {
                        out.push(LeftOutModel { model: name, balance, failed: None, trials: left_out(session, m) });
                    }
                }
                Err(f) => {
                    out.push(LeftOutModel { model: name, balance: None, failed: Some(f.problem), trials: Vec::new() });
                }
            }
        }
        Ok(LeaveOneOutView {
            version: 1,
            subject: session.facts.person.name.clone(),
            words: format!(
                "each of {} trials predicted from all others, those that the pipeline holds out included; {} rows, {}",
                trials.len(),
                rows.word(),
                estimator.name()
            ),
            models: out,
        })
    })
}

fn left_out(session: &SubjectSession, model: &ModelComparison) -> Vec<LeftOutTrial> {
    let some = |e: ErrorsBrief| (e.count > 0).then_some(e);
    let mut out: Vec<LeftOutTrial> = model
        .trials
        .iter()
        .map(|t| LeftOutTrial {
            trial: t.trial.clone(),
            role: session.trial(&t.trial).map_or("", |e| e.role.word()),
            contact: some((&t.contact).into()),
            contact_windows: some((&t.contact_weak).into()),
            flight: some((&t.flight).into()),
            flight_windows: some((&t.flight_weak).into()),
        })
        .collect();
    out.push(LeftOutTrial {
        trial: "all".to_owned(),
        role: "",
        contact: some((&model.held_out).into()),
        contact_windows: some((&model.held_out_weak).into()),
        flight: some((&model.flight_wrench).into()),
        flight_windows: some((&model.flight_weak).into()),
    });
    out
}
