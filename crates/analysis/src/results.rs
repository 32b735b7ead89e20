//! The results of a study as commands use them: with the settings that they were made with. Damaged
//! results are refused.

use aloft_pipeline::made::as_made;
use aloft_pipeline::results::Results;
use aloft_pipeline::stages::STAGES;
use aloft_study::calendar::Calendar;
use aloft_study::commands::command;
use aloft_study::subject_session::{Role, SubjectSession};
use aloft_workspace::error::{PipelineError, StageFailure};
use aloft_workspace::manifest::WHOLE_STUDY;
use aloft_workspace::workspace::Workspace;
use std::sync::{Arc, OnceLock};

/// Results of a study that has rows.
pub(crate) struct Made<'a> {
    /// The study with the settings that its results were made with.
    pub session: &'a SubjectSession,
    /// Its results.
    pub results: Results<'a>,
    /// Trials with rows and their roles.
    pub trials: Vec<(String, Role)>,
    /// The workspace that they stand in.
    pub workspace: &'a Workspace,
    /// Times of the recordings, once somebody asked.
    calendar: OnceLock<Arc<Calendar>>,
}

impl Made<'_> {
    /// Times of the session's recordings.
    pub fn calendar(&self) -> Result<Arc<Calendar>, StageFailure> {
        if let Some(known) = self.calendar.get() {
            return Ok(Arc::clone(known));
        }
        let read = Arc::new(Calendar::of(self.session, self.workspace)?);
        Ok(Arc::clone(self.calendar.get_or_init(|| read)))
    }

    /// Names of the trials with rows that are used for identification.
    pub fn training(&self) -> Vec<String> {
        self.trials.iter().filter(|(_, role)| *role == Role::Identify).map(|(name, _)| name.clone()).collect()
    }
}

fn refuse_damaged(ws: &Workspace, stage: &str, trial: &str) -> Result<(), PipelineError> {
    let problem = ws.damage(stage, trial)?.into_iter().next();
    problem.map_or(Ok(()), |problem| Err(PipelineError::Damaged { path: ws.place(stage, trial), problem }))
}

/// Calls `work` with the results of a study that has rows.
pub(crate) fn with_results<T>(
    session: &SubjectSession,
    work: impl FnOnce(&Made<'_>) -> Result<T, StageFailure>,
) -> Result<T, PipelineError> {
    let session = &as_made(session)?;
    let ws = Workspace::open(&session.workspace);
    for stage in STAGES {
        for trial in stage.tasks(session) {
            refuse_damaged(&ws, stage.name, trial.map_or(WHOLE_STUDY, |t| t.name.as_str()))?;
        }
    }
    let mut trials: Vec<(String, Role)> = Vec::new();
    for t in session.included().filter(|t| t.role.is_dynamic()) {
        trials.extend(ws.usable("regressor", &t.name)?.map(|_| (t.name.clone(), t.role)));
    }
    if trials.is_empty() {
        return Err(PipelineError::request_hint(
            format!("no trial in {} has rows", session.workspace.display()),
            format!("run `{}` first", command(session, "run", None)),
        ));
    }
    work(&Made { session, results: Results::of(&ws), trials, workspace: &ws, calendar: OnceLock::new() })
        .map_err(|f| PipelineError::Request { problem: f.problem, hint: f.hint })
}
