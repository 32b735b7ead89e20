//! `simulate`: makes a laboratory folder of recordings from a scenario, with sealed truth. Existing
//! files are not overwritten.

use aloft_simulate::Scenario;
use aloft_study::catalog;
use aloft_workspace::disk;
use aloft_workspace::error::PipelineError;
use aloft_workspace::theirs::refuse_filled;
use aloft_workspace::unfinished::Unfinished;
use std::path::{Path, PathBuf};

/// Makes the folder; returns the paths written.
pub fn simulate(scenario: &str, out: &Path, seed: Option<u64>) -> Result<Vec<PathBuf>, PipelineError> {
    refuse_filled(out)?;
    let mut wanted: Scenario = catalog::load("scenarios", scenario, Path::new(""))?;
    if let Some(seed) = seed {
        wanted.seed = seed;
    }
    let lab = aloft_simulate::simulate(&wanted).map_err(|e| PipelineError::request(e.to_string()))?;
    // written beside the folder and moved there, so that the folder holds all recordings or none
    let whole = std::path::absolute(out).map_err(PipelineError::io("find", out))?;
    let parent = whole.parent().unwrap_or(&whole);
    disk::create_dir_all(parent)?;
    let scratch = Unfinished::new_in(parent)?;
    for file in &lab.files {
        let path = scratch.path().join(&file.path);
        if let Some(folder) = path.parent() {
            disk::create_dir_all(folder)?;
        }
        disk::write(&path, &file.bytes)?;
    }
    scratch.place(&whole)?;
    Ok(lab.files.iter().map(|file| out.join(&file.path)).collect())
}
