//! Facts about the subject, and where the subjects and sessions of a study lie.

use super::trials::strings;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Stature of a person, m.
pub const HEIGHT_M: (f64, f64) = (0.3, 3.0);
/// Mass of a body, kg.
pub const MASS_KG: (f64, f64) = (0.001, 10_000.0);
/// Magnitude of gravity, m/s²: none to that of the giant planets.
pub const GRAVITY_MPS2: (f64, f64) = (0.0, 100.0);

/// Facts about the subject.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct SubjectConfig {
    /// Identifier.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub name: Option<String>,
    /// `F` or `M`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub sex: Option<String>,
    /// Stature, m.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schemars(range(min = HEIGHT_M.0, max = HEIGHT_M.1))]
    pub height_m: Option<f64>,
    /// Mass from a scale, kg.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schemars(range(min = MASS_KG.0, max = MASS_KG.1))]
    pub mass_kg: Option<f64>,
    /// Magnitude of gravity at the laboratory, m/s² (9.80665 where nothing else is known).
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schemars(range(min = GRAVITY_MPS2.0, max = GRAVITY_MPS2.1))]
    pub gravity_mps2: Option<f64>,
}

/// Where the subjects and sessions of a study lie. Names and patterns are folders; `*` and `?` as
/// in a shell.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct SubjectsConfig {
    /// Subject folders, relative to the data folder; an empty list stands for the rows of
    /// `participants.tsv`, or else `sub-*`.
    #[serde(default)]
    pub folders: Vec<String>,
    /// Session folders, relative to each subject's folder (`ses-*` where nothing is said). A
    /// subject without such folders is one session.
    #[serde(default = "default_sessions")]
    pub sessions: Vec<String>,
    /// Subjects or sessions to leave out, with the reason.
    #[serde(default)]
    pub exclude: Vec<SubjectExclusion>,
}

fn default_sessions() -> Vec<String> {
    strings(&["ses-*"])
}

/// A subject, or one session of it, that is left out.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct SubjectExclusion {
    /// Name or pattern of the subject.
    pub subject: String,
    /// Name or pattern of the session; all sessions where not given.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub session: Option<String>,
    /// Why, for the tables.
    pub reason: String,
}
