//! Forces of a recording: generalised forces of every coordinate with the plates acting on the
//! feet, and the residual wrench at the root.
//!
//! Recursive Newton-Euler gives the forces required by the motion
//! ([`aloft_body::State::inverse_dynamics`]); the contribution of the loads is subtracted joint by
//! joint. No external force acts at the root, so the remaining wrench there is the residual of the
//! model.

use crate::coordinates::CoordinateSeries;
use crate::loads::{Load, PlateAtFrames, assign, parts};
use crate::subject::SubjectExport;
use aloft_body::{JointKind, Model, Motion, State};
use nalgebra::{Vector3, Vector6};

/// Forces of a recording, frame by frame.
#[derive(Debug, Clone, PartialEq)]
pub struct TrialForces {
    /// Loads of the plates on links.
    pub loads: Vec<Load>,
    /// Force of each coordinate, N·m or N: `generalised[frame * n + coordinate]`.
    pub generalised: Vec<f64>,
    /// Residual wrench at the root: world force (N) and moment about the root's origin in world
    /// axes (N·m); NaN where the motion is missing.
    pub residual: Vec<Vector6<f64>>,
    /// Whole-body centre of mass, m, world.
    pub centre_of_mass_m: Vec<Vector3<f64>>,
}

/// Subtracts the contribution of a wrench on `link` (world force, moment about the world origin)
/// from the generalised forces.
fn take_off(model: &Model, state: &State, link: usize, wrench: &Vector6<f64>, tau: &mut [f64]) {
    let (force, moment) = parts(wrench);
    let mut next = Some(link);
    while let Some(i) = next {
        let joint = &model.links[i].joint;
        let r = state.rotation(i);
        let about = moment - state.world_from_link[i].translation.vector.cross(&force);
        let (f, m) = (r.tr_mul(&force), r.tr_mul(&about));
        let tau = &mut tau[joint.v_offset..];
        match &joint.kind {
            JointKind::Free => (0..3).for_each(|k| {
                tau[k] -= f[k];
                tau[3 + k] -= m[k];
            }),
            JointKind::Spherical => (0..3).for_each(|k| tau[k] -= m[k]),
            JointKind::Revolute(axis) => tau[0] -= m.dot(axis),
            JointKind::Prismatic(axis) => tau[0] -= f.dot(axis),
            JointKind::Fixed => {}
        }
        next = model.links[i].parent;
    }
}

/// Forces of a motion with velocities and accelerations.
pub fn forces(
    subject: &SubjectExport,
    motion: &Motion,
    series: &CoordinateSeries,
    plates: &[PlateAtFrames],
) -> TrialForces {
    let model = &subject.subject.model;
    let phi = subject.phi();
    let (n, n_frames) = (subject.coordinates.len(), motion.n_frames());
    let mut out = TrialForces {
        loads: assign(subject, motion, plates),
        generalised: vec![f64::NAN; n * n_frames],
        residual: vec![Vector6::repeat(f64::NAN); n_frames],
        centre_of_mass_m: vec![Vector3::repeat(f64::NAN); n_frames],
    };
    let mut state = State::new(model);
    let mut tau = vec![0.0; model.nv];
    for f in (0..n_frames).filter(|&f| motion.is_valid(f)) {
        state.forward_acceleration(model, motion.q(f), motion.v(f), motion.a(f));
        out.centre_of_mass_m[f] = state.centre_of_mass(&phi).1;
        state.inverse_dynamics(model, &phi, &mut tau);
        for load in &out.loads {
            take_off(model, &state, load.link, &load.wrench[f], &mut tau);
        }
        let root = state.rotation(0);
        let force = root * Vector3::new(tau[0], tau[1], tau[2]);
        let moment = root * Vector3::new(tau[3], tau[4], tau[5]);
        out.residual[f] = Vector6::new(force.x, force.y, force.z, moment.x, moment.y, moment.z);
        let own = f * n..(f + 1) * n;
        let values = &series.values[own.clone()];
        subject.coordinates.generalised_forces(model, &state, values, &tau, &mut out.generalised[own]);
    }
    out
}
