//! A line of constant tension over a pulley: body-weight support.

use super::{constant_force, tether};
use crate::definition::{
    self as def, ActsIn, Coefficient, EffectDefinition, EffectKind, NonlinearParameter, Target, WrenchLaw,
};
use crate::{Columns, EffectFrame, Scene};
use nalgebra::Vector3;

pub(super) static EFFECT: EffectDefinition = EffectDefinition {
    id: "crane",
    title: "crane or harness of constant tension",
    kind: EffectKind::Physics,
    acts: ActsIn::Both,
    class: "",
    contains: &[],
    by_group: false,
    unbounded: "a rope pulls and never pushes; its tension follows from the counterweight",
    targets: def::links,
    coefficients,
    nonlinear,
    starts,
    wrench: Some(WrenchLaw::Frame(law)),
    inertia: None,
    documentation: "\
## Physics
A harness hangs on a rope that a counterweight or a motor keeps at constant tension; the rope runs over a pulley in the room.

## Equation
`F = T u`, u the direction from the point of the link to the pulley. Coefficient: tension `T` (N, positive). Nonlinear: pulley (m), attachment within 0.3 m of the link's centre of mass.

## Identifiability
A distant pulley makes it a constant force (overhead: close to a change of gravity's magnitude). Moving sideways under the pulley turns the force and separates them.

## References
Own simulations (`docs/findings/labs.md`).
",
};

fn coefficients(_: &Scene, _: Target) -> Vec<Coefficient> {
    vec![Coefficient::positive("tension", "N")]
}

fn nonlinear(scene: &Scene, target: Target) -> Vec<NonlinearParameter> {
    let c = scene.volume_center_m;
    let mut out = NonlinearParameter::point("pulley", [c.x, c.y, c.z], 8.0);
    out.extend(constant_force::nonlinear(scene, target));
    out
}

fn starts(scene: &Scene, target: Target) -> Vec<Vec<f64>> {
    let point = &constant_force::starts(scene, target)[0];
    tether::anchors(scene).iter().map(|a| vec![a.x, a.y, a.z, point[0], point[1], point[2]]).collect()
}

fn law(f: &EffectFrame<'_>, target: Target, p: &[f64], out: &mut Columns, i: usize) {
    let at = f.links[def::link_of(target)].point(&Vector3::new(p[3], p[4], p[5]));
    let line = Vector3::new(p[0], p[1], p[2]) - at;
    out.force_at(i, 0, &(line / line.norm().max(1e-9)), &at);
}
