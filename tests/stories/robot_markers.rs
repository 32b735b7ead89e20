//! A robot without a table of its base: markers in C3D beside the log.

use crate::support::{expect, folder, repo};
use std::fs;
use std::path::Path;

/// The fixture without `_base.csv`.
fn lab(at: &Path) -> std::path::PathBuf {
    let data = at.join("lab");
    super::robot::copy(Path::new(&repo("fixtures/robot")), &data);
    for trial in ["throw_01", "throw_02"] {
        fs::remove_file(data.join(format!("{trial}_base.csv"))).unwrap();
    }
    data
}

fn call(data: &Path, ws: &str, words: &[&str], code: i32) -> (String, String) {
    let robot = repo("pipelines/robot.yaml");
    let data = data.display().to_string();
    let mut all = vec![words[0], &robot, "--data", &data, "--workspace", ws];
    all.extend(&words[1..]);
    expect(&all, code)
}

#[test]
fn markers_on_the_base_stand_in_for_its_poses() {
    let dir = folder();
    let data = lab(dir.path());
    let ws = dir.path().join("ws").display().to_string();
    call(&data, &ws, &["run"], 0);
    for trial in ["throw_01", "throw_02"] {
        let fusion: serde_json::Value =
            serde_json::from_str(&fs::read_to_string(format!("{ws}/ik/{trial}/fusion.json")).unwrap()).unwrap();
        // the first frame of the markers is 0.07 s after that of the log
        let (offset, sd) = (fusion["clock_offset_s"].as_f64().unwrap(), fusion["clock_offset_sd_s"].as_f64().unwrap());
        assert!((offset + 0.07).abs() < 4.0 * sd && sd < 1e-4, "{trial}: {offset} ± {sd}");
        let noise = fusion["noise"]["position_m"].as_f64().unwrap();
        assert!((0.5e-4..3e-4).contains(&noise), "{noise}");
        let links: serde_json::Value =
            serde_json::from_str(&fs::read_to_string(format!("{ws}/ik/{trial}/link_markers.json")).unwrap()).unwrap();
        assert_eq!(links.as_array().unwrap().len(), 3);
        for marker in links.as_array().unwrap() {
            let miss: f64 = (0..3).map(|k| marker["miss_m"][k].as_f64().unwrap().powi(2)).sum::<f64>().sqrt();
            assert!(miss < 3e-4, "{marker}");
        }
    }
    let ladder: serde_json::Value = serde_json::from_str(&call(&data, &ws, &["history", "--json"], 0).0).unwrap();
    let rung = &ladder["revisions"][0];
    let (error, floor) = (rung["held_out_error"].as_f64().unwrap(), rung["noise_floor"].as_f64().unwrap());
    assert!(error < 3.0 * floor, "{error} N at a floor of {floor} N");
    // the same parameters as from the table of poses
    let truth: serde_json::Value =
        serde_json::from_str(&fs::read_to_string(repo("fixtures/robot/truth.json")).unwrap()).unwrap();
    let found: serde_json::Value = serde_json::from_str(&call(&data, &ws, &["parameters", "--json"], 0).0).unwrap();
    for link in found["links"].as_array().unwrap() {
        let name = link["name"].as_str().unwrap();
        let mass = truth["links"][name]["mass_kg"].as_f64().unwrap();
        let ci = &link["ci95"]["mass_kg"];
        assert!(ci[0].as_f64().unwrap() < mass && mass < ci[1].as_f64().unwrap(), "{name}: {mass} kg outside {ci}");
    }
}

#[test]
fn markers_that_are_missing_unknown_or_elsewhere_give_one_line() {
    let dir = folder();
    let data = lab(dir.path());
    let ws = dir.path().join("ws").display().to_string();
    let described = fs::read_to_string(data.join("robot.yaml")).unwrap();
    let line = |told: &str, what: &str| {
        let lines: Vec<&str> = told.lines().filter(|l| l.contains(what)).collect();
        assert!(!lines.is_empty(), "expected {what}:\n{told}");
    };
    // one marker of six elsewhere is left out, with a remark
    let moved = described.replace("position_m: [0.09, 0.01, -0.09]", "position_m: [0.09, 0.01, 0.09]");
    fs::write(data.join("robot.yaml"), moved).unwrap();
    let (told, said) = call(&data, &ws, &["check"], 0);
    line(&(told + &said), "`T5` is 1");
    // a forearm's marker elsewhere: the check of the encoders says so
    let moved = described.replace("position_m: [-0.02, 0.02, -0.18]", "position_m: [-0.02, 0.02, -0.15]");
    fs::write(data.join("robot.yaml"), moved).unwrap();
    let (told, said) = call(&data, &ws, &["run", "--details"], 0);
    line(&(told + &said), "the marker `L2` on `l_lower` is 30 mm from where the encoders put it");
    // labels of another laboratory
    fs::write(data.join("robot.yaml"), described.replace("  T", "  Rumpf")).unwrap();
    let (_, said) = call(&data, &ws, &["run"], 1);
    line(
        &said,
        "0 of the 6 markers on the base `trunk` are in the recording, expected 3 at least: `Rumpf1` is missing",
    );
    // no markers in the description
    let bare = described.split("markers:").next().unwrap();
    fs::write(data.join("robot.yaml"), bare).unwrap();
    let (_, said) = call(&data, &ws, &["run"], 1);
    line(&said, "the description places 0 markers on the base `trunk`");
}
