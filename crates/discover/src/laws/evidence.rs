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
//! a few small products. Residuals with random signs of the clusters are further right-hand sides
//! of the same products: the null distribution of the whole search costs little more than the
//! search.

use crate::problem::Problem;
use nalgebra::{Cholesky, DMatrix, DVector};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

/// Draws of random signs for the null distribution of the atlas.
pub(crate) const DRAWS: usize = 60;
/// Relative ridge that keeps nearly collinear curves solvable.
const RIDGE: f64 = 1e-7;
/// Weight of a curve's second differences, in mean squares of its columns.
const SMOOTH: f64 = 1e-3;
/// Share of a column's square outside the span of the model's columns below which it is rounding
/// error.
const SPANNED: f64 = 1e-9;

struct Part {
    q: DMatrix<f64>,
    t: DMatrix<f64>,
    /// Residuals, one column for each right-hand side; the first is the measured one.
    r: DMatrix<f64>,
    /// `T r` and `T T r`.
    tr: DMatrix<f64>,
    ttr: DMatrix<f64>,
}

/// Rows prepared for candidates.
pub(crate) struct Evidence {
    parts: Vec<Part>,
    /// Squared held-out error without a candidate, by right-hand side.
    pub plain: Vec<f64>,
}

/// A candidate's columns with the model projected out.
pub(crate) struct Prepared {
    s: DMatrix<f64>,
    whole: DVector<f64>,
    c: DMatrix<f64>,
    folds: Vec<FoldOf>,
}

struct FoldOf {
    /// `eᵀ T e`, `eᵀ T r`.
    taken: DMatrix<f64>,
    right: DMatrix<f64>,
    /// `(T e)ᵀ (T e)`, `(T e)ᵀ (T r)`.
    gram: DMatrix<f64>,
    cross: DMatrix<f64>,
    /// `|T r|²`.
    plain: Vec<f64>,
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
        let mut common = DMatrix::zeros(m, 1 + draws);
        let flipped: Vec<DMatrix<f64>> = real
            .iter()
            .enumerate()
            .map(|(g, r)| {
                DMatrix::from_fn(r.len(), 1 + draws, |i, k| if k == 0 { r[i] } else { r[i] * signs[k - 1][g] })
            })
            .collect();
        for (q, r) in bases.iter().zip(&flipped) {
            common.gemm_tr(1.0, q, r, 1.0);
        }
        // the measured residual is that of the fit already (with the prior, QᵀR is not zero)
        common.column_mut(0).fill(0.0);
        let mut parts = Vec::with_capacity(n);
        let mut plain = vec![0.0; 1 + draws];
        for (q, r) in bases.into_iter().zip(flipped) {
            let r = r - &q * &common;
            let mut kept = DMatrix::identity(q.nrows(), q.nrows());
            kept.gemm(-1.0, &q, &q.transpose(), 1.0);
            let t = Cholesky::new(kept)?.inverse();
            let tr = &t * &r;
            let ttr = &t * &tr;
            for (k, sum) in plain.iter_mut().enumerate() {
                *sum += tr.column(k).norm_squared();
            }
            parts.push(Part { q, t, r, tr, ttr });
        }
        Some(Self { parts, plain })
    }

    /// Projects the model out of columns given by cluster. Each `smooth` consecutive columns are
    /// the values of a curve: a light penalty on its second differences extends it where a fold has
    /// no rows (`smooth` 0 or 1: none).
    pub fn prepare(&self, columns: &[DMatrix<f64>], smooth: usize) -> Prepared {
        let k = columns[0].ncols();
        let m = self.parts[0].q.ncols();
        let n_right = self.plain.len();
        let mut qc = DMatrix::zeros(m, k);
        let mut s = DMatrix::zeros(k, k);
        let mut c = DMatrix::zeros(k, n_right);
        for (part, x) in self.parts.iter().zip(columns) {
            qc.gemm_tr(1.0, &part.q, x, 1.0);
            s.gemm_tr(1.0, x, x, 1.0);
            c.gemm_tr(1.0, x, &part.r, 1.0);
        }
        let whole = s.diagonal();
        s.gemm_tr(-1.0, &qc, &qc, 1.0);
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
        let folds = self
            .parts
            .iter()
            .zip(columns)
            .map(|(part, x)| {
                let mut e = x.clone();
                e.gemm(-1.0, &part.q, &qc, 1.0);
                let te = &part.t * &e;
                FoldOf {
                    taken: e.tr_mul(&te),
                    right: e.tr_mul(&part.tr),
                    gram: te.tr_mul(&te),
                    cross: e.tr_mul(&part.ttr),
                    plain: (0..n_right).map(|j| part.tr.column(j).norm_squared()).collect(),
                }
            })
            .collect();
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
        let n_right = self.plain.len();
        let scale: Vec<f64> = seen.iter().map(|&i| prepared.s[(i, i)].sqrt().recip()).collect();
        let square = |m: &DMatrix<f64>| DMatrix::from_fn(k, k, |i, j| m[(seen[i], seen[j])] * scale[i] * scale[j]);
        let right = |m: &DMatrix<f64>| DMatrix::from_fn(k, n_right, |i, j| m[(seen[i], j)] * scale[i]);
        let (s, c) = (square(&prepared.s), right(&prepared.c));
        let mut sums = vec![0.0; n_right];
        let mut errors = Vec::with_capacity(prepared.folds.len());
        let solve = |mut gram: DMatrix<f64>, right: &DMatrix<f64>| {
            for i in 0..k {
                gram[(i, i)] += RIDGE;
            }
            Cholesky::new(gram).map(|f| f.solve(right))
        };
        for fold in &prepared.folds {
            let theta = solve(&s - square(&fold.taken), &(&c - right(&fold.right)))?;
            let gram = square(&fold.gram);
            let cross = right(&fold.cross);
            for (j, sum) in sums.iter_mut().enumerate() {
                let x = theta.column(j);
                let error = fold.plain[j] - 2.0 * x.dot(&cross.column(j)) + x.dot(&(&gram * x));
                *sum += error;
                if j == 0 {
                    errors.push(error);
                }
            }
        }
        let fitted = solve(s, &c)?;
        let mut theta = DVector::zeros(of.len());
        for (j, i) in of.iter().enumerate() {
            if let Some(at) = seen.iter().position(|x| x == i) {
                theta[j] = fitted[(at, 0)] * scale[at];
            }
        }
        let ratios: Vec<f64> = sums.iter().zip(&self.plain).map(|(a, b)| a / b).collect();
        ratios[0].is_finite().then(|| Score { ratio: ratios[0], null: ratios[1..].to_vec(), errors, theta })
    }
}
