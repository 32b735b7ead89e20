//! `markerset`: checks a marker-set file, and drafts one from a laboratory's recordings.

mod axes;
mod check;
mod cluster;
mod draft;
mod known;
mod renamed;

pub use check::{MarkerSetCheck, SetFinding, check};
pub(crate) use renamed::renamed;

pub use draft::{Draft, DraftedMarker, draft, to_yaml, write_new};
