//! Collision geometry of a model file as spheres that enclose it. Meshes are not read.

use aloft_body::subject::LinkBox;
use nalgebra::{Isometry3, Point3, Vector3};
use serde::{Deserialize, Serialize};

/// Most spheres along one side of a shape.
const MOST: usize = 6;

/// A shape of collision, in its own axes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Solid {
    /// Half the lengths of the sides, m.
    Box(Vector3<f64>),
    /// Radius, m.
    Sphere(f64),
    /// Along z, without caps: radius and half the length, m.
    Cylinder(f64, f64),
    /// Along z, with half spheres at both ends: radius and half the length between their centres,
    /// m.
    Capsule(f64, f64),
    /// Half the axes, m.
    Ellipsoid(Vector3<f64>),
}

/// A shape on a link of the file.
#[derive(Debug, Clone)]
pub(crate) struct Shape {
    pub link: String,
    pub pose: Isometry3<f64>,
    /// None for a mesh.
    pub solid: Option<Solid>,
}

/// Spheres that enclose the collision geometry of one link, in its frame.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct LinkSpheres {
    /// Link of the model.
    pub link: String,
    /// Centres and radii, m.
    pub spheres: Vec<([f64; 3], f64)>,
}

impl Solid {
    /// The box along the axes of the link that encloses the shape at a pose.
    fn enclosed(&self, pose: &Isometry3<f64>) -> LinkBox {
        let turn = pose.rotation.to_rotation_matrix();
        let reach = Vector3::from_fn(|i, _| {
            let row = turn.matrix().row(i);
            match *self {
                Self::Box(h) => (0..3).map(|k| row[k].abs() * h[k]).sum(),
                Self::Sphere(r) => r,
                Self::Capsule(r, half) => row[2].abs() * half + r,
                Self::Cylinder(r, half) => row[2].abs() * half + r * (1.0 - row[2] * row[2]).max(0.0).sqrt(),
                Self::Ellipsoid(h) => (0..3).map(|k| (row[k] * h[k]).powi(2)).sum::<f64>().sqrt(),
            }
        });
        let centre = pose.translation.vector;
        LinkBox { low_m: centre - reach, high_m: centre + reach }
    }

    /// True for finite sizes of which none is negative.
    pub(crate) fn is_sound(&self) -> bool {
        let sizes = match *self {
            Self::Box(h) | Self::Ellipsoid(h) => vec![h.x, h.y, h.z],
            Self::Sphere(r) => vec![r],
            Self::Cylinder(r, h) | Self::Capsule(r, h) => vec![r, h],
        };
        sizes.iter().all(|s| s.is_finite() && *s >= 0.0)
    }

    /// Spheres that enclose the shape, in its own axes.
    pub fn spheres(&self) -> Vec<(Vector3<f64>, f64)> {
        match *self {
            Self::Sphere(r) => vec![(Vector3::zeros(), r)],
            Self::Capsule(r, half) => {
                let count = pieces(half, r);
                let at = |k: usize| half * (2.0 * k as f64 / count as f64 - 1.0);
                // the waists between two spheres of the string lie inside the shape's surface:
                // wider by what is cut there
                let wide = r.hypot(half / count as f64);
                (0..=count).map(|k| (Vector3::z() * at(k), wide)).collect()
            }
            Self::Cylinder(r, half) => {
                let count = pieces(half, r);
                let step = half / count as f64;
                let at = |k: usize| -half + step * (2 * k + 1) as f64;
                (0..count).map(|k| (Vector3::z() * at(k), r.hypot(step))).collect()
            }
            Self::Box(h) => {
                let cell = h.min().max(h.max() / MOST as f64);
                let count = h.map(|side| pieces(side, cell));
                let step = Vector3::from_fn(|i, _| h[i] / count[i] as f64);
                let at = |i: usize, k: usize| -h[i] + step[i] * (2 * k + 1) as f64;
                let mut out = Vec::new();
                for x in 0..count.x {
                    for y in 0..count.y {
                        out.extend((0..count.z).map(|z| (Vector3::new(at(0, x), at(1, y), at(2, z)), step.norm())));
                    }
                }
                out
            }
            Self::Ellipsoid(h) => {
                let long = h.imax();
                let wide = (0..3).filter(|i| *i != long).map(|i| h[i]).fold(0.0, f64::max);
                let count = pieces(h[long], wide);
                let step = h[long] / count as f64;
                (0..count)
                    .map(|k| {
                        let middle = -h[long] + step * (2 * k + 1) as f64;
                        // widest where the slice is nearest to the middle of the body
                        let near = (middle.abs() - step).max(0.0) / h[long].max(f64::MIN_POSITIVE);
                        let mut at = Vector3::zeros();
                        at[long] = middle;
                        (at, (wide * (1.0 - near * near).max(0.0).sqrt()).hypot(step))
                    })
                    .collect()
            }
        }
    }
}

/// Number of pieces of a side of half a length, each about as long as a radius is wide.
fn pieces(half: f64, radius: f64) -> usize {
    ((half / radius.max(1e-6)).ceil() as usize).clamp(1, MOST)
}

/// Spheres of shapes, each moved by the pose of its link in the link of the model that it is part
/// of.
pub(crate) fn link_spheres(
    shapes: &[Shape],
    home: &[(String, String, Isometry3<f64>)],
) -> (Vec<LinkSpheres>, Vec<String>) {
    let mut out: Vec<LinkSpheres> = Vec::new();
    let mut meshes: Vec<String> = Vec::new();
    for shape in shapes {
        let Some((_, kept, pose)) = home.iter().find(|h| h.0 == shape.link) else { continue };
        let Some(solid) = shape.solid else {
            if !meshes.contains(kept) {
                meshes.push(kept.clone());
            }
            continue;
        };
        let placed = pose * shape.pose;
        let spheres = solid.spheres().into_iter().map(|(at, r)| ((placed * Point3::from(at)).coords.into(), r));
        match out.iter_mut().find(|l| l.link == *kept) {
            Some(own) => own.spheres.extend(spheres),
            None => out.push(LinkSpheres { link: kept.clone(), spheres: spheres.collect() }),
        }
    }
    (out, meshes)
}

/// The box about all collision geometry of each link of the model that has any; none for links
/// with meshes, which are not read.
pub(crate) fn link_boxes(shapes: &[Shape], home: &[(String, String, Isometry3<f64>)]) -> Vec<(String, LinkBox)> {
    let mut out: Vec<(String, LinkBox)> = Vec::new();
    let mut meshes: Vec<&str> = Vec::new();
    for shape in shapes {
        let Some((_, kept, pose)) = home.iter().find(|h| h.0 == shape.link) else { continue };
        let Some(solid) = shape.solid else {
            meshes.push(kept);
            continue;
        };
        let own = solid.enclosed(&(pose * shape.pose));
        match out.iter_mut().find(|l| l.0 == *kept) {
            Some((_, all)) => {
                all.low_m = all.low_m.inf(&own.low_m);
                all.high_m = all.high_m.sup(&own.high_m);
            }
            None => out.push((kept.clone(), own)),
        }
    }
    out.retain(|(link, _)| !meshes.contains(&link.as_str()));
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Points all over the surface of a shape.
    fn surface(solid: Solid) -> Vec<Vector3<f64>> {
        let mut out = Vec::new();
        for i in 0..=24 {
            for j in 0..48 {
                let (u, v) = (std::f64::consts::PI * f64::from(i) / 24.0, std::f64::consts::TAU * f64::from(j) / 48.0);
                let on_ball = Vector3::new(u.sin() * v.cos(), u.sin() * v.sin(), u.cos());
                let share = f64::from(i) / 12.0 - 1.0;
                out.push(match solid {
                    Solid::Box(h) => h.component_mul(&(on_ball / on_ball.amax())),
                    Solid::Sphere(r) => on_ball * r,
                    Solid::Ellipsoid(h) => h.component_mul(&on_ball),
                    Solid::Cylinder(r, h) => Vector3::new(r * v.cos(), r * v.sin(), h * share),
                    Solid::Capsule(r, h) => on_ball * r - Vector3::z() * (h * share),
                });
            }
        }
        out
    }

    #[test]
    fn boxes_enclose_their_shape_closely_at_any_pose() {
        let pose = Isometry3::new(Vector3::new(0.1, -0.2, 0.3), Vector3::new(0.4, -0.9, 0.7));
        for solid in [
            Solid::Box(Vector3::new(0.05, 0.1, 0.25)),
            Solid::Sphere(0.1),
            Solid::Cylinder(0.04, 0.2),
            Solid::Capsule(0.05, 0.15),
            Solid::Ellipsoid(Vector3::new(0.05, 0.3, 0.1)),
        ] {
            let own = solid.enclosed(&pose);
            let points: Vec<Vector3<f64>> =
                surface(solid).into_iter().map(|p| (pose * Point3::from(p)).coords).collect();
            let low = points.iter().fold(Vector3::repeat(f64::INFINITY), |a, p| a.inf(p));
            let high = points.iter().fold(Vector3::repeat(f64::NEG_INFINITY), |a, p| a.sup(p));
            for k in 0..3 {
                let size = own.high_m[k] - own.low_m[k];
                let (below, above) = (low[k] - own.low_m[k], own.high_m[k] - high[k]);
                assert!(below > -1e-9 && above > -1e-9, "{solid:?}: axis {k} sticks out by {below} {above}");
                // the surface is known at points, not at its corners
                assert!(below < 0.2 * size && above < 0.2 * size, "{solid:?}: axis {k} {below} {above} of {size}");
            }
        }
    }

    #[test]
    fn spheres_enclose_their_shape_and_not_much_more() {
        for solid in [
            Solid::Box(Vector3::new(0.05, 0.1, 0.25)),
            Solid::Box(Vector3::new(0.2, 0.01, 0.1)),
            Solid::Sphere(0.1),
            Solid::Cylinder(0.04, 0.2),
            Solid::Cylinder(0.2, 0.02),
            Solid::Capsule(0.05, 0.15),
            Solid::Ellipsoid(Vector3::new(0.05, 0.3, 0.1)),
        ] {
            let spheres = solid.spheres();
            for p in surface(solid) {
                let inside = spheres.iter().map(|(c, r)| (p - c).norm() - r).fold(f64::INFINITY, f64::min);
                assert!(inside < 1e-9, "{solid:?}: {p:?} is {inside} m outside");
            }
            let thinnest = match solid {
                Solid::Box(h) => h.min().max(h.max() / MOST as f64),
                Solid::Sphere(r) | Solid::Cylinder(r, _) | Solid::Capsule(r, _) => r,
                Solid::Ellipsoid(h) => h.max(),
            };
            let widest = spheres.iter().map(|s| s.1).fold(0.0, f64::max);
            assert!(widest < 1.8 * thinnest, "{solid:?}: {widest}");
        }
    }
}
