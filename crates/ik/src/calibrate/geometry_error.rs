//! Errors that a geometry may have: draws of joint centres, hinge axes and marker places.

use super::CalibrateOptions;
use super::reference::Reference;
use crate::IkError;
use crate::tree::{axis_angle_matrix, matrix_quaternion};
use aloft_body::{JointKind, Subject};
use nalgebra::{Unit, UnitQuaternion, Vector3};
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};
use serde::{Deserialize, Serialize};

/// Number of draws that a calibration makes: those of the noise floor have as many.
pub(crate) const DRAWS: usize = 8;
const SEED: u64 = 0x6765_6f6d;

/// One draw of the errors of a geometry: how far the true one may lie from that of the subject, in
/// the world frame of the static posture.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct GeometryError {
    /// Displacement of each link's joint centre, m; zero for the root.
    pub centre_m: Vec<Vector3<f64>>,
    /// Change of each hinge's direction (a unit vector), zero for other joints.
    pub axis: Vec<Vector3<f64>>,
    /// Displacement of each of the subject's markers, m.
    pub marker_m: Vec<Vector3<f64>>,
}

impl GeometryError {
    /// The subject with this other geometry. Link frames keep their orientation in the static
    /// posture, so that the coordinates of a posture keep their meaning; hinges turn about axes
    /// that may lie oblique in their link. The inertial prior keeps its numbers in the link frames.
    ///
    /// # Errors
    /// [`IkError::Mismatch`] if the lengths are not those of the subject.
    pub fn applied(&self, subject: &Subject) -> Result<Subject, IkError> {
        let (links, markers) = (subject.model.n_links(), subject.markers.len());
        if self.centre_m.len() != links || self.axis.len() != links || self.marker_m.len() != markers {
            return Err(IkError::Mismatch {
                subject: subject.facts.name.clone(),
                what: "errors of the geometry",
                expected: format!("{links} links and {markers} markers"),
                found: format!("{} links and {} markers", self.centre_m.len(), self.marker_m.len()),
            });
        }
        let at = Reference::of(subject)?;
        let mut out = subject.clone();
        for (i, link) in out.model.links.iter_mut().enumerate() {
            let Some(parent) = link.parent else { continue };
            let up = at.rotation[parent].transpose();
            let arm = at.centre[i] + self.centre_m[i] - at.centre[parent] - self.centre_m[parent];
            link.joint.parent_from_joint.translation.vector = up * arm;
            if let JointKind::Revolute(_) = link.joint.kind {
                let direction = at.rotation[i].transpose() * (at.axis[i] + self.axis[i]);
                let axis = Unit::new_normalize(direction);
                let rotation = up * at.rotation[i] * axis_angle_matrix(&axis, -at.angle[i]);
                link.joint.parent_from_joint.rotation =
                    UnitQuaternion::new_normalize(matrix_quaternion(&rotation).into_inner());
                link.joint.kind = JointKind::Revolute(axis);
            }
        }
        for ((marker, place), error) in out.markers.iter_mut().zip(&at.marker).zip(&self.marker_m) {
            let from = at.centre[marker.link] + self.centre_m[marker.link];
            marker.position_m = at.rotation[marker.link].transpose() * (place + error - from);
        }
        Ok(out)
    }

    /// Draws for a geometry that comes from landmarks alone: joint centres and hinge axes are wrong
    /// by the stated deviations, independently of each other; markers stay where they were seen.
    ///
    /// # Errors
    /// A static posture that does not fit the model.
    pub fn of_landmarks(subject: &Subject, options: &CalibrateOptions) -> Result<Vec<Self>, IkError> {
        let at = Reference::of(subject)?;
        let draw = |k: usize| {
            let mut rng = generator(k);
            let mut normal = || -> f64 { StandardNormal.sample(&mut rng) };
            let mut out = Self::none(subject);
            for (i, link) in subject.model.links.iter().enumerate() {
                let turns = matches!(link.joint.kind, JointKind::Spherical | JointKind::Revolute(_));
                if link.parent.is_none() || !turns {
                    continue;
                }
                out.centre_m[i] = Vector3::from_fn(|_, _| normal()) * options.joint_sd(&link.name);
                if let JointKind::Revolute(_) = link.joint.kind {
                    let sd = options.axis_sd(&link.name);
                    let away = Vector3::from_fn(|_, _| normal()) * sd;
                    out.axis[i] = away - at.axis[i] * at.axis[i].dot(&away);
                }
            }
            out
        };
        Ok((0..DRAWS).map(draw).collect())
    }

    /// No error.
    pub(crate) fn none(subject: &Subject) -> Self {
        let links = subject.model.n_links();
        Self {
            centre_m: vec![Vector3::zeros(); links],
            axis: vec![Vector3::zeros(); links],
            marker_m: vec![Vector3::zeros(); subject.markers.len()],
        }
    }
}

/// Random numbers of one draw.
pub(crate) fn generator(draw: usize) -> ChaCha8Rng {
    let mut rng = ChaCha8Rng::seed_from_u64(SEED);
    rng.set_stream(draw as u64);
    rng
}
