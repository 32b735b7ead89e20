//! A synthetic recording in every built-in marker set of people, from the static trial to joint
//! angles, with each model whose links the set marks.
#![allow(clippy::unwrap_used, clippy::print_stdout, reason = "tests fail by panicking and print what they measured")]

mod common;

use aloft_body::{ModelMarker, ModelSpec, PersonFacts, Sex, State, Subject};
use aloft_ik::{IkOptions, solve};
use aloft_scale::{Anthropometry, PersonInput, ScaleOptions, Scaled, scale_person};
use aloft_trial::{MarkerSet, Trial};
use nalgebra::Vector3;
use std::path::PathBuf;

fn configs() -> PathBuf {
    PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../../configs")
}

fn config<T: serde::de::DeserializeOwned>(path: &str) -> T {
    serde_yaml::from_str(&std::fs::read_to_string(configs().join(path)).unwrap()).unwrap()
}

/// Landmarks on the right and in the middle of a person of 1.70 m who stands facing +x, m.
const LANDMARKS: &[(&str, [f64; 3])] = &[
    ("vertex", [-0.01, 0.0, 1.715]),
    ("c7", [-0.08, 0.0, 1.45]),
    ("t10", [-0.11, 0.0, 1.22]),
    ("suprasternale", [0.06, 0.0, 1.39]),
    ("xiphoid", [0.10, 0.0, 1.23]),
    ("sacrum", [-0.11, 0.0, 1.0]),
    ("head_front_r", [0.09, -0.06, 1.60]),
    ("head_back_r", [-0.09, -0.06, 1.60]),
    ("acromion_r", [0.0, -0.16, 1.42]),
    ("elbow_lateral_r", [-0.02, -0.22, 1.10]),
    ("elbow_medial_r", [-0.02, -0.14, 1.10]),
    ("wrist_r", [0.07, -0.18, 0.87]),
    ("wrist_radial_r", [0.07, -0.21, 0.86]),
    ("wrist_ulnar_r", [0.07, -0.15, 0.86]),
    ("hand_distal_r", [0.10, -0.18, 0.79]),
    ("asis_r", [0.05, -0.12, 0.97]),
    ("psis_r", [-0.11, -0.045, 1.0]),
    ("trochanter_r", [0.0, -0.17, 0.90]),
    ("knee_lateral_r", [0.03, -0.14, 0.49]),
    ("knee_medial_r", [0.03, -0.04, 0.49]),
    ("ankle_lateral_r", [-0.04, -0.13, 0.075]),
    ("ankle_medial_r", [-0.04, -0.05, 0.075]),
    ("heel_r", [-0.09, -0.09, 0.03]),
    ("toe_r", [0.09, -0.09, 0.04]),
    ("mt1_r", [0.08, -0.06, 0.03]),
    ("mt5_r", [0.06, -0.12, 0.025]),
];

fn landmark(name: &str) -> Option<Vector3<f64>> {
    let of = |name: &str| LANDMARKS.iter().find(|(n, _)| *n == name).map(|(_, p)| Vector3::from(*p));
    name.strip_suffix("_l")
        .map_or_else(|| of(name), |stem| of(&format!("{stem}_r")).map(|p| Vector3::new(p.x, -p.y, p.z)))
}

fn facts() -> PersonFacts {
    PersonFacts { name: "made".into(), sex: Some(Sex::Female), height_m: Some(1.70), mass_kg: 65.0 }
}

fn still(points: Vec<(String, Vector3<f64>)>) -> Trial {
    let mut trial = Trial { name: "static".into(), ..Trial::default() };
    trial.markers.rate_hz = 100.0;
    trial.markers.first_frame = 1;
    trial.markers.n_frames = 60;
    for (label, p) in points {
        trial.markers.labels.push(label);
        trial.markers.trajectories.push(vec![p; 60]);
    }
    trial
}

fn scaled(model: &ModelSpec, set: &MarkerSet, trial: &Trial) -> Scaled {
    let tables: Anthropometry = config("anthropometry/de_leva.yaml");
    let facts = facts();
    let input = PersonInput { facts: &facts, model_spec: model, marker_set: set, static_trial: trial, frames: None };
    scale_person(&input, &tables, &ScaleOptions::default()).unwrap()
}

/// The person with true joints, from every landmark.
fn person() -> Subject {
    let mut set: MarkerSet = config("markersets/ior.yaml");
    set.markers.retain(|m| m.landmark.is_some());
    let points = set.markers.iter().map(|m| (m.label.clone(), landmark(m.landmark.as_ref().unwrap()).unwrap()));
    scaled(&config("models/human34.yaml"), &set, &still(points.collect())).subject
}

/// A place for every marker of a set on the person: its landmark, or a place on the skin of its
/// link that depends on its number.
fn worn(person: &Subject, set: &MarkerSet) -> Subject {
    let mut state = State::new(&person.model);
    state.forward_position(&person.model, &person.static_q);
    let mut worn = Subject { markers: Vec::new(), ..person.clone() };
    for (i, m) in set.markers.iter().enumerate() {
        let link = person.model.link_index(&m.link).unwrap();
        let frame = &state.world_from_link[link];
        let origin =
            |name: String| person.model.link_index(&name).ok().map(|k| state.world_from_link[k].translation.vector);
        const CENTERS: [(&str, &str); 6] = [
            ("hip_centre_", "thigh_"),
            ("knee_centre_", "shank_"),
            ("ankle_centre_", "foot_"),
            ("shoulder_centre_", "upper_arm_"),
            ("elbow_centre_", "forearm_"),
            ("wrist_centre_", "hand_"),
        ];
        let given = m.landmark.as_deref().and_then(|name| {
            let centre = CENTERS.iter().find_map(|(centre, link)| Some((link, name.strip_prefix(centre)?)));
            match (centre, name) {
                (Some((link, side)), _) => origin(format!("{link}{side}")),
                (None, "foot_forward_r" | "foot_forward_l") => {
                    origin(format!("foot{}", &name[name.len() - 2..])).map(|p| p + Vector3::x() * 0.1)
                }
                (None, "neck_centre") => origin("head".to_owned()),
                (None, "pelvis_up") => origin("pelvis".to_owned()).map(|p| p + Vector3::z() * 0.1),
                (None, name) => landmark(name),
            }
        });
        let position_m = match given {
            Some(p) => frame.inverse_transform_point(&p.into()).coords,
            None => {
                let angle = 2.4 * i as f64;
                let along = if m.link == "head" || m.link == "torso" { 0.15 } else { -0.04 } * (1 + i % 4) as f64;
                Vector3::new(0.06 * angle.cos(), along, 0.06 * angle.sin())
            }
        };
        worn.markers.push(ModelMarker { label: m.label.clone(), link, position_m, weight: m.weight });
    }
    worn
}

#[test]
fn every_marker_set_goes_from_a_static_trial_to_joint_angles() {
    let person = person();
    let names: Vec<String> = std::fs::read_dir(configs().join("markersets"))
        .unwrap()
        .map(|e| e.unwrap().path().file_stem().unwrap().to_string_lossy().into_owned())
        .collect();
    let mut tried = 0;
    for name in names {
        let whole: MarkerSet = config(&format!("markersets/{name}.yaml"));
        if whole.model != "human34" {
            continue;
        }
        for model in ["human34", "legs_pelvis_trunk", "legs_pelvis"] {
            let spec: ModelSpec = config(&format!("models/{model}.yaml"));
            let mut set = whole.clone();
            set.markers.retain(|m| spec.links.iter().any(|l| l.name == m.link));
            let worn = worn(&person, &set);
            let posture = common::trial(&worn, &vec![worn.static_q.clone(); 60], 100.0, 1e-4, 3);
            let scaled = scaled(&spec, &set, &posture);
            let truth = common::motion(&worn, 100, 100.0, 0.12, 4);
            let trial = common::trial(&worn, &truth, 100.0, 3e-4, 5);
            let options = IkOptions { locked: scaled.locked.clone(), ..IkOptions::default() };
            let found = solve(&scaled.subject, &trial, &options).unwrap();
            let knee = scaled.subject.model.link_index("shank_r").unwrap();
            let true_knee = worn.model.link_index("shank_r").unwrap();
            let at = |s: &Subject, k: usize, q: &[f64]| q[s.model.links[k].joint.q_offset];
            let bend = |f: usize| {
                at(&scaled.subject, knee, found.motion.q(f)) - at(&scaled.subject, knee, &scaled.subject.static_q)
            };
            let true_bend = |f: usize| at(&worn, true_knee, &truth[f]) - at(&worn, true_knee, &worn.static_q);
            let off = (0..100).map(|f| (bend(f) - true_bend(f)).abs()).sum::<f64>() / 100.0;
            let rms_mm = 1e3 * found.report.rms_m;
            println!("{name:<22} {model:<18} marker RMS {rms_mm:5.2} mm, knee {:.1}°", off.to_degrees());
            assert_eq!(found.report.n_unsolved, 0, "{name} {model}");
            assert!(rms_mm < 12.0, "{name} {model}: {rms_mm} mm");
            assert!(off.to_degrees() < 6.0, "{name} {model}: knee off by {}°", off.to_degrees());
            assert_eq!(
                scaled.subject.model.is_whole(),
                model == "human34" && whole.markers.iter().any(|m| m.link == "upper_arm_r"),
                "{name} {model}"
            );
            tried += 1;
        }
    }
    assert!(tried >= 40, "{tried} combinations");
}
