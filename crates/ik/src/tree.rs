//! The kinematic tree in a flat layout for tracking: poses, velocity-space columns in the world,
//! retraction.
//!
//! Inverse kinematics evaluates the same few quantities several hundred thousand times per second,
//! so this file stores them in the form in which they are used: rotations as matrices, one *column*
//! (a motion vector) for each velocity-space coordinate, and for every column the list of columns
//! above it in the tree. Coordinates and velocities are those of [`aloft_body::Model`]: velocities
//! of free and spherical joints are in the axes of the moving link.

use aloft_body::{JointKind, Model};
use nalgebra::{Matrix3, Quaternion, Rotation3, UnitQuaternion, Vector3};

/// Index that means "no parent".
pub(crate) const NONE: usize = usize::MAX;

/// One link with the joint that carries it.
#[derive(Debug, Clone)]
pub(crate) struct TreeLink {
    pub name: String,
    pub parent: usize,
    pub kind: JointKind,
    /// Rotation of `parent_from_joint`.
    pub rotation: Matrix3<f64>,
    /// True if `rotation` is the identity, so that a product can be skipped.
    pub aligned: bool,
    /// Translation of `parent_from_joint`, m.
    pub translation: Vector3<f64>,
    pub q_offset: usize,
    pub v_offset: usize,
}

/// The columns of one joint: consecutive, and all have the ancestors of the first.
#[derive(Debug, Clone, Copy)]
pub(crate) struct JointColumns {
    pub link: usize,
    pub first: usize,
    pub count: usize,
}

/// The tree in flat layout.
#[derive(Debug, Clone)]
pub(crate) struct Tree {
    pub links: Vec<TreeLink>,
    pub nq: usize,
    pub nv: usize,
    /// Columns of each joint that has any, root first.
    pub joints: Vec<JointColumns>,
    /// Link of each velocity-space column.
    pub column_link: Vec<usize>,
    /// Columns above each column, root first; `ancestors[i]` is a prefix of `ancestors[j]` for each
    /// i in it.
    pub ancestors: Vec<Vec<usize>>,
}

/// Poses of all links and the motion vector of each column.
#[derive(Debug, Clone)]
pub(crate) struct Pose {
    /// World from link.
    pub rotation: Vec<Matrix3<f64>>,
    /// Origin of each link in the world, m.
    pub origin: Vec<Vector3<f64>>,
    /// Point about which `linear` is given: the root's origin.
    pub reference: Vector3<f64>,
    /// Velocity of the (moved) body at the reference point for unit rate of a column.
    pub linear: Vec<Vector3<f64>>,
    /// Angular velocity for unit rate of a column.
    pub angular: Vec<Vector3<f64>>,
}

impl Tree {
    pub fn new(model: &Model) -> Self {
        let mut links = Vec::with_capacity(model.links.len());
        let mut joints = Vec::with_capacity(model.links.len());
        let mut column_link = Vec::with_capacity(model.nv);
        let mut ancestors: Vec<Vec<usize>> = Vec::with_capacity(model.nv);
        let mut last_column: Vec<usize> = Vec::with_capacity(model.links.len());
        for (index, link) in model.links.iter().enumerate() {
            let rotation = link.joint.parent_from_joint.rotation.to_rotation_matrix().into_inner();
            let parent = link.parent.unwrap_or(NONE);
            let above = if parent == NONE { NONE } else { last_column[parent] };
            let mut chain: Vec<usize> = Vec::new();
            if above != NONE {
                chain.extend_from_slice(&ancestors[above]);
                chain.push(above);
            }
            let mut last = above;
            let count = link.joint.kind.nv();
            if count > 0 {
                joints.push(JointColumns { link: index, first: link.joint.v_offset, count });
            }
            for i in 0..count {
                let column = link.joint.v_offset + i;
                column_link.push(index);
                ancestors.push(chain.clone());
                chain.push(column);
                last = column;
            }
            last_column.push(last);
            links.push(TreeLink {
                name: link.name.clone(),
                parent,
                kind: link.joint.kind,
                rotation,
                aligned: (rotation - Matrix3::identity()).amax() < 1e-15,
                translation: link.joint.parent_from_joint.translation.vector,
                q_offset: link.joint.q_offset,
                v_offset: link.joint.v_offset,
            });
        }
        Self { links, nq: model.nq, nv: model.nv, joints, column_link, ancestors }
    }

    pub fn pose(&self) -> Pose {
        let n = self.links.len();
        Pose {
            rotation: vec![Matrix3::identity(); n],
            origin: vec![Vector3::zeros(); n],
            reference: Vector3::zeros(),
            linear: vec![Vector3::zeros(); self.nv],
            angular: vec![Vector3::zeros(); self.nv],
        }
    }

    /// Poses of all links.
    pub fn forward(&self, q: &[f64], pose: &mut Pose) {
        for (index, link) in self.links.iter().enumerate() {
            self.forward_link(index, link, q, pose);
        }
    }

    /// Pose of one link; those above it must be up to date.
    pub fn forward_link(&self, index: usize, link: &TreeLink, q: &[f64], pose: &mut Pose) {
        let (mut rotation, mut origin) = if link.parent == NONE {
            (link.rotation, link.translation)
        } else {
            let above = pose.rotation[link.parent];
            let origin = pose.origin[link.parent] + above * link.translation;
            (if link.aligned { above } else { above * link.rotation }, origin)
        };
        let at = link.q_offset;
        match link.kind {
            JointKind::Free => {
                origin += rotation * Vector3::new(q[at], q[at + 1], q[at + 2]);
                rotation *= quaternion_matrix(&q[at + 3..at + 7]);
            }
            JointKind::Spherical => rotation *= quaternion_matrix(&q[at..at + 4]),
            JointKind::Revolute(axis) => rotation *= axis_angle_matrix(&axis, q[at]),
            JointKind::Prismatic(axis) => origin += rotation * axis.into_inner() * q[at],
            JointKind::Fixed => {}
        }
        pose.rotation[index] = rotation;
        pose.origin[index] = origin;
    }

    /// Motion vectors of all columns at the present poses.
    pub fn columns(&self, pose: &mut Pose) {
        pose.reference = pose.origin[0];
        for (index, link) in self.links.iter().enumerate() {
            let rotation = pose.rotation[index];
            let arm = pose.origin[index] - pose.reference;
            let mut turn = |column: usize, omega: Vector3<f64>| {
                pose.angular[column] = omega;
                pose.linear[column] = arm.cross(&omega);
            };
            let at = link.v_offset;
            match link.kind {
                JointKind::Free => {
                    for i in 0..3 {
                        turn(at + 3 + i, rotation.column(i).into_owned());
                    }
                    for i in 0..3 {
                        pose.angular[at + i] = Vector3::zeros();
                        pose.linear[at + i] = rotation.column(i).into_owned();
                    }
                }
                JointKind::Spherical => {
                    for i in 0..3 {
                        turn(at + i, rotation.column(i).into_owned());
                    }
                }
                JointKind::Revolute(axis) => turn(at, rotation * axis.into_inner()),
                JointKind::Prismatic(axis) => {
                    pose.angular[at] = Vector3::zeros();
                    pose.linear[at] = rotation * axis.into_inner();
                }
                JointKind::Fixed => {}
            }
        }
    }

    /// `out = q ⊕ dv`: first order in the root's position, exact on rotations; quaternions stay of
    /// unit length.
    pub fn retract(&self, q: &[f64], dv: &[f64], out: &mut [f64]) {
        for link in &self.links {
            let (iq, iv) = (link.q_offset, link.v_offset);
            match link.kind {
                JointKind::Free => {
                    let turn = quaternion(&q[iq + 3..iq + 7]);
                    let shift = turn * Vector3::new(dv[iv], dv[iv + 1], dv[iv + 2]);
                    for i in 0..3 {
                        out[iq + i] = q[iq + i] + shift[i];
                    }
                    let new = turn * small_rotation(&dv[iv + 3..iv + 6]);
                    store(&new, &mut out[iq + 3..iq + 7]);
                }
                JointKind::Spherical => {
                    let new = quaternion(&q[iq..iq + 4]) * small_rotation(&dv[iv..iv + 3]);
                    store(&new, &mut out[iq..iq + 4]);
                }
                JointKind::Revolute(_) | JointKind::Prismatic(_) => out[iq] = q[iq] + dv[iv],
                JointKind::Fixed => {}
            }
        }
    }

    /// The change from `q` to `moved`, in the layout of coordinates: differences of positions and
    /// angles, rotations in the axes of `q`.
    pub fn change(&self, q: &[f64], moved: &[f64], out: &mut [f64]) {
        self.each(q, moved, out, |a, b| b - a, |a, b| a.inverse() * b);
    }

    /// `q` with a change of [`Tree::change`].
    pub fn changed(&self, q: &[f64], change: &[f64], out: &mut [f64]) {
        self.each(q, change, out, |a, b| a + b, |a, b| a * b);
    }

    /// Joins two sets of coordinates number by number and rotation by rotation.
    fn each(
        &self,
        a: &[f64],
        b: &[f64],
        out: &mut [f64],
        number: impl Fn(f64, f64) -> f64,
        rotation: impl Fn(UnitQuaternion<f64>, UnitQuaternion<f64>) -> UnitQuaternion<f64>,
    ) {
        let turn = |at: usize, out: &mut [f64]| {
            store(&rotation(quaternion(&a[at..at + 4]), quaternion(&b[at..at + 4])), &mut out[at..at + 4]);
        };
        for link in &self.links {
            let at = link.q_offset;
            match link.kind {
                JointKind::Free => {
                    (at..at + 3).for_each(|i| out[i] = number(a[i], b[i]));
                    turn(at + 3, out);
                }
                JointKind::Spherical => turn(at, out),
                JointKind::Revolute(_) | JointKind::Prismatic(_) => out[at] = number(a[at], b[at]),
                JointKind::Fixed => {}
            }
        }
    }

    /// Extrapolates the change from `before` to `last` by one frame: a first guess at constant
    /// rate.
    pub fn extrapolate(&self, before: &[f64], last: &[f64], out: &mut [f64]) {
        for link in &self.links {
            let iq = link.q_offset;
            let turn_on = |at: usize, out: &mut [f64]| {
                let now = quaternion(&last[at..at + 4]);
                store(&(now * (quaternion(&before[at..at + 4]).inverse() * now)), &mut out[at..at + 4]);
            };
            match link.kind {
                JointKind::Free => {
                    for i in iq..iq + 3 {
                        out[i] = 2.0 * last[i] - before[i];
                    }
                    turn_on(iq + 3, out);
                }
                JointKind::Spherical => turn_on(iq, out),
                JointKind::Revolute(_) | JointKind::Prismatic(_) => out[iq] = 2.0 * last[iq] - before[iq],
                JointKind::Fixed => {}
            }
        }
    }

    /// Writes the posture `q` as near to `like` as it can be written, so that coordinates vary
    /// continuously: the sign of each quaternion, and whole turns of each hinge.
    pub fn align(&self, like: &[f64], q: &mut [f64]) {
        for link in &self.links {
            let at = match link.kind {
                JointKind::Free => link.q_offset + 3,
                JointKind::Spherical => link.q_offset,
                JointKind::Revolute(_) => {
                    let turns = ((q[link.q_offset] - like[link.q_offset]) / std::f64::consts::TAU).round();
                    q[link.q_offset] -= turns * std::f64::consts::TAU;
                    continue;
                }
                JointKind::Prismatic(_) | JointKind::Fixed => continue,
            };
            let dot: f64 = (at..at + 4).map(|i| like[i] * q[i]).sum();
            if dot < 0.0 {
                q[at..at + 4].iter_mut().for_each(|x| *x = -*x);
            }
        }
    }

    /// Writes each of successive postures as near to the one before it as it can be written;
    /// postures that were not solved are left out.
    pub fn make_continuous(&self, postures: &mut [f64]) {
        let mut last: Vec<f64> = Vec::with_capacity(self.nq);
        for q in postures.chunks_exact_mut(self.nq).filter(|q| q[0].is_finite()) {
            if !last.is_empty() {
                self.align(&last, q);
            }
            last.clear();
            last.extend_from_slice(q);
        }
    }

    /// Rotation of `parent_from_joint` in the world, to which the joint's own rotation is applied.
    pub fn joint_rotation(&self, index: usize, pose: &Pose) -> Matrix3<f64> {
        let link = &self.links[index];
        if link.parent == NONE { link.rotation } else { pose.rotation[link.parent] * link.rotation }
    }

    /// True if a link hangs below another one, or is the same.
    pub fn is_beyond(&self, link: usize, above: usize) -> bool {
        let mut at = link;
        while at != NONE {
            if at == above {
                return true;
            }
            at = self.links[at].parent;
        }
        false
    }

    /// Sets the rotation coordinates of a free or spherical joint so that its link has
    /// `world_from_link`.
    pub fn set_rotation(&self, index: usize, world_from_link: &Matrix3<f64>, pose: &Pose, q: &mut [f64]) {
        let link = &self.links[index];
        let at = match link.kind {
            JointKind::Free => link.q_offset + 3,
            JointKind::Spherical => link.q_offset,
            _ => return,
        };
        let local = self.joint_rotation(index, pose).transpose() * world_from_link;
        store(&matrix_quaternion(&local), &mut q[at..at + 4]);
    }
}

/// Unit quaternion from `[x y z w]`.
pub(crate) fn quaternion(q: &[f64]) -> UnitQuaternion<f64> {
    UnitQuaternion::new_unchecked(Quaternion::new(q[3], q[0], q[1], q[2]))
}

/// Unit quaternion of a rotation matrix.
pub(crate) fn matrix_quaternion(m: &Matrix3<f64>) -> UnitQuaternion<f64> {
    UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(*m))
}

fn store(turn: &UnitQuaternion<f64>, out: &mut [f64]) {
    let c = turn.coords;
    let scale = 1.0 / (c.x * c.x + c.y * c.y + c.z * c.z + c.w * c.w).sqrt();
    out[0] = c.x * scale;
    out[1] = c.y * scale;
    out[2] = c.z * scale;
    out[3] = c.w * scale;
}

fn small_rotation(v: &[f64]) -> UnitQuaternion<f64> {
    let angle2 = v[0] * v[0] + v[1] * v[1] + v[2] * v[2];
    let half = 0.5 * angle2.sqrt();
    let (w, scale) = if half < 1e-4 {
        (1.0 - 0.5 * half * half, 0.5 - half * half / 12.0)
    } else {
        (half.cos(), 0.5 * half.sin() / half)
    };
    UnitQuaternion::new_unchecked(Quaternion::new(w, v[0] * scale, v[1] * scale, v[2] * scale))
}

/// Rotation matrix of a unit quaternion `[x y z w]`.
fn quaternion_matrix(q: &[f64]) -> Matrix3<f64> {
    let (x, y, z, w) = (q[0], q[1], q[2], q[3]);
    let (x2, y2, z2) = (x + x, y + y, z + z);
    let (xx, yy, zz) = (x * x2, y * y2, z * z2);
    let (xy, xz, yz) = (x * y2, x * z2, y * z2);
    let (wx, wy, wz) = (w * x2, w * y2, w * z2);
    Matrix3::new(1.0 - yy - zz, xy - wz, xz + wy, xy + wz, 1.0 - xx - zz, yz - wx, xz - wy, yz + wx, 1.0 - xx - yy)
}

/// Rodrigues' formula.
pub(crate) fn axis_angle_matrix(axis: &Vector3<f64>, angle: f64) -> Matrix3<f64> {
    let (s, c) = angle.sin_cos();
    let t = 1.0 - c;
    let (x, y, z) = (axis.x, axis.y, axis.z);
    Matrix3::new(
        t * x * x + c,
        t * x * y - s * z,
        t * x * z + s * y,
        t * x * y + s * z,
        t * y * y + c,
        t * y * z - s * x,
        t * x * z - s * y,
        t * y * z + s * x,
        t * z * z + c,
    )
}
