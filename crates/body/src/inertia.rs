//! The ten inertial parameters of a link and their physical consistency.

use nalgebra::{Isometry3, Matrix3, Matrix4, SMatrix, SVector, Vector3};
use serde::{Deserialize, Serialize};

/// Inertial parameters of one link about its frame origin: `[m, mc_x, mc_y, mc_z, Ixx, Iyy, Izz,
/// Iyz, Izx, Ixy]` in kg, kg·m, kg·m² (the paper's eq. 4). `Iyz`, `Izx`, `Ixy` are elements of the
/// inertia tensor (with their minus sign).
pub type Phi = SVector<f64, 10>;

/// Names of the entries of [`Phi`], in order.
pub const PHI_NAMES: [&str; 10] = ["m", "mcx", "mcy", "mcz", "Ixx", "Iyy", "Izz", "Iyz", "Izx", "Ixy"];

/// Mass, centre of mass and inertia tensor about the centre of mass, in link axes.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct LinkInertia {
    /// Mass in kg.
    pub mass_kg: f64,
    /// Centre of mass in the link frame, m.
    pub com_m: Vector3<f64>,
    /// Inertia tensor about the centre of mass in link axes, kg·m².
    pub inertia_com_kgm2: Matrix3<f64>,
}

impl LinkInertia {
    /// Parameters about the link-frame origin.
    pub fn to_phi(&self) -> Phi {
        let (m, c) = (self.mass_kg, self.com_m);
        phi_from_parts(m, &(c * m), &(self.inertia_com_kgm2 + steiner(&c) * m))
    }
    /// Computed from parameters about the link-frame origin (mass must not be zero).
    pub fn from_phi(phi: &Phi) -> Self {
        let m = phi[0];
        let c = first_moment(phi) / m;
        Self { mass_kg: m, com_m: c, inertia_com_kgm2: inertia_about_origin(phi) - steiner(&c) * m }
    }
    /// The same body in another frame: `to_from_link` maps points of the link frame into the new
    /// frame.
    pub fn transformed(&self, to_from_link: &Isometry3<f64>) -> Self {
        let r = to_from_link.rotation.to_rotation_matrix().into_inner();
        Self {
            mass_kg: self.mass_kg,
            com_m: to_from_link.transform_point(&self.com_m.into()).coords,
            inertia_com_kgm2: r * self.inertia_com_kgm2 * r.transpose(),
        }
    }
}

/// Inertia of a unit mass at `c` about the origin, m²: `|c|² 1 − c cᵀ`.
pub fn steiner(c: &Vector3<f64>) -> Matrix3<f64> {
    Matrix3::from_diagonal_element(c.norm_squared()) - c * c.transpose()
}

/// Parameters from mass (kg), first moment (kg·m) and inertia tensor about the frame origin (kg·m²;
/// the upper triangle is read).
pub fn phi_from_parts(mass_kg: f64, first_moment_kgm: &Vector3<f64>, inertia_origin_kgm2: &Matrix3<f64>) -> Phi {
    let (h, i) = (first_moment_kgm, inertia_origin_kgm2);
    Phi::from([mass_kg, h.x, h.y, h.z, i[(0, 0)], i[(1, 1)], i[(2, 2)], i[(1, 2)], i[(0, 2)], i[(0, 1)]])
}

/// First moment of mass about the link-frame origin in link axes, kg·m.
pub fn first_moment(phi: &Phi) -> Vector3<f64> {
    Vector3::new(phi[1], phi[2], phi[3])
}

/// Inertia tensor about the link-frame origin in link axes, kg·m².
pub fn inertia_about_origin(phi: &Phi) -> Matrix3<f64> {
    Matrix3::new(phi[4], phi[9], phi[8], phi[9], phi[5], phi[7], phi[8], phi[7], phi[6])
}

/// 4×4 pseudo-inertia `[[Σ, mc],[mcᵀ, m]]`, Σ = ½tr(I)1 − I (Wensing, Kim, Slotine 2017). Positive
/// definite if and only if a body with positive density everywhere can have these parameters.
pub fn pseudo_inertia(phi: &Phi) -> Matrix4<f64> {
    let half_trace = 0.5 * (phi[4] + phi[5] + phi[6]);
    let mut j = Matrix4::zeros();
    j.fixed_view_mut::<3, 3>(0, 0).copy_from(&(Matrix3::from_diagonal_element(half_trace) - inertia_about_origin(phi)));
    for k in 0..3 {
        j[(k, 3)] = phi[1 + k];
        j[(3, k)] = phi[1 + k];
    }
    j[(3, 3)] = phi[0];
    j
}

/// Inverse of [`pseudo_inertia`].
pub fn phi_from_pseudo_inertia(j: &Matrix4<f64>) -> Phi {
    let sigma = j.fixed_view::<3, 3>(0, 0).into_owned();
    let inertia = Matrix3::from_diagonal_element(sigma.trace()) - sigma;
    phi_from_parts(j[(3, 3)], &Vector3::new(j[(0, 3)], j[(1, 3)], j[(2, 3)]), &inertia)
}

/// 10×10 matrix T with `φ_new = T φ_old`, for the same body in another frame (`new_from_old`).
pub fn phi_transform(new_from_old: &Isometry3<f64>) -> SMatrix<f64, 10, 10> {
    phi_transform_by(&new_from_old.rotation.to_rotation_matrix().into_inner(), &new_from_old.translation.vector)
}

/// [`phi_transform`] from a rotation matrix and the old origin in the new frame.
pub(crate) fn phi_transform_by(rotation: &Matrix3<f64>, origin: &Vector3<f64>) -> SMatrix<f64, 10, 10> {
    let mut t = Matrix4::identity();
    t.fixed_view_mut::<3, 3>(0, 0).copy_from(rotation);
    t.fixed_view_mut::<3, 1>(0, 3).copy_from(origin);
    let mut out = SMatrix::<f64, 10, 10>::zeros();
    for k in 0..10 {
        let mut unit = Phi::zeros();
        unit[k] = 1.0;
        out.set_column(k, &phi_from_pseudo_inertia(&(t * pseudo_inertia(&unit) * t.transpose())));
    }
    out
}
