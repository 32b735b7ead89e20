//! `export`: writes results for use in other programs. The formats are in the crate `aloft-export`;
//! this module gathers the data of a study and writes the files.

mod folder;
mod gather;

use crate::freshness::{Freshness, freshness};
use crate::outputs::Look;
use crate::standing::status;
use aloft_export::readme::{Making, readme};
use aloft_export::{Convention, Format, InertiaSource, OutFile, SubjectExport, names};
use aloft_study::config::Angles;
use aloft_study::recordings::{SessionId, fold};
use aloft_study::subject_session::{SubjectSession, TrialEntry};
use aloft_workspace::error::PipelineError;
use aloft_workspace::workspace::Workspace;
use folder::{Folder, Kept};
use rayon::prelude::*;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

pub use gather::program;

/// Options of an export.
#[derive(Debug, Clone, Default)]
pub struct ExportOptions {
    /// Target folder; `export` in the workspace if not given.
    pub to: Option<PathBuf>,
    /// Formats by name; all if empty.
    pub formats: Vec<String>,
    /// Patterns of trial names; all if empty.
    pub trials: Vec<String>,
    /// Joint-angle convention to use instead of the pipeline's.
    pub angles: Option<Angles>,
}

/// Result of an export.
#[derive(Debug, Clone, Default, PartialEq, serde::Serialize)]
pub struct Exported {
    /// The export folder.
    pub folder: PathBuf,
    /// Number of new files.
    pub added: usize,
    /// Number of files whose content changed.
    pub changed: usize,
    /// Number of unchanged files.
    pub unchanged: usize,
    /// Number of removed files: those of an earlier export that no longer belong to it.
    pub removed: usize,
    /// Remarks for the user.
    pub remarks: Vec<String>,
    /// What could not be written: trial (or format) and reason.
    pub failures: Vec<(String, String)>,
}

/// The formats, for help and tables.
pub fn formats() -> &'static [&'static Format] {
    aloft_export::FORMATS
}

fn convention_of(angles: Angles) -> Convention {
    match angles {
        Angles::Model => Convention::Model,
        Angles::Isb => Convention::Isb,
    }
}

/// Writes the export. A folder with other contents is refused; files of an earlier export are
/// replaced only if they were not modified since.
///
/// # Errors
/// There are no results yet; an unknown format or trial; a folder with other contents; a file that
/// cannot be written.
pub fn export(now: &SubjectSession, options: &ExportOptions) -> Result<Exported, PipelineError> {
    let freshness = freshness(now)?;
    freshness.refuse_damaged(now, &[])?;
    let session = &aloft_pipeline::made::as_made(now)?;
    let formats = Format::choose(&options.formats)
        .map_err(|e| PipelineError::request_hint(e.to_string(), "see `aloft export --help`"))?;
    let ws = Workspace::open(&session.workspace);
    let convention = convention_of(options.angles.unwrap_or(session.config.export.angles));
    let subject = gather::subject(session, &ws, convention)?;
    let entries = gather::entries(session, &options.trials)?;
    let target = options.to.clone().unwrap_or_else(|| session.workspace.join(FOLDER));
    let state = gather::state(session, &ws, convention)?;
    let folder = Folder::prepare(&target, &state)?;

    let mut done = Exported { folder: target, remarks: remarks(now, &freshness)?, ..Exported::default() };
    let mut files: Vec<Kept> = Vec::new();
    for format in &formats {
        let Some(write) = format.subject else { continue };
        match write(&subject) {
            Ok(out) => files.extend(folder.stage(out)?),
            Err(e) => done.failures.push((format.name.to_owned(), e.to_string())),
        }
    }
    let results: Vec<TrialFiles> = entries
        .par_iter()
        .map(|e| one_trial(session, &ws, &subject, e, &formats, &folder))
        .collect::<Result<_, _>>()?;
    for trial in results {
        files.extend(trial.files);
        done.remarks.extend(trial.remarks);
        done.failures.extend(trial.failures);
    }
    describe(session, &ws, &subject, &folder, &mut files, &mut done)?;
    paths_are_distinct(&files)?;
    let partial = !options.formats.is_empty() || !options.trials.is_empty();
    folder.commit(files, partial, &mut done)?;
    Ok(done)
}

/// Name of the folder of an export in its workspace.
pub const FOLDER: &str = "export";

/// Why the export in a workspace is not what an export would give now, in words; none without one.
///
/// # Errors
/// The list of its files cannot be read.
pub(crate) fn not_current(now: &SubjectSession, look: Look) -> Result<Option<(&'static str, String)>, PipelineError> {
    let root = now.workspace.join(FOLDER);
    let Some(files) = folder::Listed::read(&root)? else { return Ok(None) };
    let session = &aloft_pipeline::made::as_made(now)?;
    let ws = Workspace::open(&session.workspace);
    // the list does not state the convention of angles: each of them is current
    let mut states = Vec::new();
    for convention in [Convention::Model, Convention::Isb] {
        states.push(gather::state(session, &ws, convention)?);
    }
    if !states.iter().any(|s| files.is_from(s)) {
        return Ok(Some(("stale", "the results or the pipeline have changed since it was written".to_owned())));
    }
    let changed = if look == Look::Whole { files.changed(&root)? } else { Vec::new() };
    Ok((!changed.is_empty()).then(|| ("damaged", format!("not as they were written: {}", changed.join(", ")))))
}

/// Export folder of one subject or session below that of the whole study.
pub fn place_of(to: &Path, id: &SessionId) -> PathBuf {
    [&id.subject, &id.session].into_iter().flatten().fold(to.to_path_buf(), |path, part| path.join(names::file(part)))
}

/// Checks that no two files of an export have the same path, also on file systems that ignore case.
/// Called before any file is put in place.
fn paths_are_distinct(files: &[Kept]) -> Result<(), PipelineError> {
    let mut seen: BTreeMap<String, &Kept> = BTreeMap::new();
    for file in files {
        if let Some(other) = seen.insert(fold(&file.path), file) {
            return Err(PipelineError::request_hint(
                format!("{} ({}) and {} ({}) would be one file", other.path, other.what, file.path, file.what),
                "nothing was written; rename one of the recordings",
            ));
        }
    }
    Ok(())
}

/// Files and remarks for one trial.
#[derive(Debug, Default)]
struct TrialFiles {
    files: Vec<Kept>,
    remarks: Vec<String>,
    failures: Vec<(String, String)>,
}

/// Gathers one trial and writes it in every format.
fn one_trial(
    session: &SubjectSession,
    ws: &Workspace,
    subject: &SubjectExport,
    entry: &TrialEntry,
    formats: &[&Format],
    folder: &Folder,
) -> Result<TrialFiles, PipelineError> {
    let mut done = TrialFiles::default();
    let trial = match gather::trial(session, ws, subject, entry)? {
        Ok(trial) => trial,
        Err(reason) => {
            done.failures.push((entry.name.clone(), reason));
            return Ok(done);
        }
    };
    for format in formats {
        let Some(write) = format.trial else { continue };
        match write(subject, &trial) {
            Ok(out) => done.files.extend(folder.stage(out)?),
            Err(e) => done.failures.push((format!("{} {}", format.name, entry.name), e.to_string())),
        }
    }
    done.remarks = gather::trial_remarks(subject, &trial);
    Ok(done)
}

/// README, pipeline and the list of all files.
fn describe(
    session: &SubjectSession,
    ws: &Workspace,
    subject: &SubjectExport,
    folder: &Folder,
    files: &mut Vec<Kept>,
    done: &mut Exported,
) -> Result<(), PipelineError> {
    let mut methods = crate::methods::paragraph(session, ws, &subject.subject)?;
    methods.push_str(match &subject.source {
        InertiaSource::Identified { .. } => {
            " Links were made physically consistent (positive definite pseudo-inertia) and are the inertias of the exported models."
        }
        InertiaSource::Prior { .. } => " The exported models carry the inertias from tables.",
    });
    methods.push_str(&format!(
        " Angles in the exported files follow the convention `{}`.",
        subject.coordinates.convention.word()
    ));
    let making = Making {
        program: program(),
        pipeline: session.config.name.clone(),
        pipeline_hash: blake3::hash(session.config_text.as_bytes()).to_hex().to_string(),
        recordings: gather::recordings(session, ws)?,
        stages: gather::stages(session, ws)?,
        remarks: done
            .remarks
            .iter()
            .cloned()
            .chain(done.failures.iter().map(|(what, why)| format!("not written: {what}: {why}")))
            .collect(),
        methods: methods.clone(),
    };
    let text = |path: &str, text: String, what: &str| OutFile::text(path.to_owned(), text, what);
    files.extend(folder.stage(vec![
        text("pipeline.yaml", session.config_text.clone(), "the pipeline as it stood when exported"),
        text("methods.txt", format!("{methods}\n"), "paragraph for a paper, with the figures of this study"),
    ])?);
    // files that an earlier export of the same results left stay, and are listed in the README, too
    let mut listed: BTreeMap<String, String> =
        folder.earlier().map(|(path, what)| (path.to_owned(), what.to_owned())).collect();
    listed.extend(files.iter().map(|f| (f.path.clone(), f.what.clone())));
    listed.remove("README.md");
    let listed: Vec<OutFile> =
        listed.into_iter().map(|(path, what)| OutFile { path, bytes: Vec::new(), what }).collect();
    files.extend(folder.stage(vec![text("README.md", readme(subject, &listed, &making), "this page")])?);
    Ok(())
}

/// Remarks on results that are not up to date, failed or were left out.
fn remarks(session: &SubjectSession, freshness: &Freshness) -> Result<Vec<String>, PipelineError> {
    let mut out = Vec::new();
    if !freshness.is_current() {
        out.push(format!(
            "not up to date when exported: {}; `aloft run` brings results up to date",
            freshness.describe().join("; ")
        ));
        out.push(
            "pipeline.yaml is the pipeline as it stood when exported; methods.txt tells how the results were made"
                .to_owned(),
        );
    }
    let found = status(session)?;
    for word in ["failed", "blocked"] {
        let rows: Vec<&str> =
            found.rows.iter().filter(|r| r.cells.iter().any(|c| c == word)).map(|r| r.trial.as_str()).collect();
        if !rows.is_empty() {
            out.push(format!("{word} when exported: {}", rows.join(", ")));
        }
    }
    for trial in session.trials.iter() {
        if let Some(reason) = &trial.excluded {
            out.push(format!("{} is excluded: {reason}", trial.name));
        }
    }
    Ok(out)
}
