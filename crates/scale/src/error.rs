//! What can stop scaling. Anything less than a stop is a [`crate::ScaleWarning`] in the report.

use aloft_body::BodyError;

/// Errors of this crate.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ScaleError {
    /// The trial holds no frame that can be used.
    #[error("{trial}: no usable static frames: {problem}")]
    NoFrames {
        #[doc(hidden)]
        trial: String,
        #[doc(hidden)]
        problem: String,
    },
    /// Landmarks without which no skeleton can stand.
    #[error("{trial}: {what} needs {need}; found {found}")]
    MissingLandmarks {
        #[doc(hidden)]
        trial: String,
        #[doc(hidden)]
        what: String,
        #[doc(hidden)]
        need: String,
        #[doc(hidden)]
        found: String,
    },
    /// Landmarks that lie on one line or one point, so that no frame can be built from them.
    #[error("{trial}: {what} is degenerate: {problem}")]
    Degenerate {
        #[doc(hidden)]
        trial: String,
        #[doc(hidden)]
        what: String,
        #[doc(hidden)]
        problem: String,
    },
    /// The marker set and the model do not fit each other.
    #[error("marker set `{marker_set}`: marker `{marker}` sits on `{link}`, which model `{model}` does not have")]
    MarkerLink {
        #[doc(hidden)]
        marker_set: String,
        #[doc(hidden)]
        marker: String,
        #[doc(hidden)]
        link: String,
        #[doc(hidden)]
        model: String,
    },
    /// A link that the person's scaling does not know, or a joint kind that it cannot place.
    #[error("model `{model}`, link `{link}`: {problem}")]
    Model {
        #[doc(hidden)]
        model: String,
        #[doc(hidden)]
        link: String,
        #[doc(hidden)]
        problem: String,
    },
    /// A fact about the person or object that cannot be.
    #[error("`{subject}`: {problem}")]
    Facts {
        #[doc(hidden)]
        subject: String,
        #[doc(hidden)]
        problem: String,
    },
    /// An anthropometric table that cannot be used.
    #[error("anthropometry `{table}`: {problem}")]
    Table {
        #[doc(hidden)]
        table: String,
        #[doc(hidden)]
        problem: String,
    },
    /// An object specification that contradicts itself or the recordings.
    #[error("object `{object}`, link `{link}`: {problem}")]
    Object {
        #[doc(hidden)]
        object: String,
        #[doc(hidden)]
        link: String,
        #[doc(hidden)]
        problem: String,
    },
    /// A functional calibration without enough motion or frames.
    #[error("functional calibration: {problem}")]
    Functional {
        #[doc(hidden)]
        problem: String,
    },
    /// The model itself.
    #[error(transparent)]
    Body(#[from] BodyError),
}
