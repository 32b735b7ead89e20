//! Several effects at once: each judged again beside the others.
//!
//! The rounds of a discovery judge an effect beside those that earlier rounds found. Where two
//! effects act, the first round has only one to describe both: it can choose a compromise (a tether
//! with another anchor for a line and a tilt), or name rivals that the second effect would exclude.
//! When all rounds are done, every effect found is therefore taken out of the model, and the whole
//! catalogue is ranked and judged again beside the others: another effect takes its place if it is
//! preferred there, and the rivals that remain are those that no recording excludes beside the
//! others. This is repeated until nothing changes.

use crate::candidate::Variant;
use crate::judge::AtFloor;
use crate::ladder::{Refit, as_found, extra_columns, refit_found, to_build_on};
use crate::options::DiscoverOptions;
use crate::problem::{Domain, Problem};
use crate::result::{Found, Round, Verdict};
use crate::round::{Ask, run_round};
use crate::session::Session;
use crate::wording;
use aloft_effects::{Effect, EffectInstance};

/// Most sweeps over all effects found.
const SWEEPS: usize = 3;
/// Ratio of held-out errors (root mean square) up to which other effects count as no loss.
const LOSS: f64 = 1.03;

/// What the rounds of a discovery found, to be judged again.
pub(crate) struct Several<'m, 'a> {
    pub kept: &'m mut Vec<Variant<'a>>,
    pub found: &'m mut Vec<Found>,
    pub rounds: &'m mut Vec<Round>,
}

/// An effect found, as it is judged again.
struct Judged {
    /// The effect that the rounds found.
    first: String,
    /// Its last round beside the others.
    again: Option<Round>,
    /// True if another effect took its place.
    replaced: bool,
}

/// Judges every effect found in a domain again beside the others, if there are at least two, and
/// lets another effect take its place where that one is preferred. On a rigid body an effect that
/// is not accepted beside the others is dropped. The rounds that named them are superseded by one
/// round for each. True if the effects found have changed.
pub(crate) fn judge_each_beside_the_others<'a>(
    session: &Session<'_>,
    domain: Domain,
    effects: &[&'a dyn Effect],
    accepted: &[EffectInstance<'a>],
    several: Several<'_, 'a>,
    has_flights: bool,
    at_floor: Option<&AtFloor>,
    options: &DiscoverOptions,
) -> bool {
    let Several { kept, found, rounds } = several;
    let here = |v: &Variant<'_>| v.effect.acts().in_flight() == (domain == Domain::Flight);
    if kept.iter().filter(|v| here(v)).count() < 2 {
        return false;
    }
    // a pair that stands beside other answers, which have no place beside one half of it
    let of_pair = |r: &&Round| r.joined.len() == 2 && r.effects.iter().any(|id| !r.joined.contains(id));
    let pairs: Vec<String> = rounds.iter().filter(of_pair).flat_map(|r| r.joined.clone()).collect();
    let error = |kept: &[Variant<'_>]| {
        let extra = extra_columns(session, domain, accepted, kept, &[]);
        let joint = Problem::if_possible(session, domain, &extra, options);
        joint.map_or(f64::INFINITY, |p| p.plain())
    };
    let (kept_before, found_before) = (kept.clone(), found.clone());
    let mut judged: Vec<Judged> =
        found.iter().map(|f| Judged { first: f.effect.clone(), again: None, replaced: false }).collect();
    let (mut any_replaced, rigid) = (false, session.prior.is_none());
    for _ in 0..SWEEPS {
        let mut changed = false;
        let mut i = 0;
        while i < kept.len() {
            if !here(&kept[i]) || pairs.contains(&found[i].effect) {
                i += 1;
                continue;
            }
            let (mut others, mut others_found) = (kept.clone(), found.clone());
            let own = others.remove(i);
            others_found.remove(i);
            let extra = extra_columns(session, domain, accepted, &others, &others_found);
            let problem = Problem::if_possible(session, domain, &extra, options);
            let Some(problem) = problem else { return any_replaced };
            let (mut round, _, rivals) = run_round(&Ask {
                session,
                problem: &problem,
                extra: &extra,
                effects,
                beside: Refit { accepted, kept: &others, found: &others_found, options },
                first_round: false,
                has_flights,
                at_floor,
            });
            let named = matches!(round.verdict, Verdict::Supported | Verdict::OneOf);
            let Some(rival) = to_build_on(&rivals, &round.effects, options).filter(|_| named) else {
                if rigid && kept.len() > 1 {
                    // the others explain what it was found for
                    (changed, any_replaced) = (true, true);
                    kept.remove(i);
                    found.remove(i);
                    judged.remove(i);
                } else {
                    // errors that repeat on a person leave more to gain by chance: what the round
                    // named in which it was found stands
                    let its = &mut judged[i];
                    its.again = its.again.take().filter(|_| its.replaced);
                    i += 1;
                }
                continue;
            };
            if rival.id() != own.effect.id() || rival.scored.variant.target != own.target {
                (changed, any_replaced, judged[i].replaced) = (true, true, true);
                found[i] = as_found(session, &rival.scored);
                kept[i] = rival.scored.variant.clone();
            }
            (round.joined, round.missing) = (vec![rival.id().to_owned()], 1);
            judged[i].again = Some(round);
            i += 1;
        }
        if !changed {
            break;
        }
        refit_found(session, accepted, kept, found, options);
    }
    if any_replaced && error(kept) > LOSS * LOSS * error(&kept_before) {
        // no answer that explains less takes the place of the rounds
        (*kept, *found) = (kept_before, found_before);
        return false;
    }
    // what an earlier round named stands only for effects that could not be judged again
    let stays: Vec<String> = judged.iter().filter(|j| j.again.is_none()).map(|j| j.first.clone()).collect();
    for round in rounds.iter_mut().filter(|r| r.judged_on == wording::domain(domain) && !r.joined.is_empty()) {
        round.joined.retain(|id| stays.contains(id));
        round.missing = round.missing.min(round.joined.len());
        round.superseded = round.joined.is_empty();
    }
    let beside = judged.into_iter().filter_map(|j| j.again).map(|r| Round { words: wording::beside(&r), ..r });
    rounds.extend(beside);
    any_replaced
}
