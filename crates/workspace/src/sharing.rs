//! Several runs on one workspace at the same time, each on tasks of its own: the jobs of a cluster
//! (`aloft run --shared`, `aloft merge`).
//!
//! They hold the workspace's lock jointly, so that a plain run waits until all of them have ended,
//! and each holds a separate lock for the result that it is making. The locks are those of the
//! operating system (`flock`): they are released when the process ends, and work across machines if
//! the file system supports that.

use crate::disk;
use crate::error::PipelineError;
use crate::workspace::Workspace;
use std::fs::{File, TryLockError};

/// Lock held jointly by several runs; released when dropped.
#[derive(Debug)]
pub struct SharedLock {
    _file: File,
}

/// Lock held while one result is made; released when dropped.
#[derive(Debug)]
pub struct TaskLock {
    _file: File,
}

impl Workspace {
    /// Joins other runs that share the workspace; an error if a plain run holds it.
    pub fn lock_shared(&self) -> Result<SharedLock, PipelineError> {
        let path = self.root().join(".lock");
        if !path.is_file() {
            // the first of the shared runs creates the workspace; another process may be doing so
            // at this moment
            match self.lock(std::time::Duration::ZERO) {
                Ok(_) | Err(PipelineError::Locked { .. }) => {}
                Err(e) => return Err(e),
            }
        }
        let file = disk::open_to_lock(&path)?;
        // the run that creates the workspace holds the lock only briefly
        for _ in 0..50 {
            match file.try_lock_shared() {
                Ok(()) => {
                    crate::format::refuse_other_format(self.root())?;
                    return Ok(SharedLock { _file: file });
                }
                Err(TryLockError::WouldBlock) => std::thread::sleep(std::time::Duration::from_millis(100)),
                Err(TryLockError::Error(e)) => return Err(PipelineError::io("lock", &path)(e)),
            }
        }
        Err(PipelineError::Locked {
            path: self.root().to_path_buf(),
            holder: "a run that does not share it".to_owned(),
        })
    }

    /// Waits until no other process is making this result.
    pub fn lock_task(&self, stage: &str, trial: &str) -> Result<TaskLock, PipelineError> {
        let folder = self.root().join(".locks");
        disk::create_dir_all(&folder)?;
        let path = folder.join(format!("{stage}-{trial}"));
        let file = disk::open_to_lock(&path)?;
        file.lock().map_err(PipelineError::io("lock", &path))?;
        Ok(TaskLock { _file: file })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn shared_runs_exclude_plain_ones_only() {
        let folder = tempfile::tempdir().unwrap();
        let root = folder.path().join("ws");
        let (a, b, c) = (Workspace::open(&root), Workspace::open(&root), Workspace::open(&root));
        let one = a.lock_shared().unwrap();
        let two = b.lock_shared().unwrap();
        assert!(matches!(c.lock(std::time::Duration::ZERO), Err(PipelineError::Locked { .. })));
        drop((one, two));
        let plain = c.lock(std::time::Duration::ZERO).unwrap();
        assert!(matches!(a.lock_shared(), Err(PipelineError::Locked { .. })));
        drop(plain);
        a.lock_shared().unwrap();
    }

    #[test]
    fn one_result_is_made_by_one_at_a_time() {
        let folder = tempfile::tempdir().unwrap();
        let root = folder.path().join("ws");
        let ws = Workspace::open(&root);
        let _shared = ws.lock_shared().unwrap();
        let held = ws.lock_task("ik", "jump01").unwrap();
        let other = ws.lock_task("ik", "jump02").unwrap();
        let waits = std::thread::spawn({
            let root = root.clone();
            move || {
                let started = std::time::Instant::now();
                Workspace::open(&root).lock_task("ik", "jump01").map(|_| started.elapsed())
            }
        });
        std::thread::sleep(std::time::Duration::from_millis(200));
        drop(held);
        assert!(waits.join().unwrap().unwrap().as_millis() >= 100);
        drop(other);
    }
}
