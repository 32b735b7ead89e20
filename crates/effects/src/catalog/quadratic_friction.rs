//! Friction of a joint that is not proportional to its rate.

use crate::{About, Coefficient, Effect, EffectKind, JointSeries, Scene, Target};

const ABOUT: About<'static> = About {
    id: "quadratic_friction",
    title: "friction that bends with speed",
    kind: EffectKind::Physics,
    documentation: "\
## Physics
Grease that is churned, air, or a fan on the motor resist with the square of speed; grease that thins under shear resists less than in proportion (negative coefficient).

## Equation
`torque = quadratic v |v|`, beside viscous and Coulomb friction. Coefficient: `quadratic`, N·m·s² (N·s²/m²). Judged on the joints' torques in flight; only on robots whose log holds torques.

## Identifiability
Through rates that vary over a wide range in the same joint.

## References
Bona & Indri, Friction compensation in robotics: an overview, IEEE CDC (2005).
",
    ..About::OF_JOINTS
};

pub(super) struct QuadraticFriction;

impl Effect for QuadraticFriction {
    fn about(&self) -> About<'_> {
        ABOUT
    }
    fn targets(&self, scene: &Scene) -> Vec<Target> {
        Target::joints(scene)
    }
    fn coefficients(&self, scene: &Scene, target: Target) -> Vec<Coefficient> {
        let unit = scene.unit_of(target, "N*m*s^2", "N*s^2/m^2");
        vec![Coefficient::free("quadratic", unit)]
    }
    fn torque(&self, series: &JointSeries<'_>, _: &[f64]) -> Vec<Vec<f64>> {
        vec![series.column(|_, v| v * v.abs())]
    }
}
