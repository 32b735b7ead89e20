//! MJCF: the model for MuJoCo, Z up. Free root, ball joints, hinges; `qpos` holds quaternions as w
//! x y z.
//!
//! MuJoCo's root velocity is linear in the world and angular in body axes; a ball's is in axes of
//! the moving body. Each body has the ellipsoid of uniform density with its mass properties (for
//! display only: no contact, no mass of its own).

use super::osim::ellipsoid;
use crate::number::{exact, joined};
use crate::xml::Xml;
use crate::{ExportError, Format, OutFile, SubjectExport, names};
use aloft_body::{JointKind, State};
use nalgebra::{Isometry3, UnitQuaternion};

/// The format.
pub static FORMAT: Format = Format {
    name: "mjcf",
    title: "MuJoCo model with free root and ball joints",
    readers: "MuJoCo, dm_control, Isaac",
    trial: None,
    subject: Some(write),
};

fn write(subject: &SubjectExport) -> Result<Vec<OutFile>, ExportError> {
    if !subject.robot_files.is_empty() {
        return crate::robot_file::patched(subject, aloft_robot::Format::Mjcf);
    }
    let model = &subject.subject.model;
    for (link, inertia) in model.links.iter().zip(&subject.links) {
        if inertia.mass_kg <= 0.0 && link.joint.kind.nv() > 0 {
            return Err(ExportError::Link {
                link: link.name.clone(),
                format: "MJCF",
                problem: "MuJoCo takes no moving body without mass".to_owned(),
            });
        }
    }
    let mut x = Xml::new();
    x.open("mujoco", &[("model", &names::label(&subject.id))]);
    x.comment(&format!("{}; Z up, SI, radians", subject.program));
    x.empty("compiler", &[("angle", "radian"), ("inertiafromgeom", "false"), ("autolimits", "true")]);
    x.empty("option", &[("gravity", &joined(model.gravity_mps2.as_slice()))]);
    x.open("worldbody", &[]);
    body(&mut x, subject, 0);
    x.close();
    x.open("keyframe", &[]);
    x.empty("key", &[("name", "static"), ("qpos", &joined(&qpos(subject, &subject.subject.static_q)))]);
    let bytes = x.finish();
    let what = "MuJoCo model".to_owned();
    Ok(vec![OutFile { path: format!("Models/{}.xml", subject.id), bytes, what }])
}

/// MuJoCo's `qpos` of a posture: joint by joint in link order (free: x y z and quaternion w x y z;
/// ball: quaternion w x y z; hinge, slide: one number).
fn qpos(subject: &SubjectExport, q: &[f64]) -> Vec<f64> {
    let model = &subject.subject.model;
    let mut state = State::new(model);
    state.forward_position(model, q);
    let mut out = Vec::with_capacity(model.nq);
    for i in depth_first(subject) {
        let joint = &model.links[i].joint;
        let at = joint.q_offset;
        match joint.kind {
            JointKind::Free => {
                let pose = &state.world_from_link[i];
                let r = pose.rotation;
                out.extend_from_slice(pose.translation.vector.as_slice());
                out.extend([r.w, r.i, r.j, r.k]);
            }
            JointKind::Spherical => out.extend([q[at + 3], q[at], q[at + 1], q[at + 2]]),
            JointKind::Revolute(_) | JointKind::Prismatic(_) => out.push(q[at]),
            JointKind::Fixed => {}
        }
    }
    out
}

/// Links in the order in which nested elements list them.
fn depth_first(subject: &SubjectExport) -> Vec<usize> {
    let links = &subject.subject.model.links;
    let mut order = Vec::with_capacity(links.len());
    let mut stack = vec![0];
    while let Some(i) = stack.pop() {
        order.push(i);
        stack.extend((0..links.len()).rev().filter(|&c| links[c].parent == Some(i)));
    }
    order
}

fn quaternion(r: &UnitQuaternion<f64>) -> String {
    joined(&[r.w, r.i, r.j, r.k])
}

fn body(x: &mut Xml, subject: &SubjectExport, index: usize) {
    let model = &subject.subject.model;
    let link = &model.links[index];
    let (name, inertia) = (names::label(&link.name), &subject.links[index]);
    let base = if link.parent.is_none() { Isometry3::identity() } else { link.joint.parent_from_joint };
    x.open(
        "body",
        &[("name", &name), ("pos", &joined(base.translation.vector.as_slice())), ("quat", &quaternion(&base.rotation))],
    );
    let joint_name = format!("{name}_joint");
    match &link.joint.kind {
        JointKind::Free => {
            x.empty("freejoint", &[("name", &joint_name)]);
        }
        JointKind::Spherical => {
            x.empty("joint", &[("name", &joint_name), ("type", "ball")]);
        }
        JointKind::Revolute(axis) => {
            x.empty("joint", &[("name", &joint_name), ("type", "hinge"), ("axis", &joined(axis.as_slice()))]);
        }
        JointKind::Prismatic(axis) => {
            x.empty("joint", &[("name", &joint_name), ("type", "slide"), ("axis", &joined(axis.as_slice()))]);
        }
        JointKind::Fixed => {}
    }
    if inertia.mass_kg > 0.0 {
        let i = &inertia.inertia_com_kgm2;
        let six = [i[(0, 0)], i[(1, 1)], i[(2, 2)], i[(0, 1)], i[(0, 2)], i[(1, 2)]];
        x.empty(
            "inertial",
            &[
                ("pos", &joined(inertia.com_m.as_slice())),
                ("mass", &exact(inertia.mass_kg)),
                ("fullinertia", &joined(&six)),
            ],
        );
    }
    if let Some((semi, axes)) = ellipsoid(inertia) {
        x.empty(
            "geom",
            &[
                ("name", &format!("{name}_ellipsoid")),
                ("type", "ellipsoid"),
                ("size", &joined(&semi)),
                ("pos", &joined(inertia.com_m.as_slice())),
                ("quat", &quaternion(&axes)),
                ("contype", "0"),
                ("conaffinity", "0"),
                ("mass", "0"),
                ("rgba", "0.8 0.6 0.3 0.5"),
            ],
        );
    }
    for marker in subject.subject.markers.iter().filter(|m| m.link == index) {
        x.empty(
            "site",
            &[
                ("name", &names::label(&marker.label)),
                ("pos", &joined(marker.position_m.as_slice())),
                ("size", "0.007"),
            ],
        );
    }
    for child in (0..model.links.len()).filter(|&c| model.links[c].parent == Some(index)) {
        body(x, subject, child);
    }
    x.close();
}
