//! Finds the coordinates of a model that its markers do not determine.
//!
//! Such coordinates, for example of a head without head markers or a hand with wrist markers only,
//! would drift in inverse kinematics. They are listed here so that it can lock them. A locked
//! coordinate `k` of a joint means: component `k` of `model.difference(static_q, q)` stays zero,
//! for a spherical joint the component of the rotation vector from its static posture.

use crate::ScaleError;
use aloft_body::{JointKind, Model, State, Subject};
use nalgebra::{DMatrix, Vector3};

/// Assumed marker scatter (soft tissue in motion), m.
const MARKER_SD_M: f64 = 0.010;
/// Expected range of a coordinate, rad or m.
const COORDINATE_SD: f64 = 1.0;
/// A coordinate with a larger standard deviation than this, rad, counts as undetermined.
const SEEN_SD: f64 = 0.5;
/// A hand whose markers are all within this distance of the wrist, m along the hand, determines
/// only pronation usefully.
const HAND_REACH_M: f64 = 0.03;
/// Bend of the hinges in the additional postures, rad: a straight arm does not determine its own
/// axial rotation, a bent one does.
const BEND_RAD: f64 = 0.8;

/// Velocity indices that no marker observes, ascending.
///
/// The information from all weighted markers is averaged over the static posture and the same
/// posture with every hinge bent either way; coordinates are then locked one by one, the least
/// determined first, until each of the others is known to half a radian.
///
/// # Errors
/// [`ScaleError::Facts`] if `static_q` does not match the model.
pub(crate) fn unobserved(subject: &Subject) -> Result<Vec<usize>, ScaleError> {
    let model = &subject.model;
    let nv = model.nv;
    if subject.static_q.len() != model.nq {
        return Err(ScaleError::Facts {
            subject: subject.facts.name.clone(),
            problem: "the static posture does not belong to this model".into(),
        });
    }
    let mut information = DMatrix::<f64>::identity(nv, nv) / (COORDINATE_SD * COORDINATE_SD);
    let mut state = State::new(model);
    let mut jacobian = DMatrix::zeros(3, nv);
    let bends = [0.0, BEND_RAD, -BEND_RAD];
    for bend in bends {
        let q = bent(model, &subject.static_q, bend);
        state.forward_position(model, &q);
        for marker in subject.markers.iter().filter(|m| m.weight > 0.0) {
            state.point_jacobian(model, marker.link, &marker.position_m, &mut jacobian);
            let weight = 1.0 / (MARKER_SD_M * MARKER_SD_M * bends.len() as f64);
            information.gemm_tr(weight, &jacobian, &jacobian, 1.0);
        }
    }
    let mut locked = hands_without_markers(subject);
    loop {
        let mut held = information.clone();
        for &k in &locked {
            held[(k, k)] += 1e9;
        }
        let Some(covariance) = held.cholesky().map(|c| c.inverse()) else { break };
        // the body as a whole is never held: where the trunk of a body bends unseen, it is the
        // joint that is held, not the pelvis in the world
        let root = model.links.first().map_or(0, |l| l.joint.v_offset + l.joint.kind.nv());
        let worst = (root..nv)
            .filter(|k| !locked.contains(k))
            .max_by(|&a, &b| covariance[(a, a)].total_cmp(&covariance[(b, b)]));
        match worst {
            Some(k) if covariance[(k, k)].sqrt() > SEEN_SD => locked.push(k),
            _ => break,
        }
    }
    locked.sort_unstable();
    Ok(locked)
}

fn bent(model: &Model, q: &[f64], bend: f64) -> Vec<f64> {
    let mut q = q.to_vec();
    for link in &model.links {
        if matches!(link.joint.kind, JointKind::Revolute(_)) {
            q[link.joint.q_offset] += bend;
        }
    }
    q
}

/// Flexion and deviation of wrists whose hand has wrist markers only.
fn hands_without_markers(subject: &Subject) -> Vec<usize> {
    let mut locked = Vec::new();
    for (i, link) in subject.model.links.iter().enumerate() {
        if !link.name.starts_with("hand_") || link.joint.kind != JointKind::Spherical {
            continue;
        }
        let reach = |p: &Vector3<f64>| p.y.abs();
        if subject.markers.iter().filter(|m| m.link == i && m.weight > 0.0).all(|m| reach(&m.position_m) < HAND_REACH_M)
        {
            locked.extend([link.joint.v_offset, link.joint.v_offset + 2]);
        }
    }
    locked
}
