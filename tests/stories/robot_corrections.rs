//! Corrections that the session check offers for robots and thrown objects change their results.

use crate::support::{aloft, expect, folder, json, repo, unwrapped};
use serde_json::Value;
use std::fs;
use std::path::Path;

fn error(rung: &Value) -> f64 {
    rung["errors"].as_array().unwrap().iter().find(|e| e["judged_on"] == "flight").unwrap()["held_out_error"]
        .as_f64()
        .unwrap()
}

/// Runs, writes the corrections that `check` offers into the pipeline, runs again: they are offered
/// no more, and the error of flights falls. Returns what was written.
fn corrected(pipeline: &Path, ws: &Path, keys: &[&str]) -> String {
    let (at, ws) = (pipeline.display().to_string(), ws.display().to_string());
    let words = |verb: &str| json(&[verb, &at, "--workspace", &ws, "--json"]);
    expect(&["run", &at, "--workspace", &ws], 0);
    let before = words("check");
    let offered: Vec<&str> = before["offers"].as_array().unwrap().iter().map(|o| o["key"].as_str().unwrap()).collect();
    assert_eq!(offered, keys, "{}", before["session"]);
    let lines: String = before["offers"]
        .as_array()
        .unwrap()
        .iter()
        .flat_map(|o| o["yaml"].as_str().unwrap().lines())
        .map(|l| format!("  {l}\n"))
        .collect();
    let text = fs::read_to_string(pipeline).unwrap();
    fs::write(pipeline, format!("{text}corrections:\n{lines}")).unwrap();
    expect(&["run", &at, "--workspace", &ws], 0);
    assert!(words("check")["offers"].as_array().unwrap().is_empty(), "{}", words("check")["offers"]);
    let rungs = words("history")["revisions"].as_array().unwrap().clone();
    let (was, is) = (error(&rungs[0]), error(&rungs[1]));
    assert!(is < 0.7 * was, "{was} N before, {is} N after");
    lines
}

/// The poses of a robot in a room that is turned about x by an angle, and recorded with times that
/// are wrong by a factor.
fn spoil(from: &Path, to: &Path, turned_deg: f64, slower: f64) {
    let (sin, cos) = turned_deg.to_radians().sin_cos();
    let (s, c) = (0.5 * turned_deg.to_radians()).sin_cos();
    let text = fs::read_to_string(from).unwrap();
    let mut lines = text.lines();
    let mut out = format!("{}\n", lines.next().unwrap());
    for line in lines {
        let v: Vec<f64> = line.split(',').map(|x| x.parse().unwrap_or(f64::NAN)).collect();
        let [t, x, y, z, qw, qx, qy, qz] = v[..] else { panic!("{line}") };
        let row = [
            t * slower,
            x,
            cos * y - sin * z,
            sin * y + cos * z,
            c * qw - s * qx,
            c * qx + s * qw,
            c * qy - s * qz,
            c * qz + s * qy,
        ];
        out += &(row.map(|x| format!("{x:.9}")).join(",") + "\n");
    }
    fs::write(to, out).unwrap();
}

/// `corrections` were offered for robots and did nothing.
#[test]
fn a_tilted_room_of_a_robot_is_offered_and_corrected() {
    let dir = folder();
    let data = dir.path().join("lab");
    super::robot::copy(Path::new(&repo("fixtures/robot")), &data);
    for name in ["throw_01_base.csv", "throw_02_base.csv"] {
        let file = data.join(name);
        spoil(&file, &file, 3.0, 1.0);
    }
    let pipeline = dir.path().join("robot.yaml");
    let text = fs::read_to_string(repo("pipelines/robot.yaml")).unwrap();
    fs::write(&pipeline, text.replace("../fixtures/robot", &data.display().to_string())).unwrap();
    let block = corrected(&pipeline, &dir.path().join("ws"), &["vertical_deg"]);
    let list = block.split('[').nth(1).unwrap().split(']').next().unwrap();
    let found: Vec<f64> = list.split(',').map(|w| w.trim().parse().unwrap()).collect();
    assert!((found[0] - 3.0).abs() < 0.3 && found[1].abs() < 0.3, "{block}");

    // what cannot be corrected is refused
    let text = fs::read_to_string(&pipeline).unwrap();
    fs::write(&pipeline, text.replace("corrections:\n", "corrections:\n  plate_delay_s: 0.004\n")).unwrap();
    let ws = dir.path().join("ws").display().to_string();
    let refused = aloft(&["run", &pipeline.display().to_string(), "--workspace", &ws]);
    let said = unwrapped(&refused.stderr) + &unwrapped(&refused.stdout);
    assert_ne!(refused.status.code(), Some(0), "{said}");
    assert!(said.contains("`corrections: plate_delay_s` corrects force plates"), "{said}");
}

#[test]
fn a_tilted_room_of_a_thrown_chain_is_offered_and_corrected() {
    let dir = folder();
    let scenario = dir.path().join("tilted.yaml");
    fs::write(
        &scenario,
        "name: tilted\nseed: 9\nbody:\n  kind: chain\n  throws: {recordings: 3, throws: 4, static_s: 1.0, calibration_s: 8.0}\n\
         hidden:\n  - {effect: gravity_tilt, about_x_deg: 2.0, about_y_deg: 0.0}\n",
    )
    .unwrap();
    let data = dir.path().join("lab");
    expect(&["simulate", &scenario.display().to_string(), "--out", &data.display().to_string()], 0);
    let pipeline = dir.path().join("chain.yaml");
    let text = fs::read_to_string(repo("pipelines/chain.yaml")).unwrap();
    fs::write(&pipeline, format!("{text}data: {}\n", data.display())).unwrap();
    let block = corrected(&pipeline, &dir.path().join("ws"), &["vertical_deg"]);
    let list = block.split('[').nth(1).unwrap().split(']').next().unwrap();
    let found: Vec<f64> = list.split(',').map(|w| w.trim().parse().unwrap()).collect();
    assert!((found[0] - 2.0).abs() < 0.3 && found[1].abs() < 0.3, "{block}");
}
