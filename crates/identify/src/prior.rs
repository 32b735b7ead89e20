//! What is known of the parameters before any motion: mean and covariance, mapped to base parameters.

use crate::IdentifyError;
use nalgebra::{DMatrix, DVector};

/// Prior of the base parameters.
#[derive(Debug, Clone, PartialEq)]
pub struct Prior {
    /// Mean, n_base.
    pub mean: DVector<f64>,
    /// Covariance, n_base².
    pub covariance: DMatrix<f64>,
}

impl Prior {
    /// Mean and root of the covariance of all base parameters but the mass, given the mass.
    pub(crate) fn given_mass(&self, p: usize, mass_kg: f64) -> Result<(DVector<f64>, DMatrix<f64>), IdentifyError> {
        if self.mean.len() != p || self.covariance.shape() != (p, p) {
            return Err(IdentifyError::Length { what: "base parameters of the prior", expected: p, found: self.mean.len() });
        }
        let variance = self.covariance[(0, 0)];
        let cross = self.covariance.view((1, 0), (p - 1, 1)).into_owned();
        let mut mean = self.mean.rows(1, p - 1).into_owned();
        let mut rest = self.covariance.view((1, 1), (p - 1, p - 1)).into_owned();
        if variance > 0.0 {
            mean += cross.column(0) * ((mass_kg - self.mean[0]) / variance);
            rest -= &cross * cross.transpose() / variance;
        }
        let root = covariance_root(&rest)?;
        Ok((mean, root))
    }
}

/// Symmetric root of a covariance; directions of rounding size are lifted so that the root can be inverted.
pub(crate) fn covariance_root(covariance: &DMatrix<f64>) -> Result<DMatrix<f64>, IdentifyError> {
    let n = covariance.nrows();
    // scale to correlations first: units differ by orders of magnitude
    let sd = DVector::from_fn(n, |i, _| covariance[(i, i)].max(0.0).sqrt());
    if sd.iter().any(|s| !s.is_finite() || *s == 0.0) {
        return Err(IdentifyError::Numeric("the prior covariance has a variance that is zero or not finite".to_owned()));
    }
    let correlation = DMatrix::from_fn(n, n, |i, j| 0.5 * (covariance[(i, j)] + covariance[(j, i)]) / (sd[i] * sd[j]));
    let eigen = correlation.symmetric_eigen();
    let floor = 1e-10;
    let roots = eigen.eigenvalues.map(|l| l.max(floor).sqrt());
    Ok(DMatrix::from_diagonal(&sd) * &eigen.eigenvectors * DMatrix::from_diagonal(&roots))
}
