//! The ten inertial parameters of a link and their physical consistency.

use nalgebra::{Isometry3, Matrix3, Matrix4, SVector, Vector3};
use serde::{Deserialize, Serialize};

/// Inertial parameters of one link about its frame origin: `[m, mc_x, mc_y, mc_z, Ixx, Iyy, Izz, Iyz, Izx, Ixy]`
/// in kg, kg·m, kg·m² (the paper's eq. 4). `Iyz`, `Izx`, `Ixy` are elements of the inertia tensor (with their minus sign).
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
        todo!()
    }
    /// From parameters about the link-frame origin (mass may not be zero).
    pub fn from_phi(_phi: &Phi) -> Self {
        todo!()
    }
    /// The same body seen from another frame: `to_from_link` maps points of the link frame into the new frame.
    pub fn transformed(&self, _to_from_link: &Isometry3<f64>) -> Self {
        todo!()
    }
}

/// 4×4 pseudo-inertia `[[Σ, mc],[mcᵀ, m]]`, Σ = ½tr(I)1 − I (Wensing, Kim, Slotine 2017). Positive definite if and only if
/// a body with positive density everywhere can have these parameters.
pub fn pseudo_inertia(_phi: &Phi) -> Matrix4<f64> {
    todo!()
}
/// Inverse of [`pseudo_inertia`].
pub fn phi_from_pseudo_inertia(_j: &Matrix4<f64>) -> Phi {
    todo!()
}
/// 10×10 matrix T with `φ_new = T φ_old`, for the same body seen from another frame (`new_from_old`).
pub fn phi_transform(_new_from_old: &Isometry3<f64>) -> nalgebra::SMatrix<f64, 10, 10> {
    todo!()
}
