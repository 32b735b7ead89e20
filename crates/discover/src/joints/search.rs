//! The search over joints and laws.

use super::fit::{Scored, Variant, null_ratios, plain, score, variants};
use super::result::{JointCandidate, JointDiscovery, JointFinding};
use super::wording;
use crate::held_out::HeldOutResult;
use crate::options::DiscoverOptions;
use crate::result::{Estimate, FEWEST_CLUSTERS, Found, MANY_CLUSTERS, Verdict};
use crate::statistics::{jackknife_se, ratio_interval, resamples, sign_flip_p};
use aloft_effects::{Effect, EffectInstance, Scene, Target};
use aloft_robot::joint_evidence::ReducedFold;
use nalgebra::DVector;
use rayon::prelude::*;

/// Laws that are added to one joint at most.
const MOST_LAWS: usize = 2;
/// Values of a nonlinear parameter between its neighbours in the coarse search.
const FINE: usize = 6;

/// One joint to search.
#[derive(Debug, Clone)]
pub struct JointInput {
    /// Name.
    pub name: String,
    /// Link that it carries.
    pub link: usize,
    /// Unit of its torque.
    pub unit: String,
    /// Number of its rows.
    pub rows: usize,
    /// Held-out error with the laws of the present model; NaN where its rows cannot be solved.
    pub held_out_error: f64,
    /// What a perfect model would leave, with its 95 % interval; none if not known.
    pub floor: Option<(f64, [f64; 2])>,
}

/// What the flights say: all folds of a joint with these laws in its model, and columns of others
/// to try. None where the rows cannot be solved.
pub trait JointSearch: Sync {
    /// Folds of a joint; the last leaves nothing out.
    fn folds(
        &self,
        joint: usize,
        model: &[EffectInstance<'_>],
        tried: &[EffectInstance<'_>],
    ) -> Option<Vec<ReducedFold>>;

    /// What a joint's rows leave with these laws in the model, and what a perfect model would
    /// leave, with its 95 % interval. A model that lacks a law has wrong gains, and with them
    /// another floor.
    fn reached(&self, joint: usize, model: &[EffectInstance<'_>]) -> Option<(f64, Option<Floor>)>;
}

/// A floor and its 95 % interval.
pub type Floor = (f64, [f64; 2]);

/// Range of a nonlinear parameter on which it was searched.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Range {
    /// Lower neighbour of the best value.
    lower: f64,
    /// Upper neighbour.
    upper: f64,
}

/// Everything that is said of one joint in a round.
struct Round<'a> {
    variants: Vec<Variant<'a>>,
    laws: Vec<Law<'a>>,
    plain: Vec<f64>,
    null: Vec<f64>,
}

struct Law<'a> {
    effect: &'a dyn Effect,
    scored: Scored,
    ratio: f64,
    ci95: [f64; 2],
}

/// All starts of the laws that a joint can have.
fn choices<'a>(scene: &Scene, link: usize, effects: &[&'a dyn Effect]) -> Vec<EffectInstance<'a>> {
    let target = Target::Joint(link);
    let of = |effect: &'a dyn Effect| {
        let at = effect.targets(scene).contains(&target);
        let starts = if at { effect.starts(scene, target) } else { Vec::new() };
        starts.into_iter().map(move |nonlinear| EffectInstance { effect, target, nonlinear, trials: Vec::new() })
    };
    effects.iter().copied().filter(|e| e.acts().in_joints()).flat_map(of).collect()
}

fn round<'a>(
    scene: &Scene,
    search: &dyn JointSearch,
    joint: usize,
    model: &[EffectInstance<'a>],
    choices: &[EffectInstance<'a>],
    options: &DiscoverOptions,
) -> Option<Round<'a>> {
    let folds = search.folds(joint, model, choices)?;
    let variants = variants(scene, choices);
    let plain = plain(&folds);
    let weights = resamples(plain.len(), options.resamples, options.seed ^ 0x5eed);
    let total: f64 = plain.iter().sum();
    let mut groups: Vec<(&'a dyn Effect, Vec<usize>)> = Vec::new();
    for (i, v) in variants.iter().enumerate() {
        match groups.iter_mut().find(|(e, _)| e.id() == v.choice.effect.id()) {
            Some((_, of)) => of.push(i),
            None => groups.push((v.choice.effect, vec![i])),
        }
    }
    let mut laws: Vec<Law<'a>> = groups
        .iter()
        .filter_map(|(effect, of)| {
            let scored = score(&folds, &variants, of)?;
            let ratio = (scored.fold_error.iter().sum::<f64>() / total).sqrt();
            let ci95 = ratio_interval(&scored.fold_error, &plain, &weights);
            Some(Law { effect: *effect, scored, ratio, ci95 })
        })
        .collect();
    laws.sort_by(|a, b| a.ratio.total_cmp(&b.ratio));
    let of: Vec<Vec<usize>> = groups.into_iter().map(|(_, of)| of).collect();
    let null = null_ratios(&folds, &variants, &of, options.null_draws, options.seed ^ (joint as u64 + 1));
    Some(Round { variants, laws, plain, null })
}

/// Values between the neighbours of the best one, for a law with one nonlinear parameter.
fn finer<'a>(scene: &Scene, best: &EffectInstance<'a>, range: Range) -> Vec<EffectInstance<'a>> {
    let bounds = best.effect.nonlinear(scene, best.target);
    let Some(bound) = bounds.first().filter(|_| bounds.len() == 1) else { return vec![best.clone()] };
    let step = (range.upper - range.lower) / (FINE + 1) as f64;
    let at = |i: usize| (range.lower + step * i as f64).clamp(bound.lower, bound.upper);
    (0..FINE + 2).map(|i| EffectInstance { nonlinear: vec![at(i)], ..best.clone() }).collect()
}

/// Neighbours of the best value among those tried.
fn range(law: &Law<'_>, variants: &[Variant<'_>]) -> Option<Range> {
    let best = *variants[law.scored.best].choice.nonlinear.first()?;
    let own = variants.iter().filter(|v| v.choice.effect.id() == law.effect.id());
    let values: Vec<f64> = own.filter_map(|v| v.choice.nonlinear.first().copied()).collect();
    let below = values.iter().copied().filter(|v| *v < best).fold(f64::NAN, f64::max);
    let above = values.iter().copied().filter(|v| *v > best).fold(f64::NAN, f64::min);
    let or = |x: f64| if x.is_finite() { x } else { best };
    Some(Range { lower: or(below), upper: or(above) })
}

/// Coefficients and nonlinear parameters with intervals over the flights.
fn estimates(scene: &Scene, law: &Law<'_>, variants: &[Variant<'_>]) -> (Vec<Estimate>, Vec<Estimate>) {
    let v = &variants[law.scored.best];
    let freedom = law.scored.fold_theta.len() as f64 - 1.0;
    let blank = |name: &str, value: f64, unit: &str, at_bound: bool| Estimate {
        name: name.to_owned(),
        value,
        se: f64::NAN,
        ci95: None,
        freedom: f64::NAN,
        at_bound,
        widening: 1.0,
        unit: unit.to_owned(),
    };
    let own: Vec<usize> = (0..variants.len()).filter(|&i| variants[i].choice.effect.id() == law.effect.id()).collect();
    let at = |i: usize| variants[own[i]].choice.nonlinear.first().copied();
    let tried: Vec<f64> = (0..own.len()).filter_map(at).collect();
    let bounds = law.effect.nonlinear(scene, v.choice.target);
    let spread: Vec<f64> = law.scored.gains.iter().filter(|_| !tried.is_empty()).map(|g| top(&tried, g)).collect();
    let se_nonlinear = if bounds.is_empty() { 0.0 } else { jackknife_se(&spread) };
    let nonlinear = bounds.iter().zip(&v.choice.nonlinear).map(|(b, &value)| {
        blank(&b.name, value, &b.unit, value <= b.lower || value >= b.upper).with_error(se_nonlinear, freedom)
    });
    let best = own.iter().position(|&i| i == law.scored.best).unwrap_or(0);
    let coefficients = v.coefficients.iter().enumerate().map(|(k, c)| {
        let value = law.scored.theta[k];
        let spread: Vec<f64> = law.scored.fold_theta.iter().map(|t| t[k]).collect();
        let (fixed, moved) = (jackknife_se(&spread), slope(&tried, &law.scored.thetas, best, k) * se_nonlinear);
        let whole = fixed.hypot(moved);
        let widening = if fixed > 0.0 && whole.is_finite() { whole / fixed } else { 1.0 };
        Estimate { widening, ..blank(&c.name, value, &c.unit, value <= c.lower || value >= c.upper) }
            .with_error(whole, freedom)
    });
    (coefficients.collect(), nonlinear.collect())
}

/// Change of a coefficient with the nonlinear parameter, about the best variant.
fn slope(at: &[f64], thetas: &[DVector<f64>], best: usize, k: usize) -> f64 {
    let (low, high) = (best.saturating_sub(1), (best + 1).min(at.len().saturating_sub(1)));
    match (at.get(low), at.get(high)) {
        (Some(a), Some(b)) if b > a => (thetas[high][k] - thetas[low][k]) / (b - a),
        _ => 0.0,
    }
}

/// Where a parabola through the largest gain and its neighbours has its top.
fn top(at: &[f64], gain: &[f64]) -> f64 {
    let best = (0..gain.len()).max_by(|&a, &b| gain[a].total_cmp(&gain[b])).unwrap_or(0);
    let (Some(i), true) = (best.checked_sub(1), best + 1 < gain.len()) else { return at[best] };
    let (a, b, c) = (gain[i], gain[best], gain[best + 1]);
    let bend = a - 2.0 * b + c;
    let step = 0.5 * (at[best + 1] - at[i]);
    if bend < 0.0 { at[best] + (0.5 * (a - c) / bend).clamp(-1.0, 1.0) * step } else { at[best] }
}

fn measured(floor: Option<(f64, [f64; 2])>, error: f64) -> Option<HeldOutResult> {
    floor.map(|(floor, ci)| HeldOutResult {
        held_out_error: error,
        noise_floor: floor,
        noise_floor_ci95: Some(ci),
        by_parameters: None,
    })
}

/// A law is plausible if no coefficient and no parameter stands at a bound, where the flights did
/// not determine it.
fn plausible(coefficients: &[Estimate], nonlinear: &[Estimate]) -> bool {
    !coefficients.first().is_some_and(|c| c.at_bound || c.value == 0.0) && !nonlinear.iter().any(|n| n.at_bound)
}

fn rms(squares: &[f64], rows: usize) -> f64 {
    (squares.iter().sum::<f64>() / rows.max(1) as f64).sqrt()
}

/// The limits of a round: what is accepted, and the quantiles of chance.
struct Limits {
    threshold: f64,
    quantiles: [f64; 3],
    clusters: usize,
}

fn limits(rounds: &[Option<Round<'_>>], options: &DiscoverOptions) -> Limits {
    let clusters = rounds.iter().flatten().map(|r| r.plain.len()).max().unwrap_or(0);
    let mut best: Vec<f64> = (0..options.null_draws)
        .map(|d| rounds.iter().flatten().filter_map(|r| r.null.get(d).copied()).fold(f64::INFINITY, f64::min))
        .filter(|r| r.is_finite())
        .collect();
    best.sort_by(f64::total_cmp);
    let at = |share: f64| best.get((best.len() as f64 * share) as usize).copied().unwrap_or(f64::NAN);
    let quantiles = [at(0.01), at(0.05), at(0.5)];
    let chance = if clusters < MANY_CLUSTERS { quantiles[0] } else { quantiles[1] };
    let threshold = if clusters < FEWEST_CLUSTERS || !chance.is_finite() {
        0.0
    } else {
        chance.min(options.largest_ratio(clusters))
    };
    Limits { threshold, quantiles, clusters }
}

/// Searches the joints for missing laws among `effects`; `model` are those that it holds already.
/// With a reason to wait the errors are stated and nothing is searched.
pub fn discover_joints(
    scene: &Scene,
    inputs: &[JointInput],
    model: &[EffectInstance<'_>],
    effects: &[&dyn Effect],
    search: &dyn JointSearch,
    waits: Option<&str>,
    options: &DiscoverOptions,
) -> JointDiscovery {
    let of_joint = |i: usize| -> Vec<EffectInstance<'_>> {
        model.iter().filter(|m| m.target == Target::Joint(inputs[i].link)).cloned().collect()
    };
    let first: Vec<Option<Round<'_>>> = (0..inputs.len())
        .into_par_iter()
        .map(|i| {
            let held = of_joint(i);
            let tried: Vec<EffectInstance<'_>> = choices(scene, inputs[i].link, effects)
                .into_iter()
                .filter(|c| waits.is_none() && !held.iter().any(|h| h.effect.id() == c.effect.id()))
                .collect();
            if tried.is_empty() { None } else { round(scene, search, i, &held, &tried, options) }
        })
        .collect();
    let limits = limits(&first, options);
    let told: Vec<(JointFinding, Vec<Found>)> = inputs
        .par_iter()
        .zip(first)
        .enumerate()
        .map(|(i, (input, round))| {
            let joint = Joint { scene, search, index: i, input, limits: &limits, options };
            joint.conclude(of_joint(i), round)
        })
        .collect();
    let (joints, found): (Vec<JointFinding>, Vec<Vec<Found>>) = told.into_iter().unzip();
    let any = |v: Verdict| joints.iter().any(|j| j.verdict == v);
    // a joint that hardly moves is not judged, and says nothing of the others
    let order = [Verdict::Unexplained, Verdict::OneOf, Verdict::Supported, Verdict::NothingMissing];
    let verdict = order.into_iter().find(|v| any(*v)).unwrap_or(Verdict::NotDetectable);
    let words = waits.map_or_else(|| wording::all(&joints, limits.clusters), |why| format!("not judged: {why}"));
    JointDiscovery {
        verdict,
        words,
        judged: waits.is_none(),
        threshold: limits.threshold,
        null_quantiles: limits.quantiles,
        clusters: limits.clusters,
        joints,
        found: found.concat(),
    }
}

struct Joint<'j> {
    scene: &'j Scene,
    search: &'j dyn JointSearch,
    index: usize,
    input: &'j JointInput,
    limits: &'j Limits,
    options: &'j DiscoverOptions,
}

impl Joint<'_> {
    fn believed(&self, law: &Law<'_>, variants: &[Variant<'_>]) -> bool {
        let (coefficients, nonlinear) = estimates(self.scene, law, variants);
        law.ratio < self.limits.threshold && law.ci95[1] < 1.0 && plausible(&coefficients, &nonlinear)
    }

    fn conclude<'a>(&self, mut model: Vec<EffectInstance<'a>>, round: Option<Round<'a>>) -> (JointFinding, Vec<Found>) {
        let key = |effect: &dyn Effect| format!("{}[{}]", effect.id(), self.input.name);
        let mut out = JointFinding {
            joint: self.input.name.clone(),
            verdict: Verdict::NotDetectable,
            words: "not judged".to_owned(),
            unit: self.input.unit.clone(),
            held_out_error: self.input.held_out_error,
            held_out_error_after: self.input.held_out_error,
            noise_floor: self.input.floor.map_or(f64::NAN, |f| f.0),
            noise_floor_ci95: self.input.floor.map(|f| f.1),
            effects: Vec::new(),
            candidates: Vec::new(),
        };
        let Some(mut round) = round else { return (out, Vec::new()) };
        if round.plain.len() < FEWEST_CLUSTERS {
            out.words = wording::joint(&out, &[], self.limits.threshold);
            return (out, Vec::new());
        }
        out.held_out_error = rms(&round.plain, self.input.rows);
        out.candidates = self.candidates(&round);
        // judged with values that every fold chooses for itself; promised with those that are added
        let mut error = out.held_out_error;
        let mut promised = error;
        let mut found: Vec<Found> = Vec::new();
        let mut sure = true;
        let mut floor = self.input.floor;
        for step in 0..MOST_LAWS {
            if measured(floor, error).is_none_or(|s| s.reached_by(error)) {
                break;
            }
            let named = self.named(&round);
            let Some(&chosen) = named.first() else { break };
            sure &= named.len() == 1;
            out.effects.extend(named.iter().map(|&n| round.laws[n].effect.id().to_owned()));
            let law = &round.laws[chosen];
            // the value of a nonlinear parameter, finer than the search tried it
            let start = &round.variants[law.scored.best].choice;
            let mut best = start.clone();
            let mut close = None;
            if let Some(mut near) = range(law, &round.variants) {
                for _ in 0..2 {
                    let tried = finer(self.scene, &best, near);
                    let Some(next) = self::round(self.scene, self.search, self.index, &model, &tried, &self.quick())
                    else {
                        break;
                    };
                    let Some(first) = next.laws.first() else { break };
                    best = next.variants[first.scored.best].choice.clone();
                    near = range(first, &next.variants).unwrap_or(near);
                    close = Some(next);
                }
            }
            let (law, variants) = match close.as_ref().and_then(|c| c.laws.first().map(|l| (l, &c.variants))) {
                Some((law, variants)) => (law, variants),
                None => (law, &round.variants),
            };
            let (coefficients, nonlinear) = estimates(self.scene, law, variants);
            error = rms(&law.scored.fold_error, self.input.rows);
            let effect = law.effect;
            if let Some(shown) = out.candidates.iter_mut().find(|c| step == 0 && c.effect == effect.id()) {
                (shown.coefficients, shown.nonlinear) = (coefficients.clone(), nonlinear.clone());
            }
            found.push(Found {
                effect: effect.id().to_owned(),
                key: key(effect),
                target: best.target,
                nonlinear,
                coefficients,
                trials: Vec::new(),
                also_on: Vec::new(),
                sized_with_contact: false,
            });
            model.push(best);
            let reached = self.search.reached(self.index, &model);
            (promised, floor) = (reached.map_or(error, |r| r.0), reached.and_then(|r| r.1));
            if step + 1 == MOST_LAWS {
                break;
            }
            let left: Vec<EffectInstance<'_>> = round
                .variants
                .iter()
                .map(|v| v.choice.clone())
                .filter(|c| !model.iter().any(|m| m.effect.id() == c.effect.id()))
                .collect();
            match self::round(self.scene, self.search, self.index, &model, &left, &self.quick()) {
                Some(next) => round = next,
                None => break,
            }
        }
        out.held_out_error_after = promised;
        if let (Some(floor), false) = (floor, found.is_empty()) {
            (out.noise_floor, out.noise_floor_ci95) = (floor.0, Some(floor.1));
        }
        let after = measured(floor, error);
        out.verdict = match after {
            Some(s) if s.is_above() => Verdict::Unexplained,
            None => Verdict::NotDetectable,
            _ if found.is_empty() => Verdict::NothingMissing,
            _ if sure => Verdict::Supported,
            _ => Verdict::OneOf,
        };
        out.words = wording::joint(&out, &found, self.limits.threshold);
        if out.verdict == Verdict::Unexplained {
            out.effects.clear();
            found.clear();
        }
        (out, found)
    }

    /// Without a null distribution: that of the first round holds.
    fn quick(&self) -> DiscoverOptions {
        DiscoverOptions { null_draws: 0, ..self.options.clone() }
    }

    /// Laws that no other one beats by more than chance explains, the one with the fewest unknowns
    /// first.
    fn named(&self, round: &Round<'_>) -> Vec<usize> {
        let believed: Vec<usize> =
            (0..round.laws.len()).filter(|&i| self.believed(&round.laws[i], &round.variants)).collect();
        let Some(&first) = believed.first() else { return Vec::new() };
        let unknowns = |i: usize| {
            let v = &round.variants[round.laws[i].scored.best];
            v.coefficients.len() + v.choice.nonlinear.len()
        };
        let better = &round.laws[first].scored.fold_error;
        let mut out: Vec<usize> = believed
            .into_iter()
            .filter(|&i| {
                let worse = &round.laws[i].scored.fold_error;
                i == first || sign_flip_p(better, worse, 1000, self.options.seed) >= self.options.significance
            })
            .collect();
        // a law that contains another one counts only if it does better
        let ids: Vec<&str> = out.iter().map(|&i| round.laws[i].effect.id()).collect();
        out.retain(|&i| !round.laws[i].effect.about().contains.iter().any(|c| ids.contains(c)));
        out.sort_by_key(|&i| (unknowns(i), i));
        out
    }

    fn candidates(&self, round: &Round<'_>) -> Vec<JointCandidate> {
        round
            .laws
            .iter()
            .map(|law| {
                let (coefficients, nonlinear) = estimates(self.scene, law, &round.variants);
                JointCandidate {
                    effect: law.effect.id().to_owned(),
                    key: format!("{}[{}]", law.effect.id(), self.input.name),
                    held_out_ratio: law.ratio,
                    ci95: law.ci95,
                    coefficients,
                    nonlinear,
                    believed: self.believed(law, &round.variants),
                }
            })
            .collect()
    }
}
