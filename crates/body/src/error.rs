//! Errors of models, subjects and motions.

/// Errors of this crate.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum BodyError {
    /// The parent of a link is not listed before it.
    #[error("model `{model}`: link `{link}` has the parent `{parent}`, which does not stand before it")]
    UnknownParent {
        #[doc(hidden)]
        model: String,
        #[doc(hidden)]
        link: String,
        #[doc(hidden)]
        parent: String,
    },
    /// The model has no link of this name.
    #[error("model `{model}` has no link `{link}`; it has {known}")]
    UnknownLink {
        #[doc(hidden)]
        model: String,
        #[doc(hidden)]
        link: String,
        #[doc(hidden)]
        known: String,
    },
    /// A vector has the wrong length for the model.
    #[error("{what}: expected {expected} values, found {found}")]
    Length {
        #[doc(hidden)]
        what: &'static str,
        #[doc(hidden)]
        expected: usize,
        #[doc(hidden)]
        found: usize,
    },
    /// Any other invalid statement of a specification.
    #[error("model `{model}`: {problem}")]
    Spec {
        #[doc(hidden)]
        model: String,
        #[doc(hidden)]
        problem: String,
    },
}
