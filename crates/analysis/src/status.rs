//! The state of every stage of every trial, and the reason for it: `explain`, and the grid of
//! `status`.

use crate::freshness::{NotCurrent, not_current_of};
use aloft_pipeline::graph::{self, Stage, TaskState};
use aloft_pipeline::manifests::Manifests;
use aloft_pipeline::selection::stage_index;
use aloft_pipeline::stages::STAGES;
use aloft_study::subject_session::{SubjectSession, TrialEntry};
use aloft_workspace::error::PipelineError;
use aloft_workspace::manifest::{Manifest, WHOLE_STUDY};
use aloft_workspace::workspace::Workspace;
use serde::Serialize;
use std::collections::{HashMap, HashSet};

/// The grid of trials and stages.
#[derive(Debug, Clone, Serialize)]
pub struct Status {
    /// Version of this structure.
    pub version: u32,
    /// Stage names, in order.
    pub stages: Vec<&'static str>,
    /// One row per trial, and one for the whole study.
    pub rows: Vec<StatusRow>,
    /// Tables, report and export in the workspace that are not what the results give now.
    pub files: Vec<NotCurrent>,
}

/// One row of the grid.
#[derive(Debug, Clone, Serialize)]
pub struct StatusRow {
    /// Trial, or [`WHOLE_STUDY`].
    pub trial: String,
    /// Role.
    pub role: String,
    /// State of each stage: `ok`, `warning`, `stale`, `damaged`, `failed`, `blocked`, `missing`,
    /// `excluded`, or empty if the stage does not apply.
    pub cells: Vec<String>,
}

/// State of a task and the reasons for it.
#[derive(Debug, Clone)]
pub struct Explanation {
    /// State of the task.
    pub state: TaskState,
    /// Manifest of the last result.
    pub manifest: Option<Manifest>,
    /// Upstream results that are not up to date, with the reasons. Once they run again, this result
    /// changes, too.
    pub before: Vec<String>,
}

fn present_state(
    stage: &Stage,
    trial: Option<&TrialEntry>,
    session: &SubjectSession,
    ws: &Workspace,
    manifests: &Manifests,
) -> Result<TaskState, PipelineError> {
    let name = trial.map_or(WHOLE_STUDY, |t| t.name.as_str());
    let inputs = graph::inputs(stage, trial, session, ws, manifests)?;
    Ok(graph::task_state(stage, trial, session, &inputs, manifests.get(stage.name, name)))
}

/// The grid, without the files beside the results. A stage downstream of a stale one is stale, too.
pub fn grid(session: &SubjectSession, ws: &Workspace, manifests: &Manifests) -> Result<Status, PipelineError> {
    let states = states(session, ws, manifests)?;
    let behind: HashSet<(String, String)> =
        not_current_of(session, manifests, &states).into_iter().map(|n| (n.stage, n.trial)).collect();
    let word = |stage: &'static str, trial: &str| {
        let key = (stage, trial.to_owned());
        match states.get(&key) {
            None => String::new(),
            Some(s) if s.is_current() && behind.contains(&(stage.to_owned(), key.1)) => "stale".to_owned(),
            Some(s) => s.word().to_owned(),
        }
    };
    let mut rows: Vec<StatusRow> = session
        .trials
        .iter()
        .map(|trial| {
            let excluded = trial.excluded.is_some();
            let cell = |s: &&Stage| if excluded { "excluded".to_owned() } else { word(s.name, &trial.name) };
            let cells = STAGES.iter().map(cell).collect();
            StatusRow { trial: trial.name.clone(), role: trial.role.word().to_owned(), cells }
        })
        .collect();
    let cells = STAGES.iter().map(|s| word(s.name, WHOLE_STUDY)).collect();
    rows.push(StatusRow { trial: WHOLE_STUDY.to_owned(), role: "study".to_owned(), cells });
    Ok(Status { version: 1, stages: STAGES.iter().map(|s| s.name).collect(), rows, files: Vec::new() })
}

/// Reason for the present state of one result.
pub fn explain(session: &SubjectSession, trial: &str, stage: &str) -> Result<Explanation, PipelineError> {
    let stage = STAGES[stage_index(stage)?];
    let ws = Workspace::open(&session.workspace);
    let manifests = Manifests::read_and_examine(session, &ws, STAGES)?;
    let task = stage.tasks(session).into_iter().find(|t| t.map_or(WHOLE_STUDY, |t| t.name.as_str()) == trial);
    let Some(task) = task else {
        let names: Vec<&str> =
            stage.tasks(session).into_iter().map(|t| t.map_or(WHOLE_STUDY, |t| t.name.as_str())).collect();
        return Err(PipelineError::request_hint(
            format!("stage {} does not run for `{trial}`", stage.name),
            aloft_study::nearest::hint(trial, &names, "it runs for"),
        ));
    };
    let states = states(session, &ws, &manifests)?;
    Ok(explanation(stage, task, session, &manifests, &states))
}

/// State of every task, by stage and trial.
pub type TaskStates = HashMap<(&'static str, String), TaskState>;

pub(crate) fn states(
    session: &SubjectSession,
    ws: &Workspace,
    manifests: &Manifests,
) -> Result<TaskStates, PipelineError> {
    let mut all = HashMap::new();
    for stage in STAGES {
        for task in stage.tasks(session) {
            let name = task.map_or(WHOLE_STUDY, |t| t.name.as_str()).to_owned();
            all.insert((stage.name, name), present_state(stage, task, session, ws, manifests)?);
        }
    }
    Ok(all)
}

/// All results that are not up to date, stage by stage: `(stage, trial, why)`; for one trial and
/// what is made from it, or for all.
pub fn explain_all(
    session: &SubjectSession,
    trial: Option<&str>,
) -> Result<Vec<(&'static str, String, Explanation)>, PipelineError> {
    if let Some(name) = trial.filter(|n| *n != WHOLE_STUDY && session.trial(n).is_none()) {
        let names: Vec<&str> = session.trials.iter().map(|t| t.name.as_str()).collect();
        return Err(PipelineError::request_hint(
            format!("there is no trial `{name}`"),
            aloft_study::nearest::hint(name, &names, "the trials are"),
        ));
    }
    let ws = Workspace::open(&session.workspace);
    let manifests = Manifests::read_and_examine(session, &ws, STAGES)?;
    let states = states(session, &ws, &manifests)?;
    let behind: HashSet<(String, String)> =
        not_current_of(session, &manifests, &states).into_iter().map(|n| (n.stage, n.trial)).collect();
    let mut all = Vec::new();
    for stage in STAGES {
        for task in stage.tasks(session) {
            let name = task.map_or(WHOLE_STUDY, |t| t.name.as_str());
            if trial.is_some_and(|t| t != name) {
                continue;
            }
            let key = (stage.name.to_owned(), name.to_owned());
            if !behind.contains(&key) && states.get(&(stage.name, key.1)).is_some_and(TaskState::is_current) {
                continue;
            }
            let found = explanation(stage, task, session, &manifests, &states);
            if !found.state.is_current() || !found.before.is_empty() {
                all.push((stage.name, name.to_owned(), found));
            }
        }
    }
    Ok(all)
}

fn explanation(
    stage: &Stage,
    task: Option<&TrialEntry>,
    session: &SubjectSession,
    manifests: &Manifests,
    states: &TaskStates,
) -> Explanation {
    let name = task.map_or(WHOLE_STUDY, |t| t.name.as_str());
    let of = |stage: &Stage, name: &str| states.get(&(stage.name, name.to_owned()));
    let mut before = Vec::new();
    let mut seen = HashSet::from([(stage.name, name)]);
    let mut open = inputs_of(stage, task, session);
    while let Some((above, task)) = open.pop() {
        let above_name = task.map_or(WHOLE_STUDY, |t| t.name.as_str());
        if !seen.insert((above.name, above_name)) {
            continue;
        }
        if let Some(because) = behind(of(above, above_name)) {
            let of_whom = if task.is_some() { format!(" of {above_name}") } else { String::new() };
            before.push(format!("`{}`{of_whom}: {because}", above.name));
        }
        open.extend(inputs_of(above, task, session));
    }
    before.sort();
    // many trials with the same reason: name only the first few
    if before.len() > 4 {
        let more = before.len() - 3;
        before.truncate(3);
        before.push(format!("… and {more} more before it"));
    }
    Explanation {
        state: of(stage, name).cloned().unwrap_or(TaskState::Missing),
        manifest: manifests.get(stage.name, name).cloned(),
        before,
    }
}

/// Why a result that another one is made from is not up to date; none if it is, or cannot be.
fn behind(state: Option<&TaskState>) -> Option<String> {
    match state? {
        TaskState::Missing => Some("has never run".to_owned()),
        TaskState::Stale(changes) => Some(changes.join("; ")),
        TaskState::Damaged(problems) => Some(format!("is damaged: {}", problems.join("; "))),
        _ => None,
    }
}

/// The tasks whose results a task reads.
pub(crate) fn inputs_of<'s>(
    stage: &Stage,
    task: Option<&'s TrialEntry>,
    session: &'s SubjectSession,
) -> Vec<(&'static Stage, Option<&'s TrialEntry>)> {
    let named = |name: &str| STAGES.iter().copied().find(|s| s.name == name);
    let read = stage.needs.iter().flat_map(|need| need.results(task, session));
    read.filter_map(|(name, of)| Some((named(name)?, of))).collect()
}
