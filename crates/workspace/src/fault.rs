//! What tests do to a process: end it before a change on disk, or make one operation fail.
//!
//! * `ALOFT_STOP_BEFORE=n` ends the process before the n-th change, or with `ALOFT_STOP_TORN=1` in
//!   the middle of it if it writes a file.
//! * `ALOFT_FAULT=KIND@n` makes the n-th change fail as the system would: `nospace`, `io`,
//!   `access`, or `short`, which writes half a file first. `KIND@n+` makes all that follow fail,
//!   too. `read@n` makes the n-th reading of a file fail.
//! * `ALOFT_FAULT_LOG=FILE` lists what failed, one line each; with `ALOFT_FAULT=count`, every
//!   operation.
//!
//! Without these variables an operation costs one look at a constant.

use std::io::{Error, ErrorKind, Result, Write};
use std::path::Path;
use std::sync::OnceLock;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};

/// Exit code of a process that a test stopped.
const STOPPED: i32 = 86;

/// What kind of operation begins.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Operation {
    /// Something on the disk changes.
    Change,
    /// A file is read.
    Read,
}

/// How far an operation may go.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Extent {
    /// To its end.
    Whole,
    /// Half of it; [`after_half`] says what then happens.
    Half,
}

/// How an operation fails.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Fault {
    NoSpace,
    Io,
    Access,
    Short,
    Read,
}

impl Fault {
    fn named(word: &str) -> Option<Self> {
        [
            ("nospace", Self::NoSpace),
            ("io", Self::Io),
            ("access", Self::Access),
            ("short", Self::Short),
            ("read", Self::Read),
        ]
        .into_iter()
        .find_map(|(name, fault)| (name == word).then_some(fault))
    }

    fn error(self) -> Error {
        match self {
            Self::NoSpace | Self::Short => Error::new(ErrorKind::StorageFull, "no space left on the device (a test)"),
            Self::Io | Self::Read => Error::other("input/output error (a test)"),
            Self::Access => Error::new(ErrorKind::PermissionDenied, "permission denied (a test)"),
        }
    }
}

/// What a test asked for.
#[derive(Debug, Default)]
struct Plan {
    /// Before which change the process ends, and whether in the middle of it.
    stop: Option<(u64, bool)>,
    /// Which operation fails, how, and whether all that follow do, too.
    fault: Option<(Fault, u64, bool)>,
    /// True if every operation is listed.
    count: bool,
    log: Option<std::ffi::OsString>,
}

impl Plan {
    fn from_environment() -> Option<Self> {
        let word = |name: &str| std::env::var(name).ok();
        let stop = word("ALOFT_STOP_BEFORE").and_then(|n| n.parse().ok());
        let stop = stop.map(|at| (at, word("ALOFT_STOP_TORN").is_some_and(|v| v == "1")));
        let asked = word("ALOFT_FAULT");
        let count = asked.as_deref() == Some("count");
        let fault = asked.and_then(|text| {
            let (kind, at) = text.split_once('@')?;
            Some((Fault::named(kind)?, at.trim_end_matches('+').parse().ok()?, at.ends_with('+')))
        });
        let plan = Self { stop, fault, count, log: std::env::var_os("ALOFT_FAULT_LOG") };
        (plan.stop.is_some() || plan.fault.is_some() || plan.count).then_some(plan)
    }

    fn list(&self, line: &str) {
        let Some(log) = &self.log else { return };
        // none: the log of a test
        if let Ok(mut file) = std::fs::File::options().create(true).append(true).open(log) {
            let _ = file.write_all(format!("{line}\n").as_bytes());
        }
    }
}

/// True while the process removes what it has begun, before a signal ends it.
static ENDING: AtomicBool = AtomicBool::new(false);

/// From now on nothing more is changed through this crate: whoever asks for a change waits for the
/// end of the process.
pub(crate) fn hold_changes() {
    ENDING.store(true, Ordering::SeqCst);
}

/// Returns if changes are still made; otherwise the process removes what it has begun, and ends.
pub(crate) fn wait_if_held() {
    while is_held() {
        std::thread::park();
    }
}

/// True once nothing more is changed.
pub(crate) fn is_held() -> bool {
    ENDING.load(Ordering::SeqCst)
}

fn plan() -> Option<&'static Plan> {
    static PLAN: OnceLock<Option<Plan>> = OnceLock::new();
    PLAN.get_or_init(Plan::from_environment).as_ref()
}

/// Counts an operation that is about to begin: it goes on, fails, or ends the process.
pub(crate) fn before(operation: Operation, action: &str, path: &Path) -> Result<Extent> {
    if operation == Operation::Change {
        wait_if_held();
    }
    plan().map_or(Ok(Extent::Whole), |plan| planned(plan, operation, action, path))
}

fn planned(plan: &Plan, operation: Operation, action: &str, path: &Path) -> Result<Extent> {
    static CHANGES: AtomicU64 = AtomicU64::new(0);
    static READINGS: AtomicU64 = AtomicU64::new(0);
    let counter = if operation == Operation::Change { &CHANGES } else { &READINGS };
    let this = counter.fetch_add(1, Ordering::SeqCst) + 1;
    if plan.count {
        plan.list(&format!("{operation:?} {action} {}", path.display()));
    }
    if operation == Operation::Change
        && let Some((at, torn)) = plan.stop
    {
        if this >= at && !(torn && this == at) {
            std::process::exit(STOPPED);
        }
        if this == at {
            return Ok(Extent::Half);
        }
    }
    let Some((fault, at, lasting)) = plan.fault else { return Ok(Extent::Whole) };
    let concerns = (fault == Fault::Read) == (operation == Operation::Read);
    if !concerns || this < at || (this > at && !lasting) {
        return Ok(Extent::Whole);
    }
    plan.list(&format!("{fault:?} {action} {}", path.display()));
    if fault == Fault::Short && action == "write" { Ok(Extent::Half) } else { Err(fault.error()) }
}

/// What follows half an operation: the end of the process, or an error.
pub(crate) fn after_half() -> Error {
    if plan().is_some_and(|plan| plan.stop.is_some()) {
        std::process::exit(STOPPED);
    }
    Fault::Short.error()
}
