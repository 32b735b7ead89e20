//! `ik`: markers to joint motion, frame by frame; a bad frame is marked, never fatal.

use crate::graph::{Need, Scope, Stage, StageInputs, StageReport, StageWork, parameters_of, run_of};
use crate::results::Results;
use crate::stages::shared::fit_options;
use aloft_body::{Motion, Subject};
use aloft_filter::continuous;
use aloft_ik::{IkReport, LabelExchange, Segments, solve};
use aloft_study::config::IkConfig;
use aloft_study::osim::OsimSetup;
use aloft_study::robot::RobotSetup;
use aloft_study::subject_session::{Role, SubjectSession, TrialEntry};
use aloft_workspace::artifact::save_motion;
use aloft_workspace::error::StageFailure;
use aloft_workspace::json::write_json;
use aloft_workspace::limits::MARKER_RMS_MM;
use aloft_workspace::qc::QcReason;
use aloft_workspace::warning::StageWarning;
use serde::Serialize;
use serde_json::json;

/// The stage.
pub static STAGE: Stage = Stage {
    name: "ik",
    version: 9,
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
    #[serde(skip_serializing_if = "Option::is_none")]
    robot: Option<RobotSetup>,
    #[serde(skip_serializing_if = "Option::is_none")]
    osim: Option<OsimSetup>,
    /// True for an object, which has no skin: its segments' own fits tell the noise of the markers.
    #[serde(skip_serializing_if = "std::ops::Not::not")]
    is_object: bool,
}

/// File with the links' own rigid fits, for objects.
pub const SEGMENTS_FILE: &str = "segments.json";

/// From how many standard deviations of one sample on an error of the model counts: one that a
/// single frame shows (three, 99.7 % of its noise). The mean over a recording would show a
/// hundredth of that, which no laboratory's calibration reaches.
const SHOWS: f64 = 3.0;

/// What the model adds to the noise of the markers, in words: a joint that is not where the model
/// has it or not what it is, and a marker that sits elsewhere.
pub fn misfits(segments: &Segments) -> Vec<String> {
    let mut out = Vec::new();
    let noise_mm = 1e3 * segments.sd_m;
    if let Some((link, label, distance_m, deviations)) = segments.most_displaced()
        && deviations > SHOWS
    {
        out.push(format!(
            "marker {label} of {link} sits {:.1} mm from where the model has it (noise of the markers {noise_mm:.2} mm): it was \
             put back elsewhere or has slid; leave it out (`ik: {{weights: {{{label}: 0}}}}`) or give this recording's day a \
             static trial of its own",
            1e3 * distance_m
        ));
    }
    // a marker elsewhere turns its link, so that the joints seem to miss, too
    if !out.is_empty() {
        return out;
    }
    let Some(joints_m) = segments.joints_m.filter(|joints_m| *joints_m > SHOWS * segments.sd_m) else { return out };
    let gap = segments.gaps.first().map_or_else(String::new, |g| {
        format!(
            ", most at the joint of {}: its centre by {:.1} mm, its axis by {:.1}°",
            g.link,
            1e3 * g.centre_m,
            g.axis_rad.to_degrees()
        )
    });
    out.push(format!(
        "the joints do not move as the model's: they add {:.1} mm to the markers, whose links are rigid to {noise_mm:.2} mm{gap}",
        1e3 * joints_m
    ));
    out
}

/// Work of the stage.
#[derive(Debug)]
pub struct Work;

impl StageWork for Work {
    type Params = Params;
    fn params(session: &SubjectSession, trial: Option<&TrialEntry>) -> Params {
        Params {
            ik: session.ik_of(trial).clone(),
            robot: session.robot.clone(),
            osim: session.osim.clone(),
            is_object: session.object.is_some(),
        }
    }
    fn run(params: &Params, inputs: &StageInputs<'_>) -> Result<StageReport, StageFailure> {
        run(params, inputs)
    }
}

/// Tracks a trial with a subject's geometry: motion with continuous angles and quaternion signs,
/// the report, and labels that were exchanged against the static trial.
pub fn track(
    config: &IkConfig,
    results: Results<'_>,
    mut subject: Subject,
    name: &str,
) -> Result<(Subject, Motion, IkReport, Vec<LabelExchange>), StageFailure> {
    let (trial, exchanges) = results.load_labelled_markers(name)?;
    let options = fit_options(config, results, &mut subject)?;
    let result = solve(&subject, &trial, &options).map_err(|e| StageFailure::new(e.to_string()))?;
    let motion = continuous(&subject.model, &result.motion).map_err(|e| StageFailure::new(e.to_string()))?;
    Ok((subject, motion, result.report, exchanges))
}

fn run(params: &Params, inputs: &StageInputs<'_>) -> Result<StageReport, StageFailure> {
    if let Some(robot) = &params.robot {
        return super::robot::motion(robot, inputs);
    }
    if let Some(osim) = &params.osim {
        return super::osim::motion(osim, &params.ik, inputs);
    }
    let name = inputs.trial()?;
    let subject = inputs.results.load_subject("calibrate")?;
    let (subject, motion, report, exchanges) = track(&params.ik, inputs.results, subject, name)?;
    let segments = match params.is_object {
        true => Segments::of(&subject, &inputs.results.load_labelled_markers(name)?.0, &motion),
        false => None,
    };
    save_motion(inputs.out, &motion, &subject.model)?;
    write_json(&inputs.out.join("report.json"), &report)?;
    let mut done = StageReport::default();
    if !exchanges.is_empty() {
        write_json(&inputs.out.join("labels.json"), &exchanges)?;
        done.warnings.extend(exchanges.iter().map(|e| StageWarning::new(QcReason::LabelsExchanged, e.to_string())));
        done.note("qc", json!([QcReason::LabelsExchanged]));
    }
    if let Some(segments) = &segments {
        write_json(&inputs.out.join(SEGMENTS_FILE), segments)?;
        done.note("marker_noise_mm", segments.sd_m * 1e3);
        done.warnings.extend(misfits(segments));
    }
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
    let worst = || {
        let of = |m: &&aloft_ik::MarkerFit| format!("{} {:.0} mm", m.label, m.rms_m * 1e3);
        report.worst(4).iter().map(of).collect::<Vec<_>>().join(", ")
    };
    if 1e3 * report.rms_m > MARKER_RMS_MM[1] {
        done.warnings.push(StageWarning::new(
            QcReason::IkErrorLarge,
            format!(
                "marker RMS {:.1} mm (usual limit {} mm); worst: {}",
                report.rms_m * 1e3,
                MARKER_RMS_MM[1],
                worst()
            ),
        ));
    }
    if report.n_turned > 0 {
        done.note("turned_frames", report.n_turned);
    }
    let shortest = (0.02 * report.n_frames as f64).max(3.0) as usize;
    for b in report.beyond_range.iter().filter(|b| b.n_frames > shortest && b.worst_deg > 5.0) {
        done.warnings.push(format!(
            "joint of {}: beyond its range in {} of {} frames, by up to {:.0}° in frame {}: a label on a wrong marker, a \
             wrong branch, or a joint centre in the wrong place; worst markers: {}",
            b.link,
            b.n_frames,
            report.n_frames,
            b.worst_deg,
            b.worst_frame + 1,
            worst()
        ));
    }
    Ok(done)
}
