//! Errors, which abort reading or writing, and warnings, which are returned with the result.

use serde::{Deserialize, Serialize};

/// Reasons why bytes are not a C3D file or a structure cannot be written as one. Every variant
/// states the place.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum C3dError {
    /// The bytes are not C3D.
    #[error("not a C3D file: byte {offset} is {found:#04x}, expected {expected}")]
    NotC3d {
        /// Offset from the start of the file.
        offset: usize,
        /// Value found.
        found: u8,
        /// Value expected in a C3D file.
        expected: &'static str,
    },
    /// The file ends before its first parameter.
    #[error("not a C3D file: {length} bytes long, {what} would need {needed}")]
    TooShort {
        /// Length of the input, bytes.
        length: usize,
        /// Length required by this part, bytes.
        needed: usize,
        /// The missing part of the file.
        what: &'static str,
    },
    /// A record of the parameter section is malformed.
    #[error("byte {offset}, parameter {group}:{parameter}: {problem}")]
    Parameter {
        /// Offset of the record from the start of the file.
        offset: usize,
        /// Group name, or its number if the name is unknown.
        group: String,
        /// Parameter name; empty for a group record.
        parameter: String,
        /// Description of the problem.
        problem: String,
    },
    /// The position of the sample data is outside the file or inside the header.
    #[error("byte {offset}: sample data should start at byte {start}, but the file is {length} bytes long")]
    DataStart {
        /// Offset at which the file states the position.
        offset: usize,
        /// The stated position, bytes.
        start: usize,
        /// Length of the input, bytes.
        length: usize,
    },
    /// The requested plate does not exist.
    #[error("plate {index} asked for, the file describes {count}")]
    NoPlate {
        /// Requested index, zero-based.
        index: usize,
        /// Number of plates described.
        count: usize,
    },
    /// A plate's wrench cannot be computed.
    #[error("plate {}: {problem}", index + 1)]
    Plate {
        /// Zero-based index.
        index: usize,
        /// Missing or contradictory data.
        problem: String,
    },
    /// The structure does not fit into the format.
    #[error("cannot write {item}: {problem}")]
    Write {
        /// The point, channel, group or parameter concerned.
        item: String,
        /// Expected and found values.
        problem: String,
    },
}

/// Kind of a warning, by which programs can sort.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub enum WarningKind {
    /// Header and parameters contradict each other; the message states which was used.
    Contradiction,
    /// The file ends before the declared number of frames; the frames present were read.
    Truncated {
        /// Frames in the file.
        held: usize,
        /// Frames declared.
        stated: usize,
    },
    /// A required value is missing; the message states the value used instead.
    Missing,
    /// Labels: duplicates, truncated names, fewer labels than columns.
    Labels,
    /// Parameter section: malformed records that were skipped or repaired.
    Parameters,
    /// Events without a usable time.
    Events,
    /// Force plates: uncalibrated type, missing channels, doubtful units or sign.
    Plates,
    /// Analog scaling: unsigned offsets, scale factors of zero, lists shorter than the channels.
    Analogs,
}

/// An irregularity that did not prevent reading. Readers of other formats have kinds `K` of their
/// own.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Warning<K = WarningKind> {
    /// Kind, on which programs decide.
    pub kind: K,
    /// Message for people, with the place in the source (in C3D: group, parameter and byte offset
    /// if useful) and the action taken.
    pub message: String,
}

impl<K> Warning<K> {
    /// Creates a warning from a kind and a message.
    pub fn new(kind: K, message: impl Into<String>) -> Self {
        Self { kind, message: message.into() }
    }

    /// The same message with the kind of another reader.
    pub fn with_kind<L: From<K>>(self) -> Warning<L> {
        Warning { kind: self.kind.into(), message: self.message }
    }
}

impl<K> std::fmt::Display for Warning<K> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(&self.message)
    }
}
