//! Air resistance that grows with the square of the speed.

use crate::link_resistance::{centre_starts, centres, centres_of, one_or_each, resist};
use crate::scene::AIR_DENSITY_KGPM3;
use crate::{About, Coefficient, Columns, Effect, EffectFrame, NonlinearParameter, Scene, Series, Target};
use nalgebra::Vector3;

const ABOUT: About<'static> = About {
    id: "quadratic_drag",
    title: "air resistance, quadratic in speed",
    told_from: &[("linear_drag", "throws or jumps at speeds that differ threefold")],
    unbounded: "an area is not negative, and clothing or a parachute make it any size; entries of the matrices of a shape have either sign",
    documentation: "\
## Physics
A body that moves through still air pushes it aside: the drag on each link opposes the velocity of its centre and grows with the square of the speed. \
It always takes energy from the body. A 1 kg object at 5 m/s feels 0.2-0.7 N; a jumping person 0.5-3 N.

## Equation
`F_i = -1/2 rho C_dA s_i |v_i| v_i` at the centre of mass of link i, rho = 1.2 kg/m3, s_i the link's share of the mean area shown to the air \
(ellipsoids of the same inertia). Coefficient: the drag area `C_dA` in m2, positive; with few links one area a link may be fitted instead, \
each at a centre of its own (nonlinear, within 0.3 m of the link's centre of mass).

A link that is not round has direction-dependent drag, and a body that turns in a fluid carries some of it along. With few links the target `shape` fits, for each link and in its axes (u the velocity of its centre, w its angular velocity, S_ij the symmetric matrices of unit entries): `f = -1/2 rho |u| A u - 1/2 rho (u'B u / |u|) u + (M u) x w`, `n = (M u) x u - |w| T w` about the centre, with A = sum a_ij S_ij and so on. Coefficients: `area_ij` (m2, by direction of the force) and `breadth_ij` (m2, by direction of motion; its last entry is one with `area`), `carried_ij` (kg), `turning_ij` (N m s2/rad2).

## Identifiability
Visible to 90-99 % beside the inertial parameters. Linear drag looks alike (cosine 0.97) unless speeds span 3:1; a tether to 0.8; wind contains it. \
Throws at two speeds tell drag from all of them. In ordinary jumps it is near the limit of one session.

## References
Hoerner, Fluid-Dynamic Drag (1965), ch. 3; Todorov, Erez, Tassa, MuJoCo (2012), documentation, chapter Computation, fluid forces on an inertia box; own simulations (`docs/findings/labs.md`).
",
    ..About::PLAIN
};

/// Entries of a symmetric matrix: row, column, name.
const ENTRIES: [(usize, usize, &str); 6] =
    [(0, 0, "xx"), (1, 1, "yy"), (0, 1, "xy"), (0, 2, "xz"), (1, 2, "yz"), (2, 2, "zz")];
/// Columns of a link's shape: six areas, then (from this index) five breadths, six coefficients of
/// entrained fluid, six of resistance to rotation.
const BREADTH: usize = 6;
const CARRIED: usize = 11;
const TURNING: usize = 17;
const PER_LINK: usize = 23;

pub(super) struct QuadraticDrag;

impl Effect for QuadraticDrag {
    fn about(&self) -> About<'_> {
        ABOUT
    }
    fn targets(&self, scene: &Scene) -> Vec<Target> {
        Target::body_links_or_shape(scene)
    }
    fn coefficients(&self, scene: &Scene, target: Target) -> Vec<Coefficient> {
        if target != Target::Shape {
            return one_or_each(scene, target, "drag_area", "m^2");
        }
        let of_link = |l: &aloft_body::Link| {
            let of = |what: &str, unit: &str, n: usize| -> Vec<Coefficient> {
                ENTRIES[..n].iter().map(|e| Coefficient::free(format!("{what}_{}_{}", l.name, e.2), unit)).collect()
            };
            [
                of("area", "m^2", BREADTH),
                of("breadth", "m^2", CARRIED - BREADTH),
                of("carried", "kg", TURNING - CARRIED),
                of("turning", "N*m*s^2/rad^2", PER_LINK - TURNING),
            ]
            .concat()
        };
        scene.model.links.iter().flat_map(of_link).collect()
    }
    fn nonlinear(&self, scene: &Scene, target: Target) -> Vec<NonlinearParameter> {
        centres(scene, target)
    }
    fn starts(&self, scene: &Scene, target: Target) -> Vec<Vec<f64>> {
        vec![centre_starts(scene, target)]
    }
    fn evaluate(&self, series: &Series<'_>, target: Target, nonlinear: &[f64], out: &mut Columns) {
        let centres_m = centres_of(series.scene, nonlinear);
        for (i, f) in series.instants() {
            match target {
                Target::Shape => shape(&f, &centres_m, out, i),
                _ => drag(&f, target, &Vector3::zeros(), &centres_m, out, i),
            }
        }
    }
}

/// Drag on every link for a given velocity of the air, with one column for all links or one per
/// link.
pub(super) fn drag(
    f: &EffectFrame<'_>,
    target: Target,
    air_mps: &Vector3<f64>,
    centres_m: &[Vector3<f64>],
    out: &mut Columns,
    i: usize,
) {
    let law = |velocity_mps: Vector3<f64>| {
        let u = velocity_mps - air_mps;
        u * (-0.5 * AIR_DENSITY_KGPM3 * u.norm())
    };
    resist(f, target, centres_m, law, out, i);
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

/// Drag, lift and entrained fluid of links of any shape.
fn shape(f: &EffectFrame<'_>, centres_m: &[Vector3<f64>], out: &mut Columns, i: usize) {
    for (link, (here, centre)) in f.links.iter().zip(centres_m).enumerate() {
        let (at, first) = (here.point(centre), PER_LINK * link);
        let u = here.rotation.tr_mul(&here.point_velocity(centre));
        let w = here.rotation.tr_mul(&here.omega);
        let (speed, spin) = (u.norm(), w.norm());
        let direction = u / speed.max(1e-9);
        for (k, &e) in ENTRIES.iter().enumerate() {
            let pressed = times(e, &u);
            let mut force = |column: usize, own: Vector3<f64>| {
                out.force_at(i, first + column, &(here.rotation * own), &at);
            };
            force(k, pressed * (-0.5 * AIR_DENSITY_KGPM3 * speed));
            if BREADTH + k < CARRIED {
                force(BREADTH + k, u * (-0.5 * AIR_DENSITY_KGPM3 * direction.dot(&pressed)));
            }
            force(CARRIED + k, pressed.cross(&w));
            out.couple(i, first + CARRIED + k, &(here.rotation * pressed.cross(&u)));
            out.couple(i, first + TURNING + k, &(here.rotation * (times(e, &w) * -spin)));
        }
    }
}
