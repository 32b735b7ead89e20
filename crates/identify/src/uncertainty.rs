//! Variances of all estimates, from four sources, each with its degrees of freedom.
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
//! 3. **Markers.** Movements of the skin repeat with the posture from flight to flight, so the
//!    spread does not show them. They are drawn as the floor of a comparison draws them, from the
//!    markers' residuals ([`aloft_regressor::repeated`]).
//! 4. **Geometry.** Joint centres, hinge axes and marker places are wrong in all recordings alike.
//!    Their draws are those of the calibration, and mass moves with its bones.
//!
//! The parts are added, and their degrees of freedom are combined by Satterthwaite's formula
//! ([`crate::interval::satterthwaite`]).

use crate::IdentifyError;
use crate::clusters::Clusters;
use crate::interval::{not_negative, satterthwaite};
use crate::links::{ConsistentLinks, gradient};
use aloft_body::BaseParameters;
use aloft_regressor::{Factor, RepeatedErrors, StretchKind};
use nalgebra::{DMatrix, DVector};

/// Fewest clusters needed to estimate standard errors from their spread.
pub(crate) const MIN_CLUSTERS: usize = 3;

/// Number of rows that count as one independent observation: windows overlap by three quarters.
const OVERLAP: f64 = 3.0;

/// A variance and its degrees of freedom.
pub(crate) type Variance = (f64, f64);

/// Errors in a fit that repeat over the recordings of a session: of the markers, then of the
/// geometry.
#[derive(Debug, Clone)]
pub(crate) struct Repeating {
    /// `A_gᵀ D_g` of each cluster for the parameters without the mass and the effects, one column
    /// for each draw, divided by the square root of the number of its kind.
    sums: Vec<DMatrix<f64>>,
    /// Number of draws of the markers' errors, the first columns; the others are of the geometry.
    of_markers: usize,
}

impl Repeating {
    /// From the errors of all factors, in the same order, with the cluster of each;
    /// `contact_weight` is the factor applied to contact rows. `None` without draws.
    ///
    /// # Errors
    /// [`IdentifyError::Length`] for errors that do not belong to the factors.
    pub fn of(
        factors: &[Factor],
        errors: &[RepeatedErrors],
        groups: &[usize],
        contact_weight: f64,
    ) -> Result<Option<Self>, IdentifyError> {
        let Some(first) = errors.first() else { return Ok(None) };
        let ((_, draws), others) = (first.markers.shape(), first.geometry.ncols());
        if draws + others == 0 {
            return Ok(None);
        }
        let of = |f: &Factor| f.n_parameters() + f.n_effects();
        let n = factors.first().map_or(0, of);
        let fits = |found: usize, expected: usize, what: &'static str| {
            if found == expected { Ok(()) } else { Err(IdentifyError::Length { what, expected, found }) }
        };
        fits(errors.len(), factors.len(), "errors that repeat")?;
        let count = groups.iter().max().map_or(0, |g| g + 1);
        let mut sums = vec![DMatrix::zeros(n, draws + others); count];
        let per_root = |count: usize| (count.max(1) as f64).sqrt().recip();
        for ((factor, errors), group) in factors.iter().zip(errors).zip(groups) {
            for (rows, columns, count) in [
                (errors.markers.nrows(), errors.markers.ncols(), draws),
                (errors.geometry.nrows(), errors.geometry.ncols(), others),
            ] {
                fits(rows, n, "rows of the errors that repeat")?;
                fits(columns, count, "draws of the errors that repeat")?;
            }
            let weight = if factor.kind == StretchKind::Contact { contact_weight * contact_weight } else { 1.0 };
            let (mut markers, mut geometry) = sums[*group].columns_range_pair_mut(..draws, draws..);
            markers += &errors.markers * (weight * per_root(draws));
            geometry += &errors.geometry * (weight * per_root(others));
        }
        Ok(Some(Self { sums: sums.into_iter().map(|s| s.remove_row(0)).collect(), of_markers: draws }))
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
    /// `Uᵀ⁻¹ Σ A_gᵀ D_g` of what repeats.
    repeating: Option<DMatrix<f64>>,
    /// The same by cluster.
    repeating_of: Vec<DMatrix<f64>>,
    /// Number of its first columns that are of the markers.
    of_markers: usize,
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
        repeating: Option<&Repeating>,
    ) -> Self {
        let pooled = (!robust || clusters.len() < MIN_CLUSTERS)
            .then(|| (row_variance, ((rows as f64 - effective) / OVERLAP).max(1.0)));
        let repeating = repeating.filter(|t| t.sums.iter().all(|s| s.nrows() == clusters.unknowns()));
        let of_markers = repeating.map_or(0, |r| r.of_markers);
        let repeating_of: Vec<DMatrix<f64>> =
            repeating.map_or_else(Vec::new, |r| r.sums.iter().map(|s| clusters.reach(s)).collect());
        let repeating = repeating_of.iter().cloned().reduce(|a, b| a + b);
        Self { clusters, pooled, weight, inflation, repeating, repeating_of, of_markers, row_variance }
    }

    /// True if the spread among clusters is used.
    pub(crate) fn is_robust(&self) -> bool {
        self.pooled.is_none()
    }

    /// Variances of functions of the rows' errors, one per column, with the share of the spread
    /// among clusters that the rows' errors account for, and the middle factor of the covariance
    /// before it is reduced to that share.
    ///
    /// Residuals also contain the error of the prior and the drawn errors, whose variances are
    /// added as parts of their own; what they contribute to the spread is not counted twice. In the
    /// working model (rows of variance s², prior of weight w with its stated covariance, errors as
    /// they are drawn) the spread of a function is expected to be
    /// `s² Σ cᵀG_g c + (w − s²) Σ b_gᵀ(1 − ΣG) b_g + Σ ‖cᵀ(1 − G_g)^(−1/2)(T_g − G_g ΣT)‖²`, of
    /// which the first term is the variance caused by the rows.
    fn rows(&self, functions: &DMatrix<f64>) -> Rows {
        match self.pooled {
            Some((variance, freedom)) => {
                let gram = self.clusters.gram() * (variance * self.inflation);
                let by_rows = &gram * functions;
                let of = |k| (not_negative(functions.column(k).dot(&by_rows.column(k))), freedom);
                let n = functions.ncols();
                Rows { variances: (0..n).map(of).collect(), shares: vec![1.0; n], middle: gram }
            }
            None => {
                let spread = self.clusters.spread(functions, &self.repeating_of);
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
                let mut parts = vec![rows[k], (known[k], f64::INFINITY)];
                if let Some(repeating) = &self.repeating {
                    let reach = repeating.tr_mul(&functions.column(k));
                    for part in [reach.rows_range(..self.of_markers), reach.rows_range(self.of_markers..)] {
                        parts.extend((!part.is_empty()).then(|| (part.norm_squared(), part.len() as f64)));
                    }
                }
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
        if let Some(r) = &self.repeating {
            middle += r * r.transpose();
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
        let known = by_columns(&gradients, &links.known);
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
    columns.column_iter().zip(product.column_iter()).map(|(c, p)| not_negative(c.dot(&p))).collect()
}

/// Standard deviations of the given variances.
pub(crate) fn deviations(variances: &[Variance]) -> DVector<f64> {
    DVector::from_iterator(variances.len(), variances.iter().map(|v| not_negative(v.0).sqrt()))
}
