//! An OpenSim model as its file states it, and its reading.

use super::exact;
use super::function::Function;
use super::read::{self, RawJoint, Refused, child, objects};
use crate::RobotError;
use aloft_body::{LinkInertia, Model};
use nalgebra::{Isometry3, UnitQuaternion, Vector3};
use std::collections::BTreeMap;

/// A coordinate of the file.
#[derive(Debug, Clone)]
pub struct OsimCoordinate {
    /// Name.
    pub name: String,
    /// Value before any motion, rad or m.
    pub default: f64,
    /// Range that inverse kinematics keeps, if the file clamps it.
    pub range: Option<[f64; 2]>,
    /// True if the file locks it at its default.
    pub locked: bool,
    /// True for angles, false for lengths.
    pub is_angle: bool,
    /// True if tables in degrees hold it in degrees: OpenSim leaves coordinates alone that turn no
    /// axis one to one.
    pub in_degrees: bool,
    /// The coordinate that it is a function of, and the function.
    pub(super) follows: Option<(usize, Function)>,
}

/// One axis of a joint; the coordinate is an index.
#[derive(Debug, Clone)]
pub(super) struct Axis {
    pub(super) axis: Vector3<f64>,
    pub(super) coordinate: Option<usize>,
    pub(super) function: Function,
}

/// A joint: rotations about body-fixed axes one after the other, and translations in the parent.
#[derive(Debug, Clone)]
pub(super) struct Joint {
    pub(super) name: String,
    /// The body that it carries.
    pub(super) child: String,
    /// Index of the joint that carries the parent; none for the ground.
    pub(super) parent: Option<usize>,
    pub(super) parent_from_joint: Isometry3<f64>,
    pub(super) body_from_joint: Isometry3<f64>,
    pub(super) rotations: Vec<Axis>,
    pub(super) translations: Vec<Axis>,
    /// Inertia of the body in its own frame.
    pub(super) inertia: LinkInertia,
}

impl Joint {
    pub(super) fn axes(&self) -> impl Iterator<Item = &Axis> {
        self.rotations.iter().chain(&self.translations)
    }
}

/// A marker of the file.
#[derive(Debug, Clone, PartialEq)]
pub struct OsimMarker {
    /// Name.
    pub name: String,
    /// Index of its link in the exact tree.
    pub link: usize,
    /// Place in that link's frame, m.
    pub position_m: Vector3<f64>,
    /// Index of the joint that carries its body.
    pub(super) joint: usize,
    /// Place in the body's frame, m.
    pub(super) on_body_m: Vector3<f64>,
}

/// An OpenSim model.
#[derive(Debug, Clone)]
pub struct OsimModel {
    /// Name of the file, for messages.
    pub file: String,
    /// Name of the model in the file.
    pub name: String,
    /// The exact tree, parents first; links between sliders carry no mass.
    pub model: Model,
    /// Inertia of every link of the exact tree.
    pub inertias: Vec<LinkInertia>,
    /// Markers on bodies.
    pub markers: Vec<OsimMarker>,
    /// Coordinates that a motion has to state, with true for those that tables in degrees hold in
    /// degrees.
    pub coordinates: Vec<(String, bool)>,
    /// Markers on frames that are no bodies: not used.
    pub unplaced_markers: Vec<String>,
    /// Every coordinate, in the order of the file.
    pub(super) all: Vec<OsimCoordinate>,
    /// Parents first.
    pub(super) joints: Vec<Joint>,
    /// First index in `q` of the exact tree and whether it slides, by joint.
    pub(super) exact: Vec<(usize, bool)>,
}

impl OsimModel {
    /// Reads a model.
    ///
    /// # Errors
    /// [`RobotError::Model`] for text that is not an OpenSim 4 model, and for a model with parts
    /// that are not supported; the message names them all.
    pub fn parse(file: &str, content: &str) -> Result<Self, RobotError> {
        let document = crate::xml::parse(file, content)?;
        let root = document.root_element();
        let problem = |p: String| RobotError::model(file, p);
        if root.tag_name().name() != "OpenSimDocument" {
            return Err(problem(format!(
                "its outermost element is `{}`, expected `OpenSimDocument`",
                root.tag_name().name()
            )));
        }
        // none: a file without a version is refused in the next line
        let version: u32 = root.attribute("Version").and_then(|v| v.parse().ok()).unwrap_or(0);
        if version < 40000 {
            return Err(problem(format!(
                "it is of OpenSim version {version}; expected 40000 or newer (open it in OpenSim 4 and save it again)"
            )));
        }
        let model = child(root, "Model").ok_or_else(|| problem("it holds no model".to_owned()))?;
        let mut refused = Refused::default();
        let bodies = read::bodies(model, &mut refused);
        let raw = read::joints(model, &mut refused);
        let coupled = read::couplers(model, &mut refused);
        let all = coordinates(&raw, &coupled, &mut refused);
        if !refused.0.is_empty() {
            return Err(problem(format!("parts that are not supported: {}", refused.0.join("; "))));
        }
        let joints = in_order(raw, &bodies, &all).map_err(problem)?;
        let exact = exact::tree(model.attribute("name").unwrap_or("model"), &joints).map_err(problem)?;
        let mut unplaced_markers = Vec::new();
        let mut markers = Vec::new();
        for node in objects(model, "MarkerSet").into_iter().filter(|m| m.has_tag_name("Marker")) {
            let name = node.attribute("name").unwrap_or_default().to_owned();
            let body = read::last(read::text(node, "socket_parent_frame"));
            let joint = joints.iter().position(|j| j.child == body);
            match (joint, read::vector(node, "location")) {
                (Some(joint), Some(on_body_m)) => {
                    let (link, pose) = exact.home[joint];
                    let position_m = pose.transform_point(&on_body_m.into()).coords;
                    markers.push(OsimMarker { name, link, position_m, joint, on_body_m });
                }
                _ => unplaced_markers.push(name),
            }
        }
        Ok(Self {
            file: file.to_owned(),
            name: exact.model.name.clone(),
            coordinates: stated(&all),
            model: exact.model,
            inertias: exact.inertias,
            exact: exact.first,
            markers,
            unplaced_markers,
            all,
            joints,
        })
    }

    /// Inertia of a link of the exact tree by name.
    pub fn inertias_of(&self, link: &str) -> Option<&LinkInertia> {
        self.model.links.iter().position(|l| l.name == link).map(|i| &self.inertias[i])
    }

    /// Mass of all bodies, kg.
    pub fn mass_kg(&self) -> f64 {
        self.joints.iter().map(|j| j.inertia.mass_kg).sum()
    }

    /// Number of joints, which is that of bodies.
    pub fn joint_count(&self) -> usize {
        self.joints.len()
    }

    /// Every coordinate, in the order of the values of a motion.
    pub fn all_coordinates(&self) -> &[OsimCoordinate] {
        &self.all
    }

    /// The body that carries a marker.
    pub fn body_of(&self, marker: &OsimMarker) -> &str {
        &self.joints[marker.joint].child
    }

    /// Values of all coordinates (rad, m) from values by name; those not given are at their
    /// defaults.
    pub fn values(&self, given: &BTreeMap<String, f64>) -> Vec<f64> {
        let mut values: Vec<f64> = self.all.iter().map(|c| given.get(&c.name).copied().unwrap_or(c.default)).collect();
        self.couple(&mut values);
        values
    }

    /// `q` of the exact tree for coordinates by name (rad, m); those not given are at their
    /// defaults or follow from the couplings. `world_from_ground` turns the file's world into ours.
    pub fn posture(&self, given: &BTreeMap<String, f64>, world_from_ground: &UnitQuaternion<f64>) -> Vec<f64> {
        self.exact_posture(&self.values(given), world_from_ground)
    }
}

/// Coordinates that are not functions of others, by name.
fn stated(all: &[OsimCoordinate]) -> Vec<(String, bool)> {
    let mut out: Vec<(String, bool)> =
        all.iter().filter(|c| c.follows.is_none()).map(|c| (c.name.clone(), c.in_degrees)).collect();
    out.sort();
    out
}

fn coordinates(raw: &[RawJoint], coupled: &[(String, String, Function)], refused: &mut Refused) -> Vec<OsimCoordinate> {
    let own: Vec<&read::RawCoordinate> = raw.iter().flat_map(|j| &j.coordinates).collect();
    let index = |name: &str| own.iter().position(|c| c.name == name);
    let turns = |name: &str| raw.iter().any(|j| j.rotations.iter().any(|a| a.coordinate.as_deref() == Some(name)));
    let one_to_one = |name: &str| {
        let turned = |a: &read::RawAxis| a.coordinate.as_deref() == Some(name) && a.function.is_one_to_one();
        raw.iter().any(|j| j.rotations.iter().any(turned))
    };
    let mut out: Vec<OsimCoordinate> = own
        .iter()
        .map(|c| OsimCoordinate {
            name: c.name.clone(),
            default: c.default,
            range: c.range,
            locked: c.locked,
            is_angle: turns(&c.name),
            in_degrees: one_to_one(&c.name),
            follows: None,
        })
        .collect();
    for joint in raw {
        for axis in joint.rotations.iter().chain(&joint.translations) {
            match &axis.coordinate {
                Some(name) if index(name).is_none() => {
                    refused.add(format!("the coordinate `{name}` of the joint `{}`, which no joint has", joint.name));
                }
                _ => {}
            }
        }
    }
    for (dependent, on, function) in coupled {
        match (index(dependent), index(on)) {
            (Some(d), Some(o)) if !coupled.iter().any(|c| c.0 == *on) => out[d].follows = Some((o, function.clone())),
            (Some(_), Some(_)) => {
                refused
                    .add(format!("the coupling of `{dependent}` to `{on}`, which itself follows another coordinate"));
            }
            _ => refused.add(format!("the coupling of `{dependent}` to `{on}`: no joint has both coordinates")),
        }
    }
    out
}

/// Joints with parents first, and the inertias of their bodies.
fn in_order(
    mut raw: Vec<RawJoint>,
    bodies: &BTreeMap<String, LinkInertia>,
    all: &[OsimCoordinate],
) -> Result<Vec<Joint>, String> {
    let mut out: Vec<Joint> = Vec::new();
    let axes = |axes: Vec<read::RawAxis>| -> Vec<Axis> {
        let index = |name: &str| all.iter().position(|c| c.name == name);
        axes.into_iter()
            .map(|a| Axis { axis: a.axis, coordinate: a.coordinate.as_deref().and_then(index), function: a.function })
            .collect()
    };
    while !raw.is_empty() {
        let carried = |j: &RawJoint| out.iter().any(|o| o.child == j.parent);
        let next = raw.iter().position(|j| if out.is_empty() { j.parent == "ground" } else { carried(j) });
        let Some(next) = next else {
            let names: Vec<&str> = raw.iter().map(|j| j.child.as_str()).collect();
            return Err(format!("bodies that no joint connects to the root: {}", names.join(", ")));
        };
        let joint = raw.remove(next);
        let inertia = *bodies.get(&joint.child).ok_or_else(|| format!("no body `{}`", joint.child))?;
        if out.iter().any(|o| o.child == joint.child) {
            return Err(format!("the body `{}` has two joints, which makes a loop", joint.child));
        }
        out.push(Joint {
            parent: out.iter().position(|o| o.child == joint.parent),
            name: joint.name,
            child: joint.child,
            parent_from_joint: joint.parent_from_joint,
            body_from_joint: joint.body_from_joint,
            rotations: axes(joint.rotations),
            translations: axes(joint.translations),
            inertia,
        });
    }
    if out.is_empty() {
        return Err("no joint connects a body to the ground".to_owned());
    }
    Ok(out)
}
