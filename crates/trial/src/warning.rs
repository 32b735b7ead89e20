//! Kinds of import warnings, for every format of recordings.

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
    /// The recording holds markers of several people; the message names the one who is used.
    People,
    /// Markers that are held at one position while others move.
    HeldMarkers,
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
    /// Times that do not fit a stated rate, are in another unit, or differ between the files of a
    /// recording; the message gives the numbers and what is used.
    Clock,
    /// The vertical axis, or vectors that are not in laboratory axes.
    Axes,
    /// The unit of length is doubtful.
    Units,
    /// Read from a stored result that kept only the message.
    Unspecified,
}

/// An irregularity that did not prevent reading.
pub type Warning = aloft_c3d::Warning<WarningKind>;

impl From<C3dKind> for WarningKind {
    fn from(kind: C3dKind) -> Self {
        match kind {
            C3dKind::Truncated { held, stated } => Self::Truncated { held, stated },
            C3dKind::Contradiction => Self::Contradiction,
            C3dKind::Missing => Self::Missing,
            C3dKind::Labels => Self::Labels,
            C3dKind::Parameters => Self::Parameters,
            C3dKind::Events => Self::Events,
            C3dKind::Plates => Self::Plates,
            C3dKind::Analogs => Self::Analogs,
            _ => Self::Unspecified,
        }
    }
}
