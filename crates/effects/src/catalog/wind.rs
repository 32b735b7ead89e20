//! Air that moves.

use super::quadratic_drag::drag;
use crate::link_resistance::{centre_starts, centres, centres_of, one_or_each};
use crate::{About, Coefficient, Columns, Effect, NonlinearParameter, Scene, Separation, Series, Target, Values};

const ABOUT: About<'static> = About {
    id: "wind",
    title: "steady wind, with quadratic drag",
    contains: &["quadratic_drag"],
    becomes: &["constant_force"],
    separated_by: Separation::WithAndAgainst,
    unbounded: "an area is not negative, and clothing or a parachute make it any size",
    documentation: "\
## Physics
Air that streams past (a fan, ventilation, an open door) drags the body along: quadratic drag with the velocity of the air taken off.

## Equation
`F_i = -1/2 rho C_dA s_i |v_i - w| (v_i - w)`, w constant in the world. Coefficient: the drag area `C_dA` (m2, positive); nonlinear: `w` (m/s, up to 15 each way). \
With few links each has its own area and centre, as in still air.

## Identifiability
A body that is slow against the wind feels a constant force: then wind is an exact alias of a tilt of gravity and of a constant force. \
It contains quadratic drag in still air. Throws with and against the wind at several speeds separate it. \
A drag that acts a time T late looks in free flight like a wind g T straight down; only turning of the body tells the two apart.

## References
Hoerner, Fluid-Dynamic Drag (1965); own simulations.
",
    ..About::PLAIN
};

pub(super) struct Wind;

impl Effect for Wind {
    fn about(&self) -> About<'_> {
        ABOUT
    }
    fn targets(&self, scene: &Scene) -> Vec<Target> {
        Target::body_or_links(scene)
    }
    fn coefficients(&self, scene: &Scene, target: Target) -> Vec<Coefficient> {
        one_or_each(scene, target, "drag_area", "m^2")
    }
    fn nonlinear(&self, scene: &Scene, target: Target) -> Vec<NonlinearParameter> {
        let mut out = NonlinearParameter::vector_in_world("wind", "m/s", 15.0, 0.3);
        out.extend(centres(scene, target));
        out
    }
    fn starts(&self, scene: &Scene, target: Target) -> Vec<Vec<f64>> {
        let mut winds = vec![[0.0; 3]];
        for speed in [1.5, 5.0] {
            for k in 0..8 {
                let (sin, cos) = (std::f64::consts::FRAC_PI_4 * f64::from(k)).sin_cos();
                winds.push([speed * cos, speed * sin, 0.0]);
            }
        }
        let centres = centre_starts(scene, target);
        winds.iter().map(|w| [w.as_slice(), centres.as_slice()].concat()).collect()
    }
    fn evaluate(&self, series: &Series<'_>, target: Target, nonlinear: &[f64], out: &mut Columns) {
        let mut values = Values::new(nonlinear);
        let wind_mps = values.vector();
        let centres_m = centres_of(series.scene, values.rest());
        for (i, f) in series.instants() {
            drag(&f, target, &wind_mps, &centres_m, out, i);
        }
    }
}
