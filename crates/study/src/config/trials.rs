//! Which recordings play which part.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// Which recordings play which part. Patterns are relative to the data folder; a recording plays
/// the first part that matches it.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct TrialsConfig {
    /// Standing still, all markers visible.
    #[serde(default = "default_static")]
    pub r#static: Vec<String>,
    /// Functional calibration (a hinge swung by hand).
    #[serde(default = "default_calibration")]
    pub calibration: Vec<String>,
    /// Held out for comparison: never used to identify.
    #[serde(default = "default_validate")]
    pub validate: Vec<String>,
    /// Motion to identify from.
    #[serde(default = "default_identify")]
    pub identify: Vec<String>,
    /// Force files beside TRC files; `{trial}` stands for the marker file's stem.
    #[serde(default = "default_forces")]
    pub forces: Vec<String>,
    /// Recordings to leave out, with the reason.
    #[serde(default)]
    pub exclude: Vec<Exclusion>,
    /// Groups of recordings that differ in what the body carried: `{unloaded: ["*_plain*"], vest:
    /// ["*_vest*"]}`. A payload is sought as the difference to the group of the first recording;
    /// without groups, it is sought in the recordings themselves.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub groups: BTreeMap<String, Vec<String>>,
    /// Frames of a dynamic trial that serve as static trial: `{trial: jump01, first: 1, last: 60}`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub static_frames: Option<StaticFrames>,
}

impl Default for TrialsConfig {
    fn default() -> Self {
        Self {
            r#static: default_static(),
            calibration: default_calibration(),
            validate: default_validate(),
            identify: default_identify(),
            forces: default_forces(),
            exclude: Vec::new(),
            groups: BTreeMap::new(),
            static_frames: None,
        }
    }
}

/// A list of strings, for defaults.
pub(super) fn strings(list: &[&str]) -> Vec<String> {
    list.iter().map(|s| (*s).to_owned()).collect()
}

fn default_static() -> Vec<String> {
    strings(&["**/*[sS]tatic*.c3d", "**/*[sS]tatic*.trc", "**/*[sS]tatic*_motion.tsv"])
}
fn default_calibration() -> Vec<String> {
    strings(&["**/*calib*.c3d"])
}
fn default_validate() -> Vec<String> {
    strings(&["**/*exercise*.c3d", "**/squat*.trc", "**/*exercise*_motion.tsv"])
}
fn default_identify() -> Vec<String> {
    strings(&["**/*.c3d", "**/*.trc", "**/*_motion.tsv"])
}
fn default_forces() -> Vec<String> {
    strings(&["{trial}.mot", "{trial}_grf.mot", "../forces/{trial}_grf.mot", "../forces/{trial}.mot"])
}

/// A recording that is left out.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Exclusion {
    /// Name or pattern of the trial.
    pub trial: String,
    /// Why, for the tables.
    pub reason: String,
}

/// Frames of a dynamic trial that serve as static trial.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct StaticFrames {
    /// Name of the trial.
    pub trial: String,
    /// First frame, counted from 1.
    #[schemars(range(min = 1, max = 1_000_000_000))]
    pub first: usize,
    /// Last frame, counted from 1.
    #[schemars(range(min = 1, max = 1_000_000_000))]
    pub last: usize,
}
