//! stub
use crate::{C3dError, C3dFile};
impl C3dFile {
    /// Writes the file.
    pub fn to_bytes(&self) -> Result<Vec<u8>, C3dError> {
        todo!()
    }
}
