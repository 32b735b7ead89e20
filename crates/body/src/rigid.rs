//! Rigid fits: the rotation or pose that best maps one set of points or directions to another.
//!
//! [`best_rotation`] is the only solver of Wahba's problem; callers with weighted points, or with
//! directions only, sum the matrix and call it. [`fit_pose`] and [`fit_pose_of_seen`] do so for
//! points of equal weight.

use nalgebra::{Isometry3, Matrix3, Rotation3, Translation3, UnitQuaternion, Vector3};

/// Relative tolerance of the iteration for singular values: that of nalgebra's own `svd`.
pub const SVD_TOLERANCE: f64 = 5.0 * f64::EPSILON;

/// Maximum number of iterations of a decomposition; three to five are typical.
const SVD_ITERATIONS: usize = 200;

/// The rotation R that maximises tr(Rᵀ B) for B = Σ w b aᵀ, that is, the best rotation of the
/// vectors a onto the vectors b (Wahba 1965; Kabsch 1976), reflections excluded. Also returns the
/// singular values of B in descending order. If only one of them is non-zero, the rotation about
/// that direction is arbitrary. `None` if the matrix cannot be decomposed.
pub fn best_rotation(b: &Matrix3<f64>, tolerance: f64) -> Option<(Matrix3<f64>, Vector3<f64>)> {
    let svd = b.try_svd(true, true, tolerance, SVD_ITERATIONS)?;
    let (u, v_t) = (svd.u?, svd.v_t?);
    let mut middle = Matrix3::identity();
    // The singular values are in descending order: the least determined direction takes the
    // reflection.
    middle[(2, 2)] = (u * v_t).determinant().signum();
    let rotation = u * middle * v_t;
    rotation.iter().all(|x| x.is_finite()).then_some((rotation, svd.singular_values))
}

/// Least-squares pose that maps the points `local` onto `world`. Both slices have the same length,
/// and all points are finite.
///
/// None with fewer than three points, or when they lie within `min_spread_m` of a line (root mean
/// square, m).
pub fn fit_pose(local: &[Vector3<f64>], world: &[Vector3<f64>], min_spread_m: f64) -> Option<Isometry3<f64>> {
    let n = local.len();
    if n < 3 || world.len() != n {
        return None;
    }
    let scale = 1.0 / n as f64;
    let centre_local = local.iter().sum::<Vector3<f64>>() * scale;
    let centre_world = world.iter().sum::<Vector3<f64>>() * scale;
    let mut covariance = Matrix3::zeros();
    let mut shape = Matrix3::zeros();
    for (l, w) in local.iter().zip(world) {
        let (l, w) = (l - centre_local, w - centre_world);
        covariance += w * l.transpose();
        shape += l * l.transpose();
    }
    let mut spreads: Vec<f64> = shape.symmetric_eigenvalues().iter().copied().collect();
    spreads.sort_by(f64::total_cmp);
    let second = spreads[1];
    if !(second.max(0.0) * scale).sqrt().is_finite() || (second.max(0.0) * scale).sqrt() < min_spread_m {
        return None;
    }
    let (rotation, _) = best_rotation(&covariance, SVD_TOLERANCE)?;
    let rotation = Rotation3::from_matrix_unchecked(rotation);
    let translation = centre_world - rotation * centre_local;
    Some(Isometry3::from_parts(Translation3::from(translation), UnitQuaternion::from_rotation_matrix(&rotation)))
}

/// Pose `world_from_body` that best maps `local` onto `measured`, ignoring points that are not
/// finite, with the remaining root mean square distance, m (absolute orientation; Horn 1987, Arun
/// et al. 1987).
///
/// None with fewer than three common points or when they lie on a line.
pub fn fit_pose_of_seen(local: &[Vector3<f64>], measured: &[Vector3<f64>]) -> Option<(Isometry3<f64>, f64)> {
    let finite = |p: &Vector3<f64>| p.iter().all(|x| x.is_finite());
    let pairs = || local.iter().zip(measured).filter(|(a, b)| finite(a) && finite(b));
    let n = pairs().count();
    if n < 3 {
        return None;
    }
    let (sum_a, sum_b) = pairs().fold((Vector3::zeros(), Vector3::zeros()), |(a, b), (p, q)| (a + p, b + q));
    let (mean_a, mean_b) = (sum_a / n as f64, sum_b / n as f64);
    let mut cross = Matrix3::zeros();
    for (p, q) in pairs() {
        cross += (q - mean_b) * (p - mean_a).transpose();
    }
    let (rotation, sigma) = best_rotation(&cross, SVD_TOLERANCE)?;
    // Two directions must be determined; the third follows from handedness.
    if sigma[0].is_nan() || sigma[1] <= 1e-6 * sigma[0] || sigma[0] <= 0.0 {
        return None;
    }
    let q = UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(rotation));
    let pose = Isometry3::from_parts(Translation3::from(mean_b - q * mean_a), q);
    let distance =
        |(p, r): (&Vector3<f64>, &Vector3<f64>)| (pose.rotation * p + pose.translation.vector - r).norm_squared();
    let rms = (pairs().map(distance).sum::<f64>() / n as f64).sqrt();
    Some((pose, rms))
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "tests fail by panicking")]
mod tests {
    use super::*;

    #[test]
    fn unit_pose_of_an_exact_cloud_is_found_also_when_it_is_flat() {
        let pose = Isometry3::new(Vector3::new(0.3, -1.0, 2.0), Vector3::new(0.4, 2.5, -0.7));
        let local = [Vector3::new(0.1, 0.0, 0.0), Vector3::new(0.0, 0.2, 0.0), Vector3::new(-0.1, 0.05, 0.0)];
        let world = local.map(|p| pose.transform_point(&p.into()).coords);
        let found = fit_pose(&local, &world, 0.01).unwrap();
        assert!((found.to_homogeneous() - pose.to_homogeneous()).norm() < 1e-12);
        let (found, rms) = fit_pose_of_seen(&local, &world).unwrap();
        assert!((found.to_homogeneous() - pose.to_homogeneous()).norm() < 1e-12 && rms < 1e-12);
        let line = [Vector3::x() * 0.1, Vector3::x() * 0.2, Vector3::x() * 0.35];
        assert!(fit_pose(&line, &line, 0.005).is_none());
    }

    #[test]
    fn unit_missing_points_are_left_out_and_lines_refused() {
        let local = [
            Vector3::new(0.1, 0.0, 0.02),
            Vector3::new(-0.1, 0.05, 0.0),
            Vector3::new(0.0, -0.07, 0.03),
            Vector3::new(f64::NAN, 0.0, 0.0),
        ];
        let pose = Isometry3::new(Vector3::new(0.3, -0.2, 1.0), Vector3::new(0.4, -0.3, 1.9));
        let measured: Vec<_> = local.iter().map(|p| pose.rotation * p + pose.translation.vector).collect();
        let (found, rms) = fit_pose_of_seen(&local, &measured).unwrap();
        assert!(rms < 1e-14 && found.rotation.angle_to(&pose.rotation) < 1e-12);
        assert!((found.translation.vector - pose.translation.vector).norm() < 1e-13);
        let line = [Vector3::zeros(), Vector3::x(), 2.0 * Vector3::x()];
        assert!(fit_pose_of_seen(&line, &line).is_none());
        assert!(fit_pose_of_seen(&line[..2], &line[..2]).is_none());
    }

    #[test]
    fn regress_rotations_are_those_of_the_plain_decomposition_to_the_last_bit() {
        let mut state = 1_u64;
        let mut random = || {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            (state >> 11) as f64 / (1_u64 << 53) as f64 - 0.5
        };
        for _ in 0..5000 {
            let b = Matrix3::from_fn(|_, _| random());
            let svd = b.svd(true, true);
            let (u, v_t) = (svd.u.unwrap(), svd.v_t.unwrap());
            let mut sign = Matrix3::identity();
            if (u * v_t).determinant() < 0.0 {
                sign[(2, 2)] = -1.0;
            }
            assert_eq!(best_rotation(&b, SVD_TOLERANCE).unwrap(), (u * sign * v_t, svd.singular_values));
        }
    }
}
