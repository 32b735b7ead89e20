//! Plain JSON files of a workspace. A number that is not defined is `null` in them.

use crate::disk;
use crate::error::PipelineError;
use crate::undefined::Undefined;
use serde::Serialize;
use serde::de::DeserializeOwned;
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

/// Reads JSON; `null` is NaN where a floating-point number is expected.
pub fn read_json<T: DeserializeOwned>(path: &Path) -> Result<T, PipelineError> {
    let bytes = disk::read(path)?;
    from_slice(&bytes).map_err(|e| PipelineError::Table { path: path.to_path_buf(), problem: e.to_string() })
}

/// The same if the file exists. A file that exists and cannot be read is an error, so that an
/// answer never silently rests on less than what is there.
pub fn read_json_if_there<T: DeserializeOwned>(path: &Path) -> Result<Option<T>, PipelineError> {
    if disk::is_there(path)? { read_json(path).map(Some) } else { Ok(None) }
}

/// A value from JSON text; `null` is NaN where a floating-point number is expected.
///
/// # Errors
/// The text is no JSON, or does not fit the type.
pub fn from_slice<T: DeserializeOwned>(text: &[u8]) -> Result<T, serde_json::Error> {
    let mut reader = serde_json::Deserializer::from_slice(text);
    let value = T::deserialize(Undefined(&mut reader))?;
    reader.end()?;
    Ok(value)
}

/// A value from parsed JSON; `null` is NaN where a floating-point number is expected.
///
/// # Errors
/// The value does not fit the type.
pub fn from_value<T: DeserializeOwned>(value: serde_json::Value) -> Result<T, serde_json::Error> {
    T::deserialize(Undefined(value))
}
