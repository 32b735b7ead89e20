//! OSIM: the scaled model with its inertias and markers, OpenSim 4. Y up.
//!
//! Spherical joints are custom joints with three rotations (the coordinates of
//! [`crate::Coordinates`]). OpenSim rejects a custom joint whose first and last axis are the same,
//! so proper Euler angles (the ISB shoulder) use a massless body in between. Inertias are about the
//! centre of mass in body axes. Each body has the ellipsoid of uniform density with its mass
//! properties, which makes the identified values visible.

use crate::coordinates::{JointCoordinates, Quantity, Sequence};
use crate::frame::to_ground;
use crate::number::{exact, joined};
use crate::xml::Xml;
use crate::{ExportError, Format, InertiaSource, OutFile, SubjectExport, names};
use aloft_body::{JointKind, LinkInertia};
use nalgebra::{Isometry3, Matrix3, Rotation3, SymmetricEigen, UnitQuaternion, Vector3};

/// The format.
pub static FORMAT: Format = Format {
    name: "osim",
    title: "OpenSim 4 model with the exported inertias and markers; those from tables beside it",
    readers: "OpenSim, OpenSim Moco, SCONE",
    trial: None,
    subject: Some(write),
};

/// Path of the model.
pub(crate) fn path(subject: &SubjectExport) -> String {
    match &subject.osim_file {
        Some(file) => crate::osim_file::path(subject, file),
        None => format!("Models/{}.osim", subject.id),
    }
}

fn write(subject: &SubjectExport) -> Result<Vec<OutFile>, ExportError> {
    if let Some(file) = &subject.osim_file {
        return crate::osim_file::model(subject, file);
    }
    let from = match &subject.source {
        InertiaSource::Identified { rows, from_table, .. } if from_table.is_empty() => {
            format!("inertias identified from flights ({rows} rows)")
        }
        InertiaSource::Identified { rows, from_table, .. } => format!(
            "inertias identified from flights ({rows} rows); from tables, because motion did not determine them: {}",
            from_table.join("; ")
        ),
        InertiaSource::Prior { reason } => format!("inertias from tables: {reason}"),
    };
    let what = format!("OpenSim model, {from}");
    let mut out = vec![OutFile { path: path(subject), bytes: model(subject, &subject.links, &from)?, what }];
    if matches!(subject.source, InertiaSource::Identified { .. }) {
        let bytes = model(subject, &subject.subject.prior, "inertias from tables")?;
        let what = "the same OpenSim model with the inertias from tables".to_owned();
        out.push(OutFile { path: format!("Models/{}_prior.osim", subject.id), bytes, what });
    }
    Ok(out)
}

/// Orientation as rotations about x, then y, then z of the moving frame (rad), as in OpenSim's
/// offset frames.
fn orientation(r: &UnitQuaternion<f64>) -> [f64; 3] {
    Sequence::new([0, 1, 2], [1.0; 3]).angles(&r.to_rotation_matrix().into_inner(), None)
}

/// Semi-axes (m) and axes of the ellipsoid of uniform density with this inertia; none without mass
/// or extent.
pub(crate) fn ellipsoid(inertia: &LinkInertia) -> Option<([f64; 3], UnitQuaternion<f64>)> {
    if inertia.mass_kg <= 0.0 {
        return None;
    }
    let eigen = SymmetricEigen::new(inertia.inertia_com_kgm2);
    let moments = eigen.eigenvalues;
    let half_trace = 0.5 * moments.sum();
    let semi = std::array::from_fn(|k| (5.0 * (half_trace - moments[k]).max(0.0) / inertia.mass_kg).sqrt().max(1e-4));
    let mut axes: Matrix3<f64> = eigen.eigenvectors;
    if axes.determinant() < 0.0 {
        let flipped = -axes.column(2).into_owned();
        axes.set_column(2, &flipped);
    }
    let axes = UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(axes));
    semi.iter().all(|s: &f64| s.is_finite()).then_some((semi, axes))
}

fn model(subject: &SubjectExport, links: &[LinkInertia], from: &str) -> Result<Vec<u8>, ExportError> {
    let body = &subject.subject;
    let mut x = Xml::new();
    x.open("OpenSimDocument", &[("Version", "40000")]);
    x.open("Model", &[("name", &names::label(&subject.id))]);
    x.leaf("credits", &format!("{}; {from}", subject.program));
    x.leaf("length_units", "meters").leaf("force_units", "N");
    x.leaf("gravity", &joined(to_ground(&body.model.gravity_mps2).as_slice()));
    x.open("Ground", &[("name", "ground")]).close();
    x.open("BodySet", &[("name", "bodyset")]).open("objects", &[]);
    for (link, inertia) in body.model.links.iter().zip(links) {
        write_body(&mut x, &names::label(&link.name), inertia);
        let joint = joint_of(subject, &link.name)?;
        if joint.sequence.is_some_and(|s| s.is_proper_euler()) {
            let nothing = LinkInertia { mass_kg: 0.0, com_m: Vector3::zeros(), inertia_com_kgm2: Matrix3::zeros() };
            write_body(&mut x, &between(&link.name), &nothing);
        }
    }
    x.close().close();
    x.open("JointSet", &[("name", "jointset")]).open("objects", &[]);
    let defaults = subject.coordinates.of_posture(&body.model, &body.static_q)?;
    for joint in &subject.coordinates.joints {
        write_joint(&mut x, subject, joint, &defaults);
    }
    x.close().close();
    for set in ["ControllerSet", "ForceSet"] {
        x.open(set, &[("name", &set.to_lowercase())]).empty("objects", &[]).empty("groups", &[]).close();
    }
    x.open("MarkerSet", &[("name", "markerset")]).open("objects", &[]);
    for marker in &body.markers {
        x.open("Marker", &[("name", &names::label(&marker.label))]);
        x.leaf("socket_parent_frame", &format!("/bodyset/{}", names::label(&body.model.links[marker.link].name)));
        x.leaf("location", &joined(marker.position_m.as_slice())).leaf("fixed", "true").close();
    }
    Ok(x.finish())
}

fn joint_of<'a>(subject: &'a SubjectExport, link: &str) -> Result<&'a JointCoordinates, ExportError> {
    let index = subject.subject.model.links.iter().position(|l| l.name == link);
    index.and_then(|i| subject.coordinates.joints.get(i)).ok_or_else(|| ExportError::Link {
        link: link.to_owned(),
        format: "OSIM",
        problem: "it has no coordinates".to_owned(),
    })
}

/// Name of the massless body between the rotations of proper Euler angles.
fn between(link: &str) -> String {
    format!("{}_elevation", names::label(link))
}

fn write_body(x: &mut Xml, name: &str, inertia: &LinkInertia) {
    let i = &inertia.inertia_com_kgm2;
    x.open("Body", &[("name", name)]);
    if let Some((semi, axes)) = ellipsoid(inertia) {
        x.open("components", &[]).open("PhysicalOffsetFrame", &[("name", "mass_properties")]);
        x.open("attached_geometry", &[]).open("Ellipsoid", &[("name", &format!("{name}_ellipsoid"))]);
        x.leaf("socket_frame", "..").leaf("radii", &joined(&semi));
        x.open("Appearance", &[]).leaf("opacity", "0.5").leaf("color", "0.8 0.6 0.3").close();
        x.close().close();
        x.leaf("socket_parent", "..").leaf("translation", &joined(inertia.com_m.as_slice()));
        x.leaf("orientation", &joined(&orientation(&axes))).close().close();
    }
    x.leaf("mass", &exact(inertia.mass_kg)).leaf("mass_center", &joined(inertia.com_m.as_slice()));
    let six = [i[(0, 0)], i[(1, 1)], i[(2, 2)], i[(0, 1)], i[(0, 2)], i[(1, 2)]];
    x.leaf("inertia", &joined(&six)).close();
}

/// One axis of a spatial transform: coordinate (none: constant zero) and direction.
type Axis<'a> = (Option<&'a str>, Vector3<f64>);

struct JointXml<'a> {
    name: String,
    parent: String,
    child: String,
    offset: Isometry3<f64>,
    coordinates: Vec<usize>,
    turns: [Axis<'a>; 3],
    shifts: [Axis<'a>; 3],
}

const E: fn(usize) -> Vector3<f64> = |k| {
    let mut e = Vector3::zeros();
    e[k] = 1.0;
    e
};

/// Two axes that form a right-handed frame with the given one.
fn beside(axis: &Vector3<f64>) -> (Vector3<f64>, Vector3<f64>) {
    let other = E(axis.iamin());
    let second = axis.cross(&other).normalize();
    (second, axis.cross(&second))
}

fn write_joint(x: &mut Xml, subject: &SubjectExport, joint: &JointCoordinates, defaults: &[f64]) {
    let model = &subject.subject.model;
    let link = &model.links[joint.link];
    let child = names::label(&link.name);
    let parent =
        link.parent.map_or("/ground".to_owned(), |p| format!("/bodyset/{}", names::label(&model.links[p].name)));
    let coordinate = |k: usize| subject.coordinates.list[joint.first + k].name.as_str();
    let still = [(None, E(0)), (None, E(1)), (None, E(2))];
    let own: Vec<usize> = (joint.first..joint.first + joint.count).collect();
    let base = link.joint.parent_from_joint;
    let one = |turns, shifts, offset| JointXml {
        name: format!("{child}_joint"),
        parent: parent.clone(),
        child: format!("/bodyset/{child}"),
        offset,
        coordinates: own.clone(),
        turns,
        shifts,
    };
    let place = Isometry3::from_parts(base.translation, UnitQuaternion::identity());
    let joints = match (link.joint.kind, joint.sequence) {
        (JointKind::Free, Some(s)) => {
            // ground coordinates are absolute
            let turns = [0, 1, 2].map(|k| (Some(coordinate(k)), s.axis(k)));
            let shifts = [0, 1, 2].map(|k| (Some(coordinate(3 + k)), E(k)));
            vec![one(turns, shifts, Isometry3::identity())]
        }
        (JointKind::Spherical, Some(s)) if s.is_proper_euler() => {
            let third = s.axis(0).cross(&s.axis(1));
            let (beside_1, beside_2) = beside(&s.axis(2));
            let middle = between(&link.name);
            vec![
                JointXml {
                    name: format!("{middle}_joint"),
                    child: format!("/bodyset/{middle}"),
                    coordinates: own[..2].to_vec(),
                    ..one(
                        [(Some(coordinate(0)), s.axis(0)), (Some(coordinate(1)), s.axis(1)), (None, third)],
                        still,
                        place,
                    )
                },
                JointXml {
                    parent: format!("/bodyset/{middle}"),
                    coordinates: own[2..].to_vec(),
                    ..one(
                        [(Some(coordinate(2)), s.axis(2)), (None, beside_1), (None, beside_2)],
                        still,
                        Isometry3::identity(),
                    )
                },
            ]
        }
        (JointKind::Spherical, Some(s)) => {
            vec![one([0, 1, 2].map(|k| (Some(coordinate(k)), s.axis(k))), still, place)]
        }
        (JointKind::Revolute(axis), _) => {
            let axis = axis.into_inner() * joint.sign;
            let (second, third) = beside(&axis);
            vec![one([(Some(coordinate(0)), axis), (None, second), (None, third)], still, base)]
        }
        (JointKind::Prismatic(axis), _) => {
            let axis = axis.into_inner() * joint.sign;
            let (second, third) = beside(&axis);
            vec![one(still, [(Some(coordinate(0)), axis), (None, second), (None, third)], base)]
        }
        _ => vec![one(still, still, base)],
    };
    for part in joints {
        let fixed = part.coordinates.is_empty();
        let kind = if fixed { "WeldJoint" } else { "CustomJoint" };
        x.open(kind, &[("name", &part.name)]);
        x.leaf("socket_parent_frame", "parent_offset").leaf("socket_child_frame", "child_offset");
        if !fixed {
            x.open("coordinates", &[]);
            for &c in &part.coordinates {
                write_coordinate(x, subject, c, defaults[c]);
            }
            x.close();
        }
        x.open("frames", &[]);
        for (name, on, at) in
            [("parent_offset", &part.parent, part.offset), ("child_offset", &part.child, Isometry3::identity())]
        {
            x.open("PhysicalOffsetFrame", &[("name", name)]).leaf("socket_parent", on);
            x.leaf("translation", &joined(at.translation.vector.as_slice()));
            x.leaf("orientation", &joined(&orientation(&at.rotation))).close();
        }
        x.close();
        if !fixed {
            x.open("SpatialTransform", &[]);
            for (name, axes) in [("rotation", &part.turns), ("translation", &part.shifts)] {
                for (k, (coordinate, axis)) in axes.iter().enumerate() {
                    x.open("TransformAxis", &[("name", &format!("{name}{}", k + 1))]);
                    x.leaf("coordinates", coordinate.unwrap_or_default()).leaf("axis", &joined(axis.as_slice()));
                    match coordinate {
                        Some(_) => {
                            x.open("LinearFunction", &[("name", "function")]).leaf("coefficients", "1 0").close()
                        }
                        None => x.open("Constant", &[("name", "function")]).leaf("value", "0").close(),
                    };
                    x.close();
                }
            }
            x.close();
        }
        x.close();
    }
}

fn write_coordinate(x: &mut Xml, subject: &SubjectExport, index: usize, default: f64) {
    let coordinate = &subject.coordinates.list[index];
    x.open("Coordinate", &[("name", &coordinate.name)]);
    x.comment(&format!("positive: {}", coordinate.positive));
    x.leaf("default_value", &exact(default)).leaf("default_speed_value", "0");
    let range = if coordinate.quantity == Quantity::Angle { 4.0 * std::f64::consts::PI } else { 100.0 };
    x.leaf("range", &joined(&[-range, range])).leaf("clamped", "false");
    x.leaf("locked", if subject.is_locked(index) { "true" } else { "false" }).close();
}
