//! The kinematic tree.

use crate::BodyError;
use crate::rotation::{left_jacobian, left_jacobian_inverse, quaternion_exp, quaternion_log, quaternion_near};
pub use crate::spec::{JointSpec, LinkSpec, ModelSpec};
use nalgebra::{Isometry3, Quaternion, Unit, UnitQuaternion, Vector3};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// Standard gravity in m/s², used if a laboratory states no other value.
pub const STANDARD_GRAVITY_MPS2: f64 = 9.80665;

/// Motion of a link relative to its parent.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum JointKind {
    /// Six degrees of freedom relative to the world; root only.
    Free,
    /// Three rotations.
    Spherical,
    /// One rotation about an axis fixed in both links (unit vector, child axes).
    Revolute(Unit<Vector3<f64>>),
    /// One translation along an axis fixed in both links (unit vector, child axes).
    Prismatic(Unit<Vector3<f64>>),
    /// No relative motion.
    Fixed,
}

impl JointKind {
    /// Number of coordinates in `q`.
    pub fn nq(&self) -> usize {
        match self {
            Self::Free => 7,
            Self::Spherical => 4,
            Self::Fixed => 0,
            _ => 1,
        }
    }
    /// Number of velocities in `v`.
    pub fn nv(&self) -> usize {
        match self {
            Self::Free => 6,
            Self::Spherical => 3,
            Self::Fixed => 0,
            _ => 1,
        }
    }
}

/// A joint with its offsets in the vectors `q` and `v`.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Joint {
    /// Kind of motion.
    pub kind: JointKind,
    /// Pose of the link in its parent at zero joint coordinates (world for the root).
    pub parent_from_joint: Isometry3<f64>,
    /// First index in `q`.
    pub q_offset: usize,
    /// First index in `v`.
    pub v_offset: usize,
}

impl Joint {
    /// Where this joint's quaternion (x y z w) starts in `q`, for joints that have one.
    pub fn quaternion_offset(&self) -> Option<usize> {
        match self.kind {
            JointKind::Free => Some(self.q_offset + 3),
            JointKind::Spherical => Some(self.q_offset),
            _ => None,
        }
    }
}

/// One rigid link and the joint that carries it.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Link {
    /// Name, unique in the model.
    pub name: String,
    /// Index of the parent, always smaller than the link's own; `None` for the root.
    pub parent: Option<usize>,
    /// The joint to the parent.
    pub joint: Joint,
}

/// A constant kinematic tree: link 0 is the root. Inertias live in [`crate::Subject`] or are passed
/// as slices of [`crate::Phi`].
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Model {
    /// Name of the model, for messages.
    pub name: String,
    /// Gravity in the world frame (Z up), m/s².
    pub gravity_mps2: Vector3<f64>,
    /// Links, parents first.
    pub links: Vec<Link>,
    /// Length of `q`.
    pub nq: usize,
    /// Length of `v`.
    pub nv: usize,
    /// Parts that move and have no link, by the link on which they ride ([`ModelSpec::carries`]).
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub carries: BTreeMap<String, Vec<String>>,
    /// True if encoders measure the joints (a robot), so that a joint may have a constant error of
    /// its own.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub encoders: bool,
    /// Names of the hinges and slides of a robot, by the name of the link that each carries.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub joint_names: BTreeMap<String, String>,
}

impl Model {
    /// Builds the tree from a specification. Gravity is set to (0, 0, −g0); change the field if the
    /// laboratory states another value.
    ///
    /// # Errors
    /// No links, a root that is not free or has a parent, a free joint elsewhere, a duplicate name,
    /// a parent that is not listed before its child, an axis without direction, a value that is not
    /// finite.
    pub fn from_spec(spec: &ModelSpec) -> Result<Self, BodyError> {
        let problem = |problem: String| BodyError::Spec { model: spec.name.clone(), problem };
        if spec.links.is_empty() {
            return Err(problem("it has no links".to_owned()));
        }
        let mut links: Vec<Link> = Vec::with_capacity(spec.links.len());
        let (mut nq, mut nv) = (0, 0);
        for link in &spec.links {
            let name = &link.name;
            if links.iter().any(|known| known.name == *name) {
                return Err(problem(format!("two links have the name `{name}`")));
            }
            let parent = match &link.parent {
                None if links.is_empty() => None,
                None => {
                    return Err(problem(format!(
                        "link `{name}` has no parent, and only the first link may be the root"
                    )));
                }
                Some(parent) => Some(links.iter().position(|known| known.name == *parent).ok_or_else(|| {
                    BodyError::UnknownParent { model: spec.name.clone(), link: name.clone(), parent: parent.clone() }
                })?),
            };
            if parent.is_none() != (link.joint == JointSpec::Free) {
                return Err(problem(format!("link `{name}`: the root, and only the root, has a `free` joint")));
            }
            if link.position_m.iter().chain(&link.rpy_rad).any(|x| !x.is_finite()) {
                return Err(problem(format!("link `{name}`: its joint placement is not finite")));
            }
            let Some(kind) = link.joint.kind() else {
                return Err(problem(format!("link `{name}`: the axis of its joint has no direction")));
            };
            let [roll, pitch, yaw] = link.rpy_rad;
            let parent_from_joint = Isometry3::from_parts(
                Vector3::from(link.position_m).into(),
                UnitQuaternion::from_euler_angles(roll, pitch, yaw),
            );
            links.push(Link {
                name: name.clone(),
                parent,
                joint: Joint { kind, parent_from_joint, q_offset: nq, v_offset: nv },
            });
            nq += kind.nq();
            nv += kind.nv();
        }
        if let Some(link) = spec.carries.keys().find(|name| !links.iter().any(|l| l.name == **name)) {
            return Err(problem(format!("`carries` names the link `{link}`, which it does not have")));
        }
        let gravity_mps2 = Vector3::new(0.0, 0.0, -STANDARD_GRAVITY_MPS2);
        Ok(Self {
            name: spec.name.clone(),
            gravity_mps2,
            links,
            nq,
            nv,
            carries: spec.carries.clone(),
            encoders: false,
            joint_names: BTreeMap::new(),
        })
    }

    /// True if every moving part of the body has a link. Only then do the six equations of the base
    /// hold: a part that moves unseen exerts an unknown force and moment on the link that carries
    /// it.
    pub fn is_whole(&self) -> bool {
        self.carries.values().all(Vec::is_empty)
    }

    /// The parts that move unseen, in words: `trunk, head and arms`; none for a whole body.
    pub fn unseen_parts(&self) -> Option<String> {
        const WORDS: [(&str, &str); 8] = [
            ("torso", "trunk"),
            ("head", "head"),
            ("upper_arm", "arms"),
            ("forearm", "forearms"),
            ("hand", "hands"),
            ("thigh", "legs"),
            ("shank", "shanks"),
            ("foot", "feet"),
        ];
        let has = |part: &str| self.carries.values().flatten().any(|p| p == part);
        let mut words: Vec<&str> = WORDS.iter().filter(|(part, _)| has(part)).map(|w| w.1).collect();
        // arms contain forearms and hands, legs shanks and feet
        for (whole, parts) in [("arms", ["forearms", "hands"]), ("legs", ["shanks", "feet"])] {
            if words.contains(&whole) {
                words.retain(|w| !parts.contains(w));
            }
        }
        let known = |p: &&String| !WORDS.iter().any(|(part, _)| part == p);
        words.extend(self.carries.values().flatten().filter(known).map(String::as_str));
        match words.split_last() {
            None => None,
            Some((last, [])) => Some((*last).to_owned()),
            Some((last, others)) => Some(format!("{} and {last}", others.join(", "))),
        }
    }

    /// Index of a link by name.
    ///
    /// # Errors
    /// [`BodyError::UnknownLink`] with the names that exist.
    pub fn link_index(&self, name: &str) -> Result<usize, BodyError> {
        self.links.iter().position(|link| link.name == name).ok_or_else(|| BodyError::UnknownLink {
            model: self.name.clone(),
            link: name.to_owned(),
            known: self.links.iter().map(|link| format!("`{}`", link.name)).collect::<Vec<_>>().join(", "),
        })
    }

    /// Number of links.
    pub fn n_links(&self) -> usize {
        self.links.len()
    }

    /// `q` of the neutral posture (identity rotations, zeros). Length `nq`.
    pub fn neutral(&self) -> Vec<f64> {
        let mut q = vec![0.0; self.nq];
        for joint in self.joints() {
            if let Some(first) = joint.quaternion_offset() {
                q[first + 3] = 1.0;
            }
        }
        q
    }

    /// `q_out = q ⊕ dv` (exponential map on rotations; free joints as SE(3) with body velocities,
    /// as Pinocchio's `integrate`). Quaternions stay in the hemisphere of `q` and have unit length.
    ///
    /// # Panics
    /// If a slice is shorter than `nq` (`q`, `q_out`) or `nv` (`dv`).
    pub fn integrate(&self, q: &[f64], dv: &[f64], q_out: &mut [f64]) {
        for joint in self.joints() {
            let (iq, iv) = (joint.q_offset, joint.v_offset);
            match joint.kind {
                JointKind::Free => {
                    let start = quaternion_at(q, iq + 3);
                    let omega = vector_at(dv, iv + 3);
                    let shift = start * (left_jacobian(&omega) * vector_at(dv, iv));
                    for k in 0..3 {
                        q_out[iq + k] = q[iq + k] + shift[k];
                    }
                    write_quaternion(&(start * quaternion_exp(&omega)), &start, &mut q_out[iq + 3..iq + 7]);
                }
                JointKind::Spherical => {
                    let start = quaternion_at(q, iq);
                    let end = start * quaternion_exp(&vector_at(dv, iv));
                    write_quaternion(&end, &start, &mut q_out[iq..iq + 4]);
                }
                JointKind::Revolute(_) | JointKind::Prismatic(_) => q_out[iq] = q[iq] + dv[iv],
                JointKind::Fixed => {}
            }
        }
    }

    /// `dv = q1 ⊖ q0`, inverse of [`Model::integrate`] (as Pinocchio's `difference(q0, q1)`).
    /// Rotations take the shorter path.
    ///
    /// # Panics
    /// If a slice is shorter than `nq` (`q0`, `q1`) or `nv` (`dv_out`).
    pub fn difference(&self, q0: &[f64], q1: &[f64], dv_out: &mut [f64]) {
        for joint in self.joints() {
            let (iq, iv) = (joint.q_offset, joint.v_offset);
            match joint.kind {
                JointKind::Free => {
                    let (start, end) = (quaternion_at(q0, iq + 3), quaternion_at(q1, iq + 3));
                    let omega = quaternion_log(&(start.inverse() * end));
                    let shift = start.inverse_transform_vector(&(vector_at(q1, iq) - vector_at(q0, iq)));
                    let linear = left_jacobian_inverse(&omega) * shift;
                    dv_out[iv..iv + 3].copy_from_slice(linear.as_slice());
                    dv_out[iv + 3..iv + 6].copy_from_slice(omega.as_slice());
                }
                JointKind::Spherical => {
                    let omega = quaternion_log(&(quaternion_at(q0, iq).inverse() * quaternion_at(q1, iq)));
                    dv_out[iv..iv + 3].copy_from_slice(omega.as_slice());
                }
                JointKind::Revolute(_) | JointKind::Prismatic(_) => dv_out[iv] = q1[iq] - q0[iq],
                JointKind::Fixed => {}
            }
        }
    }

    /// Normalises quaternions to unit length.
    ///
    /// # Panics
    /// If `q` is shorter than `nq`.
    pub fn normalize(&self, q: &mut [f64]) {
        for joint in self.joints() {
            if let Some(first) = joint.quaternion_offset() {
                let part = &mut q[first..first + 4];
                let norm = part.iter().map(|x| x * x).sum::<f64>().sqrt();
                part.iter_mut().for_each(|x| *x /= norm);
            }
        }
    }

    /// Names of the coordinates in `q` order and their units, for tables (`pelvis.x` …,
    /// `shank_r.angle`, `torso.qx` …). Positions and `displacement` are in m, `angle` in rad,
    /// quaternion components have no unit.
    pub fn coordinate_names(&self) -> Vec<String> {
        self.names(|kind| match kind {
            JointKind::Free => &["x", "y", "z", "qx", "qy", "qz", "qw"],
            JointKind::Spherical => &["qx", "qy", "qz", "qw"],
            JointKind::Revolute(_) => &["angle"],
            JointKind::Prismatic(_) => &["displacement"],
            JointKind::Fixed => &[],
        })
    }

    /// Names of the velocities in `v` order (`pelvis.vx`, `pelvis.wx`, `torso.wx`, `shank_r.rate`
    /// …), in m/s and rad/s; a prismatic joint has a `speed`.
    pub fn velocity_names(&self) -> Vec<String> {
        self.names(|kind| match kind {
            JointKind::Free => &["vx", "vy", "vz", "wx", "wy", "wz"],
            JointKind::Spherical => &["wx", "wy", "wz"],
            JointKind::Revolute(_) => &["rate"],
            JointKind::Prismatic(_) => &["speed"],
            JointKind::Fixed => &[],
        })
    }

    fn names(&self, of: impl Fn(&JointKind) -> &'static [&'static str]) -> Vec<String> {
        self.links.iter().flat_map(|l| of(&l.joint.kind).iter().map(move |part| format!("{}.{part}", l.name))).collect()
    }

    fn joints(&self) -> impl Iterator<Item = &Joint> {
        self.links.iter().map(|link| &link.joint)
    }
}

fn vector_at(values: &[f64], first: usize) -> Vector3<f64> {
    Vector3::new(values[first], values[first + 1], values[first + 2])
}

/// The quaternion stored as x y z w, normalised.
fn quaternion_at(q: &[f64], first: usize) -> UnitQuaternion<f64> {
    UnitQuaternion::new_normalize(Quaternion::new(q[first + 3], q[first], q[first + 1], q[first + 2]))
}

fn write_quaternion(value: &UnitQuaternion<f64>, near: &UnitQuaternion<f64>, out: &mut [f64]) {
    let value = quaternion_near(value, near).normalize();
    out.copy_from_slice(value.coords.as_slice());
}
