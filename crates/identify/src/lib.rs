//! Base parameters, their scale and uncertainty, and consistent links.

mod error;
pub mod advice;
mod clusters;
pub mod gate;
pub mod links;
pub mod null_vector;
pub mod parameters;
pub mod prior;
mod identify;
pub mod simex;
mod system;
pub mod window;

pub use advice::{AdviceOptions, MotionAdvice, excitation_advice};
pub use error::IdentifyError;
pub use identify::{IdentifyOptions, identify};
pub use gate::{Gate, GateLimits, Seen};
pub use links::{ConsistentLinks, LinkOptions, LinkSd, consistent_links};
pub use null_vector::{ColumnScaling, NullVector, Sigma, null_vector};
pub use clusters::{ClusterBy, WeightTrial};
pub use parameters::{BaseEstimate, EffectEstimate, Estimator, Identification, LinkEstimate, Parameters};
pub use simex::{Simex, add_noise, simex};
pub use window::{WindowChoice, WindowTrial, choose_window};
pub use prior::{LinkPrior, Prior, Symmetry};

use aloft_regressor::Factor;
use nalgebra::DVector;

/// Least squares with the mass held: base parameters and effect coefficients of a merged factor.
///
/// # Errors
/// [`IdentifyError::Option`] for a mass that is not positive, [`IdentifyError::Numeric`] for rows that are not finite.
pub fn mass_constrained(merged: &Factor, mass_kg: f64) -> Result<DVector<f64>, IdentifyError> {
    Ok(system::System::new(merged, mass_kg, None)?.solve(0.0).x)
}
