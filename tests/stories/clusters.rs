//! Rigid plates on the segments and landmarks in the static trial alone (CAST): `markerset draft`
//! finds the segment of every plate, although the labels say nothing.

use crate::support::{expect, folder, json};
use aloft_c3d::{C3dBuilder, C3dFile};
use aloft_trial::Trial;
use nalgebra::Vector3;
use std::fs;

/// The same motion with markers, and as exact poses of segments.
const SCENARIO: &str = "name: cast\nseed: 11\nbody:\n  kind: human\n  person: {sex: M, height_m: 1.80, mass_kg: 78.0}\n  protocol: {jumps: 2, flights: [2, 2], exercises: 1, exercise_s: 4.0, static_s: 1.0, plates: false}\ncapture: {point_rate_hz: 100.0, gap_fraction: 0.0";
const POSES: &str = ", markerless: {centre_sd_m: 0.0, noise_m: 0.0002, noise_rad: 0.0005, cutoff_hz: 40.0}";

/// Plates: segment of the poses, link, middle in the segment (x right, y forwards, z up), m.
const PLATES: [(&str, &str, [f64; 3]); 10] = [
    ("r_thigh", "thigh_r", [0.08, 0.0, -0.22]),
    ("l_thigh", "thigh_l", [-0.08, 0.02, -0.22]),
    ("r_shank", "shank_r", [0.05, 0.02, -0.20]),
    ("l_shank", "shank_l", [-0.05, 0.0, -0.20]),
    ("r_foot", "foot_r", [0.02, 0.06, -0.02]),
    ("l_foot", "foot_l", [-0.02, 0.06, -0.02]),
    ("r_uarm", "upper_arm_r", [0.05, 0.0, -0.16]),
    ("l_uarm", "upper_arm_l", [-0.05, 0.0, -0.16]),
    ("r_larm", "forearm_r", [0.03, 0.02, -0.12]),
    ("l_larm", "forearm_l", [-0.03, 0.02, -0.12]),
];
/// Labels that stay in the dynamic trials.
const WORN: [&str; 8] = ["LASI", "RASI", "LPSI", "RPSI", "C7", "CLAV", "T10", "STRN"];
/// Corners of a plate about its middle.
const CORNERS: [[f64; 3]; 4] = [[0.0, 0.03, 0.03], [0.0, -0.03, 0.03], [0.0, -0.03, -0.03], [0.01, 0.03, -0.02]];

#[test]
fn plates_without_a_name_find_their_segments_by_the_landmarks_of_the_static_trial() {
    let dir = folder();
    let labs = [("markers", ""), ("poses", POSES)].map(|(name, more)| {
        let scenario = dir.path().join(format!("{name}.yaml"));
        fs::write(&scenario, format!("{SCENARIO}{more}}}\n")).unwrap();
        let lab = dir.path().join(name);
        expect(&["simulate", &scenario.display().to_string(), "--out", &lab.display().to_string()], 0);
        lab
    });
    let lab = dir.path().join("cast");
    fs::create_dir(&lab).unwrap();
    let mut truth: Vec<(String, &str)> = Vec::new();
    for name in ["static", "jump01", "jump02", "exercise01"] {
        let read = |at: usize| fs::read(labs[at].join(format!("{name}.c3d"))).unwrap();
        let markers = C3dFile::from_bytes(&read(0)).unwrap();
        let poses = Trial::from_c3d(name, &read(1), &Default::default()).unwrap().markers;
        let mut file = C3dBuilder::new(100.0);
        for point in markers.points.iter().filter(|p| name == "static" || WORN.contains(&p.label.as_str())) {
            file = file.marker(&point.label, point.xyz.clone());
        }
        // the plates' markers in an order that says nothing
        for corner in 0..4 {
            for (plate, (segment, link, middle)) in PLATES.iter().enumerate() {
                let label = format!("M{:02}", (7 * (4 * plate + corner) + 3) % 41);
                let of = |arm: &str| &poses.trajectories[poses.index(&format!("{segment}.{arm}")).unwrap()];
                let local = Vector3::from(*middle) + Vector3::from(CORNERS[corner]);
                let xyz = (0..poses.n_frames)
                    .map(|f| {
                        let o = of("o")[f];
                        let arms = ["x", "y", "z"].iter().zip(local.iter());
                        let p = arms.fold(o, |p, (arm, c)| p + (of(arm)[f] - o) * (*c / aloft_trial::ARM_M));
                        [p.x, p.y, p.z].map(|c| (1000.0 * c) as f32)
                    })
                    .collect();
                file = file.marker(&label, xyz);
                if name == "static" {
                    truth.push((label, link));
                }
            }
        }
        fs::write(lab.join(format!("{name}.c3d")), file.build().unwrap().to_bytes().unwrap()).unwrap();
    }
    let drafted = json(&["markerset", "draft", &lab.display().to_string(), "--json"]);
    let markers = drafted["markers"].as_array().unwrap();
    let wrong: Vec<String> = truth
        .iter()
        .filter_map(|(label, link)| {
            let m = markers.iter().find(|m| m["label"] == label.as_str()).unwrap();
            (m["link"] != *link).then(|| format!("{label} of {link}: {} ({})", m["link"], m["because"]))
        })
        .collect();
    assert!(wrong.is_empty(), "{} of {}:\n{}", wrong.len(), truth.len(), wrong.join("\n"));
    let knee = markers.iter().find(|m| m["label"] == "RKNE").unwrap();
    assert!(knee["static_only"] == true && knee["landmark"] == "knee_lateral_r", "{knee}");
}
