//! BIDS-Motion: channels in any order of kinds, `n/a`, units, axes, and errors with their line.
#![allow(clippy::unwrap_used, clippy::expect_used, reason = "tests fail by panicking")]

use aloft_trial::{BidsMotion, ImportOptions, Trial};
use nalgebra::Vector3;

const CHANNELS: &str = "name\tcomponent\ttype\ttracked_point\tunits\tsampling_frequency
t\tn/a\tLATENCY\tn/a\ts\t100
LKNE_x\tx\tPOS\tLKNE\tmm\t100
LKNE_y\ty\tPOS\tLKNE\tmm\t100
LKNE_z\tz\tPOS\tLKNE\tmm\t100
RKNE_x\tx\tPOS\tn/a\tm\t100
RKNE_y\ty\tPOS\tn/a\tm\t100
RKNE_z\tz\tPOS\tn/a\tm\t100
";
const MOTION: &str = "0\t100\t200\t500\t0.1\t-0.2\t0.5\n0.01\t101\tn/a\t501\t0.1\t-0.2\t0.5\n";

fn read(channels: &str, motion: &str, rate_hz: Option<f64>, axes: Option<&str>) -> Result<Trial, String> {
    let source = BidsMotion { motion, channels, rate_hz, spatial_axes: axes };
    Trial::from_bids_motion("sub-01_task-jump", &source, &ImportOptions::default()).map_err(|e| e.to_string())
}

#[test]
fn positions_become_markers_in_metres() {
    let trial = read(CHANNELS, MOTION, None, None).unwrap();
    assert_eq!(trial.markers.labels, ["LKNE", "RKNE"]);
    assert_eq!((trial.markers.rate_hz, trial.markers.n_frames), (100.0, 2));
    let at = |m: usize, f: usize| trial.markers.trajectories[m][f];
    assert!((at(0, 0) - Vector3::new(0.1, 0.2, 0.5)).norm() < 1e-12);
    assert!(at(0, 1).iter().all(|x| x.is_nan()), "a point with a missing coordinate is missing");
    assert!((at(1, 1) - Vector3::new(0.1, -0.2, 0.5)).norm() < 1e-12);
    assert_eq!(read(CHANNELS, MOTION, Some(250.0), None).unwrap().markers.rate_hz, 250.0);
}

#[test]
fn stated_axes_turn_the_vertical_to_z() {
    // x forward, y up, z right
    let trial = read(CHANNELS, MOTION, None, Some("ASR")).unwrap();
    assert!((trial.markers.trajectories[0][0] - Vector3::new(0.1, -0.5, 0.2)).norm() < 1e-12);
    let trial = read(CHANNELS, MOTION, None, Some("ALS")).unwrap();
    assert!((trial.markers.trajectories[0][0] - Vector3::new(0.1, 0.2, 0.5)).norm() < 1e-12);
}

#[test]
fn errors_name_file_and_line() {
    let wrong = MOTION.replace("0.01\t101", "0.01\thundred");
    let error = read(CHANNELS, &wrong, None, None).unwrap_err();
    assert!(error.contains("_motion.tsv line 2") && error.contains("hundred"), "{error}");
    let error = read(CHANNELS, "0\t1\n", None, None).unwrap_err();
    assert!(error.contains("2 columns") && error.contains('7'), "{error}");
    let error = read(&CHANNELS.replace("\tmm\t", "\tfurlong\t"), MOTION, None, None).unwrap_err();
    assert!(error.contains("furlong"), "{error}");
    let error = read("name\tunits\n", MOTION, None, None).unwrap_err();
    assert!(error.contains("_channels.tsv line 1"), "{error}");
    let error = read(&CHANNELS.replace("sampling_frequency", "x"), MOTION, None, None).unwrap_err();
    assert!(error.contains("SamplingFrequency"), "{error}");
}
