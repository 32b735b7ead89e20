//! Runs the stages of a study: what is stale, in order, trials side by side; a failure never stops the others.

use crate::error::{PipelineError, StageFailure};
use crate::graph::{self, Job, Manifests, Stage, Standing};
use crate::stages::STAGES;
use crate::study::{Study, TrialEntry};
use crate::workspace::{Manifest, Outcome, WHOLE_STUDY, Workspace};
use globset::{Glob, GlobSet, GlobSetBuilder};
use rayon::prelude::*;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::time::Instant;

/// What to run.
#[derive(Debug, Clone, Default)]
pub struct Selection {
    /// First stage.
    pub from: Option<String>,
    /// The only stage.
    pub only: Option<String>,
    /// Last stage.
    pub until: Option<String>,
    /// Patterns of trial names; all where empty.
    pub trials: Vec<String>,
    /// Run also what is up to date.
    pub force: bool,
    /// Say what would run, and run nothing.
    pub dry_run: bool,
    /// Work beside other runs on the same workspace, each on tasks of its own.
    pub shared: bool,
}

/// How one task ended in this run.
#[derive(Debug, Clone, PartialEq)]
pub enum Ended {
    /// It ran and gave results.
    Ran,
    /// It was up to date.
    UpToDate,
    /// It would run (dry run), because of this.
    WouldRun(String),
    /// It ran and failed.
    Failed(StageFailure),
    /// It could not run, because of this.
    Blocked(String),
}

/// One line of the record of a run.
#[derive(Debug, Clone, PartialEq)]
pub struct TaskReport {
    /// Stage.
    pub stage: &'static str,
    /// Trial, or [`WHOLE_STUDY`].
    pub trial: String,
    /// How it ended.
    pub ended: Ended,
    /// What was odd.
    pub warnings: Vec<String>,
    /// Wall time, s.
    pub seconds: f64,
}

/// The record of a run.
#[derive(Debug, Clone, Default)]
pub struct RunReport {
    /// Every task in order of stages, then trials.
    pub tasks: Vec<TaskReport>,
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
    /// True when some task failed or could not run.
    pub fn has_trouble(&self) -> bool {
        self.tasks.iter().any(|t| matches!(t.ended, Ended::Failed(_) | Ended::Blocked(_)))
    }
}

/// Told how a run goes on.
pub trait Progress: Sync {
    /// A stage begins with so many tasks to run.
    fn stage(&self, name: &str, tasks: usize);
    /// A task ended.
    fn task(&self, report: &TaskReport);
}

/// Tells nobody.
#[derive(Debug, Clone, Copy, Default)]
pub struct Silent;

impl Progress for Silent {
    fn stage(&self, _name: &str, _tasks: usize) {}
    fn task(&self, _report: &TaskReport) {}
}

/// The stage of a name, or an error that lists them.
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

pub(crate) fn trial_filter(study: &Study, patterns: &[String]) -> Result<Option<GlobSet>, PipelineError> {
    if patterns.is_empty() {
        return Ok(None);
    }
    let mut builder = GlobSetBuilder::new();
    for p in patterns {
        builder.add(Glob::new(p).map_err(|e| PipelineError::request(format!("--trial {p}: {}", e.kind())))?);
    }
    let set = builder.build().map_err(|e| PipelineError::request(e.to_string()))?;
    if !study.trials.iter().any(|t| set.is_match(&t.name)) {
        let names: Vec<&str> = study.trials.iter().map(|t| t.name.as_str()).collect();
        return Err(PipelineError::request_hint(
            format!("no trial matches {}", patterns.join(", ")),
            format!("the trials are {}", names.join(", ")),
        ));
    }
    Ok(Some(set))
}

struct Task<'s> {
    trial: Option<&'s TrialEntry>,
    inputs: graph::Inputs,
}

/// Runs the selected stages.
pub fn run(study: &Study, selection: &Selection, progress: &dyn Progress) -> Result<RunReport, PipelineError> {
    let started = Instant::now();
    let (from, until) = stage_range(selection)?;
    let filter = trial_filter(study, &selection.trials)?;
    let workspace = Workspace::open(&study.workspace);
    let _lock = if selection.dry_run || selection.shared { None } else { Some(workspace.lock()?) };
    let _shared = if selection.shared && !selection.dry_run { Some(workspace.lock_shared()?) } else { None };
    let mut manifests = Manifests::read(study, &workspace, STAGES);
    for stage in STAGES[..from].iter().copied().filter(|s| needed(s.name, &STAGES[from..until])) {
        refuse_if_not_current(stage, study, filter.as_ref(), &workspace, &manifests)?;
    }
    let mut report = RunReport::default();
    let mut would_change: Vec<(String, String)> = Vec::new();
    for stage in STAGES[from..until].iter().copied() {
        let mut todo = Vec::new();
        let mut line: Vec<TaskReport> = Vec::new();
        for trial in stage.tasks(study) {
            let name = trial.map_or(WHOLE_STUDY, |t| t.name.as_str());
            if let (Some(set), Some(t)) = (&filter, trial)
                && !set.is_match(&t.name)
            {
                continue;
            }
            let inputs = graph::inputs(stage, trial, study, &workspace, &manifests)?;
            let manifest = manifests.get(stage.name, name);
            let standing = graph::standing(stage, trial, study, &inputs, manifest);
            let upstream_changes = upstream_will_change(stage, trial, study, &would_change);
            let ended = match standing {
                Standing::Blocked(reason) if !upstream_changes => Some(Ended::Blocked(reason)),
                s if s.is_current() && !selection.force && !upstream_changes => Some(Ended::UpToDate),
                _ if !selection.dry_run => {
                    todo.push(Task { trial, inputs });
                    None
                }
                s => {
                    let reason = match s {
                        Standing::Missing => "never run".to_owned(),
                        Standing::Stale(changes) => changes.join("; "),
                        Standing::Failed(_) => "failed last time".to_owned(),
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
        if !todo.is_empty() {
            progress.stage(stage.name, todo.len());
        }
        let results: Vec<Result<(Manifest, TaskReport), PipelineError>> = todo
            .par_iter()
            .map(|task| {
                let name = task.trial.map_or(WHOLE_STUDY, |t| t.name.as_str());
                let _alone = if selection.shared { Some(workspace.lock_task(stage.name, name)?) } else { None };
                if selection.shared
                    && !selection.force
                    && let Some(done) = made_meanwhile(stage, task, study, &workspace)
                {
                    return Ok(done);
                }
                let (manifest, report) = run_task(stage, task, study, &workspace)?;
                progress.task(&report);
                Ok((manifest, report))
            })
            .collect();
        for result in results {
            let (manifest, task) = result?;
            manifests.insert(manifest);
            line.push(task);
        }
        line.sort_by(|a, b| a.trial.cmp(&b.trial));
        report.tasks.extend(line);
    }
    // runs side by side would overwrite each other's list; each result's own manifest holds its hashes
    if !selection.dry_run && !selection.shared {
        workspace.save_input_hashes()?;
    }
    report.seconds = started.elapsed().as_secs_f64();
    Ok(report)
}

fn upstream_will_change(
    stage: &Stage,
    trial: Option<&TrialEntry>,
    study: &Study,
    changed: &[(String, String)],
) -> bool {
    use graph::Need;
    stage.needs.iter().any(|need| match need {
        Need::Recording => false,
        Need::Same(name) => changed.iter().any(|(s, t)| s == name && trial.is_some_and(|x| &x.name == t)),
        Need::Once(name) => changed.iter().any(|(s, _)| s == name),
        Need::Every(name, roles) | Need::EveryOrStaticFrames(name, roles) => {
            changed.iter().any(|(s, t)| s == name && study.trial(t).is_some_and(|x| roles.contains(&x.role)))
        }
    })
}

/// Whether one of some stages reads what a stage gives, directly or through others.
fn needed(name: &str, by: &[&Stage]) -> bool {
    by.iter().any(|stage| {
        stage.needs.iter().any(|need| {
            let above = match need {
                graph::Need::Recording => return false,
                graph::Need::Same(n) | graph::Need::Once(n) => n,
                graph::Need::Every(n, _) | graph::Need::EveryOrStaticFrames(n, _) => n,
            };
            *above == name || STAGES.iter().any(|s| s.name == *above && needed(name, &[*s]))
        })
    })
}

fn refuse_if_not_current(
    stage: &Stage,
    study: &Study,
    filter: Option<&GlobSet>,
    workspace: &Workspace,
    manifests: &Manifests,
) -> Result<(), PipelineError> {
    for trial in stage.tasks(study) {
        if trial.is_some_and(|t| filter.is_some_and(|f| !f.is_match(&t.name))) {
            continue;
        }
        let name = trial.map_or(WHOLE_STUDY, |t| t.name.as_str());
        let inputs = graph::inputs(stage, trial, study, workspace, manifests)?;
        let problem = match graph::standing(stage, trial, study, &inputs, manifests.get(stage.name, name)) {
            Standing::Missing => "has not run".to_owned(),
            Standing::Stale(changes) => format!("is stale ({})", changes.join("; ")),
            _ => continue,
        };
        return Err(PipelineError::request_hint(
            format!("stage {} of {name} {problem}", stage.name),
            format!("run without --only and --from, or with --from {}", stage.name),
        ));
    }
    Ok(())
}

/// What another run made of a task since this one looked.
fn made_meanwhile(
    stage: &Stage,
    task: &Task<'_>,
    study: &Study,
    workspace: &Workspace,
) -> Option<(Manifest, TaskReport)> {
    let name = task.trial.map_or(WHOLE_STUDY, |t| t.name.as_str());
    let manifest = workspace.manifest(stage.name, name)?;
    if !graph::standing(stage, task.trial, study, &task.inputs, Some(&manifest)).is_current() {
        return None;
    }
    let (trial, warnings) = (name.to_owned(), manifest.warnings.clone());
    let report = TaskReport { stage: stage.name, trial, ended: Ended::UpToDate, warnings, seconds: 0.0 };
    Some((manifest, report))
}

fn run_task(
    stage: &'static Stage,
    task: &Task<'_>,
    study: &Study,
    workspace: &Workspace,
) -> Result<(Manifest, TaskReport), PipelineError> {
    let name = task.trial.map_or(WHOLE_STUDY, |t| t.name.as_str());
    let scratch = workspace.scratch(stage.name, name)?;
    let started = Instant::now();
    let job = Job { study, trial: task.trial, workspace, inputs: &task.inputs.ready, out: &scratch };
    let result = catch_unwind(AssertUnwindSafe(|| (stage.run)(&job))).unwrap_or_else(|panic| {
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
    let (outcome, done) = match result {
        Ok(done) => (Outcome::Ok, done),
        Err(failure) => {
            // what a failed stage wrote is not a result
            std::fs::remove_dir_all(&scratch).map_err(PipelineError::io("clear", &scratch))?;
            std::fs::create_dir_all(&scratch).map_err(PipelineError::io("create", &scratch))?;
            (Outcome::Failed(failure), graph::Done::default())
        }
    };
    let manifest = Manifest {
        stage: stage.name.to_owned(),
        trial: name.to_owned(),
        version: stage.version,
        parameters: (stage.parameters)(study, task.trial),
        inputs: task.inputs.hashes.clone(),
        outcome: outcome.clone(),
        warnings: done.warnings.clone(),
        summary: done.summary,
        output: String::new(),
        seconds,
        program: env!("CARGO_PKG_VERSION").to_owned(),
    };
    let manifest = workspace.commit(&scratch, manifest)?;
    let ended = match outcome {
        Outcome::Ok => Ended::Ran,
        Outcome::Failed(f) => Ended::Failed(f),
    };
    let report = TaskReport { stage: stage.name, trial: name.to_owned(), ended, warnings: done.warnings, seconds };
    Ok((manifest, report))
}
