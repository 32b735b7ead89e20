//! C3D import of the recordings of the data folder.
#![allow(clippy::unwrap_used, clippy::panic, clippy::print_stdout, reason = "helpers of tests, not library code")]

#[path = "../../../tests/shared_data.rs"]
mod shared_data;

use aloft_trial::{
    ArtefactOptions, GapOptions, ImportOptions, MarkerSet, QualityOptions, Trial, TrialError, apply_marker_set, assess,
    fill_gaps, find_artefacts, recognise,
};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../..")
}

fn read(name: &str) -> Option<Trial> {
    let bytes = std::fs::read(shared_data::shared_data(name)?).unwrap();
    Some(Trial::from_c3d(name, &bytes, &ImportOptions::default()).unwrap())
}

fn set(name: &str) -> MarkerSet {
    serde_yaml::from_str(&std::fs::read_to_string(root().join(format!("configs/markersets/{name}.yaml"))).unwrap())
        .unwrap()
}

#[test]
fn regress_simulated_subject() {
    let Some(mut trial) = read("subject_a/jump01.c3d") else { return };
    assert_eq!((trial.markers.labels.len(), trial.markers.n_frames, trial.markers.rate_hz), (35, 999, 200.0));
    assert_eq!(trial.plates.len(), 2);
    assert_eq!((trial.plates[0].rate_hz, trial.plates[0].force_n.len()), (1000.0, 4995));
    assert!(trial.warnings.is_empty(), "{:?}", trial.warnings);
    assert_eq!(trial.events.len(), 12);
    assert_eq!(trial.events[0].label, "Foot Off");
    assert!((trial.events[0].time_s - 1.211).abs() < 1e-3);
    let still = read("subject_a/static.c3d").unwrap();
    let mean = |values: &[nalgebra::Vector3<f64>]| values.iter().sum::<nalgebra::Vector3<f64>>() / values.len() as f64;
    let force: nalgebra::Vector3<f64> = still.plates.iter().map(|p| mean(&p.force_n)).sum();
    let moment: nalgebra::Vector3<f64> = still.plates.iter().map(|p| mean(&p.moment_nm)).sum();
    assert!((force.z / 9.81 - 56.2).abs() < 0.6, "{force}");
    // The centre of pressure lies between the feet.
    let toe = |label: &str| still.markers.position(still.markers.index(label).unwrap(), 100).unwrap();
    let (x, y) = (-moment.y / force.z, moment.x / force.z);
    assert!(x < toe("LTOE").x && x > toe("LHEE").x, "{x}");
    assert!(y < toe("LTOE").y && y > toe("RTOE").y, "{y}");
    let found = apply_marker_set(&mut trial, &set("plug-in-gait-35"), &BTreeMap::new());
    assert!(found.missing.is_empty() && found.unknown.is_empty() && found.renamed.is_empty(), "{found:?}");
    assert_eq!(found.missing_static.len(), 6);
}

#[test]
fn regress_chain_gaps_are_filled_from_the_link() {
    let Some(mut trial) = read("chain_a/throws_01.c3d") else { return };
    let set = set("two-link-chain");
    apply_marker_set(&mut trial, &set, &BTreeMap::new());
    let segments = set.segments();
    let findings = find_artefacts(&mut trial, &segments, &ArtefactOptions::default());
    assert!(findings.is_empty(), "{findings:?}");
    let before = trial.clone();
    let fills = fill_gaps(&mut trial, &segments, &GapOptions::default());
    let quality = assess(&trial, None, &fills, &findings, &QualityOptions::default());
    for (row, track) in quality.markers.iter().zip(&before.markers.trajectories) {
        let missing = track.iter().filter(|p| p.x.is_nan()).count();
        assert!((row.present_fraction - (1.0 - missing as f64 / track.len() as f64)).abs() < 1e-12);
        assert!((row.noise_rms_m - 0.0003).abs() < 0.00006, "{} {}", row.label, row.noise_rms_m);
    }
    let left = trial.markers.trajectories.iter().flatten().filter(|p| p.x.is_nan()).count();
    println!("{} fills, {left} marker frames stay missing", fills.len());
    assert!(fills.len() > 10 && left == 0);
}

#[test]
fn regress_jump_with_cut_labels() {
    let Some(mut trial) = read("real_landing/Sample_Jump2.c3d") else { return };
    assert!(trial.warnings.iter().any(|w| w.message.contains("full names taken")), "{:?}", trial.warnings);
    assert!(trial.markers.index("R.Knee.Medial").is_some());
    let names: Vec<_> = trial.events.iter().map(|e| e.label.as_str()).collect();
    assert_eq!(names, ["Start", "Take-Off", "Landing", "End"]);
    assert!((trial.events[1].time_s - 0.6917).abs() < 1e-3);
    let scores = recognise(&trial, &[set("helen-hayes"), set("motion-analysis-jump"), set("plug-in-gait")]);
    assert_eq!(scores[0].0, "motion-analysis-jump", "{scores:?}");
    let found = apply_marker_set(&mut trial, &set("motion-analysis-jump"), &BTreeMap::new());
    assert!(found.missing.is_empty() && found.guessed.is_empty(), "{found:?}");
    let weight: f64 = trial.plates.iter().map(|p| p.force_n[..30].iter().map(|f| f.z).sum::<f64>() / 30.0).sum();
    println!("standing force {weight:.0} N; {:?}", trial.warnings);
    assert!(weight > 300.0);
}

#[test]
fn regress_static_and_landing_of_one_laboratory() {
    for name in ["aStaticTrial_2", "doubleLegLanding", "singleLegLanding"] {
        let Some(trial) = read(&format!("real_landing/{name}.c3d")) else { return };
        let weight: f64 = trial.plates.iter().map(|p| p.force_n[p.force_n.len() - 50].z).sum();
        println!("{name}: {} markers, {:?}, last force {weight:.0} N", trial.markers.labels.len(), trial.warnings);
        assert_eq!(recognise(&trial, &[set("motion-analysis-acl"), set("plug-in-gait")])[0].0, "motion-analysis-acl");
        assert_eq!(trial.plates.len(), 3);
    }
}

#[test]
fn every_sample_file_gives_a_trial_or_one_line() {
    let Some(samples) = shared_data::shared_data("c3d_samples") else { return };
    let mut folders = vec![samples];
    let mut count = 0;
    while let Some(folder) = folders.pop() {
        for path in std::fs::read_dir(&folder).unwrap().map(|e| e.unwrap().path()) {
            if path.is_dir() {
                folders.push(path);
            } else if path.extension().is_some_and(|e| e.eq_ignore_ascii_case("c3d")) {
                count += 1;
                let name = path.file_stem().unwrap().to_string_lossy().into_owned();
                match Trial::from_c3d(&name, &std::fs::read(&path).unwrap(), &ImportOptions::default()) {
                    Ok(trial) => {
                        let height = trial.markers.trajectories.iter().flatten().map(|p| p.z).filter(|z| z.is_finite());
                        println!(
                            "{name}: {} markers, {} plates, z to {:.2} m, {:?}",
                            trial.markers.labels.len(),
                            trial.plates.len(),
                            height.fold(f64::NEG_INFINITY, f64::max),
                            trial.warnings
                        );
                    }
                    Err(error) => {
                        let line = error.to_string();
                        println!("{line}");
                        assert!(line.starts_with(&name) && !line.contains('\n'));
                    }
                }
            }
        }
    }
    assert!(count > 30);
}

#[test]
fn regress_broken_sources_say_what_they_are() {
    let options = ImportOptions::default();
    assert!(matches!(Trial::from_c3d("a", &[], &options), Err(TrialError::EmptyFile { .. })));
    let text = Trial::from_c3d("notes", b"this is a text file, not a recording\n", &options).unwrap_err().to_string();
    assert!(text.starts_with("notes: ") && !text.contains('\n'), "{text}");
}
