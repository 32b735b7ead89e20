//! A force that keeps its direction in the room.

use crate::definition::{
    self as def, ActsIn, Coefficient, EffectDefinition, EffectKind, NonlinearParameter, Target, WrenchLaw,
};
use crate::{Columns, EffectFrame, Scene};
use nalgebra::Vector3;

pub(super) static EFFECT: EffectDefinition = EffectDefinition {
    id: "constant_force",
    title: "constant force at a point of a link",
    kind: EffectKind::Physics,
    acts: ActsIn::Both,
    class: "tilt of gravity, wind",
    contains: &[],
    by_group: false,
    unbounded: "a pull may have any size and direction",
    targets: def::links,
    coefficients,
    nonlinear,
    starts,
    wrench: Some(WrenchLaw::Frame(law)),
    inertia: None,
    documentation: "\
## Physics
Something pulls or pushes one point of the body with a force of constant size and direction in the room: a long rubber band, a weight over a distant pulley, a jet of air.

## Equation
`F = (F_x, F_y, F_z)` in the world at the point p of a link. Coefficients: the force in N; nonlinear: p, within 0.3 m of the link's centre of mass.

## Identifiability
Near the whole centre of mass it is an alias of a tilt (horizontal part) and of the magnitude (vertical part) of gravity; far from it the moment tells. \
p along the force is undetermined. A second orientation of the laboratory axes, or turning the subject, separates a pull from a tilt.

## References
Own simulations (`docs/findings/labs.md`).
",
};

fn coefficients(_: &Scene, _: Target) -> Vec<Coefficient> {
    Coefficient::vector("force", "N")
}

/// A point near the centre of mass of the target's link.
pub(super) fn nonlinear(scene: &Scene, target: Target) -> Vec<NonlinearParameter> {
    NonlinearParameter::point("point", starts(scene, target)[0].as_slice().try_into().unwrap_or([0.0; 3]), 0.3)
}

/// The centre of mass itself.
pub(super) fn starts(scene: &Scene, target: Target) -> Vec<Vec<f64>> {
    let com = scene.link_com_m.get(def::link_of(target)).copied().unwrap_or_else(Vector3::zeros);
    vec![com.as_slice().to_vec()]
}

fn law(f: &EffectFrame<'_>, target: Target, p: &[f64], out: &mut Columns, i: usize) {
    let point = f.links[def::link_of(target)].point(&Vector3::new(p[0], p[1], p[2]));
    for k in 0..3 {
        out.force_at(i, k, &def::axis(k), &point);
    }
}
