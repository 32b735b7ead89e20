//! Recordings in a folder: which files hold one, their names, and the patterns that choose among
//! them; which subject's and session's a folder is.

use crate::place::error_at_key;
use aloft_workspace::error::PipelineError;
use aloft_workspace::input;
use globset::{GlobBuilder, GlobMatcher, GlobSet, GlobSetBuilder};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// Subject and session of a study; both are none for a pipeline of one subject.
#[derive(Debug, Clone, Default, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
pub struct SessionId {
    /// Subject.
    pub subject: Option<String>,
    /// Session.
    pub session: Option<String>,
}

impl std::fmt::Display for SessionId {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let parts: Vec<&str> = [&self.subject, &self.session].into_iter().flatten().map(String::as_str).collect();
        f.write_str(&parts.join(" "))
    }
}

fn not_a_pattern(p: &str, e: &globset::Error, key: &str, file: &str, text: &str) -> PipelineError {
    error_at_key(
        file,
        text,
        key,
        format!("`{p}` is not a file pattern: {}", e.kind()),
        Some("use *, ? and ** as in a shell".to_owned()),
    )
}

/// Compiles a pattern of the pipeline; an error points at `key`.
pub(crate) fn pattern(p: &str, key: &str, file: &str, text: &str) -> Result<GlobMatcher, PipelineError> {
    let glob = GlobBuilder::new(p).literal_separator(true).build();
    glob.map(|g| g.compile_matcher()).map_err(|e| not_a_pattern(p, &e, key, file, text))
}

pub(crate) fn globs(patterns: &[String], key: &str, file: &str, text: &str) -> Result<GlobSet, PipelineError> {
    let mut builder = GlobSetBuilder::new();
    for p in patterns {
        let glob = GlobBuilder::new(p).literal_separator(true).build();
        builder.add(glob.map_err(|e| not_a_pattern(p, &e, key, file, text))?);
    }
    builder.build().map_err(|e| not_a_pattern("", &e, key, file, text))
}

/// True for recording files, judged by extension.
pub fn is_recording(path: &Path) -> bool {
    path.extension().is_some_and(|e| e.eq_ignore_ascii_case("c3d") || e.eq_ignore_ascii_case("trc")) || is_bids(path)
}

/// Ending of the numbers of a BIDS-Motion recording.
const BIDS_MOTION: &str = "_motion.tsv";

/// True for the numbers of a BIDS-Motion recording.
pub fn is_bids(path: &Path) -> bool {
    path.file_name().is_some_and(|n| n.to_string_lossy().ends_with(BIDS_MOTION))
}

/// Files that describe a BIDS-Motion recording, those that are there: channels, their frame,
/// metadata.
pub fn bids_beside(path: &Path) -> Vec<PathBuf> {
    let name = path.file_name().map(|n| n.to_string_lossy().into_owned()).unwrap_or_default();
    let Some(stem) = name.strip_suffix(BIDS_MOTION) else { return Vec::new() };
    let mut beside: Vec<PathBuf> = ["channels.tsv", "channels.json", "motion.json"]
        .iter()
        .map(|end| path.with_file_name(format!("{stem}_{end}")))
        .filter(|p| input::is_there(p))
        .collect();
    // `sub-01_ses-02_scans.tsv`, a folder above the recordings, says when each was made
    let entities: Vec<&str> = stem.split('_').take_while(|e| e.starts_with("sub-") || e.starts_with("ses-")).collect();
    if let (false, Some(folder)) = (entities.is_empty(), path.parent()) {
        let scans = format!("{}_scans.tsv", entities.join("_"));
        beside.extend(folder.ancestors().take(2).map(|f| f.join(&scans)).find(|p| input::is_there(p)));
    }
    beside
}

/// Endings of a robot's log, and of the recording of its base beside it.
const LOG_ENDINGS: [&str; 4] = [".csv.gz", ".csv", ".parquet", ".mcap"];

/// The name of a robot's log without its ending: `jump_01` for `jump_01_robot.csv.gz`; none for
/// other files and for recordings of the base.
pub fn log_stem(path: &Path) -> Option<String> {
    let name = path.file_name()?.to_string_lossy().into_owned();
    let bare = LOG_ENDINGS.iter().find_map(|end| name.strip_suffix(end))?;
    (!bare.ends_with("_base")).then(|| bare.strip_suffix("_robot").unwrap_or(bare).to_owned())
}

/// The recording of the base beside a robot's log, if there is one: `jump_01_base.csv` for
/// `jump_01_robot.csv.gz`.
pub fn base_beside(log: &Path) -> Option<PathBuf> {
    let stem = log_stem(log)?;
    LOG_ENDINGS.iter().map(|end| log.with_file_name(format!("{stem}_base{end}"))).find(|p| input::is_there(p))
}

/// Markers on a robot's links beside its log, if there are any: `jump_01_markers.c3d` for
/// `jump_01_robot.csv.gz`. They count where there is no recording of the base.
pub fn markers_beside(log: &Path) -> Option<PathBuf> {
    let stem = log_stem(log)?;
    ["c3d", "C3D"].iter().map(|end| log.with_file_name(format!("{stem}_markers.{end}"))).find(|p| input::is_there(p))
}

/// The name of a recording without its ending.
pub fn stem_of(path: &Path) -> String {
    let name = path.file_name().map(|n| n.to_string_lossy().into_owned()).unwrap_or_default();
    if let Some(stem) = log_stem(path) {
        return stem;
    }
    match name.strip_suffix(BIDS_MOTION) {
        Some(stem) => stem.to_owned(),
        None => path.file_stem().map(|s| s.to_string_lossy().into_owned()).unwrap_or_default(),
    }
}

/// Names of recordings, from their paths relative to the data folder: the file's stem, or the whole
/// path where several files have the same one.
pub fn trial_names(relative: &[&Path]) -> Vec<String> {
    let mut stems: BTreeMap<String, usize> = BTreeMap::new();
    for path in relative {
        *stems.entry(fold(&stem_of(path))).or_default() += 1;
    }
    let name = |path: &&Path| {
        let short = stem_of(path);
        if stems.get(&fold(&short)) == Some(&1) {
            return short;
        }
        path.components().map(|c| c.as_os_str().to_string_lossy().into_owned()).collect::<Vec<_>>().join("-")
    };
    relative.iter().map(name).collect()
}

/// The parts of a name that Theia3D gives the poses of a person, `pose_filt_0`: whether they are
/// filtered, and the person's number; none for other names. The folder names the trial.
pub fn theia_pose(stem: &str) -> Option<(bool, &str)> {
    let (words, person) = stem.rsplit_once('_')?;
    let filtered = if words.eq_ignore_ascii_case("pose_filt") {
        true
    } else if words.eq_ignore_ascii_case("pose") {
        false
    } else {
        return None;
    };
    (!person.is_empty() && person.chars().all(|c| c.is_ascii_digit())).then_some((filtered, person))
}

/// The name by which recordings of several subjects are compared: that of the file, or of the
/// folder where every file in it has the same name.
pub fn trial_name(path: &Path) -> String {
    let stem = stem_of(path);
    match (theia_pose(&stem), path.parent().and_then(Path::file_name)) {
        (Some(_), Some(folder)) => folder.to_string_lossy().into_owned(),
        _ => stem,
    }
}

/// Recordings below a folder, relative to it, in order of names. Results (workspaces, exports,
/// `derivatives`) and hidden folders are not looked into. Whatever has the name of a recording
/// counts, so that what cannot be read is reported and not lost: data sets of DataLad or git-annex
/// consist of links, some without a target. Of folders those count that hold no recording
/// themselves, and those that may not be listed (under any name: see `may_hold`).
pub fn recordings_below(folder: &Path) -> Result<Vec<PathBuf>, PipelineError> {
    files_below(folder, is_recording)
}

/// Logs of robots below a folder, in the same way.
pub fn logs_below(folder: &Path) -> Result<Vec<PathBuf>, PipelineError> {
    files_below(folder, |path| log_stem(path).is_some())
}

fn files_below(folder: &Path, wanted: impl Fn(&Path) -> bool) -> Result<Vec<PathBuf>, PipelineError> {
    let mut found: Vec<PathBuf> = Vec::new();
    let mut folders: Vec<PathBuf> = Vec::new();
    let walk = walkdir::WalkDir::new(folder).sort_by_file_name().into_iter().filter_entry(|e| {
        let name = e.file_name().to_string_lossy();
        e.depth() == 0
            || !e.file_type().is_dir()
            || !(name.starts_with('.')
                || name == "derivatives"
                || e.path().join(aloft_workspace::format::MARKER).is_file())
    });
    for entry in walk {
        let problem = |e: walkdir::Error| e.into_io_error().unwrap_or_else(|| std::io::Error::other("a loop of links"));
        let relative = |path: &Path| path.strip_prefix(folder).unwrap_or(path).to_path_buf();
        match entry {
            Ok(e) if !wanted(e.path()) || lock_of_editor(e.file_name()) => {}
            Ok(e) if e.file_type().is_dir() => folders.push(relative(e.path())),
            Ok(e) => found.push(relative(e.path())),
            Err(e) if e.depth() > 0 && e.path().is_some() => found.extend(e.path().map(relative)),
            Err(e) => return Err(PipelineError::io("list", folder)(problem(e))),
        }
    }
    folders.retain(|of| !found.iter().any(|file| file.starts_with(of)));
    found.extend(folders);
    found.sort();
    Ok(found)
}

/// True for the links without a target by which Emacs marks a file that is being edited.
pub(crate) fn lock_of_editor(name: &std::ffi::OsStr) -> bool {
    name.to_string_lossy().starts_with(".#")
}

/// True if a file below a folder may match a pattern: the folder's path matches the pattern's
/// beginning.
pub(crate) fn may_hold(folder: &Path, pattern: &str) -> bool {
    let mut parts = pattern.split('/');
    folder.components().all(|of| match parts.next() {
        // stands for any number of folders
        Some("**") => {
            parts = "**".split('/');
            true
        }
        // none: opening the pipeline refuses a pattern that cannot be read
        Some(part) => globset::Glob::new(part).is_ok_and(|g| g.compile_matcher().is_match(of.as_os_str())),
        None => false,
    }) && parts.next().is_some()
}

/// A name as compared by file systems that ignore case.
pub fn fold(name: &str) -> String {
    name.to_lowercase()
}
