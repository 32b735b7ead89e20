//! Selection of what to run: stages, trials, and how the workspace is held.

use crate::stages::STAGES;
use aloft_study::subject_session::SubjectSession;
use aloft_workspace::error::PipelineError;
use globset::{Glob, GlobSet, GlobSetBuilder};
use std::time::Duration;

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
    /// How long to wait for another run that holds the workspace.
    pub(crate) fn patience(&self) -> Duration {
        if self.wait { Duration::MAX } else { Duration::ZERO }
    }

    /// True for a run that needs the workspace for itself.
    pub(crate) fn alone(&self) -> bool {
        !self.dry_run && !self.shared
    }
}

/// Index of the stage with this name; an error that lists all stages if there is none.
pub fn stage_index(name: &str) -> Result<usize, PipelineError> {
    STAGES.iter().position(|s| s.name == name).ok_or_else(|| {
        let known: Vec<&str> = STAGES.iter().map(|s| s.name).collect();
        PipelineError::request_hint(
            format!("there is no stage `{name}`"),
            aloft_study::nearest::hint(name, &known, "the stages are"),
        )
    })
}

/// Indices of the first selected stage and of the one after the last.
pub(crate) fn stage_range(selection: &Selection) -> Result<(usize, usize), PipelineError> {
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
            aloft_study::nearest::hint(&patterns[0], &names, "the trials are"),
        ));
    }
    Ok(Some(set))
}
