//! Revisions of a model: the effects that it holds. Each `effect add` or `remove` writes a new one;
//! earlier ones are kept.

use crate::config::CorrectionsConfig;
use aloft_regressor::limits;
use aloft_workspace::error::PipelineError;
use aloft_workspace::seal;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::path::Path;

/// An effect in a model.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct ModelEffect {
    /// Identifier with target, for example `tether` or `flywheel[torso]`.
    pub key: String,
    /// Values of its nonlinear parameters.
    #[serde(default)]
    pub nonlinear: BTreeMap<String, f64>,
    /// Trials in which it acts (for example, a payload carried in some of them); all if empty.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub trials: Vec<String>,
    /// How much the interval of each coefficient grows because the nonlinear parameters were fitted
    /// to the same recordings, and by errors that are the same in all of them.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub widening: BTreeMap<String, f64>,
    /// Centre and extent of the region that its columns refer to, m, if the discovery that found it
    /// used one.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub volume_m: Option<([f64; 3], f64)>,
    /// True if its size is from flights and contact together: contact then takes part in
    /// identification, unless the pipeline states otherwise.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub sized_with_contact: bool,
}

impl ModelEffect {
    /// The effect's identifier, without its target.
    pub fn id(&self) -> &str {
        self.key.split('[').next().unwrap_or(&self.key)
    }

    /// True for a law of a joint, which exerts nothing on the body as a whole.
    pub fn is_of_joints(&self) -> bool {
        // none: a law of the user's own acts on the body
        aloft_effects::effect(self.id()).is_ok_and(|e| e.acts().in_joints())
    }
}

/// Results of a revision.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Reached {
    /// Hash of the comparison that these results are from.
    #[serde(default)]
    pub from: String,
    /// Hash of the settings and recordings that it was made from, without the effects. Errors of
    /// revisions with different hashes cannot be compared.
    #[serde(default)]
    pub made_with: String,
    /// In flight: held-out error over weak windows, N (root mean square force, with moments over a
    /// lever arm of 0.1 m), and the noise floor. None without flights.
    #[serde(default)]
    pub flight: Option<Judged>,
    /// The same in held-out contact.
    #[serde(default)]
    pub contact: Option<Judged>,
    /// σ_{N−1}/σ_N.
    pub sigma_ratio: f64,
    /// Marker RMS, mean over trials, mm.
    pub marker_rms_mm: f64,
    /// Coefficients with their intervals.
    pub coefficients: Vec<ReachedCoefficient>,
    /// Base parameters, to see what an effect changes.
    pub base: Vec<(String, f64)>,
    /// Trials whose windows are in the errors, sorted; none in models written before they were
    /// stored.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub trials: Option<Vec<String>>,
    /// A robot's joints, where laws of joints were added or removed; empty otherwise.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub joints: Vec<JointReached>,
}

/// What the torque rows of one joint leave in flights that were left out.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct JointReached {
    /// Name of the joint.
    pub joint: String,
    /// Unit of the errors: N·m, or N for a slide.
    pub unit: String,
    /// Held-out error.
    pub held_out_error: f64,
    /// What a perfect model would leave; none if it is not known.
    pub noise_floor: Option<f64>,
    /// Its 95 % interval.
    pub noise_floor_ci95: Option<[f64; 2]>,
}

impl JointReached {
    /// Held-out error divided by the floor.
    pub fn times_floor(&self) -> Option<f64> {
        self.noise_floor.filter(|f| *f > 0.0).map(|f| self.held_out_error / f)
    }
}

/// A coefficient of an effect, as identified.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(from = "StoredCoefficient")]
pub struct ReachedCoefficient {
    /// Name.
    pub name: String,
    /// Value.
    pub value: f64,
    /// Standard error.
    pub se: f64,
    /// 95 % interval; none if the standard error is not known, and in models written before
    /// intervals were stored.
    pub ci95: Option<[f64; 2]>,
    /// Unit; empty in models written before units were stored.
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub unit: String,
    /// The range that physics allows, in words, where the value is outside; none where it is
    /// inside.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub range: Option<String>,
}

/// Formats of a stored coefficient: earlier models stored name, value and standard error.
#[derive(Deserialize)]
#[serde(untagged)]
enum StoredCoefficient {
    Whole {
        name: String,
        value: Option<f64>,
        se: Option<f64>,
        ci95: Option<[Option<f64>; 2]>,
        #[serde(default)]
        unit: String,
        #[serde(default)]
        range: Option<String>,
    },
    Earlier(String, Option<f64>, Option<f64>),
}

impl From<StoredCoefficient> for ReachedCoefficient {
    fn from(stored: StoredCoefficient) -> Self {
        let (name, value, se, ci95, unit, range) = match stored {
            StoredCoefficient::Whole { name, value, se, ci95, unit, range } => (name, value, se, ci95, unit, range),
            StoredCoefficient::Earlier(name, value, se) => (name, value, se, None, String::new(), None),
        };
        let or_nan = |x: Option<f64>| x.unwrap_or(f64::NAN);
        let ([value, se], ci95) = ([value, se].map(or_nan), ci95.map(|ends| ends.map(or_nan)));
        Self { name, value, se, ci95, unit, range }
    }
}

/// A held-out error over weak windows, and the noise floor: the error that a perfect model would
/// leave.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Judged {
    /// Error, N.
    pub error_n: f64,
    /// Noise floor, N; none if it is not known.
    pub noise_n: Option<f64>,
    /// 95 % interval of the noise floor, N: the range in which the error of a perfect model falls.
    #[serde(default)]
    pub noise_ci95: Option<[f64; 2]>,
    /// The force alone, N; none in models written before it was stored, as the next three.
    #[serde(default)]
    pub force_n: Option<f64>,
    /// The moment alone, N·m.
    #[serde(default)]
    pub moment_nm: Option<f64>,
    /// Number of windows.
    #[serde(default)]
    pub windows: usize,
    /// Whether the identified parameters passed their gate.
    #[serde(default)]
    pub gate_passed: Option<bool>,
}

impl Judged {
    /// Error divided by the noise floor.
    pub fn times_floor(&self) -> Option<f64> {
        limits::times_floor(self.error_n, self.noise_n?, self.noise_ci95)
    }
    /// True if a perfect model could have left an error this large.
    pub fn at_floor(&self) -> Option<bool> {
        limits::at_floor(self.error_n, self.noise_n?, self.noise_ci95)
    }
    /// Share of the mean square error that noise does not explain.
    pub fn explainable(&self) -> Option<f64> {
        let noise = self.noise_n?;
        (self.error_n > 0.0).then(|| (1.0 - (noise / self.error_n).powi(2)).max(0.0))
    }
}

/// One revision.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Revision {
    /// Number, from 0 (the model without effects).
    pub number: usize,
    /// Action that made it: `start`, `add drag`, `remove drag`.
    pub action: String,
    /// Effects of the model.
    pub effects: Vec<ModelEffect>,
    /// What it reached, once it has been run.
    pub reached: Option<Reached>,
    /// Corrections of the recordings under which it was made.
    #[serde(default, skip_serializing_if = "CorrectionsConfig::is_empty")]
    pub corrections: CorrectionsConfig,
    /// What explained the recordings as well as an effect of the model when it was added, by the
    /// key of that effect.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub confusable: BTreeMap<String, Vec<String>>,
    /// Why the discovery that was there when an effect was added had not named it, by the key of
    /// that effect.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub doubted: BTreeMap<String, String>,
}

/// All revisions of a workspace; the last is the present one.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Revisions {
    /// In order.
    pub revisions: Vec<Revision>,
    /// The revision that `effect add` or `effect remove` is making; it takes effect once its
    /// results exist. If it is present while nobody holds the workspace, the change was
    /// interrupted.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub pending: Option<Revision>,
}

impl Default for Revisions {
    fn default() -> Self {
        let first = Revision {
            number: 0,
            action: "start".into(),
            effects: Vec::new(),
            reached: None,
            corrections: CorrectionsConfig::default(),
            confusable: BTreeMap::new(),
            doubted: BTreeMap::new(),
        };
        Self { revisions: vec![first], pending: None }
    }
}

impl Revisions {
    /// Reads `model.json` of a workspace; returns the model without effects if there is none.
    pub fn load(workspace: &Path) -> Result<Self, PipelineError> {
        let path = workspace.join("model.json");
        let read = seal::read_if_there::<Self>(&path).map_err(|e| match e {
            PipelineError::Damaged { path, problem } => PipelineError::request_hint(
                format!("{} is damaged: {problem}", path.display()),
                "put back a copy of it; without the file the model has no effects, and its effects can be added again",
            ),
            other => other,
        });
        let Some(all) = read? else { return Ok(Self::default()) };
        if all.revisions.is_empty() { Ok(Self::default()) } else { Ok(all) }
    }

    /// Writes `model.json`, completely or not at all.
    pub fn save(&self, workspace: &Path) -> Result<(), PipelineError> {
        seal::write_whole(&workspace.join("model.json"), self)
    }

    /// Effects of the present revision.
    pub fn effects(&self) -> Vec<ModelEffect> {
        self.revisions.last().map(|r| r.effects.clone()).unwrap_or_default()
    }

    /// The effect of that key or identifier as the latest revision that has one holds it.
    pub fn held_last(&self, key: &str) -> Option<(usize, ModelEffect)> {
        let in_one = |r: &Revision| Some((r.number, r.effects.iter().find(|e| e.key == key || e.id() == key)?.clone()));
        self.revisions.iter().rev().find_map(in_one)
    }

    /// Base parameters of the model without effects, from which columns of effects take the body's
    /// centre of mass; empty before it was identified.
    pub fn plain_base(&self) -> Vec<f64> {
        let reached = self.revisions.first().and_then(|r| r.reached.as_ref());
        reached.map(|r| r.base.iter().map(|b| b.1).collect()).unwrap_or_default()
    }

    /// The next revision.
    pub fn next(&self, action: String, effects: Vec<ModelEffect>) -> Revision {
        let last = self.revisions.last();
        let corrections = last.map(|r| r.corrections.clone()).unwrap_or_default();
        let mut confusable = last.map(|r| r.confusable.clone()).unwrap_or_default();
        confusable.retain(|key, _| effects.iter().any(|e| e.key == *key));
        let mut doubted = last.map(|r| r.doubted.clone()).unwrap_or_default();
        doubted.retain(|key, _| effects.iter().any(|e| e.key == *key));
        Revision { number: self.revisions.len(), action, effects, reached: None, corrections, confusable, doubted }
    }
}
