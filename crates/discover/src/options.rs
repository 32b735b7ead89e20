//! Settings of a discovery.

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
