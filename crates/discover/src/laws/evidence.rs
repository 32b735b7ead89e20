//! The residual rows of a model, prepared so that thousands of candidate columns can be scored.
//!
//! With `Q` an orthonormal basis of the model's columns (those of the prior included) and
//! `T_g = (I − Q_g Q_gᵀ)⁻¹` for each cluster g of rows, the residual r of the fit to all rows gives
//! that of the fit without the cluster as `T_g r_g`. For columns C with `e = C − Q Qᵀ C`,
//!
//! ```text
//! S₋g = CᵀC − (QᵀC)ᵀ(QᵀC) − e_gᵀ T_g e_g       c₋g = Cᵀr − e_gᵀ T_g r_g
//! θ₋g = S₋g⁻¹ c₋g                             held-out residual T_g (r_g − e_g θ₋g)
//! ```
//!
//! so the parameters of the body are refitted beside every candidate in every fold, at the price of
//! a few small products. Residuals with random signs of the clusters are further right-hand sides:
//! draw j of cluster g is `σ_gj r_g − Q_g γ_j` with `γ_j = Σ_h σ_hj Q_hᵀ r_h`, so that its products
//! with columns are those of the measured residual, and some with a few vectors `γ`. The null
//! distribution of the whole search costs little more than the search.
//!
//! A cluster of many rows (a recording of contact has some thousand) never needs its `T_g`. With
//! `G = Q_gᵀ Q_g` and `K = (I − G)⁻¹`, Woodbury's identity gives `T_g = I + Q_g K Q_gᵀ` and
//! `T_g² = I + Q_g (K + K²) Q_gᵀ`, so that all products are made of `Q_gᵀ C`, whose size is that of
//! the model. It also gives `T_g Q_g = Q_g K`, hence `eᵀ T_g Q_g γ = (Qᵀe)ᵀ K γ`.

use crate::problem::Problem;
use nalgebra::{Cholesky, DMatrix, DVector};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use std::sync::Arc;

/// Draws of random signs for the null distribution of the atlas.
pub(crate) const DRAWS: usize = 60;
/// Relative ridge that keeps nearly collinear curves solvable.
const RIDGE: f64 = 1e-7;
/// Weight of a curve's second differences, in mean squares of its columns.
const SMOOTH: f64 = 1e-3;
/// Share of a column's square outside the span of the model's columns below which it is rounding
/// error.
const SPANNED: f64 = 1e-9;

/// The model's columns in a cluster.
struct Basis {
    /// `Qᵀ`, model × rows.
    q_t: DMatrix<f64>,
    leverage: Leverage,
}

/// How `T` of a cluster is applied.
enum Leverage {
    /// As it is, rows × rows, with `Q`, rows × model.
    Rows { t: DMatrix<f64>, q: DMatrix<f64> },
    /// By Woodbury's identity, from `G` and `K`, model × model.
    Model { g: DMatrix<f64>, k: DMatrix<f64> },
}

impl Basis {
    /// The columns `q` (rows × model) of a cluster; `None` if they leave nothing of a row.
    fn new(q: DMatrix<f64>) -> Option<Self> {
        let q_t = q.transpose();
        let inverse = |product: DMatrix<f64>| {
            let n = product.nrows();
            Cholesky::new(DMatrix::identity(n, n) - product).map(|c| c.inverse())
        };
        let leverage = if q.nrows() <= q.ncols() {
            Leverage::Rows { t: inverse(&q * &q_t)?, q }
        } else {
            let g = &q_t * q;
            let k = inverse(g.clone())?;
            Leverage::Model { g, k }
        };
        Some(Self { q_t, leverage })
    }

    /// `T x`.
    fn apply(&self, x: &DVector<f64>) -> DVector<f64> {
        match &self.leverage {
            Leverage::Rows { t, .. } => t * x,
            Leverage::Model { k, .. } => x + self.q_t.tr_mul(&(k * (&self.q_t * x))),
        }
    }

    /// What the products of draws with columns are made of: `T Q γ` and `T² Q γ` where `T` is
    /// applied as it is, `K γ` and `K² γ` otherwise, transposed and one above the other.
    fn of_draws(&self, gamma: &DMatrix<f64>) -> DMatrix<f64> {
        let (once, twice) = match &self.leverage {
            Leverage::Rows { t, q } => {
                let once = t * (q * gamma);
                let twice = t * &once;
                (once, twice)
            }
            Leverage::Model { k, .. } => {
                let once = k * gamma;
                let twice = k * &once;
                (once, twice)
            }
        };
        let n = gamma.ncols();
        let mut out = DMatrix::zeros(2 * n, once.nrows());
        out.rows_mut(0, n).copy_from(&once.transpose());
        out.rows_mut(n, n).copy_from(&twice.transpose());
        out
    }
}

/// A cluster of rows.
struct Part {
    basis: Arc<Basis>,
    /// Measured residual r, `T r` and `T² r`, rows × 3.
    measured: DMatrix<f64>,
    /// `Qᵀ T r` and `Qᵀ T² r`, model × 2; empty where `T` is applied as it is.
    projected: DMatrix<f64>,
    /// Sign of the cluster in every right-hand side; the first is the measured one.
    signs: Vec<f64>,
    /// [`Basis::of_draws`].
    draws: DMatrix<f64>,
    /// `|T r|²` of every right-hand side.
    plain: Vec<f64>,
}

impl Part {
    /// Measured residual `r` of a cluster, its signs, and `γ` (model × right-hand sides).
    fn new(basis: Arc<Basis>, r: &DVector<f64>, signs: Vec<f64>, gamma: &DMatrix<f64>) -> Self {
        let tr = basis.apply(r);
        let ttr = basis.apply(&tr);
        let projected = match basis.leverage {
            Leverage::Rows { .. } => DMatrix::zeros(0, 2),
            Leverage::Model { .. } => DMatrix::from_columns(&[&basis.q_t * &tr, &basis.q_t * &ttr]),
        };
        let draws = basis.of_draws(gamma);
        // |T (σ r − Q γ)|², of which T Q γ = Q K γ
        let t_q_gamma = match basis.leverage {
            Leverage::Rows { .. } => draws.rows(0, signs.len()).transpose(),
            Leverage::Model { .. } => basis.q_t.tr_mul(&draws.rows(0, signs.len()).transpose()),
        };
        let plain = signs.iter().zip(t_q_gamma.column_iter()).map(|(s, y)| (&tr * *s - y).norm_squared()).collect();
        let measured = DMatrix::from_columns(&[r.clone(), tr, ttr]);
        Self { basis, measured, projected, signs, draws, plain }
    }

    /// The part with the measured residual only.
    fn without_draws(&self) -> Self {
        let r = self.measured.column(0).into_owned();
        Self::new(Arc::clone(&self.basis), &r, vec![1.0], &DMatrix::zeros(self.basis.q_t.nrows(), 1))
    }

    /// The products of a fold with columns: their own ones, and `q_c = Qᵀ C` of all clusters.
    fn fold(&self, own: &Own<'_>, q_c: &DMatrix<f64>) -> FoldOf {
        let (taken, gram, measured, low) = match &self.basis.leverage {
            Leverage::Rows { t, q } => {
                let e = own.x - q * q_c;
                let (te, e_t) = (t * &e, e.transpose());
                let gram = te.transpose() * &te;
                (&e_t * te, gram, e_t * self.measured.columns(1, 2), e)
            }
            Leverage::Model { g, k } => {
                let q_c_t = q_c.transpose();
                let g_c = g * q_c;
                let between = &q_c_t * &own.q_x;
                // eᵀe and Qᵀe of e = x − Q q_c
                let squares = &own.squares - &between - between.transpose() + &q_c_t * &g_c;
                let z = &own.q_x - g_c;
                let (kz, z_t) = (k * &z, z.transpose());
                let taken = squares + z_t * &kz;
                let gram = &taken + kz.transpose() * &kz;
                (taken, gram, own.measured.columns(1, 2) - q_c_t * &self.projected, z)
            }
        };
        // eᵀ T (σ r − Q γ), and the same with T²
        let n = self.signs.len();
        let mut right = &self.draws * low;
        right.neg_mut();
        for (k, mut column) in right.column_iter_mut().enumerate() {
            for (times, part) in column.as_mut_slice().chunks_exact_mut(n).enumerate() {
                let of_measured = measured[(k, times)];
                part.iter_mut().zip(&self.signs).for_each(|(x, sign)| *x += sign * of_measured);
            }
        }
        FoldOf { taken, gram, right }
    }
}

/// Products of a cluster's rows of a candidate's columns x.
struct Own<'x> {
    x: &'x DMatrix<f64>,
    /// `Qᵀ x`.
    q_x: DMatrix<f64>,
    /// `xᵀ x`.
    squares: DMatrix<f64>,
    /// `xᵀ` of r, `T r`, `T² r`.
    measured: DMatrix<f64>,
}

/// Rows prepared for candidates.
pub(crate) struct Evidence {
    parts: Vec<Part>,
    /// `γ`, model × right-hand sides.
    gamma: DMatrix<f64>,
    /// Squared held-out error without a candidate, by right-hand side.
    pub plain: Vec<f64>,
}

/// A candidate's columns with the model projected out.
pub(crate) struct Prepared {
    s: DMatrix<f64>,
    whole: DVector<f64>,
    /// `Cᵀ r`, right-hand sides × columns.
    c: DMatrix<f64>,
    folds: Vec<FoldOf>,
}

struct FoldOf {
    /// `eᵀ T e`.
    taken: DMatrix<f64>,
    /// `(T e)ᵀ (T e)`.
    gram: DMatrix<f64>,
    /// `(eᵀ T r)ᵀ` above `((T e)ᵀ (T r))ᵀ`, each right-hand sides × columns.
    right: DMatrix<f64>,
}

/// Held-out score of some of a candidate's columns.
#[derive(Debug, Clone)]
pub(crate) struct Score {
    /// Squared held-out error over that without the candidate.
    pub ratio: f64,
    /// The same under random signs.
    pub null: Vec<f64>,
    /// Squared held-out error of every cluster.
    pub errors: Vec<f64>,
    /// Coefficients of the fit to all rows.
    pub theta: DVector<f64>,
}

impl Evidence {
    /// Residuals of a problem, with `draws` random sign patterns.
    pub fn new(problem: &Problem, draws: usize, seed: u64) -> Option<Self> {
        let bases = problem.bases()?;
        let n = bases.len();
        let real: Vec<DVector<f64>> = (0..n).map(|g| problem.residual(g)).collect();
        let signs: Vec<Vec<f64>> = (0..draws)
            .map(|draw| {
                let mut rng = ChaCha8Rng::seed_from_u64(seed);
                rng.set_stream(draw as u64);
                (0..n).map(|_| if rng.random_bool(0.5) { 1.0 } else { -1.0 }).collect()
            })
            .collect();
        let m = bases.first()?.ncols();
        // the measured residual is that of the fit already (with the prior, QᵀR is not zero)
        let mut gamma = DMatrix::zeros(m, 1 + draws);
        for ((g, q), r) in bases.iter().enumerate().zip(&real) {
            let q_r = q.tr_mul(r);
            for (mut column, signs) in gamma.column_iter_mut().skip(1).zip(&signs) {
                column.axpy(signs[g], &q_r, 1.0);
            }
        }
        let mut parts = Vec::with_capacity(n);
        let mut plain = vec![0.0; 1 + draws];
        for ((g, q), r) in bases.into_iter().enumerate().zip(&real) {
            let of_cluster = std::iter::once(1.0).chain(signs.iter().map(|s| s[g])).collect();
            let part = Part::new(Arc::new(Basis::new(q)?), r, of_cluster, &gamma);
            for (sum, of) in plain.iter_mut().zip(&part.plain) {
                *sum += of;
            }
            parts.push(part);
        }
        Some(Self { parts, gamma, plain })
    }

    /// The same without random signs: enough to compare candidates with each other.
    pub fn without_draws(&self) -> Self {
        Self {
            parts: self.parts.iter().map(Part::without_draws).collect(),
            gamma: self.gamma.columns(0, 1).into_owned(),
            plain: self.plain[..1].to_vec(),
        }
    }

    /// Projects the model out of columns given by cluster. Each `smooth` consecutive columns are
    /// the values of a curve: a light penalty on its second differences extends it where a fold has
    /// no rows (`smooth` 0 or 1: none).
    pub fn prepare<'c>(&self, columns: &'c [DMatrix<f64>], smooth: usize) -> Prepared {
        let k = columns[0].ncols();
        let n_right = self.plain.len();
        let of_part = |(part, x): (&Part, &'c DMatrix<f64>)| {
            let x_t = x.transpose();
            Own { x, q_x: &part.basis.q_t * x, squares: &x_t * x, measured: x_t * &part.measured }
        };
        let own: Vec<Own<'_>> = self.parts.iter().zip(columns).map(of_part).collect();
        let mut qc = DMatrix::zeros(self.gamma.nrows(), k);
        let mut s = DMatrix::zeros(k, k);
        let mut c = DMatrix::zeros(n_right, k);
        for (part, own) in self.parts.iter().zip(&own) {
            qc += &own.q_x;
            s += &own.squares;
            for (i, mut column) in c.column_iter_mut().enumerate() {
                let of_measured = own.measured[(i, 0)];
                column.iter_mut().zip(&part.signs).for_each(|(x, sign)| *x += sign * of_measured);
            }
        }
        c.gemm(-1.0, &self.gamma.transpose(), &qc, 1.0);
        let whole = s.diagonal();
        s.gemm(-1.0, &qc.transpose(), &qc, 1.0);
        if smooth > 2 {
            let weight = SMOOTH * s.trace() / k as f64;
            for first in (0..k).step_by(smooth) {
                for i in first + 1..first + smooth - 1 {
                    for (a, x) in [(i - 1, 1.0), (i, -2.0), (i + 1, 1.0)] {
                        for (b, y) in [(i - 1, 1.0), (i, -2.0), (i + 1, 1.0)] {
                            s[(a, b)] += weight * x * y;
                        }
                    }
                }
            }
        }
        let folds = self.parts.iter().zip(&own).map(|(part, own)| part.fold(own, &qc)).collect();
        Prepared { s, whole, c, folds }
    }

    /// Held-out score of the columns `of` (indices) of a candidate; `None` if the rows do not see
    /// them.
    pub fn score(&self, prepared: &Prepared, of: &[usize]) -> Option<Score> {
        let seen: Vec<usize> =
            of.iter().copied().filter(|&i| prepared.s[(i, i)] > SPANNED * prepared.whole[i]).collect();
        if seen.is_empty() {
            return None;
        }
        let k = seen.len();
        let n = self.plain.len();
        let scale: Vec<f64> = seen.iter().map(|&i| prepared.s[(i, i)].sqrt().recip()).collect();
        let square = |m: &DMatrix<f64>| {
            let mut out = Vec::with_capacity(k * k);
            for (&j, by) in seen.iter().zip(&scale) {
                let column = m.column(j);
                out.extend(seen.iter().zip(&scale).map(|(&i, scale)| column[i] * scale * by));
            }
            DMatrix::from_vec(k, k, out)
        };
        let right = |m: &DMatrix<f64>, first: usize| {
            let mut out = Vec::with_capacity(n * k);
            for (&i, scale) in seen.iter().zip(&scale) {
                out.extend(m.rows(first, n).column(i).iter().map(|x| x * scale));
            }
            DMatrix::from_vec(n, k, out)
        };
        let (s, c) = (square(&prepared.s), right(&prepared.c, 0));
        let factor = |mut gram: DMatrix<f64>| {
            for i in 0..k {
                gram[(i, i)] += RIDGE;
            }
            Cholesky::new(gram).map(Cholesky::unpack)
        };
        let mut sums = vec![0.0; n];
        let mut errors = Vec::with_capacity(prepared.folds.len());
        for (fold, part) in prepared.folds.iter().zip(&self.parts) {
            let mut theta = &c - right(&fold.right, 0);
            solve_rows(&factor(&s - square(&fold.taken))?, &mut theta);
            // |T r|² − 2 θᵀ(T e)ᵀ(T r) + θᵀ(T e)ᵀ(T e) θ
            let mut by_theta = right(&fold.right, n);
            by_theta.gemm(1.0, &theta, &square(&fold.gram), -2.0);
            by_theta.component_mul_assign(&theta);
            let mut error = DVector::from_column_slice(&part.plain);
            by_theta.column_iter().for_each(|x| error += x);
            sums.iter_mut().zip(error.iter()).for_each(|(sum, e)| *sum += e);
            errors.push(error[0]);
        }
        let mut fitted = c.rows(0, 1).into_owned();
        solve_rows(&factor(s)?, &mut fitted);
        let mut theta = DVector::zeros(of.len());
        for (j, i) in of.iter().enumerate() {
            if let Some(at) = seen.iter().position(|x| x == i) {
                theta[j] = fitted[at] * scale[at];
            }
        }
        let ratios: Vec<f64> = sums.iter().zip(&self.plain).map(|(a, b)| a / b).collect();
        ratios[0].is_finite().then(|| Score { ratio: ratios[0], null: ratios[1..].to_vec(), errors, theta })
    }
}

/// Solves `L Lᵀ x = b` for every row of `rows`: all right-hand sides at once, since they stand side
/// by side in memory.
fn solve_rows(l: &DMatrix<f64>, rows: &mut DMatrix<f64>) {
    let (n, k) = rows.shape();
    let less = |x: &mut [f64], other: &[f64], factor: f64| {
        x.iter_mut().zip(other).for_each(|(a, b)| *a -= factor * b);
    };
    let x = rows.as_mut_slice();
    for i in 0..k {
        let (before, rest) = x.split_at_mut(i * n);
        let own = &mut rest[..n];
        before.chunks_exact(n).enumerate().for_each(|(j, other)| less(own, other, l[(i, j)]));
        let by = l[(i, i)].recip();
        own.iter_mut().for_each(|a| *a *= by);
    }
    for i in (0..k).rev() {
        let (before, after) = x.split_at_mut((i + 1) * n);
        let own = &mut before[i * n..];
        after.chunks_exact(n).enumerate().for_each(|(j, other)| less(own, other, l[(i + 1 + j, i)]));
        let by = l[(i, i)].recip();
        own.iter_mut().for_each(|a| *a *= by);
    }
}
