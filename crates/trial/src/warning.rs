//! Import warnings: a kind, on which programs decide, and a message for people.

use aloft_c3d::WarningKind as C3dKind;
use serde::{Deserialize, Serialize};

/// Kind of a warning. Programs decide on the kind, never on the message.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
#[non_exhaustive]
pub enum WarningKind {
    /// The recording ends before the declared number of frames; the frames present were read.
    Truncated {
        /// Frames in the file.
        held: usize,
        /// Frames declared.
        stated: usize,
    },
    /// The force file that accompanies the markers ends before the declared number of rows.
    ForcesTruncated {
        /// Rows in the file.
        held: usize,
        /// Rows declared.
        stated: usize,
    },
    /// Contradictory statements in the source; the message names the one used.
    Contradiction,
    /// A required value is missing in the source; the message names the value used instead.
    Missing,
    /// Labels: repeated, truncated, unlabelled, of several subjects, or matched loosely.
    Labels,
    /// Parameter section of a C3D file: malformed records that were skipped or repaired.
    Parameters,
    /// Events outside the recording, or without a usable time.
    Events,
    /// Force plates: omitted, without a position, inverted, or with doubtful units.
    Plates,
    /// Analog channels of a C3D file and their scaling.
    Analogs,
    /// Rows of a text file that are missing or incomplete.
    Rows,
    /// The vertical axis, or vectors that are not in laboratory axes.
    Axes,
    /// The unit of length is doubtful.
    Units,
    /// Read from a stored result that kept only the message.
    Unspecified,
}

/// An irregularity that did not prevent reading.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Warning {
    /// Kind.
    pub kind: WarningKind,
    /// Message, with the place in the source and the action taken.
    pub message: String,
}

impl Warning {
    /// Creates a warning from a kind and a message.
    pub fn new(kind: WarningKind, message: impl Into<String>) -> Self {
        Self { kind, message: message.into() }
    }
}

impl std::fmt::Display for Warning {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(&self.message)
    }
}

impl From<&aloft_c3d::Warning> for Warning {
    fn from(warning: &aloft_c3d::Warning) -> Self {
        let kind = match warning.kind {
            C3dKind::Truncated { held, stated } => WarningKind::Truncated { held, stated },
            C3dKind::Contradiction => WarningKind::Contradiction,
            C3dKind::Missing => WarningKind::Missing,
            C3dKind::Labels => WarningKind::Labels,
            C3dKind::Parameters => WarningKind::Parameters,
            C3dKind::Events => WarningKind::Events,
            C3dKind::Plates => WarningKind::Plates,
            C3dKind::Analogs => WarningKind::Analogs,
            _ => WarningKind::Unspecified,
        };
        Self::new(kind, warning.message.clone())
    }
}
