//! Identifies base parameters with their scale and uncertainty, and physically consistent links.
//!
//! From the factors of all flights (and contact phases), produced by `regressor`, [`identify`]
//! computes [`Parameters`], which `compare` and `discover` use: base parameters with intervals and
//! the prior for comparison, physically possible links, and a verdict that states which parameters
//! were determined. It works on factors only and needs no frames.
//!
//! | estimator | what it minimises | when |
//! |---|---|---|
//! | [`Estimator::NullVector`] | the smallest singular vector, scaled by the mass (the paper) | flights, rich motion |
//! | [`Estimator::NoiseMetric`] | the same in the metric of the rows' noise, the mass held | objects, robots |
//! | [`Estimator::MassConstrained`] | squares of all rows with the mass held | flights, contact, effects |
//! | [`Estimator::Regularised`] | the same, drawn to the prior as far as held-out flights allow | people, few flights |
//!
//! Standard errors are cluster-robust (the unit of evidence is the flight or the trial, never the
//! row), and every 95 % interval comes from [`interval95`]. [`consistent_links`] finds physical
//! links, [`simex()`](simex()) measures the bias caused by noisy regressors, [`choose_window`]
//! compares window lengths, [`excitation_advice`] evaluates motions that were not recorded.

pub mod advice;
mod alike;
pub mod balance;
mod clusters;
mod design;
mod determination;
mod error;
pub mod gate;
mod identify;
pub mod information;
pub mod interval;
pub mod links;
mod missing_number;
pub mod noise_metric;
pub mod null_vector;
pub mod parameters;
pub mod prior;
pub mod rotated;
mod rotated_estimate;
pub mod simex;
mod system;
mod uncertainty;
pub mod visible;
pub mod window;

pub use advice::{AdviceOptions, MotionAdvice, excitation_advice};
pub use balance::{KindBalance, balanced};
pub use clusters::{ClusterBy, WeightTrial};
pub use design::Design;
pub use determination::{Determination, Origin};
pub use error::IdentifyError;
pub use gate::{Gate, GateLimits};
pub use identify::{IdentifyOptions, identify, identify_merged, identify_with_errors};
pub use information::Information;
pub use interval::{half_of, half95, interval95, satterthwaite};
pub use links::{ConsistentLinks, LinkOptions, LinkSd, consistent_links};
pub use noise_metric::NoiseUnits;
pub use null_vector::{ColumnScaling, NullVector, Sigma, null_vector};
pub use parameters::{
    BaseEstimate, EffectEstimate, Estimator, Identification, LinkEstimate, LinkIntervals, LinkOrigin, Parameters,
};
pub use prior::{LinkPrior, PreparedPrior, Prior, Symmetry};
pub use rotated::RotatedRows;
pub use rotated_estimate::RotatedEstimate;
pub use simex::{Simex, add_noise, simex};
pub use uncertainty::jackknife_freedom;
pub use visible::{Unseen, Visible};
pub use window::{WindowChoice, WindowTrial, choose_window};

use aloft_regressor::Factor;
use nalgebra::DVector;

/// Least squares with the mass held fixed: base parameters and effect coefficients of a merged
/// factor, zero for coefficients that the rows do not determine ([`Visible`]).
///
/// # Errors
/// [`IdentifyError::Option`] for a mass that is not positive, [`IdentifyError::Numeric`] for rows
/// that are not finite.
pub fn mass_constrained(merged: &Factor, mass_kg: f64) -> Result<DVector<f64>, IdentifyError> {
    let visible = Visible::of(merged, false);
    Ok(visible.whole(system::System::new(&visible.reduce(merged)?, mass_kg, None)?.solve(0.0).x))
}

/// Base parameters (and effect coefficients, except for the null vector) from an estimator, without
/// intervals, links or a verdict: for repeated calls. If no weight of the prior is given, 1 is
/// used. Coefficients that the rows do not determine are zero ([`Visible`]).
///
/// # Errors
/// As [`identify`].
pub fn point_estimate(
    merged: &Factor,
    mass_kg: f64,
    prior: Option<&Prior>,
    estimator: Estimator,
) -> Result<DVector<f64>, IdentifyError> {
    let prepared = match (estimator, prior) {
        (Estimator::Regularised { .. } | Estimator::NoiseMetric, Some(prior)) => Some(prior.prepared(mass_kg)?),
        _ => None,
    };
    point_estimate_prepared(merged, mass_kg, prepared.as_ref(), estimator)
}

/// The same with a prepared prior, for many systems.
///
/// # Errors
/// As [`identify`].
pub fn point_estimate_prepared(
    merged: &Factor,
    mass_kg: f64,
    prior: Option<&PreparedPrior>,
    estimator: Estimator,
) -> Result<DVector<f64>, IdentifyError> {
    match estimator {
        Estimator::NullVector(scaling) => Ok(null_vector(merged, mass_kg, scaling)?.parameters),
        Estimator::MassConstrained => mass_constrained(merged, mass_kg),
        Estimator::NoiseMetric => {
            let visible = Visible::of(merged, prior.is_some());
            let metric = noise_metric::NoiseMetric::of(&visible.reduce(merged)?)?;
            Ok(visible.whole(metric.estimate(mass_kg, prior, 1.0)?.solution.x))
        }
        Estimator::Regularised { weight } => {
            let visible = Visible::of(merged, prior.is_some());
            let system = system::System::prepared(&visible.reduce(merged)?, mass_kg, prior)?;
            Ok(visible.whole(system.solve(weight.unwrap_or(1.0) * system.row_variance()).x))
        }
    }
}
