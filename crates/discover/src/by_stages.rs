//! The error with the effects found, computed by all stages instead of estimated from the rows.
//!
//! The rows of a ranking have other folds and weights than the comparison, so the change of their
//! error only estimates that of the comparison. A verdict that depends on how far the error is
//! above its floor uses the number that the user will see after adding the effects, where it can be
//! computed.

use crate::held_out::HeldOutResult;
use crate::result::Found;
use std::fmt;

/// Error and floor in flight and in contact with these effects in the model; none where it cannot
/// be computed.
pub type Compute<'a> = &'a (dyn Fn(&[Found]) -> Option<[Option<HeldOutResult>; 2]> + Sync);

/// Computes a model by all stages, if the caller can.
#[derive(Clone, Copy, Default)]
pub(crate) struct ByStages<'a>(Option<Compute<'a>>);

impl<'a> ByStages<'a> {
    pub fn new(compute: Compute<'a>) -> Self {
        Self(Some(compute))
    }

    /// Error and floor with these effects in the model.
    pub fn with(&self, found: &[Found]) -> Option<[Option<HeldOutResult>; 2]> {
        if found.is_empty() { None } else { self.0?(found) }
    }
}

impl fmt::Debug for ByStages<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_tuple("ByStages").field(&self.0.is_some()).finish()
    }
}
