//! `calibrate`: joint centres, hinge axes and marker places refined over the dynamic trials, on
//! markers alone.
//!
//! Recordings held out for comparison take no part, unless `calibrate: {validation: true}` brings
//! them back: their markers would shape the geometry that they are meant to judge.

use crate::graph::{Need, Scope, Stage, StageInputs, StageReport, StageWork, parameters_of, run_of};
use crate::results::Results;
use crate::stages::object::may_teach;
use crate::stages::shared::save_subject;
use aloft_body::Subject;
use aloft_ik::{
    CalibrateOptions, Calibration, Clip, GeometryError, IkError, IkOptions, calibrate_clips, contradiction, shares,
};
use aloft_scale::{Anthropometry, JointUncertainty, ObjectSpec, StaticAnatomy, attach_prior};
use aloft_study::config::{CalibrateConfig, Switch};
use aloft_study::facts::Facts;
use aloft_study::osim::OsimSetup;
use aloft_study::subject_session::{Role, SubjectSession, TrialEntry};
use aloft_workspace::artifact::trial_length;
use aloft_workspace::error::StageFailure;
use aloft_workspace::json::{from_value, read_json, read_json_if_there, write_json};
use aloft_workspace::manifest::WHOLE_STUDY;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

/// The stage.
pub static STAGE: Stage = Stage {
    name: "calibrate",
    version: 9,
    scope: Scope::Session,
    seconds: 1.5,
    reads: "dynamic trials that are not held out, `Subject`",
    gives: "`Subject` with joint centres, hinge axes and marker places refined on markers alone",
    needs: &[
        Need::Once("scale"),
        Need::Every("import", &[Role::Static, Role::Calibration, Role::Identify, Role::Validate]),
    ],
    parameters: parameters_of::<Work>,
    run: run_of::<Work>,
};

/// Parameters of the stage. Objects are built again from their description, people are refined with
/// the priors of their tables; the role of a trial decides whether geometry may be fitted to it.
#[derive(Debug, Serialize)]
pub struct Params {
    calibrate: CalibrateConfig,
    anthropometry: Anthropometry,
    object: Option<ObjectSpec>,
    /// True for robots, whose geometry is that of the model file.
    #[serde(skip_serializing_if = "std::ops::Not::not")]
    is_robot: bool,
    /// An OpenSim model, whose geometry and markers are those of the file.
    #[serde(skip_serializing_if = "Option::is_none")]
    osim: Option<OsimSetup>,
    facts: Facts,
    roles: Vec<(String, Role)>,
}

/// Work of the stage.
#[derive(Debug)]
pub struct Work;

impl StageWork for Work {
    type Params = Params;
    fn params(session: &SubjectSession, _: Option<&TrialEntry>) -> Params {
        Params {
            calibrate: session.config.calibrate.clone(),
            anthropometry: session.anthropometry.clone(),
            object: session.object.clone(),
            is_robot: session.robot.is_some(),
            osim: session.osim.clone(),
            facts: session.facts.clone(),
            roles: session.included().map(|t| (t.name.clone(), t.role)).collect(),
        }
    }
    fn run(params: &Params, inputs: &StageInputs<'_>) -> Result<StageReport, StageFailure> {
        run(params, inputs)
    }
}

fn run(params: &Params, inputs: &StageInputs<'_>) -> Result<StageReport, StageFailure> {
    let config = &params.calibrate;
    if let Some(object) = &params.object {
        return super::object::refine(object, &params.facts, config, inputs);
    }
    if let Some(osim) = &params.osim {
        return super::osim::keep_seen(osim, &params.facts, inputs);
    }
    let subject = inputs.results.load_subject("scale")?;
    let mut done = StageReport::default();
    // every trial except the static one, whose posture the subject already contains, and those held
    // out
    let names = inputs.trials_with_role("import", |role| may_teach(config, role));
    let dynamic = names.iter().filter(|t| inputs.role(t).is_some_and(Role::is_dynamic)).count();
    if params.is_robot {
        done.note("used", false);
        save_subject(inputs, &subject)?;
        return Ok(done);
    }
    let folder = inputs.results.place("scale", WHOLE_STUDY)?;
    let scaled: serde_json::Value = read_json(&folder.join("report.json"))?;
    let joints: Vec<JointUncertainty> =
        from_value(scaled["joints"].clone()).map_err(|e| StageFailure::new(format!("scale/report.json: {e}")))?;
    let options = CalibrateOptions {
        frames: config.frames,
        joint_sd_m: joints.iter().map(|j| (j.link.clone(), j.centre_sd_m)).collect(),
        axis_sd_rad: joints.iter().filter_map(|j| j.axis_sd_rad.map(|sd| (j.link.clone(), sd))).collect(),
        ik: IkOptions { locked: inputs.results.load_locked()?, ..IkOptions::default() },
        ..CalibrateOptions::default()
    };
    if config.enabled == Switch::Off || dynamic == 0 {
        done.note("used", false);
        save_geometry(inputs, &subject, &from_landmarks(&subject, &options)?)?;
        return Ok(done);
    }
    let result = match calibrate_over(inputs, &names, &subject, &options)? {
        Ok(result) => result,
        Err(e) if config.enabled == Switch::Auto => {
            done.warnings.push(format!("the landmarks' geometry is kept: {e}"));
            done.note("used", false);
            save_geometry(inputs, &subject, &from_landmarks(&subject, &options)?)?;
            return Ok(done);
        }
        Err(e) => return Err(StageFailure::new(e.to_string())),
    };
    let mut report = result.report;
    done.note("rms_before_mm", report.held_out_rms_before_m * 1e3);
    done.note("rms_after_mm", report.held_out_rms_after_m * 1e3);
    let keep = config.enabled == Switch::On || report.held_out_rms_after_m < report.held_out_rms_before_m;
    done.note("used", keep);
    if keep {
        report.contradiction = contradiction(&report.joints);
        done.warnings.extend(report.contradiction.clone());
    }
    write_json(&inputs.out.join("report.json"), &report)?;
    let (chosen, errors) = if keep {
        let mut calibrated = result.subject;
        let anatomy: StaticAnatomy = read_json(&folder.join("anatomy.json"))?;
        let warnings = attach_prior(&mut calibrated, &params.anthropometry, &anatomy)
            .map_err(|e| StageFailure::new(e.to_string()))?;
        done.warnings.extend(warnings.iter().map(ToString::to_string));
        calibrated.provenance.push(format!("geometry: calibrated over {} trials", dynamic));
        (calibrated, result.errors)
    } else {
        done.warnings.push("held-out marker error did not fall: the landmarks' geometry is kept".to_owned());
        let errors = from_landmarks(&subject, &options)?;
        (subject, errors)
    };
    save_geometry(inputs, &chosen, &errors)?;
    Ok(done)
}

/// File of the draws of what may be wrong with the geometry ([`GeometryError`]).
const GEOMETRY_ERRORS_FILE: &str = "geometry_errors.json";

/// Draws of what may be wrong with the geometry; none for objects, robots and models of files,
/// whose geometry is given.
///
/// # Errors
/// A file that cannot be read.
pub fn geometry_errors(results: Results<'_>) -> Result<Vec<GeometryError>, StageFailure> {
    let file = results.place("calibrate", WHOLE_STUDY)?.join(GEOMETRY_ERRORS_FILE);
    Ok(read_json_if_there(&file)?.unwrap_or_default())
}

fn save_geometry(inputs: &StageInputs<'_>, subject: &Subject, errors: &[GeometryError]) -> Result<(), StageFailure> {
    write_json(&inputs.out.join(GEOMETRY_ERRORS_FILE), &errors)?;
    save_subject(inputs, subject)
}

fn from_landmarks(subject: &Subject, options: &CalibrateOptions) -> Result<Vec<GeometryError>, StageFailure> {
    GeometryError::of_landmarks(subject, options).map_err(|e| StageFailure::new(e.to_string()))
}

/// Joint centres of the geometry in use that motion and landmarks put at different places, in
/// words; none for objects, robots and models of files.
///
/// # Errors
/// A report that cannot be read.
pub fn contradicted(results: Results<'_>) -> Result<Option<String>, StageFailure> {
    #[derive(Default, Deserialize)]
    struct Of {
        contradiction: Option<String>,
    }
    let file = results.place("calibrate", WHOLE_STUDY)?.join("report.json");
    Ok(read_json_if_there::<Of>(&file)?.unwrap_or_default().contradiction)
}

/// Each thread reads one trial after the other and keeps only the frames that take part.
fn calibrate_over(
    inputs: &StageInputs<'_>,
    names: &[String],
    subject: &Subject,
    options: &CalibrateOptions,
) -> Result<Result<Calibration, IkError>, StageFailure> {
    let length = |name: &String| Ok(trial_length(&inputs.results.place("import", name)?)?);
    let lengths: Vec<usize> = names.iter().map(length).collect::<Result<_, StageFailure>>()?;
    let clips: Vec<Result<Clip, IkError>> = names
        .par_iter()
        .zip(shares(&lengths, options))
        .filter(|(_, share)| *share > 0)
        .map(|(name, share)| Ok(Clip::of(subject, &inputs.results.load_labelled_markers(name)?.0, share, options)))
        .collect::<Result<_, StageFailure>>()?;
    Ok(clips.into_iter().collect::<Result<Vec<Clip>, IkError>>().and_then(|c| calibrate_clips(subject, &c, options)))
}
