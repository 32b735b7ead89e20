//! From evidence to an answer: the likeliest explanation joins the model, and the rest is asked
//! again beside it.

use super::by_recording::ln_odds_by_recording;
use super::candidates::{explained, explanations};
use super::explanation::Explanation;
use super::form::{late, misfit};
use super::likelihood::Likelihood;
use super::model::Model;
use super::posterior::{EffectPosterior, Posterior};
use super::priors::{FAR_BEHIND, FURTHER, HELD, ODDS, SHARE, TO_THE_END, TURNS};
use crate::DiscoverError;
use crate::candidate::{Scored, pseudo_inverse, score};
use crate::ladder::estimates;
use crate::nonlinear::{columns_and_slopes, improve, score_fitted};
use crate::options::DiscoverOptions;
use crate::plausible::plausible;
use crate::result::{Found, Misfit};
use crate::session::Session;
use aloft_effects::{Effect, EffectInstance, Target};

/// One question: which effect is missing beside those found before.
#[derive(Clone)]
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
    /// True where something is likelier than "nothing", and the best explanation of it has a size
    /// that physics does not allow.
    pub at_limit: bool,
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
    /// Dependence of the strength of what was found on something that its law does not describe.
    pub misfit: Option<Misfit>,
}

/// Asks until nothing more is named.
pub(super) fn search<'a>(
    session: &Session<'_>,
    effects: &[&'a dyn Effect],
    accepted: &[EffectInstance<'_>],
    options: &DiscoverOptions,
) -> Result<Option<Search<'a>>, DiscoverError> {
    let Some(units) = session.in_noise_units() else { return Ok(None) };
    let mut out = Search { asked: Vec::new(), kept: Vec::new(), found: Vec::new(), left: f64::NAN, misfit: None };
    let mut at_first = f64::NAN;
    let keys: Vec<String> = accepted.iter().map(|c| c.key(session.scene())).collect();
    for question in 0..=options.rounds {
        let model = Model::of(&units, accepted, &out.kept, &out.found, options)?;
        out.left = model.left();
        if question == 0 {
            at_first = model.problem.rss;
        } else {
            out.misfit = misfit(&model, &out.kept, &out.found, at_first - model.problem.rss);
            for i in 0..if out.misfit.is_none() { out.kept.len() } else { 0 } {
                let mut others = out.kept.clone();
                let of = others.remove(i);
                let beside = Model::of(&units, accepted, &others, &[], options)?;
                out.misfit = out.misfit.or(late(&beside, &of, effects, &out.found[i].key));
            }
        }
        if question == options.rounds {
            break;
        }
        let mut asked = ask(&model, effects, None, &out.kept, options);
        asked.model.clone_from(&keys);
        asked.model.extend(out.found.iter().map(|f| f.key.clone()));
        let Some(best) = asked.best().cloned() else {
            out.asked.push(asked);
            break;
        };
        // what the effects found leave because they are idealised is no further effect
        if model.problem.rss - best.left <= FURTHER * (at_first - model.problem.rss) {
            asked.named.clear();
        }
        let named = !asked.named.is_empty();
        let likely = asked.posterior.effects.first().is_some_and(|e| e.ln_odds > ODDS.ln());
        if !named && (out.kept.is_empty() || !likely) {
            out.asked.push(asked);
            break;
        }
        let before = (out.kept.clone(), out.asked.clone());
        out.asked.push(asked.clone());
        out.kept.push(best);
        let beside = |kept: &[Explanation<'a>]| Model::of(&units, accepted, kept, &[], options);
        together(&mut out.kept, beside)?;
        exchange(&mut out, effects, &keys, options, beside)?;
        prune(&mut out, beside)?;
        // what is likely by rows alone may show that another one was a compromise; it stays only if
        // it is named in the end
        if out.asked.iter().any(|a| a.named.is_empty()) {
            (out.kept, out.asked) = before;
            out.asked.push(asked);
            break;
        }
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
    before: Option<&[EffectPosterior<'a>]>,
    kept: &[Explanation<'a>],
    options: &DiscoverOptions,
) -> Asked<'a> {
    let Model { session, problem, likelihood, .. } = model;
    // the same on the same place would be found again as its own remainder
    let mut of_effects = explanations(model, effects, before, options);
    for explanations in &mut of_effects {
        explanations.retain(|e| !kept.iter().any(|k| k.is_alike(e)));
    }
    of_effects.retain(|e| !e.is_empty());
    let posterior = Posterior::of(of_effects, likelihood.of_squares(problem.rss));
    let scored: Vec<Scored<'a>> =
        posterior.effects.iter().filter_map(|e| scored(model, &e.explanations.first()?.0, e.ln_odds > 0.0)).collect();
    let by_recording = scored.first().map_or(f64::NEG_INFINITY, |s| ln_odds_by_recording(problem, s));
    // a size at the edge of what physics allows is another cause in disguise
    let possible = scored.first().is_some_and(|s| plausible(s, &estimates(session, s).0));
    let sure = posterior.effects.first().is_some_and(|e| e.ln_odds.min(by_recording) > ODDS.ln());
    let mut named = Vec::new();
    if sure && possible {
        let mut held = 0.0;
        let all = 1.0 - posterior.nothing;
        for e in &posterior.effects {
            if held > HELD * all {
                break;
            }
            held += e.probability;
            named.extend(e.explanations.first().map(|(best, _)| best.variant.effect.id().to_owned()));
        }
        named.extend(other_names(&posterior, &named));
    }
    Asked {
        scored,
        by_recording,
        named,
        at_limit: sure && !possible,
        plain: problem.folds.iter().map(|f| f.error).collect(),
        likelihood: *likelihood,
        ln_nothing: likelihood.of_squares(problem.rss),
        left: model.left(),
        clusters: problem.folds.len(),
        posterior,
        model: Vec::new(),
    }
}

/// Other names of effects that act on the whole body or all plates: no recording tells them apart,
/// whatever the rows say.
fn other_names(posterior: &Posterior<'_>, named: &[String]) -> Vec<String> {
    let best = |id: &str| {
        posterior.effects.iter().filter_map(|e| Some(&e.explanations.first()?.0)).find(|e| e.place().0 == id)
    };
    let on_all = |id: &&String| best(id).is_some_and(|e| e.variant.target == Target::Body);
    let aliases = named.iter().filter(on_all).filter_map(|id| best(id)).flat_map(|e| e.variant.effect.about().aliases);
    let mut out: Vec<String> = Vec::new();
    for id in aliases.filter(|id| best(id).is_some()) {
        if !named.iter().chain(&out).any(|n| n == id) {
            out.push((*id).to_owned());
        }
    }
    out
}

/// An explanation with its errors on recordings left out; with unknowns fitted anew in each where
/// it may be named. Its standard errors are at least those of its posterior, in which errors that
/// all recordings share are unknown, too.
fn scored<'a>(model: &Model<'_>, explanation: &Explanation<'a>, may_be_named: bool) -> Option<Scored<'a>> {
    let Model { session, problem, likelihood, .. } = model;
    let variant = explanation.variant.clone();
    let nonlinear = !variant.effect.nonlinear(session.scene(), variant.target).is_empty();
    let mut out = if nonlinear && may_be_named {
        score_fitted(session, problem, variant)?
    } else {
        let columns = variant.columns(session, problem)?;
        score(problem, variant, &problem.reduce(&columns))
    };
    if may_be_named {
        let wide = columns_and_slopes(session, problem, &out.variant, &out.theta)?;
        let covariance = pseudo_inverse(&problem.reduce_all(&wide).0);
        let size = likelihood.in_noise(explanation.left).max(1.0);
        let of_posterior = covariance.diagonal().map(|v| size * v.max(0.0).sqrt());
        out.joint_se.resize(of_posterior.len(), 0.0);
        out.joint_se.iter_mut().zip(&of_posterior).for_each(|(se, of)| *se = se.max(*of));
    }
    Some(out)
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
    accepted: &[String],
    options: &DiscoverOptions,
    beside: impl Fn(&[Explanation<'a>]) -> Result<Model<'s>, DiscoverError> + Copy,
) -> Result<(), DiscoverError> {
    if search.kept.len() < 2 {
        return Ok(());
    }
    for turn in 0..TURNS {
        let mut changed = false;
        // the last one was asked for beside the others as they are, unless one of them changes
        for i in 0..search.kept.len() {
            if turn == 0 && i + 1 == search.kept.len() && !changed {
                break;
            }
            let mut others = search.kept.clone();
            others.remove(i);
            let model = beside(&others)?;
            let before = &search.asked[i].posterior.effects;
            let most = before.first().map_or(0.0, |e| e.ln_odds);
            let near: Vec<&str> = before
                .iter()
                .filter(|e| e.ln_odds > (SHARE * most).min(most - FAR_BEHIND))
                .filter_map(|e| Some(e.explanations.first()?.0.variant.effect.id()))
                .collect();
            let rivals: Vec<&'a dyn Effect> = effects.iter().copied().filter(|e| near.contains(&e.id())).collect();
            let asked = ask(&model, &rivals, Some(before), &others, options);
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
                let mut of_model = accepted.to_vec();
                of_model.extend(others.iter().map(|k| k.key(model.session)));
                search.asked[i] = Asked { model: of_model, ..asked };
            }
        }
        if !changed {
            break;
        }
        together(&mut search.kept, beside)?;
    }
    Ok(())
}

/// Takes out what the others explain as well once they are fitted without it: what was found first
/// may be a compromise between two found later.
fn prune<'a, 's>(
    search: &mut Search<'a>,
    beside: impl Fn(&[Explanation<'a>]) -> Result<Model<'s>, DiscoverError> + Copy,
) -> Result<(), DiscoverError> {
    let mut i = 0;
    while search.kept.len() > 1 && i < search.kept.len() {
        let all = beside(&search.kept)?;
        let mut others = search.kept.clone();
        let of = others.remove(i);
        together(&mut others, beside)?;
        let without = beside(&others)?.problem.rss;
        let cost = all.likelihood.of_squares(of.left) - of.ln_likelihood;
        let gain = all.likelihood.of_squares(all.problem.rss) - all.likelihood.of_squares(without);
        if gain - cost < ODDS.ln() {
            search.kept = others;
            search.asked.remove(i);
            i = 0;
        } else {
            i += 1;
        }
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
        if let Some(scored) = scored(&model, &kept[i], true) {
            out.push(crate::ladder::as_found(session, &scored));
        }
    }
    Ok(out)
}
