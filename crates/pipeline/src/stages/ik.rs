//! `ik`: markers to joint motion, frame by frame; a bad frame is marked, never fatal.

use crate::graph::{Need, Scope, Stage, StageInputs, StageReport, StageWork, parameters_of, run_of};
use crate::results::Results;
use aloft_body::{Motion, Subject};
use aloft_filter::continuous;
use aloft_ik::{IkOptions, IkReport, solve};
use aloft_study::config::IkConfig;
use aloft_study::subject_session::{Role, SubjectSession, TrialEntry};
use aloft_workspace::artifact::save_motion;
use aloft_workspace::error::StageFailure;
use aloft_workspace::json::write_json;
use aloft_workspace::qc::QcReason;
use serde::Serialize;

/// The stage.
pub static STAGE: Stage = Stage {
    name: "ik",
    version: 3,
    scope: Scope::Trial(&[Role::Calibration, Role::Identify, Role::Validate]),
    seconds: 0.15,
    reads: "trial, `Subject`",
    gives: "`Motion`: joint coordinates, marker residuals, standard deviations",
    needs: &[Need::Same("import"), Need::Once("scale"), Need::Once("calibrate")],
    parameters: parameters_of::<Work>,
    run: run_of::<Work>,
};

/// Parameters of the stage.
#[derive(Debug, Serialize)]
pub struct Params {
    ik: IkConfig,
}

/// Work of the stage.
#[derive(Debug)]
pub struct Work;

impl StageWork for Work {
    type Params = Params;
    fn params(session: &SubjectSession, trial: Option<&TrialEntry>) -> Params {
        Params { ik: session.ik_of(trial).clone() }
    }
    fn run(params: &Params, inputs: &StageInputs<'_>) -> Result<StageReport, StageFailure> {
        run(params, inputs)
    }
}

/// Settings for fitting the markers of a trial; marker weights stated in the pipeline are written
/// into the subject.
pub fn fit_options(config: &IkConfig, results: Results<'_>, subject: &mut Subject) -> Result<IkOptions, StageFailure> {
    for (label, weight) in &config.weights {
        match subject.markers.iter_mut().find(|m| &m.label == label) {
            Some(marker) => marker.weight = *weight,
            None => {
                return Err(StageFailure::with_hint(
                    format!("ik.weights names the marker `{label}`, which the subject does not have"),
                    "use the canonical labels of the marker set",
                ));
            }
        }
    }
    Ok(IkOptions { marker_sd_m: config.marker_sd_m, locked: results.load_locked()?, ..IkOptions::default() })
}

/// Tracks a trial with a subject's geometry: motion with continuous angles and quaternion signs,
/// and the report.
pub fn track(
    config: &IkConfig,
    results: Results<'_>,
    mut subject: Subject,
    name: &str,
) -> Result<(Subject, Motion, IkReport), StageFailure> {
    let trial = results.load_trial(name)?;
    let options = fit_options(config, results, &mut subject)?;
    let result = solve(&subject, &trial, &options).map_err(|e| StageFailure::new(e.to_string()))?;
    let motion = continuous(&subject.model, &result.motion).map_err(|e| StageFailure::new(e.to_string()))?;
    Ok((subject, motion, result.report))
}

fn run(params: &Params, inputs: &StageInputs<'_>) -> Result<StageReport, StageFailure> {
    let name = inputs.trial()?;
    let subject = inputs.results.load_subject("calibrate")?;
    let (subject, motion, report) = track(&params.ik, inputs.results, subject, name)?;
    save_motion(inputs.out, &motion, &subject.model)?;
    write_json(&inputs.out.join("report.json"), &report)?;
    let mut done = StageReport::default();
    done.note("marker_rms_mm", report.rms_m * 1e3);
    done.note("marker_max_mm", report.max_m * 1e3);
    done.note("unsolved_frames", report.n_unsolved);
    if report.n_unsolved == report.n_frames {
        return Err(StageFailure::with_hint(
            format!("{name}: no frame could be solved: too few markers on the root link"),
            "look at the recording with `aloft inspect`",
        )
        .because(QcReason::IkFailed));
    }
    if report.n_unsolved > 0 {
        done.warnings.push(format!("{} of {} frames could not be solved", report.n_unsolved, report.n_frames));
    }
    if report.rms_m > 0.02 {
        done.warnings.push(format!("marker RMS {:.1} mm (usual limit 20 mm)", report.rms_m * 1e3));
    }
    Ok(done)
}
