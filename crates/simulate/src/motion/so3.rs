//! Rotations by their rotation vector: rates and accelerations of `R = exp([θ]×)` and back.
//!
//! `ω` and `α` are in the axes of the moving frame (the right Jacobian): `ω = J_r(θ) θ̇`,
//! with `J_r = 1 − A [θ]× + B [θ]×²`, `A = (1 − cos φ)/φ²`, `B = (φ − sin φ)/φ³`, `φ = |θ|`.

use nalgebra::{Matrix3, UnitQuaternion, Vector3};

/// A rotation vector with two derivatives, or the equivalent angular motion (rotation, rate,
/// acceleration).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Rotation {
    /// The rotation.
    pub rotation: UnitQuaternion<f64>,
    /// Angular velocity in moving axes, rad/s.
    pub omega: Vector3<f64>,
    /// Angular acceleration in moving axes, rad/s².
    pub alpha: Vector3<f64>,
}

/// `(A, B, A'/φ, B'/φ)`.
fn coefficients(phi: f64) -> (f64, f64, f64, f64) {
    if phi < 0.05 {
        let s = phi * phi;
        (
            0.5 - s / 24.0 * (1.0 - s / 30.0),
            (1.0 - s / 20.0 * (1.0 - s / 42.0)) / 6.0,
            -1.0 / 12.0 + s / 180.0 - s * s / 6720.0,
            -1.0 / 60.0 + s / 1260.0 - s * s / 60480.0,
        )
    } else {
        let (sin, cos) = phi.sin_cos();
        let (p2, p3) = (phi * phi, phi * phi * phi);
        let (a, b) = ((1.0 - cos) / p2, (phi - sin) / p3);
        let da = sin / p2 - 2.0 * (1.0 - cos) / p3;
        let db = (1.0 - cos) / p3 - 3.0 * (phi - sin) / (p2 * p2);
        (a, b, da / phi, db / phi)
    }
}

/// The angular motion corresponding to a rotation vector with two derivatives.
pub fn from_vector(theta: &Vector3<f64>, rate: &Vector3<f64>, accel: &Vector3<f64>) -> Rotation {
    let (a, b, da, db) = coefficients(theta.norm());
    let dot = theta.dot(rate);
    let cross = theta.cross(rate);
    let double = theta.cross(&cross);
    let cross_accel = theta.cross(accel);
    Rotation {
        rotation: UnitQuaternion::from_scaled_axis(*theta),
        omega: rate - cross * a + double * b,
        alpha: accel - cross_accel * a - cross * (da * dot)
            + double * (db * dot)
            + (rate.cross(&cross) + theta.cross(&cross_accel)) * b,
    }
}

/// Rotation vector and its two derivatives of an angular motion (the branch |θ| ≤ π).
pub fn to_vector(motion: &Rotation) -> (Vector3<f64>, Vector3<f64>, Vector3<f64>) {
    let theta = motion.rotation.scaled_axis();
    let (a, b, _, _) = coefficients(theta.norm());
    let skew = theta.cross_matrix();
    let jacobian = Matrix3::identity() - skew * a + skew * skew * b;
    // det J_r = 2(1 − cos φ)/φ², zero only at φ = 2π, which scaled_axis never returns
    let inverse = jacobian.try_inverse().unwrap_or_else(Matrix3::identity);
    let rate = inverse * motion.omega;
    let bias = from_vector(&theta, &rate, &Vector3::zeros()).alpha;
    (theta, rate, inverse * (motion.alpha - bias))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rates_agree_with_differences() {
        let curve = |t: f64, s: f64| Vector3::new(s * (1.0 + t).sin(), s * (0.3 + 2.0 * t * t), s * (0.7 - t));
        for s in [1e-3, 0.04, 0.06, 0.5, 1.3] {
            let at = |t: f64| {
                let h = 1e-4;
                let (p, m, c) = (curve(t + h, s), curve(t - h, s), curve(t, s));
                from_vector(&c, &((p - m) / (2.0 * h)), &((p - c * 2.0 + m) / (h * h)))
            };
            let h = 1e-4;
            let (m0, p) = (at(0.2), at(0.2 + h));
            let m = at(0.2 - h);
            let omega = (m.rotation.inverse() * p.rotation).scaled_axis() / (2.0 * h);
            assert!((omega - m0.omega).norm() < 1e-6 * s.max(1e-2), "{omega} {}", m0.omega);
            assert!(((p.omega - m.omega) / (2.0 * h) - m0.alpha).norm() < 1e-5, "scale {s}");
        }
    }

    #[test]
    fn vector_and_back() {
        for s in [1e-9, 1e-3, 0.049, 0.051, 1.0, 2.9] {
            let theta = Vector3::new(0.4, -0.8, 0.447_213_595).normalize() * s;
            let (rate, accel) = (Vector3::new(3.0, -2.0, 1.0), Vector3::new(-20.0, 5.0, 8.0));
            let (t, r, a) = to_vector(&from_vector(&theta, &rate, &accel));
            assert!((t - theta).norm() < 1e-12 && (r - rate).norm() < 1e-10 && (a - accel).norm() < 1e-9, "{s}");
        }
    }
}
