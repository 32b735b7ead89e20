//! The rounds: rank, judge, add, rank again.

use crate::candidate::{Scored, Variant};
use crate::pairs::better_pair;
use crate::placebo::PLACEBOS;
use crate::problem::{Domain, Problem};
use crate::rank::{EffectScore, cosine, judged_in, null_ratios, score_effect};
use crate::result::{Alternative, Candidate, Confusion, Discovery, Estimate, Found, Round, Verdict};
use crate::session::Session;
use crate::statistics::{jackknife_se, ratio_interval, resamples, sign_flip_p};
use crate::{DiscoverError, words};
use aloft_effects::{Choice, Effect};
use aloft_regressor::StretchKind;
use nalgebra::{DMatrix, DVector};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

/// How a discovery is made.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct DiscoverOptions {
    /// A held-out ratio above this is never believed.
    pub belief: f64,
    /// The same for faults of kinematics (soft tissue, joint centres, filters, camera volume, flight edges). Every recording has some of them, so
    /// only a great one is worth a name, and only before any other effect was found.
    pub belief_kinematics: f64,
    /// The same for faults of plates: every plate drifts a little.
    pub belief_plates: f64,
    /// Draws of flipped signs for the null distribution.
    pub null_draws: usize,
    /// Resamples of clusters for intervals.
    pub resamples: usize,
    /// Effects that may be found one after the other.
    pub rounds: usize,
    /// Trials are the unit of evidence where there are at least this many, flights otherwise.
    pub fewest_trials: usize,
    /// Weight of the prior of the parameters (1: as uncertain as it says).
    pub prior_weight: f64,
    /// Two effects are told apart when chance explains their difference less often than this.
    pub significance: f64,
    /// Only these effects; all when empty.
    pub only: Vec<String>,
    /// Not these.
    pub without: Vec<String>,
    /// Seed of every draw.
    pub seed: u64,
}

impl Default for DiscoverOptions {
    fn default() -> Self {
        Self {
            belief: 0.90,
            belief_kinematics: 0.75,
            belief_plates: 0.80,
            null_draws: 200,
            resamples: 500,
            rounds: 3,
            fewest_trials: 6,
            prior_weight: 1.0,
            significance: 0.05,
            only: Vec::new(),
            without: Vec::new(),
            seed: 20_100_503,
        }
    }
}

/// A richer effect has to leave less than this share of a simpler one's error to be told from it.
const NEARLY: f64 = 0.94;

/// A pair of effects has to leave less than this share of the error of the best single one.
const PAIR: f64 = 0.93;

/// All effects of the catalogue.
pub fn catalogue() -> Vec<&'static dyn Effect> {
    aloft_effects::EFFECTS.iter().map(|e| *e as &dyn Effect).collect()
}

/// Which effect is missing? Ranks `effects` against the model that already holds `accepted`, adds what is believed, and goes on until nothing is.
///
/// # Errors
/// [`DiscoverError::TooFew`] with fewer than two flights, [`DiscoverError::Numeric`] when the rows do not determine the parameters.
pub fn discover(
    session: &Session<'_>,
    effects: &[&dyn Effect],
    accepted: &[Choice<'_>],
    options: &DiscoverOptions,
) -> Result<Discovery, DiscoverError> {
    let has = |contact: bool| session.blocks.iter().any(|b| (b.kind == StretchKind::Contact) == contact);
    let (has_flights, has_contact) = (has(false), has(true));
    let mut rounds: Vec<Round> = Vec::new();
    let mut found: Vec<Found> = Vec::new();
    let mut domains = Vec::new();
    if has_flights {
        domains.push(Domain::Flight);
    }
    if has_contact && effects.iter().any(|e| wanted(*e, options) && judged_in(*e, Domain::Contact, has_flights)) {
        domains.push(Domain::Contact);
    }
    let mut before = f64::NAN;
    let mut after = f64::NAN;
    // a variant found in flight also acts in contact, so its columns are made anew for every domain
    let mut kept: Vec<Variant<'_>> = Vec::new();
    for domain in domains {
        let mut first_gain: Option<f64> = None;
        for _ in 0..options.rounds.max(1) {
            let extra = extra_columns(session, domain, accepted, &kept, &found);
            let problem = match Problem::new(session, domain, &extra, options.fewest_trials, options.prior_weight) {
                Ok(problem) => problem,
                // too few contact stretches are no reason to give up on flights
                Err(DiscoverError::TooFew { .. }) if !rounds.is_empty() => break,
                Err(e) => return Err(e),
            };
            let model: Vec<String> =
                accepted.iter().map(|c| c.key(session.scene)).chain(found.iter().map(|f| f.key.clone())).collect();
            let already: Vec<&str> = kept.iter().map(|v| v.effect.id()).collect();
            let (mut round, scores) = run_round(session, &problem, effects, &already, model, has_flights, options);
            let plain = problem.plain();
            if rounds.is_empty() {
                before = plain;
            }
            if domain == Domain::Flight || !has_flights {
                after = plain;
            }
            let chosen = match round.verdict {
                Verdict::Supported | Verdict::OneOf => {
                    scores.iter().find(|s| Some(s.effect.id()) == round.effects.first().map(String::as_str))
                }
                _ => None,
            };
            let gain = chosen.map_or(0.0, |s| plain - s.mean_square(&problem));
            if let (Some(first), Some(_)) = (first_gain, chosen)
                && gain < 0.01 * first
            {
                // what is left of a great effect that was not modelled to the last per cent
                round.words = format!(
                    "what remains is below a tenth of the effect found before and may be left over from it; {}",
                    round.words
                );
                round.verdict = Verdict::NothingMissing;
                round.effects.clear();
            }
            let go_on = matches!(round.verdict, Verdict::Supported | Verdict::OneOf);
            let sure = round.verdict == Verdict::Supported;
            let pair = match chosen {
                Some(score) if go_on => {
                    let named = |id: &str| round.effects.iter().any(|e| e == id);
                    let usable: Vec<bool> = scores
                        .iter()
                        .map(|s| {
                            let more = s.effect.contains().contains(&score.effect.id());
                            !s.placebo && !more && !named(s.effect.id()) && limit(s.effect.id(), false, options) > 0.0
                        })
                        .collect();
                    let refit = Refit { accepted, kept: &kept, found: &found, options };
                    let best = scores.iter().position(|s| s.effect.id() == score.effect.id()).unwrap_or(0);
                    better_pair(session, &problem, &scores, best, &usable, PAIR, &refit)
                }
                _ => None,
            };
            if let Some((a, b, error)) = pair {
                let ids = [a.variant.effect.id().to_owned(), b.variant.effect.id().to_owned()];
                round.words = format!(
                    "two effects together, `{}` and `{}`, explain more ({:.0} % of the held-out error remains) than any one: {}",
                    key_of(session, &a),
                    key_of(session, &b),
                    100.0 * (error / (plain * problem.n_judged as f64)).sqrt(),
                    round.words
                );
                round.verdict = Verdict::Supported;
                round.effects = ids.to_vec();
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
            if let Some(score) = chosen {
                first_gain = first_gain.or(Some(gain));
                let best = &score.scored[score.best];
                if domain == Domain::Flight || !has_flights {
                    after = score.mean_square(&problem);
                }
                found.push(as_found(session, best));
                kept.push(best.variant.clone());
            }
            // without a name there is nothing to build on
            if !sure && rounds.len() >= options.rounds {
                break;
            }
        }
    }
    prune(session, accepted, &mut kept, &mut found, options);
    refit_found(session, accepted, &kept, &mut found, options);
    let first = rounds.iter().find(|r| matches!(r.verdict, Verdict::Supported | Verdict::OneOf));
    let verdict = first.map_or_else(|| rounds.first().map_or(Verdict::NotDetectable, |r| r.verdict), |r| r.verdict);
    let mut named: Vec<String> = first.map(|r| r.effects.clone()).unwrap_or_default();
    if verdict == Verdict::Supported {
        let sure =
            |id: &str| rounds.iter().any(|r| r.verdict == Verdict::Supported && r.effects.iter().any(|e| e == id));
        named = found.iter().map(|f| f.effect.clone()).filter(|id| sure(id)).collect();
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
    let noise_floor = session.noise.map_or(f64::NAN, |n| (0.5 * (n[0] + n[1])).sqrt() * weight);
    let mut out = Discovery {
        schema: 1,
        verdict,
        effects: named,
        words: String::new(),
        noise_floor,
        held_out_error: before.sqrt() * weight,
        held_out_error_after: after.sqrt() * weight,
        held_out_error_of_weight: before.sqrt(),
        candidates,
        rounds,
        found,
        advice: Vec::new(),
        warnings: session.warnings.clone(),
    };
    out.words = words::answer(&out);
    out.advice = words::advice(&out);
    Ok(out)
}

fn wanted(effect: &dyn Effect, options: &DiscoverOptions) -> bool {
    let named = |list: &[String]| list.iter().any(|n| n == effect.id());
    (options.only.is_empty() || named(&options.only)) && !named(&options.without)
}

/// What a problem with one more effect in its model is made of.
pub(crate) struct Refit<'a, 'b> {
    accepted: &'a [Choice<'b>],
    kept: &'a [Variant<'b>],
    found: &'a [Found],
    options: &'a DiscoverOptions,
}

impl Refit<'_, '_> {
    /// The problem of a domain with the columns of a variant in the model.
    pub fn with(&self, session: &Session<'_>, domain: Domain, variant: &Variant<'_>) -> Option<Problem> {
        let mut extra = extra_columns(session, domain, self.accepted, self.kept, self.found);
        extra.extend(extra_columns(session, domain, &[], std::slice::from_ref(variant), &[]));
        Problem::new(session, domain, &extra, self.options.fewest_trials, self.options.prior_weight).ok()
    }
    /// Seed of every draw.
    pub fn seed(&self) -> u64 {
        self.options.seed
    }
}

/// Columns of effects in the model, by block; of nonlinear ones found in an earlier round also the derivatives by their parameters, so that a small
/// error in these does not pass for another effect.
fn extra_columns(
    session: &Session<'_>,
    domain: Domain,
    accepted: &[Choice<'_>],
    kept: &[Variant<'_>],
    found: &[Found],
) -> Vec<Vec<DMatrix<f64>>> {
    let mut out: Vec<Vec<DMatrix<f64>>> =
        accepted.iter().filter_map(|c| session.columns(c.effect, c.target, &c.nonlinear, domain)).collect();
    for (i, v) in kept.iter().enumerate() {
        let at = |p: &[f64]| {
            session.columns(v.effect, v.target, p, domain).map(|mut columns| {
                if !v.group.is_empty() {
                    for (block, c) in session.blocks.iter().zip(&mut columns) {
                        if !v.group[block.trial] {
                            c.fill(0.0);
                        }
                    }
                }
                columns
            })
        };
        let Some(columns) = at(&v.nonlinear) else { continue };
        if let Some(found) = found.get(i) {
            let theta = DVector::from_iterator(columns[0].ncols(), found.coefficients.iter().map(|e| e.value));
            for (k, q) in v.effect.nonlinear(session.scene, v.target).iter().enumerate() {
                let mut p = v.nonlinear.clone();
                let h = if p[k] + 0.02 * q.scale > q.upper { -0.02 * q.scale } else { 0.02 * q.scale };
                p[k] += h;
                if let Some(moved) = at(&p) {
                    let of = |(a, b): (&DMatrix<f64>, &DMatrix<f64>)| {
                        let slope: DVector<f64> = (a - b) * &theta / h;
                        DMatrix::from_column_slice(slope.len(), 1, slope.as_slice())
                    };
                    out.push(moved.iter().zip(&columns).map(of).collect());
                }
            }
        }
        out.push(columns);
    }
    // an effect that does nothing here would leave the rows singular
    out.retain(|e| e.iter().any(|m| m.norm_squared() > 0.0));
    out
}

/// Takes out effects that those found later have made superfluous: a compromise found first, where two effects were at work.
fn prune(
    session: &Session<'_>,
    accepted: &[Choice<'_>],
    kept: &mut Vec<Variant<'_>>,
    found: &mut Vec<Found>,
    options: &DiscoverOptions,
) {
    /// A loss of held-out error (root mean square) below this is none.
    const LOSS: f64 = 1.03;
    let error = |kept: &[Variant<'_>], found: &[Found], domain: Domain| {
        let extra = extra_columns(session, domain, accepted, kept, found);
        Problem::new(session, domain, &extra, options.fewest_trials, options.prior_weight).ok().map(|p| p.plain())
    };
    while kept.len() > 1 {
        let mut least: Option<(usize, f64)> = None;
        for i in 0..kept.len() - 1 {
            let domain = if kept[i].effect.acts().in_flight() { Domain::Flight } else { Domain::Contact };
            let (mut fewer, mut fewer_found) = (kept.clone(), found.clone());
            fewer.remove(i);
            fewer_found.remove(i);
            if let (Some(with), Some(without)) = (error(kept, found, domain), error(&fewer, &fewer_found, domain)) {
                let loss = (without / with).sqrt();
                if loss < LOSS && least.is_none_or(|l| loss < l.1) {
                    least = Some((i, loss));
                }
            }
        }
        let Some((i, _)) = least else { break };
        kept.remove(i);
        found.remove(i);
    }
}

/// Values of the coefficients with all effects found in the model at once.
fn refit_found(
    session: &Session<'_>,
    accepted: &[Choice<'_>],
    kept: &[Variant<'_>],
    found: &mut [Found],
    options: &DiscoverOptions,
) {
    if kept.len() < 2 {
        return;
    }
    for i in 0..kept.len() {
        let others: Vec<Variant<'_>> =
            kept.iter().enumerate().filter(|(j, _)| *j != i).map(|(_, v)| v.clone()).collect();
        let domain = if kept[i].effect.acts().in_flight() { Domain::Flight } else { Domain::Contact };
        let extra = extra_columns(session, domain, accepted, &others, &[]);
        let Ok(problem) = Problem::new(session, domain, &extra, options.fewest_trials, options.prior_weight) else {
            continue;
        };
        let parameters = kept[i].effect.nonlinear(session.scene, kept[i].target);
        let scored = if parameters.is_empty() {
            let columns = kept[i].columns(session, &problem);
            columns.map(|c| crate::candidate::score(&problem, kept[i].clone(), &problem.reduce(&c)))
        } else {
            crate::nonlinear::improve(session, &problem, &kept[i], crate::rank::FULL_STEPS)
                .and_then(|(v, _)| crate::nonlinear::score_fitted(session, &problem, v))
        };
        if let Some(scored) = scored {
            found[i] = as_found(session, &scored);
        }
    }
}

fn estimates(session: &Session<'_>, scored: &Scored<'_>) -> (Vec<Estimate>, Vec<Estimate>) {
    let coefficients = scored
        .variant
        .coefficients
        .iter()
        .enumerate()
        .map(|(k, c)| Estimate {
            name: c.name.clone(),
            value: scored.theta[k],
            se: jackknife_se(&scored.fold_theta.iter().map(|t| t[k]).collect::<Vec<_>>()),
            unit: c.unit.clone(),
        })
        .collect();
    let nonlinear = scored
        .variant
        .effect
        .nonlinear(session.scene, scored.variant.target)
        .iter()
        .enumerate()
        .map(|(k, p)| Estimate {
            name: p.name.clone(),
            value: scored.variant.nonlinear[k],
            se: jackknife_se(&scored.fold_nonlinear.iter().map(|t| t[k]).collect::<Vec<_>>()),
            unit: p.unit.clone(),
        })
        .collect();
    (coefficients, nonlinear)
}

fn group_names(session: &Session<'_>, scored: &Scored<'_>) -> Vec<String> {
    let mask = &scored.variant.group;
    session.trials.iter().zip(mask).filter(|(_, m)| **m).map(|(t, _)| t.clone()).collect()
}

fn key_of(session: &Session<'_>, scored: &Scored<'_>) -> String {
    let v = &scored.variant;
    Choice { effect: v.effect, target: v.target, nonlinear: Vec::new() }.key(session.scene)
}

fn as_found(session: &Session<'_>, scored: &Scored<'_>) -> Found {
    let (coefficients, nonlinear) = estimates(session, scored);
    Found {
        effect: scored.variant.effect.id().to_owned(),
        key: key_of(session, scored),
        target: scored.variant.target,
        nonlinear,
        coefficients,
        trials: group_names(session, scored),
    }
}

fn run_round<'a>(
    session: &Session<'_>,
    problem: &Problem,
    effects: &[&'a dyn Effect],
    already: &[&str],
    model: Vec<String>,
    has_flights: bool,
    options: &DiscoverOptions,
) -> (Round, Vec<EffectScore<'a>>) {
    let used: Vec<(&'a dyn Effect, bool)> = effects
        .iter()
        .copied()
        .filter(|e| wanted(*e, options) && judged_in(*e, problem.domain, has_flights) && !already.contains(&e.id()))
        .map(|e| (e, false))
        .chain(PLACEBOS.iter().map(|p| (p as &dyn Effect, true)))
        .collect();
    let mut scores: Vec<EffectScore<'a>> =
        used.par_iter().filter_map(|(e, placebo)| score_effect(session, problem, *e, *placebo, true)).collect();
    let plain = problem.plain();
    scores.sort_by(|a, b| a.mean_square(problem).total_cmp(&b.mean_square(problem)));
    let mut null = null_ratios(problem, &scores, options.null_draws, options.seed);
    null.sort_by(f64::total_cmp);
    let quantile = |share: f64| null.get((share * null.len() as f64) as usize).copied().unwrap_or(f64::NAN);
    let null_quantiles = [quantile(0.01), quantile(0.05), quantile(0.5)];
    // with few clusters the signs have few patterns, and the original one is among them
    let few = problem.clusters.len() < 5;
    let threshold = if few || !null_quantiles[1].is_finite() {
        options.belief.min(0.8)
    } else {
        options.belief.min(null_quantiles[1])
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
            let believed = !score.placebo
                && plausible
                && ratio < threshold.min(limit(score.effect.id(), already.is_empty(), options))
                && ci95[1] < 1.0
                && score.mean_square(problem) < placebo;
            Candidate {
                effect: score.effect.id().to_owned(),
                key: key_of(session, best),
                target: best.variant.target,
                kind: score.effect.kind(),
                class: score.effect.class().to_owned(),
                judged_on: words::domain(problem.domain).to_owned(),
                held_out_ratio: ratio,
                ci95,
                chosen_share: *share,
                family_wise_p: (beaten + 1) as f64 / (null.len() + 1) as f64,
                minimum_detectable: minimum_detectable(problem, best, best_square, threshold, &coefficients),
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
    let (verdict, effects) = judge(problem, &scores, &candidates, options);
    let words = words::round(verdict, &effects, &candidates, threshold, few);
    let round = Round {
        judged_on: words::domain(problem.domain).to_owned(),
        model,
        held_out_error: plain.sqrt() * session.unit[0],
        held_out_parts: parts(session, problem),
        threshold,
        null_quantiles,
        clusters: problem.clusters.iter().filter(|c| !c.judged.is_empty()).count(),
        verdict,
        effects,
        words,
        candidates,
    };
    (round, scores)
}

/// The best variant of every target, best first.
fn alternatives(session: &Session<'_>, problem: &Problem, score: &EffectScore<'_>) -> Vec<Alternative> {
    let mut out: Vec<Alternative> = Vec::new();
    let mut order: Vec<&Scored<'_>> = score.scored.iter().collect();
    order.sort_by(|a, b| a.fold_error.iter().sum::<f64>().total_cmp(&b.fold_error.iter().sum()));
    for s in order {
        let key = key_of(session, s);
        if out.len() < 5 && !out.iter().any(|a| a.key == key) {
            let error: f64 = s.fold_error.iter().sum::<f64>() / problem.n_judged as f64;
            out.push(Alternative { key, held_out_ratio: (error / problem.plain()).sqrt() });
        }
    }
    out
}

/// Largest ratio at which an effect may be believed.
fn limit(id: &str, first_round: bool, options: &DiscoverOptions) -> f64 {
    match id {
        "soft_tissue" | "joint_centre" | "filter_attenuation" | "camera_warp" | "residual_contact" => {
            if first_round {
                options.belief_kinematics
            } else {
                0.0
            }
        }
        _ if id.starts_with("plate_") || id == "body_mass" => options.belief_plates,
        _ => options.belief,
    }
}

/// Held-out root mean squares of forces (N) and moments (N·m).
fn parts(session: &Session<'_>, problem: &Problem) -> [f64; 2] {
    let mut sums = [0.0; 2];
    let mut counts = [0.0; 2];
    for (cluster, fold) in problem.clusters.iter().zip(&problem.folds) {
        let mut kinds = Vec::new();
        for &i in &cluster.blocks {
            let block = &session.blocks[i];
            for r in 0..block.y.nrows() {
                match block.is_force(r) {
                    Some(force) => kinds.push(usize::from(!force)),
                    None => return [f64::NAN; 2],
                }
            }
        }
        for (x, &row) in fold.test.iter().zip(&cluster.judged) {
            sums[kinds[row]] += x * x;
            counts[kinds[row]] += 1.0;
        }
    }
    [(sums[0] / counts[0]).sqrt() * session.unit[0], (sums[1] / counts[1]).sqrt() * session.unit[1]]
}

/// How often each effect comes first over resamples of clusters.
fn chosen_shares(scores: &[EffectScore<'_>], weights: &[Vec<f64>]) -> Vec<f64> {
    let mut wins = vec![0.0; scores.len()];
    for w in weights {
        let sum = |s: &EffectScore<'_>| -> f64 { s.fold_error.iter().zip(w).map(|(e, w)| e * w).sum() };
        let first = (0..scores.len()).min_by(|&a, &b| sum(&scores[a]).total_cmp(&sum(&scores[b])));
        if let Some(i) = first {
            wins[i] += 1.0;
        }
    }
    wins.iter().map(|n| n / weights.len().max(1) as f64).collect()
}

/// No coefficient at a bound that physics sets, none all zero.
fn plausible(scored: &Scored<'_>, estimates: &[Estimate]) -> bool {
    let bounds = &scored.variant.coefficients;
    let mut moved = false;
    for (bound, estimate) in bounds.iter().zip(estimates) {
        let at_bound = |b: f64| b.is_finite() && b != 0.0 && (estimate.value - b).abs() <= 1e-9 * b.abs();
        if at_bound(bound.lower) || at_bound(bound.upper) {
            return false;
        }
        moved |= estimate.value != 0.0;
    }
    // with one sign allowed, zero means that the data ask for the other
    let main = bounds.first().is_some_and(|b| b.lower == 0.0 && estimates[0].value <= 0.0) && bounds.len() <= 2;
    moved && !main
}

/// Size at which the held-out ratio falls below the threshold in four of five sessions.
fn minimum_detectable(
    problem: &Problem,
    scored: &Scored<'_>,
    noise_square: f64,
    threshold: f64,
    estimates: &[Estimate],
) -> f64 {
    let unit = &scored.variant.coefficients[0].unit;
    let of_unit: Vec<usize> =
        (0..scored.variant.coefficients.len()).filter(|&k| scored.variant.coefficients[k].unit == *unit).collect();
    let energy = of_unit.iter().map(|&k| scored.s[(k, k)]).sum::<f64>() / of_unit.len() as f64;
    if energy <= 0.0 {
        return f64::INFINITY;
    }
    let n = problem.clusters.iter().map(|c| c.n_rows as f64).sum::<f64>();
    let size = (n * noise_square * (threshold.powi(-2) - 1.0) / energy).sqrt();
    let se = of_unit.iter().map(|&k| estimates[k].se.powi(2)).sum::<f64>().sqrt() / (of_unit.len() as f64).sqrt();
    size + 0.84 * if se.is_finite() { se.min(size) } else { 0.0 }
}

/// Fills in what looks like what: every believed effect against all, the rest against the best.
fn confusions(
    session: &Session<'_>,
    problem: &Problem,
    scores: &[EffectScore<'_>],
    candidates: &mut [Candidate],
    options: &DiscoverOptions,
) {
    let all: Vec<Vec<Confusion>> = (0..scores.len())
        .into_par_iter()
        .map(|a| {
            if scores[a].placebo {
                return Vec::new();
            }
            let mut out = Vec::new();
            for b in (0..scores.len()).filter(|&b| b != a && !scores[b].placebo) {
                let (x, y) = (&scores[a].scored[scores[a].best], &scores[b].scored[scores[b].best]);
                let cosine = cosine(session, problem, x, y);
                if cosine > 0.9 {
                    let (ea, eb) = (&scores[a].fold_error, &scores[b].fold_error);
                    let ahead = ea.iter().sum::<f64>() <= eb.iter().sum::<f64>();
                    let (better, worse) = if ahead { (ea, eb) } else { (eb, ea) };
                    out.push(Confusion {
                        effect: scores[b].effect.id().to_owned(),
                        cosine,
                        p_value: sign_flip_p(better, worse, 1000, options.seed),
                        separate_by: words::separate(scores[a].effect.id(), scores[b].effect.id()).to_owned(),
                    });
                }
            }
            out.sort_by(|p, q| q.cosine.total_cmp(&p.cosine));
            out
        })
        .collect();
    for (candidate, confused) in candidates.iter_mut().zip(all) {
        candidate.confused_with = confused;
    }
}

/// Verdict and names: the believed effects that no other of them beats beyond chance, the most economical first.
fn judge(
    problem: &Problem,
    scores: &[EffectScore<'_>],
    candidates: &[Candidate],
    options: &DiscoverOptions,
) -> (Verdict, Vec<String>) {
    let believed: Vec<usize> = (0..candidates.len()).filter(|&i| candidates[i].believed).collect();
    let unknowns = |i: usize| scores[i].scored[scores[i].best].variant.unknowns();
    let Some(&first) = believed.first() else {
        let hopeless = problem.clusters.iter().filter(|c| !c.judged.is_empty()).count() < 4;
        return (if hopeless { Verdict::NotDetectable } else { Verdict::NothingMissing }, Vec::new());
    };
    // a generalisation has to be as much better as another effect would have to be: its freedom also follows errors that repeat
    let simpler = believed.iter().copied().find(|&i| {
        scores[first].effect.contains().contains(&scores[i].effect.id())
            && candidates[first].held_out_ratio > options.belief * candidates[i].held_out_ratio
    });
    let best = simpler.unwrap_or(first);
    let mut class: Vec<usize> = believed
        .iter()
        .copied()
        .filter(|&i| {
            if i == best {
                return true;
            }
            let p = sign_flip_p(&scores[best].fold_error, &scores[i].fold_error, 2000, options.seed ^ 0xc1a5);
            // errors that repeat from trial to trial favour the richer model, so the simpler one stays in the class when it is nearly as good
            let near = if unknowns(i) < unknowns(best) { NEARLY } else { 0.98 };
            p >= options.significance || near * candidates[i].held_out_ratio < candidates[best].held_out_ratio
        })
        .collect();
    // an effect that contains another counts only where it does better
    let ids: Vec<&str> = class.iter().map(|&i| scores[i].effect.id()).collect();
    class.retain(|&i| !scores[i].effect.contains().iter().any(|c| ids.contains(c)));
    class.sort_by(|&a, &b| {
        unknowns(a).cmp(&unknowns(b)).then(candidates[a].held_out_ratio.total_cmp(&candidates[b].held_out_ratio))
    });
    let names: Vec<String> = class.iter().map(|&i| candidates[i].effect.clone()).collect();
    (if names.len() == 1 { Verdict::Supported } else { Verdict::OneOf }, names)
}
