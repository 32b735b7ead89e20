//! `scale`: the static trial to this body's own model, marker places and prior inertias.

use crate::graph::{Done, Job, Need, Scope, Stage};
use aloft_body::Subject;
use aloft_scale::{HipMethod, PersonInput, ScaleOptions, Scaled, scale_person};
use aloft_study::study::{Role, Study};
use aloft_workspace::error::StageFailure;
use aloft_workspace::key::key;
use aloft_workspace::workspace::{WHOLE_STUDY, read_json, write_json};
use serde_json::json;

/// The stage.
pub static STAGE: Stage = Stage {
    name: "scale",
    version: 2,
    scope: Scope::Study,
    reads: "static trial (objects: calibration trial, too), anthropometry or object description",
    gives: "`Subject`: the model with this body's joint centres, marker places and prior inertias",
    needs: &[Need::EveryOrStaticFrames("import", &[Role::Static, Role::Calibration])],
    parameters: |study, _| {
        json!({
            "scale": key(&study.config.scale), "model": key(&study.model), "marker_set": key(&study.marker_set),
            "object": key(&study.object), "anthropometry": key(&study.anthropometry), "facts": key(&study.facts),
            "static_frames": key(&study.config.trials.static_frames),
        })
    },
    run,
};

/// Velocity indices that no marker observes.
pub fn load_locked(job: &Job<'_>) -> Result<Vec<usize>, StageFailure> {
    Ok(read_json(&job.workspace.place("scale", WHOLE_STUDY).join("locked.json"))?)
}

/// Writes `subject.json`.
pub fn save_subject(job: &Job<'_>, subject: &Subject) -> Result<(), StageFailure> {
    Ok(write_json(&job.out.join("subject.json"), subject)?)
}

fn hip_method(study: &Study) -> Result<HipMethod, StageFailure> {
    serde_json::from_value(json!(study.config.scale.hip)).map_err(|_| {
        StageFailure::with_hint(
            format!("scale.hip is `{}`", study.config.scale.hip),
            "expected harrington, bell, hara or davis",
        )
    })
}

/// The static trial's name and, where frames of a dynamic trial serve, their range.
fn static_source(job: &Job<'_>) -> Result<(String, Option<std::ops::Range<usize>>), StageFailure> {
    let study = job.study;
    if let Some(named) = &study.config.trials.static_frames {
        if !job.inputs.iter().any(|(s, t)| s == "import" && t == &named.trial) {
            return Err(StageFailure::with_hint(
                format!("trials.static_frames names `{}`, which was not imported", named.trial),
                "look at the import of that trial, or name another one",
            ));
        }
        if named.first == 0 || named.last < named.first {
            return Err(StageFailure::new(format!(
                "trials.static_frames: frames {} to {}; expected first ≥ 1 and last ≥ first",
                named.first, named.last
            )));
        }
        return Ok((named.trial.clone(), Some(named.first - 1..named.last)));
    }
    let names: Vec<String> = job
        .trials_of("import")
        .into_iter()
        .filter(|n| study.trial(n).is_some_and(|t| t.role == Role::Static))
        .collect();
    match names.first() {
        Some(name) => Ok((name.clone(), None)),
        None => {
            let tried: Vec<&str> =
                study.included().filter(|t| t.role == Role::Static).map(|t| t.name.as_str()).collect();
            let problem = if tried.is_empty() {
                format!(
                    "no static trial in {} (patterns: {})",
                    study.data.display(),
                    study.config.trials.r#static.join(", ")
                )
            } else {
                format!("the static trial {} could not be imported", tried.join(", "))
            };
            Err(StageFailure::with_hint(
                problem,
                "record one, or name quiet frames of another trial: `trials: {static_frames: {trial: …, first: 1, last: 50}}`",
            ))
        }
    }
}

fn run(job: &Job<'_>) -> Result<Done, StageFailure> {
    if job.study.object.is_some() {
        return super::object::scale(job);
    }
    let study = job.study;
    let (name, frames) = static_source(job)?;
    let trial = job.load_trial(&name)?;
    let options = ScaleOptions { hip: hip_method(study)?, ..ScaleOptions::default() };
    let input = PersonInput {
        facts: &study.facts.person,
        model_spec: &study.model,
        marker_set: &study.marker_set,
        static_trial: &trial,
        frames,
    };
    let mut scaled =
        scale_person(&input, &study.anthropometry, &options).map_err(|e| StageFailure::new(e.to_string()))?;
    scaled.subject.model.gravity_mps2 = study.gravity();
    save_subject(job, &scaled.subject)?;
    write_json(&job.out.join("locked.json"), &scaled.locked)?;
    write_json(&job.out.join("anatomy.json"), &scaled.anatomy)?;
    write_json(&job.out.join("report.json"), &scaled.report)?;
    Ok(describe(&scaled))
}

fn describe(scaled: &Scaled) -> Done {
    let mut done = Done::default();
    done.note("static_trial", scaled.report.trial.clone());
    done.note("static_frames", scaled.report.frames.2);
    done.note("locked", scaled.report.locked.len());
    let errors: Vec<f64> = scaled.report.markers.iter().filter_map(|m| m.rigid_error_m).collect();
    if !errors.is_empty() {
        let mean_square = errors.iter().map(|e| e * e).sum::<f64>() / errors.len() as f64;
        done.note("scaling_error_mm", mean_square.sqrt() * 1e3);
    }
    done.note("static_spread_mm", scaled.report.typical_spread_m * 1e3);
    done.warnings.extend(scaled.report.warnings.iter().map(ToString::to_string));
    done
}
