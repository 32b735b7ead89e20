//! Rigid-body fits of small marker clouds: the pose of a segment from its visible markers.

use nalgebra::{Isometry3, Matrix3, Rotation3, Translation3, UnitQuaternion, Vector3};

/// Least-squares pose that carries the points `local` onto `world` (Kabsch 1976: the rotation that maximises tr(R H), by singular
/// values of the cross-covariance H, reflections excluded). Both slices have the same length.
///
/// `None` with fewer than three points, or when they lie within `min_spread_m` of a line (root mean square).
pub fn fit_pose(local: &[Vector3<f64>], world: &[Vector3<f64>], min_spread_m: f64) -> Option<Isometry3<f64>> {
    let n = local.len();
    if n < 3 || world.len() != n {
        return None;
    }
    let scale = 1.0 / n as f64;
    let center_local = local.iter().sum::<Vector3<f64>>() * scale;
    let center_world = world.iter().sum::<Vector3<f64>>() * scale;
    let mut covariance = Matrix3::zeros();
    let mut shape = Matrix3::zeros();
    for (l, w) in local.iter().zip(world) {
        let (l, w) = (l - center_local, w - center_world);
        covariance += w * l.transpose();
        shape += l * l.transpose();
    }
    let mut spreads: Vec<f64> = shape.symmetric_eigenvalues().iter().copied().collect();
    spreads.sort_by(f64::total_cmp);
    let second = spreads[1];
    if !(second.max(0.0) * scale).sqrt().is_finite() || (second.max(0.0) * scale).sqrt() < min_spread_m {
        return None;
    }
    let svd = covariance.svd(true, true);
    let (u, v_t) = (svd.u?, svd.v_t?);
    let mut sign = Matrix3::identity();
    if (u * v_t).determinant() < 0.0 {
        // The singular values are sorted in descending order: turn the direction that says least.
        sign[(2, 2)] = -1.0;
    }
    let rotation = Rotation3::from_matrix_unchecked(u * sign * v_t);
    let translation = center_world - rotation * center_local;
    Some(Isometry3::from_parts(Translation3::from(translation), UnitQuaternion::from_rotation_matrix(&rotation)))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn prop_pose_of_an_exact_cloud_is_found_also_when_it_is_flat() {
        let pose = Isometry3::new(Vector3::new(0.3, -1.0, 2.0), Vector3::new(0.4, 2.5, -0.7));
        let local = [Vector3::new(0.1, 0.0, 0.0), Vector3::new(0.0, 0.2, 0.0), Vector3::new(-0.1, 0.05, 0.0)];
        let world = local.map(|p| pose.transform_point(&p.into()).coords);
        let found = fit_pose(&local, &world, 0.01).unwrap();
        assert!((found.to_homogeneous() - pose.to_homogeneous()).norm() < 1e-12);
        let line = [Vector3::x() * 0.1, Vector3::x() * 0.2, Vector3::x() * 0.35];
        assert!(fit_pose(&line, &line, 0.005).is_none());
    }
}
