//! Errors of this crate.

/// What went wrong with a model, a log or a base recording; every variant names the file.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum RobotError {
    /// The model file cannot be used.
    #[error("{file}{}: {problem}", line.map_or(String::new(), |l| format!(", line {l}")))]
    Model {
        /// File.
        file: String,
        /// Line, counted from 1, where known.
        line: Option<u32>,
        /// What is wrong, with what was expected.
        problem: String,
    },
    /// A table cannot be read.
    #[error("{file}{}: {problem}", line.map_or(String::new(), |l| format!(", line {l}")))]
    Table {
        /// File.
        file: String,
        /// Line, counted from 1, where known.
        line: Option<u64>,
        /// What is wrong, with what was expected.
        problem: String,
    },
    /// The log has no column for a joint of the model.
    #[error("{file}: {problem}")]
    MissingJoint {
        /// File.
        file: String,
        /// The joint, and the columns that come near.
        problem: String,
        /// What to do.
        hint: String,
    },
    /// The contents of a log or base recording contradict each other or the model.
    #[error("{file}: {problem}")]
    Log {
        /// File.
        file: String,
        /// What is wrong, with the evidence.
        problem: String,
        /// What to do.
        hint: String,
    },
}

impl RobotError {
    /// What to do about it, if that is known.
    pub fn hint(&self) -> Option<&str> {
        match self {
            Self::Log { hint, .. } | Self::MissingJoint { hint, .. } => Some(hint),
            _ => None,
        }
    }

    pub(crate) fn log(file: &str, problem: impl Into<String>, hint: impl Into<String>) -> Self {
        Self::Log { file: file.to_owned(), problem: problem.into(), hint: hint.into() }
    }

    pub(crate) fn model(file: &str, problem: impl Into<String>) -> Self {
        Self::Model { file: file.to_owned(), line: None, problem: problem.into() }
    }
}
