//! Inertia without weight: air or water that is carried along.

use crate::{About, Coefficient, Columns, Effect, NonlinearParameter, Scene, Series, Target, Values};
use aloft_body::Phi;

const ABOUT: About<'static> = About {
    id: "added_mass",
    title: "added mass (inertia without weight)",
    class: "magnitude of gravity",
    told_from: &[(
        "constant_force",
        "standing on force plates, where a constant force changes the weight and added mass does not",
    )],
    unbounded: "a mass is not negative; in water, or under a parachute, it exceeds that of the body",
    documentation: "\
## Physics
A body that accelerates carries surrounding air or water along: inertia without weight. For limbs in air 0.1-0.5 % of the mass, for a parachute tens of kilograms.

## Equation
`F = -m_a a` at a point of the link, a its acceleration: a point mass whose weight is taken back. Coefficient: `m_a` (kg, positive); nonlinear: the point, within 0.3 m of the link's centre of mass (on a longer link up to its ends).

## Identifiability
The inertia is absorbed by the inertial parameters; what remains is the missing weight, an upward force at the point: close to a smaller gravity unless the point is far from the centre of mass.

## References
Lamb, Hydrodynamics (1932), ch. 6; own simulations.
",
    ..About::PLAIN
};

pub(super) struct AddedMass;

impl Effect for AddedMass {
    fn about(&self) -> About<'_> {
        ABOUT
    }
    fn added_inertia_kg(&self, coefficients: &[f64]) -> f64 {
        coefficients.first().copied().unwrap_or(0.0)
    }
    fn targets(&self, scene: &Scene) -> Vec<Target> {
        Target::links(scene)
    }
    fn coefficients(&self, _: &Scene, _: Target) -> Vec<Coefficient> {
        vec![Coefficient::positive("added_mass", "kg")]
    }
    fn nonlinear(&self, scene: &Scene, target: Target) -> Vec<NonlinearParameter> {
        NonlinearParameter::point_of(scene, target)
    }
    fn starts(&self, scene: &Scene, target: Target) -> Vec<Vec<f64>> {
        scene.places_on(target).iter().map(|place| place.as_slice().to_vec()).collect()
    }
    fn evaluate(&self, series: &Series<'_>, target: Target, nonlinear: &[f64], out: &mut Columns) {
        let point_m = Values::new(nonlinear).vector();
        for (i, f) in series.instants() {
            let point = f.links[target.link()].point(&point_m);
            out.force_at(i, 0, &-f.scene.model.gravity_mps2, &point);
        }
    }
    fn inertia(&self, scene: &Scene, target: Target, nonlinear: &[f64]) -> Option<Vec<Vec<Phi>>> {
        Some(vec![scene.unit_mass_at(target.link(), &Values::new(nonlinear).vector())])
    }
}
