//! Scratch memory of one frame, and the algorithms that fill it. Nothing here allocates after
//! [`State::new`].
//!
//! This file contains kinematics; dynamics and regressors are in their own files as further methods
//! of [`State`].

use crate::rotation::{product, rotation_matrix, times, transposed_times};
use crate::{JointKind, Model, Phi};
use nalgebra::{DMatrix, Isometry3, Matrix3, Quaternion, UnitQuaternion, Vector3, Vector6};

/// Poses, velocities and accelerations of every link at one instant.
#[derive(Debug, Clone)]
pub struct State {
    /// Pose of each link in the world.
    pub world_from_link: Vec<Isometry3<f64>>,
    /// Spatial velocity of each link at its origin in its own axes: linear m/s, angular rad/s.
    pub velocity: Vec<Vector6<f64>>,
    /// Spatial acceleration (without gravity), as Pinocchio's `data.a`: linear part is d/dt of the
    /// body-fixed linear velocity components.
    pub acceleration: Vec<Vector6<f64>>,
    /// Rotation of `world_from_link` as a matrix.
    pub(crate) rotation: Vec<Matrix3<f64>>,
    /// Rotation of each link in its parent (world for the root).
    pub(crate) parent_from_link: Vec<Matrix3<f64>>,
    /// Origin of each link in its parent, m.
    pub(crate) origin_in_parent: Vec<Vector3<f64>>,
    /// Forces on the links in backward passes.
    pub(crate) wrench: Vec<Vector6<f64>>,
    /// Composite inertias in backward passes.
    pub(crate) composite: Vec<Phi>,
}

pub(crate) fn linear(twist: &Vector6<f64>) -> Vector3<f64> {
    Vector3::new(twist[0], twist[1], twist[2])
}

pub(crate) fn angular(twist: &Vector6<f64>) -> Vector3<f64> {
    Vector3::new(twist[3], twist[4], twist[5])
}

pub(crate) fn spatial(linear: &Vector3<f64>, angular: &Vector3<f64>) -> Vector6<f64> {
    Vector6::new(linear.x, linear.y, linear.z, angular.x, angular.y, angular.z)
}

fn vector_at(values: &[f64], first: usize) -> Vector3<f64> {
    Vector3::new(values[first], values[first + 1], values[first + 2])
}

/// Contribution of a joint to a twist or its derivative, in link axes.
fn joint_motion(kind: &JointKind, values: &[f64], first: usize) -> (Vector3<f64>, Vector3<f64>) {
    match kind {
        JointKind::Free => (vector_at(values, first), vector_at(values, first + 3)),
        JointKind::Spherical => (Vector3::zeros(), vector_at(values, first)),
        JointKind::Revolute(axis) => (Vector3::zeros(), axis.into_inner() * values[first]),
        JointKind::Prismatic(axis) => (axis.into_inner() * values[first], Vector3::zeros()),
        JointKind::Fixed => (Vector3::zeros(), Vector3::zeros()),
    }
}

impl State {
    /// Scratch memory for a model with this number of links. It stores no data of the model, so
    /// joint positions may change between calls.
    pub fn new(model: &Model) -> Self {
        let n = model.n_links();
        Self {
            world_from_link: vec![Isometry3::identity(); n],
            velocity: vec![Vector6::zeros(); n],
            acceleration: vec![Vector6::zeros(); n],
            rotation: vec![Matrix3::identity(); n],
            parent_from_link: vec![Matrix3::identity(); n],
            origin_in_parent: vec![Vector3::zeros(); n],
            wrench: vec![Vector6::zeros(); n],
            composite: vec![Phi::zeros(); n],
        }
    }

    /// Poses only. Quaternions in `q` need not have unit length.
    ///
    /// # Panics
    /// If `q` is shorter than `nq`, or the model has more links than the one this state was made
    /// for.
    pub fn forward_position(&mut self, model: &Model, q: &[f64]) {
        for (i, link) in model.links.iter().enumerate() {
            let joint = &link.joint;
            let base = &joint.parent_from_joint;
            let iq = joint.q_offset;
            let (origin, quaternion) = match &joint.kind {
                JointKind::Free => {
                    let p = base.transform_point(&vector_at(q, iq).into()).coords;
                    (p, base.rotation * unit_quaternion(q[iq + 3], q[iq + 4], q[iq + 5], q[iq + 6]))
                }
                JointKind::Spherical => {
                    let turn = unit_quaternion(q[iq], q[iq + 1], q[iq + 2], q[iq + 3]);
                    (base.translation.vector, base.rotation * turn)
                }
                JointKind::Revolute(axis) => {
                    let (s, c) = (0.5 * q[iq]).sin_cos();
                    let turn = UnitQuaternion::new_unchecked(Quaternion::new(c, axis.x * s, axis.y * s, axis.z * s));
                    (base.translation.vector, base.rotation * turn)
                }
                JointKind::Prismatic(axis) => {
                    (base.translation.vector + base.rotation * (axis.into_inner() * q[iq]), base.rotation)
                }
                JointKind::Fixed => (base.translation.vector, base.rotation),
            };
            let local = rotation_matrix(&quaternion);
            self.parent_from_link[i] = local;
            self.origin_in_parent[i] = origin;
            match link.parent {
                None => {
                    self.rotation[i] = local;
                    self.world_from_link[i] = Isometry3::from_parts(origin.into(), quaternion);
                }
                Some(p) => {
                    let parent = self.world_from_link[p];
                    self.rotation[i] = product(&self.rotation[p], &local);
                    self.world_from_link[i] = Isometry3::from_parts(
                        (parent.translation.vector + times(&self.rotation[p], &origin)).into(),
                        parent.rotation * quaternion,
                    );
                }
            }
        }
    }

    /// Poses and velocities.
    ///
    /// # Panics
    /// As [`State::forward_position`]; also if `v` is shorter than `nv`.
    pub fn forward_velocity(&mut self, model: &Model, q: &[f64], v: &[f64]) {
        self.forward_position(model, q);
        for (i, link) in model.links.iter().enumerate() {
            let (mut lin, mut ang) = joint_motion(&link.joint.kind, v, link.joint.v_offset);
            if let Some(p) = link.parent {
                let (parent_lin, parent_ang) = (linear(&self.velocity[p]), angular(&self.velocity[p]));
                let r = &self.parent_from_link[i];
                lin += transposed_times(r, &(parent_lin + parent_ang.cross(&self.origin_in_parent[i])));
                ang += transposed_times(r, &parent_ang);
            }
            self.velocity[i] = spatial(&lin, &ang);
        }
    }

    /// Poses, velocities and accelerations.
    ///
    /// # Panics
    /// As [`State::forward_velocity`]; also if `a` is shorter than `nv`.
    pub fn forward_acceleration(&mut self, model: &Model, q: &[f64], v: &[f64], a: &[f64]) {
        self.forward_velocity(model, q, v);
        for (i, link) in model.links.iter().enumerate() {
            let (mut lin, mut ang) = joint_motion(&link.joint.kind, a, link.joint.v_offset);
            if let Some(p) = link.parent {
                let (parent_lin, parent_ang) = (linear(&self.acceleration[p]), angular(&self.acceleration[p]));
                let r = &self.parent_from_link[i];
                lin += transposed_times(r, &(parent_lin + parent_ang.cross(&self.origin_in_parent[i])));
                ang += transposed_times(r, &parent_ang);
                // Motion of the joint's own axes: the link's twist crossed with the joint's
                // contribution to it.
                let (joint_lin, joint_ang) = joint_motion(&link.joint.kind, v, link.joint.v_offset);
                let (link_lin, link_ang) = (linear(&self.velocity[i]), angular(&self.velocity[i]));
                lin += link_ang.cross(&joint_lin) + link_lin.cross(&joint_ang);
                ang += link_ang.cross(&joint_ang);
            }
            self.acceleration[i] = spatial(&lin, &ang);
        }
    }

    /// Rotation of a link in the world as a matrix. Needs poses.
    pub fn rotation(&self, link: usize) -> &Matrix3<f64> {
        &self.rotation[link]
    }

    /// World position of a point of a link.
    pub fn point_in_world(&self, link: usize, point_in_link: &Vector3<f64>) -> Vector3<f64> {
        self.world_from_link[link].translation.vector + self.rotation[link] * point_in_link
    }

    /// World velocity of a point of a link, m/s. Needs [`State::forward_velocity`].
    pub fn point_velocity_in_world(&self, link: usize, point_in_link: &Vector3<f64>) -> Vector3<f64> {
        let v = &self.velocity[link];
        self.rotation[link] * (linear(v) + angular(v).cross(point_in_link))
    }

    /// World acceleration (classical, without gravity) of a point of a link, m/s². Needs
    /// [`State::forward_acceleration`].
    pub fn point_acceleration_in_world(&self, link: usize, point_in_link: &Vector3<f64>) -> Vector3<f64> {
        let (v, a) = (&self.velocity[link], &self.acceleration[link]);
        let (lin, ang) = (linear(v), angular(v));
        let classical = linear(a) + ang.cross(&lin);
        self.rotation[link] * (classical + angular(a).cross(point_in_link) + ang.cross(&ang.cross(point_in_link)))
    }

    /// 3 × nv Jacobian of a point's world position by `v`, written into `out` (columns of joints
    /// that do not move the point are zero). Needs poses.
    ///
    /// # Panics
    /// If `out` is not 3 × nv.
    pub fn point_jacobian(&self, model: &Model, link: usize, point_in_link: &Vector3<f64>, out: &mut DMatrix<f64>) {
        assert_eq!(out.shape(), (3, model.nv), "shape of a point Jacobian");
        out.fill(0.0);
        let point = self.point_in_world(link, point_in_link);
        let columns = out.as_mut_slice();
        let mut set = |column: usize, value: Vector3<f64>| {
            columns[3 * column..3 * column + 3].copy_from_slice(value.as_slice());
        };
        let mut next = Some(link);
        while let Some(i) = next {
            let joint = &model.links[i].joint;
            let iv = joint.v_offset;
            let r = &self.rotation[i];
            let arm = point - self.world_from_link[i].translation.vector;
            match &joint.kind {
                JointKind::Free => {
                    for k in 0..3 {
                        let axis: Vector3<f64> = r.column(k).into_owned();
                        set(iv + k, axis);
                        set(iv + 3 + k, axis.cross(&arm));
                    }
                }
                JointKind::Spherical => {
                    for k in 0..3 {
                        let axis: Vector3<f64> = r.column(k).into_owned();
                        set(iv + k, axis.cross(&arm));
                    }
                }
                JointKind::Revolute(axis) => set(iv, (r * axis.into_inner()).cross(&arm)),
                JointKind::Prismatic(axis) => set(iv, r * axis.into_inner()),
                JointKind::Fixed => {}
            }
            next = model.links[i].parent;
        }
    }
}

fn unit_quaternion(x: f64, y: f64, z: f64, w: f64) -> UnitQuaternion<f64> {
    let scale = 1.0 / (x * x + y * y + z * z + w * w).sqrt();
    UnitQuaternion::new_unchecked(Quaternion::new(w * scale, x * scale, y * scale, z * scale))
}
