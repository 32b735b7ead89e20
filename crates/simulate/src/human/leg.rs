//! One leg in closed form: hip, knee and ankle from the poses of pelvis and foot.

use nalgebra::{Isometry3, Matrix3, Rotation3, UnitQuaternion, Vector3};

/// Geometry of a leg.
#[derive(Debug, Clone)]
pub struct Leg {
    /// Hip centre in the pelvis frame, m.
    pub hip: Vector3<f64>,
    /// Pose of the shank in the thigh at zero knee angle.
    pub knee: Isometry3<f64>,
    /// Ankle centre in the shank frame, m.
    pub ankle: Vector3<f64>,
}

/// Coordinates of a leg: hip rotation, knee angle (flexion negative), ankle rotation.
#[derive(Debug, Clone, Copy)]
pub struct LegPosture {
    /// Orientation of the thigh in the pelvis.
    pub hip: UnitQuaternion<f64>,
    /// Knee angle, rad.
    pub knee: f64,
    /// Orientation of the foot in the shank.
    pub ankle: UnitQuaternion<f64>,
}

impl Leg {
    fn knee_rotation(&self, angle: f64) -> UnitQuaternion<f64> {
        self.knee.rotation * UnitQuaternion::from_axis_angle(&Vector3::z_axis(), angle)
    }

    /// Lateral reference direction of the swivel: between those of the pelvis and of the foot.
    fn reference(&self, pelvis: &UnitQuaternion<f64>, foot: &UnitQuaternion<f64>) -> Vector3<f64> {
        pelvis * Vector3::z() + foot * Vector3::z()
    }

    /// Posture of the leg between a pelvis pose and a foot pose, with the knee rotated by `swivel`
    /// (rad) about the line from hip to ankle. `None` if the leg is too short or too long.
    pub fn solve(&self, pelvis: &Isometry3<f64>, foot: &Isometry3<f64>, swivel: f64) -> Option<LegPosture> {
        let hip = pelvis.transform_point(&self.hip.into()).coords;
        let line = foot.translation.vector - hip;
        let distance = line.norm();
        let knee = self.bend(distance)?;
        let ankle_in_thigh = self.knee.translation.vector + self.knee_rotation(knee) * self.ankle;
        let lateral = self.reference(&pelvis.rotation, &foot.rotation);
        let along = line / distance;
        let turn = UnitQuaternion::from_scaled_axis(along * swivel);
        let from = frame(&(ankle_in_thigh / distance), &Vector3::z());
        let to = frame(&along, &(turn * lateral));
        let thigh = UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(to * from.transpose()));
        let shank = thigh * self.knee_rotation(knee);
        Some(LegPosture { hip: pelvis.rotation.inverse() * thigh, knee, ankle: shank.inverse() * foot.rotation })
    }

    /// Knee angle for a given distance between hip and ankle, on the flexed side.
    fn bend(&self, distance: f64) -> Option<f64> {
        let (l1, l2) = (self.knee.rotation.inverse() * self.knee.translation.vector, self.ankle);
        // |l1 + Rz(κ) l2|² = |l1|² + |l2|² + 2 (A cos κ + B sin κ + C)
        let a = l1.x * l2.x + l1.y * l2.y;
        let b = l1.y * l2.x - l1.x * l2.y;
        let c = l1.z * l2.z;
        let want = 0.5 * (distance * distance - l1.norm_squared() - l2.norm_squared()) - c;
        let cosine = want / a.hypot(b);
        (cosine.abs() < 1.0).then(|| b.atan2(a) - cosine.acos())
    }

    /// Swivel of a posture: inverse of [`Leg::solve`].
    pub fn swivel(&self, pelvis: &Isometry3<f64>, posture: &LegPosture) -> f64 {
        let thigh = pelvis.rotation * posture.hip;
        let shank = thigh * self.knee_rotation(posture.knee);
        let foot = shank * posture.ankle;
        let along =
            (thigh * (self.knee.translation.vector + self.knee_rotation(posture.knee) * self.ankle)).normalize();
        let flat = |v: Vector3<f64>| v - along * along.dot(&v);
        let (from, to) = (flat(self.reference(&pelvis.rotation, &foot)), flat(thigh * Vector3::z()));
        along.dot(&from.cross(&to)).atan2(from.dot(&to))
    }
}

/// A right-handed frame whose first axis is `along` (unit) and whose third lies towards `lateral`.
fn frame(along: &Vector3<f64>, lateral: &Vector3<f64>) -> Matrix3<f64> {
    let third = (lateral - along * along.dot(lateral)).normalize();
    Matrix3::from_columns(&[*along, third.cross(along), third])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn leg_reaches_its_foot() {
        let leg = Leg {
            hip: Vector3::new(0.0, 0.0, 0.09),
            knee: Isometry3::new(Vector3::new(0.0, -0.4, 0.0), Vector3::new(0.02, -0.03, 0.0)),
            ankle: Vector3::new(0.0, -0.39, 0.0),
        };
        let pelvis = Isometry3::new(Vector3::new(0.1, 0.0, 0.8), Vector3::new(1.5, 0.1, 0.2));
        let foot = Isometry3::new(Vector3::new(0.12, -0.05, 0.1), Vector3::new(1.6, 0.0, 0.0));
        for swivel in [-0.3, 0.0, 0.2] {
            let p = leg.solve(&pelvis, &foot, swivel).expect("reach");
            let thigh = pelvis * Isometry3::from_parts(leg.hip.into(), p.hip);
            let shank = thigh * leg.knee * Isometry3::rotation(Vector3::z() * p.knee);
            let got = shank * Isometry3::from_parts(leg.ankle.into(), p.ankle);
            assert!((got.translation.vector - foot.translation.vector).norm() < 1e-12);
            assert!(got.rotation.angle_to(&foot.rotation) < 1e-7);
            assert!(p.knee < 0.0 && (leg.swivel(&pelvis, &p) - swivel).abs() < 1e-10);
        }
        let far = Isometry3::new(Vector3::new(0.12, -0.05, -0.3), Vector3::zeros());
        assert!(leg.solve(&pelvis, &far, 0.0).is_none());
    }
}
