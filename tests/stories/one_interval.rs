//! Each number has one interval: tables, JSON, history and report all show the same.

use crate::support::{expect, folder, json, repo};
use serde_json::Value;
use std::fs;

/// Half-width of an interval; none if it is null.
fn half(ci95: &Value) -> Option<f64> {
    let [low, high] = [ci95.get(0)?.as_f64()?, ci95.get(1)?.as_f64()?];
    Some(0.5 * (high - low))
}

/// Every `NAME [=:] VALUE ± HALF` in a text, and every line `NAME VALUE HALF UNIT` of a table.
fn shown(text: &str, name: &str) -> Vec<f64> {
    let mut out = Vec::new();
    for rest in text.split(name).skip(1) {
        let plain: String = rest.chars().take(120).collect::<String>().replace("</th><td>", " ");
        let mut words = plain.trim_start_matches([':', '=', ' ']).split_whitespace();
        let value = words.next().and_then(|w| w.trim_start_matches("= ").parse::<f64>().ok());
        let mut next = words.next();
        if next == Some("±") {
            next = words.next();
        }
        if let (Some(_), Some(half)) = (value, next.filter(|h| h.starts_with(|c: char| c.is_ascii_digit()))) {
            let digits: String = half.chars().take_while(|c| c.is_ascii_digit() || ".e-".contains(*c)).collect();
            out.push(digits.parse().unwrap());
        }
    }
    out
}

/// Asserts equality to the two digits that are printed.
fn assert_same(printed: f64, half: f64, place: &str) {
    assert!((printed - half).abs() <= 0.051 * half, "{place}: ± {printed} for ± {half}");
}

#[test]
fn every_surface_shows_the_same_interval() {
    let dir = folder();
    let ws = dir.path().join("ws").display().to_string();
    let demo = repo("pipelines/demo.yaml");
    let at = [demo.as_str(), "--workspace", &ws];
    expect(&[&["run"], &at[..]].concat(), 0);
    let (text, _) = expect(&[&["discover"], &at[..]].concat(), 0);
    let found = json(&[&["discover"], &at[..], &["--json"]].concat());
    let (mut compared, mut at_bound) = (0, 0);
    for effect in found["found"].as_array().unwrap() {
        for e in effect["coefficients"].as_array().unwrap().iter().chain(effect["nonlinear"].as_array().unwrap()) {
            let name = e["name"].as_str().unwrap();
            let half = half(&e["ci95"]).unwrap();
            assert!(half >= 1.959 * e["se"].as_f64().unwrap(), "{name}: narrower than a normal distribution's");
            let printed = shown(&text, name);
            assert!(!printed.is_empty(), "{name} is not in the table");
            printed.iter().for_each(|p| assert_same(*p, half, name));
            compared += printed.len();
        }
    }
    // an estimate at a bound has no interval
    for round in found["rounds"].as_array().unwrap() {
        for c in round["candidates"].as_array().unwrap() {
            for e in c["coefficients"].as_array().unwrap().iter().chain(c["nonlinear"].as_array().unwrap()) {
                assert_eq!(e["at_bound"].as_bool().unwrap() || e["se"].is_null(), e["ci95"].is_null(), "{e}");
                at_bound += usize::from(e["at_bound"].as_bool().unwrap());
            }
        }
    }
    assert!(at_bound > 0, "no candidate of the demonstration ends at a bound: choose another recording for this test");

    expect(&["effect", "add", &demo, "quadratic_drag", "--workspace", &ws], 0);
    let parameters = json(&[&["parameters"], &at[..], &["--json"]].concat());
    let (table, _) = expect(&[&["parameters"], &at[..]].concat(), 0);
    let history = json(&[&["history"], &at[..], &["--json"]].concat());
    let (ladder, _) = expect(&[&["history"], &at[..]].concat(), 0);
    let (page, _) = expect(&[&["report"], &at[..]].concat(), 0);
    let html = fs::read_to_string(page.trim()).unwrap();
    let rung = history["revisions"][1]["coefficients"].as_array().unwrap();
    let effects = parameters["effects"].as_array().unwrap();
    assert_eq!(effects.len(), rung.len());
    for (e, r) in effects.iter().zip(rung) {
        let name = e["name"].as_str().unwrap();
        assert_eq!((&e["ci95"], &e["value"], &e["name"]), (&r["ci95"], &r["value"], &r["name"]));
        let half = half(&e["ci95"]).unwrap();
        for (place, text, least) in [("parameters", &table, 1), ("history", &ladder, 1), ("report", &html, 2)] {
            let printed = shown(text, name);
            assert!(printed.len() >= least, "{name} stands {} times in {place}", printed.len());
            printed.iter().for_each(|p| assert_same(*p, half, &format!("{name} in {place}")));
            compared += printed.len();
        }
        // the fit of the candidate in the discovery and the identification of the model agree
        // within their intervals
        let own = name.rsplit('.').next().unwrap();
        let all = found["found"][0]["coefficients"].as_array().unwrap();
        let before = all.iter().find(|c| c["name"] == own).unwrap();
        let apart = (before["value"].as_f64().unwrap() - e["value"].as_f64().unwrap()).abs();
        assert!(apart < half, "{name}: the discovery found it {apart} away");
    }
    // base parameters: the table, the JSON and the report
    for b in parameters["base"].as_array().unwrap().iter().skip(1) {
        let (name, half) = (b["name"].as_str().unwrap(), half(&b["ci95"]).unwrap());
        let line = table.lines().find(|l| l.split_whitespace().next() == Some(name)).unwrap();
        assert_same(line.split_whitespace().nth(2).unwrap().parse().unwrap(), half, name);
        let row =
            html.split("<tr>").find(|r| r.contains(&format!(">{name}</th>")) && r.matches("<td").count() >= 6).unwrap();
        let cell = row.split("<td").nth(2).unwrap().split('>').nth(1).unwrap().split('<').next().unwrap();
        assert_same(cell.parse().unwrap(), half, &format!("{name} in the report"));
        compared += 2;
    }
    for l in parameters["links"].as_array().unwrap() {
        let (name, half) = (l["name"].as_str().unwrap(), half(&l["ci95"]["mass_kg"]).unwrap());
        let words = l["words"].as_str().unwrap();
        let printed = shown(words, "mass ");
        assert!((printed[0] - half).abs() <= 0.051 * half + 0.0006, "{name}: {words}");
    }
    println!("{compared} printed intervals agree with their JSON");
}
