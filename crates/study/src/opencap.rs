//! What OpenCap states about a subject: `sessionMetadata.yaml` in the folder of a session, above
//! its `MarkerData`.

use crate::config::{HEIGHT_M, MASS_KG};
use aloft_workspace::error::PipelineError;
use aloft_workspace::input;
use serde_yaml::Value;
use std::path::{Path, PathBuf};

/// Name of the file.
pub const METADATA: &str = "sessionMetadata.yaml";
/// Folders above the recordings in which it is looked for: `MarkerData/PostAugmentation` at most.
const ABOVE: usize = 3;

/// Facts in a session's metadata; a value that no person can have is left out.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Metadata {
    /// Name of the subject.
    pub name: Option<String>,
    /// `F` or `M`.
    pub sex: Option<&'static str>,
    /// Stature, m.
    pub height_m: Option<f64>,
    /// Body mass, kg.
    pub mass_kg: Option<f64>,
}

/// The metadata of the session whose recordings are in a folder: in it, above it where it belongs
/// to a session, or in the only folder below it that has some.
pub fn beside(data: &Path) -> Option<PathBuf> {
    let data = data.canonicalize().unwrap_or_else(|_| data.to_path_buf());
    let in_session = data.ancestors().take(ABOVE).any(|a| a.file_name().is_some_and(|n| n == "MarkerData"));
    let above = data.ancestors().take(if in_session { ABOVE } else { 1 }).map(|a| a.join(METADATA));
    if let Some(found) = above.into_iter().find(|p| p.is_file()) {
        return Some(found);
    }
    // none: the listing of the recordings names a folder that cannot be read
    let folders = std::fs::read_dir(&data).ok()?.filter_map(|e| e.ok().map(|e| e.path().join(METADATA)));
    let found: Vec<PathBuf> = folders.filter(|p| p.is_file()).collect();
    if let [only] = found.as_slice() { Some(only.clone()) } else { None }
}

/// Reads the metadata.
///
/// # Errors
/// The file cannot be read or is no YAML.
pub fn read(path: &Path) -> Result<Metadata, PipelineError> {
    let value: Value = crate::ranges::parse_yaml(&path.display().to_string(), &input::text(path)?)?;
    let text = |key: &str| value.get(key).and_then(Value::as_str).map(str::trim).filter(|t| !t.is_empty());
    let number = |key: &str, (low, high): (f64, f64)| {
        value.get(key).and_then(Value::as_f64).filter(|x| (low..=high).contains(x))
    };
    let sex = ["sex", "gender_mf"].into_iter().find_map(text).map(str::to_lowercase);
    Ok(Metadata {
        name: text("subjectID").map(str::to_owned),
        sex: match sex.as_deref() {
            Some("f" | "female" | "woman" | "w") => Some("F"),
            Some("m" | "male" | "man") => Some("M"),
            _ => None,
        },
        height_m: number("height_m", HEIGHT_M),
        mass_kg: number("mass_kg", MASS_KG),
    })
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "tests fail by panicking")]
mod tests {
    use super::*;

    #[test]
    fn a_session_states_mass_and_height() {
        let dir = tempfile::tempdir().unwrap();
        let session = dir.path().join("OpenCapData_1");
        let markers = session.join("MarkerData");
        std::fs::create_dir_all(&markers).unwrap();
        assert_eq!(beside(&markers), None);
        let file = session.join(METADATA);
        std::fs::write(
            &file,
            "mass_kg: 61.5\nheight_m: 168\nsubjectID: S1\ngender_mf: Woman\niphoneModel: {Cam0: x}\n",
        )
        .unwrap();
        let file = file.canonicalize().unwrap();
        for data in [&markers, &session, &dir.path().to_path_buf()] {
            assert_eq!(beside(data), Some(file.clone()), "{}", data.display());
        }
        let found = read(&file).unwrap();
        assert_eq!(
            (found.mass_kg, found.height_m, found.sex, found.name.as_deref()),
            (Some(61.5), None, Some("F"), Some("S1"))
        );
        let second = dir.path().join("OpenCapData_2");
        std::fs::create_dir(&second).unwrap();
        std::fs::write(second.join(METADATA), "mass_kg: [").unwrap();
        assert_eq!(beside(dir.path()), None, "of two sessions none is chosen");
        assert!(read(&second.join(METADATA)).is_err(), "a body without what its file states is not taken");
    }
}
