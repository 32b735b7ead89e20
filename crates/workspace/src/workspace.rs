//! The folder of results: one folder per stage and trial with tables and a manifest, renamed into
//! place when complete.

pub use crate::disk::write_whole;
use crate::disk::{self, Owned, abandoned, is_temporary};
use crate::error::{PipelineError, StageFailure};
use crate::seal;
use serde::{Deserialize, Serialize};
use std::collections::{BTreeMap, BTreeSet, HashMap};
use std::fs::{File, TryLockError};
use std::ops::Deref;
use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};
use std::time::{Duration, Instant, SystemTime, UNIX_EPOCH};

/// File that distinguishes a workspace from a folder of recordings.
pub const MARKER: &str = "ALOFT_WORKSPACE.txt";

/// Version of the layout of a workspace, stated in the marker file. Version 1 (not stated anywhere)
/// had no hashes of single files.
pub const FORMAT: u32 = 2;

/// Text of the marker file.
pub fn marker_text() -> String {
    format!("Results of aloft. Everything here can be made again from the recordings.\nformat {FORMAT}\n")
}

/// Name used in place of a trial's name for results of the whole study.
pub const WHOLE_STUDY: &str = "_study";

/// Outcome of a stage.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case", tag = "status")]
pub enum Outcome {
    /// The tables exist.
    Ok,
    /// The stage failed; there are no tables.
    Failed(StageFailure),
}

/// What the result of a stage was made from, and its outcome.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Manifest {
    /// Stage name.
    pub stage: String,
    /// Trial name, or [`WHOLE_STUDY`].
    pub trial: String,
    /// Version of the stage's code.
    pub version: u32,
    /// The parameters that the stage reads.
    pub parameters: serde_json::Value,
    /// Hash of each input: recordings and upstream results.
    pub inputs: BTreeMap<String, String>,
    /// Outcome.
    pub outcome: Outcome,
    /// Warnings.
    pub warnings: Vec<String>,
    /// Figures for tables.
    pub summary: BTreeMap<String, serde_json::Value>,
    /// Hash over all files of the result.
    pub output: String,
    /// Every file of the result except the manifest itself.
    #[serde(default)]
    pub files: BTreeMap<String, FileStamp>,
    /// Wall time of the stage, s.
    pub seconds: f64,
    /// Version of the program.
    pub program: String,
}

/// Size and hash of a file as it was written.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct FileStamp {
    /// Size, bytes.
    pub bytes: u64,
    /// Hash of the content.
    pub blake3: String,
}

impl FileStamp {
    fn of(bytes: &[u8]) -> Self {
        Self { bytes: bytes.len() as u64, blake3: blake3::hash(bytes).to_hex().to_string() }
    }
}

impl Manifest {
    /// True if the result can be used.
    pub fn is_ok(&self) -> bool {
        self.outcome == Outcome::Ok
    }

    /// Differences between what this result was made from and the given version, parameters and
    /// inputs, in words; empty if there are none.
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
                // appears and disappears together with the result of the same recording
                None if name.starts_with(ROLE) => {}
                None => changes.push(format!("new input: {}", in_words(name))),
                Some(old) if old != hash => changes.push(format!("input changed: {}", in_words(name))),
                Some(_) => {}
            }
        }
        changes.extend(
            self.inputs
                .keys()
                .filter(|k| !inputs.contains_key(*k) && !k.starts_with(ROLE))
                .map(|k| format!("input gone: {}", in_words(k))),
        );
        changes
    }
}

/// Prefix of the key of an input that is the role of a recording.
pub const ROLE: &str = "role ";

/// An input's key in words: `file jump01.c3d`, `ik/jump01` or `role jump01`.
fn in_words(key: &str) -> String {
    if let Some(trial) = key.strip_prefix(ROLE) {
        return format!("the part that {trial} plays");
    }
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

/// Suffix of an old result that is being replaced.
const OLD: &str = "~old";

/// The workspace of one study.
#[derive(Debug)]
pub struct Workspace {
    root: PathBuf,
    inputs: Mutex<BTreeMap<String, InputStamp>>,
    /// Results whose files this process compared with their hashes, with the problems found.
    examined: Mutex<HashMap<(String, String), Vec<String>>>,
}

/// A recording's hash and the file metadata for which it holds.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
struct InputStamp {
    #[serde(flatten)]
    identity: Identity,
    hash: String,
    /// False if the file changed so shortly before it was read that a further change might carry
    /// the same time.
    #[serde(skip, default = "settled")]
    settled: bool,
}

fn settled() -> bool {
    true
}

/// File metadata that change with a file's content: a copy with the old size and time (`cp -p`) has
/// another change time or another inode.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
struct Identity {
    bytes: u64,
    modified_ns: u64,
    changed_ns: u64,
    inode: u64,
    device: u64,
}

/// Minimum age of a change time before it is relied on, ns: file systems have a time resolution of
/// up to two seconds.
const TICK_NS: u64 = 2_000_000_000;

impl Identity {
    /// None if the system does not record when a file was changed: its content is then read every
    /// time.
    #[cfg(unix)]
    fn of(meta: &std::fs::Metadata) -> Option<Self> {
        use std::os::unix::fs::MetadataExt;
        let ns = |s: i64, ns: i64| (s.max(0) as u64).saturating_mul(1_000_000_000).saturating_add(ns.max(0) as u64);
        Some(Self {
            bytes: meta.len(),
            modified_ns: ns(meta.mtime(), meta.mtime_nsec()),
            changed_ns: ns(meta.ctime(), meta.ctime_nsec()),
            inode: meta.ino(),
            device: meta.dev(),
        })
    }

    #[cfg(not(unix))]
    fn of(_: &std::fs::Metadata) -> Option<Self> {
        None
    }

    fn is_settled(&self) -> bool {
        let now = SystemTime::now().duration_since(UNIX_EPOCH).map_or(0, |d| d.as_nanos() as u64);
        now > self.changed_ns.max(self.modified_ns).saturating_add(TICK_NS)
    }
}

/// A folder in which a result is being made, not visible to readers; removed when dropped.
#[derive(Debug)]
pub struct Scratch {
    path: PathBuf,
    owner: Owned,
}

impl Deref for Scratch {
    type Target = Path;
    fn deref(&self) -> &Path {
        &self.path
    }
}

impl Drop for Scratch {
    fn drop(&mut self) {
        let _ = std::fs::remove_dir_all(&self.path);
        let _ = std::fs::remove_file(&self.owner.path);
    }
}

/// A complete result with its manifest, not yet visible to readers; removed when dropped.
#[derive(Debug)]
pub struct Complete {
    scratch: Scratch,
    manifest: Manifest,
}

/// An error for a workspace that was made by another version of the program; such a workspace is
/// neither read nor written.
pub fn refuse_other_format(root: &Path) -> Result<(), PipelineError> {
    let marker = root.join(MARKER);
    let Ok(text) = std::fs::read_to_string(&marker) else { return Ok(()) };
    let stated = text.lines().find_map(|l| l.strip_prefix("format ")).map(|n| n.trim().parse::<u32>());
    let found = match stated {
        Some(Ok(FORMAT)) => return Ok(()),
        Some(Ok(n)) => format!("format {n}"),
        Some(Err(_)) => "a format that is not a number".to_owned(),
        None if !holds_results(root) => return Ok(()),
        None => "no format (an earlier aloft made it, or the file was damaged)".to_owned(),
    };
    let newer = matches!(stated, Some(Ok(n)) if n > FORMAT);
    Err(PipelineError::request_hint(
        format!("{} states {found}; aloft {} works with format {FORMAT}", marker.display(), env!("CARGO_PKG_VERSION")),
        if newer {
            "use the newer aloft that made it, or give --workspace a new folder"
        } else {
            "give --workspace a new folder and run again: everything is made from the recordings (add effects of the model again)"
        },
    ))
}

/// True for a folder that contains a model's revisions or a result of some stage.
fn holds_results(root: &Path) -> bool {
    let below = |folder: &Path| std::fs::read_dir(folder).into_iter().flatten().flatten().map(|e| e.path());
    root.join("model.json").exists()
        || below(root).flat_map(|stage| below(&stage).collect::<Vec<_>>()).any(|trial| trial.join(MANIFEST).is_file())
}

/// Lock on the workspace for one run; released when dropped, and by the operating system however
/// the process ends.
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

/// The process that holds a workspace.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Holder {
    /// Process id.
    pub pid: u32,
    /// Computer name.
    pub host: String,
    /// Start time, UTC.
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

/// Name of the computer, if the system provides it.
pub(crate) fn host_name() -> String {
    let from_files =
        ["/proc/sys/kernel/hostname", "/etc/hostname"].iter().find_map(|p| std::fs::read_to_string(p).ok());
    let from_words = || ["COMPUTERNAME", "HOSTNAME", "HOST"].iter().find_map(|v| std::env::var(v).ok());
    from_files
        .or_else(from_words)
        .map(|s| s.trim().to_owned())
        .filter(|s| !s.is_empty())
        .unwrap_or("this computer".into())
}

/// A time formatted as `2026-03-01 14:05:09 UTC` (proleptic Gregorian calendar; days to civil dates
/// after Hinnant's algorithm).
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
        // a missing or damaged list is rebuilt by reading every recording
        let inputs = seal::read(&root.join(INPUTS)).unwrap_or_default();
        Self { root: root.to_path_buf(), inputs: Mutex::new(inputs), examined: Mutex::default() }
    }

    /// Creates the folder if needed and takes the lock, waiting up to `patience` for its holder;
    /// after that the error names the holder.
    pub fn lock(&self, patience: Duration) -> Result<WorkspaceLock, PipelineError> {
        let marker = self.root.join(MARKER);
        let own = |name: &std::ffi::OsStr| is_temporary(&name.to_string_lossy());
        // check the marker last: a process that is creating the workspace at this moment writes the
        // marker first
        if self.root.is_dir()
            && std::fs::read_dir(&self.root).is_ok_and(|d| d.flatten().any(|e| !own(&e.file_name())))
            && !marker.is_file()
        {
            return Err(PipelineError::request_hint(
                format!("{} is not empty and is not a workspace", self.root.display()),
                "give --workspace a new or empty folder, so that nothing of yours is overwritten",
            ));
        }
        disk::create_dir_all(&self.root)?;
        refuse_other_format(&self.root)?;
        if std::fs::read_to_string(&marker).ok().is_none_or(|text| text != marker_text()) {
            write_whole(&marker, marker_text().as_bytes())?;
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
        self.clear_abandoned()?;
        Ok(WorkspaceLock { _file: file, note })
    }

    /// Removes the unfinished files of killed processes, and restores results that they had moved
    /// away. Files of a process that still runs are left alone: it holds a lock on them.
    pub fn clear_abandoned(&self) -> Result<(), PipelineError> {
        for folder in [self.root.clone(), self.root.join("discoveries")] {
            for entry in std::fs::read_dir(folder).into_iter().flatten().flatten() {
                if is_temporary(&entry.file_name().to_string_lossy()) && abandoned(&entry.path()) {
                    let _ = std::fs::remove_file(entry.path());
                }
            }
        }
        let scratch = self.root.join(SCRATCH);
        let entries: Vec<PathBuf> =
            std::fs::read_dir(&scratch).into_iter().flatten().flatten().map(|e| e.path()).collect();
        let name = |p: &Path| p.file_name().map(|n| n.to_string_lossy().into_owned()).unwrap_or_default();
        let owner_of = |p: &Path| scratch.join(format!("{}.lock", name(p).split('.').next().unwrap_or_default()));
        for path in entries.iter().filter(|p| p.is_dir()) {
            let owner = owner_of(path);
            if owner.exists() && !abandoned(&owner) {
                continue;
            }
            if name(path).ends_with(OLD) {
                self.put_back(path)?;
            }
        }
        for path in entries.iter().filter(|p| p.is_dir() && p.exists()) {
            let owner = owner_of(path);
            if !owner.exists() || abandoned(&owner) {
                disk::remove_dir_all(path)?;
            }
        }
        for path in entries.iter().filter(|p| p.is_file() && abandoned(p)) {
            let _ = std::fs::remove_file(path);
        }
        Ok(())
    }

    /// Restores an old result. A run that was killed after moving the old result away and before
    /// moving the new one in leaves the old one among its temporary folders. If the result is
    /// missing in its place, the old one is moved back, so that no finished result is lost.
    fn put_back(&self, old: &Path) -> Result<(), PipelineError> {
        let Ok(manifest) = seal::read::<Manifest>(&old.join(MANIFEST)) else { return Ok(()) };
        let place = self.place(&manifest.stage, &manifest.trial);
        // if the complete new result is next to it, that one is preferred
        let new = PathBuf::from(old.to_string_lossy().trim_end_matches(OLD));
        let whole = seal::read::<Manifest>(&new.join(MANIFEST)).is_ok();
        if !place.exists() {
            disk::rename(if whole { &new } else { old }, &place)?;
        }
        Ok(())
    }

    /// The root folder.
    pub fn root(&self) -> &Path {
        &self.root
    }

    /// Folder for the result of a stage.
    pub fn place(&self, stage: &str, trial: &str) -> PathBuf {
        self.root.join(stage).join(trial)
    }

    /// The manifest of a result, if it exists and is undamaged.
    pub fn manifest(&self, stage: &str, trial: &str) -> Option<Manifest> {
        seal::read(&self.place(stage, trial).join(MANIFEST)).ok()
    }

    /// Problems in the files of a result, in words; empty if they are unchanged or if there is no
    /// result. Every file is read once per process.
    pub fn damage(&self, stage: &str, trial: &str) -> Vec<String> {
        let key = (stage.to_owned(), trial.to_owned());
        let lock = || self.examined.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(known) = lock().get(&key) {
            return known.clone();
        }
        let found = examine(&self.place(stage, trial));
        lock().insert(key, found.clone());
        found
    }

    /// Discards the findings of [`Workspace::damage`], because another process may have made the
    /// result again.
    pub fn forget(&self, stage: &str, trial: &str) {
        let mut known = self.examined.lock().unwrap_or_else(PoisonError::into_inner);
        known.remove(&(stage.to_owned(), trial.to_owned()));
    }

    /// Creates a new folder to write a result into, not yet visible to readers.
    pub fn scratch(&self, stage: &str, trial: &str) -> Result<Scratch, PipelineError> {
        let folder = self.root.join(SCRATCH);
        disk::create_dir_all(&folder)?;
        let (owner, token) = Owned::create(|token| folder.join(format!("{token}.lock")))?;
        let path = folder.join(format!("{token}.{stage}-{trial}"));
        let scratch = Scratch { path, owner };
        disk::create_dir_all(&scratch.path)?;
        Ok(scratch)
    }

    /// Writes the manifest next to the tables. Nothing is visible to readers yet.
    pub fn complete(&self, scratch: Scratch, mut manifest: Manifest) -> Result<Complete, PipelineError> {
        manifest.files = stamps(&scratch)?;
        manifest.output = hash_of(&manifest.files);
        seal::write(&scratch.join(MANIFEST), &manifest)?;
        Ok(Complete { scratch, manifest })
    }

    /// Writes the manifest next to the tables, waits until all files are on the disk, and renames
    /// the folder into place.
    pub fn commit(&self, scratch: Scratch, manifest: Manifest) -> Result<Manifest, PipelineError> {
        let placed = self.place_all(vec![self.complete(scratch, manifest)?], disk::SYNCS);
        let (manifest, done) =
            placed.into_iter().next().ok_or_else(|| PipelineError::request("nothing was written"))?;
        done.map(|()| manifest)
    }

    /// Puts results in place, in this order: flush the content of all files to disk, `at_once` at a
    /// time; flush the names in their folders; rename the folders; flush the new names; remove what
    /// was replaced. A problem with one result does not affect the others.
    pub fn place_all(&self, batch: Vec<Complete>, at_once: usize) -> Vec<(Manifest, Result<(), PipelineError>)> {
        let mut done: Vec<Result<Option<PathBuf>, PipelineError>> = batch.iter().map(|_| Ok(None)).collect();
        let files = batch.iter().enumerate().flat_map(|(i, result)| {
            let names = result.manifest.files.keys().map(String::as_str).chain([MANIFEST]);
            names.map(move |name| (i, result.scratch.join(name)))
        });
        wait_for(files, at_once, &mut done);
        if cfg!(unix) {
            let folders = batch.iter().map(|result| result.scratch.to_path_buf()).enumerate();
            wait_for(folders, at_once, &mut done);
        }
        for (result, done) in batch.iter().zip(&mut done).filter(|(_, done)| done.is_ok()) {
            *done = self.rename_into_place(result);
        }
        let stages: BTreeSet<&str> = batch.iter().map(|result| result.manifest.stage.as_str()).collect();
        for stage in stages {
            let of_stage = batch.iter().zip(&mut done).filter(|(r, done)| r.manifest.stage == stage && done.is_ok());
            let mut of_stage = of_stage.map(|(_, done)| done).peekable();
            if of_stage.peek().is_some()
                && let Err(e) = disk::sync_folder(&self.root.join(stage))
            {
                // the old results stay among the temporary folders until the next run clears up
                of_stage.for_each(|done| *done = Err(PipelineError::request(e.to_string())));
            }
        }
        let mut out = Vec::with_capacity(batch.len());
        for (Complete { manifest, scratch }, done) in batch.into_iter().zip(done) {
            let done = done.and_then(|old| old.map_or(Ok(()), |old| disk::remove_dir_all(&old)));
            drop(scratch);
            if done.is_ok() {
                // the files just written were hashed as they are on the disk
                let key = (manifest.stage.clone(), manifest.trial.clone());
                self.examined.lock().unwrap_or_else(PoisonError::into_inner).insert(key, Vec::new());
            }
            out.push((manifest, done));
        }
        out
    }

    /// Returns the present path of the result that was there before.
    fn rename_into_place(&self, result: &Complete) -> Result<Option<PathBuf>, PipelineError> {
        let Complete { manifest, scratch } = result;
        let place = self.place(&manifest.stage, &manifest.trial);
        let parent = self.root.join(&manifest.stage);
        if !parent.is_dir() {
            disk::create_dir_all(&parent)?;
            disk::sync_folder(&self.root)?;
        }
        if !place.exists() {
            return disk::rename(scratch, &place).map(|()| None);
        }
        let mut old = scratch.as_os_str().to_owned();
        old.push(OLD);
        let old = PathBuf::from(old);
        disk::rename(&place, &old)?;
        if let Err(e) = disk::rename(scratch, &place) {
            // if this fails, too, the next run does it
            let _ = disk::rename(&old, &place);
            return Err(e);
        }
        Ok(Some(old))
    }

    /// Content hash of a recording. The file is read again only if the file system indicates a
    /// possible change: in size, modification time, change time or inode.
    pub fn input_hash(&self, path: &Path) -> Result<String, PipelineError> {
        let identity = |path: &Path| -> Result<Option<Identity>, PipelineError> {
            Ok(Identity::of(&std::fs::metadata(path).map_err(PipelineError::io("read", path))?))
        };
        let before = identity(path)?;
        let key = path.canonicalize().unwrap_or_else(|_| path.to_path_buf()).display().to_string();
        if let Ok(known) = self.inputs.lock()
            && let Some(stamp) = known.get(&key)
            && before.as_ref() == Some(&stamp.identity)
        {
            return Ok(stamp.hash.clone());
        }
        let bytes = std::fs::read(path).map_err(PipelineError::io("read", path))?;
        let hash = blake3::hash(&bytes).to_hex().to_string();
        if let (Ok(mut known), Some(identity)) = (self.inputs.lock(), before) {
            let settled = identity.is_settled();
            known.insert(key, InputStamp { identity, hash: hash.clone(), settled });
        }
        Ok(hash)
    }

    /// Stores the hashes of the recordings for the next run.
    pub fn save_input_hashes(&self) -> Result<(), PipelineError> {
        let mut known = self.inputs.lock().map(|k| k.clone()).unwrap_or_default();
        known.retain(|_, stamp| stamp.settled);
        let place = self.root.join(INPUTS);
        if seal::read::<BTreeMap<String, InputStamp>>(&place).is_ok_and(|old| old == known) {
            return Ok(());
        }
        seal::write_whole(&place, &known)
    }
}

/// Hashes of recordings, so that they need not be read at every call.
const INPUTS: &str = "inputs.json";

/// Folder for files being written.
const SCRATCH: &str = ".tmp";

/// File that states what a result was made from and which files belong to it.
const MANIFEST: &str = "manifest.json";

/// Waits until files or folders of results are on the disk, each given with the index of its
/// result; the first error of each result is kept.
fn wait_for<T>(paths: impl Iterator<Item = (usize, PathBuf)>, at_once: usize, done: &mut [Result<T, PipelineError>]) {
    let (of, paths): (Vec<usize>, Vec<PathBuf>) = paths.filter(|(i, _)| done[*i].is_ok()).unzip();
    for (i, answer) in of.into_iter().zip(disk::sync_each(&paths, at_once)) {
        if let (Err(e), Ok(_)) = (answer, &done[i]) {
            done[i] = Err(e);
        }
    }
}

/// Compares a result's folder with its manifest.
fn examine(place: &Path) -> Vec<String> {
    if !place.exists() {
        return Vec::new();
    }
    let manifest: Manifest = match seal::read(&place.join(MANIFEST)) {
        Ok(manifest) => manifest,
        Err(PipelineError::Damaged { problem, .. }) => return vec![format!("{MANIFEST}: {problem}")],
        Err(PipelineError::Io { source, .. }) => return vec![format!("{MANIFEST}: {source}")],
        Err(e) => return vec![format!("{MANIFEST}: {e}")],
    };
    let mut problems = Vec::new();
    for (name, stamp) in &manifest.files {
        match std::fs::read(place.join(name)) {
            Err(e) if e.kind() == std::io::ErrorKind::NotFound => problems.push(format!("{name} is missing")),
            Err(e) => problems.push(format!("{name}: {e}")),
            Ok(bytes) if bytes.len() as u64 != stamp.bytes => {
                problems.push(format!("{name} has {} bytes, expected {}", bytes.len(), stamp.bytes));
            }
            Ok(bytes) if FileStamp::of(&bytes) != *stamp => {
                problems.push(format!("{name}: its content is not what was written"));
            }
            Ok(_) => {}
        }
    }
    // hidden files belong to the file system or to file managers
    let names = std::fs::read_dir(place).into_iter().flatten().flatten();
    for name in names.map(|e| e.file_name().to_string_lossy().into_owned()) {
        if name != MANIFEST && !name.starts_with('.') && !manifest.files.contains_key(&name) {
            problems.push(format!("{name} does not belong to the result"));
        }
    }
    problems
}

/// Files of a folder with their hashes.
fn stamps(folder: &Path) -> Result<BTreeMap<String, FileStamp>, PipelineError> {
    let mut all = BTreeMap::new();
    for entry in std::fs::read_dir(folder).map_err(PipelineError::io("list", folder))? {
        let path = entry.map_err(PipelineError::io("list", folder))?.path();
        let bytes = std::fs::read(&path).map_err(PipelineError::io("read", &path))?;
        let name = path.file_name().map(|n| n.to_string_lossy().into_owned()).unwrap_or_default();
        all.insert(name, FileStamp::of(&bytes));
    }
    Ok(all)
}

/// Combined hash of all files of a result.
fn hash_of(files: &BTreeMap<String, FileStamp>) -> String {
    let mut hasher = blake3::Hasher::new();
    for (name, stamp) in files {
        hasher.update(&(name.len() as u64).to_le_bytes());
        hasher.update(name.as_bytes());
        hasher.update(stamp.blake3.as_bytes());
    }
    hasher.finalize().to_hex().to_string()
}

/// Writes pretty JSON.
pub fn write_json<T: Serialize>(path: &Path, value: &T) -> Result<(), PipelineError> {
    let text = serde_json::to_vec_pretty(value)
        .map_err(|e| PipelineError::Table { path: path.to_path_buf(), problem: e.to_string() })?;
    disk::write(path, &text)
}

/// Writes pretty JSON, completely or not at all.
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
            files: BTreeMap::new(),
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
            ws.commit(ws.scratch("ik", trial).unwrap(), manifest(trial, 1.0)).unwrap();
        }
        drop(lock);
        // killed between the two renames: once with the new result complete, once with it
        // half-written
        let moved = |trial: &str, token: &str| {
            let scratch = ws.root().join(SCRATCH).join(format!("{token}.ik-{trial}"));
            std::fs::create_dir_all(&scratch).unwrap();
            std::fs::write(ws.root().join(SCRATCH).join(format!("{token}.lock")), "").unwrap();
            std::fs::rename(ws.place("ik", trial), format!("{}{OLD}", scratch.display())).unwrap();
            scratch
        };
        seal::write(&moved("a.1", "pc-1-0").join(MANIFEST), &manifest("a.1", 2.0)).unwrap();
        std::fs::write(moved("a.2", "pc-1-1").join(MANIFEST), "{\"stage\": \"i").unwrap();
        assert!(ws.manifest("ik", "a.1").is_none() && ws.manifest("ik", "a.2").is_none());
        // files that a running process is still writing stay
        let live = ws.scratch("ik", "a.3").unwrap();
        let file = disk::Temporary::beside(&ws.root().join("discovery.json")).unwrap();
        let _lock = ws.lock(Duration::ZERO).unwrap();
        assert_eq!(ws.manifest("ik", "a.1").map(|m| m.seconds), Some(2.0));
        assert_eq!(ws.manifest("ik", "a.2").map(|m| m.seconds), Some(1.0));
        assert!(live.is_dir() && file.path().is_file());
        drop((live, file));
        assert_eq!(std::fs::read_dir(ws.root().join(SCRATCH)).unwrap().count(), 0);
    }

    #[test]
    fn a_result_that_cannot_be_placed_leaves_what_stood_there_and_the_others_go_on() {
        let names = ["a", "b", "c", "d"];
        for (broken, way) in (0..names.len()).flat_map(|i| [(i, "file"), (i, "folder"), (i, "place")]) {
            let dir = tempfile::tempdir().unwrap();
            let ws = Workspace::open(&dir.path().join("ws"));
            let lock = ws.lock(Duration::ZERO).unwrap();
            let make = |name: &str, seconds: f64| {
                let scratch = ws.scratch("ik", name).unwrap();
                disk::write(&scratch.join("x.json"), seconds.to_string().as_bytes()).unwrap();
                ws.complete(scratch, manifest(name, seconds)).unwrap()
            };
            assert!(ws.place_all(Vec::new(), 8).is_empty());
            let first = ws.place_all(names.map(|n| make(n, 1.0)).into(), 8);
            assert!(first.iter().all(|(_, done)| done.is_ok()));
            let batch = names.map(|n| make(n, 2.0));
            let scratch = batch[broken].scratch.to_path_buf();
            match way {
                "file" => std::fs::remove_file(scratch.join("x.json")).unwrap(),
                "folder" => std::fs::remove_dir_all(&scratch).unwrap(),
                // the new folder cannot be renamed onto a file that appears there in between
                _ => {
                    std::fs::remove_dir_all(ws.place("ik", names[broken])).unwrap();
                    #[cfg(unix)]
                    std::os::unix::fs::symlink(dir.path().join("gone"), ws.place("ik", names[broken])).unwrap();
                    #[cfg(not(unix))]
                    continue;
                }
            }
            let done = ws.place_all(batch.into(), 8);
            for (i, (m, done)) in done.iter().enumerate() {
                assert_eq!((m.trial.as_str(), done.is_err()), (names[i], i == broken), "{way} {broken}");
                let now = Workspace::open(ws.root());
                let stands = now.manifest("ik", names[i]).map(|m| m.seconds);
                let wanted = if i != broken { Some(2.0) } else { Some(1.0).filter(|_| way != "place") };
                assert_eq!(stands, wanted, "{way} {broken} {i}");
                assert!(stands.is_none() || now.damage("ik", names[i]).is_empty());
                if let Err(e) = done {
                    assert!(e.to_string().contains(&scratch.display().to_string()), "{e}");
                }
            }
            drop(lock);
            assert_eq!(std::fs::read_dir(ws.root().join(SCRATCH)).unwrap().count(), 0, "{way} {broken}");
        }
    }

    #[test]
    fn every_damage_of_a_result_is_found() {
        let dir = tempfile::tempdir().unwrap();
        let ws = Workspace::open(&dir.path().join("ws"));
        let make = || {
            let scratch = ws.scratch("ik", "a").unwrap();
            disk::write(&scratch.join("x.json"), b"{\"x\": 1}").unwrap();
            disk::write(&scratch.join("y.parquet"), &[7; 500]).unwrap();
            ws.commit(scratch, manifest("a", 1.0)).unwrap();
        };
        make();
        let place = ws.place("ik", "a");
        let look = || Workspace::open(ws.root()).damage("ik", "a");
        assert!(look().is_empty() && Workspace::open(ws.root()).damage("ik", "b").is_empty());
        for name in ["x.json", "y.parquet", MANIFEST] {
            let path = place.join(name);
            let bytes = std::fs::read(&path).unwrap();
            for i in (0..bytes.len()).step_by(7) {
                let mut flipped = bytes.clone();
                flipped[i] ^= 16;
                for wrong in [flipped, bytes[..i].to_vec()] {
                    std::fs::write(&path, wrong).unwrap();
                    assert!(look().iter().any(|p| p.contains(name)), "{name} at {i}");
                }
            }
            std::fs::remove_file(&path).unwrap();
            assert!(look().iter().any(|p| p.contains(name)));
            std::fs::write(&path, bytes).unwrap();
            assert!(look().is_empty());
        }
        std::fs::write(place.join("z.json"), "").unwrap();
        assert!(look().iter().any(|p| p.contains("z.json does not belong")));
        make();
        assert!(look().is_empty());
    }

    #[test]
    #[cfg(unix)]
    fn a_recording_of_equal_size_and_time_is_read_again() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("a.c3d");
        let set = |text: &str, time: SystemTime| {
            std::fs::write(&path, text).unwrap();
            File::options().write(true).open(&path).unwrap().set_modified(time).unwrap();
        };
        let time = UNIX_EPOCH + Duration::from_secs(1_000_000_000);
        set("one", time);
        let root = dir.path().join("ws");
        std::fs::create_dir(&root).unwrap();
        let ws = Workspace::open(&root);
        let first = ws.input_hash(&path).unwrap();
        ws.save_input_hashes().unwrap();
        set("two", time);
        assert_ne!(Workspace::open(&root).input_hash(&path).unwrap(), first);
        // a file unchanged for a while is not read again: its hash is taken from the list
        std::thread::sleep(Duration::from_nanos(TICK_NS + 50_000_000));
        let ws = Workspace::open(&root);
        let second = ws.input_hash(&path).unwrap();
        ws.save_input_hashes().unwrap();
        let listed: BTreeMap<String, InputStamp> = seal::read(&root.join(INPUTS)).unwrap();
        assert_eq!(listed.values().map(|s| s.hash.clone()).collect::<Vec<_>>(), [second]);
    }

    #[test]
    fn unit_workspaces_of_other_formats_are_refused() {
        let dir = tempfile::tempdir().unwrap();
        let lock = |text: &str, name: &str| {
            let root = dir.path().join(name);
            let result = root.join("import/jump01");
            std::fs::create_dir_all(&result).unwrap();
            std::fs::write(result.join(MANIFEST), "{}").unwrap();
            std::fs::write(root.join(MARKER), text).unwrap();
            let told = Workspace::open(&root).lock(Duration::ZERO).map(|_| ()).map_err(|e| e.to_string());
            assert_eq!(std::fs::read_to_string(root.join(MARKER)).unwrap(), text);
            told
        };
        assert!(lock(&marker_text(), "same").is_ok());
        assert!(lock("Results of aloft.\nformat 3\n", "newer").unwrap_err().contains("format 3"));
        assert!(lock("Results of aloft.\n", "older").unwrap_err().contains("no format"));
        assert!(lock("", "emptied").unwrap_err().contains("no format"));
        // a marker written by a workflow into a new folder
        let root = dir.path().join("new");
        std::fs::create_dir(&root).unwrap();
        std::fs::write(root.join(MARKER), "Results of aloft.\n").unwrap();
        Workspace::open(&root).lock(Duration::ZERO).unwrap();
        assert_eq!(std::fs::read_to_string(root.join(MARKER)).unwrap(), marker_text());
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
