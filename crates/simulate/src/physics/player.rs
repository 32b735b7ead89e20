//! Simulates phases in sequence (held, in the air, held again) and stores the true motion at every
//! tick.
//!
//! A tick is the shortest sampling interval of any instrument of the laboratory; the integrator
//! takes [`SUBSTEPS`] steps per tick.

use crate::error::SimulateError;
use crate::physics::dynamics::{Drive, ForwardDynamics};
use crate::physics::forces::{ForceField, Wrench};
use crate::physics::law::Past;
use crate::physics::plant::Plant;
use crate::physics::rk4::Rk4;
use aloft_body::State;

/// Integration steps per tick.
pub const SUBSTEPS: usize = 2;

/// The true motion of one trial, tick by tick.
#[derive(Debug, Clone, Default)]
pub struct TrueMotion {
    /// Length of a tick on a perfect clock, s.
    pub tick_s: f64,
    /// Number of coordinates per tick.
    pub nq: usize,
    /// Number of velocities per tick.
    pub nv: usize,
    /// `q[tick * nq + i]`.
    pub q: Vec<f64>,
    /// `v[tick * nv + i]`.
    pub v: Vec<f64>,
    /// `a[tick * nv + i]`.
    pub a: Vec<f64>,
    /// Wrench of ground or hands on the body.
    pub contact: Vec<Wrench>,
    /// Wrench of the hidden forces on the body.
    pub effects: Vec<Wrench>,
    /// First and last tick of each flight.
    pub flights: Vec<[usize; 2]>,
}

impl TrueMotion {
    /// Number of ticks.
    pub fn n_ticks(&self) -> usize {
        self.contact.len()
    }
    /// Coordinates at a tick.
    pub fn q(&self, tick: usize) -> &[f64] {
        &self.q[tick * self.nq..(tick + 1) * self.nq]
    }
    /// Velocities at a tick.
    pub fn v(&self, tick: usize) -> &[f64] {
        &self.v[tick * self.nv..(tick + 1) * self.nv]
    }
    /// Accelerations at a tick.
    pub fn a(&self, tick: usize) -> &[f64] {
        &self.a[tick * self.nv..(tick + 1) * self.nv]
    }
}

/// Simulates one trial.
pub struct Player<'a> {
    plant: &'a Plant,
    /// State vector: `[q | v | states of forces]`.
    pub y: Vec<f64>,
    tick: usize,
    motion: TrueMotion,
    past: Past,
}

impl<'a> Player<'a> {
    /// Starts at rest in the posture `q` (length nq).
    pub fn new(plant: &'a Plant, tick_s: f64, q: &[f64]) -> Self {
        let model = &plant.model;
        let mut y = vec![0.0; model.nq + model.nv + plant.forces.n_states()];
        y[..model.nq].copy_from_slice(q);
        let mut state = State::new(model);
        let v = vec![0.0; model.nv];
        state.forward_velocity(model, q, &v);
        plant.forces.rest_states(model, &state, &mut y[model.nq + model.nv..]);
        let motion = TrueMotion { tick_s, nq: model.nq, nv: model.nv, ..TrueMotion::default() };
        Self { plant, y, tick: 0, motion, past: Past::default() }
    }

    /// Number of ticks simulated so far: the index of the tick of the present state.
    pub fn tick(&self) -> usize {
        self.tick
    }

    /// Simulated time so far, s.
    pub fn time(&self) -> f64 {
        self.tick as f64 * self.motion.tick_s
    }

    /// Length of a tick, s.
    pub fn tick_s(&self) -> f64 {
        self.motion.tick_s
    }

    /// The plant.
    pub fn plant(&self) -> &'a Plant {
        self.plant
    }

    /// Simulates `ticks` ticks. `followed[link]` is true for links that follow the equations of
    /// motion; a phase whose root is followed is a flight.
    pub fn advance(&mut self, ticks: usize, followed: &[bool], drive: &dyn Drive) -> Result<(), SimulateError> {
        let mut dynamics = ForwardDynamics::new(self.plant, followed);
        let mut rk4 = Rk4::new(self.y.len());
        let flight = followed.first().copied().unwrap_or(false);
        let h = self.motion.tick_s / SUBSTEPS as f64;
        dynamics.settle(drive, self.time(), &mut self.y);
        dynamics.take_off_s = flight.then(|| self.time());
        dynamics.past = std::mem::take(&mut self.past);
        dynamics.remember(drive, self.time(), &self.y)?;
        if flight {
            self.motion.flights.push([self.tick, self.tick + ticks]);
        }
        if flight || self.tick == 0 {
            self.record(&mut dynamics, drive)?;
        }
        let integrated = !dynamics.is_prescribed();
        for _ in 0..ticks {
            for step in 0..SUBSTEPS {
                let t = self.time() + step as f64 * h;
                if integrated {
                    rk4.step(t, h, &mut self.y, |t, y, dy| dynamics.rate(drive, t, y, dy))?;
                }
                dynamics.settle(drive, t + h, &mut self.y);
                dynamics.remember(drive, t + h, &self.y)?;
            }
            self.tick += 1;
            self.record(&mut dynamics, drive)?;
        }
        self.past = std::mem::take(&mut dynamics.past);
        Ok(())
    }

    fn record(&mut self, dynamics: &mut ForwardDynamics<'_>, drive: &dyn Drive) -> Result<(), SimulateError> {
        let t = self.time();
        let (_, wrenches) = dynamics.accelerations(drive, t, &self.y)?;
        let effects = ForceField::total(wrenches);
        let contact = dynamics.contact();
        let (q, v, a) = dynamics.motion();
        let m = &mut self.motion;
        // the first tick of a flight replaces the last one of the phase before
        m.contact.truncate(self.tick);
        m.effects.truncate(self.tick);
        m.q.truncate(self.tick * m.nq);
        m.v.truncate(self.tick * m.nv);
        m.a.truncate(self.tick * m.nv);
        m.contact.push(contact);
        m.effects.push(effects);
        m.q.extend_from_slice(q);
        m.v.extend_from_slice(v);
        m.a.extend_from_slice(a);
        Ok(())
    }

    /// Accelerations that `drive` would give at this instant with other followed links, without
    /// advancing.
    pub fn accelerations(&self, followed: &[bool], drive: &dyn Drive) -> Result<Vec<f64>, SimulateError> {
        let mut dynamics = ForwardDynamics::new(self.plant, followed);
        dynamics.past = self.past.clone();
        Ok(dynamics.accelerations(drive, self.time(), &self.y)?.0.to_vec())
    }

    /// The motion so far.
    pub fn motion(&self) -> &TrueMotion {
        &self.motion
    }

    /// Ends the trial and returns its motion.
    pub fn finish(self) -> TrueMotion {
        self.motion
    }
}
