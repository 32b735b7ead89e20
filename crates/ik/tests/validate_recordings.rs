//! Recordings with known geometry, and a real one, if the data folder is available.
#![allow(clippy::unwrap_used, clippy::print_stdout, reason = "a test may panic, and says what it skips")]

#[path = "../../../tests/shared_data.rs"]
mod shared_data;

use aloft_body::subject::PriorSd;
use aloft_body::{JointSpec, LinkInertia, LinkSpec, Model, ModelMarker, ModelSpec, PersonFacts, Sex, Subject};
use aloft_ik::{CalibrateOptions, IkOptions, calibrate, solve};
use aloft_scale::{Anthropometry, PersonInput, ScaleOptions, Scaled, scale_person};
use aloft_trial::{ImportOptions, MarkerSet, Trial, apply_marker_set};
use nalgebra::{Matrix3, Rotation3, Vector3};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

fn data(folder: &str) -> Option<PathBuf> {
    shared_data::shared_data(folder)
}

fn config<T: serde::de::DeserializeOwned>(path: &str) -> T {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../configs").join(path);
    serde_yaml::from_str(&std::fs::read_to_string(path).unwrap()).unwrap()
}

fn trial(path: &Path, set: Option<&MarkerSet>) -> Trial {
    let name = path.file_stem().unwrap().to_string_lossy().into_owned();
    let options = ImportOptions::default();
    let mut trial = if path.extension().unwrap() == "trc" {
        Trial::from_trc_mot(&name, &std::fs::read_to_string(path).unwrap(), None, &options).unwrap()
    } else {
        Trial::from_c3d(&name, &std::fs::read(path).unwrap(), &options).unwrap()
    };
    if let Some(set) = set {
        apply_marker_set(&mut trial, set, &BTreeMap::new());
    }
    trial
}

fn scaled(static_trial: &Trial, set: &MarkerSet, facts: &PersonFacts) -> Scaled {
    let model: ModelSpec = config("models/human34.yaml");
    let tables: Anthropometry = config("anthropometry/de_leva.yaml");
    let input = PersonInput { facts, model_spec: &model, marker_set: set, static_trial, frames: None };
    scale_person(&input, &tables, &ScaleOptions::default()).unwrap()
}

/// True geometry: the residual is the white noise of the recording.
#[test]
fn validate_chain_residuals_are_the_marker_noise() {
    let Some(folder) = data("chain_a") else { return };
    let truth: serde_json::Value =
        serde_json::from_str(&std::fs::read_to_string(folder.join("truth/truth.json")).unwrap()).unwrap();
    let vector = |v: &serde_json::Value| Vector3::from_fn(|i, _| v[i].as_f64().unwrap());
    let turn = &truth["hinge"]["R_link0_link1_q0"];
    let turn = Rotation3::from_matrix(&Matrix3::from_fn(|r, c| turn[r][c].as_f64().unwrap()));
    let (roll, pitch, yaw) = turn.euler_angles();
    let link = |name: &str, parent: Option<&str>, joint, position_m: Vector3<f64>, rpy_rad| LinkSpec {
        name: name.to_owned(),
        parent: parent.map(str::to_owned),
        joint,
        position_m: position_m.into(),
        rpy_rad,
        inertia: None,
    };
    let links = vec![
        link("link0", None, JointSpec::Free, Vector3::zeros(), [0.0; 3]),
        link("link1", Some("link0"), JointSpec::RevoluteZ, vector(&truth["hinge"]["p_link0"]), [roll, pitch, yaw]),
    ];
    let model = Model::from_spec(&ModelSpec::new("two_link".to_owned(), links)).unwrap();
    let places = [("L0", 0, "markers_link0_m"), ("L1", 1, "markers_link1_m")];
    let markers = places.iter().flat_map(|(prefix, link, key)| {
        truth[*key].as_array().unwrap().iter().enumerate().map(move |(i, at)| ModelMarker {
            label: format!("{prefix}_{}", i + 1),
            link: *link,
            position_m: vector(at),
            weight: 1.0,
        })
    });
    let subject = Subject {
        facts: PersonFacts { name: "chain".to_owned(), sex: None, height_m: None, mass_kg: 0.997 },
        markers: markers.collect(),
        prior: vec![LinkInertia { mass_kg: 0.5, com_m: Vector3::zeros(), inertia_com_kgm2: Matrix3::identity() }; 2],
        prior_sd: vec![PriorSd { mass_rel: 0.1, com_m: 0.1, radius_rel: 0.1, together: 0.0 }; 2],
        static_q: model.neutral(),
        provenance: Vec::new(),
        model,
        estimated: None,
        boxes: Vec::new(),
    };
    for throws in ["throws_01", "throws_03"] {
        let trial = trial(&folder.join(format!("{throws}.c3d")), None);
        let result = solve(&subject, &trial, &IkOptions { bridge_gaps_s: 0.0, ..IkOptions::default() }).unwrap();
        assert_eq!((result.report.n_unsolved, result.report.n_unconverged), (0, 0));
        // Σ r² over Σ (3 n − 7) in frames with n markers is the variance of the noise
        let (mut sum, mut freedom) = (0.0, 0.0);
        for f in 0..result.motion.n_frames() {
            let seen = result.motion.residual_m[f * 9..(f + 1) * 9].iter().filter(|r| r.is_finite());
            sum += seen.clone().map(|r| r * r).sum::<f64>();
            freedom += 3.0 * seen.count() as f64 - 7.0;
        }
        let noise = (sum / freedom).sqrt();
        assert!((noise / 3e-4 - 1.0).abs() < 0.02, "{throws}: noise of {noise:e} m, 3e-4 expected");
    }
}

/// From landmarks to calibrated geometry on a simulated person whose skeleton is known.
#[test]
fn validate_calibrated_segments_of_a_simulated_person() {
    let Some(folder) = data("subject_a") else { return };
    let set: MarkerSet = config("markersets/plug-in-gait-35.yaml");
    let facts = PersonFacts { name: "S01".to_owned(), sex: Some(Sex::Female), height_m: Some(1.605), mass_kg: 56.2 };
    let scaled = scaled(&trial(&folder.join("static.c3d"), Some(&set)), &set, &facts);
    let moving: Vec<Trial> = ["jump01", "jump02", "jump05", "exercise01"]
        .iter()
        .map(|name| trial(&folder.join(format!("{name}.c3d")), Some(&set)))
        .collect();
    let moving: Vec<&Trial> = moving.iter().collect();
    let options = CalibrateOptions { rounds: 1, ..CalibrateOptions::default() };
    let result = calibrate(&scaled.subject, &moving, &options).unwrap();
    assert!(result.report.held_out_rms_before_m > 3e-3);
    assert!(result.report.held_out_rms_after_m < 1.4e-3, "{} m", result.report.held_out_rms_after_m);
    // distances between joint centres that the truth states, m
    let truth = [
        ("pelvis to torso", "torso", 0.1140),
        ("torso to head", "head", 0.3924),
        ("torso to right shoulder", "upper_arm_r", 0.3644),
        ("torso to left shoulder", "upper_arm_l", 0.3567),
        ("right thigh", "shank_r", 0.4002),
        ("left thigh", "shank_l", 0.3969),
        ("right shank", "foot_r", 0.3987),
        ("left shank", "foot_l", 0.3904),
    ];
    for (what, link, expected) in truth {
        let link = &result.subject.model.links[result.subject.model.link_index(link).unwrap()];
        let found = link.joint.parent_from_joint.translation.vector.norm();
        assert!((found - expected).abs() < 0.008, "{what}: {found} m for {expected} m");
    }
}

/// One real subject: published fits of these trials by another program (AddBiomechanics) have 11.3
/// mm on average.
#[test]
fn validate_real_jumps_fit_within_a_centimetre() {
    let Some(folder) = data("real_drop_jump/markers") else { return };
    let set: MarkerSet = config("markersets/opencap-47.yaml");
    let facts = PersonFacts { name: "real".to_owned(), sex: None, height_m: None, mass_kg: 60.05 };
    let scaled = scaled(&trial(&folder.join("static1.trc"), Some(&set)), &set, &facts);
    let names = ["DJ1", "DJ2", "DJ3", "DJAsym1", "DJAsym2", "DJAsym3", "squats1", "squatsAsym1"];
    let moving: Vec<Trial> = names.iter().map(|n| trial(&folder.join(format!("{n}.trc")), Some(&set))).collect();
    // The asymmetric jumps are not used by the calibration.
    let seen: Vec<&Trial> = moving.iter().filter(|t| !t.name.starts_with("DJAsym")).collect();
    let ik = IkOptions { locked: scaled.locked.clone(), ..IkOptions::default() };
    let options = CalibrateOptions { ik: ik.clone(), ..CalibrateOptions::default() };
    let calibrated = calibrate(&scaled.subject, &seen, &options).unwrap().subject;
    let mut mean = 0.0;
    for trial in &moving {
        let report = solve(&calibrated, trial, &ik).unwrap().report;
        println!("{}: {:.2} mm", trial.name, 1e3 * report.rms_m);
        assert_eq!(report.n_unsolved, 0);
        mean += report.rms_m / moving.len() as f64;
    }
    assert!(mean < 0.010, "mean marker RMS {mean} m");
}
