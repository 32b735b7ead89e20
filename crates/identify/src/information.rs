//! Information that motion added to the prior: posterior compared with prior, in the parameters and
//! in the wrench that they predict.
//!
//! A residual, or a gap between singular values, shows how well a vector fits; neither shows
//! whether the numbers come from motion or from the table. Two shares do. The first is the share of
//! parameters whose interval is clearly smaller than the prior's because of motion. The second
//! concerns the predicted wrench, for which the parameters are used. With prior covariance P (given
//! the mass) and posterior covariance C₋g without a fold g of the flights, whose rows are A_g,
//!
//! ```text
//! share of the prior's variance that motion removes = 1 − Σ_g tr(A_g C₋g A_gᵀ) / Σ_g tr(A_g P A_gᵀ)
//! ```
//!
//! Each flight is predicted from the others, because its own rows always determine its own wrench:
//! a single flight would explain itself perfectly without predicting the next one.

use crate::determination::Determination;
use crate::{IdentifyError, Prior};
use aloft_regressor::Factor;
use nalgebra::{DMatrix, DVector};
use serde::{Deserialize, Serialize};

/// Number of folds into which the clusters are divided.
const FOLDS: usize = 8;

/// Correlation of the rows' errors between flights: soft tissue and misplaced joint centres repeat,
/// and averaging over flights does not remove them. It does not affect the verdict on rigid
/// objects.
const REPEATS: f64 = 0.2;

/// Information that motion added to the prior.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Information {
    /// Share of the base parameters (without the mass) whose interval is clearly smaller than the
    /// prior's because of motion, 0 to 1.
    pub parameters: f64,
    /// Share of the prior's variance that motion removed from the wrench of a flight predicted from
    /// the other flights; at most 1, negative if the prior alone predicts better. None without a
    /// prior or with fewer than two flights.
    pub wrench: Option<f64>,
}

/// Share of parameters that motion determines; the mass is not among them.
pub(crate) fn of_parameters(determined: &[Determination]) -> f64 {
    let measured = determined.iter().filter(|s| **s != Determination::Hardly).count();
    measured as f64 / determined.len().max(1) as f64
}

/// Share of the wrench's variance that motion removed; none with fewer than two clusters. `weight`
/// is that of the prior in squared row units (zero for estimators without one), `row_variance` the
/// variance of a row.
///
/// # Errors
/// [`IdentifyError::Length`] for a prior of another model, [`IdentifyError::Numeric`] for one that
/// is not a covariance.
pub(crate) fn of_wrench(
    clusters: &[Factor],
    mass_kg: f64,
    prior: &Prior,
    weight: f64,
    row_variance: f64,
) -> Result<Option<f64>, IdentifyError> {
    let n = clusters.len();
    let Some(first) = clusters.first().filter(|_| n >= 2) else { return Ok(None) };
    let (p, k) = (first.n_parameters(), first.n_effects());
    let (_, root) = prior.given_mass(p, mass_kg)?;
    let folds = n.min(FOLDS);
    let mut parts: Vec<Option<Factor>> = vec![None; folds];
    let mut counts = vec![0usize; folds];
    for (i, cluster) in clusters.iter().enumerate() {
        let part = &mut parts[i * folds / n];
        counts[i * folds / n] += 1;
        *part = Some(match part {
            Some(so_far) => so_far.merged_with(cluster)?,
            None => cluster.clone(),
        });
    }
    // rows in units of the prior, followed by the effects
    let rows: Vec<DMatrix<f64>> = parts
        .iter()
        .flatten()
        .map(|f| {
            let dense = f.dense();
            let mut out = DMatrix::zeros(dense.nrows(), p - 1 + k);
            out.columns_mut(0, p - 1).copy_from(&(dense.columns(1, p - 1) * &root));
            out.columns_mut(p - 1, k).copy_from(&dense.columns(p, k));
            out
        })
        .collect();
    let grams: Vec<DMatrix<f64>> = rows.iter().map(|a| a.tr_mul(a)).collect();
    let whole = grams.iter().fold(DMatrix::zeros(p - 1 + k, p - 1 + k), |sum, g| sum + g);
    let (mut before, mut after) = (0.0, 0.0);
    for ((a, gram), count) in rows.iter().zip(&grams).zip(&counts) {
        let own = a.columns(0, p - 1);
        before += own.norm_squared();
        let rest = without_effects(&(&whole - gram), p - 1);
        let mut curvature = rest.clone();
        // without a prior, a direction not determined by the other flights is as uncertain as
        // rounding allows
        let ridge = weight.max(1e-12 * rest.trace() / (p - 1) as f64).max(f64::MIN_POSITIVE);
        for i in 0..p - 1 {
            curvature[(i, i)] += ridge;
        }
        let Some(cholesky) = curvature.cholesky() else {
            return Err(IdentifyError::Numeric("the rows of a fold are not finite".to_owned()));
        };
        let x = cholesky.solve(&own.transpose());
        let repeats = 1.0 + ((n - count) as f64 - 1.0) * REPEATS;
        let noise: f64 = (&rest * &x).component_mul(&x).sum();
        after += repeats * row_variance * noise + ridge * ridge * x.norm_squared();
    }
    Ok((before > 0.0).then(|| 1.0 - after / before))
}

/// Gram matrix of the parameters with the effects (the last columns) projected out.
fn without_effects(gram: &DMatrix<f64>, m: usize) -> DMatrix<f64> {
    let k = gram.ncols() - m;
    let own = gram.view((0, 0), (m, m)).into_owned();
    if k == 0 {
        return own;
    }
    let coupling = gram.view((0, m), (m, k));
    let effects = gram.view((m, m), (k, k));
    // unit columns; effect directions that the other flights do not determine are left out
    let scale = DVector::from_fn(k, |i, _| if effects[(i, i)] > 0.0 { effects[(i, i)].sqrt().recip() } else { 0.0 });
    let unit = DMatrix::from_fn(k, k, |i, j| effects[(i, j)] * scale[i] * scale[j]);
    let eigen = unit.symmetric_eigen();
    let kept = eigen.eigenvalues.map(|l| if l > 1e-10 { l.sqrt().recip() } else { 0.0 });
    let half = coupling * DMatrix::from_diagonal(&scale) * &eigen.eigenvectors * DMatrix::from_diagonal(&kept);
    own - &half * half.transpose()
}
