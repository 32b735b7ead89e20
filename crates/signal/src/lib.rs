//! Zero-phase filters, derivatives and spectra of sampled signals.
//!
//! Signals are plain slices of `f64` at a fixed rate; NaN is missing, and no operation reaches across it. Nothing here knows of bodies.

pub mod butterworth;
pub mod derivative;
mod multichannel;
pub mod runs;

pub use butterworth::{Butterworth, CutoffCorrection, DesignError, FilterFacts, LowPass, Section};
pub use derivative::derivatives;
pub use runs::{finite_runs, runs_where};
