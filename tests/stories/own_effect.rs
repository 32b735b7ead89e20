//! A user-defined effect: a law written as formulas is found, added, and gives the same result as
//! the built-in law; errors in it are reported at their character.

use crate::support::{expect, folder, json, lab, repo};
use serde_json::Value;
use std::fs;
use std::path::Path;

/// The demonstration's pipeline with an added section, in its own folder.
fn pipeline(at: &Path, name: &str, more: &str) -> String {
    let text = fs::read_to_string(repo("pipelines/demo.yaml")).unwrap();
    let text = text.replace("../fixtures/demo", &repo("fixtures/demo"));
    let path = at.join(name);
    fs::write(&path, format!("{text}\n{more}")).unwrap();
    path.display().to_string()
}

fn coefficients(ladder: &Value) -> Vec<(f64, f64)> {
    let last = ladder["revisions"].as_array().unwrap().last().unwrap();
    let of = |c: &Value| (c["value"].as_f64().unwrap(), c["se"].as_f64().unwrap());
    last["coefficients"].as_array().unwrap().iter().map(of).collect()
}

#[test]
fn a_law_written_as_formulas_is_found_and_gives_what_the_catalogue_gives() {
    let dir = folder();
    let ws = |name: &str| dir.path().join(name).display().to_string();
    let p = pipeline(dir.path(), "own.yaml", "effects: {files: [my_drag]}\n");

    let (own, built_in) = (ws("own"), ws("built_in"));
    expect(&["run", &p, "--workspace", &own], 0);
    let (listed, _) = expect(&["effect", "list", &p], 0);
    assert!(listed.lines().any(|l| l.trim_start().starts_with("my_drag") && l.contains("my_drag.yaml")), "{listed}");
    let (shown, _) = expect(&["effect", "show", "my_drag", &p], 0);
    assert!(shown.contains("## Physics") && shown.contains("area1 * speed * v_z"), "{shown}");

    // alone it is named; with the catalogue it is one of several that cannot be told apart
    let found = json(&["discover", &p, "--workspace", &own, "--only", "my_drag", "--json"]);
    assert_eq!(
        (&found["verdict"], &found["effects"][0]),
        (&"supported".into(), &"my_drag".into()),
        "{}",
        found["words"]
    );
    let all = json(&["discover", &p, "--workspace", &own, "--json"]);
    let mine = all["candidates"].as_array().unwrap().iter().find(|c| c["effect"] == "my_drag").unwrap();
    assert!(mine["held_out_ratio"].as_f64().unwrap() < 0.5);
    let named = |id: &str| all["effects"].as_array().unwrap().iter().any(|e| e == id);
    assert!(named("quadratic_drag") || named("my_drag"), "{}", all["words"]);

    expect(&["effect", "add", &p, "my_drag", "--workspace", &own], 0);
    let mine = coefficients(&json(&["history", &p, "--workspace", &own, "--json"]));
    // the catalogue's law acting where the formula acts: in the links' centres of mass
    expect(&["run", &p, "--workspace", &built_in], 0);
    expect(&["effect", "add", &p, "quadratic_drag[links]", "--workspace", &built_in], 0);
    let theirs = coefficients(&json(&["history", &p, "--workspace", &built_in, "--json"]));
    assert_eq!((mine.len(), theirs.len()), (2, 2));
    for ((a, se), (b, _)) in mine.iter().zip(&theirs) {
        assert!(*a > 0.005 && *se < 0.1 * a && (a - b).abs() < 1e-9 * b, "{a} for {b}");
    }

    // changing the law in the file makes the results stale; removing the effect restores the
    // earlier model
    let text = fs::read_to_string(repo("configs/effects/my_drag.yaml")).unwrap();
    fs::write(dir.path().join("mine.yaml"), text.replace("-0.5 *", "-0.25 *")).unwrap();
    fs::write(&p, fs::read_to_string(&p).unwrap().replace("[my_drag]", "[mine.yaml]")).unwrap();
    expect(&["run", &p, "--workspace", &own], 0);
    let half = coefficients(&json(&["history", &p, "--workspace", &own, "--json"]));
    for ((a, _), (b, _)) in half.iter().zip(&mine) {
        assert!((a - 2.0 * b).abs() < 1e-6 * b, "{a} for twice {b}");
    }
    expect(&["effect", "remove", &p, "my_drag", "--workspace", &own], 0);
    let ladder = json(&["history", &p, "--workspace", &own, "--json"]);
    let rungs = ladder["revisions"].as_array().unwrap();
    let error = |i: usize| rungs[i]["held_out_error"].as_f64().unwrap();
    assert!(error(1) < 0.6 * error(0) && (error(2) - error(0)).abs() < 1e-9 * error(0), "{ladder}");
}

#[test]
fn what_is_wrong_in_a_law_is_shown_at_its_character() {
    let dir = folder();
    let text = |force: &str| {
        format!(
            "effects:\n  define:\n    - id: kite\n      point: {{link: link1}}\n      force:\n        - \"0\"\n        - {force}\n        - \"0\"\n      \
             coefficients:\n        - {{name: c, unit: kg/m}}\n"
        )
    };
    let cases = [
        ("\"-c * speed * v_w\"", "nothing is called `v_w`", "v_w"),
        ("\"-c * speed\"", "the unit is", "* speed"),
        ("-c * speed * (v_x + t)", "units differ", "+ t"),
        ("'-c * speed * v_x +'", "something is missing", "'"),
    ];
    for (force, words, place) in cases {
        let yaml = text(force);
        let p = pipeline(dir.path(), "wrong.yaml", &yaml);
        let (_, err) = expect(&["check", &p], 2);
        let whole = fs::read_to_string(&p).unwrap();
        let line = whole.lines().position(|l| l.contains(force)).unwrap() + 1;
        let column = whole.lines().nth(line - 1).map(|l| l.rfind(place).unwrap() + 1).unwrap();
        let flat = err.replace(['\n', '│'], " ");
        let flat = flat.split_whitespace().collect::<Vec<_>>().join(" ");
        assert!(flat.contains(words) && flat.contains(&format!("line {line}")), "{err}");
        assert!(err.contains("wrong.yaml") && err.contains(&format!("{line}:{column}")), "{line}:{column}\n{err}");
    }
    let p = pipeline(dir.path(), "unit.yaml", &text("\"-c * speed * v_x\"").replace("kg/m", "lbf"));
    let (_, err) = expect(&["check", &p], 2);
    assert!(err.contains("lbf") && err.contains("no SI unit"), "{err}");
    let p = pipeline(dir.path(), "name.yaml", "effects: {files: [nobody]}\n");
    let (_, err) = expect(&["check", &p], 2);
    assert!(err.contains("nobody") && err.contains("magnus"), "{err}");
    let (schema, _) = expect(&["schema"], 0);
    for word in ["EffectsConfig", "FormulaEffect", "coefficients", "position_m", "groups"] {
        assert!(schema.contains(word), "the schema does not know {word}");
    }
}

#[test]
fn a_law_that_gives_no_numbers_is_said_to_be_not_tried() {
    let dir = folder();
    let ws = dir.path().join("ws").display().to_string();
    // no number at all; no number in the first 50 ms of each flight; a number only at some starting
    // values; too large to be squared
    let laws = [
        ("nowhere", "-c * v_x / (speed - speed)", ""),
        ("late", "-c * v_x / speed * sqrt((since_start - delay) / delay)", ""),
        (
            "in_part",
            "-c * v_x / speed * sqrt((late - since_start) / late)",
            "parameters: [{name: late, unit: s, lower: 0.01, upper: 5.0}]",
        ),
        ("huge", "-c * v_x / speed * exp(1000 * since_start / delay)", ""),
    ];
    let mut define = "effects:\n  define:\n".to_owned();
    for (id, law, more) in laws {
        define.push_str(&format!(
            "    - id: {id}\n      point: {{link: link0}}\n      force: [\"{law}\", \"0\", \"0\"]\n      coefficients: [{{name: c, unit: N}}]\n      \
             constants: [{{name: delay, unit: s, value: 0.05}}]\n"
        ));
        if !more.is_empty() {
            define.push_str(&format!("      {more}\n"));
        }
    }
    let text = fs::read_to_string(repo("pipelines/demo.yaml")).unwrap();
    let text = text.replace("../fixtures/demo", &repo("fixtures/demo_twin"));
    let path = dir.path().join("nan.yaml");
    fs::write(&path, format!("{text}\n{define}")).unwrap();
    let p = path.display().to_string();
    expect(&["run", &p, "--workspace", &ws], 0);
    // nothing acts on the twin: without a remark about the four laws the answer would be "nothing
    // missing"
    let only = ["--only", "linear_drag", "--only", "nowhere", "--only", "late", "--only", "in_part", "--only", "huge"];
    let found = json(&[&["discover", p.as_str(), "--workspace", &ws, "--json"], &only[..]].concat());
    let left: Vec<(&str, bool)> = found["not_tried"]
        .as_array()
        .unwrap()
        .iter()
        .map(|n| (n["effect"].as_str().unwrap(), n["in_part"].as_bool().unwrap()))
        .collect();
    assert_eq!(
        left,
        [("nowhere", false), ("late", false), ("in_part", true), ("huge", false)],
        "{}",
        found["not_tried"]
    );
    let words = found["words"].as_str().unwrap();
    let ranked: Vec<&str> =
        found["candidates"].as_array().unwrap().iter().map(|c| c["effect"].as_str().unwrap()).collect();
    for (id, ..) in laws {
        assert!(words.contains(&format!("`{id}` was not tried")), "{words}");
        assert!(id == "in_part" || !ranked.contains(&id), "{ranked:?}");
    }
    assert!(words.contains("throws_01") && words.contains("NaN or infinity"), "{words}");
    let (said, _) = expect(&[&["discover", p.as_str(), "--workspace", &ws], &only[..]].concat(), 0);
    let first = said.lines().next().unwrap();
    assert!(
        !first.ends_with("nothing missing") && said.contains("left out: `nowhere` was not tried, because"),
        "{said}"
    );
    // if nothing could be tried, there is no answer
    let none = json(&["discover", &p, "--workspace", &ws, "--json", "--only", "nowhere"]);
    assert_eq!(none["verdict"], "not_detectable", "{none}");
    // such a law cannot be added either; the model stays as it was
    for id in ["nowhere", "late"] {
        let (_, err) = expect(&["effect", "add", &p, id, "--workspace", &ws], 2);
        let err: Vec<&str> = err.split(['\n', '│', ' ']).map(str::trim).filter(|w| !w.is_empty()).collect();
        assert!(err.join(" ").contains("cannot be added: its law gives NaN"), "{err:?}");
    }
    let ladder = json(&["history", &p, "--workspace", &ws, "--json"]);
    assert_eq!(ladder["revisions"].as_array().unwrap().len(), 1, "{ladder}");
}

/// Pipelines of several bodies share the folder `effects` beside them: a law of one body does not
/// disturb another, and a law of another laboratory is not taken for the one that was found.
#[test]
fn laws_of_other_bodies_and_laboratories_are_kept_apart() {
    let dir = folder();
    let data = lab("fixtures/scenarios/unlisted.yaml", dir.path()).display().to_string();
    let pipelines = dir.path().join("pipelines");
    fs::create_dir(&pipelines).unwrap();
    for name in ["chain.yaml", "demo_human.yaml"] {
        let text = fs::read_to_string(repo(&format!("pipelines/{name}"))).unwrap();
        fs::write(pipelines.join(name), text.replace("../fixtures", &repo("fixtures"))).unwrap();
    }
    let of = |name: &str| pipelines.join(name).display().to_string();
    let ws = dir.path().join("ws").display().to_string();
    let words = [&of("chain.yaml"), "--data", &data, "--workspace", &ws];
    expect(&[&["run"], &words[..]].concat(), 0);
    let discovered = || json(&[&["discover"], &words[..], &["--json"]].concat());
    let found = discovered();
    let name = found["open"]["laws"][0]["id"].as_str().unwrap().to_owned();
    // a law of that name from another laboratory: the same place, another direction
    let effects = pipelines.join("effects");
    fs::create_dir(&effects).unwrap();
    let other = format!(
        "id: {name}\npoint: {{link: link1}}\naxes: link\nforce: [\"0\", \"c\", \"0\"]\ncoefficients: [{{name: c, unit: N}}]\n"
    );
    fs::write(effects.join(format!("{name}.yaml")), other).unwrap();
    let add = |key: &str, code| expect(&[&["effect", "add", words[0], key], &words[1..]].concat(), code);
    let (_, err) = add(&name, 2);
    let err = err.split(['\n', '│', ' ']).map(str::trim).filter(|w| !w.is_empty()).collect::<Vec<_>>().join(" ");
    assert!(err.contains("is not the law that `discover` found"), "{err}");
    // asked again, the search gives its law a name that is free
    let again = discovered();
    let free = again["open"]["laws"][0]["id"].as_str().unwrap();
    assert_ne!(free, name);
    let (out, _) = add(free, 0);
    assert!(out.contains("at the floor"), "{out}");

    let ws = dir.path().join("person").display().to_string();
    let person = of("demo_human.yaml");
    expect(&["run", &person, "--workspace", &ws, "--until", "import"], 0);
    let (_, err) = expect(&["effect", "add", &person, &name, "--workspace", &ws], 2);
    assert!(err.contains("which this body does not have"), "{err}");
}
