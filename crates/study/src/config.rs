//! The pipeline's YAML: what a user may write, with its defaults. Every section belongs to the stage of the same name,
//! so that a changed value makes just that stage (and what follows from it) stale.
//!
//! Every number has its range here, once: `aloft schema` shows it, and reading a file holds each value against it ([`crate::ranges`]).

use aloft_workspace::error::PipelineError;
use miette::{NamedSource, SourceOffset, SourceSpan};
use schemars::{JsonSchema, Schema, SchemaGenerator, json_schema};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

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
    /// Model: a name in `configs/models/` or a path to a YAML or URDF file.
    pub model: String,
    /// Marker set: a name in `configs/markersets/` or a path.
    pub marker_set: String,
    /// Object description (links whose frames are defined by markers): a name in `configs/objects/` or a path. Leave out for people.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub object: Option<String>,
    /// Facts about the subject; what is not said here is taken from `subject.yaml`, `object.yaml` or `participants.tsv` beside the recordings.
    #[serde(default)]
    pub subject: SubjectConfig,
    /// Folders of subjects and sessions, for a study of several; found by themselves where `participants.tsv` or the folders' names tell.
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

/// Effects of your own: force or moment laws as formulas, ranked by `aloft discover` and added by `aloft effect add` as the catalogue's are.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct EffectsConfig {
    /// Files with one effect each: paths relative to this file, or names in `configs/effects/` (`sail`, `my_drag`, `magnus`).
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub files: Vec<String>,
    /// Effects written here.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub define: Vec<aloft_effects::FormulaEffect>,
}

/// Stature of a person, m.
pub const HEIGHT_M: (f64, f64) = (0.3, 3.0);
/// Mass of a body, kg.
pub const MASS_KG: (f64, f64) = (0.001, 10_000.0);
/// Magnitude of gravity, m/s²: none to that of the giant planets.
pub const GRAVITY_MPS2: (f64, f64) = (0.0, 100.0);

/// Weights of single markers.
fn weights(_: &mut SchemaGenerator) -> Schema {
    json_schema!({"type": "object", "additionalProperties": {"type": "number", "minimum": 0.0, "maximum": 1000.0}})
}

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

/// Where the subjects and sessions of a study lie. Names and patterns are folders; `*` and `?` as in a shell.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct SubjectsConfig {
    /// Subject folders, relative to the data folder; an empty list stands for the rows of `participants.tsv`, or else `sub-*`.
    #[serde(default)]
    pub folders: Vec<String>,
    /// Session folders, relative to each subject's folder (`ses-*` where nothing is said). A subject without such folders is one session.
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

/// Settings for some subjects, sessions or trials. What is nearer to the trial wins: study, subject, session, trial.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Override {
    /// Name or pattern of the subject; all where not given.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub subject: Option<String>,
    /// Name or pattern of the session; all where not given.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub session: Option<String>,
    /// Name or pattern of the trial; then `set` may hold `import`, `ik` and `flight` only.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub trial: Option<String>,
    /// The settings: sections as in the pipeline, with just what differs.
    pub set: Sections,
}

impl Override {
    /// What cannot be, in words.
    pub fn check(&self) -> Result<(), String> {
        if self.trial.is_some() {
            let s = &self.set;
            let wrong = [
                ("marker_set", s.marker_set.is_some()),
                ("object", s.object.is_some()),
                ("subject", s.subject.is_some()),
                ("trials", s.trials.is_some()),
                ("scale", s.scale.is_some()),
                ("calibrate", s.calibrate.is_some()),
                ("filter", s.filter.is_some()),
                ("regressor", s.regressor.is_some()),
                ("identify", s.identify.is_some()),
                ("compare", s.compare.is_some()),
            ];
            if let Some((name, _)) = wrong.iter().find(|(_, set)| *set) {
                return Err(format!(
                    "`{name}` holds for all trials of a session and cannot differ for a single trial; \
                     expected `import`, `ik` or `flight`, or leave `trial` out"
                ));
            }
            if s.flight.as_ref().is_some_and(|f| f.margin_s != FlightConfig::default().margin_s) {
                return Err(
                    "`flight: margin_s` holds for all trials of a session and cannot differ for a single trial"
                        .to_owned(),
                );
            }
        } else if self.subject.is_none() && self.session.is_none() {
            return Err("an override names whom it is for: `subject`, `session` or `trial`".to_owned());
        }
        Ok(())
    }
}

/// The sections of a pipeline that may differ between subjects and sessions; also what a file `overrides.yaml` beside the
/// recordings of a subject or session may hold.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Sections {
    /// Marker set.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub marker_set: Option<String>,
    /// Object description.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub object: Option<String>,
    /// Facts about the subject.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub subject: Option<SubjectConfig>,
    /// Which recordings play which part.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub trials: Option<TrialsConfig>,
    /// Reading of recordings.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub import: Option<ImportConfig>,
    /// Static trial to subject.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub scale: Option<ScaleConfig>,
    /// Refinement of geometry.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub calibrate: Option<CalibrateConfig>,
    /// Markers to joint motion.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub ik: Option<IkConfig>,
    /// Low-pass filter.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub filter: Option<FilterConfig>,
    /// Search for free flight.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub flight: Option<FlightConfig>,
    /// Rows and factors.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub regressor: Option<RegressorConfig>,
    /// Estimation.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub identify: Option<IdentifyConfig>,
    /// Model against measurement.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub compare: Option<CompareConfig>,
}

/// Which recordings play which part. Patterns are relative to the data folder; a recording plays the first part that matches it.
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
    /// Groups of recordings that differ in what the body carried: `{unloaded: ["*_plain*"], vest: ["*_vest*"]}`. A payload is sought as the
    /// difference to the group of the first recording; without groups, it is sought in the recordings themselves.
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

fn strings(list: &[&str]) -> Vec<String> {
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

macro_rules! section {
    ($(#[$meta:meta])* $name:ident { $($(#[$field_meta:meta])* $field:ident : $type:ty = $default:expr,)* }) => {
        $(#[$meta])*
        #[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
        #[serde(deny_unknown_fields, default)]
        pub struct $name { $($(#[$field_meta])* pub $field: $type,)* }
        impl Default for $name {
            fn default() -> Self { Self { $($field: $default,)* } }
        }
    };
}

/// Vertical axis of a recording.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Vertical {
    /// Decide from the file, the plates and the markers.
    Auto,
    /// X up.
    X,
    /// Y up.
    Y,
    /// Z up.
    Z,
}

section! {
/// Reading of recordings.
ImportConfig {
    /// Vertical axis of the recordings.
    up_axis: Vertical = Vertical::Auto,
    /// Strip `Subject:` from labels.
    strip_prefix: bool = true,
    /// Labels of this laboratory and the marker of the set that each means.
    aliases: BTreeMap<String, String> = BTreeMap::new(),
    /// Gaps up to this length are filled, s.
    #[schemars(range(min = 0.0, max = 10.0))]
    fill_gaps_s: f64 = 0.1,
    /// Fill gaps of a marker from its segment's other markers, up to this length, s.
    #[schemars(range(min = 0.0, max = 60.0))]
    rigid_fill_s: f64 = 0.25,
    /// A file that holds less than this fraction of the frames that it states is taken for a broken copy.
    #[schemars(range(min = 0.0, max = 1.0))]
    least_fraction: f64 = 0.5,
    /// Repair spikes and label swaps (they are reported in any case).
    repair: bool = false,
}}

section! {
/// Static trial to subject.
ScaleConfig {
    /// Anthropometric table: a name in `configs/anthropometry/` (`de_leva`, `dumas`, `winter`) or a path.
    anthropometry: String = "de_leva".to_owned(),
    /// Regression of the hip joint centre: `harrington`, `bell`, `hara`, `davis`.
    hip: String = "harrington".to_owned(),
}}

section! {
/// Refinement of geometry over the dynamic trials.
CalibrateConfig {
    /// Whether to refine: `auto` keeps it only when held-out marker error falls.
    enabled: Switch = Switch::Auto,
    /// Number of frames used, over all trials.
    #[schemars(range(min = 10, max = 100_000))]
    frames: usize = 300,
    /// Whether recordings held out for comparison (`trials: validate`) take part as well. By default they do not: held out means held out.
    validation: bool = false,
}}

/// On, off, or decided from held-out data.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Switch {
    /// Decided from held-out data.
    Auto,
    /// Always.
    On,
    /// Never.
    Off,
}

section! {
/// Markers to joint motion.
IkConfig {
    /// Weights of single markers, replacing those of the marker set.
    #[schemars(schema_with = "weights")]
    weights: BTreeMap<String, f64> = BTreeMap::new(),
    /// Standard deviation of a marker about its place on the link, m.
    #[schemars(range(min = 1e-5, max = 0.1))]
    marker_sd_m: f64 = 0.002,
}}

section! {
/// Low-pass filter of joint coordinates and forces.
FilterConfig {
    /// Order of one pass; two passes double the effective order.
    #[schemars(range(min = 1, max = aloft_signal::butterworth::MAX_ORDER))]
    order: usize = 3,
    /// Stated cut-off, Hz.
    #[schemars(range(min = 0.1, max = 1000.0))]
    cutoff_hz: f64 = 10.0,
    /// `none` designs each pass at the stated cut-off; `winter` moves it so that both passes together are −3 dB there.
    cutoff_correction: Correction = Correction::None,
}}

/// Correction of the cut-off for two passes.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Correction {
    /// None.
    None,
    /// Winter's.
    Winter,
}

/// How flights are found.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum FlightSource {
    /// Plates where there are any and motion agrees; motion otherwise.
    Auto,
    /// Plates alone.
    Plates,
    /// Motion alone.
    Motion,
}

section! {
/// Search for free flight.
FlightConfig {
    /// How flights are found.
    source: FlightSource = FlightSource::Auto,
    /// Force below which a plate counts as unloaded, N.
    #[schemars(range(min = 0.01, max = 10_000.0))]
    threshold_n: f64 = 20.0,
    /// Shortest flight, s.
    #[schemars(range(min = 0.01, max = 3600.0))]
    min_duration_s: f64 = 0.12,
    /// Frames to leave out at both ends of each flight for the paper's rows (filter edges), s.
    #[schemars(range(min = 0.0, max = 10.0))]
    margin_s: f64 = 0.07,
}}

/// Rows that the identification uses.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Rows {
    /// Acceleration rows as in the paper.
    #[serde(alias = "paper")]
    Acceleration,
    /// Weak momentum rows.
    Weak,
}

impl Rows {
    /// Both kinds, in the order of the tables.
    pub const ALL: [Self; 2] = [Self::Weak, Self::Acceleration];
    /// The word that users type.
    pub fn word(self) -> &'static str {
        match self {
            Self::Acceleration => "acceleration",
            Self::Weak => "weak",
        }
    }
}

/// Weights of weak rows.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Weighting {
    /// Fixed weights that depend on nothing but the prior.
    Fixed,
    /// By the inverse of the rows' covariance, propagated from the markers' noise. `discover` weights its own rows by fixed weights in any case.
    Whitened,
}

section! {
/// Rows and factors.
RegressorConfig {
    /// Rows that the results are built on; the other kind is computed beside them.
    rows: Rows = Rows::Weak,
    /// Length of a weak window, s; 0 lets the length of each stretch decide. `aloft parameters --assess` shows what other lengths give.
    #[schemars(range(min = 0.0, max = 60.0))]
    window_s: f64 = 0.0,
    /// Weights of weak rows.
    weighting: Weighting = Weighting::Fixed,
    /// Size of errors that fade within a tenth of a second (soft tissue) in units of the markers' white noise; for `whitened`.
    #[schemars(range(min = 0.0, max = 1000.0))]
    slow_noise: f64 = 5.0,
}}

/// Estimator of the base parameters.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Estimator {
    /// Regularised where the rows alone do not see every parameter; mass-constrained otherwise.
    Auto,
    /// Right singular vector of the smallest singular value (the paper).
    NullVector,
    /// Least squares with the body mass known.
    MassConstrained,
    /// Least squares with the body mass known and the anthropometric prior.
    Regularized,
}

section! {
/// Estimation.
IdentifyConfig {
    /// Estimator.
    estimator: Estimator = Estimator::Auto,
    /// Weight of the prior; 0 lets held-out error decide.
    #[schemars(range(min = 0.0, max = 1e6))]
    prior_weight: f64 = 0.0,
    /// Whether plate-measured contact stretches of the identification trials take part.
    contact: bool = false,
    /// Bootstrap resamples over flights. Intervals do not use them: they come from the spread among flights with Student's t.
    #[schemars(range(min = 0, max = 100_000))]
    bootstrap: usize = 0,
    /// Correlation of errors from flight to flight, 0 to 1, as a further allowance for what repeats; none where not given. Soft tissue of
    /// people is allowed for in any case, as a random effect of the size that the marker residuals show.
    #[schemars(range(min = 0.0, max = 1.0))]
    #[serde(alias = "repeat_correlation")]
    flight_error_correlation: Option<f64> = None,
}}

section! {
/// Model against measurement.
CompareConfig {
    /// Time left out on both sides of each change between flight and contact, s.
    #[schemars(range(min = 0.0, max = 10.0))]
    edge_s: f64 = 0.05,
    /// Length of the windows of the weak comparison, s.
    #[schemars(range(min = 0.02, max = 60.0))]
    window_s: f64 = 0.3,
}}

/// Joint angles of exported files.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Angles {
    /// Names and axes of OpenSim's full-body models.
    Model,
    /// Recommendations of the International Society of Biomechanics (Wu et al. 2002, 2005).
    Isb,
}

section! {
/// Files for other programs.
ExportConfig {
    /// Joint angles: `model` (names and axes of OpenSim's full-body models) or `isb` (shoulder Y-X-Y, wrist Z-X-Y).
    angles: Angles = Angles::Model,
}}

/// Parses YAML with errors that point at the place. A number that is none (NaN, infinite) is refused wherever it stands.
pub fn parse_yaml<T: serde::de::DeserializeOwned>(file: &str, text: &str) -> Result<T, PipelineError> {
    let value = serde_yaml::from_str(text).map_err(|error| not_yaml(file, text, &error))?;
    crate::ranges::finite(file, text)?;
    Ok(value)
}

/// What the parser says, with its place.
pub(crate) fn not_yaml(file: &str, text: &str, error: &serde_yaml::Error) -> PipelineError {
    {
        let at = error.location().map(|l| {
            SourceSpan::new(SourceOffset::from_location(text, l.line(), l.column()), token_length(text, l.index()))
        });
        let full = error.to_string();
        let problem = match full.rfind(" at line ") {
            Some(cut) => full[..cut].to_owned(),
            None => full,
        };
        let problem = match error.location() {
            Some(l) => format!("line {}: {problem}", l.line()),
            None => problem,
        };
        PipelineError::Config {
            file: file.to_owned(),
            problem,
            text: NamedSource::new(file, text.to_owned()),
            at,
            hint: None,
        }
    }
}

fn token_length(text: &str, index: usize) -> usize {
    text.get(index..).map_or(0, |rest| rest.find([' ', ':', '\n']).unwrap_or(rest.len())).max(1)
}

/// A configuration error that points at the first line on which `key:` stands.
pub fn error_at_key(
    file: &str,
    text: &str,
    key: &str,
    problem: impl Into<String>,
    hint: Option<String>,
) -> PipelineError {
    let mut offset = 0;
    let mut at = None;
    for line in text.split_inclusive('\n') {
        let trimmed = line.trim_start();
        if trimmed.starts_with(key) && trimmed[key.len()..].trim_start().starts_with(':') {
            let start = offset + line.len() - trimmed.len();
            at = Some(SourceSpan::new(SourceOffset::from(start), trimmed.trim_end().len()));
            break;
        }
        offset += line.len();
    }
    PipelineError::Config {
        file: file.to_owned(),
        problem: problem.into(),
        text: NamedSource::new(file, text.to_owned()),
        at,
        hint,
    }
}

/// A configuration error that points at an item of the list under `key:` (at the key where items do not begin lines of their own).
pub fn error_at_item(
    file: &str,
    text: &str,
    key: &str,
    item: usize,
    problem: impl Into<String>,
    hint: Option<String>,
) -> PipelineError {
    let mut offset = 0;
    // where each line's words begin in the text, how far they are indented, and the words
    let mut lines = text.split_inclusive('\n').map(|line| {
        let indent = line.len() - line.trim_start().len();
        offset += line.len();
        (offset - line.len() + indent, indent, line.trim())
    });
    let below = lines.by_ref().find(|(_, _, l)| l.starts_with(&format!("{key}:")));
    let list: Vec<(usize, usize, &str)> =
        lines.take_while(|(_, indent, l)| *indent > 0 || l.is_empty() || l.starts_with(['-', '#'])).collect();
    let own = list.iter().find(|(_, _, l)| l.starts_with("- ")).map_or(0, |(_, indent, _)| *indent);
    let mut items = list.iter().filter(|(_, indent, l)| *indent == own && l.starts_with("- "));
    match below.and_then(|_| items.nth(item)) {
        Some((begin, _, line)) => {
            let number = text[..*begin].matches('\n').count() + 1;
            PipelineError::Config {
                file: file.to_owned(),
                problem: format!("line {number}: {}", problem.into()),
                text: NamedSource::new(file, text.to_owned()),
                at: Some(SourceSpan::new(SourceOffset::from(*begin), line.len())),
                hint,
            }
        }
        None => error_at_key(file, text, key, problem, hint),
    }
}
