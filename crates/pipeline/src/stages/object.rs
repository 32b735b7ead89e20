//! What `scale` and `calibrate` do for objects: link frames as markers define them, joints found from motion.

use crate::graph::{Done, Job};
use crate::stages::calibrate::may_teach;
use crate::stages::scale::save_subject;
use aloft_scale::{ObjectInput, ObjectOptions, ObjectSpec, ScaledObject, scale_object};
use aloft_study::config::Switch;
use aloft_study::study::Role;
use aloft_trial::Trial;
use aloft_workspace::error::StageFailure;
use aloft_workspace::workspace::write_json;

fn specification(job: &Job<'_>) -> Result<ObjectSpec, StageFailure> {
    let mut spec = job.study.object.clone().ok_or_else(|| StageFailure::new("the pipeline names no object"))?;
    spec.total_mass_kg = job.study.facts.person.mass_kg;
    spec.gravity_mps2 = Some(job.study.facts.gravity_mps2);
    Ok(spec)
}

fn load(job: &Job<'_>, stage_inputs: &str, wanted: impl Fn(Role) -> bool) -> Result<Vec<Trial>, StageFailure> {
    job.trials_of(stage_inputs)
        .iter()
        .filter(|name| job.study.trial(name).is_some_and(|t| wanted(t.role)))
        .map(|name| job.load_trial(name))
        .collect()
}

fn build(job: &Job<'_>, motion: &[Trial]) -> Result<ScaledObject, StageFailure> {
    let spec = specification(job)?;
    let statics = load(job, "import", |r| r == Role::Static)?;
    let Some(static_trial) = statics.first() else {
        return Err(StageFailure::with_hint(
            format!("no static trial of the object (patterns: {})", job.study.config.trials.r#static.join(", ")),
            "record the object lying still with all joint angles zero",
        ));
    };
    if motion.is_empty() {
        return Err(StageFailure::with_hint(
            format!("no calibration trial (patterns: {})", job.study.config.trials.calibration.join(", ")),
            "record the object while its joints are moved through their range",
        ));
    }
    let all: Vec<&Trial> = motion.iter().collect();
    let input = ObjectInput { spec: &spec, static_trial, motion_trials: &all };
    let mut scaled = scale_object(&input, &ObjectOptions::default()).map_err(|e| StageFailure::new(e.to_string()))?;
    scaled.subject.model.gravity_mps2 = job.study.gravity();
    scaled.subject.facts.name.clone_from(&job.study.facts.person.name);
    Ok(scaled)
}

fn save(job: &Job<'_>, scaled: &ScaledObject) -> Result<Done, StageFailure> {
    save_subject(job, &scaled.subject)?;
    write_json(&job.out.join("report.json"), &scaled.report)?;
    write_json(&job.out.join("locked.json"), &Vec::<usize>::new())?;
    let mut done = Done::default();
    done.note("frames", scaled.report.frames);
    done.note("marker_noise_mm", scaled.report.noise_m * 1e3);
    done.warnings.extend(scaled.report.warnings.iter().cloned());
    Ok(done)
}

/// The object from its static and calibration trials.
pub fn scale(job: &Job<'_>) -> Result<Done, StageFailure> {
    let motion = load(job, "import", |r| r == Role::Calibration)?;
    save(job, &build(job, &motion)?)
}

/// The same, with every recording in which it moves and that is not held out.
pub fn refine(job: &Job<'_>) -> Result<Done, StageFailure> {
    if job.study.config.calibrate.enabled == Switch::Off {
        let subject = job.load_subject("scale")?;
        save_subject(job, &subject)?;
        return Ok(Done::default());
    }
    let motion = load(job, "import", |r| may_teach(job, r))?;
    save(job, &build(job, &motion)?)
}
