//! Flat plates in moving air.

use crate::scene::AIR_DENSITY_KGPM3;
use crate::{About, Coefficient, Columns, Effect, NonlinearParameter, Scene, Separation, Series, Target, Values};
use aloft_body::Link;
use nalgebra::Vector3;

const ABOUT: About<'static> = About {
    id: "panels",
    other_ids: &["flat_plates"],
    title: "flat plates in still or moving air",
    contains: &["quadratic_drag", "wind"],
    separated_by: Separation::WithAndAgainst,
    unbounded: "an area is not negative, and a sail or a wing makes it any size",
    documentation: "\
## Physics
A flat part (a solar panel, a wing, a paddle, a board, a skirt) is pushed along its normal: a smooth plate has negligible tangential force. \
Turning it edgewise to the flow makes the force vanish, which no drag of a round body does. Every link has one plate, and all are exposed to the same wind.

## Equation
With n the normal of the plate of link i, u the velocity of its middle relative to the air of velocity w, and rho = 1.2 kg/m3: \
`F_i = -1/2 rho (P_i |u'n| (u'n) n + L_i |u| (u'n) n + D_i |u| u)`. Coefficients in m2, not negative, for each link: `pressure` P (broadside flow), \
`lift` L (force of a thin plate at small angles, proportional to the angle) and `drag` D (the rest, as of a round body). Nonlinear: `wind` w (m/s, up to 15 each way); \
for each link the middle of the plate (m, within 0.3 m of the link's centre of mass) and its normal, given by two numbers a and b: \
`n = (2 a, 2 b, 1 - a^2 - b^2) / (1 + a^2 + b^2)` in the axes of the link (0, 0 is z; 1, 0 is x; 0, 1 is y). For bodies of two or three links.

## Identifiability
Told from drag and wind by throws that turn: the force follows the normal. `pressure` and `lift` differ at small angles of attack only. \
Without drag `wind` and plates in still air are told apart by throws with and against it.

## References
Hoerner, Fluid-Dynamic Drag (1965), ch. 3 and 7 (plates at an angle); own simulations.
",
    ..About::PLAIN
};

/// Columns of a plate: pressure, lift, drag.
const PER_LINK: usize = 3;

pub(super) struct Panels;

impl Effect for Panels {
    fn about(&self) -> About<'_> {
        ABOUT
    }
    fn targets(&self, scene: &Scene) -> Vec<Target> {
        Target::body_or_links(scene).into_iter().filter(|t| *t == Target::EveryLink).collect()
    }
    fn coefficients(&self, scene: &Scene, _: Target) -> Vec<Coefficient> {
        let of_link = |l: &Link| {
            ["pressure", "lift", "drag"].map(|what| Coefficient::positive(format!("{what}_{}", l.name), "m^2"))
        };
        scene.model.links.iter().flat_map(of_link).collect()
    }
    fn nonlinear(&self, scene: &Scene, _: Target) -> Vec<NonlinearParameter> {
        let mut out = NonlinearParameter::vector_in_world("wind", "m/s", 15.0, 0.3);
        for (link, com) in scene.model.links.iter().zip(&scene.link_com_m) {
            out.extend(NonlinearParameter::point_on_link(&format!("middle_{}", link.name), com, 0.3));
            let of = |axis: &str| NonlinearParameter::new(format!("normal_{}_{axis}", link.name), "1", -1.5, 1.5, 0.1);
            out.extend(["a", "b"].map(of));
        }
        out
    }
    fn starts(&self, scene: &Scene, _: Target) -> Vec<Vec<f64>> {
        const AXES: [[f64; 2]; 3] = [[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]];
        let mut winds = vec![[0.0; 3]];
        for k in 0..8 {
            let (sin, cos) = (std::f64::consts::FRAC_PI_4 * f64::from(k)).sin_cos();
            winds.push([1.5 * cos, 1.5 * sin, 0.0]);
        }
        let links = scene.link_com_m.len();
        let normals = AXES.len().pow(links as u32);
        let mut out = Vec::with_capacity(winds.len() * normals);
        for wind in winds {
            for choice in 0..normals {
                let mut start = wind.to_vec();
                for (link, com) in scene.link_com_m.iter().enumerate() {
                    start.extend(com.iter());
                    start.extend(AXES[choice / AXES.len().pow(link as u32) % AXES.len()]);
                }
                out.push(start);
            }
        }
        out
    }
    fn evaluate(&self, series: &Series<'_>, _: Target, nonlinear: &[f64], out: &mut Columns) {
        let mut values = Values::new(nonlinear);
        let wind_mps = values.vector();
        let plates: Vec<(Vector3<f64>, Vector3<f64>)> = (0..series.scene.link_com_m.len())
            .map(|_| {
                let middle_m = values.vector();
                (middle_m, normal(values.scalar(), values.scalar()))
            })
            .collect();
        for (i, f) in series.instants() {
            for (link, (here, (middle_m, own))) in f.links.iter().zip(&plates).enumerate() {
                let (at, n) = (here.point(middle_m), here.rotation * own);
                let u = here.point_velocity(middle_m) - wind_mps;
                let across = u.dot(&n);
                let half = -0.5 * AIR_DENSITY_KGPM3;
                let mut force = |column: usize, f: Vector3<f64>| out.force_at(i, PER_LINK * link + column, &f, &at);
                force(0, n * (half * across.abs() * across));
                force(1, n * (half * u.norm() * across));
                force(2, u * (half * u.norm()));
            }
        }
    }
}

/// Unit vector of the stereographic coordinates of its direction; n and −n are the same plate, so
/// that the half with `a² + b² <= 1` has all of them.
fn normal(a: f64, b: f64) -> Vector3<f64> {
    let square = a * a + b * b;
    Vector3::new(2.0 * a, 2.0 * b, 1.0 - square) / (1.0 + square)
}
