//! The folder of results: one folder a stage and trial with tables and a manifest, renamed into place when complete.

use crate::error::{PipelineError, StageFailure};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::fs::{File, TryLockError};
use std::io::{Read, Seek, Write};
use std::path::{Path, PathBuf};
use std::sync::Mutex;
use std::time::UNIX_EPOCH;

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
                None => changes.push(format!("new input: {name}")),
                Some(old) if old != hash => changes.push(format!("input changed: {name}")),
                Some(_) => {}
            }
        }
        changes.extend(self.inputs.keys().filter(|k| !inputs.contains_key(*k)).map(|k| format!("input gone: {k}")));
        changes
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

/// Holds the workspace for one run; released when dropped.
#[derive(Debug)]
pub struct WorkspaceLock {
    _file: File,
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

    /// Creates the folder where needed and takes the lock; says who holds it otherwise.
    pub fn lock(&self) -> Result<WorkspaceLock, PipelineError> {
        let marker = self.root.join("ALOFT_WORKSPACE.txt");
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
        let mut file = File::options()
            .create(true)
            .truncate(false)
            .read(true)
            .write(true)
            .open(&path)
            .map_err(PipelineError::io("open", &path))?;
        match file.try_lock() {
            Ok(()) => {}
            Err(TryLockError::WouldBlock) => {
                let mut holder = String::new();
                let _ = file.read_to_string(&mut holder);
                let holder =
                    if holder.trim().is_empty() { "another process".to_owned() } else { holder.trim().to_owned() };
                return Err(PipelineError::Locked { path: self.root.clone(), holder });
            }
            Err(TryLockError::Error(e)) => return Err(PipelineError::io("lock", &path)(e)),
        }
        let note = format!("process {}", std::process::id());
        file.set_len(0)
            .and_then(|()| file.rewind())
            .and_then(|()| file.write_all(note.as_bytes()))
            .map_err(PipelineError::io("write", &path))?;
        let scratch = self.root.join(".tmp");
        if scratch.is_dir() {
            std::fs::remove_dir_all(&scratch).map_err(PipelineError::io("clear", &scratch))?;
        }
        Ok(WorkspaceLock { _file: file })
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
            let old = scratch.with_extension("old");
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
        let new = self.root.join("inputs.json.new");
        write_json(&new, &known)?;
        std::fs::rename(&new, &place).map_err(PipelineError::io("move", &new))
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

/// Reads JSON.
pub fn read_json<T: serde::de::DeserializeOwned>(path: &Path) -> Result<T, PipelineError> {
    let bytes = std::fs::read(path).map_err(PipelineError::io("read", path))?;
    serde_json::from_slice(&bytes)
        .map_err(|e| PipelineError::Table { path: path.to_path_buf(), problem: e.to_string() })
}
