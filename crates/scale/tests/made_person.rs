//! Scaling of a synthetic person: conventions, invariances, and every combination of missing
//! markers.

#![allow(clippy::unwrap_used, reason = "helpers of tests fail by panicking")]

use aloft_body::{ModelSpec, PersonFacts, Sex, State};
use aloft_scale::{Anthropometry, PersonInput, ScaleError, ScaleOptions, ScaleWarning, Scaled, scale_person};
use aloft_trial::{MarkerSet, Markers, Trial};
use nalgebra::{Rotation3, Vector3};
use std::path::PathBuf;

fn config<T: serde::de::DeserializeOwned>(path: &str) -> T {
    let root = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../../configs");
    serde_yaml::from_str(&std::fs::read_to_string(root.join(path)).unwrap()).unwrap()
}

/// Right-side and central markers of a person of 1.70 m who faces +x, knees bent by 10°, elbows by
/// 20°; the left is the mirror.
fn right_side() -> Vec<(&'static str, [f64; 3])> {
    vec![
        ("RFHD", [0.09, -0.06, 1.60]),
        ("RBHD", [-0.09, -0.06, 1.60]),
        ("C7", [-0.08, 0.0, 1.45]),
        ("T10", [-0.11, 0.0, 1.22]),
        ("CLAV", [0.06, 0.0, 1.39]),
        ("STRN", [0.10, 0.0, 1.23]),
        ("RSHO", [0.0, -0.16, 1.42]),
        ("RELB", [-0.02, -0.22, 1.10]),
        ("RELM", [-0.02, -0.14, 1.10]),
        ("RWRA", [0.07, -0.21, 0.86]),
        ("RWRB", [0.07, -0.15, 0.86]),
        ("RFIN", [0.10, -0.18, 0.79]),
        ("RASI", [0.05, -0.12, 0.97]),
        ("RPSI", [-0.11, -0.045, 1.0]),
        ("RTHI", [0.03, -0.17, 0.70]),
        ("RKNE", [0.03, -0.14, 0.49]),
        ("RKNM", [0.03, -0.04, 0.49]),
        ("RTIB", [-0.01, -0.15, 0.30]),
        ("RANK", [-0.04, -0.13, 0.075]),
        ("RANM", [-0.04, -0.05, 0.075]),
        ("RHEE", [-0.09, -0.09, 0.03]),
        ("RTOE", [0.09, -0.09, 0.04]),
    ]
}

fn person() -> Vec<(String, Vector3<f64>)> {
    let mut out = Vec::new();
    for (label, p) in right_side() {
        out.push((label.to_owned(), Vector3::from(p)));
        if let Some(rest) = label.strip_prefix('R') {
            out.push((format!("L{rest}"), Vector3::new(p[0], -p[1], p[2])));
        }
    }
    out
}

fn trial(points: &[(String, Vector3<f64>)]) -> Trial {
    let n = 60;
    Trial {
        name: "made".into(),
        markers: Markers {
            rate_hz: 100.0,
            first_frame: 1,
            n_frames: n,
            labels: points.iter().map(|(l, _)| l.clone()).collect(),
            trajectories: points.iter().map(|(_, p)| vec![*p; n]).collect(),
        },
        ..Trial::default()
    }
}

fn scale(trial: &Trial) -> Result<Scaled, ScaleError> {
    let facts = PersonFacts { name: "made".into(), sex: Some(Sex::Male), height_m: Some(1.70), mass_kg: 70.0 };
    let spec: ModelSpec = config("models/human34.yaml");
    let set: MarkerSet = config("markersets/plug-in-gait-35.yaml");
    let tables: Anthropometry = config("anthropometry/de_leva.yaml");
    let input = PersonInput { facts: &facts, model_spec: &spec, marker_set: &set, static_trial: trial, frames: None };
    scale_person(&input, &tables, &ScaleOptions::default())
}

fn angle(s: &Scaled, link: &str) -> f64 {
    let l = &s.subject.model.links[s.subject.model.link_index(link).unwrap()];
    s.subject.static_q[l.joint.q_offset].to_degrees()
}

#[test]
fn signs_and_zeros_of_hinges() {
    let s = scale(&trial(&person())).unwrap();
    for side in ["r", "l"] {
        let knee = angle(&s, &format!("shank_{side}"));
        let elbow = angle(&s, &format!("forearm_{side}"));
        assert!((-25.0..-5.0).contains(&knee), "flexion of the knee is negative: {knee}");
        assert!((10.0..35.0).contains(&elbow), "flexion of the elbow is positive: {elbow}");
    }
    // At zero a limb is straight: the shank's y is as close to the thigh's as a rotation about the
    // hinge allows.
    let shank = &s.subject.model.links[s.subject.model.link_index("shank_r").unwrap()].joint.parent_from_joint.rotation;
    let (y, x) = (shank * Vector3::y(), shank * Vector3::x());
    assert!(y.y > 0.99 && x.y.abs() < 1e-12);
    assert_eq!(s.report.warnings, [ScaleWarning::MarkerUnseen { marker: "RBAK".into() }]);
    assert!(s.locked.is_empty());
}

#[test]
fn axes_point_forward_up_and_right() {
    let s = scale(&trial(&person())).unwrap();
    let mut state = State::new(&s.subject.model);
    state.forward_position(&s.subject.model, &s.subject.static_q);
    for (link, pose) in s.subject.model.links.iter().zip(&state.world_from_link) {
        let r = pose.rotation.to_rotation_matrix().into_inner();
        assert!(r[(0, 0)] > 0.6, "{}: x is forward", link.name);
        assert!(r[(2, 1)] > 0.6, "{}: y is up", link.name);
        assert!(r[(1, 2)] < -0.6, "{}: z is to the right", link.name);
    }
}

#[test]
fn a_mirrored_person_has_a_mirrored_model() {
    // Start from an asymmetric person.
    let mut points = person();
    for (k, (_, p)) in points.iter_mut().enumerate() {
        *p += Vector3::new((k % 5) as f64, (k % 7) as f64, (k % 3) as f64) * 2e-3;
    }
    let swap =
        |l: &str| match l.strip_prefix('R').map(|r| format!("L{r}")).or(l.strip_prefix('L').map(|r| format!("R{r}"))) {
            Some(other) if points.iter().any(|(o, _)| *o == other) => other,
            _ => l.to_owned(),
        };
    let mirrored: Vec<_> = points.iter().map(|(l, p)| (swap(l), Vector3::new(p.x, -p.y, p.z))).collect();
    let (a, b) = (scale(&trial(&points)).unwrap(), scale(&trial(&mirrored)).unwrap());
    let other = |name: &str| match name.rsplit_once('_') {
        Some((stem, "r")) => format!("{stem}_l"),
        Some((stem, "l")) => format!("{stem}_r"),
        _ => name.to_owned(),
    };
    for (i, link) in a.subject.model.links.iter().enumerate() {
        let j = b.subject.model.link_index(&other(&link.name)).unwrap();
        let (p, q) = (
            link.joint.parent_from_joint.translation.vector,
            b.subject.model.links[j].joint.parent_from_joint.translation.vector,
        );
        assert!((p - Vector3::new(q.x, q.y, -q.z)).norm() < 1e-9, "{}", link.name);
        let (m, n) = (&a.subject.prior[i], &b.subject.prior[j]);
        assert!((m.mass_kg - n.mass_kg).abs() < 1e-9);
        assert!((m.com_m - Vector3::new(n.com_m.x, n.com_m.y, -n.com_m.z)).norm() < 1e-9, "{}", link.name);
        assert!((m.inertia_com_kgm2[(0, 2)] + n.inertia_com_kgm2[(0, 2)]).abs() < 1e-9);
        assert!((m.inertia_com_kgm2[(0, 1)] - n.inertia_com_kgm2[(0, 1)]).abs() < 1e-9);
    }
}

#[test]
fn where_and_which_way_a_person_stands_does_not_matter() {
    let turn = Rotation3::from_euler_angles(0.0, 0.0, 2.1);
    let moved: Vec<_> = person().into_iter().map(|(l, p)| (l, turn * p + Vector3::new(3.0, -1.0, 0.2))).collect();
    let (a, b) = (scale(&trial(&person())).unwrap(), scale(&trial(&moved)).unwrap());
    for (x, y) in a.subject.markers.iter().zip(&b.subject.markers) {
        assert!((x.position_m - y.position_m).norm() < 1e-9, "{}", x.label);
    }
    for (x, y) in a.subject.prior.iter().zip(&b.subject.prior) {
        assert!((x.com_m - y.com_m).norm() < 1e-9 && (x.inertia_com_kgm2 - y.inertia_com_kgm2).norm() < 1e-9);
    }
}

#[test]
fn exchanged_markers_are_noticed() {
    let exchange = |a: &str, b: &str| {
        let mut points = person();
        let at = |l: &str| points.iter().position(|(o, _)| o == l).unwrap();
        let (i, j) = (at(a), at(b));
        let p = points[i].1;
        points[i].1 = points[j].1;
        points[j].1 = p;
        scale(&trial(&points)).unwrap().report.warnings
    };
    let has = |w: &[ScaleWarning], test: fn(&ScaleWarning) -> bool| w.iter().any(test);
    assert!(has(&exchange("LASI", "RASI"), |w| matches!(w, ScaleWarning::SidesExchanged { .. })));
    assert!(has(&exchange("LSHO", "RSHO"), |w| matches!(w, ScaleWarning::SidesExchanged { .. })));
    assert!(has(&exchange("RHEE", "RTOE"), |w| matches!(w, ScaleWarning::BackToFront { .. })));
    assert!(has(&exchange("RHEE", "RANK"), |w| matches!(w, ScaleWarning::MarkerAsymmetry { .. })));
    let feet = exchange("RHEE", "RANK");
    let named = |w: &ScaleWarning| matches!(w, ScaleWarning::AnkleBehindHeel { ankle, .. } if ankle == "RANK");
    assert!(feet.iter().any(named), "{feet:?}");
    assert!(!exchange("LSHO", "RSHO").iter().any(|w| matches!(w, ScaleWarning::AnkleBehindHeel { .. })));
    for w in exchange("LASI", "RASI") {
        assert!(!w.to_string().is_empty());
    }
}

/// For any set of markers missing, coincident or far away, the result is a model or an error, never
/// a panic or a NaN.
#[test]
fn missing_or_senseless_markers_never_break_scaling() {
    let mut seed = 12345_u64;
    let mut random = || {
        seed = seed.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
        (seed >> 33) as f64 / (1u64 << 31) as f64
    };
    let (mut good, mut bad) = (0, 0);
    for round in 0..400 {
        let share = random();
        let mut points = person();
        for (label, p) in &mut points {
            let keep_pelvis = round % 2 == 0 && ["LASI", "RASI", "LPSI", "RPSI"].contains(&label.as_str());
            if random() < share && !keep_pelvis {
                *p = match (random() * 4.0) as usize {
                    0 => Vector3::zeros(),
                    1 => Vector3::new(1e6, 0.0, -1e6),
                    _ => Vector3::repeat(f64::NAN),
                };
            }
        }
        match scale(&trial(&points)) {
            Ok(s) => {
                good += 1;
                assert!(s.subject.static_q.iter().all(|x| x.is_finite()));
                assert!(s.subject.markers.iter().all(|m| m.position_m.iter().all(|x| x.is_finite())));
                assert!(s.subject.prior.iter().all(|p| p.to_phi().iter().all(|x| x.is_finite()) && p.mass_kg > 0.0));
                let text = serde_json::to_string(&s).unwrap();
                serde_json::from_str::<Scaled>(&text).unwrap();
            }
            Err(e) => {
                bad += 1;
                assert!(!e.to_string().is_empty());
            }
        }
    }
    assert!(good > 100 && bad > 20, "{good} scaled, {bad} refused");
}
