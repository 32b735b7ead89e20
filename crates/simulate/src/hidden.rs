//! Hidden effects of a scenario: forces missing from any model, and errors of the instruments.
//!
//! The force laws are evaluated in [`crate::physics::forces`], written independently of any
//! estimator, so that recovering their coefficients is a real test.

use serde::{Deserialize, Serialize};

fn air() -> f64 {
    1.2
}
fn origin() -> [f64; 3] {
    [0.0; 3]
}
fn yes() -> bool {
    true
}

/// The carrier of a law that acts on the whole body.
pub const WHOLE_BODY: &str = "body";

/// Axes of the components of a law.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Axes {
    /// The capture frame's.
    #[default]
    World,
    /// Those of the link (of the root link for the whole body).
    Link,
}

/// One component of a law: a formula, or just a number.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(untagged)]
pub enum FormulaText {
    /// A constant.
    Number(f64),
    /// A formula of the quantities listed at [`Hidden::Law`].
    Text(String),
}

/// A flat plate on a link.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Plate {
    /// The link.
    pub link: String,
    /// Middle of the plate, link frame, m; the link's centre of mass if not stated.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub point_m: Option<[f64; 3]>,
    /// Normal, link axes, any length; both sides are alike.
    pub normal: [f64; 3],
    /// Area, m².
    pub area_m2: f64,
}

fn plate_coefficient() -> f64 {
    1.2
}

/// One hidden effect. Points are in the named link's frame (m), world vectors in the capture frame
/// (Z up).
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(tag = "effect", rename_all = "snake_case", deny_unknown_fields)]
#[allow(missing_docs, reason = "fields of the variants are documented on the variant")]
pub enum Hidden {
    /// Air resistance `−½ ρ C_dA_i |u| u` at each link's centre of mass, `u` relative to still air;
    /// `drag_area_m2` (Σ C_dA) is spread over the links by their size.
    QuadraticDrag {
        drag_area_m2: f64,
        #[serde(default = "air")]
        air_density_kgpm3: f64,
    },
    /// `−c_i u` at each link's centre of mass; `coefficient_nspm` (Σ c, N·s/m) spread over the
    /// links by their size.
    LinearDrag { coefficient_nspm: f64 },
    /// `−c ω_i` on each link, N·m·s/rad.
    RotationalDrag { coefficient_nmsprad: f64 },
    /// Quadratic drag in air that moves with `velocity_mps`.
    Wind {
        velocity_mps: [f64; 3],
        drag_area_m2: f64,
        #[serde(default = "air")]
        air_density_kgpm3: f64,
    },
    /// A force constant in the world at a point of a link.
    ConstantForce {
        link: String,
        #[serde(default = "origin")]
        point_m: [f64; 3],
        force_n: [f64; 3],
    },
    /// Gravity is tilted from the capture frame's vertical by these angles about x and y (the wand
    /// was not level).
    GravityTilt { about_x_deg: f64, about_y_deg: f64 },
    /// Gravity is `factor` times the value stated by the laboratory.
    GravityScale { factor: f64 },
    /// The cameras' true rate; the files state the nominal one.
    TimeBase { true_rate_hz: f64 },
    /// Every length in the files is too long by `factor` (the wand was shorter than assumed).
    LengthScale { factor: f64 },
    /// An elastic line from a point of a link to an anchor: `k (d − l₀) + c ḋ` towards the anchor,
    /// and nothing when slack.
    Tether {
        link: String,
        #[serde(default = "origin")]
        point_m: [f64; 3],
        anchor_m: [f64; 3],
        rest_length_m: f64,
        stiffness_npm: f64,
        #[serde(default)]
        damping_nspm: f64,
    },
    /// A line of constant tension from a point of a link over a pulley at `pulley_m` (body-weight
    /// support).
    Crane {
        link: String,
        #[serde(default = "origin")]
        point_m: [f64; 3],
        pulley_m: [f64; 3],
        tension_n: f64,
    },
    /// A wheel in a link with constant spin momentum (link axes, N·m·s).
    Flywheel { link: String, momentum_nms: [f64; 3] },
    /// A wheel whose spin changes: momentum along `axis` is `mean_nms + swing_nms · sin(2π
    /// frequency_hz t)`.
    Rotor { link: String, axis: [f64; 3], mean_nms: f64, swing_nms: f64, frequency_hz: f64 },
    /// Payload carried on a link in some trials only (`trials`: names or prefixes; all when empty).
    Payload {
        link: String,
        #[serde(default = "origin")]
        point_m: [f64; 3],
        mass_kg: f64,
        #[serde(default)]
        trials: Vec<String>,
    },
    /// Part of a link's own mass, suspended on springs: `mass_kg` at `point_m`, natural frequency
    /// and damping ratio.
    WobblingMass { link: String, point_m: [f64; 3], mass_kg: f64, frequency_hz: f64, damping_ratio: f64 },
    /// Inertia without weight at a point of a link (entrained air or water): `−m_a · acceleration`.
    AddedMass {
        link: String,
        #[serde(default = "origin")]
        point_m: [f64; 3],
        mass_kg: f64,
    },
    /// A force fixed in a link, on for `on_s` of every `period_s` (always on if `period_s` is
    /// zero).
    Thrust {
        link: String,
        #[serde(default = "origin")]
        point_m: [f64; 3],
        force_n: [f64; 3],
        #[serde(default)]
        period_s: f64,
        #[serde(default)]
        on_s: f64,
    },
    /// Flat plates on links in moving air: `−½ ρ C A |u·n| (u·n) n` at the middle of each plate,
    /// `u` relative to the air (velocity `wind_mps`), no friction along the plate; `C` is
    /// `normal_coefficient`.
    Panels {
        plates: Vec<Plate>,
        #[serde(default = "origin")]
        wind_mps: [f64; 3],
        #[serde(default = "air")]
        air_density_kgpm3: f64,
        #[serde(default = "plate_coefficient")]
        normal_coefficient: f64,
    },
    /// Any law: force (N) at a point of a link and couple (N·m) on it, three formulas each, along
    /// the axes of the world or of the link. `link: body` is the whole body: the force then acts at
    /// its centre of mass, spread over the links by mass like weight, and the axes of the "link"
    /// are those of the root.
    ///
    /// | name | quantity |
    /// |---|---|
    /// | `x y z` | position of the point, world, m |
    /// | `vx vy vz`, `ux uy uz`, `speed` | its velocity along the axes of the world, of the link; its magnitude; m/s |
    /// | `wx wy wz`, `px py pz`, `spin` | angular velocity along the axes of the world, of the link; its magnitude; rad/s |
    /// | `up_x up_y up_z` | vertical component of the link's axes |
    /// | `ex_x ex_y ex_z`, `ey_x …`, `ez_x …` | world components of the link's axes x, y, z |
    /// | `q_LINK`, `qd_LINK` | coordinate and rate of the hinge (slider) of a link: rad, rad/s (m, m/s) |
    /// | `t` | time of the recording, s |
    /// | `since_start` | time since take-off (release), s; zero on the ground and in the hand |
    ///
    /// Operators `+ - * / ^`; `pi`; functions `abs sign sqrt exp ln sin cos tan atan tanh`, `step`
    /// (0 below zero, else 1), `min max hypot atan2` of two arguments, and `dist(x0, y0, z0)`, the
    /// distance of the point from a place in the world.
    ///
    /// `delay_s` (0, or 0.005 to 0.5 s): the components are those of the state `delay_s` ago; they
    /// act at the present point along the present axes. Before the recording's first instant they
    /// are those of that instant.
    Law {
        link: String,
        #[serde(default = "origin")]
        point_m: [f64; 3],
        #[serde(default)]
        axes: Axes,
        #[serde(default, skip_serializing_if = "Option::is_none")]
        force: Option<[FormulaText; 3]>,
        #[serde(default, skip_serializing_if = "Option::is_none")]
        moment: Option<[FormulaText; 3]>,
        #[serde(default)]
        delay_s: f64,
    },
    /// The plates' samples are `offset_s` later than the cameras' (negative: earlier).
    PlateTimeOffset { offset_s: f64 },
    /// The plates' clock runs fast by `rate_ppm`; recordings start `spacing_s` apart in a session
    /// that began synchronised.
    ClockDrift {
        rate_ppm: f64,
        #[serde(default)]
        spacing_s: f64,
    },
    /// Unloaded reading of plate `plate` (1-based), plate axes.
    PlateTare { plate: usize, force_n: [f64; 3], moment_nm: [f64; 3] },
    /// True position of plate `plate` relative to the file, `shift_m` (world).
    PlateOrigin { plate: usize, shift_m: [f64; 3] },
    /// Plate `plate` is actually rotated by this rotation vector (world, degrees) about its centre.
    PlateRotation { plate: usize, turn_deg: [f64; 3] },
    /// Gains of the six channels of plate `plate`.
    PlateGain { plate: usize, gain: [f64; 6] },
    /// More soft-tissue movement on one link: markers shift by about `amplitude_m` for a turn of
    /// half a radian in its joint.
    SoftTissue {
        link: String,
        amplitude_m: f64,
        #[serde(default = "yes")]
        along_bone: bool,
    },
    /// The reconstruction is distorted: markers shift quadratically with their distance from the
    /// middle of the volume, by `amplitude_m` at 1 m.
    CameraWarp { amplitude_m: f64 },
    /// The scale reads `error_kg` too much.
    BodyMass { error_kg: f64 },
}

impl Hidden {
    /// Name as written in YAML.
    pub fn name(&self) -> &'static str {
        match self {
            Self::QuadraticDrag { .. } => "quadratic_drag",
            Self::LinearDrag { .. } => "linear_drag",
            Self::RotationalDrag { .. } => "rotational_drag",
            Self::Wind { .. } => "wind",
            Self::ConstantForce { .. } => "constant_force",
            Self::GravityTilt { .. } => "gravity_tilt",
            Self::GravityScale { .. } => "gravity_scale",
            Self::TimeBase { .. } => "time_base",
            Self::LengthScale { .. } => "length_scale",
            Self::Tether { .. } => "tether",
            Self::Crane { .. } => "crane",
            Self::Flywheel { .. } => "flywheel",
            Self::Rotor { .. } => "rotor",
            Self::Payload { .. } => "payload",
            Self::WobblingMass { .. } => "wobbling_mass",
            Self::AddedMass { .. } => "added_mass",
            Self::Thrust { .. } => "thrust",
            Self::Panels { .. } => "panels",
            Self::Law { .. } => "law",
            Self::PlateTimeOffset { .. } => "plate_time_offset",
            Self::ClockDrift { .. } => "clock_drift",
            Self::PlateTare { .. } => "plate_tare",
            Self::PlateOrigin { .. } => "plate_origin",
            Self::PlateRotation { .. } => "plate_rotation",
            Self::PlateGain { .. } => "plate_gain",
            Self::SoftTissue { .. } => "soft_tissue",
            Self::CameraWarp { .. } => "camera_warp",
            Self::BodyMass { .. } => "body_mass",
        }
    }

    /// The link that the effect acts on, if it names one and only one (a law may name the whole
    /// body instead).
    pub fn link(&self) -> Option<&str> {
        match self {
            Self::ConstantForce { link, .. }
            | Self::Tether { link, .. }
            | Self::Crane { link, .. }
            | Self::Flywheel { link, .. }
            | Self::Rotor { link, .. }
            | Self::Payload { link, .. }
            | Self::WobblingMass { link, .. }
            | Self::AddedMass { link, .. }
            | Self::Thrust { link, .. }
            | Self::SoftTissue { link, .. } => Some(link),
            _ => None,
        }
    }

    /// The plate with the error, 1-based.
    pub fn plate(&self) -> Option<usize> {
        match self {
            Self::PlateTare { plate, .. }
            | Self::PlateOrigin { plate, .. }
            | Self::PlateRotation { plate, .. }
            | Self::PlateGain { plate, .. } => Some(*plate),
            _ => None,
        }
    }
}
