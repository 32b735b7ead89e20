//! Every file that a command stores is read back when every number in it is undefined: `null` in
//! JSON, NaN in memory. Nothing that one command writes can stop the others.

use crate::support::{aloft, expect, folder, json, lab, repo};
use aloft_analysis::assess::Assessment;
use aloft_analysis::discover::{Kept, Volume};
use aloft_body::Subject;
use aloft_compare::Comparison;
use aloft_discover::Discovery;
use aloft_flight::{Coverage, FlightReport, ImpulseMass, PlateDelay, PlateTare};
use aloft_identify::Parameters;
use aloft_ik::{CalibrationReport, GeometryError, LabelExchange, Segments};
use aloft_pipeline::factors::{load_factors, load_named, load_repeated};
use aloft_pipeline::stages::compare::StoredFloor;
use aloft_pipeline::stages::import::ImportRecord;
use aloft_robot::FusionReport;
use aloft_robot::joint_fit::JointFit;
use aloft_robot::markers::{LinkMarker, PoseNoise};
use aloft_scale::{ScaleReport, StaticAnatomy};
use aloft_signal::residual_analysis::ResidualAnalysis;
use aloft_study::revision::Revisions;
use aloft_workspace::artifact::{load_motion, load_trial};
use aloft_workspace::error::PipelineError;
use aloft_workspace::json::{from_value, read_json};
use aloft_workspace::manifest::Manifest;
use aloft_workspace::seal;
use serde::Serialize;
use serde::de::DeserializeOwned;
use serde_json::Value;
use std::collections::BTreeSet;
use std::fs;
use std::path::Path;

type Read = Result<(), PipelineError>;

/// Reads a value, and once more what would be written of it: nothing is lost on the way. Figures
/// that follow from others are computed anew, and so need not be those of the file.
fn twice<T: Serialize + DeserializeOwned>(value: T) -> Read {
    let written = serde_json::to_value(value).unwrap();
    let again = serde_json::to_value(from_value::<T>(written.clone()).unwrap()).unwrap();
    assert_eq!(written, again);
    Ok(())
}

fn same<T: Serialize + DeserializeOwned>(path: &Path) -> Read {
    twice(read_json::<T>(path)?)
}

fn sealed<T: Serialize + DeserializeOwned>(path: &Path) -> Read {
    twice(seal::read::<T>(path)?)
}

fn beside<T>(path: &Path, load: impl Fn(&Path) -> Result<T, PipelineError>) -> Read {
    load(path.parent().unwrap()).map(|_| ())
}

/// Reads a file of a workspace as the commands do; `place` is its path below the workspace.
fn read(place: &str, path: &Path) -> Read {
    let (folder, name) = place.rsplit_once('/').unwrap_or(("", place));
    let stage = folder.split('/').next().unwrap_or_default();
    match (stage, name) {
        ("", "model.json") => sealed::<Revisions>(path),
        ("", "discovery.json") | ("discoveries", _) => sealed::<Kept<Discovery>>(path),
        ("", "discovery_volume.json") => sealed::<Volume>(path),
        ("", "assessment.json") => sealed::<Assessment>(path),
        (_, "manifest.json") => sealed::<Manifest>(path),
        (_, "subject.json") => same::<Subject>(path),
        (_, "trial.json") => beside(path, load_trial),
        (_, "motion.json") => beside(path, load_motion),
        (_, "quality.json") => same::<ImportRecord>(path),
        ("scale", "report.json") if is_of_person(path) => same::<ScaleReport>(path),
        (_, "anatomy.json") => same::<StaticAnatomy>(path),
        ("calibrate", "report.json") if holds(path, "held_out_rms_before_m") => same::<CalibrationReport>(path),
        (_, "geometry_errors.json") => same::<Vec<GeometryError>>(path),
        (_, "labels.json") => same::<Vec<LabelExchange>>(path),
        (_, "residual_analysis.json") => same::<ResidualAnalysis>(path),
        (_, "flights.json") => same::<FlightReport>(path),
        (_, "tare.json") => same::<Vec<PlateTare>>(path),
        (_, "coverage.json") => same::<Coverage>(path),
        (_, "impulse_mass.json") => same::<Vec<ImpulseMass>>(path),
        (_, "plate_delay.json") => same::<Vec<PlateDelay>>(path),
        (_, "parameters_weak.json" | "parameters_acceleration.json") => same::<Parameters>(path),
        (_, "joints.json") => same::<JointFit>(path),
        (_, "comparison.json") => same::<Comparison>(path),
        (_, "noise_floor.json") => same::<StoredFloor>(path),
        (_, "fusion.json") => same::<FusionReport>(path),
        (_, "link_markers.json" | "markers_on_links.json") => same::<Option<(PoseNoise, Vec<LinkMarker>)>>(path),
        (_, "torque_noise.json") => same::<Vec<Vec<f64>>>(path),
        (_, "segments.json") => same::<Segments>(path),
        (_, "factors.json") => beside(path, load_factors),
        (_, "repeated.json") => beside(path, load_repeated),
        (_, "torque_factors.json") => beside(path, |dir| load_named(dir, "torque_factors")),
        // without fractions, or read as any JSON
        (
            _,
            "misfits.json" | "locked.json" | "clock.json" | "nothing_identified.json" | "inputs.json" | "outputs.json",
        ) => same::<Value>(path),
        (_, "report.json") => same::<Value>(path),
        ("", "self_test.json") => sealed::<Value>(path),
        _ => panic!("{place}: no reader is named for this file: add it to the test"),
    }
}

/// The report of a person states a range of frames, that of an object their number.
fn is_of_person(path: &Path) -> bool {
    serde_json::from_slice::<Value>(&fs::read(path).unwrap()).unwrap()["frames"].is_array()
}

/// Reports of objects and robots have forms of their own, which no command reads.
fn holds(path: &Path, key: &str) -> bool {
    serde_json::from_slice::<Value>(&fs::read(path).unwrap()).unwrap().get(key).is_some()
}

/// Replaces those fractions that are chosen by `null`; returns how many.
fn undefine(value: &mut Value, chosen: &mut dyn FnMut() -> bool) -> usize {
    match value {
        Value::Number(n) if n.is_f64() && chosen() => {
            *value = Value::Null;
            1
        }
        Value::Array(all) => all.iter_mut().map(|v| undefine(v, chosen)).sum(),
        // a warning that names its kind states a figure that is beyond a limit, and so is a number
        Value::Object(all) if ["kind", "reason"].iter().any(|k| all.get(*k).is_some_and(Value::is_string)) => 0,
        Value::Object(all) => all.values_mut().map(|v| undefine(v, chosen)).sum(),
        _ => 0,
    }
}

/// Writes a changed value in place of a file, sealed if it was.
fn put(path: &Path, mut value: Value) {
    match value.as_object_mut().and_then(|o| o.remove("check")) {
        Some(_) => seal::write_whole(path, &value).unwrap(),
        None => fs::write(path, value.to_string()).unwrap(),
    }
}

/// Checks every JSON file of a workspace with all numbers undefined, and with `rounds` choices of
/// some of them.
fn check(ws: &Path, rounds: u64, seen: &mut BTreeSet<String>) {
    for entry in walkdir::WalkDir::new(ws).into_iter().map(Result::unwrap) {
        let place = entry.path().strip_prefix(ws).unwrap().to_string_lossy().into_owned();
        let caches = ["forecast/", "replaced/", "switch_rows/", "columns/"];
        if !place.ends_with(".json") || place.starts_with('.') || caches.iter().any(|c| place.starts_with(c)) {
            continue;
        }
        let before = fs::read(entry.path()).unwrap();
        let whole: Value = serde_json::from_slice(&before).unwrap();
        for round in 0..=rounds {
            // a fixed sequence of pseudo-random choices (Knuth's MMIX generator); all in the first
            let mut state = round ^ 0x9e37_79b9;
            let mut chosen = || {
                state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
                round == 0 || state >> 63 == 1
            };
            let mut value = whole.clone();
            if undefine(&mut value, &mut chosen) == 0 {
                break;
            }
            put(entry.path(), value);
            read(&place, entry.path()).unwrap_or_else(|e| panic!("{place}, round {round}: {e}"));
            seen.insert(place.rsplit('/').next().unwrap().to_owned());
        }
        fs::write(entry.path(), before).unwrap();
    }
}

#[test]
fn prop_every_stored_file_is_read_back_with_every_number_undefined() {
    let dir = folder();
    let mut seen = BTreeSet::new();
    let data = lab("fixtures/scenarios/human_small.yaml", dir.path()).display().to_string();
    let studies = [("demo", None), ("human", Some(data)), ("robot", None)];
    for (name, data) in studies {
        let ws = dir.path().join(name);
        let pipeline = repo(&format!("pipelines/{name}.yaml"));
        let place = ws.display().to_string();
        let mut words = vec![pipeline.as_str(), "--workspace", &place];
        words.extend(data.iter().flat_map(|d| ["--data", d.as_str()]));
        // a recording that fails leaves the results of the others
        assert!(aloft(&[&["run"], &words[..]].concat()).status.code().is_some_and(|code| code < 2));
        if name == "demo" {
            expect(&[&["discover"], &words[..]].concat(), 0);
            expect(&[&["parameters"], &words[..], &["--assess"]].concat(), 0);
        }
        check(&ws, 3, &mut seen);
    }
    for name in
        ["comparison.json", "flights.json", "subject.json", "parameters_weak.json", "discovery.json", "fusion.json"]
    {
        assert!(seen.contains(name), "{name} was not written: {seen:?}");
    }
}

/// Without flights nothing is identified, and there is no ratio of singular values.
#[test]
fn regress_an_effect_can_be_added_where_a_figure_is_undefined() {
    let dir = folder();
    let data = lab("fixtures/scenarios/human_small.yaml", dir.path()).display().to_string();
    let ws = dir.path().join("ws");
    let place = ws.display().to_string();
    // without flights nothing is identified from them
    let pipeline = dir.path().join("p.yaml");
    let text = fs::read_to_string(repo("pipelines/human.yaml")).unwrap();
    let text = text.replace("identify: [\"jump*.c3d\"]", "identify: [\"exercise*.c3d\"]");
    fs::write(&pipeline, text.replace("validate: [\"exercise*.c3d\"]", "validate: []")).unwrap();
    let pipeline = pipeline.display().to_string();
    let words = [pipeline.as_str(), "--data", &data, "--workspace", &place];
    expect(&[&["run"], &words[..]].concat(), 0);
    expect(&["effect", "add", words[0], "plate_gain", words[1], words[2], words[3], words[4]], 0);
    for command in ["run", "compare", "history", "report", "status"] {
        expect(&[&[command], &words[..]].concat(), 0);
    }
    // a file that an earlier version wrote is read, too
    let mut model: Value = serde_json::from_slice(&fs::read(ws.join("model.json")).unwrap()).unwrap();
    let mut changed = 0;
    for revision in model["revisions"].as_array_mut().unwrap() {
        changed += undefine(&mut revision["reached"], &mut || true);
    }
    assert!(changed > 0);
    put(&ws.join("model.json"), model);
    assert!(json(&[&["history"], &words[..], &["--json"]].concat())["revisions"].is_array());
}
