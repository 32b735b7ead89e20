//! From the evidence of explanations to probabilities: of effects, of targets, of sets of
//! recordings.

use super::explanation::Explanation;
use super::priors::NOTHING;
use crate::candidate::{Variant, solve};
use crate::problem::Problem;
use crate::session::Session;
use aloft_effects::Effect;

/// One effect: its explanations, best first, with their share of the effect's probability.
#[derive(Clone)]
pub(super) struct EffectPosterior<'a> {
    pub explanations: Vec<(Explanation<'a>, f64)>,
    /// Logarithm of its odds against "nothing missing", prior odds included.
    pub ln_odds: f64,
    /// Probability that it is the one.
    pub probability: f64,
}

impl<'a> EffectPosterior<'a> {
    /// True if these are explanations by an effect.
    pub fn is_of(&self, effect: &dyn Effect) -> bool {
        self.explanations.first().is_some_and(|(e, _)| e.variant.effect.id() == effect.id())
    }

    /// Its explanations in all recordings as they are, with their gains beside another model.
    pub fn again(&self, session: &Session<'_>, problem: &Problem) -> Vec<(Variant<'a>, f64)> {
        let everywhere = |v: &&Variant<'a>| v.group.is_empty() || v.effect.about().by_group;
        let gain = |variant: &Variant<'a>| {
            let (s, c) = problem.reduce_all(&variant.columns(session, problem)?);
            Some((variant.clone(), solve(&s, &c, &variant.coefficients).1))
        };
        self.explanations.iter().map(|(e, _)| &e.variant).filter(everywhere).filter_map(gain).collect()
    }
}

/// Probabilities of all effects, the likeliest first, and that of "nothing missing".
#[derive(Clone)]
pub(super) struct Posterior<'a> {
    pub effects: Vec<EffectPosterior<'a>>,
    pub nothing: f64,
}

/// Logarithm of a sum of exponentials.
pub(super) fn ln_sum(terms: impl Iterator<Item = f64> + Clone) -> f64 {
    let most = terms.clone().fold(f64::NEG_INFINITY, f64::max);
    if most.is_finite() { most + terms.map(|t| (t - most).exp()).sum::<f64>().ln() } else { most }
}

impl<'a> Posterior<'a> {
    /// From the explanations of each effect; `ln_nothing` is the marginal likelihood of the model
    /// without them.
    pub fn of(of_effects: Vec<Vec<Explanation<'a>>>, ln_nothing: f64) -> Self {
        let prior = ((1.0 - NOTHING) / NOTHING / of_effects.len().max(1) as f64).ln();
        let mut effects: Vec<EffectPosterior<'a>> = of_effects
            .into_iter()
            .map(|mut explanations| {
                explanations.sort_by(|a, b| b.ln_likelihood.total_cmp(&a.ln_likelihood));
                let mut targets: Vec<_> = explanations.iter().map(|e| e.variant.target).collect();
                targets.sort_unstable();
                targets.dedup();
                let all = ln_sum(explanations.iter().map(|e| e.ln_likelihood));
                let shares = explanations.iter().map(|e| (e.ln_likelihood - all).exp()).collect::<Vec<_>>();
                EffectPosterior {
                    explanations: explanations.into_iter().zip(shares).collect(),
                    ln_odds: all - (targets.len().max(1) as f64).ln() + prior - ln_nothing,
                    probability: 0.0,
                }
            })
            .collect();
        effects.sort_by(|a, b| b.ln_odds.total_cmp(&a.ln_odds));
        let whole = ln_sum(std::iter::once(0.0).chain(effects.iter().map(|e| e.ln_odds)));
        effects.iter_mut().for_each(|e| e.probability = (e.ln_odds - whole).exp());
        Self { effects, nothing: (-whole).exp() }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use aloft_effects::{EFFECTS, Target};
    use nalgebra::DVector;

    fn explanation(effect: usize, link: usize, ln_likelihood: f64) -> Explanation<'static> {
        let variant = Variant {
            effect: EFFECTS[effect],
            target: Target::Link(link),
            nonlinear: Vec::new(),
            coefficients: Vec::new(),
            group: Vec::new(),
        };
        Explanation { variant, theta: DVector::zeros(0), left: 0.0, ln_likelihood }
    }

    /// Two effects that are as likely as "nothing" hold a quarter each, whatever the number of
    /// their targets, and the targets of one share its probability by their likelihoods.
    #[test]
    fn effects_share_the_prior_evenly_and_targets_that_of_their_effect() {
        let of_effects = vec![
            vec![explanation(0, 0, -7.0), explanation(0, 1, -7.0), explanation(0, 2, -7.0)],
            vec![explanation(1, 0, -7.0 + 4f64.ln() + 0.5f64.ln()), explanation(1, 1, f64::NEG_INFINITY)],
        ];
        let posterior = Posterior::of(of_effects, -7.0);
        let near = |a: f64, b: f64| (a - b).abs() < 1e-12;
        assert!(near(posterior.nothing, 0.5), "{}", posterior.nothing);
        assert!(posterior.effects.iter().all(|e| near(e.probability, 0.25)), "{:?}", posterior.effects[0].probability);
        let three = posterior.effects.iter().find(|e| e.explanations.len() == 3).unwrap();
        assert!(three.explanations.iter().all(|(_, share)| near(*share, 1.0 / 3.0)));
    }
}
