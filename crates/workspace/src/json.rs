//! Plain JSON files of a workspace.

use crate::disk;
use crate::error::PipelineError;
use serde::Serialize;
use std::path::Path;

/// Writes pretty JSON.
pub fn write_json<T: Serialize>(path: &Path, value: &T) -> Result<(), PipelineError> {
    let text = serde_json::to_vec_pretty(value)
        .map_err(|e| PipelineError::Table { path: path.to_path_buf(), problem: e.to_string() })?;
    disk::write(path, &text)
}

/// Writes pretty JSON, completely or not at all.
pub fn write_json_whole<T: Serialize>(path: &Path, value: &T) -> Result<(), PipelineError> {
    let text = serde_json::to_vec_pretty(value)
        .map_err(|e| PipelineError::Table { path: path.to_path_buf(), problem: e.to_string() })?;
    disk::write_whole(path, &text)
}

/// Reads JSON.
pub fn read_json<T: serde::de::DeserializeOwned>(path: &Path) -> Result<T, PipelineError> {
    let bytes = std::fs::read(path).map_err(PipelineError::io("read", path))?;
    serde_json::from_slice(&bytes)
        .map_err(|e| PipelineError::Table { path: path.to_path_buf(), problem: e.to_string() })
}
