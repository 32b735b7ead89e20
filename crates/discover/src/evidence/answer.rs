//! What is said, from evidence.

use super::posterior::EffectPosterior;
use super::priors::{NOISE_FREEDOM, ODDS};
use super::search::{Asked, Search, search};
use crate::DiscoverError;
use crate::candidate::Scored;
use crate::held_out::{HeldOutResult, LACK_OF_FIT};
use crate::judge::plausible;
use crate::ladder::{estimates, group_names, key_of};
use crate::not_tried::not_tried;
use crate::options::DiscoverOptions;
use crate::problem::Domain;
use crate::result::{
    Alternative, Candidate, CandidateEvidence, Discovery, FEWEST_CLUSTERS, Found, Group, Round, SessionEvidence,
    Verdict,
};
use crate::round::wanted;
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
    session.counter.expect(2 * effects.iter().filter(|e| wanted(**e, options)).count());
    let Some(made) = search(session, effects, accepted, options)? else {
        return Err(DiscoverError::TooFew {
            what: "draws of the recordings' errors (`aloft compare`)",
            needed: 1,
            found: 0,
        });
    };
    let has_flights = session.blocks.iter().any(|b| b.kind != StretchKind::Contact);
    let place = usize::from(!has_flights);
    let domain = wording::domain([Domain::Flight, Domain::Contact][place]);
    let rounds: Vec<Round> = made.asked.iter().map(|a| round(session, a, domain, options)).collect();
    let mut found = made.found.clone();
    let computed = session.by_stages.with(&found);
    if let Some(staged) = &computed {
        staged.restate(&mut found);
    }
    for (f, asked) in found.iter_mut().zip(&made.asked) {
        f.also_on = other_links(session, f, asked);
    }
    let before = session.model_error[place];
    let share = made.left / made.asked.first().map_or(f64::NAN, |a| a.left);
    let estimated = before.map(|b| HeldOutResult { held_out_error: b.held_out_error * share, ..b });
    let by_parameters = before.and_then(|b| b.by_parameters);
    let staged = computed.as_ref().and_then(|c| c.errors[place]).map(|s| HeldOutResult { by_parameters, ..s });
    let after = if found.is_empty() { before } else { staged.or(estimated) };
    let groups: Vec<Group> = made.asked.iter().filter(|a| !a.named.is_empty()).map(|a| group(&a.named)).collect();
    let elsewhere = session.model_error[1 - place].filter(|_| found.is_empty());
    let verdict = verdict(&made, &groups, [before, after], elsewhere);
    let named = matches!(verdict, Verdict::Supported | Verdict::OneOf);
    let groups = if named { groups } else { Vec::new() };
    let weight = session.unit[0];
    let error = |e: Option<HeldOutResult>| e.map_or(f64::NAN, |e| e.held_out_error);
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
        held_out_error: error(before),
        held_out_error_after: error(after),
        held_out_error_of_weight: error(before) / weight,
        candidates: rounds.first().map(|r| r.candidates.clone()).unwrap_or_default(),
        rounds,
        ladder: Vec::new(),
        found,
        advice: Vec::new(),
        warnings: session.warnings.clone(),
        failed: session.failed().into_iter().collect(),
        not_tried: effects
            .iter()
            .filter(|e| wanted(**e, options) && !e.acts().in_joints())
            .filter_map(|e| not_tried(session, *e, Domain::Both))
            .collect(),
        misfit: None,
        against: None,
        open: None,
        to_correct: None,
        joints: None,
        evidence: Some(SessionEvidence {
            residual_before: made.asked.first().map_or(f64::NAN, |a| a.left),
            residual_after: made.left,
            nothing: made.asked.first().map_or(f64::NAN, |a| a.posterior.nothing),
        }),
    };
    out.words = words(&out, before);
    out.advice = wording::advice(&out, effects);
    Ok(out)
}

/// The verdict, from the evidence and from how the error stands to its floor.
fn verdict(
    made: &Search<'_>,
    groups: &[Group],
    [before, after]: [Option<HeldOutResult>; 2],
    elsewhere: Option<HeldOutResult>,
) -> Verdict {
    // nothing is missing only where flight and contact both are at their floors
    if groups.is_empty() && elsewhere.is_some_and(|e| e.is_above()) {
        return Verdict::Unexplained;
    }
    let few = made.asked.first().is_none_or(|a| a.clusters < FEWEST_CLUSTERS);
    let above_noise = made.left > most_by_noise();
    if !groups.is_empty() && !few {
        // what was found is a part of what is missing
        let too_much = match before.zip(after) {
            Some((before, after)) => above_noise && (after.is_far() || before.share_left(&after) > LACK_OF_FIT),
            None => above_noise,
        };
        if too_much {
            return Verdict::Unexplained;
        }
        let alone = groups.iter().all(Group::is_sure);
        return if alone { Verdict::Supported } else { Verdict::OneOf };
    }
    match before {
        Some(b) if b.is_above() => Verdict::Unexplained,
        Some(b) if few || b.is_undecided() || b.is_between() => Verdict::NotDetectable,
        None if above_noise => Verdict::Unexplained,
        _ if few => Verdict::NotDetectable,
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
        held_out_parts: [f64::NAN; 2],
        threshold: f64::NAN,
        null_quantiles: [f64::NAN; 3],
        clusters: asked.clusters,
        verdict,
        effects: asked.named.clone(),
        joined: asked.named.first().cloned().into_iter().collect(),
        missing: usize::from(!asked.named.is_empty()),
        superseded: false,
        words: wording::by_evidence(verdict, &asked.named, &candidates, few),
        rival_tests: Vec::new(),
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
        accepted_below: 0.0,
        ci95: ratio_interval(&scored.fold_error, &asked.plain, weights),
        chosen_share: of.probability,
        family_wise_p: f64::NAN,
        minimum_detectable: detectable(asked, scored, of),
        plausible: plausible(scored, &coefficients),
        coefficients,
        nonlinear,
        trials: group_names(session, scored),
        confused_with: Vec::new(),
        believed: asked.named.iter().any(|n| n == effect.id()),
        placebo: false,
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

fn words(d: &Discovery, before: Option<HeldOutResult>) -> String {
    let Some(e) = &d.evidence else { return String::new() };
    let noise = |x: f64| format!("{x:.2} times the noise");
    let said: Vec<&str> = d
        .rounds
        .iter()
        .filter(|r| matches!(r.verdict, Verdict::Supported | Verdict::OneOf))
        .map(|r| r.words.as_str())
        .collect();
    match d.verdict {
        Verdict::Supported | Verdict::OneOf => {
            format!(
                "{}; {} remains, without {}",
                said.join("; then "),
                noise(e.residual_after),
                noise(e.residual_before)
            )
        }
        Verdict::NothingMissing => {
            format!("nothing missing: the model leaves {}, and no effect has odds of 20 to 1", noise(e.residual_before))
        }
        Verdict::NotDetectable => match before {
            Some(s) if s.is_undecided() => wording::undecided(d, &s),
            _ => wording::by_evidence(d.verdict, &[], &d.candidates, true),
        },
        Verdict::Unexplained => {
            let part = if said.is_empty() { String::new() } else { format!("; part of it: {}", said.join("; then ")) };
            format!("unexplained: {} remains, and the held-out error is above its floor{part}", noise(e.residual_after))
        }
    }
}
