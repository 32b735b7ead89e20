//! Models identified without one trial each, for errors on held-out motion.

use super::{ComparedTrial, Params};
use crate::graph::StageInputs;
use crate::stages::identify::{self, Predicting, identify_from, training_factors};
use aloft_body::Subject;
use aloft_compare::Candidate;
use aloft_identify::{Estimator, Parameters};
use aloft_regressor::{Factor, Stretch};
use aloft_study::config::Rows;
use aloft_workspace::error::StageFailure;
use nalgebra::DVector;
use rayon::prelude::*;

/// Parameters for each trial, identified without it, and remarks on trials that could not be left
/// out.
pub fn without_each_trial(
    params: &identify::Params,
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
            match identify_from(params, subject, &kept, estimator, 0) {
                Ok(p) => (p.base_values(), None),
                Err(e) => (all.clone(), Some(format!("{} could not be left out: {}", t.name, e.problem))),
            }
        })
        .collect();
    let warnings = results.iter().filter_map(|r| r.1.clone()).collect();
    Ok((results.into_iter().map(|r| r.0).collect(), warnings))
}

/// Model for one trial.
pub(super) struct Without {
    pub base: DVector<f64>,
    pub effects: Vec<(String, f64)>,
    /// True if the trial took no part in its identification.
    pub left_out: bool,
    pub remark: Option<String>,
}

/// A model for each trial, identified without it, using the estimator and the weight of the prior
/// chosen with all trials.
pub(super) fn each_without(
    predicting: &Predicting,
    trials: &[String],
    factors: &[(Stretch, Factor)],
    all: &Parameters,
) -> Result<Vec<Without>, StageFailure> {
    let effects = Parameters::coefficients;
    let of =
        |p: &Parameters, left_out, remark| Without { base: p.base_values(), effects: effects(p), left_out, remark };
    let every: Vec<&Factor> = factors.iter().map(|(_, f)| f).collect();
    let mut without = predicting.solve_without_each(&every)?;
    let each = trials
        .iter()
        .map(|t| {
            let own = factors.iter().filter(|(s, _)| s.trial == *t).count();
            if own == factors.len() {
                return of(all, false, Some(format!("{}: the only trial with flights, so it is not held out", t)));
            }
            if own == 0 {
                return of(all, true, None);
            }
            let found = without.remove(t).unwrap_or_else(|| {
                // the trial's factors are not among those that the estimator uses
                let kept: Vec<&Factor> = factors.iter().filter(|(s, _)| s.trial != *t).map(|(_, f)| f).collect();
                predicting.solve(&kept)
            });
            match found {
                Ok((base, effects)) => Without { base, effects, left_out: true, remark: None },
                Err(e) => of(all, false, Some(format!("{} could not be left out: {}", t, e.problem))),
            }
        })
        .collect();
    Ok(each)
}

/// The model without effects, through which noise is propagated; none if nothing was identified.
pub(super) fn plain_model(
    params: &Params,
    inputs: &StageInputs<'_>,
    subject: &Subject,
    rows: Rows,
) -> Result<Option<Candidate>, StageFailure> {
    let Some(parameters) = inputs.results.load_parameters(rows)? else { return Ok(None) };
    let stated = params.identify.contact.unwrap_or(false);
    let plain: Vec<Factor> = training_factors(inputs, rows, stated)?
        .iter()
        .map(|(_, f)| f.with_effects(&[]).map_err(|e| StageFailure::new(e.to_string())))
        .collect::<Result<_, StageFailure>>()?;
    let all: Vec<&Factor> = plain.iter().collect();
    let (base, _) = Predicting::like(subject, &parameters)?.solve(&all)?;
    Ok(Some(Candidate::base("plain", base)))
}
