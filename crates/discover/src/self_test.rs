//! Self-test: injects effects into the user's own recordings and counts how often they are
//! recovered.
//!
//! First the effects already missing from the model are found and added to it. Then every
//! detectable effect of the catalogue is added to the rows through its columns, at multiples of its
//! minimum detectable size and in random directions, and the ranking is run again. Other errors of
//! the recordings (soft tissue, joint centres) stay in them.

use crate::DiscoverError;
use crate::discover::discover;
use crate::options::DiscoverOptions;
use crate::result::{Candidate, Verdict};
use crate::session::Session;
use aloft_effects::{Effect, EffectInstance};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use serde::{Deserialize, Serialize};

/// Options of a self-test.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct SelfTestOptions {
    /// Options of every ranking; `only` and `without` select both the injected and the competing
    /// effects.
    pub discover: DiscoverOptions,
    /// Injected sizes, as multiples of the minimum detectable size.
    pub multiples: Vec<f64>,
    /// Number of directions in which each effect is injected at each size.
    pub draws: usize,
    /// Only these effects are injected (all compete); every detectable one if empty.
    pub inject: Vec<String>,
}

impl Default for SelfTestOptions {
    fn default() -> Self {
        Self { discover: DiscoverOptions::default(), multiples: vec![0.5, 1.0, 2.0], draws: 1, inject: Vec::new() }
    }
}

/// Progress of a self-test.
#[derive(Debug, Clone, PartialEq)]
pub struct SelfTestProgress<'a> {
    /// Number of injections done.
    pub done: usize,
    /// Total number of injections.
    pub of: usize,
    /// The injection just judged.
    pub last: &'a Injection,
}

/// Result for one injected effect.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Injection {
    /// Key of the effect with its target.
    pub key: String,
    /// Size as a multiple of the minimum detectable size.
    pub multiple: f64,
    /// Size, in the unit of the first coefficient.
    pub size: f64,
    /// Unit of the size.
    pub unit: String,
    /// Verdict on the recordings with the injected effect.
    pub verdict: Verdict,
    /// Effects named by the verdict.
    pub named: Vec<String>,
    /// `hit`, `class` (among the names given), `wrong`, `missed`.
    pub outcome: String,
}

/// Summary at one multiple of the minimum detectable size.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct SelfTestRow {
    /// Size as a multiple of the minimum detectable size.
    pub multiple: f64,
    /// Number of injections.
    pub injections: usize,
    /// Share in which the injected effect alone was named.
    pub hit: f64,
    /// Share in which the injected effect was named, alone or in a class.
    pub right: f64,
    /// Share in which only other effects were named.
    pub wrong: f64,
}

/// Result of a self-test.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct SelfTest {
    /// Version of this layout.
    pub schema: u32,
    /// Keys of the effects in the model during the injections: those accepted before, then those
    /// found to be missing.
    pub model: Vec<String>,
    /// Every injection.
    pub injections: Vec<Injection>,
    /// Summary by multiple.
    pub summary: Vec<SelfTestRow>,
    /// Effects that could not be injected, with the reason.
    pub left_out: Vec<String>,
}

/// Injects every effect that these recordings could detect and counts how often it is named.
///
/// This is the whole call that `aloft discover --self-test` needs: a session, the catalogue, the
/// effects in the model, options, and a callback that receives every injection as it is judged
/// (`&|_| {}` for none). The signature is meant to stay stable.
///
/// # Errors
/// As [`discover`].
pub fn self_test(
    session: &Session<'_>,
    catalogue: &[&dyn Effect],
    accepted: &[EffectInstance<'_>],
    options: &SelfTestOptions,
    progress: &(dyn Fn(&SelfTestProgress<'_>) + Sync),
) -> Result<SelfTest, DiscoverError> {
    let scene = session.scene();
    let closed = DiscoverOptions { closed: true, ..options.discover.clone() };
    let first = discover(session, catalogue, accepted, &closed)?;
    let mut model: Vec<EffectInstance<'_>> = accepted.to_vec();
    for found in &first.found {
        if let Some(effect) = catalogue.iter().copied().find(|e| e.id() == found.effect) {
            let nonlinear = found.nonlinear.iter().map(|e| e.value).collect();
            model.push(EffectInstance { effect, target: found.target, nonlinear, trials: found.trials.clone() });
        }
    }
    let quick = DiscoverOptions { rounds: 1, null_draws: options.discover.null_draws.min(100), ..closed };
    // take the sizes from the ranking with the effects found in the model
    let ranked = if first.found.is_empty() { first } else { discover(session, catalogue, &model, &quick)? };
    let mut left_out = Vec::new();
    let mut jobs: Vec<(&Candidate, &dyn Effect, usize)> = Vec::new();
    let wanted = |c: &Candidate| options.inject.is_empty() || options.inject.contains(&c.effect);
    for (index, candidate) in ranked.candidates.iter().enumerate().filter(|(_, c)| wanted(c)) {
        let Some(effect) = catalogue.iter().copied().find(|e| e.id() == candidate.effect) else { continue };
        let key = &candidate.key;
        if effect.about().by_group && candidate.trials.is_empty() {
            left_out.push(format!("`{key}` shows only between groups of trials"));
        } else if !(candidate.minimum_detectable.is_finite() && candidate.minimum_detectable > 0.0) {
            left_out.push(format!("`{key}` cannot be detected in these recordings at any plausible size"));
        } else {
            jobs.push((candidate, effect, index));
        }
    }
    let of = jobs.len() * options.multiples.len() * options.draws;
    let mut injections: Vec<Injection> = Vec::with_capacity(of);
    for (candidate, effect, index) in jobs {
        let mut choice = EffectInstance::new(effect, candidate.target, scene).in_trials(&candidate.trials);
        if !candidate.nonlinear.is_empty() {
            choice.nonlinear = candidate.nonlinear.iter().map(|e| e.value).collect();
        }
        for (step, &multiple) in options.multiples.iter().enumerate() {
            for draw in 0..options.draws {
                let mut rng = ChaCha8Rng::seed_from_u64(options.discover.seed);
                rng.set_stream((1_000_000 * index + 1000 * step + draw) as u64);
                let size = multiple * candidate.minimum_detectable;
                let theta = direction(effect, &choice, session, size, &mut rng);
                let mut copy = session.clone();
                copy.inject(&choice, &theta)?;
                let result = discover(&copy, catalogue, &model, &quick)?;
                let claimed = matches!(result.verdict, Verdict::Supported | Verdict::OneOf);
                let outcome = match result.effects.contains(&candidate.effect) {
                    true if claimed && result.effects.len() == 1 => "hit",
                    true if claimed => "class",
                    _ if claimed => "wrong",
                    _ => "missed",
                };
                injections.push(Injection {
                    key: candidate.key.clone(),
                    multiple,
                    size,
                    unit: candidate.coefficients.first().map(|c| c.unit.clone()).unwrap_or_default(),
                    verdict: result.verdict,
                    named: result.effects,
                    outcome: outcome.to_owned(),
                });
                let done = injections.len();
                if let Some(last) = injections.last() {
                    progress(&SelfTestProgress { done, of, last });
                }
            }
        }
    }
    let summary = options
        .multiples
        .iter()
        .map(|&multiple| {
            let at: Vec<&Injection> = injections.iter().filter(|i| i.multiple == multiple).collect();
            let share = |words: &[&str]| {
                at.iter().filter(|i| words.contains(&i.outcome.as_str())).count() as f64 / at.len().max(1) as f64
            };
            SelfTestRow {
                multiple,
                injections: at.len(),
                hit: share(&["hit"]),
                right: share(&["hit", "class"]),
                wrong: share(&["wrong"]),
            }
        })
        .collect();
    let model = model.iter().map(|c| c.key(scene)).collect();
    Ok(SelfTest { schema: 1, model, injections, summary, left_out })
}

/// Coefficients of a given length (over those with the unit of the first one) in a random
/// direction, within the physically permitted signs.
fn direction(
    effect: &dyn Effect,
    choice: &EffectInstance<'_>,
    session: &Session<'_>,
    size: f64,
    rng: &mut ChaCha8Rng,
) -> Vec<f64> {
    let coefficients = effect.coefficients(session.scene(), choice.target);
    let mut theta: Vec<f64> = coefficients
        .iter()
        .map(|c| {
            let x = if c.unit == coefficients[0].unit { 2.0 * rng.random::<f64>() - 1.0 } else { 0.0 };
            if c.lower == 0.0 { x.abs() } else { x }
        })
        .collect();
    let length = theta.iter().map(|x| x * x).sum::<f64>().sqrt();
    theta.iter_mut().for_each(|x| *x *= size / length.max(1e-12));
    theta
}
