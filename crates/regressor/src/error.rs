//! Errors of this crate.

/// Errors of this crate.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum RegressorError {
    /// The stretch leaves no usable frames.
    #[error("{trial}, stretch {stretch}: {frames} usable frames, at least {needed} are needed")]
    TooShort {
        #[doc(hidden)]
        trial: String,
        #[doc(hidden)]
        stretch: usize,
        #[doc(hidden)]
        frames: usize,
        #[doc(hidden)]
        needed: usize,
    },
    /// The stretch ends after the motion does.
    #[error("{trial}, stretch {stretch}: frames {first} to {end} asked for, the motion has {n_frames}")]
    OutOfRange {
        #[doc(hidden)]
        trial: String,
        #[doc(hidden)]
        stretch: usize,
        #[doc(hidden)]
        first: usize,
        #[doc(hidden)]
        end: usize,
        #[doc(hidden)]
        n_frames: usize,
    },
    /// Velocities or accelerations are needed and the motion has none.
    #[error("{trial}: the motion has no {missing}; filter it first")]
    NotFiltered {
        #[doc(hidden)]
        trial: String,
        #[doc(hidden)]
        missing: &'static str,
    },
    /// A contact stretch without a measured wrench.
    #[error("{trial}, stretch {stretch}: a contact stretch needs the wrench that the plates measured")]
    NoWrench {
        #[doc(hidden)]
        trial: String,
        #[doc(hidden)]
        stretch: usize,
    },
    /// A series has another length than the motion or the model needs.
    #[error("{trial}: {what}: expected {expected} values, found {found}")]
    Length {
        #[doc(hidden)]
        trial: String,
        #[doc(hidden)]
        what: &'static str,
        #[doc(hidden)]
        expected: usize,
        #[doc(hidden)]
        found: usize,
    },
    /// Factors with other columns cannot be merged.
    #[error("{trial}, stretch {stretch}: columns are {found}, expected {expected}")]
    Columns {
        #[doc(hidden)]
        trial: String,
        #[doc(hidden)]
        stretch: usize,
        #[doc(hidden)]
        expected: String,
        #[doc(hidden)]
        found: String,
    },
    /// Nothing to merge.
    #[error("no factors to merge")]
    Empty,
    /// An option that cannot be.
    #[error("option `{option}`: {problem}")]
    Option {
        #[doc(hidden)]
        option: &'static str,
        #[doc(hidden)]
        problem: String,
    },
    /// Numbers that should be finite are not, or a covariance is not positive definite.
    #[error("{trial}, stretch {stretch}: {problem}")]
    Numeric {
        #[doc(hidden)]
        trial: String,
        #[doc(hidden)]
        stretch: usize,
        #[doc(hidden)]
        problem: String,
    },
}
