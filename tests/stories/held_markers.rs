//! Markers that repeat one position exactly, as programs fill a gap: missing in every format, said
//! by `run` and `check`, and no error of the model.

use crate::shared::shared_data;
use crate::support::{expect, folder, json, repo, unwrapped};
use aloft_c3d::C3dFile;
use std::fs;
use std::path::Path;

/// Copies the recordings of a person; `change` changes those of the first jump.
fn lab(at: &Path, from: &Path, change: impl Fn(&mut C3dFile)) -> String {
    fs::create_dir(at).unwrap();
    for name in ["subject.yaml", "static.c3d", "exercise01.c3d", "jump02.c3d", "jump03.c3d", "jump04.c3d"] {
        fs::copy(from.join(name), at.join(name)).unwrap();
    }
    let mut jump = C3dFile::from_bytes(&fs::read(from.join("jump01.c3d")).unwrap()).unwrap();
    change(&mut jump);
    fs::write(at.join("jump01.c3d"), jump.to_bytes().unwrap()).unwrap();
    at.display().to_string()
}

fn hold(file: &mut C3dFile, label: &str, frames: std::ops::Range<usize>) {
    let point = file.points.iter_mut().find(|p| p.label == label).unwrap();
    let held = point.xyz[frames.start];
    point.xyz[frames].fill(held);
}

/// Error in flight of a model of these recordings, and what `run` printed.
fn run(lab: &str, ws: &Path) -> (f64, String) {
    let (pipeline, ws) = (repo("pipelines/human.yaml"), ws.display().to_string());
    let at = [&pipeline, "--data", lab, "--workspace", &ws];
    let (said, _) = expect(&[&["run"], &at[..]].concat(), 0);
    let view = json(&[&["compare"], &at[..], &["--json"]].concat());
    let of = |e: &&serde_json::Value| e["judged_on"] == "flight";
    let error = view["errors"].as_array().unwrap().iter().find(of).unwrap()["held_out_error"].as_f64().unwrap();
    (error, unwrapped(said.as_bytes()))
}

#[test]
fn a_held_marker_is_missing_named_and_spoils_nothing() {
    let Some(from) = shared_data("subject_a") else { return };
    let dir = folder();
    let (clean, said) = run(&lab(&dir.path().join("clean"), &from, |_| ()), &dir.path().join("ws"));
    assert!(!said.contains("repeats one position"), "{said}");

    let held = lab(&dir.path().join("held"), &from, |jump| hold(jump, "LKNE", 400..500));
    let (error, said) = run(&held, &dir.path().join("ws_held"));
    assert!((error / clean - 1.0).abs() < 0.05, "{error} N, {clean} N without");
    let told = "marker `LKNE` repeats one position exactly in 100 frames, frames 401 to 500, while others move: it is missing there";
    assert!(said.contains(&format!("jump01: {told}")) && said.contains("held marker"), "{said}");
    let (_, said) = expect(&["check", &repo("pipelines/human.yaml"), "--data", &held], 0);
    assert!(unwrapped(said.as_bytes()).contains(&format!("{told} (jump01)")), "{said}");

    // two markers of one segment, and one until the end
    let held = lab(&dir.path().join("several"), &from, |jump| {
        hold(jump, "LKNE", 400..450);
        hold(jump, "LTIB", 400..450);
        hold(jump, "RKNE", 0..80);
        let end = jump.n_frames;
        hold(jump, "RFIN", end - 80..end);
    });
    let (error, said) = run(&held, &dir.path().join("ws_several"));
    assert!((error / clean - 1.0).abs() < 0.1, "{error} N, {clean} N without");
    assert!(["`LKNE`", "`LTIB`", "`RKNE`", "`RFIN`"].iter().all(|m| said.contains(m)), "{said}");
}
