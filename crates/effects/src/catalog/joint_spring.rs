//! A spring, or a cable that is bent by a joint.

use crate::{About, Coefficient, Effect, EffectKind, JointSeries, Scene, Target};

const ABOUT: About<'static> = About {
    id: "joint_spring",
    title: "spring or cable across the joint",
    kind: EffectKind::Physics,
    contains: &["torque_offset"],
    documentation: "\
## Physics
A cable bundle through the joint, a hose, or a spring that carries weight pulls the joint towards one angle.

## Equation
`torque = stiffness q + at_zero`. Coefficients: `stiffness`, N·m/rad (N/m), zero or more; `at_zero`, N·m (N), the torque at coordinate zero. Judged on the joints' torques in flight; only on robots whose log holds torques.

## Identifiability
Through motion over much of the joint's range. Without it, only the torque at the mean angle is seen, which is `torque_offset`.

## References
Swevers, Verdonck & De Schutter, Dynamic model identification for industrial robots, IEEE Control Systems 27 (2007).
",
    ..About::OF_JOINTS
};

pub(super) struct JointSpring;

impl Effect for JointSpring {
    fn about(&self) -> About<'_> {
        ABOUT
    }
    fn targets(&self, scene: &Scene) -> Vec<Target> {
        Target::joints(scene)
    }
    fn coefficients(&self, scene: &Scene, target: Target) -> Vec<Coefficient> {
        let unit = scene.unit_of(target, "N*m", "N/m");
        let constant = scene.unit_of(target, "N*m", "N");
        vec![Coefficient::positive("stiffness", unit), Coefficient::free("at_zero", constant)]
    }
    fn torque(&self, series: &JointSeries<'_>, _: &[f64]) -> Vec<Vec<f64>> {
        vec![series.q.to_vec(), vec![1.0; series.q.len()]]
    }
}
