//! The estimate in the metric of the rows' own noise, and the rank of the rows in its units.
//!
//! With the Gram of the rows `G = RᵀR` over the columns `[Y | −E | w]`, the Gram of their errors
//! `S = TᵀT` ([`mod@aloft_regressor::matrix_noise`]) and `ψ = (φ, θ, −1)`, the estimate minimises
//!
//! ```text
//! n ψᵀGψ / ψᵀSψ  +  λ (φ − φ₀)ᵀ P⁻¹ (φ − φ₀)          the mass given
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
//! that the prior alone holds it, with the prior's width (its size, for a direction along
//! which parameters keep their ratios).
//!
//! **Solution.** At the minimum the gradient is that of `ψᵀ(G − q S)ψ / s` with
//! `q = ψᵀGψ / ψᵀSψ` and `s = ψᵀSψ / n`. So the estimate is least squares with rows whose Gram is
//! `G − q S`; q and the estimate are found in turn. All that follows from rows (links, effects,
//! intervals) uses these. What is determined is judged against q, the error that the estimate
//! leaves, because a force missing from the model lifts all directions.

use crate::gate::WELL;
use crate::system::{Solution, System};
use crate::{IdentifyError, PreparedPrior};
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

/// Weight with which links keep a size that the table gives, over that of the table: what keeps
/// them physical would otherwise shrink it where flat links are measured thicker than the table's.
const HELD: f64 = 10.0;

/// Share of an undetermined direction, in squares of the table's standard deviations, that has to
/// lie in parameters that change in proportion for it to be a size: of a rigid body it is 1.000.
/// A quadrotor with balanced rotors is not recognised; its size is then too small.
const MOSTLY: f64 = 0.9;

/// Unit vectors whose difference is shorter than this are the same.
const PARALLEL: f64 = 1e-9;

/// Most iterations for q; it grows, and settles within three or four.
const ITERATIONS: usize = 50;

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

/// The common size of parameters of which the motion fixes only the ratios.
///
/// Along such a direction the estimate keeps the table's size: the length of the parameters that
/// change with it, in the table's standard deviations, is that of the table's own values. Its
/// relative standard deviation is that of the table's values, not that of their mean: a table is
/// wrong in size in all its links together. (Independent errors of the parameters, products of
/// inertia with means of zero among them, would draw the size towards zero and give it an interval
/// that is too narrow: a quadrotor's inertias came out at 0.7 of their size ± 0.15.)
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Size {
    /// Part of the estimate that has this size, base parameters without the mass.
    pub part: DVector<f64>,
    /// What the table says of it: a row over the columns `[Y | −E | w]`, of unit variance.
    pub row: DVector<f64>,
    /// Standard deviation of the size, in units of the part.
    pub spread: f64,
}

impl Size {
    /// Of the estimate `own`, if there is one undetermined direction and it is parallel to the
    /// estimate in nearly all parameters that it changes; `columns` is the number of columns of the
    /// rows.
    fn of(
        own: &DVector<f64>,
        undetermined: &DMatrix<f64>,
        prior: &PreparedPrior,
        columns: usize,
    ) -> Result<Option<Self>, IdentifyError> {
        let unknowns = prior.mean.len();
        if undetermined.ncols() != 1 {
            return Ok(None);
        }
        let sd: Vec<f64> = prior.root.row_iter().map(|r| r.norm()).collect();
        let mut changes = undetermined.rows(0, unknowns).into_owned();
        for (mut row, sd) in changes.row_iter_mut().zip(&sd) {
            row.unscale_mut(*sd);
        }
        changes.column_iter_mut().for_each(|mut c| {
            c.try_normalize_mut(0.0);
        });
        let value = DVector::from_fn(unknowns, |i, _| own[i] / sd[i]);
        let mut scaling: Vec<usize> = (0..unknowns).collect();
        let mut part = DVector::zeros(unknowns);
        for _ in 0..ITERATIONS {
            let here = changes.select_rows(&scaling);
            let inverse = here
                .clone()
                .pseudo_inverse(ROUNDING * here.norm())
                .map_err(|problem| IdentifyError::Numeric(format!("the undetermined directions: {problem}")))?;
            part = &changes * (inverse * value.select_rows(&scaling));
            let parallel = |i: &usize| (part[*i] - value[*i]).abs() < 0.5 * value[*i].abs();
            let next: Vec<usize> = (0..unknowns).filter(parallel).collect();
            if next.len() < 2 {
                return Ok(None);
            }
            let settled = next == scaling;
            scaling = next;
            if settled {
                break;
            }
        }
        let inside: f64 = scaling.iter().map(|&i| changes.row(i).norm_squared()).sum();
        if inside < MOSTLY {
            return Ok(None);
        }
        let squares = |f: &dyn Fn(usize) -> f64| scaling.iter().map(|&i| f(i) * f(i)).sum::<f64>();
        let of_table = |i: usize| prior.mean[i] / sd[i];
        let (length, table) = (squares(&|i| part[i]), squares(&of_table));
        if length <= 0.0 || table <= 0.0 {
            return Ok(None);
        }
        let size = (table / length).sqrt();
        let spread = size * table.sqrt() / squares(&|i| of_table(i).powi(2)).sqrt();
        let mut row = DVector::zeros(columns);
        for &i in &scaling {
            row[1 + i] = part[i] / sd[i] / length / spread;
        }
        row[columns - 1] = size / spread;
        Ok(Some(Self { part: DVector::from_fn(unknowns, |i, _| part[i] * sd[i]), row, spread }))
    }
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
    merged: Factor,
}

/// The estimate with the rows that lead to it.
#[derive(Debug, Clone)]
pub(crate) struct InNoise {
    /// Rows with Gram `G − q S`, directions at the level of the noise left out.
    pub rows: Factor,
    /// The same for links, which keep a size that the table gives.
    pub of_links: Factor,
    /// q: mean square of the rows that the estimate leaves, over that of the noise.
    pub excess: f64,
    /// Changes of the unknowns (parameters without the mass, effects) that the motion does not
    /// determine, m × d.
    pub undetermined: DMatrix<f64>,
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
    /// A size that the motion leaves to the table.
    pub size: Option<Size>,
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
        // a column without rows is a direction of its own
        (0..n).for_each(|j| flat.row_mut(j).scale_mut(if length[j] > 0.0 { scale(j) } else { 1.0 }));
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
        Ok(Self { rows, noise, back, flat, merged: merged.clone() })
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

    /// Changes of ψ that keep the mass and the right-hand side and that the rows do not tell from
    /// noise, n × d. The estimate is itself a direction at the level of the noise; what may be
    /// added to it without changing its mass is undetermined.
    fn undetermined(&self, q: f64) -> DMatrix<f64> {
        let n = self.rows.ncols();
        let at_noise: Vec<_> =
            (0..self.noise.len()).filter(|&k| self.is_noise(k, q)).map(|k| self.back.column(k)).collect();
        let all: Vec<_> = at_noise.into_iter().chain(self.flat.column_iter()).collect();
        if all.is_empty() {
            return DMatrix::zeros(n, 0);
        }
        let all = DMatrix::from_columns(&all);
        let mut fixed = DMatrix::from_fn(all.ncols(), 2, |k, which| all[(if which == 0 { 0 } else { n - 1 }, k)]);
        let mut kept = Vec::new();
        for which in 0..2 {
            let size = fixed.column(which).norm();
            if size > 0.0 {
                fixed.column_mut(which).unscale_mut(size);
                kept.push(fixed.column(which).into_owned());
            }
        }
        if kept.is_empty() {
            return all;
        }
        all * complement(&orthonormal(&DMatrix::from_columns(&kept), PARALLEL))
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
            let above = self.rows_above(q);
            let rows = self.factor_of(&above)?;
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
                let changes = self.undetermined(q);
                let determined = self.without(&changes)?;
                let undetermined = changes.rows(1, changes.nrows() - 2).into_owned();
                let size = match prior.filter(|_| lambda > 0.0 && undetermined.ncols() > 0) {
                    Some(prior) => Size::of(
                        &solution.x.rows(1, prior.mean.len()).into_owned(),
                        &undetermined,
                        prior,
                        self.rows.ncols(),
                    )?,
                    None => None,
                };
                let (rows, of_links, system, solution) = match (&size, prior) {
                    (Some(size), Some(prior)) => {
                        let with_size = |root: f64| {
                            let height = above.nrows();
                            self.factor_of(&DMatrix::from_fn(height + 1, above.ncols(), |i, j| {
                                if i < height { above[(i, j)] } else { root * size.row[j] }
                            }))
                        };
                        let rows = with_size(weight.sqrt())?;
                        let system = System::prepared(&rows, mass_kg, Some(&prior.freed(&size.part)?))?;
                        let solution = system.solve(weight);
                        (rows, with_size(HELD * weight.sqrt())?, system, solution)
                    }
                    _ => (rows.clone(), rows, system, solution),
                };
                let units = NoiseUnits {
                    sigma,
                    residual: next.sqrt(),
                    undetermined: undetermined.ncols(),
                    of_table: Vec::new(),
                    ratios: false,
                };
                return Ok(InNoise {
                    rows,
                    of_links,
                    excess: q,
                    undetermined,
                    determined,
                    row_variance,
                    system,
                    solution,
                    units,
                    size,
                });
            }
            q = next;
        }
        Err(IdentifyError::Numeric("the estimate in the metric of the noise did not settle".to_owned()))
    }

    /// Variance of a row, from what the estimate leaves.
    fn row_variance(&self, solution: &Solution) -> f64 {
        let freedom = self.merged.n_rows as f64 - solution.effective_parameters;
        (self.lengths(&solution.x).0 / freedom.max(1.0)).max(f64::MIN_POSITIVE)
    }
}
