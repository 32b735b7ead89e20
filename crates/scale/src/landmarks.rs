//! The anatomical landmark names used by marker sets, and the landmarks measured in a static pose.

use crate::ScaleWarning;
use crate::statics::StaticPose;
use aloft_trial::{MarkerSet, Trial};
use nalgebra::Vector3;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// Side of the body.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Side {
    /// Right.
    Right,
    /// Left.
    Left,
}

impl Side {
    /// Both, right first.
    pub const BOTH: [Self; 2] = [Self::Right, Self::Left];
    /// Suffix of names: `r` or `l`.
    pub fn suffix(self) -> &'static str {
        match self {
            Self::Right => "r",
            Self::Left => "l",
        }
    }
    /// +1 on the right, −1 on the left: the sign of z (to the right) of a lateral point.
    pub fn sign(self) -> f64 {
        match self {
            Self::Right => 1.0,
            Self::Left => -1.0,
        }
    }
    /// The side given by the suffix of a name.
    pub fn of(name: &str) -> Option<Self> {
        if name.ends_with("_r") {
            Some(Self::Right)
        } else if name.ends_with("_l") {
            Some(Self::Left)
        } else {
            None
        }
    }
}

/// Landmarks that exist once.
pub(crate) const CENTRAL_LANDMARKS: [&str; 8] =
    ["vertex", "c7", "t10", "suprasternale", "xiphoid", "sacrum", "neck_centre", "pelvis_up"];

/// Landmarks that exist on both sides, followed by `_r` or `_l`.
pub(crate) const SIDED_LANDMARKS: [&str; 27] = [
    "head_front",
    "head_back",
    "acromion",
    "elbow_lateral",
    "elbow_medial",
    "wrist",
    "wrist_radial",
    "wrist_ulnar",
    "hand_distal",
    "asis",
    "psis",
    "hip_centre",
    "knee_centre",
    "ankle_centre",
    "shoulder_centre",
    "elbow_centre",
    "wrist_centre",
    "trochanter",
    "knee_lateral",
    "knee_medial",
    "ankle_lateral",
    "ankle_medial",
    "heel",
    "toe",
    "foot_forward",
    "mt1",
    "mt5",
];

/// All landmark names, with side.
pub fn landmark_names() -> Vec<String> {
    let sided = SIDED_LANDMARKS.iter().flat_map(|stem| [format!("{stem}_r"), format!("{stem}_l")]);
    CENTRAL_LANDMARKS.iter().map(|n| (*n).to_owned()).chain(sided).collect()
}

/// True for a known landmark name.
pub fn is_landmark(name: &str) -> bool {
    CENTRAL_LANDMARKS.contains(&name)
        || name
            .strip_suffix("_r")
            .or_else(|| name.strip_suffix("_l"))
            .is_some_and(|stem| SIDED_LANDMARKS.contains(&stem))
}

/// The measured landmarks, m, world frame of the static.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct Landmarks {
    /// By name. Several markers on one landmark are averaged.
    pub positions: BTreeMap<String, Vector3<f64>>,
}

impl Landmarks {
    /// Reads the landmarks from a static pose. Unknown landmark names and landmarks whose marker
    /// was not seen become warnings.
    pub fn read(trial: &Trial, set: &MarkerSet, pose: &StaticPose, warnings: &mut Vec<ScaleWarning>) -> Self {
        let mut sums: BTreeMap<String, (Vector3<f64>, usize)> = BTreeMap::new();
        let mut unseen: BTreeMap<&str, &str> = BTreeMap::new();
        for marker in &set.markers {
            let Some(name) = marker.landmark.as_deref() else { continue };
            if !is_landmark(name) {
                warnings.push(ScaleWarning::UnknownLandmark { marker: marker.label.clone(), landmark: name.into() });
                continue;
            }
            match trial.markers.index(&marker.label).and_then(|i| pose.positions[i]) {
                Some(p) => {
                    let entry = sums.entry(name.to_owned()).or_insert((Vector3::zeros(), 0));
                    entry.0 += p;
                    entry.1 += 1;
                }
                None => {
                    unseen.insert(name, &marker.label);
                }
            }
        }
        for (landmark, marker) in unseen {
            if !sums.contains_key(landmark) {
                warnings.push(ScaleWarning::LandmarkUnseen { marker: marker.into(), landmark: landmark.into() });
            }
        }
        Self { positions: sums.into_iter().map(|(name, (sum, n))| (name, sum / n as f64)).collect() }
    }

    /// A central landmark.
    pub fn get(&self, name: &str) -> Option<Vector3<f64>> {
        self.positions.get(name).copied()
    }
    /// A landmark of one side.
    pub fn side(&self, name: &str, side: Side) -> Option<Vector3<f64>> {
        self.positions.get(&format!("{name}_{}", side.suffix())).copied()
    }
    /// Midpoint of two landmarks of one side, if both were seen.
    pub fn middle(&self, a: &str, b: &str, side: Side) -> Option<Vector3<f64>> {
        Some((self.side(a, side)? + self.side(b, side)?) / 2.0)
    }
    /// Midpoint of right and left, if both were seen.
    pub fn across(&self, name: &str) -> Option<Vector3<f64>> {
        Some((self.side(name, Side::Right)? + self.side(name, Side::Left)?) / 2.0)
    }
    /// Names, for messages.
    pub fn names(&self) -> String {
        if self.positions.is_empty() {
            "none".into()
        } else {
            self.positions.keys().cloned().collect::<Vec<_>>().join(", ")
        }
    }
}
