//! Every correction hidden in a simulated laboratory: the session check offers it with an interval
//! that holds the truth; applied, it becomes a rung of the ladder and the error falls.

use crate::support::{aloft, expect, folder, json, unwrapped};
use serde_json::Value;
use std::fs;
use std::path::Path;

/// A laboratory with one hidden error, and what is known about it.
struct Hidden {
    seed: u32,
    effect: &'static str,
    /// Body mass in the laboratory's file, kg; it was 60.
    stated_kg: f64,
    key: &'static str,
    line: &'static str,
    /// Value that the line should show.
    truth: f64,
    /// Motion on which the error has to fall.
    judged_on: &'static str,
    /// True where the comparison takes a constant off plates that were never unloaded: the constant
    /// has to fall instead, and the error stays.
    is_constant: bool,
}

/// Largest constant that the comparison took off a recording, N.
fn constant(compared: &Value) -> f64 {
    let size = |t: &Value| {
        let force = t["offset"]["force_n"].as_array()?;
        Some(force.iter().map(|x| x.as_f64().unwrap().powi(2)).sum::<f64>().sqrt())
    };
    compared["trials"].as_array().unwrap().iter().filter_map(size).fold(0.0, f64::max)
}

fn error(rung: &Value, judged_on: &str) -> f64 {
    let errors = rung["errors"].as_array().unwrap();
    errors.iter().find(|e| e["judged_on"] == judged_on).unwrap()["held_out_error"].as_f64().unwrap()
}

/// Runs the story; gives the text of the offered block and the pipeline's path.
fn story(at: &Path, hidden: &Hidden) -> (String, String) {
    let path = |name: &str| at.join(name).display().to_string();
    let (scenario, lab, pipeline, ws) = (path("scenario.yaml"), path("lab"), path("lab.yaml"), path("ws"));
    let person = "{sex: F, height_m: 1.66, mass_kg: 60.0}";
    let text = format!(
        "name: hidden\nseed: {}\nbody:\n  kind: human\n  person: {person}\nhidden: [{}]\n",
        hidden.seed, hidden.effect
    );
    fs::write(&scenario, text).unwrap();
    expect(&["simulate", &scenario, "--out", &lab], 0);
    let facts = fs::read_to_string(format!("{lab}/subject.yaml")).unwrap();
    let stated = facts.replace("mass_kg: 60\n", &format!("mass_kg: {}\n", hidden.stated_kg));
    assert!(hidden.stated_kg == 60.0 || stated != facts, "{facts}");
    fs::write(format!("{lab}/subject.yaml"), stated).unwrap();
    expect(&["init", &lab, "--out", &pipeline], 0);
    expect(&["run", &pipeline, "--workspace", &ws], 0);
    let words = |args: &[&str]| json(&[args, &["--workspace", &ws, "--json"]].concat());
    let before = words(&["check", &pipeline]);
    let constant_before = constant(&words(&["compare", &pipeline]));
    let differing: Vec<&Value> = before["session"]["lines"]
        .as_array()
        .unwrap()
        .iter()
        .filter(|l| l["id"] == hidden.line && l["standing"] == "differs")
        .collect();
    assert_eq!(differing.len(), 1, "{before}");
    let ends: Vec<f64> = differing[0]["ci95"].as_array().unwrap().iter().map(|v| v.as_f64().unwrap()).collect();
    assert!(ends[0] < hidden.truth && hidden.truth < ends[1], "{} outside {ends:?}", hidden.truth);
    let offers = before["offers"].as_array().unwrap();
    let keys: Vec<&str> = offers.iter().map(|o| o["key"].as_str().unwrap()).collect();
    assert_eq!(keys, [hidden.key], "nothing else is offered");
    let (shown, _) = expect(&["check", &pipeline, "--workspace", &ws], 0);
    let block = shown.split("corrections:\n").nth(1).unwrap();
    let own: String = block.lines().take_while(|l| l.starts_with("  ")).map(|l| format!("{l}\n")).collect();
    let text = fs::read_to_string(&pipeline).unwrap();
    fs::write(&pipeline, format!("{text}corrections:\n{own}")).unwrap();
    expect(&["run", &pipeline, "--workspace", &ws], 0);
    let after = words(&["check", &pipeline]);
    assert!(after["offers"].as_array().unwrap().is_empty(), "{}", after["offers"]);
    let history = words(&["history", &pipeline]);
    let rungs = history["revisions"].as_array().unwrap();
    assert_eq!(rungs.len(), 2, "{history}");
    assert_eq!(rungs[1]["corrections"][0], hidden.key);
    assert!(rungs[1]["void"].is_null(), "{}", rungs[1]["void"]);
    let (was, is) = (error(&rungs[0], hidden.judged_on), error(&rungs[1], hidden.judged_on));
    let said = format!("{}: {was} N before, {is} N after", hidden.key);
    if hidden.is_constant {
        let left = constant(&words(&["compare", &pipeline]));
        assert!(constant_before > 9.0 && left < 3.0, "constant of {constant_before} N before, {left} N after");
        assert!(is < 1.001 * was, "{said}");
    } else {
        assert!(is < 0.9 * was, "{said}");
    }
    (own, pipeline)
}

#[test]
fn a_tilted_vertical_is_offered_and_corrected() {
    let dir = folder();
    let hidden = Hidden {
        seed: 31,
        effect: "{effect: gravity_tilt, about_x_deg: 2.0, about_y_deg: -2.5}",
        stated_kg: 60.0,
        key: "vertical_deg",
        line: "vertical",
        truth: 2.0_f64.hypot(2.5),
        judged_on: "flight",
        is_constant: false,
    };
    let (block, _) = story(dir.path(), &hidden);
    let list = block.split('[').nth(1).unwrap().split(']').next().unwrap();
    let found: Vec<f64> = list.split(',').map(|w| w.trim().parse().unwrap()).collect();
    assert!((found[0] - 2.0).abs() < 0.3 && (found[1] + 2.5).abs() < 0.3, "{block}");
}

#[test]
fn a_wrong_rate_is_offered_and_corrected() {
    let dir = folder();
    let hidden = Hidden {
        seed: 32,
        effect: "{effect: time_base, true_rate_hz: 208.0}",
        stated_kg: 60.0,
        key: "rate_ratio",
        line: "free_fall",
        truth: 1.0 / (1.04 * 1.04),
        judged_on: "flight",
        is_constant: false,
    };
    let (block, _) = story(dir.path(), &hidden);
    let ratio: f64 = block.split("rate_ratio: ").nth(1).unwrap().trim().parse().unwrap();
    assert!((ratio - 1.04).abs() < 0.01, "{block}");
}

#[test]
fn a_wrong_body_mass_is_offered_and_corrected() {
    let dir = folder();
    let hidden = Hidden {
        seed: 34,
        effect: "",
        stated_kg: 64.5,
        key: "mass_kg",
        line: "impulse_mass",
        truth: 60.0,
        judged_on: "contact",
        is_constant: false,
    };
    let (block, _) = story(dir.path(), &hidden);
    let mass: f64 = block.split("mass_kg: ").nth(1).unwrap().trim().parse().unwrap();
    assert!((mass - 60.0).abs() < 0.6, "{block}");
}

#[test]
fn a_plate_zero_is_offered_and_corrected_and_a_plate_that_is_not_there_is_refused() {
    let dir = folder();
    let hidden = Hidden {
        seed: 33,
        effect: "{effect: plate_tare, plate: 2, force_n: [3.0, -2.0, 9.0], moment_nm: [0.4, 0.0, 0.1]}",
        stated_kg: 60.0,
        key: "plate_zero",
        line: "plate_zero",
        // upward in the world: the plate's own z points down
        truth: -9.0,
        judged_on: "contact",
        is_constant: true,
    };
    let (block, pipeline) = story(dir.path(), &hidden);
    let list = block.split("force_n: [").nth(1).unwrap().split(']').next().unwrap();
    let size = list.split(',').map(|w| w.trim().parse::<f64>().unwrap().powi(2)).sum::<f64>().sqrt();
    assert!((size - 94.0_f64.sqrt()).abs() < 0.6, "{block}");

    let text = fs::read_to_string(&pipeline).unwrap();
    fs::write(&pipeline, text.replace("FP2:", "FP7:")).unwrap();
    let ws = dir.path().join("ws").display().to_string();
    for command in ["check", "run"] {
        let refused = aloft(&[command, &pipeline, "--workspace", &ws]);
        let said = unwrapped(&refused.stderr);
        assert_eq!(refused.status.code(), Some(2), "{command}: {said}");
        for part in ["lab.yaml", "`FP7`, which none of the", "their plates are FP1, FP2"] {
            assert!(said.contains(part), "{command}: {said}");
        }
    }
}

/// Simulates a person, states a mass, runs; gives the pipeline's path and what `run` says.
fn run_with(at: &Path, name: &str, effect: &str, stated_kg: f64) -> String {
    let path = |end: &str| at.join(format!("{name}{end}")).display().to_string();
    let (scenario, lab, pipeline, ws) = (path(".scenario.yaml"), path(""), path(".yaml"), path(".ws"));
    let person = "{sex: F, height_m: 1.66, mass_kg: 60.0}";
    let body = format!("{{kind: human, person: {person}, protocol: {{jumps: 3, exercises: 2}}}}");
    let text = format!("name: hidden\nseed: 35\nbody: {body}\nhidden: [{effect}]\n");
    fs::write(&scenario, text).unwrap();
    expect(&["simulate", &scenario, "--out", &lab], 0);
    let facts = fs::read_to_string(format!("{lab}/subject.yaml")).unwrap();
    fs::write(format!("{lab}/subject.yaml"), facts.replace("mass_kg: 60\n", &format!("mass_kg: {stated_kg}\n")))
        .unwrap();
    expect(&["init", &lab, "--out", &pipeline], 0);
    let said = aloft(&["run", &pipeline, "--workspace", &ws]);
    unwrapped(&said.stdout) + &unwrapped(&said.stderr)
}

#[test]
fn next_is_the_command_that_offers_the_correction() {
    let dir = folder();
    for (name, effect, stated_kg) in [("rate", "{effect: time_base, true_rate_hz: 240.0}", 60.0), ("mass", "", 72.0)] {
        let said = run_with(dir.path(), name, effect, stated_kg);
        assert!(said.contains("next: aloft check"), "{name}: {said}");
    }
}
