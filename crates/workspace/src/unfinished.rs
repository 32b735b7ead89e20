//! Folders that are being filled: copies of a workspace on which a model is tried, exports and
//! laboratories before they are moved to their places.
//!
//! Such a folder is removed when it is dropped. A process that a signal ends removes its folders
//! and temporary files first ([`remove_all`]); what a killed process leaves is removed by the next
//! one that makes such a folder at the same place, or that locks a workspace there.

use crate::disk::{self, Owned, abandoned};
use crate::error::PipelineError;
use crate::fault::{hold_changes, is_held, wait_if_held};
use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError, RwLock};
use std::time::Duration;

/// First part of their names.
const PREFIX: &str = ".aloft-unfinished-";

/// First parts of the names that earlier versions gave; nothing tells whether one is in use.
const EARLIER: [&str; 2] = [".aloft-export-", ".aloft-promise"];

/// Age from which a folder of an earlier version counts as abandoned: longer than any export or any
/// model takes.
const ABANDONED_AFTER: Duration = Duration::from_hours(1);

/// Ending of the file that is locked while a folder is in use.
const LOCK: &str = ".lock";

/// What this process would leave if it ended now.
static OPEN: Mutex<Vec<PathBuf>> = Mutex::new(Vec::new());

/// Shared by those who make such a file or folder; whoever removes them all waits for it.
static MAKING: RwLock<()> = RwLock::new(());

/// Makes a file or folder and adds it to what [`remove_all`] removes, in one step: a signal finds
/// it either known or not made, and then it is not made any more.
pub(crate) fn begin<T, E>(path: &Path, make: impl FnOnce() -> Result<T, E>) -> Result<T, E> {
    loop {
        wait_if_held();
        let _making = MAKING.read().unwrap_or_else(PoisonError::into_inner);
        if !is_held() {
            let made = make()?;
            OPEN.lock().unwrap_or_else(PoisonError::into_inner).push(path.to_path_buf());
            return Ok(made);
        }
    }
}

/// Takes it out of what [`remove_all`] removes, once it is gone or has its final name.
pub(crate) fn release(path: &Path) {
    OPEN.lock().unwrap_or_else(PoisonError::into_inner).retain(|p| p != path);
}

/// Removes what this process has begun and not finished; for a process that is about to end.
/// Returns what could not be removed.
pub fn remove_all() -> Vec<PathBuf> {
    hold_changes();
    drop(MAKING.write().unwrap_or_else(PoisonError::into_inner));
    let open = std::mem::take(&mut *OPEN.lock().unwrap_or_else(PoisonError::into_inner));
    open.into_iter().filter(|path| !is_removed(path)).collect()
}

/// Removes a file or folder; others may still write into it.
fn is_removed(path: &Path) -> bool {
    const TRIES: usize = 20;
    (0..TRIES).any(|_| {
        let done = if path.is_dir() { std::fs::remove_dir_all(path) } else { std::fs::remove_file(path) };
        let gone = done.is_ok() || path.symlink_metadata().is_err();
        if !gone {
            std::thread::sleep(Duration::from_millis(5));
        }
        gone
    })
}

/// A folder that is being filled; removed when dropped.
#[derive(Debug)]
pub struct Unfinished {
    path: PathBuf,
    owner: Owned,
}

impl Unfinished {
    /// Makes a folder with a new name in another one, and removes those that killed processes left
    /// there.
    ///
    /// # Errors
    /// The folder cannot be made.
    pub fn new_in(parent: &Path) -> Result<Self, PipelineError> {
        clear_abandoned(parent);
        let (owner, token) = Owned::create(|token| parent.join(format!("{PREFIX}{token}{LOCK}")))?;
        let folder = Self { path: parent.join(format!("{PREFIX}{token}")), owner };
        disk::change("create", &folder.path)?;
        begin(&folder.path, || std::fs::create_dir_all(&folder.path))
            .map_err(PipelineError::io("create", &folder.path))?;
        Ok(folder)
    }

    /// The folder.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Gives it its final name, where nothing stands or an empty folder.
    ///
    /// # Errors
    /// Something stands there; the folder cannot be moved.
    pub fn place(self, to: &Path) -> Result<(), PipelineError> {
        if to.is_dir() {
            disk::change("remove", to)?;
            // fails for a folder that is not empty
            std::fs::remove_dir(to).map_err(PipelineError::io("remove", to))?;
        }
        disk::rename(&self.path, to)
    }
}

impl Drop for Unfinished {
    fn drop(&mut self) {
        // the folder first: without its lock it counts as abandoned
        let _ = std::fs::remove_dir_all(&self.path);
        let _ = std::fs::remove_file(&self.owner.path);
        release(&self.path);
    }
}

/// Removes the folders in a folder whose process no longer runs. What cannot be removed is tried
/// again next time.
pub fn clear_abandoned(parent: &Path) {
    for entry in std::fs::read_dir(parent).into_iter().flatten().flatten() {
        let name = entry.file_name().to_string_lossy().into_owned();
        let path = entry.path();
        if EARLIER.iter().any(|p| name.starts_with(p)) {
            // none: without an age nothing is removed
            let age = entry.metadata().and_then(|m| m.modified()).ok().and_then(|t| t.elapsed().ok());
            if path.is_dir() && age.is_some_and(|a| a > ABANDONED_AFTER) {
                let _ = std::fs::remove_dir_all(&path);
            }
        } else if name.starts_with(PREFIX) && name.ends_with(LOCK) && abandoned(&path) {
            let folder = parent.join(name.trim_end_matches(LOCK));
            if !folder.exists() || std::fs::remove_dir_all(&folder).is_ok() {
                let _ = std::fs::remove_file(&path);
            }
        } else if name.starts_with(PREFIX) && !name.ends_with(LOCK) && !parent.join(format!("{name}{LOCK}")).exists() {
            let _ = std::fs::remove_dir_all(&path);
        }
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "tests fail by panicking")]
mod tests {
    use super::*;

    #[test]
    fn regress_folders_of_killed_processes_are_removed_and_those_in_use_are_not() {
        let dir = tempfile::tempdir().unwrap();
        let count = || std::fs::read_dir(dir.path()).unwrap().count();
        let live = Unfinished::new_in(dir.path()).unwrap();
        std::fs::write(live.path().join("a.txt"), "a").unwrap();
        // what killed processes leave: a folder with its lock file, one of them alone
        let left = dir.path().join(format!("{PREFIX}pc-1-1"));
        std::fs::create_dir(&left).unwrap();
        std::fs::write(left.join("b.txt"), "b").unwrap();
        std::fs::write(dir.path().join(format!("{PREFIX}pc-1-1{LOCK}")), "").unwrap();
        std::fs::write(dir.path().join(format!("{PREFIX}pc-1-2{LOCK}")), "").unwrap();
        std::fs::create_dir(dir.path().join(format!("{PREFIX}pc-1-3"))).unwrap();
        // of an earlier version, and young: it may be in use
        std::fs::create_dir(dir.path().join(".aloft-export-x")).unwrap();
        let second = Unfinished::new_in(dir.path()).unwrap();
        assert!(live.path().join("a.txt").is_file() && second.path().is_dir() && !left.exists());
        assert_eq!(count(), 5);
        let place = dir.path().join("place");
        std::fs::create_dir(&place).unwrap();
        live.place(&place).unwrap();
        assert!(place.join("a.txt").is_file());
        assert!(second.place(&place).is_err(), "a filled folder is not replaced");
        assert_eq!(count(), 2, "nothing is left beside it");
    }
}
