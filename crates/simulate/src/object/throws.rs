//! A session of throws: picked up, thrown, in the air, caught, carried, thrown again.
//!
//! While the object is held, the hand prescribes the root and guides the joints by a soft servo
//! that is released just before the throw; in the air only friction acts between the links. Hand
//! forces rise and fall within [`RAMP_S`].

use super::ThrownObject;
use crate::error::SimulateError;
use crate::motion::chart::read;
use crate::motion::curve::windowed_sine;
use crate::motion::{Chart, Jet, Piecewise};
use crate::physics::{Drive, Plant, Player, TrueMotion};
use crate::random::Stream;
use crate::scenario::ThrowProtocol;
use aloft_body::{JointKind, Model, State};
use nalgebra::{DMatrix, UnitQuaternion, Vector3};

/// Rise and fall time of a hand's force, s.
pub const RAMP_S: f64 = 0.02;
/// Speed at which dry friction is nearly fully developed, rad/s (m/s).
const FRICTION_SPEED: f64 = 0.02;

/// Joint friction and guidance by a hand.
struct Joints<'a> {
    model: &'a Model,
    damping: f64,
    friction: f64,
    /// Effective inertia of each velocity coordinate, for the servo's gains.
    inertia: &'a [f64],
    /// Target of each velocity coordinate of a hinge or slide; empty without guidance.
    targets: Vec<Option<Piecewise>>,
    /// Start and end of the guidance, s.
    guided: [f64; 2],
}

impl Joints<'_> {
    fn torque(&self, t: f64, q: &[f64], v: &[f64], tau: &mut [f64]) {
        // natural frequency of the guidance, rad/s, critically damped
        let rate = 35.0;
        let rise = |x: f64| {
            let s = (x / 0.06).clamp(0.0, 1.0);
            s * s * (3.0 - 2.0 * s)
        };
        let grip = rise(t - self.guided[0]) * rise(self.guided[1] - t);
        for link in self.model.links.iter().skip(1) {
            let joint = &link.joint;
            for i in joint.v_offset..joint.v_offset + joint.kind.nv() {
                tau[i] -= self.damping * v[i] + self.friction * (v[i] / FRICTION_SPEED).tanh();
            }
            if self.targets.is_empty() || grip <= 0.0 {
                continue;
            }
            let stiffness = |i: usize| grip * self.inertia[i] * rate * rate;
            match joint.kind {
                JointKind::Revolute(_) | JointKind::Prismatic(_) => {
                    let i = joint.v_offset;
                    let want = self.targets[i].as_ref().map(|c| c.at(t)).unwrap_or_default();
                    tau[i] += stiffness(i) * (want.x - q[joint.q_offset] + (want.v - v[i]) * 2.0 / rate);
                }
                JointKind::Spherical => {
                    let error = -read(&q[joint.q_offset..joint.q_offset + 4]).scaled_axis();
                    for k in 0..3 {
                        let i = joint.v_offset + k;
                        tau[i] += stiffness(i) * (error[k] - v[i] * 2.0 / rate);
                    }
                }
                JointKind::Free | JointKind::Fixed => {}
            }
        }
    }
}

/// Drive of an object held in the hand.
struct Held<'a> {
    chart: Chart,
    root: [Piecewise; 6],
    /// Tremor of the hand: start, duration, amplitude and frequency of each coordinate.
    tremor: Option<(f64, f64, [f64; 6], [f64; 6])>,
    joints: Joints<'a>,
}

impl Drive for Held<'_> {
    fn prescribe(&self, t: f64, q: &mut [f64], v: &mut [f64], a: &mut [f64]) {
        let mut jets: [Jet; 6] = std::array::from_fn(|i| self.root[i].at(t));
        if let Some((start, duration, amplitude, frequency)) = &self.tremor {
            for (i, jet) in jets.iter_mut().enumerate() {
                let w = windowed_sine(t - start, *duration, frequency[i], 0.3 * i as f64);
                jet.x += amplitude[i] * w.x;
                jet.v += amplitude[i] * w.v;
                jet.a += amplitude[i] * w.a;
            }
        }
        self.chart.lift_link(self.joints.model, 0, &jets, q, v, a);
    }
    fn torque(&self, t: f64, q: &[f64], v: &[f64], tau: &mut [f64]) {
        self.joints.torque(t, q, v, tau);
    }
}

/// Drive of an object in the air.
struct Loose<'a>(Joints<'a>);
impl Drive for Loose<'_> {
    fn prescribe(&self, _t: f64, _q: &mut [f64], _v: &mut [f64], _a: &mut [f64]) {}
    fn torque(&self, t: f64, q: &[f64], v: &[f64], tau: &mut [f64]) {
        self.0.torque(t, q, v, tau);
    }
}

/// Drive of an object whose coordinates are all swung by hand: the calibration of joints, and lying
/// still.
struct Swung<'a> {
    model: &'a Model,
    chart: Chart,
    /// Mean, amplitude, frequency (Hz) and phase of two sines for each velocity coordinate.
    sines: Vec<(f64, [[f64; 3]; 2])>,
}
impl Drive for Swung<'_> {
    fn prescribe(&self, t: f64, q: &mut [f64], v: &mut [f64], a: &mut [f64]) {
        let jets: Vec<Jet> = self
            .sines
            .iter()
            .map(|(mean, waves)| {
                let mut jet = Jet::rest(*mean);
                for [amplitude, frequency, phase] in waves {
                    let rate = 2.0 * std::f64::consts::PI * frequency;
                    let (sin, cos) = (rate * t + phase).sin_cos();
                    jet.x += amplitude * sin;
                    jet.v += amplitude * rate * cos;
                    jet.a -= amplitude * rate * rate * sin;
                }
                jet
            })
            .collect();
        self.chart.lift(self.model, &jets, q, v, a);
    }
}

/// Lying on a table: nothing moves.
pub fn lie_still(object: &ThrownObject, plant: &Plant, tick_s: f64, ticks: usize) -> Result<TrueMotion, SimulateError> {
    let model = &object.body.model;
    let mut sines = vec![(0.0, [[0.0; 3]; 2]); model.nv];
    sines[2].0 = 0.75;
    play_swung(plant, tick_s, ticks, sines)
}

/// Joints swung back and forth by hand while the root is moved slowly.
pub fn calibration(
    object: &ThrownObject,
    plant: &Plant,
    tick_s: f64,
    ticks: usize,
    rng: &mut Stream,
) -> Result<TrueMotion, SimulateError> {
    let model = &object.body.model;
    let mut sines = Vec::with_capacity(model.nv);
    for i in 0..model.nv {
        let (mean, amplitude) = match i {
            0 | 1 => (0.0, 0.12),
            2 => (1.05, 0.10),
            3..6 => (0.0, 0.35),
            _ => (0.2, 0.9),
        };
        let base = if i < 6 { 0.12 } else { 0.45 };
        let wave = |rng: &mut Stream, share: f64, times: f64| {
            [amplitude * share, base * times * rng.between(0.9, 1.2), rng.phase()]
        };
        sines.push((mean, [wave(rng, 1.0, 1.0), wave(rng, 0.35, 2.1)]));
    }
    play_swung(plant, tick_s, ticks, sines)
}

fn play_swung(
    plant: &Plant,
    tick_s: f64,
    ticks: usize,
    sines: Vec<(f64, [[f64; 3]; 2])>,
) -> Result<TrueMotion, SimulateError> {
    let model = &plant.model;
    let drive = Swung { model, chart: Chart::new(), sines };
    let (mut q, mut v, mut a) = (model.neutral(), vec![0.0; model.nv], vec![0.0; model.nv]);
    drive.prescribe(0.0, &mut q, &mut v, &mut a);
    let mut player = Player::new(plant, tick_s, &q);
    player.advance(ticks, &vec![false; model.n_links()], &drive)?;
    Ok(player.finish())
}

/// One recording of several throws.
pub struct Session<'a> {
    object: &'a ThrownObject,
    protocol: &'a ThrowProtocol,
    inertia: Vec<f64>,
}

struct Release {
    position: Vector3<f64>,
    rotation: UnitQuaternion<f64>,
    /// Velocity of the root, world, m/s; acceleration in m/s².
    velocity: Vector3<f64>,
    accel: Vector3<f64>,
    /// Angular velocity, link axes.
    omega: Vector3<f64>,
    alpha: Vector3<f64>,
}

impl<'a> Session<'a> {
    /// Prepares the throws of one object.
    pub fn new(object: &'a ThrownObject, protocol: &'a ThrowProtocol) -> Self {
        let model = &object.body.model;
        let mut state = State::new(model);
        state.forward_position(model, &model.neutral());
        let mut mass = DMatrix::zeros(model.nv, model.nv);
        state.mass_matrix(model, &object.body.phi, &mut mass);
        Self { object, protocol, inertia: (0..model.nv).map(|i| mass[(i, i)]).collect() }
    }

    fn joints(&self, targets: Vec<Option<Piecewise>>, guided: [f64; 2]) -> Joints<'_> {
        Joints {
            model: &self.object.body.model,
            damping: self.object.damping,
            friction: self.object.friction,
            inertia: &self.inertia,
            targets,
            guided,
        }
    }

    /// Simulates one recording.
    pub fn record(&self, plant: &Plant, tick_s: f64, rng: &mut Stream) -> Result<TrueMotion, SimulateError> {
        let model = &self.object.body.model;
        let mut held = vec![true; model.n_links()];
        held[0] = false;
        let air = vec![true; model.n_links()];
        let ticks = |seconds: f64| (seconds / tick_s).round().max(1.0) as usize;

        let mut q = model.neutral();
        q[..3].copy_from_slice(&[0.0, 0.0, 1.05]);
        q[3..7].copy_from_slice(rng.rotation().coords.as_slice());
        let mut player = Player::new(plant, tick_s, &q);
        for throw in 0..self.protocol.throws {
            let release = self.plan(plant, player.y.as_slice(), rng)?;
            let (drive, length) = self.carry(&player, &release, throw == 0, rng);
            player.advance(ticks(length), &held, &drive)?;
            let (drive, length) = self.throw(&player, &release);
            player.advance(ticks(length), &held, &drive)?;
            player.advance(ticks(release.flight_s), &air, &Loose(self.joints(Vec::new(), [0.0, 0.0])))?;
            let (drive, length) = self.catch(&player, &air)?;
            player.advance(ticks(length), &held, &drive)?;
        }
        // bring to rest
        let (drive, length) = self.rest(&player);
        player.advance(ticks(length), &held, &drive)?;
        Ok(player.finish())
    }

    /// The angle of a hinge nearest to `near` that gives the same posture as `angle`.
    fn nearest(kind: &JointKind, angle: f64, near: f64) -> f64 {
        match kind {
            JointKind::Revolute(_) => {
                let turn = 2.0 * std::f64::consts::PI;
                angle + ((near - angle) / turn).round() * turn
            }
            _ => angle,
        }
    }

    /// Draws the state at release: tumbling, joint postures and rates, and the root velocity that
    /// gives the centre of mass the required flight time.
    fn plan(&self, plant: &Plant, y: &[f64], rng: &mut Stream) -> Result<Plan, SimulateError> {
        let model = &self.object.body.model;
        let p = self.protocol;
        let time = rng.between(p.flight_s[0], p.flight_s[1]);
        let mut q = model.neutral();
        let mut v = vec![0.0; model.nv];
        let rotation = rng.rotation();
        q[..3].copy_from_slice(&[rng.between(-0.08, 0.08), rng.between(-0.08, 0.08), 1.45 + 0.1 * rng.moderate()]);
        q[3..7].copy_from_slice(rotation.coords.as_slice());
        let omega = rng.direction() * rng.between(p.spin_radps[0], p.spin_radps[1]);
        v[3..6].copy_from_slice(omega.as_slice());
        let mut joint_release = vec![Jet::default(); model.nv];
        for link in model.links.iter().skip(1) {
            let joint = &link.joint;
            if matches!(joint.kind, JointKind::Revolute(_) | JointKind::Prismatic(_)) {
                let angle = Self::nearest(&joint.kind, rng.between(-1.2, 1.2), y[joint.q_offset]);
                let rate = rng.sign() * rng.between(0.35, 1.0) * p.joint_rate_radps;
                q[joint.q_offset] = angle;
                v[joint.v_offset] = rate;
                joint_release[joint.v_offset] = Jet { x: angle, v: rate, a: 0.0 };
            }
        }
        let g = -model.gravity_mps2.z;
        let target = Vector3::new(0.4 * rng.moderate(), 0.4 * rng.moderate(), 0.5 * g * time);
        // root velocity for the required velocity of the centre of mass
        let mut state = State::new(model);
        state.forward_velocity(model, &q, &v);
        let (mut momentum, mut mass) = (Vector3::zeros(), 0.0);
        for (link, phi) in self.object.body.phi.iter().enumerate() {
            let com = Vector3::new(phi[1], phi[2], phi[3]) / phi[0];
            momentum += state.point_velocity_in_world(link, &com) * phi[0];
            mass += phi[0];
        }
        let velocity = target - momentum / mass;
        v[..3].copy_from_slice((rotation.inverse() * velocity).as_slice());
        // the acceleration in the air
        let mut start: Vec<f64> = q.iter().chain(&v).copied().collect();
        start.resize(y.len(), 0.0);
        let air = Loose(self.joints(Vec::new(), [0.0, 0.0]));
        let mut dynamics = crate::physics::ForwardDynamics::new(plant, &vec![true; model.n_links()]);
        let a = if plant.forces.n_states() == 0 {
            dynamics.accelerations(&air, 0.0, &start)?.0.to_vec()
        } else {
            let mut a = vec![0.0; model.nv];
            a[..3].copy_from_slice(
                (rotation.inverse() * model.gravity_mps2 - omega.cross(&(rotation.inverse() * velocity))).as_slice(),
            );
            a
        };
        let local = Vector3::new(a[0], a[1], a[2]) + omega.cross(&(rotation.inverse() * velocity));
        Ok(Plan {
            root: Release {
                position: Vector3::new(q[0], q[1], q[2]),
                rotation,
                velocity,
                accel: rotation * local,
                omega,
                alpha: Vector3::new(a[3], a[4], a[5]),
            },
            joints: joint_release,
            throw_s: rng.between(0.32, 0.42),
            flight_s: time,
        })
    }

    /// Motion from the resting position to the start of the throw.
    fn carry(&self, player: &Player<'_>, plan: &Plan, first: bool, rng: &mut Stream) -> (Held<'_>, f64) {
        let p = self.protocol;
        let length = if first { 0.9 } else { rng.between(p.carry_s[0], p.carry_s[1]) - 0.65 }.max(0.5);
        let (t0, t1) = (player.time(), player.time() + length);
        let (position, rotation) = root_pose(&player.y);
        let (start_position, start_turn) = plan.start();
        let turn =
            (rotation.inverse() * plan.root.rotation * UnitQuaternion::from_scaled_axis(start_turn)).scaled_axis();
        let root = std::array::from_fn(|i| {
            let (from, to) = if i < 3 { (position[i], start_position[i]) } else { (0.0, turn[i - 3]) };
            Piecewise::through(&[(t0, Jet::rest(from)), (t1, Jet::rest(to))])
        });
        let tremor = (
            t0,
            length,
            std::array::from_fn(|i| if i < 3 { 0.004 } else { 0.03 } * rng.moderate()),
            std::array::from_fn(|_| rng.between(1.0, 4.0)),
        );
        let targets = self.targets(&player.y, |i, now| {
            let release = plan.joints[i];
            let begin = release.x - 0.42 * release.v * plan.throw_s;
            Piecewise::through(&[(t0, now), (t1 - 0.1, Jet::rest(begin)), (t1, Jet::rest(begin))])
        });
        let chart = Chart { root_reference: rotation };
        (Held { chart, root, tremor: Some(tremor), joints: self.joints(targets, [t0 - 1.0, t1 + 1.0]) }, length)
    }

    /// Motion from rest to release.
    fn throw(&self, player: &Player<'_>, plan: &Plan) -> (Held<'_>, f64) {
        let length = plan.throw_s;
        let (t0, t1) = (player.time(), player.time() + length);
        let (start_position, start_turn) = plan.start();
        let r = &plan.root;
        let root = std::array::from_fn(|i| {
            let (x0, end) = if i < 3 {
                (start_position[i], Jet { x: r.position[i], v: r.velocity[i], a: r.accel[i] })
            } else {
                (start_turn[i - 3], Jet { x: 0.0, v: r.omega[i - 3], a: r.alpha[i - 3] })
            };
            // just before release the hand still pushes
            let push = 0.5 * end.v / length;
            let tau = RAMP_S;
            let before = Jet {
                x: end.x - end.v * tau + tau * tau * (end.a / 3.0 + push / 6.0),
                v: end.v - 0.5 * tau * (end.a + push),
                a: push,
            };
            Piecewise::through(&[(t0, Jet::rest(x0)), (t1 - tau, before), (t1, end)])
        });
        let targets =
            self.targets(&player.y, |i, now| Piecewise::through(&[(t0, Jet::rest(now.x)), (t1, plan.joints[i])]));
        let chart = Chart { root_reference: r.rotation };
        (Held { chart, root, tremor: None, joints: self.joints(targets, [t0 - 1.0, t1 - 0.005]) }, length)
    }

    /// Motion from the air to rest in the hand.
    fn catch(&self, player: &Player<'_>, air: &[bool]) -> Result<(Held<'_>, f64), SimulateError> {
        let length = 0.3;
        let (t0, t1) = (player.time(), player.time() + length);
        let (position, rotation) = root_pose(&player.y);
        let model = &self.object.body.model;
        let v = &player.y[model.nq..];
        let a = player.accelerations(air, &Loose(self.joints(Vec::new(), [0.0, 0.0])))?;
        let omega = Vector3::new(v[3], v[4], v[5]);
        let linear = Vector3::new(v[0], v[1], v[2]);
        let velocity = rotation * linear;
        let accel = rotation * (Vector3::new(a[0], a[1], a[2]) + omega.cross(&linear));
        let root = std::array::from_fn(|i| {
            let start = if i < 3 {
                Jet { x: position[i], v: velocity[i], a: accel[i] }
            } else {
                Jet { x: 0.0, v: omega[i - 3], a: a[i] }
            };
            let brake = -0.8 * start.v / length;
            let tau = RAMP_S;
            let after = Jet {
                x: start.x + start.v * tau + tau * tau * (start.a / 3.0 + brake / 6.0),
                v: start.v + 0.5 * tau * (start.a + brake),
                a: brake,
            };
            let rest = after.x + 0.42 * after.v * (length - tau);
            Piecewise::through(&[(t0, start), (t0 + tau, after), (t1, Jet::rest(rest))])
        });
        let targets = self.targets(&player.y, |_, now| {
            Piecewise::through(&[(t0, now), (t1, Jet::rest(now.x + 0.4 * now.v * length))])
        });
        let chart = Chart { root_reference: rotation };
        Ok((Held { chart, root, tremor: None, joints: self.joints(targets, [t0 + 0.01, t1 + 1.0]) }, length))
    }

    fn rest(&self, player: &Player<'_>) -> (Held<'_>, f64) {
        let t0 = player.time();
        let (position, rotation) = root_pose(&player.y);
        let root =
            std::array::from_fn(|i| Piecewise::through(&[(t0, Jet::rest(if i < 3 { position[i] } else { 0.0 }))]));
        let targets = self.targets(&player.y, |_, now| Piecewise::through(&[(t0, Jet::rest(now.x))]));
        let chart = Chart { root_reference: rotation };
        (Held { chart, root, tremor: None, joints: self.joints(targets, [t0 - 1.0, t0 + 9.0]) }, 0.4)
    }

    fn targets(&self, y: &[f64], curve: impl Fn(usize, Jet) -> Piecewise) -> Vec<Option<Piecewise>> {
        let model = &self.object.body.model;
        let mut out: Vec<Option<Piecewise>> = (0..model.nv).map(|_| None).collect();
        for link in model.links.iter().skip(1) {
            let joint = &link.joint;
            if matches!(joint.kind, JointKind::Revolute(_) | JointKind::Prismatic(_)) {
                let now = Jet { x: y[joint.q_offset], v: y[model.nq + joint.v_offset], a: 0.0 };
                out[joint.v_offset] = Some(curve(joint.v_offset, now));
            }
        }
        out
    }
}

struct Plan {
    root: Release,
    joints: Vec<Jet>,
    throw_s: f64,
    flight_s: f64,
}

impl Plan {
    /// Start of the throw: position, and rotation vector from the orientation at release.
    fn start(&self) -> (Vector3<f64>, Vector3<f64>) {
        let r = &self.root;
        (r.position - r.velocity * (0.42 * self.throw_s), -r.omega * (0.42 * self.throw_s))
    }
}

fn root_pose(y: &[f64]) -> (Vector3<f64>, UnitQuaternion<f64>) {
    (Vector3::new(y[0], y[1], y[2]), read(&y[3..7]))
}
