//! Runs the tasks of a stage in parallel, and meanwhile puts finished results in their places: a
//! queue of a thread of its own, which flushes all waiting results to disk at once.

use crate::graph::Stage;
use crate::progress::Progress;
use crate::ready_made;
use crate::run_report::{Ended, TaskReport};
use crate::selection::Selection;
use crate::task::{Task, empty_manifest, made_meanwhile, run_task};
use crate::trial_threads::TrialThreads;
use aloft_study::subject_session::SubjectSession;
use aloft_workspace::disk;
use aloft_workspace::error::{PipelineError, StageFailure};
use aloft_workspace::manifest::{Manifest, Outcome, WHOLE_STUDY};
use aloft_workspace::workspace::{Complete, Workspace};
use std::sync::mpsc;

/// Advice if a result cannot be written to disk.
pub(crate) const TO_THE_DISK: &str = "make room on the disk or make it writable, and run again: what is done is kept";

/// A completed task: its manifest, its report, and the reason if its result could not be put in
/// place.
pub(crate) type FinishedTask = (Manifest, TaskReport, Option<String>);

/// Runs the tasks of a stage. While the next tasks run, finished results are written to disk, all
/// waiting ones at once.
pub(crate) fn run_tasks(
    stage: &'static Stage,
    due: &[Task<'_>],
    session: &SubjectSession,
    selection: &Selection,
    workspace: &Workspace,
    threads: &TrialThreads,
    progress: &dyn Progress,
) -> Result<Vec<FinishedTask>, PipelineError> {
    // each waiting result holds an open file, and some systems allow only 256 of them
    let at_once = threads.share(32);
    let syncs = threads.share(disk::SYNCS);
    let tell = |done: FinishedTask| {
        progress.task(&session.id, &done.1);
        done
    };
    let (hand_over, handed) = mpsc::sync_channel::<(Complete, TaskReport)>(at_once);
    // the closure owns the receiver, so that no sender waits forever if it panics
    let place = move || {
        let mut out = Vec::new();
        // the loop ends when every sender is dropped
        // none: the end of the queue
        while let Ok(first) = handed.recv() {
            let batch = std::iter::once(first).chain(handed.try_iter().take(at_once - 1));
            let (batch, reports): (Vec<Complete>, Vec<TaskReport>) = batch.unzip();
            let placed = workspace.place_all(batch, syncs).into_iter().zip(reports);
            out.extend(placed.map(|((manifest, done), report)| tell(in_place(manifest, report, done))));
        }
        out
    };
    // returns none if the result was handed over
    let one = |task: &Task<'_>,
               hand_over: &mpsc::SyncSender<(Complete, TaskReport)>|
     -> Result<Option<FinishedTask>, PipelineError> {
        if progress.stops() {
            return Err(PipelineError::Stopped);
        }
        let name = task.trial.map_or(WHOLE_STUDY, |t| t.name.as_str());
        let _alone = if selection.shared { Some(workspace.lock_task(stage.name, name)?) } else { None };
        if selection.shared
            && !selection.force
            && let Some((manifest, report)) = made_meanwhile(stage, task, session, workspace)?
        {
            return Ok(Some((manifest, report, None)));
        }
        let ready = if selection.force { None } else { ready_made::take(stage, task, session, workspace) };
        let (complete, report) = match ready.map_or_else(|| run_task(stage, task, session, workspace), Ok) {
            Ok(made) => made,
            Err(e) => return Ok(Some(tell(not_made(stage, task, session, e)))),
        };
        if selection.shared {
            // a job that shares the workspace keeps the lock on its result until the result is in
            // place
            let placed = workspace.place_all(vec![complete], syncs).into_iter().zip([report]);
            return Ok(placed.map(|((manifest, done), report)| tell(in_place(manifest, report, done))).next());
        }
        hand_over.send((complete, report)).map_err(|_| stopped())?;
        Ok(None)
    };
    std::thread::scope(|scope| {
        // a separate thread, not one of rayon's: those may all be waiting for it
        let placing = std::thread::Builder::new().spawn_scoped(scope, place);
        let placing = placing.map_err(|e| PipelineError::request(format!("cannot begin a thread: {e}")))?;
        let results: Vec<Result<Option<FinishedTask>, PipelineError>> = threads.each(due, |task| one(task, &hand_over));
        drop(hand_over);
        let mut out = placing.join().map_err(|_| stopped())?;
        for result in results {
            out.extend(result?);
        }
        Ok(out)
    })
}

/// Error if the thread that puts results in place panicked.
fn stopped() -> PipelineError {
    PipelineError::request_hint(
        "results could not be put into their places: an internal error",
        "this is a defect of aloft, not of your data; please report it with the line above",
    )
}

/// A task after its result was put in place. If that went wrong, the task counts as failed, also
/// for tasks of this run that read it.
fn in_place(mut manifest: Manifest, mut report: TaskReport, done: Result<(), PipelineError>) -> FinishedTask {
    let Err(e) = done else { return (manifest, report, None) };
    let problem = format!("the result could not be written: {e}");
    let unwritten = format!("{} of {}: {problem}", manifest.stage, manifest.trial);
    let failure = StageFailure::with_hint(problem, TO_THE_DISK);
    manifest.outcome = Outcome::Failed(failure.clone());
    report.ended = Ended::Failed(failure);
    report.warnings.clear();
    (manifest, report, Some(unwritten))
}

/// A task whose result could not be written at all.
fn not_made(stage: &'static Stage, task: &Task<'_>, session: &SubjectSession, error: PipelineError) -> FinishedTask {
    let manifest = empty_manifest(stage, task, session);
    let trial = manifest.trial.clone();
    let report = TaskReport { stage: stage.name, trial, ended: Ended::Ran, warnings: Vec::new(), seconds: 0.0 };
    in_place(manifest, report, Err(error))
}
