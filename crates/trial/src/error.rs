//! What can be wrong with a recording.

/// Errors of this crate; every variant names the trial.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum TrialError {
    /// The C3D file cannot be read.
    #[error("{trial}: {problem}")]
    Unreadable {
        #[doc(hidden)]
        trial: String,
        #[doc(hidden)]
        problem: String,
    },
}
