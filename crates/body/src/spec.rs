//! Content of a model file, before it becomes a [`crate::Model`].

use crate::{JointKind, LinkInertia};
use nalgebra::{Unit, Vector3};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// Content of a model file (YAML through serde, in `pipeline`; or URDF).
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ModelSpec {
    /// Name of the model.
    pub name: String,
    /// Links, parents first.
    pub links: Vec<LinkSpec>,
    /// Parts of the body that move and have no link: by the link on which they ride rigidly, as in
    /// the static posture (names without side). A model that carries parts is not a whole body: its
    /// six base equations do not hold, in flight or on plates ([`crate::Model::is_whole`]).
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub carries: BTreeMap<String, Vec<String>>,
}

impl ModelSpec {
    /// A model of these links, which carries nothing else.
    pub fn new(name: String, links: Vec<LinkSpec>) -> Self {
        Self { name, links, carries: BTreeMap::new() }
    }
    /// Inertias of all links in order, if every link states one.
    pub fn inertias(&self) -> Option<Vec<LinkInertia>> {
        self.links.iter().map(|link| link.inertia).collect()
    }
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
    /// Joint position in the parent frame, m (zero if set by scaling).
    #[serde(default)]
    pub position_m: [f64; 3],
    /// Joint orientation in the parent frame at zero, roll-pitch-yaw as in URDF, rad.
    #[serde(default)]
    pub rpy_rad: [f64; 3],
    /// Inertia, if the model defines it (robots).
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub inertia: Option<LinkInertia>,
}

/// The joint of a [`LinkSpec`]. Written as one word (`free`, `spherical`, `fixed`,
/// `revolute_x|y|z`, `prismatic_x|y|z`) or with any axis in child axes
/// (`{revolute: [0, 0.6, 0.8]}`, `{prismatic: [1, 0, 0]}`; the length is ignored).
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(try_from = "JointText", into = "JointText")]
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

impl JointSpec {
    /// The joint with a normalised axis; `None` if the axis has no direction.
    pub(crate) fn kind(&self) -> Option<JointKind> {
        let unit = |axis: &[f64; 3]| {
            let axis = Vector3::from(*axis);
            axis.iter().all(|x| x.is_finite()).then(|| Unit::try_new(axis, 1e-12)).flatten()
        };
        Some(match self {
            Self::Free => JointKind::Free,
            Self::Spherical => JointKind::Spherical,
            Self::Fixed => JointKind::Fixed,
            Self::RevoluteZ => JointKind::Revolute(Vector3::z_axis()),
            Self::Revolute(axis) => JointKind::Revolute(unit(axis)?),
            Self::Prismatic(axis) => JointKind::Prismatic(unit(axis)?),
        })
    }
}

/// The two notations of a joint.
#[derive(Debug, Clone, Serialize, Deserialize)]
#[serde(untagged)]
enum JointText {
    Word(String),
    Axis(AxisText),
}

/// A joint with its axis.
#[derive(Debug, Clone, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct AxisText {
    #[serde(default, skip_serializing_if = "Option::is_none")]
    revolute: Option<[f64; 3]>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    prismatic: Option<[f64; 3]>,
}

impl TryFrom<JointText> for JointSpec {
    type Error = String;

    fn try_from(text: JointText) -> Result<Self, String> {
        match text {
            JointText::Word(word) => Ok(match word.as_str() {
                "free" => Self::Free,
                "spherical" => Self::Spherical,
                "fixed" => Self::Fixed,
                "revolute_x" => Self::Revolute([1.0, 0.0, 0.0]),
                "revolute_y" => Self::Revolute([0.0, 1.0, 0.0]),
                "revolute_z" => Self::RevoluteZ,
                "prismatic_x" => Self::Prismatic([1.0, 0.0, 0.0]),
                "prismatic_y" => Self::Prismatic([0.0, 1.0, 0.0]),
                "prismatic_z" => Self::Prismatic([0.0, 0.0, 1.0]),
                other => {
                    return Err(format!(
                        "unknown joint `{other}`; known are `free`, `spherical`, `fixed`, `revolute_x|y|z`, `prismatic_x|y|z`, `{{revolute: [x, y, z]}}`, `{{prismatic: [x, y, z]}}`"
                    ));
                }
            }),
            JointText::Axis(AxisText { revolute: Some(axis), prismatic: None }) => Ok(Self::Revolute(axis)),
            JointText::Axis(AxisText { revolute: None, prismatic: Some(axis) }) => Ok(Self::Prismatic(axis)),
            JointText::Axis(_) => Err("a joint with an axis is either `revolute` or `prismatic`".to_owned()),
        }
    }
}

impl From<JointSpec> for JointText {
    fn from(spec: JointSpec) -> Self {
        match spec {
            JointSpec::Free => Self::Word("free".into()),
            JointSpec::Spherical => Self::Word("spherical".into()),
            JointSpec::Fixed => Self::Word("fixed".into()),
            JointSpec::RevoluteZ => Self::Word("revolute_z".into()),
            JointSpec::Revolute(axis) => Self::Axis(AxisText { revolute: Some(axis), ..AxisText::default() }),
            JointSpec::Prismatic(axis) => Self::Axis(AxisText { prismatic: Some(axis), ..AxisText::default() }),
        }
    }
}
