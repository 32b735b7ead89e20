//! The story of the README on the recordings in the repository.

use crate::support::{expect, folder, json, repo};
use std::fs;

#[test]
fn the_demonstration_goes_from_recordings_to_a_report() {
    let dir = folder();
    let ws = dir.path().join("ws").display().to_string();
    let demo = repo("pipelines/demo.yaml");
    expect(&["run", &demo, "--workspace", &ws], 0);

    let found = json(&["parameters", &demo, "--workspace", &ws, "--json"]);
    let truth: serde_json::Value =
        serde_json::from_str(&fs::read_to_string(repo("fixtures/demo/truth/truth.json")).unwrap()).unwrap();
    let base = found["base"].as_array().unwrap();
    assert_eq!(base.len(), 17);
    assert_eq!(truth["base"].as_array().unwrap().len(), 17);
    for key in ["name", "value", "se", "unit", "formula"] {
        assert!(!base[3][key].is_null(), "parameters --json lacks base[].{key}");
    }
    assert!(found["sigma"]["second"].as_f64().unwrap() > found["sigma"]["min"].as_f64().unwrap());

    let compared = json(&["compare", &demo, "--workspace", &ws, "--json"]);
    assert!(compared["flight"]["residual_force_n"]["rms"][0].is_number());
    assert!(compared["parameters"]["sigma_ratio"].is_number());
    assert!(compared["trials"].as_array().is_some_and(|t| !t.is_empty()));

    let (page, _) = expect(&["report", &demo, "--workspace", &ws], 0);
    let html = fs::read_to_string(page.trim()).unwrap();
    assert!(html.len() < 10_000_000 && html.contains("Identified parameters"));
}
