//! `filter`: joint coordinates through the zero-phase low-pass, with velocities and accelerations on the manifold.

use crate::graph::{Done, Job, Need, Scope, Stage};
use aloft_ik::smooth;
use aloft_signal::residual_analysis::{default_cutoffs, residual_analysis};
use aloft_signal::{CutoffCorrection, LowPass};
use aloft_study::config::Correction;
use aloft_study::study::{Role, Study};
use aloft_workspace::artifact::save_motion;
use aloft_workspace::error::StageFailure;
use aloft_workspace::key::key;
use aloft_workspace::workspace::write_json;
use serde_json::json;

/// The stage.
pub static STAGE: Stage = Stage {
    name: "filter",
    version: 2,
    scope: Scope::Trial(&[Role::Identify, Role::Validate]),
    reads: "`Motion`",
    gives: "`Motion` with velocities and accelerations (zero-phase Butterworth)",
    needs: &[Need::Same("ik"), Need::Once("calibrate")],
    parameters: |study, _| json!({"filter": key(&study.config.filter)}),
    run,
};

/// The low-pass that the pipeline asks for.
pub fn low_pass(study: &Study) -> LowPass {
    let f = &study.config.filter;
    LowPass {
        order: f.order,
        cutoff_hz: f.cutoff_hz,
        correction: match f.cutoff_correction {
            Correction::None => CutoffCorrection::None,
            Correction::Winter => CutoffCorrection::Winter,
        },
    }
}

fn run(job: &Job<'_>) -> Result<Done, StageFailure> {
    let entry = job.trial()?;
    let subject = job.load_subject("calibrate")?;
    let motion = job.load_motion("ik", &entry.name)?;
    let spec = low_pass(job.study);
    let smoothed = smooth(&subject.model, &motion, Some(spec))
        .map_err(|e| StageFailure::with_hint(e.to_string(), "see `filter` in the pipeline"))?;
    save_motion(job.out, &smoothed, &subject.model)?;
    let mut done = Done::default();
    // how much of the root's path each cut-off would take away: a help for choosing one
    let root: Vec<Vec<f64>> = (0..3).map(|i| motion.q.iter().skip(i).step_by(motion.nq).copied().collect()).collect();
    let channels: Vec<&[f64]> = root.iter().map(Vec::as_slice).collect();
    if let Ok(analysis) = residual_analysis(&channels, motion.rate_hz, spec, &default_cutoffs(motion.rate_hz)) {
        if let Some(hz) = analysis.suggested_cutoff_hz {
            done.note("suggested_cutoff_hz", hz);
        }
        write_json(&job.out.join("residual_analysis.json"), &analysis)?;
    }
    if let Ok(facts) = spec.describe(motion.rate_hz) {
        done.note("effective_order", facts.effective_order);
        done.note("design_cutoff_hz", facts.design_cutoff_hz);
        done.note("true_minus3db_hz", facts.true_minus3db_hz);
    }
    let lost = (0..motion.n_frames()).filter(|f| motion.is_valid(*f) && !smoothed.is_valid(*f)).count();
    if lost > 0 {
        done.warnings.push(format!("{lost} frames stand in runs too short for the filter"));
    }
    Ok(done)
}
