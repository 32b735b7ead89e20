//! JSON files that contain their own hash, so that a file that was damaged, truncated or edited is
//! detected when it is read.
//!
//! The first key of such a file is `check`: BLAKE3 over the text without that key.

use crate::disk;
use crate::error::PipelineError;
use crate::json::from_slice;
use serde::Serialize;
use serde::de::DeserializeOwned;
use std::path::Path;

const BEFORE: &str = "{\n  \"check\": \"";
const DIGITS: usize = 64;

/// The JSON text of an object with its hash as first key.
fn sealed(text: &str) -> String {
    let hash = blake3::hash(text.as_bytes()).to_hex();
    match &text[1..] {
        "}" => format!("{BEFORE}{hash}\"}}"),
        rest => format!("{BEFORE}{hash}\",{rest}"),
    }
}

/// The JSON text as it was before it was sealed; the error describes the problem in words.
fn unsealed(bytes: &[u8]) -> Result<String, String> {
    if bytes.is_empty() {
        return Err("the file is empty".to_owned());
    }
    let text = std::str::from_utf8(bytes).map_err(|_| "it is not text".to_owned())?;
    let rest = text.strip_prefix(BEFORE).ok_or("it does not begin with its hash (`check`)")?;
    let cut = "its end is missing";
    let hash = rest.get(..DIGITS).ok_or(cut)?;
    let rest = rest.get(DIGITS..).and_then(|r| r.strip_prefix('"')).ok_or(cut)?;
    let body = match rest.strip_prefix(',') {
        Some(rest) => format!("{{{rest}"),
        None if rest == "}" => "{}".to_owned(),
        None => return Err("its content does not fit its hash".to_owned()),
    };
    if blake3::hash(body.as_bytes()).to_hex().as_str() != hash {
        return Err("its content does not fit its hash".to_owned());
    }
    Ok(body)
}

fn text_of<T: Serialize>(path: &Path, value: &T) -> Result<String, PipelineError> {
    let text = serde_json::to_string_pretty(value)
        .map_err(|e| PipelineError::Table { path: path.to_path_buf(), problem: e.to_string() })?;
    Ok(sealed(&text))
}

/// Writes an object as sealed JSON into a file that is not yet visible to readers.
pub fn write<T: Serialize>(path: &Path, value: &T) -> Result<(), PipelineError> {
    disk::write(path, text_of(path, value)?.as_bytes())
}

/// Writes an object as sealed JSON, completely or not at all.
pub fn write_whole<T: Serialize>(path: &Path, value: &T) -> Result<(), PipelineError> {
    disk::write_whole(path, text_of(path, value)?.as_bytes())
}

/// Reads sealed JSON.
///
/// # Errors
/// The file cannot be read, or it differs from what was written ([`PipelineError::Damaged`]).
pub fn read<T: DeserializeOwned>(path: &Path) -> Result<T, PipelineError> {
    let bytes = disk::read(path)?;
    let damaged = |problem: String| PipelineError::Damaged { path: path.to_path_buf(), problem };
    let body = unsealed(&bytes).map_err(damaged)?;
    from_slice(body.as_bytes()).map_err(|e| damaged(e.to_string()))
}

/// Reads sealed JSON if the file exists.
pub fn read_if_there<T: DeserializeOwned>(path: &Path) -> Result<Option<T>, PipelineError> {
    if disk::is_there(path)? { read(path).map(Some) } else { Ok(None) }
}

/// The same for a file that is made again where it is damaged: none then, too.
///
/// # Errors
/// The file is there and the system cannot read it. It is neither missing nor damaged, and another
/// answer would follow if it were taken for that.
pub fn read_if_whole<T: DeserializeOwned>(path: &Path) -> Result<Option<T>, PipelineError> {
    match read_if_there(path) {
        // none: as the caller says
        Err(PipelineError::Damaged { .. }) => Ok(None),
        other => other,
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "tests fail by panicking")]
mod tests {
    use super::*;
    use std::collections::BTreeMap;

    #[test]
    fn every_changed_or_missing_byte_is_found() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("a.json");
        let value: BTreeMap<String, f64> = [("a".into(), 1.5), ("b ü".into(), -0.0)].into();
        for value in [BTreeMap::new(), value] {
            write_whole(&path, &value).unwrap();
            assert_eq!(read::<BTreeMap<String, f64>>(&path).unwrap(), value);
            serde_json::from_slice::<serde_json::Value>(&std::fs::read(&path).unwrap()).unwrap();
            let bytes = std::fs::read(&path).unwrap();
            for i in 0..bytes.len() {
                let mut changed = bytes.clone();
                changed[i] ^= 1;
                for wrong in [changed, bytes[..i].to_vec(), [&bytes[..i], &bytes[i + 1..]].concat()] {
                    std::fs::write(&path, wrong).unwrap();
                    assert!(matches!(read::<BTreeMap<String, f64>>(&path), Err(PipelineError::Damaged { .. })), "{i}");
                }
            }
        }
    }
}
