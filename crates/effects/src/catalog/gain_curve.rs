//! A torque whose gain changes with its size.

use crate::{About, Coefficient, Effect, EffectKind, JointSeries, Scene, Target};

const ABOUT: About<'static> = About {
    id: "gain_curve",
    title: "torque whose gain changes with its size",
    kind: EffectKind::Artefact,
    documentation: "\
## Physics
The iron of a motor saturates, so that a current gives less torque than in proportion; a torque sensor bends.

## Equation
The torque at the joint is `reading + curve reading |reading|`, beside the constant gain that every joint has. Coefficient: `curve`, 1/(N·m) (1/N), negative where the motor saturates and the torque is computed from its current. Judged on the joints' torques in flight; only on robots whose log holds torques.

## Identifiability
Through torques that vary over a wide range.

## References
Swevers, Verdonck & De Schutter, Dynamic model identification for industrial robots, IEEE Control Systems 27 (2007).
",
    ..About::OF_JOINTS
};

pub(super) struct GainCurve;

impl Effect for GainCurve {
    fn about(&self) -> About<'_> {
        ABOUT
    }
    fn targets(&self, scene: &Scene) -> Vec<Target> {
        Target::joints(scene)
    }
    fn coefficients(&self, scene: &Scene, target: Target) -> Vec<Coefficient> {
        let unit = scene.unit_of(target, "1/N/m", "1/N");
        vec![Coefficient::free("curve", unit)]
    }
    fn torque(&self, series: &JointSeries<'_>, _: &[f64]) -> Vec<Vec<f64>> {
        vec![series.torque.iter().map(|t| -t * t.abs()).collect()]
    }
}
