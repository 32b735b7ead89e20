//! Plates that are late: the session check finds it unaided, the pipeline's `corrections` take it
//! off, and the ladder shows what that was worth.

use crate::support::{aloft, expect, folder, json, repo};
use serde_json::Value;
use std::fs;

fn line<'v>(check: &'v Value, id: &str) -> &'v Value {
    check["session"]["lines"].as_array().unwrap().iter().find(|l| l["id"] == id).unwrap_or(&Value::Null)
}

#[test]
fn late_plates_are_offered_as_a_correction_and_become_a_rung_of_the_ladder() {
    let dir = folder();
    let lab = dir.path().join("lab").display().to_string();
    let pipeline = dir.path().join("lab.yaml").display().to_string();
    let ws = dir.path().join("ws").display().to_string();
    // 5 ms late, displaced by some millimetres, and not tared
    expect(&["simulate", &repo("configs/scenarios/human_plates.yaml"), "--out", &lab], 0);
    expect(&["init", &lab, "--out", &pipeline], 0);
    expect(&["run", &pipeline, "--workspace", &ws], 0);
    let words = |args: &[&str]| json(&[args, &["--workspace", &ws, "--json"]].concat());
    let before = words(&["check", &pipeline]);
    let delay = line(&before, "plate_delay");
    assert_eq!(delay["standing"], "differs", "{delay}");
    assert!((delay["value"].as_f64().unwrap() - 5.0).abs() < 1.5, "{delay}");
    let offer = before["offers"].as_array().unwrap().iter().find(|o| o["key"] == "plate_delay_s").unwrap();
    assert!(offer["evidence"].as_str().unwrap().contains("contacts between flights"), "{offer}");
    // the block of `check` is what a pipeline takes
    let (shown, _) = expect(&["check", &pipeline, "--workspace", &ws], 0);
    let block = shown.split("corrections:\n").nth(1).unwrap();
    let own: String = block.lines().filter(|l| l.contains("plate_delay_s")).map(|l| format!("{l}\n")).collect();
    let text = fs::read_to_string(&pipeline).unwrap();
    fs::write(&pipeline, format!("{text}corrections:\n{own}")).unwrap();
    expect(&["run", &pipeline, "--workspace", &ws], 0);
    let after = words(&["check", &pipeline]);
    let left = line(&after, "plate_delay");
    assert!(left["value"].as_f64().unwrap().abs() < 0.5, "{left}");
    assert!(after["offers"].as_array().unwrap().iter().all(|o| o["key"] != "plate_delay_s"));
    let history = words(&["history", &pipeline]);
    let rungs = history["revisions"].as_array().unwrap();
    assert_eq!(rungs.len(), 2, "{history}");
    assert_eq!(rungs[1]["action"], "correct plate_delay_s");
    assert_eq!(rungs[1]["corrections"][0], "plate_delay_s");
    assert!(rungs[1]["void"].is_null(), "{}", rungs[1]["void"]);
    let error = |r: &Value| {
        let errors = r["errors"].as_array().unwrap();
        errors.iter().find(|e| e["judged_on"] == "contact").unwrap()["held_out_error"].as_f64().unwrap()
    };
    assert!(error(&rungs[1]) < error(&rungs[0]), "{} {}", error(&rungs[0]), error(&rungs[1]));
    // without the correction the model is that of the first rung again
    fs::write(&pipeline, &text).unwrap();
    expect(&["run", &pipeline, "--workspace", &ws], 0);
    let history = words(&["history", &pipeline]);
    let rungs = history["revisions"].as_array().unwrap();
    assert_eq!(rungs.len(), 3);
    assert_eq!(rungs[2]["action"], "without the correction of plate_delay_s");
    assert!((error(&rungs[2]) / error(&rungs[0]) - 1.0).abs() < 1e-9);
    // an impossible value is refused with its place
    fs::write(&pipeline, format!("{text}corrections:\n  plate_delay_s: 3.0\n")).unwrap();
    let refused = aloft(&["run", &pipeline, "--workspace", &ws]);
    assert_eq!(refused.status.code(), Some(2));
    assert!(String::from_utf8_lossy(&refused.stderr).contains("plate_delay_s"));
}
