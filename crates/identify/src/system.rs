//! Least squares with the mass held fixed and an optional prior: the linear system used by the
//! estimators.
//!
//! The unknowns are the base parameters without the mass, x, and the effect coefficients θ. With
//! merged rows `A x + E θ ≈ b` (the column of the mass moved to the right-hand side) and a prior of
//! mean x₀ and covariance P = L Lᵀ (conditional on the mass), minimise
//!
//! ```text
//! ‖A x + E θ − b‖² + w ‖L⁻¹ (x − x₀)‖²
//! ```
//!
//! θ is eliminated first; then one singular value decomposition of A L solves for every weight w.

use crate::prior::PreparedPrior;
use crate::{IdentifyError, Prior};
use aloft_regressor::Factor;
use faer::Mat;
use nalgebra::{DMatrix, DVector};

/// Merged rows, ready to solve for any weight of the prior.
#[derive(Debug, Clone)]
pub(crate) struct System {
    n_parameters: usize,
    n_effects: usize,
    mass_kg: f64,
    n_rows: usize,
    /// R of `[E | A]`, by blocks: inverse of the effects' triangle, their coupling to the
    /// parameters and to the right-hand side.
    effects_inverse: DMatrix<f64>,
    coupling: DMatrix<f64>,
    effects_right: DVector<f64>,
    /// Mean of the prior (zero without) and root of its covariance (column norms without), given
    /// the mass.
    mean: DVector<f64>,
    root: DMatrix<f64>,
    pub has_prior: bool,
    /// A L = U S Vᵀ; Uᵀ (b − A x₀).
    singular: DVector<f64>,
    v: DMatrix<f64>,
    projected: DVector<f64>,
    /// Sum of squares of the right-hand side outside the range of A.
    outside: f64,
}

/// Inverse of the effects' triangle.
///
/// # Errors
/// [`IdentifyError::Numeric`] if a column is zero or depends on others: elimination would have used
/// up rows on it. [`crate::Visible`] removes such columns beforehand.
pub(crate) fn inverse_triangle(triangle: &DMatrix<f64>) -> Result<DMatrix<f64>, IdentifyError> {
    let k = triangle.ncols();
    let dependent = (0..k).any(|j| triangle[(j, j)].abs() <= 1e-12 * triangle.column(j).norm());
    let inverse = if dependent { None } else { triangle.solve_upper_triangular(&DMatrix::identity(k, k)) };
    inverse.ok_or_else(|| IdentifyError::Numeric("columns of effects are zero or depend on each other".to_owned()))
}

/// Mean of the prior and root of its covariance, given the mass; without a prior zero and the
/// inverse norms of the columns. `dense` begins with the columns of `p` base parameters.
pub(crate) fn origin(dense: &DMatrix<f64>, p: usize, prior: Option<&PreparedPrior>) -> (DVector<f64>, DMatrix<f64>) {
    match prior {
        Some(prior) => (prior.mean.clone(), prior.root.clone()),
        None => {
            // scaling by column norms makes the rank decision independent of units
            let norms = DVector::from_fn(p - 1, |j, _| {
                let norm = dense.column(j + 1).norm();
                if norm > 0.0 { norm.recip() } else { 1.0 }
            });
            (DVector::zeros(p - 1), DMatrix::from_diagonal(&norms))
        }
    }
}

/// One solution of a [`System`].
#[derive(Debug, Clone)]
pub(crate) struct Solution {
    /// Base parameters (mass first) and effects.
    pub x: DVector<f64>,
    /// Sum of squares of the rows' residuals, without the prior's rows.
    pub rss: f64,
    /// Effective number of parameters that the rows determine (effects included).
    pub effective_parameters: f64,
    /// Number of directions that neither rows nor prior determine.
    pub deficient: usize,
}

impl System {
    pub fn new(merged: &Factor, mass_kg: f64, prior: Option<&Prior>) -> Result<Self, IdentifyError> {
        let prepared = match prior {
            Some(prior) if prior.mean.len() != merged.n_parameters() => {
                return Err(IdentifyError::Length {
                    what: "base parameters of the prior",
                    expected: merged.n_parameters(),
                    found: prior.mean.len(),
                });
            }
            Some(prior) => Some(prior.prepared(mass_kg)?),
            None => None,
        };
        Self::prepared(merged, mass_kg, prepared.as_ref())
    }

    /// The same with a prepared prior.
    pub fn prepared(merged: &Factor, mass_kg: f64, prior: Option<&PreparedPrior>) -> Result<Self, IdentifyError> {
        if !(mass_kg > 0.0 && mass_kg.is_finite()) {
            return Err(IdentifyError::Option { option: "mass_kg", problem: format!("{mass_kg}") });
        }
        let (p, k) = (merged.n_parameters(), merged.n_effects());
        let dense = merged.dense();
        let (h, n) = (dense.nrows(), p + k + 1);
        let (mean, root) = origin(&dense, p, prior);
        if mean.len() + 1 != p {
            return Err(IdentifyError::Length {
                what: "base parameters of the prior",
                expected: p,
                found: mean.len() + 1,
            });
        }
        let a = dense.columns(1, p - 1);
        let right = dense.column(n - 1) - dense.column(0) * mass_kg - a * &mean;
        let scaled = a * &root;
        let rows = h.max(k);
        let stacked = Mat::from_fn(rows, k + p, |i, j| {
            if i >= h {
                0.0
            } else if j < k {
                dense[(i, p + j)]
            } else if j < k + p - 1 {
                scaled[(i, j - k)]
            } else {
                right[i]
            }
        });
        let qr = stacked.qr();
        let r = qr.thin_R();
        let height = r.nrows();
        let get = |i: usize, j: usize| if i < height && i <= j { r[(i, j)] } else { 0.0 };
        let effects_inverse = inverse_triangle(&DMatrix::from_fn(k, k, get))?;
        let coupling = DMatrix::from_fn(k, p - 1, |i, j| get(i, k + j));
        let effects_right = DVector::from_fn(k, |i, _| get(i, k + p - 1));
        let block = Mat::from_fn(p - 1, p - 1, |i, j| get(k + i, k + j));
        let target = DVector::from_fn(p - 1, |i, _| get(k + i, k + p - 1));
        let last = get(k + p - 1, k + p - 1);
        let svd = block
            .thin_svd()
            .map_err(|_| IdentifyError::Numeric("the singular value decomposition failed".to_owned()))?;
        let m = p - 1;
        let singular = DVector::from_iterator(m, svd.S().column_vector().iter().copied());
        let v = DMatrix::from_fn(m, m, |i, j| svd.V()[(i, j)]);
        let u = DMatrix::from_fn(m, m, |i, j| svd.U()[(i, j)]);
        let projected = u.tr_mul(&target);
        if singular.iter().chain(projected.iter()).any(|x| !x.is_finite()) {
            return Err(IdentifyError::Numeric("the merged rows hold numbers that are not finite".to_owned()));
        }
        Ok(Self {
            n_parameters: p,
            n_effects: k,
            mass_kg,
            n_rows: merged.n_rows,
            effects_inverse,
            coupling,
            effects_right,
            mean,
            root,
            has_prior: prior.is_some(),
            singular,
            v,
            projected,
            outside: last * last,
        })
    }

    pub fn n_rows(&self) -> usize {
        self.n_rows
    }

    /// Solution for a weight w of the prior (0 without one).
    pub fn solve(&self, weight: f64) -> Solution {
        let m = self.singular.len();
        let floor = if self.has_prior && weight > 0.0 { 0.0 } else { 1e-13 * self.singular.max() };
        let mut z = DVector::zeros(m);
        let (mut rss, mut effective, mut deficient) = (self.outside, self.n_effects as f64, 0);
        for i in 0..m {
            let s = self.singular[i];
            if s <= floor {
                rss += self.projected[i] * self.projected[i];
                if weight <= 0.0 || !self.has_prior {
                    deficient += 1;
                }
                continue;
            }
            let share = s * s / (s * s + weight);
            z[i] = share * self.projected[i] / s;
            let left = (1.0 - share) * self.projected[i];
            rss += left * left;
            effective += share;
        }
        let y = &self.v * z;
        let theta = &self.effects_inverse * (&self.effects_right - &self.coupling * &y);
        let rest = &self.mean + &self.root * y;
        let mut x = DVector::zeros(self.n_parameters + self.n_effects);
        x[0] = self.mass_kg;
        x.rows_mut(1, self.n_parameters - 1).copy_from(&rest);
        x.rows_mut(self.n_parameters, self.n_effects).copy_from(&theta);
        Solution { x, rss, effective_parameters: effective, deficient }
    }

    /// For each base parameter, the mass first: true if it contributes to a direction that neither
    /// rows nor prior (of weight w) determine.
    pub fn undetermined(&self, weight: f64) -> Vec<bool> {
        let mut out = vec![false; self.n_parameters];
        if self.has_prior && weight > 0.0 {
            return out;
        }
        let floor = 1e-13 * self.singular.max();
        for (i, _) in self.singular.iter().enumerate().filter(|(_, s)| **s <= floor) {
            for (j, part) in (&self.root * self.v.column(i)).iter().enumerate() {
                out[j + 1] |= part.abs() > 1e-6 * self.root.row(j).norm();
            }
        }
        out
    }

    /// Variance s² of a row. Without a prior `rss / (rows − parameters)`; with one the
    /// maximum-likelihood value of `b − A x₀ ~ N(0, s² + A P Aᵀ)`, which is also valid with fewer
    /// rows than parameters.
    pub fn row_variance(&self) -> f64 {
        let n = self.n_rows as f64;
        if !self.has_prior {
            let s = self.solve(0.0);
            return s.rss / (n - s.effective_parameters).max(1.0);
        }
        let m = self.singular.len();
        let seen = self.n_rows.saturating_sub(self.n_effects).min(m);
        let beyond = self.n_rows.saturating_sub(self.n_effects + m) as f64;
        let minus_log_likelihood = |log_variance: f64| -> f64 {
            let variance = log_variance.exp();
            let inside: f64 = (0..seen)
                .map(|i| {
                    let total = variance + self.singular[i] * self.singular[i];
                    self.projected[i] * self.projected[i] / total + total.ln()
                })
                .sum();
            inside + self.outside / variance + beyond * log_variance
        };
        // bracket: from a millionth of the misfit of the prior mean (as a standard deviation) up to
        // all of it. Fewer rows than parameters can be fitted exactly, so the likelihood has no
        // lower limit there; with a smaller value the prior would vanish in rounding
        let total = (self.projected.norm_squared() + self.outside).max(f64::MIN_POSITIVE);
        let high = (total / n.max(1.0)).ln() + 1.0;
        let low = high - 28.0;
        let grid = 113;
        let at = |i: usize| low + (high - low) * i as f64 / (grid - 1) as f64;
        let best = (0..grid)
            .map(|i| (i, minus_log_likelihood(at(i))))
            .fold((0, f64::INFINITY), |best, next| if next.1 < best.1 { next } else { best })
            .0;
        // find the sign change of the slope between the neighbours of the best point: near a flat
        // minimum, comparing values gives only eight digits, so that rounding of the rows would
        // show in the ninth digit of every parameter
        let slope = |log_variance: f64| -> f64 {
            let variance = log_variance.exp();
            let inside: f64 = (0..seen)
                .map(|i| {
                    let total = variance + self.singular[i] * self.singular[i];
                    variance / total * (1.0 - self.projected[i] * self.projected[i] / total)
                })
                .sum();
            inside - self.outside / variance + beyond
        };
        let (mut a, mut b) = (at(best.saturating_sub(1)), at((best + 1).min(grid - 1)));
        for _ in 0..60 {
            let middle = 0.5 * (a + b);
            if slope(middle) > 0.0 { b = middle } else { a = middle }
        }
        (0.5 * (a + b)).exp()
    }

    /// Covariance of parameters and effects for independent rows of variance `row_variance` at the
    /// weight w of the prior: `H⁻¹ (s² AᵀA + w² P⁻¹) H⁻¹` with `H = AᵀA + w P⁻¹`: noise of the
    /// rows, and the bias due to the prior's own spread. Zero for the mass and for undetermined
    /// directions (reported by the gate).
    pub fn covariance(&self, row_variance: f64, weight: f64) -> DMatrix<f64> {
        let m = self.singular.len();
        let floor = 1e-13 * self.singular.max();
        let scaled = DMatrix::from_fn(m, m, |i, j| {
            let s = self.singular[j];
            if s <= floor && weight == 0.0 {
                return 0.0;
            }
            self.v[(i, j)] * (row_variance * s * s + weight * weight).sqrt() / (s * s + weight)
        });
        // x = L y; θ = E⁻¹ (… − coupling y)
        let x_of = &self.root * &scaled;
        let p = self.n_parameters;
        let n = p + self.n_effects;
        let mut factor = DMatrix::zeros(n, m + self.n_effects);
        factor.view_mut((1, 0), (p - 1, m)).copy_from(&x_of);
        if self.n_effects > 0 {
            let inverse = &self.effects_inverse;
            let by_y = -inverse * (&self.coupling * &scaled);
            factor.view_mut((p, 0), (self.n_effects, m)).copy_from(&by_y);
            factor.view_mut((p, m), (self.n_effects, self.n_effects)).copy_from(&(inverse * row_variance.sqrt()));
        }
        &factor * factor.transpose()
    }
}
