//! A link whose table values are wrong, or a load that it carries in every trial.

use crate::{About, Coefficient, Columns, Effect, NonlinearParameter, Scene, Separation, Series, Target, Values};
use aloft_body::Phi;

const ABOUT: About<'static> = About {
    id: "link_mass",
    title: "link heavier or lighter than in the tables, or a load on it in every trial",
    separated_by: Separation::WithAndWithoutLoad,
    of_tables: true,
    documentation: "\
## Physics
A weight is worn in every recording, or a link is not what the anthropometric tables say: a prosthesis, a cast, a missing limb, a very muscular leg. The inertial parameters found from flights are held near the tables, so that a large deviation of one link leaves an error.

## Equation
Parameters of the link change by `m [1, p, |p|2 1 - p p']` and those of the whole body by `-m phi / M`, so that the body mass stays the stated one. Coefficient: mass `m` (kg, that of the load if the body was weighed with it). Nonlinear: the place p within 0.3 m of the link's centre of mass (on a longer link up to its ends).

## Identifiability
Only for bodies with values from tables (people): without them it is part of the inertial parameters. Flights do not show the total mass: where the body was weighed without the load m, the coefficient is `m M / (M + m)`. A load and a wrong value in the tables are the same; a recording without the load separates them.

## References
Own simulations (`docs/findings/labs.md`).
",
    ..About::PLAIN
};

pub(super) struct LinkMass;

impl Effect for LinkMass {
    fn about(&self) -> About<'_> {
        ABOUT
    }
    fn targets(&self, scene: &Scene) -> Vec<Target> {
        Target::links(scene)
    }
    fn coefficients(&self, scene: &Scene, target: Target) -> Vec<Coefficient> {
        let own_kg = scene.phi.get(target.link()).map_or(0.0, |phi| phi[0]);
        vec![Coefficient::within("mass", "kg", -own_kg, 0.5 * scene.mass_kg)]
    }
    fn nonlinear(&self, scene: &Scene, target: Target) -> Vec<NonlinearParameter> {
        NonlinearParameter::point_of(scene, target)
    }
    fn starts(&self, scene: &Scene, target: Target) -> Vec<Vec<f64>> {
        scene.places_on(target).iter().map(|place| place.as_slice().to_vec()).collect()
    }
    fn has_wrench(&self) -> bool {
        false
    }
    fn evaluate(&self, _: &Series<'_>, _: Target, _: &[f64], _: &mut Columns) {}
    fn inertia(&self, scene: &Scene, target: Target, nonlinear: &[f64]) -> Option<Vec<Vec<Phi>>> {
        let mut change = scene.unit_mass_at(target.link(), &Values::new(nonlinear).vector());
        for (c, phi) in change.iter_mut().zip(&scene.phi) {
            *c -= phi / scene.mass_kg;
        }
        Some(vec![change])
    }
}
