//! The definition of a format, and the files that it gives.

use crate::ExportError;
use crate::subject::SubjectExport;
use crate::trial::TrialExport;

/// One file of an export, in memory.
#[derive(Debug, Clone, PartialEq)]
pub struct OutFile {
    /// Path below the export's folder, with `/` between folders.
    pub path: String,
    /// Content.
    pub bytes: Vec<u8>,
    /// One-line description for the README.
    pub what: String,
}

impl OutFile {
    /// A text file.
    pub fn text(path: String, text: String, what: impl Into<String>) -> Self {
        Self { path, bytes: text.into_bytes(), what: what.into() }
    }
}

/// Writes the files of one recording.
pub type TrialWriter = fn(&SubjectExport, &TrialExport) -> Result<Vec<OutFile>, ExportError>;
/// Writes the files that occur once per export.
pub type SubjectWriter = fn(&SubjectExport) -> Result<Vec<OutFile>, ExportError>;

/// A format: its documentation and its functions.
#[derive(Debug)]
pub struct Format {
    /// Name typed by users.
    pub name: &'static str,
    /// Description, for help and README.
    pub title: &'static str,
    /// Programs that read it.
    pub readers: &'static str,
    /// Files of each recording.
    pub trial: Option<TrialWriter>,
    /// Files that occur once.
    pub subject: Option<SubjectWriter>,
}
