//! What `scale` and `calibrate` do for objects: link frames as markers define them, joints found
//! from motion.

use crate::graph::{StageInputs, StageReport};
use crate::stages::shared::save_subject;
use aloft_scale::{ObjectInput, ObjectOptions, ObjectSpec, ScaledObject, scale_object};
use aloft_study::config::{CalibrateConfig, Switch};
use aloft_study::facts::Facts;
use aloft_study::subject_session::Role;
use aloft_trial::Trial;
use aloft_workspace::error::StageFailure;
use aloft_workspace::json::write_json;

fn specification(object: &ObjectSpec, facts: &Facts) -> ObjectSpec {
    ObjectSpec { total_mass_kg: facts.person.mass_kg, gravity_mps2: Some(facts.gravity_mps2), ..object.clone() }
}

fn load(inputs: &StageInputs<'_>, wanted: impl Fn(Role) -> bool) -> Result<Vec<Trial>, StageFailure> {
    inputs.trials_with_role("import", wanted).iter().map(|name| inputs.results.load_trial(name)).collect()
}

fn build(
    object: &ObjectSpec,
    facts: &Facts,
    inputs: &StageInputs<'_>,
    motion: &[Trial],
) -> Result<ScaledObject, StageFailure> {
    let spec = specification(object, facts);
    let statics = load(inputs, |r| r == Role::Static)?;
    let Some(static_trial) = statics.first() else {
        return Err(StageFailure::with_hint(
            "no static trial of the object: no recording matches `trials: {static: …}`",
            "record the object lying still with all joint angles zero",
        ));
    };
    if motion.is_empty() {
        return Err(StageFailure::with_hint(
            "no calibration trial: no recording matches `trials: {calibration: …}`",
            "record the object while its joints are moved through their range",
        ));
    }
    let all: Vec<&Trial> = motion.iter().collect();
    let input = ObjectInput { spec: &spec, static_trial, motion_trials: &all };
    let mut scaled = scale_object(&input, &ObjectOptions::default()).map_err(|e| StageFailure::new(e.to_string()))?;
    scaled.subject.model.gravity_mps2 = facts.gravity();
    scaled.subject.facts.name.clone_from(&facts.person.name);
    Ok(scaled)
}

fn save(inputs: &StageInputs<'_>, scaled: &ScaledObject) -> Result<StageReport, StageFailure> {
    save_subject(inputs, &scaled.subject)?;
    write_json(&inputs.out.join("report.json"), &scaled.report)?;
    write_json(&inputs.out.join("locked.json"), &Vec::<usize>::new())?;
    let mut done = StageReport::default();
    done.note("frames", scaled.report.frames);
    done.note("marker_noise_mm", scaled.report.noise_m * 1e3);
    done.warnings.extend(scaled.report.warnings.iter().cloned());
    Ok(done)
}

/// Builds the object from its static and calibration trials.
pub fn scale(object: &ObjectSpec, facts: &Facts, inputs: &StageInputs<'_>) -> Result<StageReport, StageFailure> {
    let motion = load(inputs, |r| r == Role::Calibration)?;
    save(inputs, &build(object, facts, inputs, &motion)?)
}

/// The same, using every recording in which it moves and that is not held out.
pub fn refine(
    object: &ObjectSpec,
    facts: &Facts,
    config: &CalibrateConfig,
    inputs: &StageInputs<'_>,
) -> Result<StageReport, StageFailure> {
    if config.enabled == Switch::Off {
        let subject = inputs.results.load_subject("scale")?;
        save_subject(inputs, &subject)?;
        return Ok(StageReport::default());
    }
    let motion = load(inputs, |role| may_teach(config, role))?;
    save(inputs, &build(object, facts, inputs, &motion)?)
}

/// True if geometry may be fitted to trials of this role.
pub fn may_teach(config: &CalibrateConfig, role: Role) -> bool {
    match role {
        Role::Static => false,
        Role::Validate => config.validation,
        Role::Calibration | Role::Identify => true,
    }
}
