//! `simulate`: makes a laboratory folder of recordings from a scenario, with sealed truth. Existing
//! files are not overwritten.

use aloft_simulate::Scenario;
use aloft_study::catalog;
use aloft_workspace::error::PipelineError;
use std::path::{Path, PathBuf};

/// Makes the folder; returns the paths written.
pub fn simulate(scenario: &str, out: &Path, seed: Option<u64>) -> Result<Vec<PathBuf>, PipelineError> {
    if out.is_dir() && std::fs::read_dir(out).is_ok_and(|mut d| d.next().is_some()) {
        return Err(PipelineError::request_hint(
            format!("{} is not empty", out.display()),
            "give --out a new or empty folder, so that nothing of yours is overwritten",
        ));
    }
    let mut wanted: Scenario = catalog::load("scenarios", scenario, Path::new(""))?;
    if let Some(seed) = seed {
        wanted.seed = seed;
    }
    let lab = aloft_simulate::simulate(&wanted).map_err(|e| PipelineError::request(e.to_string()))?;
    let mut written = Vec::new();
    for file in &lab.files {
        let path = out.join(&file.path);
        if let Some(parent) = path.parent() {
            std::fs::create_dir_all(parent).map_err(PipelineError::io("create", parent))?;
        }
        std::fs::write(&path, &file.bytes).map_err(PipelineError::io("write", &path))?;
        written.push(path);
    }
    Ok(written)
}
