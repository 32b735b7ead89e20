//! What was odd in a recording: the kind, on which programs decide, beside the words, which people read.

use aloft_c3d::WarningKind as C3dKind;
use serde::{Deserialize, Serialize};

/// What a warning is about. Programs decide on this and never on the words.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
#[non_exhaustive]
pub enum WarningKind {
    /// The recording ends before the frames that it declares; those that it holds were read.
    Truncated {
        /// Frames in the file.
        held: usize,
        /// Frames declared.
        stated: usize,
    },
    /// The file of forces beside the markers ends before the rows that it declares.
    ForcesTruncated {
        /// Rows in the file.
        held: usize,
        /// Rows declared.
        stated: usize,
    },
    /// Statements of the source contradict each other; the words say which was taken.
    Contradiction,
    /// The source does not state something that a reader needs; the words say what was taken.
    Missing,
    /// Labels: repeated, cut, unlabelled, of several subjects, or read loosely.
    Labels,
    /// Parameter section of a C3D file: odd records that were skipped or repaired.
    Parameters,
    /// Events outside of the recording, or that could not be placed.
    Events,
    /// Force plates: left out, without a place, turned, or with doubtful units.
    Plates,
    /// Analog channels of a C3D file and their scaling.
    Analogs,
    /// Rows of a text file that are missing or break off.
    Rows,
    /// The vertical axis, or vectors that are not in laboratory axes.
    Axes,
    /// The unit of length is doubtful.
    Units,
    /// Read from a result that kept the words alone.
    Unspecified,
}

/// Something odd that did not stop the reading.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Warning {
    /// What it is about.
    pub kind: WarningKind,
    /// In words, with the place in the source and what was done about it.
    pub message: String,
}

impl Warning {
    /// A warning of a kind, in words.
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
