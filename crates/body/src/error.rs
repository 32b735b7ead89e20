//! What can be wrong with a model, a subject or a motion.

/// Errors of this crate.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum BodyError {
    /// A link names a parent that does not stand before it.
    #[error("model `{model}`: link `{link}` has the parent `{parent}`, which does not stand before it")]
    UnknownParent {
        #[doc(hidden)]
        model: String,
        #[doc(hidden)]
        link: String,
        #[doc(hidden)]
        parent: String,
    },
    /// A name of a link that the model does not have.
    #[error("model `{model}` has no link `{link}`; it has {known}")]
    UnknownLink {
        #[doc(hidden)]
        model: String,
        #[doc(hidden)]
        link: String,
        #[doc(hidden)]
        known: String,
    },
    /// A vector has another length than the model needs.
    #[error("{what}: expected {expected} values, found {found}")]
    Length {
        #[doc(hidden)]
        what: &'static str,
        #[doc(hidden)]
        expected: usize,
        #[doc(hidden)]
        found: usize,
    },
    /// Anything else that a specification says and that cannot be.
    #[error("model `{model}`: {problem}")]
    Spec {
        #[doc(hidden)]
        model: String,
        #[doc(hidden)]
        problem: String,
    },
}
