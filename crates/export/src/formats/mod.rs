//! The formats, one file each. To add one: write a file with a `FORMAT` and name it in [`FORMATS`].

pub mod bids;
pub mod c3d;
pub mod csv;
pub mod forces;
pub mod mjcf;
pub mod mot;
pub mod osim;
pub mod parquet;
pub mod sto;
pub mod trc;
pub mod urdf;

use crate::Format;

/// Every format, in the order of the README. Help, README table and conformance tests are made from this slice.
pub static FORMATS: &[&Format] = &[
    &osim::FORMAT,
    &urdf::FORMAT,
    &mjcf::FORMAT,
    &trc::FORMAT,
    &mot::FORMAT,
    &sto::FORMAT,
    &forces::FORMAT,
    &c3d::FORMAT,
    &parquet::FORMAT,
    &csv::FORMAT,
    &bids::FORMAT,
];
