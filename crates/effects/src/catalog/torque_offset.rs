//! A torque that reads a constant too much.

use crate::{About, Coefficient, Effect, EffectKind, JointSeries, Scene, Target};

const ABOUT: About<'static> = About {
    id: "torque_offset",
    title: "torque with a wrong zero",
    kind: EffectKind::Artefact,
    documentation: "\
## Physics
The torque sensor or current amplifier has a zero of its own, or a pretensioned cable pulls with a constant torque.

## Equation
`torque = offset`: the reading is larger by `offset` than what moves the joint. Coefficient: `offset`, N·m (N). Judged on the joints' torques in flight; only on robots whose log holds torques.

## Identifiability
While the joint moves all the time, it is the same as friction that depends on direction (`asymmetric_friction`).

## References
Swevers, Verdonck & De Schutter, Dynamic model identification for industrial robots, IEEE Control Systems 27 (2007).
",
    ..About::OF_JOINTS
};

pub(super) struct TorqueOffset;

impl Effect for TorqueOffset {
    fn about(&self) -> About<'_> {
        ABOUT
    }
    fn targets(&self, scene: &Scene) -> Vec<Target> {
        Target::joints(scene)
    }
    fn coefficients(&self, scene: &Scene, target: Target) -> Vec<Coefficient> {
        let unit = scene.unit_of(target, "N*m", "N");
        vec![Coefficient::free("offset", unit)]
    }
    fn torque(&self, series: &JointSeries<'_>, _: &[f64]) -> Vec<Vec<f64>> {
        vec![vec![1.0; series.v.len()]]
    }
}
