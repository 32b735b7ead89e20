//! Recordings in SI and one declared world frame (Z up): markers, plates, events, gaps, quality.
//!
//! Missing is missing: a marker that was not seen is NaN, from import to export, never zero and never the last value.

pub mod error;
pub mod marker_set;
pub mod recording;

pub use error::TrialError;
pub use marker_set::{MarkerDefinition, MarkerSet};
pub use recording::{ComputedPoint, Event, Markers, Plate, Trial};
