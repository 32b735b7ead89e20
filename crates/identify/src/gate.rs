//! Gate: decides which numbers are results, which come from the prior and which are undetermined,
//! with reasons and advice on what to record next.

use crate::advice::Advice;
use crate::determination::Determination;
use crate::information::Information;
use crate::{Estimator, Sigma};
use serde::{Deserialize, Serialize};

/// Limits of the gate.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct GateLimits {
    /// Smallest σ_{N−1}/σ_N for which a null vector counts as a result.
    pub sigma_ratio: f64,
    /// Largest share of hardly observed parameters in a result without a prior.
    pub hardly_share: f64,
    /// Smallest share of the parameters that motion has to determine in a result with a prior.
    pub parameters: f64,
    /// Smallest share of the prior's variance that flights have to remove from the wrench of a
    /// flight predicted from the others.
    pub wrench: f64,
    /// Smallest number of stretches.
    pub stretches: usize,
}

impl Default for GateLimits {
    /// The shares come from simulated people with separate seeds, one data set of each kind. With 3
    /// mm of soft tissue, two flights removed 0.78 to 0.84 of the variance and three or more at
    /// least 0.907, with held-out window errors of 0.3 to 0.7 of the prior's. With 25 mm there was
    /// no improvement: 0.45 to 0.82, and 0.15 to 0.18 of the parameters. In between, the gate does
    /// not separate sharply: one set with 8 mm passes at 0.92 to 0.94 although its force error
    /// hardly decreased.
    fn default() -> Self {
        Self { sigma_ratio: 3.0, hardly_share: 0.1, parameters: 0.25, wrench: 0.9, stretches: 3 }
    }
}

/// Verdict over all parameters.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Gate {
    /// True if the numbers may be reported as identified.
    pub passed: bool,
    /// Reasons for a failure, or reservations.
    pub reasons: Vec<String>,
    /// What the model's joints and marker places add to the noise of the markers, where they do:
    /// the numbers are then those of another body.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub misfit: Option<String>,
    /// Names of the parameters that are hardly observed.
    pub hardly_seen: Vec<String>,
    /// What to record next, the most useful first.
    pub advice: Vec<String>,
    /// The first of these motions in a few words.
    #[serde(default)]
    pub next_motion: Option<String>,
}

/// Share of the prior's standard deviation, or of a tenth of the body's own scale, below which a
/// standard error counts as well determined.
pub(crate) const WELL: f64 = 0.3;

/// How well one parameter is determined: its standard error relative to the prior's standard
/// deviation, or without a prior to a tenth of the body's own scale. `unseen` is the part of the
/// error along directions that the motion does not determine: where that part alone is too large
/// for a well determined value, the value is the prior's, whatever the prior's own terms make of
/// its width.
pub fn determination(se: f64, unseen: f64, prior_sd: Option<f64>, scale: f64) -> Determination {
    let reference = prior_sd.filter(|s| *s > 0.0).unwrap_or(0.1 * scale);
    let share = se / reference;
    if share < WELL {
        Determination::Well
    } else if unseen / reference >= WELL {
        Determination::Hardly
    } else if share < 0.7 {
        Determination::Partly
    } else {
        Determination::Hardly
    }
}

/// The verdict.
pub(crate) fn judge(
    estimator: &Estimator,
    sigma: &Sigma,
    information: Option<&Information>,
    parameters: &[(String, Determination)],
    n_stretches: usize,
    deficient: usize,
    limits: &GateLimits,
    advice: Vec<Advice>,
) -> Gate {
    let hardly_seen: Vec<String> =
        parameters.iter().filter(|(_, s)| *s == Determination::Hardly).map(|(name, _)| name.clone()).collect();
    let mut reasons = Vec::new();
    let mut passed = true;
    if n_stretches < limits.stretches {
        reasons.push(format!(
            "{n_stretches} flights: intervals need at least {}, standard errors are those of the noise alone",
            limits.stretches
        ));
    }
    if let Estimator::NullVector(_) = estimator
        && (sigma.ratio.is_nan() || sigma.ratio < limits.sigma_ratio)
    {
        passed = false;
        reasons.push(format!(
            "σ(N−1)/σ(N) is {:.2}, below {:.1}: a second direction fits the flights nearly as well, so this vector is not a result",
            sigma.ratio, limits.sigma_ratio
        ));
    }
    if deficient > 0 {
        passed = false;
        reasons.push(format!("{deficient} directions of the parameters are not determined by any row"));
    }
    let share = hardly_seen.len() as f64 / parameters.len().max(1) as f64;
    if let Some(information) = information {
        match information.wrench {
            Some(removed) if removed < limits.wrench => {
                passed = false;
                reasons.push(format!(
                    "the flights remove {:.0} % of the tables' variance from the wrench of a flight predicted from the others, less than {:.0} %: what is \
                     predicted comes from tables as much as from motion",
                    100.0 * removed.max(0.0),
                    100.0 * limits.wrench
                ));
            }
            None => {
                passed = false;
                reasons.push("one flight cannot be cross-validated; record more flights".to_owned());
            }
            Some(_) => {}
        }
        if information.parameters < limits.parameters {
            passed = false;
            reasons.push(format!(
                "motion determines {:.0} % of the parameters, less than {:.0} %: this is the body from tables, corrected by a few combinations",
                100.0 * information.parameters,
                100.0 * limits.parameters
            ));
        }
    }
    match estimator {
        Estimator::Regularised { .. } | Estimator::NoiseMetric if hardly_seen.is_empty() => {}
        Estimator::Regularised { .. } | Estimator::NoiseMetric => reasons.push(format!(
            "{} of {} parameters are from tables; combinations that move the whole body are known better than each of them",
            hardly_seen.len(),
            parameters.len()
        )),
        _ if share > limits.hardly_share => {
            passed = false;
            reasons.push(format!(
                "{} of {} parameters are not determined (their error exceeds 7 % of the body's own scale); use tables (`estimator: regularised`) or add motion",
                hardly_seen.len(),
                parameters.len()
            ));
        }
        _ => {}
    }
    let next_motion = advice.first().map(|a| a.motion.clone());
    Gate {
        passed,
        reasons,
        misfit: None,
        hardly_seen,
        advice: advice.into_iter().map(|a| a.text).collect(),
        next_motion,
    }
}
