//! The error that the model will have with the effects that a discovery found, before any is added:
//! the stages that `effect add` runs, on a copy of the workspace, so that the promised number is the
//! one that the ladder shows afterwards.

use crate::compare::{ComparisonView, compare};
use crate::discover::Volume;
use crate::effect::suggestion;
use crate::freshness::freshness;
use crate::history::reached;
use aloft_discover::{Discovery, FoundLaw};
use aloft_pipeline::progress::Silent;
use aloft_pipeline::runner::run_held;
use aloft_study::effects::OwnEffect;
use aloft_study::revision::Revisions;
use aloft_study::subject_session::SubjectSession;
use aloft_workspace::error::PipelineError;
use aloft_workspace::workspace::Workspace;
use std::path::Path;
use std::time::Duration;

/// The comparison of the model with all effects found added to it, or the laws that replace them;
/// none if none was found, or if the results are not up to date, so that more than the effect would
/// change.
pub(crate) fn promised(
    session: &SubjectSession,
    found: &Discovery,
    volume: Volume,
) -> Result<Option<ComparisonView>, PipelineError> {
    let laws: Vec<&FoundLaw> = found.open.iter().filter(|o| o.complete).flat_map(|o| &o.laws).collect();
    if (found.found.is_empty() && laws.is_empty()) || !freshness(session)?.is_current() {
        return Ok(None);
    }
    let mut all = Revisions::load(&session.workspace)?;
    let now = reached(session, &compare(session)?)?;
    if let Some(last) = all.revisions.last_mut() {
        last.reached = Some(now);
    }
    let mut effects = all.effects();
    let keys = found.found.iter().map(|f| &f.key).chain(laws.iter().map(|l| &l.id));
    for key in keys {
        let Some(mut effect) = suggestion(found, key) else { continue };
        effect.volume_m = Some((volume.middle_m, volume.reach_m));
        effects.push(effect);
    }
    let mut own_effects = session.own_effects.clone();
    for law in laws {
        own_effects.push(OwnEffect::described(&law.effect)?);
    }
    let beside = session.workspace.parent().unwrap_or(Path::new("."));
    let copy = tempfile::Builder::new()
        .prefix(".aloft-promise")
        .tempdir_in(beside)
        .map_err(PipelineError::io("create a folder in", beside))?;
    link_all(&session.workspace, copy.path())?;
    let with = SubjectSession {
        workspace: copy.path().to_path_buf(),
        effects,
        own_effects,
        plain_base: all.plain_base(),
        ..session.clone()
    };
    let lock = Workspace::open(copy.path()).lock(Duration::ZERO)?;
    run_held(&with, &lock, &Silent)?;
    let view = compare(&with)?;
    drop(lock);
    Ok(Some(view))
}

/// Files beside the stages' folders that the copy needs: the layout of the workspace, and the hashes
/// of recordings that were read before.
const ALSO: [&str; 2] = [aloft_workspace::format::MARKER, "inputs.json"];

/// The stages' results below another folder: links to the same files where the file system has
/// them, copies elsewhere. Results are replaced as a whole and never changed in place, so that a
/// link is as good as a copy.
fn link_all(from: &Path, to: &Path) -> Result<(), PipelineError> {
    for entry in walkdir::WalkDir::new(from).min_depth(1) {
        let entry = entry.map_err(|e| PipelineError::request(format!("{}: {e}", from.display())))?;
        let Ok(relative) = entry.path().strip_prefix(from) else { continue };
        let target = to.join(relative);
        if entry.file_type().is_dir() {
            std::fs::create_dir_all(&target).map_err(PipelineError::io("create", &target))?;
        } else if relative.components().count() > 2 || ALSO.iter().any(|name| relative == Path::new(name)) {
            let linked = relative.components().count() > 2 && std::fs::hard_link(entry.path(), &target).is_ok();
            if !linked {
                std::fs::copy(entry.path(), &target).map_err(PipelineError::io("copy to", &target))?;
            }
        }
    }
    Ok(())
}
