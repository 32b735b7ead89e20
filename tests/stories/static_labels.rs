//! Labels that are exchanged in the static trial alone: every recording then differs from it, and
//! the model is built on the wrong markers.

use crate::robot::copy;
use crate::support::{expect, folder, repo, unwrapped};
use std::fs;
use std::path::Path;

/// Exchanges two labels of equal length in a C3D file.
fn exchange(file: &Path, a: &[u8], b: &[u8]) {
    let mut bytes = fs::read(file).unwrap();
    let at = |what: &[u8]| -> Vec<usize> {
        (0..bytes.len() - what.len()).filter(|i| bytes[*i..].starts_with(what)).collect()
    };
    let (first, second) = (at(a), at(b));
    assert!(!first.is_empty() && !second.is_empty());
    first.into_iter().for_each(|i| bytes[i..i + b.len()].copy_from_slice(b));
    second.into_iter().for_each(|i| bytes[i..i + a.len()].copy_from_slice(a));
    fs::write(file, bytes).unwrap();
}

#[test]
fn a_static_trial_with_heel_and_ankle_exchanged_is_named_first() {
    let dir = folder();
    let data = dir.path().join("lab");
    copy(Path::new(&repo("fixtures/human_twin")), &data);
    exchange(&data.join("static.c3d"), b"LANK", b"LHEE");
    let pipeline = dir.path().join("aloft.yaml").display().to_string();
    let text = fs::read_to_string(repo("pipelines/demo_human.yaml")).unwrap();
    fs::write(&pipeline, text.replace("../fixtures/human_tethered", &data.display().to_string())).unwrap();
    let ws = dir.path().join("ws").display().to_string();
    let (said, _) = expect(&["run", &pipeline, "--workspace", &ws], 0);
    let said = unwrapped(said.as_bytes());
    assert!(said.contains("check the labels of the static trial: in the static, `LANK` on the malleolus"), "{said}");
    let (told, checked) = expect(&["check", &pipeline, "--workspace", &ws], 0);
    let line = unwrapped((told + &checked).as_bytes());
    assert!(line.contains("labels against the static trial: in the static, `LANK`"), "{line}");
}
