//! Merged rows in the coordinates in which the prior, or least squares, works on each direction of
//! the body by itself. From them the estimate for any choice of effects takes a few small products,
//! so that a page in a browser can do it.
//!
//! With `x = x₀ + L y` (as in the module `system`) and `A L = U S Vᵀ`, the rows become
//!
//! ```text
//! S y' + Ẽ θ ≈ b̃      one row for each direction of the body, y' = Vᵀ y
//!        E₂ θ ≈ b₂      what the body cannot explain
//! ```
//!
//! Choosing effects picks columns of Ẽ and E₂. For a weight w of the prior, θ solves the least
//! squares of `√(w / (S² + w)) (Ẽ θ − b̃)` and `E₂ θ − b₂`, and `y' = S (b̃ − Ẽ θ) / (S² + w)`.

use crate::prior::PreparedPrior;
use crate::{Estimator, IdentifyError};
use aloft_regressor::Factor;
use faer::Mat;
use nalgebra::{DMatrix, DVector};

/// Merged rows with all effects in these coordinates; `m` directions of the body, `k` effect
/// columns.
#[derive(Debug, Clone)]
pub struct RotatedRows {
    /// Number of rows before factorisation.
    pub n_rows: usize,
    /// S, at most `m`.
    pub singular: Vec<f64>,
    /// `[Ẽ | b̃]`, one row for each of `singular`.
    pub top: DMatrix<f64>,
    /// `[E₂ | b₂]`, at most `k + 1` rows, upper trapezoid.
    pub bottom: DMatrix<f64>,
    /// Base parameters, the mass first: x₀.
    pub mean: DVector<f64>,
    /// Base parameters for each direction: L V, with a row of zeros for the mass.
    pub spread: DMatrix<f64>,
    /// Norm of the longest column of the body's parameters and of the measured one, beside which a
    /// column counts as zero.
    pub longest: f64,
    /// True if the body's own columns use up all rows, so that only the prior separates effects
    /// from them.
    pub saturated: bool,
    /// Weight of the prior beside the variance of a row; none without a prior.
    pub prior_weight: Option<f64>,
}

/// Singular values below this share of the largest one are rounding.
const NOTHING: f64 = 1e-12;

impl RotatedRows {
    /// Rotates merged rows for an estimator; none for the null vector, which is no least squares.
    /// Rows in the metric of their noise are those above it ([`mod@crate::noise_metric`]) with all
    /// effects; a choice that leaves effects out then differs from its own estimate by what the
    /// noise could imitate.
    ///
    /// # Errors
    /// Rows that are not finite; a prior of another body.
    pub fn of(
        merged: &Factor,
        mass_kg: f64,
        prior: Option<&PreparedPrior>,
        estimator: Estimator,
    ) -> Result<Option<Self>, IdentifyError> {
        let (prior, prior_weight) = match estimator {
            // no least squares in these rows
            Estimator::NullVector(_) => return Ok(None),
            Estimator::NoiseMetric => {
                let above = crate::noise_metric::NoiseMetric::of(merged)?.all_above()?;
                return Self::of(&above, mass_kg, prior, Estimator::Regularised { weight: None });
            }
            Estimator::MassConstrained => (None, None),
            Estimator::Regularised { weight } => (prior, prior.map(|_| weight.unwrap_or(1.0))),
        };
        let (p, k) = (merged.n_parameters(), merged.n_effects());
        let m = p - 1;
        let dense = merged.dense();
        let (h, n) = (dense.nrows(), p + k + 1);
        let (x0, root) = crate::system::origin(&dense, p, prior);
        if x0.len() != m {
            let what = "base parameters of the prior";
            return Err(IdentifyError::Length { what, expected: p, found: x0.len() + 1 });
        }
        let a = dense.columns(1, m);
        let right = dense.column(n - 1) - dense.column(0) * mass_kg - a * &x0;
        let scaled = a * &root;
        let qr = Mat::from_fn(h, m + k + 1, |i, j| match j {
            _ if j < m => scaled[(i, j)],
            _ if j < m + k => dense[(i, j + 1)],
            _ => right[i],
        })
        .qr();
        let r = qr.thin_R();
        let (height, above) = (r.nrows(), r.nrows().min(m));
        let block = Mat::from_fn(above, m, |i, j| if i <= j { r[(i, j)] } else { 0.0 });
        let svd = block
            .thin_svd()
            .map_err(|_| IdentifyError::Numeric("the singular value decomposition failed".to_owned()))?;
        let singular: Vec<f64> = svd.S().column_vector().iter().copied().collect();
        let u = DMatrix::from_fn(above, above, |i, j| svd.U()[(i, j)]);
        let v = DMatrix::from_fn(m, above, |i, j| svd.V()[(i, j)]);
        let top = u.tr_mul(&DMatrix::from_fn(above, k + 1, |i, j| r[(i, m + j)]));
        let bottom = DMatrix::from_fn(height - above, k + 1, |i, j| if i <= j { r[(above + i, m + j)] } else { 0.0 });
        if singular.iter().chain(top.iter()).chain(bottom.iter()).any(|x| !x.is_finite()) {
            return Err(IdentifyError::Numeric("the merged rows hold numbers that are not finite".to_owned()));
        }
        let mut mean = DVector::zeros(p);
        mean[0] = mass_kg;
        mean.rows_mut(1, m).copy_from(&x0);
        let mut spread = DMatrix::zeros(p, above);
        spread.view_mut((1, 0), (m, above)).copy_from(&(&root * v));
        let longest = (0..p).chain([n - 1]).map(|j| dense.column(j).norm()).fold(0.0, f64::max);
        let largest = singular.iter().copied().fold(0.0, f64::max);
        let rank = singular.iter().filter(|s| **s > NOTHING * largest).count();
        let n_rows = merged.n_rows;
        let saturated = rank >= n_rows.min(n);
        Ok(Some(Self { n_rows, singular, top, bottom, mean, spread, longest, saturated, prior_weight }))
    }
}
