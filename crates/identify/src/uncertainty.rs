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
//! 3. **Soft tissue.** Slides of the skin repeat from flight to flight, so the spread does not show them. They are a random effect:
//!    [`aloft_regressor::tissue`] draws it, and its size is that of the marker residuals.
//!
//! The parts are added, and their degrees of freedom are combined by Satterthwaite's formula
//! ([`crate::interval::satterthwaite`]).

use crate::LinkPrior;
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
    /// `Σ_g A_gᵀ D_g` for the parameters without the mass and the effects, one column for each
    /// realisation, divided by the square root of their number.
    sums: DMatrix<f64>,
    /// Size of the slides, m/rad.
    pub size: f64,
}

impl Tissue {
    /// From the slides of all factors, in the same order; `contact_weight` is the factor applied to
    /// contact rows. `None` without slides, or if the markers show none.
    pub fn of(factors: &[Factor], slides: &[Slides], contact_weight: f64) -> Option<Self> {
        let first = slides.first().filter(|_| slides.len() == factors.len())?;
        let (n, draws) = first.sums.shape();
        let (mut sums, mut predicted, mut observed) = (DMatrix::zeros(n, draws), 0.0, 0.0);
        for (factor, slides) in factors.iter().zip(slides) {
            if slides.sums.shape() != (n, draws) {
                return None;
            }
            let weight = if factor.kind == StretchKind::Contact { contact_weight * contact_weight } else { 1.0 };
            sums += &slides.sums * weight;
            predicted += slides.predicted;
            observed += slides.observed;
        }
        let size = (observed / predicted).sqrt();
        if !(size > 0.0 && size.is_finite()) {
            return None;
        }
        let scaled = sums.rows(1, n - 1) * (size / (draws as f64).sqrt());
        Some(Self { sums: scaled, size })
    }
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
        let tissue = tissue.filter(|t| t.sums.nrows() == clusters.unknowns()).map(|t| clusters.reach(&t.sums));
        Self { clusters, pooled, weight, inflation, tissue }
    }

    /// True if the spread among clusters is used.
    pub(crate) fn is_robust(&self) -> bool {
        self.pooled.is_none()
    }

    /// Variances of functions of the rows' errors, one per column, and the middle factor of the
    /// covariance.
    fn rows(&self, functions: &DMatrix<f64>) -> (Vec<Variance>, DMatrix<f64>) {
        match self.pooled {
            Some((variance, freedom)) => {
                let gram = self.clusters.gram() * (variance * self.inflation);
                let by_rows = &gram * functions;
                let of = |k| (functions.column(k).dot(&by_rows.column(k)).max(0.0), freedom);
                ((0..functions.ncols()).map(of).collect(), gram)
            }
            None => {
                let spread = self.clusters.spread(functions);
                let variances = spread.variance.iter().map(|v| v * self.inflation);
                (variances.zip(spread.freedom).collect(), spread.meat * self.inflation)
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

    /// Covariance of parameters and effects, the mass first (zeros), and degrees of freedom of each variance.
    pub fn estimates(&self) -> (DMatrix<f64>, Vec<f64>) {
        let functions = self.clusters.own_functions();
        let (rows, mut middle) = self.rows(&functions);
        let variances = self.together(&functions, &rows, &self.clusters.of_prior(self.weight, &functions));
        let gram = self.clusters.gram();
        let m = gram.nrows();
        middle += (DMatrix::identity(m, m) - gram) * self.weight;
        if let Some(t) = &self.tissue {
            middle += t * t.transpose();
        }
        let freedom = std::iter::once(f64::INFINITY).chain(variances.iter().map(|v| v.1)).collect();
        (self.clusters.covariance(&middle), freedom)
    }

    /// Variances of the ten numbers of each link: mass, centre of mass, inertia about it (in the
    /// order of [`gradient`]). Consistent links respond to the rows through the curvature at their
    /// minimum.
    pub fn links(
        &self,
        links: &ConsistentLinks,
        merged: &Factor,
        base: &BaseParameters,
        prior: &LinkPrior,
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
            if let Ok(inverse) = e.tr_mul(&e).pseudo_inverse(1e-12) {
                let eliminated = inverse * e.tr_mul(&a) * &by_base;
                by_rows.rows_mut(p - 1, k).copy_from(&(-eliminated));
            }
        }
        let all_known = by_columns(&gradients, &links.known);
        // second-order shifts change moments about the origin, not those about the centre of mass
        let beyond = covariance_root(&prior.covariance).ok().and_then(DMatrix::try_inverse).map(|inverse| {
            let back = inverse.tr_mul(&inverse) * (&follow * prior_weight);
            by_columns(&back, &prior.second_order)
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
        let all = self.together(&functions, &self.rows(&functions).0, &known);
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
