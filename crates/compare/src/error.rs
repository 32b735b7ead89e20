//! Errors of this crate.

/// Errors in the input of a comparison.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum CompareError {
    /// There is nothing to compare.
    #[error("nothing to compare: no model was given")]
    NoModel,
    /// Something has another length than the model or the motion needs.
    #[error("{of}: {what}: expected {expected}, found {found}")]
    Length {
        #[doc(hidden)]
        of: String,
        #[doc(hidden)]
        what: &'static str,
        #[doc(hidden)]
        expected: usize,
        #[doc(hidden)]
        found: usize,
    },
    /// The motion carries no derivatives.
    #[error("{trial}: the motion has no {missing}: filter it first")]
    NotFiltered {
        #[doc(hidden)]
        trial: String,
        #[doc(hidden)]
        missing: &'static str,
    },
    /// A plate cannot be filtered like the motion.
    #[error("{trial}, plate {plate}: {source}")]
    Plate {
        #[doc(hidden)]
        trial: String,
        #[doc(hidden)]
        plate: String,
        #[doc(hidden)]
        source: aloft_signal::DesignError,
    },
    /// A motion with drawn errors, or their plates, cannot be filtered.
    #[error("{trial}: its noise floor cannot be computed: {problem}")]
    Smooth {
        #[doc(hidden)]
        trial: String,
        #[doc(hidden)]
        problem: String,
    },
    /// Weak rows cannot be formed.
    #[error(transparent)]
    Rows(#[from] aloft_regressor::RegressorError),
}
