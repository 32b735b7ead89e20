//! Reads files that the user named or that lie among the user's recordings.
//!
//! A name that looks like a recording may be anything: a link whose target is absent (git-annex and
//! DataLad keep those), a named pipe, on which a read would wait for ever, a folder, a device, a
//! file that another user owns or that is larger than the memory. Each is refused here with its
//! reason; nothing else in the program opens such paths.

use crate::error::PipelineError;
use crate::fault::{Operation, before};
use std::fs::{File, FileType, Metadata};
use std::io::{Error, ErrorKind, Read};
use std::path::Path;

/// True if something has this name, whatever it is: a link without a target and a path that may not
/// be looked at count, so that they are reported when they are read.
pub fn is_there(path: &Path) -> bool {
    match std::fs::symlink_metadata(path) {
        Ok(_) => true,
        Err(e) => !matches!(e.kind(), ErrorKind::NotFound | ErrorKind::NotADirectory),
    }
}

/// Opens a file that can be read to its end; its size in bytes.
///
/// # Errors
/// [`PipelineError::Io`] for anything that is not a file, may not be read, or does not fit into the
/// memory, with what to do.
pub fn open(path: &Path) -> Result<(File, u64), PipelineError> {
    before(Operation::Read, "read", path).map_err(PipelineError::io("read", path))?;
    // a named pipe must not be opened: that alone waits for a writer
    look(path)?;
    let file = File::open(path).map_err(PipelineError::io("read", path))?;
    let meta = file.metadata().map_err(PipelineError::io("read", path))?;
    no_file(path, &meta)?;
    match available_memory() {
        Some(free) if needed(meta.len()) > free => Err(too_large(path, meta.len(), Some(free))),
        _ => Ok((file, meta.len())),
    }
}

/// What the system says about a file, without opening it.
///
/// # Errors
/// [`PipelineError::Io`] for anything that is not a file.
pub fn look(path: &Path) -> Result<Metadata, PipelineError> {
    let meta = std::fs::metadata(path).map_err(|e| absent(path, e))?;
    no_file(path, &meta).map(|()| meta)
}

/// The bytes of a file.
///
/// # Errors
/// Those of [`open`], and what the system says while it reads.
pub fn bytes(path: &Path) -> Result<Vec<u8>, PipelineError> {
    let (mut file, size) = open(path)?;
    let mut out = Vec::new();
    let wanted = usize::try_from(size).unwrap_or(usize::MAX);
    out.try_reserve_exact(wanted).map_err(|_| too_large(path, size, None))?;
    file.read_to_end(&mut out).map_err(PipelineError::io("read", path))?;
    Ok(out)
}

/// The text of a file; bytes that are not UTF-8 are replaced.
///
/// # Errors
/// Those of [`bytes`].
pub fn lossy(path: &Path) -> Result<String, PipelineError> {
    bytes(path).map(|b| String::from_utf8(b).unwrap_or_else(|e| String::from_utf8_lossy(e.as_bytes()).into_owned()))
}

/// The text of a file in UTF-8.
///
/// # Errors
/// Those of [`bytes`]; bytes that are not UTF-8, with their place.
pub fn text(path: &Path) -> Result<String, PipelineError> {
    String::from_utf8(bytes(path)?).map_err(|e| {
        let at = e.utf8_error().valid_up_to();
        let problem = format!("it is not UTF-8 text (from byte {at} on)");
        problem_at(path, Error::new(ErrorKind::InvalidData, problem), "save it as plain text in UTF-8")
    })
}

fn problem_at(path: &Path, problem: Error, hint: &str) -> PipelineError {
    PipelineError::Io { action: "read", path: path.to_path_buf(), problem, hint: Some(hint.to_owned()) }
}

/// A path that leads nowhere: a link whose target is absent, or no file of this name.
fn absent(path: &Path, error: Error) -> PipelineError {
    // none: what is no link has the error of reading
    let Ok(target) = std::fs::read_link(path) else { return PipelineError::io("read", path)(error) };
    let (problem, hint) = if error.kind() == ErrorKind::NotFound {
        let problem = format!("it is a link to {}, which is not there", target.display());
        (Error::new(error.kind(), problem), "fetch its content (in a data set of DataLad or git-annex: `datalad get`)")
    } else {
        (error, "mend the link, or leave it out with the patterns under `trials`")
    };
    problem_at(path, problem, hint)
}

fn no_file(path: &Path, meta: &Metadata) -> Result<(), PipelineError> {
    if meta.is_file() {
        return Ok(());
    }
    // what a folder that may not be listed holds is not known
    let closed = if meta.is_dir() { std::fs::read_dir(path).err() } else { None };
    let (problem, hint) = match closed {
        Some(e) => {
            let problem = format!("it is a folder whose files cannot be listed: {e}");
            (Error::new(e.kind(), problem), "give this user the right to list it, or exclude it")
        }
        None => {
            let problem = format!("it is {}, expected a file", kind(meta.file_type()));
            (Error::other(problem), "rename it, or leave it out with the patterns under `trials`")
        }
    };
    Err(problem_at(path, problem, hint))
}

/// What a path is, in words.
#[cfg(unix)]
fn kind(of: FileType) -> &'static str {
    use std::os::unix::fs::FileTypeExt;
    match of {
        t if t.is_dir() => "a folder",
        t if t.is_fifo() => "a named pipe",
        t if t.is_socket() => "a socket",
        t if t.is_block_device() || t.is_char_device() => "a device",
        _ => "neither file nor folder",
    }
}

#[cfg(not(unix))]
fn kind(of: FileType) -> &'static str {
    if of.is_dir() { "a folder" } else { "neither file nor folder" }
}

/// Memory that reading a file takes: its bytes, and its numbers beside them, which take as much
/// again in every format (eight bytes for a number of about eight characters or four bytes).
fn needed(size: u64) -> u64 {
    size.saturating_mul(2)
}

/// Memory that the system can still give, bytes; none where it does not say so. Linux promises more
/// than it has and ends the process later: asking for the memory would not fail.
fn available_memory() -> Option<u64> {
    // none: a system that does not say so has no limit here
    let text = std::fs::read_to_string("/proc/meminfo").ok()?;
    let line = text.lines().find_map(|l| l.strip_prefix("MemAvailable:"))?;
    line.split_whitespace().next()?.parse::<u64>().ok().map(|kib| kib.saturating_mul(1024))
}

fn too_large(path: &Path, size: u64, free: Option<u64>) -> PipelineError {
    let gb = |bytes: u64| format!("{:.1} GB", bytes as f64 / 1e9);
    let free = free.map_or(String::new(), |f| format!(", {} of memory are free", gb(f)));
    let problem = format!("it has {}, reading it takes {}{free}", gb(size), gb(needed(size)));
    problem_at(path, Error::new(ErrorKind::OutOfMemory, problem), "cut the recording into parts, or free memory")
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "tests fail by panicking")]
mod tests {
    use super::*;

    fn said(path: &Path) -> String {
        bytes(path).map_or_else(|e| e.to_string(), |b| format!("{} bytes", b.len()))
    }

    #[test]
    #[cfg(unix)]
    fn whatever_is_no_file_is_refused_with_what_it_is() {
        let dir = tempfile::tempdir().unwrap();
        let at = |name: &str| dir.path().join(name);
        std::fs::write(at("file"), "four").unwrap();
        std::os::unix::fs::symlink(at("file"), at("good")).unwrap();
        std::os::unix::fs::symlink("../annex/objects/x", at("dangling")).unwrap();
        std::os::unix::fs::symlink(at("loop"), at("loop")).unwrap();
        std::fs::create_dir(at("folder")).unwrap();
        let _socket = std::os::unix::net::UnixListener::bind(at("socket")).unwrap();
        std::process::Command::new("mkfifo").arg(at("pipe")).status().unwrap();
        File::create(at("vast")).unwrap().set_len(1 << 42).unwrap();
        std::os::unix::fs::symlink("/dev/zero", at("zero")).unwrap();
        for (name, words) in [
            ("file", "4 bytes"),
            ("good", "4 bytes"),
            ("dangling", "it is a link to ../annex/objects/x, which is not there"),
            ("loop", "cannot read:"),
            ("folder", "it is a folder, expected a file"),
            ("socket", "it is a socket"),
            ("pipe", "it is a named pipe"),
            ("zero", "it is a device"),
            ("vast", "it has 4398.0 GB"),
        ] {
            assert!(said(&at(name)).contains(words), "{name}: {}", said(&at(name)));
            assert!(is_there(&at(name)), "{name}");
        }
        assert!(!is_there(&at("nothing")) && !is_there(&at("file/below")));
    }
}
