//! The pages of a study of several subjects: one per subject and session, and one over all of them.

use super::group::{Absent, Member};
use aloft_analysis::outputs::{REPORT, begin};
use aloft_study::data_set::DataSet;
use aloft_study::recordings::SessionId;
use aloft_study::subject_session::SubjectSession;
use aloft_workspace::error::PipelineError;
use std::path::PathBuf;

/// What was written, and what could not be.
#[derive(Debug)]
pub struct SetReport {
    /// Pages, with that of the whole study first.
    pub pages: Vec<PathBuf>,
    /// Subjects and sessions without a page, and why.
    pub failed: Vec<(SessionId, PipelineError)>,
}

/// Writes the page of every subject and session into its workspace, and `report.html` of the whole
/// study into the study's workspace.
///
/// # Errors
/// No subject has results; the page of the whole study cannot be written.
pub fn write_set(set: &DataSet) -> Result<SetReport, PipelineError> {
    let (mut pages, mut failed, mut members) = (Vec::new(), Vec::new(), Vec::new());
    for session in &set.members {
        let (link, switches) = match super::write_page(session, None) {
            Ok((path, switches)) => {
                let relative = path.strip_prefix(&set.workspace).unwrap_or(&path);
                let parts: Vec<String> =
                    relative.components().map(|c| c.as_os_str().to_string_lossy().into_owned()).collect();
                pages.push(path);
                (parts.join("/"), switches)
            }
            Err(e) => {
                failed.push((session.id.clone(), e));
                (String::new(), "none: no page".to_owned())
            }
        };
        members.push(Member { name: session.id.to_string(), session, link, switches });
    }
    let broken = set.broken.iter().map(|b| (&b.id, b.failure.problem.clone(), false));
    let excluded = set.excluded.iter().map(|(id, why)| (id, why.clone(), true));
    let absent: Vec<Absent> = broken
        .chain(excluded)
        .map(|(id, reason, on_purpose)| Absent { name: id.to_string(), reason, on_purpose })
        .collect();
    let whole = set.workspace.join(REPORT);
    let of: Vec<&SubjectSession> = set.members.iter().collect();
    let recording = begin(&set.workspace, &[REPORT], &of)?;
    pages.insert(0, super::write_group(&set.pipeline.config.name, &members, &absent, &whole)?);
    recording.done()?;
    Ok(SetReport { pages, failed })
}
