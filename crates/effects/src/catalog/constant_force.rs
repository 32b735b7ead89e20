//! A force that keeps its direction in the room.

use crate::columns::axis;
use crate::{About, Coefficient, Columns, Effect, NonlinearParameter, Scene, Separation, Series, Target, Values};

const ABOUT: About<'static> = About {
    id: "constant_force",
    title: "constant force at a point of a link",
    class: "tilt of gravity, wind",
    separated_by: Separation::OtherPlaces,
    unbounded: "a pull may have any size and direction",
    documentation: "\
## Physics
Something pulls or pushes one point of the body with a force of constant size and direction in the room: a long rubber band, a weight over a distant pulley, a jet of air.

## Equation
`F = (F_x, F_y, F_z)` in the world at the point p of a link. Coefficients: the force in N; nonlinear: p, within 0.3 m of the link's centre of mass (on a longer link up to its ends).

## Identifiability
Near the whole centre of mass it is an alias of a tilt (horizontal part) and of the magnitude (vertical part) of gravity; far from it the moment tells. \
p along the force is undetermined. A second orientation of the laboratory axes, or turning the subject, separates a pull from a tilt.

## References
Own simulations (`docs/findings/labs.md`).
",
    ..About::PLAIN
};

pub(super) struct ConstantForce;

impl Effect for ConstantForce {
    fn about(&self) -> About<'_> {
        ABOUT
    }
    fn targets(&self, scene: &Scene) -> Vec<Target> {
        Target::links(scene)
    }
    fn coefficients(&self, _: &Scene, _: Target) -> Vec<Coefficient> {
        Coefficient::vector_in_world("force", "N", f64::INFINITY)
    }
    fn nonlinear(&self, scene: &Scene, target: Target) -> Vec<NonlinearParameter> {
        NonlinearParameter::point_of(scene, target)
    }
    fn starts(&self, scene: &Scene, target: Target) -> Vec<Vec<f64>> {
        vec![scene.com_of(target).as_slice().to_vec()]
    }
    fn evaluate(&self, series: &Series<'_>, target: Target, nonlinear: &[f64], out: &mut Columns) {
        let point_m = Values::new(nonlinear).vector();
        for (i, f) in series.instants() {
            let point = f.links[target.link()].point(&point_m);
            for k in 0..3 {
                out.force_at(i, k, &axis(k), &point);
            }
        }
    }
}
