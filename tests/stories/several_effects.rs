//! Several effects, added one after the other; loads carried only in some recordings; the
//! comparison's breakdown of the error.

use crate::support::{expect, folder, json, lab, repo, unwrapped};
use serde_json::Value;
use std::fs;

fn number(v: &Value) -> f64 {
    v.as_f64().unwrap()
}

/// Fitted beside the other as first found, each of the two took all of the force that both can
/// describe, and their sum left 2.4 times the floor.
#[test]
#[ignore = "open: a force too many is named (docs/mathematics/discovery.md, where it is wrong)"]
fn two_effects_that_are_alike_are_fitted_together() {
    let dir = folder();
    let data = lab("fixtures/scenarios/chain_line_and_force.yaml", dir.path()).display().to_string();
    let ws = dir.path().join("ws").display().to_string();
    let words = [&repo("pipelines/chain.yaml"), "--data", &data, "--workspace", &ws];
    expect(&[&["run"], &words[..]].concat(), 0);
    let only = ["--only", "tether", "--only", "constant_force", "--json"];
    let found = json(&[&["discover"], &words[..], &only].concat());
    let keys: Vec<&str> = found["found"].as_array().unwrap().iter().map(|f| f["key"].as_str().unwrap()).collect();
    assert_eq!(keys, ["tether[link0]", "constant_force[link1]"], "{}", found["words"]);
    let force: Vec<f64> =
        found["found"][1]["coefficients"].as_array().unwrap().iter().map(|c| number(&c["value"])).collect();
    assert!(force.iter().map(|f| f * f).sum::<f64>().sqrt() > 0.03, "{force:?}");
    let after = &found["errors_after"][0];
    assert!(number(&after["times_floor"]) < 1.2, "{after}");
}

#[test]
fn drag_and_tilt_are_added_one_after_the_other() {
    let dir = folder();
    let data = lab("fixtures/scenarios/chain_two_effects.yaml", dir.path()).display().to_string();
    let ws = dir.path().join("ws").display().to_string();
    let words = [&repo("pipelines/chain.yaml"), "--data", &data, "--workspace", &ws];
    expect(&[&["run"], &words[..]].concat(), 0);
    let found = json(&[&["discover"], &words[..], &["--json"]].concat());
    let mut keys: Vec<&str> = found["found"].as_array().unwrap().iter().map(|f| f["key"].as_str().unwrap()).collect();
    keys.sort_unstable();
    assert_eq!(keys.len(), 2, "{}", found["words"]);
    assert!(keys[0].starts_with("gravity_tilt") && keys[1].starts_with("quadratic_drag"), "{keys:?}");

    let add = |key: &str| expect(&[&["effect", "add", words[0], key], &words[1..]].concat(), 0);
    let (out, said) = add(keys[1]);
    let said = unwrapped((out + &said).as_bytes());
    let rest = said.split("next: aloft effect add").nth(1).unwrap_or_else(|| panic!("no second effect: {said}"));
    assert!(rest.contains(keys[0]), "the answer named both, and is not asked for again: {rest}");
    let second = json(&[&["discover"], &words[..], &["--json"]].concat());
    // with drag in the model a wind looks like a tilt: the answer is a class, of which the tilt has
    // the fewest unknowns
    assert!(["supported", "one_of"].contains(&second["verdict"].as_str().unwrap()), "{}", second["words"]);
    assert_eq!(second["effects"][0], "gravity_tilt");
    let (out, _) = add("gravity_tilt");
    assert!(out.contains("add gravity_tilt") && out.contains("gravity_tilt.dg_x"), "{out}");
    let last = json(&[&["discover"], &words[..], &["--json"]].concat());
    assert_eq!(last["verdict"], "nothing_missing", "{}", last["words"]);

    let ladder = json(&[&["history"], &words[..], &["--json"]].concat());
    let rungs = ladder["revisions"].as_array().unwrap();
    assert_eq!(rungs.len(), 3);
    let error = |i: usize| number(&rungs[i]["held_out_error"]);
    assert!(error(2) < 0.5 * error(1) && error(2) < 1.2 * number(&rungs[2]["noise_floor"]), "{ladder:#}");
    // gravity is tilted: the coefficients are the sines of 0.5° and 0.4° times 9.81 m/s²
    let coefficient = |name: &str| {
        let all = rungs[2]["coefficients"].as_array().unwrap();
        number(&all.iter().find(|c| c["name"] == format!("gravity_tilt.{name}")).unwrap()["value"]).abs()
    };
    let lean = coefficient("dg_x").hypot(coefficient("dg_y"));
    let truth = 9.80665 * (0.5f64.hypot(0.4)).to_radians().sin();
    assert!((lean - truth).abs() < 0.02 * truth, "{lean} for {truth} m/s²");

    // an effect that the model holds cannot be added again, and one that it does not hold cannot be
    // removed
    let (_, err) = expect(&[&["effect", "add", words[0], "gravity_tilt"], &words[1..]].concat(), 2);
    assert!(err.contains("already"), "{err}");
    let (_, err) = expect(&[&["effect", "remove", words[0], "tether"], &words[1..]].concat(), 2);
    assert!(err.contains("holds no `tether`") && err.contains("gravity_tilt"), "{err}");
    expect(&[&["effect", "remove", words[0], "quadratic_drag"], &words[1..]].concat(), 0);
    let ladder = json(&[&["history"], &words[..], &["--json"]].concat());
    assert_eq!(ladder["revisions"][3]["effects"], serde_json::json!(["gravity_tilt"]));
    assert!(number(&ladder["revisions"][3]["held_out_error"]) > 2.0 * error(2));
}

#[test]
fn a_load_that_some_recordings_carry_is_found_with_and_without_groups() {
    let dir = folder();
    let data = lab("fixtures/scenarios/chain_payload.yaml", dir.path()).display().to_string();
    let ws = dir.path().join("ws").display().to_string();
    let text = fs::read_to_string(repo("pipelines/chain.yaml")).unwrap();
    let groups = "trials:\n  groups: {bare: [\"throws_0[123].c3d\"], loaded: [\"throws_0[456].c3d\"]}\n";
    let named = dir.path().join("named.yaml");
    fs::write(&named, text.replace("trials:\n", groups)).unwrap();
    let named = named.display().to_string();
    let plain = repo("pipelines/chain.yaml");
    let at = ["--data", &data, "--workspace", &ws];
    expect(&[&["run", &plain], &at[..]].concat(), 0);
    let loaded = serde_json::json!(["throws_04", "throws_05", "throws_06"]);
    for p in [&plain, &named] {
        let found = json(&[&["discover", p], &at[..], &["--json"]].concat());
        assert_eq!(found["effects"][0], "payload", "{}", found["words"]);
        let one = &found["found"][0];
        assert_eq!(one["trials"], loaded, "{one}");
        let mass = number(&one["coefficients"][0]["value"]);
        assert!((mass - 0.05).abs() < 0.003, "{mass} kg");
    }
    expect(&[&["effect", "add", &named, "payload"], &at[..]].concat(), 0);
    let ladder = json(&[&["history", &named], &at[..], &["--json"]].concat());
    let (before, rung) = (number(&ladder["revisions"][0]["held_out_error"]), &ladder["revisions"][1]);
    let (after, mass) = (number(&rung["held_out_error"]), number(&rung["coefficients"][0]["value"]));
    assert!(after < 0.3 * before && (mass - 0.05).abs() < 0.003, "{before} N to {after} N, {mass} kg");
    // a group without recordings, and a recording in two groups
    for (wrong, words) in
        [("loaded: [\"x*\"]", "no recording is in the group"), ("loaded: [\"throws_0[3456].c3d\"]", "in the groups")]
    {
        let path = dir.path().join("wrong.yaml");
        let from = "loaded: [\"throws_0[456].c3d\"]";
        fs::write(&path, fs::read_to_string(&named).unwrap().replace(from, wrong)).unwrap();
        let (_, err) = expect(&[&["check", &path.display().to_string()], &at[..]].concat(), 2);
        assert!(err.contains(words), "{err}");
    }
}

#[test]
fn the_comparison_says_where_it_fails_and_what_of_it_noise_explains() {
    let dir = folder();
    let ws = dir.path().join("ws").display().to_string();
    let demo = repo("pipelines/demo.yaml");
    expect(&["run", &demo, "--workspace", &ws], 0);
    let c = json(&["compare", &demo, "--workspace", &ws, "--json"]);
    let groups = c["breakdown"].as_array().unwrap();
    for by in ["trial", "phase", "flight", "time_in_flight", "speed", "acceleration", "turning", "posture"] {
        assert!(groups.iter().any(|g| g["by"] == by), "no breakdown by {by}");
    }
    let floors = c["noise_floor"]["groups"].as_array().unwrap();
    assert_eq!(floors.len(), groups.len());
    assert_eq!(c["axes"].as_array().unwrap().len(), 6);
    // drag grows with the square of the speed, and so does the error that noise does not explain
    let by_speed: Vec<(f64, f64)> = groups
        .iter()
        .zip(floors)
        .filter(|(g, _)| g["by"] == "speed")
        .map(|(g, f)| {
            let rms =
                |e: &Value| (0..3).map(|i| number(&e["windows"]["force_n"]["rmse"][i]).powi(2)).sum::<f64>().sqrt();
            (rms(g), rms(f))
        })
        .collect();
    assert_eq!(by_speed.len(), 4);
    assert!(by_speed[3].0 > 1.5 * by_speed[0].0 && by_speed[3].0 > 3.0 * by_speed[3].1, "{by_speed:?}");
    let segments = c["segments"].as_array().unwrap();
    assert!(
        segments.iter().any(|s| number(&s["drag_share"]) > 0.1 && number(&s["drag_coefficient"]) > 0.0),
        "{segments:?}"
    );
    let (out, _) = expect(&["compare", &demo, "--workspace", &ws, "--by", "speed,axis"], 0);
    assert!(
        out.contains("by speed")
            && out.contains("world z")
            && out.contains("explainable")
            && !out.contains("by flight"),
        "{out}"
    );
    let (out, _) = expect(&["compare", &demo, "--workspace", &ws, "--details"], 0);
    for words in ["by flight", "by posture", "by segment", "noise floor", "The error grows with the speed"] {
        assert!(out.contains(words), "no {words} in\n{out}");
    }
}

#[test]
fn a_recording_tells_what_a_low_pass_would_take_away() {
    let file = repo("fixtures/human_twin/jump01.c3d");
    let seen = json(&["inspect", &file, "--json"]);
    let a = &seen["residual_analysis"];
    let rms: Vec<f64> = a["residual_rms"].as_array().unwrap().iter().map(number).collect();
    assert!(rms.windows(2).all(|w| w[1] < w[0]) && rms[0] > 0.05 && *rms.last().unwrap() < 0.001, "{rms:?}");
    let (out, _) = expect(&["inspect", &file], 0);
    assert!(out.contains("residual, mm") && out.contains("cut-off, Hz"), "{out}");
}

/// A session of many recordings, of which rivals are compared on some: what acts in all recordings
/// and what acts in four of them are both named.
#[test]
fn effects_are_named_among_many_recordings() {
    let dir = folder();
    let data = lab("fixtures/scenarios/chain_many.yaml", dir.path()).display().to_string();
    let ws = dir.path().join("ws").display().to_string();
    let words = [&repo("pipelines/chain.yaml"), "--data", &data, "--workspace", &ws];
    expect(&[&["run"], &words[..]].concat(), 0);
    let found = json(&[&["discover"], &words[..], &["--json", "--closed"]].concat());
    let found: Vec<(&str, usize)> = found["found"]
        .as_array()
        .unwrap()
        .iter()
        .map(|f| (f["key"].as_str().unwrap(), f["trials"].as_array().map_or(0, Vec::len)))
        .collect();
    assert_eq!(found, [("quadratic_drag[links]", 0), ("payload[link0]", 4)]);
}

/// A load that is also carried in one of two exercises, which are held out, was refused: judged
/// without it, contact has more error with the load in the jumps than without it.
#[test]
fn a_load_is_named_where_it_is_also_carried_in_an_exercise_that_is_held_out() {
    let dir = folder();
    let scenario = dir.path().join("load.yaml");
    let text = "name: load\nseed: 52\nbody:\n  kind: human\n  person: {sex: F, height_m: 1.66, mass_kg: 60.0}\n  \
        protocol: {jumps: 6, exercises: 2, exercise_s: 3.0}\nhidden:\n  - {effect: payload, link: hand_r, \
        point_m: [0.0, -0.06, 0.0], mass_kg: 1.2, trials: [jump04, jump05, jump06, exercise02]}\n";
    fs::write(&scenario, text).unwrap();
    let data = dir.path().join("lab").display().to_string();
    expect(&["simulate", &scenario.display().to_string(), "--out", &data], 0);
    let ws = dir.path().join("ws").display().to_string();
    let words = [&repo("pipelines/human.yaml"), "--data", &data, "--workspace", &ws];
    expect(&[&["run"], &words[..]].concat(), 0);
    let found = json(&[&["discover"], &words[..], &["--closed", "--json"]].concat());
    assert_eq!(found["verdict"], "supported", "{}", found["words"]);
    let load = &found["found"][0];
    assert_eq!(load["key"], "payload[hand_r]");
    assert_eq!(load["trials"], serde_json::json!(["exercise02", "jump04", "jump05", "jump06"]));
    let mass = &load["coefficients"][0];
    assert!(number(&mass["ci95"][0]) < 1.2 && 1.2 < number(&mass["ci95"][1]), "{mass}");
    for e in found["errors_after"].as_array().unwrap() {
        assert_eq!(e["at_floor"], true, "{e}");
    }
}
