//! Calibration of synthetic people with known joints, started from wrong ones.

#![allow(clippy::unwrap_used, reason = "a test may panic")]

mod common;

use aloft_body::{JointKind, State, Subject};
use aloft_ik::{CalibrateOptions, GeometryError, calibrate};
use aloft_trial::Trial;
use common::{chain, motion, person, trial};
use nalgebra::{Rotation3, UnitQuaternion, Vector3};
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, Normal};

/// Displaces joints and rotates hinges as wrong landmarks would: every marker stays in place in the
/// static posture.
fn spoil(truth: &Subject, centre_sd_m: f64, axis_sd_rad: f64, seed: u64) -> Subject {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let normal = Normal::new(0.0, 1.0).unwrap();
    let mut subject = truth.clone();
    for i in 1..subject.model.n_links() {
        let mut state = State::new(&subject.model);
        state.forward_position(&subject.model, &subject.static_q);
        let rotation = state.world_from_link[i].rotation;
        let parent = subject.model.links[i].parent.unwrap();
        let shift = Vector3::from_fn(|_, _| centre_sd_m * normal.sample(&mut rng));
        let mut turn = Rotation3::identity();
        if let JointKind::Revolute(_) = subject.model.links[i].joint.kind {
            let (a, b) = (normal.sample(&mut rng), normal.sample(&mut rng));
            turn = Rotation3::new(Vector3::new(a, b, 0.0) * axis_sd_rad);
            let theta = Rotation3::new(Vector3::z() * subject.static_q[subject.model.links[i].joint.q_offset]);
            let pose = &mut subject.model.links[i].joint.parent_from_joint;
            pose.rotation *= UnitQuaternion::from(theta * turn * theta.inverse());
        }
        let up = state.world_from_link[parent].rotation.inverse() * shift;
        subject.model.links[i].joint.parent_from_joint.translation.vector += up;
        let here = rotation.inverse() * shift;
        for marker in subject.markers.iter_mut().filter(|m| m.link == i) {
            marker.position_m = turn.inverse() * (marker.position_m - here);
        }
        for link in subject.model.links.iter_mut().filter(|l| l.parent == Some(i)) {
            let pose = &mut link.joint.parent_from_joint;
            pose.translation.vector = turn.inverse() * (pose.translation.vector - here);
            pose.rotation = UnitQuaternion::from(turn.inverse()) * pose.rotation;
        }
    }
    subject
}

/// Joint centres in the static posture.
fn centres(subject: &Subject) -> Vec<Vector3<f64>> {
    let mut state = State::new(&subject.model);
    state.forward_position(&subject.model, &subject.static_q);
    state.world_from_link.iter().map(|p| p.translation.vector).collect()
}

/// Root mean square distance of the joint centres that markers on both sides determine. Excluded
/// are the root, the elbows (an upper arm with one marker may rotate about the line from shoulder
/// to marker) and the component along a hinge.
fn error(truth: &Subject, other: &Subject) -> f64 {
    let mut state = State::new(&truth.model);
    state.forward_position(&truth.model, &truth.static_q);
    let (a, b) = (centres(truth), centres(other));
    let (mut sum, mut count) = (0.0, 0);
    for i in 1..a.len() {
        if truth.model.links[i].name.starts_with("forearm") {
            continue;
        }
        let mut gap = b[i] - a[i];
        if let JointKind::Revolute(axis) = truth.model.links[i].joint.kind {
            let axis = state.world_from_link[i].rotation * axis.into_inner();
            gap -= axis * axis.dot(&gap);
        }
        sum += gap.norm_squared();
        count += 1;
    }
    (sum / f64::from(count)).sqrt()
}

fn trials(subject: &Subject, noise_m: f64) -> Vec<Trial> {
    (0..4)
        .map(|i| {
            let mut made = trial(subject, &motion(subject, 300, 100.0, 0.5, 20 + i), 100.0, noise_m, 30 + i);
            made.name = format!("made{i}");
            made
        })
        .collect()
}

#[test]
fn wrong_joints_are_put_right() {
    let truth = person();
    let wrong = spoil(&truth, 0.010, 0.05, 1);
    // Every marker is still in its place in the static posture.
    let markers = |s: &Subject| {
        let mut state = State::new(&s.model);
        state.forward_position(&s.model, &s.static_q);
        s.markers.iter().map(|m| state.point_in_world(m.link, &m.position_m)).collect::<Vec<_>>()
    };
    for (a, b) in markers(&truth).iter().zip(&markers(&wrong)) {
        assert!((a - b).norm() < 1e-12);
    }
    let trials = trials(&truth, 5e-4);
    let trials: Vec<&Trial> = trials.iter().collect();
    let options = CalibrateOptions { marker_noise_m: 5e-4, frame_weight: 1.0, ..CalibrateOptions::default() };
    let result = calibrate(&wrong, &trials, &options).unwrap();
    let (before, after) = (error(&truth, &wrong), error(&truth, &result.subject));
    assert!(before > 0.012, "{before}");
    assert!(after < 0.001, "joint centres wrong by {after} m after calibration, {before} m before");
    let report = &result.report;
    assert!(report.held_out_rms_before_m > 3e-3 && report.held_out_rms_after_m < 1.0e-3);
    for joint in &report.joints {
        assert!(joint.sd_m > 0.0 && joint.sd_m < 0.005, "{joint:?}");
    }
    // Hinges still rotate about z of their link, and mass is conserved.
    for (old, new) in wrong.model.links.iter().zip(&result.subject.model.links) {
        assert_eq!(old.joint.kind, new.joint.kind);
        assert!((new.joint.parent_from_joint.rotation.norm() - 1.0).abs() < 1e-12);
    }
    let mass = |s: &Subject| s.prior.iter().map(|p| p.mass_kg).sum::<f64>();
    assert!((mass(&wrong) - mass(&result.subject)).abs() < 1e-12);
}

#[test]
fn right_joints_stay() {
    let truth = person();
    let trials = trials(&truth, 3e-4);
    let trials: Vec<&Trial> = trials.iter().collect();
    let result = calibrate(&truth, &trials, &CalibrateOptions::default()).unwrap();
    assert!(error(&truth, &result.subject) < 1e-3, "moved by {} m", error(&truth, &result.subject));
}

#[test]
fn chain_hinge_is_found() {
    let truth = chain();
    let wrong = spoil(&truth, 0.010, 0.1, 3);
    let trials = trials(&truth, 3e-4);
    let trials: Vec<&Trial> = trials.iter().collect();
    let options = CalibrateOptions { marker_noise_m: 3e-4, frame_weight: 1.0, ..CalibrateOptions::default() };
    let result = calibrate(&wrong, &trials, &options).unwrap();
    // Perpendicular to the axis, because the position along a hinge cannot be observed.
    let mut state = State::new(&truth.model);
    state.forward_position(&truth.model, &truth.static_q);
    let axis = state.world_from_link[1].rotation * Vector3::z();
    let gap = centres(&truth)[1] - centres(&result.subject)[1];
    let across = gap - axis * axis.dot(&gap);
    assert!(across.norm() < 3e-4, "hinge off by {across:?}");
    state.forward_position(&result.subject.model, &result.subject.static_q);
    let found = state.world_from_link[1].rotation * Vector3::z();
    assert!(found.angle(&axis) < 5e-3, "axis off by {} rad", found.angle(&axis));
}

/// Skin that moves over bone with the time course of the motion, in the axes of the link.
fn with_skin(truth: &Subject, size_m: f64, seed: u64) -> Vec<Trial> {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let normal = Normal::new(0.0, 1.0).unwrap();
    let of_marker: Vec<[Vector3<f64>; 2]> = truth
        .markers
        .iter()
        .map(|_| [0; 2].map(|_| Vector3::from_fn(|_, _| size_m * normal.sample(&mut rng))))
        .collect();
    let mut state = State::new(&truth.model);
    (0..4)
        .map(|i| {
            let postures = motion(truth, 300, 100.0, 0.5, seed + 20 + i);
            let mut made = trial(truth, &postures, 100.0, 3e-4, seed + 30 + i);
            made.name = format!("made{i}");
            for (f, q) in postures.iter().enumerate() {
                state.forward_position(&truth.model, q);
                let t = f as f64 / 100.0;
                for ((marker, [a, b]), places) in
                    truth.markers.iter().zip(&of_marker).zip(&mut made.markers.trajectories)
                {
                    let rotation = state.world_from_link[marker.link].rotation;
                    places[f] += rotation * (a * (3.0 * t).sin() + b * (7.0 * t + f64::from(i as u32)).cos());
                }
            }
            made
        })
        .collect()
}

#[test]
fn drawn_errors_of_the_geometry_are_as_large_as_the_true_ones() {
    let truth = person();
    let options = CalibrateOptions { frames: 100, rounds: 2, ..CalibrateOptions::default() };
    let (mut right, mut drawn) = (0.0, 0.0);
    for seed in [100, 200, 300, 400] {
        let wrong = spoil(&truth, 0.006, 0.03, seed);
        let trials = with_skin(&truth, 0.002, seed);
        let result = calibrate(&wrong, &trials.iter().collect::<Vec<_>>(), &options).unwrap();
        right += error(&truth, &result.subject).powi(2) / 4.0;
        assert_eq!(result.errors.len(), 8);
        for draw in &result.errors {
            let other = draw.applied(&result.subject).unwrap();
            drawn += error(&result.subject, &other).powi(2) / 32.0;
        }
    }
    let ratio = (right / drawn).sqrt();
    assert!((0.6..1.6).contains(&ratio), "true {} m, drawn {} m", right.sqrt(), drawn.sqrt());
}

#[test]
fn another_geometry_moves_joints_and_markers_by_its_error_and_keeps_the_posture() {
    let subject = person();
    let draws = GeometryError::of_landmarks(&subject, &CalibrateOptions::default()).unwrap();
    let mut draw = draws[3].clone();
    draw.marker_m.iter_mut().enumerate().for_each(|(m, e)| *e = Vector3::new(1e-3, -2e-3, 1e-4 * m as f64));
    let other = draw.applied(&subject).unwrap();
    let places = |s: &Subject| {
        let mut state = State::new(&s.model);
        state.forward_position(&s.model, &s.static_q);
        let markers: Vec<_> = s.markers.iter().map(|m| state.point_in_world(m.link, &m.position_m)).collect();
        (state.world_from_link, markers)
    };
    let ((links, markers), (moved, moved_markers)) = (places(&subject), places(&other));
    for i in 0..links.len() {
        let gap = moved[i].translation.vector - links[i].translation.vector - draw.centre_m[i];
        assert!(gap.norm() < 1e-12, "{}: {gap}", subject.model.links[i].name);
        assert!(moved[i].rotation.angle_to(&links[i].rotation) < 1e-12);
        if let (JointKind::Revolute(a), JointKind::Revolute(b)) =
            (subject.model.links[i].joint.kind, other.model.links[i].joint.kind)
        {
            let turned = moved[i].rotation * b.into_inner();
            let expected = (links[i].rotation * a.into_inner() + draw.axis[i]).normalize();
            assert!((turned - expected).norm() < 1e-12 && draw.axis[i].norm() > 1e-4);
        }
    }
    for ((a, b), error) in markers.iter().zip(&moved_markers).zip(&draw.marker_m) {
        assert!((b - a - error).norm() < 1e-12);
    }
    draw.centre_m.pop();
    assert!(draw.applied(&subject).is_err());
}

#[test]
fn same_calibration_at_any_number_of_threads() {
    let truth = person();
    let wrong = spoil(&truth, 0.005, 0.02, 4);
    let trials = trials(&truth, 1e-3);
    let trials: Vec<&Trial> = trials.iter().collect();
    let options = CalibrateOptions { frames: 60, rounds: 1, ..CalibrateOptions::default() };
    let run = |threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| calibrate(&wrong, &trials, &options).unwrap().subject)
    };
    assert_eq!(run(1), run(3));
}

#[test]
fn regress_nothing_to_calibrate_is_an_error() {
    let truth = person();
    let mut still = trial(&truth, &motion(&truth, 3, 100.0, 0.1, 1), 100.0, 0.0, 1);
    still.markers.trajectories.iter_mut().flatten().for_each(|p| *p = Vector3::repeat(f64::NAN));
    assert!(matches!(
        calibrate(&truth, &[&still], &CalibrateOptions::default()),
        Err(aloft_ik::IkError::NothingToCalibrate { trials: 1, .. })
    ));
    assert!(calibrate(&truth, &[], &CalibrateOptions::default()).is_err());
}
