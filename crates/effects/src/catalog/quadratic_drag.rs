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
    unbounded: "an area is not negative, and clothing or a parachute make it any size; entries of the matrices of a shape have either sign",
    targets: def::body_links_or_shape,
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

A link that is not round meets the air differently on each side, and a body that turns in a fluid carries some of it along. With few links the target `shape` fits, for each link and in its axes (u the velocity of its centre, w its angular velocity, S_ij the symmetric matrices of unit entries): `f = -1/2 rho |u| A u - 1/2 rho (u'B u / |u|) u + (M u) x w`, `n = (M u) x u - |w| T w` about the centre, with A = sum a_ij S_ij and so on. Coefficients: `area_ij` (m2, by direction of the force) and `breadth_ij` (m2, by direction of motion; its last entry is one with `area`), `carried_ij` (kg), `turning_ij` (N m s2/rad2).

## Identifiability
Visible to 90-99 % beside the inertial parameters. Linear drag looks alike (cosine 0.97) unless speeds span 3:1; a tether to 0.8; wind contains it. \
Throws at two speeds tell drag from all of them. In ordinary jumps it is near the limit of one session.

## References
Hoerner, Fluid-Dynamic Drag (1965), ch. 3; Todorov, Erez, Tassa, MuJoCo (2012), documentation, chapter Computation, fluid forces on an inertia box; own simulations (`docs/findings/labs.md`).
",
};

fn coefficients(scene: &Scene, target: Target) -> Vec<Coefficient> {
    let links = || scene.model.links.iter().map(|l| &l.name);
    match target {
        Target::EveryLink => links().map(|l| Coefficient::positive(format!("drag_area_{l}"), "m^2")).collect(),
        Target::Shape => links()
            .flat_map(|l| {
                let of = move |what: &str, unit: &str, n: usize| -> Vec<Coefficient> {
                    ENTRIES[..n].iter().map(|e| Coefficient::free(format!("{what}_{l}_{}", e.2), unit)).collect()
                };
                [
                    of("area", "m^2", 6),
                    of("breadth", "m^2", 5),
                    of("carried", "kg", 6),
                    of("turning", "N*m*s^2/rad^2", 6),
                ]
                .concat()
            })
            .collect(),
        _ => vec![Coefficient::positive("drag_area", "m^2")],
    }
}

/// Entries of a symmetric matrix: row, column, name.
const ENTRIES: [(usize, usize, &str); 6] =
    [(0, 0, "xx"), (1, 1, "yy"), (0, 1, "xy"), (0, 2, "xz"), (1, 2, "yz"), (2, 2, "zz")];
/// Coefficients of a link's shape.
const PER_LINK: usize = 23;

/// Centres of the links' areas, where each link has its own.
pub(super) fn centres(scene: &Scene, target: Target) -> Vec<NonlinearParameter> {
    if !matches!(target, Target::EveryLink | Target::Shape) {
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
    vec![if matches!(target, Target::EveryLink | Target::Shape) { coms() } else { Vec::new() }]
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

/// `S v` for the symmetric matrix of unit entries `e`.
fn times(e: (usize, usize, &str), v: &Vector3<f64>) -> Vector3<f64> {
    let mut out = Vector3::zeros();
    out[e.0] += v[e.1];
    if e.0 != e.1 {
        out[e.1] += v[e.0];
    }
    out
}

/// Drag, lift and carried fluid of links of any shape.
fn shape(f: &EffectFrame<'_>, p: &[f64], out: &mut Columns, i: usize) {
    for (link, here) in f.links.iter().enumerate() {
        let centre = centre(f, link, p);
        let (at, first) = (here.point(&centre), PER_LINK * link);
        let u = here.rotation.tr_mul(&here.point_velocity(&centre));
        let w = here.rotation.tr_mul(&here.omega);
        let (speed, spin) = (u.norm(), w.norm());
        let direction = u / speed.max(1e-9);
        for (k, &e) in ENTRIES.iter().enumerate() {
            let pressed = times(e, &u);
            let mut force = |column: usize, own: Vector3<f64>| {
                out.force_at(i, first + column, &(here.rotation * own), &at);
            };
            force(k, pressed * (-0.5 * AIR_DENSITY_KGPM3 * speed));
            if k < 5 {
                force(6 + k, u * (-0.5 * AIR_DENSITY_KGPM3 * direction.dot(&pressed)));
            }
            force(11 + k, pressed.cross(&w));
            out.couple(i, first + 11 + k, &(here.rotation * pressed.cross(&u)));
            out.couple(i, first + 17 + k, &(here.rotation * (times(e, &w) * -spin)));
        }
    }
}

fn law(f: &EffectFrame<'_>, target: Target, p: &[f64], out: &mut Columns, i: usize) {
    if target == Target::Shape {
        return shape(f, p, out, i);
    }
    drag(f, target, &Vector3::zeros(), p, out, i);
}
