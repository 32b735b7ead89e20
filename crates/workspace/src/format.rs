//! Layout of a workspace: the file that marks its folder, and the version stated there.

use crate::disk;
use crate::error::PipelineError;
use crate::input;
use crate::manifest::MANIFEST;
use std::path::Path;

/// File that distinguishes a workspace from a folder of recordings.
pub const MARKER: &str = "ALOFT_WORKSPACE.txt";

/// Version of the layout of a workspace, stated in the marker file. Version 1 (not stated anywhere)
/// had no hashes of single files.
pub const FORMAT: u32 = 2;

/// Text of the marker file.
pub fn marker_text() -> String {
    format!("Results of aloft. Everything here can be made again from the recordings.\nformat {FORMAT}\n")
}

/// An error for a workspace that was made by another version of the program; such a workspace is
/// neither read nor written.
pub fn refuse_other_format(root: &Path) -> Result<(), PipelineError> {
    let marker = root.join(MARKER);
    // a folder without a marker is no workspace yet
    if !disk::is_there(&marker)? {
        return Ok(());
    }
    let text = input::lossy(&marker)?;
    let stated = text.lines().find_map(|l| l.strip_prefix("format ")).map(|n| n.trim().parse::<u32>());
    let found = match stated {
        Some(Ok(FORMAT)) => return Ok(()),
        Some(Ok(n)) => format!("format {n}"),
        // none: the message says so
        Some(Err(_)) => "a format that is not a number".to_owned(),
        None if !holds_results(root) => return Ok(()),
        None => "no format (an earlier aloft made it, or the file was damaged)".to_owned(),
    };
    let newer = matches!(stated, Some(Ok(n)) if n > FORMAT);
    Err(PipelineError::request_hint(
        format!("{} states {found}; aloft {} works with format {FORMAT}", marker.display(), env!("CARGO_PKG_VERSION")),
        if newer {
            "use the newer aloft that made it, or give --workspace a new folder"
        } else {
            "give --workspace a new folder and run again: everything is made from the recordings (add effects of the model again)"
        },
    ))
}

/// True for a folder that contains a model's revisions or a result of some stage.
fn holds_results(root: &Path) -> bool {
    let below = |folder: &Path| std::fs::read_dir(folder).into_iter().flatten().flatten().map(|e| e.path());
    root.join("model.json").exists()
        || below(root).flat_map(|stage| below(&stage).collect::<Vec<_>>()).any(|trial| trial.join(MANIFEST).is_file())
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "tests fail by panicking")]
mod tests {
    use super::*;
    use crate::workspace::Workspace;
    use std::time::Duration;

    #[test]
    fn unit_workspaces_of_other_formats_are_refused() {
        let dir = tempfile::tempdir().unwrap();
        let lock = |text: &str, name: &str| {
            let root = dir.path().join(name);
            let result = root.join("import/jump01");
            std::fs::create_dir_all(&result).unwrap();
            std::fs::write(result.join(MANIFEST), "{}").unwrap();
            std::fs::write(root.join(MARKER), text).unwrap();
            let told = Workspace::open(&root).lock(Duration::ZERO).map(|_| ()).map_err(|e| e.to_string());
            assert_eq!(std::fs::read_to_string(root.join(MARKER)).unwrap(), text);
            told
        };
        assert!(lock(&marker_text(), "same").is_ok());
        assert!(lock("Results of aloft.\nformat 3\n", "newer").unwrap_err().contains("format 3"));
        assert!(lock("Results of aloft.\n", "older").unwrap_err().contains("no format"));
        assert!(lock("", "emptied").unwrap_err().contains("no format"));
        // a marker written by a workflow into a new folder
        let root = dir.path().join("new");
        std::fs::create_dir(&root).unwrap();
        std::fs::write(root.join(MARKER), "Results of aloft.\n").unwrap();
        Workspace::open(&root).lock(Duration::ZERO).unwrap();
        assert_eq!(std::fs::read_to_string(root.join(MARKER)).unwrap(), marker_text());
    }
}
