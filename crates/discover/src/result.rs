//! Result of a discovery, as written by `aloft discover --json`.

use crate::joints::JointDiscovery;
use crate::laws::OpenWorld;
use aloft_effects::{EffectKind, Target};
use serde::{Deserialize, Serialize};

/// Verdict of a discovery.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Verdict {
    /// One effect is missing, and no other explains the recordings as well.
    Supported,
    /// One of several effects is missing; these recordings cannot distinguish them.
    OneOf,
    /// The model explains what the recordings can show: its held-out error is at the noise floor or
    /// near it.
    NothingMissing,
    /// The held-out error is far above the noise floor, and no effect of the catalogue explains it.
    Unexplained,
    /// The recordings are too few or too noisy to tell.
    NotDetectable,
}

/// A coefficient, or a nonlinear parameter, with its standard error.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Estimate {
    /// Name.
    pub name: String,
    /// Value.
    #[serde(deserialize_with = "nullable")]
    pub value: f64,
    /// Standard error: over clusters (jackknife), or that of the joint fit with nonlinear
    /// parameters if that is larger. Null if unknown, as for an estimate at its bound.
    #[serde(deserialize_with = "nullable")]
    pub se: f64,
    /// 95 % interval ([`aloft_identify::interval95`]); null if the standard error is unknown.
    #[serde(default)]
    pub ci95: Option<[f64; 2]>,
    /// Degrees of freedom of the standard error; null for infinity.
    #[serde(default = "nothing", deserialize_with = "nullable")]
    pub freedom: f64,
    /// True if the fit ended at a bound set by physics or by the method: the recordings did not
    /// determine this number.
    #[serde(default)]
    pub at_bound: bool,
    /// Factor by which the interval grows because nonlinear parameters were fitted as well, and by
    /// errors that are the same in all recordings; 1 where there are none.
    #[serde(default = "one")]
    #[serde(deserialize_with = "nullable")]
    pub widening: f64,
    /// SI unit.
    pub unit: String,
}

impl Estimate {
    /// Sets the standard error and its degrees of freedom, and from them the interval. An estimate
    /// at its bound has none.
    pub(crate) fn with_error(mut self, se: f64, freedom: f64) -> Self {
        (self.se, self.freedom) = if self.at_bound { (f64::NAN, f64::NAN) } else { (se, freedom) };
        self.ci95 = aloft_identify::interval95(self.value, self.se, self.freedom);
        self
    }
}

/// JSON has no NaN and no infinity: both are written as null, and null is read as NaN.
pub(crate) fn nullable<'de, D: serde::Deserializer<'de>>(deserializer: D) -> Result<f64, D::Error> {
    Ok(Option::<f64>::deserialize(deserializer)?.unwrap_or(f64::NAN))
}

/// The same for a list of fixed length.
pub(crate) fn nullable_all<'de, D: serde::Deserializer<'de>, const N: usize>(
    deserializer: D,
) -> Result<[f64; N], D::Error> {
    let values = Vec::<Option<f64>>::deserialize(deserializer)?;
    let found = values.len();
    let values: Vec<f64> = values.into_iter().map(|v| v.unwrap_or(f64::NAN)).collect();
    values.try_into().map_err(|_| serde::de::Error::invalid_length(found, &"a list of fixed length"))
}

fn nothing() -> f64 {
    f64::NAN
}

fn one() -> f64 {
    1.0
}

/// One effect of the ranking.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Candidate {
    /// Identifier.
    pub effect: String,
    /// Key of the effect with its target, as accepted by `effect add`.
    pub key: String,
    /// Target on which it acts.
    pub target: Target,
    /// Physics or artefact.
    pub kind: EffectKind,
    /// Group of effects that recordings of this kind can never distinguish; empty for none.
    pub class: String,
    /// `flight` or `contact`: the rows on which it was judged.
    pub judged_on: String,
    /// Held-out error (root mean square) with the effect divided by that without it.
    #[serde(deserialize_with = "nullable")]
    pub held_out_ratio: f64,
    /// 95 % interval of the ratio over clusters.
    #[serde(deserialize_with = "nullable_all")]
    pub ci95: [f64; 2],
    /// Linear unknowns.
    pub coefficients: Vec<Estimate>,
    /// Nonlinear unknowns.
    pub nonlinear: Vec<Estimate>,
    /// Trials in which a group effect acts; empty for all.
    pub trials: Vec<String>,
    /// Effect size that would be detected in four of five sessions like this one, in the unit of
    /// the first coefficient (length of the vector of coefficients of that unit).
    #[serde(deserialize_with = "nullable")]
    pub minimum_detectable: f64,
    /// False if a coefficient is at a physical bound.
    pub plausible: bool,
    /// True if it passes every test except the comparison with its rivals.
    pub believed: bool,
    /// The same effect on other targets, best first (this one included).
    pub alternatives: Vec<Alternative>,
    /// Its marginal likelihood; none in an answer of an earlier version.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub evidence: Option<CandidateEvidence>,
}

/// What one marginal likelihood over flights and contact says of an effect.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct CandidateEvidence {
    /// Natural logarithm of its odds against "nothing missing", over all targets, places and sets
    /// of recordings, those before the recordings included.
    #[serde(deserialize_with = "nullable")]
    pub ln_odds: f64,
    /// The same with recordings as the units, left out one by one; null for effects that are not
    /// the first, and where it gains nothing.
    #[serde(default)]
    pub ln_odds_by_recording: Option<f64>,
    /// Probability that it is the one that is missing.
    #[serde(deserialize_with = "nullable")]
    pub probability: f64,
    /// Root mean square of the rows that it leaves, in units of their noise.
    #[serde(deserialize_with = "nullable")]
    pub residual: f64,
}

impl CandidateEvidence {
    /// Odds against "nothing missing" that may be stated (natural logarithm): the smaller of those
    /// by rows and those by recordings, because errors that repeat make rows look independent.
    pub fn sure(&self) -> f64 {
        self.ln_odds_by_recording.map_or(self.ln_odds, |by| by.min(self.ln_odds))
    }
}

/// What one marginal likelihood says of the recordings as a whole.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct SessionEvidence {
    /// Root mean square of the rows that the present model leaves, in units of their noise.
    #[serde(deserialize_with = "nullable")]
    pub residual_before: f64,
    /// The same with the effects found.
    #[serde(deserialize_with = "nullable")]
    pub residual_after: f64,
    /// Probability that nothing is missing from the present model.
    #[serde(deserialize_with = "nullable")]
    pub nothing: f64,
}

/// An effect on one target.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Alternative {
    /// Key of the effect with its target.
    pub key: String,
    /// Held-out ratio of this target alone.
    #[serde(deserialize_with = "nullable")]
    pub held_out_ratio: f64,
}

/// With fewer flights or trials than this only a strong effect counts in the torques of joints, and
/// more are asked for.
pub(crate) const MANY_CLUSTERS: usize = 12;

/// With fewer flights or trials than this nothing is named: random signs of five residuals have
/// sixteen patterns up to a common sign, so that no p-value could be below 0.05.
pub(crate) const FEWEST_CLUSTERS: usize = 6;

/// One round: the ranking against a model, and the conclusion.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Round {
    /// `flight` or `contact`.
    pub judged_on: String,
    /// Keys of the effects in the model before this round.
    pub model: Vec<String>,
    /// Held-out error of that model: root mean square of weak rows, N (moments over the weighting
    /// length of the rows).
    #[serde(deserialize_with = "nullable")]
    pub held_out_error: f64,
    /// Number of flights or trials that count as evidence.
    pub clusters: usize,
    /// Verdict of this round.
    pub verdict: Verdict,
    /// Effects named by the verdict, the one with the fewest unknowns first.
    pub effects: Vec<String>,
    /// Number of the named effects that are missing at least: one, or two of a pair.
    #[serde(default)]
    pub missing: usize,
    /// Reason, in words.
    pub words: String,
    /// All effects, best first.
    pub candidates: Vec<Candidate>,
}

impl Round {
    /// True if there are too few clusters to name anything.
    pub fn has_too_few(&self) -> bool {
        self.clusters < FEWEST_CLUSTERS
    }
}

/// Effects of which some are missing from the model. A group of one is supported; of a larger one
/// the recordings cannot tell which.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Group {
    /// Identifiers, the one that joined the model first.
    pub effects: Vec<String>,
    /// How many of them are missing at least.
    pub missing: usize,
}

impl Group {
    /// True if every effect of the group is missing.
    pub fn is_sure(&self) -> bool {
        self.missing >= self.effects.len()
    }
}

/// Result of a discovery.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Discovery {
    /// Version of this layout.
    pub schema: u32,
    /// Verdict.
    pub verdict: Verdict,
    /// Effects named by the verdict: with `supported` each of them is missing, with `one_of` the
    /// members of all `groups`.
    pub effects: Vec<String>,
    /// What is missing, round by round: effects of which the recordings say that `missing` of them
    /// act.
    #[serde(default)]
    pub groups: Vec<Group>,
    /// The result in words.
    pub words: String,
    /// Noise floor of the comparison, N: held-out error over weak windows that a perfect model
    /// would leave on these recordings; NaN if no comparison was made.
    #[serde(with = "nullable")]
    pub noise_floor: f64,
    /// 95 % interval of the floor, N: the range of the error of a perfect model.
    #[serde(default)]
    pub noise_floor_ci95: Option<[f64; 2]>,
    /// Error up to which noise, the geometry that the markers leave open and the errors of the
    /// parameters, fitted to the other recordings, account for it (97.5 %), N. Far above the floor
    /// where few flights determine the body only roughly.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub error_by_parameters: Option<f64>,
    /// Held-out error of the present model, N, as reported by the comparison: force, and moment
    /// over a lever of 0.1 m. In flight; in contact where no recording has a flight.
    #[serde(deserialize_with = "nullable")]
    pub held_out_error: f64,
    /// Held-out error with the effects found on the same motion, N: computed by all stages, or
    /// scaled by the relative change of the rows' error.
    #[serde(deserialize_with = "nullable")]
    pub held_out_error_after: f64,
    /// `held_out_error` as a share of the body's weight.
    #[serde(deserialize_with = "nullable")]
    pub held_out_error_of_weight: f64,
    /// Ranking against the present model.
    pub candidates: Vec<Candidate>,
    /// All rounds.
    pub rounds: Vec<Round>,
    /// Effects to add, in order: keys with values of their nonlinear parameters.
    pub found: Vec<Found>,
    /// The same effects added one after the other, each judged on the windows where it acts.
    #[serde(default)]
    pub ladder: Vec<Addition>,
    /// What to record next.
    pub advice: Vec<String>,
    /// Data that were left out, with the reason.
    pub warnings: Vec<String>,
    /// Why models that the search wanted to judge could not be computed; empty for a whole answer.
    /// An answer with such a part missing is not stored.
    #[serde(skip)]
    pub failed: Vec<String>,
    /// Search beyond the catalogue; null if the error is at its floor, or the catalogue explains
    /// it.
    #[serde(default)]
    pub open: Option<OpenWorld>,
    /// What to correct before the answer and its sizes can be trusted; none where nothing has to
    /// be, or where the answer explains what it rests on. It is the first piece of advice, too.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub to_correct: Option<String>,
    /// Laws of joints, from the torques in a robot's log; null without torques.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub joints: Option<JointDiscovery>,
    /// Effects whose law gives no numbers on these recordings, so that no conclusion about them is
    /// possible.
    #[serde(default)]
    pub not_tried: Vec<NotTried>,
    /// Dependence of the strength of what was found on something that its law does not describe: it
    /// acts like the effect, and what acts is not known.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub misfit: Option<Misfit>,
    /// Evidence of the recordings as a whole; none in an answer of an earlier version.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub evidence: Option<SessionEvidence>,
}

/// Dependence of an effect's strength that its law does not describe.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Misfit {
    /// Key of the effect with its target.
    pub effect: String,
    /// Link whose motion the variable describes, or `body`.
    pub carrier: String,
    /// Variable, as formulas name it; `strength` if the effect's force grows with another power of
    /// its own strength, `delay` if it follows the motion at another time.
    pub variable: String,
    /// What its strength does, in words.
    #[serde(default)]
    pub words: String,
    /// Natural logarithm of the odds for that dependence, the smaller of those by rows and by
    /// recordings.
    #[serde(default = "nothing", deserialize_with = "nullable")]
    pub ln_odds: f64,
}

/// An effect as stored in a model revision.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Found {
    /// Identifier.
    pub effect: String,
    /// Key of the effect with its target.
    pub key: String,
    /// Target.
    pub target: Target,
    /// Nonlinear parameters.
    pub nonlinear: Vec<Estimate>,
    /// Coefficients with all effects found in the model: those that `effect add` will show where
    /// all stages could compute them, else refitted by the ranking.
    pub coefficients: Vec<Estimate>,
    /// Trials in which a group effect acts; empty for all.
    pub trials: Vec<String>,
    /// Other links on which the effect explains as much, best first: the recordings leave open on
    /// which of them it acts. Of a load also pairs of mirrored links, half of it on each, as
    /// `thigh_l and thigh_r`.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub also_on: Vec<String>,
    /// True if its size is from flights and contact together, so that contact takes part in the
    /// identification of a model with it; false if it is from flights alone.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub sized_with_contact: bool,
}

impl Found {
    /// Other links on which it explains as much, in words; none if the recordings tell its link.
    pub fn other_links(&self) -> Option<String> {
        let names: Vec<String> = self.also_on.iter().map(|name| format!("`{name}`")).collect();
        (!names.is_empty()).then(|| format!("it would explain as much on {}", names.join(" or ")))
    }

    /// True if both put the same effect into a model, whatever its coefficients are estimated at.
    pub fn is_same_effect(&self, other: &Self) -> bool {
        let values = |f: &Self| f.nonlinear.iter().map(|e| e.value.to_bits()).collect::<Vec<_>>();
        self.key == other.key
            && self.trials == other.trials
            && self.sized_with_contact == other.sized_with_contact
            && values(self) == values(other)
    }
}

/// Writes a missing number as `null` in text formats and reads it back as NaN.
mod nullable {
    use serde::{Deserialize, Deserializer, Serialize, Serializer};

    pub fn serialize<S: Serializer>(value: &f64, to: S) -> Result<S::Ok, S::Error> {
        value.is_finite().then_some(*value).serialize(to)
    }

    pub fn deserialize<'de, D: Deserializer<'de>>(from: D) -> Result<f64, D::Error> {
        Ok(Option::<f64>::deserialize(from)?.unwrap_or(f64::NAN))
    }
}

/// One rung of the ladder: held-out error before and after an effect, on the windows where it acts.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Addition {
    /// Effect with target.
    pub key: String,
    /// `flight` or `contact`: the windows on which it is judged.
    pub judged_on: String,
    /// Held-out error of the model before, N (root mean square of weak rows, moments over the
    /// weighting length of the rows).
    pub held_out_error_before: f64,
    /// With the effect.
    pub held_out_error: f64,
    /// Their ratio.
    pub ratio: f64,
    /// 95 % interval of the ratio over clusters.
    pub ci95: [f64; 2],
    /// Coefficients, the parameters refitted beside them.
    pub coefficients: Vec<Estimate>,
    /// Trials in which it acts; empty for all.
    pub trials: Vec<String>,
    /// Share of the held-out error of the present model there that remains with this effect and
    /// those before it, computed by all stages: what `history` will show once they are added. Null
    /// where that was not computed.
    #[serde(default)]
    pub left_of_error: Option<f64>,
}

/// An effect whose law gives NaN or infinity on these recordings, with the place where it does.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct NotTried {
    /// Identifier.
    pub effect: String,
    /// Reason, in words.
    pub because: String,
    /// True if it was tried at some starting values of its parameters and left out at others only.
    #[serde(default)]
    pub in_part: bool,
}

impl std::fmt::Display for NotTried {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let how = if self.in_part { "not tried everywhere" } else { "not tried" };
        write!(f, "`{}` was {how}, because {}", self.effect, self.because)
    }
}
