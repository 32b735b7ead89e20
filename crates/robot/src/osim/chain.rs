//! Poses of the bodies as functions of the file's coordinates, and what each coordinate turns and
//! moves.

use super::model::{Axis, Joint, OsimModel};
use nalgebra::{Isometry3, Translation3, UnitQuaternion, Vector3};

/// What one coordinate does at one joint, in ground axes, per unit of the coordinate.
#[derive(Debug, Clone, Copy)]
pub(super) struct Twist {
    pub coordinate: usize,
    /// Angular velocity.
    pub turn: Vector3<f64>,
    /// Velocity of the moving frame's origin.
    pub shift: Vector3<f64>,
    /// The moving frame's origin, m.
    pub origin: Vector3<f64>,
}

impl Twist {
    /// Velocity of a point of a body beyond the joint.
    pub fn of_point(&self, point: &Vector3<f64>) -> Vector3<f64> {
        self.shift + self.turn.cross(&(point - self.origin))
    }
}

fn argument(axis: &Axis, values: &[f64]) -> f64 {
    axis.coordinate.and_then(|c| values.get(c)).copied().unwrap_or(0.0)
}

impl Joint {
    /// The moving frame in the joint's frame on the parent.
    pub(super) fn moved(&self, values: &[f64]) -> Isometry3<f64> {
        let value = |a: &Axis| a.function.value(argument(a, values));
        let turn = |r: UnitQuaternion<f64>, a: &Axis| r * UnitQuaternion::from_scaled_axis(a.axis * value(a));
        let rotation = self.rotations.iter().fold(UnitQuaternion::identity(), turn);
        let shift = self.translations.iter().fold(Vector3::zeros(), |t, a| t + a.axis * value(a));
        Isometry3::from_parts(Translation3::from(shift), rotation)
    }

    /// The body in its parent's frame.
    pub(super) fn body_in_parent(&self, values: &[f64]) -> Isometry3<f64> {
        self.parent_from_joint * self.moved(values) * self.body_from_joint.inverse()
    }
}

impl OsimModel {
    /// Sets coordinates that are functions of others.
    pub(super) fn couple(&self, values: &mut [f64]) {
        for (i, c) in self.all.iter().enumerate() {
            if let Some((on, function)) = &c.follows {
                values[i] = function.value(values[*on]);
            }
        }
    }

    /// Poses of the bodies in the ground, by joint.
    pub(super) fn poses(&self, values: &[f64]) -> Vec<Isometry3<f64>> {
        let mut out: Vec<Isometry3<f64>> = Vec::with_capacity(self.joints.len());
        for joint in &self.joints {
            let parent = joint.parent.map_or(Isometry3::identity(), |p| out[p]);
            out.push(parent * joint.body_in_parent(values));
        }
        out
    }

    /// What the coordinates do at each joint with a pose; couplings are resolved to the coordinates
    /// that they follow.
    pub(super) fn twists(&self, values: &[f64], poses: &[Isometry3<f64>]) -> Vec<Vec<Twist>> {
        self.joints
            .iter()
            .take(poses.len())
            .map(|joint| {
                let parent = joint.parent.map_or(Isometry3::identity(), |p| poses[p]);
                let base = parent * joint.parent_from_joint;
                let origin = (base * joint.moved(values)).translation.vector;
                let mut out = Vec::new();
                let mut rotation = base.rotation;
                for axis in &joint.rotations {
                    let turn = rotation * axis.axis;
                    out.extend(self.twist(axis, values, turn, Vector3::zeros(), origin));
                    let angle = axis.function.value(argument(axis, values));
                    rotation *= UnitQuaternion::from_scaled_axis(axis.axis * angle);
                }
                for axis in &joint.translations {
                    out.extend(self.twist(axis, values, Vector3::zeros(), base.rotation * axis.axis, origin));
                }
                out
            })
            .collect()
    }

    fn twist(
        &self,
        axis: &Axis,
        values: &[f64],
        turn: Vector3<f64>,
        shift: Vector3<f64>,
        origin: Vector3<f64>,
    ) -> Option<Twist> {
        let own = axis.coordinate?;
        let slope = axis.function.slope(values[own]);
        let (coordinate, slope) = match &self.all[own].follows {
            None => (own, slope),
            Some((on, function)) => (*on, slope * function.slope(values[*on])),
        };
        (slope != 0.0).then_some(Twist { coordinate, turn: turn * slope, shift: shift * slope, origin })
    }

    /// Joints from the root to this one.
    pub(super) fn path(&self, joint: usize) -> Vec<usize> {
        let mut out = vec![joint];
        let mut at = joint;
        while let Some(parent) = self.joints[at].parent {
            out.push(parent);
            at = parent;
        }
        out.reverse();
        out
    }
}
