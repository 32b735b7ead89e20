//! From evidence to an answer: the likeliest explanation joins the model, and the rest is asked
//! again beside it.

use super::by_recording::ln_odds_by_recording;
use super::candidates::{Explanation, explained, explanations};
use super::likelihood::Likelihood;
use super::model::Model;
use super::posterior::{EffectPosterior, Posterior};
use super::priors::{HELD, ODDS, TO_THE_END, TURNS};
use crate::DiscoverError;
use crate::candidate::{Scored, score};
use crate::nonlinear::{improve, score_fitted};
use crate::options::DiscoverOptions;
use crate::problem::Problem;
use crate::result::Found;
use crate::session::Session;
use aloft_effects::{Effect, EffectInstance};

/// One question: which effect is missing beside those found before.
pub(super) struct Asked<'a> {
    pub posterior: Posterior<'a>,
    /// The best explanation of each effect, judged on recordings left out, in the order of the
    /// posterior.
    pub scored: Vec<Scored<'a>>,
    /// Logarithm of the odds that recordings left out one by one give the best one.
    pub by_recording: f64,
    /// Effects that hold 95 % of what is not "nothing", the likeliest first; none where "nothing"
    /// stands.
    pub named: Vec<String>,
    /// Held-out squares of each recording (or stretch) without a further effect.
    pub plain: Vec<f64>,
    pub likelihood: Likelihood,
    /// Logarithm of the marginal likelihood of "nothing missing".
    pub ln_nothing: f64,
    /// Root mean square before, in units of the noise.
    pub left: f64,
    /// Recordings (or stretches) that count.
    pub clusters: usize,
    /// Keys of the model before.
    pub model: Vec<String>,
}

/// What the search made.
pub(super) struct Search<'a> {
    pub asked: Vec<Asked<'a>>,
    pub kept: Vec<Explanation<'a>>,
    pub found: Vec<Found>,
    /// Root mean square with what was found, in units of the noise.
    pub left: f64,
}

/// Asks until nothing more is named.
pub(super) fn search<'a>(
    session: &Session<'_>,
    effects: &[&'a dyn Effect],
    accepted: &[EffectInstance<'_>],
    options: &DiscoverOptions,
) -> Result<Option<Search<'a>>, DiscoverError> {
    let Some(units) = session.in_noise_units() else { return Ok(None) };
    let mut out = Search { asked: Vec::new(), kept: Vec::new(), found: Vec::new(), left: f64::NAN };
    for question in 0..=options.rounds {
        let model = Model::of(&units, accepted, &out.kept, &out.found, options)?;
        out.left = model.left();
        if question == options.rounds {
            break;
        }
        let mut asked = ask(&model, effects, &out.kept, options);
        asked.model = accepted.iter().map(|c| c.key(session.scene())).collect();
        asked.model.extend(out.found.iter().map(|f| f.key.clone()));
        let best = asked.best().cloned();
        let named = !asked.named.is_empty();
        out.asked.push(asked);
        let Some(best) = best.filter(|_| named) else { break };
        out.kept.push(best);
        let beside = |kept: &[Explanation<'a>]| Model::of(&units, accepted, kept, &[], options);
        together(&mut out.kept, beside)?;
        exchange(&mut out, effects, options, beside)?;
        out.found = found(session, &out.kept, beside)?;
    }
    Ok(Some(out))
}

impl<'a> Asked<'a> {
    /// The best explanation of the likeliest effect.
    fn best(&self) -> Option<&Explanation<'a>> {
        Some(&self.posterior.effects.first()?.explanations.first()?.0)
    }
}

fn ask<'a>(
    model: &Model<'_>,
    effects: &[&'a dyn Effect],
    kept: &[Explanation<'a>],
    options: &DiscoverOptions,
) -> Asked<'a> {
    let Model { session, problem, likelihood, .. } = model;
    // the same on the same place would be found again as its own remainder
    let mut of_effects = explanations(model, effects, options);
    for explanations in &mut of_effects {
        explanations.retain(|e| !kept.iter().any(|k| k.is_alike(e)));
    }
    of_effects.retain(|e| !e.is_empty());
    let posterior = Posterior::of(of_effects, likelihood.of_squares(problem.rss));
    let scored: Vec<Scored<'a>> = posterior
        .effects
        .iter()
        .filter_map(|e| scored(session, problem, &e.explanations.first()?.0, e.ln_odds > 0.0))
        .collect();
    let by_recording = scored.first().map_or(f64::NEG_INFINITY, |s| ln_odds_by_recording(problem, s));
    let sure = |e: &EffectPosterior<'_>| e.ln_odds.min(by_recording) > ODDS.ln();
    let mut named = Vec::new();
    if posterior.effects.first().is_some_and(sure) {
        let mut held = 0.0;
        let all = 1.0 - posterior.nothing;
        for e in &posterior.effects {
            if held > HELD * all {
                break;
            }
            held += e.probability;
            named.extend(e.explanations.first().map(|(best, _)| best.variant.effect.id().to_owned()));
        }
    }
    Asked {
        scored,
        by_recording,
        named,
        plain: problem.folds.iter().map(|f| f.error).collect(),
        likelihood: *likelihood,
        ln_nothing: likelihood.of_squares(problem.rss),
        left: model.left(),
        clusters: problem.folds.len(),
        posterior,
        model: Vec::new(),
    }
}

/// An explanation with its errors on recordings left out; with unknowns fitted anew in each where
/// it may be named.
fn scored<'a>(
    session: &Session<'_>,
    problem: &Problem,
    explanation: &Explanation<'a>,
    may_be_named: bool,
) -> Option<Scored<'a>> {
    let variant = explanation.variant.clone();
    let nonlinear = !variant.effect.nonlinear(session.scene(), variant.target).is_empty();
    if nonlinear && may_be_named {
        return score_fitted(session, problem, variant);
    }
    let columns = variant.columns(session, problem)?;
    Some(score(problem, variant, &problem.reduce(&columns)))
}

/// Effects fitted together: each beside the others as they are by then, in turn.
fn together<'a, 's>(
    kept: &mut [Explanation<'a>],
    beside: impl Fn(&[Explanation<'a>]) -> Result<Model<'s>, DiscoverError>,
) -> Result<(), DiscoverError> {
    if kept.len() < 2 {
        return Ok(());
    }
    for _ in 0..TURNS {
        let before: f64 = kept.iter().map(|k| k.left).sum();
        for i in 0..kept.len() {
            let mut others = kept.to_vec();
            others.remove(i);
            let model = beside(&others)?;
            let variant = kept[i].variant.clone();
            let better = improve(model.session, &model.problem, &variant, TO_THE_END).map_or(variant, |b| b.0);
            if let Some(now) = explained(&model, better) {
                kept[i] = now;
            }
        }
        let after: f64 = kept.iter().map(|k| k.left).sum();
        if after > 0.99 * before {
            break;
        }
    }
    Ok(())
}

/// Each effect asked for again beside the others, as long as another one takes its place: what is
/// likeliest alone may be a compromise between two.
fn exchange<'a, 's>(
    search: &mut Search<'a>,
    effects: &[&'a dyn Effect],
    options: &DiscoverOptions,
    beside: impl Fn(&[Explanation<'a>]) -> Result<Model<'s>, DiscoverError> + Copy,
) -> Result<(), DiscoverError> {
    if search.kept.len() < 2 {
        return Ok(());
    }
    for _ in 0..TURNS {
        let mut changed = false;
        for i in 0..search.kept.len() {
            let mut others = search.kept.clone();
            others.remove(i);
            let model = beside(&others)?;
            let asked = ask(&model, effects, &others, options);
            if asked.named.is_empty() {
                // beside the others nothing speaks for it any more
                search.kept.remove(i);
                search.asked.remove(i);
                changed = true;
                break;
            }
            if let Some(best) = asked.best().cloned() {
                changed |= best.place() != search.kept[i].place();
                search.kept[i] = best;
                let model = std::mem::take(&mut search.asked[i].model);
                search.asked[i] = Asked { model, ..asked };
            }
        }
        if !changed {
            break;
        }
        together(&mut search.kept, beside)?;
    }
    Ok(())
}

/// What was found, with estimates beside all the others.
fn found<'a, 's>(
    session: &Session<'_>,
    kept: &[Explanation<'a>],
    beside: impl Fn(&[Explanation<'a>]) -> Result<Model<'s>, DiscoverError>,
) -> Result<Vec<Found>, DiscoverError> {
    let mut out = Vec::new();
    for i in 0..kept.len() {
        let mut others = kept.to_vec();
        others.remove(i);
        let model = beside(&others)?;
        if let Some(scored) = scored(model.session, &model.problem, &kept[i], true) {
            out.push(crate::ladder::as_found(session, &scored));
        }
    }
    Ok(out)
}
