//! The estimate in the metric of the rows' own noise, and the rank of the rows in its units.
//!
//! With the Gram of the rows `G = RᵀR` over the columns `[Y | −E | w]`, the Gram of their errors
//! `S = TᵀT` ([`mod@aloft_regressor::matrix_noise`]) and `ψ = (φ, θ, −1)`, the estimate minimises
//!
//! ```text
//! n ψᵀGψ / ψᵀSψ  +  λ q (φ − φ₀)ᵀ P⁻¹ (φ − φ₀)        the mass given, q = ψᵀGψ / ψᵀSψ
//! ```
//!
//! For flights without a prior this is the null vector of the pair (R, T), the smallest vector of
//! their generalised singular value decomposition: generalised total least squares (Van Huffel and
//! Vandewalle 1989), of which the paper's estimator (its eq. 14 to 16) is the case S = 1. Least
//! squares minimises `ψᵀGψ` alone and so shrinks what the noise imitates: on chains thrown gently
//! by 0.9 to 1.5 % of an inertia; on a single rigid body, whose moments about its centre of mass
//! are homogeneous in the inertia, to a thirtieth of it. The term `ln det` of the errors'
//! covariance is left out on purpose: with it nine tenths of that bias return.
//!
//! **Units of noise.** The generalised singular values σ_k of (R, T) are the lengths of the rows
//! along conjugate directions over the length that noise alone gives them. The paper assumes that
//! the rank falls by exactly one. In these units that can be seen: each direction with σ_k at the
//! level of the noise is one that the motion does not determine. It is taken out of the rows, so
//! that the prior alone holds it, with the prior's width. The prior states relative deviations of
//! links, so the value along such a direction is that of the consistent links ([`crate::links`]):
//! where the motion gives ratios, the size is the one with which the table agrees best.
//!
//! **Solution.** At the minimum the gradient is that of `ψᵀ(G − q S)ψ / s` with
//! `q = ψᵀGψ / ψᵀSψ` and `s = ψᵀSψ / n`. So the estimate is least squares with rows whose Gram is
//! `G − q S`; q and the estimate are found in turn. All that follows from rows (links, effects,
//! intervals) uses these. What is determined is judged against q, the error that the estimate
//! leaves, because a force missing from the model lifts all directions.

use crate::gate::WELL;
use crate::links::INERTIA_UNIT;
use crate::system::{Solution, System};
use crate::{IdentifyError, PreparedPrior};
use aloft_body::BaseParameters;
use aloft_regressor::Factor;
use faer::Mat;
use nalgebra::{DMatrix, DVector};
use serde::{Deserialize, Serialize};

/// Relative standard deviation with which the variance of the noise along one direction is known.
/// It is not the same for sensors of different kinds, and a smoother links errors of neighbouring
/// frames: on simulated rigid bodies two directions that hold noise alone come out at 0.88 and
/// 1.10, or at 1.06 and 1.51, ratios of variances of 1.6 and 2.0.
const NOISE_KNOWN_WITHIN: f64 = 0.5;

/// Singular values of the columns below this share of the largest are rounding.
const ROUNDING: f64 = 1e-12;

/// Unit vectors whose difference is shorter than this are the same.
const PARALLEL: f64 = 1e-9;

/// Most iterations for q; it grows, and settles within three or four, or slowly where a force is
/// missing that leaves 300 times the noise.
const ITERATIONS: usize = 500;

/// The rows in units of their noise.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct NoiseUnits {
    /// Generalised singular values of the rows and their noise, smallest first: lengths along
    /// conjugate directions in units of the stated noise. Exactly one is at its level if the
    /// flights determine everything but the scale. Directions without noise are not among them.
    pub sigma: Vec<f64>,
    /// Root mean square of the rows that the estimate leaves, in units of the noise: 1 for a model
    /// that lacks nothing and noise of the stated size.
    pub residual: f64,
    /// Number of directions at the level of the noise, beyond the one that the scale fixes.
    pub undetermined: usize,
    /// Base parameters whose value is the table's because it changes along these directions.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub of_table: Vec<String>,
    /// True if all of these change in proportion: the motion gives their ratios, the table their
    /// size.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub ratios: bool,
}

/// Orthonormal basis of the span of columns, without directions of at most `shortest`.
fn orthonormal(columns: &DMatrix<f64>, shortest: f64) -> DMatrix<f64> {
    if columns.is_empty() {
        return DMatrix::zeros(columns.nrows(), 0);
    }
    let svd = columns.clone().svd(true, false);
    let of = |u: &DMatrix<f64>| {
        let kept: Vec<usize> = (0..svd.singular_values.len()).filter(|&k| svd.singular_values[k] > shortest).collect();
        DMatrix::from_fn(u.nrows(), kept.len(), |i, k| u[(i, kept[k])])
    };
    svd.u.as_ref().map_or_else(|| DMatrix::zeros(columns.nrows(), 0), of)
}

/// Orthonormal basis of what is perpendicular to orthonormal columns: singular values of their
/// projection are 0 or 1.
fn complement(columns: &DMatrix<f64>) -> DMatrix<f64> {
    let n = columns.nrows();
    orthonormal(&(DMatrix::identity(n, n) - columns * columns.transpose()), 0.5)
}

/// The generalised decomposition of merged rows and their noise.
#[derive(Debug, Clone)]
pub(crate) struct NoiseMetric {
    /// Rows B with `G = BᵀB` and `S = Bᵀ diag(noise) B` where rows exist, r × n.
    rows: DMatrix<f64>,
    /// Gram of the noise along each row of B, largest first: `1 / σ²`.
    noise: Vec<f64>,
    /// Inverse of B in the space of its rows, n × r.
    back: DMatrix<f64>,
    /// Directions along which no row changes, n × e.
    flat: DMatrix<f64>,
    /// Length of a change along each of these, e × n.
    along_flat: DMatrix<f64>,
    merged: Factor,
}

/// The estimate with the rows that lead to it.
#[derive(Debug, Clone)]
pub(crate) struct InNoise {
    /// Rows with Gram `G − q S`, directions at the level of the noise left out.
    pub rows: Factor,
    /// q: mean square of the rows that the estimate leaves, over that of the noise.
    pub excess: f64,
    /// What of the unknowns (parameters without the mass, effects) the motion does not determine:
    /// the rows that were taken out, d × m.
    pub undetermined: DMatrix<f64>,
    /// The changes W of these unknowns with `undetermined · W = 1`, m × d.
    changes: DMatrix<f64>,
    /// Projection of columns that takes these changes out, n × n.
    pub determined: DMatrix<f64>,
    /// Variance of a row.
    pub row_variance: f64,
    /// The system of `rows`.
    pub system: System,
    /// Its solution.
    pub solution: Solution,
    /// For reports.
    pub units: NoiseUnits,
}

impl NoiseMetric {
    /// Decomposes merged rows.
    ///
    /// # Errors
    /// [`IdentifyError::Option`] for rows without their noise, [`IdentifyError::Numeric`] if a
    /// decomposition fails.
    pub fn of(merged: &Factor) -> Result<Self, IdentifyError> {
        let Some(noise) = merged.noise() else {
            return Err(IdentifyError::Option {
                option: "estimator",
                problem: "the noise of the rows is not known; compute the rows again, or use `mass_constrained`"
                    .to_owned(),
            });
        };
        let failed = || IdentifyError::Numeric("the singular value decomposition failed".to_owned());
        let (r, t) = (merged.dense(), noise.dense());
        let n = r.ncols();
        // columns of unit length make the rank decision independent of units
        let length: Vec<f64> = (0..n).map(|j| r.column(j).norm()).collect();
        let scale = |j: usize| if length[j] > 0.0 { length[j].recip() } else { 0.0 };
        let of_rows = Mat::from_fn(r.nrows(), n, |i, j| r[(i, j)] * scale(j));
        let svd = of_rows.thin_svd().map_err(|_| failed())?;
        let singular: Vec<f64> = svd.S().column_vector().iter().copied().collect();
        let largest = singular.iter().copied().fold(0.0, f64::max);
        let rank = singular.iter().filter(|s| **s > ROUNDING * largest).count();
        if rank == 0 || !largest.is_finite() {
            return Err(IdentifyError::Numeric("the merged rows are zero or not finite".to_owned()));
        }
        let v = svd.V();
        let seen = DMatrix::from_fn(n, rank, |j, k| v[(j, k)]);
        let mut flat = complement(&seen);
        let mut along_flat = flat.transpose();
        // a column without rows is a direction of its own
        for j in (0..n).filter(|j| length[*j] > 0.0) {
            flat.row_mut(j).scale_mut(scale(j));
            along_flat.column_mut(j).scale_mut(length[j]);
        }
        // noise along each right singular vector, per unit of the rows
        let along = Mat::from_fn(n, rank, |j, k| scale(j) * v[(j, k)] / singular[k]);
        let errors = Mat::from_fn(t.nrows(), n, |i, j| t[(i, j)]) * &along;
        let tall = errors.nrows().max(rank);
        let errors = Mat::from_fn(tall, rank, |i, j| if i < errors.nrows() { errors[(i, j)] } else { 0.0 });
        let inner = errors.thin_svd().map_err(|_| failed())?;
        let noise: Vec<f64> = inner.S().column_vector().iter().map(|m| m * m).collect();
        let z = inner.V();
        let rows = DMatrix::from_fn(rank, n, |k, j| {
            length[j] * (0..rank).map(|l| z[(l, k)] * singular[l] * v[(j, l)]).sum::<f64>()
        });
        let back = DMatrix::from_fn(n, rank, |j, k| (0..rank).map(|l| along[(j, l)] * z[(l, k)]).sum());
        Ok(Self { rows, noise, back, flat, along_flat, merged: merged.clone() })
    }

    /// Rows with Gram `G − q S`, without the directions at the level of the noise.
    fn rows_above(&self, q: f64) -> DMatrix<f64> {
        let kept: Vec<usize> = (0..self.rows.nrows()).filter(|&k| !self.is_noise(k, q)).collect();
        let share = |k: usize| (1.0 - q * self.noise[k]).max(0.0).sqrt();
        DMatrix::from_fn(kept.len(), self.rows.ncols(), |i, j| self.rows[(kept[i], j)] * share(kept[i]))
    }

    /// Rows with Gram `G − q S` and the largest q for which that has no negative direction.
    pub fn all_above(&self) -> Result<Factor, IdentifyError> {
        let q = self.noise.first().filter(|m| **m > 0.0).map_or(0.0, |m| m.recip());
        let (r, n) = self.rows.shape();
        self.factor_of(&DMatrix::from_fn(r, n, |k, j| self.rows[(k, j)] * (1.0 - q * self.noise[k]).max(0.0).sqrt()))
    }

    /// The factor of such rows.
    fn factor_of(&self, rows: &DMatrix<f64>) -> Result<Factor, IdentifyError> {
        let dense = Mat::from_fn(rows.nrows(), rows.ncols(), |i, j| rows[(i, j)]);
        Ok(self.merged.corrected(dense.as_ref())?)
    }

    /// Changes W of ψ that keep the mass and the right-hand side and that the rows do not tell from
    /// noise, n × d, and the rows V that see nothing else, d × n with V W = 1. The estimate is
    /// itself a direction at the level of the noise; what may be added to it without changing its
    /// mass is undetermined.
    fn undetermined(&self, q: f64) -> (DMatrix<f64>, DMatrix<f64>) {
        let n = self.rows.ncols();
        let at_noise: Vec<usize> = (0..self.noise.len()).filter(|&k| self.is_noise(k, q)).collect();
        let (kept, flat) = (at_noise.len(), self.flat.ncols());
        let changes = DMatrix::from_fn(n, kept + flat, |i, k| match at_noise.get(k) {
            Some(&at) => self.back[(i, at)],
            None => self.flat[(i, k - kept)],
        });
        let rows = DMatrix::from_fn(kept + flat, n, |k, i| match at_noise.get(k) {
            Some(&at) => self.rows[(at, i)],
            None => self.along_flat[(k - kept, i)],
        });
        let fixed: Vec<DVector<f64>> =
            [0, n - 1].iter().filter_map(|&i| changes.row(i).transpose().try_normalize(0.0)).collect();
        if changes.is_empty() || fixed.is_empty() {
            return (changes, rows);
        }
        let free = complement(&orthonormal(&DMatrix::from_columns(&fixed), PARALLEL));
        (changes * &free, free.transpose() * rows)
    }

    /// Projection of columns that takes changes W of ψ out, conjugate to the rows:
    /// `1 − W (WᵀGW)⁺ WᵀG`.
    fn without(&self, changes: &DMatrix<f64>) -> Result<DMatrix<f64>, IdentifyError> {
        let n = self.rows.ncols();
        if changes.is_empty() {
            return Ok(DMatrix::identity(n, n));
        }
        let along = &self.rows * changes;
        let inverse = along
            .pseudo_inverse(ROUNDING)
            .map_err(|problem| IdentifyError::Numeric(format!("the undetermined directions: {problem}")))?;
        Ok(DMatrix::identity(n, n) - changes * (inverse * &self.rows))
    }

    /// Whether a direction is at the level of q times the noise. With a variance κ times that of
    /// the noise, an error δ of the noise's variance is one of δ / (κ − 1) in what the direction
    /// tells: it tells nothing where that exceeds the share of a well determined value. The noise
    /// is never taken for less than what the sensors have: of a few short flights the estimate can
    /// leave less by chance.
    fn is_noise(&self, k: usize, q: f64) -> bool {
        q.max(1.0) * self.noise[k] * (1.0 + NOISE_KNOWN_WITHIN / WELL) >= 1.0
    }

    /// ψ of an estimate.
    fn psi(&self, x: &DVector<f64>) -> DVector<f64> {
        let n = self.rows.ncols();
        DVector::from_fn(n, |i, _| if i + 1 == n { -1.0 } else { x[i] })
    }

    /// `ψᵀGψ` and `ψᵀSψ` of an estimate.
    fn lengths(&self, x: &DVector<f64>) -> (f64, f64) {
        let along = &self.rows * self.psi(x);
        let of_rows = along.norm_squared();
        let of_noise = along.iter().zip(&self.noise).map(|(a, m)| a * a * m).sum();
        (of_rows, of_noise)
    }

    /// The estimate with the mass given; the prior has weight `lambda` in units of its covariance.
    ///
    /// # Errors
    /// As [`System::prepared`].
    pub fn estimate(&self, mass_kg: f64, prior: Option<&PreparedPrior>, lambda: f64) -> Result<InNoise, IdentifyError> {
        let mut q = self.noise.first().filter(|m| **m > 0.0).map_or(0.0, |m| m.recip());
        let mut row_variance = f64::NAN;
        for _ in 0..ITERATIONS {
            let rows = self.factor_of(&self.rows_above(q))?;
            let system = System::prepared(&rows, mass_kg, prior)?;
            if row_variance.is_nan() {
                row_variance = self.row_variance(&system.solve(0.0));
            }
            let weight = if prior.is_some() { lambda * row_variance } else { 0.0 };
            let solution = system.solve(weight);
            let (of_rows, of_noise) = self.lengths(&solution.x);
            let next = if of_noise > 0.0 { of_rows / of_noise } else { q };
            row_variance = self.row_variance(&solution);
            if next <= q * (1.0 + 1e-9) {
                let sigma = self.noise.iter().filter(|m| **m > 0.0).map(|m| m.sqrt().recip()).collect();
                let (changes, rows_of) = self.undetermined(q);
                let determined = self.without(&changes)?;
                let undetermined = rows_of.columns_range(1..rows_of.ncols() - 1).into_owned();
                let changes = changes.rows_range(1..changes.nrows() - 1).into_owned();
                let units = NoiseUnits {
                    sigma,
                    residual: next.sqrt(),
                    undetermined: undetermined.nrows(),
                    of_table: Vec::new(),
                    ratios: false,
                };
                return Ok(InNoise {
                    rows,
                    excess: q,
                    undetermined,
                    changes,
                    determined,
                    row_variance,
                    system,
                    solution,
                    units,
                });
            }
            q = next;
        }
        Err(IdentifyError::Numeric("the estimate in the metric of the noise did not settle".to_owned()))
    }

    /// Moves an estimate along what the motion does not determine to where `x` is (parameters with
    /// the mass first, effects).
    pub fn move_to(&self, found: &mut InNoise, x: &DVector<f64>) {
        let m = found.undetermined.ncols();
        let to_go = &found.undetermined * (x.rows(1, m) - found.solution.x.rows(1, m));
        let mut moved = found.solution.x.rows_mut(1, m);
        moved += &found.changes * to_go;
        let (of_rows, of_noise) = self.lengths(&found.solution.x);
        if of_noise > 0.0 {
            found.units.residual = (of_rows / of_noise).sqrt();
        }
    }

    /// Rows M over the base parameters with `‖M φ_B‖²` the part of `ψᵀSψ` that inertias bring in, 1
    /// at an estimate; none if there is no such part.
    pub fn moment_errors(&self, x: &DVector<f64>, base: &BaseParameters) -> Option<DMatrix<f64>> {
        let mut errors = self.merged.noise()?.dense().columns(0, base.len()).into_owned();
        for (j, mut column) in errors.column_iter_mut().enumerate() {
            if base.parameters[j].unit != INERTIA_UNIT {
                column.fill(0.0);
            }
        }
        let at_estimate = (&errors * x.rows(0, base.len())).norm();
        (at_estimate > 0.0).then(|| errors / at_estimate)
    }

    /// Variance of a row, from what the estimate leaves.
    fn row_variance(&self, solution: &Solution) -> f64 {
        let freedom = self.merged.n_rows as f64 - solution.effective_parameters;
        (self.lengths(&solution.x).0 / freedom.max(1.0)).max(f64::MIN_POSITIVE)
    }
}
