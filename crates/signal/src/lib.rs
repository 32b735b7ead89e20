//! Zero-phase filters, derivatives and spectra of sampled signals.
//!
//! Signals are plain slices of `f64` at a fixed rate. Nothing here knows of bodies.

pub mod butterworth;
pub mod derivative;

pub use butterworth::{Butterworth, CutoffCorrection, LowPass};
