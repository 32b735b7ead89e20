//! What a run did: the outcome of each task, of each study, and of all studies together.

use aloft_study::recordings::SessionId;
use aloft_workspace::error::{PipelineError, StageFailure};
use aloft_workspace::warning::StageWarning;

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
    /// Trial, or [`WHOLE_STUDY`](aloft_workspace::manifest::WHOLE_STUDY).
    pub trial: String,
    /// Outcome.
    pub ended: Ended,
    /// Warnings.
    pub warnings: Vec<StageWarning>,
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
        // none: `runs` holds the reasons of the others
        self.runs.iter().filter_map(|r| r.report.as_ref().ok().map(|report| (&r.id, report)))
    }
    /// True if some task failed or could not run, or some study could not begin.
    pub fn has_trouble(&self) -> bool {
        // none: an error is trouble
        self.runs.iter().any(|r| match &r.report {
            Ok(report) => report.has_trouble(),
            Err(_) => true,
        })
    }
}
