//! Few flights determine a body only roughly: an error that follows from that is no evidence that
//! something is missing, and does not hide what is large.

use crate::support::{expect, folder, json, repo};
use std::fs;

/// The answer on two recordings of three throws each.
fn asked(hidden: &str) -> serde_json::Value {
    let dir = folder();
    let scenario = dir.path().join("scenario.yaml");
    let body = "body: {kind: chain, throws: {recordings: 2, throws: 3}}\ncapture: {marker_noise_m: 0.0003}\n";
    fs::write(&scenario, format!("name: few\nseed: 64\n{body}hidden: {hidden}\n")).unwrap();
    let (data, ws) = (dir.path().join("data"), dir.path().join("ws"));
    expect(&["simulate", &scenario.display().to_string(), "--out", &data.display().to_string()], 0);
    let chain = repo("pipelines/chain.yaml");
    let places = ["--data", &data.display().to_string(), "--workspace", &ws.display().to_string()];
    expect(&[&["run", &chain], &places[..]].concat(), 0);
    json(&[&["discover", &chain, "--closed", "--json"], &places[..]].concat())
}

#[test]
fn an_error_of_roughly_determined_parameters_is_not_unexplained() {
    let number = |found: &serde_json::Value, key: &str| found[key].as_f64().unwrap();
    let found = asked("[]");
    let (error, floor) = (number(&found, "held_out_error"), number(&found, "noise_floor"));
    assert!(error > 2.0 * floor && error < number(&found, "error_by_parameters"), "{found}");
    assert_eq!(found["verdict"], "not_detectable", "{}", found["words"]);
    let words = found["words"].as_str().unwrap();
    assert!(words.contains("these flights determine the body only roughly"), "{words}");

    let found = asked("[{effect: constant_force, link: link0, force_n: [0.6, 0.4, 0.0]}]");
    assert!(number(&found, "held_out_error") > 2.0 * number(&found, "error_by_parameters"), "{found}");
    assert_ne!(found["verdict"], "not_detectable", "{}", found["words"]);
    assert_ne!(found["verdict"], "nothing_missing", "{}", found["words"]);
}
