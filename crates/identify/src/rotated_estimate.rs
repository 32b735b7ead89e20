//! The estimate for a choice of effects from rotated rows ([`RotatedRows`]): what
//! [`point_estimate_prepared`](crate::point_estimate_prepared) gives for the same merged rows,
//! without a singular value decomposition for each choice.
//!
//! The variance of a row is found as there, by restricted maximum likelihood: for a trial variance
//! v the rows have the variances `v + S²` (directions of the body) and `v` (all others); the
//! effects' columns, weighed by them, are made orthonormal, and what they leave of the measured
//! column gives likelihood and slope.

use crate::{IdentifyError, RotatedRows};
use nalgebra::{DMatrix, DVector};

/// Points of the search for the variance of a row, and halvings between two of them.
const GRID: usize = 113;
const HALVINGS: usize = 60;
/// A column beside which less than this share is left when others are taken out is made orthogonal
/// once more: rounding would matter.
const LITTLE: f64 = 0.1;
/// Limits of `Visible`: a column is zero, or depends on those before it.
const ZERO: f64 = 1e-12;
const DEPENDENT: f64 = 1e-8;

/// Parameters and coefficients for a choice of effects.
#[derive(Debug, Clone)]
pub struct RotatedEstimate {
    /// Base parameters, the mass first.
    pub parameters: DVector<f64>,
    /// Coefficients of the chosen columns; zero where the rows do not determine them.
    pub effects: DVector<f64>,
}

impl RotatedRows {
    /// The estimate with these columns of effects.
    ///
    /// # Errors
    /// [`IdentifyError::Numeric`] for columns that depend on each other.
    pub fn estimate(&self, chosen: &[usize]) -> Result<RotatedEstimate, IdentifyError> {
        let (d, k) = (self.singular.len(), self.top.ncols() - 1);
        let with_measured: Vec<usize> = chosen.iter().copied().chain([k]).collect();
        let mut below = self.bottom.select_columns(&with_measured);
        if below.nrows() > below.ncols() {
            below = below.qr().r();
        }
        let column = |j: usize| {
            let (top, below) = (self.top.column(with_measured[j]), below.column(j));
            DVector::from_iterator(d + below.len(), top.iter().chain(below.iter()).copied())
        };
        let measured = column(chosen.len());
        let columns: Vec<DVector<f64>> = (0..chosen.len()).map(column).collect();
        let seen = self.determined(&columns);
        let effects = DMatrix::from_fn(measured.len(), seen.len(), |i, j| columns[seen[j]][i]);
        let weight = match self.prior_weight {
            Some(weight) => weight * Likelihood::of(self, &effects, &measured)?.variance(),
            None => 0.0,
        };
        let floor = if weight > 0.0 { 0.0 } else { 1e-13 * self.singular.iter().copied().fold(0.0, f64::max) };
        let root = DVector::from_fn(measured.len(), |i, _| match self.singular.get(i) {
            Some(s) if *s > floor => (weight / (s * s + weight)).sqrt(),
            _ => 1.0,
        });
        let weighed = DMatrix::from_fn(effects.nrows(), effects.ncols(), |i, j| root[i] * effects[(i, j)]);
        let x = least_squares(weighed, &measured.component_mul(&root))?;
        let left = &measured - &effects * &x;
        let y = DVector::from_fn(d, |i, _| match self.singular[i] {
            s if s > floor => s * left[i] / (s * s + weight),
            _ => 0.0,
        });
        let mut theta = DVector::zeros(chosen.len());
        for (place, value) in seen.iter().zip(x.iter()) {
            theta[*place] = *value;
        }
        Ok(RotatedEstimate { parameters: &self.mean + &self.spread * y, effects: theta })
    }

    /// Places of the columns that the rows determine, as [`Visible`](crate::Visible) finds them.
    fn determined(&self, columns: &[DVector<f64>]) -> Vec<usize> {
        let norms: Vec<f64> = columns.iter().map(DVector::norm).collect();
        let zero = ZERO * norms.iter().copied().fold(self.longest, f64::max);
        let largest = self.singular.iter().copied().fold(0.0, f64::max);
        let beside_body = !(self.saturated && self.prior_weight.is_some());
        let (mut basis, mut out): (Vec<DVector<f64>>, Vec<usize>) = (Vec::new(), Vec::new());
        for (j, column) in columns.iter().enumerate().filter(|(j, _)| norms[*j] > zero) {
            let mut v = column / norms[j];
            for (i, s) in self.singular.iter().enumerate() {
                if beside_body && *s > ZERO * largest {
                    v[i] = 0.0;
                }
            }
            for _ in 0..2 {
                clear(&mut v, &basis);
            }
            let rest = v.norm();
            if rest >= DEPENDENT {
                basis.push(v / rest);
                out.push(j);
            }
        }
        out
    }
}

/// Takes orthonormal columns out of a vector.
fn clear(v: &mut DVector<f64>, basis: &[DVector<f64>]) {
    for u in basis {
        let along = u.dot(v);
        v.axpy(-along, u, 1.0);
    }
}

/// x of the least squares `columns x ≈ right`.
fn least_squares(columns: DMatrix<f64>, right: &DVector<f64>) -> Result<DVector<f64>, IdentifyError> {
    let k = columns.ncols();
    if k == 0 {
        return Ok(DVector::zeros(0));
    }
    let dependent = || IdentifyError::Numeric("columns of effects are zero or depend on each other".to_owned());
    if columns.nrows() < k {
        return Err(dependent());
    }
    let qr = columns.qr();
    let projected = qr.q().tr_mul(right);
    let x = qr.r().solve_upper_triangular(&projected).ok_or_else(dependent)?;
    if x.iter().all(|v| v.is_finite()) { Ok(x) } else { Err(dependent()) }
}

/// Likelihood of a variance of a row.
struct Likelihood<'a> {
    effects: &'a DMatrix<f64>,
    measured: &'a DVector<f64>,
    /// S² of each direction of the body; zero for the other rows.
    squares: Vec<f64>,
    /// Rows before factorisation, and directions of the body.
    n_rows: f64,
    directions: usize,
    /// Largest log variance that is tried.
    high: f64,
}

/// Rows weighed by a variance.
struct Weighed {
    /// 1/√ of each row's variance.
    root: DVector<f64>,
    /// The effects' columns, orthonormal, and their lengths before.
    basis: Vec<DVector<f64>>,
    lengths: Vec<f64>,
    /// What they leave of the measured column.
    rest: DVector<f64>,
}

impl<'a> Likelihood<'a> {
    fn of(rows: &RotatedRows, effects: &'a DMatrix<f64>, measured: &'a DVector<f64>) -> Result<Self, IdentifyError> {
        let x = least_squares(effects.clone(), measured)?;
        let total = (measured - effects * x).norm_squared().max(f64::MIN_POSITIVE);
        let n_rows = rows.n_rows as f64;
        let squares = (0..measured.len()).map(|i| rows.singular.get(i).map_or(0.0, |s| s * s)).collect();
        let high = (total / n_rows.max(1.0)).ln() + 1.0;
        Ok(Self { effects, measured, squares, n_rows, directions: rows.singular.len(), high })
    }

    fn weighed(&self, variance: f64) -> Weighed {
        let root = DVector::from_fn(self.measured.len(), |i, _| (variance + self.squares[i]).sqrt().recip());
        let (mut basis, mut lengths): (Vec<DVector<f64>>, Vec<f64>) = (Vec::new(), Vec::new());
        let orthogonal = |v: &mut DVector<f64>, basis: &[DVector<f64>]| {
            let before = v.norm();
            clear(v, basis);
            if v.norm() < LITTLE * before {
                clear(v, basis);
            }
        };
        for column in self.effects.column_iter() {
            let mut v = column.component_mul(&root);
            orthogonal(&mut v, &basis);
            let length = v.norm();
            basis.push(v / length);
            lengths.push(length);
        }
        let mut rest = self.measured.component_mul(&root);
        orthogonal(&mut rest, &basis);
        Weighed { root, basis, lengths, rest }
    }

    /// −2 log likelihood, up to a constant.
    fn unlikely(&self, log_variance: f64) -> f64 {
        let w = self.weighed(log_variance.exp());
        let directions: f64 = w.root.iter().take(self.directions).map(|r| -2.0 * r.ln()).sum();
        let effects: f64 = w.lengths.iter().map(|l| 2.0 * l.ln()).sum();
        w.rest.norm_squared() + (self.n_rows - self.directions as f64) * log_variance + directions + effects
    }

    /// Its derivative by the log variance.
    fn slope(&self, log_variance: f64) -> f64 {
        let variance = log_variance.exp();
        let w = self.weighed(variance);
        let rows = w.root.iter().enumerate().map(|(i, root)| {
            let left = 1.0 - w.rest[i] * w.rest[i] - w.basis.iter().map(|q| q[i] * q[i]).sum::<f64>();
            variance * root * root * left
        });
        self.n_rows - self.measured.len() as f64 + rows.sum::<f64>()
    }

    fn variance(&self) -> f64 {
        let low = self.high - 28.0;
        let at = |i: usize| low + (self.high - low) * i as f64 / (GRID - 1) as f64;
        let least = |best: (usize, f64), i: usize| {
            let value = self.unlikely(at(i));
            if value < best.1 { (i, value) } else { best }
        };
        let best = (0..GRID).fold((0, f64::INFINITY), least).0;
        let (mut a, mut b) = (at(best.saturating_sub(1)), at((best + 1).min(GRID - 1)));
        for _ in 0..HALVINGS {
            let middle = 0.5 * (a + b);
            if self.slope(middle) > 0.0 { b = middle } else { a = middle }
        }
        (0.5 * (a + b)).exp()
    }
}
