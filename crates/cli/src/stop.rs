//! Why a command stops early.

use aloft_workspace::error::PipelineError;

/// Reason why a command stopped.
#[derive(Debug)]
pub enum Stop {
    /// The reader of our output closed the pipe.
    PipeClosed,
    /// An error.
    Error(miette::Report),
}

impl From<PipelineError> for Stop {
    fn from(error: PipelineError) -> Self {
        Self::Error(miette::Report::new(error))
    }
}
