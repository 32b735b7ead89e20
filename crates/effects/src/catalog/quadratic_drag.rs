//! Air resistance that grows with the square of the speed.

use crate::definition::{self as def, ActsIn, Coefficient, EffectDefinition, EffectKind, Target, WrenchLaw};
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
    nonlinear: def::none,
    starts: def::one_start,
    wrench: Some(WrenchLaw::Frame(law)),
    inertia: None,
    documentation: "\
## Physics
A body that moves through still air pushes it aside: the drag on each link opposes the velocity of its centre and grows with the square of the speed. \
It always takes energy from the body. A 1 kg object at 5 m/s feels 0.2-0.7 N; a jumping person 0.5-3 N.

## Equation
`F_i = -1/2 rho C_dA s_i |v_i| v_i` at the centre of mass of link i, rho = 1.2 kg/m3, s_i the link's share of the mean area shown to the air \
(ellipsoids of the same inertia). Coefficient: the drag area `C_dA` in m2, positive; with few links one area a link may be fitted instead.

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

/// Drag on every link for one velocity of the air, a column for all or one a link.
pub(super) fn drag(f: &EffectFrame<'_>, target: Target, air: &Vector3<f64>, out: &mut Columns, i: usize) {
    for (link, (here, com)) in f.links.iter().zip(&f.scene.link_com_m).enumerate() {
        let u = here.point_velocity(com) - air;
        let unit = u * (-0.5 * AIR_DENSITY_KGPM3 * u.norm());
        match target {
            Target::EveryLink => out.force_at(i, link, &unit, &here.point(com)),
            _ => out.force_at(i, 0, &(unit * f.scene.area_share[link]), &here.point(com)),
        }
    }
}

fn law(f: &EffectFrame<'_>, target: Target, _: &[f64], out: &mut Columns, i: usize) {
    drag(f, target, &Vector3::zeros(), out, i);
}
