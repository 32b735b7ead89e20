//! The folder of results: one folder a stage and trial with tables and a manifest, renamed into place when complete.

use crate::error::{PipelineError, StageFailure};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::fs::{File, TryLockError};
use std::path::{Path, PathBuf};
use std::sync::Mutex;
use std::time::{Duration, Instant, SystemTime, UNIX_EPOCH};

/// File that tells a workspace from a folder of recordings.
pub const MARKER: &str = "ALOFT_WORKSPACE.txt";

/// Name that stands for the whole study where a trial's name would stand.
pub const WHOLE_STUDY: &str = "_study";

/// How a stage ended.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case", tag = "status")]
pub enum Outcome {
    /// Tables are there.
    Ok,
    /// They are not.
    Failed(StageFailure),
}

/// What a stage's result was made from, and how it ended.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Manifest {
    /// Stage.
    pub stage: String,
    /// Trial, or [`WHOLE_STUDY`].
    pub trial: String,
    /// Version of the stage's code.
    pub version: u32,
    /// The parameters that the stage reads.
    pub parameters: serde_json::Value,
    /// Hash of each input: recordings and upstream results.
    pub inputs: BTreeMap<String, String>,
    /// How it ended.
    pub outcome: Outcome,
    /// What was odd, in words.
    pub warnings: Vec<String>,
    /// Figures for tables.
    pub summary: BTreeMap<String, serde_json::Value>,
    /// Hash over all files of the result.
    pub output: String,
    /// Wall time of the stage, s.
    pub seconds: f64,
    /// Version of the program.
    pub program: String,
}

impl Manifest {
    /// True when the result can be used.
    pub fn is_ok(&self) -> bool {
        self.outcome == Outcome::Ok
    }

    /// What differs between the makings of two results, in words; empty when nothing does.
    pub fn differences(
        &self,
        version: u32,
        parameters: &serde_json::Value,
        inputs: &BTreeMap<String, String>,
    ) -> Vec<String> {
        let mut changes = Vec::new();
        if self.version != version {
            changes.push(format!("the stage's code: version {} → {version}", self.version));
        }
        describe_changes("", &self.parameters, parameters, &mut changes);
        for (name, hash) in inputs {
            match self.inputs.get(name) {
                None => changes.push(format!("new input: {}", in_words(name))),
                Some(old) if old != hash => changes.push(format!("input changed: {}", in_words(name))),
                Some(_) => {}
            }
        }
        changes.extend(
            self.inputs.keys().filter(|k| !inputs.contains_key(*k)).map(|k| format!("input gone: {}", in_words(k))),
        );
        changes
    }
}

/// An input's key in words: `file jump01.c3d` or `ik/jump01`.
fn in_words(key: &str) -> String {
    match (key.strip_prefix("file "), key.split_once('/')) {
        (Some(file), _) => format!("the content of the file {file}"),
        (None, Some((stage, trial))) if trial == WHOLE_STUDY => format!("the result of `{stage}`"),
        (None, Some((stage, trial))) => format!("the result of `{stage}` for {trial}"),
        _ => key.to_owned(),
    }
}

fn describe_changes(path: &str, old: &serde_json::Value, new: &serde_json::Value, out: &mut Vec<String>) {
    use serde_json::Value::Object;
    match (old, new) {
        (Object(a), Object(b)) => {
            for (key, value) in b {
                let here = if path.is_empty() { key.clone() } else { format!("{path}.{key}") };
                describe_changes(&here, a.get(key).unwrap_or(&serde_json::Value::Null), value, out);
            }
            for key in a.keys().filter(|k| !b.contains_key(*k)) {
                out.push(format!("parameter gone: {path}.{key}"));
            }
        }
        _ if old == new => {}
        _ => {
            let show = |v: &serde_json::Value| {
                let s = v.to_string();
                if s.len() > 60 { format!("{}…", s.chars().take(57).collect::<String>()) } else { s }
            };
            out.push(format!("parameter `{path}`: {} → {}", show(old), show(new)));
        }
    }
}

/// Ending of an old result on its way out.
const OLD: &str = "~old";

/// The workspace of one study.
#[derive(Debug)]
pub struct Workspace {
    root: PathBuf,
    inputs: Mutex<BTreeMap<String, InputStamp>>,
}

#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
struct InputStamp {
    bytes: u64,
    modified_ns: u128,
    hash: String,
}

/// Holds the workspace for one run; released when dropped, and by the operating system when the process ends in any way.
#[derive(Debug)]
pub struct WorkspaceLock {
    _file: File,
    note: PathBuf,
}

impl Drop for WorkspaceLock {
    fn drop(&mut self) {
        let _ = std::fs::remove_file(&self.note);
    }
}

/// Who holds a workspace.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Holder {
    /// Process.
    pub pid: u32,
    /// Computer.
    pub host: String,
    /// Since when, UTC.
    pub since: String,
}

impl std::fmt::Display for Holder {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "process {} on {} since {}", self.pid, self.host, self.since)
    }
}

impl Holder {
    fn this_process() -> Self {
        Self { pid: std::process::id(), host: host_name(), since: utc(SystemTime::now()) }
    }
}

/// The computer's name, where the system tells.
fn host_name() -> String {
    let from_files =
        ["/proc/sys/kernel/hostname", "/etc/hostname"].iter().find_map(|p| std::fs::read_to_string(p).ok());
    let from_words = || ["COMPUTERNAME", "HOSTNAME", "HOST"].iter().find_map(|v| std::env::var(v).ok());
    from_files
        .or_else(from_words)
        .map(|s| s.trim().to_owned())
        .filter(|s| !s.is_empty())
        .unwrap_or("this computer".into())
}

/// A time as `2026-03-01 14:05:09 UTC` (proleptic Gregorian calendar; days to civil dates after Hinnant's algorithm).
pub fn utc(time: SystemTime) -> String {
    let seconds = time.duration_since(UNIX_EPOCH).unwrap_or_default().as_secs();
    let (days, rest) = ((seconds / 86_400) as i64, seconds % 86_400);
    let shifted = days + 719_468;
    let era = shifted.div_euclid(146_097);
    let day_of_era = shifted.rem_euclid(146_097);
    let year_of_era = (day_of_era - day_of_era / 1460 + day_of_era / 36_524 - day_of_era / 146_096) / 365;
    let day_of_year = day_of_era - (365 * year_of_era + year_of_era / 4 - year_of_era / 100);
    let month_index = (5 * day_of_year + 2) / 153;
    let day = day_of_year - (153 * month_index + 2) / 5 + 1;
    let month = if month_index < 10 { month_index + 3 } else { month_index - 9 };
    let year = year_of_era + era * 400 + i64::from(month <= 2);
    format!("{year}-{month:02}-{day:02} {:02}:{:02}:{:02} UTC", rest / 3600, rest / 60 % 60, rest % 60)
}

impl Workspace {
    /// Opens a workspace for reading; nothing is created.
    pub fn open(root: &Path) -> Self {
        let inputs = std::fs::read(root.join("inputs.json"))
            .ok()
            .and_then(|bytes| serde_json::from_slice(&bytes).ok())
            .unwrap_or_default();
        Self { root: root.to_path_buf(), inputs: Mutex::new(inputs) }
    }

    /// Creates the folder where needed and takes the lock, waiting so long for who holds it; then says who does.
    pub fn lock(&self, patience: Duration) -> Result<WorkspaceLock, PipelineError> {
        let marker = self.root.join(MARKER);
        if self.root.is_dir()
            && !marker.is_file()
            && std::fs::read_dir(&self.root).is_ok_and(|mut d| d.next().is_some())
        {
            return Err(PipelineError::request_hint(
                format!("{} is not empty and is not a workspace", self.root.display()),
                "give --workspace a new or empty folder, so that nothing of yours is overwritten",
            ));
        }
        std::fs::create_dir_all(&self.root).map_err(PipelineError::io("create", &self.root))?;
        if !marker.is_file() {
            std::fs::write(&marker, "Results of aloft. Everything here can be made again from the recordings.\n")
                .map_err(PipelineError::io("write", &marker))?;
        }
        let path = self.root.join(".lock");
        let file = File::options()
            .create(true)
            .truncate(false)
            .read(true)
            .write(true)
            .open(&path)
            .map_err(PipelineError::io("open", &path))?;
        let note = self.root.join(".holder.json");
        let started = Instant::now();
        loop {
            match file.try_lock() {
                Ok(()) => break,
                Err(TryLockError::WouldBlock) if started.elapsed() < patience => {
                    std::thread::sleep(Duration::from_millis(100));
                }
                Err(TryLockError::WouldBlock) => {
                    let holder = read_json::<Holder>(&note).map_or("another process".to_owned(), |h| h.to_string());
                    return Err(PipelineError::Locked { path: self.root.clone(), holder });
                }
                Err(TryLockError::Error(e)) => return Err(PipelineError::io("lock", &path)(e)),
            }
        }
        write_json_whole(&note, &Holder::this_process())?;
        // what a killed run was writing
        for entry in std::fs::read_dir(&self.root).map_err(PipelineError::io("list", &self.root))?.flatten() {
            let name = entry.file_name().to_string_lossy().into_owned();
            if name.starts_with('.') && name.ends_with(NEW) {
                let _ = std::fs::remove_file(entry.path());
            }
        }
        let scratch = self.root.join(".tmp");
        if scratch.is_dir() {
            self.put_back(&scratch)?;
            std::fs::remove_dir_all(&scratch).map_err(PipelineError::io("clear", &scratch))?;
        }
        Ok(WorkspaceLock { _file: file, note })
    }

    /// A run that was killed between moving an old result away and the new one in leaves the old one in `.tmp`: a result that
    /// is missing in its place is put back, so that nothing finished is lost.
    fn put_back(&self, scratch: &Path) -> Result<(), PipelineError> {
        let entries = std::fs::read_dir(scratch).map_err(PipelineError::io("list", scratch))?;
        for old in entries.filter_map(|e| e.ok().map(|e| e.path())) {
            if !old.file_name().is_some_and(|n| n.to_string_lossy().ends_with(OLD)) {
                continue;
            }
            let Ok(manifest) = read_json::<Manifest>(&old.join("manifest.json")) else { continue };
            let place = self.place(&manifest.stage, &manifest.trial);
            // the finished successor stands beside it and is worth more
            let name =
                old.file_name().map(|n| n.to_string_lossy().trim_end_matches(OLD).to_owned()).unwrap_or_default();
            let new = scratch.join(name);
            let whole = read_json::<Manifest>(&new.join("manifest.json")).is_ok();
            if !place.exists() {
                let from = if whole { &new } else { &old };
                std::fs::rename(from, &place).map_err(PipelineError::io("move", from))?;
            }
        }
        Ok(())
    }

    /// The folder.
    pub fn root(&self) -> &Path {
        &self.root
    }

    /// Where the result of a stage lies.
    pub fn place(&self, stage: &str, trial: &str) -> PathBuf {
        self.root.join(stage).join(trial)
    }

    /// The manifest of a result, if it is there and readable.
    pub fn manifest(&self, stage: &str, trial: &str) -> Option<Manifest> {
        let bytes = std::fs::read(self.place(stage, trial).join("manifest.json")).ok()?;
        serde_json::from_slice(&bytes).ok()
    }

    /// A fresh folder to write a result into, not yet visible to readers.
    pub fn scratch(&self, stage: &str, trial: &str) -> Result<PathBuf, PipelineError> {
        let path = self.root.join(".tmp").join(format!("{stage}-{trial}"));
        if path.exists() {
            std::fs::remove_dir_all(&path).map_err(PipelineError::io("clear", &path))?;
        }
        std::fs::create_dir_all(&path).map_err(PipelineError::io("create", &path))?;
        Ok(path)
    }

    /// Writes the manifest beside the tables and renames the folder into place.
    pub fn commit(&self, scratch: &Path, mut manifest: Manifest) -> Result<Manifest, PipelineError> {
        manifest.output = hash_folder(scratch)?;
        write_json(&scratch.join("manifest.json"), &manifest)?;
        let place = self.place(&manifest.stage, &manifest.trial);
        if let Some(parent) = place.parent() {
            std::fs::create_dir_all(parent).map_err(PipelineError::io("create", parent))?;
        }
        if place.exists() {
            let mut old = scratch.as_os_str().to_owned();
            old.push(OLD);
            let old = PathBuf::from(old);
            if old.exists() {
                std::fs::remove_dir_all(&old).map_err(PipelineError::io("clear", &old))?;
            }
            std::fs::rename(&place, &old).map_err(PipelineError::io("move", &place))?;
            std::fs::rename(scratch, &place).map_err(PipelineError::io("move", scratch))?;
            std::fs::remove_dir_all(&old).map_err(PipelineError::io("clear", &old))?;
        } else {
            std::fs::rename(scratch, &place).map_err(PipelineError::io("move", scratch))?;
        }
        Ok(manifest)
    }

    /// Content hash of a recording; read again only when its size or time changed.
    pub fn input_hash(&self, path: &Path) -> Result<String, PipelineError> {
        let meta = std::fs::metadata(path).map_err(PipelineError::io("read", path))?;
        let modified_ns =
            meta.modified().ok().and_then(|t| t.duration_since(UNIX_EPOCH).ok()).map_or(0, |d| d.as_nanos());
        let key = path.canonicalize().unwrap_or_else(|_| path.to_path_buf()).display().to_string();
        if let Ok(known) = self.inputs.lock()
            && let Some(stamp) = known.get(&key)
            && stamp.bytes == meta.len()
            && stamp.modified_ns == modified_ns
        {
            return Ok(stamp.hash.clone());
        }
        let bytes = std::fs::read(path).map_err(PipelineError::io("read", path))?;
        let hash = blake3::hash(&bytes).to_hex().to_string();
        if let Ok(mut known) = self.inputs.lock() {
            known.insert(key, InputStamp { bytes: meta.len(), modified_ns, hash: hash.clone() });
        }
        Ok(hash)
    }

    /// Keeps the hashes of the recordings for the next run.
    pub fn save_input_hashes(&self) -> Result<(), PipelineError> {
        let known = self.inputs.lock().map(|k| k.clone()).unwrap_or_default();
        let place = self.root.join("inputs.json");
        if read_json::<BTreeMap<String, InputStamp>>(&place).is_ok_and(|old| old == known) {
            return Ok(());
        }
        write_json_whole(&place, &known)
    }
}

fn hash_folder(folder: &Path) -> Result<String, PipelineError> {
    let mut names: Vec<PathBuf> = std::fs::read_dir(folder)
        .map_err(PipelineError::io("list", folder))?
        .filter_map(|e| e.ok().map(|e| e.path()))
        .filter(|p| p.is_file())
        .collect();
    names.sort();
    let mut hasher = blake3::Hasher::new();
    for path in names {
        hasher.update(path.file_name().map(|n| n.to_string_lossy().into_owned()).unwrap_or_default().as_bytes());
        let bytes = std::fs::read(&path).map_err(PipelineError::io("read", &path))?;
        hasher.update(&(bytes.len() as u64).to_le_bytes());
        hasher.update(&bytes);
    }
    Ok(hasher.finalize().to_hex().to_string())
}

/// Writes pretty JSON.
pub fn write_json<T: Serialize>(path: &Path, value: &T) -> Result<(), PipelineError> {
    let text = serde_json::to_vec_pretty(value)
        .map_err(|e| PipelineError::Table { path: path.to_path_buf(), problem: e.to_string() })?;
    std::fs::write(path, text).map_err(PipelineError::io("write", path))
}

/// Ending of a file that is being written.
const NEW: &str = ".new";

/// A hidden name beside a file, for writing it whole.
pub fn beside(path: &Path) -> PathBuf {
    let name = path.file_name().map(|n| n.to_string_lossy().into_owned()).unwrap_or_default();
    path.with_file_name(format!(".{name}.{}{NEW}", std::process::id()))
}

/// Writes a file whole or not at all: beside its place, then renamed into it.
pub fn write_whole(path: &Path, bytes: &[u8]) -> Result<(), PipelineError> {
    let new = beside(path);
    std::fs::write(&new, bytes).map_err(PipelineError::io("write", &new))?;
    std::fs::rename(&new, path).map_err(PipelineError::io("move", &new))
}

/// Writes pretty JSON whole or not at all.
pub fn write_json_whole<T: Serialize>(path: &Path, value: &T) -> Result<(), PipelineError> {
    let text = serde_json::to_vec_pretty(value)
        .map_err(|e| PipelineError::Table { path: path.to_path_buf(), problem: e.to_string() })?;
    write_whole(path, &text)
}

/// Reads JSON.
pub fn read_json<T: serde::de::DeserializeOwned>(path: &Path) -> Result<T, PipelineError> {
    let bytes = std::fs::read(path).map_err(PipelineError::io("read", path))?;
    serde_json::from_slice(&bytes)
        .map_err(|e| PipelineError::Table { path: path.to_path_buf(), problem: e.to_string() })
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "tests fail by panicking")]
mod tests {
    use super::*;

    #[test]
    fn unit_dates_are_those_of_the_calendar() {
        let at = |s: u64| utc(UNIX_EPOCH + Duration::from_secs(s));
        // `date -u -d @N`
        assert_eq!(at(0), "1970-01-01 00:00:00 UTC");
        assert_eq!(at(951_782_400), "2000-02-29 00:00:00 UTC");
        assert_eq!(at(1_772_373_909), "2026-03-01 14:05:09 UTC");
        assert_eq!(at(4_102_444_799), "2099-12-31 23:59:59 UTC");
    }

    fn manifest(trial: &str, seconds: f64) -> Manifest {
        Manifest {
            stage: "ik".into(),
            trial: trial.into(),
            version: 1,
            parameters: serde_json::json!({}),
            inputs: BTreeMap::new(),
            outcome: Outcome::Ok,
            warnings: Vec::new(),
            summary: BTreeMap::new(),
            output: String::new(),
            seconds,
            program: String::new(),
        }
    }

    #[test]
    fn unit_a_result_that_a_killed_run_had_moved_away_is_put_back() {
        let dir = tempfile::tempdir().unwrap();
        let ws = Workspace::open(&dir.path().join("ws"));
        let lock = ws.lock(Duration::ZERO).unwrap();
        for trial in ["a.1", "a.2"] {
            ws.commit(&ws.scratch("ik", trial).unwrap(), manifest(trial, 1.0)).unwrap();
        }
        drop(lock);
        // killed between the two renames: once with the new result complete, once with it half-written
        let moved = |trial: &str| {
            let scratch = ws.scratch("ik", trial).unwrap();
            std::fs::rename(ws.place("ik", trial), scratch.with_file_name(format!("ik-{trial}{OLD}"))).unwrap();
            scratch
        };
        write_json(&moved("a.1").join("manifest.json"), &manifest("a.1", 2.0)).unwrap();
        std::fs::write(moved("a.2").join("manifest.json"), "{\"stage\": \"i").unwrap();
        assert!(ws.manifest("ik", "a.1").is_none() && ws.manifest("ik", "a.2").is_none());
        let _lock = ws.lock(Duration::ZERO).unwrap();
        assert_eq!(ws.manifest("ik", "a.1").map(|m| m.seconds), Some(2.0));
        assert_eq!(ws.manifest("ik", "a.2").map(|m| m.seconds), Some(1.0));
    }

    #[test]
    fn unit_the_holder_is_named() {
        let dir = tempfile::tempdir().unwrap();
        let ws = Workspace::open(&dir.path().join("ws"));
        let _held = ws.lock(Duration::ZERO).unwrap();
        let other = Workspace::open(&dir.path().join("ws"));
        let refused = other.lock(Duration::from_millis(150)).unwrap_err().to_string();
        let here = Holder::this_process();
        assert!(refused.contains(&format!("process {} on {}", here.pid, here.host)), "{refused}");
    }
}
