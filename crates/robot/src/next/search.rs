//! The search for one flight: which splines and which turn at release.
//!
//! An evolution strategy (one parent, many children, the step adapted by success; Schwefel,
//! *Evolution and Optimum Seeking*, 1995) from the best of random starts. Random numbers are seeded
//! and children are compared in order, so that the result does not depend on the number of threads.

use crate::RobotModel;
use crate::next::extent::Extents;
use crate::next::fly::{Release, fly};
use crate::next::limits::JointLimits;
use crate::next::wave::Wave;
use aloft_body::{BaseParameters, JointKind, Model, Motion, Phi, State};
use aloft_identify::{Design, IdentifyError};
use aloft_regressor::{Acting, CoordinateNoise, Factor, Noise, RegressorError, Stretch, WeakOptions, weak_factor};
use nalgebra::{UnitQuaternion, Vector3};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};
use rayon::prelude::*;

/// Size of a plan and of its search.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PlanOptions {
    /// Number of flights.
    pub flights: usize,
    /// Duration of each, s.
    pub flight_s: f64,
    /// Largest turn of the base at release, rad/s.
    pub turn_rad_s: f64,
    /// Control values of each joint.
    pub control: usize,
    /// Random starts.
    pub starts: usize,
    /// Rounds of the search.
    pub rounds: usize,
    /// Children in each round.
    pub children: usize,
}

impl Default for PlanOptions {
    /// Three flights of half a second with four control values a joint.
    fn default() -> Self {
        Self { flights: 3, flight_s: 0.5, turn_rad_s: 3.0, control: 4, starts: 32, rounds: 80, children: 16 }
    }
}

/// Time at both ends of a flight that finding it in a recording may cost, s.
const EDGE_S: f64 = 0.02;
/// Rate of the flights that are tried, Hz.
const TRIED_HZ: f64 = 100.0;
/// Largest number of times that a motion is made smaller to keep its limits.
const SMALLER: usize = 5;

/// The robot that flies and the rows that its flights would give.
pub(crate) struct Robot<'a> {
    pub robot: &'a RobotModel,
    pub model: &'a Model,
    pub base: &'a BaseParameters,
    /// Parameters with which rows are formed, and those with which the robot flies.
    pub prior: &'a [Phi],
    pub phi: &'a [Phi],
    pub weak: WeakOptions,
    /// Noise of the coordinates in one frame at `rate_hz`; none for rows with fixed weights.
    pub noise: Option<FrameErrors<'a>>,
    pub rate_hz: f64,
}

/// Errors of the coordinates in a frame, as the rows of the recordings are whitened with.
#[derive(Debug, Clone, Copy)]
pub struct FrameErrors<'a> {
    /// Deviation of each velocity's direction, nv.
    pub sd: &'a [f64],
    /// Slow part, as a multiple of the deviations, and its time constant (s): see
    /// [`aloft_regressor::Noise`].
    pub slow: f64,
    /// Time constant, s.
    pub slow_time_s: f64,
}

/// A flight within the limits.
#[derive(Debug, Clone)]
pub(crate) struct Tried {
    pub wave: Wave,
    pub turn: Vector3<f64>,
    /// Largest torque as a share of its limit, with the joint.
    pub effort: Option<(usize, f64)>,
}

impl Robot<'_> {
    /// The flight at a rate; only where positions are asked for with little error are substeps
    /// needed.
    pub fn motion(&self, wave: &Wave, turn: &Vector3<f64>, rate_hz: f64, substeps: usize) -> Motion {
        let frames = (wave.duration_s * rate_hz).round() as usize + 1;
        let up = -self.model.gravity_mps2 * (0.5 * wave.duration_s);
        let release = Release {
            centre_m: Vector3::zeros(),
            speed_m_s: up,
            rotation: UnitQuaternion::identity(),
            turn_rad_s: *turn,
        };
        fly(self.model, self.phi, &release, &|t| wave.at(t), frames, rate_hz, substeps)
    }

    /// Rows of a flight, with the noise of the recordings' frames.
    pub fn rows(&self, motion: &Motion) -> Result<Factor, RegressorError> {
        let edge = (EDGE_S * motion.rate_hz).round() as usize;
        let stretch = Stretch::flight("planned", 0, edge, motion.n_frames().saturating_sub(edge));
        // fewer frames, each as good as all those that it stands for; errors that stay are not
        // averaged
        let fewer = (motion.rate_hz / self.rate_hz).sqrt();
        let sd: Option<Vec<f64>> = self.noise.map(|n| n.sd.iter().map(|s| s * fewer).collect());
        let noise = self.noise.zip(sd.as_ref()).map(|(n, sd)| Noise {
            coordinates: CoordinateNoise::PerCoordinate(sd),
            slow: n.slow / fewer,
            slow_time_s: n.slow_time_s,
        });
        weak_factor(self.model, self.base, self.prior, motion, &stretch, Acting::nothing(), &self.weak, noise.as_ref())
    }

    /// Largest share of an effort's limit over a flight, with its joint: inverse dynamics,
    /// reflected inertia and friction.
    pub fn effort(&self, motion: &Motion, limits: &[JointLimits]) -> Option<(usize, f64)> {
        let (nv, n) = (motion.nv, motion.n_frames());
        let mut state = State::new(self.model);
        let mut tau = vec![0.0; nv];
        let one = |k: &JointKind| matches!(k, JointKind::Revolute(_) | JointKind::Prismatic(_));
        let places: Vec<usize> =
            self.model.links.iter().filter(|l| one(&l.joint.kind)).map(|l| l.joint.v_offset).collect();
        let mut worst: Option<(usize, f64)> = None;
        for i in 1..n.saturating_sub(1) {
            let acceleration: Vec<f64> =
                motion.v(i + 1).iter().zip(motion.v(i - 1)).map(|(b, a)| (b - a) * 0.5 * motion.rate_hz).collect();
            state.forward_acceleration(self.model, motion.q(i), motion.v(i), &acceleration);
            state.inverse_dynamics(self.model, self.phi, &mut tau);
            for (j, (joint, limit)) in self.robot.joints.iter().zip(limits).enumerate() {
                let Some(most) = limit.effort.filter(|e| *e > 0.0) else { continue };
                let at = places[j];
                let v = motion.v(i)[at];
                let own = tau[at]
                    + joint.armature * acceleration[at]
                    + joint.damping * v
                    + joint.friction * (v / 0.05).tanh();
                let share = own.abs() / most;
                if worst.is_none_or(|w| share > w.1) {
                    worst = Some((j, share));
                }
            }
        }
        worst
    }

    /// Smallest room between links over a flight, m.
    pub fn room_m(&self, motion: &Motion, extents: &Extents) -> f64 {
        let mut state = State::new(self.model);
        (0..motion.n_frames())
            .map(|i| {
                state.forward_position(self.model, motion.q(i));
                extents.room_m(&state)
            })
            .fold(f64::INFINITY, f64::min)
    }
}

/// Limits and posture of the flights to be found.
pub(crate) struct Space<'a> {
    pub hold: &'a [f64],
    pub limits: &'a [JointLimits],
    pub extents: &'a Extents,
    pub options: PlanOptions,
}

impl Space<'_> {
    fn size(&self) -> usize {
        self.hold.len() * self.options.control + 3
    }

    /// The flight that a vector of numbers from −1 to 1 stands for, before torques and distances
    /// are checked.
    fn decode(&self, x: &[f64]) -> (Wave, Vector3<f64>) {
        let k = self.options.control;
        let control = self
            .limits
            .iter()
            .zip(self.hold)
            .enumerate()
            .map(|(j, (limit, hold))| {
                let room = |x: f64| if x > 0.0 { x * (limit.high - hold) } else { x * (hold - limit.low) };
                x[j * k..(j + 1) * k].iter().map(|x| room(*x)).collect::<Vec<f64>>()
            })
            .collect();
        let mut wave = Wave { hold: self.hold.to_vec(), control, duration_s: self.options.flight_s };
        for (j, limit) in self.limits.iter().enumerate() {
            let bound = wave.rate_bound(j);
            if bound > limit.rate {
                for c in &mut wave.control[j] {
                    *c *= limit.rate / bound;
                }
            }
        }
        let turn = Vector3::from_row_slice(&x[self.size() - 3..]);
        (wave, turn / turn.norm().max(1.0) * self.options.turn_rad_s)
    }

    /// The flight made small enough for torques and distances, with its motion; none if that does
    /// not help.
    fn within(&self, robot: &Robot<'_>, x: &[f64]) -> Option<(Tried, Motion)> {
        let (mut wave, turn) = self.decode(x);
        for _ in 0..SMALLER {
            let motion = robot.motion(&wave, &turn, TRIED_HZ, 1);
            let effort = robot.effort(&motion, self.limits);
            let room_m = robot.room_m(&motion, self.extents);
            let share = effort.map_or(0.0, |e| e.1);
            if share <= 1.0 && room_m >= 0.0 {
                return Some((Tried { wave, turn, effort }, motion));
            }
            let by = if share > 1.0 { (0.97 / share).clamp(0.4, 0.95) } else { 1.0 };
            wave = wave.scaled(if room_m < 0.0 { by.min(0.8) } else { by });
        }
        None
    }

    /// The flight that leaves least of the prior's variance; none if no flight keeps the limits.
    ///
    /// # Errors
    /// As [`Design::left_with`].
    pub fn search(&self, robot: &Robot<'_>, known: &Design, seed: u64) -> Result<Option<Tried>, IdentifyError> {
        let n = self.size();
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        // every child is judged alone; the comparison is in order
        let judge = |all: &[Vec<f64>]| -> Result<Vec<Option<(f64, Tried)>>, IdentifyError> {
            all.par_iter()
                .map(|x| {
                    let Some((tried, motion)) = self.within(robot, x) else { return Ok(None) };
                    match robot.rows(&motion) {
                        Ok(rows) => Ok(Some((known.left_with(&rows, 1.0)?, tried))),
                        // none: a flight that is too short for a window is no candidate
                        Err(_) => Ok(None),
                    }
                })
                .collect()
        };
        let starts: Vec<Vec<f64>> =
            (0..self.options.starts).map(|_| (0..n).map(|_| rng.random_range(-1.0..1.0)).collect()).collect();
        let mut best: Option<(f64, Tried, Vec<f64>)> = None;
        let take = |all: Vec<Vec<f64>>, best: &mut Option<(f64, Tried, Vec<f64>)>| -> Result<bool, IdentifyError> {
            let mut better = false;
            for (found, x) in judge(&all)?.into_iter().zip(all) {
                if let Some((left, tried)) = found.filter(|f| best.as_ref().is_none_or(|b| f.0 < b.0)) {
                    *best = Some((left, tried, x));
                    better = true;
                }
            }
            Ok(better)
        };
        take(starts, &mut best)?;
        let mut step = 0.4;
        for _ in 0..self.options.rounds {
            let Some((_, _, parent)) = &best else { break };
            let children: Vec<Vec<f64>> = (0..self.options.children)
                .map(|_| {
                    parent
                        .iter()
                        .map(|x| {
                            let moved: f64 = StandardNormal.sample(&mut rng);
                            if rng.random_bool(0.4) { (x + step * moved).clamp(-1.0, 1.0) } else { *x }
                        })
                        .collect()
                })
                .collect();
            step *= if take(children, &mut best)? { 1.15 } else { 0.8 };
        }
        Ok(best.map(|b| b.1))
    }
}
