//! Absurd numbers: for every numeric setting of the schema and every fact about the subject,
//! `check` and `run` reject them alike, with the line and the range from the schema. Accepted
//! values are in a list with the reason.

use crate::support::{aloft, expect, folder, repo};
use serde_json::{Value, json};
use std::collections::BTreeSet;
use std::fs;
use std::path::Path;

/// Values that no laboratory uses; the last three are not numbers.
const ABSURD: [&str; 11] = [".nan", ".inf", "-.inf", "1e999", "1e38", "-1e38", "-1", "0", "abc", "\"5\"", "[1]"];

/// Those of these values that are accepted, by setting: the value, and why it is meaningful.
const ACCEPTED: [(&str, &str, &str); 30] = [
    ("corrections.plate_delay_s", "0", "nothing is corrected"),
    ("set.corrections.plate_zero.L0_1.force_n", "-1", "a reading, of a subject who is not in this session"),
    ("set.corrections.plate_zero.L0_1.moment_nm", "-1", "a reading, of a subject who is not in this session"),
    ("corrections.vertical_deg", "0", "nothing is corrected"),
    ("corrections.vertical_deg", "-1", "an angle"),
    ("import.fill_gaps_s", "0", "no gap is filled"),
    ("import.rigid_fill_s", "0", "no gap is filled from the segment"),
    ("import.least_fraction", "0", "a truncated file is used as far as it goes"),
    ("ik.weights.L0_1", "0", "the marker is not used"),
    ("flight.stated.from_s", "0", "from the first frame"),
    ("flight.margin_s", "0", "nothing is left out at the ends"),
    ("regressor.window_s", "0", "the stretch decides"),
    ("regressor.slow_noise", "0", "white noise alone"),
    ("identify.prior_weight", "0", "held-out error decides"),
    ("identify.bootstrap", "0", "intervals after Student's t"),
    ("identify.flight_error_correlation", "0", "errors do not repeat"),
    ("compare.edge_s", "0", "nothing is left out"),
    ("subject.gravity_mps2", "0", "weightlessness"),
    ("point.position_m", "0", "a place in a link's frame"),
    ("point.position_m", "-1", "a place in a link's frame"),
    ("coefficients.lower", "0", "a bound of a law"),
    ("coefficients.lower", "-1", "a bound of a law"),
    ("coefficients.upper", "0", "a bound of a law"),
    ("parameters.lower", "0", "a bound of a law"),
    ("parameters.lower", "-1", "a bound of a law"),
    ("parameters.start", "0", "within its bounds"),
    ("parameters.start", "-1", "within its bounds"),
    ("coefficients.upper", "-1", "a bound of a law"),
    ("constants.value", "0", "a constant of a law"),
    ("constants.value", "-1", "a constant of a law"),
];

/// Paths of all numbers of a schema: keys, and 0 for an item of a list.
fn numbers(root: &Value, schema: &Value, path: &[String], out: &mut Vec<Vec<String>>) {
    if let Some(place) = schema["$ref"].as_str() {
        numbers(root, root.pointer(place.trim_start_matches('#')).unwrap(), path, out);
    }
    for key in ["anyOf", "oneOf", "allOf"] {
        for branch in schema[key].as_array().into_iter().flatten() {
            numbers(root, branch, path, out);
        }
    }
    let types: Vec<&str> = match &schema["type"] {
        Value::String(s) => vec![s.as_str()],
        Value::Array(all) => all.iter().filter_map(Value::as_str).collect(),
        _ => Vec::new(),
    };
    if types.iter().any(|t| *t == "number" || *t == "integer") {
        out.push(path.to_vec());
    }
    let deeper = |key: &str| [path, &[key.to_owned()]].concat();
    for (key, property) in schema["properties"].as_object().into_iter().flatten() {
        numbers(root, property, &deeper(key), out);
    }
    if schema["additionalProperties"].is_object() {
        numbers(root, &schema["additionalProperties"], &deeper("L0_1"), out);
    }
    if schema["items"].is_object() {
        numbers(root, &schema["items"], &deeper("0"), out);
    }
}

/// A pipeline in which every number occurs.
fn whole(data: &str) -> Value {
    let law = |id: &str, part: bool| {
        let point = json!({"link": "link0", "position_m": [0.0, 0.1, 0.0]});
        let force = json!(["-c * v_x / speed * exp(-b * since_start) * k", "0", "0"]);
        let mut law = json!({
            "id": id,
            "coefficients": [{"name": "c", "unit": "N", "lower": -5.0, "upper": 5.0}],
            "parameters": [{"name": "b", "unit": "1/s", "lower": -2.0, "upper": 2.0, "start": 0.5}],
            "constants": [{"name": "k", "unit": "1", "value": 1.0}],
        });
        if part {
            law["parts"] = json!([{"point": point, "force": force}]);
        } else {
            law["point"] = point;
            law["force"] = force;
        }
        law
    };
    json!({
        "name": "settings", "data": data, "model": "two_link", "marker_set": "two-link-chain", "object": "two_link_chain",
        "trials": {"static": ["static.c3d"], "calibration": ["hinge_calib.c3d"], "identify": ["throws_*.c3d"], "validate": []},
        "overrides": [{"subject": "somebody", "set": {}}],
        "effects": {"define": [law("plain_law", false), law("law_of_parts", true)]},
    })
}

/// The pipeline's text: JSON, except for the token that replaces one number.
fn with(data: &str, path: &[String], token: &str) -> String {
    let mut pipeline = whole(data);
    let mut at = &mut pipeline;
    for (i, key) in path.iter().enumerate() {
        at = match key.as_str() {
            // the second law is the one with several parts
            "0" if i > 0 && path[i - 1] == "define" && path.contains(&"parts".to_owned()) => &mut at[1],
            "static_frames" => {
                at["static_frames"] = json!({"trial": "throws_01", "first": 1, "last": 30});
                &mut at["static_frames"]
            }
            "stated" => {
                at["stated"] = json!([{"from_s": 0.2, "to_s": 0.5}]);
                &mut at["stated"]
            }
            "0" => &mut at[0],
            "vertical_deg" => {
                at["vertical_deg"] = json!([0.0, 0.0]);
                &mut at["vertical_deg"]
            }
            "force_n" | "moment_nm" => {
                at[key] = json!([0.0, 0.0, 0.0]);
                &mut at[key]
            }
            key => &mut at[key],
        };
    }
    *at = json!("@here@");
    serde_json::to_string_pretty(&pipeline).unwrap().replace("\"@here@\"", token)
}

fn accepted(path: &[String], token: &str) -> bool {
    let keys: Vec<&str> = path.iter().map(String::as_str).filter(|k| *k != "0").collect();
    let name = keys.join(".");
    ACCEPTED.iter().any(|(setting, value, _)| name.ends_with(setting) && *value == token)
}

#[test]
fn absurd_settings_are_refused_by_check_and_run_alike() {
    let (schema, _) = expect(&["schema"], 0);
    let schema: Value = serde_json::from_str(&schema).unwrap();
    let mut paths = Vec::new();
    numbers(&schema, &schema, &[], &mut paths);
    let sections: BTreeSet<&String> = paths.iter().map(|p| &p[0]).collect();
    assert!(paths.len() >= 50 && sections.len() >= 9, "{} numbers in {sections:?}", paths.len());
    let dir = folder();
    let data = repo("fixtures/demo");
    let ws = dir.path().join("ws").display().to_string();
    let file = dir.path().join("p.yaml");
    let name = file.display().to_string();
    fs::write(&file, serde_json::to_string_pretty(&whole(&data)).unwrap()).unwrap();
    expect(&["check", &name], 0);
    expect(&["run", &name, "--workspace", &ws], 0);
    let (mut tried, mut refused, mut taken) = (0, 0, BTreeSet::new());
    for path in &paths {
        let of_override = path[0] == "overrides";
        for token in ABSURD {
            // an override has the same types as the section itself
            if of_override && !matches!(token, ".nan" | "-1" | "1e38" | "abc") {
                continue;
            }
            fs::write(&file, with(&data, path, token)).unwrap();
            tried += 1;
            let checked = aloft(&["check", &name]);
            let said = String::from_utf8_lossy(&checked.stderr).into_owned();
            let what = format!("{} = {token}\n{said}", path.join("."));
            if accepted(path, token) {
                assert_eq!(checked.status.code(), Some(0), "{what}");
                taken.insert((path.join("."), token));
                let of_law = path[0] == "effects";
                let weightless = path.last().is_some_and(|k| k == "gravity_mps2");
                // the effects of a law's bounds and of weightlessness on results are tested
                // elsewhere
                if !of_override && !of_law && !weightless {
                    expect(&["run", &name, "--workspace", &ws], 0);
                }
                continue;
            }
            let ran = aloft(&["run", &name, "--workspace", &ws]);
            assert_eq!((checked.status.code(), ran.status.code()), (Some(2), Some(2)), "{what}");
            assert_eq!(said, String::from_utf8_lossy(&ran.stderr), "`check` and `run` say the same");
            let flat: String = said.split(['\n', '│']).map(str::trim).collect::<Vec<_>>().join(" ");
            assert!(flat.contains("p.yaml") && flat.contains("line "), "{what}");
            refused += 1;
        }
    }
    println!(
        "settings: {} numbers, {tried} absurd values tried, {refused} refused, {} accepted for a reason",
        paths.len(),
        taken.len()
    );
    for (setting, value, why) in ACCEPTED {
        let used = taken.iter().any(|(p, t)| p.replace(".0", "").ends_with(setting) && *t == value);
        assert!(used, "{setting} = {value} ({why}) is not accepted");
    }
}

/// A laboratory like the demonstration's, with its own facts.
fn laboratory(at: &Path, file: &str, text: &str) -> [String; 2] {
    let data = at.join("lab");
    let _ = fs::remove_dir_all(&data);
    fs::create_dir_all(&data).unwrap();
    for name in ["static.c3d", "hinge_calib.c3d", "throws_01.c3d"] {
        fs::copy(Path::new(&repo("fixtures/demo")).join(name), data.join(name)).unwrap();
    }
    fs::write(data.join(file), text).unwrap();
    [data.display().to_string(), at.join("ws").display().to_string()]
}

#[test]
fn absurd_facts_are_refused_by_check_and_run_alike() {
    let dir = folder();
    let pipeline = repo("pipelines/demo.yaml");
    let yaml = |key: &'static str| {
        move |v: &str| {
            (
                "subject.yaml",
                format!("name: x\nmass_kg: 1.0\n{key}: {v}\n").replacen(
                    "mass_kg: 1.0\n",
                    if key.contains("mass_kg") { "" } else { "mass_kg: 1.0\n" },
                    1,
                ),
            )
        }
    };
    let table = |column: &'static str| {
        move |v: &str| {
            let (mass, height) = if column == "mass" { (v, "1.7") } else { ("70", v) };
            ("participants.tsv", format!("participant_id\tmass\theight\nsub-01\t{mass}\t{height}\n"))
        }
    };
    let object = |v: &str| ("object.yaml", format!("name: x\ntotal_mass_kg: 1.0\nlab:\n  gravity: {v}\n"));
    type Maker<'a> = Box<dyn Fn(&str) -> (&'static str, String) + 'a>;
    // the writer of the facts, the absurd values it accepts, and a valid value
    let makers: [(&str, Maker<'_>, &[&str], &str); 8] = [
        ("mass_kg", Box::new(yaml("mass_kg")), &[], "70.5"),
        ("total_mass_kg", Box::new(yaml("total_mass_kg")), &[], "0.9"),
        ("height_m", Box::new(yaml("height_m")), &[], "1.7"),
        ("gravity_m_s2", Box::new(yaml("gravity_m_s2")), &["0"], "9.81"),
        ("gravity_mps2", Box::new(yaml("gravity_mps2")), &["0"], "9.81"),
        // a component along the vertical: −1 is a magnitude of 1
        ("lab.gravity", Box::new(object), &["0", "-1"], "[0, 0, -9.81]"),
        ("mass", Box::new(table("mass")), &[], "70,5"),
        ("height", Box::new(table("height")), &[], "172"),
    ];
    let (mut tried, mut refused) = (0, 0);
    for (key, make, fine, right) in &makers {
        for token in ABSURD.iter().chain([right, &"n/a"]) {
            let is_table = key == &"mass" || key == &"height";
            let token = if is_table { token.trim_start_matches('.') } else { token };
            // words for a missing value are no facts; a mass that is missing is that of the object
            let is_missing = is_table && aloft_trial::missing::is_missing(token);
            if token == "n/a" && !is_table || is_missing && key == &"mass" || (is_table && token == "\"5\"") {
                continue;
            }
            let (file, text) = make(token);
            let [data, ws] = laboratory(dir.path(), file, &text);
            let words = [pipeline.as_str(), "--data", &data, "--workspace", &ws];
            let checked = aloft(&[&["check"], &words[..]].concat());
            let said = String::from_utf8_lossy(&checked.stderr).into_owned();
            tried += 1;
            if token == *right || fine.contains(&token) || is_missing {
                assert_eq!(checked.status.code(), Some(0), "{key} = {token}\n{said}");
                continue;
            }
            let ran = aloft(&[&["run"], &words[..]].concat());
            assert_eq!((checked.status.code(), ran.status.code()), (Some(2), Some(2)), "{key} = {token}\n{said}");
            assert_eq!(said, String::from_utf8_lossy(&ran.stderr));
            let flat: String = said.split(['\n', '│']).map(str::trim).collect::<Vec<_>>().join(" ");
            assert!(
                flat.contains("line ") && said.replace(['\n', '│', ' '], "").contains(file),
                "{key} = {token}\n{said}"
            );
            refused += 1;
        }
    }
    println!("facts: {tried} tried, {refused} refused");
}
