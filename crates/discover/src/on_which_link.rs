//! On which links an effect that was found may act.
//!
//! A load or force near a joint acts on either of the joint's links nearly alike, and a load on a
//! light link moves much as one on its neighbour. The name of the effect can be certain where its
//! link is not. Each effect found on a link is therefore fitted again on every other link, beside
//! the other effects; links that leave hardly more error are named.
//!
//! A load may also be two equal ones, on both thighs or both forearms: together they move much as
//! one between them. What is carried is therefore tried on each pair of mirrored links, too, with
//! mirrored places, so that a pair has as many unknowns as a single load. Where several loads were
//! found, they are on their links already.

use crate::candidate::{Variant, solve};
use crate::ladder::extra_columns;
use crate::limits::SAME;
use crate::nonlinear::fitted;
use crate::options::DiscoverOptions;
use crate::problem::{Domain, Problem};
use crate::result::Found;
use crate::session::Session;
use crate::statistics::sign_flip_p;
use aloft_body::Phi;
use aloft_effects::{
    About, Coefficient, Columns, Effect, EffectInstance, NonlinearParameter, ParameterKind, Scene, Series, Target,
};
use aloft_identify::Symmetry;
use rayon::prelude::*;

/// Error on the link found over that on another, below which the other is not considered whatever
/// the sign test says.
const WORSE: f64 = 0.9;

/// What is carried on a link, half on it and half on the mirrored one, at mirrored places.
struct OnBoth<'a> {
    effect: &'a dyn Effect,
    /// Index of the mirrored link.
    mirrored: usize,
    /// Axis of the links perpendicular to the plane of symmetry.
    axis: usize,
}

impl Effect for OnBoth<'_> {
    fn about(&self) -> About<'_> {
        self.effect.about()
    }
    fn targets(&self, scene: &Scene) -> Vec<Target> {
        self.effect.targets(scene)
    }
    fn coefficients(&self, scene: &Scene, target: Target) -> Vec<Coefficient> {
        self.effect.coefficients(scene, target)
    }
    fn nonlinear(&self, scene: &Scene, target: Target) -> Vec<NonlinearParameter> {
        self.effect.nonlinear(scene, target)
    }
    fn starts(&self, scene: &Scene, target: Target) -> Vec<Vec<f64>> {
        self.effect.starts(scene, target)
    }
    fn has_wrench(&self) -> bool {
        false
    }
    fn evaluate(&self, _: &Series<'_>, _: Target, _: &[f64], _: &mut Columns) {}
    fn inertia(&self, scene: &Scene, target: Target, nonlinear: &[f64]) -> Option<Vec<Vec<Phi>>> {
        let kinds = self.effect.nonlinear(scene, target);
        let across = |(p, x): (&NonlinearParameter, &f64)| match p.kind {
            ParameterKind::PointOnLink(axis) | ParameterKind::VectorOnLink(axis) if axis == self.axis => -x,
            _ => *x,
        };
        let mirrored: Vec<f64> = kinds.iter().zip(nonlinear).map(across).collect();
        let mut here = self.effect.inertia(scene, target, nonlinear)?;
        let there = self.effect.inertia(scene, Target::Link(self.mirrored), &mirrored)?;
        for (a, b) in here.iter_mut().flatten().zip(there.iter().flatten()) {
            *a = (*a + b) / 2.0;
        }
        Some(here)
    }
}

/// Sets [`Found::also_on`] of every effect that was found on a link.
pub(crate) fn name_other_links(
    session: &Session<'_>,
    accepted: &[EffectInstance<'_>],
    kept: &[Variant<'_>],
    found: &mut [Found],
    options: &DiscoverOptions,
) {
    for (i, f) in found.iter_mut().enumerate() {
        f.also_on = other_links(session, accepted, kept, i, options).unwrap_or_default();
    }
}

/// Names of the links on which effect `i` explains as much as on its own; none if it has no link.
fn other_links(
    session: &Session<'_>,
    accepted: &[EffectInstance<'_>],
    kept: &[Variant<'_>],
    i: usize,
    options: &DiscoverOptions,
) -> Option<Vec<String>> {
    let own = &kept[i];
    let Target::Link(_) = own.target else { return None };
    let mut others = kept.to_vec();
    others.remove(i);
    let domain = if own.effect.acts().in_flight() { Domain::Flight } else { Domain::Contact };
    let extra = extra_columns(session, domain, accepted, &others, &[]);
    let problem = Problem::if_possible(session, domain, &extra, options)?;
    let in_model = accepted.iter().map(|c| (c.effect.id(), c.target));
    let taken: Vec<(&str, Target)> = in_model.chain(others.iter().map(|v| (v.effect.id(), v.target))).collect();
    let here = fitted(session, &problem, own)?;
    let is_free = |t: &Target| !taken.contains(&(own.effect.id(), *t));
    let on = |effect: &dyn Effect, t: Target| -> Option<Vec<f64>> {
        let variant = at_best_start(session, &problem, Variant { effect, ..own.clone() }, t)?;
        Some(fitted(session, &problem, &variant)?.fold_error)
    };
    let targets = own.effect.targets(session.scene);
    let single = targets.iter().filter(|t| matches!(t, Target::Link(_)) && **t != own.target && is_free(t));
    let mut tried: Vec<(String, Option<Vec<f64>>)> =
        single.collect::<Vec<_>>().into_par_iter().map(|t| (t.label(session.scene), on(own.effect, *t))).collect();
    let alone = others.iter().all(|v| v.effect.id() != own.effect.id());
    if alone
        && !own.effect.has_wrench()
        && let Some(of) = Symmetry::from_names(&session.scene.model)
    {
        let pairs: Vec<[usize; 2]> = of.pairs.iter().map(|&(a, b)| [a, b]).collect();
        let both = |pair: &[usize; 2]| {
            let [link, mirrored] = *pair;
            let label = |i: usize| Target::Link(i).label(session.scene);
            let together = OnBoth { effect: own.effect, mirrored, axis: of.axis };
            (format!("{} and {}", label(link), label(mirrored)), on(&together, Target::Link(link)))
        };
        let free = pairs.par_iter().filter(|pair| pair.iter().all(|i| is_free(&Target::Link(*i))));
        tried.par_extend(free.map(both));
    }
    let sum = |errors: &[f64]| errors.iter().sum::<f64>();
    let same = SAME[usize::from(session.prior.is_some())];
    let as_good = |errors: &[f64]| {
        let ratio = (sum(&here.fold_error) / sum(errors)).sqrt();
        let p = || sign_flip_p(&here.fold_error, errors, 2000, options.seed ^ 0x11a4);
        ratio > same || (ratio > WORSE && p() >= options.significance)
    };
    let mut named: Vec<(f64, String)> = tried
        .into_iter()
        .filter_map(|(name, errors)| Some((name, errors?)))
        .filter(|(_, errors)| as_good(errors))
        .map(|(name, errors)| (sum(&errors), name))
        .collect();
    named.sort_by(|a, b| a.0.total_cmp(&b.0));
    Some(named.into_iter().map(|(_, name)| name).collect())
}

/// The effect on another link, at that of its starting values that gains most.
fn at_best_start<'a>(
    session: &Session<'_>,
    problem: &Problem,
    own: Variant<'a>,
    target: Target,
) -> Option<Variant<'a>> {
    let starts = own.effect.starts(session.scene, target);
    let with_gain = |start: Vec<f64>| {
        let variant = Variant { group: own.group.clone(), ..Variant::new(session, own.effect, target, start) };
        let columns = variant.columns(session, problem)?;
        let (s, c) = problem.reduce_all(&columns);
        Some((solve(&s, &c, &variant.coefficients).1, variant))
    };
    starts.into_iter().filter_map(with_gain).max_by(|a, b| a.0.total_cmp(&b.0)).map(|(_, variant)| variant)
}
