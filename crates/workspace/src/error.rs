//! What can go wrong between a configuration and its results. Configuration errors carry the text
//! and the place in it.

use crate::nearest;
use crate::qc::QcReason;
use miette::{Diagnostic, NamedSource, SourceSpan};
use std::path::{Path, PathBuf};

/// Errors of this crate.
#[derive(Debug, thiserror::Error, Diagnostic)]
#[non_exhaustive]
pub enum PipelineError {
    /// A configuration file says something that cannot be.
    #[error("{file}: {problem}")]
    #[diagnostic(code(aloft::config))]
    Config {
        /// The file's name as the user gave it.
        file: String,
        /// What was found and what was expected.
        problem: String,
        /// The file's text.
        #[source_code]
        text: NamedSource<String>,
        /// Where in the text.
        #[label("here")]
        at: Option<SourceSpan>,
        /// What to do about it.
        #[help]
        hint: Option<String>,
    },
    /// Something on the disk cannot be read or written.
    #[error("{}: cannot {action}: {problem}", path.display())]
    #[diagnostic(code(aloft::io))]
    Io {
        /// What was tried, for example `read`.
        action: &'static str,
        /// Where.
        path: PathBuf,
        /// What the operating system said.
        problem: std::io::Error,
        /// What to do about it.
        #[help]
        hint: Option<String>,
    },
    /// A table of the workspace cannot be read or written.
    #[error("{}: {problem}", path.display())]
    #[diagnostic(
        code(aloft::table),
        help(
            "a table of the workspace is made again by `aloft verify` and `aloft run`; a recording must be exported again"
        )
    )]
    Table {
        /// Where.
        path: PathBuf,
        /// What is wrong.
        problem: String,
    },
    /// A file of the workspace is not what was written.
    #[error("{} is damaged: {problem}", path.display())]
    #[diagnostic(
        code(aloft::damaged),
        help(
            "`aloft verify` shows everything that is damaged; `aloft run`, `discover` or `parameters --assess` write their results again"
        )
    )]
    Damaged {
        /// Where.
        path: PathBuf,
        /// What is wrong.
        problem: String,
    },
    /// A command or configuration asks for something that is not there.
    #[error("{problem}")]
    #[diagnostic(code(aloft::request))]
    Request {
        /// What was asked and what there is.
        problem: String,
        /// What to do about it.
        #[help]
        hint: Option<String>,
    },
    /// Whoever asked for the work asked to stop it.
    #[error("stopped on request")]
    #[diagnostic(code(aloft::stopped), help("what was done is kept; run again to go on"))]
    Stopped,
    /// Another run holds the workspace.
    #[error("workspace {} is in use by {holder}", path.display())]
    #[diagnostic(
        code(aloft::locked),
        help("wait for it to end (--wait does so), or give this run another --workspace")
    )]
    Locked {
        /// The workspace.
        path: PathBuf,
        /// Process that holds the lock.
        holder: String,
    },
}

impl PipelineError {
    /// An [`PipelineError::Io`] for `path`.
    pub fn io(action: &'static str, path: impl Into<PathBuf>) -> impl FnOnce(std::io::Error) -> Self {
        let path = path.into();
        move |problem| {
            let hint = if problem.kind() == std::io::ErrorKind::NotFound { files_there(&path) } else { None };
            Self::Io { action, path, problem, hint }
        }
    }

    /// A folder that the user named and that does not exist; `given` is how it was named, for
    /// example `--data lab`.
    pub fn no_folder(given: &str) -> Self {
        let here =
            // none: only words of a message
            std::env::current_dir().map_or_else(|_| "the current folder".to_owned(), |d| d.display().to_string());
        Self::request_hint(
            format!("{given}: there is no such folder"),
            format!("give the folder that holds the recordings, as seen from {here}"),
        )
    }

    /// A [`PipelineError::Request`] without a hint.
    pub fn request(problem: impl Into<String>) -> Self {
        Self::Request { problem: problem.into(), hint: None }
    }

    /// A [`PipelineError::Request`] with a hint.
    pub fn request_hint(problem: impl Into<String>, hint: impl Into<String>) -> Self {
        Self::Request { problem: problem.into(), hint: Some(hint.into()) }
    }
}

/// For a file that does not exist, the files beside it that may be meant.
fn files_there(path: &Path) -> Option<String> {
    let folder = path.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new("."));
    let name = path.file_name()?.to_string_lossy();
    // none: only the nearest name in a message
    let Ok(entries) = std::fs::read_dir(folder) else {
        return Some(format!("there is no folder {}", folder.display()));
    };
    let of_kind = |p: &PathBuf| p.extension() == path.extension();
    let there = entries.flatten().map(|e| e.path()).filter(of_kind);
    let names: Vec<String> = there.filter_map(|p| Some(p.file_name()?.to_string_lossy().into_owned())).collect();
    let known: Vec<&str> = names.iter().map(String::as_str).collect();
    let near: Vec<String> = nearest::nearest(&name, &known).iter().map(|n| format!("`{n}`")).collect();
    (!near.is_empty()).then(|| format!("the folder {} holds {}", folder.display(), near.join(" and ")))
}

/// Why one stage failed for one trial: one line for people, and a hint.
#[derive(Debug, Clone, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct StageFailure {
    /// What was found and what was expected, naming file and place.
    pub problem: String,
    /// What to do about it.
    pub hint: Option<String>,
    /// The reason out of the closed list, where the stage knows it better than "the stage failed".
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub reason: Option<QcReason>,
}

impl StageFailure {
    /// A failure without a hint.
    pub fn new(problem: impl Into<String>) -> Self {
        Self { problem: problem.into(), hint: None, reason: None }
    }

    /// A failure with a hint.
    pub fn with_hint(problem: impl Into<String>, hint: impl Into<String>) -> Self {
        Self { problem: problem.into(), hint: Some(hint.into()), reason: None }
    }

    /// The same with its reason out of the closed list.
    #[must_use]
    pub fn because(self, reason: QcReason) -> Self {
        Self { reason: Some(reason), ..self }
    }
}

impl From<PipelineError> for StageFailure {
    fn from(error: PipelineError) -> Self {
        let hint = error.help().map(|h| h.to_string());
        Self { problem: error.to_string(), hint, reason: None }
    }
}
