//! Looks up named configurations such as `human34` or `de_leva`: in a file beside the pipeline, or
//! in the set built into the binary.

use crate::nearest::hint;
use crate::ranges::parse_yaml;
use aloft_workspace::error::PipelineError;
use aloft_workspace::input;
use include_dir::{Dir, include_dir};
use serde::de::DeserializeOwned;
use std::path::{Path, PathBuf};

static BUILT_IN: Dir<'_> = include_dir!("$CARGO_MANIFEST_DIR/../../configs");

/// The text of a configuration and where it came from.
#[derive(Debug, Clone)]
pub struct Source {
    /// A path, or `built in: models/human34.yaml`.
    pub origin: String,
    /// The text.
    pub text: String,
}

/// Names of the built-in configurations of one kind (`models`, `markersets`, `anthropometry`,
/// `objects`, `scenarios`).
pub fn names(kind: &str) -> Vec<String> {
    let mut names: Vec<String> = BUILT_IN
        .get_dir(kind)
        .map(|d| d.files().filter_map(|f| f.path().file_stem()).map(|s| s.to_string_lossy().into_owned()).collect())
        .unwrap_or_default();
    names.sort();
    names
}

/// Finds `name` of a `kind`: first as a path relative to the pipeline, then as
/// `../configs/<kind>/<name>.yaml` beside it, then in the built-in set.
pub fn find(kind: &str, name: &str, pipeline_dir: &Path) -> Result<Source, PipelineError> {
    let looks_like_path = name.contains(['/', '\\', '.']);
    let mut candidates: Vec<PathBuf> = Vec::new();
    if looks_like_path {
        candidates.push(pipeline_dir.join(name));
    } else {
        candidates.push(pipeline_dir.join(format!("../configs/{kind}/{name}.yaml")));
    }
    for path in candidates {
        if input::is_there(&path) {
            let text = input::text(&path)?;
            return Ok(Source { origin: path.display().to_string(), text });
        }
    }
    if let Some(file) = BUILT_IN.get_file(format!("{kind}/{name}.yaml")) {
        return Ok(Source {
            origin: format!("built in: {kind}/{name}.yaml"),
            text: file.contents_utf8().unwrap_or_default().to_owned(),
        });
    }
    let names = names(kind);
    let known: Vec<&str> = names.iter().map(String::as_str).collect();
    Err(PipelineError::request_hint(
        format!("no {} called `{name}`", kind.trim_end_matches('s')),
        format!("{}; or give a path ending in .yaml", hint(name, &known, "known are")),
    ))
}

/// Finds a configuration as [`find`] does, and parses it.
pub fn load<T: DeserializeOwned>(kind: &str, name: &str, pipeline_dir: &Path) -> Result<T, PipelineError> {
    let source = find(kind, name, pipeline_dir)?;
    parse_yaml(&source.origin, &source.text)
}

/// Every built-in configuration of a kind, parsed.
pub fn all<T: DeserializeOwned>(kind: &str) -> Result<Vec<T>, PipelineError> {
    let nowhere = Path::new("");
    names(kind).iter().map(|n| load(kind, n, nowhere)).collect()
}
