//! The settings of the stages: one section each, with ranges and defaults.

use super::MASS_KG;
use aloft_trial::{ImportOptions, PlateNames, UpAxis};
use schemars::{JsonSchema, Schema, SchemaGenerator, json_schema};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// Weights of single markers.
fn weights(_: &mut SchemaGenerator) -> Schema {
    json_schema!({"type": "object", "additionalProperties": {"type": "number", "minimum": 0.0, "maximum": 1000.0}})
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

/// Reading of an unloaded plate.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct PlateZeroConfig {
    /// Force, N, world axes.
    #[schemars(inner(range(min = -2000.0, max = 2000.0)))]
    pub force_n: [f64; 3],
    /// Moment about the world origin, N·m.
    #[schemars(inner(range(min = -2000.0, max = 2000.0)))]
    pub moment_nm: [f64; 3],
}

section! {
/// Corrections of a session's recordings and facts, as `aloft check` offers them after a run. Each
/// is a rung of the ladder.
CorrectionsConfig {
    /// Delay of the plates against the cameras, s; positive where plates are late.
    #[schemars(range(min = -0.2, max = 0.2))]
    plate_delay_s: f64 = 0.0,
    /// What each plate reads with nothing on it, by name.
    #[serde(skip_serializing_if = "BTreeMap::is_empty")]
    plate_zero: BTreeMap<String, PlateZeroConfig> = BTreeMap::new(),
    /// Direction of free fall against the recording's vertical, degrees about x and y of the world.
    #[schemars(inner(range(min = -45.0, max = 45.0)))]
    vertical_deg: [f64; 2] = [0.0; 2],
    /// True rate over stated rate, of cameras and plates together.
    #[schemars(range(min = 0.5, max = 2.0))]
    rate_ratio: f64 = 1.0,
    /// Body mass instead of the stated one, kg.
    #[schemars(range(min = MASS_KG.0, max = MASS_KG.1))]
    #[serde(skip_serializing_if = "Option::is_none")]
    mass_kg: Option<f64> = None,
}
}

impl CorrectionsConfig {
    /// True if nothing is corrected.
    pub fn is_empty(&self) -> bool {
        *self == Self::default()
    }
    /// Keys that correct something.
    pub fn keys(&self) -> Vec<&'static str> {
        let none = Self::default();
        [
            ("plate_delay_s", self.plate_delay_s != none.plate_delay_s),
            ("plate_zero", self.plate_zero != none.plate_zero),
            ("vertical_deg", self.vertical_deg != none.vertical_deg),
            ("rate_ratio", self.rate_ratio != none.rate_ratio),
            ("mass_kg", self.mass_kg != none.mass_kg),
        ]
        .into_iter()
        .filter(|k| k.1)
        .map(|k| k.0)
        .collect()
    }
    /// True if what is corrected changes flights, not plates alone.
    pub fn act_in_flight(&self) -> bool {
        self.keys().iter().any(|k| !k.starts_with("plate_"))
    }
    /// The part that is applied to recordings.
    pub fn of_recordings(&self) -> aloft_trial::Corrections {
        let zero = |z: &PlateZeroConfig| aloft_trial::PlateZero { force_n: z.force_n, moment_nm: z.moment_nm };
        aloft_trial::Corrections {
            plate_delay_s: self.plate_delay_s,
            plate_zero: self.plate_zero.iter().map(|(name, z)| (name.clone(), zero(z))).collect(),
            vertical_deg: self.vertical_deg,
            rate_ratio: self.rate_ratio,
        }
    }
    /// Corrections with which recordings were imported, and the corrected mass.
    pub fn made(recordings: Option<&aloft_trial::Corrections>, mass_kg: Option<f64>) -> Self {
        let Some(r) = recordings else { return Self { mass_kg, ..Self::default() } };
        let zero = |z: &aloft_trial::PlateZero| PlateZeroConfig { force_n: z.force_n, moment_nm: z.moment_nm };
        Self {
            plate_delay_s: r.plate_delay_s,
            plate_zero: r.plate_zero.iter().map(|(name, z)| (name.clone(), zero(z))).collect(),
            vertical_deg: r.vertical_deg,
            rate_ratio: if r.rate_ratio > 0.0 { r.rate_ratio } else { 1.0 },
            mass_kg,
        }
    }
}

/// Names of three columns of a force file.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(untagged)]
pub enum ColumnNames {
    /// What stands before `x`, `y` and `z` in their names: `ground_force1_v`.
    Before(String),
    /// The names for x, y and z; `null` for a component that is zero.
    Each([Option<String>; 3]),
}

/// Columns of a force file that belong to one plate.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct PlateColumnsConfig {
    /// Force on the subject, N.
    pub force: ColumnNames,
    /// Point of application, m; the origin if absent.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub point: Option<ColumnNames>,
    /// Moment about that point, N·m; none if absent.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub moment: Option<ColumnNames>,
}

/// What the times of a force file count.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum ForceTimes {
    /// The same clock as the times of the markers.
    #[default]
    AsStated,
    /// A clock of their own: the first row belongs to the first frame.
    FromFirstFrame,
}

section! {
/// Reading of recordings.
ImportConfig {
    /// Vertical axis of the recordings.
    up_axis: Vertical = Vertical::Auto,
    /// Length unit of recordings that state none or a wrong one: `mm`, `cm`, `dm`, `m`, `in`, `ft`.
    #[serde(skip_serializing_if = "Option::is_none")]
    point_unit: Option<String> = None,
    /// Rate of the markers, Hz, where files state none or a wrong one; plates of a C3D file keep
    /// their samples a frame.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(range(min = 0.001, max = 1000000.0))]
    rate_hz: Option<f64> = None,
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
    /// A file with less than this fraction of its declared frames is rejected as truncated.
    #[schemars(range(min = 0.0, max = 1.0))]
    least_fraction: f64 = 0.5,
    /// Repair spikes and label swaps (they are reported in any case).
    repair: bool = false,
    /// Person whose markers are used where a recording holds several people: the name before the
    /// labels (`Anna:LASI`) or in SUBJECTS of a C3D file. If absent, the subject's name.
    #[serde(skip_serializing_if = "Option::is_none")]
    person: Option<String> = None,
    /// Plates and the columns of each in the force files beside TRC files, where the names of the
    /// columns do not tell: `{FP1: {force: ground_force1_v, point: ground_force1_p, moment:
    /// ground_torque1_}}`. Columns that are not named here are not used.
    #[serde(skip_serializing_if = "BTreeMap::is_empty")]
    forces: BTreeMap<String, PlateColumnsConfig> = BTreeMap::new(),
    /// What the times of force files count: `as_stated` (the same clock as those of the markers) or
    /// `from_first_frame` (a clock of their own; both files start together).
    #[serde(skip_serializing_if = "is_as_stated")]
    force_times: ForceTimes = ForceTimes::AsStated,
}}

/// The default is left out of stored parameters.
fn is_as_stated(times: &ForceTimes) -> bool {
    *times == ForceTimes::AsStated
}

impl ImportConfig {
    /// The part that the readers of recordings take.
    pub fn options(&self) -> ImportOptions {
        let names = |n: &ColumnNames| match n {
            ColumnNames::Before(before) => aloft_trial::ColumnNames::Before(before.clone()),
            ColumnNames::Each(names) => aloft_trial::ColumnNames::Each(names.clone()),
        };
        let plate = |p: &PlateColumnsConfig| PlateNames {
            force: names(&p.force),
            point: p.point.as_ref().map(names),
            moment: p.moment.as_ref().map(names),
        };
        ImportOptions {
            up_axis: match self.up_axis {
                Vertical::Auto => None,
                Vertical::X => Some(UpAxis::X),
                Vertical::Y => Some(UpAxis::Y),
                Vertical::Z => Some(UpAxis::Z),
            },
            strip_prefix: self.strip_prefix,
            point_unit: self.point_unit.clone(),
            rate_hz: self.rate_hz,
            people: self.person.iter().cloned().collect(),
            forces: self.forces.iter().map(|(name, p)| (name.clone(), plate(p))).collect(),
            force_times: match self.force_times {
                ForceTimes::AsStated => aloft_trial::ForceTimes::AsStated,
                ForceTimes::FromFirstFrame => aloft_trial::ForceTimes::FromFirstFrame,
            },
            ..ImportOptions::default()
        }
    }
}

section! {
/// Static trial to subject.
ScaleConfig {
    /// Anthropometric table: a name in `configs/anthropometry/` (`de_leva`, `dumas`, `winter`) or a
    /// path.
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
    /// Whether recordings held out for comparison (`trials: validate`) take part as well. By
    /// default they do not: held out means held out.
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
    #[schemars(range(min = 1e-5, max = 0.03))]
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
    /// `none` designs each pass at the stated cut-off; `winter` moves it so that both passes
    /// together are −3 dB there.
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
    /// Each recording is one flight, from its first frame to its last: recordings that were cut in
    /// the air.
    Whole,
}

/// A flight stated by hand.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct StatedFlight {
    /// Its first frame, s from the first frame of the recording.
    #[schemars(range(min = 0.0, max = 1_000_000.0))]
    pub from_s: f64,
    /// The first frame after it, likewise, s.
    #[schemars(range(min = 1e-6, max = 1_000_000.0))]
    pub to_s: f64,
}

section! {
/// Search for free flight.
FlightConfig {
    /// How flights are found.
    source: FlightSource = FlightSource::Auto,
    /// Flights stated by hand, in seconds from the first frame: `[{from_s: 0.40, to_s: 0.62}]`.
    /// They are taken as they are, and none is looked for. For single recordings under `overrides`.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    stated: Vec<StatedFlight> = Vec::new(),
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

/// What a link's inertia must fit into.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum InertiaLimit {
    /// Nothing: any mass distribution of positive density.
    None,
    /// The box about the link's collision geometry in the model file.
    Collision,
}

section! {
/// A robot: its description, and how far its model's inertias may be from the truth.
RobotConfig {
    /// Description of the robot, a path relative to the recordings: model files, inertial unit,
    /// noise of the sensors.
    description: String = "robot.yaml".to_owned(),
    /// Standard deviation of a link's mass in the model file, as a share.
    #[schemars(range(min = 0.001, max = 2.0))]
    mass_rel: f64 = 0.15,
    /// Standard deviation of a link's centre of mass in the model file, each axis, m.
    #[schemars(range(min = 1e-5, max = 1.0))]
    com_m: f64 = 0.012,
    /// Standard deviation of a link's radii of gyration in the model file, as a share (half of that
    /// of inertias).
    #[schemars(range(min = 0.001, max = 2.0))]
    radius_rel: f64 = 0.12,
    /// Rows of a log up to this far apart are interpolated, with the error of the interpolation in
    /// the noise, s. The default is half a period of a filter of 30 Hz: samples that close
    /// determine what it keeps.
    #[schemars(range(min = 0.0, max = 1.0))]
    fill_gaps_s: f64 = 0.0167,
    /// What a link's identified inertia must fit into. With `collision`, no mass is put outside the
    /// box about a link's collision geometry (boxes, cylinders, spheres, capsules, ellipsoids;
    /// links with meshes have no limit).
    inertia_limits: InertiaLimit = InertiaLimit::None,
    /// Margin about the collision geometry, each side, m.
    #[schemars(range(min = 0.0, max = 1.0))]
    limits_margin_m: f64 = 0.01,
    /// Number of flights that `parameters --assess` plans.
    #[schemars(range(min = 1, max = 24))]
    next_flights: usize = 3,
    /// Duration of a planned flight, s; 0: that of the recorded flights.
    #[schemars(range(min = 0.0, max = 10.0))]
    next_flight_s: f64 = 0.0,
    /// Largest turn of the base when it is let go in a planned flight, rad/s; 0: the largest of the
    /// recordings.
    #[schemars(range(min = 0.0, max = 50.0))]
    next_turn_rad_s: f64 = 0.0,
    /// Share of the stated rates and torques that planned flights use.
    #[schemars(range(min = 0.01, max = 1.0))]
    limit_share: f64 = 0.8,
    /// How many times faster than in the recordings a joint may be in a planned flight.
    #[schemars(range(min = 0.1, max = 10.0))]
    faster: f64 = 1.5,
    /// Distance that a planned flight keeps between links that no joint connects, m; less where the
    /// recordings have less.
    #[schemars(range(min = 0.0, max = 1.0))]
    clearance_m: f64 = 0.01,
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
    /// By the inverse of the rows' covariance, propagated from the markers' noise. `discover`
    /// weights its own rows by fixed weights in any case.
    Whitened,
}

section! {
/// Rows and factors.
RegressorConfig {
    /// Rows that the results are built on; the other kind is computed beside them.
    rows: Rows = Rows::Weak,
    /// Length of a weak window, s; 0 lets the length of each stretch decide. `aloft parameters
    /// --assess` shows what other lengths give.
    #[schemars(range(min = 0.0, max = 60.0))]
    window_s: f64 = 0.0,
    /// Weights of weak rows.
    weighting: Weighting = Weighting::Fixed,
    /// Size of errors that fade within a tenth of a second (soft tissue) in units of the markers'
    /// white noise; for `whitened`.
    #[schemars(range(min = 0.0, max = 1000.0))]
    slow_noise: f64 = 5.0,
}}

/// Estimator of the base parameters.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Estimator {
    /// For objects and robots the metric of the rows' noise; for people the tables beside least
    /// squares; what `contact` or `null_vector` need is stated by them.
    Auto,
    /// Smallest vector in the metric of the rows' own noise, with the body mass known; directions
    /// that the motion does not determine keep the values of tables or drawing.
    NoiseMetric,
    /// Right singular vector of the smallest singular value (the paper).
    NullVector,
    /// Least squares with the body mass known.
    MassConstrained,
    /// Least squares with the body mass known and the anthropometric prior.
    #[serde(alias = "regularized")]
    Regularised,
}

section! {
/// Estimation.
IdentifyConfig {
    /// Estimator.
    estimator: Estimator = Estimator::Auto,
    /// Weight of the prior; 0 lets held-out error decide.
    #[schemars(range(min = 0.0, max = 1e6))]
    prior_weight: f64 = 0.0,
    /// Whether plate-measured contact stretches of the identification trials take part. Where not
    /// given: only once the model holds an effect that shows on force plates alone (`plate_gain`,
    /// `body_mass` …), which nothing else can determine, or one of which `discover` found that it
    /// predicts as well with its size from flights and contact together.
    contact: Option<bool> = None,
    /// Bootstrap resamples over flights. Intervals do not use them: they come from the spread among
    /// flights with Student's t.
    #[schemars(range(min = 0, max = 100_000))]
    bootstrap: usize = 0,
    /// Correlation of errors from flight to flight, 0 to 1, as a further allowance for what
    /// repeats; none where not given. Soft tissue of people is allowed for in any case, as a random
    /// effect of the size that the marker residuals show.
    #[schemars(range(min = 0.0, max = 1.0))]
    #[serde(alias = "repeat_correlation")]
    flight_error_correlation: Option<f64> = None,
    /// Whether the subject may turn over in the air (gymnasts, divers, trampolines). Only then, and
    /// for objects, does the advice on what to record next contain it.
    somersaults: bool = false,
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
    /// Joint angles: `model` (names and axes of OpenSim's full-body models) or `isb` (shoulder
    /// Y-X-Y, wrist Z-X-Y).
    angles: Angles = Angles::Model,
}}
