//! One task: a stage for one trial or for the whole study, run into a folder that readers do not
//! see yet.

use crate::graph::{self, Stage, StageInputs};
use crate::run_report::{Ended, TaskReport};
use aloft_study::subject_session::{SubjectSession, TrialEntry};
use aloft_workspace::disk;
use aloft_workspace::error::{PipelineError, StageFailure};
use aloft_workspace::manifest::{Manifest, Outcome, WHOLE_STUDY};
use aloft_workspace::warning::StageWarning;
use aloft_workspace::workspace::{Complete, Workspace};
use std::collections::BTreeMap;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::time::Instant;

/// A task and what it reads.
pub(crate) struct Task<'s> {
    pub(crate) trial: Option<&'s TrialEntry>,
    pub(crate) inputs: graph::TaskInputs,
}

/// The result of a task that another run has completed since this run looked.
pub(crate) fn made_meanwhile(
    stage: &Stage,
    task: &Task<'_>,
    session: &SubjectSession,
    workspace: &Workspace,
) -> Result<Option<(Manifest, TaskReport)>, PipelineError> {
    let name = task.trial.map_or(WHOLE_STUDY, |t| t.name.as_str());
    workspace.forget(stage.name, name);
    let Some(manifest) = workspace.manifest(stage.name, name)? else { return Ok(None) };
    let inputs = graph::TaskInputs { own_damage: workspace.damage(stage.name, name)?, ..task.inputs.clone() };
    if !graph::task_state(stage, task.trial, session, &inputs, Some(&manifest)).is_current() {
        return Ok(None);
    }
    let (trial, warnings) = (name.to_owned(), manifest.warnings.clone());
    let report = TaskReport { stage: stage.name, trial, ended: Ended::UpToDate, warnings, seconds: 0.0 };
    Ok(Some((manifest, report)))
}

/// Checks that a recording did not change between hashing and reading; otherwise the result would
/// be stored under a wrong hash.
fn unchanged_meanwhile(stage: &Stage, task: &Task<'_>, workspace: &Workspace) -> Result<(), StageFailure> {
    let Some(trial) = task.trial.filter(|_| stage.needs.contains(&graph::Need::Recording)) else { return Ok(()) };
    for path in std::iter::once(&trial.file).chain(&trial.forces).chain(&trial.beside) {
        let hash = workspace.input_hash(path)?;
        if !task.inputs.hashes.values().any(|h| *h == hash) {
            return Err(StageFailure::with_hint(
                format!("{} changed while it was read", path.display()),
                "run again when nothing writes to the recordings",
            ));
        }
    }
    Ok(())
}

/// Manifest of a result before it is made.
pub(crate) fn empty_manifest(stage: &Stage, task: &Task<'_>, session: &SubjectSession) -> Manifest {
    Manifest {
        stage: stage.name.to_owned(),
        trial: task.trial.map_or(WHOLE_STUDY, |t| t.name.as_str()).to_owned(),
        version: stage.version,
        parameters: (stage.parameters)(session, task.trial),
        inputs: task.inputs.hashes.clone(),
        outcome: Outcome::Ok,
        warnings: Vec::new(),
        summary: BTreeMap::new(),
        output: String::new(),
        files: BTreeMap::new(),
        seconds: 0.0,
        program: env!("CARGO_PKG_VERSION").to_owned(),
    }
}

/// Runs a task; the result is complete but not yet in its place.
pub(crate) fn run_task(
    stage: &'static Stage,
    task: &Task<'_>,
    session: &SubjectSession,
    workspace: &Workspace,
) -> Result<(Complete, TaskReport), PipelineError> {
    let name = task.trial.map_or(WHOLE_STUDY, |t| t.name.as_str());
    let scratch = workspace.scratch(stage.name, name)?;
    let started = Instant::now();
    let inputs = StageInputs::new(stage, task.trial, session, workspace, &task.inputs, &scratch);
    let result = catch_unwind(AssertUnwindSafe(|| (stage.run)(session, task.trial, &inputs))).unwrap_or_else(|panic| {
        let what = panic
            .downcast_ref::<String>()
            .map(String::as_str)
            .or_else(|| panic.downcast_ref::<&str>().copied())
            .unwrap_or("no message");
        Err(StageFailure::with_hint(
            format!("{name}: the stage {} stopped with an internal error: {what}", stage.name),
            "this is a defect of aloft, not of your data; please report it with this line",
        ))
    });
    let seconds = started.elapsed().as_secs_f64();
    let result = result.and_then(|done| unchanged_meanwhile(stage, task, workspace).map(|()| done));
    let (outcome, done) = match result {
        Ok(done) => (Outcome::Ok, done),
        Err(failure) => {
            // files written by a failed stage are not a result
            disk::remove_dir_all(&scratch)?;
            disk::create_dir_all(&scratch)?;
            (Outcome::Failed(failure), graph::StageReport::default())
        }
    };
    let warnings: Vec<StageWarning> = done.warnings.into();
    let manifest = Manifest {
        outcome: outcome.clone(),
        warnings: warnings.clone(),
        summary: done.summary,
        seconds,
        ..empty_manifest(stage, task, session)
    };
    let complete = workspace.complete(scratch, manifest)?;
    let ended = match outcome {
        Outcome::Ok => Ended::Ran,
        Outcome::Failed(f) => Ended::Failed(f),
    };
    let report = TaskReport { stage: stage.name, trial: name.to_owned(), ended, warnings, seconds };
    Ok((complete, report))
}
