//! Recordings in SI and one declared world frame (Z up): markers, plates, events, gaps, quality.
//!
//! Missing markers are NaN from import to export, never zero and never the last value.

pub mod artefacts;
pub mod bids;
pub mod corrections;
pub mod error;
mod fall;
mod force_columns;
mod frozen;
pub mod gaps;
mod import;
pub mod labels;
pub mod limits;
pub mod marker_set;
pub mod missing;
pub mod mot;
pub mod options;
mod people;
mod person;
mod possible;
pub mod quality;
mod recorded;
pub mod recording;
mod rows;
mod samples;
mod segments;
pub mod session;
pub mod smoothing;
mod trc;
mod warning;
pub mod world;

pub use aloft_c3d::PointKind;
pub use artefacts::{ArtefactOptions, Finding, FindingKind, find_artefacts};
pub use bids::BidsMotion;
pub use corrections::{Corrections, PlateZero, vertical_of_fall};
pub use error::TrialError;
pub use fall::falls;
pub use force_columns::{ColumnNames, PlateNames};
pub use gaps::{FillMethod, GapFill, GapOptions, fill_gaps, fill_gaps_with_poses};
pub use labels::{MarkerSetMatch, apply_marker_set, recognise};
pub use limits::limits_to_missing;
pub use marker_set::{MarkerDefinition, MarkerSet, Markerless};
pub use mot::Table;
pub use options::{ForceTimes, ImportOptions};
pub use person::{person_key, person_of};
pub use quality::{MarkerQuality, QualityOptions, QualityReason, Severity, TrialQuality, assess};
pub use recorded::{RecordedAt, recorded_at};
pub use recording::{ComputedPoint, Event, Markers, Plate, Trial};
pub use samples::{plate_sketch, sample_sketch, share_in_common};
pub use segments::ARM_M;
pub use session::{SessionRecording, SessionSource, SessionTimes, session_times};
pub use smoothing::{Smoothing, smoothing};
pub use warning::{Warning, WarningKind};
pub use world::UpAxis;
