//! `discover` asked again: the stored answer is shown if nothing that it rests on has changed, and
//! never otherwise.

use crate::support::{expect, folder, json, repo};
use std::fs;
use std::path::Path;

const BEFORE: &str = "stored answer";

fn damage(file: &Path) {
    let mut bytes = fs::read(file).unwrap();
    let middle = bytes.len() / 2;
    bytes[middle] ^= 1;
    fs::write(file, bytes).unwrap();
}

#[test]
fn the_same_question_is_answered_from_the_workspace_and_another_one_is_not() {
    let dir = folder();
    let ws = dir.path().join("ws").display().to_string();
    let pipeline = dir.path().join("p.yaml");
    let text = fs::read_to_string(repo("pipelines/demo.yaml")).unwrap();
    let text = text.replace("../fixtures/demo", &repo("fixtures/demo"));
    fs::write(&pipeline, &text).unwrap();
    let at = [&pipeline.display().to_string(), "--workspace", &ws];
    let two = ["--only", "quadratic_drag", "--only", "tether"];
    let ask = |more: &[&str]| expect(&[&["discover"], &at[..], more].concat(), 0);
    let from_before = |more: &[&str]| ask(more).1.contains(BEFORE);
    expect(&[&["run"], &at[..]].concat(), 0);

    let (first, said) = ask(&two);
    assert!(!said.contains(BEFORE), "{said}");
    let (second, said) = ask(&two);
    assert!(said.contains(BEFORE) && said.contains("--again"), "{said}");
    assert_eq!(first, second);
    let whole = json(&[&["discover"], &at[..], &two, &["--json"]].concat());
    let anew = json(&[&["discover"], &at[..], &two, &["--json", "--again"]].concat());
    assert_eq!(whole, anew);
    assert!(!from_before(&[&two[..], &["--again"]].concat()) && from_before(&two));

    // other options, and what depends on the clock
    assert!(!from_before(&["--only", "quadratic_drag"]) && !from_before(&two) && from_before(&two));
    let timed = [&two[..], &["--budget", "5"]].concat();
    assert!(!from_before(&timed) && !from_before(&timed) && !from_before(&two));

    // the pipeline: a stale result is said, and the answer is computed anew
    fs::write(&pipeline, text.replace("demo.yaml", "demo.yaml of today")).unwrap();
    assert_ne!(fs::read_to_string(&pipeline).unwrap(), text, "the test has lost its case");
    assert!(!from_before(&two) && from_before(&two));
    fs::write(&pipeline, format!("{text}regressor: {{window_s: 0.09}}\n")).unwrap();
    let (_, said) = ask(&two);
    assert!(!said.contains(BEFORE) && said.contains("stale"), "{said}");
    expect(&[&["run"], &at[..]].concat(), 0);
    assert!(!from_before(&two) && from_before(&two));

    // the model, there and back: another model is another question, and each has its answer when it
    // comes back
    let change = |action| {
        expect(&[&["effect", action], &at[..1], &["quadratic_drag[links]"], &at[1..]].concat(), 0);
    };
    let (plain, _) = ask(&two);
    change("add");
    assert!(!from_before(&two) && from_before(&two));
    let (with_drag, _) = ask(&two);
    assert_ne!(plain, with_drag);
    for _ in 0..2 {
        change("remove");
        let (came_back, said) = ask(&two);
        assert!(said.contains(BEFORE) && came_back == plain, "{came_back}\n{said}");
        change("add");
        let (came_back, said) = ask(&two);
        assert!(said.contains(BEFORE) && came_back == with_drag, "{came_back}\n{said}");
    }

    // a damaged answer is not shown
    for file in fs::read_dir(dir.path().join("ws/discoveries")).unwrap() {
        damage(&file.unwrap().path());
    }
    assert!(!from_before(&two) && from_before(&two));
}
