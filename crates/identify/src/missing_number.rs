//! Numbers that are missing: `null` in JSON, NaN in memory.

use serde::{Deserialize, Deserializer};

/// JSON has no NaN and no infinity: both are written as null, and null is read as NaN.
pub(crate) fn nullable<'de, D: Deserializer<'de>>(deserializer: D) -> Result<f64, D::Error> {
    Ok(Option::<f64>::deserialize(deserializer)?.unwrap_or(f64::NAN))
}

pub(crate) fn nothing() -> f64 {
    f64::NAN
}
