//! What is said, from evidence.

use super::beyond::look;
use super::explanation::Explanation;
use super::posterior::EffectPosterior;
use super::priors::{IDEALISED, NOISE_FREEDOM, ODDS};
use super::search::{Asked, Search, search};
use super::sizes::predicts_as_well;
use crate::DiscoverError;
use crate::addition::addition;
use crate::by_stages::Staged;
use crate::candidate::{Scored, Variant};
use crate::held_out::HeldOutResult;
use crate::ladder::{estimates, extra_columns, group_names, key_of};
use crate::not_tried::not_tried;
use crate::options::DiscoverOptions;
use crate::plausible::plausible;
use crate::problem::{Domain, Problem};
use crate::repeating::widen;
use crate::result::{
    Addition, Alternative, Candidate, CandidateEvidence, Discovery, FEWEST_CLUSTERS, Found, Group, Round,
    SessionEvidence, Verdict,
};
use crate::session::Session;
use crate::statistics::{ratio_interval, resamples};
use crate::wording;
use aloft_effects::{Effect, EffectInstance};
use aloft_regressor::StretchKind;

/// Chi-square with [`NOISE_FREEDOM`] degrees of freedom below which it lies in 2.5 % of cases.
const CHI_SQUARE_LOW: f64 = 9.591;

/// Largest error, in units of the noise, that the noise's own uncertainty accounts for in 97.5 % of
/// sessions.
fn most_by_noise() -> f64 {
    (NOISE_FREEDOM / CHI_SQUARE_LOW).sqrt()
}

/// Searches for missing effects by one marginal likelihood over flights and contact together.
///
/// # Errors
/// As [`discover`](crate::discover()); [`DiscoverError::TooFew`] without draws of the recordings'
/// errors, which a comparison makes.
pub(crate) fn by_evidence(
    session: &Session<'_>,
    effects: &[&dyn Effect],
    accepted: &[EffectInstance<'_>],
    options: &DiscoverOptions,
) -> Result<Discovery, DiscoverError> {
    session.counter.expect(2 * effects.iter().filter(|e| options.asks_for(**e)).count());
    let Some(made) = search(session, effects, accepted, options)? else {
        return Err(DiscoverError::TooFew {
            what: "draws of the recordings' errors (`aloft compare`)",
            needed: 1,
            found: 0,
        });
    };
    let has_flights = session.blocks.iter().any(|b| b.kind != StretchKind::Contact);
    let mut found = made.found.clone();
    widen_all(session, accepted, &made, &mut found, options);
    let computed = by_stages(session, &made, &mut found);
    for (f, asked) in found.iter_mut().zip(&made.asked) {
        f.also_on = other_links(session, f, asked);
    }
    // errors of the plates are judged where the plates measure
    let in_flight = has_flights && (made.kept.is_empty() || made.kept.iter().any(Explanation::acts_in_flight));
    let place = usize::from(!in_flight);
    let domain = wording::domain([Domain::Flight, Domain::Contact][place]);
    let rounds: Vec<Round> = made.asked.iter().map(|a| round(session, a, domain, options)).collect();
    let share = made.left / made.asked.first().map_or(f64::NAN, |a| a.left);
    let errors = [0, 1].map(|i| {
        let before = session.model_error[i]?;
        let staged = computed.as_ref().and_then(|c| c.errors[i]);
        let estimated = HeldOutResult { held_out_error: before.held_out_error * share, ..before };
        match staged {
            Some(staged) => Some(HeldOutResult { by_parameters: before.by_parameters, ..staged }),
            None if found.is_empty() => Some(before),
            None => Some(estimated).filter(|_| i == place),
        }
    });
    let before = session.model_error[place];
    let (after, by_parameters) = (errors[place], before.and_then(|b| b.by_parameters));
    let groups: Vec<Group> = made.asked.iter().filter(|a| !a.named.is_empty()).map(|a| group(&a.named)).collect();
    let elsewhere = session.model_error[1 - place].filter(|_| found.is_empty());
    let verdict = verdict(&made, &groups, before, elsewhere);
    let named = matches!(verdict, Verdict::Supported | Verdict::OneOf);
    let groups = if named { groups } else { Vec::new() };
    let weight = session.unit[0];
    // without a comparison the rows alone say how large the error is
    let of_rows = |share: f64| match before {
        Some(_) => f64::NAN,
        None => share * held_out_by_rows(session, accepted, [Domain::Flight, Domain::Contact][place], options),
    };
    let [error_before, error_after] =
        [(before, 1.0), (after, share)].map(|(e, share)| e.map_or_else(|| of_rows(share), |e| e.held_out_error));
    let mut named_effects: Vec<String> = Vec::new();
    for id in groups.iter().flat_map(|g| &g.effects) {
        if !named_effects.contains(id) {
            named_effects.push(id.clone());
        }
    }
    let mut out = Discovery {
        schema: 1,
        verdict,
        effects: named_effects,
        groups,
        words: String::new(),
        noise_floor: before.map_or(f64::NAN, |s| s.noise_floor),
        noise_floor_ci95: before.and_then(|s| s.noise_floor_ci95),
        error_by_parameters: by_parameters,
        held_out_error: error_before,
        held_out_error_after: error_after,
        held_out_error_of_weight: error_before / weight,
        candidates: rounds.first().map(|r| r.candidates.clone()).unwrap_or_default(),
        rounds,
        ladder: steps(session, accepted, &made, &found, options),
        found,
        advice: Vec::new(),
        warnings: session.warnings.clone(),
        failed: session.failed().into_iter().collect(),
        not_tried: effects
            .iter()
            .filter(|e| options.asks_for(**e) && !e.acts().in_joints())
            .filter_map(|e| not_tried(session, *e, Domain::Both))
            .collect(),
        misfit: made.misfit.clone(),
        open: None,
        to_correct: None,
        joints: None,
        evidence: Some(SessionEvidence {
            residual_before: made.asked.first().map_or(f64::NAN, |a| a.left),
            residual_after: made.left,
            nothing: made.asked.first().map_or(f64::NAN, |a| a.posterior.nothing),
        }),
    };
    out.words = words(&out, before, errors);
    if out.verdict == Verdict::Unexplained && has_flights && !options.closed && options.only.is_empty() {
        look(session, effects, accepted, &made, options, &mut out);
    }
    out.advice = wording::advice(&out, effects);
    if !has_flights {
        let untried = effects.iter().filter(|e| options.asks_for(**e) && e.acts().in_flight() && !e.acts().in_joints());
        out.warnings.push(wording::no_flights(untried.count()));
    }
    Ok(out)
}

/// Widens the intervals of what was found by errors that are the same in all recordings.
fn widen_all(
    session: &Session<'_>,
    accepted: &[EffectInstance<'_>],
    made: &Search<'_>,
    found: &mut [Found],
    options: &DiscoverOptions,
) {
    let kept: Vec<Variant<'_>> = made.kept.iter().map(|k| k.variant.clone()).collect();
    let of = |v: &[Variant<'_>]| extra_columns(session, Domain::Both, accepted, v, &[]);
    for (i, f) in found.iter_mut().enumerate() {
        let mut others = kept.clone();
        let own = others.remove(i);
        let estimates = (&mut f.coefficients[..], &mut f.nonlinear[..]);
        widen(session, Domain::Both, &of(&others), &of(&kept), &own, estimates, &|_| None, options);
    }
}

/// The model with what was found, computed by all stages: with sizes from flights and contact where
/// these predict as well. The estimates become those of the model.
fn by_stages(session: &Session<'_>, made: &Search<'_>, found: &mut Vec<Found>) -> Option<Staged> {
    let mut computed = session.by_stages.with(found)?;
    let always = |k: &Explanation<'_>| k.acts_in_flight() && k.variant.effect.acts().in_contact();
    let mut sized = found.clone();
    sized.iter_mut().zip(&made.kept).for_each(|(f, k)| f.sized_with_contact = always(k));
    if computed.errors[1].is_some()
        && sized.iter().any(|f| f.sized_with_contact)
        && let Some(both) = session.by_stages.with(&sized)
        && predicts_as_well(computed.errors, both.errors)
    {
        (*found, computed) = (sized, both);
    }
    computed.restate(found);
    Some(computed)
}

/// What each effect found adds to the model that holds those before it.
fn steps<'e>(
    session: &Session<'_>,
    accepted: &[EffectInstance<'e>],
    made: &Search<'e>,
    found: &[Found],
    options: &DiscoverOptions,
) -> Vec<Addition> {
    let mut model: Vec<EffectInstance<'e>> = accepted.to_vec();
    let mut steps = Vec::new();
    for (Explanation { variant, .. }, f) in made.kept.iter().zip(found) {
        let nonlinear = f.nonlinear.iter().map(|e| e.value).collect();
        let (effect, target) = (variant.effect, variant.target);
        let choice = EffectInstance { effect, target, nonlinear, trials: f.trials.clone() };
        steps.extend(session.or_named(addition(session, &model, &choice, options)));
        model.push(choice);
    }
    steps
}

/// Held-out error of the model on the rows alone, N.
fn held_out_by_rows(
    session: &Session<'_>,
    accepted: &[EffectInstance<'_>],
    domain: Domain,
    options: &DiscoverOptions,
) -> f64 {
    let extra = extra_columns(session, domain, accepted, &[], &[]);
    let problem = Problem::if_possible(session, domain, &extra, options);
    problem.map_or(f64::NAN, |p| p.plain().sqrt() * session.unit[0])
}

/// The verdict, from the evidence and from how the error stands to its floor.
fn verdict(
    made: &Search<'_>,
    groups: &[Group],
    before: Option<HeldOutResult>,
    elsewhere: Option<HeldOutResult>,
) -> Verdict {
    // nothing is missing only where flight and contact both are at their floors
    if groups.is_empty() && elsewhere.is_some_and(|e| e.is_above()) {
        return Verdict::Unexplained;
    }
    let few = made.asked.first().is_none_or(|a| a.clusters < FEWEST_CLUSTERS);
    let above_noise = made.left > most_by_noise();
    // something is missing, and what describes it best cannot be it
    let at_limit = !few && made.asked.first().is_some_and(|a| a.at_limit);
    if !groups.is_empty() && !few {
        // what was found is a part of what is missing
        let [left, at_first] = [made.left, made.asked.first().map_or(f64::NAN, |a| a.left)].map(|x| x * x - 1.0);
        if made.misfit.is_some() || above_noise && left > IDEALISED * at_first {
            return Verdict::Unexplained;
        }
        let alone = groups.iter().all(Group::is_sure);
        return if alone { Verdict::Supported } else { Verdict::OneOf };
    }
    match before {
        Some(b) if b.is_above() || at_limit && !b.is_below() => Verdict::Unexplained,
        Some(b) if few || b.is_below() || b.is_undecided() || b.is_between() => Verdict::NotDetectable,
        None if above_noise || at_limit => Verdict::Unexplained,
        _ if few || made.asked.first().is_none_or(|a| a.scored.is_empty()) => Verdict::NotDetectable,
        _ => Verdict::NothingMissing,
    }
}

fn group(named: &[String]) -> Group {
    Group { effects: named.to_vec(), missing: 1 }
}

fn round(session: &Session<'_>, asked: &Asked<'_>, domain: &str, options: &DiscoverOptions) -> Round {
    let weights = resamples(asked.plain.len(), options.resamples, options.seed ^ 0x5eed);
    let candidates: Vec<Candidate> =
        asked.scored.iter().filter_map(|s| candidate(session, asked, s, domain, &weights)).collect();
    let few = asked.clusters < FEWEST_CLUSTERS;
    let verdict = match asked.named.len() {
        _ if few => Verdict::NotDetectable,
        0 => Verdict::NothingMissing,
        1 => Verdict::Supported,
        _ => Verdict::OneOf,
    };
    Round {
        judged_on: domain.to_owned(),
        model: asked.model.clone(),
        held_out_error: asked.left * session.unit[0],
        clusters: asked.clusters,
        verdict,
        effects: asked.named.clone(),
        missing: usize::from(!asked.named.is_empty()),
        words: wording::beside(&asked.model, &wording::by_evidence(verdict, &asked.named, &candidates, few)),
        candidates,
    }
}

fn candidate(
    session: &Session<'_>,
    asked: &Asked<'_>,
    scored: &Scored<'_>,
    domain: &str,
    weights: &[Vec<f64>],
) -> Option<Candidate> {
    let effect = scored.variant.effect;
    let of = asked
        .posterior
        .effects
        .iter()
        .find(|e| e.explanations.iter().any(|x| x.0.variant.effect.id() == effect.id()))?;
    let best = &of.explanations.first()?.0;
    let (coefficients, nonlinear) = estimates(session, scored);
    let error: f64 = scored.fold_error.iter().sum();
    let plain: f64 = asked.plain.iter().sum();
    let is_first = asked.scored.first().is_some_and(|s| s.variant.effect.id() == effect.id());
    Some(Candidate {
        effect: effect.id().to_owned(),
        key: key_of(session, scored),
        target: scored.variant.target,
        kind: effect.kind(),
        class: effect.about().class.to_owned(),
        judged_on: domain.to_owned(),
        held_out_ratio: (error / plain).sqrt(),
        ci95: ratio_interval(&scored.fold_error, &asked.plain, weights),
        minimum_detectable: detectable(asked, scored, of),
        plausible: plausible(scored, &coefficients),
        coefficients,
        nonlinear,
        trials: group_names(session, scored),
        believed: asked.named.iter().any(|n| n == effect.id()),
        alternatives: of
            .explanations
            .iter()
            .map(|(e, _)| Alternative {
                key: EffectInstance { effect, target: e.variant.target, nonlinear: Vec::new(), trials: Vec::new() }
                    .key(session.scene()),
                held_out_ratio: asked.likelihood.in_noise(e.left) / asked.left,
            })
            .collect(),
        evidence: Some(CandidateEvidence {
            ln_odds: of.ln_odds,
            ln_odds_by_recording: is_first.then_some(asked.by_recording).filter(|x| x.is_finite()),
            probability: of.probability,
            residual: asked.likelihood.in_noise(best.left),
        }),
    })
}

/// Size that four of five sessions like this one would show with odds of 20 to 1, in the unit of
/// the first coefficient; what the best explanation leaves is its noise.
fn detectable(asked: &Asked<'_>, scored: &Scored<'_>, of: &EffectPosterior<'_>) -> f64 {
    /// Standard deviations above which a normal variable lies in one of five cases.
    const ONE_OF_FIVE: f64 = 0.842;
    let unit = scored.variant.coefficients.first().map(|c| c.unit.as_str());
    let alike = |k: usize| scored.variant.coefficients.get(k).map(|c| c.unit.as_str()) == unit;
    let information =
        (0..scored.s.nrows()).filter(|&k| alike(k)).map(|k| scored.s[(k, k)]).fold(f64::INFINITY, f64::min);
    let left = asked
        .posterior
        .effects
        .iter()
        .filter_map(|e| Some(e.explanations.first()?.0.left))
        .fold(f64::INFINITY, f64::min);
    let size = (left / asked.likelihood.n).max(1.0);
    // what its unknowns and its choice among others cost
    let Some(best) = of.explanations.first() else { return f64::NAN };
    let cost = asked.likelihood.of_squares(best.0.left) - asked.ln_nothing - of.ln_odds;
    ((2.0 * (ODDS.ln() + cost.max(0.0))).sqrt() + ONE_OF_FIVE) * (size / information).sqrt()
}

/// Links on which the effect found is likely, too, the likeliest first.
fn other_links(session: &Session<'_>, found: &Found, asked: &Asked<'_>) -> Vec<String> {
    let Some(of) = asked.posterior.effects.first() else { return Vec::new() };
    let mut held = 0.0;
    let mut out: Vec<String> = Vec::new();
    for (explanation, share) in &of.explanations {
        if held > super::priors::HELD {
            break;
        }
        held += share;
        if explanation.variant.target != found.target
            && let aloft_effects::Target::Link(link) = explanation.variant.target
            && let Some(name) = session.scene().model.links.get(link).map(|l| l.name.clone())
            && !out.contains(&name)
        {
            out.push(name);
        }
    }
    out
}

/// The answer in words; `errors` are those of flight and contact with what was found, where they
/// are judged.
fn words(d: &Discovery, before: Option<HeldOutResult>, errors: [Option<HeldOutResult>; 2]) -> String {
    let places = [Domain::Flight, Domain::Contact];
    let judged = || places.into_iter().zip(errors).filter_map(|(place, e)| Some((place, e?)));
    let times =
        |a: &(Domain, HeldOutResult), b: &(Domain, HeldOutResult)| a.1.times_floor().total_cmp(&b.1.times_floor());
    match (d.verdict, before) {
        (Verdict::Unexplained, _) if d.misfit.is_some() => wording::of_another_form(d),
        (Verdict::Unexplained, _) => match judged().max_by(times) {
            Some((place, e)) => wording::unexplained(d, wording::domain(place), &e),
            None => format!("unexplained; {}", wording::answer(d)),
        },
        (Verdict::NotDetectable, Some(e)) if e.is_below() => wording::below(&e),
        (Verdict::NotDetectable, Some(e)) if e.is_undecided() => wording::undecided(d, &e),
        (Verdict::NotDetectable, _) => match judged().filter(|(_, e)| e.is_between()).max_by(times) {
            Some((place, e)) => wording::between(d, place, &e),
            None => wording::answer(d),
        },
        _ => wording::answer(d),
    }
}
