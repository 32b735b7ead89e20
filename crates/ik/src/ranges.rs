//! How far joints of a person reach: soft limits of inverse kinematics, and a report where they
//! act.
//!
//! Ranges are wide: the largest that clinical tables and gymnasts show, and some 15° more for the
//! errors of joint frames. They keep a posture from a wrong branch; they do not shape a right one.
//! What they report is nearly always a wrong branch, a label on the wrong marker, or a joint centre
//! in the wrong place.
//!
//! The rotation of a spherical joint is a twist about the link's long axis (y), followed by a swing
//! of that axis. The swing is limited by an ellipse with four half axes (forwards, backwards,
//! sideways), the twist by an interval. The shoulder has no limits: its long axis reaches nearly
//! every direction, where a twist is not defined. Hinges are limited by their flexion
//! ([`IkOptions`](crate::IkOptions)).

use serde::{Deserialize, Serialize};

/// Range of a spherical joint, degrees from the model's neutral posture.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct JointRange {
    /// Largest turn about +z: flexion of hips and ankles, extension of the trunk.
    pub forwards_deg: f64,
    /// Largest turn about −z.
    pub backwards_deg: f64,
    /// Largest turn about x, both ways: abduction, adduction, bending to a side.
    pub sideways_deg: f64,
    /// Largest twist about the long axis, both ways.
    pub twist_deg: f64,
}

/// Ranges of the links of a person (`human34` and models with links of the same names).
pub(crate) fn of_person() -> impl Iterator<Item = (String, JointRange)> {
    let range = |forwards_deg, backwards_deg, sideways_deg, twist_deg| JointRange {
        forwards_deg,
        backwards_deg,
        sideways_deg,
        twist_deg,
    };
    [
        ("torso", range(70.0, 115.0, 65.0, 80.0)),
        ("head", range(100.0, 100.0, 75.0, 110.0)),
        ("thigh_r", range(155.0, 65.0, 85.0, 85.0)),
        ("thigh_l", range(155.0, 65.0, 85.0, 85.0)),
        ("foot_r", range(65.0, 85.0, 65.0, 65.0)),
        ("foot_l", range(65.0, 85.0, 65.0, 65.0)),
        ("hand_r", range(115.0, 115.0, 90.0, 150.0)),
        ("hand_l", range(115.0, 115.0, 90.0, 150.0)),
    ]
    .into_iter()
    .map(|(name, range)| (name.to_owned(), range))
}

/// The limit of one joint, rad.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Limit {
    pub link: usize,
    pub q_index: usize,
    pub v_index: usize,
    forwards: f64,
    backwards: f64,
    sideways: f64,
    twist: f64,
    /// Square of the cosine of half the smallest swing that reaches the limit.
    surely_within: f64,
    /// Tangent of half the largest twist.
    half_twist: f64,
}

/// Relative distance from a limit within which rounding could decide.
const NEAR_LIMIT: f64 = 1e-9;

impl Limit {
    pub fn new(link: usize, q_index: usize, v_index: usize, range: &JointRange) -> Self {
        let smallest = range.forwards_deg.min(range.backwards_deg).min(range.sideways_deg).clamp(0.0, 180.0);
        Self {
            link,
            q_index,
            v_index,
            forwards: range.forwards_deg.to_radians(),
            backwards: range.backwards_deg.to_radians(),
            sideways: range.sideways_deg.to_radians(),
            twist: range.twist_deg.to_radians(),
            surely_within: (0.5 * smallest.to_radians()).cos().powi(2) * (1.0 + NEAR_LIMIT) + f64::MIN_POSITIVE,
            half_twist: (0.5 * range.twist_deg.clamp(0.0, 180.0).to_radians()).tan() * (1.0 - NEAR_LIMIT),
        }
    }

    /// Excess of swing and twist beyond the range, rad, of the quaternion `[x y z w]`.
    pub fn excess(&self, q: &[f64]) -> [f64; 2] {
        let (x, y, z, w) = (q[0], q[1], q[2], q[3]);
        // within the circle inside the ellipse no angle has to be known
        let upright = y * y + w * w;
        if upright > self.surely_within * (upright + x * x + z * z) && y.abs() < self.half_twist * w.abs() {
            return [0.0; 2];
        }
        let length = y.hypot(w);
        if length < 1e-9 {
            // half a turn of the long axis: the twist is not defined
            let reach = self.forwards.min(self.backwards).min(self.sideways);
            return [(std::f64::consts::PI - reach).max(0.0), 0.0];
        }
        let mut twist = 2.0 * y.atan2(w);
        twist -= std::f64::consts::TAU * (twist / std::f64::consts::TAU).round();
        // swing = q · twist⁻¹, with its scalar part positive
        let (c, s) = (w / length, y / length);
        let (sx, sz) = (x * c + z * s, z * c - x * s);
        let sine = sx.hypot(sz);
        let angle = 2.0 * sine.atan2(length);
        let swing = if sine > 0.0 {
            let along = if sz > 0.0 { self.forwards } else { self.backwards };
            let stretch = (sz / sine / along).hypot(sx / sine / self.sideways);
            (angle - 1.0 / stretch).max(0.0)
        } else {
            0.0
        };
        [swing, twist.signum() * (twist.abs() - self.twist).max(0.0)]
    }

    /// Derivatives of [`Limit::excess`] along rotations of the link about its own axes.
    pub fn slopes(&self, q: &[f64]) -> [[f64; 3]; 2] {
        const STEP: f64 = 1e-5;
        let mut out = [[0.0; 3]; 2];
        for axis in 0..3 {
            let side = |sign: f64| {
                let mut half = [0.0; 3];
                half[axis] = 0.5 * sign * STEP;
                let [a, b, c] = half;
                let (x, y, z, w) = (q[0], q[1], q[2], q[3]);
                let turned = [
                    x + w * a + y * c - z * b,
                    y + w * b + z * a - x * c,
                    z + w * c + x * b - y * a,
                    w - x * a - y * b - z * c,
                ];
                self.excess(&turned)
            };
            let (plus, minus) = (side(1.0), side(-1.0));
            for part in 0..2 {
                out[part][axis] = (plus[part] - minus[part]) / (2.0 * STEP);
            }
        }
        out
    }
}

/// A joint that goes beyond its range in a trial.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct BeyondRange {
    /// Name of the link beyond the joint.
    pub link: String,
    /// Frames in which it does.
    pub n_frames: usize,
    /// Frame in which it goes farthest, counted from zero.
    pub worst_frame: usize,
    /// Excess there, degrees.
    pub worst_deg: f64,
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::{UnitQuaternion, Vector3};

    fn thigh() -> Limit {
        let range = JointRange { forwards_deg: 150.0, backwards_deg: 60.0, sideways_deg: 80.0, twist_deg: 80.0 };
        Limit::new(1, 0, 0, &range)
    }

    fn excess_deg(turns: &[(Vector3<f64>, f64)]) -> [f64; 2] {
        let q = turns.iter().fold(UnitQuaternion::identity(), |q, (axis, deg)| {
            q * UnitQuaternion::from_scaled_axis(axis * deg.to_radians())
        });
        let found = thigh().excess(&[q.i, q.j, q.k, q.w]).map(f64::to_degrees);
        // the same rotation, with the other sign of the quaternion
        let other = thigh().excess(&[-q.i, -q.j, -q.k, -q.w]).map(f64::to_degrees);
        assert!((found[0] - other[0]).abs() < 1e-9 && (found[1] - other[1]).abs() < 1e-9);
        found
    }

    #[test]
    fn swing_and_twist_beyond_the_range() {
        let (x, y, z) = (Vector3::x(), Vector3::y(), Vector3::z());
        let near = |a: [f64; 2], b: [f64; 2]| (a[0] - b[0]).abs() < 1e-6 && (a[1] - b[1]).abs() < 1e-6;
        assert!(near(excess_deg(&[(z, 140.0)]), [0.0, 0.0]));
        assert!(near(excess_deg(&[(z, -75.0)]), [15.0, 0.0]));
        assert!(near(excess_deg(&[(x, -90.0)]), [10.0, 0.0]));
        assert!(near(excess_deg(&[(z, 100.0), (y, 60.0)]), [0.0, 0.0]));
        assert!(near(excess_deg(&[(z, 20.0), (y, 170.0)]), [0.0, 90.0]));
        assert!(near(excess_deg(&[(z, 20.0), (y, -100.0)]), [0.0, -20.0]));
        // obliquely: on the ellipse of 150° and 80°
        let direction = (x + z).normalize();
        let radius = 1.0 / (0.5 / 150.0_f64.powi(2) + 0.5 / 80.0_f64.powi(2)).sqrt();
        assert!(near(excess_deg(&[(direction, radius + 7.0)]), [7.0, 0.0]));
    }

    /// The circle of angles that are not computed lies inside the limits, up to them.
    #[test]
    fn within_the_range_without_angles() {
        let near = Limit { surely_within: f64::INFINITY, ..thigh() };
        let mut counts = [0; 3];
        for i in 0..200 {
            for (axis, far) in [(Vector3::z(), 1.0), (Vector3::x(), 1.0), (Vector3::new(0.7, 0.0, -0.7), 0.5)] {
                let swing = UnitQuaternion::from_scaled_axis(axis * (far * (f64::from(i) * 0.02 - 2.0)));
                for twist in [-1.5, -80f64.to_radians(), -0.3, 0.0, 1.396, 80f64.to_radians(), 2.0] {
                    let q = swing * UnitQuaternion::from_scaled_axis(Vector3::y() * twist);
                    let q = [q.i, q.j, q.k, q.w];
                    let (found, full) = (thigh().excess(&q), near.excess(&q));
                    assert_eq!(found, full, "{q:?}");
                    counts[full.iter().filter(|x| **x != 0.0).count()] += 1;
                }
            }
        }
        assert!(counts.iter().all(|n| *n > 100), "{counts:?}");
    }

    #[test]
    fn slopes_are_derivatives() {
        let q = UnitQuaternion::from_scaled_axis(Vector3::new(0.4, 0.0, -1.4))
            * UnitQuaternion::from_scaled_axis(Vector3::new(0.0, 1.6, 0.0));
        let limit = thigh();
        let at = |q: &UnitQuaternion<f64>| limit.excess(&[q.i, q.j, q.k, q.w]);
        let slopes = limit.slopes(&[q.i, q.j, q.k, q.w]);
        let small = Vector3::new(2e-4, -1e-4, 3e-4);
        let (here, there) = (at(&q), at(&(q * UnitQuaternion::from_scaled_axis(small))));
        assert!(here[0] > 0.1 && here[1] > 0.1);
        for part in 0..2 {
            let foreseen: f64 = (0..3).map(|i| slopes[part][i] * small[i]).sum();
            assert!((there[part] - here[part] - foreseen).abs() < 2e-6, "{part}");
        }
    }
}
