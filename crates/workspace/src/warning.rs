//! Warnings of the stages: a reason, on which programs decide, and a sentence for people.

use crate::qc::QcReason;
use serde::{Deserialize, Serialize};

/// A warning of a stage. In a manifest it has the fields `reason` and `text`; a manifest of an
/// earlier version has the sentence alone, which is read with the reason [`QcReason::Remarks`].
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(from = "Stored")]
pub struct StageWarning {
    /// Reason; [`QcReason::Remarks`] where the list has none for it.
    pub reason: QcReason,
    /// The sentence shown to people.
    pub text: String,
}

/// The forms in which a warning may stand in a manifest.
#[derive(Deserialize)]
#[serde(untagged)]
enum Stored {
    Text(String),
    Typed { reason: QcReason, text: String },
}

impl From<Stored> for StageWarning {
    fn from(stored: Stored) -> Self {
        match stored {
            Stored::Text(text) => Self::from(text),
            Stored::Typed { reason, text } => Self { reason, text },
        }
    }
}

impl StageWarning {
    /// A warning with its reason.
    pub fn new(reason: QcReason, text: impl Into<String>) -> Self {
        Self { reason, text: text.into() }
    }
}

impl From<String> for StageWarning {
    fn from(text: String) -> Self {
        Self { reason: QcReason::Remarks, text }
    }
}

impl std::fmt::Display for StageWarning {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(&self.text)
    }
}

/// Warnings while a stage runs. A sentence can be added as it is where no reason fits.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Warnings(Vec<StageWarning>);

impl Warnings {
    /// Adds a warning.
    pub fn push(&mut self, warning: impl Into<StageWarning>) {
        self.0.push(warning.into());
    }
}

impl<W: Into<StageWarning>> Extend<W> for Warnings {
    fn extend<I: IntoIterator<Item = W>>(&mut self, warnings: I) {
        self.0.extend(warnings.into_iter().map(Into::into));
    }
}

impl<W: Into<StageWarning>> From<Vec<W>> for Warnings {
    fn from(warnings: Vec<W>) -> Self {
        Self(warnings.into_iter().map(Into::into).collect())
    }
}

impl From<Warnings> for Vec<StageWarning> {
    fn from(warnings: Warnings) -> Self {
        warnings.0
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "tests fail by panicking")]
mod tests {
    use super::*;

    #[test]
    fn unit_warnings_of_earlier_manifests_are_read() {
        let both = r#"["a sentence", {"reason": "untared_plate", "text": "plate `FP1`"}]"#;
        let read: Vec<StageWarning> = serde_json::from_str(both).unwrap();
        let typed = StageWarning::new(QcReason::UntaredPlate, "plate `FP1`");
        assert_eq!(read, [StageWarning::from("a sentence".to_owned()), typed]);
        assert_eq!(read[0].reason, QcReason::Remarks);
        let again: Vec<StageWarning> = serde_json::from_str(&serde_json::to_string(&read).unwrap()).unwrap();
        assert_eq!(again, read);
    }
}
