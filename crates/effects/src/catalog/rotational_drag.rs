//! Resistance against turning.

use crate::link_resistance::one_or_each;
use crate::{About, Coefficient, Columns, Effect, Scene, Series, Target};

const ABOUT: About<'static> = About {
    id: "rotational_drag",
    title: "resistance against turning",
    unbounded: "a resistance is not negative; how large it is depends on the fluid",
    documentation: "\
## Physics
Air (or a fluid) resists the turning of each link by a moment against its angular velocity; no force comes with it.

## Equation
`N_i = -c w_i`, w_i the angular velocity of link i in the world. Coefficient: `c` in N m s/rad, the same for all links (with few links one a link may be fitted), positive.

## Identifiability
34 % is taken by inertia errors in a human jump, little in a tumbling chain. The moment follows the angular velocity and decays it: long flights with spin show it.

## References
Lamb, Hydrodynamics (1932), s. 334; own simulations.
",
    ..About::PLAIN
};

pub(super) struct RotationalDrag;

impl Effect for RotationalDrag {
    fn about(&self) -> About<'_> {
        ABOUT
    }
    fn targets(&self, scene: &Scene) -> Vec<Target> {
        Target::body_or_links(scene)
    }
    fn coefficients(&self, scene: &Scene, target: Target) -> Vec<Coefficient> {
        one_or_each(scene, target, "rotational_resistance", "N*m*s/rad")
    }
    fn evaluate(&self, series: &Series<'_>, target: Target, _: &[f64], out: &mut Columns) {
        for (i, f) in series.instants() {
            for (link, here) in f.links.iter().enumerate() {
                let column = if target == Target::EveryLink { link } else { 0 };
                out.couple(i, column, &-here.omega);
            }
        }
    }
}
