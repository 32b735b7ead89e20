//! C3D files: lossless conversion from bytes to a structure and back, without biomechanical
//! interpretation.
//!
//! Lowest level of import: `trial` converts a [`C3dFile`] into a recording in SI units and one
//! world frame; `export` and `simulate` create new files with [`C3dBuilder`].
//!
//! ```
//! use aloft_c3d::{C3dBuilder, C3dFile};
//!
//! # fn main() -> Result<(), aloft_c3d::C3dError> {
//! # let bytes = C3dBuilder::new(100.0).marker("LASI", vec![[1.0, 2.0, 3.0]; 4]).build()?.to_bytes()?;
//! let mut file = C3dFile::from_bytes(&bytes)?;
//! for warning in &file.warnings {
//!     println!("{warning}");
//! }
//! let wrenches: Vec<_> = (0..file.plates.len()).map(|i| file.plate_wrench(i)).collect();
//! file.points[0].label = "L.ASIS".into();
//! let again = file.to_bytes()?;
//! # assert_eq!(C3dFile::from_bytes(&again)?.points[0].label, "L.ASIS");
//! # Ok(())
//! # }
//! ```
//!
//! # Reading
//!
//! [`C3dFile::from_bytes`] reads Intel, DEC and MIPS files with integer or float samples. Real
//! files state their sizes two or three times and inconsistently; the statement that agrees with
//! the file's length is used, and the contradiction becomes a [`Warning`]. Memory is bounded by a
//! small multiple of the input, no input causes a panic, and unreadable input gives an error with
//! byte offset, group and parameter. A point whose fourth word is negative as a 16-bit integer was
//! not seen: its coordinates and residual are NaN, never the origin.
//!
//! # Plates
//!
//! [`C3dFile::plate_wrench`] returns the reaction on the subject in the file's world axes, N and
//! N·m about the world origin, at the analog rate. Repairs (sign, moment unit, direction of the
//! origin, an unusable baseline) are listed in [`PlateWrench::warnings`].
//!
//! # Writing
//!
//! [`C3dFile::groups`] keeps every group and parameter as stored, and a file that was read keeps
//! its original samples: [`C3dFile::to_bytes`] changes only what no longer agrees with the typed
//! fields. Rewriting an unchanged file preserves every sample bit by bit.
//!
//! | module | what it holds |
//! |---|---|
//! | `number` | bytes of integers and floats in three orders |
//! | `parameters`, `parameter_reader` | the tree of groups and its reader |
//! | `header`, `layout` | the first block; choice among the stated sizes |
//! | `samples` | bulk conversion, one loop for each order and storage |
//! | `read`, `events`, `plate_reader` | interpretation of the standard groups |
//! | `poses` | poses of segments, as markerless software stores them |
//! | `wrench` | conversion of plate channels to wrenches |
//! | `write`, `parameter_sync`, `builder` | writing, and new files |

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
mod poses;
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
pub use poses::{SegmentPoses, SegmentTrack};
pub use text::{Text, is_unlabelled, split_subject, strip_subject};
pub use unit::metres_per;
pub use wrench::PlateFrame;
