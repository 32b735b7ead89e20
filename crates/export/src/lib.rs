//! Files that other programs open, one file a format: what a laboratory takes home from a study.
//!
//! Stands after everything else: a [`SubjectExport`] (the model with its inertias) and a [`TrialExport`] for each recording go in,
//! [`OutFile`]s come out, named by paths relative to the export's folder. Nothing here touches the disk; `pipeline` writes.
//!
//! # Frames and units
//!
//! Inside, the world is Z-up and everything is SI. Three families of files leave it:
//!
//! | family | world | lengths | angles |
//! |---|---|---|---|
//! | OpenSim (`trc`, `mot`, `sto`, `forces`, `osim`) | Y up: `(x, y, z) → (x, z, −y)`, [`frame::ground_from_world`], for markers, forces and model alike | m (TRC: mm) | degrees in tables, radians in the model |
//! | robotics (`urdf`, `mjcf`) | Z up | m | radians |
//! | data (`c3d`, `parquet`, `csv`, `bids`) | Z up; C3D keeps the axes of the recording | m (C3D: the recording's unit) | degrees |
//!
//! # Coordinates
//!
//! [`Coordinates`] are the joint angles that people read: each spherical joint becomes three turns about axes of the moving link, in an
//! order and with signs that a [`Convention`] states. Model files and tables are made from the same [`Coordinates`], so a
//! `.mot` always fits its `.osim`.
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
pub mod parquet;
pub mod readme;
mod storage;
mod xml;

pub use coordinates::{Convention, CoordinateSeries, Coordinates, Sequence};
pub use error::ExportError;
pub use format::{Format, InertiaSource, OutFile, PlateAtFrames, SourceFile, SubjectExport, TrialExport};
pub use formats::FORMATS;
