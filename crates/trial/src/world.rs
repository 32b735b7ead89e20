//! The world frame: Z up, metres. Rotates all data of a recording so that the source's vertical
//! becomes Z.

use crate::{Trial, WarningKind};
use nalgebra::{Matrix3, Rotation3, Vector3};
use serde::{Deserialize, Serialize};

/// Which axis of the source points up.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
pub enum UpAxis {
    /// +X.
    #[serde(rename = "x", alias = "+x", alias = "X", alias = "+X")]
    X,
    /// +Y, the convention of OpenSim.
    #[serde(rename = "y", alias = "+y", alias = "Y", alias = "+Y")]
    Y,
    /// +Z, the convention of capture systems.
    #[serde(rename = "z", alias = "+z", alias = "Z", alias = "+Z")]
    Z,
    /// −X.
    #[serde(rename = "-x", alias = "-X")]
    NegX,
    /// −Y.
    #[serde(rename = "-y", alias = "-Y")]
    NegY,
    /// −Z.
    #[serde(rename = "-z", alias = "-Z")]
    NegZ,
}

impl UpAxis {
    /// Reads `z`, `+Y`, `-y` …
    pub fn parse(text: &str) -> Option<Self> {
        match text.trim().to_ascii_lowercase().as_str() {
            "x" | "+x" => Some(Self::X),
            "y" | "+y" => Some(Self::Y),
            "z" | "+z" => Some(Self::Z),
            "-x" => Some(Self::NegX),
            "-y" => Some(Self::NegY),
            "-z" => Some(Self::NegZ),
            _ => None,
        }
    }

    /// The same axis, positive.
    pub(crate) fn positive(self) -> Self {
        match self {
            Self::X | Self::NegX => Self::X,
            Self::Y | Self::NegY => Self::Y,
            Self::Z | Self::NegZ => Self::Z,
        }
    }

    /// From the index of an axis and the sign of "up" along it.
    pub(crate) fn from_index(axis: usize, positive: bool) -> Self {
        match (axis, positive) {
            (0, true) => Self::X,
            (0, false) => Self::NegX,
            (1, true) => Self::Y,
            (1, false) => Self::NegY,
            (_, true) => Self::Z,
            (_, false) => Self::NegZ,
        }
    }

    /// Proper rotation that brings this axis to +Z.
    ///
    /// Y-up sources keep X: (X forward, Y up, Z right) becomes (X forward, Y left, Z up), that is
    /// (x, y, z) → (x, −z, y). X-up sources are turned cyclically, (x, y, z) → (y, z, x). The
    /// entries are 0 and ±1, so that nothing is rounded.
    pub fn world_from_source(self) -> Rotation3<f64> {
        let rows = match self {
            Self::Z => [[1., 0., 0.], [0., 1., 0.], [0., 0., 1.]],
            Self::Y => [[1., 0., 0.], [0., 0., -1.], [0., 1., 0.]],
            Self::NegY => [[1., 0., 0.], [0., 0., 1.], [0., -1., 0.]],
            Self::NegZ => [[1., 0., 0.], [0., -1., 0.], [0., 0., -1.]],
            Self::X => [[0., 1., 0.], [0., 0., 1.], [1., 0., 0.]],
            Self::NegX => [[0., 1., 0.], [0., 0., -1.], [-1., 0., 0.]],
        };
        Rotation3::from_matrix_unchecked(Matrix3::from_fn(|i, j| rows[i][j]))
    }
}

impl std::fmt::Display for UpAxis {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(match self {
            Self::X => "+X",
            Self::Y => "+Y",
            Self::Z => "+Z",
            Self::NegX => "-X",
            Self::NegY => "-Y",
            Self::NegZ => "-Z",
        })
    }
}

/// Vertical axis found in the recording, still in source axes, and the evidence for it.
///
/// Plates are horizontal (their corners share one coordinate), forces on a subject point along one
/// axis on average, and markers are above the plates. `None` without plates.
pub(crate) fn up_axis_from_plates(trial: &Trial) -> Option<(UpAxis, &'static str)> {
    let mut axis = None;
    for plate in &trial.plates {
        if let Some(flat) = flat_axis(&plate.corners_m) {
            axis = Some(flat);
            break;
        }
    }
    let mut told = "the corners of the plates";
    let mut total = Vector3::zeros();
    for plate in &trial.plates {
        for force in plate.force_n.iter().filter(|f| f.iter().all(|x| x.is_finite())) {
            total += force;
        }
    }
    if axis.is_none() {
        let largest = total.iamax();
        if total.norm() > 0.0 && total[largest].abs() > 0.8 * total.norm() {
            axis = Some(largest);
            told = "the mean force on the plates";
        }
    }
    let axis = axis?;
    // The side with the markers is up; without plate corners the force decides.
    let level = trial.plates.iter().find_map(|p| p.corners_m.first().map(|c| c[axis]));
    let mut above = 0_i64;
    if let Some(level) = level {
        for track in &trial.markers.trajectories {
            for p in track.iter().step_by(10) {
                let height = p[axis] - level;
                if height.is_finite() {
                    above += if height > 0.0 { 1 } else { -1 };
                }
            }
        }
    }
    let positive = if above == 0 { total[axis] >= 0.0 } else { above > 0 };
    Some((UpAxis::from_index(axis, positive), told))
}

/// Parts of labels of markers on the upper body and on the feet, lower case, letters and digits.
const UPPER: [&str; 16] = [
    "head", "fhd", "bhd", "hdf", "hdb", "temp", "occ", "c7", "cv7", "sho", "acr", "clav", "stern", "strn", "sjn", "snj",
];
const FEET: [&str; 15] =
    ["heel", "hee", "calc", "cal", "fcc", "toe", "ank", "mal", "meta", "mt1", "mt5", "fm1", "fm5", "mfh", "tam"];
/// Least mean distance between the two groups, m, and the share of it that has to lie along one
/// axis.
const TALL_M: f64 = 0.5;
const UPRIGHT: f64 = 0.8;

/// Vertical axis told by the body: shoulders and head are above the feet on average, in any
/// recording of a person. `None` where the labels do not name both, or the person lies.
pub(crate) fn up_axis_from_body(trial: &Trial) -> Option<UpAxis> {
    let group = |parts: &[&str]| -> Vec<usize> {
        let plain = |label: &String| -> String {
            label.chars().filter(char::is_ascii_alphanumeric).map(|c| c.to_ascii_lowercase()).collect()
        };
        let labels = trial.markers.labels.iter().map(plain).enumerate();
        labels.filter(|(_, l)| parts.iter().any(|p| l.contains(p))).map(|(i, _)| i).collect()
    };
    let (upper, feet) = (group(&UPPER), group(&FEET));
    if upper.is_empty() || feet.len() < 2 {
        return None;
    }
    let mean = |group: &[usize], frame: usize| -> Option<Vector3<f64>> {
        let seen: Vec<Vector3<f64>> = group.iter().filter_map(|&m| trial.markers.position(m, frame)).collect();
        (!seen.is_empty()).then(|| seen.iter().sum::<Vector3<f64>>() / seen.len() as f64)
    };
    let step = (trial.markers.n_frames / 50).max(1);
    let spans: Vec<Vector3<f64>> =
        (0..trial.markers.n_frames).step_by(step).filter_map(|f| Some(mean(&upper, f)? - mean(&feet, f)?)).collect();
    if spans.is_empty() {
        return None;
    }
    let span = spans.iter().sum::<Vector3<f64>>() / spans.len() as f64;
    let axis = span.iamax();
    (span.norm() > TALL_M && span[axis].abs() > UPRIGHT * span.norm())
        .then(|| UpAxis::from_index(axis, span[axis] > 0.0))
}

/// Index of the coordinate that all corners share within 5 % of the plate's size, if exactly one
/// does.
fn flat_axis(corners_m: &[Vector3<f64>]) -> Option<usize> {
    if corners_m.len() < 4 {
        return None;
    }
    let span = |axis: usize| {
        let values = corners_m.iter().map(|c| c[axis]);
        values.clone().fold(f64::NEG_INFINITY, f64::max) - values.fold(f64::INFINITY, f64::min)
    };
    let spans = Vector3::new(span(0), span(1), span(2));
    if !spans.iter().all(|s| s.is_finite()) {
        return None;
    }
    let thin = spans.imin();
    let others = (0..3).filter(|&axis| axis != thin).map(|axis| spans[axis]).fold(f64::INFINITY, f64::min);
    (others > 0.05 && spans[thin] < 0.05 * others).then_some(thin)
}

/// Rotates markers, plates and laboratory vectors together and stores the rotation.
pub(crate) fn rotate(trial: &mut Trial, up: UpAxis) {
    if up == UpAxis::Z {
        return;
    }
    let world_from_source = up.world_from_source();
    for point in trial.markers.trajectories.iter_mut().flatten() {
        *point = world_from_source * *point;
    }
    for plate in &mut trial.plates {
        for vector in plate.corners_m.iter_mut().chain(&mut plate.force_n).chain(&mut plate.moment_nm) {
            *vector = world_from_source * *vector;
        }
    }
    let mut own_axes = 0;
    for computed in &mut trial.computed {
        if computed.in_laboratory_axes() {
            for value in &mut computed.values {
                *value = world_from_source * *value;
            }
        } else if computed.is_vector() {
            own_axes += 1;
        }
    }
    if own_axes > 0 {
        trial.warn(WarningKind::Axes, format!(
            "{own_axes} computed forces and moments keep their own axes: the source does not say that they are in laboratory axes"
        ));
    }
    trial.world_from_source = world_from_source * trial.world_from_source;
}

#[cfg(test)]
mod tests {
    use super::*;

    const ALL: [UpAxis; 6] = [UpAxis::X, UpAxis::Y, UpAxis::Z, UpAxis::NegX, UpAxis::NegY, UpAxis::NegZ];

    #[test]
    fn every_up_axis_is_a_proper_rotation_to_z() {
        for up in ALL {
            let r = up.world_from_source();
            assert_eq!(r.matrix().determinant(), 1.0, "{up}");
            assert_eq!(r * r.inverse(), Rotation3::identity(), "{up}");
            let mut axis = Vector3::zeros();
            let index = match up {
                UpAxis::X | UpAxis::NegX => 0,
                UpAxis::Y | UpAxis::NegY => 1,
                UpAxis::Z | UpAxis::NegZ => 2,
            };
            axis[index] = if up.to_string().starts_with('+') { 1.0 } else { -1.0 };
            assert_eq!(r * axis, Vector3::z(), "{up}");
            assert_eq!(UpAxis::parse(&up.to_string()), Some(up));
        }
    }

    #[test]
    fn y_up_keeps_forward_and_turns_right_into_minus_left() {
        let r = UpAxis::Y.world_from_source();
        assert_eq!(r * Vector3::x(), Vector3::x());
        assert_eq!(r * Vector3::z(), -Vector3::y());
    }
}
