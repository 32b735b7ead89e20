//! Butterworth low-pass filters, run forward and backward.
//!
//! First step after inverse kinematics and before every comparison with plates: the same
//! [`LowPass`] filters joint coordinates and measured forces. A filter is a cascade of second-order
//! sections, which stays accurate at orders and cut-offs for which a single polynomial fraction
//! does not; the result is the same function of the signal as
//! `scipy.signal.filtfilt(*butter(order, cutoff, fs=rate), signal)`.
//!
//! The meaning of "order" and "cut-off" differs between programs, so a [`LowPass`] defines both:
//! the order is that of one pass (two passes double it), and [`LowPass::describe`] gives the
//! frequency at which the two passes together have −3 dB.

use crate::runs::finite_runs;
use serde::{Deserialize, Serialize};
use std::f64::consts::PI;

/// Highest order that [`Butterworth::design`] accepts.
pub const MAX_ORDER: usize = 12;
/// Maximum number of sections.
const MAX_SECTIONS: usize = MAX_ORDER.div_ceil(2);

/// Whether the cut-off is moved so that the two passes together are −3 dB at the stated frequency.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum CutoffCorrection {
    /// Design each pass at the stated cut-off (as scipy's `filtfilt`).
    #[default]
    None,
    /// Winter's correction.
    Winter,
}

/// A zero-phase low-pass as specified by the user.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct LowPass {
    /// Order of one pass (two passes double the effective order).
    pub order: usize,
    /// Stated cut-off, Hz.
    pub cutoff_hz: f64,
    /// Correction of the cut-off.
    #[serde(default)]
    pub correction: CutoffCorrection,
}

/// Actual properties of a [`LowPass`] at one sampling rate.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct FilterFacts {
    /// Order of both passes together.
    pub effective_order: usize,
    /// Frequency at which each single pass is designed to be −3 dB, Hz.
    pub design_cutoff_hz: f64,
    /// Frequency at which both passes together are −3 dB, Hz.
    pub true_minus3db_hz: f64,
}

impl LowPass {
    /// Checks the specification at one sampling rate and states effective order, design cut-off and
    /// true −3 dB frequency.
    ///
    /// One pass of order n has the gain `(1 + (W/Wc)^{2n})^{-1/2}` at `W = tan(π f / rate)`
    /// (bilinear, pre-warped), so both passes together fall to −3 dB at `W = C Wc` with `C = (√2 −
    /// 1)^{1/(2n)}`. Winter's correction designs at `Wc / C` instead.
    pub fn describe(&self, rate_hz: f64) -> Result<FilterFacts, DesignError> {
        let w_design = self.design_tangent(rate_hz)?;
        let frequency = |w: f64| rate_hz / PI * w.atan();
        Ok(FilterFacts {
            effective_order: 2 * self.order,
            design_cutoff_hz: frequency(w_design),
            true_minus3db_hz: frequency(w_design * self.two_pass_ratio()),
        })
    }

    /// Gain of both passes together at a frequency, between 0 and 1.
    pub fn gain(&self, frequency_hz: f64, rate_hz: f64) -> Result<f64, DesignError> {
        let w_design = self.design_tangent(rate_hz)?;
        let w = (PI * frequency_hz / rate_hz).tan();
        Ok(1.0 / (1.0 + (w / w_design).powi(2 * self.order as i32)))
    }

    /// `C = (√2 − 1)^{1/(2n)}`: where two passes are −3 dB, as a fraction of the single pass's
    /// pre-warped cut-off.
    fn two_pass_ratio(&self) -> f64 {
        (std::f64::consts::SQRT_2 - 1.0).powf(0.5 / self.order as f64)
    }

    /// Pre-warped cut-off `tan(π f/rate)` of the single pass, corrected if requested.
    fn design_tangent(&self, rate_hz: f64) -> Result<f64, DesignError> {
        if self.order == 0 || self.order > MAX_ORDER {
            return Err(DesignError::Order { order: self.order });
        }
        let nyquist_hz = 0.5 * rate_hz;
        if !(self.cutoff_hz > 0.0 && self.cutoff_hz < nyquist_hz && nyquist_hz.is_finite()) {
            return Err(DesignError::Cutoff { cutoff_hz: self.cutoff_hz, nyquist_hz });
        }
        let stated = (PI * self.cutoff_hz / rate_hz).tan();
        Ok(match self.correction {
            CutoffCorrection::None => stated,
            CutoffCorrection::Winter => stated / self.two_pass_ratio(),
        })
    }
}

/// One section of the cascade in transposed direct form II, gain 1 at zero frequency: `y = b0 x +
/// z0; z0 ← b1 x − a1 y + z1; z1 ← b2 x − a2 y`. A first-order section has `b2 = a2 = 0`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Section {
    /// Numerator b0, b1, b2.
    pub b: [f64; 3],
    /// Denominator a1, a2 (a0 is 1).
    pub a: [f64; 2],
}

impl Section {
    /// State for which a constant input of 1 gives a constant output of 1 (the result of
    /// `lfilter_zi`).
    pub(crate) fn steady_state(&self) -> [f64; 2] {
        let z1 = self.b[2] - self.a[1];
        [self.b[1] - self.a[0] + z1, z1]
    }

    #[inline(always)]
    fn step(&self, x: f64, z: &mut [f64; 2]) -> f64 {
        let y = self.b[0] * x + z[0];
        // Compute the sum first, so that only the product with y depends on y.
        z[0] = (self.b[1] * x + z[1]) - self.a[0] * y;
        z[1] = self.b[2] * x - self.a[1] * y;
        y
    }
}

/// A designed filter: second-order sections at one sampling rate.
#[derive(Debug, Clone, PartialEq)]
pub struct Butterworth {
    order: usize,
    sections: Vec<Section>,
}

impl Butterworth {
    /// Designs the filter. Errors: order outside 1 to 12, cut-off not below half the rate.
    pub fn design(spec: LowPass, rate_hz: f64) -> Result<Self, DesignError> {
        let k = spec.design_tangent(rate_hz)?;
        let n = spec.order;
        let mut sections = Vec::with_capacity(n.div_ceil(2));
        if n % 2 == 1 {
            let b = k / (1.0 + k);
            sections.push(Section { b: [b, b, 0.0], a: [(k - 1.0) / (k + 1.0), 0.0] });
        }
        // Pole pairs of the analogue prototype, s² + 2 sin((2i+1)π/2n) s + 1, by the bilinear
        // transform. The best damped pair comes first, so that no section rings more than the
        // whole.
        for pair in (0..n / 2).rev() {
            let damping = 2.0 * (PI * (2 * pair + 1) as f64 / (2 * n) as f64).sin();
            let norm = 1.0 / (1.0 + damping * k + k * k);
            let b = k * k * norm;
            sections.push(Section {
                b: [b, 2.0 * b, b],
                a: [2.0 * (k * k - 1.0) * norm, (1.0 - damping * k + k * k) * norm],
            });
        }
        Ok(Self { order: n, sections })
    }

    /// Order of one pass.
    pub fn order(&self) -> usize {
        self.order
    }

    /// The cascade, in the order of execution.
    pub fn sections(&self) -> &[Section] {
        &self.sections
    }

    /// Samples of odd reflection on each side, 3·(order + 1); a run must be longer than this.
    pub(crate) fn padding(&self) -> usize {
        3 * (self.order + 1)
    }

    /// Filters forward and backward in place with scipy's `filtfilt` default padding (odd, of
    /// 3·(order + 1) samples); runs without NaN are filtered separately; runs not longer than the
    /// padding become NaN.
    ///
    /// Returns the number of samples lost in this way. This is the scalar version;
    /// [`Butterworth::filtfilt_interleaved`] and [`Butterworth::filtfilt_channels`] give the same
    /// numbers for many channels at once.
    pub fn filtfilt(&self, signal: &mut [f64]) -> usize {
        let mut lost = 0;
        let mut scratch = Vec::new();
        for run in finite_runs(signal) {
            let run = &mut signal[run];
            if run.len() <= self.padding() {
                run.fill(f64::NAN);
                lost += run.len();
            } else {
                self.filtfilt_run(run, &mut scratch);
            }
        }
        lost
    }

    /// One run without NaN that is longer than the padding.
    fn filtfilt_run(&self, run: &mut [f64], extended: &mut Vec<f64>) {
        let (n, pad) = (run.len(), self.padding());
        let (first, last) = (run[0], run[n - 1]);
        extended.clear();
        extended.reserve(n + 2 * pad);
        extended.extend((1..=pad).rev().map(|i| 2.0 * first - run[i]));
        extended.extend_from_slice(run);
        extended.extend((1..=pad).map(|i| 2.0 * last - run[n - 1 - i]));
        self.pass(extended.iter_mut());
        self.pass(extended.iter_mut().rev());
        run.copy_from_slice(&extended[pad..pad + n]);
    }

    /// One pass, started in the steady state for the first sample.
    fn pass<'a>(&self, samples: impl Iterator<Item = &'a mut f64>) {
        let mut z = [[0.0; 2]; MAX_SECTIONS];
        let mut started = false;
        for sample in samples {
            let mut x = *sample;
            if !started {
                started = true;
                for (s, z) in self.sections.iter().zip(&mut z) {
                    *z = s.steady_state().map(|unit| unit * x);
                }
            }
            for (s, z) in self.sections.iter().zip(&mut z) {
                x = s.step(x, z);
            }
            *sample = x;
        }
    }
}

/// Reasons why a filter cannot be designed.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
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
    /// The order is zero or too high.
    #[error("filter order {order}: expected 1 to 12")]
    Order {
        #[doc(hidden)]
        order: usize,
    },
}
