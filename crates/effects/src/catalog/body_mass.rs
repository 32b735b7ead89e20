//! A body mass that was stated wrongly.

use crate::{About, ActsIn, Coefficient, Columns, Effect, EffectKind, Family, Scene, Separation, Series, Target};
use aloft_body::Phi;

const ABOUT: About<'static> = About {
    id: "body_mass",
    title: "body mass stated wrongly",
    kind: EffectKind::Artefact,
    acts: ActsIn::Contact,
    family: Family::Plates,
    class: "one gain for all plates",
    aliases: &["plate_gain"],
    separated_by: Separation::KnownWeight,
    shows_in_free_fall: true,
    documentation: "\
## Physics
The mass from the scale is wrong, or the subject wore something else that day. Flights fix the parameters only up to that mass; plates measure the weight independently.

## Equation
All parameters grow in proportion: `dphi = phi / M` a kilogram. Coefficient: the true mass less the stated one, kg (negative for a scale that reads too much).

## Identifiability
Invisible in flight. On plates an exact alias of one gain for all plates. A certified weight on the plates, or a second scale, separates them. A body heavier than stated may also carry a load in every recording: the answer then names `link_mass`, too, unless the model holds it.

## References
Own simulations (`docs/findings/labs.md`).
",
    ..About::PLAIN
};

pub(super) struct BodyMass;

impl Effect for BodyMass {
    fn about(&self) -> About<'_> {
        ABOUT
    }
    fn added_inertia_kg(&self, coefficients: &[f64]) -> f64 {
        coefficients.first().copied().unwrap_or(0.0)
    }
    fn looks_like(&self, coefficients: &[f64]) -> &'static [&'static str] {
        // plates weigh a load that every recording contains as they weigh the body
        if coefficients.first().is_some_and(|kg| *kg > 0.0) { &["link_mass"] } else { &[] }
    }
    fn targets(&self, scene: &Scene) -> Vec<Target> {
        Target::body_on_plates(scene)
    }
    fn coefficients(&self, scene: &Scene, _: Target) -> Vec<Coefficient> {
        vec![Coefficient::within("mass_error", "kg", -0.5 * scene.mass_kg, 0.5 * scene.mass_kg)]
    }
    fn has_wrench(&self) -> bool {
        false
    }
    fn evaluate(&self, _: &Series<'_>, _: Target, _: &[f64], _: &mut Columns) {}
    fn inertia(&self, scene: &Scene, _: Target, _: &[f64]) -> Option<Vec<Vec<Phi>>> {
        Some(vec![scene.phi.iter().map(|p| p / scene.mass_kg).collect()])
    }
}
