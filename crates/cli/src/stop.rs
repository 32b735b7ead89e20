//! Why a command stops early.

use aloft_workspace::error::PipelineError;

/// Why a command stopped.
#[derive(Debug)]
pub enum Stop {
    /// The reader of our output went away.
    PipeClosed,
    /// Something is wrong.
    Error(miette::Report),
}

impl From<PipelineError> for Stop {
    fn from(error: PipelineError) -> Self {
        Self::Error(miette::Report::new(error))
    }
}
