//! Coulomb friction that differs between the two directions of a joint.

use crate::{About, Coefficient, Effect, EffectKind, JointSeries, Scene, Target};

const ABOUT: About<'static> = About {
    id: "asymmetric_friction",
    title: "friction that depends on direction",
    kind: EffectKind::Physics,
    told_from: &[("torque_offset", "holding the joint still, where friction by direction vanishes and an offset stays")],
    documentation: "\
## Physics
A gear, a seal or a worm runs harder in one direction than in the other.

## Equation
`torque = difference |sgn(v)|`: Coulomb friction is larger by `difference` forwards and smaller by it backwards than its mean. Coefficient: `difference`, N·m (N). Judged on the joints' torques in flight; only on robots whose log holds torques.

## Identifiability
While the joint moves all the time, it is the same as an offset of the torque (`torque_offset`). They differ where the joint rests.

## References
Bittencourt & Gunnarsson, Static friction in a robot joint, J. Dyn. Sys. Meas. Control 134 (2012).
",
    ..About::OF_JOINTS
};

pub(super) struct AsymmetricFriction;

impl Effect for AsymmetricFriction {
    fn about(&self) -> About<'_> {
        ABOUT
    }
    fn targets(&self, scene: &Scene) -> Vec<Target> {
        Target::joints(scene)
    }
    fn coefficients(&self, scene: &Scene, target: Target) -> Vec<Coefficient> {
        let unit = scene.unit_of(target, "N*m", "N");
        vec![Coefficient::free("difference", unit)]
    }
    fn torque(&self, series: &JointSeries<'_>, _: &[f64]) -> Vec<Vec<f64>> {
        vec![series.directions().map(f64::abs).collect()]
    }
}
