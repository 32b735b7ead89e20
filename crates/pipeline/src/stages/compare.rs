//! `compare`: predicted against measured wrench on held-out motion; the residual wrench in flight.

use self::left_out::{each_without, plain_model};
use self::tables::{series_table, windows_table};
use crate::graph::{Need, Scope, Stage, StageInputs, StageReport, StageWork, parameters_of, run_of};
use crate::plate_zeros::{SessionZeros, tare_readings};
use crate::stages::filter::low_pass;
use crate::stages::identify::{Predicting, training_factors};
use crate::trial_rows::TrialRows;
use aloft_body::{BaseParameters, Motion, Subject};
use aloft_compare::{
    Body, Candidate, CompareError, CompareOptions, Comparison, Filtering, Noise, NoiseFloor, TareReadings, TrialInput,
    TrialSeries, compare_each,
};
use aloft_filter::smooth;
use aloft_ik::ERROR_SEED;
use aloft_study::calendar::Calendar;
use aloft_study::config::{CompareConfig, FilterConfig, IdentifyConfig, IkConfig, RegressorConfig, Rows};
use aloft_study::effects::ModelEffects;
use aloft_study::subject_session::{Role, SubjectSession, TrialEntry};
use aloft_workspace::artifact::plate_centres;
use aloft_workspace::error::StageFailure;
use aloft_workspace::json::{read_json, write_json};
use aloft_workspace::key::key;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};
use serde_json::json;
use std::collections::BTreeMap;
use std::sync::{Arc, OnceLock};

mod left_out;
mod tables;
mod trial;

pub use left_out::without_each_trial;
pub use trial::{ComparedTrial, HeldOut, has_validation, load_trials};

/// The stage.
pub static STAGE: Stage = Stage {
    name: "compare",
    version: 17,
    scope: Scope::Session,
    seconds: 0.6,
    reads: "parameters, held-out trials",
    gives: "predicted against measured wrench",
    needs: &[
        // coordinates that no marker observes, needed for the errors of the markers
        Need::Once("scale"),
        Need::Once("calibrate"),
        Need::Once("identify"),
        Need::Every("import", &[Role::Identify, Role::Validate]),
        Need::Every("ik", &[Role::Identify, Role::Validate]),
        Need::Every("filter", &[Role::Identify, Role::Validate]),
        Need::Every("flight", &[Role::Identify, Role::Validate]),
        Need::Every("regressor", &[Role::Identify, Role::Validate]),
        Need::Every("acceleration", &[Role::Identify, Role::Validate]),
    ],
    parameters: parameters_of::<Work>,
    run: run_of::<Work>,
};

/// Parameters of the stage.
#[derive(Debug, Serialize)]
pub struct Params {
    /// Settings of the comparison.
    pub compare: CompareConfig,
    /// Filter for motion and plates.
    pub filter: FilterConfig,
    /// Settings of the rows.
    pub regressor: RegressorConfig,
    /// Identification.
    pub identify: IdentifyConfig,
    /// Whether contact takes part in identification.
    pub contact: bool,
    /// Time at both ends of a flight that the paper's rows leave out, s.
    pub margin_s: f64,
    /// True for objects.
    pub is_rigid: bool,
    /// Inverse kinematics.
    pub ik: IkConfig,
    /// Inverse kinematics of trials with settings of their own.
    #[serde(skip_serializing_if = "BTreeMap::is_empty")]
    pub ik_of_trials: BTreeMap<String, IkConfig>,
    /// Effects of the model.
    pub effects: ModelEffects,
}

impl Params {
    /// Parameters for a study.
    pub fn of(session: &SubjectSession) -> Self {
        let config = &session.config;
        let own = |t: &TrialEntry| {
            let ik = session.ik_of(Some(t));
            (*ik != config.ik).then(|| (t.name.clone(), ik.clone()))
        };
        Self {
            compare: config.compare.clone(),
            filter: config.filter.clone(),
            regressor: config.regressor.clone(),
            identify: config.identify.clone(),
            contact: session.identifies_from_contact(),
            margin_s: config.flight.margin_s,
            is_rigid: session.is_rigid(),
            ik: config.ik.clone(),
            ik_of_trials: session.included().filter_map(own).collect(),
            effects: session.model_effects(),
        }
    }
    fn ik_of(&self, trial: &str) -> &IkConfig {
        self.ik_of_trials.get(trial).unwrap_or(&self.ik)
    }
}

/// Work of the stage.
#[derive(Debug)]
pub struct Work;

impl StageWork for Work {
    type Params = Params;
    fn params(session: &SubjectSession, _: Option<&TrialEntry>) -> Params {
        Params::of(session)
    }
    fn run(params: &Params, inputs: &StageInputs<'_>) -> Result<StageReport, StageFailure> {
        run(params, inputs)
    }
}

/// Source of a comparison's noise floor.
#[derive(Debug, Clone, Copy)]
pub enum Floor<'a> {
    /// Drawn this many times and propagated through a model's parameters (of the first model if
    /// none is given).
    Drawn(usize, Option<&'a Candidate>),
    /// Taken from an earlier comparison of the same motion.
    Known(&'a NoiseFloor),
}

/// Compares models of one subject with the measurement of trials. `left_out` states for which
/// trials the flights took no part in the first model; if it is not given, `held_out` decides.
pub fn compare_models(
    params: &Params,
    subject: &Subject,
    trials: &[ComparedTrial],
    candidates: &[Candidate],
    held_out: HeldOut,
    left_out: Option<&[bool]>,
    floor: Floor<'_>,
) -> Result<(Comparison, Vec<TrialSeries>), StageFailure> {
    let validation = has_validation(trials);
    compare_with(
        params,
        subject,
        trials.len(),
        |i| Ok(&trials[i]),
        |i, trial| trial.input(i, held_out, validation, left_out),
        candidates,
        floor,
    )
}

/// [`compare_models`] over trials that are read one at a time.
fn compare_with<T>(
    params: &Params,
    subject: &Subject,
    trials: usize,
    read: impl Fn(usize) -> Result<T, Failed> + Sync,
    view: impl for<'a> Fn(usize, &'a T) -> TrialInput<'a> + Sync,
    candidates: &[Candidate],
    floor: Floor<'_>,
) -> Result<(Comparison, Vec<TrialSeries>), StageFailure> {
    let base = BaseParameters::of(&subject.model);
    let prior = subject.prior_phi();
    let body = Body { model: &subject.model, base: &base, prior: &prior };
    let spec = low_pass(&params.filter);
    let again = |m: &Motion| smooth(&subject.model, m, Some(spec)).map_err(|e| e.to_string());
    let options = CompareOptions {
        noise_draws: if let Floor::Drawn(draws, _) = floor { draws } else { CompareOptions::default().noise_draws },
        ..compare_options(params, subject)
    };
    let filtering = Filtering { filter: Some(spec), smooth: &again };
    let noise = match floor {
        Floor::Drawn(_, of) => Noise::Drawn { filtering, of },
        Floor::Known(floor) => Noise::Known(floor),
    };
    compare_each(&body, candidates, trials, read, view, noise, &options).map_err(|Failed(failure)| failure)
}

/// Failure to read or compare a trial.
struct Failed(StageFailure);

impl From<CompareError> for Failed {
    fn from(error: CompareError) -> Self {
        Self(StageFailure::new(error.to_string()))
    }
}

/// [`CompareOptions::floor_spread`] of people, and of objects and robots, which have none. With the spread of people the
/// intervals of 80 simulated ones contain the true error in 95 % of flights and contacts together
/// (`benches/floor.py`, seeds 11 and 21).
pub fn floor_spread(is_rigid: bool) -> f64 {
    if is_rigid { 0.0 } else { 0.12 }
}

/// Options of the comparison that follow from the pipeline.
pub fn compare_options(params: &Params, subject: &Subject) -> CompareOptions {
    CompareOptions {
        edge_s: params.compare.edge_s,
        flight_margin_s: params.margin_s,
        window_s: params.compare.window_s,
        flight_window_s: (params.regressor.window_s > 0.0).then_some(params.regressor.window_s),
        mass_kg: Some(subject.facts.mass_kg),
        floor_spread: floor_spread(params.is_rigid),
        seed: ERROR_SEED,
        ..CompareOptions::default()
    }
}

/// Name of the model identified from the rows that were not chosen.
fn from_rows(rows: Rows, with_effects: bool) -> String {
    format!("{} rows{}", rows.word(), if with_effects { "" } else { " without effects" })
}

/// True for the model from acceleration rows beside that from weak rows, with effects or without.
pub fn is_of_earlier_method(model: &str) -> bool {
    [true, false].into_iter().any(|with_effects| model == from_rows(Rows::Acceleration, with_effects))
}

fn run(params: &Params, inputs: &StageInputs<'_>) -> Result<StageReport, StageFailure> {
    let results = inputs.results;
    let subject = results.load_subject("calibrate")?;
    let base = BaseParameters::of(&subject.model);
    // a trial whose motion could not be filtered has weak rows, but nothing to compare frame by
    // frame
    let filtered = inputs.trials_of("filter");
    let names: Vec<String> = inputs.trials_of("regressor").into_iter().filter(|n| filtered.contains(n)).collect();
    let chosen = params.regressor.rows;
    let other = if chosen == Rows::Weak { Rows::Acceleration } else { Rows::Weak };
    let mut candidates = Vec::new();
    let mut done = StageReport::default();
    let mut left_out = vec![false; names.len()];
    let mut with_effects = false;
    for (i, rows) in [chosen, other].into_iter().enumerate() {
        let Some(parameters) = results.load_parameters(rows)? else { continue };
        let without = with_effects && parameters.effects.is_empty();
        with_effects |= i == 0 && !parameters.effects.is_empty();
        let name = if i == 0 { "identified".to_owned() } else { from_rows(rows, !without) };
        let factors = training_factors(inputs, rows, params.contact)?;
        let parts = each_without(&Predicting::like(&subject, &parameters)?, &names, &factors, &parameters)?;
        if i == 0 {
            left_out = parts.iter().map(|p| p.left_out).collect();
        }
        done.warnings.extend(parts.iter().filter_map(|p| p.remark.clone()));
        let (base, effects) = parts.into_iter().map(|p| (p.base, p.effects)).unzip();
        candidates.push(Candidate::per_trial(name, base).with_effects_per_trial(effects));
    }
    candidates.push(Candidate::links("prior", &base, &subject.prior_phi()));
    // without identification no trial shaped the model: every one is held out
    let held_out = if candidates.len() > 1 { HeldOut::Validation } else { HeldOut::EveryTrial };
    if candidates.len() == 1 {
        left_out.fill(true);
    }
    let key = floor_key(params, inputs, &compare_options(params, &subject))?;
    // none: a floor that cannot be read is drawn again
    let stored = inputs.earlier().and_then(|place| read_json::<StoredFloor>(&place.join(NOISE_FLOOR_FILE)).ok());
    let earlier = stored.filter(|f| f.key == key);
    let plain = if earlier.is_some() { None } else { plain_model(params, inputs, &subject, chosen)? };
    let floor = match &earlier {
        Some(f) => Floor::Known(&f.floor),
        // what the unseen parts of a body do, and where software misses the joints, is in the error
        // and in no floor
        None if !subject.is_judged() => Floor::Drawn(0, None),
        None => Floor::Drawn(CompareOptions::default().noise_draws, plain.as_ref()),
    };
    let validates = |name: &String| -> Result<bool, StageFailure> {
        let held_out = inputs.role(name) == Some(Role::Validate);
        Ok(held_out && !plate_centres(&results.place("import", name)?)?.is_empty())
    };
    let validation = names.iter().map(validates).collect::<Result<Vec<bool>, _>>()?.contains(&true);
    let readings: Vec<(String, TareReadings)> = if earlier.is_some() {
        Vec::new()
    } else {
        names.par_iter().map(|n| Ok((n.clone(), tare_readings(results, n)?))).collect::<Result<_, StageFailure>>()?
    };
    let listed = params.effects.recordings.as_deref().unwrap_or_default();
    let times: OnceLock<Arc<Calendar>> = OnceLock::new();
    let calendar = || -> Result<Arc<Calendar>, StageFailure> {
        if let Some(known) = times.get() {
            return Ok(Arc::clone(known));
        }
        let read = Arc::new(Calendar::from_order(listed, &inputs.expected(), results.workspace())?);
        Ok(Arc::clone(times.get_or_init(|| read)))
    };
    let zeros = SessionZeros::new(results, &names);
    let load = |name: &str| {
        let rows = TrialRows::load(results, Some(&params.filter), &calendar, name, &subject)?;
        let trial =
            ComparedTrial::of(params, results, inputs.role(name).unwrap_or(Role::Identify), name, &zeros, rows)?;
        if earlier.is_some() || !subject.is_judged() {
            Ok(trial)
        } else {
            trial.with_errors(params, results, &subject, &readings)
        }
    };
    let read = |i: usize| load(&names[i]).map_err(Failed);
    let (mut comparison, series) = compare_with(
        params,
        &subject,
        names.len(),
        read,
        |i, trial| trial.input(i, held_out, validation, Some(&left_out)),
        &candidates,
        floor,
    )?;
    if !subject.is_judged() {
        // the difference is mostly the motion of parts that no marker shows, or where software
        // misses the joints: where it sits and with what it grows says nothing about the links
        (comparison.words, comparison.worst) = (Vec::new(), Vec::new());
        comparison.words_beside.clear();
        (comparison.first.segments, comparison.first.breakdown) = (Vec::new(), Vec::new());
        done.note("judged", false);
    }
    if let Some(floor) = &mut comparison.noise_floor {
        let stored = StoredFloor { key, floor: floor.clone() };
        write_json(&inputs.out.join(NOISE_FLOOR_FILE), &stored)?;
        floor.draws.clear();
    }
    write_json(&inputs.out.join("comparison.json"), &comparison)?;
    for s in &series {
        series_table(s, &comparison).write(&inputs.out.join(format!("series_{}.parquet", s.trial)))?;
        windows_table(s, &comparison).write(&inputs.out.join(format!("windows_{}.parquet", s.trial)))?;
    }
    describe(&comparison, &mut done);
    Ok(done)
}

/// File of the [`StoredFloor`].
pub const NOISE_FLOOR_FILE: &str = "noise_floor.json";

/// The stored noise floor of a comparison, with its draws.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct StoredFloor {
    /// Hash of everything that it depends on.
    key: String,
    /// The floor.
    pub floor: NoiseFloor,
}

/// Hash of everything that the noise floor depends on: the motion, the plates, and how both are
/// processed; never the effects of the model.
fn floor_key(params: &Params, inputs: &StageInputs<'_>, options: &CompareOptions) -> Result<String, StageFailure> {
    let mut hasher = blake3::Hasher::new();
    for (stage, trial) in
        inputs.all().iter().filter(|(s, _)| !matches!(s.as_str(), "regressor" | "acceleration" | "identify"))
    {
        let output = inputs.results.output(stage, trial)?;
        hasher.update(format!("{stage}/{trial}={output}\n").as_bytes());
    }
    let roles: Vec<&str> =
        inputs.trials_of("regressor").iter().filter_map(|n| inputs.role(n)).map(Role::word).collect();
    let settings = json!({"version": STAGE.version, "options": key(options), "filter": key(&params.filter),
        "regressor": key(&params.regressor), "identify": key(&params.identify), "ik": key(&params.ik), "roles": roles});
    hasher.update(settings.to_string().as_bytes());
    Ok(hasher.finalize().to_hex().to_string())
}

fn describe(c: &Comparison, done: &mut StageReport) {
    let first = &c.first;
    let errors = |e: &aloft_compare::WrenchErrors, w: &aloft_compare::WindowErrors| {
        let held_out_error = (w.windows > 0).then(|| w.size());
        (e.frames > 0).then(|| {
            json!({"force_n": e.force_n.mean_mae(), "moment_nm": e.moment_nm.mean_mae(), "held_out_error": held_out_error})
        })
    };
    let trials: serde_json::Map<String, serde_json::Value> = first
        .trials
        .iter()
        .map(|t| {
            let (contact, flight) = (errors(&t.contact, &t.contact_weak), errors(&t.flight, &t.flight_weak));
            (t.trial.clone(), json!({"contact": contact, "flight": flight}))
        })
        .collect();
    done.note("trials", trials);
    if first.held_out.frames > 0 {
        done.note("held_out_force_n", first.held_out.force_n.mean_mae());
        done.note("held_out_moment_nm", first.held_out.moment_nm.mean_mae());
    }
    for a in &c.against_floor {
        done.note(&format!("held_out_error_{}_n", a.judged_on), a.held_out_error);
        if let Some(floor) = a.floor {
            done.note(&format!("noise_floor_{}_n", a.judged_on), floor.noise_floor);
            done.note(&format!("times_floor_{}", a.judged_on), json!(a.times_floor));
        }
    }
    if first.flight.frames > 0 {
        done.note("flight_force_rms_n", json!(first.flight.residual_force_n.rms));
        done.note("flight_moment_rms_nm", json!(first.flight.residual_moment_nm.rms));
    }
}
