//! Zero-phase filters, derivatives and spectra of sampled signals.
//!
//! Signals are plain slices of `f64` at a fixed rate; NaN means missing, and no operation crosses
//! it. This crate is independent of body models.
//!
//! | module | what it gives |
//! |---|---|
//! | [`butterworth`] | [`LowPass`] as a user states it, [`Butterworth::filtfilt`] forward and backward, on one channel or many |
//! | [`derivative`] | first and second derivative by fourth-order differences |
//! | [`order`] | medians and quantiles |
//! | [`parabola`] | the least-squares parabola of a short run |
//! | [`runs`] | stretches of indices for which a condition holds |
//! | [`residual_analysis`](mod@residual_analysis) | cut-off against residual, and a suggested cut-off |
//! | [`resample`](mod@resample) | values at other times, plates to camera frames |
//! | [`spectrum`] | power spectral density |
//! | [`t975`], [`t9995`] | points of Student's t |
//! | [`ln_gamma_lower`] | incomplete gamma function |
//!
//! ```
//! use aloft_signal::{Butterworth, CutoffCorrection, LowPass, derivatives};
//!
//! let spec = LowPass { order: 3, cutoff_hz: 10.0, correction: CutoffCorrection::None };
//! println!("{:?}", spec.describe(200.0)?); // effective order 6, −3 dB at 8.6 Hz
//! let mut angle_rad: Vec<f64> = (0..400).map(|i| (0.01 * i as f64).sin()).collect();
//! let lost = Butterworth::design(spec, 200.0)?.filtfilt(&mut angle_rad);
//! assert_eq!(lost, 0);
//! let (_rate, _acceleration) = derivatives(&angle_rad, 200.0);
//! # Ok::<(), aloft_signal::DesignError>(())
//! ```

pub mod butterworth;
pub mod derivative;
mod multichannel;
pub mod order;
pub mod parabola;
pub mod resample;
pub mod residual_analysis;
pub mod runs;
pub mod spectrum;
mod student;

pub use butterworth::{Butterworth, CutoffCorrection, DesignError, FilterFacts, LowPass, Section};
pub use derivative::derivatives;
pub use order::{mean_and_deviation, median, median_and_deviation, one_more, quantile_of_sorted, upper_median};
pub use parabola::{SHORT_RUN_S, parabola_of};
pub use resample::{Interpolation, filter_and_resample, resample};
pub use residual_analysis::{ResidualAnalysis, residual_analysis};
pub use runs::{finite_runs, runs_where};
pub use spectrum::{Spectrum, welch};
pub use student::{ln_gamma_lower, t975, t9995};
