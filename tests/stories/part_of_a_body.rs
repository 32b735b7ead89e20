//! A gait laboratory without markers above the pelvis: from `init` to the report, and nothing is
//! claimed that the equations of the whole body would have to carry.

use crate::support::{aloft, expect, folder, json, repo};
use aloft_c3d::C3dFile;
use std::fs;
use std::path::Path;

/// Simulates the small laboratory and takes the markers of some links off.
fn lab(dir: &Path, without: &[&str]) -> String {
    let lab = dir.join("lab");
    expect(&["simulate", &repo("fixtures/scenarios/human_small.yaml"), "--out", &lab.display().to_string()], 0);
    for entry in fs::read_dir(&lab).unwrap() {
        let path = entry.unwrap().path();
        if path.extension().is_none_or(|e| e != "c3d") {
            continue;
        }
        let mut file = C3dFile::from_bytes(&fs::read(&path).unwrap()).unwrap();
        file.points.retain(|p| !without.contains(&p.label.as_str()));
        fs::write(&path, file.to_bytes().unwrap()).unwrap();
    }
    lab.display().to_string()
}

const ARMS: [&str; 10] = ["LELB", "RELB", "LWRA", "LWRB", "RWRA", "RWRB", "LFIN", "RFIN", "LELM", "RELM"];
const HEAD: [&str; 4] = ["LFHD", "RFHD", "LBHD", "RBHD"];
const TRUNK: [&str; 7] = ["C7", "T10", "CLAV", "STRN", "RBAK", "LSHO", "RSHO"];

fn served(without: &[&str], model: &str, links: usize, unseen: &str) {
    let dir = folder();
    let lab = lab(dir.path(), without);
    let pipeline = dir.path().join("lab.yaml").display().to_string();
    let ws = dir.path().join("ws").display().to_string();
    expect(&["init", &lab, "--out", &pipeline], 0);
    let text = fs::read_to_string(&pipeline).unwrap();
    assert!(text.contains(&format!("model: {model}   # no markers on {unseen}")), "{text}");
    expect(&["run", &pipeline, "--workspace", &ws], 0);
    let found = json(&["compare", &pipeline, "--workspace", &ws, "--json"]);
    assert!(found["limits"][0].as_str().unwrap().starts_with(unseen), "{}", found["limits"]);
    assert!(found["parameters"]["nothing"].as_str().unwrap().contains("nothing is identified"));
    // the plates are compared for information, without floor, judgement or attribution
    assert!(found["errors"][0]["held_out_error"].as_f64().unwrap() > 0.0);
    assert!(found["errors"].as_array().unwrap().iter().all(|e| e["noise_floor"].is_null() && e["signal"] == "unknown"));
    assert!(found["errors"].as_array().unwrap().iter().all(|e| e["judged_on"] != "flight"));
    assert!(found["words"].as_array().unwrap().is_empty() && found["worst"].as_array().unwrap().is_empty());
    let markers = found["kinematics"][0]["marker_rms_mm"].as_f64().unwrap();
    assert!(markers < 3.0, "{markers} mm");
    // the whole mass is in the model
    let subject = fs::read_dir(format!("{ws}/calibrate")).unwrap().next().unwrap().unwrap().path().join("subject.json");
    let subject: aloft_body::Subject = serde_json::from_str(&fs::read_to_string(subject).unwrap()).unwrap();
    assert_eq!(subject.model.n_links(), links);
    assert!((subject.prior.iter().map(|l| l.mass_kg).sum::<f64>() - 61.5).abs() < 1e-9);
    assert!(!subject.model.is_whole());
    for command in ["parameters", "discover"] {
        let refused = aloft(&[command, &pipeline, "--workspace", &ws]);
        assert_eq!(refused.status.code(), Some(2), "{command}");
        let words = String::from_utf8_lossy(&refused.stderr).replace(['│', '×'], " ");
        let words = words.split_whitespace().collect::<Vec<_>>().join(" ");
        assert!(words.contains(&format!("{unseen} move unseen")), "{command}: {words}");
    }
    expect(&["report", &pipeline, "--workspace", &ws], 0);
    let page = fs::read_to_string(format!("{ws}/report.html")).unwrap();
    assert!(page.contains("nothing is identified or judged"));
    // commands that refuse are not proposed
    assert!(
        page.contains("Cannot be told") && !page.contains("aloft discover ") && !page.contains("aloft parameters ")
    );
}

#[test]
fn legs_and_pelvis_are_served_without_a_judgement() {
    let without: Vec<&str> = ARMS.iter().chain(&HEAD).chain(&TRUNK).copied().collect();
    served(&without, "legs_pelvis", 7, "trunk, head and arms");
}

#[test]
fn legs_pelvis_and_trunk_are_served_without_a_judgement() {
    let without: Vec<&str> = ARMS.iter().chain(&HEAD).copied().collect();
    served(&without, "legs_pelvis_trunk", 8, "head and arms");
}

#[test]
fn a_whole_body_model_whose_arms_no_marker_shows_is_not_a_whole_body() {
    let dir = folder();
    let lab = lab(dir.path(), &ARMS);
    let pipeline = dir.path().join("lab.yaml").display().to_string();
    let ws = dir.path().join("ws").display().to_string();
    expect(&["init", &lab, "--out", &pipeline], 0);
    let text = fs::read_to_string(&pipeline).unwrap();
    let line = text.lines().find(|l| l.starts_with("model:")).unwrap().to_owned();
    fs::write(&pipeline, text.replace(&line, "model: human34")).unwrap();
    expect(&["run", &pipeline, "--workspace", &ws], 0);
    let found = json(&["compare", &pipeline, "--workspace", &ws, "--json"]);
    assert!(found["limits"][0].as_str().unwrap().starts_with("arms move unseen"), "{}", found["limits"]);
    assert!(found["parameters"]["nothing"].as_str().is_some());
}
