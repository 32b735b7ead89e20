//! What may be missing: an effect on a target in some or all recordings.

use crate::candidate::Variant;
use crate::session::Session;
use aloft_effects::{EffectInstance, Target};
use nalgebra::DVector;

/// An effect on a target in some or all recordings, at the optimum of its unknowns.
#[derive(Clone)]
pub(super) struct Explanation<'a> {
    pub variant: Variant<'a>,
    pub theta: DVector<f64>,
    /// Sum of squares that it leaves.
    pub left: f64,
    /// Logarithm of its marginal likelihood, the same constant left out as for "nothing"; without
    /// what it costs to choose its effect and target among others.
    pub ln_likelihood: f64,
}

impl Explanation<'_> {
    /// True for a cause that acts on the body in the air.
    pub fn acts_in_flight(&self) -> bool {
        self.variant.effect.acts().in_flight()
    }

    /// Its key, as `effect add` takes it.
    pub fn key(&self, session: &Session<'_>) -> String {
        let (effect, target) = (self.variant.effect, self.variant.target);
        EffectInstance { effect, target, nonlinear: Vec::new(), trials: Vec::new() }.key(session.scene())
    }

    /// Effect and target.
    pub fn place(&self) -> (&str, Target) {
        (self.variant.effect.id(), self.variant.target)
    }

    /// True if another one would only describe this one once more: the same effect on the same
    /// target, on a body of one target, or one of its other names there.
    pub fn is_alike(&self, other: &Self) -> bool {
        let (own, its) = (self.variant.effect, other.variant.effect);
        let of_a_part = matches!(self.variant.target, Target::Link(_) | Target::Plate(_));
        let same = own.id() == its.id() && !(of_a_part && self.variant.target != other.variant.target);
        let wider = its.about().contains.contains(&own.id());
        let narrower = own.about().contains.contains(&its.id()) && self.variant.target == other.variant.target;
        same || wider || narrower || (own.about().aliases.contains(&its.id()) && self.variant.target == Target::Body)
    }
}
