//! Stretches of markers that import left out: held at one position, or exchanged with another one.

use aloft_study::subject_session::SubjectSession;
use aloft_workspace::error::PipelineError;
use aloft_workspace::workspace::Workspace;

/// Recordings that are named.
const NAMED: usize = 2;

/// What to say of recordings in which something was left out; none without any.
///
/// # Errors
/// A recording was imported and its result cannot be read.
pub fn left_out(session: &SubjectSession) -> Result<Option<String>, PipelineError> {
    let ws = Workspace::open(&session.workspace);
    let mut all: Vec<String> = Vec::new();
    for trial in session.included() {
        let Some(done) = ws.manifest_if_there("import", &trial.name)? else { continue };
        let Some(left_out) = done.summary.get("left_out").and_then(serde_json::Value::as_array) else { continue };
        let words: Vec<&str> = left_out.iter().filter_map(serde_json::Value::as_str).collect();
        all.push(format!("{}: {}", trial.name, words.join("; ")));
    }
    let more = all.len().saturating_sub(NAMED);
    all.truncate(NAMED);
    if more > 0 {
        all.push(format!("{more} more recordings (`aloft check`)"));
    }
    Ok((!all.is_empty()).then(|| all.join("; ")))
}
