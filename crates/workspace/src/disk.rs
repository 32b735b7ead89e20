//! Changes of the disk: whole files, safe on the disk before they are visible, under temporary names that say whose they are.
//!
//! Every operation that changes a workspace goes through this module. Tests stop the process between any two of them:
//! `ALOFT_STOP_BEFORE=n` ends it before the n-th operation, and with `ALOFT_STOP_TORN=1` in the middle of it, where that operation
//! writes a file.

use crate::error::PipelineError;
use std::fs::{File, TryLockError};
use std::io::Write;
use std::path::{Path, PathBuf};
use std::sync::OnceLock;
use std::sync::atomic::{AtomicU64, AtomicUsize, Ordering};

/// Exit code of a process that a test stopped.
const STOPPED: i32 = 86;

/// Where a test stops the process: before which operation, and whether in the middle of it.
fn stop_at() -> Option<(u64, bool)> {
    static AT: OnceLock<Option<(u64, bool)>> = OnceLock::new();
    *AT.get_or_init(|| {
        let at = std::env::var("ALOFT_STOP_BEFORE").ok()?.parse().ok()?;
        Some((at, std::env::var("ALOFT_STOP_TORN").is_ok_and(|v| v == "1")))
    })
}

/// Counts an operation; true where it is to be torn.
fn torn() -> bool {
    static DONE: AtomicU64 = AtomicU64::new(0);
    let Some((at, torn)) = stop_at() else { return false };
    let this = DONE.fetch_add(1, Ordering::SeqCst) + 1;
    if this >= at && !(torn && this == at) {
        std::process::exit(STOPPED);
    }
    this == at
}

/// Announces an operation that another writer (a table, a page) carries out.
pub fn step() {
    if torn() {
        std::process::exit(STOPPED);
    }
}

fn write_all(file: &mut File, bytes: &[u8], path: &Path) -> Result<(), PipelineError> {
    let tear = torn();
    let part = if tear { &bytes[..bytes.len() / 2] } else { bytes };
    file.write_all(part).map_err(PipelineError::io("write", path))?;
    if tear {
        std::process::exit(STOPPED);
    }
    Ok(())
}

/// Writes a file that nobody reads yet.
pub fn write(path: &Path, bytes: &[u8]) -> Result<(), PipelineError> {
    let mut file = File::create(path).map_err(PipelineError::io("create", path))?;
    write_all(&mut file, bytes, path)
}

/// Renames.
pub fn rename(from: &Path, to: &Path) -> Result<(), PipelineError> {
    step();
    std::fs::rename(from, to).map_err(PipelineError::io("move", from))
}

/// Creates a folder with those above it.
pub fn create_dir_all(path: &Path) -> Result<(), PipelineError> {
    if path.is_dir() {
        return Ok(());
    }
    step();
    std::fs::create_dir_all(path).map_err(PipelineError::io("create", path))
}

/// Removes a folder with everything in it.
pub fn remove_dir_all(path: &Path) -> Result<(), PipelineError> {
    step();
    std::fs::remove_dir_all(path).map_err(PipelineError::io("clear", path))
}

/// Waits until a file's content is on the disk.
pub fn sync(path: &Path) -> Result<(), PipelineError> {
    File::open(path).and_then(|f| f.sync_all()).map_err(PipelineError::io("write to the disk", path))
}

/// Files that one run waits for at a time.
pub const SYNCS: usize = 8;

/// Waits until each of many files is on the disk, so many at a time: side by side the system writes them together, in a seventh of
/// the time. What went wrong with each, in their order.
pub fn sync_each(paths: &[PathBuf], at_once: usize) -> Vec<Result<(), PipelineError>> {
    let next = AtomicUsize::new(0);
    let slots: Vec<OnceLock<Result<(), PipelineError>>> = paths.iter().map(|_| OnceLock::new()).collect();
    let work = || {
        while let Some((path, slot)) = {
            let i = next.fetch_add(1, Ordering::Relaxed);
            paths.get(i).zip(slots.get(i))
        } {
            let _ = slot.set(sync(path));
        }
    };
    std::thread::scope(|scope| {
        for _ in 1..at_once.min(paths.len()) {
            // where the system gives no more threads, those that there are do it
            if std::thread::Builder::new().spawn_scoped(scope, work).is_err() {
                break;
            }
        }
        work();
    });
    paths.iter().zip(slots).map(|(path, slot)| slot.into_inner().unwrap_or_else(|| sync(path))).collect()
}

/// Waits until the names in a folder are on the disk; a system without that notion has nothing to wait for.
pub fn sync_folder(path: &Path) -> Result<(), PipelineError> {
    if cfg!(unix) { sync(path) } else { Ok(()) }
}

/// Ending of a file that is being written.
const NEW: &str = ".new";

/// This process in a temporary name: computer, process, and a number that no other name of the process has.
pub(crate) fn token() -> String {
    static NEXT: AtomicU64 = AtomicU64::new(0);
    let host: String = crate::workspace::host_name()
        .chars()
        .map(|c| if c.is_ascii_alphanumeric() { c } else { '_' })
        .take(40)
        .collect();
    format!("{host}-{}-{}", std::process::id(), NEXT.fetch_add(1, Ordering::Relaxed))
}

/// A file that exists while its owner works and is locked by it: what belongs to a locked file is in use.
#[derive(Debug)]
pub(crate) struct Owned {
    pub path: PathBuf,
    file: File,
}

impl Owned {
    /// Creates and locks a file of the name that `named` makes of a token.
    pub fn create(named: impl Fn(&str) -> PathBuf) -> Result<(Self, String), PipelineError> {
        loop {
            let token = token();
            let path = named(&token);
            step();
            let file = File::options()
                .create_new(true)
                .read(true)
                .write(true)
                .open(&path)
                .map_err(PipelineError::io("create", &path))?;
            // whoever clears up may have found it in the moment before the lock; a file system without locks is taken as it is
            let taken = matches!(file.try_lock(), Err(TryLockError::WouldBlock));
            if !taken && path.is_file() {
                return Ok((Self { path, file }, token));
            }
        }
    }
}

/// True when the owner of a file that [`Owned::create`] made is gone.
pub(crate) fn abandoned(path: &Path) -> bool {
    let Ok(file) = File::options().read(true).write(true).open(path) else { return false };
    match file.try_lock() {
        Ok(()) => true,
        Err(TryLockError::WouldBlock) => false,
        // without locks: a process of this computer that no longer runs
        Err(TryLockError::Error(_)) => {
            let name = path.file_name().map(|n| n.to_string_lossy().into_owned()).unwrap_or_default();
            let mut parts = name.trim_end_matches(NEW).trim_end_matches(".lock").rsplit('-');
            let pid = parts.nth(1).unwrap_or_default();
            let here = token();
            let host = here.split('-').next().unwrap_or_default();
            cfg!(target_os = "linux")
                && name.contains(&format!("{host}-{pid}-"))
                && !Path::new("/proc").join(pid).exists()
        }
    }
}

/// A file on its way to its place: written under a name of this process, then renamed. Removed when dropped before that.
#[derive(Debug)]
pub struct Temporary {
    own: Owned,
    target: PathBuf,
    placed: bool,
}

impl Temporary {
    /// Beside its later place, locked for as long as this process works on it.
    pub fn beside(target: &Path) -> Result<Self, PipelineError> {
        let name = target.file_name().map(|n| n.to_string_lossy().into_owned()).unwrap_or_default();
        let (own, _) = Owned::create(|token| target.with_file_name(format!(".{name}.{token}{NEW}")))?;
        Ok(Self { own, target: target.to_path_buf(), placed: false })
    }

    /// Where it is written.
    pub fn path(&self) -> &Path {
        &self.own.path
    }

    /// Puts it into its place, once its content is on the disk.
    pub fn place(mut self) -> Result<(), PipelineError> {
        self.own.file.sync_all().map_err(PipelineError::io("write to the disk", &self.own.path))?;
        rename(&self.own.path, &self.target)?;
        self.placed = true;
        let folder = self.target.parent().filter(|p| !p.as_os_str().is_empty());
        folder.map_or(Ok(()), sync_folder)
    }
}

impl Drop for Temporary {
    fn drop(&mut self) {
        if !self.placed {
            let _ = std::fs::remove_file(&self.own.path);
        }
    }
}

/// True for the name of a [`Temporary`].
pub(crate) fn is_temporary(name: &str) -> bool {
    name.starts_with('.') && name.ends_with(NEW)
}

/// Writes a file whole or not at all: beside its place, onto the disk, then renamed into place.
pub fn write_whole(path: &Path, bytes: &[u8]) -> Result<(), PipelineError> {
    let mut new = Temporary::beside(path)?;
    write_all(&mut new.own.file, bytes, path)?;
    new.place()
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "tests fail by panicking")]
mod tests {
    use super::*;

    #[test]
    fn prop_each_file_has_its_own_answer() {
        let dir = tempfile::tempdir().unwrap();
        for n in [0, 1, 2, 7, 40] {
            let paths: Vec<PathBuf> = (0..n).map(|i| dir.path().join(format!("{n}-{i}"))).collect();
            for path in paths.iter().step_by(3) {
                std::fs::write(path, "x").unwrap();
            }
            for at_once in [0, 1, 8] {
                let answers = sync_each(&paths, at_once);
                assert_eq!(answers.len(), n);
                for (path, answer) in paths.iter().zip(answers) {
                    let named = |e: PipelineError| e.to_string().contains(&path.display().to_string());
                    assert!(answer.map_or_else(named, |()| path.is_file()));
                }
            }
        }
    }

    #[test]
    fn prop_a_temporary_file_is_abandoned_only_without_its_owner() {
        let dir = tempfile::tempdir().unwrap();
        let target = dir.path().join("model.json");
        let live = Temporary::beside(&target).unwrap();
        let path = live.path().to_path_buf();
        assert!(is_temporary(&path.file_name().unwrap().to_string_lossy()) && !abandoned(&path));
        live.place().unwrap();
        assert!(target.is_file() && !path.exists());
        drop(Temporary::beside(&target).unwrap());
        assert_eq!(std::fs::read_dir(dir.path()).unwrap().count(), 1);
        // what a killed process leaves
        std::fs::write(&path, "").unwrap();
        assert!(abandoned(&path));
    }
}
