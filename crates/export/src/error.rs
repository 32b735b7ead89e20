//! Errors of this crate.

/// Errors of this crate.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ExportError {
    /// A format that does not exist.
    #[error("there is no format `{found}`; the formats are {known}")]
    UnknownFormat {
        #[doc(hidden)]
        found: String,
        #[doc(hidden)]
        known: String,
    },
    /// Parts of an export contradict each other.
    #[error("{what}: expected {expected}, found {found}")]
    Mismatch {
        #[doc(hidden)]
        what: String,
        #[doc(hidden)]
        expected: String,
        #[doc(hidden)]
        found: String,
    },
    /// A link that a format cannot hold.
    #[error("link `{link}` cannot be written as {format}: {problem}")]
    Link {
        #[doc(hidden)]
        link: String,
        #[doc(hidden)]
        format: &'static str,
        #[doc(hidden)]
        problem: String,
    },
    /// A recording that cannot be read again or written.
    #[error("{trial}: {problem}")]
    Recording {
        #[doc(hidden)]
        trial: String,
        #[doc(hidden)]
        problem: String,
    },
    /// A table that polars refused.
    #[error("{path}: {problem}")]
    Table {
        #[doc(hidden)]
        path: String,
        #[doc(hidden)]
        problem: String,
    },
}
