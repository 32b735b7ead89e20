//! Recordings without markers, from `init` to the report: joint motion holds, and neither masses
//! nor effects are claimed.

use crate::support::{aloft, expect, folder, json, unwrapped};
use std::fmt::Write;
use std::fs;
use std::path::{Path, PathBuf};

/// A person in front of cameras, without markers.
const SCENARIO: &str = "name: theia\nseed: 5\nbody:\n  kind: human\n  person: {sex: F, height_m: 1.68, mass_kg: 61.5}\n  protocol: {jumps: 2, flights: [2, 2], exercises: 1, exercise_s: 4.0, static_s: 1.0}\ncapture: {point_rate_hz: 100.0, markerless: {cutoff_hz: 10.0}}\n";

/// Poses of segments as C3D, without the static trial.
fn theia(dir: &Path) -> PathBuf {
    let (scenario, lab) = (dir.join("scenario.yaml"), dir.join("lab"));
    fs::write(&scenario, SCENARIO).unwrap();
    expect(&["simulate", &scenario.display().to_string(), "--out", &lab.display().to_string()], 0);
    fs::remove_file(lab.join("static.c3d")).unwrap();
    lab
}

/// The same motion as keypoints in TRC files, Y up, metres: joint centres, feet, and a head above
/// the neck.
fn keypoints(theia: &Path, to: &Path) {
    const POINTS: [(&str, &str); 20] = [
        ("Hip", "pelvis.o"),
        ("RHip", "r_thigh.o"),
        ("RKnee", "r_shank.o"),
        ("RAnkle", "r_foot.o"),
        ("RBigToe", "r_toes.x"),
        ("RSmallToe", "r_toes.o"),
        ("RHeel", "r_foot.z"),
        ("LHip", "l_thigh.o"),
        ("LKnee", "l_shank.o"),
        ("LAnkle", "l_foot.o"),
        ("LBigToe", "l_toes.o"),
        ("LSmallToe", "l_toes.x"),
        ("LHeel", "l_foot.z"),
        ("Neck", "torso.o"),
        ("RShoulder", "r_uarm.o"),
        ("RElbow", "r_larm.o"),
        ("RWrist", "r_hand.o"),
        ("LShoulder", "l_uarm.o"),
        ("LElbow", "l_larm.o"),
        ("LWrist", "l_hand.o"),
    ];
    fs::create_dir(to).unwrap();
    for name in ["jump01", "jump02", "exercise01"] {
        let bytes = fs::read(theia.join(format!("{name}.c3d"))).unwrap();
        let trial = aloft_trial::Trial::from_c3d(name, &bytes, &Default::default()).unwrap();
        let at = |label: &str, f: usize| trial.markers.trajectories[trial.markers.index(label).unwrap()][f];
        let mut labels: Vec<&str> = POINTS.iter().map(|p| p.0).collect();
        labels.extend(["Head", "Nose"]);
        let n = trial.markers.n_frames;
        let mut text = format!("PathFileType\t4\t(X/Y/Z)\t{name}.trc\n");
        text.push_str(
            "DataRate\tCameraRate\tNumFrames\tNumMarkers\tUnits\tOrigDataRate\tOrigDataStartFrame\tOrigNumFrames\n",
        );
        let _ = writeln!(text, "100\t100\t{n}\t{}\tm\t100\t1\t{n}", labels.len());
        let _ = writeln!(text, "Frame#\tTime\t{}", labels.join("\t\t\t"));
        let axes: Vec<String> = (1..=labels.len()).map(|i| format!("X{i}\tY{i}\tZ{i}")).collect();
        let _ = writeln!(text, "\t\t{}\n", axes.join("\t"));
        for f in 0..n {
            let mut points: Vec<_> = POINTS.iter().map(|(_, from)| at(from, f)).collect();
            let head = |s: f64, axis: &str| {
                let o = at("head.o", f);
                o + s * (at(axis, f) - o)
            };
            points.extend([head(2.5, "head.z"), head(1.2, "head.y")]);
            let _ = write!(text, "{}\t{:.4}", f + 1, f as f64 / 100.0);
            for p in points {
                let _ = write!(text, "\t{:.6}\t{:.6}\t{:.6}", p.y, p.z, p.x);
            }
            text.push('\n');
        }
        fs::write(to.join(format!("{name}.trc")), text).unwrap();
    }
}

fn served(lab: &Path, dir: &Path, set: &str, source: &str, most_mm: f64) {
    let lab = lab.display().to_string();
    let pipeline = dir.join(format!("{set}.yaml")).display().to_string();
    let ws = dir.join(set).display().to_string();
    expect(&["init", &lab, "--out", &pipeline], 0);
    let text = fs::read_to_string(&pipeline).unwrap();
    assert!(text.contains(&format!("marker_set: {set} ")), "{text}");
    assert!(text.contains("without markers no static trial is needed"), "{text}");
    let text = text.replace("  mass_kg:              #", "  mass_kg: 61.5 #").replace("  sex:  ", "  sex: F");
    fs::write(&pipeline, text).unwrap();
    let (out, err) = expect(&["run", &pipeline, "--workspace", &ws], 0);
    assert!(out.contains("identified  nothing: the joints of ") && out.contains("not judged"), "{out}{err}");
    assert!(!out.contains("at the floor") && !out.contains("poor"), "{out}");

    let found = json(&["compare", &pipeline, "--workspace", &ws, "--json"]);
    let limits = found["limits"].as_array().unwrap();
    let why = limits[0].as_str().unwrap();
    assert!(why.starts_with(source) && why.contains("judges neither masses nor effects"), "{why}");
    assert!(why.contains("were smoothed away before import"), "smoothed at 10 Hz, and not noticed: {why}");
    assert!(limits[1].as_str().unwrap().contains("joint angles"));
    assert!(found["errors"].as_array().unwrap().iter().all(|e| e["noise_floor"].is_null() && e["signal"] == "unknown"));
    assert!(found["words"].as_array().unwrap().is_empty());
    for trial in found["kinematics"].as_array().unwrap() {
        let rms = trial["marker_rms_mm"].as_f64().unwrap();
        assert!(rms < most_mm, "{}: {rms} mm", trial["trial"]);
        if trial["trial"] != "exercise01" {
            assert_eq!(trial["flights"], 2, "{}", trial["trial"]);
        }
    }
    for command in ["discover", "parameters"] {
        let refused = aloft(&[command, &pipeline, "--workspace", &ws]);
        assert_eq!(refused.status.code(), Some(2), "{command}");
        assert!(unwrapped(&refused.stderr).contains("from the bones'"), "{command}: {}", unwrapped(&refused.stderr));
    }
    expect(&["report", &pipeline, "--workspace", &ws], 0);
    let page = fs::read_to_string(format!("{ws}/report.html")).unwrap();
    assert!(page.contains("Joint motion without markers") && page.contains("nothing is identified or judged"));
    // commands that refuse are not proposed
    assert!(
        page.contains("Cannot be told") && !page.contains("aloft discover ") && !page.contains("aloft parameters ")
    );
}

#[test]
fn poses_of_segments_go_from_init_to_the_report_without_a_static_trial() {
    let dir = folder();
    let lab = theia(dir.path());
    served(&lab, dir.path(), "theia3d", "Theia3D", 4.0);
}

#[test]
fn keypoints_of_videos_go_from_init_to_the_report_without_a_static_trial() {
    let dir = folder();
    let (poses, lab) = (theia(dir.path()), dir.path().join("keypoints"));
    keypoints(&poses, &lab);
    served(&lab, dir.path(), "halpe-26", "Pose2Sim", 12.0);
}
