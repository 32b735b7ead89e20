//! Joint refit of inertial parameters and a candidate, with one cluster left out at a time.
//!
//! With parameters scaled by the prior (x = x₀ + L z) every cluster g of rows is `A_g z + C_g θ ≈
//! b_g`. One Cholesky factor of `Σ AᵀA + w` for all rows and one for each fold project the
//! parameters out of any column (Frisch and Waugh), so that a candidate costs a few small products.
//! Weights of rows are fixed; only the weight of the prior is estimated from residuals.

use crate::DiscoverError;
use crate::options::DiscoverOptions;
use crate::session::Session;
use aloft_regressor::StretchKind;
use nalgebra::{Cholesky, DMatrix, DVector, Dyn};
use rayon::prelude::*;

/// Number of rows that count as one independent observation: windows overlap by three quarters.
pub(crate) const OVERLAP: f64 = 3.0;

/// Rows used for judging.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Domain {
    /// Rows of flights, for fitting and judging.
    Flight,
    /// All rows for fitting, those of contact for judging.
    Contact,
    /// All rows for fitting and judging: laws that act in flight and in contact.
    Both,
}

#[derive(Clone)]
pub(crate) struct Cluster {
    pub a: DMatrix<f64>,
    pub b: DVector<f64>,
    /// Rows on which effects are judged.
    pub judged: Vec<usize>,
    gram: DMatrix<f64>,
    right: DVector<f64>,
    /// Number of rows in the cluster.
    pub n_rows: usize,
    /// Blocks of the session, in order.
    pub blocks: Vec<usize>,
    pub trial: usize,
}

pub(crate) struct Fold {
    pub cholesky: Cholesky<f64, Dyn>,
    /// Residual of the judged rows of the left-out cluster.
    pub test: DVector<f64>,
    pub error: f64,
}

/// What errors of the motion change in the rows of a cluster.
pub(crate) struct RowErrors {
    /// Rows of the scaled parameters.
    pub rows: DMatrix<f64>,
    /// Measured side, less what the mass and the prior's mean account for.
    pub measured: DVector<f64>,
    /// Columns of a candidate.
    pub columns: DMatrix<f64>,
}

/// Rows of a domain with the base model, prepared for candidates.
pub(crate) struct Problem {
    pub domain: Domain,
    pub clusters: Vec<Cluster>,
    pub cholesky: Cholesky<f64, Dyn>,
    /// Squares added to the diagonal of the Gram matrix: the prior's rows.
    pub ridge: DVector<f64>,
    solution: DVector<f64>,
    pub right: DVector<f64>,
    pub folds: Vec<Fold>,
    /// Sum of squares at the fit to all rows, the prior's rows included.
    pub rss: f64,
    /// Number of judged rows.
    pub n_judged: usize,
    /// Base parameters of the fit, the mass first.
    pub parameters: DVector<f64>,
    /// Variance of a row, which sets the weight of the prior.
    pub variance: f64,
    /// Factors of the columns that joined the model, which give them unit length.
    pub norms: Vec<f64>,
}

/// Columns of a candidate with the parameters projected out.
pub(crate) struct Reduced {
    pub s: DMatrix<f64>,
    pub c: DVector<f64>,
    pub folds: Vec<ReducedFold>,
}

pub(crate) struct ReducedFold {
    pub s: DMatrix<f64>,
    pub c: DVector<f64>,
    pub test: DMatrix<f64>,
}

impl Problem {
    /// Rows of a domain with `extra` columns (effects accepted before) added to the model. Clusters
    /// are trials where there are at least `fewest` of them, single stretches otherwise.
    pub fn new(
        session: &Session<'_>,
        domain: Domain,
        extra: &[Vec<DMatrix<f64>>],
        fewest: usize,
        prior_weight: f64,
    ) -> Result<Self, DiscoverError> {
        Self::with_variance(session, domain, extra, fewest, prior_weight, None)
    }

    /// The same; none where there is too little to judge, and where it cannot be computed, which
    /// the answer then names.
    pub fn if_possible(
        session: &Session<'_>,
        domain: Domain,
        extra: &[Vec<DMatrix<f64>>],
        options: &DiscoverOptions,
    ) -> Option<Self> {
        session.or_named(Self::new(session, domain, extra, options.fewest_trials, options.prior_weight))
    }

    /// The same with a given variance of a row (which weights the prior) instead of an estimated
    /// one.
    pub fn with_variance(
        session: &Session<'_>,
        domain: Domain,
        extra: &[Vec<DMatrix<f64>>],
        fewest: usize,
        prior_weight: f64,
        given: Option<f64>,
    ) -> Result<Self, DiscoverError> {
        let used: Vec<usize> = (0..session.blocks.len())
            .filter(|&i| domain != Domain::Flight || session.blocks[i].kind != StretchKind::Contact)
            .collect();
        let judged = |i: usize| domain != Domain::Contact || session.blocks[i].kind == StretchKind::Contact;
        let mut trials: Vec<usize> = used.iter().map(|&i| session.blocks[i].trial).collect();
        trials.sort_unstable();
        trials.dedup();
        let judged_trials =
            trials.iter().filter(|t| used.iter().any(|&i| session.blocks[i].trial == **t && judged(i))).count();
        let members: Vec<Vec<usize>> = if judged_trials >= fewest {
            trials.iter().map(|t| used.iter().copied().filter(|&i| session.blocks[i].trial == *t).collect()).collect()
        } else {
            used.iter().map(|&i| vec![i]).collect()
        };
        let p = session.blocks[0].y.ncols();
        let (mean, root) = given_mass(session, p)?;
        let k_extra: usize = extra.iter().map(|e| e[0].ncols()).sum();
        let norms: Vec<f64> = extra
            .iter()
            .flat_map(|e| {
                (0..e[0].ncols()).map(|c| {
                    let norm = e.iter().map(|m| m.column(c).norm_squared()).sum::<f64>().sqrt();
                    if norm > 0.0 { norm.recip() } else { 1.0 }
                })
            })
            .collect();
        let m = p - 1 + k_extra;
        let mut clusters: Vec<Cluster> = members
            .into_par_iter()
            .map(|blocks| {
                let n: usize = blocks.iter().map(|&i| session.blocks[i].y.nrows()).sum();
                let mut a = DMatrix::zeros(n, m);
                let mut b = DVector::zeros(n);
                let mut rows_judged = Vec::new();
                let mut at = 0;
                for &i in &blocks {
                    let block = &session.blocks[i];
                    let h = block.y.nrows();
                    let y = block.y.columns(1, p - 1);
                    a.view_mut((at, 0), (h, p - 1)).copy_from(&(y * &root));
                    let mut column = p - 1;
                    for e in extra {
                        for c in 0..e[i].ncols() {
                            a.view_mut((at, column), (h, 1)).copy_from(&(e[i].column(c) * norms[column + 1 - p]));
                            column += 1;
                        }
                    }
                    let right = &block.w - block.y.column(0) * session.mass_kg - y * &mean;
                    b.rows_mut(at, h).copy_from(&right);
                    if judged(i) {
                        rows_judged.extend(at..at + h);
                    }
                    at += h;
                }
                Cluster {
                    gram: a.tr_mul(&a),
                    right: a.tr_mul(&b),
                    a,
                    b,
                    judged: rows_judged,
                    n_rows: blocks.iter().map(|&i| session.blocks[i].n_rows).sum(),
                    trial: session.blocks[blocks[0]].trial,
                    blocks,
                }
            })
            .collect();
        clusters.sort_by_key(|c| c.blocks[0]);
        let n_judged = used.iter().filter(|&&i| judged(i)).map(|&i| session.blocks[i].n_rows).sum();
        let n_test = clusters.iter().filter(|c| !c.judged.is_empty()).count();
        if n_test < 2 {
            return Err(DiscoverError::TooFew {
                what: "flights, or trials with plates (each is judged by the others)",
                needed: 2,
                found: n_test,
            });
        }
        let gram = clusters.iter().fold(DMatrix::zeros(m, m), |s, c| s + &c.gram);
        let right = clusters.iter().fold(DVector::zeros(m), |s, c| s + &c.right);
        let n_rows: usize = clusters.iter().map(|c| c.n_rows).sum();
        // the weight of the prior in squared row units: the variance of a row that agrees with the
        // fit
        let mut variance =
            given.unwrap_or_else(|| clusters.iter().map(|c| c.b.norm_squared()).sum::<f64>() / n_rows as f64);
        let has_prior = session.prior.is_some();
        let ridge = |variance: f64| -> DVector<f64> {
            let floor = 1e-10 * gram.trace() / m as f64;
            DVector::from_fn(
                m,
                |i, _| if has_prior && i < p - 1 { (prior_weight * variance).max(floor) } else { floor },
            )
        };
        let mut cholesky = factor(&gram, &ridge(variance))?;
        let mut solution = cholesky.solve(&right);
        for _ in 0..if has_prior && given.is_none() { 4 } else { 0 } {
            let rss: f64 = clusters.iter().map(|c| (&c.b - &c.a * &solution).norm_squared()).sum();
            let effective = (cholesky.solve(&gram)).trace();
            variance = rss / (n_rows as f64 - effective).max(1.0);
            cholesky = factor(&gram, &ridge(variance))?;
            solution = cholesky.solve(&right);
        }
        let ridge = ridge(variance);
        let mut parameters = DVector::zeros(p);
        parameters[0] = session.mass_kg;
        parameters.rows_mut(1, p - 1).copy_from(&(&mean + &root * solution.rows(0, p - 1)));
        let squares: f64 = clusters.iter().map(|c| c.b.norm_squared()).sum();
        let rss = squares - right.dot(&solution);
        let folds = folds_of(&clusters, &gram, &right, &ridge)?;
        Ok(Self {
            domain,
            clusters,
            cholesky,
            ridge,
            solution,
            right,
            folds,
            rss,
            n_judged,
            parameters,
            variance,
            norms,
        })
    }

    /// The rows of some clusters only, with the same prior. The parameters stay those of all rows.
    pub fn with_clusters(&self, kept: &[usize]) -> Result<Self, DiscoverError> {
        self.of(kept.iter().map(|&g| self.clusters[g].clone()).collect(), self.ridge.clone())
    }

    /// The same rows with other squares on the diagonal of the Gram matrix.
    pub fn with_ridge(&self, ridge: DVector<f64>) -> Result<Self, DiscoverError> {
        self.of(self.clusters.clone(), ridge)
    }

    fn of(&self, clusters: Vec<Cluster>, ridge: DVector<f64>) -> Result<Self, DiscoverError> {
        let m = self.right.len();
        let gram = clusters.iter().fold(DMatrix::zeros(m, m), |s, c| s + &c.gram);
        let right = clusters.iter().fold(DVector::zeros(m), |s, c| s + &c.right);
        let cholesky = factor(&gram, &ridge)?;
        let solution = cholesky.solve(&right);
        let squares: f64 = clusters.iter().map(|c| c.b.norm_squared()).sum();
        let folds = folds_of(&clusters, &gram, &right, &ridge)?;
        Ok(Self {
            domain: self.domain,
            n_judged: clusters.iter().map(|c| c.judged.len()).sum(),
            rss: squares - right.dot(&solution),
            cholesky,
            ridge,
            solution,
            right,
            folds,
            clusters,
            parameters: self.parameters.clone(),
            variance: self.variance,
            norms: self.norms.clone(),
        })
    }

    /// Held-out mean square of the model without a candidate.
    pub fn plain(&self) -> f64 {
        self.folds.iter().map(|f| f.error).sum::<f64>() / self.n_judged as f64
    }

    /// Rows of an orthonormal basis of the model's columns, those of the prior included, by
    /// cluster: `A_g L⁻ᵀ` with `L Lᵀ` the Gram matrix.
    pub fn bases(&self) -> Option<Vec<DMatrix<f64>>> {
        let l = self.cholesky.l();
        self.clusters.iter().map(|c| l.solve_lower_triangular(&c.a.transpose()).map(|x| x.transpose())).collect()
    }

    /// Residual of a cluster at the fit to all rows.
    pub fn residual(&self, g: usize) -> DVector<f64> {
        let c = &self.clusters[g];
        &c.b - &c.a * &self.solution
    }

    /// Columns of a candidate gathered by cluster, from its blocks.
    pub fn gather(&self, blocks: &[DMatrix<f64>]) -> Vec<DMatrix<f64>> {
        self.clusters
            .iter()
            .map(|c| {
                let k = blocks[0].ncols();
                let mut out = DMatrix::zeros(c.b.len(), k);
                let mut at = 0;
                for &i in &c.blocks {
                    out.view_mut((at, 0), (blocks[i].nrows(), k)).copy_from(&blocks[i]);
                    at += blocks[i].nrows();
                }
                out
            })
            .collect()
    }

    /// What errors of the motion put into [`reduce_all`](Self::reduce_all): by draw and cluster
    /// `errors` holds what they change in the rows of the scaled parameters, in the measured side
    /// and in the columns. With the parameters projected out, errors of a column and of what is
    /// left of the measured side are linked, and their products do not average out. Gram matrix,
    /// right-hand side, and the square of what is left.
    pub fn of_errors(&self, columns: &[DMatrix<f64>], errors: &[Vec<RowErrors>]) -> (DMatrix<f64>, DVector<f64>, f64) {
        let (ac, cc, cb) = self.products(columns, None);
        let x = self.cholesky.solve(&ac);
        let (mut s, mut c) = (DMatrix::zeros(cc.nrows(), cc.ncols()), DVector::zeros(cb.len()));
        let n = errors.len().max(1) as f64;
        let mut square = 0.0;
        for of in errors.iter().flatten() {
            let p = of.rows.ncols();
            let left = &of.measured - &of.rows * self.solution.rows(0, p);
            let column = &of.columns - &of.rows * x.rows(0, p);
            s.gemm_tr(n.recip(), &column, &column, 1.0);
            c.gemv_tr(n.recip(), &column, &left, 1.0);
            square += left.norm_squared() / n;
        }
        (s, c, square)
    }

    /// Gram matrix and right-hand side of columns over all rows, with the parameters projected out.
    pub fn reduce_all(&self, columns: &[DMatrix<f64>]) -> (DMatrix<f64>, DVector<f64>) {
        let (ac, cc, cb) = self.products(columns, None);
        let x = self.cholesky.solve(&ac);
        unspanned(&cc, symmetric(&cc - ac.tr_mul(&x)), cb - x.tr_mul(&self.right))
    }

    /// Covariance of the unknowns of `[C | ∂(Cθ)/∂p]` (the first `theta.len()` columns are `C`) at
    /// the optimum, with the parameters projected out: the inverse of their Gram matrix times the
    /// variance of the residuals along them, by cluster (so that errors that repeat within a flight
    /// count), and at least that of single rows. Directions that the rows do not determine get a
    /// very large variance.
    pub fn covariance(&self, columns: &[DMatrix<f64>], theta: &DVector<f64>) -> DMatrix<f64> {
        let (k, k_all) = (theta.len(), columns[0].ncols());
        let (ac, cc, _) = self.products(columns, None);
        let x = self.cholesky.solve(&ac);
        let s = symmetric(cc - ac.tr_mul(&x));
        let solution = &self.solution - x.columns(0, k) * theta;
        let mut squares = 0.0;
        let slopes: Vec<DVector<f64>> = self
            .clusters
            .iter()
            .zip(columns)
            .map(|(cluster, c)| {
                let r = &cluster.b - &cluster.a * &solution - c.columns(0, k) * theta;
                squares += r.norm_squared();
                c.tr_mul(&r) - x.tr_mul(&cluster.a.tr_mul(&r))
            })
            .collect();
        let scale = DVector::from_fn(k_all, |i, _| if s[(i, i)] > 0.0 { s[(i, i)].sqrt().recip() } else { 0.0 });
        let unit = DMatrix::from_fn(k_all, k_all, |i, j| s[(i, j)] * scale[i] * scale[j]);
        let eigen = unit.symmetric_eigen();
        let roots = eigen.eigenvalues.map(|l| l.max(1e-12).sqrt().recip());
        // coordinates in which the Gram matrix is the identity
        let root = DMatrix::from_diagonal(&scale) * &eigen.eigenvectors * DMatrix::from_diagonal(&roots);
        let n = self.clusters.len() as f64;
        let seen = eigen.eigenvalues.iter().filter(|l| **l > 1e-9).count().max(1) as f64;
        let by_cluster = slopes
            .iter()
            .map(|u| {
                let v = root.tr_mul(u);
                v.iter().zip(&eigen.eigenvalues).filter(|(_, l)| **l > 1e-9).map(|(v, _)| v * v).sum::<f64>()
            })
            .sum::<f64>()
            / seen
            * n
            / (n - 1.0).max(1.0);
        let rows: f64 = self.clusters.iter().map(|c| c.n_rows as f64).sum();
        let by_row = squares / (rows - (self.right.len() + k_all) as f64).max(0.5 * rows);
        (&root * root.transpose()) * by_cluster.max(by_row)
    }

    /// `AᵀC`, `CᵀC`, `Cᵀb` over all clusters but one.
    pub(crate) fn products(
        &self,
        columns: &[DMatrix<f64>],
        without: Option<usize>,
    ) -> (DMatrix<f64>, DMatrix<f64>, DVector<f64>) {
        let (k, m) = (columns[0].ncols(), self.right.len());
        let (mut ca, mut cc, mut cb) = (DMatrix::zeros(k, m), DMatrix::zeros(k, k), DVector::zeros(k));
        for (g, (cluster, c)) in self.clusters.iter().zip(columns).enumerate() {
            if Some(g) != without {
                // `CᵀA` and not `AᵀC`: the larger matrix is read once, and not once for each column
                ca.gemm_tr(1.0, c, &cluster.a, 1.0);
                cc.gemm_tr(1.0, c, c, 1.0);
                cb.gemv_tr(1.0, c, &cluster.b, 1.0);
            }
        }
        (ca.transpose(), cc, cb)
    }

    /// The reduced columns of a candidate for one fold.
    pub fn reduce_fold(&self, g: usize, columns: &[DMatrix<f64>]) -> ReducedFold {
        self.fold_of(g, &columns[g], self.products(columns, Some(g)))
    }

    fn fold_of(
        &self,
        g: usize,
        c_g: &DMatrix<f64>,
        products: (DMatrix<f64>, DMatrix<f64>, DVector<f64>),
    ) -> ReducedFold {
        let (cluster, (ac, cc, cb)) = (&self.clusters[g], products);
        let x = self.folds[g].cholesky.solve(&ac);
        let all = c_g - &cluster.a * &x;
        let (s, c) = unspanned(&cc, symmetric(&cc - ac.tr_mul(&x)), cb - x.tr_mul(&(&self.right - &cluster.right)));
        ReducedFold {
            s,
            c,
            test: DMatrix::from_fn(cluster.judged.len(), c_g.ncols(), |i, j| all[(cluster.judged[i], j)]),
        }
    }

    /// The reduced columns of a candidate for all folds.
    pub fn reduce(&self, columns: &[DMatrix<f64>]) -> Reduced {
        let parts: Vec<(DMatrix<f64>, DMatrix<f64>, DVector<f64>)> = self
            .clusters
            .iter()
            .zip(columns)
            .map(|(cluster, c)| (cluster.a.tr_mul(c), c.tr_mul(c), c.tr_mul(&cluster.b)))
            .collect();
        let (ac, cc, cb) = self.products(columns, None);
        let x = self.cholesky.solve(&ac);
        let folds = (0..self.folds.len())
            .map(|g| self.fold_of(g, &columns[g], (&ac - &parts[g].0, &cc - &parts[g].1, &cb - &parts[g].2)))
            .collect();
        let (s, c) = unspanned(&cc, symmetric(&cc - ac.tr_mul(&x)), &cb - x.tr_mul(&self.right));
        Reduced { s, c, folds }
    }
}

/// Factor of a Gram matrix with the prior's rows.
fn factor(gram: &DMatrix<f64>, ridge: &DVector<f64>) -> Result<Cholesky<f64, Dyn>, DiscoverError> {
    Cholesky::new(gram + DMatrix::from_diagonal(ridge))
        .ok_or_else(|| DiscoverError::Numeric("the rows do not determine the parameters".to_owned()))
}

/// One fold for each cluster: the fit to the others, and its error on the one left out. `gram` and
/// `right` are sums over all clusters.
fn folds_of(
    clusters: &[Cluster],
    gram: &DMatrix<f64>,
    right: &DVector<f64>,
    ridge: &DVector<f64>,
) -> Result<Vec<Fold>, DiscoverError> {
    clusters
        .par_iter()
        .map(|c| {
            let cholesky = factor(&(gram - &c.gram), ridge)?;
            let rest = right - &c.right;
            let x = cholesky.solve(&rest);
            let all = &c.b - &c.a * x;
            let test = DVector::from_fn(c.judged.len(), |i, _| all[c.judged[i]]);
            Ok(Fold { cholesky, error: test.norm_squared(), test })
        })
        .collect()
}

/// Share of a column's square outside the span of the model's columns below which only rounding
/// error (and the ridge) remains.
const SPANNED: f64 = 1e-9;

/// Gram matrix and right-hand side of columns with the parameters projected out, set to zero for
/// columns in the span of the model's columns, whose rounding error would otherwise count as
/// evidence. `whole` is the Gram matrix before the projection.
fn unspanned(whole: &DMatrix<f64>, mut s: DMatrix<f64>, mut c: DVector<f64>) -> (DMatrix<f64>, DVector<f64>) {
    for i in 0..c.len() {
        if s[(i, i)] <= SPANNED * whole[(i, i)] {
            s.row_mut(i).fill(0.0);
            s.column_mut(i).fill(0.0);
            c[i] = 0.0;
        }
    }
    (s, c)
}

fn symmetric(m: DMatrix<f64>) -> DMatrix<f64> {
    (&m + m.transpose()) * 0.5
}

/// Mean of the base parameters other than the mass and a root of their covariance, conditional on
/// the mass; without a prior, column norms.
pub(crate) fn given_mass(session: &Session<'_>, p: usize) -> Result<(DVector<f64>, DMatrix<f64>), DiscoverError> {
    let Some(prior) = &session.prior else {
        let norms = DVector::from_fn(p - 1, |j, _| {
            let norm = session.blocks.iter().map(|b| b.y.column(j + 1).norm_squared()).sum::<f64>().sqrt();
            if norm > 0.0 { norm.recip() } else { 1.0 }
        });
        return Ok((DVector::zeros(p - 1), DMatrix::from_diagonal(&norms)));
    };
    if prior.mean.len() != p || prior.covariance.shape() != (p, p) {
        return Err(DiscoverError::Length {
            what: "base parameters of the prior",
            expected: p,
            found: prior.mean.len(),
        });
    }
    let variance = prior.covariance[(0, 0)];
    let cross = prior.covariance.view((1, 0), (p - 1, 1)).into_owned();
    let mut mean = prior.mean.rows(1, p - 1).into_owned();
    let mut rest = prior.covariance.view((1, 1), (p - 1, p - 1)).into_owned();
    if variance > 0.0 {
        mean += cross.column(0) * ((session.mass_kg - prior.mean[0]) / variance);
        rest -= &cross * cross.transpose() / variance;
    }
    let sd = DVector::from_fn(p - 1, |i, _| rest[(i, i)].max(0.0).sqrt());
    if sd.iter().any(|s| !(s.is_finite() && *s > 0.0)) {
        return Err(DiscoverError::Numeric("the prior has a variance that is zero or not finite".to_owned()));
    }
    let correlation = DMatrix::from_fn(p - 1, p - 1, |i, j| 0.5 * (rest[(i, j)] + rest[(j, i)]) / (sd[i] * sd[j]));
    let eigen = correlation.symmetric_eigen();
    let roots = eigen.eigenvalues.map(|l| l.max(1e-10).sqrt());
    Ok((mean, DMatrix::from_diagonal(&sd) * &eigen.eigenvectors * DMatrix::from_diagonal(&roots)))
}
