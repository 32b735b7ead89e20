//! Errors of the search for flights.

/// Errors of this crate; every variant names the trial.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum FlightError {
    /// A filter is not valid at this sampling rate.
    #[error("{trial}: {what}: {problem}")]
    Filter {
        #[doc(hidden)]
        trial: String,
        #[doc(hidden)]
        what: &'static str,
        #[doc(hidden)]
        problem: String,
    },
    /// Model, inertias and motion do not match.
    #[error(
        "{trial}: motion has {found} coordinates a frame and {found_phi} inertias, expected {expected} and {expected_phi} of model `{model}`"
    )]
    Mismatch {
        #[doc(hidden)]
        trial: String,
        #[doc(hidden)]
        model: String,
        #[doc(hidden)]
        found: usize,
        #[doc(hidden)]
        found_phi: usize,
        #[doc(hidden)]
        expected: usize,
        #[doc(hidden)]
        expected_phi: usize,
    },
    /// The trial has neither plates nor motion for the requested method.
    #[error("{trial}: flights by `{method}` need {missing}, which this trial does not have")]
    Missing {
        #[doc(hidden)]
        trial: String,
        #[doc(hidden)]
        method: &'static str,
        #[doc(hidden)]
        missing: &'static str,
    },
}
