//! A body mass that was stated wrongly.

use crate::Scene;
use crate::definition::{self as def, ActsIn, Coefficient, EffectDefinition, EffectKind, Target};
use aloft_body::Phi;

pub(super) static EFFECT: EffectDefinition = EffectDefinition {
    id: "body_mass",
    title: "body mass stated wrongly",
    kind: EffectKind::Artefact,
    acts: ActsIn::Contact,
    class: "one gain for all plates",
    contains: &[],
    by_group: false,
    unbounded: "",
    targets,
    coefficients,
    nonlinear: def::none,
    starts: def::one_start,
    wrench: None,
    inertia: Some(inertia),
    documentation: "\
## Physics
The mass from the scale is wrong, or the subject wore something else that day. Flights fix the parameters only up to that mass; plates weigh the body anew.

## Equation
All parameters grow in proportion: `dphi = phi / M` a kilogram. Coefficient: the true mass less the stated one, kg (negative for a scale that reads too much).

## Identifiability
Invisible in flight. On plates an exact alias of one gain for all plates. A certified weight on the plates, or a second scale, separates them.

## References
Own simulations (`docs/findings/labs.md`).
",
};

fn targets(scene: &Scene) -> Vec<Target> {
    if scene.n_plates() > 0 { vec![Target::Body] } else { Vec::new() }
}

fn coefficients(scene: &Scene, _: Target) -> Vec<Coefficient> {
    vec![Coefficient::within("mass_error", "kg", -0.5 * scene.mass_kg, 0.5 * scene.mass_kg)]
}

fn inertia(scene: &Scene, _: Target, _: &[f64]) -> Vec<Vec<Phi>> {
    vec![scene.phi.iter().map(|p| p / scene.mass_kg).collect()]
}
