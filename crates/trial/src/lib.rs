//! Recordings in SI and one declared world frame (Z up): markers, plates, events, gaps, quality.
//!
//! Missing is missing: a marker that was not seen is NaN, from import to export, never zero and never the last value.

pub mod error;
mod import;
pub mod marker_set;
pub mod mot;
pub mod options;
pub mod recording;
mod trc;
pub mod world;

pub use error::TrialError;
pub use marker_set::{MarkerDefinition, MarkerSet};
pub use mot::Table;
pub use options::ImportOptions;
pub use recording::{ComputedPoint, Event, Markers, Plate, Trial};
pub use world::UpAxis;
