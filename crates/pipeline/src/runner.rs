//! Runs the stale stages of a study in order, with trials in parallel; a failure never stops the
//! other trials. Subjects and sessions run in parallel, too: the trials of all of them share one
//! pool of threads.

use crate::corrected::refuse_unknown_plates;
use crate::graph::{self, DATED, Stage, TaskState};
use crate::manifests::Manifests;
pub use crate::progress::{Plan, Progress, Silent};
pub use crate::run_report::{BatchReport, Ended, RunReport, StudyRun, TaskReport};
pub use crate::selection::Selection;
use crate::selection::{stage_range, trial_filter};
use crate::stages::STAGES;
use crate::task::Task;
use crate::trial_threads::TrialThreads;
use crate::write_queue::{TO_THE_DISK, run_tasks};
use aloft_study::data_set::DataSet;
use aloft_study::revision::Revisions;
use aloft_study::subject_session::{SubjectSession, TrialEntry};
use aloft_workspace::error::PipelineError;
use aloft_workspace::lock::WorkspaceLock;
use aloft_workspace::manifest::WHOLE_STUDY;
use aloft_workspace::workspace::Workspace;
use globset::GlobSet;
use std::collections::{HashMap, HashSet};
use std::sync::Mutex;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::Instant;

/// Maximum number of tasks that the selection may run, and how long they took before.
fn plan(
    studies: &[&SubjectSession],
    (from, until): (usize, usize),
    filter: Option<&GlobSet>,
) -> Result<Plan, PipelineError> {
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
                    && let Some(m) = workspace.usable(STAGES[i].name, task.map_or(WHOLE_STUDY, |t| &t.name))?
                {
                    sum += m.seconds;
                    n += 1.0;
                }
            }
        }
        plan.seconds[i] = (n > 0.0).then(|| sum / n);
    }
    Ok(plan)
}

/// Runs the selected stages of one study.
pub fn run(
    session: &SubjectSession,
    selection: &Selection,
    progress: &dyn Progress,
) -> Result<RunReport, PipelineError> {
    let range = stage_range(selection)?;
    let filter = trial_filter(&[session], &selection.trials)?;
    refuse_unknown_plates(&[session])?;
    progress.begin(&plan(&[session], range, filter.as_ref())?);
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
    progress.begin(&plan(&[session], range, None)?);
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
    refuse_unknown_plates(&members)?;
    let whole = Workspace::open(&set.workspace);
    let _lock = if selection.alone() { Some(whole.lock(selection.patience())?) } else { None };
    let _shared = if selection.shared && !selection.dry_run { Some(whole.lock_shared()?) } else { None };
    progress.begin(&plan(&members, range, filter.as_ref())?);
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
                // none: a slot whose worker ended early is reported as such below
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
    let _lock = if selection.alone() { Some(workspace.lock(selection.patience())?) } else { None };
    let _shared = if selection.shared && !selection.dry_run { Some(workspace.lock_shared()?) } else { None };
    // another process may have changed the model while this one waited
    let session = &session.refreshed()?;
    let mut notes = Vec::new();
    if selection.alone() {
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
        Manifests::read(session, workspace, STAGES)?
    } else {
        Manifests::read_and_examine(session, workspace, STAGES)?
    };
    for stage in STAGES[..from].iter().copied() {
        refuse_if_not_current(stage, &STAGES[from..until], session, filter, workspace, &manifests)?;
    }
    let mut report = RunReport::default();
    let mut would_change = Changing::default();
    for stage in STAGES[from..until].iter().copied() {
        let mut due = Vec::new();
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
            let standing = graph::task_state(stage, trial, session, &inputs, manifest);
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
                    due.push(Task { trial, inputs });
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
                    would_change.entry(stage.name).or_default().insert(name.to_owned());
                    Some(Ended::WouldRun(reason))
                }
            };
            if let Some(ended) = ended {
                let warnings = manifest.map(|m| m.warnings.clone()).unwrap_or_default();
                line.push(TaskReport { stage: stage.name, trial: name.to_owned(), ended, warnings, seconds: 0.0 });
            }
        }
        progress.stage(&session.id, stage.name, line.len(), due.len());
        for (manifest, task, unwritten) in run_tasks(stage, &due, session, selection, workspace, threads, progress)? {
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

/// Trials whose results would be made again, by stage; only a dry run has any.
type Changing = HashMap<&'static str, HashSet<String>>;

fn upstream_will_change(
    stage: &Stage,
    trial: Option<&TrialEntry>,
    session: &SubjectSession,
    changed: &Changing,
) -> bool {
    use graph::Need;
    stage.needs.iter().any(|need| {
        let Some(names) = need.stage().and_then(|name| changed.get(name)) else { return false };
        match need {
            Need::Recording => false,
            Need::Same(_) => trial.is_some_and(|t| names.contains(&t.name)),
            Need::Once(_) | Need::Times => true,
            Need::Every(_, roles) | Need::Merged(_, roles) | Need::EveryOrStaticFrames(_, roles) => {
                session.included().any(|t| roles.contains(&t.role) && names.contains(&t.name))
            }
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
                Need::Times => (&DATED, None),
                Need::Same(n) => match stage.scope {
                    Scope::Trial(roles) => (n, Some(roles)),
                    Scope::Session => (n, None),
                },
                Need::Every(n, roles) | Need::Merged(n, roles) | Need::EveryOrStaticFrames(n, roles) => {
                    (n, Some(*roles))
                }
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
        let problem = match graph::task_state(stage, trial, session, &inputs, manifests.get(stage.name, name)) {
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
