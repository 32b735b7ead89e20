//! `calibrate`: joint centres, hinge axes and marker places refined over the dynamic trials, on markers alone.
//!
//! Recordings held out for comparison take no part, unless `calibrate: {validation: true}` brings them back: their markers would shape the
//! geometry that they are meant to judge.

use crate::artifact::{load_markers, trial_length};
use crate::config::Switch;
use crate::error::StageFailure;
use crate::graph::{Done, Job, Need, Scope, Stage, key};
use crate::stages::scale::{load_locked, save_subject};
use crate::study::Role;
use crate::workspace::{WHOLE_STUDY, read_json, write_json};
use aloft_body::Subject;
use aloft_ik::{CalibrateOptions, Calibration, Clip, IkError, IkOptions, calibrate_clips, shares};
use aloft_scale::{JointUncertainty, StaticAnatomy, attach_prior};
use rayon::prelude::*;
use serde_json::json;

/// The stage.
pub static STAGE: Stage = Stage {
    name: "calibrate",
    version: 3,
    scope: Scope::Study,
    reads: "dynamic trials that are not held out, `Subject`",
    gives: "`Subject` with joint centres, hinge axes and marker places refined on markers alone",
    needs: &[
        Need::Once("scale"),
        Need::Every("import", &[Role::Static, Role::Calibration, Role::Identify, Role::Validate]),
    ],
    parameters: |study, _| {
        // things are built again from their description, people refined with the priors of their tables; the role of a trial decides
        // whether geometry may learn from it
        let roles: Vec<[&str; 2]> = study.included().map(|t| [t.name.as_str(), t.role.word()]).collect();
        json!({"calibrate": key(&study.config.calibrate), "anthropometry": key(&study.anthropometry),
            "object": key(&study.object), "facts": key(&study.facts), "roles": roles})
    },
    run,
};

fn run(job: &Job<'_>) -> Result<Done, StageFailure> {
    if job.study.object.is_some() {
        return super::object::refine(job);
    }
    let subject = job.load_subject("scale")?;
    let config = &job.study.config.calibrate;
    let mut done = Done::default();
    let names = moving(job);
    let dynamic = names.iter().filter(|t| job.study.trial(t).is_some_and(|e| e.role.is_dynamic())).count();
    if config.enabled == Switch::Off || dynamic == 0 {
        done.note("used", false);
        save_subject(job, &subject)?;
        return Ok(done);
    }
    let folder = job.workspace.place("scale", WHOLE_STUDY);
    let report: serde_json::Value = read_json(&folder.join("report.json"))?;
    let joints: Vec<JointUncertainty> = serde_json::from_value(report["joints"].clone())
        .map_err(|e| StageFailure::new(format!("scale/report.json: {e}")))?;
    let options = CalibrateOptions {
        frames: config.frames,
        joint_sd_m: joints.iter().map(|j| (j.link.clone(), j.center_sd_m)).collect(),
        axis_sd_rad: joints.iter().filter_map(|j| j.axis_sd_rad.map(|sd| (j.link.clone(), sd))).collect(),
        ik: IkOptions { locked: load_locked(job)?, ..IkOptions::default() },
        ..CalibrateOptions::default()
    };
    let result = match calibrate_over(job, &names, &subject, &options)? {
        Ok(result) => result,
        Err(e) if config.enabled == Switch::Auto => {
            done.warnings.push(format!("the landmarks' geometry is kept: {e}"));
            done.note("used", false);
            save_subject(job, &subject)?;
            return Ok(done);
        }
        Err(e) => return Err(StageFailure::new(e.to_string())),
    };
    let r = &result.report;
    done.note("rms_before_mm", r.held_out_rms_before_m * 1e3);
    done.note("rms_after_mm", r.held_out_rms_after_m * 1e3);
    let keep = config.enabled == Switch::On || r.held_out_rms_after_m < r.held_out_rms_before_m;
    done.note("used", keep);
    write_json(&job.out.join("report.json"), r)?;
    let chosen: Subject = if keep {
        let mut calibrated = result.subject;
        let anatomy: StaticAnatomy = read_json(&folder.join("anatomy.json"))?;
        let warnings = attach_prior(&mut calibrated, &job.study.anthropometry, &anatomy)
            .map_err(|e| StageFailure::new(e.to_string()))?;
        done.warnings.extend(warnings.iter().map(ToString::to_string));
        calibrated.provenance.push(format!("geometry: calibrated over {} trials", dynamic));
        calibrated
    } else {
        done.warnings.push("held-out marker error did not fall: the landmarks' geometry is kept".to_owned());
        subject
    };
    save_subject(job, &chosen)?;
    Ok(done)
}

/// Trials that geometry may learn from: every one but the static one, whose posture the subject carries already, and those held out.
fn moving(job: &Job<'_>) -> Vec<String> {
    let takes_part = |name: &String| job.study.trial(name).is_some_and(|t| may_teach(job, t.role));
    job.trials_of("import").into_iter().filter(takes_part).collect()
}

/// True for trials of a role that geometry may learn from.
pub fn may_teach(job: &Job<'_>, role: Role) -> bool {
    match role {
        Role::Static => false,
        Role::Validate => job.study.config.calibrate.validation,
        Role::Calibration | Role::Identify => true,
    }
}

/// Reads one trial after the other on each thread and keeps no more of it than the frames that take part.
fn calibrate_over(
    job: &Job<'_>,
    names: &[String],
    subject: &Subject,
    options: &CalibrateOptions,
) -> Result<Result<Calibration, IkError>, StageFailure> {
    let place = |name: &String| job.workspace.place("import", name);
    let lengths: Vec<usize> = names.iter().map(|name| trial_length(&place(name))).collect::<Result<_, _>>()?;
    let clips: Vec<Result<Clip, IkError>> = names
        .par_iter()
        .zip(shares(&lengths, options))
        .filter(|(_, share)| *share > 0)
        .map(|(name, share)| Ok(Clip::of(subject, &load_markers(&place(name))?, share, options)))
        .collect::<Result<_, StageFailure>>()?;
    Ok(clips.into_iter().collect::<Result<Vec<Clip>, IkError>>().and_then(|c| calibrate_clips(subject, &c, options)))
}
