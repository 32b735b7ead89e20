//! A tilt of gravity that hardly shows in flight: a force that imitates soft tissue there, and
//! would spoil the agreement with the plates, must not be named.

use crate::support::{expect, folder, json, repo};

#[test]
fn what_contact_contradicts_is_not_named() {
    let dir = folder();
    let path = |name: &str| dir.path().join(name).display().to_string();
    let (lab, ws) = (path("lab"), path("ws"));
    expect(&["simulate", &repo("configs/scenarios/human_tilt.yaml"), "--out", &lab], 0);
    let pipeline = repo("pipelines/human.yaml");
    let at = ["--data", &lab, "--workspace", &ws];
    expect(&[&["run", &pipeline][..], &at].concat(), 0);
    let found = json(&[&["discover", &pipeline, "--closed", "--json"][..], &at].concat());
    let names: Vec<&str> = found["effects"].as_array().unwrap().iter().map(|e| e.as_str().unwrap()).collect();
    assert!(names.contains(&"gravity_tilt") && !names.contains(&"thrust"), "{names:?}: {}", found["words"]);
    let contact = |errors: &serde_json::Value| {
        let of = |e: &&serde_json::Value| e["judged_on"] == "contact";
        errors.as_array().unwrap().iter().find(of).unwrap()["held_out_error"].as_f64().unwrap()
    };
    assert!(contact(&found["errors_after"]) < contact(&found["errors"]), "{}", found["errors_after"]);
}
