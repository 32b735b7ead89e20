//! The effects that stand beside each other for the verdict, fitted on equal terms.

use crate::candidate::{Scored, Variant, score};
use crate::ladder::sharpened;
use crate::limits::limit;
use crate::nonlinear::{FULL_STEPS, improve, score_fitted, with_joint_errors};
use crate::options::DiscoverOptions;
use crate::problem::Problem;
use crate::rank::EffectScore;
use crate::result::Candidate;
use crate::session::Session;
use aloft_effects::{Effect, ParameterKind, Target};
use nalgebra::DMatrix;
use rayon::prelude::*;

/// An effect that narrowly misses acceptance takes part if the best one leaves more than this share
/// of its error.
const NEARLY: f64 = 0.94;
/// Number of targets of a rival that are fitted again.
const TARGETS: usize = 3;

/// Ratio of held-out errors (mean square) up to which two links carry an effect equally well.
const ALIKE: f64 = 1.02;

/// Distance of the point on which a variant acts from the centre of mass of its link, m; zero for
/// one without a point.
fn away_from_middle(session: &Session<'_>, variant: &Variant<'_>) -> f64 {
    let parameters = variant.effect.nonlinear(session.scene, variant.target);
    let on_link =
        parameters.iter().zip(&variant.nonlinear).filter(|(q, _)| matches!(q.kind, ParameterKind::PointOnLink(_)));
    on_link.map(|(q, p)| (p - 0.5 * (q.lower + q.upper)).powi(2)).sum::<f64>().sqrt()
}

/// An accepted effect, refitted with the weight that the prior has when the best effect is in the
/// model.
pub(crate) struct Rival<'a> {
    /// Index in the ranking.
    pub index: usize,
    /// False if it narrowly missed the acceptance limit: it may be named together with others, but
    /// cannot rule one out.
    pub believed: bool,
    /// True if, in flights of a person, it leaves no more than a complete model would.
    pub at_floor: bool,
    pub scored: Scored<'a>,
    /// Squared error by fold.
    pub fold_error: Vec<f64>,
}

impl Rival<'_> {
    pub fn id(&self) -> &str {
        self.scored.variant.effect.id()
    }
    pub fn error(&self) -> f64 {
        self.fold_error.iter().sum()
    }
}

/// True for two effects that no recording can tell apart: aliases that both act on the whole body
/// or on all plates.
pub(crate) fn is_alias(effect: &dyn Effect, target: Target, other: &str, other_target: Target) -> bool {
    effect.about().aliases.contains(&other) && target == Target::Body && other_target == Target::Body
}

/// True for an effect that narrowly misses the limit that the best one passes, so that only the
/// limit separates them. Plate and kinematic errors have limits of their own.
fn close(effect: &dyn Effect, candidate: &Candidate, best: &Candidate, options: &DiscoverOptions) -> bool {
    if is_alias(effect, candidate.target, &best.effect, best.target) && candidate.plausible {
        return true;
    }
    candidate.plausible
        && !candidate.placebo
        && candidate.ci95[1] < 1.0
        && limit(effect, false, options) == options.belief
        && (best.held_out_ratio..best.held_out_ratio / NEARLY).contains(&candidate.held_out_ratio)
}

/// The accepted effects and those that narrowly miss acceptance, as rivals, and the problem on
/// which they were fitted.
pub(crate) fn rivals<'a>(
    session: &Session<'_>,
    problem: &Problem,
    extra: &[Vec<DMatrix<f64>>],
    scores: &[EffectScore<'a>],
    candidates: &[Candidate],
    options: &DiscoverOptions,
) -> (Option<Problem>, Vec<Rival<'a>>) {
    let Some(best) = candidates.iter().find(|c| c.believed) else { return (None, Vec::new()) };
    let takes_part = |i: &usize| candidates[*i].believed || close(scores[*i].effect, &candidates[*i], best, options);
    let believed: Vec<usize> = (0..candidates.len()).filter(takes_part).collect();
    let as_ranked = |&index: &usize| {
        let s = &scores[index];
        let believed = candidates[index].believed;
        Rival { index, believed, at_floor: false, scored: s.scored[s.best].clone(), fold_error: s.fold_error.clone() }
    };
    let first = candidates.iter().position(|c| c.believed).filter(|_| session.prior.is_some());
    let sharp = first.and_then(|first| {
        let best = &scores[first].scored[scores[first].best].variant;
        let columns = best.blocks_at(session, problem, &best.nonlinear)?;
        let whole: Vec<Vec<DMatrix<f64>>> = extra.iter().cloned().chain([columns]).collect();
        session.or_named(sharpened(session, problem, extra, &whole, options))
    });
    let Some(sharp) = sharp else { return (None, believed.iter().map(as_ranked).collect()) };
    let refitted = believed.par_iter().map(|index| {
        let mut variants: Vec<&Scored<'a>> = scores[*index].scored.iter().collect();
        variants.sort_by(|a, b| b.gain.total_cmp(&a.gain));
        let fitted = variants.iter().take(TARGETS).filter_map(|s| {
            let v = &s.variant;
            if v.fitted == 0 {
                let columns = v.columns(session, &sharp)?;
                let scored = score(&sharp, v.clone(), &sharp.reduce(&columns));
                return Some(with_joint_errors(session, &sharp, scored));
            }
            improve(session, &sharp, v, FULL_STEPS).and_then(|(v, _)| score_fitted(session, &sharp, v))
        });
        let unknowns = |s: &Scored<'_>| s.variant.unknowns();
        let error = |s: &Scored<'_>| s.fold_error.iter().sum::<f64>();
        let fitted: Vec<Scored<'a>> = fitted.collect();
        let order =
            |a: &&Scored<'_>, b: &&Scored<'_>| error(a).total_cmp(&error(b)).then(unknowns(a).cmp(&unknowns(b)));
        let best = fitted.iter().min_by(order).map(|least| {
            // a force at a joint acts on either link: the one whose middle is nearer to it
            let alike = |s: &&Scored<'_>| unknowns(s) == unknowns(least) && error(s) <= ALIKE * error(least);
            let away = |s: &Scored<'_>| away_from_middle(session, &s.variant);
            let nearest = fitted.iter().filter(alike).min_by(|a, b| away(a).total_cmp(&away(b)));
            nearest.unwrap_or(least).clone()
        });
        best.map_or_else(
            || as_ranked(index),
            |scored| Rival {
                index: *index,
                believed: candidates[*index].believed,
                at_floor: false,
                fold_error: scored.fold_error.clone(),
                scored,
            },
        )
    });
    let refitted = refitted.collect();
    (Some(sharp), refitted)
}
