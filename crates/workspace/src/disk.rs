//! All reading and all changes on disk. Files are written completely and flushed to disk before
//! they become visible; temporary names identify the process that owns them.
//!
//! Every operation on a file goes through this module, whichever crate asks for it, so that tests
//! can end the process between any two of them and make any of them fail (`crate::fault`).

use crate::error::PipelineError;
use crate::fault::{Extent, Operation, after_half, before};
use crate::unfinished::{begin, release};
use std::fs::{File, TryLockError};
use std::io::{Result as IoResult, Write};
use std::path::{Path, PathBuf};
use std::sync::OnceLock;
use std::sync::atomic::{AtomicU64, AtomicUsize, Ordering};

/// Begins a change that has no middle.
pub(crate) fn change(action: &'static str, path: &Path) -> Result<(), PipelineError> {
    match before(Operation::Change, action, path) {
        Ok(Extent::Whole) => Ok(()),
        Ok(Extent::Half) => Err(PipelineError::io(action, path)(after_half())),
        Err(e) => Err(PipelineError::io(action, path)(e)),
    }
}

fn write_all(file: &mut File, bytes: &[u8], path: &Path) -> IoResult<()> {
    if before(Operation::Change, "write", path)? == Extent::Whole {
        return file.write_all(bytes);
    }
    file.write_all(&bytes[..bytes.len() / 2])?;
    Err(after_half())
}

/// Reads a file.
pub fn read(path: &Path) -> Result<Vec<u8>, PipelineError> {
    crate::input::bytes(path)
}

/// True if a file or folder exists; an error if that cannot be told.
pub fn is_there(path: &Path) -> Result<bool, PipelineError> {
    match path.try_exists() {
        Ok(there) => Ok(there),
        // a file stands where a folder of the path would be
        Err(e) if e.kind() == std::io::ErrorKind::NotADirectory => Ok(false),
        Err(e) => Err(PipelineError::io("look for", path)(e)),
    }
}

/// Writes a file that is not yet visible to readers.
pub fn write(path: &Path, bytes: &[u8]) -> Result<(), PipelineError> {
    let mut file = File::create(path).map_err(PipelineError::io("create", path))?;
    write_all(&mut file, bytes, path).map_err(PipelineError::io("write", path))
}

/// A file that another writer (a table, a page) fills.
#[derive(Debug)]
pub struct Out {
    file: File,
    path: PathBuf,
    begun: bool,
}

impl Write for Out {
    fn write(&mut self, bytes: &[u8]) -> IoResult<usize> {
        if !self.begun {
            self.begun = true;
            write_all(&mut self.file, bytes, &self.path)?;
            return Ok(bytes.len());
        }
        self.file.write(bytes)
    }

    fn flush(&mut self) -> IoResult<()> {
        self.file.flush()
    }
}

/// Creates a file for another writer, not yet visible to readers.
pub fn create(path: &Path) -> Result<std::io::BufWriter<Out>, PipelineError> {
    let file = File::create(path).map_err(PipelineError::io("create", path))?;
    Ok(std::io::BufWriter::new(Out { file, path: path.to_path_buf(), begun: false }))
}

/// Renames a file or folder.
pub fn rename(from: &Path, to: &Path) -> Result<(), PipelineError> {
    change("move", from)?;
    std::fs::rename(from, to).map_err(PipelineError::io("move", from))
}

/// Creates a folder and its parents.
pub fn create_dir_all(path: &Path) -> Result<(), PipelineError> {
    if path.is_dir() {
        return Ok(());
    }
    change("create", path)?;
    std::fs::create_dir_all(path).map_err(PipelineError::io("create", path))
}

/// Removes a folder with its contents.
pub fn remove_dir_all(path: &Path) -> Result<(), PipelineError> {
    change("clear", path)?;
    std::fs::remove_dir_all(path).map_err(PipelineError::io("clear", path))
}

/// Removes a file.
pub fn remove_file(path: &Path) -> Result<(), PipelineError> {
    change("remove", path)?;
    std::fs::remove_file(path).map_err(PipelineError::io("remove", path))
}

/// Copies a file.
pub fn copy(from: &Path, to: &Path) -> Result<(), PipelineError> {
    change("copy to", to)?;
    std::fs::copy(from, to).map(|_| ()).map_err(PipelineError::io("copy to", to))
}

/// Gives a file a second name, or copies it where the file system has no links.
pub fn link(from: &Path, to: &Path) -> Result<(), PipelineError> {
    change("link", to)?;
    // none: where no link can be made, a copy does the same
    std::fs::hard_link(from, to).or_else(|_| std::fs::copy(from, to).map(|_| ())).map_err(PipelineError::io("link", to))
}

/// Opens a file to be locked, and creates it if it is not there.
pub fn open_to_lock(path: &Path) -> Result<File, PipelineError> {
    change("open", path)?;
    File::options()
        .create(true)
        .truncate(false)
        .read(true)
        .write(true)
        .open(path)
        .map_err(PipelineError::io("open", path))
}

/// Waits until a file's content is on the disk.
pub fn sync(path: &Path) -> Result<(), PipelineError> {
    change("write to the disk", path)?;
    File::open(path).and_then(|f| f.sync_all()).map_err(PipelineError::io("write to the disk", path))
}

/// Maximum number of files that one run flushes to disk at the same time.
pub const SYNCS: usize = 8;

/// Waits until each of many files is on the disk, `at_once` at a time. In parallel the system
/// writes them together, in a seventh of the time. Returns the result for each file, in their
/// order.
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
            // if the system provides no more threads, the existing ones do the work
            if std::thread::Builder::new().spawn_scoped(scope, work).is_err() {
                break;
            }
        }
        work();
    });
    paths.iter().zip(slots).map(|(path, slot)| slot.into_inner().unwrap_or_else(|| sync(path))).collect()
}

/// Waits until the names in a folder are on the disk; does nothing on systems that have no such
/// operation.
pub fn sync_folder(path: &Path) -> Result<(), PipelineError> {
    if cfg!(unix) { sync(path) } else { Ok(()) }
}

/// Ending of a file that is being written.
const NEW: &str = ".new";

/// Identifier of this process for temporary names: computer, process, and a number that no other
/// name of this process has.
pub(crate) fn token() -> String {
    static NEXT: AtomicU64 = AtomicU64::new(0);
    let host: String = host_name().chars().map(|c| if c.is_ascii_alphanumeric() { c } else { '_' }).take(40).collect();
    format!("{host}-{}-{}", std::process::id(), NEXT.fetch_add(1, Ordering::Relaxed))
}

/// A file that exists and is locked while its owner works: what belongs to a locked file is in use.
#[derive(Debug)]
pub(crate) struct Owned {
    pub path: PathBuf,
    file: File,
}

impl Owned {
    /// Creates and locks a file, removed if a signal ends the process before its path is released;
    /// `named` gives its name for a token.
    pub fn create(named: impl Fn(&str) -> PathBuf) -> Result<(Self, String), PipelineError> {
        loop {
            let token = token();
            let path = named(&token);
            change("create", &path)?;
            let new = || File::options().create_new(true).read(true).write(true).open(&path);
            let file = begin(&path, new).map_err(PipelineError::io("create", &path))?;
            // a process that clears up may have found the file before it was locked; on a file
            // system without locks it is accepted as it is
            let taken = matches!(file.try_lock(), Err(TryLockError::WouldBlock));
            let own = Self { path, file };
            if !taken && own.path.is_file() {
                return Ok((own, token));
            }
        }
    }
}

impl Drop for Owned {
    fn drop(&mut self) {
        release(&self.path);
    }
}

/// True if the owner of a file made by [`Owned::create`] no longer runs.
pub(crate) fn abandoned(path: &Path) -> bool {
    // none: what cannot be opened is not ours to remove
    let Ok(file) = File::options().read(true).write(true).open(path) else { return false };
    match file.try_lock() {
        Ok(()) => true,
        Err(TryLockError::WouldBlock) => false,
        // without locks, check whether the process still runs on this computer
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

/// A file being written under a temporary name of this process, to be renamed to its final name.
/// Removed if dropped before that.
#[derive(Debug)]
pub struct Temporary {
    own: Owned,
    target: PathBuf,
    placed: bool,
}

impl Temporary {
    /// Creates a temporary file next to its final place, locked for as long as this process works
    /// on it.
    pub fn beside(target: &Path) -> Result<Self, PipelineError> {
        let name = target.file_name().map(|n| n.to_string_lossy().into_owned()).unwrap_or_default();
        let (own, _) = Owned::create(|token| target.with_file_name(format!(".{name}.{token}{NEW}")))?;
        Ok(Self { own, target: target.to_path_buf(), placed: false })
    }

    /// Path to write to.
    pub fn path(&self) -> &Path {
        &self.own.path
    }

    /// Writes its whole content.
    pub(crate) fn fill(&mut self, bytes: &[u8]) -> Result<(), PipelineError> {
        write_all(&mut self.own.file, bytes, &self.target).map_err(PipelineError::io("write", &self.target))
    }

    fn flush(&self) -> Result<(), PipelineError> {
        change("write to the disk", &self.own.path)?;
        self.own.file.sync_all().map_err(PipelineError::io("write to the disk", &self.own.path))
    }

    /// Renames it to its final name once its content is on the disk.
    pub fn place(mut self) -> Result<(), PipelineError> {
        self.flush()?;
        rename(&self.own.path, &self.target)?;
        self.placed = true;
        let folder = self.target.parent().filter(|p| !p.as_os_str().is_empty());
        folder.map_or(Ok(()), sync_folder)
    }

    /// The same, and nothing is replaced: its final name is given to it as a second name, which
    /// fails if the name is taken. Where the file system has no second names, a file that appears
    /// between this and an earlier look is replaced.
    pub(crate) fn place_new(mut self) -> Result<(), PipelineError> {
        self.flush()?;
        change("move", &self.own.path)?;
        match std::fs::hard_link(&self.own.path, &self.target) {
            Ok(()) => {}
            Err(e) if e.kind() == std::io::ErrorKind::AlreadyExists => {
                return Err(PipelineError::io("create", &self.target)(e));
            }
            // none: a file system without links has the file renamed into place
            Err(_) => {
                rename(&self.own.path, &self.target)?;
                self.placed = true;
            }
        }
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

/// Writes a file completely or not at all: next to its final place, flushed to disk, then renamed.
pub fn write_whole(path: &Path, bytes: &[u8]) -> Result<(), PipelineError> {
    let mut new = Temporary::beside(path)?;
    new.fill(bytes)?;
    new.place()
}

/// Name of the computer, if the system provides it.
pub(crate) fn host_name() -> String {
    let from_files =
        // none: only the name of the machine in a message
        ["/proc/sys/kernel/hostname", "/etc/hostname"].iter().find_map(|p| std::fs::read_to_string(p).ok());
    let from_words = || ["COMPUTERNAME", "HOSTNAME", "HOST"].iter().find_map(|v| std::env::var(v).ok());
    from_files
        .or_else(from_words)
        .map(|s| s.trim().to_owned())
        .filter(|s| !s.is_empty())
        .unwrap_or("this computer".into())
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "tests fail by panicking")]
mod tests {
    use super::*;

    #[test]
    fn each_file_has_its_own_answer() {
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
    fn a_temporary_file_is_abandoned_only_without_its_owner() {
        let dir = tempfile::tempdir().unwrap();
        let target = dir.path().join("model.json");
        let live = Temporary::beside(&target).unwrap();
        let path = live.path().to_path_buf();
        assert!(is_temporary(&path.file_name().unwrap().to_string_lossy()) && !abandoned(&path));
        live.place().unwrap();
        assert!(target.is_file() && !path.exists());
        drop(Temporary::beside(&target).unwrap());
        assert_eq!(std::fs::read_dir(dir.path()).unwrap().count(), 1);
        // the files that a killed process leaves behind
        std::fs::write(&path, "").unwrap();
        assert!(abandoned(&path));
    }
}
