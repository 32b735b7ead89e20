//! The stage graph: what each stage reads, which parameters it sees, and which tasks a study consists of.

use crate::error::{PipelineError, StageFailure};
use crate::stages::STAGES;
use crate::study::{Role, Study, TrialEntry};
use crate::workspace::{Manifest, WHOLE_STUDY, Workspace};
use std::collections::{BTreeMap, HashMap};
use std::path::Path;

/// Whether a stage runs once a trial or once a study.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Scope {
    /// Once for each trial of the given roles.
    Trial(&'static [Role]),
    /// Once.
    Study,
}

/// One thing that a stage reads.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Need {
    /// The recording's files.
    Recording,
    /// A stage's result for the same trial.
    Same(&'static str),
    /// A study-wide stage's result.
    Once(&'static str),
    /// A stage's results for all trials of the given roles (those that succeeded).
    Every(&'static str, &'static [Role]),
    /// As `Every`, and also the trial that `trials.static_frames` names.
    EveryOrStaticFrames(&'static str, &'static [Role]),
}

/// What a stage hands back beside its files.
#[derive(Debug, Clone, Default)]
pub struct Done {
    /// What was odd, in words.
    pub warnings: Vec<String>,
    /// Figures for tables.
    pub summary: BTreeMap<String, serde_json::Value>,
}

impl Done {
    /// Adds a figure.
    pub fn note(&mut self, key: &str, value: impl Into<serde_json::Value>) {
        self.summary.insert(key.to_owned(), value.into());
    }
}

/// A stage: its documentation, its place in the graph and its function.
#[derive(Debug)]
pub struct Stage {
    /// Name that users type.
    pub name: &'static str,
    /// Raised whenever the code's results change.
    pub version: u32,
    /// Once a trial or once.
    pub scope: Scope,
    /// What it reads, for people.
    pub reads: &'static str,
    /// What it gives, for people.
    pub gives: &'static str,
    /// What it reads, for the graph.
    pub needs: &'static [Need],
    /// The parameters that it sees.
    pub parameters: fn(&Study, Option<&TrialEntry>) -> serde_json::Value,
    /// The work: reads through the job, writes into `job.out`.
    pub run: fn(&Job<'_>) -> Result<Done, StageFailure>,
}

impl Stage {
    /// Trials for which the stage runs; the whole study counts as one.
    pub fn tasks<'s>(&self, study: &'s Study) -> Vec<Option<&'s TrialEntry>> {
        match self.scope {
            Scope::Study => vec![None],
            Scope::Trial(roles) => study.included().filter(|t| roles.contains(&t.role)).map(Some).collect(),
        }
    }
}

/// All that a stage's function may use.
#[derive(Debug)]
pub struct Job<'a> {
    /// The study.
    pub study: &'a Study,
    /// The trial, for stages that run once a trial.
    pub trial: Option<&'a TrialEntry>,
    /// Where upstream results lie.
    pub workspace: &'a Workspace,
    /// Upstream results that succeeded: `(stage, trial)`.
    pub inputs: &'a [(String, String)],
    /// Where to write.
    pub out: &'a Path,
}

impl Job<'_> {
    /// Names of the trials for which `stage` is among the inputs, sorted.
    pub fn trials_of(&self, stage: &str) -> Vec<String> {
        self.inputs.iter().filter(|(s, t)| s == stage && t != WHOLE_STUDY).map(|(_, t)| t.clone()).collect()
    }
    /// The trial; an error for stages without one (which would be a defect of the stage's definition).
    pub fn trial(&self) -> Result<&TrialEntry, StageFailure> {
        self.trial.ok_or_else(|| StageFailure::new("the stage was called without a trial"))
    }
}

/// One task's inputs as they stand now.
#[derive(Debug, Clone)]
pub struct Inputs {
    /// Hash of each input.
    pub hashes: BTreeMap<String, String>,
    /// Upstream results that can be read.
    pub ready: Vec<(String, String)>,
    /// Upstream results without which the task cannot run, with the reason.
    pub blocked_by: Vec<String>,
}

/// The manifests of a workspace, read once.
#[derive(Debug, Default)]
pub struct Manifests(HashMap<(String, String), Manifest>);

impl Manifests {
    /// Reads every manifest that the stages of a study may have left.
    pub fn read(study: &Study, workspace: &Workspace, stages: &[&Stage]) -> Self {
        let mut all = HashMap::new();
        for stage in stages {
            for task in stage.tasks(study) {
                let trial = task.map_or(WHOLE_STUDY, |t| &t.name);
                if let Some(m) = workspace.manifest(stage.name, trial) {
                    all.insert((stage.name.to_owned(), trial.to_owned()), m);
                }
            }
        }
        Self(all)
    }
    /// The manifest of a result.
    pub fn get(&self, stage: &str, trial: &str) -> Option<&Manifest> {
        self.0.get(&(stage.to_owned(), trial.to_owned()))
    }
    /// Why a result must not be used: it failed or is missing, or something that it was made from (of the same trial or of the whole
    /// study) has failed since. Results that were made before a recording broke do not outlive it.
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
            Need::Recording | Need::Every(..) | Need::EveryOrStaticFrames(..) => None,
        })
    }
    /// Puts a manifest in.
    pub fn insert(&mut self, manifest: Manifest) {
        self.0.insert((manifest.stage.clone(), manifest.trial.clone()), manifest);
    }
}

/// Gathers what a task reads.
pub fn inputs(
    stage: &Stage,
    trial: Option<&TrialEntry>,
    study: &Study,
    workspace: &Workspace,
    manifests: &Manifests,
) -> Result<Inputs, PipelineError> {
    let mut out = Inputs { hashes: BTreeMap::new(), ready: Vec::new(), blocked_by: Vec::new() };
    let upstream = |out: &mut Inputs, name: &str, of: &str, required: bool| match (
        manifests.get(name, of),
        manifests.trouble(name, of),
    ) {
        (Some(m), None) => {
            out.hashes.insert(format!("{name}/{of}"), m.output.clone());
            out.ready.push((name.to_owned(), of.to_owned()));
        }
        (_, Some(reason)) if required => out.blocked_by.push(reason),
        _ => {}
    };
    for need in stage.needs {
        match need {
            Need::Recording => {
                if let Some(t) = trial {
                    for path in std::iter::once(&t.file).chain(&t.forces).chain(&t.beside) {
                        let name = path.file_name().map(|n| n.to_string_lossy().into_owned()).unwrap_or_default();
                        out.hashes.insert(format!("file {name}"), workspace.input_hash(path)?);
                    }
                }
            }
            Need::Same(name) => {
                if let Some(t) = trial {
                    upstream(&mut out, name, &t.name, true);
                }
            }
            Need::Once(name) => upstream(&mut out, name, WHOLE_STUDY, true),
            Need::Every(name, roles) => {
                for t in study.included().filter(|t| roles.contains(&t.role)) {
                    upstream(&mut out, name, &t.name, false);
                }
            }
            Need::EveryOrStaticFrames(name, roles) => {
                let named = study.config.trials.static_frames.as_ref().map(|f| f.trial.as_str());
                for t in study.included().filter(|t| roles.contains(&t.role) || named == Some(t.name.as_str())) {
                    upstream(&mut out, name, &t.name, false);
                }
            }
        }
    }
    Ok(out)
}

/// How a task stands.
#[derive(Debug, Clone, PartialEq)]
pub enum Standing {
    /// Up to date, without remarks.
    Ok,
    /// Up to date, with remarks.
    Warning,
    /// Never run.
    Missing,
    /// Made from something else than what is there now: what changed.
    Stale(Vec<String>),
    /// Ran and failed.
    Failed(StageFailure),
    /// Cannot run, because of this.
    Blocked(String),
}

impl Standing {
    /// The word in the grid.
    pub fn word(&self) -> &'static str {
        match self {
            Self::Ok => "ok",
            Self::Warning => "warning",
            Self::Missing => "missing",
            Self::Stale(_) => "stale",
            Self::Failed(_) => "failed",
            Self::Blocked(_) => "blocked",
        }
    }
    /// True when nothing needs to be done.
    pub fn is_current(&self) -> bool {
        matches!(self, Self::Ok | Self::Warning)
    }
}

/// Compares a task's manifest with what is there now.
pub fn standing(
    stage: &Stage,
    trial: Option<&TrialEntry>,
    study: &Study,
    inputs: &Inputs,
    manifest: Option<&Manifest>,
) -> Standing {
    if let Some(reason) = inputs.blocked_by.first() {
        return Standing::Blocked(reason.clone());
    }
    let Some(m) = manifest else { return Standing::Missing };
    let changes = m.differences(stage.version, &(stage.parameters)(study, trial), &inputs.hashes);
    if !changes.is_empty() {
        return Standing::Stale(changes);
    }
    match &m.outcome {
        crate::workspace::Outcome::Failed(f) => Standing::Failed(f.clone()),
        crate::workspace::Outcome::Ok if m.warnings.is_empty() => Standing::Ok,
        crate::workspace::Outcome::Ok => Standing::Warning,
    }
}
