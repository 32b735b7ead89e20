//! Revisions of a model: which effects it holds. Each `effect add` or `remove` writes a new one; the old stay.

use crate::error::PipelineError;
use crate::workspace::{read_json, write_json};
use aloft_effects::{Choice, Scene};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::path::Path;

/// An effect in a model.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct ModelEffect {
    /// Identifier with target, for example `tether` or `flywheel[torso]`.
    pub key: String,
    /// Values of its nonlinear parameters.
    #[serde(default)]
    pub nonlinear: BTreeMap<String, f64>,
}

impl ModelEffect {
    /// The effect bound to a scene.
    pub fn choice(&self, scene: &Scene) -> Result<Choice<'static>, PipelineError> {
        let fail = |e: aloft_effects::EffectsError| PipelineError::request(e.to_string());
        let mut choice = Choice::parse(&self.key, scene).map_err(fail)?;
        for (name, value) in &self.nonlinear {
            choice.set(scene, name, *value).map_err(fail)?;
        }
        Ok(choice)
    }
}

/// What a revision reached.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Reached {
    /// Held-out error over weak windows, N: force root mean square, with moments over a lever of 0.1 m.
    pub held_out_error: f64,
    /// What it is taken on.
    pub judged_on: String,
    /// The same in flight, N.
    pub flight_error: f64,
    /// What noise alone makes of the held-out error, N.
    pub noise_floor: Option<f64>,
    /// σ_{N−1}/σ_N.
    pub sigma_ratio: f64,
    /// Marker RMS, mean over trials, mm.
    pub marker_rms_mm: f64,
    /// Coefficients: name, value, standard error.
    pub coefficients: Vec<(String, f64, f64)>,
    /// Base parameters, to see what an effect changes.
    pub base: Vec<(String, f64)>,
}

/// One revision.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Revision {
    /// Number, from 0 (the plain model).
    pub number: usize,
    /// What made it: `start`, `add drag`, `remove drag`.
    pub action: String,
    /// Effects of the model.
    pub effects: Vec<ModelEffect>,
    /// What it reached, once it was run.
    pub reached: Option<Reached>,
}

/// All revisions of a workspace; the last is the present one.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Revisions {
    /// In order.
    pub revisions: Vec<Revision>,
}

impl Default for Revisions {
    fn default() -> Self {
        Self { revisions: vec![Revision { number: 0, action: "start".into(), effects: Vec::new(), reached: None }] }
    }
}

impl Revisions {
    /// Reads `model.json` of a workspace; the plain model where there is none.
    pub fn load(workspace: &Path) -> Result<Self, PipelineError> {
        let path = workspace.join("model.json");
        if !path.is_file() {
            return Ok(Self::default());
        }
        let all: Self = read_json(&path)?;
        if all.revisions.is_empty() { Ok(Self::default()) } else { Ok(all) }
    }

    /// Writes it, whole or not at all.
    pub fn save(&self, workspace: &Path) -> Result<(), PipelineError> {
        let new = workspace.join("model.json.new");
        write_json(&new, self)?;
        std::fs::rename(&new, workspace.join("model.json")).map_err(PipelineError::io("move", new))
    }

    /// Effects of the present revision.
    pub fn effects(&self) -> Vec<ModelEffect> {
        self.revisions.last().map(|r| r.effects.clone()).unwrap_or_default()
    }

    /// Appends a revision.
    pub fn push(&mut self, action: String, effects: Vec<ModelEffect>) {
        self.revisions.push(Revision { number: self.revisions.len(), action, effects, reached: None });
    }
}
