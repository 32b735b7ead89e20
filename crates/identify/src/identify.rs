//! The whole step: factors in, parameters with uncertainty, consistent links and a verdict out.

use crate::clusters::{Clusters, choose_weight, merge_groups};
use crate::gate::{judge, seen};
use crate::links::link_with_sd;
use crate::null_vector::sigma_of;
use crate::system::System;
use crate::{
    BaseEstimate, ClusterBy, ColumnScaling, EffectEstimate, Estimator, GateLimits, Identification, IdentifyError,
    Information, LinkEstimate, LinkOptions, LinkOrigin, LinkPrior, Origin, Parameters, Prior, Seen, Sigma, Visible,
    advice, balanced, consistent_links, information, null_vector,
};
use aloft_body::{BaseParameters, Model, Phi};
use aloft_regressor::{Factor, StretchKind, leave_group_out};
use nalgebra::{DMatrix, DVector, SMatrix};
use serde::{Deserialize, Serialize};

/// What to identify and how.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct IdentifyOptions {
    /// Estimator.
    pub estimator: Estimator,
    /// What counts as independent evidence.
    pub cluster: ClusterBy,
    /// Correlation ρ of the error between clusters, 0 to 1: what repeats from flight to flight and no resampling can see (soft tissue that follows
    /// the same joint angles, joint centres beside their place). Variances grow by 1 + (clusters − 1) ρ. Zero for rigid objects; 0.1 to 0.2 made
    /// intervals cover the truth on simulated people with 3 mm of soft tissue.
    pub repeat_correlation: f64,
    /// Bootstrap draws (0 for none).
    pub bootstrap: usize,
    /// Seed of the draws.
    pub seed: u64,
    /// Weights of the prior that are tried when none is given.
    pub weights: Vec<f64>,
    /// Weight of the divergence that keeps links consistent.
    pub divergence_weight: f64,
    /// Limits of the gate.
    pub gate: GateLimits,
}

impl Default for IdentifyOptions {
    /// Mass-constrained least squares, clusters are stretches, no bootstrap; weights of a prior are chosen among 1, 3 and 10.
    fn default() -> Self {
        Self {
            estimator: Estimator::MassConstrained,
            cluster: ClusterBy::Stretch,
            repeat_correlation: 0.0,
            bootstrap: 0,
            seed: 1,
            weights: vec![1.0, 3.0, 10.0],
            divergence_weight: 0.3,
            gate: GateLimits::default(),
        }
    }
}

/// Identifies parameters from the factors of all stretches.
///
/// [`Estimator::NullVector`] uses flights alone and leaves contact stretches out; the others use both.
/// `prior` is needed for [`Estimator::Regularised`] and for consistent links; with another estimator it stands beside the results only
/// (and shapes the links).
///
/// # Errors
/// [`IdentifyError::Regressor`] when factors cannot be merged, [`IdentifyError::TooFew`] when the rows are too few for the estimator,
/// [`IdentifyError::Option`] for an estimator without the prior that it needs.
pub fn identify(
    model: &Model,
    base: &BaseParameters,
    factors: &[Factor],
    mass_kg: f64,
    prior: Option<&LinkPrior>,
    options: &IdentifyOptions,
) -> Result<Identification, IdentifyError> {
    identify_merged(model, base, factors, None, mass_kg, prior, options)
}

/// As [`identify`], with the flights among `factors` merged already, for example by many machines in a tree. It is used where no
/// contact stretch has to be weighed against them; uncertainty comes from the factors one by one in any case.
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
    let base_prior = prior.map(|p| p.base(base)).transpose()?;
    // coefficients that the rows do not determine stay out of every elimination
    let visible = match options.estimator {
        Estimator::NullVector(_) => Visible::default(),
        Estimator::MassConstrained => Visible::among(factors, false)?,
        Estimator::Regularised { .. } => Visible::among(factors, base_prior.is_some())?,
    };
    let reduced = visible.reduce_all(factors)?;
    let factors = reduced.as_slice();
    let flights = flights.map(|f| visible.reduce(f)).transpose()?;
    let (factors, balance) = match options.estimator {
        // a null vector exists where nothing acts: contact, whose rows have a right side, is left out
        Estimator::NullVector(_) => {
            (factors.iter().filter(|f| f.kind != StretchKind::Contact).cloned().collect(), None)
        }
        Estimator::MassConstrained => balanced(factors, mass_kg, None)?,
        Estimator::Regularised { .. } => balanced(factors, mass_kg, base_prior.as_ref())?,
    };
    let factors = factors.as_slice();
    // the same rows, or it is not their merger
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
    let (groups, cluster_names) = options.cluster.groups(factors);
    let clusters = merge_groups(factors, &groups)?;
    let fit = match options.estimator {
        Estimator::NullVector(scaling) => Fit::null_vector(factors, &groups, &merged, mass_kg, scaling)?,
        Estimator::MassConstrained => Fit::least_squares(&clusters, &merged, mass_kg, None, 0.0, Vec::new(), options)?,
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
            Fit::least_squares(&clusters, &merged, mass_kg, Some(prior), lambda, tried, options)?
        }
    };
    let rows = merged.rows;
    let sigma = flight_sigma(factors)?;
    let base_estimates = fit.base_estimates(base, base_prior.as_ref(), mass_kg);
    let links = match prior {
        Some(prior) => fit.links(model, base, &merged, mass_kg, prior, options)?,
        None => Vec::new(),
    };
    let named: Vec<(String, Seen)> = base_estimates.iter().map(|b| (b.name.clone(), b.seen)).collect();
    let hints = advice::in_words(model, &named);
    let information = match base_prior.as_ref() {
        Some(prior) => Some(fit.information(&clusters, mass_kg, prior, &named, options)?),
        None => None,
    };
    let gate = judge(
        &options.estimator,
        &sigma,
        information.as_ref(),
        &named,
        factors.len(),
        fit.deficient,
        &options.gate,
        hints,
    );
    let effects = visible.estimates(fit.effect_estimates(&merged));
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
        information,
        gate,
        n_stretches: factors.len(),
        n_trials: trials.len(),
        n_rows: merged.n_rows,
        row_rms: (merged.sum_of_squares(&fit.padded(merged.n_effects())) / merged.n_rows.max(1) as f64).sqrt(),
        row_sd: fit.row_sd,
        prior_weight: fit.prior_weight,
        weights_tried: fit.tried.clone(),
        cluster: options.cluster,
        contact: balance,
        se_from: fit.se_from(cluster_names.len()),
    };
    let draws = fit.draws.into_iter().map(|d| visible.whole(d)).collect();
    Ok(Identification { parameters, covariance: visible.whole_covariance(fit.covariance), draws })
}

/// σ's of the flights' parameter columns; NaN without flights.
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
    /// Quantile of Student's t for 95 % intervals.
    quantile: f64,
    row_sd: f64,
    /// By how much clusters vary more than independent rows would.
    inflation: f64,
    prior_weight: f64,
    tried: Vec<crate::WeightTrial>,
    deficient: usize,
    draws: Vec<DVector<f64>>,
    robust: bool,
}

/// Fewest clusters for which standard errors are taken from the spread among them.
const MIN_CLUSTERS: usize = 5;

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
            leave_group_out(factors, groups, |_, rest| null_vector(rest, mass_kg, scaling).ok())?
                .into_iter()
                .flatten()
                .map(|v| v.parameters)
                .collect()
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
            quantile: t_quantile(left.len().saturating_sub(1)),
            row_sd: row_variance.sqrt(),
            inflation: 1.0,
            prior_weight: 0.0,
            tried: Vec::new(),
            deficient: 0,
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
        options: &IdentifyOptions,
    ) -> Result<Self, IdentifyError> {
        let system = System::new(merged, mass_kg, prior)?;
        let row_variance = system.row_variance();
        let weight = lambda * row_variance;
        let solution = system.solve(weight);
        if !(0.0..=1.0).contains(&options.repeat_correlation) {
            return Err(IdentifyError::Option {
                option: "repeat_correlation",
                problem: format!("{} is not within 0 to 1", options.repeat_correlation),
            });
        }
        let repeats = 1.0 + (clusters.len() as f64 - 1.0) * options.repeat_correlation;
        let model = system.covariance(repeats * row_variance, weight);
        let resampled = Clusters::new(clusters, merged, mass_kg, prior, weight, &solution.x)?;
        let robust = resampled.len() >= MIN_CLUSTERS && solution.deficient == 0;
        // the larger of the two errors counts for each parameter; correlations are those of the rows
        let (covariance, inflation) = if robust {
            let spread = resampled.robust_covariance(weight, repeats);
            let ratio = DVector::from_fn(model.nrows(), |i, _| {
                if model[(i, i)] > 0.0 { (spread[(i, i)] / model[(i, i)]).max(1.0) } else { 1.0 }
            });
            let n = ratio.len().max(2) - 1;
            let inflation = repeats * ratio.rows(1, n).map(f64::ln).mean().exp();
            let scale = DMatrix::from_diagonal(&ratio.map(f64::sqrt));
            (&scale * model * &scale, inflation)
        } else {
            (model, repeats)
        };
        let draws = if options.bootstrap > 0 && resampled.len() >= 2 {
            resampled.bootstrap(options.bootstrap, options.seed)
        } else {
            Vec::new()
        };
        let freedom = match (robust, prior) {
            (true, _) => resampled.len() - 1,
            // a prior makes intervals those of a normal distribution
            (false, Some(_)) => usize::MAX,
            (false, None) => system.n_rows().saturating_sub(solution.effective_parameters as usize),
        };
        Ok(Self {
            x: solution.x,
            n_parameters: merged.n_parameters(),
            covariance,
            quantile: t_quantile(freedom),
            row_sd: row_variance.sqrt(),
            inflation,
            prior_weight: lambda,
            tried,
            deficient: solution.deficient,
            draws,
            robust,
        })
    }

    fn se_from(&self, n_clusters: usize) -> String {
        if self.robust {
            format!("spread among {n_clusters} clusters, at least the noise of the rows; Student's t")
        } else {
            "noise of the rows alone: too few clusters to see their spread".to_owned()
        }
    }

    fn padded(&self, n_effects: usize) -> DVector<f64> {
        pad(&self.x, (self.n_parameters + n_effects).saturating_sub(self.x.len()))
    }

    /// Percentile interval of the bootstrap where there are draws enough, else Student's t.
    fn interval(&self, i: usize, value: f64, se: f64) -> [f64; 2] {
        if self.draws.len() < 200 {
            return [value - self.quantile * se, value + self.quantile * se];
        }
        let mut values: Vec<f64> = self.draws.iter().map(|d| d[i]).collect();
        values.sort_by(f64::total_cmp);
        let at = |share: f64| values[((values.len() - 1) as f64 * share).round() as usize];
        // never narrower than the noise says
        let half = 1.96 * se;
        [at(0.025).min(value - half), at(0.975).max(value + half)]
    }

    fn base_estimates(&self, base: &BaseParameters, prior: Option<&Prior>, mass_kg: f64) -> Vec<BaseEstimate> {
        // the body's own length: radius of gyration from its largest root inertia
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
                let se = self.covariance[(i, i)].max(0.0).sqrt();
                let scale = match parameter.unit {
                    "kg" => mass_kg,
                    "kg·m" => mass_kg * length,
                    _ => mass_kg * length * length,
                };
                let prior_sd = prior.map(|p| p.covariance[(i, i)].max(0.0).sqrt());
                let seen = if i == 0 { Seen::Well } else { seen(se, prior_sd, scale) };
                BaseEstimate {
                    name: parameter.name.clone(),
                    value: self.x[i],
                    se,
                    ci95: self.interval(i, self.x[i], se),
                    unit: parameter.unit.to_owned(),
                    formula: parameter.formula.clone(),
                    prior: prior.map(|p| p.mean[i]),
                    prior_sd,
                    seen,
                    from: if i == 0 { Origin::Scale } else { Origin::of(seen, self.prior_weight > 0.0) },
                }
            })
            .collect()
    }

    /// What motion added to the prior.
    fn information(
        &self,
        clusters: &[Factor],
        mass_kg: f64,
        prior: &Prior,
        named: &[(String, Seen)],
        options: &IdentifyOptions,
    ) -> Result<Information, IdentifyError> {
        let row_variance = self.row_sd * self.row_sd;
        let weighing = information::Weighing {
            weight: self.prior_weight * row_variance,
            row_variance,
            repeat_correlation: options.repeat_correlation,
        };
        let standing: Vec<Seen> = named.iter().skip(1).map(|n| n.1).collect();
        Ok(Information {
            parameters: information::of_parameters(&standing),
            wrench: information::of_wrench(clusters, mass_kg, prior, weighing)?,
        })
    }

    fn effect_estimates(&self, merged: &Factor) -> Vec<EffectEstimate> {
        let p = self.n_parameters;
        if self.x.len() < p + merged.n_effects() {
            return Vec::new();
        }
        merged
            .columns
            .effects
            .iter()
            .enumerate()
            .map(|(k, name)| {
                let (value, se) = (self.x[p + k], self.covariance[(p + k, p + k)].max(0.0).sqrt());
                EffectEstimate {
                    name: name.clone(),
                    value,
                    se,
                    ci95: self.interval(p + k, value, se),
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
        options: &IdentifyOptions,
    ) -> Result<Vec<LinkEstimate>, IdentifyError> {
        let consistent = consistent_links(
            merged,
            base,
            mass_kg,
            prior,
            &LinkOptions {
                row_variance: (self.row_sd * self.row_sd).max(f64::MIN_POSITIVE),
                prior_weight: if self.prior_weight > 0.0 { self.prior_weight } else { 1.0 },
                divergence_weight: options.divergence_weight,
            },
        )?;
        let covariance = consistent.covariance * self.inflation;
        Ok(consistent
            .phi
            .iter()
            .enumerate()
            .map(|(j, phi)| {
                let block: SMatrix<f64, 10, 10> = covariance.fixed_view::<10, 10>(10 * j, 10 * j).into();
                let before: SMatrix<f64, 10, 10> = prior.covariance.fixed_view::<10, 10>(10 * j, 10 * j).into();
                link_estimate(&model.links[j].name, phi, &block, &prior.links[j], &before)
            })
            .collect())
    }
}

fn pad(x: &DVector<f64>, zeros: usize) -> DVector<f64> {
    x.clone().resize_vertically(x.len() + zeros, 0.0)
}

fn link_estimate(
    name: &str,
    phi: &Phi,
    covariance: &SMatrix<f64, 10, 10>,
    prior: &aloft_body::LinkInertia,
    prior_covariance: &SMatrix<f64, 10, 10>,
) -> LinkEstimate {
    let (link, sd) = link_with_sd(phi, covariance);
    let (_, before) = link_with_sd(&prior.to_phi(), prior_covariance);
    let mass = seen(sd.mass_kg, Some(before.mass_kg), 1.0);
    let com = seen(sd.com_m.norm(), Some(before.com_m.norm()), 1.0);
    let size = |s: &[f64; 6]| s[..3].iter().map(|x| x * x).sum::<f64>().sqrt();
    let inertia = seen(size(&sd.inertia_kgm2), Some(size(&before.inertia_kgm2)), 1.0);
    let word = |s: Seen| match s {
        Seen::Well => "well seen",
        Seen::Partly => "partly seen",
        Seen::Hardly => Origin::Table.words(),
    };
    // links are drawn to the table by every estimator
    let from = LinkOrigin {
        mass_kg: Origin::of(mass, true),
        com_m: Origin::of(com, true),
        inertia_kgm2: Origin::of(inertia, true),
    };
    let words = format!(
        "mass {:.3} ± {:.3} kg ({}), centre of mass ± {:.0} mm ({}), inertia ({})",
        link.mass_kg,
        sd.mass_kg,
        word(mass),
        1000.0 * sd.com_m.norm(),
        word(com),
        word(inertia)
    );
    LinkEstimate {
        name: name.to_owned(),
        mass_kg: link.mass_kg,
        com_m: link.com_m.into(),
        inertia_kgm2: std::array::from_fn(|i| std::array::from_fn(|j| link.inertia_com_kgm2[(i, j)])),
        sd,
        prior: *prior,
        seen: mass.min(com).min(inertia),
        from,
        words,
    }
}

/// 97.5 % quantile of Student's t (Cornish-Fisher expansion, exact for one and two degrees).
pub(crate) fn t_quantile(freedom: usize) -> f64 {
    const Z: f64 = 1.959_963_984_540_054;
    match freedom {
        0 => f64::INFINITY,
        1 => 12.706_204_736,
        2 => 4.302_652_730,
        n => {
            let n = n as f64;
            let (z3, z5, z7) = (Z.powi(3), Z.powi(5), Z.powi(7));
            Z + (z3 + Z) / (4.0 * n)
                + (5.0 * z5 + 16.0 * z3 + 3.0 * Z) / (96.0 * n * n)
                + (3.0 * z7 + 19.0 * z5 + 17.0 * z3 - 15.0 * Z) / (384.0 * n * n * n)
        }
    }
}
