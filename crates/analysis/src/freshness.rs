//! Whether the results that a command shows match the present pipeline and recordings.

use crate::status::{TaskStates, inputs_of, states};
use aloft_pipeline::graph::{DATED, Need, TaskState};
use aloft_pipeline::manifests::Manifests;
use aloft_pipeline::stages::STAGES;
use aloft_study::revision::Revisions;
use aloft_study::subject_session::SubjectSession;
use aloft_workspace::error::PipelineError;
use aloft_workspace::manifest::{Manifest, WHOLE_STUDY};
use aloft_workspace::workspace::Workspace;
use serde::Serialize;
use std::collections::HashSet;

/// A result that differs from what the pipeline and the recordings would give now.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct NotCurrent {
    /// Stage, or `model` for a change of the model's effects that was interrupted.
    pub stage: String,
    /// Trial, or `_study` for a stage that runs once.
    pub trial: String,
    /// `stale`: made from other inputs or settings than the present ones; `missing`: never made;
    /// `damaged`: its files differ from what was written.
    pub state: String,
    /// Why.
    pub because: String,
    /// True if it is stale only because a result upstream is.
    pub follows: bool,
}

/// All results of a study that are not current.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Freshness {
    /// In the order of the stages.
    pub stale: Vec<NotCurrent>,
}

/// An answer together with the results it is based on that are not up to date.
#[derive(Debug, Clone, Serialize)]
pub struct WithStale<T> {
    /// The answer.
    #[serde(flatten)]
    pub answer: T,
    /// Results that differ from what the pipeline and the recordings would give now.
    pub stale: Vec<NotCurrent>,
}

/// Computes an answer from results and adds which of them are not up to date. Damaged results of
/// the stages that the answer `reads` (of all stages if none is named) are refused.
pub fn with_stale<T>(
    session: &SubjectSession,
    reads: &[&str],
    ask: impl FnOnce(&SubjectSession) -> Result<T, PipelineError>,
) -> Result<WithStale<T>, PipelineError> {
    let fresh = freshness(session)?;
    fresh.refuse_damaged(session, reads)?;
    Ok(WithStale { answer: ask(session)?, stale: fresh.stale })
}

/// Checks every result and compares every file with its hash.
pub fn freshness(session: &SubjectSession) -> Result<Freshness, PipelineError> {
    let ws = Workspace::open(&session.workspace);
    let manifests = Manifests::read_and_examine(session, &ws, STAGES)?;
    let mut stale = not_current_of(session, &manifests, &states(session, &ws, &manifests)?);
    if let Some(pending) = Revisions::load(&session.workspace)?.pending {
        stale.insert(
            0,
            NotCurrent {
                stage: "model".to_owned(),
                trial: WHOLE_STUDY.to_owned(),
                state: "stale".to_owned(),
                because: format!("`effect {}` has not ended (it runs, or was interrupted)", pending.action),
                follows: false,
            },
        );
    }
    Ok(Freshness { stale })
}

/// Why one result is not current; none if it is. Files are not compared with their hashes.
pub fn of_result(session: &SubjectSession, stage: &str, trial: &str) -> Result<Option<NotCurrent>, PipelineError> {
    let ws = Workspace::open(&session.workspace);
    let manifests = Manifests::read(session, &ws, STAGES)?;
    let all = not_current_of(session, &manifests, &states(session, &ws, &manifests)?);
    Ok(all.into_iter().find(|n| n.stage == stage && n.trial == trial))
}

/// The same from known task states. A result whose trial failed, or that was blocked by a failure,
/// counts as up to date.
pub fn not_current_of(session: &SubjectSession, manifests: &Manifests, states: &TaskStates) -> Vec<NotCurrent> {
    let is_left = |stage: &str, trial: &str| manifests.get(stage, trial).is_some_and(Manifest::is_ok);
    let mut out: Vec<NotCurrent> = Vec::new();
    let mut behind: HashSet<(&str, &str)> = HashSet::new();
    for stage in STAGES {
        // a recording that is imported again may move the others in the session
        let of_times = || session.included().map(|t| (DATED, t.name.as_str())).find(|above| behind.contains(above));
        let of_times = if stage.needs.contains(&Need::Times) { of_times() } else { None };
        for task in stage.tasks(session) {
            let trial = task.map_or(WHOLE_STUDY, |t| t.name.as_str());
            let Some(state) = states.get(&(stage.name, trial.to_owned())) else { continue };
            let above = inputs_of(stage, task, session)
                .into_iter()
                .map(|(s, t)| (s.name, t.map_or(WHOLE_STUDY, |t| t.name.as_str())))
                .find(|above| behind.contains(above))
                .or(of_times);
            let (state, because, follows) = match (state, above) {
                (TaskState::Damaged(problems), _) => ("damaged", problems.join("; "), false),
                (TaskState::Missing, None) => ("missing", "never run".to_owned(), false),
                (TaskState::Stale(changes), None) => ("stale", changes.join("; "), false),
                (TaskState::Missing, Some((s, t))) => ("missing", follows_from(s, t), true),
                // made before something upstream failed
                (TaskState::Blocked(reason), None) if is_left(stage.name, trial) => {
                    ("stale", format!("cannot be made any more: {reason}"), false)
                }
                (_, Some((s, t))) => ("stale", follows_from(s, t), true),
                _ => continue,
            };
            behind.insert((stage.name, trial));
            out.push(NotCurrent {
                stage: stage.name.to_owned(),
                trial: trial.to_owned(),
                state: state.to_owned(),
                because,
                follows,
            });
        }
    }
    out
}

fn follows_from(stage: &str, trial: &str) -> String {
    if trial == WHOLE_STUDY {
        format!("`{stage}` is not up to date")
    } else {
        format!("`{stage}` of {trial} is not up to date")
    }
}

/// Maximum number of lines of a notice.
const LINES: usize = 4;

impl Freshness {
    /// True when everything is up to date.
    pub fn is_current(&self) -> bool {
        self.stale.is_empty()
    }

    /// A short notice: the results that are out of date by themselves, and how many depend on them.
    pub fn describe(&self) -> Vec<String> {
        let mut groups: Vec<(&NotCurrent, Vec<&str>)> = Vec::new();
        for one in self.stale.iter().filter(|n| !n.follows) {
            match groups
                .iter_mut()
                .find(|(g, _)| (&g.stage, &g.state, &g.because) == (&one.stage, &one.state, &one.because))
            {
                Some((_, trials)) => trials.push(&one.trial),
                None => groups.push((one, vec![&one.trial])),
            }
        }
        let mut out: Vec<String> = groups
            .iter()
            .take(LINES)
            .map(|(one, trials)| {
                let whose = match trials.as_slice() {
                    [WHOLE_STUDY] => String::new(),
                    few if few.len() <= 3 => format!(" of {}", few.join(", ")),
                    many => format!(" of {} trials", many.len()),
                };
                format!("{}: {}{whose}: {}", one.state, one.stage, one.because)
            })
            .collect();
        if groups.len() > LINES {
            out.push(format!("… and {} more reasons; see `aloft explain`", groups.len() - LINES));
        }
        let following = self.stale.iter().filter(|n| n.follows).count();
        if following > 0 {
            let s = if following == 1 { "result follows from it" } else { "results follow from these" };
            out.push(format!("{following} later {s}"));
        }
        out
    }

    /// Refuses to show damaged results of these stages, or of all stages if none is named.
    pub fn refuse_damaged(&self, session: &SubjectSession, stages: &[&str]) -> Result<(), PipelineError> {
        let read = |n: &&NotCurrent| n.state == "damaged" && (stages.is_empty() || stages.contains(&n.stage.as_str()));
        let Some(one) = self.stale.iter().find(read) else { return Ok(()) };
        let ws = Workspace::open(&session.workspace);
        Err(PipelineError::request_hint(
            format!("{} is damaged: {}", ws.place(&one.stage, &one.trial).display(), one.because),
            format!("`aloft run {}` makes it again", session.config_path.display()),
        ))
    }
}
