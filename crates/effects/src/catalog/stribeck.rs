//! Friction of a joint that falls from rest to sliding.

use crate::{About, Coefficient, Effect, EffectKind, JointSeries, NonlinearParameter, Scene, Target};

const ABOUT: About<'static> = About {
    id: "stribeck",
    title: "more friction near rest (Stribeck)",
    kind: EffectKind::Physics,
    documentation: "\
## Physics
A lubricated joint has more friction near rest, where its surfaces touch, than when it slides on a film.

## Equation
`torque = extra exp(-(v / speed)^2) sgn(v)`, with the joint's rate `v`, beside the Coulomb and viscous friction that every joint has. Coefficient: `extra`, N·m (N), zero or more; nonlinear: `speed`, rad/s (m/s). Judged on the joints' torques in flight; only on robots whose log holds torques.

## Identifiability
Through motion that passes rest slowly and often. A speed far below the slowest sustained motion cannot be seen; one far above the fastest is Coulomb friction.

## References
Armstrong-Helouvry, Dupont & Canudas de Wit, A survey of models, analysis tools and compensation methods for the control of machines with friction, Automatica 30 (1994).
",
    ..About::OF_JOINTS
};

/// Slowest and fastest speed at which the excess may fade, rad/s or m/s.
const SLOWEST: f64 = 0.1;
const FASTEST: f64 = 5.0;

pub(super) struct Stribeck;

impl Effect for Stribeck {
    fn about(&self) -> About<'_> {
        ABOUT
    }
    fn targets(&self, scene: &Scene) -> Vec<Target> {
        Target::joints(scene)
    }
    fn coefficients(&self, scene: &Scene, target: Target) -> Vec<Coefficient> {
        let unit = scene.unit_of(target, "N*m", "N");
        vec![Coefficient::positive("extra", unit)]
    }
    fn nonlinear(&self, scene: &Scene, target: Target) -> Vec<NonlinearParameter> {
        let unit = scene.unit_of(target, "rad/s", "m/s");
        vec![NonlinearParameter::new("speed", unit, SLOWEST, FASTEST, 0.1)]
    }
    fn starts(&self, _: &Scene, _: Target) -> Vec<Vec<f64>> {
        [0.15, 0.25, 0.4, 0.7, 1.2, 2.0, 3.5].map(|speed| vec![speed]).to_vec()
    }
    fn torque(&self, series: &JointSeries<'_>, nonlinear: &[f64]) -> Vec<Vec<f64>> {
        let speed = nonlinear.first().copied().unwrap_or(FASTEST);
        let fading = series.v.iter().map(|v| (-(v / speed).powi(2)).exp());
        vec![series.directions().zip(fading).map(|(d, f)| d * f).collect()]
    }
}
