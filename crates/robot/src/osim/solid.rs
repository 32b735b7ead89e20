//! Inertias that no body has, made those of the nearest one.

use aloft_body::{LinkInertia, Phi};
use nalgebra::{Matrix3, SymmetricEigen, Vector3};

/// Smallest second moment of a link as a share of its largest.
const LEAST_SHARE: f64 = 1e-3;
/// Mass that a moving body without mass is given, kg.
const LEAST_MASS_KG: f64 = 1e-3;

/// The inertia as that of a body with positive density, and what was changed, in words.
pub(super) fn made_solid(sum: &Phi) -> (LinkInertia, Option<String>) {
    let mut inertia = LinkInertia::from_phi(sum);
    let mut changed = None;
    if inertia.mass_kg < LEAST_MASS_KG {
        changed = Some(format!("it moves and has no mass: taken as {} g", 1e3 * LEAST_MASS_KG));
        inertia.mass_kg = LEAST_MASS_KG;
        inertia.com_m = Vector3::zeros();
        inertia.inertia_com_kgm2 = Matrix3::from_diagonal_element(LEAST_MASS_KG * 1e-4);
    }
    let second = Matrix3::from_diagonal_element(0.5 * inertia.inertia_com_kgm2.trace()) - inertia.inertia_com_kgm2;
    let eigen = SymmetricEigen::new(second);
    let least = (LEAST_SHARE * eigen.eigenvalues.max()).max(1e-9);
    if eigen.eigenvalues.min() < least {
        let raised = eigen.eigenvalues.map(|v| v.max(least));
        if eigen.eigenvalues.min() <= 0.0 {
            changed = changed.or_else(|| {
                Some("no body of positive density has its inertia: the nearest one is the prior".to_owned())
            });
        }
        let second = eigen.eigenvectors * Matrix3::from_diagonal(&raised) * eigen.eigenvectors.transpose();
        inertia.inertia_com_kgm2 = Matrix3::from_diagonal_element(second.trace()) - second;
    }
    (inertia, changed)
}
