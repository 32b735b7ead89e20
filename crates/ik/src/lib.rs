//! Inverse kinematics: from markers to joint motion.
//!
//! Runs between scaling and filtering: a [`aloft_body::Subject`] defines the marker positions on
//! the links, a [`aloft_trial::Trial`] the measured positions, and [`solve()`] finds the joint
//! coordinates of every frame ([`aloft_body::Motion`]). [`calibrate()`] improves the subject's
//! joint centres, hinge axes and marker positions from the trials themselves, using markers alone.
//!
//! Missing markers are omitted; a frame that cannot be solved is NaN and counted, never an error.

mod bridge;
mod calibrate;
mod error;
mod frame;
mod labels;
mod labels_between;
mod marker_errors;
mod normal;
mod options;
mod passage;
mod problem;
mod ranges;
mod report;
mod roughness;
mod segments;
mod skyline;
mod solve;
mod start;
mod tree;

pub use calibrate::{
    CalibrateOptions, Calibration, CalibrationReport, Clip, GeometryError, JointChange, MarkerChange, TrialFit,
    calibrate, calibrate_clips, contradiction, shares,
};
pub use error::IkError;
pub use labels::{LabelExchange, exchange_labels, label_exchanges};
pub use marker_errors::{ERROR_SEED, MarkerErrors};
pub use options::IkOptions;
pub use ranges::{BeyondRange, JointRange};
pub use report::{IkReport, MarkerFit};
pub use segments::{JointGap, SegmentFit, Segments};
pub use solve::{IkResult, solve};
