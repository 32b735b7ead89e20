//! Errors and warnings.

/// Why bytes are not a C3D file. Every variant says where.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum C3dError {
    /// Not C3D at all.
    #[error("not a C3D file: byte {offset} is {found:#04x}, expected {expected}")]
    NotC3d {
        #[doc(hidden)]
        offset: usize,
        #[doc(hidden)]
        found: u8,
        #[doc(hidden)]
        expected: &'static str,
    },
}

/// Something odd that did not stop the reading.
#[derive(Debug, Clone, PartialEq)]
pub struct Warning {
    /// In words, naming group, parameter and byte offset where that helps.
    pub message: String,
}
