//! Settings of a discovery.

use serde::{Deserialize, Serialize};

/// How effects are judged.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Method {
    /// Held-out errors in rounds, in flight and in contact apart, each with its limits.
    #[default]
    Rounds,
    /// One marginal likelihood over flights and contact together.
    Evidence,
}

/// Options of a discovery.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct DiscoverOptions {
    /// How effects are judged.
    #[serde(skip_serializing_if = "Method::is_default")]
    pub method: Method,
    /// Largest held-out ratio at which an effect can be accepted.
    pub belief: f64,
    /// The same limit for kinematic errors (soft tissue, joint centres, filters, camera volume,
    /// flight edges). Every recording has some of them, so only a large one is named, and only
    /// before any other effect was found.
    pub belief_kinematics: f64,
    /// The same limit for force-plate errors: every plate drifts a little.
    pub belief_plates: f64,
    /// Draws of flipped signs for the null distribution.
    pub null_draws: usize,
    /// Resamples of clusters for intervals.
    pub resamples: usize,
    /// Largest number of rounds per kind of motion, each adding an effect or a pair.
    pub rounds: usize,
    /// Trials are the unit of evidence if there are at least this many, flights otherwise.
    pub fewest_trials: usize,
    /// Weight of the prior of the parameters (1: the uncertainty that the prior states).
    pub prior_weight: f64,
    /// Two effects count as distinguishable if the p-value of their difference is below this.
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

impl Method {
    fn is_default(&self) -> bool {
        *self == Self::default()
    }
}

impl Default for DiscoverOptions {
    fn default() -> Self {
        Self {
            method: Method::default(),
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
            closed: false,
            budget_s: None,
            seed: 20_100_503,
        }
    }
}
