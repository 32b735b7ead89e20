//! Conversion from our Z-up world to OpenSim's Y-up world.

use nalgebra::{Matrix3, Rotation3, Vector3};

/// Rotation from the Z-up world to OpenSim's ground (Y up): `(x, y, z) → (x, z, −y)`. A person who
/// faces +X stands along the ground's axes (X forward, Y up, Z right). Entries are 0 and ±1, so
/// nothing is rounded.
pub fn ground_from_world() -> Rotation3<f64> {
    Rotation3::from_matrix_unchecked(Matrix3::new(1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, -1.0, 0.0))
}

/// A vector of the world in ground axes.
pub fn to_ground(v: &Vector3<f64>) -> Vector3<f64> {
    Vector3::new(v.x, v.z, -v.y)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn up_becomes_y_and_the_rotation_is_proper() {
        let r = ground_from_world();
        assert_eq!(r.matrix().determinant(), 1.0);
        assert_eq!(r * Vector3::z(), Vector3::y());
        let v = Vector3::new(1.0, 2.0, 3.0);
        assert_eq!(r * v, to_ground(&v));
    }
}
