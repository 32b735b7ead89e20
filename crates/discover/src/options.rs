//! Settings of a discovery.

use crate::result::MANY_CLUSTERS;
use aloft_effects::Effect;
use serde::{Deserialize, Serialize};

/// Options of a discovery.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct DiscoverOptions {
    /// Largest held-out ratio at which a law of a rigid body, or of a joint, is stated.
    pub belief: f64,
    /// The same limit for laws on a person, whose skin repeats from trial to trial and looks like a
    /// law.
    pub belief_kinematics: f64,
    /// Draws of flipped signs for the null distribution of the torques of joints.
    pub null_draws: usize,
    /// Resamples of clusters for intervals.
    pub resamples: usize,
    /// Largest number of questions, each of which may add an effect.
    pub rounds: usize,
    /// Trials are the unit of evidence if there are at least this many, flights otherwise.
    pub fewest_trials: usize,
    /// Weight of the prior of the parameters (1: the uncertainty that the prior states).
    pub prior_weight: f64,
    /// A law is stated only if chance alone does as well with a probability below this.
    pub significance: f64,
    /// Only these effects are ranked; all when empty.
    pub only: Vec<String>,
    /// Effects to leave out.
    pub without: Vec<String>,
    /// True to rank the catalogue only, without the search for laws beyond it.
    pub closed: bool,
    /// Time after which the search for laws begins nothing new and answers with what it has, s; no
    /// limit where not given. The answer then depends on the speed of the machine.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub budget_s: Option<f64>,
    /// Seed of all random draws.
    pub seed: u64,
}

impl DiscoverOptions {
    /// True if an effect is to be tried.
    pub(crate) fn asks_for(&self, effect: &dyn Effect) -> bool {
        let named = |list: &[String]| list.iter().any(|n| n == effect.id());
        (self.only.is_empty() || named(&self.only)) && !named(&self.without)
    }

    /// Largest held-out ratio that counts with this number of flights or trials: with few of them
    /// only a strong effect does.
    pub(crate) fn largest_ratio(&self, clusters: usize) -> f64 {
        match clusters {
            0..5 => self.belief.min(0.80),
            5..MANY_CLUSTERS => self.belief.min(0.85),
            _ => self.belief,
        }
    }
}

impl Default for DiscoverOptions {
    fn default() -> Self {
        Self {
            belief: 0.90,
            belief_kinematics: 0.75,
            null_draws: 200,
            resamples: 500,
            rounds: 3,
            fewest_trials: 6,
            prior_weight: 1.0,
            significance: 0.05,
            only: Vec::new(),
            without: Vec::new(),
            closed: false,
            budget_s: None,
            seed: 20_100_503,
        }
    }
}
