//! `status`: the grid of stages and trials, with the files beside the results that no longer are
//! what the results give.

use crate::freshness::NotCurrent;
use crate::outputs::{self, FILE, Look};
use crate::status::{Status, grid};
use aloft_pipeline::manifests::Manifests;
use aloft_pipeline::stages::STAGES;
use aloft_study::subject_session::SubjectSession;
use aloft_workspace::error::PipelineError;
use aloft_workspace::workspace::Workspace;

/// The grid and the files.
///
/// # Errors
/// A result or a file cannot be looked at.
pub fn status(session: &SubjectSession) -> Result<Status, PipelineError> {
    let ws = Workspace::open(&session.workspace);
    let manifests = Manifests::read_and_examine(session, &ws, STAGES)?;
    Ok(Status { files: files(session, Look::Quick)?, ..grid(session, &ws, &manifests)? })
}

/// Files in the workspace of one subject and session that are not what its results would give.
///
/// # Errors
/// A file cannot be looked at.
pub fn files(session: &SubjectSession, look: Look) -> Result<Vec<NotCurrent>, PipelineError> {
    let mut out = outputs::not_current(&session.workspace, &[session], look)?;
    out.extend(crate::export::not_current(session, look)?.map(|(state, because)| NotCurrent {
        stage: FILE.to_owned(),
        trial: crate::export::FOLDER.to_owned(),
        state: state.to_owned(),
        because: format!("{because}; `aloft export` writes it again"),
        follows: false,
    }));
    Ok(out)
}
