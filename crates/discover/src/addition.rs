//! Adds one effect to a model and reports the change in held-out error, from a session's
//! rows.
//!
//! The effect's columns at its given nonlinear parameters join the model; nothing is searched and
//! no frame is processed again. The parameters are refitted with and without these columns, and
//! every trial (or flight) is predicted from the others. An effect of the air is judged in flight,
//! one of the plates in contact. An effect that acts in both is judged in flight, where no other
//! force acts, and its contact error is reported as well.

use crate::DiscoverError;
use crate::candidate::{Scored, Variant, score};
use crate::ladder::{estimates, extra_columns, key_of, sharpened};
use crate::nonlinear::joint_se_at;
use crate::options::DiscoverOptions;
use crate::problem::{Domain, Problem};
use crate::repeating::widen;
use crate::result::Addition;
use crate::session::Session;
use crate::statistics::{jackknife_se, ratio_interval, resamples};
use crate::wording;
use aloft_effects::EffectInstance;
use aloft_regressor::StretchKind;
use nalgebra::{DMatrix, DVector};

/// Held-out error before and after one effect joins the model that already holds `accepted`, at the
/// given values of its nonlinear parameters.
///
/// # Errors
/// [`DiscoverError::TooFew`] with fewer than two flights (or contact stretches) on which the effect
/// could be judged, [`DiscoverError::Numeric`] when its columns cannot be formed or are all zero.
pub fn addition(
    session: &Session<'_>,
    accepted: &[EffectInstance<'_>],
    choice: &EffectInstance<'_>,
    options: &DiscoverOptions,
) -> Result<Addition, DiscoverError> {
    let domain = domain_of(session, choice);
    let extra = extra_columns(session, domain, accepted, &[], &[]);
    let problem = Problem::new(session, domain, &extra, options.fewest_trials, options.prior_weight)?;
    let blocks = columns_of(session, choice, domain)?;
    let mut variant = Variant::new(session, choice.effect, choice.target, choice.nonlinear.clone());
    variant.group = session.trials.iter().map(|t| choice.acts_in(t)).collect();
    // with the effect in the model the residual is smaller, so the prior weighs less
    let whole: Vec<Vec<DMatrix<f64>>> = extra.iter().cloned().chain([blocks.clone()]).collect();
    let sharp = sharpened(session, &problem, &extra, &whole, options)?;
    let mut scored: Scored<'_> = score(&sharp, variant, &sharp.reduce(&sharp.gather(&blocks)));
    scored.joint_se = joint_se_at(session, &sharp, &scored.variant);
    let mut coefficients = estimates(session, &scored).0;
    widen(session, domain, &extra, &whole, &scored.variant, (&mut coefficients, &mut []), &|_| None, options);
    let plain: Vec<f64> = problem.folds.iter().map(|f| f.error).collect();
    let weights = resamples(plain.len(), options.resamples, options.seed ^ 0x5eed);
    let in_newton = |square: f64| (square / problem.n_judged as f64).sqrt() * session.unit[0];
    let (before, after) = (plain.iter().sum::<f64>(), scored.fold_error.iter().sum::<f64>());
    Ok(Addition {
        key: key_of(session, &scored),
        judged_on: wording::domain(domain).to_owned(),
        held_out_error_before: in_newton(before),
        held_out_error: in_newton(after),
        ratio: (after / before).sqrt(),
        ci95: ratio_interval(&scored.fold_error, &plain, &weights),
        coefficients,
        trials: choice.trials.clone(),
        left_of_error: None,
    })
}

/// Ladder of a model: adds the effects in order, each to those before it and judged on the windows
/// where it acts.
///
/// # Errors
/// As [`addition`].
pub fn ladder(
    session: &Session<'_>,
    effects: &[EffectInstance<'_>],
    options: &DiscoverOptions,
) -> Result<Vec<Addition>, DiscoverError> {
    (0..effects.len()).map(|i| addition(session, &effects[..i], &effects[i], options)).collect()
}

/// Multiple of `coefficients` of an effect that would be detected in four of five sessions like
/// this one, computed before anything is fitted: the size at which the held-out error without the
/// effect exceeds that with it by the acceptance limit, plus 0.84 standard errors.
///
/// # Errors
/// As [`addition`], and [`DiscoverError::Length`] if the number of coefficients differs from that
/// of the effect.
pub fn detectable(
    session: &Session<'_>,
    accepted: &[EffectInstance<'_>],
    choice: &EffectInstance<'_>,
    coefficients: &[f64],
    options: &DiscoverOptions,
) -> Result<f64, DiscoverError> {
    let domain = domain_of(session, choice);
    let extra = extra_columns(session, domain, accepted, &[], &[]);
    let problem = Problem::new(session, domain, &extra, options.fewest_trials, options.prior_weight)?;
    let blocks = columns_of(session, choice, domain)?;
    let expected = blocks[0].ncols();
    if coefficients.len() != expected {
        return Err(DiscoverError::Length { what: "coefficients", expected, found: coefficients.len() });
    }
    let theta = DVector::from_column_slice(coefficients);
    let signal: Vec<DMatrix<f64>> = problem
        .gather(&blocks)
        .iter()
        .map(|c| {
            let s = c * &theta;
            DMatrix::from_column_slice(s.len(), 1, s.as_slice())
        })
        .collect();
    let reduced = problem.reduce(&signal);
    let energy = reduced.s[(0, 0)];
    if !(energy.is_finite() && energy > 0.0) {
        return Ok(f64::INFINITY);
    }
    let threshold = options.largest_ratio(problem.clusters.len());
    let size = (problem.n_judged as f64 * problem.plain() * (threshold.powi(-2) - 1.0) / energy).sqrt();
    let se = jackknife_se(&reduced.folds.iter().map(|f| f.c[0] / f.s[(0, 0)]).collect::<Vec<_>>());
    Ok(size + 0.84 * if se.is_finite() { se.min(size) } else { 0.0 })
}

/// Flight where the effect acts there and there are flights, contact otherwise.
fn domain_of(session: &Session<'_>, choice: &EffectInstance<'_>) -> Domain {
    let flights = session.blocks.iter().any(|b| b.kind != StretchKind::Contact);
    if flights && choice.effect.acts().in_flight() { Domain::Flight } else { Domain::Contact }
}

/// Columns by block, finite and not all zero.
fn columns_of(
    session: &Session<'_>,
    choice: &EffectInstance<'_>,
    domain: Domain,
) -> Result<Vec<DMatrix<f64>>, DiscoverError> {
    let nothing = |what: &str| DiscoverError::Numeric(format!("`{}` {what}", choice.key(session.scene)));
    let blocks = session.columns_of(choice, domain).ok_or_else(|| nothing("has no columns in these rows"))?;
    if blocks.iter().any(|b| b.iter().any(|x| !x.is_finite())) {
        return Err(nothing("has columns that are not finite"));
    }
    if blocks.iter().all(|b| b.norm_squared() == 0.0) {
        return Err(nothing("has no effect on these recordings"));
    }
    Ok(blocks)
}
