//! Conversion between a subject's geometry and positions in the static posture.

use crate::IkError;
use crate::problem::Problem;
use crate::tree::{NONE, Tree, axis_angle_matrix, matrix_quaternion};
use aloft_body::{JointKind, State, Subject};
use nalgebra::{Isometry3, Matrix3, Rotation3, Translation3, Unit, UnitQuaternion, Vector3};

/// Positions in the world frame of the static posture, m.
#[derive(Debug, Clone)]
pub(crate) struct Reference {
    /// Orientation of each link; constant during a calibration.
    pub rotation: Vec<Matrix3<f64>>,
    /// Centre of each link's joint (the root's origin for link 0).
    pub centre: Vec<Vector3<f64>>,
    /// Direction of each hinge, zero for other joints.
    pub axis: Vec<Vector3<f64>>,
    /// Position of every marker of the subject.
    pub marker: Vec<Vector3<f64>>,
    /// Hinge angle in the static posture, zero for other joints.
    pub angle: Vec<f64>,
}

impl Reference {
    pub fn of(subject: &Subject) -> Result<Self, IkError> {
        let model = &subject.model;
        if subject.static_q.len() != model.nq || subject.prior.len() != model.n_links() {
            return Err(IkError::Mismatch {
                subject: subject.facts.name.clone(),
                what: "static posture and prior",
                expected: format!("{} values and {} links", model.nq, model.n_links()),
                found: format!("{} values and {} links", subject.static_q.len(), subject.prior.len()),
            });
        }
        let mut state = State::new(model);
        state.forward_position(model, &subject.static_q);
        let rotation: Vec<Matrix3<f64>> =
            state.world_from_link.iter().map(|pose| pose.rotation.to_rotation_matrix().into_inner()).collect();
        let centre = state.world_from_link.iter().map(|pose| pose.translation.vector).collect();
        let mut axis = vec![Vector3::zeros(); model.n_links()];
        let mut angle = vec![0.0; model.n_links()];
        for (i, link) in model.links.iter().enumerate() {
            if let JointKind::Revolute(direction) = link.joint.kind {
                axis[i] = rotation[i] * direction.into_inner();
                angle[i] = subject.static_q[link.joint.q_offset];
            }
        }
        let marker = subject.markers.iter().map(|m| state.point_in_world(m.link, &m.position_m)).collect();
        Ok(Self { rotation, centre, axis, marker, angle })
    }

    /// Writes the geometry into a tracking problem whose hinge angles are relative to the static
    /// posture.
    pub fn apply(&self, problem: &mut Problem, marker_of: &[usize]) {
        for (i, link) in problem.tree.links.iter_mut().enumerate() {
            if link.parent == NONE {
                continue;
            }
            link.translation = self.rotation[link.parent].transpose() * (self.centre[i] - self.centre[link.parent]);
            if let JointKind::Revolute(_) = link.kind {
                link.rotation = self.rotation[link.parent].transpose() * self.rotation[i];
                link.aligned = false;
                link.kind = JointKind::Revolute(Unit::new_unchecked(self.rotation[i].transpose() * self.axis[i]));
            }
        }
        for (tracked, &m) in problem.markers.iter_mut().zip(marker_of) {
            tracked.position = self.rotation[tracked.link].transpose() * (self.marker[m] - self.centre[tracked.link]);
        }
    }

    /// The subject with this geometry. Hinges keep their axis in link coordinates (z stays z): the
    /// frame of the link rotates with it. `posture` is the static posture in the coordinates of
    /// [`Reference::apply`].
    pub fn subject(&self, like: &Subject, posture: &[f64], tree: &Tree) -> Result<Subject, IkError> {
        let old = Self::of(like)?;
        let mut subject = like.clone();
        // Orientation of the new link frames in the static posture.
        let mut turned = self.rotation.clone();
        for (i, link) in like.model.links.iter().enumerate() {
            if let JointKind::Revolute(direction) = link.joint.kind {
                let now = self.rotation[i] * direction.into_inner();
                let Some(turn) = Rotation3::rotation_between(&now, &self.axis[i]) else { continue };
                turned[i] = turn.into_inner() * self.rotation[i];
            }
        }
        let iso = |rotation: &Matrix3<f64>, origin: &Vector3<f64>| {
            Isometry3::from_parts(Translation3::from(*origin), matrix_quaternion(rotation))
        };
        for i in 0..like.model.n_links() {
            let link = &mut subject.model.links[i];
            if let Some(parent) = link.parent {
                let up = turned[parent].transpose();
                link.joint.parent_from_joint.translation.vector = up * (self.centre[i] - self.centre[parent]);
                if let JointKind::Revolute(direction) = link.joint.kind {
                    let back = axis_angle_matrix(&direction, -self.angle[i]);
                    let rotation = up * turned[i] * back;
                    link.joint.parent_from_joint.rotation = renormalized(&rotation);
                }
            }
            let new_from_old = iso(&turned[i], &self.centre[i]).inverse() * iso(&old.rotation[i], &old.centre[i]);
            subject.prior[i] = like.prior[i].transformed(&new_from_old);
        }
        for (marker, place) in subject.markers.iter_mut().zip(&self.marker) {
            marker.position_m = turned[marker.link].transpose() * (place - self.centre[marker.link]);
        }
        // The static posture: poses of the links as tracked, then joint coordinates of the new
        // frames.
        let mut pose = tree.pose();
        tree.forward(posture, &mut pose);
        let new_rotation: Vec<Matrix3<f64>> =
            (0..turned.len()).map(|i| pose.rotation[i] * self.rotation[i].transpose() * turned[i]).collect();
        subject.static_q = posture.to_vec();
        for i in 0..subject.model.n_links() {
            let joint = subject.model.links[i].joint;
            let above = subject.model.links[i].parent.map_or(Matrix3::identity(), |p| new_rotation[p]);
            let start = above * joint.parent_from_joint.rotation.to_rotation_matrix().into_inner();
            let local = renormalized(&(start.transpose() * new_rotation[i]));
            match joint.kind {
                JointKind::Free => {
                    subject.static_q[joint.q_offset + 3..joint.q_offset + 7].copy_from_slice(local.coords.as_slice())
                }
                JointKind::Spherical => {
                    subject.static_q[joint.q_offset..joint.q_offset + 4].copy_from_slice(local.coords.as_slice())
                }
                JointKind::Revolute(_) => subject.static_q[joint.q_offset] = posture[joint.q_offset] + self.angle[i],
                JointKind::Prismatic(_) | JointKind::Fixed => {}
            }
        }
        subject.model.normalize(&mut subject.static_q);
        Ok(subject)
    }
}

fn renormalized(m: &Matrix3<f64>) -> UnitQuaternion<f64> {
    UnitQuaternion::new_normalize(matrix_quaternion(m).into_inner())
}
