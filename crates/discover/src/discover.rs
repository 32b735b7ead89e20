//! Discovery rounds: rank the effects, judge the ranking, add the best, and repeat.

use crate::addition::addition;
use crate::candidate::{Scored, Variant};
use crate::floor::{LACK_OF_FIT, Standing};
use crate::judge::{
    AtFloor, Rival, alternatives, chosen_shares, confusions, is_trivial, judge, limit, limit_by_number,
    minimum_detectable, parts, plausible, rivals,
};
use crate::ladder::{Refit, as_found, estimates, extra_columns, group_names, key_of, prune, refit_found, to_build_on};
use crate::laws::Direction;
use crate::not_tried::{NotTried, not_tried};
use crate::options::DiscoverOptions;
use crate::pairs::{better_pair, pair_alone};
use crate::placebo::PLACEBOS;
use crate::problem::{Domain, Problem};
use crate::progress::Until;
use crate::rank::{EffectScore, judged_in, null_ratios, score_effect};
use crate::repeating::widen;
use crate::result::{Candidate, Discovery, FEWEST_CLUSTERS, Found, MANY_CLUSTERS, Round, Verdict};
use crate::session::Session;
use crate::statistics::{ratio_interval, resamples};
use crate::{DiscoverError, wording};
use aloft_effects::{Effect, EffectInstance, Target};
use aloft_regressor::StretchKind;
use nalgebra::DMatrix;
use rayon::prelude::*;

/// A pair of effects has to reduce the error below this share of that of the best single effect.
const PAIR: f64 = 0.93;

/// Below this multiple of the floor an effect on a person has to leave less than `STRONG` of the
/// error.
const NEAR_FLOOR: f64 = 2.0;
const STRONG: f64 = 0.70;

/// All effects of the catalogue.
pub fn catalogue() -> Vec<&'static dyn Effect> {
    aloft_effects::EFFECTS.to_vec()
}

/// Searches for missing effects: ranks `effects` against the model that already holds `accepted`,
/// adds the best effect that passes, and repeats until none does.
///
/// # Errors
/// [`DiscoverError::TooFew`] with fewer than two flights, [`DiscoverError::Numeric`] when the rows do not determine the parameters.
pub fn discover(
    session: &Session<'_>,
    effects: &[&dyn Effect],
    accepted: &[EffectInstance<'_>],
    options: &DiscoverOptions,
) -> Result<Discovery, DiscoverError> {
    let until = Until::of(options.budget_s);
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
    let mut to_come = domains.len();
    for domain in domains {
        session.counter.expect(usual * to_come);
        to_come -= 1;
        let mut first_gain: Option<f64> = None;
        let mut at_floor: Option<AtFloor> = None;
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
                at_floor = session.standing[usize::from(domain == Domain::Contact)]
                    .map(|standing| AtFloor { standing, scale: standing.held_out_error / plain.sqrt() });
            }
            // an error at its floor leaves nothing to explain: further effects would fit errors that
            // repeat
            if !kept.is_empty() && at_floor.as_ref().is_some_and(|f| f.reached_by(plain)) {
                break;
            }
            let (mut round, scores, rivals) = run_round(
                session,
                &problem,
                &extra,
                effects,
                &already,
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
            let pair = match chosen {
                Some(rival) if go_on && !enough => {
                    let named = |id: &str| round.effects.iter().any(|e| e == id);
                    let usable: Vec<bool> = scores
                        .iter()
                        .map(|s| {
                            let more = s.effect.about().contains.contains(&rival.id());
                            !s.placebo && !more && !named(s.effect.id()) && limit(s.effect, false, options) > 0.0
                        })
                        .collect();
                    let refit = Refit { accepted, kept: &kept, found: &found, options };
                    better_pair(session, &problem, &scores, rival.index, &usable, PAIR, &refit)
                }
                _ => None,
            };
            // two effects can hide each other: where the best single one leaves the error far above its
            // floor, or none is accepted, pairs are tried without a winner
            let share = if go_on { ((plain - gain) / plain).max(0.0).sqrt() } else { 1.0 };
            let remains = session.standing[usize::from(domain == Domain::Contact)]
                .map(|s| Standing { held_out_error: s.held_out_error * share, ..s });
            let two = |a: &Scored<'_>, b: &Scored<'_>| {
                vec![a.variant.effect.id().to_owned(), b.variant.effect.id().to_owned()]
            };
            let pair = pair
                .map(|(a, b, error)| {
                    let ids = two(&a, &b);
                    (a, b, error, ids)
                })
                .or_else(|| {
                    if !(kept.is_empty() && round.clusters >= FEWEST_CLUSTERS && remains.is_some_and(|s| s.is_far())) {
                        return None;
                    }
                    let usable: Vec<bool> =
                        scores.iter().map(|s| !s.placebo && limit(s.effect, false, options) > 0.0).collect();
                    let refit = Refit { accepted, kept: &kept, found: &found, options };
                    pair_alone(session, &problem, &scores, &usable, &refit)
                });
            if let Some((a, b, error, ids)) = pair {
                let both = two(&a, &b);
                let sure_of_both = ids.iter().all(|id| both.contains(id));
                let share = 100.0 * (error / (plain * problem.n_judged as f64)).sqrt();
                let both = format!("`{}` and `{}`", key_of(session, &a), key_of(session, &b));
                round.words = if go_on {
                    format!(
                        "two effects together, {both}, explain more ({share:.0} % of the held-out error remains) than any \
                         one: {}",
                        round.words
                    )
                } else {
                    format!(
                        "two effects together, {both}, are missing: held-out error falls to {share:.0} %; none explains it alone"
                    )
                };
                round.verdict = if sure_of_both { Verdict::Supported } else { Verdict::OneOf };
                round.effects = ids;
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
            rounds.push(round);
            if !go_on {
                break;
            }
            if let Some(rival) = chosen {
                first_gain = first_gain.or(Some(gain));
                if domain == Domain::Flight || !has_flights {
                    after = mean_square(rival);
                }
                found.push(as_found(session, &rival.scored));
                kept.push(rival.scored.variant.clone());
            }
            // no single effect is named, so further rounds have no definite model to extend
            if !sure && rounds.len() >= options.rounds {
                break;
            }
        }
    }
    prune(session, accepted, &mut kept, &mut found, options);
    refit_found(session, accepted, &kept, &mut found, options);
    for (i, f) in found.iter_mut().enumerate() {
        let domain = if kept[i].effect.acts().in_flight() { Domain::Flight } else { Domain::Contact };
        let mut others = kept.clone();
        others.remove(i);
        let of = |v: &[Variant<'_>]| extra_columns(session, domain, accepted, v, &[]);
        let estimates = (&mut f.coefficients[..], &mut f.nonlinear[..]);
        widen(session, domain, &of(&others), &of(&kept), &kept[i], estimates, options);
    }
    let mut model: Vec<EffectInstance<'_>> = accepted.to_vec();
    let mut steps = Vec::new();
    for (v, f) in kept.iter().zip(&found) {
        let nonlinear = f.nonlinear.iter().map(|e| e.value).collect();
        let choice = EffectInstance { effect: v.effect, target: v.target, nonlinear, trials: f.trials.clone() };
        steps.extend(addition(session, &model, &choice, options).ok());
        model.push(choice);
    }
    let first = rounds.iter().find(|r| matches!(r.verdict, Verdict::Supported | Verdict::OneOf));
    let verdict = first.map_or_else(|| rounds.first().map_or(Verdict::NotDetectable, |r| r.verdict), |r| r.verdict);
    let mut named: Vec<String> = first.map(|r| r.effects.clone()).unwrap_or_default();
    if verdict == Verdict::Supported {
        let sure =
            |id: &str| rounds.iter().any(|r| r.verdict == Verdict::Supported && r.effects.iter().any(|e| e == id));
        named = found.iter().map(|f| f.effect.clone()).filter(|id| sure(id)).collect();
    }
    let mut once: Vec<String> = Vec::new();
    for id in named {
        if !once.contains(&id) {
            once.push(id);
        }
    }
    let mut candidates: Vec<Candidate> = Vec::new();
    for r in &rounds {
        for c in &r.candidates {
            if !candidates.iter().any(|o| o.effect == c.effect) {
                candidates.push(c.clone());
            }
        }
    }
    candidates.sort_by(|a, b| a.held_out_ratio.total_cmp(&b.held_out_ratio));
    let weight = session.unit[0];
    // scale to the errors of the comparison, if one was made: relative change from the rows,
    // newtons from the comparison
    let standing = session.standing[usize::from(!has_flights)];
    let scale = standing.map_or(weight, |s| s.held_out_error / before.sqrt());
    // errors of the present model, before any effect found here: contact rounds already contain
    // the effects found in flight
    let error_with = |domain: Domain, kept: &[Variant<'_>], found: &[Found]| {
        let extra = extra_columns(session, domain, accepted, kept, found);
        let problem = Problem::new(session, domain, &extra, options.fewest_trials, options.prior_weight).ok()?;
        Some(problem.plain().sqrt() * session.unit[0])
    };
    let places = [Domain::Flight, Domain::Contact];
    let first_error = places.map(|place| {
        let judged = rounds.iter().any(|r| r.judged_on == wording::domain(place));
        if judged { error_with(place, &[], &[]).unwrap_or(f64::NAN) } else { f64::NAN }
    });
    for round in &mut rounds {
        let of = usize::from(round.judged_on != wording::domain(Domain::Flight));
        let first = first_error[of];
        if let (Some(s), true) = (session.standing[of], first > 0.0) {
            round.held_out_error *= s.held_out_error / first;
        }
    }
    // what is left with the effects found, in each domain
    let left = |i: usize| -> Option<Standing> {
        let standing = session.standing[i]?;
        let share = match (i, has_flights) {
            _ if kept.is_empty() => 1.0,
            (0, true) | (_, false) => (after / before).sqrt(),
            _ => error_with(places[i], &kept, &found)? / first_error[i],
        };
        share.is_finite().then_some(Standing { held_out_error: standing.held_out_error * share, ..standing })
    };
    let left = [left(0), left(1)];
    let mut out = Discovery {
        schema: 1,
        verdict,
        effects: once,
        words: String::new(),
        noise_floor: standing.map_or(f64::NAN, |s| s.noise_floor),
        noise_floor_ci95: standing.and_then(|s| s.noise_floor_ci95),
        held_out_error: before.sqrt() * scale,
        held_out_error_after: after.sqrt() * scale,
        held_out_error_of_weight: before.sqrt() * scale / weight,
        candidates,
        rounds,
        ladder: steps,
        found,
        advice: Vec::new(),
        warnings: session.warnings.clone(),
        not_tried: left_out,
        open: None,
    };
    // An error that remains far above its floor is not explained, whatever was found; nor is one of
    // which effects leave a share that the noise does not account for. Effects found
    // in flight are judged in flight; their error in contact also contains what only contact shows.
    let only_flight = kept.iter().any(|v| v.effect.acts().in_flight()) && has_flights;
    let far = (0..2)
        .filter(|i| *i == 0 || !only_flight)
        .filter_map(|i| {
            let (before, after) = (session.standing[i]?, left[i]?);
            let judged_here = kept.iter().any(|v| v.effect.acts().in_flight() == (i == 0));
            let misfit = judged_here && before.share_left(&after) > LACK_OF_FIT;
            (after.is_far() || misfit).then(|| (wording::domain(places[i]), after))
        })
        .max_by(|a, b| a.1.times_floor().total_cmp(&b.1.times_floor()));
    if far.is_some() {
        out.verdict = Verdict::Unexplained;
        out.effects.clear();
    }
    if has_flights && !options.closed && options.only.is_empty() {
        look_beyond(session, accepted, effects, &kept, &left, &mut out, &until, options);
    }
    out.words = wording::answer(&out, far);
    if let Some(open) = &out.open {
        out.words = wording::with_open(&out, open, far.is_some());
    }
    out.advice = wording::advice(&out, effects);
    if !has_flights {
        let untried = effects.iter().filter(|e| wanted(**e, options) && !judged_in(**e, Domain::Contact)).count();
        out.warnings.push(wording::no_flights(untried));
    }
    Ok(out)
}

/// Searches for laws beyond the catalogue where flights leave an error above the interval of its
/// floor, or where the catalogue needs effects of several kinds, and lets laws that convince replace
/// what the catalogue names.
fn look_beyond(
    session: &Session<'_>,
    accepted: &[EffectInstance<'_>],
    effects: &[&dyn Effect],
    kept: &[Variant<'_>],
    left: &[Option<Standing>; 2],
    out: &mut Discovery,
    until: &Until,
    options: &DiscoverOptions,
) {
    let above = |s: &Standing| s.noise_floor > 0.0 && !s.reached_by(s.held_out_error) && s.times_floor() > 1.2;
    let several = kept.iter().any(|v| v.effect.id() != kept[0].effect.id());
    if !(left[0].as_ref().is_some_and(above) || (several && session.standing[0].as_ref().is_some_and(above))) {
        return;
    }
    if until.is_over() {
        let budget = options.budget_s.unwrap_or_default();
        out.warnings
            .push(format!("the search beyond the catalogue was not begun: the budget of {budget} s was used up"));
        return;
    }
    let first = out.rounds.first().map_or(&out.candidates, |r| &r.candidates);
    let single = first.iter().filter(|c| !c.placebo).map(|c| c.held_out_ratio).fold(1.0, f64::min);
    let ratio = (out.held_out_error_after / out.held_out_error).min(single);
    let taken: Vec<&str> = effects.iter().map(|e| e.id()).collect();
    let unknowns: usize = kept.iter().map(Variant::unknowns).sum();
    let rival = crate::laws::Rivals { ratio, single, several: several.then_some(unknowns) };
    out.open = crate::laws::search(session, accepted, rival, &taken, until, options);
    let Some(open) = &out.open else { return };
    let named = matches!(out.verdict, Verdict::Supported | Verdict::OneOf);
    // a force of constant size is what the catalogue's own forces, gravity and frame rate look like
    let constant = open.laws.iter().all(|l| l.variables.is_empty() && l.direction != Direction::Towards);
    if named && (!open.complete || constant) {
        // what the catalogue names stands, unless a law brings the error to the floor
        out.open = None;
        return;
    }
    let limit = if session.prior.is_some() { options.belief_kinematics } else { options.belief };
    let acts =
        open.diagnosis.as_ref().is_some_and(|d| d.held_out_ratio < limit && d.family_wise_p < options.significance);
    if !open.laws.is_empty() || acts {
        out.verdict = Verdict::Unexplained;
        out.effects.clear();
    }
    if open.complete {
        // effects that removed a part of the error stood in for the law
        out.found.clear();
        out.ladder.clear();
        out.held_out_error_after = open.held_out_error_after;
    }
}

fn wanted(effect: &dyn Effect, options: &DiscoverOptions) -> bool {
    let named = |list: &[String]| list.iter().any(|n| n == effect.id());
    (options.only.is_empty() || named(&options.only)) && !named(&options.without)
}

/// True for an effect that cannot be found again beside those found before: an alias of one of them,
/// a generalisation of it, or the same on the whole body. A second one of a kind on another link or plate can.
/// Without flights, an alias on any target counts: gains of single plates together with a wrong mass
/// would scale both sides of every row to zero.
fn excluded(effect: &dyn Effect, already: &[(&dyn Effect, Target)], has_flights: bool) -> bool {
    already.iter().any(|(found, target)| {
        let again = found.id() == effect.id() && !matches!(target, Target::Link(_) | Target::Plate(_));
        // what contains the effect found (wind contains drag) would only describe it once more
        let wider = effect.about().contains.contains(&found.id());
        again || wider || (found.about().aliases.contains(&effect.id()) && (!has_flights || *target == Target::Body))
    })
}

fn run_round<'a>(
    session: &Session<'_>,
    problem: &Problem,
    extra: &[Vec<DMatrix<f64>>],
    effects: &[&'a dyn Effect],
    already: &[(&dyn Effect, Target)],
    first_round: bool,
    model: Vec<String>,
    has_flights: bool,
    at_floor: Option<&AtFloor>,
    options: &DiscoverOptions,
) -> (Round, Vec<EffectScore<'a>>, Vec<Rival<'a>>) {
    let all = effects;
    let used: Vec<(&'a dyn Effect, bool)> = effects
        .iter()
        .copied()
        .filter(|e| wanted(*e, options) && judged_in(*e, problem.domain) && !excluded(*e, already, has_flights))
        .map(|e| (e, false))
        .chain(PLACEBOS.iter().map(|p| (p as &dyn Effect, true)))
        .collect();
    let mut scores: Vec<EffectScore<'a>> = used
        .par_iter()
        .filter_map(|(e, placebo)| {
            let taken: Vec<Target> =
                already.iter().filter(|(a, _)| a.id() == e.id()).map(|(_, target)| *target).collect();
            let scored = score_effect(session, problem, *e, &taken, None, *placebo, true);
            session.counter.one();
            scored
        })
        .collect();
    let plain = problem.plain();
    let by_error = |a: &EffectScore<'_>, b: &EffectScore<'_>| a.mean_square(problem).total_cmp(&b.mean_square(problem));
    scores.sort_by(by_error);
    // where the best effect acts in some trials only, every other one is given the same trials
    let part = scores.first().map(|s| (s.effect.about().by_group, s.scored[s.best].variant.group.clone()));
    if let Some((false, acting)) = part.filter(|(_, group)| !group.is_empty()) {
        let again: Vec<Option<EffectScore<'a>>> = scores
            .par_iter()
            .map(|s| {
                let taken: Vec<Target> =
                    already.iter().filter(|(a, _)| a.id() == s.effect.id()).map(|(_, target)| *target).collect();
                let whole = s.placebo || s.effect.about().by_group;
                (!whole).then(|| score_effect(session, problem, s.effect, &taken, Some(&acting), false, true)).flatten()
            })
            .collect();
        for (score, again) in scores.iter_mut().zip(again) {
            if let Some(again) = again.filter(|a| by_error(a, score).is_lt()) {
                *score = again;
            }
        }
        scores.sort_by(by_error);
    }
    let mut null = null_ratios(problem, &scores, options.null_draws, options.seed);
    null.sort_by(f64::total_cmp);
    let quantile = |share: f64| null.get((share * null.len() as f64) as usize).copied().unwrap_or(f64::NAN);
    let null_quantiles = [quantile(0.01), quantile(0.05), quantile(0.5)];
    // with few clusters there are few sign patterns, the original one among them
    let clusters = problem.clusters.iter().filter(|c| !c.judged.is_empty()).count();
    let few = clusters < FEWEST_CLUSTERS;
    let largest = limit_by_number(problem.clusters.len(), options);
    // with few sign patterns, and nonlinear parameters kept at their starts, the 5 % quantile is
    // too lenient
    let by_chance = null_quantiles[usize::from(clusters >= MANY_CLUSTERS)];
    let threshold = if few {
        largest
    } else if by_chance.is_finite() {
        largest.min(by_chance)
    } else {
        options.belief.min(0.8)
    };
    // On a person errors repeat from trial to trial (soft tissue, the prior), and where they are most of
    // what is left an effect that imitates them fits well. Differences between groups of trials do not
    // repeat.
    let near_floor = session.prior.is_some()
        && problem.domain == Domain::Flight
        && at_floor.is_some_and(|f| f.times(plain) < NEAR_FLOOR);
    let limit_for = |effect: &dyn Effect| {
        let limit = limit(effect, first_round, options);
        if near_floor && !effect.about().by_group { limit.min(STRONG) } else { limit }
    };
    let plain_errors: Vec<f64> = problem.folds.iter().map(|f| f.error).collect();
    let weights = resamples(problem.folds.len(), options.resamples, options.seed ^ 0x5eed);
    let shares = chosen_shares(&scores, &weights);
    let best_square = scores.iter().filter(|s| !s.placebo).map(|s| s.mean_square(problem)).fold(plain, f64::min);
    let placebo = scores.iter().filter(|s| s.placebo).map(|s| s.mean_square(problem)).fold(plain, f64::min);
    let mut candidates: Vec<Candidate> = scores
        .par_iter()
        .zip(&shares)
        .map(|(score, share)| {
            let best = &score.scored[score.best];
            let ratio = (score.mean_square(problem) / plain).sqrt();
            let ci95 = ratio_interval(&score.fold_error, &plain_errors, &weights);
            let (coefficients, nonlinear) = estimates(session, best);
            let plausible = plausible(best, &coefficients);
            let beaten = null.iter().filter(|n| **n <= ratio).count();
            let believed = !few
                && !score.placebo
                && plausible
                && ratio < threshold.min(limit_for(score.effect))
                && ci95[1] < 1.0
                && score.mean_square(problem) < placebo
                && !is_trivial(session, problem, score.mean_square(problem));
            Candidate {
                effect: score.effect.id().to_owned(),
                key: key_of(session, best),
                target: best.variant.target,
                kind: score.effect.kind(),
                class: score.effect.about().class.to_owned(),
                judged_on: wording::domain(problem.domain).to_owned(),
                held_out_ratio: ratio,
                ci95,
                chosen_share: *share,
                family_wise_p: (beaten + 1) as f64 / (null.len() + 1) as f64,
                minimum_detectable: minimum_detectable(problem, best, best_square, threshold),
                coefficients,
                nonlinear,
                trials: group_names(session, best),
                confused_with: Vec::new(),
                plausible,
                believed,
                placebo: score.placebo,
                alternatives: alternatives(session, problem, score),
            }
        })
        .collect();
    confusions(session, problem, &scores, &mut candidates, options);
    let (sharp, rivals) = rivals(session, problem, extra, &scores, &candidates, options);
    let (mut verdict, mut effects, duels) =
        judge(session, sharp.as_ref().unwrap_or(problem), &rivals, at_floor, options);
    // the effect that the answer describes, that joins the model in later rounds and that the user is
    // told to add is one and the same
    if let Some(first) = to_build_on(&rivals, &effects, options)
        && let Some(at) = effects.iter().position(|id| id == first.id())
    {
        effects[..=at].rotate_right(1);
    }
    let alike: Vec<&str> = rivals
        .iter()
        .filter(|r| effects.iter().any(|id| id == r.id()))
        .flat_map(|r| r.scored.variant.effect.looks_like(r.scored.theta.as_slice()))
        .copied()
        .filter(|id| {
            let possible = |e: &&&dyn Effect| e.id() == *id && wanted(**e, options) && session.prior.is_some();
            !already.iter().any(|(e, _)| e.id() == *id) && all.iter().any(|e| possible(&e))
        })
        .collect();
    for id in alike {
        if !effects.iter().any(|e| e == id) {
            effects.push(id.to_owned());
            verdict = Verdict::OneOf;
        }
    }
    if few || candidates.iter().all(|c| c.placebo) {
        verdict = Verdict::NotDetectable;
    }
    let limit_of = |c: &Candidate| {
        let effect = scores.iter().find(|s| s.effect.id() == c.effect).map(|s| s.effect);
        effect.map_or(options.belief, limit_for)
    };
    let words = wording::round(verdict, &effects, &candidates, threshold, limit_of, few);
    let round = Round {
        judged_on: wording::domain(problem.domain).to_owned(),
        model,
        held_out_error: plain.sqrt() * session.unit[0],
        held_out_parts: parts(session, problem),
        threshold,
        null_quantiles,
        clusters,
        verdict,
        effects,
        words,
        duels,
        candidates,
    };
    (round, scores, rivals)
}
