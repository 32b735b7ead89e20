//! The stage graph: which results and parameters each stage reads, and the tasks of a study.

use crate::manifests::Manifests;
use crate::results::{Ready, Results};
use aloft_study::calendar::Calendar;
use aloft_study::subject_session::{Role, SubjectSession, TrialEntry};
use aloft_workspace::error::{PipelineError, StageFailure};
use aloft_workspace::key::key;
use aloft_workspace::manifest::{Manifest, ROLE, TIME, WHOLE_STUDY};
use aloft_workspace::qc::QcReason;
use aloft_workspace::warning::Warnings;
use aloft_workspace::workspace::Workspace;
use serde::Serialize;
use serde_json::Value;
use std::collections::{BTreeMap, BTreeSet, HashMap};
use std::path::{Path, PathBuf};
use std::sync::{Arc, OnceLock};

/// Whether a stage runs once per trial or once per study.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Scope {
    /// Once for each trial of the given roles.
    Trial(&'static [Role]),
    /// Once per study.
    Session,
}

/// One input of a stage.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Need {
    /// Files of the recording.
    Recording,
    /// Result of a stage for the same trial.
    Same(&'static str),
    /// Result of a study-wide stage.
    Once(&'static str),
    /// Results of a stage for all trials of the given roles (those that succeeded).
    Every(&'static str, &'static [Role]),
    /// As `Every`, for a stage that gives factors; flights are read merged in a tree.
    Merged(&'static str, &'static [Role]),
    /// As `Every`, and also the trial named by `trials.static_frames`.
    EveryOrStaticFrames(&'static str, &'static [Role]),
    /// When in the session the trial was recorded. It follows from the imports of all recordings,
    /// but only the trial's own time is part of its key: another recording does not make the result
    /// stale unless it moves this one.
    Times,
}

/// Stage whose results tell when the recordings of a session were made.
pub const DATED: &str = "import";

impl Need {
    /// The stage whose results are read; none for recordings.
    pub fn stage(&self) -> Option<&'static str> {
        match self {
            Self::Recording => None,
            Self::Times => Some(DATED),
            Self::Same(name)
            | Self::Once(name)
            | Self::Every(name, _)
            | Self::Merged(name, _)
            | Self::EveryOrStaticFrames(name, _) => Some(name),
        }
    }
    /// Results that are read for a task of `trial`: the stage and the trial of each, `None` for the
    /// whole study. Empty for recordings and for times.
    pub fn results<'s>(
        &self,
        trial: Option<&'s TrialEntry>,
        session: &'s SubjectSession,
    ) -> Vec<(&'static str, Option<&'s TrialEntry>)> {
        let statics = session.config.trials.static_frames.as_ref().map(|f| f.trial.as_str());
        match *self {
            Self::Recording | Self::Times => Vec::new(),
            Self::Same(name) => trial.map(|t| (name, Some(t))).into_iter().collect(),
            Self::Once(name) => vec![(name, None)],
            Self::Every(name, roles) | Self::Merged(name, roles) => {
                session.included().filter(|t| roles.contains(&t.role)).map(|t| (name, Some(t))).collect()
            }
            Self::EveryOrStaticFrames(name, roles) => session
                .included()
                .filter(|t| roles.contains(&t.role) || statics == Some(t.name.as_str()))
                .map(|t| (name, Some(t)))
                .collect(),
        }
    }
}

/// Hash of the stored results of a list, each by stage and trial (`None`: the whole study); a
/// result that does not exist counts as empty.
///
/// # Errors
/// A manifest is there and cannot be read.
pub fn results_hash<'s>(
    workspace: &Workspace,
    results: impl IntoIterator<Item = (&'static str, Option<&'s TrialEntry>)>,
) -> Result<blake3::Hash, PipelineError> {
    let named: BTreeSet<(&str, &str)> =
        results.into_iter().map(|(stage, t)| (stage, t.map_or(WHOLE_STUDY, |t| t.name.as_str()))).collect();
    let mut hasher = blake3::Hasher::new();
    for (stage, trial) in named {
        let output = workspace.output(stage, trial)?;
        hasher.update(format!("{stage}/{trial} {output}\n").as_bytes());
    }
    Ok(hasher.finalize())
}

/// What a stage returns besides its files.
#[derive(Debug, Clone, Default)]
pub struct StageReport {
    /// Warnings.
    pub warnings: Warnings,
    /// Figures for tables.
    pub summary: BTreeMap<String, Value>,
}

impl StageReport {
    /// Adds a figure.
    pub fn note(&mut self, key: &str, value: impl Into<Value>) {
        self.summary.insert(key.to_owned(), value.into());
    }
}

/// The work of a stage. Everything that it may know of the study is in its parameters, which are
/// also the cache key.
pub trait StageWork {
    /// The parameters that the stage reads. Serialised, they are the cache key: a result becomes
    /// stale when they change.
    type Params: Serialize;

    /// Takes the parameters from the study; `trial` is given for stages that run once per trial.
    fn params(session: &SubjectSession, trial: Option<&TrialEntry>) -> Self::Params;

    /// Computes the result: reads through `inputs`, writes into `inputs.out`.
    ///
    /// # Errors
    /// Any problem that makes the result impossible, with a hint for the user.
    fn run(params: &Self::Params, inputs: &StageInputs<'_>) -> Result<StageReport, StageFailure>;
}

/// A stage: its documentation, its inputs and its work.
#[derive(Debug)]
pub struct Stage {
    /// Name that users type.
    pub name: &'static str,
    /// Version; to be raised whenever the results of the code change.
    pub version: u32,
    /// Once per trial or once per study.
    pub scope: Scope,
    /// Rough wall time of a task before any was measured, s: only the ratios matter.
    pub seconds: f64,
    /// Inputs, in words for the documentation.
    pub reads: &'static str,
    /// Results, in words for the documentation.
    pub gives: &'static str,
    /// Inputs, for the graph.
    pub needs: &'static [Need],
    /// The parameters as stored in a manifest: [`parameters_of`] the stage's work.
    pub parameters: fn(&SubjectSession, Option<&TrialEntry>) -> Value,
    /// The work: [`run_of`] it.
    pub run: fn(&SubjectSession, Option<&TrialEntry>, &StageInputs<'_>) -> Result<StageReport, StageFailure>,
}

/// Parameters of a stage's work as stored in a manifest.
pub fn parameters_of<W: StageWork>(session: &SubjectSession, trial: Option<&TrialEntry>) -> Value {
    key(&W::params(session, trial))
}

/// Runs a stage's work with the parameters taken from the study.
///
/// # Errors
/// As [`StageWork::run`].
pub fn run_of<W: StageWork>(
    session: &SubjectSession,
    trial: Option<&TrialEntry>,
    inputs: &StageInputs<'_>,
) -> Result<StageReport, StageFailure> {
    W::run(&W::params(session, trial), inputs)
}

impl Stage {
    /// Trials for which the stage runs; a study-wide stage has one task, without a trial.
    pub fn tasks<'s>(&self, session: &'s SubjectSession) -> Vec<Option<&'s TrialEntry>> {
        match self.scope {
            Scope::Session => vec![None],
            Scope::Trial(roles) => session.included().filter(|t| roles.contains(&t.role)).map(Some).collect(),
        }
    }
}

/// Files of a recording.
#[derive(Debug, Clone)]
pub struct Recording {
    /// The trial's name.
    pub name: String,
    /// C3D, TRC or BIDS-Motion file.
    pub file: PathBuf,
    /// MOT file with forces, for TRC.
    pub forces: Option<PathBuf>,
    /// The recording of the same session, before this one, that holds the same bytes.
    pub copy_of: Option<String>,
}

impl Recording {
    /// The recording of a trial.
    pub fn of(trial: &TrialEntry) -> Self {
        Self { name: trial.name.clone(), file: trial.file.clone(), forces: trial.forces.clone(), copy_of: None }
    }
}

/// Everything that the work of a stage may use besides its parameters.
#[derive(Debug)]
pub struct StageInputs<'a> {
    /// The results that the stage declares as inputs.
    pub results: Results<'a>,
    /// Folder to write into.
    pub out: &'a Path,
    /// Name of the trial, for stages that run once per trial.
    trial: Option<&'a str>,
    recording: Option<Recording>,
    ready: &'a Ready,
    calendar: Option<&'a Arc<Calendar>>,
    session: &'a SubjectSession,
    /// Roles by name, for stages that ask for many.
    roles: OnceLock<HashMap<&'a str, Role>>,
    /// Folder of an earlier result of the same task, if that result is intact.
    earlier: Option<PathBuf>,
}

impl<'a> StageInputs<'a> {
    /// Inputs of one task.
    pub(crate) fn new(
        stage: &Stage,
        trial: Option<&'a TrialEntry>,
        session: &'a SubjectSession,
        workspace: &'a Workspace,
        inputs: &'a TaskInputs,
        out: &'a Path,
    ) -> Self {
        let ready = &inputs.ready;
        let name = trial.map_or(WHOLE_STUDY, |t| t.name.as_str());
        // none: what cannot be read is not reused
        let sound = workspace.damage(stage.name, name).is_ok_and(|found| found.is_empty());
        Self {
            results: Results::limited(workspace, ready),
            out,
            trial: trial.map(|t| t.name.as_str()),
            recording: trial
                .filter(|_| stage.needs.contains(&Need::Recording))
                .map(|t| Recording { copy_of: inputs.copy_of.clone(), ..Recording::of(t) }),
            ready,
            calendar: inputs.calendar.as_ref(),
            session,
            roles: OnceLock::new(),
            earlier: sound.then(|| workspace.place(stage.name, name)),
        }
    }

    /// Names of the trials whose result of `stage` is among the inputs, sorted.
    pub fn trials_of(&self, stage: &str) -> Vec<String> {
        self.all().iter().filter(|(s, t)| s == stage && t != WHOLE_STUDY).map(|(_, t)| t.clone()).collect()
    }

    /// The same with the trials' roles, only for the roles wanted.
    pub fn trials_with_role(&self, stage: &str, wanted: impl Fn(Role) -> bool) -> Vec<String> {
        self.trials_of(stage).into_iter().filter(|t| self.role(t).is_some_and(&wanted)).collect()
    }

    /// True if a result is among the inputs.
    pub fn has(&self, stage: &str, trial: &str) -> bool {
        self.ready.has(stage, trial)
    }

    /// All inputs: `(stage, trial)`.
    pub fn all(&self) -> &[(String, String)] {
        self.ready.all()
    }

    /// Role of a trial.
    pub fn role(&self, trial: &str) -> Option<Role> {
        let roles = || self.session.included().map(|t| (t.name.as_str(), t.role)).collect();
        self.roles.get_or_init(roles).get(trial).copied()
    }

    /// Every trial of the study that is not excluded, with its role, whether or not its results
    /// exist; for messages and for the order of merging.
    pub fn expected(&self) -> Vec<(String, Role)> {
        self.session.included().map(|t| (t.name.clone(), t.role)).collect()
    }

    /// When in the session the recording was made.
    ///
    /// # Errors
    /// The stage does not declare that it depends on it.
    pub fn calendar(&self) -> Result<Arc<Calendar>, StageFailure> {
        self.calendar.cloned().ok_or_else(|| StageFailure::new("the stage was called without a time in the session"))
    }

    /// Folder of the recordings, for messages.
    pub fn data(&self) -> &Path {
        &self.session.data
    }

    /// Folder of an earlier result of the same task, if that result is intact. Anything reused from
    /// it must carry its own key.
    pub fn earlier(&self) -> Option<&Path> {
        self.earlier.as_deref()
    }

    /// Name of the trial; an error for a stage without one (a mistake in the stage's definition).
    pub fn trial(&self) -> Result<&'a str, StageFailure> {
        self.trial.ok_or_else(|| StageFailure::new("the stage was called without a trial"))
    }

    /// The recording; an error for a copy of another one of the session, and for a stage that does
    /// not declare it as an input.
    pub fn recording(&self) -> Result<&Recording, StageFailure> {
        let recording = self.recording.as_ref();
        let recording = recording.ok_or_else(|| StageFailure::new("the stage was called without a recording"))?;
        match &recording.copy_of {
            None => Ok(recording),
            Some(first) => Err(StageFailure {
                problem: format!(
                    "{} has the same content as the recording {first}; the same data must not count twice",
                    recording.file.display()
                ),
                hint: Some(format!(
                    "delete the copy, or exclude it: `trials: {{exclude: [{{trial: {}, reason: copy}}]}}`",
                    recording.name
                )),
                reason: Some(QcReason::CopiedRecording),
            }),
        }
    }
}

/// Present state of the inputs of one task.
#[derive(Debug, Clone)]
pub struct TaskInputs {
    /// Hash of each input.
    pub hashes: BTreeMap<String, String>,
    /// Upstream results that can be read.
    pub ready: Ready,
    /// When in the session the task's recording was made, for stages that depend on it.
    pub calendar: Option<Arc<Calendar>>,
    /// The recording of the same session, before this task's, that holds the same bytes.
    pub copy_of: Option<String>,
    /// Missing upstream results that prevent the task from running, with the reasons.
    pub blocked_by: Vec<String>,
    /// Damaged upstream results: they must be made again before they are read.
    pub damaged: Vec<String>,
    /// Problems in the files of the task's own result.
    pub own_damage: Vec<String>,
}

/// In place of the hash of an input that cannot be read.
const UNREADABLE: &str = "unreadable";

/// Collects the inputs of a task.
pub fn inputs(
    stage: &Stage,
    trial: Option<&TrialEntry>,
    session: &SubjectSession,
    workspace: &Workspace,
    manifests: &Manifests,
) -> Result<TaskInputs, PipelineError> {
    let own = trial.map_or(WHOLE_STUDY, |t| t.name.as_str());
    let mut out = TaskInputs {
        hashes: BTreeMap::new(),
        ready: Ready::default(),
        calendar: None,
        copy_of: None,
        blocked_by: Vec::new(),
        damaged: Vec::new(),
        own_damage: workspace.damage(stage.name, own)?,
    };
    let upstream = |out: &mut TaskInputs, name: &str, of: &str, required: bool| {
        if !workspace.damage(name, of)?.is_empty() {
            out.damaged.push(if of == WHOLE_STUDY { format!("`{name}`") } else { format!("`{name}` for {of}") });
        }
        match (manifests.get(name, of), manifests.trouble(name, of)) {
            (Some(m), None) => {
                out.hashes.insert(format!("{name}/{of}"), m.output.clone());
                out.ready.push(name, of);
                Ok::<_, PipelineError>(true)
            }
            (_, Some(reason)) if required => {
                out.blocked_by.push(reason);
                Ok(false)
            }
            _ => Ok(false),
        }
    };
    for need in stage.needs {
        match need {
            Need::Recording => {
                if let Some(t) = trial {
                    out.copy_of = manifests.copied_from(t, session, workspace);
                    if let Some(first) = &out.copy_of {
                        out.hashes.insert(format!("copy of {first}"), String::new());
                    }
                    for path in std::iter::once(&t.file).chain(&t.forces).chain(&t.beside) {
                        let name = path.file_name().map(|n| n.to_string_lossy().into_owned()).unwrap_or_default();
                        // forces may be in another folder under the same name
                        let again = (2..).map(|i| format!("file {name} ({i})"));
                        let key = std::iter::once(format!("file {name}")).chain(again);
                        // the stage that reads it says why it cannot; once it can be read again,
                        // the hash differs and the stage runs
                        // none: the stage that reads it says why it cannot
                        let hash = workspace.input_hash(path).unwrap_or_else(|_| UNREADABLE.to_owned());
                        if let Some(key) = key.into_iter().find(|k| !out.hashes.contains_key(k)) {
                            out.hashes.insert(key, hash);
                        }
                    }
                }
            }
            Need::Times => {
                let times = manifests.times(session, workspace)?;
                out.damaged.extend(times.damaged.iter().map(|t| format!("`{DATED}` for {t}")));
                if let Some((own, key)) = trial.and_then(|t| times.of_trial(&t.name)) {
                    out.hashes.insert(TIME.to_owned(), key);
                    out.calendar = Some(own);
                }
            }
            Need::Same(_) | Need::Once(_) => {
                for (name, of) in need.results(trial, session) {
                    upstream(&mut out, name, of.map_or(WHOLE_STUDY, |t| &t.name), true)?;
                }
            }
            Need::Every(..) | Need::Merged(..) | Need::EveryOrStaticFrames(..) => {
                for (name, of) in need.results(trial, session) {
                    if let Some(t) = of
                        && upstream(&mut out, name, &t.name, false)?
                    {
                        out.hashes.insert(format!("{ROLE}{}", t.name), t.role.word().to_owned());
                    }
                }
            }
        }
    }
    Ok(out)
}

/// State of a task.
#[derive(Debug, Clone, PartialEq)]
pub enum TaskState {
    /// Up to date, without warnings.
    Ok,
    /// Up to date, with warnings.
    Warning,
    /// Never run.
    Missing,
    /// Made from other inputs or settings than the present ones: what changed.
    Stale(Vec<String>),
    /// Its files differ from what was written: the problems found.
    Damaged(Vec<String>),
    /// Ran and failed.
    Failed(StageFailure),
    /// Cannot run, for this reason.
    Blocked(String),
}

impl TaskState {
    /// Word in the status grid.
    pub fn word(&self) -> &'static str {
        match self {
            Self::Ok => "ok",
            Self::Warning => "warning",
            Self::Missing => "missing",
            Self::Stale(_) => "stale",
            Self::Damaged(_) => "damaged",
            Self::Failed(_) => "failed",
            Self::Blocked(_) => "blocked",
        }
    }
    /// True if nothing needs to be done.
    pub fn is_current(&self) -> bool {
        matches!(self, Self::Ok | Self::Warning)
    }
}

/// Compares a task's manifest with its present inputs.
pub fn task_state(
    stage: &Stage,
    trial: Option<&TrialEntry>,
    session: &SubjectSession,
    inputs: &TaskInputs,
    manifest: Option<&Manifest>,
) -> TaskState {
    if let Some(reason) = inputs.blocked_by.first() {
        return TaskState::Blocked(reason.clone());
    }
    if !inputs.own_damage.is_empty() {
        return TaskState::Damaged(inputs.own_damage.clone());
    }
    let Some(m) = manifest else { return TaskState::Missing };
    if !inputs.damaged.is_empty() {
        return TaskState::Stale(inputs.damaged.iter().map(|d| format!("the result of {d} is damaged")).collect());
    }
    let changes = m.differences(stage.version, &(stage.parameters)(session, trial), &inputs.hashes);
    if !changes.is_empty() {
        return TaskState::Stale(changes);
    }
    match &m.outcome {
        aloft_workspace::manifest::Outcome::Failed(f) => TaskState::Failed(f.clone()),
        aloft_workspace::manifest::Outcome::Ok if m.warnings.is_empty() => TaskState::Ok,
        aloft_workspace::manifest::Outcome::Ok => TaskState::Warning,
    }
}
