//! Hashes of recordings. A recording is read again only if the file system indicates that it may
//! have changed.

use crate::error::PipelineError;
use crate::input;
use crate::seal;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::io::{Error, ErrorKind};
use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};
use std::time::{SystemTime, UNIX_EPOCH};

/// List of the hashes, so that the recordings need not be read at every call.
const INPUTS: &str = "inputs.json";

/// Hashes of the recordings of a workspace.
#[derive(Debug)]
pub(crate) struct InputHashes {
    list: PathBuf,
    known: Mutex<BTreeMap<String, InputStamp>>,
    /// Recordings that this process could not read, with what the system said.
    unread: Mutex<BTreeMap<PathBuf, (ErrorKind, String)>>,
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
        // none: before 1970 nothing is settled
        let now = SystemTime::now().duration_since(UNIX_EPOCH).ok().map_or(0, |d| d.as_nanos() as u64);
        now > self.changed_ns.max(self.modified_ns).saturating_add(TICK_NS)
    }
}

impl InputHashes {
    /// Reads the list of a workspace; a missing or damaged list is rebuilt by reading every
    /// recording.
    pub(crate) fn open(root: &Path) -> Self {
        let list = root.join(INPUTS);
        // none: what is not known is hashed
        let known = seal::read(&list).ok().unwrap_or_default();
        Self { list, known: Mutex::new(known), unread: Mutex::default() }
    }

    /// Content hash of a recording. The file is read again only if its size, modification time,
    /// change time or inode differ. One that could not be read stays so: a recording that counts as
    /// unreadable in one place and not in the next would be taken for changed, or for no copy.
    pub(crate) fn of(&self, path: &Path) -> Result<String, PipelineError> {
        let mut unread = self.unread.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some((kind, words)) = unread.get(path) {
            return Err(PipelineError::io("read", path)(Error::new(*kind, words.clone())));
        }
        let hash = self.of_content(path);
        if let Err(PipelineError::Io { problem, .. }) = &hash {
            unread.insert(path.to_path_buf(), (problem.kind(), problem.to_string()));
        }
        hash
    }

    fn of_content(&self, path: &Path) -> Result<String, PipelineError> {
        let identity =
            |path: &Path| -> Result<Option<Identity>, PipelineError> { Ok(Identity::of(&input::look(path)?)) };
        let before = identity(path)?;
        let key = path.canonicalize().unwrap_or_else(|_| path.to_path_buf()).display().to_string();
        if let Ok(known) = self.known.lock()
            && let Some(stamp) = known.get(&key)
            && before.as_ref() == Some(&stamp.identity)
        {
            return Ok(stamp.hash.clone());
        }
        // in pieces: a long recording need not be in memory for this
        let mut hasher = blake3::Hasher::new();
        hasher.update_reader(input::open(path)?.0).map_err(PipelineError::io("read", path))?;
        let hash = hasher.finalize().to_hex().to_string();
        if let (Ok(mut known), Some(identity)) = (self.known.lock(), before) {
            let settled = identity.is_settled();
            known.insert(key, InputStamp { identity, hash: hash.clone(), settled });
        }
        Ok(hash)
    }

    /// Stores the list for the next run.
    pub(crate) fn save(&self) -> Result<(), PipelineError> {
        let mut known = self.known.lock().unwrap_or_else(PoisonError::into_inner).clone();
        known.retain(|_, stamp| stamp.settled);
        if seal::read_if_whole::<BTreeMap<String, InputStamp>>(&self.list)?.is_some_and(|old| old == known) {
            return Ok(());
        }
        seal::write_whole(&self.list, &known)
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "tests fail by panicking")]
mod tests {
    use super::*;
    use crate::workspace::Workspace;
    use std::fs::File;
    use std::time::Duration;

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
}
