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

use crate::ExportError;
use crate::format::Format;

/// Every format, in the order of the README. Help, README table and conformance tests are made from
/// this slice.
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

impl Format {
    /// The formats with the names typed by users; all if no name is given.
    ///
    /// # Errors
    /// [`ExportError::UnknownFormat`] with the available names.
    pub fn choose(names: &[String]) -> Result<Vec<&'static Self>, ExportError> {
        let all = FORMATS;
        if names.is_empty() {
            return Ok(all.to_vec());
        }
        for name in names {
            if !all.iter().any(|f| f.name.eq_ignore_ascii_case(name)) {
                return Err(ExportError::UnknownFormat {
                    found: name.clone(),
                    known: all.iter().map(|f| f.name).collect::<Vec<_>>().join(", "),
                });
            }
        }
        Ok(all.iter().filter(|f| names.iter().any(|n| f.name.eq_ignore_ascii_case(n))).copied().collect())
    }
}
