//! Result of the search beyond the catalogue, as written by `aloft discover --json` under `open`.

use super::kinematics::{Action, Direction};
use crate::Estimate;
use aloft_effects::{ActsIn, FormulaEffect};
use serde::{Deserialize, Serialize};

/// Where and how the remaining error acts, without a law: the best entry of the atlas.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Diagnosis {
    /// Link, or `body` for the whole body.
    pub carrier: String,
    /// Other links on which an entry leaves nearly as little: they are not excluded.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub also: Vec<String>,
    /// Force or couple.
    pub action: Action,
    /// Direction that it keeps.
    pub direction: Direction,
    /// Variable on which its strength depends (`1` for none), as formulas name it.
    pub variable: String,
    /// Held-out error with this entry, as a share of that without it (root mean square).
    pub held_out_ratio: f64,
    /// Share of the error that it removes: 1 − ratio.
    pub removes: f64,
    /// Probability that the best entry under random signs of flights or trials does as well.
    pub family_wise_p: f64,
    /// The same place and direction with constant strength: held-out ratio.
    pub constant_ratio: Option<f64>,
    /// Probability that the dependence on the variable is chance.
    pub dependence_p: Option<f64>,
    /// Strength (N, or N·m) over the variable, along the direction's first component with the
    /// largest strength: pairs of the variable's value and the strength.
    pub curve: Vec<[f64; 2]>,
    /// In words.
    pub text: String,
}

/// One entry of the atlas.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Entry {
    /// Link, or `body`.
    pub carrier: String,
    /// Force or couple.
    pub action: Action,
    /// Direction.
    pub direction: Direction,
    /// Variable.
    pub variable: String,
    /// Held-out error with the entry over that without.
    pub held_out_ratio: f64,
}

/// Whether a law is an expression or a curve.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum LawKind {
    /// An expression with fitted constants.
    Formula,
    /// A curve through free values: no expression came within 15 % of it.
    Curve,
}

/// A law found by the search.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct FoundLaw {
    /// Identifier, as accepted by `aloft effect add`.
    pub id: String,
    /// Expression or curve.
    pub kind: LawKind,
    /// Link, or `body`.
    pub carrier: String,
    /// Other links on which a law of the same kind leaves at most 5 % more error: the recordings do
    /// not exclude them.
    pub also: Vec<String>,
    /// Force or couple.
    pub action: Action,
    /// Direction.
    pub direction: Direction,
    /// Variables of its factors, as formulas name them.
    pub variables: Vec<String>,
    /// Strength along the direction (N, or N·m) in the names of its unknowns and variables, one
    /// term for each linear unknown of a component.
    pub strength: String,
    /// Point on the link, link frame, m, with its standard errors; empty for a couple, the whole
    /// body, or the link's centre of mass.
    pub point: Vec<Estimate>,
    /// Linear unknowns. Their intervals hold if this law is the right one. They contain the spread
    /// between recordings and, where the comparison drew errors, the geometry of the calibrated
    /// body.
    pub coefficients: Vec<Estimate>,
    /// Nonlinear unknowns that the formulas name, with intervals of the same kind.
    pub parameters: Vec<Estimate>,
    /// Held-out error with the laws up to this one, over that without this one.
    pub held_out_ratio: f64,
    /// Probability that the best entry of the search under random signs does as well. For a law of
    /// flights and contact: the best at the places that were chosen by flights, so that the number
    /// does not contain this choice.
    pub family_wise_p: f64,
    /// True if it was found in flight and contact together, so that a lower error in contact is no
    /// independent test of it. False if it was found in flight alone.
    #[serde(default)]
    pub with_contact: bool,
    /// True if the sizes of its coefficients are from flights and contact together, so that contact
    /// takes part in the identification of a model with it.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub sized_with_contact: bool,
    /// Work over all flights: share of the absolute power that is taken from the body (1: it only
    /// brakes), and mean absolute power over force times speed (0: it does no work).
    pub work: Work,
    /// In words.
    pub text: String,
    /// The law as an effect of the user's own.
    pub effect: FormulaEffect,
}

impl FoundLaw {
    /// The law, acting in contact as well as in flight.
    pub(crate) fn acting_everywhere(&self) -> Self {
        let effect = FormulaEffect { acts: ActsIn::Both, ..self.effect.clone() };
        // a law that was sought in contact says so already
        let words = if self.with_contact { "" } else { "; found in flight, it lowers the error in contact, too" };
        Self { text: format!("{}{words}", self.text), effect, ..self.clone() }
    }
}

/// Work done by a law over all flights.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Work {
    /// Share of the absolute power that is taken from the body: 1 if it only brakes.
    pub taken: f64,
    /// Mean absolute power over mean magnitude of force times speed (couple times angular
    /// velocity): 0 if it does no work.
    pub share: f64,
}

/// The recording that would tell a law from the next best one.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct NextRecording {
    /// The next best law with another place, direction or variable, in words.
    pub rival: String,
    /// Its held-out error over that of the law.
    pub rival_error_ratio: f64,
    /// How the flights should be changed.
    pub change: String,
    /// Root mean square of the difference of the two laws on the present flights, N: force, and
    /// moment over a lever of 0.1 m.
    pub differ_here_n: f64,
    /// The same on the changed flights.
    pub differ_there_n: f64,
}

/// Result of the search beyond the catalogue.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct OpenWorld {
    /// Effects in the model on which the search was made.
    pub model: Vec<String>,
    /// Number of entries of the atlas that were scored in the first round.
    pub entries: usize,
    /// Flights or trials that count as evidence.
    pub clusters: usize,
    /// The 5 % quantile of the best ratio under random signs, first round.
    pub by_chance: f64,
    /// Where and how the error acts; none if the best entry is not better than chance.
    pub diagnosis: Option<Diagnosis>,
    /// The best entries that differ in place, direction or variable, best first.
    pub atlas: Vec<Entry>,
    /// Laws, in the order in which they were found; empty if none convinces.
    pub laws: Vec<FoundLaw>,
    /// Recording that would tell the first law from the next best one.
    pub next: Option<NextRecording>,
    /// True if the laws bring the error to 1.5 times its floor or less: they are the answer. False:
    /// they are a part of it.
    pub complete: bool,
    /// Held-out error with the laws over the floor; null without a floor.
    pub times_floor_after: Option<f64>,
    /// True if that error is not above the interval of the floor; null where neither is known.
    #[serde(default)]
    pub at_floor_after: Option<bool>,
    /// Held-out error with the laws, N.
    pub held_out_error_after: f64,
    /// Error in contact over its floor with the laws, as computed by all stages; null where it was
    /// not computed.
    #[serde(default)]
    pub times_floor_in_contact: Option<f64>,
    /// Budget after which the search was stopped, s: more time may find more. None if it ended by
    /// itself.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub stopped_after_s: Option<f64>,
    /// The result in words.
    pub words: String,
}
