//! Forward dynamics and synthetic laboratories with known truth.

pub mod error;
pub mod hidden;
pub mod human;
pub mod measure;
pub mod motion;
pub mod object;
pub mod physics;
pub mod random;
pub mod scenario;

pub use error::SimulateError;
pub use hidden::Hidden;
pub use scenario::*;
