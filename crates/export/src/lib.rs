//! Writes the results of a study as files for other programs, one module per format.
//!
//! Input: a [`SubjectExport`] (the model with its inertias) and a [`TrialExport`] for each
//! recording. Output: [`OutFile`]s, named by paths relative to the export's folder. This crate does
//! not access the disk; `pipeline` writes the files.
//!
//! # Frames and units
//!
//! Internally the world is Z-up and everything is in SI units. There are three families of files:
//!
//! | family | world | lengths | angles |
//! |---|---|---|---|
//! | OpenSim (`trc`, `mot`, `sto`, `forces`, `osim`) | Y up: `(x, y, z) → (x, z, −y)`, [`frame::ground_from_world`], for markers, forces and model alike | m (TRC: mm) | degrees in tables, radians in the model |
//! | robotics (`urdf`, `mjcf`) | Z up | m | radians |
//! | data (`c3d`, `parquet`, `csv`, `bids`) | Z up; C3D keeps the axes of the recording | m (C3D: the recording's unit) | degrees |
//!
//! # Coordinates
//!
//! [`Coordinates`] are conventional joint angles: each spherical joint becomes three rotations
//! about axes of the moving link, with the order and signs of a [`Convention`]. Model files and
//! tables are made from the same [`Coordinates`], so a `.mot` always matches its `.osim`.
//!
//! To add a format: write `formats/<format>.rs` with a `FORMAT` and name it in [`FORMATS`].

pub mod channels;
pub mod coordinates;
pub mod dynamics;
mod error;
pub mod format;
pub mod formats;
pub mod frame;
pub mod loads;
pub mod names;
mod number;
mod osim_file;
pub mod parquet;
mod parquet_pages;
pub mod readme;
mod robot_file;
mod storage;
pub mod subject;
pub mod trial;
mod xml;

pub use coordinates::{Convention, CoordinateSeries, Coordinates, Sequence};
pub use error::ExportError;
pub use format::{Format, OutFile};
pub use formats::FORMATS;
pub use loads::PlateAtFrames;
pub use names::{csv_cell, no_formula};
pub use number::with_half;
pub use subject::{InertiaSource, LinkKnown, OsimFile, RobotFile, SubjectExport};
pub use trial::{FileCoordinates, SourceFile, TrialExport};
