//! Errors that stop scaling. Everything less severe is a [`crate::ScaleWarning`] in the report.

use aloft_body::BodyError;

/// Span of the middle half of the markers of a person, or of their legs, m: 0.3 to 1.2 m for
/// children and adults, so that a unit that is wrong by a factor of ten or more is outside.
pub(crate) const SPAN_M: [f64; 2] = [0.15, 2.5];

/// What was taken for what if a person's markers span this much.
fn misread(span_m: f64) -> &'static str {
    /// Middle of the span of children and adults, m.
    const USUAL_M: f64 = 0.6;
    match (span_m / USUAL_M).log10().round() as i64 {
        ..=-3 => "metres read as millimetres",
        -2 => "metres read as centimetres",
        -1 => "centimetres read as millimetres",
        1 => "millimetres read as centimetres",
        2 => "centimetres read as metres",
        3.. => "millimetres read as metres",
        0 => "another unit than the stated one",
    }
}

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
        "{trial}: the middle half of the markers spans {span_m:.2} m, expected {} to {} m for a person: probably {}. `import: {{point_unit: …}}` states the \
         unit in place of the file; other points among the markers can be the reason, too",
        SPAN_M[0],
        SPAN_M[1],
        misread(*span_m)
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
