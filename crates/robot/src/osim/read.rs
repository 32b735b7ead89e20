//! The parts of an OpenSim 4 file: bodies, joints, coordinates, couplings, markers.

use super::function::{Function, numbers};
use aloft_body::LinkInertia;
use nalgebra::{Isometry3, Matrix3, Unit, UnitQuaternion, Vector3};
use roxmltree::Node;
use std::collections::BTreeMap;

/// What a file contains that is not supported.
#[derive(Default)]
pub(super) struct Refused(pub(super) Vec<String>);

impl Refused {
    pub(super) fn add(&mut self, what: impl Into<String>) {
        let what = what.into();
        if !self.0.contains(&what) {
            self.0.push(what);
        }
    }
}

pub(super) fn child<'a, 'b>(node: Node<'a, 'b>, name: &str) -> Option<Node<'a, 'b>> {
    node.children().find(|c| c.has_tag_name(name))
}

pub(super) fn objects<'a, 'b>(model: Node<'a, 'b>, set: &str) -> Vec<Node<'a, 'b>> {
    let objects = child(model, set).and_then(|s| child(s, "objects"));
    objects.map_or(Vec::new(), |o| o.children().filter(Node::is_element).collect())
}

pub(super) fn text<'a>(node: Node<'a, '_>, name: &str) -> &'a str {
    node.children().find(|c| c.has_tag_name(name)).and_then(|c| c.text()).unwrap_or_default().trim()
}

pub(super) fn vector(node: Node<'_, '_>, name: &str) -> Option<Vector3<f64>> {
    match numbers(text(node, name))?.as_slice() {
        [] => Some(Vector3::zeros()),
        [x, y, z] => Some(Vector3::new(*x, *y, *z)),
        _ => None,
    }
}

pub(super) fn last(path: &str) -> &str {
    path.rsplit('/').next().unwrap_or(path)
}

/// The number in an element, `missing` where there is none; anything else is refused.
fn number_or(node: Node<'_, '_>, element: &str, missing: f64, of: &str, refused: &mut Refused) -> f64 {
    match numbers(text(node, element)).as_deref() {
        Some([]) => missing,
        Some([number]) => *number,
        _ => {
            refused.add(format!("`{element}` of `{of}`, which is `{}`", text(node, element)));
            missing
        }
    }
}

/// Bodies by name with their inertia in the body's frame.
pub(super) fn bodies(model: Node<'_, '_>, refused: &mut Refused) -> BTreeMap<String, LinkInertia> {
    let mut out = BTreeMap::new();
    for node in objects(model, "BodySet") {
        let name = node.attribute("name").unwrap_or_default();
        // none: a body without a mass is refused below
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

/// One axis of a joint.
#[derive(Debug, Clone)]
pub(super) struct RawAxis {
    pub axis: Vector3<f64>,
    pub coordinate: Option<String>,
    pub function: Function,
}

/// A coordinate as the file states it.
#[derive(Debug, Clone)]
pub(super) struct RawCoordinate {
    pub name: String,
    pub default: f64,
    pub range: Option<[f64; 2]>,
    pub locked: bool,
}

/// A joint before the tree is made, with the names of its bodies.
#[derive(Debug, Clone)]
pub(super) struct RawJoint {
    pub name: String,
    pub parent: String,
    pub child: String,
    pub parent_from_joint: Isometry3<f64>,
    pub body_from_joint: Isometry3<f64>,
    pub rotations: Vec<RawAxis>,
    pub translations: Vec<RawAxis>,
    pub coordinates: Vec<RawCoordinate>,
}

fn coordinate(node: Node<'_, '_>, refused: &mut Refused) -> Option<RawCoordinate> {
    let name = node.attribute("name")?.to_owned();
    let prescribed = child(node, "prescribed_function").is_some_and(|f| f.children().any(|c| c.is_element()));
    if prescribed && text(node, "prescribed") == "true" {
        refused.add(format!("the coordinate `{name}` prescribed by a function of time"));
    }
    let stated = numbers(text(node, "range"));
    if stated.is_none() {
        refused.add(format!("the range `{}` of the coordinate `{name}`", text(node, "range")));
    }
    let range = match stated.as_deref() {
        Some(&[low, high]) if low <= high && text(node, "clamped") == "true" => Some([low, high]),
        _ => None,
    };
    let default = number_or(node, "default_value", 0.0, &name, refused);
    Some(RawCoordinate { name, default, range, locked: text(node, "locked") == "true" })
}

pub(super) fn joints(model: Node<'_, '_>, refused: &mut Refused) -> Vec<RawJoint> {
    let mut out = Vec::new();
    for node in objects(model, "JointSet") {
        let (kind, name) = (node.tag_name().name(), node.attribute("name").unwrap_or_default());
        let frames = frames(node);
        let place = |socket: &str| {
            let named = last(text(node, socket)).to_owned();
            frames.get(&named).cloned().unwrap_or((named, Isometry3::identity()))
        };
        let coordinates: Vec<RawCoordinate> = child(node, "coordinates").map_or(Vec::new(), |c| {
            c.children().filter(Node::is_element).filter_map(|c| coordinate(c, refused)).collect()
        });
        let along = |i: usize, axis: [f64; 3]| RawAxis {
            axis: Vector3::from(axis),
            coordinate: coordinates.get(i).map(|c| c.name.clone()),
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
        let name = name.to_owned();
        out.push(RawJoint {
            name,
            parent,
            child,
            parent_from_joint,
            body_from_joint,
            rotations,
            translations,
            coordinates,
        });
    }
    out
}

/// Axes of a CustomJoint.
fn custom(node: Node<'_, '_>) -> Result<(Vec<RawAxis>, Vec<RawAxis>), String> {
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
        let found = RawAxis { axis: direction, coordinate, function };
        if axis.attribute("name").unwrap_or_default().starts_with("rotation") {
            rotations.push(found);
        } else {
            translations.push(found);
        }
    }
    Ok((rotations, translations))
}

pub(super) fn couplers(model: Node<'_, '_>, refused: &mut Refused) -> Vec<(String, String, Function)> {
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
                    let scale = number_or(node, "scale_factor", 1.0, name, refused);
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
