//! `filter`: joint coordinates through the zero-phase low-pass, with velocities and accelerations
//! on the manifold.

use crate::graph::{Need, Scope, Stage, StageInputs, StageReport, StageWork, parameters_of, run_of};
use aloft_filter::smooth;
use aloft_signal::residual_analysis::{default_cutoffs, residual_analysis};
use aloft_signal::{CutoffCorrection, LowPass};
use aloft_study::config::{Correction, FilterConfig};
use aloft_study::subject_session::{Role, SubjectSession, TrialEntry};
use aloft_workspace::artifact::save_motion;
use aloft_workspace::error::StageFailure;
use aloft_workspace::json::write_json;
use serde::Serialize;

/// The stage.
pub static STAGE: Stage = Stage {
    name: "filter",
    version: 3,
    scope: Scope::Trial(&[Role::Identify, Role::Validate]),
    seconds: 0.03,
    reads: "`Motion`",
    gives: "`Motion` with velocities and accelerations (zero-phase Butterworth)",
    needs: &[Need::Same("ik"), Need::Once("calibrate")],
    parameters: parameters_of::<Work>,
    run: run_of::<Work>,
};

/// Parameters of the stage.
#[derive(Debug, Serialize)]
pub struct Params {
    filter: FilterConfig,
}

/// Work of the stage.
#[derive(Debug)]
pub struct Work;

impl StageWork for Work {
    type Params = Params;
    fn params(session: &SubjectSession, _: Option<&TrialEntry>) -> Params {
        Params { filter: session.config.filter.clone() }
    }
    fn run(params: &Params, inputs: &StageInputs<'_>) -> Result<StageReport, StageFailure> {
        run(params, inputs)
    }
}

/// The low-pass that the pipeline asks for.
pub fn low_pass(f: &FilterConfig) -> LowPass {
    LowPass {
        order: f.order,
        cutoff_hz: f.cutoff_hz,
        correction: match f.cutoff_correction {
            Correction::None => CutoffCorrection::None,
            Correction::Winter => CutoffCorrection::Winter,
        },
    }
}

fn run(params: &Params, inputs: &StageInputs<'_>) -> Result<StageReport, StageFailure> {
    let subject = inputs.results.load_subject("calibrate")?;
    let motion = inputs.results.load_motion("ik", inputs.trial()?)?;
    let spec = low_pass(&params.filter);
    let smoothed = smooth(&subject.model, &motion, Some(spec))
        .map_err(|e| StageFailure::with_hint(e.to_string(), "see `filter` in the pipeline"))?;
    save_motion(inputs.out, &smoothed, &subject.model)?;
    let mut done = StageReport::default();
    // how much of the root's path each cut-off would remove; helps to choose one
    let root: Vec<Vec<f64>> = (0..3).map(|i| motion.q.iter().skip(i).step_by(motion.nq).copied().collect()).collect();
    let channels: Vec<&[f64]> = root.iter().map(Vec::as_slice).collect();
    match residual_analysis(&channels, motion.rate_hz, spec, &default_cutoffs(motion.rate_hz)) {
        Ok(analysis) => {
            if let Some(hz) = analysis.suggested_cutoff_hz {
                done.note("suggested_cutoff_hz", hz);
            }
            write_json(&inputs.out.join("residual_analysis.json"), &analysis)?;
        }
        // it only helps to choose a cut-off: the motion is filtered with the one that was chosen
        Err(e) => done.warnings.push(format!("no residual analysis: {e}")),
    }
    let facts = spec.describe(motion.rate_hz).map_err(|e| StageFailure::new(e.to_string()))?;
    done.note("effective_order", facts.effective_order);
    done.note("design_cutoff_hz", facts.design_cutoff_hz);
    done.note("true_minus3db_hz", facts.true_minus3db_hz);
    let lost = (0..motion.n_frames()).filter(|f| motion.is_valid(*f) && !smoothed.is_valid(*f)).count();
    if lost > 0 {
        done.warnings.push(format!("{lost} frames are in runs too short for the filter"));
    }
    Ok(done)
}
