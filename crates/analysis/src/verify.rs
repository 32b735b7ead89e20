//! `verify`: compares every file of a workspace with the hash stored when it was written.

use crate::freshness::{NotCurrent, freshness};
use crate::outputs::{self, Look};
use crate::standing::files;
use aloft_pipeline::stages::STAGES;
use aloft_study::subject_session::SubjectSession;
use aloft_workspace::disk::is_there;
use aloft_workspace::error::PipelineError;
use aloft_workspace::manifest::{Manifest, WHOLE_STUDY};
use aloft_workspace::seal;
use aloft_workspace::workspace::Workspace;
use rayon::prelude::*;
use serde::Serialize;
use std::path::Path;

/// Result of `verify`.
#[derive(Debug, Clone, Serialize)]
pub struct Verified {
    /// Version of this structure.
    pub version: u32,
    /// The folder.
    pub workspace: String,
    /// Number of results checked.
    pub results: usize,
    /// Number of files in these results and next to them.
    pub files: usize,
    /// Their total size.
    pub bytes: u64,
    /// Files that differ from what was written.
    pub damaged: Vec<Damage>,
    /// Results of recordings or stages that the study no longer has, `stage/trial`; nothing reads
    /// them.
    pub unused: Vec<String>,
    /// Results that differ from what the pipeline and the recordings would give now.
    pub stale: Vec<NotCurrent>,
}

/// A damaged result or file.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct Damage {
    /// Folder of a result, or file, relative to the workspace.
    pub place: String,
    /// Problems found.
    pub problems: Vec<String>,
    /// How to make it again.
    pub mend: String,
}

impl Damage {
    /// A table, report or export that is not as it was written; the problem names what mends it.
    pub fn of_file(place: String, problem: String) -> Self {
        let (problem, mend) = problem.split_once("; ").unwrap_or((&problem, ""));
        Self { place, problems: vec![problem.to_owned()], mend: mend.trim_end_matches(" writes it again").to_owned() }
    }
}

/// Files that commands store next to the results of stages, each with the command that writes it
/// again.
const KEPT: [(&str, &str); 7] = [
    ("model.json", "put back a copy, or delete the file and add the effects again"),
    ("discovery.json", "`aloft discover`"),
    ("discovery_volume.json", "`aloft discover`"),
    ("self_test.json", "`aloft discover --self-test`"),
    ("assessment.json", "`aloft parameters --assess`"),
    ("inputs.json", "`aloft run`"),
    (outputs::LIST, "`aloft run`"),
];

/// Checks everything in a study's workspace; changes nothing.
///
/// # Errors
/// The workspace was made by another version; a folder cannot be listed.
pub fn verify(session: &SubjectSession) -> Result<Verified, PipelineError> {
    let ws = Workspace::open(&session.workspace);
    let mut out = Verified {
        version: 1,
        workspace: session.workspace.display().to_string(),
        results: 0,
        files: 0,
        bytes: 0,
        damaged: Vec::new(),
        unused: Vec::new(),
        stale: Vec::new(),
    };
    let folders = STAGES.iter().map(|s| s.name).chain(["merge"]);
    let mut found: Vec<(&str, String)> = Vec::new();
    for stage in folders {
        found.extend(folders_in(&ws.root().join(stage))?.into_iter().map(|t| (stage, t)));
    }
    let damage: Result<Vec<Vec<String>>, _> = found.par_iter().map(|(stage, trial)| ws.damage(stage, trial)).collect();
    let mut manifests = Vec::new();
    for ((stage, trial), problems) in found.iter().zip(damage?) {
        let place = format!("{stage}/{trial}");
        out.results += 1;
        let manifest = ws.manifest(stage, trial)?;
        if let Some(m) = &manifest {
            out.files += m.files.len() + 1;
            out.bytes += m.files.values().map(|f| f.bytes).sum::<u64>();
        }
        if !is_used(session, stage, trial) {
            out.unused.push(place.clone());
        }
        if !problems.is_empty() {
            let mend = if *stage == "merge" { "`aloft merge`" } else { "`aloft run`" };
            out.damaged.push(Damage { place, problems, mend: mend.to_owned() });
        }
        manifests.extend(manifest);
    }
    let answers = folders_and_files(&ws.root().join("discoveries"))?
        .into_iter()
        .filter(|n| n.ends_with(".json") && !n.starts_with('.'))
        .map(|n| (format!("discoveries/{n}"), "`aloft discover`"));
    let kept = KEPT.iter().map(|(name, mend)| ((*name).to_owned(), *mend));
    for (name, mend) in kept.chain(answers) {
        let path = ws.root().join(&name);
        if !path.exists() {
            continue;
        }
        out.files += 1;
        // none: only the size that is shown; the content is checked below
        out.bytes += std::fs::metadata(&path).ok().map_or(0, |m| m.len());
        if let Err(e) = seal::read::<serde_json::Value>(&path) {
            let problem = match e {
                PipelineError::Damaged { problem, .. } => problem,
                other => other.to_string(),
            };
            out.damaged.push(Damage { place: name, problems: vec![problem], mend: mend.to_owned() });
        }
    }
    out.stale = freshness(session)?.stale;
    let (damaged, stale): (Vec<_>, Vec<_>) =
        files(session, Look::Whole)?.into_iter().partition(|f| f.state == "damaged");
    out.files += outputs::count(&session.workspace)?;
    out.damaged.extend(damaged.into_iter().map(|f| Damage::of_file(f.trial, f.because)));
    out.stale.extend(stale);
    // a missing folder cannot be compared with its hash, but later results were made from it
    for one in out.stale.iter().filter(|n| n.state == "missing" && n.stage != "model") {
        let key = format!("{}/{}", one.stage, one.trial);
        if manifests.iter().any(|m: &Manifest| m.inputs.contains_key(&key)) {
            out.damaged.push(Damage {
                place: key,
                problems: vec!["it is missing, and other results were made from it".to_owned()],
                mend: "`aloft run`".to_owned(),
            });
        }
    }
    Ok(out)
}

fn is_used(session: &SubjectSession, stage: &str, trial: &str) -> bool {
    match STAGES.iter().find(|s| s.name == stage) {
        None => true,
        Some(s) => s.tasks(session).into_iter().any(|t| t.map_or(WHOLE_STUDY, |t| t.name.as_str()) == trial),
    }
}

/// Names in a folder, in order; nothing where there is no such folder.
fn folders_and_files(folder: &Path) -> Result<Vec<String>, PipelineError> {
    if !is_there(folder)? {
        return Ok(Vec::new());
    }
    let mut names: Vec<String> = std::fs::read_dir(folder)
        .map_err(PipelineError::io("list", folder))?
        .map(|e| e.map(|e| e.file_name().to_string_lossy().into_owned()).map_err(PipelineError::io("list", folder)))
        .collect::<Result<_, _>>()?;
    names.sort();
    Ok(names)
}

fn folders_in(folder: &Path) -> Result<Vec<String>, PipelineError> {
    Ok(folders_and_files(folder)?.into_iter().filter(|n| folder.join(n).is_dir()).collect())
}
