//! Names, axes, order of rotations and positive senses of the coordinates of each joint.
//!
//! Link frames of people follow the ISB on both sides: x forward, y up (proximal), z to the right.
//! Left-hand coordinates about x and y are mirrored, so that adduction, inversion and internal
//! rotation are positive on both sides.

use super::{Convention, Sequence};
use aloft_body::{JointKind, Link};

/// Coordinates of one joint, independent of a model.
pub(super) struct Naming {
    pub names: Vec<String>,
    pub positive: Vec<&'static str>,
    pub sequence: Option<Sequence>,
    /// Sense of a hinge's or slider's coordinate along the joint's axis.
    pub sign: f64,
    /// Name of the whole joint, as used in files of angles (`RHipAngles`).
    pub group: String,
}

const X: usize = 0;
const Y: usize = 1;
const Z: usize = 2;

/// Stem and side of a name such as `thigh_r`.
fn side(name: &str) -> (&str, Option<char>) {
    match name.rsplit_once('_') {
        Some((stem, "r")) => (stem, Some('r')),
        Some((stem, "l")) => (stem, Some('l')),
        _ => (name, None),
    }
}

struct Ball {
    group: &'static str,
    axes: [usize; 3],
    names: [&'static str; 3],
    positive: [&'static str; 3],
    negative_middle: bool,
}

fn ball(group: &'static str, axes: [usize; 3], names: [&'static str; 3], positive: [&'static str; 3]) -> Ball {
    Ball { group, axes, names, positive, negative_middle: false }
}

/// Spherical joints of a person.
fn human_ball(stem: &str, convention: Convention) -> Option<Ball> {
    let zxy = [Z, X, Y];
    Some(match (stem, convention) {
        ("torso", _) => ball(
            "Lumbar",
            zxy,
            ["lumbar_extension", "lumbar_bending", "lumbar_rotation"],
            ["extension", "bending to the right", "turn to the left"],
        ),
        ("head", _) => ball(
            "Neck",
            zxy,
            ["neck_extension", "neck_bending", "neck_rotation"],
            ["extension", "bending to the right", "turn to the left"],
        ),
        ("thigh", _) => ball(
            "Hip",
            zxy,
            ["hip_flexion", "hip_adduction", "hip_rotation"],
            ["flexion", "adduction", "internal rotation"],
        ),
        ("foot", _) => ball(
            "Ankle",
            zxy,
            ["ankle_angle", "ankle_inversion", "ankle_rotation"],
            ["dorsiflexion", "inversion", "internal rotation"],
        ),
        ("upper_arm", Convention::Model) => {
            ball("Shoulder", zxy, ["arm_flex", "arm_add", "arm_rot"], ["flexion", "adduction", "internal rotation"])
        }
        ("upper_arm", Convention::Isb) => Ball {
            negative_middle: true,
            ..ball(
                "Shoulder",
                [Y, X, Y],
                ["shoulder_plane", "shoulder_elevation", "shoulder_rotation"],
                [
                    "plane of elevation: 0° abduction, 90° forward flexion",
                    "elevation is negative (ISB)",
                    "internal rotation",
                ],
            )
        },
        ("hand", _) => ball(
            "Wrist",
            zxy,
            ["wrist_flex", "wrist_dev", "pro_sup"],
            ["palmar flexion", "ulnar deviation", "pronation"],
        ),
        _ => return None,
    })
}

/// Hinges of a person: group, name, positive sense, sign along the link's z axis.
fn human_hinge(stem: &str) -> Option<(&'static str, &'static str, &'static str, f64)> {
    match stem {
        "shank" => Some(("Knee", "knee_angle", "flexion", -1.0)),
        "forearm" => Some(("Elbow", "elbow_flex", "flexion", 1.0)),
        _ => None,
    }
}

/// Coordinates of a link's joint.
pub(super) fn naming(link: &Link, convention: Convention) -> Naming {
    let (stem, side) = side(&link.name);
    let own = |suffix: &str| format!("{}_{suffix}", link.name);
    let prefix = side.map_or(String::new(), |s| s.to_ascii_uppercase().to_string());
    let plain = Naming {
        names: Vec::new(),
        positive: Vec::new(),
        sequence: None,
        sign: 1.0,
        group: format!("{}Angles", link.name),
    };
    match link.joint.kind {
        JointKind::Free if link.name == "pelvis" => Naming {
            names: ["tilt", "list", "rotation", "tx", "ty", "tz"].map(own).to_vec(),
            positive: vec!["backward tilt", "right side down", "turn to the left", "along X", "up (Y)", "along Z"],
            sequence: Some(Sequence::new([Z, X, Y], [1.0; 3])),
            group: "PelvisAngles".to_owned(),
            ..plain
        },
        JointKind::Free => Naming {
            names: ["rz", "rx", "ry", "tx", "ty", "tz"].map(own).to_vec(),
            positive: vec![
                "right-handed about z",
                "right-handed about x",
                "right-handed about y",
                "along X",
                "up (Y)",
                "along Z",
            ],
            sequence: Some(Sequence::new([Z, X, Y], [1.0; 3])),
            ..plain
        },
        JointKind::Spherical => match human_ball(stem, convention) {
            Some(b) => {
                let mirror = if side == Some('l') { -1.0 } else { 1.0 };
                let with_side = |n: &str| side.map_or(n.to_owned(), |s| format!("{n}_{s}"));
                Naming {
                    names: b.names.iter().map(|n| with_side(n)).collect(),
                    positive: b.positive.to_vec(),
                    sequence: Some(Sequence {
                        axes: b.axes,
                        signs: b.axes.map(|a| if a == Z { 1.0 } else { mirror }),
                        negative_middle: b.negative_middle,
                    }),
                    sign: 1.0,
                    group: format!("{prefix}{}Angles", b.group),
                }
            }
            None => Naming {
                names: ["rz", "rx", "ry"].map(own).to_vec(),
                positive: vec!["right-handed about z", "right-handed about x", "right-handed about y"],
                sequence: Some(Sequence::new([Z, X, Y], [1.0; 3])),
                ..plain
            },
        },
        JointKind::Revolute(_) => match human_hinge(stem) {
            Some((group, name, positive, sign)) => Naming {
                names: vec![side.map_or(name.to_owned(), |s| format!("{name}_{s}"))],
                positive: vec![positive],
                sign,
                group: format!("{prefix}{group}Angles"),
                ..plain
            },
            None => Naming { names: vec![own("angle")], positive: vec!["right-handed about the hinge"], ..plain },
        },
        JointKind::Prismatic(_) => {
            Naming { names: vec![own("displacement")], positive: vec!["along the joint's axis"], ..plain }
        }
        JointKind::Fixed => plain,
    }
}
