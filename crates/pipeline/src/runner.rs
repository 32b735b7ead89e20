//! Runs the stale stages of a study in order, with trials in parallel; a failure never stops the
//! other trials. Subjects and sessions run in parallel, too: the trials of all of them share one
//! pool of threads.

use crate::graph::{self, Manifests, Stage, StageInputs, TaskState};
pub use crate::progress::{Plan, Progress, Silent};
use crate::stages::STAGES;
use crate::trial_threads::TrialThreads;
use aloft_study::data_set::DataSet;
use aloft_study::recordings::SessionId;
use aloft_study::revision::Revisions;
use aloft_study::subject_session::{SubjectSession, TrialEntry};
use aloft_workspace::disk;
use aloft_workspace::error::{PipelineError, StageFailure};
use aloft_workspace::lock::WorkspaceLock;
use aloft_workspace::manifest::{Manifest, Outcome, WHOLE_STUDY};
use aloft_workspace::workspace::{Complete, Workspace};
use globset::{Glob, GlobSet, GlobSetBuilder};
use std::collections::BTreeMap;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Mutex, mpsc};
use std::time::{Duration, Instant};

/// Selection of what to run.
#[derive(Debug, Clone, Default)]
pub struct Selection {
    /// First stage.
    pub from: Option<String>,
    /// Only this stage.
    pub only: Option<String>,
    /// Last stage.
    pub until: Option<String>,
    /// Patterns of trial names; all if empty.
    pub trials: Vec<String>,
    /// Also run what is up to date.
    pub force: bool,
    /// Report what would run, and run nothing.
    pub dry_run: bool,
    /// Work on the workspace at the same time as other runs, each on tasks of its own.
    pub shared: bool,
    /// Wait for another run that holds the workspace, instead of failing with an error that names
    /// it.
    pub wait: bool,
}

impl Selection {
    fn patience(&self) -> Duration {
        if self.wait { Duration::MAX } else { Duration::ZERO }
    }
}

/// Outcome of one task in this run.
#[derive(Debug, Clone, PartialEq)]
pub enum Ended {
    /// It ran and gave results.
    Ran,
    /// It was up to date.
    UpToDate,
    /// It would run (dry run), for this reason.
    WouldRun(String),
    /// It ran and failed.
    Failed(StageFailure),
    /// It could not run, for this reason.
    Blocked(String),
}

/// Report of one task.
#[derive(Debug, Clone, PartialEq)]
pub struct TaskReport {
    /// Stage.
    pub stage: &'static str,
    /// Trial, or [`WHOLE_STUDY`].
    pub trial: String,
    /// Outcome.
    pub ended: Ended,
    /// Warnings.
    pub warnings: Vec<String>,
    /// Wall time, s.
    pub seconds: f64,
}

/// Report of a run.
#[derive(Debug, Clone, Default)]
pub struct RunReport {
    /// All tasks, in order of stages, then trials.
    pub tasks: Vec<TaskReport>,
    /// What the run found in the workspace and repaired or left alone, in words.
    pub notes: Vec<String>,
    /// Results that could not be written to disk, in words: their tasks count as failed, and the
    /// earlier results remain in place.
    pub unwritten: Vec<String>,
    /// Wall time, s.
    pub seconds: f64,
}

impl RunReport {
    /// Tasks that failed.
    pub fn failures(&self) -> impl Iterator<Item = (&TaskReport, &StageFailure)> {
        self.tasks.iter().filter_map(|t| match &t.ended {
            Ended::Failed(f) => Some((t, f)),
            _ => None,
        })
    }
    /// Number of tasks that ran.
    pub fn ran(&self) -> usize {
        self.tasks.iter().filter(|t| t.ended == Ended::Ran).count()
    }
    /// Number of tasks that were up to date.
    pub fn up_to_date(&self) -> usize {
        self.tasks.iter().filter(|t| t.ended == Ended::UpToDate).count()
    }
    /// True if some task failed or could not run.
    pub fn has_trouble(&self) -> bool {
        self.tasks.iter().any(|t| matches!(t.ended, Ended::Failed(_) | Ended::Blocked(_)))
    }
}

/// Report of a run for one subject's session.
#[derive(Debug)]
pub struct StudyRun {
    /// Subject and session.
    pub id: SessionId,
    /// The tasks; an error if the run could not begin (in that case nothing of this study was
    /// changed).
    pub report: Result<RunReport, PipelineError>,
}

/// Report of a run over several studies.
#[derive(Debug, Default)]
pub struct BatchReport {
    /// In the order of the studies.
    pub runs: Vec<StudyRun>,
    /// Wall time, s.
    pub seconds: f64,
}

impl BatchReport {
    /// Reports of the studies whose run could begin.
    pub fn reports(&self) -> impl Iterator<Item = (&SessionId, &RunReport)> {
        self.runs.iter().filter_map(|r| r.report.as_ref().ok().map(|report| (&r.id, report)))
    }
    /// True if some task failed or could not run, or some study could not begin.
    pub fn has_trouble(&self) -> bool {
        self.runs.iter().any(|r| r.report.as_ref().map_or(true, RunReport::has_trouble))
    }
}

/// Index of the stage with this name; an error that lists all stages if there is none.
pub fn stage_index(name: &str) -> Result<usize, PipelineError> {
    STAGES.iter().position(|s| s.name == name).ok_or_else(|| {
        let known: Vec<&str> = STAGES.iter().map(|s| s.name).collect();
        PipelineError::request_hint(
            format!("there is no stage `{name}`"),
            format!("the stages are {}", known.join(", ")),
        )
    })
}

fn stage_range(selection: &Selection) -> Result<(usize, usize), PipelineError> {
    if let Some(only) = &selection.only {
        let i = stage_index(only)?;
        return Ok((i, i + 1));
    }
    let from = selection.from.as_deref().map_or(Ok(0), stage_index)?;
    let until = selection.until.as_deref().map_or(Ok(STAGES.len()), |u| stage_index(u).map(|i| i + 1))?;
    if from >= until {
        return Err(PipelineError::request("--from names a stage that comes after --until"));
    }
    Ok((from, until))
}

/// Trials that match the patterns, over all studies; none if no pattern is given. A pattern that
/// matches nothing is an error.
pub fn trial_filter(studies: &[&SubjectSession], patterns: &[String]) -> Result<Option<GlobSet>, PipelineError> {
    if patterns.is_empty() {
        return Ok(None);
    }
    let mut builder = GlobSetBuilder::new();
    for p in patterns {
        builder.add(Glob::new(p).map_err(|e| PipelineError::request(format!("--trial {p}: {}", e.kind())))?);
    }
    let set = builder.build().map_err(|e| PipelineError::request(e.to_string()))?;
    let trials = || studies.iter().flat_map(|s| &s.trials);
    if !trials().any(|t| set.is_match(&t.name)) {
        let mut names: Vec<&str> = trials().map(|t| t.name.as_str()).collect();
        names.sort_unstable();
        names.dedup();
        return Err(PipelineError::request_hint(
            format!("no trial matches {}", patterns.join(", ")),
            format!("the trials are {}", names.join(", ")),
        ));
    }
    Ok(Some(set))
}

struct Task<'s> {
    trial: Option<&'s TrialEntry>,
    inputs: graph::TaskInputs,
}

/// Maximum number of tasks that the selection may run, and how long they took before.
fn plan(studies: &[&SubjectSession], (from, until): (usize, usize), filter: Option<&GlobSet>) -> Plan {
    let mut plan = Plan { tasks: vec![0; STAGES.len()], seconds: vec![None; STAGES.len()] };
    for i in from..until {
        let (mut sum, mut n) = (0.0, 0.0);
        for session in studies {
            let workspace = Workspace::open(&session.workspace);
            for (j, task) in STAGES[i].tasks(session).into_iter().enumerate() {
                if task.is_some_and(|t| filter.is_some_and(|f| !f.is_match(&t.name))) {
                    continue;
                }
                plan.tasks[i] += 1;
                // a few earlier times are enough for a forecast
                if j < 3
                    && let Some(m) = workspace.manifest(STAGES[i].name, task.map_or(WHOLE_STUDY, |t| &t.name))
                    && m.is_ok()
                {
                    sum += m.seconds;
                    n += 1.0;
                }
            }
        }
        plan.seconds[i] = (n > 0.0).then(|| sum / n);
    }
    plan
}

/// True for a run that needs the workspace for itself.
fn alone(selection: &Selection) -> bool {
    !selection.dry_run && !selection.shared
}

/// Runs the selected stages of one study.
pub fn run(
    session: &SubjectSession,
    selection: &Selection,
    progress: &dyn Progress,
) -> Result<RunReport, PipelineError> {
    let range = stage_range(selection)?;
    let filter = trial_filter(&[session], &selection.trials)?;
    progress.begin(&plan(&[session], range, filter.as_ref()));
    let done = run_study(session, range, filter.as_ref(), selection, &TrialThreads::new(1), progress);
    progress.end();
    done
}

/// Brings everything up to date while the caller already holds the workspace; the study's effects
/// are taken as they are. A result that cannot be written is an error here, because what follows
/// would be built on old results.
pub fn run_held(
    session: &SubjectSession,
    _held: &WorkspaceLock,
    progress: &dyn Progress,
) -> Result<RunReport, PipelineError> {
    let range = (0, STAGES.len());
    progress.begin(&plan(&[session], range, None));
    let workspace = Workspace::open(&session.workspace);
    let done = run_stages(session, &workspace, range, None, &Selection::default(), &TrialThreads::new(1), progress);
    progress.end();
    match done {
        Ok(report) if !report.unwritten.is_empty() => {
            Err(PipelineError::request_hint(report.unwritten.join("; "), TO_THE_DISK))
        }
        done => done,
    }
}

/// Runs the selected stages of every member of a set. Their trials share the pool of threads; a
/// member that cannot begin, or whose tasks fail, never stops the others. An error is returned only
/// if it concerns all members: a wrong stage or pattern, or a workspace in use.
pub fn run_all(set: &DataSet, selection: &Selection, progress: &dyn Progress) -> Result<BatchReport, PipelineError> {
    let started = Instant::now();
    if !set.several {
        let Some(session) = set.members.first() else { return Ok(BatchReport::default()) };
        let report = Ok(run(session, selection, progress)?);
        let runs = vec![StudyRun { id: session.id.clone(), report }];
        return Ok(BatchReport { runs, seconds: started.elapsed().as_secs_f64() });
    }
    let range = stage_range(selection)?;
    let members: Vec<&SubjectSession> = set.members.iter().collect();
    let filter = trial_filter(&members, &selection.trials)?;
    let whole = Workspace::open(&set.workspace);
    let _lock = if alone(selection) { Some(whole.lock(selection.patience())?) } else { None };
    let _shared = if selection.shared && !selection.dry_run { Some(whole.lock_shared()?) } else { None };
    progress.begin(&plan(&members, range, filter.as_ref()));
    let next = AtomicUsize::new(0);
    let slots: Vec<Mutex<Option<Result<RunReport, PipelineError>>>> =
        members.iter().map(|_| Mutex::new(None)).collect();
    // one study more than there are threads keeps every thread busy while a study-wide stage runs
    // on one
    let side_by_side = members.len().min(rayon::current_num_threads() + 1);
    let threads = TrialThreads::new(side_by_side);
    std::thread::scope(|scope| {
        for _ in 0..side_by_side {
            scope.spawn(|| {
                while let Some((session, slot)) = {
                    let i = next.fetch_add(1, Ordering::Relaxed);
                    members.get(i).zip(slots.get(i))
                } {
                    let done = run_study(session, range, filter.as_ref(), selection, &threads, progress);
                    if let Ok(mut slot) = slot.lock() {
                        *slot = Some(done);
                    }
                }
            });
        }
    });
    progress.end();
    let runs = members
        .iter()
        .zip(slots)
        .map(|(session, slot)| StudyRun {
            id: session.id.clone(),
            report: slot
                .into_inner()
                .ok()
                .flatten()
                .unwrap_or_else(|| Err(PipelineError::request("the run ended before this study was reached"))),
        })
        .collect();
    Ok(BatchReport { runs, seconds: started.elapsed().as_secs_f64() })
}

fn run_study(
    session: &SubjectSession,
    (from, until): (usize, usize),
    filter: Option<&GlobSet>,
    selection: &Selection,
    threads: &TrialThreads,
    progress: &dyn Progress,
) -> Result<RunReport, PipelineError> {
    if filter.is_some_and(|f| !session.trials.iter().any(|t| f.is_match(&t.name))) {
        return Ok(RunReport::default());
    }
    let workspace = Workspace::open(&session.workspace);
    let _lock = if alone(selection) { Some(workspace.lock(selection.patience())?) } else { None };
    let _shared = if selection.shared && !selection.dry_run { Some(workspace.lock_shared()?) } else { None };
    // another process may have changed the model while this one waited
    let session = &session.refreshed()?;
    let mut notes = Vec::new();
    if alone(selection) {
        let mut model = Revisions::load(&session.workspace)?;
        if let Some(pending) = model.pending.take() {
            model.save(&session.workspace)?;
            notes.push(format!("`effect {}` was interrupted; the model is the one before it", pending.action));
        }
    }
    let mut report = run_stages(session, &workspace, (from, until), filter, selection, threads, progress)?;
    report.notes.splice(0..0, notes);
    Ok(report)
}

fn run_stages(
    session: &SubjectSession,
    workspace: &Workspace,
    (from, until): (usize, usize),
    filter: Option<&GlobSet>,
    selection: &Selection,
    threads: &TrialThreads,
    progress: &dyn Progress,
) -> Result<RunReport, PipelineError> {
    let started = Instant::now();
    // jobs of a cluster read only the manifests of their own inputs
    let mut manifests = if selection.shared {
        Manifests::read(session, workspace, STAGES)
    } else {
        Manifests::read_and_examine(session, workspace, STAGES)
    };
    for stage in STAGES[..from].iter().copied() {
        refuse_if_not_current(stage, &STAGES[from..until], session, filter, workspace, &manifests)?;
    }
    let mut report = RunReport::default();
    let mut would_change: Vec<(String, String)> = Vec::new();
    for stage in STAGES[from..until].iter().copied() {
        let mut todo = Vec::new();
        let mut line: Vec<TaskReport> = Vec::new();
        for trial in stage.tasks(session) {
            let name = trial.map_or(WHOLE_STUDY, |t| t.name.as_str());
            if let (Some(set), Some(t)) = (filter, trial)
                && !set.is_match(&t.name)
            {
                continue;
            }
            let inputs = graph::inputs(stage, trial, session, workspace, &manifests)?;
            let manifest = manifests.get(stage.name, name);
            let standing = graph::standing(stage, trial, session, &inputs, manifest);
            let upstream_changes = upstream_will_change(stage, trial, session, &would_change);
            if let TaskState::Damaged(problems) = &standing {
                let whose = if trial.is_some() { format!(" of {name}") } else { String::new() };
                let what = if selection.dry_run { "would be made again" } else { "made again" };
                report.notes.push(format!("damaged: {}{whose}: {}; {what}", stage.name, problems.join("; ")));
            }
            let ended = match standing {
                TaskState::Blocked(reason) if !upstream_changes => Some(Ended::Blocked(reason)),
                // the damaged result was not selected; otherwise it would have been made again by
                // now
                _ if !inputs.damaged.is_empty() && !upstream_changes => {
                    Some(Ended::Blocked(format!("{} is damaged and was not chosen", inputs.damaged.join(", "))))
                }
                s if s.is_current() && !selection.force && !upstream_changes => Some(Ended::UpToDate),
                _ if !selection.dry_run => {
                    todo.push(Task { trial, inputs });
                    None
                }
                s => {
                    let reason = match s {
                        TaskState::Missing => "never run".to_owned(),
                        TaskState::Stale(changes) => changes.join("; "),
                        TaskState::Damaged(problems) => format!("damaged: {}", problems.join("; ")),
                        TaskState::Failed(_) => "failed last time".to_owned(),
                        _ if upstream_changes => "an earlier stage runs".to_owned(),
                        _ => "--force".to_owned(),
                    };
                    would_change.push((stage.name.to_owned(), name.to_owned()));
                    Some(Ended::WouldRun(reason))
                }
            };
            if let Some(ended) = ended {
                let warnings = manifest.map(|m| m.warnings.clone()).unwrap_or_default();
                line.push(TaskReport { stage: stage.name, trial: name.to_owned(), ended, warnings, seconds: 0.0 });
            }
        }
        progress.stage(&session.id, stage.name, line.len(), todo.len());
        for (manifest, task, unwritten) in run_tasks(stage, &todo, session, selection, workspace, threads, progress)? {
            manifests.insert(manifest);
            line.push(task);
            report.unwritten.extend(unwritten);
        }
        line.sort_by(|a, b| a.trial.cmp(&b.trial));
        report.tasks.extend(line);
    }
    // parallel runs would overwrite each other's list; the manifest of each result holds its hashes
    if !selection.dry_run
        && !selection.shared
        && let Err(e) = workspace.save_input_hashes()
    {
        report.notes.push(format!("the next run reads every recording again: {e}"));
    }
    report.seconds = started.elapsed().as_secs_f64();
    Ok(report)
}

/// Advice if a result cannot be written to disk.
const TO_THE_DISK: &str = "make room on the disk or make it writable, and run again: what is done is kept";

/// A completed task: its manifest, its report, and the reason if its result could not be put in
/// place.
type Done = (Manifest, TaskReport, Option<String>);

/// Runs the tasks of a stage. While the next tasks run, finished results are written to disk, all
/// waiting ones at once.
fn run_tasks(
    stage: &'static Stage,
    todo: &[Task<'_>],
    session: &SubjectSession,
    selection: &Selection,
    workspace: &Workspace,
    threads: &TrialThreads,
    progress: &dyn Progress,
) -> Result<Vec<Done>, PipelineError> {
    // each waiting result holds an open file, and some systems allow only 256 of them
    let at_once = threads.share(32);
    let syncs = threads.share(disk::SYNCS);
    let tell = |done: Done| {
        progress.task(&session.id, &done.1);
        done
    };
    let (hand_over, handed) = mpsc::sync_channel::<(Complete, TaskReport)>(at_once);
    // the closure owns the receiver, so that no sender waits forever if it panics
    let place = move || {
        let mut out = Vec::new();
        // the loop ends when every sender is dropped
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
     -> Result<Option<Done>, PipelineError> {
        let name = task.trial.map_or(WHOLE_STUDY, |t| t.name.as_str());
        let _alone = if selection.shared { Some(workspace.lock_task(stage.name, name)?) } else { None };
        if selection.shared
            && !selection.force
            && let Some((manifest, report)) = made_meanwhile(stage, task, session, workspace)
        {
            return Ok(Some((manifest, report, None)));
        }
        let (complete, report) = match run_task(stage, task, session, workspace) {
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
        let results: Vec<Result<Option<Done>, PipelineError>> = threads.each(todo, |task| one(task, &hand_over));
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
fn in_place(mut manifest: Manifest, mut report: TaskReport, done: Result<(), PipelineError>) -> Done {
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
fn not_made(stage: &'static Stage, task: &Task<'_>, session: &SubjectSession, error: PipelineError) -> Done {
    let manifest = empty_manifest(stage, task, session);
    let trial = manifest.trial.clone();
    let report = TaskReport { stage: stage.name, trial, ended: Ended::Ran, warnings: Vec::new(), seconds: 0.0 };
    in_place(manifest, report, Err(error))
}

fn upstream_will_change(
    stage: &Stage,
    trial: Option<&TrialEntry>,
    session: &SubjectSession,
    changed: &[(String, String)],
) -> bool {
    use graph::Need;
    stage.needs.iter().any(|need| match need {
        Need::Recording => false,
        Need::Same(name) => changed.iter().any(|(s, t)| s == name && trial.is_some_and(|x| &x.name == t)),
        Need::Once(name) => changed.iter().any(|(s, _)| s == name),
        Need::Every(name, roles) | Need::EveryOrStaticFrames(name, roles) => {
            changed.iter().any(|(s, t)| s == name && session.trial(t).is_some_and(|x| roles.contains(&x.role)))
        }
    })
}

/// Whether one of some stages reads the result of a stage for a trial (none: for the whole study),
/// directly or through others.
fn reads(by: &[&Stage], name: &str, trial: Option<&TrialEntry>, session: &SubjectSession) -> bool {
    use graph::{Need, Scope};
    let still = session.config.trials.static_frames.as_ref().map(|f| f.trial.as_str());
    by.iter().any(|stage| {
        stage.needs.iter().any(|need| {
            let (above, roles) = match need {
                Need::Recording => return false,
                Need::Once(n) => (n, None),
                Need::Same(n) => match stage.scope {
                    Scope::Trial(roles) => (n, Some(roles)),
                    Scope::SubjectSession => (n, None),
                },
                Need::Every(n, roles) | Need::EveryOrStaticFrames(n, roles) => (n, Some(*roles)),
            };
            let fits =
                trial.is_none_or(|t| roles.is_none_or(|r| r.contains(&t.role)) || still == Some(t.name.as_str()));
            let through = || STAGES.iter().any(|s| s.name == *above && reads(&[*s], name, trial, session));
            (*above == name && fits) || through()
        })
    })
}

fn refuse_if_not_current(
    stage: &Stage,
    by: &[&Stage],
    session: &SubjectSession,
    filter: Option<&GlobSet>,
    workspace: &Workspace,
    manifests: &Manifests,
) -> Result<(), PipelineError> {
    for trial in stage.tasks(session) {
        if trial.is_some_and(|t| filter.is_some_and(|f| !f.is_match(&t.name))) {
            continue;
        }
        if !reads(by, stage.name, trial, session) {
            continue;
        }
        let name = trial.map_or(WHOLE_STUDY, |t| t.name.as_str());
        let inputs = graph::inputs(stage, trial, session, workspace, manifests)?;
        let problem = match graph::standing(stage, trial, session, &inputs, manifests.get(stage.name, name)) {
            TaskState::Missing => "has not run".to_owned(),
            TaskState::Stale(changes) => format!("is stale ({})", changes.join("; ")),
            TaskState::Damaged(problems) => format!("is damaged ({})", problems.join("; ")),
            _ => continue,
        };
        return Err(PipelineError::request_hint(
            format!("stage {} of {name} {problem}", stage.name),
            format!("run without --only and --from, or with --from {}", stage.name),
        ));
    }
    Ok(())
}

/// The result of a task that another run has completed since this run looked.
fn made_meanwhile(
    stage: &Stage,
    task: &Task<'_>,
    session: &SubjectSession,
    workspace: &Workspace,
) -> Option<(Manifest, TaskReport)> {
    let name = task.trial.map_or(WHOLE_STUDY, |t| t.name.as_str());
    workspace.forget(stage.name, name);
    let manifest = workspace.manifest(stage.name, name)?;
    let inputs = graph::TaskInputs { own_damage: workspace.damage(stage.name, name), ..task.inputs.clone() };
    if !graph::standing(stage, task.trial, session, &inputs, Some(&manifest)).is_current() {
        return None;
    }
    let (trial, warnings) = (name.to_owned(), manifest.warnings.clone());
    let report = TaskReport { stage: stage.name, trial, ended: Ended::UpToDate, warnings, seconds: 0.0 };
    Some((manifest, report))
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
fn empty_manifest(stage: &Stage, task: &Task<'_>, session: &SubjectSession) -> Manifest {
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

fn run_task(
    stage: &'static Stage,
    task: &Task<'_>,
    session: &SubjectSession,
    workspace: &Workspace,
) -> Result<(Complete, TaskReport), PipelineError> {
    let name = task.trial.map_or(WHOLE_STUDY, |t| t.name.as_str());
    let scratch = workspace.scratch(stage.name, name)?;
    let started = Instant::now();
    let inputs = StageInputs::new(stage, task.trial, session, workspace, &task.inputs.ready, &scratch);
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
    let manifest = Manifest {
        outcome: outcome.clone(),
        warnings: done.warnings.clone(),
        summary: done.summary,
        seconds,
        ..empty_manifest(stage, task, session)
    };
    let complete = workspace.complete(scratch, manifest)?;
    let ended = match outcome {
        Outcome::Ok => Ended::Ran,
        Outcome::Failed(f) => Ended::Failed(f),
    };
    let report = TaskReport { stage: stage.name, trial: name.to_owned(), ended, warnings: done.warnings, seconds };
    Ok((complete, report))
}
