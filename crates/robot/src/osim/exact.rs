//! The exact tree of a model: three sliders and a ball for each joint that translates.

use super::model::{Joint, OsimModel};
use aloft_body::{JointSpec, LinkInertia, LinkSpec, Model, ModelSpec};
use nalgebra::{Isometry3, Matrix3, UnitQuaternion, Vector3};

/// The tree with the place of every body in it.
pub(super) struct Exact {
    pub model: Model,
    pub inertias: Vec<LinkInertia>,
    /// By joint: first index in `q`, and whether it slides.
    pub first: Vec<(usize, bool)>,
    /// By joint: link that carries the body, and the body's place in the link's frame.
    pub home: Vec<(usize, Isometry3<f64>)>,
}

pub(super) fn link_spec(name: String, parent: Option<String>, joint: JointSpec, at: &Isometry3<f64>) -> LinkSpec {
    let (roll, pitch, yaw) = at.rotation.euler_angles();
    LinkSpec {
        name,
        parent,
        joint,
        position_m: at.translation.vector.into(),
        rpy_rad: [roll, pitch, yaw],
        inertia: None,
    }
}

pub(super) fn tree(name: &str, joints: &[Joint]) -> Result<Exact, String> {
    let nothing = LinkInertia { mass_kg: 0.0, com_m: Vector3::zeros(), inertia_com_kgm2: Matrix3::zeros() };
    let mut links: Vec<LinkSpec> = Vec::new();
    let (mut inertias, mut home, mut slides) = (Vec::new(), Vec::<(usize, Isometry3<f64>)>::new(), Vec::new());
    for joint in joints {
        let link_from_body = joint.body_from_joint.inverse();
        let sliding = joint.translations.iter().any(|a| !a.function.is_zero());
        match joint.parent {
            None => links.push(link_spec(joint.child.clone(), None, JointSpec::Free, &Isometry3::identity())),
            Some(parent) => {
                let (carrier, pose) = home[parent];
                let mut above = links[carrier].name.clone();
                let mut place = pose * joint.parent_from_joint;
                if sliding {
                    for (axis, direction) in [("x", [1.0, 0.0, 0.0]), ("y", [0.0, 1.0, 0.0]), ("z", [0.0, 0.0, 1.0])] {
                        let slider = format!("{} {axis}", joint.child);
                        links.push(link_spec(slider.clone(), Some(above), JointSpec::Prismatic(direction), &place));
                        inertias.push(nothing);
                        (above, place) = (slider, Isometry3::identity());
                    }
                }
                links.push(link_spec(joint.child.clone(), Some(above), JointSpec::Spherical, &place));
            }
        }
        inertias.push(joint.inertia.transformed(&link_from_body));
        home.push((links.len() - 1, link_from_body));
        slides.push(sliding && joint.parent.is_some());
    }
    let model = Model::from_spec(&ModelSpec::new(name.to_owned(), links)).map_err(|e| e.to_string())?;
    let first = home
        .iter()
        .zip(&slides)
        .map(|((link, _), slides)| (model.links[*link].joint.q_offset - if *slides { 3 } else { 0 }, *slides))
        .collect();
    Ok(Exact { model, inertias, first, home })
}

impl OsimModel {
    /// `q` of the exact tree for values of all coordinates.
    pub(super) fn exact_posture(&self, values: &[f64], world_from_ground: &UnitQuaternion<f64>) -> Vec<f64> {
        let mut q = self.model.neutral();
        for (joint, (at, slides)) in self.joints.iter().zip(&self.exact) {
            let moved = joint.moved(values);
            let at = *at;
            if joint.parent.is_none() {
                let pose = world_from_ground * (joint.parent_from_joint * moved);
                q[..3].copy_from_slice(pose.translation.vector.as_slice());
                q[3..7].copy_from_slice(pose.rotation.coords.as_slice());
            } else if *slides {
                q[at..at + 3].copy_from_slice(moved.translation.vector.as_slice());
                q[at + 3..at + 7].copy_from_slice(moved.rotation.coords.as_slice());
            } else {
                q[at..at + 4].copy_from_slice(moved.rotation.coords.as_slice());
            }
        }
        q
    }
}
