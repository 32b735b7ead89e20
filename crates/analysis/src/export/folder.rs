//! The export folder. Files are written to a temporary folder next to it and renamed into place;
//! only the export's own files are ever replaced.
//!
//! `export.json` lists every file with its hash. A folder without it must be empty. A file that was
//! modified since, or a foreign file where the export wants to write, stops the export before
//! anything is changed; files that are not listed are left alone.

use super::Exported;
use aloft_export::OutFile;
use aloft_workspace::disk;
use aloft_workspace::error::PipelineError;
use aloft_workspace::json::{read_json_if_there, write_json};
use aloft_workspace::unfinished::Unfinished;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};

const MANIFEST: &str = "export.json";

/// A staged file.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Kept {
    /// Path below the folder.
    pub path: String,
    /// One line for the README.
    pub what: String,
    /// Hash of its content.
    hash: String,
}

#[derive(Debug, Clone, Default, Serialize, Deserialize)]
struct Entry {
    blake3: String,
    what: String,
}

#[derive(Debug, Clone, Default, Serialize, Deserialize)]
struct Manifest {
    version: u32,
    program: String,
    /// Hash of the results that the files were made from.
    results: String,
    files: BTreeMap<String, Entry>,
    /// Hashes that files may also have while an export is being written.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    before: BTreeMap<String, String>,
}

/// The list of the files of an export.
pub(super) struct Listed(Manifest);

impl Listed {
    /// Reads the list; none if the folder holds no export.
    pub fn read(root: &Path) -> Result<Option<Self>, PipelineError> {
        Ok(read_json_if_there(&root.join(MANIFEST))?.map(Self))
    }

    /// True if the files were made from results of this hash.
    pub fn is_from(&self, state: &str) -> bool {
        self.0.results == state
    }

    /// Files that are missing, or whose content is not what was written.
    pub fn changed(&self, root: &Path) -> Result<Vec<String>, PipelineError> {
        let mut out = Vec::new();
        for (path, entry) in &self.0.files {
            let place = root.join(path);
            let as_written =
                disk::is_there(&place)? && blake3::hash(&disk::read(&place)?).to_hex().as_str() == entry.blake3;
            if !as_written {
                out.push(path.clone());
            }
        }
        Ok(out)
    }
}

/// A checked export folder, with a temporary folder next to it for new files.
#[derive(Debug)]
pub(super) struct Folder {
    root: PathBuf,
    scratch: Unfinished,
    manifest: Manifest,
    state: String,
}

impl Folder {
    /// Checks the folder and creates the temporary folder for new files.
    pub fn prepare(root: &Path, state: &str) -> Result<Self, PipelineError> {
        let manifest = if let Some(manifest) = read_json_if_there(&root.join(MANIFEST))? {
            manifest
        } else {
            if root.exists() && !root.is_dir() {
                return Err(PipelineError::request_hint(
                    format!("{} is a file", root.display()),
                    "give --to the name of a folder",
                ));
            }
            // none: writing into it names a folder that cannot be read
            if root.is_dir() && fs::read_dir(root).is_ok_and(|mut d| d.next().is_some()) {
                return Err(PipelineError::request_hint(
                    format!("{} is not empty and holds no export of aloft", root.display()),
                    "give --to a new or empty folder, so that nothing of yours is overwritten",
                ));
            }
            Manifest::default()
        };
        let absolute = std::path::absolute(root).map_err(PipelineError::io("find", root))?;
        let parent = absolute.parent().unwrap_or(&absolute).to_path_buf();
        disk::create_dir_all(&parent)?;
        let scratch = Unfinished::new_in(&parent)?;
        let folder = Self { root: absolute, scratch, manifest, state: state.to_owned() };
        folder.refuse_changed()?;
        Ok(folder)
    }

    fn hash_of(&self, path: &str) -> Result<Option<String>, PipelineError> {
        let place = self.root.join(path);
        if !disk::is_there(&place)? {
            return Ok(None);
        }
        let bytes = disk::read(&place)?;
        Ok(Some(blake3::hash(&bytes).to_hex().to_string()))
    }

    /// Refuses to go on if files of the export were modified since.
    fn refuse_changed(&self) -> Result<(), PipelineError> {
        let mut changed = Vec::new();
        for (path, entry) in &self.manifest.files {
            if let Some(hash) = self.hash_of(path)?
                && hash != entry.blake3
                && self.manifest.before.get(path) != Some(&hash)
            {
                changed.push(path.as_str());
            }
        }
        if changed.is_empty() {
            return Ok(());
        }
        let more = if changed.len() > 3 { format!(" and {} more", changed.len() - 3) } else { String::new() };
        Err(PipelineError::request_hint(
            format!(
                "{}: changed since they were exported: {}{more}",
                self.root.display(),
                changed.iter().take(3).copied().collect::<Vec<_>>().join(", ")
            ),
            "move these files away (they would be overwritten), or give --to another folder",
        ))
    }

    /// True if the earlier export was made from the same results, so that its files may stay.
    fn continues(&self) -> bool {
        self.manifest.results == self.state
    }

    /// Files of an earlier export of the same results: path and description.
    pub fn earlier(&self) -> impl Iterator<Item = (&str, &str)> {
        let continues = self.continues();
        self.manifest.files.iter().filter(move |_| continues).map(|(p, e)| (p.as_str(), e.what.as_str()))
    }

    /// Writes files into the temporary folder.
    pub fn stage(&self, files: Vec<OutFile>) -> Result<Vec<Kept>, PipelineError> {
        let mut kept = Vec::with_capacity(files.len());
        for file in files {
            let place = self.scratch.path().join(&file.path);
            if let Some(parent) = place.parent() {
                disk::create_dir_all(parent)?;
            }
            disk::write(&place, &file.bytes)?;
            let hash = blake3::hash(&file.bytes).to_hex().to_string();
            kept.push(Kept { path: file.path, what: file.what, hash });
        }
        Ok(kept)
    }

    /// Renames everything into place. A `partial` export (some formats, some trials) does not
    /// remove files of an export of earlier results.
    pub fn commit(self, files: Vec<Kept>, partial: bool, done: &mut Exported) -> Result<(), PipelineError> {
        let mut next =
            Manifest { version: 1, program: super::program(), results: self.state.clone(), ..Manifest::default() };
        if self.continues() {
            next.files.clone_from(&self.manifest.files);
        }
        for file in &files {
            next.files.insert(file.path.clone(), Entry { blake3: file.hash.clone(), what: file.what.clone() });
        }
        let mut to_move = Vec::new();
        for file in &files {
            match self.hash_of(&file.path)? {
                None => {
                    done.added += 1;
                    to_move.push(&file.path);
                }
                Some(hash) if hash == file.hash => done.unchanged += 1,
                Some(hash) => {
                    if !self.manifest.files.contains_key(&file.path) {
                        return Err(PipelineError::request_hint(
                            format!(
                                "{} exists and was not written by the export",
                                self.root.join(&file.path).display()
                            ),
                            "move it away, or give --to another folder",
                        ));
                    }
                    next.before.insert(file.path.clone(), hash);
                    done.changed += 1;
                    to_move.push(&file.path);
                }
            }
        }
        let gone: Vec<String> = self.manifest.files.keys().filter(|p| !next.files.contains_key(*p)).cloned().collect();
        if partial && !gone.is_empty() {
            return Err(PipelineError::request_hint(
                format!("{} holds {} more files, made from earlier results", self.root.display(), gone.len()),
                "export everything (without --format and --trial), or give --to another folder",
            ));
        }
        if !self.root.is_dir() {
            // the folder does not exist yet: one rename makes the whole export appear
            write_json(&self.scratch.path().join(MANIFEST), &next)?;
            return self.scratch.place(&self.root);
        }
        for path in &gone {
            if let Some(hash) = self.hash_of(path)? {
                next.before.insert(path.clone(), hash);
                next.files.insert(path.clone(), self.manifest.files[path].clone());
            }
        }
        self.write_manifest(&next)?;
        for path in to_move {
            let place = self.root.join(path);
            if let Some(parent) = place.parent() {
                disk::create_dir_all(parent)?;
            }
            disk::rename(&self.scratch.path().join(path), &place)?;
        }
        for path in &gone {
            let place = self.root.join(path);
            if place.is_file() {
                disk::remove_file(&place)?;
                done.removed += 1;
            }
            next.files.remove(path);
        }
        next.before.clear();
        self.write_manifest(&next)
    }

    fn write_manifest(&self, manifest: &Manifest) -> Result<(), PipelineError> {
        let new = self.scratch.path().join(MANIFEST);
        write_json(&new, manifest)?;
        let place = self.root.join(MANIFEST);
        disk::rename(&new, &place)
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used, reason = "tests fail by panicking")]
    use super::*;

    fn file(path: &str, text: &str) -> OutFile {
        OutFile::text(path.to_owned(), text.to_owned(), "a file")
    }

    fn write(root: &Path, state: &str, files: &[(&str, &str)]) -> Result<Exported, PipelineError> {
        let folder = Folder::prepare(root, state)?;
        let kept = folder.stage(files.iter().map(|(p, t)| file(p, t)).collect())?;
        let mut done = Exported::default();
        folder.commit(kept, false, &mut done)?;
        Ok(done)
    }

    #[test]
    fn regress_a_second_export_changes_only_what_is_different() {
        let dir = tempfile::tempdir().unwrap();
        let root = dir.path().join("out");
        let done = write(&root, "a", &[("x/1.txt", "one"), ("2.txt", "two")]).unwrap();
        assert_eq!((done.added, done.changed, done.unchanged), (2, 0, 0));
        let done = write(&root, "a", &[("x/1.txt", "one"), ("3.txt", "three")]).unwrap();
        assert_eq!((done.added, done.unchanged, done.removed), (1, 1, 0), "other files of the same results stay");
        assert!(root.join("2.txt").is_file());
        let done = write(&root, "b", &[("x/1.txt", "uno")]).unwrap();
        assert_eq!((done.changed, done.removed), (1, 2), "files of old results go");
        assert_eq!(fs::read_to_string(root.join("x/1.txt")).unwrap(), "uno");
        assert!(!root.join("2.txt").exists());
        assert_eq!(fs::read_dir(dir.path()).unwrap().count(), 1, "nothing is left beside the folder");
    }

    #[test]
    fn regress_nothing_of_somebody_else_is_touched() {
        let dir = tempfile::tempdir().unwrap();
        let theirs = dir.path().join("thesis");
        fs::create_dir(&theirs).unwrap();
        fs::write(theirs.join("chapter1.txt"), "precious").unwrap();
        assert!(write(&theirs, "a", &[("1.txt", "one")]).unwrap_err().to_string().contains("not empty"));
        let root = dir.path().join("out");
        write(&root, "a", &[("1.txt", "one")]).unwrap();
        fs::write(root.join("notes.txt"), "mine").unwrap();
        write(&root, "b", &[("1.txt", "two")]).unwrap();
        assert_eq!(fs::read_to_string(root.join("notes.txt")).unwrap(), "mine");
        let folder = Folder::prepare(&root, "c").unwrap();
        let kept = folder.stage(vec![file("5.txt", "five")]).unwrap();
        let error = folder.commit(kept, true, &mut Exported::default()).unwrap_err();
        assert!(
            error.to_string().contains("earlier results")
                && root.join("1.txt").is_file()
                && !root.join("5.txt").exists()
        );
        assert!(
            write(&root, "b", &[("notes.txt", "x")]).unwrap_err().to_string().contains("not written by the export")
        );
        fs::write(root.join("1.txt"), "edited").unwrap();
        assert!(write(&root, "c", &[("1.txt", "three")]).unwrap_err().to_string().contains("changed since"));
        assert_eq!(fs::read_to_string(root.join("1.txt")).unwrap(), "edited");
    }

    #[test]
    fn regress_an_export_that_was_cut_short_can_be_taken_up_again() {
        let dir = tempfile::tempdir().unwrap();
        let root = dir.path().join("out");
        write(&root, "a", &[("1.txt", "one"), ("2.txt", "two")]).unwrap();
        // the state after the manifest was written and the first of two renames was made
        let hash = |t: &str| blake3::hash(t.as_bytes()).to_hex().to_string();
        let mut manifest: Manifest = aloft_workspace::json::read_json(&root.join(MANIFEST)).unwrap();
        manifest.results = "b".into();
        for (path, old, new) in [("1.txt", "one", "uno"), ("2.txt", "two", "due")] {
            manifest.files.get_mut(path).unwrap().blake3 = hash(new);
            manifest.before.insert(path.into(), hash(old));
        }
        write_json(&root.join(MANIFEST), &manifest).unwrap();
        fs::write(root.join("1.txt"), "uno").unwrap();
        let done = write(&root, "b", &[("1.txt", "uno"), ("2.txt", "due")]).unwrap();
        assert_eq!((done.changed, done.unchanged), (1, 1));
        assert_eq!(fs::read_to_string(root.join("2.txt")).unwrap(), "due");
    }
}
