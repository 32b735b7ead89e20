//! Butterworth low-pass filters, run forward and backward.

use serde::{Deserialize, Serialize};

/// Whether the cut-off is moved so that the two passes together are −3 dB at the stated frequency.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum CutoffCorrection {
    /// Design each pass at the stated cut-off (scipy's `filtfilt` habit).
    #[default]
    None,
    /// Winter's correction.
    Winter,
}

/// A zero-phase low-pass as a user states it.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct LowPass {
    /// Order of one pass (two passes double the effective order).
    pub order: usize,
    /// Stated cut-off, Hz.
    pub cutoff_hz: f64,
    /// Correction.
    #[serde(default)]
    pub correction: CutoffCorrection,
}

/// A designed filter: second-order sections at one sampling rate.
#[derive(Debug, Clone)]
pub struct Butterworth {}

impl Butterworth {
    /// Designs the filter. `Err` text says what is wrong (order 0, cut-off not below half the rate).
    pub fn design(_spec: LowPass, _rate_hz: f64) -> Result<Self, crate::butterworth::DesignError> {
        todo!()
    }
    /// Filters forward and backward in place with scipy's `filtfilt` default padding (odd, 3·(order+1) samples); runs without NaN are
    /// filtered separately; runs shorter than the padding become NaN.
    pub fn filtfilt(&self, _signal: &mut [f64]) {
        todo!()
    }
}

/// A filter that cannot be.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum DesignError {
    /// The cut-off is not between zero and half the sampling rate.
    #[error("cut-off {cutoff_hz} Hz: expected a value above 0 and below {nyquist_hz} Hz, half the sampling rate")]
    Cutoff {
        #[doc(hidden)]
        cutoff_hz: f64,
        #[doc(hidden)]
        nyquist_hz: f64,
    },
    /// Order zero or absurdly high.
    #[error("filter order {order}: expected 1 to 12")]
    Order {
        #[doc(hidden)]
        order: usize,
    },
}
