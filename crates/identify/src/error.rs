//! Errors of this crate.

use aloft_regressor::RegressorError;

/// Errors of this crate.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum IdentifyError {
    /// Factors that cannot be merged, or none.
    #[error(transparent)]
    Regressor(#[from] RegressorError),
    /// A vector or matrix has another size than the model needs.
    #[error("{what}: expected {expected}, found {found}")]
    Length {
        #[doc(hidden)]
        what: &'static str,
        #[doc(hidden)]
        expected: usize,
        #[doc(hidden)]
        found: usize,
    },
    /// An estimator needs more flights, trials or rows than there are.
    #[error("{what}: {found} found, at least {needed} are needed")]
    TooFew {
        #[doc(hidden)]
        what: &'static str,
        #[doc(hidden)]
        needed: usize,
        #[doc(hidden)]
        found: usize,
    },
    /// An option that cannot be.
    #[error("option `{option}`: {problem}")]
    Option {
        #[doc(hidden)]
        option: &'static str,
        #[doc(hidden)]
        problem: String,
    },
    /// A decomposition failed or a number is not finite.
    #[error("{0}")]
    Numeric(String),
}
