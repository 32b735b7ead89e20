//! The manifests of a workspace, read once, and what follows from them for the whole study: which
//! results may be used, which recordings are copies, and when each was made.

use crate::graph::{DATED, Need, Stage};
use crate::stages::STAGES;
use aloft_study::calendar::Calendar;
use aloft_study::subject_session::{SubjectSession, TrialEntry};
use aloft_trial::SessionSource;
use aloft_workspace::error::PipelineError;
use aloft_workspace::manifest::{Manifest, WHOLE_STUDY};
use aloft_workspace::workspace::Workspace;
use rayon::prelude::*;
use std::collections::HashMap;
use std::sync::{Arc, Mutex, OnceLock, PoisonError};

/// The manifests of a workspace, read once.
#[derive(Debug, Default)]
pub struct Manifests {
    /// By stage, then by trial.
    all: HashMap<String, HashMap<String, Manifest>>,
    /// Times of the session, computed when the first task asks for its own.
    times: OnceLock<Times>,
    /// Copies among the recordings of one size, each with the recording that it repeats; found when
    /// the first task of that size asks.
    copies: Mutex<HashMap<u64, HashMap<String, String>>>,
}

/// Times of a session for the tasks that depend on them.
#[derive(Debug)]
pub(crate) struct Times {
    /// None if they are damaged.
    calendar: Option<Calendar>,
    /// Whether the source of the times is part of a result: effects of the model grow over the
    /// session, and a remark says how the times were found.
    source_matters: bool,
    /// Recordings whose imports are damaged, so that their times cannot be relied on.
    pub(crate) damaged: Vec<String>,
}

impl Times {
    fn of(session: &SubjectSession, workspace: &Workspace) -> Result<Self, PipelineError> {
        let calendar = match Calendar::of(session, workspace) {
            Err(e @ PipelineError::Io { .. }) => return Err(e),
            // none: the imports are named as damaged
            other => other.ok(),
        };
        let mut damaged: Vec<String> = Vec::new();
        for trial in session.included() {
            damaged.extend((!workspace.damage(DATED, &trial.name)?.is_empty()).then(|| trial.name.clone()));
        }
        if calendar.is_none() && damaged.is_empty() {
            damaged.extend(session.included().map(|t| t.name.clone()));
        }
        Ok(Self { calendar, source_matters: session.model_effects().recordings.is_some(), damaged })
    }

    /// The calendar of one recording alone, and the text that stands for it among the inputs; none
    /// where nothing depends on it.
    pub(crate) fn of_trial(&self, trial: &str) -> Option<(Arc<Calendar>, String)> {
        let own = self.calendar.as_ref()?.only(trial)?;
        let mut key = format!("{} s", own.start_s(trial));
        if self.source_matters && own.source == SessionSource::OrderAndLengths {
            key = format!("{key}, from {}", own.words);
        }
        Some((Arc::new(own), key))
    }
}

impl Manifests {
    /// Reads every manifest that the stages of a study may have written.
    ///
    /// # Errors
    /// One is there and cannot be read.
    pub fn read(session: &SubjectSession, workspace: &Workspace, stages: &[&Stage]) -> Result<Self, PipelineError> {
        let mut out = Self::default();
        for stage in stages {
            for task in stage.tasks(session) {
                out.all_of(workspace, stage.name, task.map_or(WHOLE_STUDY, |t| &t.name))?;
            }
        }
        Ok(out)
    }

    /// Manifests of the given results.
    ///
    /// # Errors
    /// One is there and cannot be read.
    pub fn of(workspace: &Workspace, results: &[(&str, &str)]) -> Result<Self, PipelineError> {
        let mut out = Self::default();
        for (stage, trial) in results {
            out.all_of(workspace, stage, trial)?;
        }
        Ok(out)
    }

    fn all_of(&mut self, workspace: &Workspace, stage: &str, trial: &str) -> Result<(), PipelineError> {
        if let Some(m) = workspace.manifest(stage, trial)? {
            self.all.entry(stage.to_owned()).or_default().insert(trial.to_owned(), m);
        }
        Ok(())
    }

    /// Like [`Manifests::read`], but also compares every file of the results with its hash, in
    /// parallel.
    ///
    /// # Errors
    /// A file is there and cannot be read.
    pub fn read_and_examine(
        session: &SubjectSession,
        workspace: &Workspace,
        stages: &[&Stage],
    ) -> Result<Self, PipelineError> {
        let tasks: Vec<(&str, &str)> = stages
            .iter()
            .flat_map(|s| s.tasks(session).into_iter().map(|t| (s.name, t.map_or(WHOLE_STUDY, |t| t.name.as_str()))))
            .collect();
        tasks.par_iter().try_for_each(|(stage, trial)| workspace.damage(stage, trial).map(|_| ()))?;
        Self::read(session, workspace, stages)
    }

    /// The manifest of a result.
    pub fn get(&self, stage: &str, trial: &str) -> Option<&Manifest> {
        self.all.get(stage)?.get(trial)
    }

    /// Why a result must not be used: it failed or is missing, or something that it was made from
    /// (of the same trial or of the whole study) has failed since. A result made before its
    /// recording became unusable is therefore not used any more.
    pub fn trouble(&self, stage: &str, trial: &str) -> Option<String> {
        match self.get(stage, trial) {
            None => return Some(format!("{stage} has not run")),
            Some(m) if !m.is_ok() => return Some(format!("{stage} failed")),
            Some(_) => {}
        }
        let needs = STAGES.iter().find(|s| s.name == stage).map_or(&[][..], |s| s.needs);
        needs.iter().find_map(|need| match need {
            Need::Same(above) => self.trouble(above, trial),
            Need::Once(above) => self.trouble(above, WHOLE_STUDY),
            Need::Recording | Need::Every(..) | Need::Merged(..) | Need::EveryOrStaticFrames(..) | Need::Times => None,
        })
    }

    /// Adds a manifest.
    pub fn insert(&mut self, manifest: Manifest) {
        if manifest.stage == DATED {
            self.times = OnceLock::new();
        }
        self.all.entry(manifest.stage.clone()).or_default().insert(manifest.trial.clone(), manifest);
    }

    /// Times of the session's recordings, from their imports.
    pub(crate) fn times(&self, session: &SubjectSession, workspace: &Workspace) -> Result<&Times, PipelineError> {
        if let Some(times) = self.times.get() {
            return Ok(times);
        }
        let times = Times::of(session, workspace)?;
        Ok(self.times.get_or_init(|| times))
    }

    /// The first moving recording of the session that holds the same bytes as `trial`, if it stands
    /// before it: copies would count as independent evidence. Recordings that cannot be read are
    /// copies of none.
    pub(crate) fn copied_from(
        &self,
        trial: &TrialEntry,
        session: &SubjectSession,
        workspace: &Workspace,
    ) -> Option<String> {
        let (size, alike) = session.of_same_size(trial).filter(|_| trial.role.is_dynamic())?;
        let mut known = self.copies.lock().unwrap_or_else(PoisonError::into_inner);
        known.entry(size).or_insert_with(|| copies(&alike, workspace)).get(&trial.name).cloned()
    }
}

/// Copies among recordings of one size, each with the first moving recording that it repeats.
fn copies(alike: &[&TrialEntry], workspace: &Workspace) -> HashMap<String, String> {
    let moving: Vec<&TrialEntry> = alike.iter().copied().filter(|t| t.role.is_dynamic()).collect();
    let mut out = HashMap::new();
    if moving.len() < 2 {
        return out;
    }
    let mut by_hash: HashMap<String, Vec<&TrialEntry>> = HashMap::new();
    for trial in moving {
        // none: its import reports a recording that cannot be read
        let Ok(hash) = workspace.input_hash(&trial.file) else { continue };
        let same = by_hash.entry(hash).or_default();
        // one file may serve several trials
        if let Some(first) = same.iter().find(|t| t.file != trial.file) {
            out.insert(trial.name.clone(), first.name.clone());
        }
        same.push(trial);
    }
    out
}
