//! An elastic line to a fixed point of the room.

use super::constant_force;
use crate::definition::{
    self as def, ActsIn, Coefficient, EffectDefinition, EffectKind, NonlinearParameter, Target, WrenchLaw,
};
use crate::{Columns, EffectFrame, Scene};
use nalgebra::Vector3;

pub(super) static EFFECT: EffectDefinition = EffectDefinition {
    id: "tether",
    title: "tether or bungee",
    kind: EffectKind::Physics,
    acts: ActsIn::Both,
    class: "",
    contains: &[],
    by_group: false,
    unbounded: "a stiffness is not negative and has no largest value; a damping of zero has to be found as zero from both sides",
    targets: def::links,
    coefficients,
    nonlinear,
    starts,
    wrench: Some(WrenchLaw::Frame(law)),
    inertia: None,
    documentation: "\
## Physics
An elastic line, safety rope or cable runs from a point of a link to an anchor in the room. It pulls towards the anchor when stretched and does nothing when slack.

## Equation
`F = (k (d - l0) + c d_dot) u` for d > l0, else zero; d the distance and u the direction to the anchor. Coefficients: stiffness `k` (N/m, positive), damping `c` (N s/m). \
Nonlinear: anchor (m), rest length `l0` (m, zero or more), attachment within 0.3 m of the link's centre of mass.

## Identifiability
Visible to 90-99 %. Anchor and rest length trade off along the line while the stiffness stays good; a slack tether shows nothing. A short stiff one is told from drag (0.8) and gravity (0.9-0.97) \
by flights in several places. A very distant anchor makes it a constant force.

## References
Own simulations (`docs/findings/labs.md`).
",
};

fn coefficients(_: &Scene, _: Target) -> Vec<Coefficient> {
    vec![Coefficient::positive("stiffness", "N/m"), Coefficient::free("damping", "N*s/m")]
}

fn nonlinear(scene: &Scene, target: Target) -> Vec<NonlinearParameter> {
    let c = scene.volume_center_m;
    let mut out = NonlinearParameter::point("anchor", [c.x, c.y, c.z], 8.0);
    out.push(NonlinearParameter::new("rest_length", "m", 0.0, 8.0, 0.1));
    out.extend(constant_force::nonlinear(scene, target));
    out
}

/// Anchors around the volume, at several heights and distances, slack and not.
pub(super) fn anchors(scene: &Scene) -> Vec<Vector3<f64>> {
    let c = scene.volume_center_m;
    let mut out = vec![c + Vector3::z() * 2.0, c + Vector3::z() * 0.8, c - Vector3::z() * 1.0];
    for distance in [1.0, 2.5] {
        for k in 0..8 {
            let (sin, cos) = (std::f64::consts::FRAC_PI_4 * k as f64).sin_cos();
            for height in [-0.4, 0.5] {
                out.push(c + Vector3::new(cos, sin, height) * distance);
            }
        }
    }
    out
}

fn starts(scene: &Scene, target: Target) -> Vec<Vec<f64>> {
    let point = &constant_force::starts(scene, target)[0];
    anchors(scene)
        .iter()
        .flat_map(|a| {
            let mean = (a - scene.volume_center_m).norm();
            [0.0, 0.6 * mean, 0.95 * mean].map(|l0| vec![a.x, a.y, a.z, l0, point[0], point[1], point[2]])
        })
        .collect()
}

fn law(f: &EffectFrame<'_>, target: Target, p: &[f64], out: &mut Columns, i: usize) {
    let point = Vector3::new(p[4], p[5], p[6]);
    let link = &f.links[def::link_of(target)];
    let at = link.point(&point);
    let line = Vector3::new(p[0], p[1], p[2]) - at;
    let distance = line.norm();
    let stretch = distance - p[3].max(0.0);
    if stretch <= 0.0 || distance < 1e-9 {
        return;
    }
    let u = line / distance;
    let lengthening = -u.dot(&link.point_velocity(&point));
    out.force_at(i, 0, &(u * stretch), &at);
    out.force_at(i, 1, &(u * lengthening), &at);
}
