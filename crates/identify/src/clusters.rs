//! Evidence by cluster (flight or trial): resampling and held-out error without the original rows.
//!
//! With U the triangle of all rows and prior rows together, every cluster's rows become `Q_g = A_g
//! U⁻¹` with `Σ Q_gᵀQ_g + prior = 1`: a well-conditioned Gram `G_g = Q_gᵀQ_g` per cluster. At the
//! estimate x̂ with residuals r_g = A_g x̂ − b_g, leaving a cluster out gives `x̂ + U⁻¹ (1 − G_g)⁻¹
//! Q_gᵀ r_g`, and giving it the weight w_g (bootstrap) `x̂ − U⁻¹ (1 + Σ (w_g−1) G_g)⁻¹ Σ (w_g−1)
//! Q_gᵀ r_g`.

use crate::system::System;
use crate::{IdentifyError, Prior};
use aloft_regressor::Factor;
use faer::linalg::solvers::Solve;
use faer::{Mat, Side};
use nalgebra::{DMatrix, DVector};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// Unit of independent evidence.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum ClusterBy {
    /// Every flight or contact phase.
    #[default]
    Stretch,
    /// All rows of one trial.
    Trial,
}

impl ClusterBy {
    /// Number of the cluster of each factor, in the order of first appearance, and the clusters'
    /// names.
    pub fn groups(self, factors: &[Factor]) -> (Vec<usize>, Vec<String>) {
        let mut names: Vec<String> = Vec::new();
        let mut known: BTreeMap<String, usize> = BTreeMap::new();
        let groups = factors
            .iter()
            .map(|f| {
                let name = match self {
                    Self::Trial => f.trial.clone(),
                    Self::Stretch => format!("{}#{}{:?}", f.trial, f.stretch, f.kind),
                };
                *known.entry(name.clone()).or_insert_with(|| {
                    names.push(name);
                    names.len() - 1
                })
            })
            .collect();
        (groups, names)
    }
}

/// Factors merged within clusters and preconditioned by all of them together with the prior.
#[derive(Debug, Clone)]
pub(crate) struct Clusters {
    /// Estimate without the mass: parameters 1.. and effects.
    estimate: DVector<f64>,
    inverse: DMatrix<f64>,
    /// U.
    triangle: DMatrix<f64>,
    clusters: Vec<ClusterRows>,
    mass_kg: f64,
}

/// Variances of linear functions estimated from the clusters.
#[derive(Debug, Clone)]
pub(crate) struct Spread {
    /// Variance of each function.
    pub variance: Vec<f64>,
    /// Degrees of freedom of each variance.
    pub freedom: Vec<f64>,
    /// Sum of outer products of the adjusted scores, m × m: the middle factor ("meat") of the
    /// sandwich covariance.
    pub meat: DMatrix<f64>,
    /// `Σ_g cᵀ G_g c` of each function: its variance for rows of unit variance.
    pub own: Vec<f64>,
    /// `Σ_g b_gᵀ (1 − G) b_g` of each function.
    pub by_prior: Vec<f64>,
    /// What the known errors of the rows contribute to each variance on average.
    pub by_known: Vec<f64>,
}

/// With more clusters than this the pair products are left out of the degrees of freedom, which are
/// large then.
const MOST_PAIRED: usize = 400;

/// One cluster, preconditioned.
#[derive(Debug, Clone)]
struct ClusterRows {
    /// Q_g.
    q: DMatrix<f64>,
    /// r_g.
    residual: DVector<f64>,
    /// Q_gᵀQ_g.
    gram: DMatrix<f64>,
    /// Q_gᵀ r_g.
    score: DVector<f64>,
    n_rows: usize,
}

/// What corrects the rows of clusters for their own noise ([`crate::noise_metric`]).
#[derive(Debug, Clone, Copy)]
pub(crate) struct Correction<'a> {
    /// q: the Gram of a cluster is `G_g − q S_g`.
    pub excess: f64,
    /// Projection of columns that takes undetermined directions out, n × n.
    pub determined: &'a DMatrix<f64>,
}

impl Correction<'_> {
    /// The columns of a cluster's noise.
    fn noise(&self, group: &Factor) -> Option<DMatrix<f64>> {
        group.noise().map(|noise| noise.dense() * self.excess.sqrt())
    }
}

impl Clusters {
    /// `merged` is the triangle of all groups; `weight` is the weight w of the prior in squared row
    /// units.
    pub fn new(
        groups: &[Factor],
        merged: &Factor,
        mass_kg: f64,
        prior: Option<&Prior>,
        weight: f64,
        solution: &DVector<f64>,
    ) -> Result<Self, IdentifyError> {
        Self::corrected(groups, merged, mass_kg, prior, weight, solution, None)
    }

    /// The same for rows that are corrected for their noise: `merged` is the triangle of the
    /// corrected rows, scores and Grams of the clusters are those of `G_g − q S_g`.
    pub fn corrected(
        groups: &[Factor],
        merged: &Factor,
        mass_kg: f64,
        prior: Option<&Prior>,
        weight: f64,
        solution: &DVector<f64>,
        correction: Option<Correction<'_>>,
    ) -> Result<Self, IdentifyError> {
        let first = groups.first().ok_or(IdentifyError::TooFew { what: "clusters", needed: 1, found: 0 })?;
        let (p, k) = (first.n_parameters(), first.n_effects());
        let m = p - 1 + k;
        let estimate = solution.rows(1, m).into_owned();
        let split = |dense: DMatrix<f64>| {
            let a = dense.columns(1, m);
            let residual = a * &estimate + dense.column(0) * mass_kg - dense.column(m + 1);
            // undetermined directions are held by the prior: no row moves the estimate along them
            (correction.map_or_else(|| a.into_owned(), |c| &dense * c.determined.columns(1, m)), residual)
        };
        let reduced: Vec<_> = groups
            .iter()
            .map(|g| (split(g.dense()), correction.and_then(|c| c.noise(g)).map(split), g.n_rows))
            .collect();
        let prior_rows = match prior {
            Some(prior) if weight > 0.0 => {
                let (_, root) = prior.given_mass(p, mass_kg)?;
                let inverse = root
                    .try_inverse()
                    .ok_or_else(|| IdentifyError::Numeric("the prior covariance is singular".to_owned()))?;
                inverse * weight.sqrt()
            }
            _ => DMatrix::zeros(0, p - 1),
        };
        let all = merged.dense();
        let at = all.nrows();
        let mut stacked = Mat::<f64>::zeros((at + prior_rows.nrows()).max(m), m);
        for j in 0..m {
            for i in 0..at {
                stacked[(i, j)] = all[(i, j + 1)];
            }
        }
        for i in 0..prior_rows.nrows() {
            for j in 0..p - 1 {
                stacked[(at + i, j)] = prior_rows[(i, j)];
            }
        }
        let qr = stacked.qr();
        let r = qr.thin_R();
        let triangle = DMatrix::from_fn(m, m, |i, j| if i <= j { r[(i, j)] } else { 0.0 });
        // an undetermined direction gets no variance here; the gate reports it
        let scale = DVector::from_fn(m, |j, _| triangle.column(j).norm());
        let mut lifted = triangle.clone();
        for j in 0..m {
            if lifted[(j, j)].abs() <= 1e-13 * scale[j].max(f64::MIN_POSITIVE) {
                lifted[(j, j)] = f64::INFINITY;
            }
        }
        let mut inverse = lifted
            .solve_upper_triangular(&DMatrix::identity(m, m))
            .ok_or_else(|| IdentifyError::Numeric("the merged rows are singular".to_owned()))?;
        inverse.iter_mut().for_each(|x| {
            if !x.is_finite() {
                *x = 0.0;
            }
        });
        let rows: Vec<ClusterRows> = reduced
            .into_par_iter()
            .map(|((a, residual), noise, n_rows)| {
                let q = a * &inverse;
                let (mut gram, mut score) = (q.tr_mul(&q), q.tr_mul(&residual));
                if let Some((a, residual)) = noise {
                    let q = a * &inverse;
                    gram -= q.tr_mul(&q);
                    score -= q.tr_mul(&residual);
                }
                ClusterRows { gram, score, q, residual, n_rows }
            })
            .collect();
        Ok(Self { estimate, inverse, triangle, clusters: rows, mass_kg })
    }

    pub fn len(&self) -> usize {
        self.clusters.len()
    }

    fn whole(&self, reduced: DVector<f64>) -> DVector<f64> {
        let mut x = DVector::zeros(reduced.len() + 1);
        x[0] = self.mass_kg;
        x.rows_mut(1, reduced.len()).copy_from(&reduced);
        x
    }

    /// `(1 − G_g)⁻¹ Q_gᵀ r_g`, by least squares where leaving the cluster out leaves a direction
    /// undetermined.
    fn left_out(&self, g: usize, vector: &DVector<f64>) -> DVector<f64> {
        let m = self.estimate.len();
        let gram = &self.clusters[g].gram;
        let rest = Mat::from_fn(m, m, |i, j| f64::from(u8::from(i == j)) - gram[(i, j)]);
        solve_semidefinite(&rest, vector, 1e-10)
    }

    /// Estimates with each cluster left out, mass first.
    pub fn leave_one_out(&self) -> Vec<DVector<f64>> {
        (0..self.len())
            .into_par_iter()
            .map(|g| self.whole(&self.estimate + &self.inverse * self.left_out(g, &self.clusters[g].score)))
            .collect()
    }

    /// Sum of squares and number of rows of each cluster, predicted from all others.
    pub fn held_out(&self) -> Vec<(f64, usize)> {
        (0..self.len())
            .into_par_iter()
            .map(|g| {
                let ClusterRows { q, residual, n_rows, .. } = &self.clusters[g];
                let error = residual + q * self.left_out(g, &self.clusters[g].score);
                (error.norm_squared(), *n_rows)
            })
            .collect()
    }

    /// Number of unknowns: parameters without the mass, and effects.
    pub fn unknowns(&self) -> usize {
        self.estimate.len()
    }

    /// The unknowns themselves as functions of the rows' errors, m × m; see [`Clusters::spread`].
    pub(crate) fn own_functions(&self) -> DMatrix<f64> {
        self.inverse.transpose()
    }

    /// Functions `wᵀ Σ_g A_gᵀ ε_g` of the rows' errors, one per column of `by_rows` (m × n), in the
    /// form that [`Clusters::spread`] takes.
    pub fn functions(&self, by_rows: &DMatrix<f64>) -> DMatrix<f64> {
        &self.triangle * by_rows
    }

    /// Sums `Σ_g A_gᵀ D_g` (m × K) over additional columns D of the rows, in the coordinates of the
    /// functions.
    pub fn reach(&self, sums: &DMatrix<f64>) -> DMatrix<f64> {
        self.inverse.tr_mul(sums)
    }

    /// Variance of functions of the prior's own error if the prior has weight w: `w cᵀ (1 − Σ G_g)
    /// c`.
    pub fn of_prior(&self, weight: f64, functions: &DMatrix<f64>) -> Vec<f64> {
        let by_prior = functions - self.gram() * functions;
        let of = |(c, b): (nalgebra::DVectorView<'_, f64>, nalgebra::DVectorView<'_, f64>)| weight * c.dot(&b).max(0.0);
        functions.column_iter().zip(by_prior.column_iter()).map(of).collect()
    }

    /// Σ G_g.
    pub fn gram(&self) -> DMatrix<f64> {
        let m = self.estimate.len();
        self.clusters.iter().fold(DMatrix::zeros(m, m), |sum, c| sum + &c.gram)
    }

    /// Covariance `U⁻¹ middle U⁻ᵀ` of the estimates, with zeros for the mass.
    pub fn covariance(&self, middle: &DMatrix<f64>) -> DMatrix<f64> {
        let m = self.estimate.len();
        let mut out = DMatrix::zeros(m + 1, m + 1);
        out.view_mut((1, 1), (m, m)).copy_from(&(&self.inverse * middle * self.inverse.transpose()));
        out
    }

    /// Variances of linear functions `cᵀ Σ_g Q_gᵀ ε_g` of the rows' errors (c a column of
    /// `functions`, m × n), from the spread among clusters: bias-reduced linearisation (CR2), with
    /// the degrees of freedom of Bell and McCaffrey (2002).
    ///
    /// With `a_g = (1 − Q_gQ_gᵀ)^(−1/2) Q_g c` the variance is `Σ_g (a_gᵀ r_g)²`, a quadratic form
    /// of the errors. If these were independent and identically distributed, its eigenvalues would
    /// be those of the matrix with diagonal elements `c G_g c` and off-diagonal elements `−b_gᵀ
    /// b_h`, `b_g = (1 − G_g)^(−1/2) G_g c`: the degrees of freedom are its squared trace over the
    /// sum of its squared elements.
    ///
    /// `known` holds, by cluster, the scores `Q_gᵀ K_g` of errors of the rows with a variance of
    /// their own (m × number of realisations each); empty without such errors.
    pub fn spread(&self, functions: &DMatrix<f64>, known: &[DMatrix<f64>]) -> Spread {
        let (m, n) = functions.shape();
        let by = Mat::from_fn(m, n, |i, j| functions[(i, j)]);
        let all = known.iter().cloned().reduce(|a, b| a + b);
        let parts: Vec<ClusterSpread> = self
            .clusters
            .par_iter()
            .enumerate()
            .map(|(g, c)| {
                let residual = all.as_ref().map(|all| &known[g] - &c.gram * all);
                cluster_spread(c, &by, residual.as_ref())
            })
            .collect();
        let left = DMatrix::identity(m, m) - self.gram();
        let left = Mat::from_fn(m, m, |i, j| left[(i, j)]);
        let (mut by_prior, mut by_known) = (vec![0.0; n], vec![0.0; n]);
        for part in &parts {
            let rest = &left * &part.b;
            for k in 0..n {
                by_prior[k] += (0..m).map(|i| part.b[(i, k)] * rest[(i, k)]).sum::<f64>();
                by_known[k] += part.known[k];
            }
        }
        let own: Vec<f64> = (0..n).map(|k| parts.iter().map(|p| p.own[k]).sum()).collect();
        let mut meat = DMatrix::zeros(m, m);
        for part in &parts {
            meat.ger(1.0, &part.score, &part.score, 1.0);
        }
        let pairs = parts.len() <= MOST_PAIRED;
        let (variance, freedom) = (0..n)
            .into_par_iter()
            .map(|k| {
                let c = functions.column(k);
                let variance: f64 = parts.iter().map(|p| c.dot(&p.score).powi(2)).sum();
                let trace: f64 = own[k];
                let mut squares: f64 = parts.iter().map(|p| p.own[k] * p.own[k]).sum();
                if pairs {
                    let reach = Mat::from_fn(m, parts.len(), |i, g| parts[g].b[(i, k)]);
                    let products = reach.transpose() * &reach;
                    for h in 0..parts.len() {
                        for g in 0..h {
                            squares += 2.0 * products[(g, h)] * products[(g, h)];
                        }
                    }
                }
                (variance, if squares > 0.0 { trace * trace / squares } else { f64::INFINITY })
            })
            .unzip();
        Spread { variance, freedom, meat, own, by_prior, by_known }
    }

    /// Estimates from clusters drawn with replacement, mass first. Draw `i` depends only on `seed`
    /// and `i`.
    pub fn bootstrap(&self, draws: usize, seed: u64) -> Vec<DVector<f64>> {
        let (n, m) = (self.len(), self.estimate.len());
        let every: Vec<usize> = (0..draws).collect();
        every
            .par_chunks(DRAWS_AT_ONCE)
            .flat_map_iter(|some| {
                let weights: Vec<Vec<f64>> = some.iter().map(|&draw| drawn_weights(n, seed, draw)).collect();
                let mut sums: Vec<(Mat<f64>, DVector<f64>)> =
                    some.iter().map(|_| (Mat::identity(m, m), DVector::zeros(m))).collect();
                // each cluster's matrix is read once for all these draws; for symmetric sums the
                // lower half suffices
                for (c, cluster) in self.clusters.iter().enumerate() {
                    for ((matrix, right), weights) in sums.iter_mut().zip(&weights) {
                        let w = weights[c];
                        if w == 0.0 {
                            continue;
                        }
                        for j in 0..m {
                            let from = &cluster.gram.as_slice()[j * m + j..(j + 1) * m];
                            for (x, g) in matrix.col_as_slice_mut(j)[j..].iter_mut().zip(from) {
                                *x += g * w;
                            }
                        }
                        right.axpy(-w, &cluster.score, 1.0);
                    }
                }
                // directions that a draw does not contain keep their estimate
                sums.into_iter().map(|(matrix, right)| {
                    self.whole(&self.estimate + &self.inverse * solve_semidefinite(&matrix, &right, 1e-8))
                })
            })
            .collect()
    }
}

/// What one cluster contributes to the spread of functions c.
struct ClusterSpread {
    /// Adjusted score `(1 − G)^(−1/2) Qᵀ r`.
    score: DVector<f64>,
    /// `cᵀ G c` of each function.
    own: Vec<f64>,
    /// `(1 − G)^(−1/2) G c`.
    b: Mat<f64>,
    /// `‖cᵀ (1 − G)^(−1/2) K‖²` of each function.
    known: Vec<f64>,
}

/// Contribution of a cluster; the columns of `known` are the scores K of its known errors.
fn cluster_spread(cluster: &ClusterRows, functions: &Mat<f64>, known: Option<&DMatrix<f64>>) -> ClusterSpread {
    let (m, n) = (functions.nrows(), functions.ncols());
    let gram = Mat::from_fn(m, m, |i, j| cluster.gram[(i, j)]);
    // none: the spread is not known, which leaves no interval
    let Ok(eigen) = gram.self_adjoint_eigen(Side::Lower) else {
        let unknown = || vec![f64::NAN; n];
        let (score, b) = (DVector::repeat(m, f64::NAN), Mat::full(m, n, f64::NAN));
        return ClusterSpread { score, own: unknown(), b, known: unknown() };
    };
    let (v, values) = (eigen.U(), eigen.S().column_vector());
    // a direction determined by no other cluster and no prior has no residual to estimate its
    // variance from
    let values: Vec<f64> = values.iter().map(|l| if *l < 1.0 - 1e-8 { l.max(0.0) } else { 0.0 }).collect();
    let along = v.transpose() * functions;
    let score = v.transpose() * Mat::from_fn(m, 1, |i, _| cluster.score[i]);
    let by_root = |x: &Mat<f64>, power: i32| {
        Mat::from_fn(m, x.ncols(), |i, j| x[(i, j)] * values[i].powi(power) / (1.0 - values[i]).sqrt())
    };
    let own = (0..n).map(|k| (0..m).map(|i| values[i] * along[(i, k)] * along[(i, k)]).sum()).collect();
    let score = v * by_root(&score, 0);
    let known = known.map_or_else(
        || vec![0.0; n],
        |known| {
            let errors = v.transpose() * Mat::from_fn(m, known.ncols(), |i, j| known[(i, j)]);
            let reach = by_root(&along, 0).transpose() * errors;
            (0..n).map(|k| (0..known.ncols()).map(|j| reach[(k, j)] * reach[(k, j)]).sum()).collect()
        },
    );
    ClusterSpread { score: DVector::from_fn(m, |i, _| score[(i, 0)]), own, b: v * by_root(&along, 1), known }
}

/// Number of bootstrap draws whose sums are formed together.
const DRAWS_AT_ONCE: usize = 8;

/// How often each of `n` clusters is drawn with replacement, minus one.
fn drawn_weights(n: usize, seed: u64, draw: usize) -> Vec<f64> {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    rng.set_stream(draw as u64);
    let mut weights = vec![-1.0; n];
    for _ in 0..n {
        weights[rng.random_range(0..n)] += 1.0;
    }
    weights
}

/// `A⁻¹ b` from the lower half of A; by least squares, ignoring eigenvalues up to `least`, if A is
/// not positive definite.
fn solve_semidefinite(matrix: &Mat<f64>, right: &DVector<f64>, least: f64) -> DVector<f64> {
    match matrix.llt(Side::Lower) {
        Ok(factor) => {
            let x = factor.solve(Mat::from_fn(right.len(), 1, |i, _| right[i]));
            DVector::from_fn(right.len(), |i, _| x[(i, 0)])
        }
        // none: a matrix that is not positive definite is solved by least squares
        Err(_) => through_eigen(matrix, right, |l| if l > least { l.recip() } else { 0.0 }),
    }
}

/// `f(A) b` for a function of the eigenvalues, from the lower half of A; NaN where the
/// decomposition fails.
fn through_eigen(matrix: &Mat<f64>, vector: &DVector<f64>, f: impl Fn(f64) -> f64) -> DVector<f64> {
    let n = vector.len();
    // none: not a number is not known
    let Ok(eigen) = matrix.self_adjoint_eigen(Side::Lower) else { return DVector::repeat(n, f64::NAN) };
    let (u, values) = (eigen.U(), eigen.S().column_vector());
    let mut out = DVector::zeros(n);
    for (k, value) in values.iter().enumerate() {
        let column = u.col(k);
        let along: f64 = column.iter().zip(vector.iter()).map(|(a, b)| a * b).sum();
        let by = along * f(*value);
        out.iter_mut().zip(column.iter()).for_each(|(o, c)| *o += c * by);
    }
    out
}

/// Factors merged within each group, in the order of group numbers.
pub(crate) fn merge_groups(factors: &[Factor], groups: &[usize]) -> Result<Vec<Factor>, IdentifyError> {
    let n = groups.iter().max().map_or(0, |g| g + 1);
    (0..n)
        .map(|g| {
            let members: Vec<&Factor> = factors.iter().zip(groups).filter(|(_, k)| **k == g).map(|(f, _)| f).collect();
            Factor::merge_refs(&members).map_err(IdentifyError::from)
        })
        .collect()
}

/// Held-out error for one weight of the prior.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct WeightTrial {
    /// Weight λ of the prior.
    pub weight: f64,
    /// Root mean square of a cluster's rows predicted from the others.
    pub held_out_rms: f64,
    /// Standard error, over clusters, of the difference of mean squares to the best weight, in the
    /// same unit squared.
    pub difference_se: f64,
}

/// Chooses the weight of the prior by leave-one-cluster-out error, and returns the table of all
/// weights tried.
///
/// Among weights whose error is at most one standard error worse than the best, the largest is
/// chosen: errors that repeat from flight to flight (soft tissue, joint centres) bias the held-out
/// error towards weights that are too small.
pub(crate) fn choose_weight(
    groups: &[Factor],
    merged: &Factor,
    mass_kg: f64,
    prior: &Prior,
    candidates: &[f64],
) -> Result<(f64, Vec<WeightTrial>), IdentifyError> {
    let system = System::new(merged, mass_kg, Some(prior))?;
    let errors: Vec<Vec<(f64, usize)>> = candidates
        .iter()
        .map(|&lambda| {
            let weight = lambda * system.row_variance();
            let x = system.solve(weight).x;
            Ok(Clusters::new(groups, merged, mass_kg, Some(prior), weight, &x)?.held_out())
        })
        .collect::<Result<_, IdentifyError>>()?;
    let mean_square = |e: &[(f64, usize)]| {
        let rows: usize = e.iter().map(|x| x.1).sum();
        e.iter().map(|x| x.0).sum::<f64>() / rows.max(1) as f64
    };
    let means: Vec<f64> = errors.iter().map(|e| mean_square(e)).collect();
    let best = (0..means.len()).min_by(|&a, &b| means[a].total_cmp(&means[b])).ok_or(IdentifyError::TooFew {
        what: "weights of the prior",
        needed: 1,
        found: 0,
    })?;
    let n = groups.len() as f64;
    let table: Vec<WeightTrial> = candidates
        .iter()
        .enumerate()
        .map(|(i, &weight)| {
            let differences: Vec<f64> =
                errors[i].iter().zip(&errors[best]).map(|(a, b)| (a.0 - b.0) / a.1.max(1) as f64).collect();
            let mean = differences.iter().sum::<f64>() / n;
            let variance = differences.iter().map(|d| (d - mean) * (d - mean)).sum::<f64>() / (n - 1.0).max(1.0);
            WeightTrial { weight, held_out_rms: means[i].sqrt(), difference_se: (variance / n).sqrt() }
        })
        .collect();
    let chosen = table
        .iter()
        .zip(&means)
        .filter(|(t, m)| **m <= means[best] + t.difference_se)
        .map(|(t, _)| t.weight)
        .fold(candidates[best], f64::max);
    Ok((chosen, table))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn spd(n: usize, gap: usize) -> DMatrix<f64> {
        let a = DMatrix::from_fn(n - gap, n, |i, j| ((i * 7 + j * 3) as f64).sin() + f64::from(u8::from(i == j)));
        a.tr_mul(&a)
    }

    /// Agreement with nalgebra's decompositions, with and without full rank.
    #[test]
    fn solutions_are_those_of_the_plain_decompositions() {
        for (n, gap) in [(1, 0), (9, 0), (40, 0), (9, 2)] {
            let a = spd(n, gap);
            let b = DVector::from_fn(n, |i, _| (i as f64).cos());
            let lower = Mat::from_fn(n, n, |i, j| if i >= j { a[(i, j)] } else { f64::NAN });
            let eigen = a.clone().symmetric_eigen();
            let plain = |f: &dyn Fn(f64) -> f64| {
                &eigen.eigenvectors * eigen.eigenvalues.map(f).component_mul(&eigen.eigenvectors.tr_mul(&b))
            };
            let root = |l: f64| if l > 1e-8 { l.sqrt().recip() } else { 0.0 };
            let scale = plain(&root).amax();
            assert!((through_eigen(&lower, &b, root) - plain(&root)).amax() < 1e-9 * scale, "{n} {gap}");
            if gap == 0 {
                let x = a.clone().cholesky().map(|c| c.solve(&b)).unwrap_or_else(|| DVector::zeros(n));
                assert!((solve_semidefinite(&lower, &b, 1e-8) - &x).amax() < 1e-8 * x.amax(), "{n}");
            }
        }
    }

    /// Draws computed together agree with draws computed one by one.
    #[test]
    fn draws_built_together_are_those_built_alone() {
        let (n, m) = (12, 5);
        let cluster = |c: usize| {
            let q = DMatrix::from_fn(3, m, |i, j| 0.05 * ((c * 5 + i * 3 + j) as f64).sin());
            let residual = DVector::from_fn(3, |i, _| ((c + i) as f64).cos());
            ClusterRows { gram: q.tr_mul(&q), score: q.tr_mul(&residual), q, residual, n_rows: 3 }
        };
        let clusters = Clusters {
            estimate: DVector::from_fn(m, |i, _| i as f64),
            inverse: DMatrix::identity(m, m) * 0.5,
            triangle: DMatrix::identity(m, m) * 2.0,
            clusters: (0..n).map(cluster).collect(),
            mass_kg: 60.0,
        };
        for (draw, found) in clusters.bootstrap(19, 4).iter().enumerate() {
            let weights = drawn_weights(n, 4, draw);
            assert_eq!(weights.iter().sum::<f64>(), 0.0);
            let mut matrix = DMatrix::identity(m, m);
            let mut right = DVector::zeros(m);
            for (w, c) in weights.iter().zip(&clusters.clusters) {
                matrix += &c.gram * *w;
                right -= &c.score * *w;
            }
            let step = matrix.try_inverse().unwrap_or_else(|| DMatrix::zeros(m, m)) * right;
            let plain = clusters.whole(&clusters.estimate + &clusters.inverse * step);
            assert!((found - &plain).amax() < 1e-9 * plain.amax(), "draw {draw}");
        }
    }
}
