//! Segments on which no recording has a marker: their motion is not seen.

use crate::to_correct::ToCorrect;
use aloft_pipeline::stages::import::ImportRecord;
use aloft_study::subject_session::{Role, SubjectSession};
use aloft_trial::MarkerSet;
use aloft_workspace::error::PipelineError;
use aloft_workspace::json::read_json_if_there;
use aloft_workspace::workspace::Workspace;

/// Segments of the marker set without any marker in any recording of motion, as what comes first;
/// none where every segment has one, or nothing is imported.
///
/// # Errors
/// A recording was imported and its result cannot be read.
pub(crate) fn unseen(session: &SubjectSession, ws: &Workspace) -> Result<Option<ToCorrect>, PipelineError> {
    let mut missing: Option<Vec<String>> = None;
    for trial in session.included().filter(|t| matches!(t.role, Role::Identify | Role::Validate)) {
        let record = read_json_if_there::<ImportRecord>(&ws.place("import", &trial.name).join("quality.json"))?;
        let Some(record) = record else { continue };
        let here = record.matched.missing;
        missing = Some(match missing {
            Some(so_far) => so_far.into_iter().filter(|label| here.contains(label)).collect(),
            None => here,
        });
    }
    let links = links_without(&session.marker_set, &missing.unwrap_or_default());
    Ok((!links.is_empty()).then(|| ToCorrect {
        words: format!(
            "no recording has a marker on {}: what moves there is not seen, and its share of every force and moment is missing \
             (label the markers, or map them under `import: {{aliases: …}}`; a body without this segment, after an amputation, cannot be \
             described yet)",
            links.join(", ")
        ),
        first: true,
        void: true,
        offered: false,
    }))
}

/// Links of a marker set all of whose tracking markers are among `missing`.
fn links_without(set: &MarkerSet, missing: &[String]) -> Vec<String> {
    let mut links: Vec<(&str, bool)> = Vec::new();
    for marker in set.markers.iter().filter(|m| m.tracking) {
        let is_missing = missing.contains(&marker.label);
        match links.iter_mut().find(|(link, _)| *link == marker.link) {
            Some((_, all)) => *all &= is_missing,
            None => links.push((&marker.link, is_missing)),
        }
    }
    links.into_iter().filter(|(_, all)| *all).map(|(link, _)| format!("`{link}`")).collect()
}
