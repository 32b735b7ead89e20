//! How the results in a workspace were made: the settings read from their manifests, for all texts
//! that state them.

use crate::graph::Scope;
use crate::stages::STAGES;
use aloft_study::config::{CorrectionsConfig, PipelineConfig};
use aloft_study::facts::Facts;
use aloft_study::revision::ModelEffect;
use aloft_study::subject_session::SubjectSession;
use aloft_workspace::error::PipelineError;
use aloft_workspace::manifest::{Manifest, TIME, WHOLE_STUDY};
use aloft_workspace::workspace::Workspace;
use serde::de::DeserializeOwned;
use serde_json::Value;
use std::collections::BTreeMap;

/// Existing, successful results of a stage, by trial.
fn made(session: &SubjectSession, ws: &Workspace, stage: &str) -> Result<Vec<(String, Manifest)>, PipelineError> {
    let tasks = STAGES.iter().find(|s| s.name == stage).map_or(Vec::new(), |s| s.tasks(session));
    let names = tasks.into_iter().map(|t| t.map_or(WHOLE_STUDY, |t| t.name.as_str()));
    names.filter_map(|n| ws.usable(stage, n).map(|m| Some((n.to_owned(), m?))).transpose()).collect()
}

/// The value under a key of a stage's parameters with which most of its results were made.
fn most<T: DeserializeOwned>(manifests: &[(String, Manifest)], key: &str) -> Option<T> {
    let mut count: BTreeMap<String, (usize, &Value)> = BTreeMap::new();
    for (_, m) in manifests {
        if let Some(value) = m.parameters.get(key) {
            count.entry(value.to_string()).or_insert((0, value)).0 += 1;
        }
    }
    let (_, value) = count.into_values().max_by_key(|(n, _)| *n)?;
    read(value)
}

/// A setting as a manifest states it. Present settings can always be read: one that cannot is of
/// another version, its result differs from the present one and is stale.
fn read<T: DeserializeOwned>(value: &Value) -> Option<T> {
    // none: such a result is stale, and every command says so
    serde_json::from_value(value.clone()).ok()
}

fn put<T>(place: &mut T, found: Option<T>) {
    if let Some(found) = found {
        *place = found;
    }
}

/// The study with the settings that its results were made with, where these differ from the present
/// pipeline. Recordings, names and paths are the present ones.
///
/// # Errors
/// A manifest is there and cannot be read.
pub fn as_made(session: &SubjectSession) -> Result<SubjectSession, PipelineError> {
    let ws = Workspace::open(&session.workspace);
    let of = |stage: &str| made(session, &ws, stage);
    let mut out = session.clone();
    let config: &mut PipelineConfig = &mut out.config;
    let import = of("import")?;
    put(&mut config.import, most(&import, "import"));
    put(&mut out.marker_set, most(&import, "marker_set"));
    let corrected: Option<aloft_trial::Corrections> = most(&import, "corrections");
    let scale = of("scale")?;
    put(&mut config.scale, most(&scale, "scale"));
    put(&mut config.trials.static_frames, most(&scale, "static_frames"));
    put(&mut out.model, most(&scale, "model"));
    put(&mut out.object, most(&scale, "object"));
    put(&mut out.robot, most(&scale, "robot"));
    // paths are no part of a manifest
    if let (Some(robot), Some(present)) = (&mut out.robot, &session.robot) {
        robot.files.clone_from(&present.files);
    }
    put(&mut out.anthropometry, most(&scale, "anthropometry"));
    put(&mut out.facts, most::<Facts>(&scale, "facts"));
    if !import.is_empty() {
        let mass_kg = out.facts.stated_mass_kg.map(|_| out.facts.person.mass_kg);
        config.corrections = CorrectionsConfig::made(corrected.as_ref(), mass_kg);
    }
    put(&mut config.calibrate, most(&of("calibrate")?, "calibrate"));
    put(&mut config.ik, most(&of("ik")?, "ik"));
    put(&mut config.filter, most(&of("filter")?, "filter"));
    put(&mut config.flight, most(&of("flight")?, "flight"));
    let regressor = of("regressor")?;
    put(&mut config.flight.margin_s, most(&of("acceleration")?, "margin_s"));
    put(&mut config.regressor.window_s, most(&regressor, "window_s"));
    put(&mut config.regressor.weighting, most(&regressor, "weighting"));
    put(&mut config.regressor.slow_noise, most(&regressor, "slow_noise"));
    if let Some(effects) = most(&regressor, "effects") {
        put(&mut out.effects, effects_of(&effects));
    }
    let identify = of("identify")?;
    put(&mut config.identify, most(&identify, "identify"));
    put(&mut config.regressor.rows, most(&identify, "rows"));
    put(&mut config.compare, most(&of("compare")?, "compare"));
    for trial in &mut out.trials {
        let Some(own) = &mut trial.settings else { continue };
        let of = |stage: &str| ws.usable(stage, &trial.name);
        put(&mut own.import, of("import")?.and_then(|m| read(m.parameters.get("import")?)));
        put(&mut own.ik, of("ik")?.and_then(|m| read(m.parameters.get("ik")?)));
        put(&mut own.flight, of("flight")?.and_then(|m| read(m.parameters.get("flight")?)));
    }
    Ok(out)
}

/// Effects of a model as stored in a manifest; none if they cannot be read.
fn effects_of(parameters: &Value) -> Option<Vec<ModelEffect>> {
    parameters.get("model").map_or(Some(Vec::new()), read)
}

/// Effects with which a comparison's parameters were identified; none if they cannot be read.
pub fn compared_effects(compared: &Manifest) -> Option<Vec<ModelEffect>> {
    effects_of(compared.parameters.get("effects")?)
}

/// Hash of the settings and recordings from which all results were made, without the effects of the
/// model and the corrections, which are rungs of the ladder.
///
/// # Errors
/// A manifest is there and cannot be read.
pub fn made_with(session: &SubjectSession, ws: &Workspace) -> Result<String, PipelineError> {
    let mut hasher = blake3::Hasher::new();
    for stage in STAGES {
        for (name, mut m) in made(session, ws, stage.name)? {
            if let Some(all) = m.parameters.as_object_mut() {
                // whether contact is used can follow from the effects; what the pipeline states of
                // it is among the settings of `identify`
                all.remove("effects");
                all.remove("corrections");
                uncorrected_mass(all);
                all.remove("contact");
            }
            hasher.update(format!("{}/{name} {} {}\n", stage.name, m.version, m.parameters).as_bytes());
            // times in the session follow from the recordings, and from a correction of their rate
            for (input, hash) in m.inputs.iter().filter(|(k, _)| !k.contains('/') && *k != TIME) {
                hasher.update(format!("{input} {hash}\n").as_bytes());
            }
        }
    }
    Ok(hasher.finalize().to_hex().to_string())
}

/// Puts the stated body mass back where a correction replaced it.
fn uncorrected_mass(parameters: &mut serde_json::Map<String, Value>) {
    let Some(facts) = parameters.get_mut("facts").and_then(Value::as_object_mut) else { return };
    let Some(stated) = facts.remove("stated_mass_kg") else { return };
    if let Some(person) = facts.get_mut("person").and_then(Value::as_object_mut) {
        person.insert("mass_kg".to_owned(), stated);
    }
}

/// Settings that differ between the results of different recordings, in words. Causes are
/// overrides, or recomputing only some of the results.
///
/// # Errors
/// A manifest is there and cannot be read.
pub fn differences(session: &SubjectSession, ws: &Workspace) -> Result<Vec<String>, PipelineError> {
    let mut out = Vec::new();
    for stage in STAGES.iter().filter(|s| matches!(s.scope, Scope::Trial(_))) {
        let all = made(session, ws, stage.name)?;
        let mut leaves: BTreeMap<String, BTreeMap<String, Vec<&str>>> = BTreeMap::new();
        for (name, m) in &all {
            let mut own = Vec::new();
            flatten("", &m.parameters, &mut own);
            for (path, value) in own {
                leaves.entry(path).or_default().entry(value).or_default().push(name);
            }
        }
        // report a difference in the section where the setting belongs, not for every stage that
        // reads it
        for (path, values) in leaves.into_iter().filter(|(p, v)| v.len() > 1 && p.starts_with(stage.name)) {
            let words: Vec<String> = values
                .iter()
                .map(|(value, names)| match names.len() {
                    1..=3 => format!("{value} ({})", names.join(", ")),
                    n => format!("{value} ({n} recordings)"),
                })
                .collect();
            out.push(format!("{path} differs between recordings: {}", words.join(", ")));
        }
    }
    Ok(out)
}

fn flatten(path: &str, value: &Value, out: &mut Vec<(String, String)>) {
    match value {
        Value::Object(all) if !all.is_empty() => {
            for (key, value) in all {
                flatten(&if path.is_empty() { key.clone() } else { format!("{path}.{key}") }, value, out);
            }
        }
        other => out.push((path.to_owned(), other.to_string())),
    }
}
