//! What a pipeline is bound to, and what a run did, as data. (The command line shows both as text.)

use aloft_pipeline::runner::{BatchReport, Ended, RunReport, TaskReport};
use aloft_study::data_set::DataSet;
use aloft_study::recordings::SessionId;
use aloft_study::subject_session::SubjectSession;
use aloft_workspace::error::PipelineError;
use aloft_workspace::manifest::WHOLE_STUDY;
use miette::Diagnostic;
use serde::Serialize;
use std::path::PathBuf;

/// A pipeline bound to recordings.
#[derive(Serialize)]
pub struct Opened {
    name: String,
    data: PathBuf,
    workspace: PathBuf,
    several: bool,
    members: Vec<Member>,
    broken: Vec<Broken>,
    excluded: Vec<Broken>,
    remarks: Vec<String>,
    /// What a user should know at once: a workspace in an earlier place, names of an earlier
    /// version.
    notes: Vec<String>,
}

#[derive(Serialize)]
struct Member {
    #[serde(flatten)]
    id: SessionId,
    data: PathBuf,
    workspace: PathBuf,
    mass_kg: f64,
    gravity_mps2: f64,
    trials: Vec<Trial>,
}

#[derive(Serialize)]
struct Trial {
    name: String,
    role: &'static str,
    file: String,
    group: Option<String>,
    excluded: Option<String>,
}

#[derive(Serialize)]
struct Broken {
    #[serde(flatten)]
    id: SessionId,
    because: String,
    hint: Option<String>,
}

impl Opened {
    /// Of a set.
    pub fn of(set: &DataSet) -> Self {
        let old = set.pipeline.old_names.iter().map(|old| format!("{}: {old}", set.pipeline.name()));
        Self {
            name: set.pipeline.config.name.clone(),
            data: set.data.clone(),
            workspace: set.workspace.clone(),
            several: set.several,
            members: set.members.iter().map(member).collect(),
            broken: broken(set),
            excluded: set
                .excluded
                .iter()
                .map(|(id, because)| Broken { id: id.clone(), because: because.clone(), hint: None })
                .collect(),
            remarks: set.remarks.clone(),
            notes: set.place_note.iter().cloned().chain(old).collect(),
        }
    }
}

fn broken(set: &DataSet) -> Vec<Broken> {
    let of = |b: &aloft_study::data_set::BrokenMember| Broken {
        id: b.id.clone(),
        because: b.failure.problem.clone(),
        hint: b.failure.hint.clone(),
    };
    set.broken.iter().map(of).collect()
}

fn member(session: &SubjectSession) -> Member {
    let trials = session.trials.iter().map(|t| Trial {
        name: t.name.clone(),
        role: t.role.word(),
        file: t.file.display().to_string(),
        group: t.group.clone(),
        excluded: t.excluded.clone(),
    });
    Member {
        id: session.id.clone(),
        data: session.data.clone(),
        workspace: session.workspace.clone(),
        mass_kg: session.facts.person.mass_kg,
        gravity_mps2: session.facts.gravity_mps2,
        trials: trials.collect(),
    }
}

/// What a run did.
#[derive(Serialize)]
pub struct RunAnswer {
    /// True if no task failed or was blocked, and every subject could be processed.
    ok: bool,
    /// Wall time, s.
    seconds: f64,
    tasks: Vec<TaskAnswer>,
    /// Subjects and sessions that could not be processed.
    broken: Vec<Broken>,
    notes: Vec<String>,
}

#[derive(Serialize)]
struct TaskAnswer {
    #[serde(flatten)]
    id: SessionId,
    stage: &'static str,
    /// None for a stage that runs once a study.
    trial: Option<String>,
    /// `ran`, `up to date`, `would run`, `failed` or `blocked`.
    outcome: &'static str,
    because: Option<String>,
    hint: Option<String>,
    warnings: Vec<String>,
    /// Wall time, s.
    seconds: f64,
}

impl RunAnswer {
    /// Of a run over all subjects and sessions of a set.
    pub fn of(set: &DataSet, done: &BatchReport) -> Self {
        let mut out = Self {
            ok: !done.has_trouble() && set.broken.is_empty(),
            seconds: done.seconds,
            tasks: Vec::new(),
            broken: broken(set),
            notes: Vec::new(),
        };
        for run in &done.runs {
            match &run.report {
                Ok(report) => out.push(&run.id, report),
                Err(error) => {
                    out.broken.push(Broken { id: run.id.clone(), because: error.to_string(), hint: hint(error) })
                }
            }
        }
        out
    }

    /// Of a run for one subject and session.
    pub fn of_one(id: &SessionId, report: &RunReport) -> Self {
        let mut out = Self {
            ok: !report.has_trouble(),
            seconds: report.seconds,
            tasks: Vec::new(),
            broken: Vec::new(),
            notes: Vec::new(),
        };
        out.push(id, report);
        out
    }

    fn push(&mut self, id: &SessionId, report: &RunReport) {
        self.tasks.extend(report.tasks.iter().map(|t| task(id, t)));
        let whose = if id.subject.is_some() { format!("{id}: ") } else { String::new() };
        self.notes.extend(report.notes.iter().chain(&report.unwritten).map(|n| format!("{whose}{n}")));
    }
}

fn hint(error: &PipelineError) -> Option<String> {
    error.help().map(|h| h.to_string())
}

fn task(id: &SessionId, t: &TaskReport) -> TaskAnswer {
    let (outcome, because, hint) = match &t.ended {
        Ended::Ran => ("ran", None, None),
        Ended::UpToDate => ("up to date", None, None),
        Ended::WouldRun(because) => ("would run", Some(because.clone()), None),
        Ended::Failed(f) => ("failed", Some(f.problem.clone()), f.hint.clone()),
        Ended::Blocked(because) => ("blocked", Some(because.clone()), None),
    };
    TaskAnswer {
        id: id.clone(),
        stage: t.stage,
        trial: (t.trial != WHOLE_STUDY).then(|| t.trial.clone()),
        outcome,
        because,
        hint,
        warnings: t.warnings.iter().map(ToString::to_string).collect(),
        seconds: t.seconds,
    }
}
