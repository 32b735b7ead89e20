//! What a discovery says of the torques of joints.

use crate::result::{Estimate, Found, Verdict, nullable, nullable_all};
use serde::{Deserialize, Serialize};

/// Result for all joints.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct JointDiscovery {
    /// Verdict over all joints: `unexplained` if one is, else `supported` or `one_of` if something
    /// was found.
    pub verdict: Verdict,
    /// The result in words.
    pub words: String,
    /// False where the rows of the body are not in order yet, so that only the errors are stated.
    pub judged: bool,
    /// A ratio below this is accepted.
    #[serde(deserialize_with = "nullable")]
    pub threshold: f64,
    /// Quantiles 1, 5, 50 % of the best ratio over all joints and laws under flipped signs.
    #[serde(deserialize_with = "nullable_all")]
    pub null_quantiles: [f64; 3],
    /// Number of flights or recordings that count as evidence.
    pub clusters: usize,
    /// The joints, in the model's order.
    pub joints: Vec<JointFinding>,
    /// Laws to add, in order.
    pub found: Vec<Found>,
}

impl JointDiscovery {
    /// The verdict in a few words: `supported: stribeck[l_knee]`, `nothing missing`, `unexplained:
    /// l_knee` …
    pub fn short(&self) -> String {
        if !self.judged {
            return "not judged".to_owned();
        }
        let mut parts: Vec<String> = Vec::new();
        for j in &self.joints {
            let keys: Vec<String> = j.effects.iter().map(|e| format!("{e}[{}]", j.joint)).collect();
            match j.verdict {
                Verdict::Supported => parts.push(keys.join(" and ")),
                Verdict::OneOf => parts.push(format!("one of {{{}}}", keys.join(", "))),
                Verdict::Unexplained => parts.push(format!("{} unexplained", j.joint)),
                Verdict::NothingMissing | Verdict::NotDetectable => {}
            }
        }
        match (parts.is_empty(), self.verdict) {
            (false, _) => parts.join(", "),
            (true, Verdict::NotDetectable) => "not detectable".to_owned(),
            (true, _) => "nothing missing".to_owned(),
        }
    }
}

/// One joint.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct JointFinding {
    /// Name of the joint.
    pub joint: String,
    /// Verdict.
    pub verdict: Verdict,
    /// Reason, in words.
    pub words: String,
    /// Unit of the errors: N·m, or N for a slide.
    pub unit: String,
    /// Root mean square that rows of flights left out keep, with the laws of the present model.
    #[serde(deserialize_with = "nullable")]
    pub held_out_error: f64,
    /// The same with the laws found.
    #[serde(deserialize_with = "nullable")]
    pub held_out_error_after: f64,
    /// What a perfect model would leave.
    #[serde(deserialize_with = "nullable")]
    pub noise_floor: f64,
    /// 95 % interval of the floor.
    pub noise_floor_ci95: Option<[f64; 2]>,
    /// Laws named by the verdict, the one with the fewest unknowns first.
    pub effects: Vec<String>,
    /// All laws tried on the present model, best first.
    pub candidates: Vec<JointCandidate>,
}

impl JointFinding {
    /// Held-out error divided by the floor.
    pub fn times_floor(&self) -> f64 {
        self.held_out_error / self.noise_floor
    }
}

/// One law on one joint.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct JointCandidate {
    /// Identifier of the effect.
    pub effect: String,
    /// Key with the joint, as accepted by `effect add`.
    pub key: String,
    /// Held-out error with the law divided by that without it.
    #[serde(deserialize_with = "nullable")]
    pub held_out_ratio: f64,
    /// 95 % interval of the ratio.
    #[serde(deserialize_with = "nullable_all")]
    pub ci95: [f64; 2],
    /// Coefficients.
    pub coefficients: Vec<Estimate>,
    /// Nonlinear parameters.
    pub nonlinear: Vec<Estimate>,
    /// True if it passes every test except the comparison with others.
    pub believed: bool,
}
