//! What a result was made from: the manifest beside its tables, what differs from what there is
//! now, and whether the files are those that it lists.

use crate::disk;
use crate::error::{PipelineError, StageFailure};
use crate::seal;
use crate::warning::StageWarning;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::io::ErrorKind::NotFound;
use std::path::Path;

/// File that states what a result was made from and which files belong to it.
pub(crate) const MANIFEST: &str = "manifest.json";

/// Name used in place of a trial's name for results of the whole study.
pub const WHOLE_STUDY: &str = "_study";

/// Outcome of a stage.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case", tag = "status")]
pub enum Outcome {
    /// The tables exist.
    Ok,
    /// The stage failed; there are no tables.
    Failed(StageFailure),
}

/// What the result of a stage was made from, and its outcome.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Manifest {
    /// Stage name.
    pub stage: String,
    /// Trial name, or [`WHOLE_STUDY`].
    pub trial: String,
    /// Version of the stage's code.
    pub version: u32,
    /// The parameters that the stage reads.
    pub parameters: serde_json::Value,
    /// Hash of each input: recordings and upstream results.
    pub inputs: BTreeMap<String, String>,
    /// Outcome.
    pub outcome: Outcome,
    /// Warnings.
    pub warnings: Vec<StageWarning>,
    /// Figures for tables.
    pub summary: BTreeMap<String, serde_json::Value>,
    /// Hash over all files of the result.
    pub output: String,
    /// Every file of the result except the manifest itself.
    #[serde(default)]
    pub files: BTreeMap<String, FileStamp>,
    /// Wall time of the stage, s.
    pub seconds: f64,
    /// Version of the program.
    pub program: String,
}

/// Size and hash of a file as it was written.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct FileStamp {
    /// Size, bytes.
    pub bytes: u64,
    /// Hash of the content.
    pub blake3: String,
}

impl FileStamp {
    fn of(bytes: &[u8]) -> Self {
        Self { bytes: bytes.len() as u64, blake3: blake3::hash(bytes).to_hex().to_string() }
    }
}

impl Manifest {
    /// True if the result can be used.
    pub fn is_ok(&self) -> bool {
        self.outcome == Outcome::Ok
    }

    /// Differences between what this result was made from and the given version, parameters and
    /// inputs, in words; empty if there are none.
    pub fn differences(
        &self,
        version: u32,
        parameters: &serde_json::Value,
        inputs: &BTreeMap<String, String>,
    ) -> Vec<String> {
        let mut changes = Vec::new();
        if self.version != version {
            changes.push(format!("the stage's code: version {} → {version}", self.version));
        }
        describe_changes("", &self.parameters, parameters, &mut changes);
        // the role appears and disappears together with the result of the same recording
        let other = |k: &&String| !k.starts_with(ROLE);
        let changed = inputs.iter().filter(|(k, hash)| self.inputs.get(*k).is_some_and(|old| old != *hash));
        let new = inputs.keys().filter(|k| !self.inputs.contains_key(*k)).filter(other);
        let gone = self.inputs.keys().filter(|k| !inputs.contains_key(*k)).filter(other);
        describe_inputs("new input", new, &mut changes);
        describe_inputs("input changed", changed.map(|(k, _)| k), &mut changes);
        describe_inputs("input gone", gone, &mut changes);
        changes
    }
}

/// Prefix of the key of an input that is the role of a recording.
pub const ROLE: &str = "role ";

/// Results of one stage that are named one by one when they changed; of more, only the number.
const NAMED: usize = 3;

/// Adds what happened to inputs; many results of one stage are one entry.
fn describe_inputs<'k>(what: &str, keys: impl Iterator<Item = &'k String>, changes: &mut Vec<String>) {
    let stage_of = |key: &'k String| key.split_once('/').filter(|(_, of)| *of != WHOLE_STUDY).map(|(stage, _)| stage);
    let mut groups: Vec<(Option<&str>, Vec<&String>)> = Vec::new();
    for key in keys {
        match groups.last_mut() {
            Some((stage, all)) if stage.is_some() && *stage == stage_of(key) => all.push(key),
            _ => groups.push((stage_of(key), vec![key])),
        }
    }
    for (stage, keys) in groups {
        match stage.filter(|_| keys.len() > NAMED) {
            Some(stage) => changes.push(format!("{what}: the results of `{stage}` for {} recordings", keys.len())),
            None => changes.extend(keys.into_iter().map(|k| format!("{what}: {}", in_words(k)))),
        }
    }
}

/// Key of the input that is a trial's time in the session.
pub const TIME: &str = "time in the session";

/// An input's key in words: `file jump01.c3d`, `ik/jump01` or `role jump01`.
fn in_words(key: &str) -> String {
    if let Some(trial) = key.strip_prefix(ROLE) {
        return format!("the part that {trial} plays");
    }
    if key == TIME {
        return "when in the session it was recorded".to_owned();
    }
    match (key.strip_prefix("file "), key.split_once('/')) {
        (Some(file), _) => format!("the content of the file {file}"),
        (None, Some((stage, trial))) if trial == WHOLE_STUDY => format!("the result of `{stage}`"),
        (None, Some((stage, trial))) => format!("the result of `{stage}` for {trial}"),
        _ => key.to_owned(),
    }
}

fn describe_changes(path: &str, old: &serde_json::Value, new: &serde_json::Value, out: &mut Vec<String>) {
    use serde_json::Value::Object;
    match (old, new) {
        (Object(a), Object(b)) => {
            for (key, value) in b {
                let here = if path.is_empty() { key.clone() } else { format!("{path}.{key}") };
                describe_changes(&here, a.get(key).unwrap_or(&serde_json::Value::Null), value, out);
            }
            for key in a.keys().filter(|k| !b.contains_key(*k)) {
                out.push(format!("parameter gone: {path}.{key}"));
            }
        }
        _ if old == new => {}
        _ => {
            let show = |v: &serde_json::Value| {
                let s = v.to_string();
                if s.len() > 60 { format!("{}…", s.chars().take(57).collect::<String>()) } else { s }
            };
            out.push(format!("parameter `{path}`: {} → {}", show(old), show(new)));
        }
    }
}

/// Compares a result's folder with its manifest.
///
/// # Errors
/// The system cannot read one of its files: whether it is damaged is not known.
pub(crate) fn examine(place: &Path) -> Result<Vec<String>, PipelineError> {
    if !disk::is_there(place)? {
        return Ok(Vec::new());
    }
    let manifest: Manifest = match seal::read(&place.join(MANIFEST)) {
        Ok(manifest) => manifest,
        Err(PipelineError::Damaged { problem, .. }) => return Ok(vec![format!("{MANIFEST}: {problem}")]),
        Err(PipelineError::Io { problem, .. }) if problem.kind() == NotFound => {
            return Ok(vec![format!("{MANIFEST}: {problem}")]);
        }
        Err(e) => return Err(e),
    };
    let mut problems = Vec::new();
    for (name, stamp) in &manifest.files {
        let file = place.join(name);
        match std::fs::read(&file) {
            Err(e) if e.kind() == NotFound => problems.push(format!("{name} is missing")),
            Err(e) => return Err(PipelineError::io("read", file)(e)),
            Ok(bytes) if bytes.len() as u64 != stamp.bytes => {
                problems.push(format!("{name} has {} bytes, expected {}", bytes.len(), stamp.bytes));
            }
            Ok(bytes) if FileStamp::of(&bytes) != *stamp => {
                problems.push(format!("{name}: its content is not what was written"));
            }
            Ok(_) => {}
        }
    }
    // hidden files belong to the file system or to file managers
    let names = std::fs::read_dir(place).into_iter().flatten().flatten();
    for name in names.map(|e| e.file_name().to_string_lossy().into_owned()) {
        if name != MANIFEST && !name.starts_with('.') && !manifest.files.contains_key(&name) {
            problems.push(format!("{name} does not belong to the result"));
        }
    }
    Ok(problems)
}

/// Files of a folder with their hashes.
pub(crate) fn stamps(folder: &Path) -> Result<BTreeMap<String, FileStamp>, PipelineError> {
    let mut all = BTreeMap::new();
    for entry in std::fs::read_dir(folder).map_err(PipelineError::io("list", folder))? {
        let path = entry.map_err(PipelineError::io("list", folder))?.path();
        let bytes = disk::read(&path)?;
        let name = path.file_name().map(|n| n.to_string_lossy().into_owned()).unwrap_or_default();
        all.insert(name, FileStamp::of(&bytes));
    }
    Ok(all)
}

/// Combined hash of all files of a result.
pub(crate) fn hash_of(files: &BTreeMap<String, FileStamp>) -> String {
    let mut hasher = blake3::Hasher::new();
    for (name, stamp) in files {
        hasher.update(&(name.len() as u64).to_le_bytes());
        hasher.update(name.as_bytes());
        hasher.update(stamp.blake3.as_bytes());
    }
    hasher.finalize().to_hex().to_string()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn many_results_of_a_stage_that_changed_are_one_reason_and_few_are_named() {
        let inputs = |pairs: &[(&str, &str)]| -> BTreeMap<String, String> {
            pairs.iter().map(|(k, v)| ((*k).to_owned(), (*v).to_owned())).collect()
        };
        let manifest = Manifest {
            stage: "regressor".into(),
            trial: "a".into(),
            version: 1,
            parameters: serde_json::json!({}),
            inputs: inputs(&[
                ("import/a", "1"),
                ("import/b", "1"),
                ("import/c", "1"),
                ("import/d", "1"),
                ("role d", "x"),
            ]),
            outcome: Outcome::Ok,
            warnings: Vec::new(),
            summary: BTreeMap::new(),
            output: String::new(),
            files: BTreeMap::new(),
            seconds: 0.0,
            program: String::new(),
        };
        let changes = |now: &[(&str, &str)]| manifest.differences(1, &serde_json::json!({}), &inputs(now));
        assert_eq!(changes(&[]), ["input gone: the results of `import` for 4 recordings"]);
        let one = [("import/a", "1"), ("import/b", "2"), ("import/c", "1"), ("import/d", "1"), (TIME, "3 s")];
        assert_eq!(
            changes(&one),
            ["new input: when in the session it was recorded", "input changed: the result of `import` for b"]
        );
        let few = [("import/a", "1"), ("import/c", "1"), ("calibrate/_study", "1"), ("role d", "y")];
        assert_eq!(
            changes(&few),
            [
                "new input: the result of `calibrate`",
                "input changed: the part that d plays",
                "input gone: the result of `import` for b",
                "input gone: the result of `import` for d"
            ]
        );
    }
}
