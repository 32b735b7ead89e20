//! A marker that repeats one position exactly is missing, whatever the format.
#![allow(clippy::unwrap_used, reason = "tests fail by panicking")]

use aloft_c3d::C3dFile;
use aloft_trial::{BidsMotion, ImportOptions, Trial, UpAxis, WarningKind};
use std::fmt::Write;
use std::path::Path;

/// Frames in which `LKNE` is held.
const HELD: std::ops::Range<usize> = 150..200;

fn recording() -> C3dFile {
    let file = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../fixtures/human_twin/jump01.c3d");
    let mut file = C3dFile::from_bytes(&std::fs::read(file).unwrap()).unwrap();
    let knee = file.points.iter_mut().find(|p| p.label == "LKNE").unwrap();
    let held = knee.xyz[HELD.start];
    knee.xyz[HELD].fill(held);
    file
}

/// The cells of a frame, mm with four decimals; empty where a marker was not seen.
fn cells(file: &C3dFile, frame: usize, missing: &str) -> String {
    let of = |p: &aloft_c3d::Point| {
        p.xyz[frame].map(|x| if x.is_nan() { missing.to_owned() } else { format!("{x:.4}") }).join("\t")
    };
    file.points.iter().map(of).collect::<Vec<_>>().join("\t")
}

fn trc(file: &C3dFile) -> String {
    let (n, m) = (file.n_frames, file.points.len());
    let mut out = format!(
        "PathFileType\t4\t(X/Y/Z)\tx.trc\nDataRate\tCameraRate\tNumFrames\tNumMarkers\tUnits\tOrigDataRate\tOrigDataStartFrame\tOrigNumFrames\n\
         100\t100\t{n}\t{m}\tmm\t100\t1\t{n}\nFrame#\tTime\t"
    );
    out.push_str(&file.points.iter().map(|p| p.label.clone()).collect::<Vec<_>>().join("\t\t\t"));
    out.push_str("\t\t\n\t\t");
    out.push_str(&(1..=m).map(|k| format!("X{k}\tY{k}\tZ{k}")).collect::<Vec<_>>().join("\t"));
    out.push_str("\n\n");
    for f in 0..n {
        writeln!(out, "{}\t{:.2}\t{}", f + 1, f as f64 / 100.0, cells(file, f, "")).unwrap();
    }
    out
}

fn bids(file: &C3dFile) -> (String, String) {
    let mut channels = "name\tcomponent\ttype\tunits\n".to_owned();
    for p in &file.points {
        for axis in ["x", "y", "z"] {
            writeln!(channels, "{}_{axis}\t{axis}\tPOS\tmm", p.label).unwrap();
        }
    }
    let motion = (0..file.n_frames).map(|f| cells(file, f, "n/a") + "\n").collect();
    (channels, motion)
}

#[test]
fn a_held_marker_is_missing_in_every_format() {
    let file = recording();
    let options = ImportOptions { up_axis: Some(UpAxis::Z), ..ImportOptions::default() };
    let (channels, motion) = bids(&file);
    let source =
        BidsMotion { motion: &motion, channels: &channels, rate_hz: Some(100.0), duration_s: None, spatial_axes: None };
    let all = [
        Trial::from_c3d("jump", &file.to_bytes().unwrap(), &options).unwrap(),
        Trial::from_trc_mot("jump", &trc(&file), None, &options).unwrap(),
        Trial::from_bids_motion("jump", &source, &options).unwrap(),
    ];
    for trial in all {
        let knee = trial.markers.index("LKNE").unwrap();
        assert!(HELD.into_iter().all(|f| trial.markers.position(knee, f).is_none()));
        assert!(
            trial.markers.position(knee, HELD.start - 1).is_some() && trial.markers.position(knee, HELD.end).is_some()
        );
        let told: Vec<_> = trial.warnings.iter().filter(|w| w.kind == WarningKind::HeldMarkers).collect();
        let words = "marker `LKNE` repeats one position exactly in 50 frames, frames 151 to 200, while others move: it is missing there";
        assert!(told.len() == 1 && told[0].message == words, "{told:?}");
    }
}
