//! Compares models with measurements: residuals by trial, phase, axis, segment.
//!
//! Takes identified parameters and held-out trials, and computes how far the predicted wrench is
//! from the measured one. The wrench is the one on the root, in root axes about the root origin;
//! the error is *predicted − measured*. In contact the plates give the measured wrench, filtered
//! with the filter of the motion; in flight the true wrench is zero, so the predicted wrench is the
//! error.
//!
//! Three figures are reported together, because each alone is misleading: single frames (the error
//! of inverse dynamics, limited by the noise of second derivatives), weak windows (the error of the
//! model itself), and the noise floor (the error that a perfect model would leave in either).
//! Several models (identified, prior, …) are compared on the same motion.
//!
//! Plates that were never unloaded in a recording cannot be tared. Where [`TrialInput::untared`] is
//! set, a constant wrench is subtracted from the recording for each model ([`RecordingOffset`]),
//! and all figures are without it; those named `…_as_measured` include it.
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
mod follows;
mod frames;
mod grade;
mod input;
mod judgement;
mod measured;
mod noise_floor;
mod offset;
mod phase;
mod predict;
mod segments;
mod trial_draws;
mod windows;
mod wording;

pub use aloft_regressor::{FAIR_TIMES_FLOOR, FLOOR_KNOWN_WITHIN, POOR_TIMES_FLOOR};
pub use breakdown::{Group, GroupFloor, GroupedBy};
pub use comparison::{
    AgainstFloor, AxisRow, BesideWords, Comparison, Filtering, ModelComparison, Noise, TrialComparison, WorstPlace,
    compare, compare_each,
};
pub use drift::{PlateDrift, TareReadings};
pub use error::CompareError;
pub use errors::{AxisErrors, AxisResidual, FlightErrors, WindowErrors, WrenchErrors};
pub use follows::correlation_in_time;
pub use frames::{TrialSeries, WindowSample};
pub use grade::{Grade, Graded, Limits, Reserve, Signal};
pub use input::{Body, Candidate, CompareOptions, OtherGeometry, PoseErrors, TrialInput};
pub use judgement::{floor_in_words, significant};
pub use measured::{Measured, measured_wrench};
pub use noise_floor::{Floor, NoiseFloor, Smooth, noise_root};
pub use offset::{OffsetRange, RecordingOffset};
pub use phase::Phase;
pub use segments::SegmentShare;
pub use trial_draws::TrialDraws;
pub use windows::{WindowRows, size_of_windows};
pub use wording::growth;
