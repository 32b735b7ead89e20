//! Files that a command writes where the user says (`--out`). Nothing is replaced but what Aloft
//! wrote itself: no recording, no pipeline, no link, no device.

use crate::disk::{self, Temporary};
use crate::error::PipelineError;
use std::path::Path;

/// Advice where something else stands in the place of a file.
const OTHER_NAME: &str = "give another name with --out; nothing is overwritten";

/// Refuses a place where something stands that is no file made by Aloft: `ours` tells one by its
/// content, and `what` names it, for example `page`.
///
/// # Errors
/// Something else stands there, or what stands there cannot be read.
pub fn refuse_foreign(path: &Path, what: &str, ours: impl Fn(&[u8]) -> bool) -> Result<(), PipelineError> {
    let Some(kind) = kind_of(path)? else { return Ok(()) };
    // anything but a plain file is not even opened: reading a pipe would wait for its writer
    let found = match kind {
        Kind::File if ours(&disk::read(path)?) => return Ok(()),
        Kind::File => format!("is no {what} that aloft made"),
        Kind::Other(word) => format!("is {word}, not a {what} that aloft made"),
    };
    Err(PipelineError::request_hint(format!("{} exists and {found}", path.display()), OTHER_NAME))
}

/// Writes a file completely or not at all, in a free place or over one that Aloft made.
///
/// # Errors
/// As [`refuse_foreign`]; the file cannot be written.
pub fn write_own(path: &Path, bytes: &[u8], what: &str, ours: impl Fn(&[u8]) -> bool) -> Result<(), PipelineError> {
    refuse_foreign(path, what, ours)?;
    disk::write_whole(path, bytes)
}

/// Writes a new file completely or not at all; nothing is replaced, whatever it is, not even a file
/// that another process makes at this moment.
///
/// # Errors
/// Something is there already; the file cannot be written.
pub fn write_new(path: &Path, bytes: &[u8]) -> Result<(), PipelineError> {
    refuse_any(path)?;
    let mut new = Temporary::beside(path)?;
    new.fill(bytes)?;
    new.place_new()
}

/// Refuses a place where anything stands.
///
/// # Errors
/// Something is there already.
pub fn refuse_any(path: &Path) -> Result<(), PipelineError> {
    match kind_of(path)? {
        None => Ok(()),
        Some(_) => Err(PipelineError::request_hint(format!("{} is there already", path.display()), OTHER_NAME)),
    }
}

/// Refuses a folder that holds anything; a folder that does not exist is free.
///
/// # Errors
/// The folder is not empty, cannot be listed, or is no folder.
pub fn refuse_filled(folder: &Path) -> Result<(), PipelineError> {
    if kind_of(folder)?.is_none() {
        return Ok(());
    }
    let mut entries = std::fs::read_dir(folder).map_err(PipelineError::io("list", folder))?;
    match entries.next() {
        None => Ok(()),
        Some(_) => Err(PipelineError::request_hint(
            format!("{} is not empty", folder.display()),
            "give --out a new or empty folder, so that nothing of yours is overwritten",
        )),
    }
}

enum Kind {
    File,
    Other(&'static str),
}

/// What stands in a place; a link is not followed.
fn kind_of(path: &Path) -> Result<Option<Kind>, PipelineError> {
    let kind = match std::fs::symlink_metadata(path) {
        Ok(meta) => meta.file_type(),
        Err(e) if e.kind() == std::io::ErrorKind::NotFound => return Ok(None),
        Err(e) => return Err(PipelineError::io("look at", path)(e)),
    };
    Ok(Some(match kind {
        k if k.is_file() => Kind::File,
        k if k.is_dir() => Kind::Other("a folder"),
        k if k.is_symlink() => Kind::Other("a link"),
        _ => Kind::Other("a device or pipe"),
    }))
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "tests fail by panicking")]
mod tests {
    use super::*;

    fn ours(bytes: &[u8]) -> bool {
        bytes.starts_with(b"aloft")
    }

    #[test]
    fn regress_only_files_that_aloft_made_are_replaced() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("page.html");
        write_own(&path, b"aloft 1", "page", ours).unwrap();
        write_own(&path, b"aloft 2", "page", ours).unwrap();
        assert_eq!(std::fs::read(&path).unwrap(), b"aloft 2");
        assert!(write_new(&path, b"x").is_err());
        for theirs in ["", "a recording", "alof"] {
            std::fs::write(&path, theirs).unwrap();
            let told = write_own(&path, b"aloft 3", "page", ours).unwrap_err().to_string();
            assert!(told.contains("no page that aloft made"), "{told}");
            assert_eq!(std::fs::read(&path).unwrap(), theirs.as_bytes());
        }
        assert!(write_own(dir.path(), b"aloft", "page", ours).unwrap_err().to_string().contains("a folder"));
        let new = dir.path().join("new.yaml");
        write_new(&new, b"text").unwrap();
        assert_eq!(std::fs::read(&new).unwrap(), b"text");
        assert_eq!(std::fs::read_dir(dir.path()).unwrap().count(), 2, "nothing is left beside them");
    }

    #[test]
    #[cfg(unix)]
    fn regress_links_pipes_and_devices_stay_as_they_are() {
        use std::os::unix::fs::symlink;
        let dir = tempfile::tempdir().unwrap();
        let own = dir.path().join("own.html");
        std::fs::write(&own, "aloft").unwrap();
        for (name, target) in [("dangling", dir.path().join("gone")), ("to-own", own), ("device", "/dev/null".into())] {
            let link = dir.path().join(name);
            symlink(&target, &link).unwrap();
            assert!(write_own(&link, b"aloft", "page", ours).is_err(), "{name}");
            assert!(write_new(&link, b"aloft").is_err(), "{name}");
            assert_eq!(std::fs::read_link(&link).unwrap(), target);
        }
        let told = write_own(Path::new("/dev/null"), b"aloft", "page", ours).unwrap_err().to_string();
        assert!(told.contains("device"), "{told}");
        let pipe = dir.path().join("pipe");
        let made = std::process::Command::new("mkfifo").arg(&pipe).status().unwrap().success();
        assert!(made && write_own(&pipe, b"aloft", "page", ours).is_err() && write_new(&pipe, b"aloft").is_err());
    }
}
