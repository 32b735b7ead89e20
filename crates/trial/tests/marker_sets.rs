//! Every committed marker set parses, names only existing links and landmarks, and fits the
//! recordings it was made for.
#![allow(clippy::unwrap_used, clippy::panic, clippy::print_stdout, reason = "helpers of tests, not library code")]

#[path = "../../../tests/shared_data.rs"]
mod shared_data;

use aloft_trial::{ImportOptions, MarkerSet, Trial, apply_marker_set, recognise};
use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

const LINKS: [&str; 17] = [
    "pelvis",
    "torso",
    "head",
    "upper_arm_r",
    "forearm_r",
    "hand_r",
    "upper_arm_l",
    "forearm_l",
    "hand_l",
    "thigh_r",
    "shank_r",
    "foot_r",
    "thigh_l",
    "shank_l",
    "foot_l",
    "link0",
    "link1",
];
const MIDLINE: [&str; 8] = ["vertex", "c7", "t10", "suprasternale", "xiphoid", "sacrum", "neck_centre", "pelvis_up"];
const SIDED: &[&str] = &[
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

fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../..")
}

fn sets() -> Vec<MarkerSet> {
    let mut paths: Vec<_> = std::fs::read_dir(root().join("configs/markersets"))
        .unwrap()
        .map(|e| e.unwrap().path())
        .filter(|p| p.extension().is_some_and(|e| e == "yaml"))
        .collect();
    paths.sort();
    paths
        .iter()
        .map(|path| {
            let set: MarkerSet = serde_yaml::from_str(&std::fs::read_to_string(path).unwrap())
                .unwrap_or_else(|e| panic!("{}: {e}", path.display()));
            assert_eq!(Some(set.name.as_str()), path.file_stem().and_then(|s| s.to_str()));
            set
        })
        .collect()
}

fn data(name: &str) -> Option<Vec<u8>> {
    shared_data::shared_data(name).map(|path| std::fs::read(path).unwrap())
}

#[test]
fn sets_are_sound() {
    let sets = sets();
    assert!(sets.len() >= 8);
    for set in &sets {
        let mut labels = BTreeSet::new();
        let mut landmarks = BTreeSet::new();
        for marker in &set.markers {
            assert!(labels.insert(&marker.label), "{}: `{}` stands twice", set.name, marker.label);
            assert!(LINKS.contains(&marker.link.as_str()), "{}: link {}", set.name, marker.link);
            if let Some(landmark) = &marker.landmark {
                let sided = landmark.strip_suffix("_l").or(landmark.strip_suffix("_r"));
                assert!(
                    MIDLINE.contains(&landmark.as_str()) || sided.is_some_and(|l| SIDED.contains(&l)),
                    "{}: landmark {landmark}",
                    set.name
                );
                // A point of the midline may be the mean of several markers.
                assert!(
                    landmarks.insert(landmark) || MIDLINE.contains(&landmark.as_str()),
                    "{}: landmark {landmark} stands twice",
                    set.name
                );
                let side = landmark.rsplit('_').next().unwrap();
                if matches!(side, "l" | "r") && marker.link.contains('_') {
                    assert!(marker.link.ends_with(side), "{}: {landmark} on {}", set.name, marker.link);
                }
            }
        }
        let names: BTreeSet<_> = set.markers.iter().map(|m| m.label.as_str()).collect();
        for marker in &set.markers {
            for alias in &marker.aliases {
                assert!(!names.contains(alias.as_str()), "{}: alias {alias} is a label", set.name);
            }
        }
    }
}

fn trc(name: &str) -> Option<Trial> {
    let markers = String::from_utf8(data(&format!("real_drop_jump/markers/{name}.trc"))?).unwrap();
    let forces = String::from_utf8(data(&format!("real_drop_jump/forces/{name}_grf.mot"))?).unwrap();
    Some(Trial::from_trc_mot(name, &markers, Some(&forces), &ImportOptions::default()).unwrap())
}

#[test]
fn regress_drop_jump_is_recognised_and_complete() {
    let Some(mut trial) = trc("static1") else { return };
    let sets = sets();
    let scores = recognise(&trial, &sets);
    assert_eq!(scores[0].0, "opencap-47", "{scores:?}");
    assert!(scores[0].1 > 0.99 && scores[1].1 < 0.6, "{scores:?}");
    let set = sets.iter().find(|s| s.name == "opencap-47").unwrap();
    assert_eq!(set.markers.iter().filter(|m| m.tracking && !m.static_only).count(), 47);
    let found = apply_marker_set(&mut trial, set, &BTreeMap::new());
    assert!(found.missing.is_empty() && found.missing_static.is_empty() && found.unknown.is_empty(), "{found:?}");
    let mut jump = trc("DJ1").unwrap();
    let found = apply_marker_set(&mut jump, set, &BTreeMap::new());
    assert!(found.missing.is_empty() && found.unknown.is_empty(), "{found:?}");
    assert_eq!(found.missing_static, ["L_mknee", "L_mankle", "r_mknee", "r_mankle"]);
}

#[test]
fn labels_are_found_by_alias_prefix_and_letters() {
    let sets = sets();
    let set = sets.iter().find(|s| s.name == "plug-in-gait").unwrap();
    let mut trial = Trial::default();
    trial.markers.n_frames = 1;
    trial.markers.labels =
        ["Anna:LFHD", "rfhd", "L_BHD", "CV7", "my_head", "Stranger", "LTOE", "LTOE#2"].map(str::to_owned).to_vec();
    trial.markers.trajectories = vec![vec![nalgebra::Vector3::zeros()]; 8];
    let extra = BTreeMap::from([("my_head".to_owned(), "RBHD".to_owned())]);
    let found = apply_marker_set(&mut trial, set, &extra);
    assert_eq!(trial.markers.labels, ["LFHD", "RFHD", "LBHD", "C7", "RBHD", "Stranger", "LTOE", "LTOE#2"]);
    assert_eq!(found.unknown, ["Stranger", "LTOE#2"]);
    assert_eq!(found.guessed.len(), 2);
    assert!(found.missing.contains(&"LASI".to_owned()));
    assert!(trial.warnings.iter().any(|w| w.message.contains("`rfhd` as `RFHD`")), "{:?}", trial.warnings);
}

#[test]
fn regress_every_laboratory_is_recognised() {
    let sets = sets();
    for (file, expected) in [
        ("subject_a/jump01.c3d", "plug-in-gait-35"),
        ("subject_a/static.c3d", "plug-in-gait-35"),
        ("subject_b/exercise01.c3d", "plug-in-gait-35"),
        ("chain_b/throws_01.c3d", "two-link-chain"),
        ("real_landing/Sample_Jump2.c3d", "motion-analysis-jump"),
        ("real_landing/aStaticTrial_2.c3d", "motion-analysis-acl"),
        ("real_landing/singleLegLanding.c3d", "motion-analysis-acl"),
    ] {
        let Some(bytes) = data(file) else { return };
        let trial = Trial::from_c3d(file, &bytes, &ImportOptions::default()).unwrap();
        let scores = recognise(&trial, &sets);
        assert_eq!(scores[0].0, expected, "{file}: {scores:?}");
        assert!(scores[0].1 > 0.85, "{file}: {scores:?}");
    }
}
