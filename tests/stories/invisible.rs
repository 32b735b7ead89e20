//! Effects that the recordings cannot show: `effect add` refuses them, and if an older study holds
//! them, they are shown without any number.

use crate::support::{aloft, expect, folder, json, repo};
use aloft_effects::{EFFECTS, EffectInstance, Scene};
use aloft_study::revision::{ModelEffect, Revisions};
use serde_json::Value;
use std::fs;
use std::path::{Path, PathBuf};

/// Base parameters and links of a workspace: name, value and scale (the value, or its standard
/// error if that is larger).
fn numbers(parameters: &Value) -> Vec<(String, f64, f64)> {
    let mut out = Vec::new();
    for b in parameters["base"].as_array().unwrap() {
        let (v, se) = (b["value"].as_f64().unwrap(), b["se"].as_f64().unwrap());
        out.push((b["name"].as_str().unwrap().to_owned(), v, v.abs().max(se)));
        out.push((format!("{} ±", b["name"]), se, se.max(1e-9 * v.abs())));
    }
    for l in parameters["links"].as_array().unwrap() {
        let mass = l["mass_kg"].as_f64().unwrap();
        out.push((format!("mass of {}", l["name"]), mass, mass));
    }
    out
}

/// Writes a model as an older study may hold it, without the checks of `effect add`.
fn hold(workspace: &str, effects: Vec<ModelEffect>) {
    let workspace = Path::new(workspace);
    let mut all = Revisions::load(workspace).unwrap();
    all.revisions.truncate(1);
    let older = all.next("older study".to_owned(), effects);
    all.revisions.push(older);
    all.save(workspace).unwrap();
}

fn effect(key: &str, trials: &[&str]) -> ModelEffect {
    let trials = trials.iter().map(|t| (*t).to_owned()).collect();
    ModelEffect { key: key.to_owned(), trials, ..ModelEffect::default() }
}

/// Every effect of the catalogue with its first and its last target.
fn keys(workspace: &str) -> Vec<String> {
    let path = find(Path::new(workspace), "subject.json");
    let subject: aloft_body::Subject = serde_json::from_str(&fs::read_to_string(path).unwrap()).unwrap();
    let scene = Scene::new(&subject.model, &subject.prior_phi(), &[]);
    let mut out = Vec::new();
    for effect in EFFECTS {
        let targets = effect.targets(&scene);
        for target in targets.first().into_iter().chain(targets.last()) {
            let key = EffectInstance::new(*effect, *target, &scene).key(&scene);
            if out.last() != Some(&key) {
                out.push(key);
            }
        }
    }
    out
}

/// The file of this name in the results of `calibrate`.
fn find(workspace: &Path, name: &str) -> PathBuf {
    let places = fs::read_dir(workspace.join("calibrate")).unwrap();
    places.map(|e| e.unwrap().path().join(name)).find(|p| p.is_file()).expect("a result of calibrate")
}

/// A message without the frame in which it is printed.
fn one_line(message: &str) -> String {
    message.replace(['│', '×'], " ").split_whitespace().collect::<Vec<_>>().join(" ")
}

/// Tolerance for rounding errors.
const BOUND: f64 = 1e-9;

#[test]
fn no_effect_moves_parameters_in_trials_that_it_does_not_touch() {
    let dir = folder();
    let ws = dir.path().join("ws").display().to_string();
    let demo = repo("pipelines/demo.yaml");
    expect(&["run", &demo, "--workspace", &ws], 0);
    let plain = numbers(&json(&["parameters", &demo, "--workspace", &ws, "--json"]));
    let (mut tried, mut worst) = (0, 0.0f64);
    for key in keys(&ws) {
        hold(&ws, vec![effect(&key, &["a recording that nobody made"])]);
        let ran = aloft(&["run", &demo, "--workspace", &ws]);
        let said = String::from_utf8_lossy(&ran.stderr).into_owned();
        assert!(ran.status.success(), "{key}: {said}");
        let found = json(&["parameters", &demo, "--workspace", &ws, "--json"]);
        let effects = found["effects"].as_array().unwrap();
        assert!(!effects.is_empty(), "{key}");
        for e in effects {
            assert!(e["value"].is_null() && e["se"].is_null(), "{key}: {e}");
            assert!(e["not_determined"].as_str().unwrap().contains("has no effect"), "{key}: {e}");
        }
        for ((name, a, size), (_, b, _)) in plain.iter().zip(numbers(&found)) {
            worst = worst.max((a - b).abs() / size);
            assert!((a - b).abs() <= BOUND * size, "{key} moves {name}: {a} to {b}");
        }
        let (table, _) = expect(&["parameters", &demo, "--workspace", &ws], 0);
        assert!(table.contains("not determined"), "{key}");
        tried += 1;
    }
    println!("{tried} effects; largest movement of a parameter, its error or a mass: {worst:.1e}");
    assert!(tried >= 25, "{tried}");
    // the commands that show results report this too, and none of them shows a number
    let ladder = json(&["history", &demo, "--workspace", &ws, "--json"]);
    assert!(ladder["revisions"][1]["coefficients"].as_array().unwrap().is_empty(), "{ladder}");
    expect(&["report", &demo, "--workspace", &ws], 0);
}

#[test]
fn effect_add_refuses_what_rows_cannot_show_and_changes_nothing() {
    let dir = folder();
    let ws = dir.path().join("ws").display().to_string();
    // flights only
    let human = dir.path().join("flights.yaml").display().to_string();
    let text = fs::read_to_string(repo("pipelines/demo_human.yaml")).unwrap();
    let text = text.replace("../fixtures/human_tethered", &repo("fixtures/human_tethered"));
    fs::write(&human, format!("{text}identify: {{contact: false}}\n")).unwrap();
    expect(&["run", &human, "--workspace", &ws], 0);
    let before = json(&["parameters", &human, "--workspace", &ws, "--json"]);
    let refused = |key: &str, reason: &str| {
        let (_, said) = expect(&["effect", "add", &human, key, "--workspace", &ws], 2);
        let said = one_line(&said);
        assert!(said.contains(reason) && said.contains(key), "{key}: {said}");
        assert_eq!(before, json(&["parameters", &human, "--workspace", &ws, "--json"]), "{key} changed the results");
        let ladder = json(&["history", &human, "--workspace", &ws, "--json"]);
        assert!(ladder["revisions"].as_array().unwrap().iter().all(|r| r["effects"].as_array().unwrap().is_empty()));
    };
    // all effects of the plates, in flights
    for effect in
        ["plate_time_offset", "plate_gain", "plate_tare[plate1]", "plate_rotation[plate1]", "plate_origin[plate2]"]
    {
        refused(effect, "it has no effect on these recordings");
    }
}

#[test]
fn an_effect_is_not_added_twice_under_two_names() {
    let dir = folder();
    let ws = dir.path().join("ws").display().to_string();
    let demo = repo("pipelines/demo.yaml");
    expect(&["run", &demo, "--workspace", &ws], 0);
    // nobody asked `discover` for its values
    let (out, err) = expect(&["effect", "add", &demo, "quadratic_drag", "--workspace", &ws], 0);
    let said = one_line(&format!("{out}{err}"));
    assert!(said.contains("the interval of `quadratic_drag` leaves out"), "{said}");
    let before = json(&["parameters", &demo, "--workspace", &ws, "--json"]);
    let (_, said) = expect(&["effect", "add", &demo, "quadratic_drag[links]", "--workspace", &ws], 2);
    let said = one_line(&said);
    assert!(said.contains("does the same as `quadratic_drag.drag_area`"), "{said}");
    assert_eq!(before, json(&["parameters", &demo, "--workspace", &ws, "--json"]));
    // a model that holds both nevertheless: one coefficient too many, but no absurd values
    hold(&ws, vec![effect("quadratic_drag", &[]), effect("quadratic_drag[links]", &[])]);
    expect(&["run", &demo, "--workspace", &ws], 0);
    let found = json(&["parameters", &demo, "--workspace", &ws, "--json"]);
    let effects = found["effects"].as_array().unwrap();
    let none: Vec<&Value> = effects.iter().filter(|e| e["value"].is_null()).collect();
    assert_eq!((effects.len(), none.len()), (3, 1), "{effects:?}");
    for e in effects.iter().filter(|e| !e["value"].is_null()) {
        assert!(e["value"].as_f64().unwrap().abs() < 1.0, "{e}");
    }
    let (a, b) = (numbers(&before), numbers(&found));
    for ((name, x, size), (_, y, _)) in a.iter().zip(&b).filter(|((n, ..), _)| !n.ends_with('±')) {
        assert!((x - y).abs() < 0.05 * size.max(1e-3), "{name}: {x} to {y}");
    }
}
