//! A robot's own model files with identified inertials: order, comments and everything else stay.

use crate::{ExportError, InertiaSource, OutFile, SubjectExport};
use aloft_robot::{Format, patch};

/// The files of one format, patched.
///
/// # Errors
/// [`ExportError::Recording`] if nothing was identified, or the file does not fit the model.
pub(crate) fn patched(subject: &SubjectExport, format: Format) -> Result<Vec<OutFile>, ExportError> {
    let files = subject.robot_files.iter().filter(|f| f.model.format == format);
    let links: Vec<_> =
        subject.subject.model.links.iter().map(|l| l.name.clone()).zip(subject.links.iter().copied()).collect();
    files
        .map(|file| {
            let problem = |problem: String| ExportError::Recording { trial: file.name.clone(), problem };
            if let InertiaSource::Prior { reason } = &subject.source {
                return Err(problem(format!("there are no identified inertias to write: {reason}")));
            }
            let done =
                patch::patch(&file.text, &file.model, &links, &file.provenance).map_err(|e| problem(e.to_string()))?;
            let (stem, end) = file.name.rsplit_once('.').unwrap_or((&file.name, "xml"));
            let what = format!(
                "{} with the identified inertials of {} links; nothing else changed{}",
                file.name,
                done.written.len(),
                done.remarks.iter().map(|r| format!("; {r}")).collect::<String>()
            );
            Ok(OutFile::text(format!("Models/{stem}_identified.{end}"), done.text, what))
        })
        .collect()
}
