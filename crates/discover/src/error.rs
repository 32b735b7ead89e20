//! Errors of this crate.

use aloft_effects::EffectsError;
use aloft_regressor::RegressorError;

/// Errors of a discovery.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum DiscoverError {
    /// Rows that cannot be formed or merged.
    #[error(transparent)]
    Regressor(#[from] RegressorError),
    /// Columns that cannot be formed.
    #[error(transparent)]
    Effects(#[from] EffectsError),
    /// Too few flights, trials or rows.
    #[error("{what}: {found} found, at least {needed} are needed")]
    TooFew {
        #[doc(hidden)]
        what: &'static str,
        #[doc(hidden)]
        needed: usize,
        #[doc(hidden)]
        found: usize,
    },
    /// Sizes that do not fit.
    #[error("{what}: expected {expected}, found {found}")]
    Length {
        #[doc(hidden)]
        what: &'static str,
        #[doc(hidden)]
        expected: usize,
        #[doc(hidden)]
        found: usize,
    },
    /// A decomposition failed or a number is not finite.
    #[error("{0}")]
    Numeric(String),
}
