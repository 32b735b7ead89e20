//! The growing model: columns of the effects found, and their estimates.

use crate::DiscoverError;
use crate::candidate::{Scored, Variant};
use crate::options::DiscoverOptions;
use crate::problem::{Domain, Problem};
use crate::result::{Estimate, Found};
use crate::session::Session;
use crate::statistics::jackknife_se;
use aloft_effects::EffectInstance;
use nalgebra::{DMatrix, DVector};

/// Columns of effects in the model, by block; for nonlinear ones found in an earlier round also the
/// derivatives with respect to their parameters, so that a small error in these is not mistaken for
/// another effect.
pub(crate) fn extra_columns(
    session: &Session<'_>,
    domain: Domain,
    accepted: &[EffectInstance<'_>],
    kept: &[Variant<'_>],
    found: &[Found],
) -> Vec<Vec<DMatrix<f64>>> {
    let mut out: Vec<Vec<DMatrix<f64>>> = accepted.iter().filter_map(|c| session.columns_of(c, domain)).collect();
    for (i, v) in kept.iter().enumerate() {
        let at = |p: &[f64]| {
            session.columns(v.effect, v.target, p, domain).map(|mut columns| {
                if !v.group.is_empty() {
                    for (block, c) in session.blocks.iter().zip(&mut columns) {
                        if !v.group[block.trial] {
                            c.fill(0.0);
                        }
                    }
                }
                columns
            })
        };
        let Some(columns) = at(&v.nonlinear) else { continue };
        if let Some(found) = found.get(i) {
            let theta = DVector::from_iterator(columns[0].ncols(), found.coefficients.iter().map(|e| e.value));
            for (k, q) in v.effect.nonlinear(session.scene, v.target).iter().enumerate() {
                let mut p = v.nonlinear.clone();
                let h = if p[k] + 0.02 * q.scale > q.upper { -0.02 * q.scale } else { 0.02 * q.scale };
                p[k] += h;
                if let Some(moved) = at(&p) {
                    let of = |(a, b): (&DMatrix<f64>, &DMatrix<f64>)| {
                        let slope: DVector<f64> = (a - b) * &theta / h;
                        DMatrix::from_column_slice(slope.len(), 1, slope.as_slice())
                    };
                    out.push(moved.iter().zip(&columns).map(of).collect());
                }
            }
        }
        out.push(columns);
    }
    // an effect with all-zero columns would make the rows singular
    out.retain(|e| e.iter().any(|m| m.norm_squared() > 0.0));
    out
}

/// The problem with the prior weighted by the residual left when the columns `whole` (those of
/// `extra` and one or more effects) are in the model. A missing effect makes rows look noisy, which
/// gives the prior too much weight; rivals are compared without that bias.
pub(crate) fn sharpened(
    session: &Session<'_>,
    problem: &Problem,
    extra: &[Vec<DMatrix<f64>>],
    whole: &[Vec<DMatrix<f64>>],
    options: &DiscoverOptions,
) -> Result<Problem, DiscoverError> {
    let new = |columns: &[Vec<DMatrix<f64>>], variance| {
        let (fewest, weight) = (options.fewest_trials, options.prior_weight);
        Problem::with_variance(session, problem.domain, columns, fewest, weight, variance)
    };
    let variance = if session.prior.is_some() { new(whole, None)?.variance } else { problem.variance };
    new(extra, Some(variance))
}

/// True for a value at one of its bounds, within rounding.
pub(crate) fn is_at_bound(value: f64, bounds: [f64; 2]) -> bool {
    let near = |b: f64| b.is_finite() && (value - b).abs() <= 1e-9 * b.abs().max(f64::MIN_POSITIVE);
    bounds.into_iter().any(near)
}

/// Coefficients and nonlinear parameters with standard errors: those of the jackknife or, where
/// parameters were fitted, the larger of these and those of the joint fit. A fold takes one damped
/// step, which does not follow directions in which two unknowns compensate each other (such as the
/// distance of an anchor and the rest length of its tether).
pub(crate) fn estimates(session: &Session<'_>, scored: &Scored<'_>) -> (Vec<Estimate>, Vec<Estimate>) {
    let joint = |i: usize| scored.joint_se.get(i).copied();
    let larger = |jackknife: f64, joint: Option<f64>| match joint {
        Some(joint) if joint > jackknife => joint,
        _ => jackknife,
    };
    let freedom = |i: usize| scored.freedom.get(i).copied().unwrap_or((scored.fold_theta.len() as f64 - 1.0).max(1.0));
    let estimate = |name: &str, value: f64, unit: &str, bounds: [f64; 2], widening: f64| Estimate {
        name: name.to_owned(),
        value,
        se: f64::NAN,
        ci95: None,
        freedom: f64::NAN,
        at_bound: is_at_bound(value, bounds),
        widening,
        unit: unit.to_owned(),
    };
    let coefficients = scored
        .variant
        .coefficients
        .iter()
        .enumerate()
        .map(|(k, c)| {
            let jackknife = jackknife_se(&scored.fold_theta.iter().map(|t| t[k]).collect::<Vec<_>>());
            let se = larger(jackknife, joint(k));
            // the model's own error is that over recordings
            let grows = if jackknife > 0.0 && se.is_finite() { se / jackknife } else { 1.0 };
            let widening = scored.widening.get(k).copied().unwrap_or(1.0).max(grows);
            estimate(&c.name, scored.theta[k], &c.unit, [c.lower, c.upper], widening).with_error(se, freedom(k))
        })
        .collect();
    let nonlinear = scored
        .variant
        .effect
        .nonlinear(session.scene, scored.variant.target)
        .iter()
        .enumerate()
        .map(|(k, p)| {
            let at = scored.theta.len() + k;
            let jackknife = jackknife_se(&scored.fold_nonlinear.iter().map(|t| t[k]).collect::<Vec<_>>());
            estimate(&p.name, scored.variant.nonlinear[k], &p.unit, [p.lower, p.upper], 1.0)
                .with_error(larger(jackknife, joint(at)), freedom(at))
        })
        .collect();
    (coefficients, nonlinear)
}

pub(crate) fn group_names(session: &Session<'_>, scored: &Scored<'_>) -> Vec<String> {
    let mask = &scored.variant.group;
    session.trials.iter().zip(mask).filter(|(_, m)| **m).map(|(t, _)| t.clone()).collect()
}

pub(crate) fn key_of(session: &Session<'_>, scored: &Scored<'_>) -> String {
    let v = &scored.variant;
    EffectInstance { effect: v.effect, target: v.target, nonlinear: Vec::new(), trials: Vec::new() }.key(session.scene)
}

pub(crate) fn as_found(session: &Session<'_>, scored: &Scored<'_>) -> Found {
    let (coefficients, nonlinear) = estimates(session, scored);
    Found {
        effect: scored.variant.effect.id().to_owned(),
        key: key_of(session, scored),
        target: scored.variant.target,
        nonlinear,
        coefficients,
        trials: group_names(session, scored),
        also_on: Vec::new(),
        sized_with_contact: false,
    }
}
