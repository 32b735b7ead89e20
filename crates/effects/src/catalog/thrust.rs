//! A force that turns with a link: jet, propeller, thruster.

use crate::{About, Coefficient, Columns, Effect, Scene, Series, Target};
use nalgebra::Vector3;

const ABOUT: About<'static> = About {
    id: "thrust",
    title: "thrust fixed in a link",
    accompanying: &["moment"],
    unbounded: "a jet may push with any force along any line",
    documentation: "\
## Physics
A jet, a propeller or a thruster pushes with constant force along a direction fixed in a link, along a line anywhere in the link.

## Equation
`F = R f`, `N = R n` about the link's centre of mass. Coefficients: `f` (N) and `n` (N m) in link axes; for a pure force n = p x f gives its line.

## Identifiability
28-55 % is taken by the inertial parameters (a force in a spinning link looks like a shifted centre of mass). Tumbling about several axes turns it through the room and separates it from a constant force.

## References
Own simulations (`docs/findings/labs.md`).
",
    ..About::PLAIN
};

/// First columns of the force and of the moment.
const FORCE: usize = 0;
const MOMENT: usize = 3;

pub(super) struct Thrust;

impl Effect for Thrust {
    fn about(&self) -> About<'_> {
        ABOUT
    }
    fn targets(&self, scene: &Scene) -> Vec<Target> {
        Target::links(scene)
    }
    fn coefficients(&self, _: &Scene, _: Target) -> Vec<Coefficient> {
        let mut out = Coefficient::vector_on_link("force", "N", f64::INFINITY);
        out.extend(Coefficient::vector_on_link("moment", "N*m", f64::INFINITY));
        out
    }
    fn evaluate(&self, series: &Series<'_>, target: Target, _: &[f64], out: &mut Columns) {
        let index = target.link();
        for (i, f) in series.instants() {
            let link = &f.links[index];
            let point = link.point(&f.scene.link_com_m[index]);
            for k in 0..3 {
                let axis: Vector3<f64> = link.rotation.column(k).into_owned();
                out.force_at(i, FORCE + k, &axis, &point);
                out.couple(i, MOMENT + k, &axis);
            }
        }
    }
}
