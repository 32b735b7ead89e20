//! Something carried on a link in some trials.

use crate::{About, Coefficient, Columns, Effect, NonlinearParameter, Scene, Separation, Series, Target, Values};
use aloft_body::Phi;

const ABOUT: About<'static> = About {
    id: "payload",
    title: "payload on a link in a group of trials",
    separated_by: Separation::WithAndWithoutLoad,
    by_group: true,
    unbounded: "negative where the body was weighed with the load",
    documentation: "\
## Physics
A weight, a vest, a bag or a tool rides on a link in some of the trials. Within those trials it is part of the body; between loaded and unloaded trials the inertial parameters differ.

## Equation
Parameters of the link change by `m [1, p, |p|2 1 - p p']` in the trials of one group. Coefficient: mass `m` (kg, relative to the body mass stated). Nonlinear: the place p within 0.3 m of the link's centre of mass (on a longer link up to its ends).

## Identifiability
Exactly absorbed by the inertial parameters unless there are loaded and unloaded trials; the group is named by the user or found from the trials themselves. Which group carries it follows from the sign only if the body mass was taken unloaded.

## References
Own simulations (`docs/findings/labs.md`).
",
    ..About::PLAIN
};

pub(super) struct Payload;

impl Effect for Payload {
    fn about(&self) -> About<'_> {
        ABOUT
    }
    fn targets(&self, scene: &Scene) -> Vec<Target> {
        Target::links(scene)
    }
    fn coefficients(&self, _: &Scene, _: Target) -> Vec<Coefficient> {
        vec![Coefficient::free("mass", "kg")]
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
        Some(vec![scene.unit_mass_at(target.link(), &Values::new(nonlinear).vector())])
    }
}
