//! The demonstration in the README, on the recordings in the repository.

use crate::report::{check_page, figures, signal};
use crate::support::{expect, folder, json, repo};
use std::fs;

#[test]
fn the_demonstration_goes_from_recordings_to_a_report() {
    let dir = folder();
    let ws = dir.path().join("ws").display().to_string();
    let demo = repo("pipelines/demo.yaml");
    expect(&["run", &demo, "--workspace", &ws], 0);

    let found = json(&["parameters", &demo, "--workspace", &ws, "--json"]);
    let truth: serde_json::Value =
        serde_json::from_str(&fs::read_to_string(repo("fixtures/demo/truth/truth.json")).unwrap()).unwrap();
    let base = found["base"].as_array().unwrap();
    assert_eq!(base.len(), 17);
    assert_eq!(truth["base"].as_array().unwrap().len(), 17);
    for key in ["name", "value", "se", "unit", "formula"] {
        assert!(!base[3][key].is_null(), "parameters --json lacks base[].{key}");
    }
    assert!(found["sigma"]["second"].as_f64().unwrap() > found["sigma"]["min"].as_f64().unwrap());

    let compared = json(&["compare", &demo, "--workspace", &ws, "--json"]);
    assert!(compared["flight"]["residual_force_n"]["rms"][0].is_number());
    assert!(compared["parameters"]["sigma_ratio"].is_number());
    assert!(compared["trials"].as_array().is_some_and(|t| !t.is_empty()));

    // the loop: find what is missing, add it, see the error fall
    let before =
        json(&["history", &demo, "--workspace", &ws, "--json"])["revisions"][0]["held_out_error"].as_f64().unwrap();
    let found = json(&["discover", &demo, "--workspace", &ws, "--json"]);
    assert_eq!(found["verdict"], "supported", "{}", found["words"]);
    assert_eq!(found["effects"][0], "quadratic_drag");
    // before it is added: no good signal far above the floor, the drag as a suspicion, the command
    // that adds it
    let (page, _) = expect(&["report", &demo, "--workspace", &ws], 0);
    let html = fs::read_to_string(page.trim()).unwrap();
    check_page(&html, &["overview"]);
    assert_eq!(signal(&html), "poor", "4.4 times the floor");
    assert!(html.contains("<code>quadratic_drag[links]</code> is missing"));
    assert!(html.contains("aloft effect add ") && html.contains("quadratic_drag[links]"));
    assert!(html.contains("class=\"rung neutral forecast\""), "what adding it promises");
    let suspected =
        |f: &serde_json::Value| f["arrows"].as_array().is_some_and(|a| a.iter().any(|a| a["suspected"] == true));
    assert!(figures(&html).iter().any(suspected));
    expect(&["effect", "add", &demo, "quadratic_drag", "--workspace", &ws], 0);
    let ladder = json(&["history", &demo, "--workspace", &ws, "--json"]);
    let rung = &ladder["revisions"][1];
    let after = rung["held_out_error"].as_f64().unwrap();
    assert!(after < 0.5 * before && after < 1.2 * rung["noise_floor"].as_f64().unwrap(), "{before} N to {after} N");
    let area: f64 = rung["coefficients"].as_array().unwrap().iter().map(|c| c["value"].as_f64().unwrap()).sum();
    let hidden = truth["hidden"][0]["drag_area_m2"].as_f64().unwrap();
    assert!((area - hidden).abs() < 0.05 * hidden, "{area} m² for {hidden} m²");
    let again = json(&["discover", &demo, "--workspace", &ws, "--json"]);
    assert_eq!(again["verdict"], "nothing_missing", "{}", again["words"]);

    // with the drag in the model the base parameters are those of the true body
    let found = json(&["parameters", &demo, "--workspace", &ws, "--json"]);
    for (b, t) in found["base"].as_array().unwrap().iter().zip(truth["base"].as_array().unwrap()) {
        let (value, true_value) = (b["value"].as_f64().unwrap(), t["value"].as_f64().unwrap());
        assert!((value - true_value).abs() < 5e-4, "{}: {value} for {true_value}", b["name"]);
    }

    let (page, _) = expect(&["report", &demo, "--workspace", &ws], 0);
    let html = fs::read_to_string(page.trim()).unwrap();
    let chapters = ["overview", "prediction", "discovery", "parameters", "kinematics", "methods", "trial-throws-01"];
    check_page(&html, &chapters);
    for told in [
        "Held-out error by model revision",
        "<b class=\"word good\">at the floor</b>",
        "quadratic_drag",
        "Choosing the filter",
        "Location of the error",
    ] {
        assert!(html.contains(told), "the page does not tell of: {told}");
    }
    // the report shows both answers: for the model without effects, and after the drag was added
    assert!(html.contains("asked of the plain model") && html.contains("asked of the model with quadratic_drag"));
    let figures = figures(&html);
    let players: Vec<_> = figures.iter().filter(|f| f["kind"] == "player").collect();
    assert_eq!(players.len(), 4, "one on the first screen, and one a recording");
    // the page follows the model: at the floor, the drag drawn on the links, the body without it
    assert_eq!(signal(&html), "good");
    assert!(html.contains("With <code>quadratic_drag[links]</code> the model is at its noise floor"));
    assert!(!html.to_lowercase().contains("no external force"), "a force acts in flight");
    let overview = html.split("<article class=\"chapter\" id=\"prediction\"").next().unwrap();
    assert!(!overview.contains("</code> is missing"), "what was added is not missing");
    for player in players {
        let effects: Vec<_> = player["arrows"].as_array().unwrap().iter().filter(|a| a["of"] == "effect").collect();
        assert!(effects.len() == 1 && effects[0]["n"] == 2 && effects[0]["suspected"] == false, "drag on both links");
        assert!(!player["ghost"].is_null(), "the body without the effects");
    }
}

#[test]
fn nothing_is_missing_where_nothing_is_hidden() {
    let dir = folder();
    let data = repo("fixtures/demo_twin");
    let ws = dir.path().join("ws").display().to_string();
    let words = [&repo("pipelines/demo.yaml"), "--data", &data, "--workspace", &ws];
    expect(&[&["run"], &words[..]].concat(), 0);
    let found = json(&[&["discover"], &words[..], &["--json"]].concat());
    assert_eq!(found["verdict"], "nothing_missing", "{}", found["words"]);
    assert!(found["noise_floor"].as_f64().unwrap() > 0.0);
    for key in ["effect", "held_out_ratio", "ci95", "coefficients", "minimum_detectable"] {
        assert!(!found["candidates"][0][key].is_null(), "discover --json lacks candidates[].{key}");
    }
}
