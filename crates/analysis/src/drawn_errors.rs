//! What the comparison drew, and the rows in contact that go with it: how large an error may be
//! that noise, an uncertain geometry and few flights cause.

use crate::results::with_results;
use aloft_body::BaseParameters;
use aloft_compare::{Body, TrialDraws, WindowRows};
use aloft_pipeline::stages::compare::{
    self, ComparedTrial, HeldOut, NOISE_FLOOR_FILE, StoredFloor, compare_options, load_trials,
};
use aloft_study::subject_session::SubjectSession;
use aloft_workspace::error::{PipelineError, StageFailure};
use aloft_workspace::json::read_json_if_there;
use aloft_workspace::manifest::WHOLE_STUDY;
use aloft_workspace::workspace::Workspace;
use nalgebra::DMatrix;
use rayon::prelude::*;

/// Draws of the errors that a model with the true parameters leaves; none without a comparison.
pub(crate) fn drawn(session: &SubjectSession) -> Result<Vec<TrialDraws>, PipelineError> {
    let folder = Workspace::open(&session.workspace).place("compare", WHOLE_STUDY);
    let stored: Option<StoredFloor> = read_json_if_there(&folder.join(NOISE_FLOOR_FILE))?;
    Ok(stored.map(|s| s.floor.draws).unwrap_or_default())
}

/// Rows of the base parameters in the windows in contact of trials that have draws there, where
/// contact is held out.
pub(crate) fn contact_rows(
    session: &SubjectSession,
    draws: &[TrialDraws],
) -> Result<Vec<(String, DMatrix<f64>)>, PipelineError> {
    let has = |name: &str| draws.iter().any(|d| d.trial == name && d.held_out_contact && d.in_flight.contains(&false));
    with_results(session, |made| {
        let params = compare::Params::of(session);
        let subject = made.results.load_subject("calibrate")?;
        let (base, prior) = (BaseParameters::of(&subject.model), subject.prior_phi());
        let body = Body { model: &subject.model, base: &base, prior: &prior };
        let options = compare_options(&params, &subject);
        let trials = load_trials(&params, made.results, &|| made.calendar(), &made.trials)?;
        let of = |t: &ComparedTrial| {
            let input = t.input(0, HeldOut::EveryTrial, false, None);
            let windows = WindowRows::of(&body, &input, &options).map_err(|e| StageFailure::new(e.to_string()))?;
            Ok(windows.map(|w| (t.name.clone(), w.contact_columns(base.len(), t.untared && t.flights.is_empty()))))
        };
        let kept: Vec<&ComparedTrial> = trials.iter().filter(|t| has(&t.name)).collect();
        let rows = kept.into_par_iter().map(of).collect::<Result<Vec<_>, StageFailure>>()?;
        Ok(rows.into_iter().flatten().collect())
    })
}
