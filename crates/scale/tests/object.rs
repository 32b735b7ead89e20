//! Scaling of the two-link chain against the simulator's truth. The recordings may be absent.

#![allow(clippy::unwrap_used, reason = "helpers of tests fail by panicking")]
#![allow(clippy::print_stdout, reason = "tests say what they skip and what they measured")]

#[path = "../../../tests/shared_data.rs"]
mod shared_data;

use aloft_body::State;
use aloft_scale::{ObjectInput, ObjectOptions, ObjectSpec, ScaledObject, scale_object};
use aloft_trial::{ImportOptions, Markers, Trial};
use nalgebra::{Isometry3, Matrix3, Rotation3, Translation3, UnitQuaternion, Vector3};
use std::path::PathBuf;

fn root() -> PathBuf {
    PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../..")
}

fn spec() -> ObjectSpec {
    serde_yaml::from_str(&std::fs::read_to_string(root().join("configs/objects/two_link_chain.yaml")).unwrap()).unwrap()
}

fn trial(set: &str, name: &str) -> Option<Trial> {
    let bytes = std::fs::read(shared_data::shared_data(&format!("{set}/{name}.c3d"))?).unwrap();
    Some(Trial::from_c3d(name, &bytes, &ImportOptions::default()).unwrap())
}

#[derive(serde::Deserialize)]
struct Hinge {
    p_link0: [f64; 3],
    #[serde(rename = "R_link0_link1_q0")]
    r: [[f64; 3]; 3],
}

#[derive(serde::Deserialize)]
struct Truth {
    hinge: Hinge,
    markers_link0_m: Vec<[f64; 3]>,
    markers_link1_m: Vec<[f64; 3]>,
}

struct Errors {
    centre_mm: f64,
    axis_mrad: f64,
    zero_mrad: f64,
    marker_mm: f64,
}

fn errors(found: &ScaledObject, set: &str) -> Errors {
    let path = shared_data::shared_data(&format!("{set}/truth/truth.json")).unwrap();
    let truth: Truth = serde_json::from_str(&std::fs::read_to_string(path).unwrap()).unwrap();
    let joint = &found.subject.model.links[1].joint.parent_from_joint;
    let r = Matrix3::from_fn(|i, j| truth.hinge.r[i][j]);
    let mine = joint.rotation.to_rotation_matrix().into_inner();
    let turn = Rotation3::from_matrix_unchecked(r.transpose() * mine).scaled_axis();
    let true_markers = truth.markers_link0_m.iter().chain(&truth.markers_link1_m);
    Errors {
        centre_mm: 1e3 * (joint.translation.vector - Vector3::from(truth.hinge.p_link0)).norm(),
        axis_mrad: 1e3 * turn.xy().norm(),
        zero_mrad: 1e3 * turn.z.abs(),
        marker_mm: found
            .subject
            .markers
            .iter()
            .zip(true_markers)
            .map(|(m, t)| 1e3 * (m.position_m - Vector3::from(*t)).norm())
            .fold(0.0, f64::max),
    }
}

fn scaled(set: &str, motion: &[&str]) -> Option<ScaledObject> {
    let still = trial(set, "static")?;
    let motion: Vec<Trial> = motion.iter().map(|n| trial(set, n)).collect::<Option<_>>()?;
    let motion: Vec<&Trial> = motion.iter().collect();
    let start = std::time::Instant::now();
    let found = scale_object(
        &ObjectInput { spec: &spec(), static_trial: &still, motion_trials: &motion },
        &ObjectOptions::default(),
    )
    .unwrap();
    let e = errors_if_known(&found, set);
    println!(
        "{set}: {} frames, {} iterations, noise {:.3} mm, outliers {}, first guess {:.2} mm, range {:.0?}°{e}; {:.2} s",
        found.report.frames,
        found.report.iterations,
        1e3 * found.report.noise_m,
        found.report.outliers,
        1e3 * found.report.joints[0].first_guess_rms_m,
        (found.report.joints[0].range_rad.0.to_degrees(), found.report.joints[0].range_rad.1.to_degrees()),
        start.elapsed().as_secs_f64(),
    );
    Some(found)
}

fn errors_if_known(found: &ScaledObject, set: &str) -> String {
    if set == "chain_b" {
        return String::new();
    }
    let e = errors(found, set);
    format!(
        "; hinge {:.4} mm, axis {:.3} mrad, zero {:.3} mrad, worst marker {:.4} mm",
        e.centre_mm, e.axis_mrad, e.zero_mrad, e.marker_mm
    )
}

#[test]
fn validate_the_chains_geometry_against_the_simulators_truth() {
    for set in ["chain_a", "chain_p"] {
        let Some(found) = scaled(set, &["hinge_calib"]) else { return };
        let e = errors(&found, set);
        assert!(e.centre_mm < 0.1 && e.axis_mrad < 0.5 && e.zero_mrad < 0.5 && e.marker_mm < 0.1, "{set}");
        assert!((found.report.noise_m - 3e-4).abs() < 2e-5);
        assert_eq!(found.report.outliers, 0);
        assert!(found.report.warnings.is_empty(), "{:?}", found.report.warnings);
        let mass: f64 = found.subject.prior.iter().map(|p| p.mass_kg).sum();
        assert!((mass - 0.997).abs() < 1e-12);
        for p in &found.subject.prior {
            println!("  prior {:.3} kg at {:?}", p.mass_kg, p.com_m.as_slice());
        }
        // Including the throws.
        let all = ["hinge_calib", "throws_01", "throws_02", "throws_03", "throws_04", "throws_05"];
        let Some(found) = scaled(set, &all) else { return };
        let e = errors(&found, set);
        assert!(e.centre_mm < 0.05 && e.axis_mrad < 0.3 && e.zero_mrad < 0.3 && e.marker_mm < 0.05, "{set}");
    }
    scaled("chain_b", &["hinge_calib"]);
}

#[test]
fn a_specification_that_contradicts_itself_is_refused_with_its_link() {
    let still = Trial::default();
    let refuse = |change: &dyn Fn(&mut ObjectSpec)| {
        let mut s = spec();
        change(&mut s);
        scale_object(&ObjectInput { spec: &s, static_trial: &still, motion_trials: &[] }, &ObjectOptions::default())
            .unwrap_err()
            .to_string()
    };
    assert!(refuse(&|s| s.links[1].parent = Some("nothing".into())).contains("link1"));
    assert!(refuse(&|s| s.links[1].joint = None).contains("joint"));
    assert!(refuse(&|s| s.links[0].markers.truncate(2)).contains("three"));
    assert!(refuse(&|s| s.links[1].markers.push("L0_1".into())).contains("twice"));
    assert!(refuse(&|s| s.links[1].frame = s.links[0].frame.clone()).contains("hinge"));
    assert!(refuse(&|s| s.total_mass_kg = -1.0).contains("mass"));
    assert!(refuse(&|s| s.links.clear()).contains("no links"));
    assert!(refuse(&|_| ()).contains("no marker frames"));
}

/// A base, an arm on a hinge and a tip on a ball joint, without noise: the geometry is recovered to
/// the rounding of the solver.
#[test]
fn a_made_object_with_hinge_and_ball_is_recovered_exactly() {
    let text = "
name: made
total_mass_kg: 2.0
links:
  - {name: base, markers: [A1, A2, A3, A4], frame: {by: markers, origin: A1, y_axis: [A1, A2], z_side: A3}}
  - {name: arm, parent: base, markers: [B1, B2, B3, B4], joint: {type: hinge, positive_along_parent: [0, 0, -1]},
     frame: {by: hinge, x_plane: B1, side: positive}}
  - {name: tip, parent: arm, markers: [C1, C2, C3, C4], joint: {type: ball},
     frame: {by: markers, y_axis: [C1, C2], z_side: C3}, mass_fraction: 0.25}
";
    let spec: ObjectSpec = serde_yaml::from_str(text).unwrap();
    let base = [[0.0, 0.0, 0.0], [0.0, 0.2, 0.0], [0.0, 0.1, 0.08], [0.06, 0.15, 0.02]].map(Vector3::from);
    let hinge = Isometry3::from_parts(
        Translation3::new(0.03, -0.05, 0.01),
        UnitQuaternion::face_towards(&Vector3::new(0.1, 0.2, -1.0), &Vector3::y()),
    );
    // Origin of the arm's frame: the point of its axis nearest to the base's origin.
    let axis = hinge.rotation * Vector3::z();
    let hinge = Isometry3::from_parts(
        Translation3::from(hinge.translation.vector - axis * axis.dot(&hinge.translation.vector)),
        hinge.rotation,
    );
    let arm = [[0.2, 0.0, 0.02], [0.1, 0.05, 0.0], [0.15, -0.04, 0.03], [0.05, 0.03, -0.03]].map(Vector3::from);
    let ball = Vector3::new(0.25, 0.01, 0.0);
    let tip = [[0.02, -0.03, 0.01], [0.02, 0.06, 0.01], [0.02, 0.02, 0.07], [0.1, 0.01, -0.02]].map(Vector3::from);
    let frame = |t: f64, angle: f64, turn: Vector3<f64>| {
        let world_from_base = Isometry3::from_parts(
            Translation3::new(t.sin(), 0.3 * t.cos(), 1.0),
            UnitQuaternion::from_scaled_axis(Vector3::new(0.4 * t.sin(), 0.3 * t, (0.7 * t).cos())),
        );
        let world_from_arm = world_from_base * hinge * UnitQuaternion::from_scaled_axis(Vector3::z() * angle);
        let world_from_tip = world_from_arm * Translation3::from(ball) * UnitQuaternion::from_scaled_axis(turn);
        let put = |pose: &Isometry3<f64>, p: &Vector3<f64>| pose.transform_point(&(*p).into()).coords;
        base.iter()
            .map(|p| put(&world_from_base, p))
            .chain(arm.iter().map(|p| put(&world_from_arm, p)))
            .chain(tip.iter().map(|p| put(&world_from_tip, p)))
            .collect::<Vec<_>>()
    };
    let labels: Vec<String> = ["A", "B", "C"].iter().flat_map(|s| (1..=4).map(move |k| format!("{s}{k}"))).collect();
    let record = |name: &str, frames: Vec<Vec<Vector3<f64>>>| Trial {
        name: name.into(),
        markers: Markers {
            rate_hz: 100.0,
            first_frame: 1,
            n_frames: frames.len(),
            labels: labels.clone(),
            trajectories: (0..12).map(|m| frames.iter().map(|f| f[m]).collect()).collect(),
        },
        ..Trial::default()
    };
    // The ball's rest rotation: zero when the tip's axes, as its markers define them, are the
    // arm's.
    let rest = Vector3::new(0.1, -0.2, 0.3);
    let still = record("still", vec![frame(0.4, 0.0, rest); 50]);
    let motion = record(
        "motion",
        (0..300)
            .map(|i| {
                let t = 0.05 * f64::from(i);
                let mut f = frame(
                    t,
                    1.2 * (1.7 * t).sin(),
                    Vector3::new(t.cos(), 0.8 * (1.1 * t).sin(), 0.5 * (0.6 * t).sin()),
                );
                if i % 7 == 0 {
                    f[(i % 12) as usize] = Vector3::repeat(f64::NAN);
                }
                f
            })
            .collect(),
    );
    let input = ObjectInput { spec: &spec, static_trial: &still, motion_trials: &[&motion] };
    let found = scale_object(&input, &ObjectOptions::default()).unwrap();
    assert!(found.report.noise_m < 1e-9, "{}", found.report.noise_m);
    let links = &found.subject.model.links;
    let at = |i: usize| links[i].joint.parent_from_joint;
    assert!((at(1).translation.vector - hinge.translation.vector).norm() < 1e-8);
    assert!(at(1).rotation.angle_to(&hinge.rotation) < 1e-7);
    assert!((at(2).translation.vector - ball).norm() < 1e-8);
    for (m, t) in found.subject.markers.iter().zip(base.iter().chain(&arm).chain(&tip)) {
        if m.label.starts_with('C') {
            // The tip's frame is defined by its markers, at the ball.
            assert!((m.position_m.norm() - t.norm()).abs() < 1e-8);
        } else {
            assert!((m.position_m - t).norm() < 1e-8, "{}", m.label);
        }
    }
    assert!((found.subject.prior[2].mass_kg - 0.5).abs() < 1e-12);
    // The model at its static posture reproduces the static.
    let mut state = State::new(&found.subject.model);
    state.forward_position(&found.subject.model, &found.subject.static_q);
    for (m, t) in found.subject.markers.iter().zip(&still.markers.trajectories) {
        assert!((state.point_in_world(m.link, &m.position_m) - t[0]).norm() < 1e-8);
    }
}
