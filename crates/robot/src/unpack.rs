//! How far packed files are unpacked.
//!
//! A few megabytes of an archive can stand for gigabytes. Tables of numbers pack to a third to a
//! tenth of their size; what unpacks to far more is no recording.

use std::io::Read;

/// Bytes that any packed file may unpack to.
const ALWAYS: usize = 128 << 20;
/// Times its size that a larger one may unpack to.
const TIMES: usize = 20;

/// Bytes that a file of some bytes may unpack to.
pub(crate) fn most(packed: usize) -> usize {
    packed.saturating_mul(TIMES).max(ALWAYS)
}

/// The message for a file that holds more.
pub(crate) fn too_much(packed: usize) -> String {
    format!(
        "{packed} bytes unpack to more than {} MB ({TIMES} times the file, at least {} MB): no log of numbers packs so small",
        most(packed) >> 20,
        ALWAYS >> 20
    )
}

/// Everything that a stream of gzip holds, unpacked.
///
/// # Errors
/// More than a file of `packed` bytes may unpack to; what the stream reports.
pub(crate) fn all(stream: impl Read, packed: usize) -> Result<Vec<u8>, String> {
    let mut out = Vec::new();
    let most = most(packed);
    stream
        .take(most as u64 + 1)
        .read_to_end(&mut out)
        .map_err(|e| format!("the gzip archive is damaged after {} bytes: {e}", out.len()))?;
    if out.len() > most { Err(too_much(packed)) } else { Ok(out) }
}
