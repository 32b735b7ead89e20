//! Expresses the refined geometry in the frames defined by the specification.

use super::ObjectInput;
use super::links::{Links, error};
use super::size::size_prior;
use crate::ScaleError;
use crate::bundle::Bundle;
use crate::geometry::{apply_inverse, axes_y_z, axes_z_x, pose, reject};
use crate::object_spec::{HalfPlane, ObjectFrame, ObjectJoint, ObjectLink};
use aloft_body::{ModelMarker, PersonFacts, State, Subject};
use nalgebra::{Isometry3, UnitQuaternion, Vector3};

fn local(links: &Links<'_>, bundle: &Bundle, label: &str) -> Option<Vector3<f64>> {
    links.markers.iter().position(|(_, l)| *l == label).map(|k| bundle.markers[k].position_m)
}

/// A link's frame as specified, in the bundle's working frame of that link.
///
/// `parent_origin` is the parent's final origin in this link's working frame at rest, `positive`
/// the sense of a hinge there.
fn wanted_frame(
    links: &Links<'_>,
    bundle: &Bundle,
    link: &ObjectLink,
    parent_origin: &Vector3<f64>,
    positive: &Vector3<f64>,
) -> Result<Isometry3<f64>, ScaleError> {
    let at = |label: &String| {
        local(links, bundle, label)
            .ok_or_else(|| error(links.spec, &link.name, format!("marker `{label}` is not known")))
    };
    let flat = || error(links.spec, &link.name, "the markers that define its frame lie on a line");
    match &link.frame {
        ObjectFrame::Markers { origin, y_axis, z_side } => {
            let (a, b) = (at(&y_axis[0])?, at(&y_axis[1])?);
            let axes = axes_y_z(&(b - a), &(at(z_side)? - a)).ok_or_else(flat)?;
            // The centre of a ball joint is the origin of the working frame.
            let origin = origin.as_ref().map_or(Ok(Vector3::zeros()), at)?;
            Ok(pose(&origin, &axes))
        }
        ObjectFrame::Hinge { x_plane, side } => {
            let z = if positive.z < 0.0 { -Vector3::z() } else { Vector3::z() };
            let marker = reject(&at(x_plane)?, &z);
            let x = if *side == HalfPlane::Positive { marker } else { -marker };
            let axes = axes_z_x(&z, &x).ok_or_else(flat)?;
            Ok(pose(&(z * z.dot(parent_origin)), &axes))
        }
    }
}

/// The bundle in the frames of the specification.
pub(super) fn name_frames(links: &Links<'_>, bundle: &Bundle, input: &ObjectInput<'_>) -> Result<Subject, ScaleError> {
    let spec = links.spec;
    let rest = bundle.frames.first().ok_or_else(|| error(spec, "-", "the static was lost as an outlier"))?;
    let mut state = State::new(&bundle.model);
    state.forward_position(&bundle.model, &rest.q);
    let mut model = bundle.model.clone();
    let mut q = model.neutral();
    let mut old_from_new: Vec<Isometry3<f64>> = Vec::with_capacity(spec.links.len());
    let mut world: Vec<Isometry3<f64>> = Vec::with_capacity(spec.links.len());
    for (l, link) in spec.links.iter().enumerate() {
        let own = state.world_from_link[l];
        let (parent_origin, positive) = match (links.parents[l], &link.joint) {
            (Some(p), Some(ObjectJoint::Hinge { positive_along_parent })) => {
                let along = Vector3::from(*positive_along_parent);
                let direction = own.rotation.inverse() * (world[p].rotation * along);
                if direction.z.abs() < 1e-3 * along.norm() {
                    return Err(error(
                        spec,
                        &link.name,
                        "its hinge is perpendicular to the direction that tells its sense",
                    ));
                }
                (apply_inverse(&own, &world[p].translation.vector), direction)
            }
            _ => (Vector3::zeros(), Vector3::z()),
        };
        let change = wanted_frame(links, bundle, link, &parent_origin, &positive)?;
        let here = own * change;
        let joint = &mut model.links[l].joint;
        let at = joint.q_offset;
        match links.parents[l] {
            None => {
                q[at..at + 3].copy_from_slice(here.translation.vector.as_slice());
                q[at + 3..at + 7].copy_from_slice(here.rotation.coords.as_slice());
            }
            Some(p) => {
                let in_parent = world[p].inverse() * here;
                if matches!(link.joint, Some(ObjectJoint::Ball)) {
                    joint.parent_from_joint = Isometry3::from_parts(in_parent.translation, UnitQuaternion::identity());
                    q[at..at + 4].copy_from_slice(in_parent.rotation.coords.as_slice());
                } else {
                    joint.parent_from_joint = in_parent;
                    q[at] = 0.0;
                }
            }
        }
        old_from_new.push(change);
        world.push(here);
    }
    model.normalize(&mut q);
    let markers: Vec<ModelMarker> = links
        .markers
        .iter()
        .zip(&bundle.markers)
        .map(|(&(link, label), m)| ModelMarker {
            label: label.into(),
            link,
            position_m: apply_inverse(&old_from_new[link], &m.position_m),
            weight: 1.0,
        })
        .collect();
    let (prior, prior_sd) = size_prior(links, &model, &markers);
    Ok(Subject {
        facts: PersonFacts { name: spec.name.clone(), sex: None, height_m: None, mass_kg: spec.total_mass_kg },
        model,
        markers,
        prior,
        prior_sd,
        static_q: q,
        provenance: vec![
            format!("geometry: {} and {} motion trials", input.static_trial.name, input.motion_trials.len()),
            "prior: size of each link's markers and joints".into(),
        ],
        estimated: None,
        boxes: Vec::new(),
    })
}
