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
    let source = BidsMotion { motion, channels, rate_hz, duration_s: None, spatial_axes: axes };
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
    let fast = read(&CHANNELS.replace("LKNE\tmm\t100", "LKNE\tmm\tfast"), MOTION, None, None);
    assert!(fast.is_err_and(|e| e.contains("fast") && e.contains("sampling_frequency")));
    let error = read(&CHANNELS.replace("sampling_frequency", "x"), MOTION, None, None).unwrap_err();
    assert!(error.contains("SamplingFrequency"), "{error}");
}

/// A recording of 40 frames, with numbers of a fixed or of the shortest length.
fn long(fixed: bool) -> String {
    let number = |x: f64| if fixed { format!("{x:.4}") } else { format!("{}", (x * 1e4).round() / 1e4) };
    let row = |f: usize| {
        let t = 0.01 * f as f64;
        let x = |k: usize| number(0.5 + 0.1 * (3.0 * t + k as f64).sin());
        let cells: Vec<String> = std::iter::once(number(t)).chain((0..6).map(x)).collect();
        cells.join("\t")
    };
    (0..40).map(|f| row(f) + "\n").collect()
}

#[test]
fn a_table_that_is_cut_at_any_place_is_noticed() {
    for fixed in [true, false] {
        let text = long(fixed);
        let read = |motion: &str| {
            let source =
                BidsMotion { motion, channels: CHANNELS, rate_hz: None, duration_s: Some(0.4), spatial_axes: None };
            Trial::from_bids_motion("cut", &source, &ImportOptions::default())
        };
        let whole = read(&text).unwrap();
        assert!(whole.warnings.is_empty() && whole.markers.n_frames == 40, "{:?}", whole.warnings);
        for end in 1..text.len() {
            let Ok(trial) = read(&text[..end]) else { continue };
            let n = trial.markers.n_frames;
            let noticed = !trial.warnings.is_empty();
            let same = |f: usize, m: usize| {
                let (a, b) = (trial.markers.trajectories[m][f], whole.markers.trajectories[m][f]);
                a.iter().any(|x| x.is_nan()) || (a - b).norm() < 1e-12
            };
            assert!((0..n).all(|f| (0..2).all(|m| same(f, m))), "cut at {end}: another value");
            assert!(noticed || n == 40, "cut at {end}: {n} frames and no word");
            assert_eq!(trial.truncated().map(|t| t.0), (n < 40).then_some(n), "cut at {end}");
        }
    }
}

#[test]
fn a_list_of_channels_that_is_cut_at_any_place_is_noticed() {
    let columns = |text: &str| -> String {
        // the unit last: a cut turns mm into m
        text.lines()
            .map(|l| {
                let c: Vec<&str> = l.split('\t').collect();
                format!("{}\t{}\t{}\t{}\t{}\t{}\n", c[0], c[1], c[2], c[3], c[5], c[4])
            })
            .collect()
    };
    for channels in [CHANNELS.to_owned(), columns(CHANNELS)] {
        let motion = long(true);
        let read = |channels: &str| {
            let source =
                BidsMotion { motion: &motion, channels, rate_hz: None, duration_s: Some(0.4), spatial_axes: None };
            Trial::from_bids_motion("cut", &source, &ImportOptions::default())
        };
        let whole = read(&channels).unwrap();
        // without the last line break everything is there
        for end in 1..channels.len() - 1 {
            if let Ok(trial) = read(&channels[..end]) {
                assert_eq!(trial.markers, whole.markers, "cut at {end}: {}", &channels[end.saturating_sub(40)..end]);
            }
        }
    }
}
