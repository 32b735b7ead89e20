//! Inject and recover on the user's own recordings: how often would the right name have come out?
//!
//! An effect of known size is added to the rows through its columns, at multiples of its minimum detectable size and in random directions, and the
//! ranking is run again. What the recordings hold of other errors stays in them.

use crate::DiscoverError;
use crate::discover::{DiscoverOptions, discover};
use crate::result::{Discovery, Verdict};
use crate::session::Session;
use aloft_effects::{Choice, Effect};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use serde::{Deserialize, Serialize};

/// What became of one injected effect.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Injection {
    /// Effect with target.
    pub key: String,
    /// Size over the minimum detectable size.
    pub multiple: f64,
    /// Size, in the unit of the first coefficient.
    pub size: f64,
    /// Verdict on the recordings with it.
    pub verdict: Verdict,
    /// Names given.
    pub named: Vec<String>,
    /// `hit`, `class` (among the names given), `wrong`, `missed`.
    pub outcome: String,
}

/// Table of a self-test.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct SelfTest {
    /// Every injection.
    pub injections: Vec<Injection>,
    /// By multiple: multiple, injections, share of hits, of right classes (hits included), of wrong names.
    pub summary: Vec<[f64; 5]>,
}

/// Injects every effect that `found` could tell at 0.5, 1 and 2 times its minimum detectable size.
///
/// # Errors
/// As [`discover`].
pub fn self_test(
    session: &Session<'_>,
    effects: &[&dyn Effect],
    accepted: &[Choice<'_>],
    found: &Discovery,
    options: &DiscoverOptions,
) -> Result<SelfTest, DiscoverError> {
    let quick = DiscoverOptions { rounds: 1, null_draws: options.null_draws.min(100), ..options.clone() };
    let mut injections = Vec::new();
    for (index, candidate) in found.candidates.iter().filter(|c| !c.placebo).enumerate() {
        let Some(effect) = effects.iter().copied().find(|e| e.id() == candidate.effect) else { continue };
        let detectable = candidate.minimum_detectable;
        if !(detectable.is_finite() && detectable > 0.0) || effect.by_group() {
            continue;
        }
        let mut choice = Choice::new(effect, candidate.target, session.scene);
        if !candidate.nonlinear.is_empty() {
            choice.nonlinear = candidate.nonlinear.iter().map(|e| e.value).collect();
        }
        let coefficients = effect.coefficients(session.scene, candidate.target);
        for multiple in [0.5, 1.0, 2.0] {
            let mut rng = ChaCha8Rng::seed_from_u64(options.seed);
            rng.set_stream(1000 * index as u64 + (10.0 * multiple) as u64);
            let mut theta: Vec<f64> = coefficients
                .iter()
                .map(|c| if c.unit == coefficients[0].unit { 2.0 * rng.random::<f64>() - 1.0 } else { 0.0 })
                .collect();
            for (x, c) in theta.iter_mut().zip(&coefficients) {
                if c.lower == 0.0 {
                    *x = x.abs();
                }
            }
            let length = theta.iter().map(|x| x * x).sum::<f64>().sqrt();
            let size = multiple * detectable;
            theta.iter_mut().for_each(|x| *x *= size / length.max(1e-12));
            let mut copy = session.clone();
            copy.inject(&choice, &theta)?;
            let result = discover(&copy, effects, accepted, &quick)?;
            let outcome = match result.verdict {
                Verdict::Supported if result.effects.first() == Some(&candidate.effect) => "hit",
                Verdict::Supported | Verdict::OneOf if result.effects.contains(&candidate.effect) => "class",
                Verdict::Supported | Verdict::OneOf => "wrong",
                _ => "missed",
            };
            injections.push(Injection {
                key: candidate.key.clone(),
                multiple,
                size,
                verdict: result.verdict,
                named: result.effects,
                outcome: outcome.to_owned(),
            });
        }
    }
    let summary = [0.5, 1.0, 2.0]
        .iter()
        .map(|m| {
            let of: Vec<&Injection> = injections.iter().filter(|i| i.multiple == *m).collect();
            let share = |words: &[&str]| {
                of.iter().filter(|i| words.contains(&i.outcome.as_str())).count() as f64 / of.len().max(1) as f64
            };
            [*m, of.len() as f64, share(&["hit"]), share(&["hit", "class"]), share(&["wrong"])]
        })
        .collect();
    Ok(SelfTest { injections, summary })
}
