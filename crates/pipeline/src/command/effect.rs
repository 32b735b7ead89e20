//! `effect list | show | add | remove` and `history`: the model's revisions and what each reached.

use crate::command::compare::{ComparisonView, compare, judged_on};
use crate::error::PipelineError;
use crate::revision::{ModelEffect, Reached, Revision, Revisions};
use crate::runner::{Progress, RunReport, Selection, run};
use crate::stages::identify::file_name;
use crate::study::{Overrides, Study};
use crate::workspace::{WHOLE_STUDY, Workspace, read_json};
use aloft_body::Subject;
use aloft_discover::Discovery;
use aloft_effects::{EFFECTS, EffectDefinition, Scene, effect};
use aloft_identify::Parameters;
use serde::Serialize;
use std::collections::BTreeMap;

/// The catalogue.
pub fn list() -> &'static [&'static EffectDefinition] {
    EFFECTS
}

/// One effect's documentation.
pub fn show(id: &str) -> Result<&'static EffectDefinition, PipelineError> {
    effect(id).map_err(|e| PipelineError::request(e.to_string()))
}

/// The ladder as `history --json` shows it.
#[derive(Debug, Clone, Serialize)]
pub struct History {
    /// Version of this structure.
    pub version: u32,
    /// Who.
    pub subject: String,
    /// Revisions, oldest first.
    pub revisions: Vec<HistoryRow>,
}

/// One rung.
#[derive(Debug, Clone, Serialize)]
pub struct HistoryRow {
    /// Number.
    pub revision: usize,
    /// What made it.
    pub action: String,
    /// Effects of the model.
    pub effects: Vec<String>,
    /// Held-out error over weak windows, N.
    pub held_out_error: Option<f64>,
    /// The same for the revision before.
    pub held_out_error_before: Option<f64>,
    /// What noise alone makes, N.
    pub noise_floor: Option<f64>,
    /// Error in flight, N.
    pub flight_error: Option<f64>,
    /// What the held-out error is taken on.
    pub judged_on: Option<String>,
    /// σ_{N−1}/σ_N.
    pub sigma_ratio: Option<f64>,
    /// Coefficients.
    pub coefficients: Vec<HistoryCoefficient>,
    /// Largest change of a base parameter against the revision before: name and change.
    pub largest_change: Option<(String, f64)>,
    /// Set when the gain is void, with the reason.
    pub void: Option<String>,
}

/// One coefficient with its interval.
#[derive(Debug, Clone, Serialize)]
pub struct HistoryCoefficient {
    /// Name.
    pub name: String,
    /// Value.
    pub value: f64,
    /// Standard error.
    pub se: f64,
    /// 95 % interval.
    pub ci95: [f64; 2],
}

/// Reads the revisions, with what the present one reached.
pub fn history(study: &Study) -> Result<History, PipelineError> {
    let mut all = Revisions::load(&study.workspace)?;
    if let (Some(last), Ok(view)) = (all.revisions.last_mut(), compare(study))
        && last.reached.is_none()
    {
        last.reached = Some(reached(study, &view)?);
    }
    let rows = all
        .revisions
        .iter()
        .enumerate()
        .map(|(i, r)| row(r, i.checked_sub(1).and_then(|j| all.revisions.get(j))))
        .collect();
    Ok(History { version: 1, subject: study.facts.person.name.clone(), revisions: rows })
}

fn row(r: &Revision, before: Option<&Revision>) -> HistoryRow {
    let now = r.reached.as_ref();
    let old = before.and_then(|b| b.reached.as_ref());
    let largest_change = now.zip(old).and_then(|(n, o)| {
        n.base.iter().zip(&o.base).map(|(a, b)| (a.0.clone(), a.1 - b.1)).max_by(|a, b| a.1.abs().total_cmp(&b.1.abs()))
    });
    let void = now.zip(old).and_then(|(n, o)| {
        (n.marker_rms_mm > 1.02 * o.marker_rms_mm)
            .then(|| format!("void: marker error grew from {:.2} to {:.2} mm", o.marker_rms_mm, n.marker_rms_mm))
    });
    HistoryRow {
        revision: r.number,
        action: r.action.clone(),
        effects: r.effects.iter().map(|e| e.key.clone()).collect(),
        held_out_error: now.map(|n| n.held_out_error),
        held_out_error_before: old.map(|o| o.held_out_error),
        noise_floor: now.and_then(|n| n.noise_floor),
        flight_error: now.map(|n| n.flight_error),
        judged_on: now.map(|n| n.judged_on.clone()),
        sigma_ratio: now.map(|n| n.sigma_ratio),
        coefficients: now
            .map(|n| {
                n.coefficients
                    .iter()
                    .map(|(name, value, se)| HistoryCoefficient {
                        name: name.clone(),
                        value: *value,
                        se: *se,
                        ci95: [value - 1.96 * se, value + 1.96 * se],
                    })
                    .collect()
            })
            .unwrap_or_default(),
        largest_change,
        void,
    }
}

/// What the present results reach.
pub fn reached(study: &Study, view: &ComparisonView) -> Result<Reached, PipelineError> {
    let c = &view.comparison;
    let ws = Workspace::open(&study.workspace);
    let parameters: Parameters =
        read_json(&ws.place("identify", WHOLE_STUDY).join(file_name(study.config.regressor.rows)))?;
    let contact = c.first.held_out.frames > 0;
    let rms: Vec<f64> = view.kinematics.iter().filter_map(|k| k.marker_rms_mm).collect();
    Ok(Reached {
        held_out_error: if contact { c.first.held_out_weak.size() } else { c.first.flight_weak.size() },
        judged_on: judged_on(c).to_owned(),
        flight_error: c.first.flight_weak.size(),
        noise_floor: c.noise_floor.as_ref().map(|f| if contact { f.contact_weak.size() } else { f.flight_weak.size() }),
        sigma_ratio: view.parameters.sigma_ratio,
        marker_rms_mm: rms.iter().sum::<f64>() / rms.len().max(1) as f64,
        coefficients: parameters.effects.iter().map(|e| (e.name.clone(), e.value, e.se)).collect(),
        base: parameters.base.iter().map(|b| (b.name.clone(), b.value)).collect(),
    })
}

fn scene(study: &Study) -> Result<Scene, PipelineError> {
    let ws = Workspace::open(&study.workspace);
    let subject: Subject = read_json(&ws.place("calibrate", WHOLE_STUDY).join("subject.json"))?;
    let mut centers = Vec::new();
    for t in study.included() {
        if let Ok(trial) = crate::artifact::load_trial(&ws.place("import", &t.name))
            && !trial.plates.is_empty()
        {
            centers = trial
                .plates
                .iter()
                .map(|p| p.corners_m.iter().sum::<nalgebra::Vector3<f64>>() / p.corners_m.len().max(1) as f64)
                .collect();
            break;
        }
    }
    Ok(Scene::new(&subject.model, &subject.prior_phi(), &centers))
}

/// Records what the present revision reached, if it is not recorded yet.
fn record(study: &Study, all: &mut Revisions) -> Result<(), PipelineError> {
    if let Some(last) = all.revisions.last_mut()
        && last.reached.is_none()
    {
        let view = compare(study)?;
        last.reached = Some(reached(study, &view)?);
    }
    Ok(())
}

/// Adds an effect: a new revision, and everything that depends on it again.
pub fn add(
    study: &Study,
    overrides: &Overrides,
    key: &str,
    set: &[(String, f64)],
    progress: &dyn Progress,
) -> Result<(RunReport, History), PipelineError> {
    let mut all = Revisions::load(&study.workspace)?;
    record(study, &mut all)?;
    let scene = scene(study)?;
    let mut effects = all.effects();
    let found: Option<Discovery> = read_json(&study.workspace.join("discovery.json")).ok();
    let suggestion = found.as_ref().and_then(|d| suggestion(d, key));
    let (key, mut nonlinear) = suggestion.unwrap_or((key.to_owned(), BTreeMap::new()));
    if effects.iter().any(|e| e.key == key) {
        return Err(PipelineError::request_hint(
            format!("the model holds `{key}` already"),
            "see `aloft history`; remove it first to change it",
        ));
    }
    nonlinear.extend(set.iter().cloned());
    let chosen = ModelEffect { key: key.clone(), nonlinear };
    chosen.choice(&scene)?;
    effects.push(chosen);
    all.push(format!("add {key}"), effects);
    rerun(study, overrides, all, progress)
}

/// What the last discovery says of an effect: its key with target, and its nonlinear parameters.
fn suggestion(d: &Discovery, key: &str) -> Option<(String, BTreeMap<String, f64>)> {
    let values = |n: &[aloft_discover::Estimate]| n.iter().map(|e| (e.name.clone(), e.value)).collect();
    d.found.iter().find(|f| f.key == key || f.effect == key).map(|f| (f.key.clone(), values(&f.nonlinear))).or_else(
        || d.candidates.iter().find(|c| c.key == key || c.effect == key).map(|c| (c.key.clone(), values(&c.nonlinear))),
    )
}

/// Takes an effect out: a new revision without it.
pub fn remove(
    study: &Study,
    overrides: &Overrides,
    key: &str,
    progress: &dyn Progress,
) -> Result<(RunReport, History), PipelineError> {
    let mut all = Revisions::load(&study.workspace)?;
    record(study, &mut all)?;
    let mut effects = all.effects();
    let before = effects.len();
    effects.retain(|e| e.key != key && e.key.split('[').next() != Some(key));
    if effects.len() == before {
        let held: Vec<&str> = effects.iter().map(|e| e.key.as_str()).collect();
        return Err(PipelineError::request_hint(
            format!("the model holds no `{key}`"),
            if held.is_empty() { "it holds no effect".to_owned() } else { format!("it holds {}", held.join(", ")) },
        ));
    }
    all.push(format!("remove {key}"), effects);
    rerun(study, overrides, all, progress)
}

fn rerun(
    study: &Study,
    overrides: &Overrides,
    mut all: Revisions,
    progress: &dyn Progress,
) -> Result<(RunReport, History), PipelineError> {
    all.save(&study.workspace)?;
    let now = Study::open(&study.config_path, overrides)?;
    let report = run(&now, &Selection::default(), progress)?;
    if report.tasks.iter().any(|t| {
        t.stage == "compare" && !matches!(t.ended, crate::runner::Ended::Failed(_) | crate::runner::Ended::Blocked(_))
    }) {
        record(&now, &mut all)?;
        all.save(&now.workspace)?;
    }
    Ok((report, history(&now)?))
}
