//! Answers of `discover` as a workspace keeps them: one for each model and the results that it was
//! asked on, so that an answer comes back with its model.
//!
//! A file is named after both: `discoveries/MODEL-RESULTS.json`. The model is the list of its
//! effects with everything that their columns are computed from, whatever the number of its
//! revision. Workspaces of earlier versions hold one file for each revision, `revision_N.json`.

use crate::kept::{Kept, looked_at};
use aloft_discover::Discovery;
use aloft_effects::FormulaEffect;
use aloft_study::revision::{ModelEffect, Revisions};
use aloft_study::subject_session::SubjectSession;
use aloft_workspace::error::PipelineError;
use aloft_workspace::{disk, seal};
use std::path::{Path, PathBuf};
use std::time::SystemTime;

/// Folder of the answers in a workspace.
const FOLDER: &str = "discoveries";
/// Most answers that a workspace keeps; beyond it the one that was written first is removed. An
/// answer takes about a tenth of a megabyte.
const MOST: usize = 100;

/// Characters of a hash in the name of a file.
const SHORT: usize = 24;

/// The model in the name of a file: a hash of its effects and of the laws of the user's own among
/// them.
fn model(session: &SubjectSession, effects: &[ModelEffect]) -> Result<String, PipelineError> {
    let is_held = |id: &str| effects.iter().any(|e| e.id() == id);
    let own: Vec<&FormulaEffect> = session.own_effects.iter().map(|o| &o.spec).filter(|s| is_held(&s.id)).collect();
    let text = serde_json::to_string(&(effects, own))
        .map_err(|e| PipelineError::request(format!("the effects of the model cannot be written as JSON: {e}")))?;
    Ok(blake3::hash(text.as_bytes()).to_hex()[..SHORT].to_owned())
}

/// Where the answer for a model on some results stands.
fn place(session: &SubjectSession, effects: &[ModelEffect], results: &str) -> Result<PathBuf, PipelineError> {
    let results = results.get(..SHORT).unwrap_or(results);
    Ok(session.workspace.join(FOLDER).join(format!("{}-{results}.json", model(session, effects)?)))
}

/// Where earlier versions kept the answer for a revision.
fn of_number(session: &SubjectSession, revision: usize) -> PathBuf {
    session.workspace.join(FOLDER).join(format!("revision_{revision}.json"))
}

/// Keeps an answer for the present model.
pub(crate) fn keep(session: &SubjectSession, answer: &Kept<Discovery>) -> Result<(), PipelineError> {
    let effects = Revisions::load(&session.workspace)?.effects();
    let place = place(session, &effects, &answer.made_from)?;
    disk::create_dir_all(&session.workspace.join(FOLDER))?;
    seal::write_whole(&place, answer)?;
    let mut all = files(&session.workspace)?;
    all.sort();
    let more = all.len().saturating_sub(MOST);
    for (_, path) in all.into_iter().filter(|(_, path)| *path != place).take(more) {
        disk::remove_file(&path)?;
    }
    Ok(())
}

/// The answers in a workspace, with the times at which they were written.
fn files(workspace: &Path) -> Result<Vec<(SystemTime, PathBuf)>, PipelineError> {
    let folder = workspace.join(FOLDER);
    if !folder.is_dir() {
        return Ok(Vec::new());
    }
    let mut out = Vec::new();
    for entry in std::fs::read_dir(&folder).map_err(PipelineError::io("list", &folder))? {
        let path = entry.map_err(PipelineError::io("list", &folder))?.path();
        let hidden = path.file_name().is_none_or(|n| n.to_string_lossy().starts_with('.'));
        if hidden || path.extension().is_none_or(|e| e != "json") {
            continue;
        }
        let written = path.metadata().and_then(|m| m.modified()).map_err(PipelineError::io("read", &path))?;
        out.push((written, path));
    }
    Ok(out)
}

/// The answer for the present model on the present results; none if it was not asked.
///
/// # Errors
/// The model or the answer is damaged or cannot be read.
pub fn present(session: &SubjectSession) -> Result<Option<Kept<Discovery>>, PipelineError> {
    let all = Revisions::load(&session.workspace)?;
    on_present_results(session, &all, &all.effects(), &looked_at(session)?)
}

/// The answer for a model on some results.
fn on_present_results(
    session: &SubjectSession,
    all: &Revisions,
    effects: &[ModelEffect],
    results: &str,
) -> Result<Option<Kept<Discovery>>, PipelineError> {
    let is_of = |kept: &Kept<Discovery>| kept.made_from == results;
    let kept: Option<Kept<Discovery>> = seal::read_if_there(&place(session, effects, results)?)?;
    if let Some(kept) = kept.filter(is_of) {
        return Ok(Some(kept));
    }
    Ok(by_revision(session, all, effects)?.filter(is_of))
}

/// The answer of an earlier version for the last revision that holds a model.
fn by_revision(
    session: &SubjectSession,
    all: &Revisions,
    effects: &[ModelEffect],
) -> Result<Option<Kept<Discovery>>, PipelineError> {
    for r in all.revisions.iter().rev().filter(|r| r.effects == effects) {
        if let Some(kept) = seal::read_if_there(&of_number(session, r.number))? {
            return Ok(Some(kept));
        }
    }
    Ok(None)
}

/// The last answer for a model, on the present results if there is one.
fn last_of(
    session: &SubjectSession,
    all: &Revisions,
    effects: &[ModelEffect],
    results: &str,
) -> Result<Option<Kept<Discovery>>, PipelineError> {
    if let Some(kept) = on_present_results(session, all, effects, results)? {
        return Ok(Some(kept));
    }
    let model = model(session, effects)?;
    let is_of = |path: &PathBuf| path.file_name().is_some_and(|n| n.to_string_lossy().starts_with(&model));
    let newest = files(&session.workspace)?.into_iter().filter(|(_, path)| is_of(path)).max();
    match newest {
        Some((_, path)) => seal::read_if_there(&path),
        None => by_revision(session, all, effects),
    }
}

/// The last answer for each model of the history, with the number of the last revision that holds
/// it; in the order of these numbers.
///
/// # Errors
/// As [`present`].
pub fn of_revisions(session: &SubjectSession) -> Result<Vec<(usize, Kept<Discovery>)>, PipelineError> {
    let all = Revisions::load(&session.workspace)?;
    let results = looked_at(session)?;
    let mut out = Vec::new();
    for (i, r) in all.revisions.iter().enumerate() {
        if all.revisions[i + 1..].iter().all(|later| later.effects != r.effects) {
            out.extend(last_of(session, &all, &r.effects, &results)?.map(|kept| (r.number, kept)));
        }
    }
    Ok(out)
}

/// The last answer on the present results for a model before the present one, with the keys of the
/// effects that it held.
///
/// # Errors
/// As [`present`].
pub fn earlier(session: &SubjectSession) -> Result<Option<(Discovery, Vec<String>)>, PipelineError> {
    let all = Revisions::load(&session.workspace)?;
    let (present, results) = (all.effects(), looked_at(session)?);
    for r in all.revisions.iter().rev().filter(|r| r.effects != present) {
        if let Some(kept) = on_present_results(session, &all, &r.effects, &results)? {
            return Ok(Some((kept.answer, r.effects.iter().map(|e| e.key.clone()).collect())));
        }
    }
    Ok(None)
}

/// The answer from which effects take their values: that for the present model, otherwise the last
/// one that was given.
pub(crate) fn to_add_from(session: &SubjectSession) -> Result<Option<Kept<Discovery>>, PipelineError> {
    match present(session)? {
        Some(kept) => Ok(Some(kept)),
        None => seal::read_if_there(&session.workspace.join("discovery.json")),
    }
}
