//! Forward dynamics and synthetic laboratories with known truth.

mod describe;
pub mod error;
pub mod hidden;
pub mod human;
pub mod lab;
pub mod measure;
pub mod motion;
pub mod npz;
pub mod object;
pub mod physics;
pub mod random;
pub mod scenario;
pub mod truth;

pub use error::SimulateError;
pub use hidden::Hidden;
pub use lab::{Lab, LabFile, LabTrial, simulate};
pub use scenario::*;
pub use truth::Truth;
