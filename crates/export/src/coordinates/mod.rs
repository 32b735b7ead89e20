//! Conventional joint angles from joint motion, and back to the axes of the model files.
//!
//! Internally, rotations are quaternions; here each spherical joint (and the root) becomes three
//! rotations. Series are continuous in time: of the triples that give the same rotation, the one
//! nearest to the previous frame is taken, so there are no jumps by 360°, and angles remain
//! continuous when a motion passes through gimbal lock.

mod naming;
mod sequence;

pub use sequence::Sequence;

use crate::ExportError;
use crate::frame::{ground_from_world, to_ground};
use aloft_body::{JointKind, Model, Motion, State};
use nalgebra::{Matrix3, Quaternion, UnitQuaternion, Vector3};
use serde::{Deserialize, Serialize};

/// Convention of the joint angles written.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Convention {
    /// Names and axes of OpenSim's full-body models: z-x-y (flexion, adduction, rotation) at hip,
    /// ankle, back, neck and shoulder; also at the wrist (flexion, deviation, pronation), so that a
    /// hand whose markers determine only pronation can be fixed in the other two.
    #[default]
    Model,
    /// Recommendations of the International Society of Biomechanics: Wu et al. 2002 (hip, ankle,
    /// spine: z-x-y; knee: flexion about the hinge) and Wu et al. 2005 (shoulder: Y-X-Y, plane of
    /// elevation, elevation, axial rotation; wrist: z-x-y).
    Isb,
}

impl Convention {
    /// Name typed by users.
    pub fn word(self) -> &'static str {
        match self {
            Self::Model => "model",
            Self::Isb => "isb",
        }
    }
}

/// Angle or length.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Quantity {
    /// A rotation, rad.
    Angle,
    /// A displacement, m.
    Length,
}

/// One coordinate of the exported model.
#[derive(Debug, Clone, PartialEq)]
pub struct Coordinate {
    /// Name, unique in the model.
    pub name: String,
    /// Angle or length.
    pub quantity: Quantity,
    /// Index of the link that it moves.
    pub link: usize,
    /// Meaning of the positive sense.
    pub positive: &'static str,
}

/// The coordinates of one joint.
#[derive(Debug, Clone, PartialEq)]
pub struct JointCoordinates {
    /// Index of the link.
    pub link: usize,
    /// Index of the first coordinate.
    pub first: usize,
    /// Number of coordinates: 6, 3, 1 or 0.
    pub count: usize,
    /// Order of the rotations of a free or spherical joint.
    pub sequence: Option<Sequence>,
    /// Sense of a hinge's or slider's coordinate along the joint's axis.
    pub sign: f64,
    /// Name of the joint's angles, for files that group them.
    pub group: String,
}

/// All coordinates of a model, joint by joint in link order.
#[derive(Debug, Clone, PartialEq)]
pub struct Coordinates {
    /// The convention.
    pub convention: Convention,
    /// One entry per link.
    pub joints: Vec<JointCoordinates>,
    /// The coordinates in order.
    pub list: Vec<Coordinate>,
}

/// Coordinates over time, SI (rad, m), frame by frame: `values[frame * n + coordinate]`; NaN where
/// missing.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct CoordinateSeries {
    /// Number of coordinates per frame.
    pub n: usize,
    /// Number of frames.
    pub n_frames: usize,
    /// Values.
    pub values: Vec<f64>,
    /// Rates; empty if the motion has none.
    pub rates: Vec<f64>,
    /// Accelerations; empty if the motion has none.
    pub accelerations: Vec<f64>,
    /// Number of frames within 5° of gimbal lock: (link, frames), only for links with such frames.
    pub near_gimbal_lock: Vec<(usize, usize)>,
}

/// sin 5°: closer to gimbal lock than this, angles are still correct but their rates are
/// unreliable.
const NEAR_LOCK: f64 = 0.087_155_742_747_658_17;

impl Coordinates {
    /// The coordinates of a model.
    pub fn of(model: &Model, convention: Convention) -> Self {
        let (mut joints, mut list) = (Vec::new(), Vec::new());
        for (index, link) in model.links.iter().enumerate() {
            let naming = naming::naming(link, convention);
            joints.push(JointCoordinates {
                link: index,
                first: list.len(),
                count: naming.names.len(),
                sequence: naming.sequence,
                sign: naming.sign,
                group: naming.group,
            });
            for (k, (name, positive)) in naming.names.into_iter().zip(naming.positive).enumerate() {
                let length = match link.joint.kind {
                    JointKind::Free => k >= 3,
                    JointKind::Prismatic(_) => true,
                    _ => false,
                };
                let quantity = if length { Quantity::Length } else { Quantity::Angle };
                list.push(Coordinate { name, quantity, link: index, positive });
            }
        }
        Self { convention, joints, list }
    }

    /// Number of coordinates.
    pub fn len(&self) -> usize {
        self.list.len()
    }

    /// True for a model without coordinates.
    pub fn is_empty(&self) -> bool {
        self.list.is_empty()
    }

    /// Coordinates of one posture. Those of the root refer to OpenSim's ground (Y up). `state`
    /// holds the poses of `q`; `previous` (same length) selects among equivalent triples.
    fn posture(&self, model: &Model, state: &State, q: &[f64], previous: Option<&[f64]>, out: &mut [f64]) {
        for joint in &self.joints {
            let kind = model.links[joint.link].joint.kind;
            let at = model.links[joint.link].joint.q_offset;
            let own = joint.first..joint.first + joint.count;
            match (kind, joint.sequence) {
                (JointKind::Free | JointKind::Spherical, Some(sequence)) => {
                    let r = self.rotation(model, state, joint.link, q);
                    let before = previous.map(|p| [p[joint.first], p[joint.first + 1], p[joint.first + 2]]);
                    let before = before.filter(|b| b.iter().all(|x| x.is_finite()));
                    out[joint.first..joint.first + 3].copy_from_slice(&sequence.angles(&r, before.as_ref()));
                    if kind == JointKind::Free {
                        let p = to_ground(&state.world_from_link[joint.link].translation.vector);
                        out[joint.first + 3..joint.first + 6].copy_from_slice(p.as_slice());
                    }
                }
                (JointKind::Revolute(_) | JointKind::Prismatic(_), _) => out[own.start] = joint.sign * q[at],
                _ => {}
            }
        }
    }

    /// Rotation described by a joint's three angles: the link in its parent, for the root in
    /// OpenSim's ground.
    fn rotation(&self, model: &Model, state: &State, link: usize, q: &[f64]) -> Matrix3<f64> {
        let joint = &model.links[link].joint;
        match joint.kind {
            JointKind::Free => ground_from_world().into_inner() * state.rotation(link),
            _ => {
                let x = &q[joint.q_offset..joint.q_offset + 4];
                let turn = UnitQuaternion::new_normalize(Quaternion::new(x[3], x[0], x[1], x[2]));
                (joint.parent_from_joint.rotation * turn).to_rotation_matrix().into_inner()
            }
        }
    }

    /// Coordinates of one posture (rad, m).
    ///
    /// # Errors
    /// `q` does not belong to the model.
    pub(crate) fn of_posture(&self, model: &Model, q: &[f64]) -> Result<Vec<f64>, ExportError> {
        expect_length("coordinates of a posture", model.nq, q.len())?;
        let mut state = State::new(model);
        state.forward_position(model, q);
        let mut out = vec![f64::NAN; self.len()];
        self.posture(model, &state, q, None, &mut out);
        Ok(out)
    }

    /// Coordinates of a motion, with rates and accelerations if it has them.
    ///
    /// # Errors
    /// The motion does not belong to the model.
    pub fn series(&self, model: &Model, motion: &Motion) -> Result<CoordinateSeries, ExportError> {
        expect_length("coordinates of a motion", model.nq, motion.nq)?;
        let (n, n_frames) = (self.len(), motion.n_frames());
        let moving = motion.v.len() == n_frames * model.nv && motion.a.len() == n_frames * model.nv;
        let mut s = CoordinateSeries { n, n_frames, values: vec![f64::NAN; n * n_frames], ..Default::default() };
        if moving {
            s.rates = vec![f64::NAN; n * n_frames];
            s.accelerations = vec![f64::NAN; n * n_frames];
        }
        let mut state = State::new(model);
        let mut last: Option<Vec<f64>> = None;
        let mut locked = vec![0; self.joints.len()];
        let mut values = vec![0.0; n];
        for f in (0..n_frames).filter(|&f| motion.is_valid(f)) {
            let q = motion.q(f);
            state.forward_position(model, q);
            self.posture(model, &state, q, last.as_deref(), &mut values);
            s.values[f * n..(f + 1) * n].copy_from_slice(&values);
            if moving {
                let (rates, accelerations) = (&mut s.rates[f * n..], &mut s.accelerations[f * n..]);
                self.rates(model, &state, &values, motion.v(f), motion.a(f), rates, accelerations);
            }
            for (joint, count) in self.joints.iter().zip(&mut locked) {
                if let Some(sequence) = joint.sequence {
                    *count += usize::from(sequence.regularity(&three(&values, joint.first)) < NEAR_LOCK);
                }
            }
            last = Some(values.clone());
        }
        s.near_gimbal_lock = locked.into_iter().enumerate().filter(|(_, frames)| *frames > 0).collect();
        Ok(s)
    }

    fn rates(
        &self,
        model: &Model,
        state: &State,
        values: &[f64],
        v: &[f64],
        a: &[f64],
        rates: &mut [f64],
        accelerations: &mut [f64],
    ) {
        let vector = |x: &[f64], i: usize| Vector3::new(x[i], x[i + 1], x[i + 2]);
        for joint in &self.joints {
            let own = &model.links[joint.link].joint;
            let (i, k) = (own.v_offset, joint.first);
            let turning = match own.kind {
                JointKind::Free => i + 3,
                _ => i,
            };
            match (own.kind, joint.sequence) {
                (JointKind::Free | JointKind::Spherical, Some(sequence)) => {
                    let (w, dw) = (vector(v, turning), vector(a, turning));
                    let (r, dr) = sequence.rates(&three(values, k), &w, &dw);
                    rates[k..k + 3].copy_from_slice(&r);
                    accelerations[k..k + 3].copy_from_slice(&dr);
                    if own.kind == JointKind::Free {
                        let (lin, dlin) = (vector(v, i), vector(a, i));
                        let world = state.rotation(joint.link);
                        let velocity = to_ground(&(world * lin));
                        let acceleration = to_ground(&(world * (dlin + w.cross(&lin))));
                        rates[k + 3..k + 6].copy_from_slice(velocity.as_slice());
                        accelerations[k + 3..k + 6].copy_from_slice(acceleration.as_slice());
                    }
                }
                (JointKind::Revolute(_) | JointKind::Prismatic(_), _) => {
                    rates[k] = joint.sign * v[i];
                    accelerations[k] = joint.sign * a[i];
                }
                _ => {}
            }
        }
    }

    /// Generalised forces for these coordinates, from those for the model's velocities: N·m for
    /// angles, N for lengths. `values` are the coordinates of the frame, `tau` has length nv (free
    /// joint: force then moment, in root axes).
    pub(crate) fn generalised_forces(
        &self,
        model: &Model,
        state: &State,
        values: &[f64],
        tau: &[f64],
        out: &mut [f64],
    ) {
        for joint in &self.joints {
            let own = &model.links[joint.link].joint;
            let (i, k) = (own.v_offset, joint.first);
            let vector = |i: usize| Vector3::new(tau[i], tau[i + 1], tau[i + 2]);
            match (own.kind, joint.sequence) {
                (JointKind::Free | JointKind::Spherical, Some(sequence)) => {
                    let free = own.kind == JointKind::Free;
                    let moment = vector(if free { i + 3 } else { i });
                    let along = sequence.velocity_matrix(&three(values, k)).transpose() * moment;
                    out[k..k + 3].copy_from_slice(along.as_slice());
                    if free {
                        let force = to_ground(&(state.rotation(joint.link) * vector(i)));
                        out[k + 3..k + 6].copy_from_slice(force.as_slice());
                    }
                }
                (JointKind::Revolute(_) | JointKind::Prismatic(_), _) => out[k] = joint.sign * tau[i],
                _ => {}
            }
        }
    }
}

impl CoordinateSeries {
    /// One coordinate over time.
    pub fn column(&self, coordinate: usize) -> Vec<f64> {
        self.values.iter().skip(coordinate).step_by(self.n.max(1)).copied().collect()
    }
}

fn three(values: &[f64], first: usize) -> [f64; 3] {
    [values[first], values[first + 1], values[first + 2]]
}

pub(crate) fn expect_length(what: &str, expected: usize, found: usize) -> Result<(), ExportError> {
    if expected == found {
        return Ok(());
    }
    Err(ExportError::Mismatch { what: what.to_owned(), expected: expected.to_string(), found: found.to_string() })
}
