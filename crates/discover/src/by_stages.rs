//! The error with the effects found, computed by all stages instead of estimated from the rows.
//!
//! The rows of a ranking have other folds and weights than the comparison, so the change of their
//! error only estimates that of the comparison. A verdict that depends on how far the error is
//! above its floor uses the number that the user will see after adding the effects, where it can be
//! computed.

use crate::held_out::HeldOutResult;
use crate::laws::FoundLaw;
use crate::result::{Estimate, Found};
use std::fmt;

/// A model with effects, computed by all stages.
#[derive(Debug, Clone, Default)]
pub struct Staged {
    /// Error and floor in flight and in contact.
    pub errors: [Option<HeldOutResult>; 2],
    /// Coefficients of the effects.
    pub coefficients: Vec<StagedCoefficient>,
}

/// A coefficient as the model reports it.
#[derive(Debug, Clone)]
pub struct StagedCoefficient {
    /// Key of the effect and name of the coefficient: `tether[hand_r].stiffness`.
    pub name: String,
    /// Estimate.
    pub value: f64,
    /// Standard error and its degrees of freedom.
    pub se: (f64, f64),
}

impl Staged {
    /// Replaces the estimates of the ranking by those of the model, so that one number with one
    /// interval stands everywhere.
    pub(crate) fn restate(&self, found: &mut [Found]) {
        for f in found {
            for e in f.coefficients.iter_mut().filter(|e| !e.at_bound) {
                let name = format!("{}.{}", f.key, e.name);
                let Some(c) = self.coefficients.iter().find(|c| c.name == name && c.value.is_finite()) else {
                    continue;
                };
                *e = Estimate { value: c.value, ..e.clone() }.with_error(c.se.0, c.se.1);
            }
        }
    }
}

/// The model with these effects and laws; none where it cannot be computed.
pub type Compute<'a> = &'a (dyn Fn(&[Found], &[&FoundLaw]) -> Option<Staged> + Sync);

/// Computes a model by all stages, if the caller can.
#[derive(Clone, Copy, Default)]
pub(crate) struct ByStages<'a>(Option<Compute<'a>>);

impl<'a> ByStages<'a> {
    pub fn new(compute: Compute<'a>) -> Self {
        Self(Some(compute))
    }

    /// The model with these effects.
    pub fn with(&self, found: &[Found]) -> Option<Staged> {
        if found.is_empty() { None } else { self.0?(found, &[]) }
    }

    /// The model with these laws instead.
    pub fn with_laws(&self, laws: &[FoundLaw]) -> Option<Staged> {
        if laws.is_empty() { None } else { self.0?(&[], &laws.iter().collect::<Vec<_>>()) }
    }
}

impl fmt::Debug for ByStages<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_tuple("ByStages").field(&self.0.is_some()).finish()
    }
}
