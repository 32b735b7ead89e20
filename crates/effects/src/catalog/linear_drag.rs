//! Resistance in proportion to the speed.

use crate::link_resistance::{centre_starts, centres, centres_of, one_or_each, resist};
use crate::{About, Coefficient, Columns, Effect, NonlinearParameter, Scene, Series, Target};

const ABOUT: About<'static> = About {
    id: "linear_drag",
    title: "resistance, linear in speed",
    unbounded: "a resistance is not negative; how large it is depends on the fluid or the brake",
    documentation: "\
## Physics
A viscous surrounding, a dragged cable or a brake resists in proportion to the velocity of each link. It always takes energy from the body.

## Equation
`F_i = -c s_i v_i` at the centre of mass of link i, s_i the link's share of the mean area. Coefficient: `c` in N s/m, positive; with few links one a link may be fitted, \
each at a centre of its own (nonlinear).

## Identifiability
Visible to 92-99 % beside the inertial parameters. Quadratic drag looks alike (cosine 0.97-0.98): only a range of speeds of 3:1 or more separates them.

## References
Batchelor, An Introduction to Fluid Dynamics (1967), s. 4.9; own simulations.
",
    ..About::PLAIN
};

pub(super) struct LinearDrag;

impl Effect for LinearDrag {
    fn about(&self) -> About<'_> {
        ABOUT
    }
    fn targets(&self, scene: &Scene) -> Vec<Target> {
        Target::body_or_links(scene)
    }
    fn coefficients(&self, scene: &Scene, target: Target) -> Vec<Coefficient> {
        one_or_each(scene, target, "resistance", "N*s/m")
    }
    fn nonlinear(&self, scene: &Scene, target: Target) -> Vec<NonlinearParameter> {
        centres(scene, target)
    }
    fn starts(&self, scene: &Scene, target: Target) -> Vec<Vec<f64>> {
        vec![centre_starts(scene, target)]
    }
    fn evaluate(&self, series: &Series<'_>, target: Target, nonlinear: &[f64], out: &mut Columns) {
        let centres_m = centres_of(series.scene, nonlinear);
        for (i, f) in series.instants() {
            resist(&f, target, &centres_m, |velocity_mps| -velocity_mps, out, i);
        }
    }
}
