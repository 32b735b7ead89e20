//! Files of results in a workspace.

use aloft_analysis::freshness::of_result;
use aloft_pipeline::stages::STAGES;
use aloft_study::subject_session::SubjectSession;
use aloft_workspace::error::PipelineError;
use aloft_workspace::manifest::{Outcome, WHOLE_STUDY};
use aloft_workspace::workspace::Workspace;
use std::path::PathBuf;

/// The path of one file of a result, and why the result is not up to date, if it is not. A damaged
/// result is refused.
pub fn result(
    session: &SubjectSession,
    stage: &str,
    trial: Option<&str>,
    file: &str,
) -> Result<(PathBuf, Option<String>), PipelineError> {
    let stage = STAGES[aloft_pipeline::selection::stage_index(stage)?].name;
    let of = trial.unwrap_or(WHOLE_STUDY);
    if let Some(name) = trial.filter(|name| session.trial(name).is_none()) {
        let names: Vec<&str> = session.trials.iter().map(|t| t.name.as_str()).collect();
        return Err(PipelineError::request_hint(
            format!("there is no trial `{name}`"),
            aloft_study::nearest::hint(name, &names, "the trials are"),
        ));
    }
    let ws = Workspace::open(&session.workspace);
    let whose = trial.map_or(String::new(), |name| format!(" of {name}"));
    let manifest = ws.manifest(stage, of)?.ok_or_else(|| {
        PipelineError::request_hint(
            format!("`{stage}`{whose} has no result in {}", session.workspace.display()),
            "run() makes it, if the stage runs for such a trial; status() shows what there is",
        )
    })?;
    if let Outcome::Failed(failure) = &manifest.outcome {
        let problem = format!("`{stage}`{whose} failed: {}", failure.problem);
        return Err(PipelineError::Request { problem, hint: failure.hint.clone() });
    }
    if !manifest.files.contains_key(file) {
        let files: Vec<&str> = manifest.files.keys().map(String::as_str).collect();
        return Err(PipelineError::request_hint(
            format!("the result of `{stage}`{whose} has no file `{file}`"),
            aloft_study::nearest::hint(file, &files, "it has"),
        ));
    }
    let place = ws.place(stage, of);
    if let Some(problem) = ws.damage(stage, of)?.into_iter().next() {
        return Err(PipelineError::Damaged { path: place, problem });
    }
    let late = of_result(session, stage, of)?;
    Ok((place.join(file), late.map(|n| format!("{}: {stage}{whose}: {}", n.state, n.because))))
}

/// All tables of the results: stage, trial (none for the whole study) and file.
///
/// # Errors
/// A manifest is there and cannot be read.
pub fn tables(session: &SubjectSession) -> Result<Vec<(String, Option<String>, String)>, PipelineError> {
    let ws = Workspace::open(&session.workspace);
    let mut out = Vec::new();
    for stage in STAGES {
        for task in stage.tasks(session) {
            let trial = task.map(|t| t.name.clone());
            let Some(manifest) = ws.manifest(stage.name, trial.as_deref().unwrap_or(WHOLE_STUDY))? else { continue };
            let tables = manifest.files.keys().filter(|f| f.ends_with(".parquet"));
            out.extend(tables.map(|f| (stage.name.to_owned(), trial.clone(), f.clone())));
        }
    }
    Ok(out)
}
