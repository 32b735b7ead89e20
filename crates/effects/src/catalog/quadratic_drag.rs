//! Air resistance that grows with the square of the speed.

use crate::definition::{
    self as def, ActsIn, Coefficient, EffectDefinition, EffectKind, NonlinearParameter, Target, WrenchLaw,
};
use crate::scene::AIR_DENSITY_KGPM3;
use crate::{Columns, EffectFrame, Scene};
use nalgebra::Vector3;

pub(super) static EFFECT: EffectDefinition = EffectDefinition {
    id: "quadratic_drag",
    title: "air resistance, quadratic in speed",
    kind: EffectKind::Physics,
    acts: ActsIn::Both,
    class: "",
    contains: &[],
    by_group: false,
    targets: def::body_or_links,
    coefficients,
    nonlinear: centres,
    starts: centre_starts,
    wrench: Some(WrenchLaw::Frame(law)),
    inertia: None,
    documentation: "\
## Physics
A body that moves through still air pushes it aside: the drag on each link opposes the velocity of its centre and grows with the square of the speed. \
It always takes energy from the body. A 1 kg object at 5 m/s feels 0.2-0.7 N; a jumping person 0.5-3 N.

## Equation
`F_i = -1/2 rho C_dA s_i |v_i| v_i` at the centre of mass of link i, rho = 1.2 kg/m3, s_i the link's share of the mean area shown to the air \
(ellipsoids of the same inertia). Coefficient: the drag area `C_dA` in m2, positive; with few links one area a link may be fitted instead, \
each at a centre of its own (nonlinear, within 0.3 m of the link's centre of mass).

## Identifiability
Visible to 90-99 % beside the inertial parameters. Linear drag looks alike (cosine 0.97) unless speeds span 3:1; a tether to 0.8; wind contains it. \
Throws at two speeds tell drag from all of them. In ordinary jumps it is near the limit of one session.

## References
Hoerner, Fluid-Dynamic Drag (1965), ch. 3; own simulations, facts on effects.
",
};

fn coefficients(scene: &Scene, target: Target) -> Vec<Coefficient> {
    match target {
        Target::EveryLink => {
            scene.model.links.iter().map(|l| Coefficient::positive(format!("drag_area_{}", l.name), "m^2")).collect()
        }
        _ => vec![Coefficient::positive("drag_area", "m^2")],
    }
}

/// Centres of the links' areas, where each link has its own.
pub(super) fn centres(scene: &Scene, target: Target) -> Vec<NonlinearParameter> {
    if target != Target::EveryLink {
        return Vec::new();
    }
    let of = |(link, com): (&aloft_body::Link, &Vector3<f64>)| {
        NonlinearParameter::point(&format!("centre_{}", link.name), [com.x, com.y, com.z], 0.3)
    };
    scene.model.links.iter().zip(&scene.link_com_m).flat_map(of).collect()
}

/// The links' centres of mass.
pub(super) fn centre_starts(scene: &Scene, target: Target) -> Vec<Vec<f64>> {
    let coms = || scene.link_com_m.iter().flat_map(|c| [c.x, c.y, c.z]).collect();
    vec![if target == Target::EveryLink { coms() } else { Vec::new() }]
}

/// Centre of a link's area: given, or its centre of mass.
pub(super) fn centre(f: &EffectFrame<'_>, link: usize, p: &[f64]) -> Vector3<f64> {
    match p.get(3 * link..3 * link + 3) {
        Some(c) => Vector3::new(c[0], c[1], c[2]),
        None => f.scene.link_com_m[link],
    }
}

/// Drag on every link for one velocity of the air, a column for all or one a link.
pub(super) fn drag(f: &EffectFrame<'_>, target: Target, air: &Vector3<f64>, p: &[f64], out: &mut Columns, i: usize) {
    for (link, here) in f.links.iter().enumerate() {
        let centre = centre(f, link, p);
        let u = here.point_velocity(&centre) - air;
        let unit = u * (-0.5 * AIR_DENSITY_KGPM3 * u.norm());
        match target {
            Target::EveryLink => out.force_at(i, link, &unit, &here.point(&centre)),
            _ => out.force_at(i, 0, &(unit * f.scene.area_share[link]), &here.point(&centre)),
        }
    }
}

fn law(f: &EffectFrame<'_>, target: Target, p: &[f64], out: &mut Columns, i: usize) {
    drag(f, target, &Vector3::zeros(), p, out, i);
}
