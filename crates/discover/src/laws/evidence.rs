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
//!
//! A cluster of many rows (a recording of contact has some thousand) never needs its `T_g`. With
//! `G = Q_gᵀ Q_g` and `K = (I − G)⁻¹`, Woodbury's identity gives `T_g = I + Q_g K Q_gᵀ` and
//! `T_g² = I + Q_g (K + K²) Q_gᵀ`, so that all products are made of `Q_gᵀ C`, whose size is that of
//! the model.

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
    /// As it is, rows × rows.
    Rows(DMatrix<f64>),
    /// By Woodbury's identity, from `G` and `K`, model × model.
    Model { g: DMatrix<f64>, k: DMatrix<f64> },
}

impl Basis {
    /// The columns `q` (rows × model) of a cluster; `None` if they leave nothing of a row.
    fn new(q: &DMatrix<f64>) -> Option<Self> {
        let q_t = q.transpose();
        let inverse = |product: DMatrix<f64>| {
            let n = product.nrows();
            Cholesky::new(DMatrix::identity(n, n) - product).map(|c| c.inverse())
        };
        let leverage = if q.nrows() <= q.ncols() {
            Leverage::Rows(inverse(q * &q_t)?)
        } else {
            let g = &q_t * q;
            let k = inverse(g.clone())?;
            Leverage::Model { g, k }
        };
        Some(Self { q_t, leverage })
    }

    /// `T x`.
    fn apply(&self, x: &DMatrix<f64>) -> DMatrix<f64> {
        match &self.leverage {
            Leverage::Rows(t) => t * x,
            Leverage::Model { k, .. } => x + self.q_t.transpose() * (k * (&self.q_t * x)),
        }
    }
}

/// A cluster of rows.
struct Part {
    basis: Arc<Basis>,
    /// Residuals, one column for each right-hand side; the first is the measured one.
    r: DMatrix<f64>,
    /// `T r` and `T T r`.
    tr: DMatrix<f64>,
    ttr: DMatrix<f64>,
    /// `Qᵀ T r` and `Qᵀ T T r`; empty where `T` is applied as it is.
    q_tr: DMatrix<f64>,
    q_ttr: DMatrix<f64>,
    /// `|T r|²`.
    plain: Vec<f64>,
}

impl Part {
    /// Residuals `r` of a cluster.
    fn new(basis: Arc<Basis>, r: DMatrix<f64>) -> Self {
        let tr = basis.apply(&r);
        let ttr = basis.apply(&tr);
        let plain = tr.column_iter().map(|c| c.norm_squared()).collect();
        let projected = |x: &DMatrix<f64>| match basis.leverage {
            Leverage::Rows(_) => DMatrix::zeros(0, x.ncols()),
            Leverage::Model { .. } => &basis.q_t * x,
        };
        let (q_tr, q_ttr) = (projected(&tr), projected(&ttr));
        Self { basis, r, tr, ttr, q_tr, q_ttr, plain }
    }

    /// The products of a fold with columns `x` (rows × candidates), of which `q_x = Qᵀ x` in this
    /// cluster and `q_c` in all of them.
    fn fold(&self, x: &DMatrix<f64>, q_x: &DMatrix<f64>, q_c: &DMatrix<f64>) -> FoldOf {
        let plain = self.plain.clone();
        match &self.basis.leverage {
            Leverage::Rows(t) => {
                let mut e = x.clone();
                e.gemm_tr(-1.0, &self.basis.q_t, q_c, 1.0);
                let (te, e_t) = (t * &e, e.transpose());
                let gram = te.transpose() * &te;
                FoldOf { taken: &e_t * te, right: &e_t * &self.tr, gram, cross: e_t * &self.ttr, plain }
            }
            Leverage::Model { g, k } => {
                let (x_t, q_c_t) = (x.transpose(), q_c.transpose());
                let g_c = g * q_c;
                let between = &q_c_t * q_x;
                // eᵀe and Qᵀe of e = x − Q q_c
                let own = &x_t * x - &between - between.transpose() + &q_c_t * &g_c;
                let z = q_x - g_c;
                let (kz, z_t) = (k * &z, z.transpose());
                let taken = own + z_t * &kz;
                let gram = &taken + kz.transpose() * &kz;
                let e_times = |y: &DMatrix<f64>, q_y: &DMatrix<f64>| &x_t * y - &q_c_t * q_y;
                FoldOf {
                    right: e_times(&self.tr, &self.q_tr),
                    cross: e_times(&self.ttr, &self.q_ttr),
                    taken,
                    gram,
                    plain,
                }
            }
        }
    }
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
            common += q.transpose() * r;
        }
        // the measured residual is that of the fit already (with the prior, QᵀR is not zero)
        common.column_mut(0).fill(0.0);
        let mut parts = Vec::with_capacity(n);
        let mut plain = vec![0.0; 1 + draws];
        for (q, r) in bases.into_iter().zip(flipped) {
            let part = Part::new(Arc::new(Basis::new(&q)?), r - &q * &common);
            for (sum, of) in plain.iter_mut().zip(&part.plain) {
                *sum += of;
            }
            parts.push(part);
        }
        Some(Self { parts, plain })
    }

    /// The same without random signs: enough to compare candidates with each other.
    pub fn without_draws(&self) -> Self {
        let of = |p: &Part| Part::new(Arc::clone(&p.basis), p.r.columns(0, 1).into_owned());
        Self { parts: self.parts.iter().map(of).collect(), plain: self.plain[..1].to_vec() }
    }

    /// Projects the model out of columns given by cluster. Each `smooth` consecutive columns are
    /// the values of a curve: a light penalty on its second differences extends it where a fold has
    /// no rows (`smooth` 0 or 1: none).
    pub fn prepare(&self, columns: &[DMatrix<f64>], smooth: usize) -> Prepared {
        let k = columns[0].ncols();
        let n_right = self.plain.len();
        let by_part: Vec<DMatrix<f64>> = self.parts.iter().zip(columns).map(|(p, x)| &p.basis.q_t * x).collect();
        let mut qc = DMatrix::zeros(by_part[0].nrows(), k);
        let mut s = DMatrix::zeros(k, k);
        let mut c = DMatrix::zeros(k, n_right);
        for ((part, x), q_x) in self.parts.iter().zip(columns).zip(&by_part) {
            qc += q_x;
            let x_t = x.transpose();
            s.gemm(1.0, &x_t, x, 1.0);
            c.gemm(1.0, &x_t, &part.r, 1.0);
        }
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
        let parts = self.parts.iter().zip(columns).zip(&by_part);
        let folds = parts.map(|((part, x), q_x)| part.fold(x, q_x, &qc)).collect();
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
