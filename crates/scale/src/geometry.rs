//! Geometry helpers of this crate: frames from two directions, medians, vector statistics.

use nalgebra::{Isometry3, Matrix3, Rotation3, Translation3, UnitQuaternion, Vector3};

/// Unit vector, or `None` for a vector shorter than a nanometre or not finite.
pub(crate) fn unit(v: &Vector3<f64>) -> Option<Vector3<f64>> {
    let n = v.norm();
    (n.is_finite() && n > 1e-9).then(|| v / n)
}

fn from_columns(x: Vector3<f64>, y: Vector3<f64>, z: Vector3<f64>) -> UnitQuaternion<f64> {
    UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(Matrix3::from_columns(&[x, y, z])))
}

/// Axes with y exactly along `y` and z as close to `z_hint` as possible. `None` if the two are
/// parallel.
pub(crate) fn axes_y_z(y: &Vector3<f64>, z_hint: &Vector3<f64>) -> Option<UnitQuaternion<f64>> {
    let y = unit(y)?;
    let x = unit(&y.cross(&unit(z_hint)?)).filter(|_| y.cross(z_hint).norm() > 1e-3 * z_hint.norm())?;
    Some(from_columns(x, y, x.cross(&y)))
}

/// Axes with x exactly along `x` and z as close to `z_hint` as possible.
pub(crate) fn axes_x_z(x: &Vector3<f64>, z_hint: &Vector3<f64>) -> Option<UnitQuaternion<f64>> {
    let x = unit(x)?;
    let y = unit(&z_hint.cross(&x)).filter(|_| z_hint.cross(&x).norm() > 1e-3 * z_hint.norm())?;
    Some(from_columns(x, y, x.cross(&y)))
}

/// Axes with z exactly along `z` and y as close to `y_hint` as possible.
pub(crate) fn axes_z_y(z: &Vector3<f64>, y_hint: &Vector3<f64>) -> Option<UnitQuaternion<f64>> {
    let z = unit(z)?;
    let x = unit(&y_hint.cross(&z)).filter(|_| y_hint.cross(&z).norm() > 1e-3 * y_hint.norm())?;
    Some(from_columns(x, z.cross(&x), z))
}

/// Axes with z exactly along `z` and x as close to `x_hint` as possible.
pub(crate) fn axes_z_x(z: &Vector3<f64>, x_hint: &Vector3<f64>) -> Option<UnitQuaternion<f64>> {
    let z = unit(z)?;
    let y = unit(&z.cross(x_hint)).filter(|_| z.cross(x_hint).norm() > 1e-3 * x_hint.norm())?;
    Some(from_columns(y.cross(&z), y, z))
}

/// Unit axes of a rotation.
pub(crate) fn x_of(r: &UnitQuaternion<f64>) -> Vector3<f64> {
    r * Vector3::x()
}
pub(crate) fn y_of(r: &UnitQuaternion<f64>) -> Vector3<f64> {
    r * Vector3::y()
}
pub(crate) fn z_of(r: &UnitQuaternion<f64>) -> Vector3<f64> {
    r * Vector3::z()
}

/// Pose from origin and axes.
pub(crate) fn pose(origin: &Vector3<f64>, axes: &UnitQuaternion<f64>) -> Isometry3<f64> {
    Isometry3::from_parts(Translation3::from(*origin), *axes)
}

/// Transforms a point by a pose.
pub(crate) fn apply(pose: &Isometry3<f64>, p: &Vector3<f64>) -> Vector3<f64> {
    pose.rotation * p + pose.translation.vector
}

/// Transforms a point by the inverse of a pose.
pub(crate) fn apply_inverse(pose: &Isometry3<f64>, p: &Vector3<f64>) -> Vector3<f64> {
    pose.rotation.inverse() * (p - pose.translation.vector)
}

/// `v` without its component along the unit vector `axis`.
pub(crate) fn reject(v: &Vector3<f64>, axis: &Vector3<f64>) -> Vector3<f64> {
    v - axis * axis.dot(v)
}

/// Median of the finite values; NaN when there are none.
pub(crate) fn median(values: impl Iterator<Item = f64>) -> f64 {
    aloft_signal::median(&mut values.filter(|x| x.is_finite()).collect::<Vec<f64>>())
}

/// Component-wise median of the points that are finite.
pub(crate) fn median_point<'a>(points: impl Iterator<Item = &'a Vector3<f64>> + Clone) -> Option<Vector3<f64>> {
    let m = Vector3::from_fn(|i, _| median(points.clone().map(|p| p[i])));
    m.iter().all(|x| x.is_finite()).then_some(m)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn frames_keep_their_first_axis_and_are_right_handed() {
        let a = Vector3::new(0.3, -2.0, 0.7);
        let b = Vector3::new(1.0, 0.2, -0.4);
        for (r, kept) in [
            (axes_y_z(&a, &b).unwrap(), 1),
            (axes_x_z(&a, &b).unwrap(), 0),
            (axes_z_y(&a, &b).unwrap(), 2),
            (axes_z_x(&a, &b).unwrap(), 2),
        ] {
            let m = r.to_rotation_matrix().into_inner();
            assert!((m.column(kept) - a.normalize()).norm() < 1e-12);
            assert!((m.determinant() - 1.0).abs() < 1e-12);
        }
        assert!((z_of(&axes_y_z(&a, &b).unwrap()).dot(&b)) > 0.0);
        assert!((y_of(&axes_z_y(&a, &b).unwrap()).dot(&b)) > 0.0);
        assert!((x_of(&axes_z_x(&a, &b).unwrap()).dot(&b)) > 0.0);
        assert!(axes_y_z(&a, &(2.0 * a)).is_none());
    }

    #[test]
    fn median_ignores_missing() {
        assert_eq!(median([f64::NAN, 3.0, 1.0, 2.0].into_iter()), 2.0);
        assert!(median([f64::NAN].into_iter()).is_nan());
    }
}
