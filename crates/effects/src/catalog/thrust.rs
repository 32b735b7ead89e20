//! A force that turns with a link: jet, propeller, thruster.

use crate::definition::{self as def, ActsIn, Coefficient, EffectDefinition, EffectKind, Target, WrenchLaw};
use crate::{Columns, EffectFrame, Scene};
use nalgebra::Vector3;

pub(super) static EFFECT: EffectDefinition = EffectDefinition {
    id: "thrust",
    title: "thrust fixed in a link",
    kind: EffectKind::Physics,
    acts: ActsIn::Both,
    class: "",
    contains: &[],
    by_group: false,
    unbounded: "a jet may push with any force along any line",
    targets: def::links,
    coefficients,
    nonlinear: def::none,
    starts: def::one_start,
    wrench: Some(WrenchLaw::Frame(law)),
    inertia: None,
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
};

fn coefficients(_: &Scene, _: Target) -> Vec<Coefficient> {
    let mut out = Coefficient::vector("force", "N");
    out.extend(Coefficient::vector("moment", "N*m"));
    out
}

fn law(f: &EffectFrame<'_>, target: Target, _: &[f64], out: &mut Columns, i: usize) {
    let index = def::link_of(target);
    let link = &f.links[index];
    let point = link.point(&f.scene.link_com_m[index]);
    for k in 0..3 {
        let axis: Vector3<f64> = link.rotation.column(k).into_owned();
        out.force_at(i, k, &axis, &point);
        out.couple(i, 3 + k, &axis);
    }
}
