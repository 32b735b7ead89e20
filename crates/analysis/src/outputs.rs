//! Files that commands write into a workspace for people and other programs: `summary.csv`,
//! `summary.parquet`, `summary.txt`, `report.html`, and the folder `export`. They are copies of
//! what the results say, so that they are behind as soon as a result changes.
//!
//! `outputs.json` states for each of them what it was made from and the hash of its content.
//! `status` and `verify` compare both.

use crate::freshness::NotCurrent;
use aloft_pipeline::manifests::Manifests;
use aloft_pipeline::stages::STAGES;
use aloft_study::data_set::DataSet;
use aloft_study::subject_session::SubjectSession;
use aloft_workspace::disk;
use aloft_workspace::error::PipelineError;
use aloft_workspace::manifest::WHOLE_STUDY;
use aloft_workspace::seal;
use aloft_workspace::workspace::Workspace;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::path::Path;

/// The list of these files in a workspace.
pub const LIST: &str = "outputs.json";

/// Word in place of a stage for such a file.
pub const FILE: &str = "file";

/// Files of the summary.
pub const SUMMARY: [&str; 3] = ["summary.csv", "summary.parquet", "summary.txt"];

/// The report.
pub const REPORT: &str = "report.html";

/// Files of a workspace, each with the command that writes it again.
const MADE: [(&str, &str); 4] = [(SUMMARY[0], "run"), (SUMMARY[1], "run"), (SUMMARY[2], "run"), (REPORT, "report")];

/// What a file was made from, and its content.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
struct Output {
    from: String,
    bytes: u64,
    blake3: String,
}

type List = BTreeMap<String, Output>;

/// How closely files are looked at.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Look {
    /// What they were made from, and their size.
    Quick,
    /// Their content, too.
    Whole,
}

/// Hash of the results of some subjects and sessions, as far as tables of them can tell: outcome,
/// warnings and figures of every task, and which recordings there are. Times are no part of it.
fn of_results(sessions: &[&SubjectSession]) -> Result<blake3::Hasher, PipelineError> {
    let mut hasher = blake3::Hasher::new();
    for session in sessions {
        let ws = Workspace::open(&session.workspace);
        let manifests = Manifests::read(session, &ws, STAGES)?;
        hasher.update(format!("{:?}\n", session.id).as_bytes());
        for t in &session.trials {
            hasher.update(format!("{} {:?} {:?}\n", t.name, t.role, t.excluded).as_bytes());
        }
        for (stage, trial) in STAGES.iter().flat_map(|s| s.tasks(session).into_iter().map(move |t| (s.name, t))) {
            let name = trial.map_or(WHOLE_STUDY, |t| t.name.as_str());
            let known = manifests.get(stage, name).map(|m| (&m.outcome, &m.warnings, &m.summary, &m.output));
            hasher.update(format!("{stage} {name} {known:?}\n").as_bytes());
        }
    }
    Ok(hasher)
}

/// Files beside the results that a report shows.
const SHOWN: [&str; 4] = ["model.json", "discovery.json", "assessment.json", crate::notes::FILE];

/// What a file is made from, as one hash.
fn from(name: &str, sessions: &[&SubjectSession]) -> Result<String, PipelineError> {
    let mut hasher = of_results(sessions)?;
    if name == REPORT {
        for path in sessions.iter().flat_map(|s| SHOWN.map(|name| s.workspace.join(name))) {
            if disk::is_there(&path)? {
                hasher.update(blake3::hash(&disk::read(&path)?).as_bytes());
            }
            hasher.update(b"\n");
        }
    }
    Ok(hasher.finalize().to_hex().to_string())
}

/// A record of files being written: what they are made from is taken before, so that a result that
/// changes meanwhile makes them stale.
#[derive(Debug)]
pub struct Recording<'a> {
    folder: &'a Path,
    names: &'a [&'a str],
    from: Vec<String>,
}

/// Begins to write files into a workspace, made from some subjects and sessions.
///
/// # Errors
/// What they are made from cannot be read.
pub fn begin<'a>(
    folder: &'a Path,
    names: &'a [&'a str],
    sessions: &[&SubjectSession],
) -> Result<Recording<'a>, PipelineError> {
    let from = names.iter().map(|name| from(name, sessions)).collect::<Result<_, _>>()?;
    Ok(Recording { folder, names, from })
}

impl Recording<'_> {
    /// Lists the files as they are now.
    ///
    /// # Errors
    /// A file cannot be read; the list cannot be written.
    pub fn done(self) -> Result<(), PipelineError> {
        let path = self.folder.join(LIST);
        let mut list: List = seal::read_if_whole(&path)?.unwrap_or_default();
        for (name, from) in self.names.iter().zip(self.from) {
            let bytes = disk::read(&self.folder.join(name))?;
            let blake3 = blake3::hash(&bytes).to_hex().to_string();
            list.insert((*name).to_owned(), Output { from, bytes: bytes.len() as u64, blake3 });
        }
        seal::write_whole(&path, &list)
    }
}

/// Files in a workspace that are not what the results of these subjects and sessions would give.
///
/// # Errors
/// A file cannot be looked at.
pub fn not_current(folder: &Path, sessions: &[&SubjectSession], look: Look) -> Result<Vec<NotCurrent>, PipelineError> {
    let mut there = Vec::new();
    for (name, command) in MADE {
        if disk::is_there(&folder.join(name))? {
            there.push((name, command));
        }
    }
    if there.is_empty() {
        return Ok(Vec::new());
    }
    // without the list, or with a damaged one, nothing is known of the files
    let list: List = seal::read_if_whole(&folder.join(LIST))?.unwrap_or_default();
    let mut out = Vec::new();
    for (name, command) in there {
        let again = format!("`aloft {command}` writes it again");
        let problem = match list.get(name) {
            None => Some(("stale", "nothing states what it was made from")),
            Some(known) if !is_as_written(&folder.join(name), known, look)? => {
                Some(("damaged", "its content is not what was written"))
            }
            Some(known) if known.from != from(name, sessions)? => {
                Some(("stale", "the results have changed since it was written"))
            }
            Some(_) => None,
        };
        out.extend(problem.map(|(state, because)| NotCurrent {
            stage: FILE.to_owned(),
            trial: name.to_owned(),
            state: state.to_owned(),
            because: format!("{because}; {again}"),
            follows: false,
        }));
    }
    Ok(out)
}

fn is_as_written(path: &Path, known: &Output, look: Look) -> Result<bool, PipelineError> {
    if look == Look::Quick {
        return Ok(std::fs::metadata(path).map_err(PipelineError::io("look at", path))?.len() == known.bytes);
    }
    let bytes = disk::read(path)?;
    Ok(bytes.len() as u64 == known.bytes && blake3::hash(&bytes).to_hex().as_str() == known.blake3)
}

/// Files in the workspace of a whole study of several; none for a study of one, whose files are
/// those of [`crate::standing::files`].
///
/// # Errors
/// A file cannot be looked at.
pub fn of_set(set: &DataSet, look: Look) -> Result<Vec<NotCurrent>, PipelineError> {
    let members: Vec<&SubjectSession> = set.members.iter().collect();
    if set.several { not_current(&set.workspace, &members, look) } else { Ok(Vec::new()) }
}

/// Number of these files in a workspace, without those of an export.
///
/// # Errors
/// A file cannot be looked at.
pub(crate) fn count(folder: &Path) -> Result<usize, PipelineError> {
    let mut n = 0;
    for (name, _) in MADE {
        n += usize::from(disk::is_there(&folder.join(name))?);
    }
    Ok(n)
}
