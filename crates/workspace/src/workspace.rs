//! The folder of results: one folder per stage and trial with tables and a manifest, renamed into
//! place when complete.

use crate::disk::{self, Owned, abandoned, is_temporary};
use crate::error::PipelineError;
use crate::fingerprint::InputHashes;
use crate::manifest::{MANIFEST, Manifest, examine, hash_of, stamps};
use crate::seal;
use crate::unfinished;
use std::collections::{BTreeSet, HashMap};
use std::ops::Deref;
use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};

/// Folder for files being written.
const SCRATCH: &str = ".tmp";

/// Suffix of an old result that is being replaced.
const OLD: &str = "~old";

/// The workspace of one study.
#[derive(Debug)]
pub struct Workspace {
    root: PathBuf,
    inputs: InputHashes,
    /// Results whose files this process compared with their hashes, with the problems found.
    examined: Mutex<HashMap<(String, String), Vec<String>>>,
}

/// A folder in which a result is being made, not visible to readers; removed when dropped.
#[derive(Debug)]
pub struct Scratch {
    path: PathBuf,
    owner: Owned,
}

impl Deref for Scratch {
    type Target = Path;
    fn deref(&self) -> &Path {
        &self.path
    }
}

impl Drop for Scratch {
    fn drop(&mut self) {
        let _ = std::fs::remove_dir_all(&self.path);
        let _ = std::fs::remove_file(&self.owner.path);
    }
}

/// A complete result with its manifest, not yet visible to readers; removed when dropped.
#[derive(Debug)]
pub struct Complete {
    scratch: Scratch,
    manifest: Manifest,
}

impl Workspace {
    /// Opens a workspace for reading; nothing is created.
    pub fn open(root: &Path) -> Self {
        Self { root: root.to_path_buf(), inputs: InputHashes::open(root), examined: Mutex::default() }
    }

    /// Removes the unfinished files of killed processes, and restores results that they had moved
    /// away. Files of a process that still runs are left alone: it holds a lock on them.
    pub fn clear_abandoned(&self) -> Result<(), PipelineError> {
        for folder in [self.root.clone(), self.root.join("discoveries")] {
            for entry in std::fs::read_dir(folder).into_iter().flatten().flatten() {
                if is_temporary(&entry.file_name().to_string_lossy()) && abandoned(&entry.path()) {
                    let _ = std::fs::remove_file(entry.path());
                }
            }
        }
        // copies on which models were tried stand beside the workspace or inside
        unfinished::clear_abandoned(&self.root);
        let beside = self.root.parent().filter(|p| !p.as_os_str().is_empty());
        unfinished::clear_abandoned(beside.unwrap_or(Path::new(".")));
        let scratch = self.root.join(SCRATCH);
        let entries: Vec<PathBuf> =
            std::fs::read_dir(&scratch).into_iter().flatten().flatten().map(|e| e.path()).collect();
        let name = |p: &Path| p.file_name().map(|n| n.to_string_lossy().into_owned()).unwrap_or_default();
        let owner_of = |p: &Path| scratch.join(format!("{}.lock", name(p).split('.').next().unwrap_or_default()));
        for path in entries.iter().filter(|p| p.is_dir()) {
            let owner = owner_of(path);
            if owner.exists() && !abandoned(&owner) {
                continue;
            }
            if name(path).ends_with(OLD) {
                self.put_back(path)?;
            }
        }
        for path in entries.iter().filter(|p| p.is_dir() && p.exists()) {
            let owner = owner_of(path);
            if !owner.exists() || abandoned(&owner) {
                disk::remove_dir_all(path)?;
            }
        }
        for path in entries.iter().filter(|p| p.is_file() && abandoned(p)) {
            let _ = std::fs::remove_file(path);
        }
        Ok(())
    }

    /// Restores an old result. A run that was killed after moving the old result away and before
    /// moving the new one in leaves the old one among its temporary folders. If the result is
    /// missing in its place, the old one is moved back, so that no finished result is lost.
    fn put_back(&self, old: &Path) -> Result<(), PipelineError> {
        let Some(manifest) = seal::read_if_whole::<Manifest>(&old.join(MANIFEST))? else { return Ok(()) };
        let place = self.place(&manifest.stage, &manifest.trial);
        // if the complete new result is next to it, that one is preferred
        let new = PathBuf::from(old.to_string_lossy().trim_end_matches(OLD));
        let whole = seal::read_if_whole::<Manifest>(&new.join(MANIFEST))?.is_some();
        if !place.exists() {
            disk::rename(if whole { &new } else { old }, &place)?;
        }
        Ok(())
    }

    /// The root folder.
    pub fn root(&self) -> &Path {
        &self.root
    }

    /// Folder for the result of a stage.
    pub fn place(&self, stage: &str, trial: &str) -> PathBuf {
        self.root.join(stage).join(trial)
    }

    /// The manifest of a result, if it exists.
    ///
    /// # Errors
    /// It exists and is damaged or cannot be read.
    pub fn manifest_if_there(&self, stage: &str, trial: &str) -> Result<Option<Manifest>, PipelineError> {
        seal::read_if_there(&self.place(stage, trial).join(MANIFEST))
    }

    /// The manifest of a result, if it exists and is undamaged: a damaged one is made again by the
    /// next run, and [`Workspace::damage`] says what is wrong with it.
    ///
    /// # Errors
    /// It exists and the system cannot read it.
    pub fn manifest(&self, stage: &str, trial: &str) -> Result<Option<Manifest>, PipelineError> {
        seal::read_if_whole(&self.place(stage, trial).join(MANIFEST))
    }

    /// The same, if the result can be used: its stage did not fail.
    ///
    /// # Errors
    /// As [`Workspace::manifest`].
    pub fn usable(&self, stage: &str, trial: &str) -> Result<Option<Manifest>, PipelineError> {
        Ok(self.manifest(stage, trial)?.filter(Manifest::is_ok))
    }

    /// Hash of the files of a result; empty if there is none.
    ///
    /// # Errors
    /// As [`Workspace::manifest`].
    pub fn output(&self, stage: &str, trial: &str) -> Result<String, PipelineError> {
        Ok(self.manifest(stage, trial)?.map_or_else(String::new, |m| m.output))
    }

    /// Problems in the files of a result, in words; empty if they are unchanged or if there is no
    /// result. Every file is read once per process.
    ///
    /// # Errors
    /// The system cannot read one of them.
    pub fn damage(&self, stage: &str, trial: &str) -> Result<Vec<String>, PipelineError> {
        let key = (stage.to_owned(), trial.to_owned());
        let lock = || self.examined.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(known) = lock().get(&key) {
            return Ok(known.clone());
        }
        let found = examine(&self.place(stage, trial))?;
        lock().insert(key, found.clone());
        Ok(found)
    }

    /// Discards the findings of [`Workspace::damage`], because another process may have made the
    /// result again.
    pub fn forget(&self, stage: &str, trial: &str) {
        let mut known = self.examined.lock().unwrap_or_else(PoisonError::into_inner);
        known.remove(&(stage.to_owned(), trial.to_owned()));
    }

    /// Creates a new folder to write a result into, not yet visible to readers.
    pub fn scratch(&self, stage: &str, trial: &str) -> Result<Scratch, PipelineError> {
        let folder = self.root.join(SCRATCH);
        disk::create_dir_all(&folder)?;
        let (owner, token) = Owned::create(|token| folder.join(format!("{token}.lock")))?;
        let path = folder.join(format!("{token}.{stage}-{trial}"));
        let scratch = Scratch { path, owner };
        disk::create_dir_all(&scratch.path)?;
        Ok(scratch)
    }

    /// Writes the manifest next to the tables. Nothing is visible to readers yet.
    pub fn complete(&self, scratch: Scratch, mut manifest: Manifest) -> Result<Complete, PipelineError> {
        manifest.files = stamps(&scratch)?;
        manifest.output = hash_of(&manifest.files);
        seal::write(&scratch.join(MANIFEST), &manifest)?;
        Ok(Complete { scratch, manifest })
    }

    /// Writes the manifest next to the tables, waits until all files are on the disk, and renames
    /// the folder into place.
    pub fn commit(&self, scratch: Scratch, manifest: Manifest) -> Result<Manifest, PipelineError> {
        let placed = self.place_all(vec![self.complete(scratch, manifest)?], disk::SYNCS);
        let (manifest, done) =
            placed.into_iter().next().ok_or_else(|| PipelineError::request("nothing was written"))?;
        done.map(|()| manifest)
    }

    /// Puts results in place, in this order: flush the content of all files to disk, `at_once` at a
    /// time; flush the names in their folders; rename the folders; flush the new names; remove what
    /// was replaced. A problem with one result does not affect the others.
    pub fn place_all(&self, batch: Vec<Complete>, at_once: usize) -> Vec<(Manifest, Result<(), PipelineError>)> {
        let mut done: Vec<Result<Option<PathBuf>, PipelineError>> = batch.iter().map(|_| Ok(None)).collect();
        let files = batch.iter().enumerate().flat_map(|(i, result)| {
            let names = result.manifest.files.keys().map(String::as_str).chain([MANIFEST]);
            names.map(move |name| (i, result.scratch.join(name)))
        });
        wait_for(files, at_once, &mut done);
        if cfg!(unix) {
            let folders = batch.iter().map(|result| result.scratch.to_path_buf()).enumerate();
            wait_for(folders, at_once, &mut done);
        }
        for (result, done) in batch.iter().zip(&mut done).filter(|(_, done)| done.is_ok()) {
            *done = self.rename_into_place(result);
        }
        let stages: BTreeSet<&str> = batch.iter().map(|result| result.manifest.stage.as_str()).collect();
        for stage in stages {
            let of_stage = batch.iter().zip(&mut done).filter(|(r, done)| r.manifest.stage == stage && done.is_ok());
            let mut of_stage = of_stage.map(|(_, done)| done).peekable();
            if of_stage.peek().is_some()
                && let Err(e) = disk::sync_folder(&self.root.join(stage))
            {
                // the old results stay among the temporary folders until the next run clears up
                of_stage.for_each(|done| *done = Err(PipelineError::request(e.to_string())));
            }
        }
        let mut out = Vec::with_capacity(batch.len());
        for (Complete { manifest, scratch }, done) in batch.into_iter().zip(done) {
            let done = done.and_then(|old| old.map_or(Ok(()), |old| disk::remove_dir_all(&old)));
            drop(scratch);
            if done.is_ok() {
                // the files just written were hashed as they are on the disk
                let key = (manifest.stage.clone(), manifest.trial.clone());
                self.examined.lock().unwrap_or_else(PoisonError::into_inner).insert(key, Vec::new());
            }
            out.push((manifest, done));
        }
        out
    }

    /// Returns the present path of the result that was there before.
    fn rename_into_place(&self, result: &Complete) -> Result<Option<PathBuf>, PipelineError> {
        let Complete { manifest, scratch } = result;
        let place = self.place(&manifest.stage, &manifest.trial);
        let parent = self.root.join(&manifest.stage);
        if !parent.is_dir() {
            disk::create_dir_all(&parent)?;
            disk::sync_folder(&self.root)?;
        }
        if !place.exists() {
            return disk::rename(scratch, &place).map(|()| None);
        }
        let mut old = scratch.as_os_str().to_owned();
        old.push(OLD);
        let old = PathBuf::from(old);
        disk::rename(&place, &old)?;
        if let Err(e) = disk::rename(scratch, &place) {
            // if this fails, too, the next run does it
            let _ = disk::rename(&old, &place);
            return Err(e);
        }
        Ok(Some(old))
    }

    /// Content hash of a recording. The file is read again only if the file system indicates a
    /// possible change: in size, modification time, change time or inode.
    pub fn input_hash(&self, path: &Path) -> Result<String, PipelineError> {
        self.inputs.of(path)
    }

    /// Stores the hashes of the recordings for the next run.
    pub fn save_input_hashes(&self) -> Result<(), PipelineError> {
        self.inputs.save()
    }
}

/// Waits until files or folders of results are on the disk, each given with the index of its
/// result; the first error of each result is kept.
fn wait_for<T>(paths: impl Iterator<Item = (usize, PathBuf)>, at_once: usize, done: &mut [Result<T, PipelineError>]) {
    let (of, paths): (Vec<usize>, Vec<PathBuf>) = paths.filter(|(i, _)| done[*i].is_ok()).unzip();
    for (i, answer) in of.into_iter().zip(disk::sync_each(&paths, at_once)) {
        if let (Err(e), Ok(_)) = (answer, &done[i]) {
            done[i] = Err(e);
        }
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "tests fail by panicking")]
mod tests {
    use super::*;
    use crate::manifest::Outcome;
    use std::collections::BTreeMap;
    use std::time::Duration;

    fn manifest(trial: &str, seconds: f64) -> Manifest {
        Manifest {
            stage: "ik".into(),
            trial: trial.into(),
            version: 1,
            parameters: serde_json::json!({}),
            inputs: BTreeMap::new(),
            outcome: Outcome::Ok,
            warnings: Vec::new(),
            summary: BTreeMap::new(),
            output: String::new(),
            files: BTreeMap::new(),
            seconds,
            program: String::new(),
        }
    }

    #[test]
    fn unit_a_result_that_a_killed_run_had_moved_away_is_put_back() {
        let dir = tempfile::tempdir().unwrap();
        let ws = Workspace::open(&dir.path().join("ws"));
        let lock = ws.lock(Duration::ZERO).unwrap();
        for trial in ["a.1", "a.2"] {
            ws.commit(ws.scratch("ik", trial).unwrap(), manifest(trial, 1.0)).unwrap();
        }
        drop(lock);
        // killed between the two renames: once with the new result complete, once with it
        // half-written
        let moved = |trial: &str, token: &str| {
            let scratch = ws.root().join(SCRATCH).join(format!("{token}.ik-{trial}"));
            std::fs::create_dir_all(&scratch).unwrap();
            std::fs::write(ws.root().join(SCRATCH).join(format!("{token}.lock")), "").unwrap();
            std::fs::rename(ws.place("ik", trial), format!("{}{OLD}", scratch.display())).unwrap();
            scratch
        };
        seal::write(&moved("a.1", "pc-1-0").join(MANIFEST), &manifest("a.1", 2.0)).unwrap();
        std::fs::write(moved("a.2", "pc-1-1").join(MANIFEST), "{\"stage\": \"i").unwrap();
        assert!(ws.manifest("ik", "a.1").unwrap().is_none() && ws.manifest("ik", "a.2").unwrap().is_none());
        // files that a running process is still writing stay
        let live = ws.scratch("ik", "a.3").unwrap();
        let file = disk::Temporary::beside(&ws.root().join("discovery.json")).unwrap();
        let _lock = ws.lock(Duration::ZERO).unwrap();
        assert_eq!(ws.manifest("ik", "a.1").unwrap().map(|m| m.seconds), Some(2.0));
        assert_eq!(ws.manifest("ik", "a.2").unwrap().map(|m| m.seconds), Some(1.0));
        assert!(live.is_dir() && file.path().is_file());
        drop((live, file));
        assert_eq!(std::fs::read_dir(ws.root().join(SCRATCH)).unwrap().count(), 0);
    }

    #[test]
    fn a_result_that_cannot_be_placed_leaves_what_stood_there_and_the_others_go_on() {
        let names = ["a", "b", "c", "d"];
        for (broken, way) in (0..names.len()).flat_map(|i| [(i, "file"), (i, "folder"), (i, "place")]) {
            let dir = tempfile::tempdir().unwrap();
            let ws = Workspace::open(&dir.path().join("ws"));
            let lock = ws.lock(Duration::ZERO).unwrap();
            let make = |name: &str, seconds: f64| {
                let scratch = ws.scratch("ik", name).unwrap();
                disk::write(&scratch.join("x.json"), seconds.to_string().as_bytes()).unwrap();
                ws.complete(scratch, manifest(name, seconds)).unwrap()
            };
            assert!(ws.place_all(Vec::new(), 8).is_empty());
            let first = ws.place_all(names.map(|n| make(n, 1.0)).into(), 8);
            assert!(first.iter().all(|(_, done)| done.is_ok()));
            let batch = names.map(|n| make(n, 2.0));
            let scratch = batch[broken].scratch.to_path_buf();
            match way {
                "file" => std::fs::remove_file(scratch.join("x.json")).unwrap(),
                "folder" => std::fs::remove_dir_all(&scratch).unwrap(),
                // the new folder cannot be renamed onto a file that appears there in between
                _ => {
                    std::fs::remove_dir_all(ws.place("ik", names[broken])).unwrap();
                    #[cfg(unix)]
                    std::os::unix::fs::symlink(dir.path().join("gone"), ws.place("ik", names[broken])).unwrap();
                    #[cfg(not(unix))]
                    continue;
                }
            }
            let done = ws.place_all(batch.into(), 8);
            for (i, (m, done)) in done.iter().enumerate() {
                assert_eq!((m.trial.as_str(), done.is_err()), (names[i], i == broken), "{way} {broken}");
                let now = Workspace::open(ws.root());
                let stands = now.manifest("ik", names[i]).unwrap().map(|m| m.seconds);
                let wanted = if i != broken { Some(2.0) } else { Some(1.0).filter(|_| way != "place") };
                assert_eq!(stands, wanted, "{way} {broken} {i}");
                assert!(stands.is_none() || now.damage("ik", names[i]).unwrap().is_empty());
                if let Err(e) = done {
                    assert!(e.to_string().contains(&scratch.display().to_string()), "{e}");
                }
            }
            drop(lock);
            assert_eq!(std::fs::read_dir(ws.root().join(SCRATCH)).unwrap().count(), 0, "{way} {broken}");
        }
    }

    #[test]
    fn regress_a_manifest_that_cannot_be_read_is_neither_missing_nor_damaged() {
        let dir = tempfile::tempdir().unwrap();
        let ws = Workspace::open(dir.path());
        let place = ws.place("ik", "a");
        let known = || (ws.manifest("ik", "a"), ws.output("ik", "a"), ws.damage("ik", "a"));
        assert!(matches!(known(), (Ok(None), Ok(output), Ok(damage)) if output.is_empty() && damage.is_empty()));
        std::fs::create_dir_all(&place).unwrap();
        std::fs::write(place.join(MANIFEST), "{}").unwrap();
        ws.forget("ik", "a");
        assert!(matches!(known(), (Ok(None), Ok(_), Ok(damage)) if damage.len() == 1));
        // what the system does not read as a file, whoever the user is
        std::fs::remove_file(place.join(MANIFEST)).unwrap();
        std::fs::create_dir(place.join(MANIFEST)).unwrap();
        ws.forget("ik", "a");
        let (manifest, output, damage) = known();
        for error in [manifest.map(|_| ()), output.map(|_| ()), damage.map(|_| ())] {
            assert!(error.unwrap_err().to_string().contains(&place.join(MANIFEST).display().to_string()));
        }
    }

    #[test]
    fn every_damage_of_a_result_is_found() {
        let dir = tempfile::tempdir().unwrap();
        let ws = Workspace::open(&dir.path().join("ws"));
        let make = || {
            let scratch = ws.scratch("ik", "a").unwrap();
            disk::write(&scratch.join("x.json"), b"{\"x\": 1}").unwrap();
            disk::write(&scratch.join("y.parquet"), &[7; 500]).unwrap();
            ws.commit(scratch, manifest("a", 1.0)).unwrap();
        };
        make();
        let place = ws.place("ik", "a");
        let look = || Workspace::open(ws.root()).damage("ik", "a").unwrap();
        assert!(look().is_empty() && Workspace::open(ws.root()).damage("ik", "b").unwrap().is_empty());
        for name in ["x.json", "y.parquet", MANIFEST] {
            let path = place.join(name);
            let bytes = std::fs::read(&path).unwrap();
            for i in (0..bytes.len()).step_by(7) {
                let mut flipped = bytes.clone();
                flipped[i] ^= 16;
                for wrong in [flipped, bytes[..i].to_vec()] {
                    std::fs::write(&path, wrong).unwrap();
                    assert!(look().iter().any(|p| p.contains(name)), "{name} at {i}");
                }
            }
            std::fs::remove_file(&path).unwrap();
            assert!(look().iter().any(|p| p.contains(name)));
            std::fs::write(&path, bytes).unwrap();
            assert!(look().is_empty());
        }
        std::fs::write(place.join("z.json"), "").unwrap();
        assert!(look().iter().any(|p| p.contains("z.json does not belong")));
        make();
        assert!(look().is_empty());
    }
}
