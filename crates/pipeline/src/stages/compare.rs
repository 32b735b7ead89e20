//! `compare`: predicted against measured wrench on held-out motion; the residual wrench in flight.

use crate::config::Rows;
use crate::error::StageFailure;
use crate::graph::{Done, Job, Need, Scope, Stage};
use crate::stages::filter::low_pass;
use crate::stages::identify::{estimator, identify_from, training_factors};
use crate::stages::regressor::{TrialRows, effect_columns};
use crate::study::{Role, Study};
use crate::table::Table;
use crate::workspace::{read_json, write_json};
use aloft_body::{BaseParameters, Motion, Subject};
use aloft_compare::{
    Body, Candidate, CompareOptions, Comparison, Filtering, Measured, TrialInput, TrialSeries, compare, measured_wrench,
};
use aloft_flight::{PlateTare, TareSource};
use aloft_identify::Estimator;
use aloft_ik::smooth;
use aloft_regressor::{EffectColumns, Factor, Stretch};
use nalgebra::DVector;
use rayon::prelude::*;
use serde_json::json;
use std::ops::Range;

/// The stage.
pub static STAGE: Stage = Stage {
    name: "compare",
    version: 2,
    scope: Scope::Study,
    reads: "parameters, held-out trials",
    gives: "model against measurement, everywhere",
    needs: &[
        Need::Once("calibrate"),
        Need::Once("identify"),
        Need::Every("import", &[Role::Identify, Role::Validate]),
        Need::Every("ik", &[Role::Identify, Role::Validate]),
        Need::Every("filter", &[Role::Identify, Role::Validate]),
        Need::Every("flight", &[Role::Identify, Role::Validate]),
        Need::Every("regressor", &[Role::Identify, Role::Validate]),
    ],
    parameters: |study, _| {
        json!({"compare": study.config.compare, "filter": study.config.filter, "rows": study.config.regressor.rows,
            "identify": study.config.identify, "margin_s": study.config.flight.margin_s, "effects": study.effects})
    },
    run,
};

/// One trial with all that the comparison reads.
pub struct ComparedTrial {
    /// Name.
    pub name: String,
    /// Its part.
    pub role: Role,
    /// Filtered motion.
    pub filtered: Motion,
    /// Motion before filtering.
    pub unfiltered: Motion,
    /// Plates, tared; none where the trial has none.
    pub measured: Option<Measured>,
    /// Flights.
    pub flights: Vec<Range<usize>>,
    /// Frames in which everything that the body touches is measured.
    pub complete: Vec<bool>,
    /// Columns of the model's effects.
    pub effects: Option<EffectColumns>,
    /// True when the plates were never unloaded, so that what they read at rest is not known.
    pub untared: bool,
}

impl ComparedTrial {
    /// From the rows' material of a trial.
    pub fn of(job: &Job<'_>, name: &str, rows: TrialRows) -> Result<Self, StageFailure> {
        let effects = effect_columns(job.study, &rows)?;
        let trial = job.load_tared_trial(name)?;
        let report = job.load_flights(name)?;
        let flights: Vec<Range<usize>> = report.flights.iter().map(aloft_flight::Flight::frames).collect();
        let (rate_hz, frames) = (rows.filtered.rate_hz, rows.filtered.n_frames());
        let measured = if trial.plates.is_empty() {
            None
        } else {
            let filter = Some(low_pass(job.study));
            let m = measured_wrench(name, &trial.plates, rate_hz, frames, filter)
                .map_err(|e| StageFailure::new(e.to_string()))?;
            Some(m)
        };
        let complete = completely_measured(measured.as_ref(), &flights, frames);
        let tares: Vec<PlateTare> = read_json(&job.workspace.place("flight", name).join("tare.json"))?;
        let untared = measured.is_some() && tares.iter().all(|t| t.source == TareSource::None);
        Ok(Self {
            name: name.to_owned(),
            role: job.study.trial(name).map_or(Role::Identify, |t| t.role),
            filtered: rows.filtered,
            unfiltered: rows.motion,
            measured,
            flights,
            complete,
            effects,
            untared,
        })
    }
}

/// Loads the trials that every earlier stage brought through.
pub fn load_trials(job: &Job<'_>) -> Result<Vec<ComparedTrial>, StageFailure> {
    let names = job.trials_of("regressor");
    names.par_iter().map(|name| ComparedTrial::of(job, name, TrialRows::load(job, name)?)).collect()
}

/// In the air everything is known; on the ground only where plates are loaded: somebody who stands on a box before a drop loads none.
fn completely_measured(measured: Option<&Measured>, flights: &[Range<usize>], frames: usize) -> Vec<bool> {
    (0..frames)
        .map(|f| {
            flights.iter().any(|r| r.contains(&f))
                || measured.is_some_and(|m| m.unfiltered.get(f).is_some_and(|w| w[2] > 20.0))
        })
        .collect()
}

/// True when a trial that takes no part in identification was measured by plates: models are judged there. Else every trial in turn is
/// left out.
pub fn has_validation(trials: &[ComparedTrial]) -> bool {
    trials.iter().any(|t| t.role == Role::Validate && t.measured.is_some())
}

/// How a pipeline's models are compared: which trials count as held out, and whether noise is estimated.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum HeldOut {
    /// Trials that take no part; every trial where there are none (models come with one set of parameters a trial).
    Validation,
    /// Every trial (models come with one set of parameters a trial).
    EveryTrial,
}

/// Models of one subject against the measurement of trials.
pub fn compare_models(
    study: &Study,
    subject: &Subject,
    trials: &[ComparedTrial],
    candidates: &[Candidate],
    held_out: HeldOut,
    noise_draws: usize,
) -> Result<(Comparison, Vec<TrialSeries>), StageFailure> {
    let every = held_out == HeldOut::EveryTrial || !has_validation(trials);
    let inputs: Vec<TrialInput<'_>> = trials
        .iter()
        .map(|t| TrialInput {
            unfiltered: Some(&t.unfiltered),
            measured: t.measured.as_ref(),
            complete: Some(&t.complete),
            effects: t.effects.as_ref(),
            untared: t.untared,
            held_out_contact: if every { t.measured.is_some() } else { t.role == Role::Validate },
            held_out_flight: every || t.role == Role::Validate,
            ..TrialInput::new(&t.filtered, &t.flights)
        })
        .collect();
    let base = BaseParameters::of(&subject.model);
    let prior = subject.prior_phi();
    let body = Body { model: &subject.model, base: &base, prior: &prior };
    let spec = low_pass(study);
    let again = |m: &Motion| smooth(&subject.model, m, Some(spec)).ok();
    let options = CompareOptions {
        edge_s: study.config.compare.edge_s,
        flight_margin_s: study.config.flight.margin_s,
        window_s: study.config.compare.window_s,
        mass_kg: Some(subject.facts.mass_kg),
        noise_draws,
        ..CompareOptions::default()
    };
    let filtering = Filtering { filter: Some(spec), smooth: &again };
    compare(&body, candidates, &inputs, Some(filtering), &options).map_err(|e| StageFailure::new(e.to_string()))
}

fn run(job: &Job<'_>) -> Result<Done, StageFailure> {
    let study = job.study;
    let subject = job.load_subject("calibrate")?;
    let base = BaseParameters::of(&subject.model);
    let trials = load_trials(job)?;
    let validated = has_validation(&trials);
    let chosen = study.config.regressor.rows;
    let other = if chosen == Rows::Weak { Rows::Paper } else { Rows::Weak };
    let mut candidates = Vec::new();
    let mut done = Done::default();
    for (i, rows) in [chosen, other].into_iter().enumerate() {
        let Some(parameters) = job.load_parameters(rows)? else { continue };
        let name = if i == 0 { "identified".to_owned() } else { format!("{} rows", rows.word()) };
        let all = parameters.base_values();
        let candidate = if validated {
            Candidate::base(name, all)
        } else {
            let factors = training_factors(job, rows, study.config.identify.contact)?;
            let each = without_each_trial(study, &subject, &trials, &factors, estimator(study, rows), &all)?;
            done.warnings.extend(each.1);
            Candidate::per_trial(name, each.0)
        };
        candidates.push(candidate.with_effects(parameters.effects.iter().map(|e| (e.name.clone(), e.value))));
    }
    candidates.push(Candidate::links("prior", &base, &subject.prior_phi()));
    let draws = CompareOptions::default().noise_draws;
    let (comparison, series) = compare_models(study, &subject, &trials, &candidates, HeldOut::Validation, draws)?;
    write_json(&job.out.join("comparison.json"), &comparison)?;
    for s in &series {
        series_table(s, &comparison).write(&job.out.join(format!("series_{}.parquet", s.trial)))?;
    }
    describe(&comparison, &mut done);
    Ok(done)
}

/// Parameters for each trial, identified without it, and what could not be held out.
pub fn without_each_trial(
    study: &Study,
    subject: &Subject,
    trials: &[ComparedTrial],
    factors: &[(Stretch, Factor)],
    estimator: Estimator,
    all: &DVector<f64>,
) -> Result<(Vec<DVector<f64>>, Vec<String>), StageFailure> {
    let results: Vec<(DVector<f64>, Option<String>)> = trials
        .par_iter()
        .map(|t| {
            let kept: Vec<_> = factors.iter().filter(|(s, _)| s.trial != t.name).cloned().collect();
            if kept.is_empty() || kept.len() == factors.len() {
                let alone =
                    kept.is_empty().then(|| format!("{}: the only trial with flights, so it is not held out", t.name));
                return (all.clone(), alone);
            }
            match identify_from(study, subject, &kept, estimator, 0) {
                Ok(p) => (p.base_values(), None),
                Err(e) => (all.clone(), Some(format!("{} could not be left out: {}", t.name, e.problem))),
            }
        })
        .collect();
    let warnings = results.iter().filter_map(|r| r.1.clone()).collect();
    Ok((results.into_iter().map(|r| r.0).collect(), warnings))
}

const COMPONENTS: [&str; 6] = ["force_x_n", "force_y_n", "force_z_n", "moment_x_nm", "moment_y_nm", "moment_z_nm"];

fn series_table(s: &TrialSeries, comparison: &Comparison) -> Table {
    let mut table = Table::default();
    table.push("time_s", s.time_s.clone());
    table.push("in_flight", s.in_flight.iter().map(|f| f64::from(u8::from(*f))).collect());
    table.push("counts", s.phase.iter().map(|p| f64::from(u8::from(p.is_some()))).collect());
    for (i, name) in COMPONENTS.iter().enumerate() {
        table.push(format!("measured.{name}"), s.measured.iter().map(|w| w[i]).collect());
    }
    for (model, values) in comparison.models().zip(&s.predicted) {
        for (i, name) in COMPONENTS.iter().enumerate() {
            table.push(format!("{}.{name}", model.model), values.iter().map(|w| w[i]).collect());
        }
    }
    table
}

fn describe(c: &Comparison, done: &mut Done) {
    let first = &c.first;
    if first.held_out.frames > 0 {
        done.note("held_out_force_n", first.held_out.force_n.mean_mae());
        done.note("held_out_moment_nm", first.held_out.moment_nm.mean_mae());
    }
    if first.flight.frames > 0 {
        done.note("flight_force_rms_n", json!(first.flight.residual_force_n.rms));
        done.note("flight_moment_rms_nm", json!(first.flight.residual_moment_nm.rms));
    }
}
