//! Rotations and rigid motions as groups: exponential and logarithm, exact at small angles and near
//! half turns.
//!
//! Used by [`crate::Model::integrate`] and [`crate::Model::difference`]; also useful wherever
//! orientations are interpolated, filtered or averaged.

use nalgebra::{Matrix3, Quaternion, UnitQuaternion, Vector3};

/// Below this angle (rad) series replace quotients; the omitted terms are smaller than one rounding
/// error.
const SMALL_ANGLE_RAD: f64 = 1e-2;

/// Unit quaternion of a rotation vector (axis times angle, rad).
pub fn quaternion_exp(rotation_rad: &Vector3<f64>) -> UnitQuaternion<f64> {
    let angle = rotation_rad.norm();
    let half = 0.5 * angle;
    // sin(θ/2)/θ
    let scale = if angle < SMALL_ANGLE_RAD {
        let h2 = half * half;
        0.5 * (1.0 - h2 / 6.0 * (1.0 - h2 / 20.0 * (1.0 - h2 / 42.0)))
    } else {
        half.sin() / angle
    };
    let v = rotation_rad * scale;
    UnitQuaternion::new_unchecked(Quaternion::new(half.cos(), v.x, v.y, v.z))
}

/// Rotation vector (axis times angle, rad) of a quaternion, with an angle in [0, π]. `q` and `−q`
/// give the same vector; the length of the quaternion does not matter.
pub fn quaternion_log(q: &Quaternion<f64>) -> Vector3<f64> {
    // Use one hemisphere: the shorter rotation.
    let (w, v) = if q.scalar() < 0.0 { (-q.scalar(), -q.vector()) } else { (q.scalar(), q.vector().into_owned()) };
    let sine = v.norm();
    // tan(θ/2) = |v|/w; atan2 keeps all digits at θ → 0 and at θ → π.
    let scale = if sine < 0.1 * w {
        // Σ (−t²)ᵏ/(2k+1): the first term left out is below 1e-18
        let t2 = (sine / w) * (sine / w);
        2.0 / w * (0..9).rev().fold(0.0, |sum, k| 1.0 / f64::from(2 * k + 1) - t2 * sum)
    } else {
        2.0 * sine.atan2(w) / sine
    };
    v * scale
}

/// Of `q` and `−q` (the same rotation), the one nearer to `reference`: makes series of quaternions
/// sign-continuous.
pub(crate) fn quaternion_near(q: &Quaternion<f64>, reference: &Quaternion<f64>) -> Quaternion<f64> {
    if q.coords.dot(&reference.coords) < 0.0 { -q } else { *q }
}

/// Cross-product matrix: `skew(a) b = a × b`.
pub fn skew(a: &Vector3<f64>) -> Matrix3<f64> {
    Matrix3::new(0.0, -a.z, a.y, a.z, 0.0, -a.x, -a.y, a.x, 0.0)
}

/// Rotation matrix of a unit quaternion.
pub(crate) fn rotation_matrix(q: &UnitQuaternion<f64>) -> Matrix3<f64> {
    let (x, y, z, w) = (q.coords.x, q.coords.y, q.coords.z, q.coords.w);
    let (xs, ys, zs) = (x + x, y + y, z + z);
    let (wx, wy, wz) = (w * xs, w * ys, w * zs);
    let (xx, xy, xz) = (x * xs, x * ys, x * zs);
    let (yy, yz, zz) = (y * ys, y * zs, z * zs);
    Matrix3::new(
        1.0 - (yy + zz),
        xy - wz,
        xz + wy,
        xy + wz,
        1.0 - (xx + zz),
        yz - wx,
        xz - wy,
        yz + wx,
        1.0 - (xx + yy),
    )
}

/// `m v`, written out: the compiler optimises nine products better than a loop.
#[inline(always)]
pub(crate) fn times(m: &Matrix3<f64>, v: &Vector3<f64>) -> Vector3<f64> {
    Vector3::new(
        m.m11 * v.x + m.m12 * v.y + m.m13 * v.z,
        m.m21 * v.x + m.m22 * v.y + m.m23 * v.z,
        m.m31 * v.x + m.m32 * v.y + m.m33 * v.z,
    )
}

/// `mᵀ v`, written out.
#[inline(always)]
pub(crate) fn transposed_times(m: &Matrix3<f64>, v: &Vector3<f64>) -> Vector3<f64> {
    Vector3::new(
        m.m11 * v.x + m.m21 * v.y + m.m31 * v.z,
        m.m12 * v.x + m.m22 * v.y + m.m32 * v.z,
        m.m13 * v.x + m.m23 * v.y + m.m33 * v.z,
    )
}

/// Columns of a matrix.
#[inline(always)]
pub(crate) fn columns(m: &Matrix3<f64>) -> [Vector3<f64>; 3] {
    [Vector3::new(m.m11, m.m21, m.m31), Vector3::new(m.m12, m.m22, m.m32), Vector3::new(m.m13, m.m23, m.m33)]
}

/// `a b`, written out.
#[inline(always)]
pub(crate) fn product(a: &Matrix3<f64>, b: &Matrix3<f64>) -> Matrix3<f64> {
    let [x, y, z] = columns(b);
    let (x, y, z) = (times(a, &x), times(a, &y), times(a, &z));
    Matrix3::new(x.x, y.x, z.x, x.y, y.y, z.y, x.z, y.z, z.z)
}

/// The matrix V with `exp([v, ω]) = (exp ω, V(ω) v)`: translation reached by a constant body twist
/// in unit time (left Jacobian of SO(3)).
pub fn left_jacobian(omega: &Vector3<f64>) -> Matrix3<f64> {
    let t2 = omega.norm_squared();
    let t = t2.sqrt();
    let (a, b) = if t < SMALL_ANGLE_RAD {
        (0.5 * (1.0 - t2 / 12.0 * (1.0 - t2 / 30.0)), (1.0 - t2 / 20.0 * (1.0 - t2 / 42.0)) / 6.0)
    } else {
        let s = (0.5 * t).sin();
        (2.0 * s * s / t2, (t - t.sin()) / (t2 * t))
    };
    let w = skew(omega);
    Matrix3::identity() + w * a + w * w * b
}

/// Inverse of [`left_jacobian`], for |ω| < 2π.
pub fn left_jacobian_inverse(omega: &Vector3<f64>) -> Matrix3<f64> {
    let t2 = omega.norm_squared();
    let t = t2.sqrt();
    let c = if t < 0.1 {
        (1.0 + t2 / 60.0 * (1.0 + t2 / 42.0 * (1.0 + t2 / 40.0))) / 12.0
    } else {
        // 1/θ² − cot(θ/2)/(2θ)
        (1.0 - 0.5 * t / (0.5 * t).tan()) / t2
    };
    let w = skew(omega);
    Matrix3::identity() - w * 0.5 + w * w * c
}
