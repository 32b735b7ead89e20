//! Errors, which stop the reading or the writing, and warnings, which are data beside the result.

/// Why bytes are not a C3D file, or a structure cannot become one. Every variant says where.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum C3dError {
    /// Not C3D at all.
    #[error("not a C3D file: byte {offset} is {found:#04x}, expected {expected}")]
    NotC3d {
        /// Where, from the start of the file.
        offset: usize,
        /// What is there.
        found: u8,
        /// What a C3D file has there.
        expected: &'static str,
    },
    /// The file ends before its first parameter.
    #[error("not a C3D file: {length} bytes long, {what} would need {needed}")]
    TooShort {
        /// Length of the input, bytes.
        length: usize,
        /// Length that the named part asks for, bytes.
        needed: usize,
        /// The part of the file that is missing.
        what: &'static str,
    },
    /// A record of the parameter section makes no sense.
    #[error("byte {offset}, parameter {group}:{parameter}: {problem}")]
    Parameter {
        /// Where the record starts, from the start of the file.
        offset: usize,
        /// Group name, or its number where the name is not known.
        group: String,
        /// Parameter name; empty for a group record.
        parameter: String,
        /// What is wrong.
        problem: String,
    },
    /// The place of the sample data is outside the file or inside the header.
    #[error("byte {offset}: sample data should start at byte {start}, but the file is {length} bytes long")]
    DataStart {
        /// Where the file states the place.
        offset: usize,
        /// The stated place, bytes.
        start: usize,
        /// Length of the input, bytes.
        length: usize,
    },
    /// There is no such plate.
    #[error("plate {index} asked for, the file describes {count}")]
    NoPlate {
        /// Zero-based index asked for.
        index: usize,
        /// Plates described.
        count: usize,
    },
    /// A plate's wrench cannot be computed.
    #[error("plate {}: {problem}", index + 1)]
    Plate {
        /// Zero-based index.
        index: usize,
        /// What is missing or contradictory.
        problem: String,
    },
    /// The structure does not fit into the format.
    #[error("cannot write {item}: {problem}")]
    Write {
        /// Point, channel, group or parameter at fault.
        item: String,
        /// Expected and found.
        problem: String,
    },
}

/// What a warning is about, for programs that sort them.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub enum WarningKind {
    /// Header and parameters contradict each other; the message says which was taken.
    Contradiction,
    /// The file ends before the frames that it declares; those that it holds were read.
    Truncated {
        /// Frames in the file.
        held: usize,
        /// Frames declared.
        stated: usize,
    },
    /// Something that a reader needs is missing; the message says what was taken instead.
    Missing,
    /// Labels: duplicates, cut names, fewer labels than columns.
    Labels,
    /// Parameter section: odd records that were skipped or repaired.
    Parameters,
    /// Events that could not be placed.
    Events,
    /// Force plates: type not calibrated, channels missing, units or sign doubtful.
    Plates,
    /// Analog scaling: unsigned offsets, factors of zero, lists shorter than the channels.
    Analogs,
}

/// Something odd that did not stop the reading.
#[derive(Debug, Clone, PartialEq)]
pub struct Warning {
    /// What it is about.
    pub kind: WarningKind,
    /// In words, naming group, parameter and byte offset where that helps.
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
