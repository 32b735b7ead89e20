//! The kinematic tree.

use crate::{BodyError, LinkInertia};
use nalgebra::{Isometry3, Unit, Vector3};
use serde::{Deserialize, Serialize};

/// How a link moves against its parent.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum JointKind {
    /// Six degrees of freedom against the world; the root only.
    Free,
    /// Three rotations.
    Spherical,
    /// One rotation about an axis fixed in both links (unit vector, child axes).
    Revolute(Unit<Vector3<f64>>),
    /// One translation along an axis fixed in both links (unit vector, child axes).
    Prismatic(Unit<Vector3<f64>>),
    /// None.
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

/// A joint with its place in the vectors `q` and `v`.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Joint {
    /// How the link moves.
    pub kind: JointKind,
    /// Pose of the link in its parent at zero joint coordinates (world for the root).
    pub parent_from_joint: Isometry3<f64>,
    /// First index in `q`.
    pub q_offset: usize,
    /// First index in `v`.
    pub v_offset: usize,
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

/// A constant kinematic tree: link 0 is the root. Inertias live in [`crate::Subject`] or are passed as slices of [`crate::Phi`].
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Model {
    /// Name of the model, for messages.
    pub name: String,
    /// Gravity in the world frame (Z up), m/s².
    pub gravity_mps2: Vector3<f64>,
    /// Links in an order in which parents come first.
    pub links: Vec<Link>,
    /// Length of `q`.
    pub nq: usize,
    /// Length of `v`.
    pub nv: usize,
}

/// What a model file says (YAML through serde, in `pipeline`; or URDF).
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ModelSpec {
    /// Name of the model.
    pub name: String,
    /// Links, parents first.
    pub links: Vec<LinkSpec>,
}

/// One link of a [`ModelSpec`].
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct LinkSpec {
    /// Name, unique in the model.
    pub name: String,
    /// Name of the parent; none for the root.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub parent: Option<String>,
    /// Kind of joint.
    pub joint: JointSpec,
    /// Joint position in the parent frame, m (zero where scaling decides).
    #[serde(default)]
    pub position_m: [f64; 3],
    /// Joint orientation in the parent frame at zero, roll-pitch-yaw as in URDF, rad.
    #[serde(default)]
    pub rpy_rad: [f64; 3],
    /// Inertia where the model knows it (robots).
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub inertia: Option<LinkInertia>,
}

/// The joint of a [`LinkSpec`], as written in YAML: `free`, `spherical`, `fixed`, `revolute_x|y|z`, or with any axis.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum JointSpec {
    /// Root with six degrees of freedom.
    Free,
    /// Three rotations.
    Spherical,
    /// No motion.
    Fixed,
    /// Rotation about the child's z axis (the convention of `human34` and `two_link`).
    RevoluteZ,
    /// Rotation about any axis in child axes.
    Revolute([f64; 3]),
    /// Translation along any axis in child axes.
    Prismatic([f64; 3]),
}

impl Model {
    /// Builds the tree from a specification. Gravity is set to (0, 0, −g0); change the field for another laboratory.
    pub fn from_spec(_spec: &ModelSpec) -> Result<Self, BodyError> {
        todo!()
    }
    /// Index of a link by name.
    pub fn link_index(&self, _name: &str) -> Result<usize, BodyError> {
        todo!()
    }
    /// Number of links.
    pub fn n_links(&self) -> usize {
        self.links.len()
    }
    /// `q` of the neutral posture (identity rotations, zeros). Length `nq`.
    pub fn neutral(&self) -> Vec<f64> {
        todo!()
    }
    /// `q_out = q ⊕ dv` (exponential map on rotations; free joints as SE(3) with body velocities, as Pinocchio's `integrate`).
    pub fn integrate(&self, _q: &[f64], _dv: &[f64], _q_out: &mut [f64]) {
        todo!()
    }
    /// `dv = q1 ⊖ q0`, inverse of [`Model::integrate`] (as Pinocchio's `difference(q0, q1)`).
    pub fn difference(&self, _q0: &[f64], _q1: &[f64], _dv_out: &mut [f64]) {
        todo!()
    }
    /// Brings quaternions back to unit length.
    pub fn normalize(&self, _q: &mut [f64]) {
        todo!()
    }
    /// Names of the coordinates in `q` order and their units, for tables (`pelvis.x` …, `shank_r.angle`, `torso.qx` …).
    pub fn coordinate_names(&self) -> Vec<String> {
        todo!()
    }
    /// Names of the velocities in `v` order (`pelvis.vx`, `pelvis.wx`, `torso.wx`, `shank_r.rate` …).
    pub fn velocity_names(&self) -> Vec<String> {
        todo!()
    }
}
