//! C3D files, bytes to structure and back, losing nothing. Nothing biomechanical is decided here.

mod error;
mod file;

pub use error::{C3dError, Warning};
pub use file::*;
