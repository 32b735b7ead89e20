//! `scale`: the static trial to this body's own model, marker places and prior inertias.

use crate::graph::{Need, Scope, Stage, StageInputs, StageReport, StageWork, parameters_of, run_of};
use crate::stages::shared::save_subject;
use aloft_body::ModelSpec;
use aloft_scale::{Anthropometry, HipMethod, ObjectSpec, PersonInput, ScaleOptions, Scaled, scale_person};
use aloft_study::config::{ScaleConfig, StaticFrames};
use aloft_study::facts::Facts;
use aloft_study::osim::OsimSetup;
use aloft_study::robot::RobotSetup;
use aloft_study::subject_session::{Role, SubjectSession, TrialEntry};
use aloft_trial::MarkerSet;
use aloft_workspace::error::StageFailure;
use aloft_workspace::json::write_json;
use serde::Serialize;
use serde_json::json;

/// The stage.
pub static STAGE: Stage = Stage {
    name: "scale",
    version: 3,
    scope: Scope::Session,
    seconds: 0.03,
    reads: "static trial (objects: calibration trial, too), anthropometry or object description; robots and OpenSim models: the model file",
    gives: "`Subject`: the model with this body's joint centres, marker places and prior inertias",
    needs: &[Need::EveryOrStaticFrames("import", &[Role::Static, Role::Calibration])],
    parameters: parameters_of::<Work>,
    run: run_of::<Work>,
};

/// Parameters of the stage.
#[derive(Debug, Serialize)]
pub struct Params {
    scale: ScaleConfig,
    model: ModelSpec,
    marker_set: MarkerSet,
    object: Option<ObjectSpec>,
    #[serde(skip_serializing_if = "Option::is_none")]
    robot: Option<RobotSetup>,
    #[serde(skip_serializing_if = "Option::is_none")]
    osim: Option<OsimSetup>,
    anthropometry: Anthropometry,
    facts: Facts,
    static_frames: Option<StaticFrames>,
}

/// Work of the stage.
#[derive(Debug)]
pub struct Work;

impl StageWork for Work {
    type Params = Params;
    fn params(session: &SubjectSession, _: Option<&TrialEntry>) -> Params {
        Params {
            scale: session.config.scale.clone(),
            model: session.model.clone(),
            marker_set: session.marker_set.clone(),
            object: session.object.clone(),
            robot: session.robot.clone(),
            osim: session.osim.clone(),
            anthropometry: session.anthropometry.clone(),
            facts: session.facts.clone(),
            static_frames: session.config.trials.static_frames.clone(),
        }
    }
    fn run(params: &Params, inputs: &StageInputs<'_>) -> Result<StageReport, StageFailure> {
        run(params, inputs)
    }
}

fn hip_method(hip: &str) -> Result<HipMethod, StageFailure> {
    serde_json::from_value(json!(hip)).map_err(|_| {
        StageFailure::with_hint(format!("scale.hip is `{hip}`"), "expected harrington, bell, hara or davis")
    })
}

/// Name of the static trial and, if frames of a dynamic trial are used instead, their range.
fn static_source(
    params: &Params,
    inputs: &StageInputs<'_>,
) -> Result<(String, Option<std::ops::Range<usize>>), StageFailure> {
    if let Some(named) = &params.static_frames {
        if !inputs.has("import", &named.trial) {
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
    let names = inputs.trials_with_role("import", |r| r == Role::Static);
    match names.first() {
        Some(name) => Ok((name.clone(), None)),
        None => {
            let expected = inputs.expected();
            let statics = expected.iter().filter(|(_, role)| *role == Role::Static);
            let tried: Vec<&str> = statics.map(|(name, _)| name.as_str()).collect();
            let problem = if tried.is_empty() {
                format!("no static trial in {}: no recording matches `trials: {{static: …}}`", inputs.data().display())
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

fn run(params: &Params, inputs: &StageInputs<'_>) -> Result<StageReport, StageFailure> {
    if let Some(object) = &params.object {
        return super::object::scale(object, &params.facts, inputs);
    }
    if let Some(robot) = &params.robot {
        return super::robot::scale(robot, &params.facts, inputs);
    }
    if let Some(osim) = &params.osim {
        return super::osim::scale(osim, &params.facts, inputs);
    }
    let (name, frames) = static_source(params, inputs)?;
    let trial = inputs.results.load_trial(&name)?;
    let options = ScaleOptions { hip: hip_method(&params.scale.hip)?, ..ScaleOptions::default() };
    let input = PersonInput {
        facts: &params.facts.person,
        model_spec: &params.model,
        marker_set: &params.marker_set,
        static_trial: &trial,
        frames,
    };
    let mut scaled =
        scale_person(&input, &params.anthropometry, &options).map_err(|e| StageFailure::new(e.to_string()))?;
    scaled.subject.model.gravity_mps2 = params.facts.gravity();
    save_subject(inputs, &scaled.subject)?;
    write_json(&inputs.out.join("locked.json"), &scaled.locked)?;
    write_json(&inputs.out.join("anatomy.json"), &scaled.anatomy)?;
    write_json(&inputs.out.join("report.json"), &scaled.report)?;
    Ok(describe(&scaled))
}

fn describe(scaled: &Scaled) -> StageReport {
    let mut done = StageReport::default();
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
