//! Segment poses of markerless software as virtual markers.
//!
//! A pose has six numbers, and so have three points that are rigidly attached to the segment. Four
//! are made, the origin and one on each axis: everything after import (inverse kinematics,
//! calibration, quality, pictures) then treats a pose as it treats a cluster of markers, and no
//! weight between metres and radians has to be chosen. With arms of 0.1 m an error of 1° in
//! orientation counts as 1.7 mm.
//!
//! Axes are those of Visual3D and Theia3D: x to the right, y forwards, z towards the proximal end,
//! origin at the proximal joint.

use crate::{Trial, Warning, WarningKind};
use aloft_c3d::{C3dFile, SegmentTrack};
use nalgebra::{Matrix3, Vector3};

/// Distance of the virtual markers from the segment's origin, m.
pub const ARM_M: f64 = 0.1;
/// Ending of the labels of poses.
const ENDING: &str = "_4X4";
/// The laboratory itself, which some files list as a segment.
const WORLD: &str = "worldbody";
/// Points on the axis of a joint that turns about the x axis of the parent while the child's own
/// axes turn on (the elbow, since the forearm pronates): label, child, parent.
const HINGES: [(&str, &str, &str); 2] = [("r_elbow.x", "r_larm", "r_uarm"), ("l_elbow.x", "l_larm", "l_uarm")];
/// Largest deviation of R'R from the identity in a rotation.
const ORTHOGONAL: f64 = 1e-2;

/// One segment: orientation and origin in each frame, m.
struct Segment {
    label: String,
    poses: Vec<Option<(Matrix3<f64>, Vector3<f64>)>>,
}

impl Segment {
    fn of(track: &SegmentTrack, ratio: usize, metres: f64) -> (Self, usize) {
        let label = track.label.trim();
        let label = match label.len().checked_sub(ENDING.len()).and_then(|at| label.split_at_checked(at)) {
            Some((stem, end)) if end.eq_ignore_ascii_case(ENDING) => stem,
            _ => label,
        };
        let mut odd = 0;
        let frames = track.matrix.iter().zip(&track.reliability).step_by(ratio.max(1));
        let poses = frames
            .map(|(m, reliability)| {
                let m = m.map(f64::from);
                if *reliability < 0.0 || m.iter().any(|x| !x.is_finite()) {
                    return None;
                }
                let rotation = Matrix3::new(m[0], m[4], m[8], m[1], m[5], m[9], m[2], m[6], m[10]);
                let skew = (rotation.transpose() * rotation - Matrix3::identity()).abs().max();
                if skew > ORTHOGONAL || rotation.determinant() < 0.0 {
                    odd += 1;
                    return None;
                }
                Some((rotation, Vector3::new(m[12], m[13], m[14]) * metres))
            })
            .collect();
        (Self { label: label.to_owned(), poses }, odd)
    }

    fn track(&self, at: Vector3<f64>) -> Vec<Vector3<f64>> {
        let missing = Vector3::repeat(f64::NAN);
        self.poses.iter().map(|p| p.map_or(missing, |(r, o)| r * at + o)).collect()
    }
}

/// Adds the virtual markers of a file's segments, in source axes. A recording without points takes
/// frames and rate from the poses.
pub(crate) fn add_segments(trial: &mut Trial, file: &C3dFile, metres: f64) {
    let poses = &file.poses;
    if poses.segments.is_empty() {
        return;
    }
    let alone = trial.markers.labels.is_empty();
    let ratio = if alone { 1 } else { poses.n_frames().checked_div(trial.markers.n_frames).unwrap_or(1).max(1) };
    let mut odd = 0;
    let segments: Vec<Segment> = poses
        .segments
        .iter()
        .map(|track| {
            let (segment, n) = Segment::of(track, ratio, metres);
            odd += n;
            segment
        })
        .filter(|s| !s.label.eq_ignore_ascii_case(WORLD))
        .collect();
    if odd > 0 {
        let message = format!("ROTATION: {odd} matrices are no rotations; these poses are missing");
        trial.warnings.push(Warning::new(WarningKind::Contradiction, message));
    }
    if alone {
        trial.markers.rate_hz = poses.rate_hz;
        trial.markers.n_frames = poses.n_frames();
    }
    let n_frames = trial.markers.n_frames;
    let mut add = |label: String, mut track: Vec<Vector3<f64>>| {
        track.resize(n_frames, Vector3::repeat(f64::NAN));
        trial.markers.labels.push(label);
        trial.markers.trajectories.push(track);
    };
    for segment in &segments {
        let arms = [
            ("o", Vector3::zeros()),
            ("x", Vector3::x() * ARM_M),
            ("y", Vector3::y() * ARM_M),
            ("z", Vector3::z() * ARM_M),
        ];
        for (name, at) in arms {
            add(format!("{}.{name}", segment.label), segment.track(at));
        }
    }
    let find = |label: &str| segments.iter().find(|s| s.label.eq_ignore_ascii_case(label));
    for (label, child, parent) in HINGES {
        let (Some(child), Some(parent)) = (find(child), find(parent)) else { continue };
        let track = child.poses.iter().zip(&parent.poses).map(|(c, p)| match (c, p) {
            (Some((_, origin)), Some((axes, _))) => origin + axes * Vector3::x() * ARM_M,
            _ => Vector3::repeat(f64::NAN),
        });
        add(label.to_owned(), track.collect());
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::Rotation3;

    fn pose(rotation: &Rotation3<f64>, at: [f32; 3]) -> [f32; 16] {
        let m = rotation.matrix();
        let mut out = [0.0_f32; 16];
        for column in 0..3 {
            for row in 0..3 {
                out[4 * column + row] = m[(row, column)] as f32;
            }
        }
        [out[12], out[13], out[14], out[15]] = [at[0], at[1], at[2], 1.0];
        out
    }

    #[test]
    fn a_pose_becomes_four_points_that_turn_with_the_segment() {
        let turn = Rotation3::from_euler_angles(0.3, -0.2, 1.1);
        let good = pose(&turn, [100.0, 200.0, 900.0]);
        let mut bad = good;
        bad[0] *= 2.0;
        let track = SegmentTrack {
            label: "r_larm_4X4".into(),
            matrix: vec![good, bad, good, [f32::NAN; 16]],
            reliability: vec![0.5, 0.5, -1.0, 0.5],
        };
        let mut file = aloft_c3d::C3dBuilder::new(100.0).build().unwrap();
        let world = SegmentTrack { label: "worldbody_4X4".into(), ..track.clone() };
        file.poses = aloft_c3d::SegmentPoses { rate_hz: 100.0, segments: vec![world, track] };
        let mut trial = Trial::default();
        add_segments(&mut trial, &file, 1e-3);
        assert_eq!(trial.markers.labels, ["r_larm.o", "r_larm.x", "r_larm.y", "r_larm.z"]);
        assert_eq!((trial.markers.n_frames, trial.markers.rate_hz), (4, 100.0));
        let at = |i: usize, f: usize| trial.markers.trajectories[i][f];
        assert!((at(0, 0) - Vector3::new(0.1, 0.2, 0.9)).norm() < 1e-7);
        assert!((at(3, 0) - at(0, 0) - turn * Vector3::z() * ARM_M).norm() < 1e-7);
        assert!((1..4).all(|f| (0..4).all(|i| at(i, f).x.is_nan())), "no rotation, not reliable, not a number");
        assert_eq!(trial.warnings.len(), 1);
    }
}
