//! Corrections that name what the recordings do not have.

use crate::graph::Recording;
use crate::recording::read_recording;
use aloft_study::place::error_at_key;
use aloft_study::subject_session::SubjectSession;
use aloft_workspace::error::PipelineError;
use std::collections::BTreeSet;

/// Refuses `corrections: {plate_zero: …}` for plates that no recording of these sessions has: the
/// correction would do nothing, unnoticed. Recordings are read until every name is found;
/// sessions may have different plates, and so may recordings of one.
///
/// # Errors
/// [`PipelineError::Config`] at the name, with the plates of the recordings.
pub fn refuse_unknown_plates(sessions: &[&SubjectSession]) -> Result<(), PipelineError> {
    let named = |s: &SubjectSession| s.config.corrections.plate_zero.keys().cloned().collect::<BTreeSet<String>>();
    let mut open: BTreeSet<String> = sessions.iter().flat_map(|s| named(s)).collect();
    let mut found: BTreeSet<String> = BTreeSet::new();
    let mut read = 0;
    for (session, trial) in sessions.iter().flat_map(|s| s.included().map(move |t| (s, t))) {
        if open.is_empty() {
            return Ok(());
        }
        // a recording that cannot be read is reported by its import
        // none: its import reports a recording that cannot be read
        if let Ok(recording) =
            read_recording(session.import_of(Some(trial)), &session.names_of_person(Some(trial)), &Recording::of(trial))
        {
            read += 1;
            for plate in &recording.plates {
                open.remove(&plate.name);
                found.insert(plate.name.clone());
            }
        }
    }
    let Some(unknown) = open.first() else { return Ok(()) };
    let Some(session) = sessions.iter().find(|s| named(s).contains(unknown)) else { return Ok(()) };
    let plates: Vec<&str> = found.iter().map(String::as_str).collect();
    let problem =
        format!("`corrections: plate_zero` names the plate `{unknown}`, which none of the {read} recordings has");
    let hint = match plates.as_slice() {
        [] => "they have no force plates: take the correction out".to_owned(),
        _ => format!(
            "their plates are {}; names are those of `aloft inspect` and of the offered block",
            plates.join(", ")
        ),
    };
    Err(error_at_key(&session.config_path.display().to_string(), &session.config_text, unknown, problem, Some(hint)))
}
