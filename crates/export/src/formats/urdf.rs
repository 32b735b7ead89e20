//! URDF: the model for robotics programs, Z up, floating base (the root link has no joint).
//!
//! URDF has no spherical joint: each becomes three continuous joints with massless links between
//! them, with the order, names and senses of the exported coordinates, so that a row of the MOT
//! file in radians is a posture of the URDF.

use super::osim::ellipsoid;
use crate::number::{exact, joined};
use crate::xml::Xml;
use crate::{ExportError, Format, OutFile, SubjectExport, names};
use aloft_body::{JointKind, LinkInertia};
use nalgebra::{Isometry3, UnitQuaternion, Vector3};

/// The format.
pub static FORMAT: Format = Format {
    name: "urdf",
    title: "URDF with floating base; spherical joints as three hinges",
    readers: "Pinocchio, Drake, ROS, PyBullet",
    trial: None,
    subject: Some(write),
};

fn write(subject: &SubjectExport) -> Result<Vec<OutFile>, ExportError> {
    if !subject.robot_files.is_empty() {
        return crate::robot_file::patched(subject, aloft_robot::Format::Urdf);
    }
    let model = &subject.subject.model;
    let mut x = Xml::new();
    x.open("robot", &[("name", &names::label(&subject.id))]);
    x.comment(&format!("{}; Z up, SI, radians; the root link floats", subject.program));
    for (i, link) in model.links.iter().enumerate() {
        let name = names::label(&link.name);
        write_link(&mut x, &name, &subject.links[i]);
        let Some(parent) = link.parent else { continue };
        let mut parent = names::label(&model.links[parent].name);
        let joint = &subject.coordinates.joints[i];
        let coordinate = |k: usize| subject.coordinates.list[joint.first + k].name.as_str();
        let base = &link.joint.parent_from_joint;
        match (&link.joint.kind, joint.sequence) {
            (JointKind::Spherical, Some(s)) => {
                let mut at = Isometry3::from_parts(base.translation, UnitQuaternion::identity());
                for k in 0..3 {
                    let child = if k == 2 { name.clone() } else { format!("{name}_after_{}", coordinate(k)) };
                    if k < 2 {
                        x.empty("link", &[("name", &child)]);
                    }
                    write_joint(&mut x, coordinate(k), "continuous", &parent, &child, &at, Some(&s.axis(k)));
                    at = Isometry3::identity();
                    parent = child;
                }
            }
            (JointKind::Revolute(axis), _) => {
                let axis = axis.into_inner() * joint.sign;
                write_joint(&mut x, coordinate(0), "continuous", &parent, &name, base, Some(&axis));
            }
            (JointKind::Prismatic(axis), _) => {
                let axis = axis.into_inner() * joint.sign;
                write_joint(&mut x, coordinate(0), "prismatic", &parent, &name, base, Some(&axis));
            }
            _ => write_joint(&mut x, &format!("{name}_joint"), "fixed", &parent, &name, base, None),
        }
    }
    let bytes = x.finish();
    let what = "URDF model; its joints are the coordinates of the MOT files, in radians".to_owned();
    Ok(vec![OutFile { path: format!("Models/{}.urdf", subject.id), bytes, what }])
}

fn origin(x: &mut Xml, at: &Isometry3<f64>) {
    let (roll, pitch, yaw) = at.rotation.euler_angles();
    x.empty("origin", &[("xyz", &joined(at.translation.vector.as_slice())), ("rpy", &joined(&[roll, pitch, yaw]))]);
}

fn write_link(x: &mut Xml, name: &str, inertia: &LinkInertia) {
    x.open("link", &[("name", name)]);
    if inertia.mass_kg > 0.0 {
        let i = &inertia.inertia_com_kgm2;
        x.open("inertial", &[]);
        origin(x, &Isometry3::from_parts(inertia.com_m.into(), UnitQuaternion::identity()));
        x.empty("mass", &[("value", &exact(inertia.mass_kg))]);
        x.empty(
            "inertia",
            &[
                ("ixx", &exact(i[(0, 0)])),
                ("ixy", &exact(i[(0, 1)])),
                ("ixz", &exact(i[(0, 2)])),
                ("iyy", &exact(i[(1, 1)])),
                ("iyz", &exact(i[(1, 2)])),
                ("izz", &exact(i[(2, 2)])),
            ],
        );
        x.close();
    }
    if let Some((semi, axes)) = ellipsoid(inertia) {
        // a box with the same mass properties: side² = 12/5 semi-axis²
        let sides = semi.map(|s| s * (12.0_f64 / 5.0).sqrt());
        x.open("visual", &[]);
        origin(x, &Isometry3::from_parts(inertia.com_m.into(), axes));
        x.open("geometry", &[]).empty("box", &[("size", &joined(&sides))]).close().close();
    }
    x.close();
}

fn write_joint(
    x: &mut Xml,
    name: &str,
    kind: &str,
    parent: &str,
    child: &str,
    at: &Isometry3<f64>,
    axis: Option<&Vector3<f64>>,
) {
    x.open("joint", &[("name", name), ("type", kind)]);
    origin(x, at);
    x.empty("parent", &[("link", parent)]).empty("child", &[("link", child)]);
    if let Some(axis) = axis {
        x.empty("axis", &[("xyz", &joined(axis.as_slice()))]);
    }
    if kind == "prismatic" {
        x.empty("limit", &[("lower", "-100"), ("upper", "100"), ("effort", "1e9"), ("velocity", "1e9")]);
    }
    x.close();
}
