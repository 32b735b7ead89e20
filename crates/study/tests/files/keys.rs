//! A key that nobody reads is refused, in every mapping of every kind of YAML file: a misspelt one
//! would count as not given.
#![allow(clippy::unwrap_used, clippy::panic, reason = "tests fail by panicking")]

use aloft_body::ModelSpec;
use aloft_effects::FormulaEffect;
use aloft_scale::{Anthropometry, ObjectSpec};
use aloft_simulate::Scenario;
use aloft_study::config::{PipelineConfig, Sections};
use aloft_study::data_set::DataSet;
use aloft_study::subject_session::Overrides;
use aloft_study::{catalog, ranges};
use aloft_trial::MarkerSet;
use aloft_workspace::error::PipelineError;
use serde_yaml::Value;
use std::fs;
use std::path::{Path, PathBuf};

/// A key that no file has.
const SLIP: &str = "gravty";

fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../..")
}

fn read(path: &str) -> String {
    fs::read_to_string(root().join(path)).unwrap()
}

fn parsed<T: serde::de::DeserializeOwned>(text: &str) -> Result<(), PipelineError> {
    ranges::parse_yaml::<T>("f.yaml", text).map(drop)
}

fn checked<T: serde::de::DeserializeOwned + schemars::JsonSchema + 'static>(text: &str) -> Result<(), PipelineError> {
    ranges::parse::<T>("f.yaml", text).map(drop)
}

/// Opens a pipeline with a file beside its recordings.
fn beside(pipeline: &str, recording: &str, name: &str, text: &str) -> Result<(), PipelineError> {
    let dir = tempfile::tempdir().unwrap();
    fs::write(dir.path().join(recording), "").unwrap();
    fs::create_dir(dir.path().join("model")).unwrap();
    for file in ["nominal.urdf", "nominal.xml"] {
        fs::write(dir.path().join("model").join(file), read(&format!("fixtures/robot/model/{file}"))).unwrap();
    }
    fs::write(dir.path().join(name), text).unwrap();
    let path = dir.path().join("p.yaml");
    fs::write(&path, pipeline).unwrap();
    let set = DataSet::open(&path, &Overrides::default())?;
    match set.broken.into_iter().next() {
        Some(broken) => Err(PipelineError::request(broken.failure.problem)),
        None => Ok(()),
    }
}

fn of_person(text: &str) -> Result<(), PipelineError> {
    let pipeline = "name: t\ndata: .\nmodel: human34\nmarker_set: plug-in-gait-35\nsubject: {mass_kg: 70}\n";
    beside(pipeline, "static.c3d", "subject.yaml", text)
}

fn of_object(text: &str) -> Result<(), PipelineError> {
    let pipeline = "name: t\ndata: .\nmodel: two_link\nmarker_set: two-link-chain\nobject: two_link_chain\nsubject: {mass_kg: 1}\n";
    beside(pipeline, "static.c3d", "object.yaml", text)
}

fn of_robot(text: &str) -> Result<(), PipelineError> {
    let pipeline = "name: t\ndata: .\nrobot: {}\ntrials: {identify: ['*.csv']}\n";
    beside(pipeline, "a_robot.csv", "robot.yaml", text)
}

/// Paths at which any key is allowed: names that the file gives, or a description in free words.
fn free(kind: &str, path: &str) -> bool {
    let below =
        |root: &str| path == root || path.starts_with(&format!("{root}.")) || path.starts_with(&format!("{root}["));
    let told = ["plates", "capture", "links", "recordings", "files", "columns", "trials", "notes"];
    match kind {
        "subject.yaml" | "object.yaml" | "robot.yaml" => told.iter().any(|t| below(t)),
        _ => false,
    }
}

/// Every mapping of a value, with the value that has a slip in it.
fn with_slips(value: &Value, path: &str, whole: &dyn Fn(Value) -> Value, out: &mut Vec<(String, Value)>) {
    match value {
        Value::Mapping(map) => {
            let mut slipped = map.clone();
            slipped.insert(SLIP.into(), 9.81.into());
            out.push((path.to_owned(), whole(Value::Mapping(slipped))));
            for (key, inner) in map {
                let name = key.as_str().unwrap_or("?");
                let inside = if path.is_empty() { name.to_owned() } else { format!("{path}.{name}") };
                let put = |new: Value| {
                    let mut map = map.clone();
                    map.insert(key.clone(), new);
                    whole(Value::Mapping(map))
                };
                with_slips(inner, &inside, &put, out);
            }
        }
        Value::Sequence(list) => {
            for (i, inner) in list.iter().enumerate() {
                let put = |new: Value| {
                    let mut list = list.clone();
                    list[i] = new;
                    whole(Value::Sequence(list))
                };
                with_slips(inner, &format!("{path}[{i}]"), &put, out);
            }
        }
        _ => {}
    }
}

type Kind = (&'static str, fn(&str) -> Result<(), PipelineError>, Vec<String>);

fn kinds() -> Vec<Kind> {
    let of = |kind: &str| -> Vec<String> {
        catalog::names(kind).iter().map(|n| catalog::find(kind, n, Path::new("")).unwrap().text).collect()
    };
    let pipelines =
        ["demo", "human", "robot", "chain", "osim"].iter().map(|n| root().join(format!("pipelines/{n}.yaml")));
    let overrides = "filter: {cutoff_hz: 8.0}\nimport: {up_axis: auto}\nflight: {margin_s: 0.02}\ntrials: {exclude: [{trial: a, reason: b}]}\n";
    vec![
        ("pipeline", checked::<PipelineConfig>, pipelines.filter_map(|p| fs::read_to_string(p).ok()).collect()),
        ("overrides.yaml", checked::<Sections>, vec![overrides.to_owned()]),
        ("subject.yaml", of_person, vec![read("fixtures/human_twin/subject.yaml")]),
        ("object.yaml", of_object, vec![read("fixtures/demo/object.yaml")]),
        ("robot.yaml", of_robot, vec![read("fixtures/robot/robot.yaml")]),
        ("scenario", parsed::<Scenario>, of("scenarios")),
        ("marker set", parsed::<MarkerSet>, of("markersets")),
        ("model", parsed::<ModelSpec>, of("models")),
        ("object", parsed::<ObjectSpec>, of("objects")),
        ("anthropometry", parsed::<Anthropometry>, of("anthropometry")),
        ("effect", checked::<FormulaEffect>, of("effects")),
    ]
}

#[test]
fn regress_a_key_that_is_not_read_is_refused_in_every_mapping() {
    let mut accepted = Vec::new();
    for (kind, read, texts) in kinds() {
        assert!(!texts.is_empty(), "{kind}");
        for text in texts {
            read(&text).unwrap_or_else(|e| panic!("{kind}: {e}"));
            let mut slipped = Vec::new();
            with_slips(&serde_yaml::from_str(&text).unwrap(), "", &|v| v, &mut slipped);
            for (path, value) in slipped.into_iter().filter(|(path, _)| !free(kind, path)) {
                let text = serde_yaml::to_string(&value).unwrap();
                match read(&text) {
                    Ok(()) => accepted.push(format!("{kind}: {path}")),
                    Err(e) => assert!(!e.to_string().is_empty()),
                }
            }
        }
    }
    accepted.sort();
    accepted.dedup();
    assert!(accepted.is_empty(), "{accepted:#?}");
}

#[test]
fn a_slip_is_shown_with_its_line_and_the_key_that_was_meant() {
    let told = |result: Result<(), PipelineError>| match result {
        Err(e) => format!("{e} / {}", miette::Diagnostic::help(&e).map(|h| h.to_string()).unwrap_or_default()),
        Ok(()) => "accepted".to_owned(),
    };
    let robot = read("fixtures/robot/robot.yaml");
    for (said, expected) in [
        (
            told(of_robot(&robot.replace("gravity_m_s2", "gravty_m_s2"))),
            "line 4: unknown key `gravty_m_s2` / did you mean `gravity_m_s2`?",
        ),
        (
            told(of_robot(&robot.replace("orientation_deg", "orientation_dg"))),
            "unknown key `orientation_dg` in `noise` / did you mean `orientation_deg`?",
        ),
        (told(of_robot(&format!("{robot}gravty: 1\n"))), "unknown key `gravty` / "),
        (told(of_robot(&format!("{robot}gravity_direction: [0, -1, 0]\n"))), "`gravity_direction` is not [0, 0, -1]"),
        (told(of_robot(&format!("{robot}gravity_direction: [0, 0, -1]\nnotes: {{any: thing}}\n"))), "accepted"),
        (told(of_person("mass_kg: 70\nheigth_m: 1.8\n")), "line 2: unknown key `heigth_m` / did you mean `height_m`?"),
        (
            told(of_person("mass_kg: 70\nlab: {gravty: 9.81}\n")),
            "line 2: unknown key `gravty` in `lab` / did you mean `gravity`?",
        ),
        (told(of_person("mass_kg: 70\nage: 31\nnotes: barefoot\n")), "accepted"),
    ] {
        assert!(said.contains(expected), "{said}\nexpected {expected}");
    }
}

#[test]
fn a_slip_in_the_head_of_a_table_of_participants_is_refused() {
    let of = |head: &str| {
        let pipeline = "name: t\ndata: .\nmodel: human34\nmarker_set: plug-in-gait-35\nsubject: {mass_kg: 70}\n";
        beside(pipeline, "static.c3d", "participants.tsv", &format!("participant_id\t{head}\nsub-01\t1.7\n"))
    };
    assert!(of("wieght").unwrap_err().to_string().contains("line 1: unknown column `wieght`"));
    assert!(of("height_mm").unwrap_err().to_string().contains("unknown column `height_mm`"));
    for other in ["height", "group", "age", "bmi", "dominant_leg"] {
        of(other).unwrap();
    }
}
