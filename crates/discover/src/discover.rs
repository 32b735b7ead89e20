//! Discovery rounds: rank the effects, judge the ranking, add the best, and repeat.

use crate::DiscoverError;
use crate::beside::{Several, judge_each_beside_the_others};
use crate::candidate::{Scored, Variant};
use crate::conclude::{RoundResults, conclude, widen_found, widen_named};
use crate::held_out::HeldOutResult;
use crate::judge::AtFloor;
use crate::ladder::{Refit, as_found, extra_columns, key_of, prune, refit_found, to_build_on};
use crate::limits::limit;
use crate::nonlinear::settled;
use crate::not_tried::not_tried;
use crate::on_which_link::name_other_links;
use crate::one_is_enough::one_is_enough;
use crate::options::DiscoverOptions;
use crate::pairs::{ALONE, CARRIED, Search, better_pair, pair_alone, pair_as_good};
use crate::problem::{Domain, Problem};
use crate::progress::Until;
use crate::rank::{EffectScore, judged_in};
use crate::refused::{Refused, Unnamed};
use crate::result::{Discovery, FEWEST_CLUSTERS, Found, NotTried, Round, Verdict};
use crate::rivals::Rival;
use crate::round::{run_round, wanted};
use crate::session::Session;
use crate::shown_in_both::also_in_flight;
use crate::wording;
use aloft_effects::{Effect, EffectInstance, Target};
use aloft_regressor::StretchKind;

/// A pair of effects has to reduce the error below this share of that of the best single effect.
const PAIR: f64 = 0.93;

/// Two lists one after the other, each name once.
fn in_order(lists: [Vec<String>; 2]) -> Vec<String> {
    let mut out: Vec<String> = Vec::new();
    for id in lists.into_iter().flatten() {
        if !out.contains(&id) {
            out.push(id);
        }
    }
    out
}

/// All effects of the catalogue.
pub fn catalogue() -> Vec<&'static dyn Effect> {
    aloft_effects::EFFECTS.to_vec()
}

/// Searches for missing effects: ranks `effects` against the model that already holds `accepted`,
/// adds the best effect that passes, and repeats until none does.
///
/// # Errors
/// [`DiscoverError::TooFew`] with fewer than two flights, [`DiscoverError::Numeric`] when the rows
/// do not determine the parameters.
pub fn discover(
    session: &Session<'_>,
    effects: &[&dyn Effect],
    accepted: &[EffectInstance<'_>],
    options: &DiscoverOptions,
) -> Result<Discovery, DiscoverError> {
    let until = Until::of(options.budget_s);
    let mut options = options.clone();
    let mut refused = Vec::new();
    loop {
        match without_refused(session, effects, accepted, &until, &options)? {
            Ok(mut answer) => {
                answer.warnings.extend(refused);
                return Ok(answer);
            }
            Err(no) => {
                options.without.push(no.id);
                refused.push(no.words);
            }
        }
    }
}

/// The answer with the effects that `options` allow, or the one of them that contact refuses.
fn without_refused(
    session: &Session<'_>,
    effects: &[&dyn Effect],
    accepted: &[EffectInstance<'_>],
    until: &Until,
    options: &DiscoverOptions,
) -> Result<Result<Discovery, Refused>, DiscoverError> {
    let has = |contact: bool| session.blocks.iter().any(|b| (b.kind == StretchKind::Contact) == contact);
    let (has_flights, has_contact) = (has(false), has(true));
    let mut rounds: Vec<Round> = Vec::new();
    let mut found: Vec<Found> = Vec::new();
    let mut domains = Vec::new();
    if has_flights {
        domains.push(Domain::Flight);
    }
    if has_contact && (!has_flights || effects.iter().any(|e| wanted(*e, options) && judged_in(*e, Domain::Contact))) {
        domains.push(Domain::Contact);
    }
    // usually one round names an effect, and a second one finds nothing more
    let usual = 2 * effects.iter().filter(|e| wanted(**e, options)).count();
    let mut before = f64::NAN;
    let mut after = f64::NAN;
    // a variant found in flight also acts in contact, so its columns are recomputed for every
    // domain
    let mut kept: Vec<Variant<'_>> = Vec::new();
    let mut left_out: Vec<NotTried> = Vec::new();
    let mut contradicted = None;
    let mut to_come = domains.len();
    let mut floors: Vec<(Domain, Option<AtFloor>)> = Vec::new();
    for domain in domains {
        session.counter.expect(usual * to_come);
        to_come -= 1;
        let mut first_gain: Option<f64> = None;
        let mut at_floor: Option<AtFloor> = None;
        // what flights name has to hold in contact
        let beside = Refit { accepted, kept: &kept, found: &found, options };
        if domain == Domain::Contact
            && let Some(why) = beside.contradicted(session)
        {
            for round in rounds.iter_mut().filter(|r| matches!(r.verdict, Verdict::Supported | Verdict::OneOf)) {
                round.words = format!("{}; not named, because {why}", round.words);
                round.superseded = true;
            }
            let keys: Vec<String> = found.iter().map(|f| format!("`{}`", f.key)).collect();
            contradicted = Some(format!("{} would lower the error in flight, but {why}", keys.join(" and ")));
            (kept, found, after) = (Vec::new(), Vec::new(), before);
        }
        for _ in 0..options.rounds.max(1) {
            let extra = extra_columns(session, domain, accepted, &kept, &found);
            let problem = match Problem::new(session, domain, &extra, options.fewest_trials, options.prior_weight) {
                Ok(problem) => problem,
                // too few contact stretches: keep the result from the flights
                Err(DiscoverError::TooFew { .. }) if !rounds.is_empty() => break,
                Err(e) => return Err(e),
            };
            let model: Vec<String> =
                accepted.iter().map(|c| c.key(session.scene)).chain(found.iter().map(|f| f.key.clone())).collect();
            let already: Vec<(&dyn Effect, Target)> = accepted
                .iter()
                .map(|c| (c.effect, c.target))
                .chain(kept.iter().map(|v| (v.effect, v.target)))
                .collect();
            let plain = problem.plain();
            if kept.is_empty() {
                at_floor = session.model_error[usize::from(domain == Domain::Contact)]
                    .map(|model_error| AtFloor { model_error, scale: model_error.held_out_error / plain.sqrt() });
            }
            // An error at its floor leaves nothing to explain: further effects would fit errors
            // that repeat. A rigid body has no such errors, and a small second effect can hide
            // within the floor's interval.
            let rigid = session.prior.is_none() && domain == Domain::Flight;
            let nothing_left = |f: &AtFloor| if rigid { f.times(plain) <= 1.0 } else { f.reached_by(plain) };
            if !kept.is_empty() && at_floor.as_ref().is_some_and(nothing_left) {
                break;
            }
            let (mut round, scores, rivals) = run_round(
                session,
                &problem,
                &extra,
                effects,
                &already,
                &Refit { accepted, kept: &kept, found: &found, options },
                kept.is_empty(),
                model,
                has_flights,
                at_floor.as_ref(),
                options,
            );
            // an effect whose law gives no numbers cannot be ranked; report it, so that the result
            // is not taken for "nothing missing"
            let unranked = |e: &dyn Effect| {
                let listed =
                    scores.iter().any(|s| s.effect.id() == e.id()) || already.iter().any(|(a, _)| a.id() == e.id());
                wanted(e, options)
                    && judged_in(e, domain)
                    && (!listed || aloft_effects::effect(e.id()).is_err())
                    && !left_out.iter().any(|l| l.effect == e.id())
            };
            let missing: Vec<NotTried> =
                effects.iter().filter(|e| unranked(**e)).filter_map(|e| not_tried(session, *e, domain)).collect();
            left_out.extend(missing);
            if rounds.is_empty() {
                before = plain;
            }
            if domain == Domain::Flight || !has_flights {
                after = plain;
            }
            let chosen = match round.verdict {
                Verdict::Supported | Verdict::OneOf => to_build_on(&rivals, &round.effects, options),
                _ => None,
            };
            let mean_square = |r: &Rival<'_>| r.error() / problem.n_judged as f64;
            // an error of the plates and a force on the body look the same in contact
            let flight = rounds.iter().find(|r| r.judged_on == wording::domain(Domain::Flight));
            if let (Domain::Contact, Some(rival), Some(flight)) = (domain, chosen, flight) {
                let forces = effects.iter().filter(|e| wanted(**e, options) && judged_in(**e, Domain::Flight));
                let forces: Vec<&dyn Effect> = forces.copied().collect();
                let in_some = !rival.scored.variant.group.is_empty();
                also_in_flight(session, &problem, &forces, flight, mean_square(rival), in_some, &mut round);
            }
            let gain = chosen.map_or(0.0, |r| plain - mean_square(r));
            if let (Some(first), Some(_)) = (first_gain, chosen)
                && gain < 0.01 * first
            {
                // probably the remainder of a large effect that the model does not describe exactly
                round.words = format!(
                    "what remains is below a tenth of the effect found before and may be left over from it; {}",
                    round.words
                );
                round.verdict = Verdict::NothingMissing;
                round.effects.clear();
            }
            let go_on = matches!(round.verdict, Verdict::Supported | Verdict::OneOf);
            let sure = round.verdict == Verdict::Supported;
            let enough = chosen.is_some_and(|r| at_floor.as_ref().is_some_and(|f| f.reached_by(mean_square(r))));
            let refit = Refit { accepted, kept: &kept, found: &found, options };
            let pair = match chosen {
                Some(rival) if go_on && !enough => {
                    // an effect that reproduces the named one at the edge of its range is named,
                    // too
                    let limit_of_named = |id: &str| round.rival_tests.iter().any(|d| d.only_as_limit && d.effect == id);
                    let named = |id: &str| round.effects.iter().any(|e| e == id) || limit_of_named(id);
                    let usable: Vec<bool> = scores
                        .iter()
                        .map(|s| {
                            let more = s.effect.about().contains.contains(&rival.id());
                            !s.placebo && !more && !named(s.effect.id()) && limit(s.effect, false, options) > 0.0
                        })
                        .collect();
                    let search = Search {
                        session,
                        problem: &problem,
                        scores: &scores,
                        best: rival.index,
                        usable: &usable,
                        refit: &refit,
                    };
                    better_pair(&search, PAIR).map(|(a, b, error, _)| (a, b, error))
                }
                _ => None,
            };
            // two effects can hide each other: where the best single one leaves the error far above
            // its floor, or none is accepted, pairs are tried without a winner
            let share = if go_on { ((plain - gain) / plain).max(0.0).sqrt() } else { 1.0 };
            let remains = session.model_error[usize::from(domain == Domain::Contact)]
                .map(|s| HeldOutResult { held_out_error: s.held_out_error * share, ..s });
            let two = |a: &Scored<'_>, b: &Scored<'_>| {
                vec![a.variant.effect.id().to_owned(), b.variant.effect.id().to_owned()]
            };
            let pair = pair
                .map(|(a, b, error)| {
                    let ids = two(&a, &b);
                    (a, b, error, ids)
                })
                .or_else(|| {
                    // where the plates show in which trials something was carried, loads on two
                    // links are tried with less error left, too
                    let carried = domain == Domain::Flight && session.shows_loads_on_plates();
                    let far = remains.is_some_and(|s| s.is_far());
                    let tried = far || (carried && remains.is_some_and(|s| s.is_above()));
                    if !(kept.is_empty() && round.clusters >= FEWEST_CLUSTERS && tried) {
                        return None;
                    }
                    let usable: Vec<bool> = scores
                        .iter()
                        .map(|s| !s.placebo && limit(s.effect, false, options) > 0.0)
                        .zip(scores.iter().map(|s| far || s.effect.about().by_group))
                        .map(|(usable, asked)| usable && asked)
                        .collect();
                    let most = if far { ALONE } else { CARRIED };
                    let any = pair_alone(session, &problem, &scores, &usable, &refit, most)?;
                    // an effect that contains another one counts only if it does better
                    let wider = |i: usize| {
                        let contains = scores[i].effect.about().contains;
                        (0..scores.len()).any(|j| usable[j] && contains.contains(&scores[j].effect.id()))
                    };
                    let plain: Vec<bool> = (0..scores.len()).map(|i| usable[i] && !wider(i)).collect();
                    let better = |p: &(_, _, f64, _)| (any.2 / p.2).sqrt() < options.belief;
                    match pair_alone(session, &problem, &scores, &plain, &refit, most) {
                        Some(pair) if !better(&pair) => Some(pair),
                        _ => Some(any),
                    }
                });
            if let Some((a, b, error, ids)) = pair {
                let both_ids = two(&a, &b);
                let sure_of_both = ids.iter().all(|id| both_ids.contains(id));
                let share = 100.0 * (error / (plain * problem.n_judged as f64)).sqrt();
                let both = format!("`{}` and `{}`", key_of(session, &a), key_of(session, &b));
                let one = chosen.filter(|_| go_on).map(|r| {
                    let left = 100.0 * (mean_square(r) / plain).sqrt();
                    format!("the best of them, `{}`, leaves {left:.0} %", key_of(session, &r.scored))
                });
                round.words = if let Some(one) = one {
                    format!(
                        "two effects together, {both}, are missing: held-out error falls to {share:.0} %; one alone explains less ({one})"
                    )
                } else {
                    format!(
                        "two effects together, {both}, are missing: held-out error falls to {share:.0} %; none explains it alone"
                    )
                };
                round.verdict = if sure_of_both { Verdict::Supported } else { Verdict::OneOf };
                round.effects = ids;
                round.missing = both_ids.len();
                round.joined = both_ids;
                rounds.push(round);
                first_gain = first_gain.or(Some(gain));
                if domain == Domain::Flight || !has_flights {
                    after = error / problem.n_judged as f64;
                }
                for part in [a, b] {
                    found.push(as_found(session, &part));
                    kept.push(part.variant);
                }
                continue;
            }
            let mut join: Vec<Scored<'_>> = Vec::new();
            if let (true, Some(rival)) = (go_on, chosen) {
                let settled = settled(session, &problem, &rival.scored);
                let its = as_found(session, &settled);
                if let Some(c) = round.candidates.iter_mut().find(|c| c.key == its.key) {
                    (c.coefficients, c.nonlinear) = (its.coefficients, its.nonlinear);
                }
                join.push(settled);
                round.missing = 1;
                first_gain = first_gain.or(Some(gain));
                let mut left = mean_square(rival);
                // one that contains the chosen effect is no part of a pair beside it
                let wider = |s: &EffectScore<'_>| s.effect.about().contains.contains(&rival.id());
                let usable: Vec<bool> =
                    scores.iter().map(|s| !s.placebo && !wider(s) && limit(s.effect, false, options) > 0.0).collect();
                let search = Search {
                    session,
                    problem: &problem,
                    scores: &scores,
                    best: rival.index,
                    usable: &usable,
                    refit: &refit,
                };
                if let Some((a, b, error, ids)) = pair_as_good(&search) {
                    let keys = [&a, &b].map(|s| key_of(session, s));
                    round.verdict = Verdict::OneOf;
                    // the simpler of equals joins the model
                    let pair_joins = error < rival.error();
                    if pair_joins {
                        left = error / problem.n_judged as f64;
                        join = vec![a, b];
                    }
                    let share = (left / plain).sqrt();
                    round.words = wording::or_pair(&round.effects, &keys, pair_joins, share);
                    round.effects = in_order(if pair_joins { [ids, round.effects] } else { [round.effects, ids] });
                }
                if domain == Domain::Flight || !has_flights {
                    after = left;
                }
                round.joined = join.iter().map(|s| s.variant.effect.id().to_owned()).collect();
            }
            rounds.push(round);
            if !go_on {
                break;
            }
            for scored in join {
                found.push(as_found(session, &scored));
                kept.push(scored.variant);
            }
            // no single effect is named, so further rounds have no definite model to extend
            if !sure && rounds.len() >= options.rounds {
                break;
            }
        }
        floors.push((domain, at_floor));
    }
    prune(session, accepted, &mut kept, &mut found, options);
    refit_found(session, accepted, &mut kept, &mut found, options);
    let mut replaced = false;
    for (domain, at_floor) in &floors {
        let several = Several { kept: &mut kept, found: &mut found, rounds: &mut rounds };
        let floor = at_floor.as_ref();
        replaced |=
            judge_each_beside_the_others(session, *domain, effects, accepted, several, has_flights, floor, options);
    }
    if replaced {
        prune(session, accepted, &mut kept, &mut found, options);
        let domain = if has_flights { Domain::Flight } else { Domain::Contact };
        let extra = extra_columns(session, domain, accepted, &kept, &[]);
        let joint = Problem::new(session, domain, &extra, options.fewest_trials, options.prior_weight);
        after = joint.map_or(after, |p| p.plain());
    }
    widen_found(session, accepted, &kept, &mut found, options);
    widen_named(session, accepted, effects, &kept, &mut rounds, options);
    let errors = [before, after];
    let in_doubt = Vec::new();
    let made = RoundResults { rounds, found, kept, contradicted, in_doubt, left_out, errors, has_flights };
    let mut made = one_is_enough(session, effects, accepted, &made, options).unwrap_or(made);
    name_other_links(session, accepted, &made.kept, &mut made.found, options);
    let answer = match conclude(session, effects, accepted, made.clone(), until, options) {
        Err(Unnamed::All(why)) => {
            let nothing = made.naming_nothing(&why);
            conclude(session, effects, accepted, nothing, until, options).map(|mut answer| {
                answer.warnings.push(why.words);
                answer
            })
        }
        answer => answer,
    };
    match answer {
        Ok(answer) => Ok(Ok(answer)),
        Err(Unnamed::One(refused)) => Ok(Err(refused)),
        // with nothing named there is nothing to refuse
        Err(Unnamed::All(why)) => Err(DiscoverError::Numeric(why.words)),
    }
}
