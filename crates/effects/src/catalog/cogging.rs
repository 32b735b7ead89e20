//! A torque that ripples over the angle of a joint.

use crate::{About, Coefficient, Effect, EffectKind, JointSeries, NonlinearParameter, Scene, Target};

const ABOUT: About<'static> = About {
    id: "cogging",
    title: "torque ripple over the angle (cogging)",
    kind: EffectKind::Physics,
    documentation: "\
## Physics
Poles of the motor and teeth of a gear give a torque that repeats over the turn.

## Equation
`torque = sine sin(n q) + cosine cos(n q)` on a hinge with angle `q`. Coefficients: `sine`, `cosine`, N·m; nonlinear: `periods`, `n` in a turn of the joint, 6 to 52. Judged on the joints' torques in flight; only on robots whose log holds torques.

## Identifiability
Through motion over several periods, slow enough that a period lasts some samples.

## References
Piccoli & Yim, Anticogging: torque ripple suppression, modeling, and parameter selection, IJRR 35 (2016).
",
    ..About::OF_JOINTS
};

/// Fewest and most periods in a turn that are looked for.
const FEWEST: f64 = 6.0;
const MOST: f64 = 52.0;

pub(super) struct Cogging;

impl Effect for Cogging {
    fn about(&self) -> About<'_> {
        ABOUT
    }
    fn targets(&self, scene: &Scene) -> Vec<Target> {
        Target::joints(scene).into_iter().filter(|t| !scene.slides(t.link())).collect()
    }
    fn coefficients(&self, _: &Scene, _: Target) -> Vec<Coefficient> {
        vec![Coefficient::free("sine", "N*m"), Coefficient::free("cosine", "N*m")]
    }
    fn nonlinear(&self, _: &Scene, _: Target) -> Vec<NonlinearParameter> {
        vec![NonlinearParameter::new("periods", "1", FEWEST, MOST, 0.5)]
    }
    fn starts(&self, _: &Scene, _: Target) -> Vec<Vec<f64>> {
        (0..24).map(|i| vec![FEWEST + 2.0 * f64::from(i)]).collect()
    }
    fn torque(&self, series: &JointSeries<'_>, nonlinear: &[f64]) -> Vec<Vec<f64>> {
        let periods = nonlinear.first().copied().unwrap_or(FEWEST);
        vec![series.column(|q, _| (periods * q).sin()), series.column(|q, _| (periods * q).cos())]
    }
}
