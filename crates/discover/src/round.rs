//! One round of a discovery: all effects ranked against the model, and the ranking judged.

use crate::judge::{
    AtFloor, alternatives, chosen_shares, confusions, is_trivial, judge, minimum_detectable, parts, plausible,
};
use crate::ladder::{Refit, estimates, group_names, key_of, to_build_on};
use crate::limits::{SMALLEST, limit, limit_by_number};
use crate::options::DiscoverOptions;
use crate::placebo::PLACEBOS;
use crate::problem::{Domain, Problem};
use crate::rank::{EffectScore, judged_in, null_ratios, score_effect};
use crate::result::{Candidate, FEWEST_CLUSTERS, MANY_CLUSTERS, Round, Verdict};
use crate::rivals::{Rival, rivals};
use crate::session::Session;
use crate::statistics::{ratio_interval, resamples};
use crate::wording;
use aloft_effects::{Effect, Family, Target};
use nalgebra::DMatrix;
use rayon::prelude::*;

/// Below this multiple of the floor an effect on a person has to leave less than `STRONG` of the
/// error.
const NEAR_FLOOR: f64 = 2.0;
const STRONG: f64 = 0.70;

/// True if the options ask for an effect.
pub(crate) fn wanted(effect: &dyn Effect, options: &DiscoverOptions) -> bool {
    let named = |list: &[String]| list.iter().any(|n| n == effect.id());
    (options.only.is_empty() || named(&options.only)) && !named(&options.without)
}

/// True for an effect that cannot be found again beside those found before: an alias of one of
/// them, a generalisation of it, or the same on the whole body. A second one of a kind on another
/// link or plate can. Without flights, an alias on any target counts: gains of single plates
/// together with a wrong mass would scale both sides of every row to zero.
fn excluded(effect: &dyn Effect, already: &[(&dyn Effect, Target)], has_flights: bool) -> bool {
    already.iter().any(|(found, target)| {
        let again = found.id() == effect.id() && !matches!(target, Target::Link(_) | Target::Plate(_));
        // what contains the effect found (wind contains drag) would only describe it once more
        let wider = effect.about().contains.contains(&found.id());
        again || wider || (found.about().aliases.contains(&effect.id()) && (!has_flights || *target == Target::Body))
    })
}

/// Ranks all effects on a problem and judges the ranking. `beside` is the model in the
/// problem.
pub(crate) fn run_round<'a>(
    session: &Session<'_>,
    problem: &Problem,
    extra: &[Vec<DMatrix<f64>>],
    effects: &[&'a dyn Effect],
    already: &[(&dyn Effect, Target)],
    beside: &Refit<'_, '_>,
    first_round: bool,
    model: Vec<String>,
    has_flights: bool,
    at_floor: Option<&AtFloor>,
    options: &DiscoverOptions,
) -> (Round, Vec<EffectScore<'a>>, Vec<Rival<'a>>) {
    let all = effects;
    // beside a force that flights show, the zero of a plate would only undo what the force does in
    // contact; recordings that show it are not in doubt
    let flights_show_one = !beside.kept.is_empty() || beside.accepted.iter().any(|a| a.effect.acts().in_flight());
    let zeros_known = flights_show_one && session.blocks.iter().any(|b| b.zero.is_some());
    let used: Vec<(&'a dyn Effect, bool)> = effects
        .iter()
        .copied()
        .filter(|e| !(zeros_known && e.about().shows_unloaded))
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
    // On a person errors repeat from trial to trial (soft tissue, the prior), and where they are
    // most of what is left an effect that imitates them fits well. Differences between groups of
    // trials do not repeat.
    let near_floor = session.prior.is_some()
        && problem.domain == Domain::Flight
        && at_floor.is_some_and(|f| f.times(plain) < NEAR_FLOOR);
    // The errors of a rigid body do not repeat. A small effect is accepted there if it gains
    // twice as much as one in a hundred would by chance: the more flights, the smaller the
    // effect. The first one has to bring the error to its floor: a share of a large error is not
    // what is missing.
    let rigid = session.prior.is_none() && problem.domain == Domain::Flight;
    let small_is_all = !first_round || at_floor.is_none_or(|f| f.reached_by(plain * SMALLEST.powi(2)));
    let sharper = if rigid && small_is_all && clusters >= MANY_CLUSTERS && null_quantiles[0].is_finite() {
        null_quantiles[0].powi(2).min(SMALLEST)
    } else {
        0.0
    };
    let limit_for = |effect: &dyn Effect| {
        let limit = limit(effect, first_round, options);
        let limit = if near_floor && !effect.about().by_group { limit.min(STRONG) } else { limit };
        let small = if effect.about().family == Family::Forces { sharper } else { 0.0 };
        threshold.min(limit).max(small)
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
                && ratio < limit_for(score.effect)
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
                accepted_below: limit_for(score.effect),
                ci95,
                chosen_share: *share,
                family_wise_p: (beaten + 1) as f64 / (null.len() + 1) as f64,
                minimum_detectable: minimum_detectable(problem, best, best_square, threshold.max(sharper)),
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
    let (sharp, mut rivals) = rivals(session, problem, extra, &scores, &candidates, options);
    if let (true, Domain::Flight, Some(floor)) = (session.prior.is_some(), problem.domain, at_floor) {
        let n_judged = sharp.as_ref().unwrap_or(problem).n_judged as f64;
        for rival in &mut rivals {
            rival.at_floor = floor.times(rival.error() / n_judged) <= 1.0;
        }
    }
    let mut said_by_plates: Vec<String> = Vec::new();
    let (mut verdict, mut effects, rival_tests) = loop {
        let (mut verdict, mut effects, mut tests) = judge(session, sharp.as_ref().unwrap_or(problem), &rivals, options);
        let at_edge: Vec<String> = tests.iter().filter(|d| d.only_as_limit).map(|d| d.effect.clone()).collect();
        let named = matches!(verdict, Verdict::OneOf | Verdict::Supported) && problem.domain == Domain::Flight;
        let plates = named.then(|| beside.by_plates(session, &rivals, &effects, &at_edge)).flatten();
        let Some(plates) = plates else { break (verdict, effects, tests) };
        said_by_plates.extend(Some(plates.words).filter(|words| !words.is_empty()));
        if plates.ruled_out.is_empty() {
            effects.extend(plates.inside.iter().cloned());
            for test in tests.iter_mut().filter(|d| plates.inside.contains(&d.effect)) {
                test.only_as_limit = false;
            }
            verdict = if effects.len() == 1 { Verdict::Supported } else { Verdict::OneOf };
            break (verdict, effects, tests);
        }
        // others may have been left out in favour of what the plates rule out
        rivals.retain(|r| !plates.ruled_out.iter().any(|id| id == r.id()));
    };
    // the effect that the answer describes, that joins the model in later rounds and that the user
    // is told to add is one and the same
    if let Some(first) = to_build_on(&rivals, &effects, options)
        && let Some(at) = effects.iter().position(|id| id == first.id())
    {
        effects[..=at].rotate_right(1);
        // on the link on which it joins the model
        let key = key_of(session, &first.scored);
        if let Some(c) = candidates.iter_mut().find(|c| c.effect == first.id() && c.key != key) {
            (c.coefficients, c.nonlinear) = estimates(session, &first.scored);
            (c.key, c.target, c.trials) = (key, first.scored.variant.target, group_names(session, &first.scored));
        }
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
    let limits: Vec<&str> = rival_tests.iter().filter(|d| d.only_as_limit).map(|d| d.effect.as_str()).collect();
    let mut words = wording::round(verdict, &effects, &limits, &candidates, limit_of, few);
    for said in said_by_plates {
        words = format!("{words}; {said}");
    }
    let round = Round {
        judged_on: wording::domain(problem.domain).to_owned(),
        model,
        held_out_error: plain.sqrt() * session.unit[0],
        held_out_parts: parts(session, problem),
        threshold: threshold.max(sharper),
        null_quantiles,
        clusters,
        verdict,
        effects,
        joined: Vec::new(),
        missing: 0,
        superseded: false,
        words,
        rival_tests,
        candidates,
    };
    (round, scores, rivals)
}
