//! Where links are, as spheres: a check that a planned motion keeps links apart.
//!
//! A link with collision geometry (boxes, spheres, cylinders, capsules, ellipsoids) has the spheres
//! that enclose it. The spheres of any other link are strung from its origin to the origins of its
//! children, or, at the end of a limb, to twice the distance of its centre of mass. Their radius is
//! that of a homogeneous cylinder with the link's mass and smallest moment of inertia (`r² = 2
//! I/m`). This is rough. A pair of links is therefore judged by comparison: it may come as close as
//! the margin, or as close as it came in the recordings.

use crate::LinkSpheres;
use aloft_body::{LinkInertia, Model, State};
use nalgebra::Vector3;

/// Spheres of all links.
#[derive(Debug, Clone)]
pub struct Extents {
    /// Link, centre in the link's frame (m), radius (m).
    spheres: Vec<(usize, Vector3<f64>, f64)>,
    /// Pairs of links that no joint connects, with the smallest distance allowed.
    pairs: Vec<(usize, usize, f64)>,
    links: usize,
}

/// Largest number of spheres along one line.
const MOST: usize = 8;

impl Extents {
    /// Spheres of a model's links, with a smallest distance of `margin_m` between links that no
    /// joint connects.
    pub fn of(model: &Model, links: &[LinkInertia], collision: &[LinkSpheres], margin_m: f64) -> Self {
        let mut spheres = Vec::new();
        for (i, inertia) in links.iter().enumerate() {
            if let Some(own) = collision.iter().find(|c| c.link == model.links[i].name) {
                spheres.extend(own.spheres.iter().map(|(at, r)| (i, Vector3::from(*at), *r)));
                continue;
            }
            let principal = inertia.inertia_com_kgm2.symmetric_eigenvalues();
            let radius = (2.0 * principal.min().max(0.0) / inertia.mass_kg).sqrt();
            let mut ends: Vec<Vector3<f64>> = model
                .links
                .iter()
                .filter(|l| l.parent == Some(i))
                .map(|l| l.joint.parent_from_joint.translation.vector)
                .filter(|p| p.norm() > 1e-6)
                .collect();
            if ends.is_empty() {
                ends.push(inertia.com_m * 2.0);
            }
            if i == 0 {
                // the base's origin may be anywhere in it
                spheres.push((0, inertia.com_m, radius));
            }
            for end in ends {
                let count = ((end.norm() / radius.max(1e-3)).ceil() as usize).clamp(1, MOST);
                spheres.extend((0..=count).map(|k| (i, end * (k as f64 / count as f64), radius)));
            }
        }
        let n = model.n_links();
        let joined = |a: usize, b: usize| model.links[a].parent == Some(b) || model.links[b].parent == Some(a);
        let pairs = (0..n)
            .flat_map(|a| (a + 1..n).map(move |b| (a, b)))
            .filter(|(a, b)| !joined(*a, *b))
            .map(|(a, b)| (a, b, margin_m))
            .collect();
        Self { spheres, pairs, links: n }
    }

    /// Distances of all pairs in a posture, m; negative where spheres overlap.
    fn distances(&self, state: &State) -> Vec<f64> {
        let mut out = vec![f64::INFINITY; self.links * self.links];
        let placed: Vec<(usize, Vector3<f64>, f64)> =
            self.spheres.iter().map(|(l, c, r)| (*l, state.point_in_world(*l, c), *r)).collect();
        for (i, a) in placed.iter().enumerate() {
            for b in &placed[i + 1..] {
                let at = a.0.min(b.0) * self.links + a.0.max(b.0);
                out[at] = out[at].min((a.1 - b.1).norm() - a.2 - b.2);
            }
        }
        self.pairs.iter().map(|(a, b, _)| out[a * self.links + b]).collect()
    }

    /// Allows each pair to come as close as in a posture of the recordings.
    pub fn allow(&mut self, state: &State) {
        for (found, pair) in self.distances(state).iter().zip(&mut self.pairs) {
            pair.2 = pair.2.min(*found);
        }
    }

    /// How much room is left in a posture, m: negative if a pair is closer than allowed.
    pub fn room_m(&self, state: &State) -> f64 {
        self.distances(state).iter().zip(&self.pairs).map(|(d, p)| d - p.2).fold(f64::INFINITY, f64::min)
    }
}
