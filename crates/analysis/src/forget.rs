//! `forget`: removes everything that a workspace holds about one subject. Recordings, pipelines and
//! files outside the workspace are not touched, and are named.

use crate::outputs::{LIST, REPORT, SUMMARY};
use aloft_pipeline::stages::STAGES;
use aloft_study::data_set::DataSet;
use aloft_study::nearest;
use aloft_study::subject_session::Overrides;
use aloft_workspace::disk;
use aloft_workspace::error::PipelineError;
use aloft_workspace::format::MARKER;
use aloft_workspace::workspace::Workspace;
use serde::Serialize;
use std::path::{Path, PathBuf};
use std::time::Duration;

/// What was removed, and what was not touched.
#[derive(Debug, Clone, Serialize)]
pub struct Forgotten {
    /// Version of this structure.
    pub version: u32,
    /// The subject.
    pub subject: String,
    /// The workspace.
    pub workspace: String,
    /// False if nothing was removed, because only the list was asked for.
    pub done: bool,
    /// What was removed, relative to the workspace.
    pub removed: Vec<Removed>,
    /// What was not touched, in words.
    pub kept: Vec<String>,
}

/// A file or folder that was removed.
#[derive(Debug, Clone, Serialize)]
pub struct Removed {
    /// Path below the workspace; `.` for the whole workspace.
    pub place: String,
    /// Number of files.
    pub files: usize,
    /// Their size.
    pub bytes: u64,
    /// Why it concerns the subject.
    pub because: String,
}

/// Removes what the workspace of a pipeline holds about a subject; with `only_list`, says what that
/// is.
///
/// # Errors
/// The workspace holds no such subject, is in use, or cannot be changed.
pub fn forget(
    pipeline: &Path,
    overrides: &Overrides,
    subject: &str,
    only_list: bool,
) -> Result<Forgotten, PipelineError> {
    let (data, workspace) = DataSet::places(pipeline, overrides)?;
    if !disk::is_there(&workspace.join(MARKER))? {
        return Err(PipelineError::request_hint(
            format!("there is no workspace {}", workspace.display()),
            "name it with --workspace",
        ));
    }
    let places = places_of(pipeline, overrides, &workspace, subject)?;
    let _lock = if only_list { None } else { Some(Workspace::open(&workspace).lock(Duration::ZERO)?) };
    // a run of the subject by itself locks its own folder
    let mut sessions = Vec::new();
    for place in places.iter().filter(|p| p.path != workspace) {
        for session in workspaces_below(&place.path)? {
            if !only_list {
                sessions.push(Workspace::open(&session).lock(Duration::ZERO)?);
            }
        }
    }
    drop(sessions);
    let mut removed = Vec::new();
    for place in &places {
        let (files, bytes) = size_of(&place.path);
        let shown = place.path.strip_prefix(&workspace).unwrap_or(&place.path).display().to_string();
        let shown = if shown.is_empty() { ".".to_owned() } else { shown };
        removed.push(Removed { place: shown, files, bytes, because: place.because.to_owned() });
        if !only_list {
            clear(&place.path, &workspace)?;
        }
    }
    let kept = vec![
        format!("the recordings and facts in {}", data.display()),
        format!("the pipeline {}", pipeline.display()),
        "files written outside the workspace (export --to, report --out, simulate, workflow) and copies of the workspace".to_owned(),
    ];
    let workspace = workspace.display().to_string();
    Ok(Forgotten { version: 1, subject: subject.to_owned(), workspace, done: !only_list, removed, kept })
}

struct Place {
    path: PathBuf,
    because: &'static str,
}

/// What there is of a subject: its own folder, and what is about the whole study; or everything, in
/// a study of one.
fn places_of(
    pipeline: &Path,
    overrides: &Overrides,
    workspace: &Path,
    subject: &str,
) -> Result<Vec<Place>, PipelineError> {
    let folders = subjects_in(workspace)?;
    if folders.is_empty() {
        // the workspace of one subject: its name is in the facts
        let set = DataSet::open(pipeline, overrides)?;
        let names: Vec<&str> = set.members.iter().map(|m| m.facts.person.name.as_str()).collect();
        if names.contains(&subject) {
            return Ok(vec![Place { path: workspace.to_path_buf(), because: "everything in it is about the subject" }]);
        }
        return Err(unknown(subject, &names));
    }
    let known: Vec<&str> = folders.iter().map(String::as_str).collect();
    if !known.contains(&subject) {
        return Err(unknown(subject, &known));
    }
    let mut out = vec![Place { path: workspace.join(subject), because: "results, answers and exports of the subject" }];
    for name in SUMMARY.iter().copied().chain([REPORT, LIST, "inputs.json"]) {
        let path = workspace.join(name);
        if disk::is_there(&path)? {
            out.push(Place { path, because: "of the whole study; the next command writes it without the subject" });
        }
    }
    Ok(out)
}

fn unknown(subject: &str, known: &[&str]) -> PipelineError {
    PipelineError::request_hint(
        format!("the workspace holds nothing about `{subject}`"),
        nearest::hint(subject, known, "it holds"),
    )
}

/// Folders of subjects in the workspace of a study of several: those that hold workspaces.
fn subjects_in(workspace: &Path) -> Result<Vec<String>, PipelineError> {
    let mut out = Vec::new();
    for entry in std::fs::read_dir(workspace).map_err(PipelineError::io("list", workspace))? {
        let entry = entry.map_err(PipelineError::io("list", workspace))?;
        let name = entry.file_name().to_string_lossy().into_owned();
        let is_stage = STAGES.iter().any(|s| s.name == name);
        if entry.path().is_dir() && !name.starts_with('.') && !is_stage && !workspaces_below(&entry.path())?.is_empty()
        {
            out.push(name);
        }
    }
    out.sort();
    Ok(out)
}

/// Workspaces in a subject's folder: the folder itself, or those of its sessions.
///
/// # Errors
/// The folder cannot be listed: what stands in it would stay.
fn workspaces_below(folder: &Path) -> Result<Vec<PathBuf>, PipelineError> {
    let mut out = vec![folder.to_path_buf()];
    if folder.is_dir() {
        for entry in std::fs::read_dir(folder).map_err(PipelineError::io("list", folder))? {
            out.push(entry.map_err(PipelineError::io("list", folder))?.path());
        }
    }
    out.retain(|p| p.join(MARKER).is_file());
    Ok(out)
}

fn size_of(path: &Path) -> (usize, u64) {
    // none: only the size that is shown
    let files = walkdir::WalkDir::new(path).into_iter().flatten().filter(|e| e.file_type().is_file());
    files.fold((0, 0), |(n, bytes), e| (n + 1, bytes + e.metadata().ok().map_or(0, |m| m.len())))
}

/// Removes a file or folder; of the whole workspace, everything but what marks and locks it.
fn clear(path: &Path, workspace: &Path) -> Result<(), PipelineError> {
    if path != workspace {
        return if path.is_dir() { disk::remove_dir_all(path) } else { disk::remove_file(path) };
    }
    for entry in std::fs::read_dir(path).map_err(PipelineError::io("list", path))? {
        let entry = entry.map_err(PipelineError::io("list", path))?;
        let name = entry.file_name().to_string_lossy().into_owned();
        if name == MARKER || name == ".lock" || name == ".holder.json" {
            continue;
        }
        if entry.path().is_dir() { disk::remove_dir_all(&entry.path())? } else { disk::remove_file(&entry.path())? }
    }
    Ok(())
}
