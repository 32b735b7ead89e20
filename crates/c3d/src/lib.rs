//! C3D files, bytes to structure and back, losing nothing. Nothing biomechanical is decided here.

mod builder;
mod error;
mod events;
mod file;
mod header;
mod layout;
mod number;
mod parameter_reader;
mod parameter_sync;
mod parameters;
mod plate_reader;
mod read;
mod samples;
mod text;
mod unit;
mod wrench;
mod write;

pub use builder::C3dBuilder;
pub use error::{C3dError, Warning, WarningKind};
pub use file::{Analog, C3dFile, FileEvent, PlateDescription, PlateWrench, Point, PointKind};
pub use header::HeaderEvent;
pub use number::{ByteOrder, Storage};
pub use parameters::{Group, Parameter, Parameters, Values};
pub use text::{Text, is_unlabelled, strip_subject};
pub use wrench::PlateFrame;
