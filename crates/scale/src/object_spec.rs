//! Specification of an object made of rigid links: `configs/objects/*.yaml`, read by `pipeline`.
//!
//! Everything is defined by markers: those on each link, those that define its frame, and its
//! connection to the parent. The joint itself is estimated from motion ([`crate::object`]).

use serde::{Deserialize, Serialize};

/// An object.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ObjectSpec {
    /// Identifier, also the file's stem.
    pub name: String,
    /// One-line description.
    #[serde(default)]
    pub title: String,
    /// Mass of the whole object from a scale, kg.
    pub total_mass_kg: f64,
    /// Gravity at the laboratory, m/s²; standard gravity if not stated.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub gravity_mps2: Option<f64>,
    /// Stem of the trial in which the object lies still and all joint angles are zero.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub static_trial: Option<String>,
    /// Stems of the trials in which the joints are moved.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub calibration_trials: Vec<String>,
    /// Links, parents first.
    pub links: Vec<ObjectLink>,
}

/// One link of an object.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ObjectLink {
    /// Name, as in the model.
    pub name: String,
    /// Name of the parent; none for the root.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub parent: Option<String>,
    /// Labels of the markers on it; at least three that do not lie on a line.
    pub markers: Vec<String>,
    /// Joint to the parent; none for the root.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub joint: Option<ObjectJoint>,
    /// How its frame is defined.
    pub frame: ObjectFrame,
    /// Fraction of the total mass, if the laboratory can estimate it better than from size.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub mass_fraction: Option<f64>,
}

/// A joint to be estimated from motion.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case", tag = "type", deny_unknown_fields)]
pub enum ObjectJoint {
    /// A hinge: the z axis of the link. Its angle is zero in the static trial and increases by the
    /// right-hand rule about z.
    Hinge {
        /// z has a positive dot product with this direction of the parent's axes at angle zero.
        positive_along_parent: [f64; 3],
    },
    /// A ball joint. Its rotation is zero when the link's axes are parallel to its parent's.
    Ball,
}

/// Definition of a link's frame by markers.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case", tag = "by", deny_unknown_fields)]
pub enum ObjectFrame {
    /// By markers alone.
    Markers {
        /// Marker at the origin (omit for a link on a joint: its origin is the joint).
        #[serde(default, skip_serializing_if = "Option::is_none")]
        origin: Option<String>,
        /// y points from the first marker to the second.
        y_axis: [String; 2],
        /// z is perpendicular to y, on the side of this marker: it lies in the +z half of the y-z
        /// plane.
        z_side: String,
    },
    /// On a hinge: z along it, origin at the point of the axis nearest to the parent's origin, and
    /// a marker in the x-z plane.
    Hinge {
        /// Marker in the x-z plane.
        x_plane: String,
        /// Side of the axis on which the marker lies.
        side: HalfPlane,
    },
}

/// Sign of a marker's x.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum HalfPlane {
    /// x > 0.
    Positive,
    /// x < 0.
    Negative,
}
