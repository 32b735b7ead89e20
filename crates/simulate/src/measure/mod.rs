//! The instruments: cameras, plates, and their errors.

pub mod cameras;
pub mod feet;
pub mod markerless;
pub mod plates;

pub use cameras::Gap;
pub use plates::{PlateChannels, PlateGeometry};
