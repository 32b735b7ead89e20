//! A class of effects of flights whose chosen member needs another effect beside it in contact.
//!
//! Of effects that flights cannot tell apart one joins the model, and contact is judged with it. If
//! another one is true, contact keeps a part of its force, and a gain of the plates or a wrong mass
//! seems to be missing as well. A single effect that predicts flights and contact as well as both
//! is the simpler answer. It takes the place of the two, first in its class.

use crate::candidate::Variant;
use crate::conclude::{RoundResults, widen_one};
use crate::held_out::HeldOutResult;
use crate::ladder::{as_found, extra_columns};
use crate::nonlinear::fitted;
use crate::options::DiscoverOptions;
use crate::problem::{Domain, Problem};
use crate::result::{Found, Verdict};
use crate::session::Session;
use crate::sizes::predicts_as_well;
use aloft_effects::{Effect, EffectInstance};
use rayon::prelude::*;

/// A member of the class in the place of the chosen one and of what contact needed beside it.
struct Single<'a> {
    kept: Vec<Variant<'a>>,
    found: Vec<Found>,
    /// Product of the errors in flight and in contact, N².
    size: f64,
}

/// The results with another member of a class of flights alone, if it predicts as well as the
/// chosen one with effects that act in contact only; none otherwise.
pub(crate) fn one_is_enough<'a>(
    session: &Session<'_>,
    effects: &[&'a dyn Effect],
    accepted: &[EffectInstance<'_>],
    made: &RoundResults<'a>,
    options: &DiscoverOptions,
) -> Option<RoundResults<'a>> {
    let only_contact = |v: &Variant<'_>| !v.effect.acts().in_flight();
    if !made.has_flights || !options.only.is_empty() || !made.kept.iter().any(only_contact) {
        return None;
    }
    let in_model = |id: &String| made.kept.iter().position(|v| v.effect.id() == id);
    let of_class = |r: &crate::result::Round| {
        let [chosen] = &r.joined[..] else { return None };
        let alone = r.verdict == Verdict::OneOf && r.missing < 2 && !r.superseded;
        in_model(chosen).filter(|&i| alone && !only_contact(&made.kept[i]))
    };
    let (round, chosen) = made.rounds.iter().enumerate().find_map(|(i, r)| Some((i, of_class(r)?)))?;
    let both = session.by_stages.with(&made.found)?;
    let class = &made.rounds[round];
    let single = |id: &String| -> Option<Single<'a>> {
        let candidate = class.candidates.iter().find(|c| c.effect == *id)?;
        let variant = Variant::of_candidate(session, effects, candidate)?;
        let stays = |i: &usize| *i != chosen && !only_contact(&made.kept[*i]);
        let others: Vec<usize> = (0..made.kept.len()).filter(stays).collect();
        let mut kept: Vec<Variant<'a>> = others.iter().map(|&i| made.kept[i].clone()).collect();
        let mut found: Vec<Found> = others.iter().map(|&i| made.found[i].clone()).collect();
        let extra = extra_columns(session, Domain::Flight, accepted, &kept, &found);
        let problem = Problem::if_possible(session, Domain::Flight, &extra, options)?;
        let scored = fitted(session, &problem, &variant)?;
        let mut its = as_found(session, &scored);
        kept.insert(0, scored.variant);
        widen_one(session, Domain::Flight, accepted, &kept, 0, &mut its, options);
        found.insert(0, its);
        let staged = session.by_stages.with(&found)?;
        let error = |e: &Option<HeldOutResult>| e.map_or(f64::NAN, |e| e.held_out_error);
        let size = staged.errors.iter().map(error).product();
        predicts_as_well(both.errors, staged.errors).then_some(Single { kept, found, size })
    };
    let members: Vec<&String> = class.effects.iter().filter(|id| !class.joined.contains(id)).collect();
    let found: Vec<Option<Single<'a>>> = members.par_iter().map(|id| single(id)).collect();
    let (id, best) =
        members.iter().zip(found).filter_map(|(id, s)| Some((*id, s?))).min_by(|a, b| a.1.size.total_cmp(&b.1.size))?;
    let mut out = RoundResults { kept: best.kept, found: best.found, ..made.clone() };
    let dropped: Vec<String> =
        made.found.iter().filter(|f| out.found.iter().all(|o| o.effect != f.effect)).map(|f| f.key.clone()).collect();
    for later in out.rounds.iter_mut().skip(round + 1) {
        if later.joined.iter().any(|id| out.found.iter().all(|f| f.effect != *id)) {
            later.superseded = true;
            later.words = format!("not needed beside `{}`: {}", out.found[0].key, later.words);
        }
    }
    let class = &mut out.rounds[round];
    class.words += &format!(
        "; `{}` alone predicts flights and contact as well as {} together",
        out.found[0].key,
        dropped.iter().map(|key| format!("`{key}`")).collect::<Vec<_>>().join(" and ")
    );
    class.effects.retain(|e| e != id);
    class.effects.insert(0, id.clone());
    class.joined = vec![id.clone()];
    let extra = extra_columns(session, Domain::Flight, accepted, &out.kept, &out.found);
    let problem = Problem::if_possible(session, Domain::Flight, &extra, options)?;
    out.errors[1] = problem.plain();
    Some(out)
}
