//! Notes of people about a study: one text file in its workspace.

use aloft_study::subject_session::SubjectSession;
use aloft_workspace::disk;
use aloft_workspace::error::PipelineError;
use std::path::PathBuf;

/// Name of the file in the workspace.
pub const FILE: &str = "notes.txt";

fn path(session: &SubjectSession) -> PathBuf {
    session.workspace.join(FILE)
}

/// The notes; empty if there are none.
///
/// # Errors
/// A file that cannot be read or is no text.
pub fn read(session: &SubjectSession) -> Result<String, PipelineError> {
    let path = path(session);
    match std::fs::read_to_string(&path) {
        Ok(text) => Ok(text),
        Err(e) if e.kind() == std::io::ErrorKind::NotFound => Ok(String::new()),
        Err(e) => Err(PipelineError::io("read", &path)(e)),
    }
}

/// Replaces the notes `before` by `after`.
///
/// # Errors
/// The notes are not `before` any more: somebody else has written meanwhile, and nothing is lost.
pub fn write(session: &SubjectSession, before: &str, after: &str) -> Result<(), PipelineError> {
    if read(session)? != before {
        return Err(PipelineError::request_hint(
            "the notes were changed elsewhere since this page read them; nothing was saved",
            "copy your text, reload the page, and add it again",
        ));
    }
    disk::write_whole(&path(session), after.as_bytes())
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "tests fail by panicking")]
mod tests {
    use super::*;
    use aloft_study::subject_session::Overrides;

    #[test]
    fn notes_are_kept_and_nobody_overwrites_those_of_another() {
        let folder = tempfile::tempdir().unwrap();
        let pipeline = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../../pipelines/demo.yaml");
        let overrides = Overrides { workspace: Some(folder.path().to_path_buf()), ..Overrides::default() };
        let session = SubjectSession::open(&pipeline, &overrides).unwrap();
        assert_eq!(read(&session).unwrap(), "");
        write(&session, "", "first\n").unwrap();
        assert!(write(&session, "", "second").is_err());
        assert_eq!(read(&session).unwrap(), "first\n");
        write(&session, "first\n", "both").unwrap();
        assert_eq!(read(&session).unwrap(), "both");
    }
}
