//! The paper's estimator: the right singular vector of the smallest singular value, scaled by the
//! body mass.
//!
//! In flight `Y φ_B = 0`: the parameters span the null space of the merged factor. Noise in Y makes
//! the smallest singular value σ_N positive; the ratio of the next one, σ_{N−1}, to it shows how
//! well the direction is determined. Columns may be scaled before the decomposition. Without
//! scaling (as in the paper, the default) noise has equal weight in every column in its own unit,
//! which suits acceleration rows, whose columns carry noise of similar size; with unit columns the
//! result does not depend on units.

use crate::IdentifyError;
use aloft_regressor::Factor;
use faer::Mat;
use nalgebra::DVector;
use serde::{Deserialize, Serialize};

/// How columns are scaled before the singular value decomposition.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum ColumnScaling {
    /// Unscaled rows, SI units.
    #[default]
    None,
    /// Every column scaled to unit length.
    Unit,
}

/// Singular values in the paper's layout.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Sigma {
    /// Largest, σ_1.
    #[serde(deserialize_with = "crate::missing_number::nullable")]
    pub max: f64,
    /// Second smallest, σ_{N−1}.
    #[serde(deserialize_with = "crate::missing_number::nullable")]
    pub second: f64,
    /// Smallest, σ_N.
    #[serde(deserialize_with = "crate::missing_number::nullable")]
    pub min: f64,
    /// σ_{N−1} / σ_N.
    #[serde(deserialize_with = "crate::missing_number::nullable")]
    pub ratio: f64,
}

/// The smallest singular vector of a merged factor.
#[derive(Debug, Clone, PartialEq)]
pub struct NullVector {
    /// Base parameters, scaled to the body mass.
    pub parameters: DVector<f64>,
    /// σ_1, σ_{N−1}, σ_N.
    pub sigma: Sigma,
    /// All singular values, largest first.
    pub singular_values: Vec<f64>,
}

/// Parameters from the smallest singular vector of the parameter columns, with sign and scale from
/// `mass_kg`.
///
/// Effect columns and the measured column are ignored: this estimator is for flights.
///
/// # Errors
/// [`IdentifyError::TooFew`] with fewer rows than parameters less one, [`IdentifyError::Numeric`]
/// when the vector has no mass component.
pub fn null_vector(merged: &Factor, mass_kg: f64, scaling: ColumnScaling) -> Result<NullVector, IdentifyError> {
    let p = merged.n_parameters();
    if merged.height() + 1 < p {
        return Err(IdentifyError::TooFew { what: "rows", needed: p - 1, found: merged.height() });
    }
    let dense = merged.dense();
    let scale: Vec<f64> = (0..p)
        .map(|j| match scaling {
            ColumnScaling::None => 1.0,
            ColumnScaling::Unit => {
                let norm = dense.column(j).norm();
                if norm > 0.0 { norm.recip() } else { 1.0 }
            }
        })
        .collect();
    // rows below the parameter columns are zero there; missing rows count as zero
    let a = Mat::from_fn(p, p, |i, j| if i < dense.nrows() { dense[(i, j)] * scale[j] } else { 0.0 });
    let svd = a.thin_svd().map_err(|_| IdentifyError::Numeric("the singular value decomposition failed".to_owned()))?;
    let singular_values: Vec<f64> = svd.S().column_vector().iter().copied().collect();
    let vector = DVector::from_fn(p, |i, _| svd.V()[(i, p - 1)] * scale[i]);
    if vector[0].abs() < 1e-12 * vector.norm() || !vector.iter().all(|x| x.is_finite()) {
        return Err(IdentifyError::Numeric(
            "the smallest singular vector has no mass: another direction is determined even less".to_owned(),
        ));
    }
    let parameters = &vector * (mass_kg / vector[0]);
    Ok(NullVector { parameters, sigma: sigma_of(&singular_values), singular_values })
}

/// Singular values of a merged factor's parameter columns, in the paper's layout.
pub(crate) fn sigma_of(singular_values: &[f64]) -> Sigma {
    let n = singular_values.len();
    let at = |i: Option<usize>| i.and_then(|i| singular_values.get(i)).copied().unwrap_or(f64::NAN);
    let (max, second, min) = (at(Some(0)), at(n.checked_sub(2)), at(n.checked_sub(1)));
    Sigma { max, second, min, ratio: second / min }
}
