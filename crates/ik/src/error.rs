//! Errors that prevent tracking of a trial or calibration of a subject.

/// Errors of this crate.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum IkError {
    /// Trial and subject share fewer markers than a pose needs.
    #[error(
        "{trial}: {found} of its markers are markers of `{subject}`, at least {needed} are needed; the subject has {expected}"
    )]
    TooFewMarkers {
        /// Trial.
        trial: String,
        /// Subject.
        subject: String,
        /// Markers in common that have a positive weight.
        found: usize,
        /// Smallest usable number.
        needed: usize,
        /// Labels of the subject's markers, for the message.
        expected: String,
    },
    /// A vector of the subject or of the options does not match the model.
    #[error("`{subject}`: {what}: expected {expected}, found {found}")]
    Mismatch {
        /// Subject.
        subject: String,
        /// Which quantity.
        what: &'static str,
        /// Value required by the model.
        expected: String,
        /// Value found.
        found: String,
    },
    /// An option has an invalid value.
    #[error("option `{option}` is {found}; it must be {expected}")]
    Option {
        /// Name of the option.
        option: &'static str,
        /// Value found.
        found: f64,
        /// Accepted values.
        expected: &'static str,
    },
    /// No frame of any trial can be used for a calibration.
    #[error("`{subject}`: none of {trials} trials has a solved frame to calibrate with")]
    NothingToCalibrate {
        /// Subject.
        subject: String,
        /// Number of trials examined.
        trials: usize,
    },
    /// The calibration's equations have no unique solution.
    #[error("`{subject}`: calibration over {frames} frames failed: {problem}")]
    Calibration {
        /// Subject.
        subject: String,
        /// Frames used.
        frames: usize,
        /// Description of the problem.
        problem: &'static str,
    },
}
