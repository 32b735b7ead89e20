//! Model against measurement: residuals by trial, phase, axis, segment.
//!
//! Last of the science: takes identified parameters and held-out trials, and says how far the predicted wrench is from the measured
//! one. The wrench is the one on the root, in root axes about the root origin; the error is *predicted − measured*. In contact the
//! plates measure, filtered with the filter of the motion; in flight nothing acts, and what is predicted there is the error.
//!
//! Three figures stand beside each other, because each alone misleads:
//! single frames (what inverse dynamics would show, limited by the noise of second derivatives), weak windows (the model's own error),
//! and the noise floor (what a perfect model would leave in either). Several models (identified, prior, …) are compared on the same motion.
//!
//! Plates that were never unloaded in a recording cannot be tared. Where [`TrialInput::untared`] says so, a constant wrench of the
//! recording is taken off for each model ([`RecordingOffset`]) and all figures are without it; `…_as_measured` are with it.
//!
//! ```no_run
//! # fn f(body: aloft_compare::Body<'_>, motion: &aloft_body::Motion, flights: &[std::ops::Range<usize>],
//! #      identified: nalgebra::DVector<f64>) -> Result<(), aloft_compare::CompareError> {
//! use aloft_compare::{Candidate, CompareOptions, Noise, TrialInput, compare};
//!
//! let models = [Candidate::base("identified", identified), Candidate::links("prior", body.base, body.prior)];
//! let trials = [TrialInput::new(motion, flights)];
//! let (comparison, _series) = compare(&body, &models, &trials, Noise::Unknown, &CompareOptions::default())?;
//! println!("{:?}", comparison.first.flight.residual_force_n.rms);
//! # Ok(())
//! # }
//! ```

mod breakdown;
mod comparison;
mod drift;
mod error;
mod errors;
mod frames;
mod input;
mod measured;
mod noise_floor;
mod offset;
mod phase;
mod predict;
mod segments;
mod windows;
mod words;

pub use breakdown::{Group, GroupFloor, GroupedBy};
pub use comparison::{
    AgainstFloor, AxisRow, Comparison, Filtering, ModelComparison, Noise, TrialComparison, compare, compare_each,
};
pub use drift::{PlateDrift, TareReadings};
pub use error::CompareError;
pub use errors::{AxisErrors, AxisResidual, FlightErrors, WindowErrors, WrenchErrors};
pub use frames::TrialSeries;
pub use input::{Body, Candidate, CompareOptions, TrialInput};
pub use measured::{Measured, measured_wrench};
pub use noise_floor::{Floor, NoiseFloor, PoseErrors, Smooth, noise_root};
pub use offset::RecordingOffset;
pub use phase::Phase;
pub use segments::SegmentShare;
