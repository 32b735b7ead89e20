//! Variances of all estimates, from three sources, each with its degrees of freedom.
//!
//! To first order the error of an estimate is a linear function of the errors of the rows, of the
//! prior and of the kinematics:
//!
//! 1. **Rows.** Differences between clusters: bias-reduced cluster-robust variances (CR2) with the
//!    degrees of freedom of Bell and McCaffrey (2002). Overlapping windows, unequal noise of forces
//!    and moments and noisy regressors are all part of that spread, so no assumption about them is
//!    needed. With fewer than three clusters the pooled variance of the rows is used, with a third
//!    of the rows as degrees of freedom, because neighbouring windows overlap.
//! 2. **Prior.** Its own spread causes a bias where it constrains an estimate. This part is known,
//!    not estimated.
//! 3. **Soft tissue.** Slides of the skin repeat from flight to flight, so the spread does not show
//!    them. They are a random effect: [`aloft_regressor::tissue`] draws it, and its size is that of
//!    the marker residuals.
//!
//! The parts are added, and their degrees of freedom are combined by Satterthwaite's formula
//! ([`crate::interval::satterthwaite`]).

use crate::clusters::Clusters;
use crate::interval::satterthwaite;
use crate::links::{ConsistentLinks, gradient};
use crate::prior::covariance_root;
use aloft_body::BaseParameters;
use aloft_regressor::{Factor, Slides, StretchKind};
use nalgebra::{DMatrix, DVector};

/// Fewest clusters needed to estimate standard errors from their spread.
pub(crate) const MIN_CLUSTERS: usize = 3;

/// Number of rows that count as one independent observation: windows overlap by three quarters.
const OVERLAP: f64 = 3.0;

/// A variance and its degrees of freedom.
pub(crate) type Variance = (f64, f64);

/// Soft tissue errors in a fit.
#[derive(Debug, Clone)]
pub(crate) struct Tissue {
    /// `A_gᵀ D_g` of each cluster for the parameters without the mass and the effects, one column
    /// for each realisation, divided by the square root of their number.
    sums: Vec<DMatrix<f64>>,
    /// Size of the slides, m/rad.
    pub size: f64,
}

impl Tissue {
    /// From the slides of all factors, in the same order, with the cluster of each;
    /// `contact_weight` is the factor applied to contact rows. `None` without slides, or if the
    /// markers show none.
    pub fn of(factors: &[Factor], slides: &[Slides], groups: &[usize], contact_weight: f64) -> Option<Self> {
        let first = slides.first().filter(|_| slides.len() == factors.len())?;
        let (n, draws) = first.sums.shape();
        let count = groups.iter().max().map_or(0, |g| g + 1);
        let (mut sums, mut predicted, mut observed) = (vec![DMatrix::zeros(n, draws); count], 0.0, 0.0);
        for ((factor, slides), group) in factors.iter().zip(slides).zip(groups) {
            if slides.sums.shape() != (n, draws) {
                return None;
            }
            let weight = if factor.kind == StretchKind::Contact { contact_weight * contact_weight } else { 1.0 };
            sums[*group] += &slides.sums * weight;
            predicted += slides.predicted;
            observed += slides.observed;
        }
        let size = (observed / predicted).sqrt();
        if !(size > 0.0 && size.is_finite()) {
            return None;
        }
        let scaled = sums.iter().map(|s| s.rows(1, n - 1) * (size / (draws as f64).sqrt())).collect();
        Some(Self { sums: scaled, size })
    }
}

/// Variances of functions caused by the rows; see [`Uncertainty::rows`].
struct Rows {
    variances: Vec<Variance>,
    shares: Vec<f64>,
    middle: DMatrix<f64>,
}

/// Sources of the variances.
#[derive(Debug, Clone)]
pub(crate) struct Uncertainty {
    clusters: Clusters,
    /// Variance of a row and its degrees of freedom, used if there are too few clusters.
    pooled: Option<Variance>,
    /// Weight w of the prior in squared row units.
    weight: f64,
    /// Factor applied to the spread among clusters.
    inflation: f64,
    /// `Uᵀ⁻¹ Σ A_gᵀ D_g`.
    tissue: Option<DMatrix<f64>>,
    /// The same by cluster.
    tissue_of: Vec<DMatrix<f64>>,
    /// Variance s² of a row in the working model.
    row_variance: f64,
}

impl Uncertainty {
    /// `rows` and `effective` are the number of rows and of parameters that they determine;
    /// `robust` is false if directions are undetermined.
    pub fn new(
        clusters: Clusters,
        row_variance: f64,
        rows: usize,
        effective: f64,
        weight: f64,
        inflation: f64,
        robust: bool,
        tissue: Option<&Tissue>,
    ) -> Self {
        let pooled = (!robust || clusters.len() < MIN_CLUSTERS)
            .then(|| (row_variance, ((rows as f64 - effective) / OVERLAP).max(1.0)));
        let tissue_of: Vec<DMatrix<f64>> = tissue
            .filter(|t| t.sums.iter().all(|s| s.nrows() == clusters.unknowns()))
            .map_or_else(Vec::new, |t| t.sums.iter().map(|s| clusters.reach(s)).collect());
        let tissue = tissue_of.iter().cloned().reduce(|a, b| a + b);
        Self { clusters, pooled, weight, inflation, tissue, tissue_of, row_variance }
    }

    /// True if the spread among clusters is used.
    pub(crate) fn is_robust(&self) -> bool {
        self.pooled.is_none()
    }

    /// Variances of functions of the rows' errors, one per column, with the share of the spread
    /// among clusters that the rows' errors account for, and the middle factor of the covariance
    /// before it is reduced to that share.
    ///
    /// Residuals also contain the error of the prior and the slides of soft tissue, whose variances
    /// are added as parts of their own; what they contribute to the spread is not counted twice. In
    /// the working model (rows of variance s², prior of weight w with its stated covariance, slides
    /// of the size that the markers show) the spread of a function is expected to be
    /// `s² Σ cᵀG_g c + (w − s²) Σ b_gᵀ(1 − ΣG) b_g + Σ ‖cᵀ(1 − G_g)^(−1/2)(T_g − G_g ΣT)‖²`, of
    /// which the first term is the variance caused by the rows.
    fn rows(&self, functions: &DMatrix<f64>) -> Rows {
        match self.pooled {
            Some((variance, freedom)) => {
                let gram = self.clusters.gram() * (variance * self.inflation);
                let by_rows = &gram * functions;
                let of = |k| (functions.column(k).dot(&by_rows.column(k)).max(0.0), freedom);
                let n = functions.ncols();
                Rows { variances: (0..n).map(of).collect(), shares: vec![1.0; n], middle: gram }
            }
            None => {
                let spread = self.clusters.spread(functions, &self.tissue_of);
                let share = |k: usize| {
                    let own = self.row_variance * spread.own[k];
                    let repeated = (self.weight - self.row_variance) * spread.by_prior[k] + spread.by_known[k];
                    // without information the spread is zero as well
                    if own > 0.0 { own / (own + repeated) } else { 1.0 }
                };
                let shares: Vec<f64> = (0..functions.ncols()).map(share).collect();
                let variances = spread.variance.iter().zip(&shares).map(|(v, share)| v * share * self.inflation);
                Rows {
                    variances: variances.zip(spread.freedom).collect(),
                    shares,
                    middle: spread.meat * self.inflation,
                }
            }
        }
    }

    /// Sum of the parts; `known` is the part of each function that is not estimated.
    fn together(&self, functions: &DMatrix<f64>, rows: &[Variance], known: &[f64]) -> Vec<Variance> {
        (0..functions.ncols())
            .map(|k| {
                let tissue = self.tissue.as_ref().map(|t| {
                    let reach = t.tr_mul(&functions.column(k));
                    (reach.norm_squared(), t.ncols() as f64)
                });
                let parts: Vec<Variance> =
                    [Some(rows[k]), Some((known[k], f64::INFINITY)), tissue].into_iter().flatten().collect();
                satterthwaite(&parts)
            })
            .collect()
    }

    /// Covariance of parameters and effects, the mass first (zeros), and degrees of freedom of each
    /// variance.
    pub fn estimates(&self) -> (DMatrix<f64>, Vec<f64>) {
        let functions = self.clusters.own_functions();
        let rows = self.rows(&functions);
        let variances = self.together(&functions, &rows.variances, &self.clusters.of_prior(self.weight, &functions));
        let gram = self.clusters.gram();
        let m = gram.nrows();
        let mut middle = (DMatrix::identity(m, m) - gram) * self.weight;
        if let Some(t) = &self.tissue {
            middle += t * t.transpose();
        }
        let freedom = std::iter::once(f64::INFINITY).chain(variances.iter().map(|v| v.1)).collect();
        let mut covariance = self.clusters.covariance(&rows.middle);
        for (i, a) in rows.shares.iter().enumerate() {
            for (j, b) in rows.shares.iter().enumerate() {
                covariance[(i + 1, j + 1)] *= (a * b).sqrt();
            }
        }
        (covariance + self.clusters.covariance(&middle), freedom)
    }

    /// Variances of the ten numbers of each link: mass, centre of mass, inertia about it (in the
    /// order of [`gradient`]). Consistent links respond to the rows through the curvature at their
    /// minimum.
    pub fn links(
        &self,
        links: &ConsistentLinks,
        merged: &Factor,
        base: &BaseParameters,
        row_variance: f64,
        prior_weight: f64,
    ) -> Vec<[Variance; 10]> {
        let n = links.phi.len();
        let mut gradients = DMatrix::zeros(10 * n, 10 * n);
        for (j, phi) in links.phi.iter().enumerate() {
            gradients.fixed_view_mut::<10, 10>(10 * j, 10 * j).copy_from(&gradient(phi).transpose());
        }
        let follow = &links.response * &gradients;
        let by_base = &base.from_full * &follow / row_variance;
        let (p, k) = (merged.n_parameters(), merged.n_effects());
        let mut by_rows = DMatrix::zeros(p - 1 + k, 10 * n);
        by_rows.rows_mut(0, p - 1).copy_from(&by_base.rows(1, p - 1));
        if k > 0 {
            // effects are eliminated from the rows of links; here from their errors
            let dense = merged.dense();
            let (a, e) = (dense.columns(0, p), dense.columns(p, k));
            // none: only a negative tolerance is refused
            if let Ok(inverse) = e.tr_mul(&e).pseudo_inverse(1e-12) {
                let eliminated = inverse * e.tr_mul(&a) * &by_base;
                by_rows.rows_mut(p - 1, k).copy_from(&(-eliminated));
            }
        }
        let all_known = by_columns(&gradients, &links.known);
        // second-order shifts change moments about the origin, not those about the centre of mass
        // none: without them the intervals are the wider ones
        let beyond = covariance_root(&links.prior_covariance).ok().and_then(DMatrix::try_inverse).map(|inverse| {
            let back = inverse.tr_mul(&inverse) * (&follow * prior_weight);
            by_columns(&back, &links.second_order)
        });
        let known: Vec<f64> = all_known
            .iter()
            .enumerate()
            .map(|(k, all)| {
                let second = beyond.as_ref().filter(|_| k % 10 >= 4).map_or(0.0, |b| b[k]);
                all - second.min(0.9 * all)
            })
            .collect();
        let functions = self.clusters.functions(&by_rows);
        let all = self.together(&functions, &self.rows(&functions).variances, &known);
        (0..n).map(|j| std::array::from_fn(|i| all[10 * j + i])).collect()
    }
}

/// Effective number of equal clusters minus one, from each cluster's share of the evidence (Carter,
/// Schnepel and Steigerwald 2017): degrees of freedom of a jackknife.
pub fn jackknife_freedom(shares: &[f64]) -> f64 {
    let (sum, squares) = shares.iter().fold((0.0, 0.0), |s, h| (s.0 + h, s.1 + h * h));
    if squares > 0.0 { (sum * sum / squares - 1.0).max(1.0) } else { (shares.len() as f64 - 1.0).max(1.0) }
}

/// `cᵀ M c` for every column c.
fn by_columns(columns: &DMatrix<f64>, m: &DMatrix<f64>) -> Vec<f64> {
    let product = m * columns;
    columns.column_iter().zip(product.column_iter()).map(|(c, p)| c.dot(&p).max(0.0)).collect()
}

/// Standard deviations of the given variances.
pub(crate) fn deviations(variances: &[Variance]) -> DVector<f64> {
    DVector::from_iterator(variances.len(), variances.iter().map(|v| v.0.max(0.0).sqrt()))
}
