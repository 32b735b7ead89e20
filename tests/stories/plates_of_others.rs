//! Force plates that belong to another recording: nothing about the model can be learnt from them,
//! and their course in time shows whose they are.

use crate::support::{expect, folder, json, repo};
use aloft_c3d::C3dFile;
use std::fs;
use std::path::Path;

/// The channels of one recording in another one, as long as its own.
fn exchange(data: &Path, one: &str, other: &str) {
    let files = [one, other].map(|name| data.join(format!("{name}.c3d")));
    let [mut a, mut b] = files.clone().map(|file| C3dFile::from_bytes(&fs::read(file).unwrap()).unwrap());
    for (x, y) in a.analogs.iter_mut().zip(&mut b.analogs) {
        let lengths = [x.values.len(), y.values.len()];
        std::mem::swap(&mut x.values, &mut y.values);
        for (channel, n) in [x, y].into_iter().zip(lengths) {
            let last = *channel.values.last().unwrap();
            channel.values.resize(n, last);
        }
    }
    fs::write(&files[0], a.to_bytes().unwrap()).unwrap();
    fs::write(&files[1], b.to_bytes().unwrap()).unwrap();
}

#[test]
fn exchanged_plates_are_named_with_the_recording_that_they_belong_to() {
    let dir = folder();
    let (scenario, data) = (dir.path().join("scenario.yaml"), dir.path().join("data"));
    let person =
        "body: {kind: human, person: {sex: F, height_m: 1.66, mass_kg: 60.0}, protocol: {jumps: 5, exercises: 0}}";
    // a force that acts everywhere changes the size of what plates measure, not its course
    let force = "{effect: constant_force, link: torso, force_n: [15.0, 0.0, 20.0]}";
    fs::write(&scenario, format!("name: plates\nseed: 71\n{person}\nhidden: [{force}]\n")).unwrap();
    expect(&["simulate", &scenario.display().to_string(), "--out", &data.display().to_string()], 0);
    let pipeline = repo("pipelines/human.yaml");
    let compared = |name: &str| {
        let ws = dir.path().join(name).display().to_string();
        let at = ["--data", &data.display().to_string(), "--workspace", &ws];
        expect(&[&["run", &pipeline], &at[..]].concat(), 0);
        json(&[&["compare", &pipeline], &at[..], &["--json"]].concat())
    };
    let before = compared("before");
    let said = before["to_correct"]["words"].as_str().unwrap_or_default();
    assert!(!said.contains("plates"), "{said}");
    for trial in before["trials"].as_array().unwrap() {
        assert!(trial["plates_correlation"].as_f64().unwrap() > 0.98, "{trial}");
    }
    exchange(&data, "jump02", "jump04");
    let after = compared("after");
    let said = after["to_correct"]["words"].as_str().unwrap();
    assert!(said.contains("those in jump02 measured the motion of jump04"), "{said}");
    assert!(said.contains("those in jump04 measured the motion of jump02"), "{said}");
    assert!(!said.contains("jump01") && !said.contains("jump03") && !said.contains("jump05"), "{said}");
    assert_eq!(after["to_correct"]["first"], true);
}
