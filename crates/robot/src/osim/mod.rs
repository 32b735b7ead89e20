//! OpenSim models (version 4): bodies with their inertias, joints with coupled coordinates, markers.
//!
//! Every joint is a rotation and a translation that are functions of coordinates. The tree made
//! from it gives each joint that translates three sliders and a ball, others a ball, whatever the
//! file calls them: the equations of the base need the motion of the bodies only, not how many
//! coordinates make it. [`OsimModel::posture`] turns coordinates into that tree's `q`.

mod function;

use crate::RobotError;
use aloft_body::{JointSpec, LinkInertia, LinkSpec, Model, ModelSpec};
use function::{Function, numbers};
use nalgebra::{Isometry3, Matrix3, Translation3, Unit, UnitQuaternion, Vector3};
use roxmltree::Node;
use std::collections::BTreeMap;

/// One axis of a joint.
#[derive(Debug, Clone)]
struct Axis {
    axis: Vector3<f64>,
    coordinate: Option<String>,
    function: Function,
}

/// A joint: rotations about body-fixed axes one after the other, and translations in the parent.
#[derive(Debug, Clone)]
struct Joint {
    child: String,
    parent_from_joint: Isometry3<f64>,
    body_from_joint: Isometry3<f64>,
    rotations: Vec<Axis>,
    translations: Vec<Axis>,
    /// First index of this joint in `q`.
    q_offset: usize,
    slides: bool,
}

/// A marker of the file.
#[derive(Debug, Clone, PartialEq)]
pub struct OsimMarker {
    /// Name.
    pub name: String,
    /// Index of its link in the tree.
    pub link: usize,
    /// Place in that link's frame, m.
    pub position_m: Vector3<f64>,
}

/// An OpenSim model as a tree.
#[derive(Debug, Clone)]
pub struct OsimModel {
    /// Name of the model in the file.
    pub name: String,
    /// The tree, parents first; links between sliders carry no mass.
    pub model: Model,
    /// Inertia of every link.
    pub inertias: Vec<LinkInertia>,
    /// Markers.
    pub markers: Vec<OsimMarker>,
    /// Coordinates that a motion has to state, with true for those that are angles.
    pub coordinates: Vec<(String, bool)>,
    /// Default values of all coordinates.
    defaults: BTreeMap<String, f64>,
    /// Coordinates that are functions of another one.
    coupled: Vec<(String, String, Function)>,
    joints: Vec<Joint>,
}

/// What a file contains that is not supported.
#[derive(Default)]
struct Refused(Vec<String>);

impl Refused {
    fn add(&mut self, what: impl Into<String>) {
        let what = what.into();
        if !self.0.contains(&what) {
            self.0.push(what);
        }
    }
}

fn child<'a, 'b>(node: Node<'a, 'b>, name: &str) -> Option<Node<'a, 'b>> {
    node.children().find(|c| c.has_tag_name(name))
}

fn objects<'a, 'b>(model: Node<'a, 'b>, set: &str) -> Vec<Node<'a, 'b>> {
    let objects = child(model, set).and_then(|s| child(s, "objects"));
    objects.map_or(Vec::new(), |o| o.children().filter(Node::is_element).collect())
}

fn text<'a>(node: Node<'a, '_>, name: &str) -> &'a str {
    node.children().find(|c| c.has_tag_name(name)).and_then(|c| c.text()).unwrap_or_default().trim()
}

fn vector(node: Node<'_, '_>, name: &str) -> Option<Vector3<f64>> {
    match numbers(text(node, name))?.as_slice() {
        [] => Some(Vector3::zeros()),
        [x, y, z] => Some(Vector3::new(*x, *y, *z)),
        _ => None,
    }
}

fn last(path: &str) -> &str {
    path.rsplit('/').next().unwrap_or(path)
}

impl OsimModel {
    /// Reads a model.
    ///
    /// # Errors
    /// [`RobotError::Model`] for text that is not an OpenSim 4 model, and for a model with parts that
    /// are not supported; the message names them all.
    pub fn parse(file: &str, content: &str) -> Result<Self, RobotError> {
        let document = crate::model::parse(file, content)?;
        let root = document.root_element();
        let problem = |p: String| RobotError::model(file, p);
        if root.tag_name().name() != "OpenSimDocument" {
            return Err(problem(format!(
                "its outermost element is `{}`, expected `OpenSimDocument`",
                root.tag_name().name()
            )));
        }
        let version: u32 = root.attribute("Version").and_then(|v| v.parse().ok()).unwrap_or(0);
        if version < 40000 {
            return Err(problem(format!(
                "it is of OpenSim version {version}; expected 40000 or newer (open it in OpenSim 4 and save it again)"
            )));
        }
        let model = child(root, "Model").ok_or_else(|| problem("it holds no model".to_owned()))?;
        let mut refused = Refused::default();
        let bodies = bodies(model, &mut refused);
        let joints = joints(model, &mut refused);
        let coupled = couplers(model, &mut refused);
        if !refused.0.is_empty() {
            return Err(problem(format!("parts that are not supported: {}", refused.0.join("; "))));
        }
        let name = model.attribute("name").unwrap_or("model").to_owned();
        tree(name, model, &bodies, joints, coupled).map_err(problem)
    }

    /// Inertia of a link by name.
    pub fn inertias_of(&self, link: &str) -> Option<&LinkInertia> {
        self.model.links.iter().position(|l| l.name == link).map(|i| &self.inertias[i])
    }

    /// Mass of all bodies, kg.
    pub fn mass_kg(&self) -> f64 {
        self.inertias.iter().map(|i| i.mass_kg).sum()
    }

    /// `q` of the tree for coordinates by name (rad, m); those not given are at their defaults or
    /// follow from the couplings. `world_from_ground` turns the file's world into ours.
    pub fn posture(&self, values: &BTreeMap<String, f64>, world_from_ground: &UnitQuaternion<f64>) -> Vec<f64> {
        let mut all = self.defaults.clone();
        all.extend(values.iter().map(|(k, v)| (k.clone(), *v)));
        for (dependent, on, function) in &self.coupled {
            let x = all.get(on).copied().unwrap_or(0.0);
            all.insert(dependent.clone(), function.value(x));
        }
        let value = |a: &Axis| a.function.value(a.coordinate.as_ref().and_then(|c| all.get(c)).copied().unwrap_or(0.0));
        let mut q = self.model.neutral();
        for joint in &self.joints {
            let rotation = joint
                .rotations
                .iter()
                .fold(UnitQuaternion::identity(), |r, a| r * UnitQuaternion::from_scaled_axis(a.axis * value(a)));
            let shift = joint.translations.iter().fold(Vector3::zeros(), |t, a| t + a.axis * value(a));
            let at = joint.q_offset;
            if at == 0 {
                let pose = joint.parent_from_joint * Isometry3::from_parts(Translation3::from(shift), rotation);
                let pose = world_from_ground * pose;
                q[..3].copy_from_slice(pose.translation.vector.as_slice());
                q[3..7].copy_from_slice(pose.rotation.coords.as_slice());
            } else if joint.slides {
                q[at..at + 3].copy_from_slice(shift.as_slice());
                q[at + 3..at + 7].copy_from_slice(rotation.coords.as_slice());
            } else {
                q[at..at + 4].copy_from_slice(rotation.coords.as_slice());
            }
        }
        q
    }
}

/// Bodies by name with their inertia in the body's frame.
fn bodies(model: Node<'_, '_>, refused: &mut Refused) -> BTreeMap<String, LinkInertia> {
    let mut out = BTreeMap::new();
    for node in objects(model, "BodySet") {
        let name = node.attribute("name").unwrap_or_default();
        let mass = text(node, "mass").parse::<f64>().ok().filter(|m| m.is_finite() && *m >= 0.0);
        let inertia = numbers(text(node, "inertia"));
        match (node.tag_name().name(), mass, vector(node, "mass_center"), inertia.as_deref()) {
            ("Body", Some(mass_kg), Some(com_m), Some(&[xx, yy, zz, xy, xz, yz])) => {
                let inertia_com_kgm2 = Matrix3::new(xx, xy, xz, xy, yy, yz, xz, yz, zz);
                out.insert(name.to_owned(), LinkInertia { mass_kg, com_m, inertia_com_kgm2 });
            }
            ("Body", ..) => refused.add(format!("body `{name}` without mass, mass_center or inertia")),
            (other, ..) => refused.add(format!("{other} `{name}` among the bodies")),
        }
    }
    out
}

/// Frames of a joint: name, body and place on it.
fn frames(node: Node<'_, '_>) -> BTreeMap<String, (String, Isometry3<f64>)> {
    let list = child(node, "frames").map_or(Vec::new(), |f| f.children().filter(Node::is_element).collect());
    list.iter()
        .filter_map(|f| {
            let [x, y, z]: [f64; 3] = vector(*f, "orientation")?.into();
            let about = |axis: Unit<Vector3<f64>>, angle| UnitQuaternion::from_axis_angle(&axis, angle);
            let rotation = about(Vector3::x_axis(), x) * about(Vector3::y_axis(), y) * about(Vector3::z_axis(), z);
            let pose = Isometry3::from_parts(vector(*f, "translation")?.into(), rotation);
            Some((f.attribute("name")?.to_owned(), (last(text(*f, "socket_parent")).to_owned(), pose)))
        })
        .collect()
}

/// A joint before the tree is made: names of its bodies beside it.
struct RawJoint {
    parent: String,
    joint: Joint,
    defaults: Vec<(String, f64)>,
}

fn joints(model: Node<'_, '_>, refused: &mut Refused) -> Vec<RawJoint> {
    let mut out = Vec::new();
    for node in objects(model, "JointSet") {
        let (kind, name) = (node.tag_name().name(), node.attribute("name").unwrap_or_default());
        let frames = frames(node);
        let place = |socket: &str| {
            let named = last(text(node, socket)).to_owned();
            frames.get(&named).cloned().unwrap_or((named, Isometry3::identity()))
        };
        let coordinates: Vec<(String, f64)> = child(node, "coordinates").map_or(Vec::new(), |c| {
            let of = |c: Node<'_, '_>| {
                Some((c.attribute("name")?.to_owned(), text(c, "default_value").parse::<f64>().unwrap_or(0.0)))
            };
            c.children().filter(Node::is_element).filter_map(of).collect()
        });
        let along = |i: usize, axis: [f64; 3]| Axis {
            axis: Vector3::from(axis),
            coordinate: coordinates.get(i).map(|c| c.0.clone()),
            function: Function::Polynomial(vec![1.0, 0.0]),
        };
        let (x, y, z) = ([1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]);
        let (rotations, translations) = match kind {
            "CustomJoint" => match custom(node) {
                Ok(both) => both,
                Err(what) => {
                    refused.add(format!("{what} in the joint `{name}`"));
                    continue;
                }
            },
            "WeldJoint" => (Vec::new(), Vec::new()),
            "PinJoint" => (vec![along(0, z)], Vec::new()),
            "SliderJoint" => (Vec::new(), vec![along(0, x)]),
            "UniversalJoint" => (vec![along(0, x), along(1, y)], Vec::new()),
            "BallJoint" | "GimbalJoint" => (vec![along(0, x), along(1, y), along(2, z)], Vec::new()),
            "PlanarJoint" => (vec![along(0, z)], vec![along(1, x), along(2, y)]),
            "FreeJoint" => (vec![along(0, x), along(1, y), along(2, z)], vec![along(3, x), along(4, y), along(5, z)]),
            other => {
                refused.add(format!("the joint `{name}` of the kind {other}"));
                continue;
            }
        };
        let (parent, parent_from_joint) = place("socket_parent_frame");
        let (child, body_from_joint) = place("socket_child_frame");
        let slides = translations.iter().any(|a| !a.function.is_zero());
        out.push(RawJoint {
            parent,
            joint: Joint { child, parent_from_joint, body_from_joint, rotations, translations, q_offset: 0, slides },
            defaults: coordinates,
        });
    }
    out
}

/// Axes of a CustomJoint.
fn custom(node: Node<'_, '_>) -> Result<(Vec<Axis>, Vec<Axis>), String> {
    let transform = child(node, "SpatialTransform").ok_or("no SpatialTransform")?;
    let (mut rotations, mut translations) = (Vec::new(), Vec::new());
    for axis in transform.children().filter(|c| c.has_tag_name("TransformAxis")) {
        let function =
            axis.children().find(|c| c.is_element() && !matches!(c.tag_name().name(), "coordinates" | "axis"));
        let function = function.map_or(Ok(Function::Constant(0.0)), |f| {
            // some versions wrap it into <function>
            let inner = if f.has_tag_name("function") { f.children().find(Node::is_element).unwrap_or(f) } else { f };
            Function::read(inner)
        })?;
        let names: Vec<&str> = text(axis, "coordinates").split_whitespace().collect();
        if names.len() > 1 {
            return Err(format!("an axis that depends on {}", names.join(" and ")));
        }
        let direction = vector(axis, "axis").ok_or("an axis without direction")?;
        let coordinate = names.first().map(|n| (*n).to_owned());
        let found = Axis { axis: direction, coordinate, function };
        if axis.attribute("name").unwrap_or_default().starts_with("rotation") {
            rotations.push(found);
        } else {
            translations.push(found);
        }
    }
    Ok((rotations, translations))
}

fn couplers(model: Node<'_, '_>, refused: &mut Refused) -> Vec<(String, String, Function)> {
    let mut out = Vec::new();
    for node in objects(model, "ConstraintSet") {
        let (kind, name) = (node.tag_name().name(), node.attribute("name").unwrap_or_default());
        if text(node, "isEnforced") == "false" {
            continue;
        }
        let independent: Vec<&str> = text(node, "independent_coordinate_names").split_whitespace().collect();
        let function = child(node, "coupled_coordinates_function").and_then(|f| f.children().find(Node::is_element));
        match (kind, independent.as_slice(), function) {
            ("CoordinateCouplerConstraint", [on], Some(function)) => match Function::read(function) {
                Ok(f) => {
                    let scale = text(node, "scale_factor").parse::<f64>().unwrap_or(1.0);
                    let dependent = text(node, "dependent_coordinate_name").to_owned();
                    out.push((dependent, (*on).to_owned(), Function::Scaled(Box::new(f), scale)));
                }
                Err(what) => refused.add(format!("{what} in the constraint `{name}`")),
            },
            _ => refused.add(format!("the constraint `{name}` of the kind {kind}")),
        }
    }
    out
}

/// Puts the joints in order, makes the tree, and places inertias and markers.
fn tree(
    name: String,
    model: Node<'_, '_>,
    bodies: &BTreeMap<String, LinkInertia>,
    mut raw: Vec<RawJoint>,
    coupled: Vec<(String, String, Function)>,
) -> Result<OsimModel, String> {
    let mut links: Vec<LinkSpec> = Vec::new();
    let mut inertias = Vec::new();
    // link that carries each body, and the body's place in the link's frame
    let mut home: BTreeMap<String, (usize, Isometry3<f64>)> = BTreeMap::new();
    let (mut joints, mut defaults) = (Vec::new(), BTreeMap::new());
    let nothing = LinkInertia { mass_kg: 0.0, com_m: Vector3::zeros(), inertia_com_kgm2: Matrix3::zeros() };
    while !raw.is_empty() {
        let next =
            raw.iter().position(|j| if links.is_empty() { j.parent == "ground" } else { home.contains_key(&j.parent) });
        let Some(next) = next else {
            let names: Vec<&str> = raw.iter().map(|j| j.joint.child.as_str()).collect();
            return Err(format!("bodies that no joint connects to the root: {}", names.join(", ")));
        };
        let RawJoint { parent, mut joint, defaults: own } = raw.remove(next);
        let inertia = bodies.get(&joint.child).ok_or_else(|| format!("no body `{}`", joint.child))?;
        let link_from_body = joint.body_from_joint.inverse();
        defaults.extend(own);
        let link = |name: String, parent: Option<String>, kind, at: &Isometry3<f64>| {
            let (roll, pitch, yaw) = at.rotation.euler_angles();
            LinkSpec {
                name,
                parent,
                joint: kind,
                position_m: at.translation.vector.into(),
                rpy_rad: [roll, pitch, yaw],
                inertia: None,
            }
        };
        if links.is_empty() {
            links.push(link(joint.child.clone(), None, JointSpec::Free, &Isometry3::identity()));
        } else {
            let (carrier, pose) = home[&parent];
            let at = pose * joint.parent_from_joint;
            let mut above = links[carrier].name.clone();
            let mut place = at;
            if joint.slides {
                for (axis, direction) in [("x", [1.0, 0.0, 0.0]), ("y", [0.0, 1.0, 0.0]), ("z", [0.0, 0.0, 1.0])] {
                    let slider = format!("{} {axis}", joint.child);
                    links.push(link(slider.clone(), Some(above), JointSpec::Prismatic(direction), &place));
                    inertias.push(nothing);
                    (above, place) = (slider, Isometry3::identity());
                }
            }
            links.push(link(joint.child.clone(), Some(above), JointSpec::Spherical, &place));
        }
        inertias.push(inertia.transformed(&link_from_body));
        home.insert(joint.child.clone(), (links.len() - 1, link_from_body));
        joint.q_offset = links.len() - 1;
        joints.push(joint);
    }
    if links.is_empty() {
        return Err("no joint connects a body to the ground".to_owned());
    }
    let tree = Model::from_spec(&ModelSpec::new(name.clone(), links)).map_err(|e| e.to_string())?;
    for joint in &mut joints {
        let link = &tree.links[joint.q_offset];
        joint.q_offset = link.joint.q_offset - if joint.slides && link.parent.is_some() { 3 } else { 0 };
    }
    let markers = objects(model, "MarkerSet")
        .into_iter()
        .filter_map(|m| {
            let (link, pose) = home.get(last(text(m, "socket_parent_frame")))?;
            let position_m = pose.transform_point(&vector(m, "location")?.into()).coords;
            Some(OsimMarker { name: m.attribute("name")?.to_owned(), link: *link, position_m })
        })
        .collect();
    let dependent = |c: &str| coupled.iter().any(|k| k.0 == c);
    let is_angle = |c: &str| joints.iter().any(|j| j.rotations.iter().any(|a| a.coordinate.as_deref() == Some(c)));
    let coordinates = defaults.keys().filter(|c| !dependent(c)).map(|c| (c.clone(), is_angle(c))).collect();
    Ok(OsimModel { name, model: tree, inertias, markers, coordinates, defaults, coupled, joints })
}
