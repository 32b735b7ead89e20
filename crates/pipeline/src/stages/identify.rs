//! `identify`: base parameters from the factors of all flights, with weak rows and with the paper's beside them.

use crate::config::{Estimator as Choice, Rows};
use crate::error::StageFailure;
use crate::graph::{Done, Job, Need, Scope, Stage, key};
use crate::merge;
use crate::stages::regressor::{load_factors, load_slides, row_kind};
use crate::study::{Role, Study};
use crate::workspace::{WHOLE_STUDY, read_json, write_json};
use aloft_body::{BaseParameters, Subject};
use aloft_identify::{
    ColumnScaling, Estimator, IdentifyOptions, LinkPrior, Parameters, Prior, identify_with_slides, point_estimate,
};
use aloft_regressor::{Factor, RowKind, Slides, Stretch, StretchKind, leave_group_out};
use nalgebra::DVector;
use serde_json::json;
use std::collections::HashMap;

/// The stage.
pub static STAGE: Stage = Stage {
    name: "identify",
    version: 4,
    scope: Scope::Study,
    reads: "all factors",
    gives: "base parameters with intervals, consistent link inertias",
    needs: &[Need::Once("calibrate"), Need::Every("regressor", &[Role::Identify])],
    parameters: |study, _| {
        json!({"identify": key(&study.config.identify), "rows": key(&study.config.regressor.rows),
            "is_object": study.object.is_some()})
    },
    run,
};

/// Flights (and contact stretches, where asked for) of the identification trials, from one kind of rows.
pub fn training_factors(job: &Job<'_>, rows: Rows, contact: bool) -> Result<Vec<(Stretch, Factor)>, StageFailure> {
    let mut out = Vec::new();
    for name in job.trials_of("regressor") {
        if job.study.trial(&name).is_none_or(|t| t.role != Role::Identify) {
            continue;
        }
        let factors = load_factors(&job.workspace.place("regressor", &name))?;
        out.extend(
            factors.into_iter().filter(|(s, f)| f.rows == row_kind(rows) && (contact || s.kind == StretchKind::Flight)),
        );
    }
    Ok(out)
}

/// The estimator for a kind of rows: the paper's rows go with the paper's estimator unless the pipeline says otherwise.
pub fn estimator(study: &Study, rows: Rows) -> Estimator {
    let config = &study.config.identify;
    let weight = (config.prior_weight > 0.0).then_some(config.prior_weight);
    match (config.estimator, rows) {
        (Choice::NullVector, _) | (Choice::Auto, Rows::Paper) => Estimator::NullVector(ColumnScaling::default()),
        (Choice::MassConstrained, _) => Estimator::MassConstrained,
        (Choice::Regularized, _) => Estimator::Regularized { weight },
        (Choice::Auto, Rows::Weak) if study.object.is_some() => Estimator::MassConstrained,
        (Choice::Auto, Rows::Weak) => Estimator::Regularized { weight },
    }
}

/// What soft tissue makes of the weak rows of some factors, in their order; empty where a trial has none (objects).
fn training_slides(job: &Job<'_>, factors: &[(Stretch, Factor)]) -> Result<Vec<Slides>, StageFailure> {
    let mut of_trials: HashMap<&str, Vec<(Stretch, Slides)>> = HashMap::new();
    let mut out = Vec::with_capacity(factors.len());
    for (stretch, factor) in factors {
        if !of_trials.contains_key(factor.trial.as_str()) {
            of_trials.insert(&factor.trial, load_slides(&job.workspace.place("regressor", &factor.trial))?);
        }
        let found = of_trials.get(factor.trial.as_str()).and_then(|all| all.iter().find(|(s, _)| s == stretch));
        match found {
            Some((_, slides)) if factor.rows == RowKind::Weak => out.push(slides.clone()),
            _ => return Ok(Vec::new()),
        }
    }
    Ok(out)
}

/// Base parameters, and coefficients of effects by name.
pub type PointEstimate = (DVector<f64>, Vec<(String, f64)>);

/// Identifies from the given factors.
pub fn identify_from(
    study: &Study,
    subject: &Subject,
    factors: &[(Stretch, Factor)],
    estimator: Estimator,
    bootstrap: usize,
) -> Result<Parameters, StageFailure> {
    identify_with(study, subject, factors, None, &[], estimator, bootstrap)
}

/// The same with the flights merged already ([`merge::root`]) and with slides of soft tissue.
fn identify_with(
    study: &Study,
    subject: &Subject,
    factors: &[(Stretch, Factor)],
    flights: Option<&Factor>,
    slides: &[Slides],
    estimator: Estimator,
    bootstrap: usize,
) -> Result<Parameters, StageFailure> {
    let base = BaseParameters::of(&subject.model);
    let prior = LinkPrior::of_subject(subject).map_err(|e| StageFailure::new(e.to_string()))?;
    let repeat_correlation = study.config.identify.repeat_correlation.unwrap_or(0.0);
    let widening = study
        .effects
        .iter()
        .flat_map(|e| e.widening.iter().map(move |(name, by)| (format!("{}.{name}", e.key), *by)))
        .collect();
    let options = IdentifyOptions { estimator, bootstrap, repeat_correlation, widening, ..IdentifyOptions::default() };
    let plain: Vec<Factor> = factors.iter().map(|(_, f)| f.clone()).collect();
    identify_with_slides(&subject.model, &base, &plain, flights, slides, subject.facts.mass_kg, Some(&prior), &options)
        .map(|i| i.parameters)
        .map_err(|e| StageFailure::new(e.to_string()))
}

/// Base parameters and coefficients of effects without intervals and without links: all that predictions need.
pub struct Predicting {
    prior: Option<Prior>,
    mass_kg: f64,
    estimator: Estimator,
    contact_weight: f64,
}

impl Predicting {
    /// In the manner of parameters that were identified: their estimator, their weight of the prior and of contact.
    pub fn like(subject: &Subject, parameters: &Parameters) -> Result<Self, StageFailure> {
        let fail = |e: aloft_identify::IdentifyError| StageFailure::new(e.to_string());
        let prior = match parameters.estimator {
            Estimator::Regularized { .. } => {
                let base = BaseParameters::of(&subject.model);
                Some(LinkPrior::of_subject(subject).map_err(fail)?.base(&base).map_err(fail)?)
            }
            _ => None,
        };
        let contact_weight = parameters.contact.as_ref().map_or(1.0, |c| c.contact_weight);
        Ok(Self { prior, mass_kg: subject.facts.mass_kg, estimator: parameters.estimator, contact_weight })
    }

    /// Those of some factors that the estimator uses, contact by its weight.
    fn weighed(&self, factors: &[&Factor]) -> Vec<Factor> {
        let flights_only = matches!(self.estimator, Estimator::NullVector(_));
        factors
            .iter()
            .filter(|f| !(flights_only && f.kind == StretchKind::Contact))
            .map(|f| if f.kind == StretchKind::Contact { f.scaled(self.contact_weight) } else { (*f).clone() })
            .collect()
    }

    /// From the factors of some stretches.
    pub fn solve(&self, factors: &[&Factor]) -> Result<PointEstimate, StageFailure> {
        let merged = Factor::merge(&self.weighed(factors)).map_err(|e| StageFailure::new(e.to_string()))?;
        self.solve_merged(&merged)
    }

    /// The same for each trial without its factors. Of `n` trials the merging costs `3 n` steps in all, not `n` for each.
    pub fn solve_without_each(&self, factors: &[&Factor]) -> HashMap<String, Result<PointEstimate, StageFailure>> {
        let weighed = self.weighed(factors);
        let mut names: Vec<&str> = Vec::new();
        let mut group: HashMap<&str, usize> = HashMap::new();
        let groups: Vec<usize> = weighed
            .iter()
            .map(|f| {
                *group.entry(f.trial.as_str()).or_insert_with(|| {
                    names.push(&f.trial);
                    names.len() - 1
                })
            })
            .collect();
        // nothing is left of a single trial
        let Ok(found) = leave_group_out(&weighed, &groups, |_, rest| self.solve_merged(rest)) else {
            return HashMap::new();
        };
        names.iter().map(|n| (*n).to_owned()).zip(found).collect()
    }

    fn solve_merged(&self, merged: &Factor) -> Result<PointEstimate, StageFailure> {
        let x = point_estimate(merged, self.mass_kg, self.prior.as_ref(), self.estimator)
            .map_err(|e| StageFailure::new(e.to_string()))?;
        let p = merged.n_parameters();
        let effects = merged.columns.effects.iter().cloned().zip(x.iter().skip(p).copied()).collect();
        Ok((x.rows(0, p).into_owned(), effects))
    }
}

/// Where the parameters from one kind of rows lie.
pub fn file_name(rows: Rows) -> String {
    format!("parameters_{}.json", rows.word())
}

impl Job<'_> {
    /// What was identified from one kind of rows, if it was.
    pub fn load_parameters(&self, rows: Rows) -> Result<Option<Parameters>, StageFailure> {
        let path = self.workspace.place("identify", WHOLE_STUDY).join(file_name(rows));
        if path.is_file() { Ok(Some(read_json(&path)?)) } else { Ok(None) }
    }
}

fn run(job: &Job<'_>) -> Result<Done, StageFailure> {
    let study = job.study;
    let subject = job.load_subject("calibrate")?;
    let mut done = Done::default();
    let chosen = study.config.regressor.rows;
    for rows in Rows::ALL {
        let factors = training_factors(job, rows, study.config.identify.contact)?;
        if factors.is_empty() {
            let problem = format!("no flight of an identification trial gave {} rows", rows.word());
            if rows == chosen {
                return Err(StageFailure::with_hint(
                    problem,
                    "look at `aloft status` and the warnings of the stage `flight`",
                ));
            }
            done.warnings.push(problem);
            continue;
        }
        let flights = merge::root(job, &factors, row_kind(rows))?;
        let bootstrap = study.config.identify.bootstrap;
        let slides = training_slides(job, &factors)?;
        match identify_with(study, &subject, &factors, flights.as_ref(), &slides, estimator(study, rows), bootstrap) {
            Ok(parameters) => {
                write_json(&job.out.join(file_name(rows)), &parameters)?;
                if rows == chosen {
                    let unseen = parameters.effects.iter().filter_map(|e| Some((&e.name, e.not_determined.as_ref()?)));
                    done.warnings.extend(unseen.map(|(name, why)| format!("effect {name} is not determined: {why}")));
                    done.note("flights", parameters.n_stretches);
                    done.note("rows", parameters.n_rows);
                    done.note("gate_passed", parameters.gate.passed);
                    if !parameters.gate.passed {
                        done.warnings.extend(parameters.gate.reasons.iter().cloned());
                    }
                }
                done.note(&format!("sigma_ratio_{}", rows.word()), parameters.sigma.ratio);
            }
            Err(failure) if rows != chosen => done.warnings.push(format!("{} rows: {}", rows.word(), failure.problem)),
            Err(failure) => return Err(failure),
        }
    }
    Ok(done)
}
