//! The lock on a workspace: one run at a time changes it, and the others are told which process
//! holds it.

use crate::disk::{self, host_name, is_temporary};
use crate::error::PipelineError;
use crate::format::{MARKER, marker_text, refuse_other_format};
use crate::json::{read_json, write_json_whole};
use crate::workspace::Workspace;
use serde::{Deserialize, Serialize};
use std::fs::{File, TryLockError};
use std::path::PathBuf;
use std::time::{Duration, Instant, SystemTime, UNIX_EPOCH};

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

/// A time formatted as `2026-03-01 14:05:09 UTC` (proleptic Gregorian calendar; days to civil dates
/// after Hinnant's algorithm).
fn utc(time: SystemTime) -> String {
    // none: a clock before 1970 is shown as 1970
    let seconds = time.duration_since(UNIX_EPOCH).ok().unwrap_or_default().as_secs();
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
    /// Creates the folder if needed and takes the lock, waiting up to `patience` for its holder;
    /// after that the error names the holder.
    pub fn lock(&self, patience: Duration) -> Result<WorkspaceLock, PipelineError> {
        let marker = self.root().join(MARKER);
        let own = |name: &std::ffi::OsStr| is_temporary(&name.to_string_lossy());
        // check the marker last: a process that is creating the workspace at this moment writes the
        // marker first
        if self.root().is_dir()
            // none: making the lock names a folder that cannot be read
            && std::fs::read_dir(self.root()).is_ok_and(|d| d.flatten().any(|e| !own(&e.file_name())))
            && !marker.is_file()
        {
            return Err(PipelineError::request_hint(
                format!("{} is not empty and is not a workspace", self.root().display()),
                "give --workspace a new or empty folder, so that nothing of yours is overwritten",
            ));
        }
        disk::create_dir_all(self.root())?;
        refuse_other_format(self.root())?;
        // none: a marker that cannot be read is written again
        if std::fs::read_to_string(&marker).ok().is_none_or(|text| text != marker_text()) {
            disk::write_whole(&marker, marker_text().as_bytes())?;
        }
        let path = self.root().join(".lock");
        let file = disk::open_to_lock(&path)?;
        let note = self.root().join(".holder.json");
        let started = Instant::now();
        loop {
            match file.try_lock() {
                Ok(()) => break,
                Err(TryLockError::WouldBlock) if started.elapsed() < patience => {
                    std::thread::sleep(Duration::from_millis(100));
                }
                Err(TryLockError::WouldBlock) => {
                    // none: only the name of the holder in a message
                    let holder =
                        read_json::<Holder>(&note).ok().map_or("another process".to_owned(), |h| h.to_string());
                    return Err(PipelineError::Locked { path: self.root().to_path_buf(), holder });
                }
                Err(TryLockError::Error(e)) => return Err(PipelineError::io("lock", &path)(e)),
            }
        }
        write_json_whole(&note, &Holder::this_process())?;
        self.clear_abandoned()?;
        Ok(WorkspaceLock { _file: file, note })
    }
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
