//! A scenario: the person or object, its movements, the instruments and the hidden effects. Plain
//! data; the pipeline reads it from YAML.

use crate::error::SimulateError;
use crate::hidden::Hidden;
use crate::measure::markerless::MarkerlessSpec;
use aloft_body::{ModelSpec, Sex};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// A whole laboratory session to be simulated.
///
/// All random draws follow from `seed`: the same scenario gives the same bytes. Scenarios that
/// differ only in `hidden` have the same body, choreography and noise, so a scenario and its
/// [`Scenario::twin`] can be compared directly.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Scenario {
    /// Name of the scenario, also of the subject or object in the files.
    pub name: String,
    /// Seed of all random draws.
    #[serde(default)]
    pub seed: u64,
    /// The person or object, and its movements.
    pub body: BodySpec,
    /// The instruments.
    #[serde(default)]
    pub capture: CaptureSpec,
    /// Effects hidden from the laboratory.
    #[serde(default)]
    pub hidden: Vec<Hidden>,
    /// Write the true motion of every trial as `truth/truth_<trial>.npz`.
    #[serde(default)]
    pub trajectories: bool,
}

impl Scenario {
    /// The same session without hidden effects.
    pub fn twin(&self) -> Self {
        Self { name: format!("{}_twin", self.name), hidden: Vec::new(), ..self.clone() }
    }

    /// Seed of what instruments and skin add.
    pub(crate) fn capture_seed(&self) -> u64 {
        self.capture.seed.unwrap_or(self.seed)
    }

    pub(crate) fn value_error(&self, field: &str, found: impl ToString, expected: &str) -> SimulateError {
        SimulateError::Value {
            scenario: self.name.clone(),
            field: field.to_owned(),
            found: found.to_string(),
            expected: expected.to_owned(),
        }
    }

    pub(crate) fn expect(
        &self,
        field: &str,
        value: f64,
        range: std::ops::RangeInclusive<f64>,
        expected: &str,
    ) -> Result<(), SimulateError> {
        if range.contains(&value) { Ok(()) } else { Err(self.value_error(field, value, expected)) }
    }
}

/// The person or object that is recorded.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(tag = "kind", rename_all = "snake_case")]
pub enum BodySpec {
    /// Two links with one passive hinge, thrown and caught.
    Chain(ChainLab),
    /// A person of 15 links who jumps and moves on two force plates.
    Human(HumanLab),
    /// Any model, thrown and caught like the chain.
    Custom(CustomLab),
}

/// The chain and its session.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct ChainLab {
    /// The object.
    pub object: ChainSpec,
    /// The throws.
    pub throws: ThrowProtocol,
}

/// A two-link chain. Its shape follows the seed around a bar of 235 mm with an arm of 205 mm.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct ChainSpec {
    /// Mass of both links, kg.
    pub mass_kg: f64,
    /// How much the individual differs from the design (0: not at all; 1: by some per cent).
    pub variation: f64,
    /// Viscous friction of the hinge, N·m·s/rad.
    pub hinge_damping_nmsprad: f64,
    /// Dry friction of the hinge, N·m.
    pub hinge_friction_nm: f64,
}

impl Default for ChainSpec {
    fn default() -> Self {
        Self { mass_kg: 0.997, variation: 1.0, hinge_damping_nmsprad: 1.5e-4, hinge_friction_nm: 6e-4 }
    }
}

/// Any other object: a model with inertias, markers on it, and passive joints.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CustomLab {
    /// The model; every link needs its inertia.
    pub model: ModelSpec,
    /// Markers: label → link and position in its frame.
    pub markers: BTreeMap<String, MarkerSpec>,
    /// Viscous friction of every joint, N·m·s/rad (N·s/m).
    #[serde(default)]
    pub joint_damping: f64,
    /// Dry friction of every joint, N·m (N).
    #[serde(default)]
    pub joint_friction: f64,
    /// The throws.
    #[serde(default)]
    pub throws: ThrowProtocol,
}

/// Position of a marker.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct MarkerSpec {
    /// Link that carries it.
    pub link: String,
    /// Position in the link frame, m.
    pub position_m: [f64; 3],
}

/// How an object is thrown.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct ThrowProtocol {
    /// Recordings `throws_01`, `throws_02` …
    pub recordings: usize,
    /// Number of throws in each recording.
    pub throws: usize,
    /// Shortest and longest flight, s.
    pub flight_s: [f64; 2],
    /// Slowest and fastest tumbling at release, rad/s.
    pub spin_radps: [f64; 2],
    /// Fastest joint rate at release, rad/s.
    pub joint_rate_radps: f64,
    /// Seconds between throws (catching, carrying, picking up again).
    pub carry_s: [f64; 2],
    /// Length of the static recording, s.
    pub static_s: f64,
    /// Length of the joint calibration, s.
    pub calibration_s: f64,
}

impl Default for ThrowProtocol {
    fn default() -> Self {
        Self {
            recordings: 5,
            throws: 6,
            flight_s: [0.6, 0.8],
            spin_radps: [2.0, 9.0],
            joint_rate_radps: 9.0,
            carry_s: [1.7, 2.3],
            static_s: 3.0,
            calibration_s: 14.0,
        }
    }
}

/// A person and the session.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct HumanLab {
    /// The person.
    pub person: PersonSpec,
    /// Trials of the session.
    #[serde(default)]
    pub protocol: JumpProtocol,
}

/// A person. Geometry and masses follow from sex and stature, with individual variation from the
/// seed.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PersonSpec {
    /// Sex.
    pub sex: Sex,
    /// Stature, m.
    pub height_m: f64,
    /// Mass, kg.
    pub mass_kg: f64,
    /// How much the individual differs from the tables (0: not at all; 1: typical variation between
    /// people).
    #[serde(default = "one")]
    pub variation: f64,
}

fn one() -> f64 {
    1.0
}

/// Trials of a person's session.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct JumpProtocol {
    /// Trials `jump01`, `jump02` …
    pub jumps: usize,
    /// Smallest and largest number of flights in a jump trial.
    pub flights: [usize; 2],
    /// Shortest and longest flight, s.
    pub flight_s: [f64; 2],
    /// Trials `exercise01` … with both feet on the plates.
    pub exercises: usize,
    /// Length of an exercise, s.
    pub exercise_s: f64,
    /// Length of the static trial, s.
    pub static_s: f64,
    /// How strongly arms, legs and trunk move in the air: 1 is vigorous, 0.3 a plain jump.
    pub vigour: f64,
    /// True if there are force plates under the feet.
    pub plates: bool,
}

impl Default for JumpProtocol {
    fn default() -> Self {
        Self {
            jumps: 8,
            flights: [2, 3],
            flight_s: [0.47, 0.6],
            exercises: 2,
            exercise_s: 5.2,
            static_s: 2.0,
            vigour: 1.0,
            plates: true,
        }
    }
}

/// The instruments.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct CaptureSpec {
    /// Camera rate, Hz.
    pub point_rate_hz: f64,
    /// Plate samples per camera frame.
    pub analog_per_frame: usize,
    /// White noise of a marker, each axis, m.
    pub marker_noise_m: f64,
    /// Soft-tissue artefact of a person's markers, root mean square, m (smooth function of joint
    /// angles).
    pub soft_tissue_m: f64,
    /// Typical root mean square movement that all markers of a segment have in common, over the
    /// bone, m: shift and turn, which inverse kinematics follows without a residual.
    pub soft_cluster_m: f64,
    /// Fraction of marker frames lost in gaps.
    pub gap_fraction: f64,
    /// Shortest and longest gap, frames.
    pub gap_frames: [usize; 2],
    /// White noise of a plate's force channels, N (moments: 0.3 times this, in N·m).
    pub plate_noise_n: f64,
    /// Slow drift of a plate's force channels over a trial, N.
    pub plate_drift_n: f64,
    /// Magnitude of gravity stated by the laboratory, m/s².
    pub gravity_mps2: f64,
    /// Seed of everything that the instruments and the skin add: noise, gaps, soft tissue, drift.
    /// Another value repeats the same motion of the same body with other errors. That of the
    /// scenario if absent.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub seed: Option<u64>,
    /// Poses of segments as markerless software finds them, in place of a person's markers.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub markerless: Option<MarkerlessSpec>,
}

impl Default for CaptureSpec {
    fn default() -> Self {
        Self {
            point_rate_hz: 200.0,
            analog_per_frame: 5,
            marker_noise_m: 0.3e-3,
            soft_tissue_m: 3e-3,
            soft_cluster_m: 0.0,
            gap_fraction: 2e-3,
            gap_frames: [5, 40],
            plate_noise_n: 1.0,
            plate_drift_n: 0.8,
            gravity_mps2: 9.81,
            seed: None,
            markerless: None,
        }
    }
}
