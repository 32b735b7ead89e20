//! On which links an effect that was found may act.
//!
//! A load or force near a joint acts on either of the joint's links nearly alike, and a load on a
//! light link moves much as one on its neighbour. The name of the effect can be certain where its
//! link is not. Each effect found on a link is therefore fitted again on every other link, beside
//! the other effects; links that leave hardly more error are named.

use crate::candidate::{Scored, Variant, solve};
use crate::ladder::extra_columns;
use crate::limits::SAME;
use crate::nonlinear::fitted;
use crate::options::DiscoverOptions;
use crate::problem::{Domain, Problem};
use crate::result::Found;
use crate::session::Session;
use crate::statistics::sign_flip_p;
use aloft_effects::{EffectInstance, Target};
use rayon::prelude::*;

/// Error on the link found over that on another, below which the other is not considered whatever
/// the sign test says.
const WORSE: f64 = 0.9;

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
    let problem = Problem::new(session, domain, &extra, options.fewest_trials, options.prior_weight).ok()?;
    let in_model = accepted.iter().map(|c| (c.effect.id(), c.target));
    let taken: Vec<(&str, Target)> = in_model.chain(others.iter().map(|v| (v.effect.id(), v.target))).collect();
    let here = fitted(session, &problem, own)?;
    let tried: Vec<(Target, Option<Scored<'_>>)> = own
        .effect
        .targets(session.scene)
        .into_par_iter()
        .filter(|t| matches!(t, Target::Link(_)) && *t != own.target && !taken.contains(&(own.effect.id(), *t)))
        .map(|t| (t, at_best_start(session, &problem, own, t).and_then(|v| fitted(session, &problem, &v))))
        .collect();
    let sum = |s: &Scored<'_>| s.fold_error.iter().sum::<f64>();
    let same = SAME[usize::from(session.prior.is_some())];
    let as_good = |s: &Scored<'_>| {
        let ratio = (sum(&here) / sum(s)).sqrt();
        let p = || sign_flip_p(&here.fold_error, &s.fold_error, 2000, options.seed ^ 0x11a4);
        ratio > same || (ratio > WORSE && p() >= options.significance)
    };
    let mut named: Vec<(f64, String)> = tried
        .iter()
        .filter_map(|(t, s)| Some((t, s.as_ref()?)))
        .filter(|(_, s)| as_good(s))
        .map(|(t, s)| (sum(s), t.label(session.scene)))
        .collect();
    named.sort_by(|a, b| a.0.total_cmp(&b.0));
    Some(named.into_iter().map(|(_, name)| name).collect())
}

/// The effect on another link, at that of its starting values that gains most.
fn at_best_start<'a>(
    session: &Session<'_>,
    problem: &Problem,
    own: &Variant<'a>,
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
