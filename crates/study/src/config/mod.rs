//! The pipeline's YAML: what a user may write, with its defaults. Every section belongs to the
//! stage of the same name, so that a changed value makes just that stage (and what follows from it)
//! stale.
//!
//! Every number has its range here, once: `aloft schema` shows it, and reading a file holds each
//! value against it ([`crate::ranges`]).

mod overrides;
mod sections;
mod subjects;
mod trials;

pub use overrides::{Override, Sections};
pub use sections::{
    Angles, CalibrateConfig, ColumnNames, CompareConfig, Correction, CorrectionsConfig, Estimator, ExportConfig,
    FilterConfig, FlightConfig, FlightSource, ForceTimes, IdentifyConfig, IkConfig, ImportConfig, InertiaLimit,
    PlateColumnsConfig, RegressorConfig, RobotConfig, Rows, ScaleConfig, StatedFlight, Switch, Vertical, Weighting,
};
pub use subjects::{GRAVITY_MPS2, HEIGHT_M, MASS_KG, SubjectConfig, SubjectExclusion, SubjectsConfig};
pub use trials::{Exclusion, StaticFrames, TrialsConfig};

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// A pipeline file.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct PipelineConfig {
    /// Name of the pipeline; also the name of its default workspace.
    pub name: String,
    /// Folder of recordings, relative to this file. `--data` replaces it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub data: Option<String>,
    /// Folder for results, relative to this file. `--workspace` replaces it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub workspace: Option<String>,
    /// Model: a name in `configs/models/`, or a path to a YAML, URDF or OpenSim 4 (`.osim`) file. A
    /// robot's is named by its description.
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub model: String,
    /// Marker set: a name in `configs/markersets/` or a path. Robots have none; an OpenSim model
    /// brings its own.
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub marker_set: String,
    /// Object description (links whose frames are defined by markers): a name in `configs/objects/`
    /// or a path. Leave out for people.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub object: Option<String>,
    /// A robot, whose motion is logged by its joints. Leave out for people and objects.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub robot: Option<RobotConfig>,
    /// Facts about the subject; what is not said here is taken from `subject.yaml`, `object.yaml`
    /// or `participants.tsv` beside the recordings.
    #[serde(default)]
    pub subject: SubjectConfig,
    /// Folders of subjects and sessions, for a study of several; found by themselves where
    /// `participants.tsv` or the folders' names tell.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub subjects: Option<SubjectsConfig>,
    /// Settings that hold for some subjects, sessions or trials only.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub overrides: Vec<Override>,
    /// Which recordings play which part.
    #[serde(default)]
    pub trials: TrialsConfig,
    /// Reading of recordings.
    #[serde(default)]
    pub import: ImportConfig,
    /// Corrections that the session check offered and you confirm.
    #[serde(default, skip_serializing_if = "CorrectionsConfig::is_empty")]
    pub corrections: CorrectionsConfig,
    /// Static trial to subject.
    #[serde(default)]
    pub scale: ScaleConfig,
    /// Refinement of geometry over the dynamic trials.
    #[serde(default)]
    pub calibrate: CalibrateConfig,
    /// Markers to joint motion.
    #[serde(default)]
    pub ik: IkConfig,
    /// Low-pass filter of joint coordinates and forces.
    #[serde(default)]
    pub filter: FilterConfig,
    /// Search for free flight.
    #[serde(default)]
    pub flight: FlightConfig,
    /// Rows and factors.
    #[serde(default)]
    pub regressor: RegressorConfig,
    /// Estimation.
    #[serde(default)]
    pub identify: IdentifyConfig,
    /// Model against measurement.
    #[serde(default)]
    pub compare: CompareConfig,
    /// Files for other programs.
    #[serde(default)]
    pub export: ExportConfig,
    /// Effects of your own, ranked beside the catalogue.
    #[serde(default)]
    pub effects: EffectsConfig,
}

/// Effects of your own: force or moment laws as formulas, ranked by `aloft discover` and added by
/// `aloft effect add` as the catalogue's are.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct EffectsConfig {
    /// Files with one effect each: paths relative to this file, or names in `configs/effects/`
    /// (`sail`, `my_drag`, `magnus`).
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub files: Vec<String>,
    /// Effects written here.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub define: Vec<aloft_effects::FormulaEffect>,
}
