//! Few flights determine a body only roughly: an error that follows from that is no evidence that
//! something is missing, and does not hide what is large.

use crate::support::{expect, folder, json, repo};
use std::fs;

/// Two recordings of three throws each.
const THROWS: &str = "body: {kind: chain, throws: {recordings: 2, throws: 3}}\ncapture: {marker_noise_m: 0.0003}\n";

/// The answer on a body.
fn asked(kind: &str, body: &str, hidden: &str) -> serde_json::Value {
    let dir = folder();
    let scenario = dir.path().join("scenario.yaml");
    fs::write(&scenario, format!("name: few\nseed: 74\n{body}hidden: {hidden}\n")).unwrap();
    let (data, ws) = (dir.path().join("data"), dir.path().join("ws"));
    expect(&["simulate", &scenario.display().to_string(), "--out", &data.display().to_string()], 0);
    let pipeline = repo(&format!("pipelines/{kind}.yaml"));
    let places = ["--data", &data.display().to_string(), "--workspace", &ws.display().to_string()];
    expect(&[&["run", &pipeline], &places[..]].concat(), 0);
    json(&[&["discover", &pipeline, "--closed", "--json"], &places[..]].concat())
}

#[test]
fn an_error_of_roughly_determined_parameters_is_not_unexplained() {
    let number = |found: &serde_json::Value, key: &str| found[key].as_f64().unwrap();
    let found = asked("chain", THROWS, "[]");
    let (error, floor) = (number(&found, "held_out_error"), number(&found, "noise_floor"));
    assert!(error > 2.0 * floor && error < number(&found, "error_by_parameters"), "{found}");
    assert_eq!(found["verdict"], "not_detectable", "{}", found["words"]);
    let words = found["words"].as_str().unwrap();
    assert!(words.contains("these recordings determine the body only roughly"), "{words}");

    let found = asked("chain", THROWS, "[{effect: constant_force, link: link0, force_n: [0.6, 0.4, 0.0]}]");
    assert!(number(&found, "held_out_error") > 2.0 * number(&found, "error_by_parameters"), "{found}");
    assert_ne!(found["verdict"], "not_detectable", "{}", found["words"]);
    assert_ne!(found["verdict"], "nothing_missing", "{}", found["words"]);
}

/// Jumps without exercises: flights leave the body open, and the plates, which weigh it in contact,
/// show that.
#[test]
fn contact_after_a_few_jumps_is_judged_by_what_they_determine() {
    let body =
        "body: {kind: human, person: {sex: M, height_m: 1.76, mass_kg: 72.0}, protocol: {jumps: 5, exercises: 0}}\n";
    let found = asked("human", body, "[]");
    assert!(["not_detectable", "nothing_missing"].contains(&found["verdict"].as_str().unwrap()), "{found}");
    let hand = "[{effect: constant_force, link: hand_r, force_n: [40.0, 0.0, 0.0]}]";
    let found = asked("human", body, hand);
    assert!(!["not_detectable", "nothing_missing"].contains(&found["verdict"].as_str().unwrap()), "{found}");
}
