//! The whole identification step: from factors to parameters with uncertainty, consistent links and
//! a verdict.

use crate::alike::alike;
use crate::clusters::{Clusters, Correction, choose_weight, merge_groups};
use crate::gate::{WELL, determination, judge};
use crate::interval::{half_of, interval95, not_negative};
use crate::links::{LinkSd, gradient, link_with_sd};
use crate::noise_metric::{InNoise, NoiseMetric, NoiseUnits};
use crate::null_vector::sigma_of;
use crate::parameters::LinkIntervals;
use crate::prior::covariance_root;
use crate::system::System;
use crate::uncertainty::{Repeating, Uncertainty, Variance, deviations};
use crate::{
    BaseEstimate, ClusterBy, ColumnScaling, Determination, EffectEstimate, Estimator, GateLimits, Identification,
    IdentifyError, Information, LinkEstimate, LinkOptions, LinkOrigin, LinkPrior, Origin, Parameters, Prior, Sigma,
    Visible, advice, balanced, consistent_links, information, null_vector,
};
use aloft_body::{BaseParameters, Model, Phi};
use aloft_regressor::{Factor, RepeatedErrors, StretchKind, leave_group_out};
use nalgebra::{DMatrix, DVector, SMatrix};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// Cosine from which on a change counts as parallel to the values themselves: their ratios stay
/// within some five percent while they change by a third.
const PARALLEL: f64 = 0.99;

/// Options of an identification.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct IdentifyOptions {
    /// Estimator.
    pub estimator: Estimator,
    /// Unit of independent evidence.
    pub cluster: ClusterBy,
    /// Correlation ρ of the error between clusters, 0 to 1, for errors that repeat from flight to
    /// flight and are not modelled: variances grow by 1 + (clusters − 1) ρ. Zero by default,
    /// because soft tissue has a model of its own ([`identify_with_errors`]).
    pub flight_error_correlation: f64,
    /// Number of bootstrap draws (0 for none). Intervals do not depend on them.
    pub bootstrap: usize,
    /// Seed of the bootstrap.
    pub seed: u64,
    /// Weights of the prior that are tried if none is given.
    pub weights: Vec<f64>,
    /// Weight of what keeps the mass of links inside their boxes.
    pub box_weight: f64,
    /// Limits of the gate.
    pub gate: GateLimits,
    /// Factors of the standard errors of effect coefficients, by column: how much they grow because
    /// nonlinear parameters of the effect, fixed here, were fitted to the same recordings, and by
    /// errors that are the same in all recordings.
    pub widening: BTreeMap<String, f64>,
    /// Whether advice may contain turning the whole body over in the air: for objects, and for
    /// people whose protocol contains it.
    pub turning_over: bool,
}

impl Default for IdentifyOptions {
    /// Mass-constrained least squares, clusters are stretches, no bootstrap; weights of a prior are
    /// chosen among 1, 3 and 10.
    fn default() -> Self {
        Self {
            estimator: Estimator::MassConstrained,
            cluster: ClusterBy::Stretch,
            flight_error_correlation: 0.0,
            bootstrap: 0,
            seed: 1,
            weights: vec![1.0, 3.0, 10.0],
            box_weight: 0.3,
            gate: GateLimits::default(),
            widening: BTreeMap::new(),
            turning_over: false,
        }
    }
}

/// Identifies parameters from the factors of all stretches.
///
/// [`Estimator::NullVector`] uses only flights and leaves contact stretches out; the others use
/// both. `prior` is required for [`Estimator::Regularised`] and for consistent links; with another
/// estimator it is only reported next to the results (and used for the links).
///
/// # Errors
/// [`IdentifyError::Regressor`] when factors cannot be merged, [`IdentifyError::TooFew`] when the
/// rows are too few for the estimator, [`IdentifyError::Option`] for an estimator without the prior
/// that it needs.
pub fn identify(
    model: &Model,
    base: &BaseParameters,
    factors: &[Factor],
    mass_kg: f64,
    prior: Option<&LinkPrior>,
    options: &IdentifyOptions,
) -> Result<Identification, IdentifyError> {
    identify_with_errors(model, base, factors, None, &[], mass_kg, prior, options)
}

/// As [`identify`], with the flights among `factors` already merged, for example by many machines
/// in a tree. The merged factor is used if there are no contact stretches to weight against the
/// flights; uncertainty always comes from the individual factors.
///
/// # Errors
/// As [`identify`].
pub fn identify_merged(
    model: &Model,
    base: &BaseParameters,
    factors: &[Factor],
    flights: Option<&Factor>,
    mass_kg: f64,
    prior: Option<&LinkPrior>,
    options: &IdentifyOptions,
) -> Result<Identification, IdentifyError> {
    identify_with_errors(model, base, factors, flights, &[], mass_kg, prior, options)
}

/// As [`identify_merged`], with what errors of the markers and the geometry do to each factor's
/// rows ([`aloft_regressor::weak_factor_with_repeated`]), in the same order. Estimates do not
/// depend on it; their intervals include errors that repeat from flight to flight.
///
/// # Errors
/// As [`identify`], and [`IdentifyError::Length`] if `errors` has another length than `factors`.
pub fn identify_with_errors(
    model: &Model,
    base: &BaseParameters,
    factors: &[Factor],
    flights: Option<&Factor>,
    errors: &[RepeatedErrors],
    mass_kg: f64,
    prior: Option<&LinkPrior>,
    options: &IdentifyOptions,
) -> Result<Identification, IdentifyError> {
    if !errors.is_empty() && errors.len() != factors.len() {
        return Err(IdentifyError::Length { what: "errors that repeat", expected: factors.len(), found: errors.len() });
    }
    let base_prior = prior.map(|p| p.base(base)).transpose()?;
    // coefficients that the rows do not determine are excluded from every elimination
    let visible = match options.estimator {
        Estimator::NullVector(_) => Visible::default(),
        Estimator::MassConstrained => Visible::among(factors, false)?,
        Estimator::Regularised { .. } | Estimator::NoiseMetric => Visible::among(factors, base_prior.is_some())?,
    };
    let reduced = visible.reduce_all(factors)?;
    let factors = reduced.as_slice();
    let flights = flights.map(|f| visible.reduce(f)).transpose()?;
    let errors: Vec<RepeatedErrors> = errors.iter().map(|s| visible.reduce_errors(s)).collect();
    let (factors, balance) = match options.estimator {
        // a null vector exists only without external forces: contact, whose rows have a right-hand
        // side, is left out
        Estimator::NullVector(_) => {
            (factors.iter().filter(|f| f.kind != StretchKind::Contact).cloned().collect(), None)
        }
        Estimator::MassConstrained => balanced(factors, mass_kg, None)?,
        Estimator::Regularised { .. } | Estimator::NoiseMetric => balanced(factors, mass_kg, base_prior.as_ref())?,
    };
    let factors = factors.as_slice();
    let (groups, cluster_names) = options.cluster.groups(factors);
    let contact_weight = balance.as_ref().map_or(1.0, |b| b.contact_weight);
    let repeating = match options.estimator {
        // its errors are those of resampled flights
        Estimator::NullVector(_) => None,
        _ => Repeating::of(factors, &errors, &groups, contact_weight)?,
    };
    // the merged factor must have as many rows as the factors
    let rows: usize = factors.iter().map(|f| f.n_rows).sum();
    let alone = factors.iter().all(|f| f.kind != StretchKind::Contact);
    let merged = match &flights {
        Some(all) if alone && all.n_rows == rows && factors.iter().all(|f| f.columns == all.columns) => all.clone(),
        _ => Factor::merge(factors)?,
    };
    if merged.n_parameters() != base.len() {
        return Err(IdentifyError::Length {
            what: "base parameters of the factors",
            expected: base.len(),
            found: merged.n_parameters(),
        });
    }
    let clusters = merge_groups(factors, &groups)?;
    let mut noise_units = None;
    let mut moment_errors = None;
    // rows that the estimate and the links use: all of them, or those corrected for their noise
    let mut used = merged.clone();
    let fit = match options.estimator {
        Estimator::NoiseMetric => {
            let metric = NoiseMetric::of(&merged)?;
            let prepared = base_prior.as_ref().map(|p| p.prepared(mass_kg)).transpose()?;
            let mut found = metric.estimate(mass_kg, prepared.as_ref(), 1.0)?;
            moment_errors = metric.moment_errors(&found.solution.x, base);
            // what the motion does not determine is that of the links, for which the prior is
            // stated (without such directions nothing would move)
            if let (Some(prior), 1..) = (prior, found.units.undetermined) {
                let weights = link_options(found.row_variance, 1.0, moment_errors.clone(), options);
                let links = consistent_links(&found.rows, base, mass_kg, prior, &weights)?;
                metric.move_to(&mut found, &links.base(base));
            }
            used = found.rows.clone();
            noise_units = Some(found.units.clone());
            Fit::in_noise_metric(&clusters, found, mass_kg, base_prior.as_ref(), options)?
        }
        Estimator::NullVector(scaling) => Fit::null_vector(factors, &groups, &merged, mass_kg, scaling)?,
        Estimator::MassConstrained => {
            Fit::least_squares(&clusters, &merged, mass_kg, None, 0.0, Vec::new(), repeating.as_ref(), options)?
        }
        Estimator::Regularised { weight } => {
            let prior = base_prior.as_ref().ok_or_else(|| IdentifyError::Option {
                option: "estimator",
                problem: "`regularised` needs a prior".to_owned(),
            })?;
            let (lambda, tried) = match weight {
                Some(w) if w > 0.0 && w.is_finite() => (w, Vec::new()),
                Some(w) => return Err(IdentifyError::Option { option: "weight", problem: format!("{w}") }),
                None if clusters.len() < 2 => (options.weights.iter().copied().fold(1.0, f64::max), Vec::new()),
                None => choose_weight(&clusters, &merged, mass_kg, prior, &options.weights)?,
            };
            Fit::least_squares(&clusters, &merged, mass_kg, Some(prior), lambda, tried, repeating.as_ref(), options)?
        }
    };
    let rows = merged.rows;
    let sigma = flight_sigma(factors)?;
    let unseen = fit.unseen()?;
    let unseen_sd: Vec<f64> = unseen.row_iter().map(|row| row.norm()).collect();
    let base_estimates = fit.base_estimates(base, base_prior.as_ref(), mass_kg, &unseen_sd);
    if let (Some(units), Some(prior)) = (&mut noise_units, &base_prior) {
        fit.name_undetermined(units, &base_estimates, prior, &unseen);
    }
    let links = match prior {
        Some(prior) => fit.links(model, base, &used, mass_kg, prior, &unseen, moment_errors, options)?,
        None => Vec::new(),
    };
    let named: Vec<(String, Determination)> =
        base_estimates.iter().map(|b| (b.name.clone(), b.determination)).collect();
    // no motion in the air shows what the noise metric leaves to the table
    let of_table: &[String] = noise_units.as_ref().map_or(&[], |u| &u.of_table);
    let open: Vec<_> = named.iter().filter(|(name, _)| !of_table.contains(name)).cloned().collect();
    let hints = advice::in_words(model, &open, options.turning_over);
    let information = match base_prior.as_ref() {
        Some(prior) => Some(fit.information(&clusters, mass_kg, prior, &named)?),
        None => None,
    };
    let mut gate = judge(
        &options.estimator,
        &sigma,
        information.as_ref(),
        &named,
        factors.len(),
        fit.deficient,
        &options.gate,
        hints,
    );
    gate.reasons.splice(0..0, against_table(&links));
    let effects = visible.estimates(fit.effect_estimates(&merged, &options.widening));
    let mut trials: Vec<&str> = factors.iter().map(|f| f.trial.as_str()).collect();
    trials.sort_unstable();
    trials.dedup();
    let estimator = match options.estimator {
        Estimator::Regularised { .. } => Estimator::Regularised { weight: Some(fit.prior_weight) },
        other => other,
    };
    let parameters = Parameters {
        rows,
        estimator,
        mass_kg,
        base: base_estimates,
        effects,
        links,
        sigma,
        noise_units,
        information,
        gate,
        n_stretches: factors.len(),
        n_contacts: factors.iter().filter(|f| f.kind == StretchKind::Contact).count(),
        n_trials: trials.len(),
        n_rows: merged.n_rows,
        row_rms: (merged.sum_of_squares(&fit.padded(merged.n_effects())) / merged.n_rows.max(1) as f64).sqrt(),
        row_sd: fit.row_sd,
        prior_weight: fit.prior_weight,
        weights_tried: fit.tried.clone(),
        cluster: options.cluster,
        contact: balance,
        se_from: fit.se_from(cluster_names.len()),
        with_geometry: fit.repeats,
    };
    let draws = fit.draws.into_iter().map(|d| visible.whole(d)).collect();
    Ok(Identification { parameters, covariance: visible.whole_covariance(fit.covariance), draws })
}

/// Singular values of the flights' parameter columns; NaN without flights.
fn flight_sigma(factors: &[Factor]) -> Result<Sigma, IdentifyError> {
    let flights: Vec<&Factor> = factors.iter().filter(|f| f.kind != StretchKind::Contact).collect();
    if flights.is_empty() {
        return Ok(sigma_of(&[]));
    }
    let merged = Factor::merge_refs(&flights)?;
    let p = merged.n_parameters();
    let dense = merged.dense();
    let a = faer::Mat::from_fn(p, p, |i, j| if i < dense.nrows() { dense[(i, j)] } else { 0.0 });
    let singular = a
        .singular_values()
        .map_err(|_| IdentifyError::Numeric("the singular value decomposition failed".to_owned()))?;
    Ok(sigma_of(&singular))
}

struct Fit {
    x: DVector<f64>,
    n_parameters: usize,
    covariance: DMatrix<f64>,
    /// Degrees of freedom of each variance, the mass first.
    freedom: Vec<f64>,
    /// Sources of the variances; none for the null vector, which has only a jackknife.
    uncertainty: Option<Uncertainty>,
    /// True if the variances hold errors that repeat over a session.
    repeats: bool,
    row_sd: f64,
    prior_weight: f64,
    tried: Vec<crate::WeightTrial>,
    deficient: usize,
    /// True for base parameters that neither rows nor prior determine.
    undetermined: Vec<bool>,
    /// Rows at the level of the noise that were taken out, d × m: the prior holds what they see.
    held_by_prior: DMatrix<f64>,
    draws: Vec<DVector<f64>>,
    robust: bool,
}

impl Fit {
    fn null_vector(
        factors: &[Factor],
        groups: &[usize],
        merged: &Factor,
        mass_kg: f64,
        scaling: ColumnScaling,
    ) -> Result<Self, IdentifyError> {
        let whole = null_vector(merged, mass_kg, scaling)?;
        let p = merged.n_parameters();
        let n = groups.iter().max().map_or(0, |g| g + 1);
        let left: Vec<DVector<f64>> = if n >= 2 {
            // none: where one group is needed to determine the vector, its scatter is not known,
            // and all of it has no interval
            let each = leave_group_out(factors, groups, |_, rest| null_vector(rest, mass_kg, scaling).ok())?;
            let all: Option<Vec<_>> = each.into_iter().map(|v| v.map(|v| v.parameters)).collect();
            all.unwrap_or_default()
        } else {
            Vec::new()
        };
        let g = left.len() as f64;
        let mut covariance = DMatrix::zeros(p, p);
        if left.len() >= 2 {
            let mean = left.iter().fold(DVector::zeros(p), |sum, x| sum + x) / g;
            for x in &left {
                let d = x - &mean;
                covariance += &d * d.transpose() * ((g - 1.0) / g);
            }
        } else {
            covariance.fill_diagonal(f64::INFINITY);
        }
        let rows = merged.n_rows.max(p) as f64;
        let row_variance =
            merged.sum_of_squares(&pad(&whole.parameters, merged.n_effects())) / (rows - p as f64 + 1.0).max(1.0);
        Ok(Self {
            x: whole.parameters,
            n_parameters: p,
            covariance,
            freedom: vec![left.len().saturating_sub(1) as f64; p],
            uncertainty: None,
            repeats: false,
            row_sd: row_variance.sqrt(),
            prior_weight: 0.0,
            tried: Vec::new(),
            deficient: 0,
            undetermined: vec![false; p],
            held_by_prior: DMatrix::zeros(0, p - 1),
            draws: Vec::new(),
            robust: left.len() >= 2,
        })
    }

    fn least_squares(
        clusters: &[Factor],
        merged: &Factor,
        mass_kg: f64,
        prior: Option<&Prior>,
        lambda: f64,
        tried: Vec<crate::WeightTrial>,
        repeating: Option<&Repeating>,
        options: &IdentifyOptions,
    ) -> Result<Self, IdentifyError> {
        let system = System::new(merged, mass_kg, prior)?;
        let row_variance = system.row_variance();
        let weight = lambda * row_variance;
        let solution = system.solve(weight);
        if !(0.0..=1.0).contains(&options.flight_error_correlation) {
            return Err(IdentifyError::Option {
                option: "flight_error_correlation",
                problem: format!("{} is not within 0 to 1", options.flight_error_correlation),
            });
        }
        let repeats = 1.0 + (clusters.len() as f64 - 1.0) * options.flight_error_correlation;
        let resampled = Clusters::new(clusters, merged, mass_kg, prior, weight, &solution.x)?;
        let draws = if options.bootstrap > 0 && resampled.len() >= 2 {
            resampled.bootstrap(options.bootstrap, options.seed)
        } else {
            Vec::new()
        };
        let uncertainty = Uncertainty::new(
            resampled,
            row_variance,
            system.n_rows(),
            solution.effective_parameters,
            weight,
            repeats,
            solution.deficient == 0,
            repeating,
        );
        let (covariance, freedom) = uncertainty.estimates();
        Ok(Self {
            x: solution.x,
            n_parameters: merged.n_parameters(),
            covariance,
            freedom,
            robust: uncertainty.is_robust(),
            uncertainty: Some(uncertainty),
            repeats: repeating.is_some(),
            row_sd: row_variance.sqrt(),
            prior_weight: lambda,
            tried,
            deficient: solution.deficient,
            undetermined: system.undetermined(weight),
            held_by_prior: DMatrix::zeros(0, 0),
            draws,
        })
    }

    /// The estimate in the metric of the noise, with intervals from the spread of the clusters'
    /// corrected scores.
    fn in_noise_metric(
        clusters: &[Factor],
        found: InNoise,
        mass_kg: f64,
        prior: Option<&Prior>,
        options: &IdentifyOptions,
    ) -> Result<Self, IdentifyError> {
        let lambda = if prior.is_some() { 1.0 } else { 0.0 };
        let InNoise { rows, excess, undetermined, determined, row_variance, system, solution, .. } = found;
        let weight = lambda * row_variance;
        let correction = Correction { excess, determined: &determined };
        let resampled = Clusters::corrected(clusters, &rows, mass_kg, prior, weight, &solution.x, Some(correction))?;
        let draws = if options.bootstrap > 0 && resampled.len() >= 2 {
            resampled.bootstrap(options.bootstrap, options.seed)
        } else {
            Vec::new()
        };
        let effective = solution.effective_parameters;
        let robust = solution.deficient == 0;
        let (n, repeats) = (system.n_rows(), 1.0);
        let uncertainty = Uncertainty::new(resampled, row_variance, n, effective, weight, repeats, robust, None);
        let (covariance, freedom) = uncertainty.estimates();
        Ok(Self {
            n_parameters: rows.n_parameters(),
            undetermined: system.undetermined(weight),
            deficient: solution.deficient,
            x: solution.x,
            covariance,
            freedom,
            robust: uncertainty.is_robust(),
            uncertainty: Some(uncertainty),
            repeats: false,
            row_sd: row_variance.sqrt(),
            prior_weight: lambda,
            tried: Vec::new(),
            held_by_prior: undetermined,
            draws,
        })
    }

    /// What the undetermined directions V do to the base parameters, the mass first: the part of
    /// their covariance C that a measurement of V would take away has the root `C Vᵀ (V C
    /// Vᵀ)^(−1/2)`, p × d.
    fn unseen(&self) -> Result<DMatrix<f64>, IdentifyError> {
        let (p, rows) = (self.n_parameters, &self.held_by_prior);
        if rows.nrows() == 0 || self.prior_weight <= 0.0 {
            return Ok(DMatrix::zeros(p, 0));
        }
        let all = self.covariance.nrows();
        let along = self.covariance.columns_range(1..all) * rows.transpose();
        let root = covariance_root(&(rows * along.rows_range(1..all)))?;
        let singular = || IdentifyError::Numeric("the undetermined directions have no variance".to_owned());
        Ok(along.rows_range(..p) * root.try_inverse().ok_or_else(singular)?.transpose())
    }

    fn se_from(&self, n_clusters: usize) -> String {
        let rows = if self.robust {
            format!("spread among {n_clusters} clusters")
        } else {
            "noise of the rows alone: too few clusters to see their spread".to_owned()
        };
        let repeats = if self.repeats { ", errors of markers and geometry as random effects" } else { "" };
        format!("{rows}{repeats}; Student's t")
    }

    fn padded(&self, n_effects: usize) -> DVector<f64> {
        pad(&self.x, (self.n_parameters + n_effects).saturating_sub(self.x.len()))
    }

    fn freedom(&self, i: usize) -> f64 {
        self.freedom.get(i).copied().unwrap_or(f64::NAN)
    }

    /// Names the parameters that are the prior's because of undetermined directions.
    fn name_undetermined(&self, units: &mut NoiseUnits, base: &[BaseEstimate], prior: &Prior, unseen: &DMatrix<f64>) {
        let sd = |i: usize| prior.covariance[(i, i)].max(f64::MIN_POSITIVE).sqrt();
        let held: Vec<usize> = (1..base.len())
            .filter(|&i| base[i].determination == Determination::Hardly && unseen.row(i).norm() >= WELL * sd(i))
            .collect();
        units.of_table = held.iter().map(|&i| base[i].name.clone()).collect();
        if unseen.ncols() != 1 || held.len() < 2 {
            return;
        }
        // in proportion: the change is parallel to the values themselves
        let of = |f: &dyn Fn(usize) -> f64| DVector::from_iterator(held.len(), held.iter().map(|&i| f(i) / sd(i)));
        let (change, value) = (of(&|i| unseen[(i, 0)]), of(&|i| self.x[i]));
        units.ratios = change.dot(&value).abs() >= PARALLEL * change.norm() * value.norm();
    }

    fn base_estimates(
        &self,
        base: &BaseParameters,
        prior: Option<&Prior>,
        mass_kg: f64,
        unseen_sd: &[f64],
    ) -> Vec<BaseEstimate> {
        // characteristic length of the body: radius of gyration from its largest root inertia
        let largest = base
            .parameters
            .iter()
            .enumerate()
            .filter(|(_, b)| matches!(b.name.as_str(), "Jxx" | "Jyy" | "Jzz"))
            .map(|(i, _)| prior.map_or(self.x[i], |p| p.mean[i]).abs())
            .fold(0.0, f64::max);
        let length = (largest / mass_kg).sqrt();
        base.parameters
            .iter()
            .enumerate()
            .map(|(i, parameter)| {
                // an undetermined direction has zero variance in the covariance: its parameters are
                // unknown, not exact
                let se =
                    if self.undetermined[i] { f64::INFINITY } else { not_negative(self.covariance[(i, i)]).sqrt() };
                let scale = match parameter.unit {
                    "kg" => mass_kg,
                    "kg·m" => mass_kg * length,
                    _ => mass_kg * length * length,
                };
                let prior_sd = prior.map(|p| p.covariance[(i, i)].max(0.0).sqrt());
                let determination =
                    if i == 0 { Determination::Well } else { determination(se, unseen_sd[i], prior_sd, scale) };
                BaseEstimate {
                    name: parameter.name.clone(),
                    value: self.x[i],
                    se,
                    ci95: interval95(self.x[i], se, self.freedom(i)),
                    freedom: self.freedom(i),
                    unit: parameter.unit.to_owned(),
                    formula: parameter.formula.clone(),
                    prior: prior.map(|p| p.mean[i]),
                    prior_sd,
                    determination,
                    from: if i == 0 { Origin::Scale } else { Origin::of(determination, self.prior_weight > 0.0) },
                }
            })
            .collect()
    }

    /// Information that motion added to the prior.
    fn information(
        &self,
        clusters: &[Factor],
        mass_kg: f64,
        prior: &Prior,
        named: &[(String, Determination)],
    ) -> Result<Information, IdentifyError> {
        let row_variance = self.row_sd * self.row_sd;
        let weight = self.prior_weight * row_variance;
        let determined: Vec<Determination> = named.iter().skip(1).map(|n| n.1).collect();
        Ok(Information {
            parameters: information::of_parameters(&determined),
            wrench: information::of_wrench(clusters, mass_kg, prior, weight, row_variance)?,
        })
    }

    fn effect_estimates(&self, merged: &Factor, widening: &BTreeMap<String, f64>) -> Vec<EffectEstimate> {
        let p = self.n_parameters;
        if self.x.len() < p + merged.n_effects() {
            return Vec::new();
        }
        let names = &merged.columns.effects;
        let wider = |name: &String| widening.get(name).copied().unwrap_or(1.0).max(1.0);
        let own = |(k, name): (usize, &String)| wider(name) * not_negative(self.covariance[(p + k, p + k)]).sqrt();
        let se: Vec<f64> = names.iter().enumerate().map(own).collect();
        // a prior tells columns apart that are alike beside a body about which nothing is known
        let theta = self.x.rows(p, names.len()).into_owned();
        let alike = if self.prior_weight > 0.0 { vec![false; se.len()] } else { alike(merged, &theta, &se) };
        names
            .iter()
            .enumerate()
            .map(|(k, name)| {
                let (value, se) = (self.x[p + k], if alike[k] { f64::NAN } else { se[k] });
                let freedom = self.freedom(p + k);
                EffectEstimate {
                    name: name.clone(),
                    value,
                    se,
                    ci95: interval95(value, se, freedom),
                    freedom,
                    not_determined: None,
                }
            })
            .collect()
    }

    fn links(
        &self,
        model: &Model,
        base: &BaseParameters,
        merged: &Factor,
        mass_kg: f64,
        prior: &LinkPrior,
        unseen: &DMatrix<f64>,
        moment_errors: Option<DMatrix<f64>>,
        options: &IdentifyOptions,
    ) -> Result<Vec<LinkEstimate>, IdentifyError> {
        let row_variance = (self.row_sd * self.row_sd).max(f64::MIN_POSITIVE);
        let prior_weight = if self.prior_weight > 0.0 { self.prior_weight } else { 1.0 };
        let weights = link_options(row_variance, prior_weight, moment_errors, options);
        let consistent = consistent_links(merged, base, mass_kg, prior, &weights)?;
        let variances: Vec<[Variance; 10]> = match &self.uncertainty {
            Some(uncertainty) => uncertainty.links(&consistent, merged, base, row_variance),
            None => {
                let of = |(j, phi): (usize, &Phi)| {
                    let by = gradient(phi);
                    let own = consistent.covariance.fixed_view::<10, 10>(10 * j, 10 * j);
                    let variances = (by * own * by.transpose()).diagonal();
                    std::array::from_fn(|i| (variances[i], self.freedom(1)))
                };
                consistent.phi.iter().enumerate().map(of).collect()
            }
        };
        let along = unseen_of_links(prior, base, unseen)?;
        Ok(consistent
            .phi
            .iter()
            .zip(&variances)
            .enumerate()
            .map(|(j, (phi, variances))| {
                let before: SMatrix<f64, 10, 10> = prior.covariance.fixed_view::<10, 10>(10 * j, 10 * j).into();
                let unseen = gradient(phi) * along.rows(10 * j, 10);
                let sd: Vec<f64> = unseen.row_iter().map(|row| row.norm()).collect();
                link_estimate(&model.links[j].name, phi, variances, &prior.links[j], &before, &sd)
            })
            .collect())
    }
}

/// Weights of the links' problem beside those of the estimate.
fn link_options(
    row_variance: f64,
    prior_weight: f64,
    moment_errors: Option<DMatrix<f64>>,
    options: &IdentifyOptions,
) -> LinkOptions {
    LinkOptions { row_variance, prior_weight, box_weight: options.box_weight, moment_errors }
}

/// Changes of the stacked φ that the prior expects with changes of the base parameters, 10 n × d:
/// `P Bᵀ (B P Bᵀ)⁻¹ W`.
fn unseen_of_links(
    prior: &LinkPrior,
    base: &BaseParameters,
    changes: &DMatrix<f64>,
) -> Result<DMatrix<f64>, IdentifyError> {
    if changes.ncols() == 0 {
        return Ok(DMatrix::zeros(prior.mean.len(), 0));
    }
    let singular = || IdentifyError::Numeric("the prior covariance is singular".to_owned());
    let inverse = covariance_root(&prior.base(base)?.covariance)?.try_inverse().ok_or_else(singular)?;
    Ok(&prior.covariance * base.from_full.tr_mul(&inverse.tr_mul(&(&inverse * changes))))
}

fn pad(x: &DVector<f64>, zeros: usize) -> DVector<f64> {
    x.clone().resize_vertically(x.len() + zeros, 0.0)
}

fn link_estimate(
    name: &str,
    phi: &Phi,
    variances: &[Variance; 10],
    prior: &aloft_body::LinkInertia,
    prior_covariance: &SMatrix<f64, 10, 10>,
    unseen: &[f64],
) -> LinkEstimate {
    let size_of = |s: &[f64]| s.iter().map(|x| x * x).sum::<f64>().sqrt();
    let link = aloft_body::LinkInertia::from_phi(phi);
    let sd = LinkSd::of(deviations(variances).as_slice());
    let i = &link.inertia_com_kgm2;
    let of = |k: usize, value: f64| interval95(value, not_negative(variances[k].0).sqrt(), variances[k].1);
    let pairs = [(0, 0), (1, 1), (2, 2), (1, 2), (2, 0), (0, 1)];
    let ci95 = LinkIntervals {
        mass_kg: of(0, link.mass_kg),
        com_m: std::array::from_fn(|k| of(1 + k, link.com_m[k])),
        inertia_kgm2: std::array::from_fn(|k| of(4 + k, i[pairs[k]])),
    };
    let half = |ci95: Option<[f64; 2]>| half_of(ci95).unwrap_or(f64::NAN);
    let (_, before) = link_with_sd(&prior.to_phi(), prior_covariance);
    let mass = determination(sd.mass_kg, unseen[0].abs(), Some(before.mass_kg), 1.0);
    let com = determination(sd.com_m.norm(), size_of(&unseen[1..4]), Some(before.com_m.norm()), 1.0);
    let size = |s: &[f64; 6]| size_of(&s[..3]);
    let inertia = determination(size(&sd.inertia_kgm2), size_of(&unseen[4..7]), Some(size(&before.inertia_kgm2)), 1.0);
    let word = |s: Determination| match s {
        Determination::Well => "well seen",
        Determination::Partly => "partly seen",
        Determination::Hardly => Origin::Table.describe(),
    };
    // every estimator's links are regularised towards the table
    let from = LinkOrigin {
        mass_kg: Origin::of(mass, true),
        com_m: Origin::of(com, true),
        inertia_kgm2: Origin::of(inertia, true),
    };
    let words = format!(
        "mass {:.3} ± {:.3} kg ({}), centre of mass ± {:.0} mm ({}), inertia ({})",
        link.mass_kg,
        half(ci95.mass_kg),
        word(mass),
        1000.0 * ci95.com_m.iter().map(|c| half(*c).powi(2)).sum::<f64>().sqrt(),
        word(com),
        word(inertia)
    );
    LinkEstimate {
        name: name.to_owned(),
        mass_kg: link.mass_kg,
        com_m: link.com_m.into(),
        inertia_kgm2: std::array::from_fn(|i| std::array::from_fn(|j| link.inertia_com_kgm2[(i, j)])),
        sd,
        ci95,
        prior: *prior,
        determination: mass.min(com).min(inertia),
        from,
        mass_against_table: (before.mass_kg > 0.0).then(|| (link.mass_kg - prior.mass_kg) / before.mass_kg),
        words,
    }
}

/// Links whose mass the recordings contradict, in words; none where there is none.
fn against_table(links: &[LinkEstimate]) -> Option<String> {
    let of = |l: &LinkEstimate| {
        let deviations = l.mass_against_table.map_or(f64::NAN, f64::abs);
        format!(
            "{} ({:+.1} kg, {deviations:.1} of the table's standard deviations)",
            l.name,
            l.mass_kg - l.prior.mass_kg
        )
    };
    let all: Vec<String> = links.iter().filter(|l| l.contradicts_table()).map(of).collect();
    (!all.is_empty()).then(|| {
        format!(
            "the recordings contradict the table for the mass of {}: check the joint centres and markers there, what it carries, and the stated mass",
            all.join(", ")
        )
    })
}
