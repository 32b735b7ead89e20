//! What can keep a trial from being tracked, or a subject from being calibrated.

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
    /// A vector of the subject or of the options does not fit the model.
    #[error("`{subject}`: {what}: expected {expected}, found {found}")]
    Mismatch {
        /// Subject.
        subject: String,
        /// Which quantity.
        what: &'static str,
        /// What the model needs.
        expected: String,
        /// What is there.
        found: String,
    },
    /// An option has a value that cannot be used.
    #[error("option `{option}` is {found}; it must be {expected}")]
    Option {
        /// Name of the option.
        option: &'static str,
        /// Value found.
        found: f64,
        /// What would be accepted.
        expected: &'static str,
    },
    /// No frame of any trial can take part in a calibration.
    #[error("`{subject}`: none of {trials} trials has a solved frame to calibrate with")]
    NothingToCalibrate {
        /// Subject.
        subject: String,
        /// Trials looked at.
        trials: usize,
    },
    /// The calibration's equations have no unique solution.
    #[error("`{subject}`: calibration over {frames} frames failed: {problem}")]
    Calibration {
        /// Subject.
        subject: String,
        /// Frames used.
        frames: usize,
        /// What went wrong.
        problem: &'static str,
    },
}
