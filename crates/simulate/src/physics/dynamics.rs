//! Forward dynamics of a tree in which some joints are prescribed and the others follow the
//! equations of motion.
//!
//! With the coordinates split into followed (F) and prescribed (P), `M_FF a_F = τ_F + Q_F − h_F(q,
//! v, a_P)`, where `h` is recursive Newton-Euler with `a_F = 0` and `Q` the hidden forces.

use crate::error::SimulateError;
use crate::motion::chart::read;
use crate::physics::forces::{ForceField, Wrench};
use crate::physics::law::{Instant, Past};
use crate::physics::plant::Plant;
use aloft_body::{JointKind, Model, Phi, State};
use nalgebra::{DMatrix, DVector, Matrix6, Quaternion, Vector3, Vector6};

/// Prescribed motion and joint forces.
pub trait Drive {
    /// Writes `q`, `v`, `a` of the prescribed links at time `t`; the others are unchanged.
    fn prescribe(&self, t: f64, q: &mut [f64], v: &mut [f64], a: &mut [f64]);
    /// Adds generalised forces (length nv) of motors, springs and friction on the followed joints.
    fn torque(&self, _t: f64, _q: &[f64], _v: &[f64], _tau: &mut [f64]) {}
}

/// Workspace and right-hand side for one plant and one set of followed links.
///
/// The state vector is `[q (nq) | v (nv) | states of the forces]`; entries of prescribed links are
/// overwritten by the drive whenever they are needed.
pub struct ForwardDynamics<'a> {
    plant: &'a Plant,
    /// Time of the last take-off (release), s; `None` on the ground and in the hand.
    pub take_off_s: Option<f64>,
    /// Past steps, for laws with a delay.
    pub past: Past,
    followed: Vec<usize>,
    /// Velocity indices of the followed links.
    dofs: Vec<usize>,
    state: State,
    q: Vec<f64>,
    v: Vec<f64>,
    a: Vec<f64>,
    tau: Vec<f64>,
    applied: Vec<f64>,
    wrenches: Vec<Wrench>,
    subtree: Vec<Wrench>,
    rates: Vec<f64>,
    mass: DMatrix<f64>,
}

impl<'a> ForwardDynamics<'a> {
    /// `followed[link]` is true for links that follow the equations of motion.
    pub fn new(plant: &'a Plant, followed: &[bool]) -> Self {
        let model = &plant.model;
        let followed: Vec<usize> = (0..model.n_links()).filter(|i| followed[*i]).collect();
        let dofs = followed
            .iter()
            .flat_map(|i| {
                let joint = &model.links[*i].joint;
                joint.v_offset..joint.v_offset + joint.kind.nv()
            })
            .collect();
        Self {
            plant,
            take_off_s: None,
            past: Past::default(),
            followed,
            dofs,
            state: State::new(model),
            q: model.neutral(),
            v: vec![0.0; model.nv],
            a: vec![0.0; model.nv],
            tau: vec![0.0; model.nv],
            applied: vec![0.0; model.nv],
            wrenches: vec![Wrench::default(); model.n_links()],
            subtree: vec![Wrench::default(); model.n_links()],
            rates: vec![0.0; plant.forces.n_states()],
            mass: DMatrix::zeros(model.nv, model.nv),
        }
    }

    /// Length of the state vector.
    pub fn len(&self) -> usize {
        self.plant.model.nq + self.plant.model.nv + self.plant.forces.n_states()
    }

    /// True for a model without coordinates.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// True if the drive prescribes the whole state: there is nothing to integrate.
    pub fn is_prescribed(&self) -> bool {
        self.dofs.is_empty() && self.plant.forces.n_states() == 0
    }

    /// Overwrites the prescribed part of a state vector and normalises quaternions.
    pub fn settle(&self, drive: &dyn Drive, t: f64, y: &mut [f64]) {
        let model = &self.plant.model;
        let (q, rest) = y.split_at_mut(model.nq);
        let mut a = vec![0.0; model.nv];
        drive.prescribe(t, q, &mut rest[..model.nv], &mut a);
        model.normalize(q);
    }

    /// Accelerations of all coordinates (length nv) and wrenches of the hidden forces at a state.
    pub fn accelerations(
        &mut self,
        drive: &dyn Drive,
        t: f64,
        y: &[f64],
    ) -> Result<(&[f64], &[Wrench]), SimulateError> {
        self.evaluate(drive, t, y)?;
        Ok((&self.a, &self.wrenches))
    }

    /// Stores the step of the last evaluation's coordinates for laws with a delay; `y` is the state
    /// at `t`.
    pub fn remember(&mut self, drive: &dyn Drive, t: f64, y: &[f64]) -> Result<(), SimulateError> {
        if self.plant.forces.is_delayed() {
            self.place(drive, t, y);
            let now = instant(self.plant, self.take_off_s, t, &self.state, &self.q, &self.v);
            self.plant.forces.remember(&now, &mut self.past)?;
        }
        Ok(())
    }

    /// `dy/dt`.
    pub fn rate(&mut self, drive: &dyn Drive, t: f64, y: &[f64], dy: &mut [f64]) -> Result<(), SimulateError> {
        self.evaluate(drive, t, y)?;
        let model = &self.plant.model;
        dy.fill(0.0);
        let (dq, rest) = dy.split_at_mut(model.nq);
        for link in &self.followed {
            let joint = &model.links[*link].joint;
            let (iq, iv) = (joint.q_offset, joint.v_offset);
            match joint.kind {
                JointKind::Free => {
                    let rotation = read(&self.q[iq + 3..iq + 7]);
                    let velocity = rotation * Vector3::new(self.v[iv], self.v[iv + 1], self.v[iv + 2]);
                    dq[iq..iq + 3].copy_from_slice(velocity.as_slice());
                    quaternion_rate(&self.q[iq + 3..iq + 7], &self.v[iv + 3..iv + 6], &mut dq[iq + 3..iq + 7]);
                }
                JointKind::Spherical => {
                    quaternion_rate(&self.q[iq..iq + 4], &self.v[iv..iv + 3], &mut dq[iq..iq + 4]);
                }
                JointKind::Revolute(_) | JointKind::Prismatic(_) => dq[iq] = self.v[iv],
                JointKind::Fixed => {}
            }
        }
        for i in &self.dofs {
            rest[*i] = self.a[*i];
        }
        rest[model.nv..].copy_from_slice(&self.rates);
        Ok(())
    }

    /// The wrench that the environment (ground, hands) must add to the hidden forces for the motion
    /// of the last [`ForwardDynamics::accelerations`]: on the body, about the world origin. Zero
    /// within rounding if the root is followed.
    pub fn contact(&mut self) -> Wrench {
        let plant = self.plant;
        self.state.forward_acceleration(&plant.model, &self.q, &self.v, &self.a);
        self.state.inverse_dynamics(&plant.model, &plant.phi, &mut self.tau);
        let pose = &self.state.world_from_link[0];
        let force = pose.rotation * Vector3::new(self.tau[0], self.tau[1], self.tau[2]);
        let moment =
            pose.rotation * Vector3::new(self.tau[3], self.tau[4], self.tau[5]) + pose.translation.vector.cross(&force);
        let hidden = ForceField::total(&self.wrenches);
        Wrench { force_n: force - hidden.force_n, moment_nm: moment - hidden.moment_nm }
    }

    /// Coordinates, velocities and accelerations of the last [`ForwardDynamics::accelerations`].
    pub fn motion(&self) -> (&[f64], &[f64], &[f64]) {
        (&self.q, &self.v, &self.a)
    }

    /// Poses and velocities of the last evaluation.
    pub fn state(&self) -> &State {
        &self.state
    }

    /// Poses, velocities and accelerations at a state, those of the followed links without the
    /// acceleration that the forces give them.
    fn place(&mut self, drive: &dyn Drive, t: f64, y: &[f64]) {
        let model = &self.plant.model;
        self.q.copy_from_slice(&y[..model.nq]);
        self.v.copy_from_slice(&y[model.nq..model.nq + model.nv]);
        self.a.fill(0.0);
        drive.prescribe(t, &mut self.q, &mut self.v, &mut self.a);
        for i in &self.dofs {
            self.a[*i] = 0.0;
        }
        model.normalize(&mut self.q);
        self.state.forward_acceleration(model, &self.q, &self.v, &self.a);
    }

    fn evaluate(&mut self, drive: &dyn Drive, t: f64, y: &[f64]) -> Result<(), SimulateError> {
        let plant = self.plant;
        let model = &plant.model;
        self.place(drive, t, y);
        self.state.inverse_dynamics(model, &plant.phi, &mut self.tau);
        let states = &y[model.nq + model.nv..];
        let now = instant(plant, self.take_off_s, t, &self.state, &self.q, &self.v);
        plant.forces.evaluate(&now, &self.past, states, &mut self.wrenches, &mut self.rates)?;
        self.applied.fill(0.0);
        drive.torque(t, &self.q, &self.v, &mut self.applied);
        if !plant.forces.is_empty() {
            generalised(model, &self.state, &self.wrenches, &mut self.subtree, &mut self.applied);
        }
        self.solve().ok_or_else(|| SimulateError::Diverged { model: model.name.clone(), time_s: t })
    }

    /// Accelerations of the followed coordinates; `None` if they are not finite.
    fn solve(&mut self) -> Option<()> {
        let plant = self.plant;
        if self.followed == [0] && plant.model.links[0].joint.kind == JointKind::Free {
            let inertia = root_inertia(&plant.model, &self.state, &plant.phi);
            let load = Vector6::from_fn(|i, _| self.applied[i] - self.tau[i]);
            let a = inertia.cholesky()?.solve(&load);
            self.a[..6].copy_from_slice(a.as_slice());
        } else if !self.dofs.is_empty() {
            self.state.mass_matrix(&plant.model, &plant.phi, &mut self.mass);
            let n = self.dofs.len();
            let mass = DMatrix::from_fn(n, n, |i, j| self.mass[(self.dofs[i], self.dofs[j])]);
            let load = DVector::from_fn(n, |i, _| self.applied[self.dofs[i]] - self.tau[self.dofs[i]]);
            let a = mass.cholesky()?.solve(&load);
            for (i, dof) in self.dofs.iter().enumerate() {
                self.a[*dof] = a[i];
            }
        }
        self.a.iter().all(|x| x.is_finite()).then_some(())
    }
}

fn instant<'b>(
    plant: &'b Plant,
    take_off_s: Option<f64>,
    t: f64,
    state: &'b State,
    q: &'b [f64],
    v: &'b [f64],
) -> Instant<'b> {
    let since_start = take_off_s.map_or(0.0, |start| t - start);
    Instant { t, since_start, model: &plant.model, phi: plant.forces.phi(), state, q, v }
}

fn quaternion_rate(q: &[f64], omega: &[f64], out: &mut [f64]) {
    let q = Quaternion::new(q[3], q[0], q[1], q[2]);
    let rate = q * Quaternion::new(0.0, omega[0], omega[1], omega[2]) * 0.5;
    out.copy_from_slice(rate.coords.as_slice());
}

/// Inertia of the whole body, all joints locked, about the root origin in root axes (linear,
/// angular). Needs poses.
pub fn root_inertia(model: &Model, state: &State, phi: &[Phi]) -> Matrix6<f64> {
    let world_from_root = state.world_from_link[0];
    let mut sum = Phi::zeros();
    for link in 0..model.n_links() {
        let root_from_link = world_from_root.inv_mul(&state.world_from_link[link]);
        let (r, p) = (root_from_link.rotation.to_rotation_matrix(), root_from_link.translation.vector);
        let f = &phi[link];
        let (m, mc) = (f[0], r * Vector3::new(f[1], f[2], f[3]));
        let inertia = nalgebra::Matrix3::new(f[4], f[9], f[8], f[9], f[5], f[7], f[8], f[7], f[6]);
        let turned = r.matrix() * inertia * r.matrix().transpose();
        // about the root origin: shift through the first moment, I' = I − [p][mc] − [mc][p] − m
        // [p][p]
        let (px, cx) = (p.cross_matrix(), mc.cross_matrix());
        let moved = turned - px * cx - cx * px - px * px * m;
        let first = mc + p * m;
        sum += Phi::from_column_slice(&[
            m,
            first.x,
            first.y,
            first.z,
            moved[(0, 0)],
            moved[(1, 1)],
            moved[(2, 2)],
            moved[(1, 2)],
            moved[(0, 2)],
            moved[(0, 1)],
        ]);
    }
    let mut out = Matrix6::zeros();
    let cross = Vector3::new(sum[1], sum[2], sum[3]).cross_matrix();
    for i in 0..3 {
        out[(i, i)] = sum[0];
    }
    out.fixed_view_mut::<3, 3>(0, 3).copy_from(&-cross);
    out.fixed_view_mut::<3, 3>(3, 0).copy_from(&cross);
    out.fixed_view_mut::<3, 3>(3, 3)
        .copy_from(&nalgebra::Matrix3::new(sum[4], sum[9], sum[8], sum[9], sum[5], sum[7], sum[8], sum[7], sum[6]));
    out
}

/// Adds the generalised forces of wrenches on links (world axes about the world origin) to `out`
/// (length nv). Needs poses.
pub fn generalised(model: &Model, state: &State, wrenches: &[Wrench], subtree: &mut [Wrench], out: &mut [f64]) {
    subtree.copy_from_slice(wrenches);
    for link in (0..model.n_links()).rev() {
        let pose = &state.world_from_link[link];
        let wrench = subtree[link];
        let moment = pose.rotation.inverse() * (wrench.moment_nm - pose.translation.vector.cross(&wrench.force_n));
        let force = pose.rotation.inverse() * wrench.force_n;
        let iv = model.links[link].joint.v_offset;
        match model.links[link].joint.kind {
            JointKind::Free => {
                for i in 0..3 {
                    out[iv + i] += force[i];
                    out[iv + 3 + i] += moment[i];
                }
            }
            JointKind::Spherical => (0..3).for_each(|i| out[iv + i] += moment[i]),
            JointKind::Revolute(axis) => out[iv] += axis.dot(&moment),
            JointKind::Prismatic(axis) => out[iv] += axis.dot(&force),
            JointKind::Fixed => {}
        }
        if let Some(parent) = model.links[link].parent {
            subtree[parent].add(&wrench);
        }
    }
}
