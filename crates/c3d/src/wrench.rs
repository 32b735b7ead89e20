//! stub
use crate::{C3dError, C3dFile, PlateWrench};
impl C3dFile {
    /// The calibrated wrench of plate `index` as reaction on the subject.
    pub fn plate_wrench(&self, _index: usize) -> Result<PlateWrench, C3dError> {
        todo!()
    }
}
