//! Exported recordings are recordings: read again in each format that is both written and read,
//! they give the same result.

use crate::support::*;
use std::fs;

#[test]
fn regress_exported_recordings_give_the_same_result() {
    let dir = folder();
    let at = |name: &str| dir.path().join(name).display().to_string();
    let pipeline = repo("pipelines/demo.yaml");
    let places = [pipeline.as_str(), "--data", &repo("fixtures/demo"), "--workspace", &at("ws")];
    expect(&[&["run"], &places[..]].concat(), 0);
    expect(&[&["export"], &places[..], &["--format", "c3d,trc,bids", "--to", &at("out")]].concat(), 0);
    let error = |places: &[&str]| {
        let found = json(&[&["compare"], places, &["--json"]].concat());
        // in BIDS every subject has a folder of its own, also the only one
        let own = found["studies"].get(0).map_or(&found, |study| &study["result"]);
        let error = &own["errors"][0];
        [&error["held_out_error"], &error["noise_floor"]].map(|v| v.as_f64().unwrap())
    };
    let before = error(&places);
    let again = at("again.yaml");
    let text = "name: again\nmodel: two_link\nmarker_set: two-link-chain\nobject: two_link_chain\n\
                subject: {mass_kg: 0.997, gravity_mps2: 9.81}\n\
                trials: {static: ['**/*static*'], calibration: ['**/*calib*'], identify: ['**/*throws*'], validate: []}\n\
                filter: {order: 3, cutoff_hz: 10.0}\n";
    fs::write(&again, text).unwrap();
    for folder in ["C3D", "MarkerData", "BIDS"] {
        let (data, ws) = (at(&format!("out/{folder}")), at(folder));
        let places = [again.as_str(), "--data", &data, "--workspace", &ws];
        expect(&[&["run"], &places[..]].concat(), 0);
        let after = error(&places);
        for (a, b) in before.iter().zip(after) {
            assert!((b / a - 1.0).abs() < 0.01, "{folder}: {before:?} {after:?}");
        }
    }
    // and `init` finds the motion in them
    let written = at("bids.yaml");
    expect(&["init", &at("out/BIDS"), "--out", &written], 0);
    let text = fs::read_to_string(&written).unwrap();
    assert!(text.contains("identify: [\"**/*task-throws*"), "{text}");
}
