//! Constants of all frames: the prior body, gravity, plates, the volume of the motion.

use crate::Target;
use aloft_body::{JointKind, LinkInertia, Model, Phi};
use nalgebra::{SymmetricEigen, Vector3};

/// Air density that drag areas refer to, kg/m³ (20 °C at sea level).
pub const AIR_DENSITY_KGPM3: f64 = 1.2;

/// The constants from which columns are built.
#[derive(Debug, Clone)]
pub struct Scene {
    /// The model, gravity included.
    pub model: Model,
    /// Inertial parameters of the links, prior or identified.
    pub phi: Vec<Phi>,
    /// Centre of mass of each link in its frame, m.
    pub link_com_m: Vec<Vector3<f64>>,
    /// Mean projected area of each link, as a share of the sum.
    pub area_share: Vec<f64>,
    /// Mass of the whole body, kg.
    pub mass_kg: f64,
    /// Centres of the plates, world, m; empty without plates.
    pub plate_centres_m: Vec<Vector3<f64>>,
    /// Middle of the volume of the motion, world, m.
    pub volume_centre_m: Vector3<f64>,
    /// Standard deviation of the body's positions about it, m.
    pub volume_reach_m: f64,
}

impl Scene {
    /// Scene of a model with its inertial parameters; the volume is set by [`Scene::with_volume`].
    pub fn new(model: &Model, phi: &[Phi], plate_centres_m: &[Vector3<f64>]) -> Self {
        let inertias: Vec<LinkInertia> = phi.iter().map(LinkInertia::from_phi).collect();
        let com = |i: &LinkInertia| if i.mass_kg.abs() > 1e-12 { i.com_m } else { Vector3::zeros() };
        let areas: Vec<f64> = inertias.iter().map(mean_area).collect();
        let total: f64 = areas.iter().sum();
        let n = areas.len().max(1) as f64;
        Self {
            model: model.clone(),
            phi: phi.to_vec(),
            link_com_m: inertias.iter().map(com).collect(),
            area_share: areas.iter().map(|a| if total > 0.0 { a / total } else { 1.0 / n }).collect(),
            mass_kg: phi.iter().map(|p| p[0]).sum(),
            plate_centres_m: plate_centres_m.to_vec(),
            volume_centre_m: Vector3::zeros(),
            volume_reach_m: 1.0,
        }
    }

    /// Sets the volume of the motion from positions of the body's centre of mass.
    pub fn with_volume(mut self, places: &[Vector3<f64>]) -> Self {
        if !places.is_empty() {
            let n = places.len() as f64;
            self.volume_centre_m = places.iter().sum::<Vector3<f64>>() / n;
            let spread = places.iter().map(|p| (p - self.volume_centre_m).norm_squared()).sum::<f64>() / n;
            self.volume_reach_m = spread.sqrt().max(0.05);
        }
        self
    }

    /// Name of the joint that carries a link, where a robot's model names it.
    pub fn joint_name(&self, link: usize) -> Option<&str> {
        let link = self.model.links.get(link)?;
        self.model.joint_names.get(&link.name).map(String::as_str)
    }

    /// True if the joint that carries a link slides.
    pub fn slides(&self, link: usize) -> bool {
        matches!(self.model.links.get(link).map(|l| l.joint.kind), Some(JointKind::Prismatic(_)))
    }

    /// The unit of a joint's coefficient: for a joint that turns, or for one that slides.
    pub(crate) fn unit_of<'u>(&self, joint: Target, turns: &'u str, slides: &'u str) -> &'u str {
        if self.slides(joint.link()) { slides } else { turns }
    }

    /// Number of plates.
    pub fn n_plates(&self) -> usize {
        self.plate_centres_m.len()
    }

    /// Magnitude of gravity, m/s².
    pub fn gravity(&self) -> f64 {
        self.model.gravity_mps2.norm()
    }

    /// Centre of mass of the target's link in its frame, m (of the root if the target has no link).
    pub fn com_of(&self, target: Target) -> Vector3<f64> {
        self.link_com_m.get(target.link()).copied().unwrap_or_else(Vector3::zeros)
    }

    /// Places on the target's link from which a search for that of a mass starts, in its frame, m:
    /// its centre of mass, its joint, and the place opposite to the joint; places that are nearly
    /// the same once. A mass near the joint looks like a negative one at the far end if the search
    /// starts in the middle only.
    pub fn places_on(&self, target: Target) -> Vec<Vector3<f64>> {
        /// Distance up to which two places are the same start, m.
        const SAME_M: f64 = 0.03;
        let middle = self.com_of(target);
        let ends = [Vector3::zeros(), 2.0 * middle];
        std::iter::once(middle).chain(ends.into_iter().filter(|end| (end - middle).norm() > SAME_M)).collect()
    }

    /// φ of a point of unit mass at `point_m` of a link, as a stack over all links.
    pub fn unit_mass_at(&self, link: usize, point_m: &Vector3<f64>) -> Vec<Phi> {
        let mut out = vec![Phi::zeros(); self.model.n_links()];
        if let Some(phi) = out.get_mut(link) {
            *phi = aloft_body::inertia::phi_from_parts(1.0, point_m, &aloft_body::inertia::steiner(point_m));
        }
        out
    }
}

/// Mean projected area of the ellipsoid with the same inertia (a quarter of its surface), m²; if
/// the inertia is unusable, that of a sphere of water with the same mass.
fn mean_area(link: &LinkInertia) -> f64 {
    let m = link.mass_kg;
    if !(m.is_finite() && m > 0.0) {
        return 0.0;
    }
    let i = SymmetricEigen::new(link.inertia_com_kgm2).eigenvalues;
    // semi-axes of a uniform ellipsoid: a² = 5/(2m) (I_b + I_c − I_a)
    let mut axes = [0.0; 3];
    for k in 0..3 {
        axes[k] = (2.5 / m * (i.sum() - 2.0 * i[k])).max(0.0).sqrt();
    }
    let largest = axes.iter().copied().fold(0.0, f64::max);
    if !(largest > 1e-4 && largest.is_finite()) {
        return std::f64::consts::PI * (0.75 * m / (1000.0 * std::f64::consts::PI)).powf(2.0 / 3.0);
    }
    let [a, b, c] = axes.map(|x| x.max(0.02 * largest));
    // Knud Thomsen's formula for the surface of an ellipsoid
    const P: f64 = 1.6075;
    let mean = ((a * b).powf(P) + (a * c).powf(P) + (b * c).powf(P)) / 3.0;
    std::f64::consts::PI * mean.powf(1.0 / P)
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::Matrix3;

    #[test]
    fn a_ball_shows_its_disc() {
        let (m, r) = (3.0, 0.2f64);
        let link = LinkInertia {
            mass_kg: m,
            com_m: Vector3::zeros(),
            inertia_com_kgm2: Matrix3::identity() * (0.4 * m * r * r),
        };
        let disc = std::f64::consts::PI * r * r;
        assert!((mean_area(&link) - disc).abs() < 1e-9 * disc);
    }
}
