//! Errors that stop scaling. Everything less severe is a [`crate::ScaleWarning`] in the report.

use aloft_body::BodyError;

/// Span of the middle half of the markers of a person, or of their legs, m: 0.3 to 1.2 m for
/// children and adults, so that a wrong unit is far outside.
pub(crate) const SPAN_M: [f64; 2] = [0.05, 5.0];

/// Errors of this crate.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ScaleError {
    /// The trial contains no usable frame.
    #[error("{trial}: no usable static frames: {problem}")]
    NoFrames {
        #[doc(hidden)]
        trial: String,
        #[doc(hidden)]
        problem: String,
    },
    /// The markers span what no body spans: the unit of the file is wrong.
    #[error(
        "{trial}: the middle half of the markers spans {span_m:.2e} m, expected {} to {} m for a person: the unit of the file is not what it states, or other \
         points lie among the markers (`import: {{point_unit: m}}` overrides the unit)",
        SPAN_M[0],
        SPAN_M[1]
    )]
    Span {
        #[doc(hidden)]
        trial: String,
        #[doc(hidden)]
        span_m: f64,
    },
    /// Required landmarks of the skeleton are missing.
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
    /// Landmarks lie on one line or one point, so that no frame can be defined from them.
    #[error("{trial}: {what} is degenerate: {problem}")]
    Degenerate {
        #[doc(hidden)]
        trial: String,
        #[doc(hidden)]
        what: String,
        #[doc(hidden)]
        problem: String,
    },
    /// The marker set and the model do not match.
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
    /// A link that person scaling does not support, or a joint kind that it cannot place.
    #[error("model `{model}`, link `{link}`: {problem}")]
    Model {
        #[doc(hidden)]
        model: String,
        #[doc(hidden)]
        link: String,
        #[doc(hidden)]
        problem: String,
    },
    /// An impossible fact about the person or object.
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
