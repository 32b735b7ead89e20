//! The instruments: cameras, plates, and what is wrong with them.

pub mod cameras;
pub mod feet;
pub mod plates;

pub use cameras::Gap;
pub use plates::{PlateChannels, PlateGeometry};
