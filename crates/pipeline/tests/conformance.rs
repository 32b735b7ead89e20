//! Checks that every entry of the explicit slices conforms: stages, effects, built-in
//! configurations; and that the documents list them.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic, reason = "tests fail by panicking")]

use aloft_pipeline::graph::Stage;
use aloft_pipeline::stages::STAGES;
use aloft_study::catalog;
use aloft_study::subject_session::{Overrides, SubjectSession};
use serde_json::{Value, json};
use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

fn document(name: &str) -> String {
    std::fs::read_to_string(Path::new(env!("CARGO_MANIFEST_DIR")).join("../..").join(name)).unwrap()
}

#[test]
fn stages_read_only_what_stands_before_them() {
    for (i, stage) in STAGES.iter().enumerate() {
        assert!(STAGES[..i].iter().all(|s| s.name != stage.name), "{} twice", stage.name);
        for need in stage.needs {
            let Some(name) = need.stage() else { continue };
            assert!(
                STAGES[..i].iter().any(|s| s.name == name),
                "{} reads {name}, which does not stand before it",
                stage.name
            );
        }
    }
}

#[test]
fn architecture_has_the_stage_table() {
    let page = document("ARCHITECTURE.md");
    for stage in STAGES {
        let row = format!("| `{}` | {} | {} |", stage.name, stage.reads, stage.gives);
        assert!(page.contains(&row), "ARCHITECTURE.md lacks the row\n{row}");
    }
}

#[test]
fn readme_names_the_commands_that_checks_run() {
    let checks = document(".ci/run");
    let readme = document("README.md");
    let test = "cargo test --release --workspace";
    assert!(checks.contains(test) && readme.contains(test));
}

#[test]
fn every_built_in_configuration_parses() {
    let nowhere = Path::new("");
    for name in catalog::names("models") {
        let spec: aloft_body::ModelSpec = catalog::load("models", &name, nowhere).unwrap();
        aloft_body::Model::from_spec(&spec).unwrap();
    }
    for set in catalog::all::<aloft_trial::MarkerSet>("markersets").unwrap() {
        let spec: aloft_body::ModelSpec = catalog::load("models", &set.model, nowhere).unwrap();
        for marker in &set.markers {
            assert!(spec.links.iter().any(|l| l.name == marker.link), "{}: {} sits on no link", set.name, marker.label);
        }
    }
    assert!(catalog::all::<aloft_scale::Anthropometry>("anthropometry").unwrap().len() >= 3);
    assert!(!catalog::all::<aloft_scale::ObjectSpec>("objects").unwrap().is_empty());
    assert!(catalog::all::<aloft_simulate::Scenario>("scenarios").unwrap().len() >= 5);
}

#[test]
fn every_shipped_pipeline_parses() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../pipelines");
    let mut n = 0;
    for entry in std::fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        // beside pipelines stand workspaces and effects of one's own
        if path.extension().is_none_or(|e| e != "yaml") {
            continue;
        }
        let text = std::fs::read_to_string(&path).unwrap();
        aloft_study::ranges::parse_yaml::<aloft_study::config::PipelineConfig>(&path.display().to_string(), &text)
            .unwrap();
        n += 1;
    }
    assert!(n >= 4);
}

#[test]
fn effects_are_documented_under_four_headings() {
    for effect in aloft_effects::EFFECTS {
        for heading in ["Physics", "Equation", "Identifiability", "References"] {
            assert!(effect.about().documentation.contains(heading), "{} lacks {heading}", effect.id());
        }
    }
}

#[test]
fn a_new_cut_off_leaves_weak_rows_and_what_they_need_alone() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("../..");
    let before = SubjectSession::open(&root.join("pipelines/demo.yaml"), &Overrides::default()).unwrap();
    let mut after = before.clone();
    after.config.filter.cutoff_hz *= 0.5;
    let parameters = |stage: &Stage, session: &SubjectSession| -> Vec<Value> {
        stage.tasks(session).into_iter().map(|t| (stage.parameters)(session, t)).collect()
    };
    let changed = |stage: &Stage| parameters(stage, &before) != parameters(stage, &after);
    let stale: Vec<&str> = STAGES.iter().filter(|s| changed(s)).map(|s| s.name).collect();
    assert_eq!(stale, ["filter", "acceleration", "compare"]);
    // nothing that weak rows are made from is made from a stale result
    let mut needed = vec!["regressor"];
    let mut at = 0;
    while at < needed.len() {
        let stage = STAGES.iter().find(|s| s.name == needed[at]).unwrap();
        for need in stage.needs {
            if let Some(n) = need.stage()
                && !needed.contains(&n)
            {
                needed.push(n);
            }
        }
        at += 1;
    }
    assert!(needed.iter().all(|n| !stale.contains(n)), "{needed:?}");
}

/// Other values for a setting, from its schema: each variant of a choice, a number or a word that
/// is not the default.
fn others(schema: &Value, root: &Value) -> Vec<Value> {
    let target = schema["$ref"].as_str().and_then(|r| root.pointer(r.trim_start_matches('#'))).unwrap_or(schema);
    let default = schema.get("default").unwrap_or(&Value::Null);
    let choices: Vec<Value> = target["oneOf"]
        .as_array()
        .into_iter()
        .flatten()
        .filter_map(|c| c.get("const").cloned())
        .chain(target["enum"].as_array().into_iter().flatten().cloned())
        .filter(|c| c != default)
        .collect();
    if !choices.is_empty() {
        return choices;
    }
    let kind = target["type"].as_str().or_else(|| target["type"][0].as_str()).unwrap_or_default();
    match (kind, default) {
        ("boolean", Value::Bool(b)) => vec![Value::Bool(!b)],
        ("integer", Value::Number(n)) => vec![Value::from(n.as_u64().unwrap() + 1)],
        ("number", Value::Number(n)) if n.as_f64() == Some(0.0) => vec![Value::from(0.2)],
        ("number", Value::Number(n)) => vec![Value::from(n.as_f64().unwrap() * 0.75)],
        ("number", _) => vec![Value::from(0.1)],
        _ => Vec::new(),
    }
}

/// Every setting of the stages' sections with other values, and settings of the subject.
fn changes() -> Vec<(String, Value)> {
    let schema = aloft_study::config_schema().to_value();
    let mut out = Vec::new();
    for section in ["import", "scale", "calibrate", "ik", "filter", "flight", "regressor", "identify", "compare"] {
        let reference = schema["properties"][section].to_string();
        let name = reference.split("#/$defs/").nth(1).and_then(|r| r.split('"').next()).unwrap();
        for (key, own) in schema["$defs"][name]["properties"].as_object().unwrap() {
            out.extend(others(own, &schema).into_iter().map(|v| (format!("{section}.{key}"), v)));
        }
    }
    for (key, value) in [("mass_kg", 61.5), ("height_m", 1.7), ("gravity_mps2", 9.7)] {
        out.push((format!("subject.{key}"), Value::from(value)));
    }
    out.push(("scale.hip".into(), "bell".into()));
    out.push(("scale.anthropometry".into(), "dumas".into()));
    out.push(("ik.weights".into(), json!({"LASI": 0.5})));
    out.push(("import.aliases".into(), json!({"nothing": "LASI"})));
    out
}

/// The stages whose parameters a setting changes, for two pipelines: an object and a person. A
/// setting that a stage does not read may not make its results stale, and one that it reads must.
#[test]
fn each_setting_makes_exactly_the_stages_stale_that_read_it() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("../..");
    let folder = tempfile::tempdir().unwrap();
    let mut table: BTreeMap<String, BTreeSet<&str>> = BTreeMap::new();
    for name in ["demo", "demo_human"] {
        let text = std::fs::read_to_string(root.join(format!("pipelines/{name}.yaml"))).unwrap();
        let data = root.join(if name == "demo" { "fixtures/demo" } else { "fixtures/human_tethered" });
        let mut plain: Value = aloft_study::ranges::parse_yaml::<Value>(name, &text).unwrap();
        plain["data"] = data.display().to_string().into();
        let open = |pipeline: &Value| {
            let file = folder.path().join("p.yaml");
            // JSON is valid YAML
            std::fs::write(&file, pipeline.to_string()).unwrap();
            SubjectSession::open(&file, &Overrides::default())
        };
        let parameters = |session: &SubjectSession| -> Vec<Vec<Value>> {
            let of = |s: &&Stage| s.tasks(session).into_iter().map(|t| (s.parameters)(session, t)).collect();
            STAGES.iter().map(of).collect()
        };
        let before = parameters(&open(&plain).unwrap());
        for (setting, value) in changes() {
            let (section, key) = setting.split_once('.').unwrap();
            let mut changed = plain.clone();
            if changed[section].is_null() {
                changed[section] = json!({});
            }
            changed[section][key] = value;
            let Ok(session) = open(&changed) else { continue };
            let stale = STAGES.iter().zip(before.iter().zip(parameters(&session))).filter(|(_, (a, b))| **a != *b);
            table.entry(setting).or_default().extend(stale.map(|(s, _)| s.name));
        }
    }
    assert!(table.len() >= 30, "{} settings", table.len());
    let text: String = table
        .iter()
        .map(|(setting, stages)| {
            let read: Vec<&str> = STAGES.iter().map(|s| s.name).filter(|s| stages.contains(s)).collect();
            format!("{setting}\t{}\n", read.join(" "))
        })
        .collect();
    let golden = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/settings_and_stages.tsv");
    if std::env::var_os("ALOFT_UPDATE_GOLDENS").is_some() {
        std::fs::write(&golden, &text).unwrap();
    }
    let expected = std::fs::read_to_string(&golden).ok().unwrap_or_default();
    for (now, then) in text.lines().zip(expected.lines()) {
        assert_eq!(now, then, "a stage reads other settings; if that is intended: ALOFT_UPDATE_GOLDENS=1");
    }
    assert_eq!(text.lines().count(), expected.lines().count());
}
