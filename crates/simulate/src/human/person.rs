//! An individual: geometry scaled from stature, masses from tables, markers on the skin, all with
//! variation from the seed.
//!
//! Link frames: X anterior, Y up (proximal), Z to the right in the upright neutral posture; origin
//! at the proximal joint centre, the pelvis' midway between the hips. Mass fractions and radii of
//! gyration follow de Leva (1996); hip centres are placed by Harrington's regression (2007) from
//! the pelvis markers, with a random error of a few millimetres.

use crate::error::SimulateError;
use crate::object::TrueMarker;
use crate::object::chain::individual;
use crate::physics::Body;
use crate::random::Stream;
use crate::scenario::{PersonSpec, Scenario};
use aloft_body::{JointSpec, LinkSpec, Model, ModelSpec, Sex};
use nalgebra::{Isometry3, UnitQuaternion, Vector3};

/// Links of the human model, in order, with parent and joint.
pub const LINKS: [(&str, Option<&str>, JointSpec); 15] = [
    ("pelvis", None, JointSpec::Free),
    ("torso", Some("pelvis"), JointSpec::Spherical),
    ("head", Some("torso"), JointSpec::Spherical),
    ("upper_arm_r", Some("torso"), JointSpec::Spherical),
    ("forearm_r", Some("upper_arm_r"), JointSpec::RevoluteZ),
    ("hand_r", Some("forearm_r"), JointSpec::Spherical),
    ("upper_arm_l", Some("torso"), JointSpec::Spherical),
    ("forearm_l", Some("upper_arm_l"), JointSpec::RevoluteZ),
    ("hand_l", Some("forearm_l"), JointSpec::Spherical),
    ("thigh_r", Some("pelvis"), JointSpec::Spherical),
    ("shank_r", Some("thigh_r"), JointSpec::RevoluteZ),
    ("foot_r", Some("shank_r"), JointSpec::Spherical),
    ("thigh_l", Some("pelvis"), JointSpec::Spherical),
    ("shank_l", Some("thigh_l"), JointSpec::RevoluteZ),
    ("foot_l", Some("shank_l"), JointSpec::Spherical),
];
/// Index of the thigh of a side (0 right, 1 left); shank and foot follow.
pub const THIGH: [usize; 2] = [9, 12];
/// Sign of Z on a side (0 right, 1 left).
pub const SIDE: [f64; 2] = [1.0, -1.0];

/// Markers of the plug-in-gait set in the order of the files, then those used only in the static
/// trial.
pub const LABELS: [&str; 35] = [
    "LFHD", "RFHD", "LBHD", "RBHD", "C7", "T10", "CLAV", "STRN", "RBAK", "LSHO", "RSHO", "LELB", "RELB", "LWRA",
    "LWRB", "RWRA", "RWRB", "LFIN", "RFIN", "LASI", "RASI", "LPSI", "RPSI", "LTHI", "RTHI", "LKNE", "RKNE", "LTIB",
    "RTIB", "LANK", "RANK", "LHEE", "RHEE", "LTOE", "RTOE",
];
/// Medial markers of the static trial.
pub const STATIC_LABELS: [&str; 6] = ["LKNM", "RKNM", "LANM", "RANM", "LELM", "RELM"];

/// A person: body, markers, and the foot geometry used by the choreography.
#[derive(Debug, Clone)]
pub struct Person {
    /// Tree and true inertias.
    pub body: Body,
    /// All 41 markers, in the order of the labels.
    pub markers: Vec<TrueMarker>,
    /// Ball of the foot on the sole, foot frame, right and left, m.
    pub ball_m: [Vector3<f64>; 2],
    /// Stature, m.
    pub height_m: f64,
}

/// One row of the inertial table: share of the body mass, centre of mass and radii of gyration
/// (about X, Y, Z) in units of the length that the row scales with.
struct Row {
    mass: f64,
    com: [f64; 3],
    radii: [f64; 3],
    area: f64,
}

fn row(mass: f64, com: [f64; 3], radii: [f64; 3], area: f64) -> Row {
    Row { mass, com, radii, area }
}

/// Pelvis, torso, head (in statures), upper arm, forearm (in their lengths), hand (stature), thigh,
/// shank (lengths), foot (stature).
fn table(sex: Sex) -> [Row; 9] {
    match sex {
        Sex::Female => [
            row(0.1247, [-0.006, 0.0531, 0.0], [0.0453, 0.0464, 0.0421], 0.07),
            row(0.3011, [0.004, 0.115, 0.0], [0.088, 0.060, 0.077], 0.16),
            row(0.0668, [0.009, 0.067, 0.0], [0.0381, 0.0367, 0.0414], 0.035),
            row(0.0255, [0.0, -0.5754, 0.0], [0.278, 0.148, 0.260], 0.028),
            row(0.0138, [0.0, -0.4559, 0.0], [0.261, 0.094, 0.257], 0.020),
            row(0.0056, [0.0, -0.0336, 0.0], [0.0239, 0.0151, 0.0204], 0.012),
            row(0.1478, [0.0, -0.3812, 0.0], [0.352, 0.158, 0.350], 0.065),
            row(0.0481, [0.0, -0.4352, 0.0], [0.267, 0.092, 0.263], 0.045),
            row(0.0129, [0.024, -0.023, 0.0], [0.0190, 0.0410, 0.0395], 0.02),
        ],
        Sex::Male => [
            row(0.1117, [-0.006, 0.0355, 0.0], [0.0515, 0.0491, 0.0461], 0.07),
            row(0.3229, [0.004, 0.121, 0.0], [0.090, 0.064, 0.080], 0.17),
            row(0.0694, [0.009, 0.066, 0.0], [0.0423, 0.0364, 0.0439], 0.035),
            row(0.0271, [0.0, -0.5772, 0.0], [0.285, 0.158, 0.269], 0.030),
            row(0.0162, [0.0, -0.4574, 0.0], [0.276, 0.121, 0.265], 0.022),
            row(0.0061, [0.0, -0.0391, 0.0], [0.0311, 0.0199, 0.0254], 0.013),
            row(0.1416, [0.0, -0.4095, 0.0], [0.329, 0.149, 0.329], 0.068),
            row(0.0433, [0.0, -0.4395, 0.0], [0.251, 0.102, 0.246], 0.046),
            row(0.0137, [0.025, -0.023, 0.0], [0.0184, 0.0405, 0.0385], 0.022),
        ],
    }
}
/// Row of the table for each link.
const ROW: [usize; 15] = [0, 1, 2, 3, 4, 5, 3, 4, 5, 6, 7, 8, 6, 7, 8];

/// Joint positions and marker anchors used by several parts of the builder, m.
struct Geometry {
    offsets: [Vector3<f64>; 15],
    upper_arm: [f64; 2],
    forearm: [f64; 2],
    thigh: [f64; 2],
    shank: [f64; 2],
    ankle: f64,
    asis: [Vector3<f64>; 2],
    psis: [Vector3<f64>; 2],
}

fn geometry(spec: &PersonSpec, rng: &mut Stream) -> Geometry {
    let (h, s) = (spec.height_m, spec.variation);
    let female = spec.sex == Sex::Female;
    let either = |f: f64, m: f64| if female { f } else { m };
    // both sides share most of the individual variation; each side adds one per cent of its own
    let mut pair = |share: f64| {
        let length = h * share * (1.0 + 0.025 * s * rng.moderate());
        [length * (1.0 + 0.006 * s * rng.moderate()), length * (1.0 + 0.006 * s * rng.moderate())]
    };
    let upper_arm = pair(either(0.164, 0.168));
    let forearm = pair(either(0.152, 0.153));
    let thigh = pair(either(0.247, 0.245));
    let shank = pair(either(0.246, 0.247));
    let shoulder = pair(either(0.101, 0.108));
    let ankle = h * 0.041 * (1.0 + 0.04 * s * rng.moderate());
    // pelvis: markers first, then the hips from Harrington's regression (mm), then individual
    // variation
    let width = h * either(0.146, 0.139) * (1.0 + 0.04 * s * rng.moderate());
    let depth = h * either(0.088, 0.086) * (1.0 + 0.04 * s * rng.moderate());
    let leg = 0.5 * (thigh[0] + thigh[1] + shank[0] + shank[1]) + 0.06;
    let tilt = (12.0 + 3.0 * s * rng.moderate()).to_radians();
    let forward = Vector3::new(tilt.cos(), -tilt.sin(), 0.0);
    let up = Vector3::new(tilt.sin(), tilt.cos(), 0.0);
    let back = -0.24 * depth - 0.0099 + 0.003 * s * rng.moderate();
    let down = -0.16 * width - 0.04 * leg - 0.0071 + 0.003 * s * rng.moderate();
    let mut side = || 0.28 * depth + 0.16 * width + 0.0079 + 0.0025 * s * rng.moderate();
    let hips = [side(), side()];
    let mid_asis = -(forward * back + up * down);
    let z = |x: f64| Vector3::new(0.0, 0.0, x);
    let mut skin = || rng.vector() * (0.0025 * s);
    let asis = [mid_asis + z(0.5 * width) + skin(), mid_asis - z(0.5 * width) + skin()];
    let mid_psis = mid_asis - forward * depth;
    let psis = [mid_psis + z(0.029 * h) + skin(), mid_psis - z(0.029 * h) + skin()];

    let mut jitter = |x: f64, y: f64, z: f64| Vector3::new(x, y, z) + rng.vector() * (0.004 * s);
    let mut offsets = [Vector3::zeros(); 15];
    offsets[1] = jitter(-0.0135 * h, either(0.070, 0.066) * h, 0.0);
    offsets[2] = jitter(-0.009 * h, either(0.243, 0.250) * h, 0.0);
    for (side, sign) in SIDE.into_iter().enumerate() {
        let arm = 3 + 3 * side;
        offsets[arm] = jitter(-0.003 * h, either(0.202, 0.208) * h, sign * shoulder[side]);
        offsets[arm + 1] = Vector3::new(0.0, -upper_arm[side], 0.0);
        offsets[arm + 2] = Vector3::new(0.0, -forearm[side], 0.0);
        offsets[THIGH[side]] = z(sign * hips[side]);
        offsets[THIGH[side] + 1] = Vector3::new(0.0, -thigh[side], 0.0);
        offsets[THIGH[side] + 2] = Vector3::new(0.0, -shank[side], 0.0);
    }
    // the pelvis' origin is midway between the hips
    let middle = (offsets[THIGH[0]] + offsets[THIGH[1]]) * 0.5;
    for link in [THIGH[0], THIGH[1]] {
        offsets[link] -= middle;
    }
    Geometry { offsets, upper_arm, forearm, thigh, shank, ankle, asis, psis }
}

fn markers(spec: &PersonSpec, g: &Geometry, rng: &mut Stream) -> Vec<TrueMarker> {
    let h = spec.height_m / 1.605;
    let s = spec.variation;
    let place = |label: &str| -> (usize, Vector3<f64>) {
        let side = usize::from(label.starts_with('L'));
        let sign = SIDE[side];
        let v = |x: f64, y: f64, z: f64| Vector3::new(x * h, y * h, z * h * sign);
        let middle = |x: f64, y: f64, z: f64| Vector3::new(x * h, y * h, z * h);
        let (arm, thigh) = (3 + 3 * side, THIGH[side]);
        // distances along a bone scale with its length
        let along = |length: f64, share: f64, x: f64, z: f64| Vector3::new(x * h, -share * length, z * h * sign);
        match label {
            "C7" => return (1, middle(-0.085, 0.380, 0.0)),
            "T10" => return (1, middle(-0.110, 0.168, 0.0)),
            "CLAV" => return (1, middle(0.060, 0.335, 0.0)),
            "STRN" => return (1, middle(0.106, 0.187, 0.0)),
            "RBAK" => return (1, middle(-0.096, 0.272, 0.080)),
            _ => {}
        }
        match &label[1..] {
            "FHD" => (2, v(0.088, 0.146, 0.057)),
            "BHD" => (2, v(-0.086, 0.151, 0.058)),
            "SHO" => (1, g.offsets[arm] + v(0.004, 0.047, -0.009)),
            "ELB" => (arm, along(g.upper_arm[side], 1.0, 0.001, 0.039)),
            "ELM" => (arm, along(g.upper_arm[side], 1.0, 0.001, -0.039)),
            "WRA" => (arm + 2, v(0.034, 0.001, 0.009)),
            "WRB" => (arm + 2, v(-0.030, 0.003, 0.008)),
            "FIN" => (arm + 2, v(0.003, -0.071, 0.020)),
            "ASI" => (0, g.asis[side]),
            "PSI" => (0, g.psis[side]),
            // wand markers are at different heights on the two sides so that the sides can be
            // distinguished
            "THI" => (thigh, along(g.thigh[side], if side == 0 { 0.62 } else { 0.48 }, 0.026, 0.078)),
            "KNE" => (thigh, along(g.thigh[side], 1.0, 0.001, 0.056)),
            "KNM" => (thigh, along(g.thigh[side], 1.0, -0.001, -0.054)),
            "TIB" => (thigh + 1, along(g.shank[side], if side == 0 { 0.59 } else { 0.46 }, 0.014, 0.064)),
            "ANK" => (thigh + 1, along(g.shank[side], 1.0, 0.003, 0.038)),
            "ANM" => (thigh + 1, along(g.shank[side], 1.0, -0.003, -0.038)),
            "HEE" => (thigh + 2, v(-0.055, -0.030, 0.0)),
            _ => (thigh + 2, v(0.114, -0.022, 0.002)),
        }
    };
    LABELS
        .iter()
        .chain(&STATIC_LABELS)
        .map(|label| {
            let (link, position) = place(label);
            let pelvis = link == 0;
            let position = if pelvis { position } else { position + rng.vector() * (0.003 * s) };
            TrueMarker { label: (*label).to_owned(), link, position_m: position }
        })
        .collect()
}

impl Person {
    /// Builds the person of a scenario.
    pub fn new(scenario: &Scenario, spec: &PersonSpec) -> Result<Self, SimulateError> {
        scenario.expect("body.person.height_m", spec.height_m, 0.8..=2.5, "0.8 to 2.5 m")?;
        scenario.expect("body.person.mass_kg", spec.mass_kg, 10.0..=300.0, "10 to 300 kg")?;
        scenario.expect("body.person.variation", spec.variation, 0.0..=2.0, "0 to 2")?;
        let rng = &mut Stream::new(scenario.seed, "person");
        let s = spec.variation;
        let g = geometry(spec, rng);

        let links = LINKS
            .iter()
            .zip(&g.offsets)
            .map(|((name, parent, joint), offset)| LinkSpec {
                name: (*name).to_owned(),
                parent: parent.map(str::to_owned),
                joint: *joint,
                position_m: (*offset).into(),
                rpy_rad: [0.0; 3],
                inertia: None,
            })
            .collect();
        let mut model = Model::from_spec(&ModelSpec::new("human34".to_owned(), links))?;
        model.gravity_mps2 = Vector3::new(0.0, 0.0, -scenario.capture.gravity_mps2);
        // real elbow and knee axes are never exactly lateral
        for link in [4, 7, 10, 13] {
            let lean = Vector3::new(0.02 * s * rng.moderate(), 0.02 * s * rng.moderate(), 0.0);
            let joint = &mut model.links[link].joint;
            joint.parent_from_joint =
                Isometry3::from_parts(joint.parent_from_joint.translation, UnitQuaternion::from_scaled_axis(lean));
        }

        let rows = table(spec.sex);
        let shares: Vec<f64> = ROW.iter().map(|r| rows[*r].mass * (1.0 + 0.05 * s * rng.moderate())).collect();
        let total: f64 = shares.iter().sum();
        let length = |link: usize| {
            let side = usize::from(LINKS[link].0.ends_with("_l"));
            match ROW[link] {
                3 => g.upper_arm[side],
                4 => g.forearm[side],
                6 => g.thigh[side],
                7 => g.shank[side],
                _ => spec.height_m,
            }
        };
        let mut phi = Vec::with_capacity(15);
        let mut area_m2 = Vec::with_capacity(15);
        for link in 0..15 {
            let row = &rows[ROW[link]];
            let scale = length(link);
            let com = Vector3::from(row.com) * scale;
            let radii = row.radii.map(|k| k * scale);
            // the trunk's centre of mass varies more between people than that of an arm
            let spread_m = if link < 2 { 0.007 } else { 0.0035 } * s;
            let mass = spec.mass_kg * shares[link] / total;
            phi.push(individual(mass, com, radii, [spread_m, 0.05 * s, 0.06 * s], rng).to_phi());
            area_m2.push(row.area);
        }
        let markers = markers(spec, &g, rng);
        let ball = Vector3::new(0.066 * spec.height_m, -g.ankle, 0.0);
        Ok(Self { body: Body { model, phi, area_m2 }, markers, ball_m: [ball; 2], height_m: spec.height_m })
    }
}
