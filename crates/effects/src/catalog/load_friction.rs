//! Friction of a joint that grows with the torque through its gear.

use crate::{About, Coefficient, Effect, EffectKind, JointSeries, Scene, Target};

const ABOUT: About<'static> = About {
    id: "load_friction",
    title: "friction that grows with the load",
    kind: EffectKind::Physics,
    documentation: "\
## Physics
Teeth that carry more press harder and rub harder: a gear of 95 % efficiency loses a twentieth of what passes through it.

## Equation
`torque = share |torque| sgn(v)`. Coefficient: `share`, 0 to 1. Judged on the joints' torques in flight; only on robots whose log holds torques.

## Identifiability
Through torques that vary at the same speed, driving and braking.

## References
Hamon, Gautier & Garrec, Dynamic identification of robots with a dry friction model depending on load and velocity, IROS (2010).
",
    ..About::OF_JOINTS
};

pub(super) struct LoadFriction;

impl Effect for LoadFriction {
    fn about(&self) -> About<'_> {
        ABOUT
    }
    fn targets(&self, scene: &Scene) -> Vec<Target> {
        Target::joints(scene)
    }
    fn coefficients(&self, _: &Scene, _: Target) -> Vec<Coefficient> {
        vec![Coefficient::within("share", "1", 0.0, 1.0)]
    }
    fn torque(&self, series: &JointSeries<'_>, _: &[f64]) -> Vec<Vec<f64>> {
        vec![series.directions().zip(series.torque).map(|(d, t)| d * t.abs()).collect()]
    }
}
