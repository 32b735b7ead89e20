//! Recordings of planned flights as a robot with known parameters would log them.
//!
//! The robot is held, let go with the planned turn, flies, is caught, and held again, once for each
//! flight. Encoders have steps, gyroscope, accelerometer, torques and poses noise, and the poses a
//! clock of their own. With other parameters than those a plan was made with, the recordings show
//! whether the plan keeps what it promises.

use crate::RobotModel;
use crate::description::{Imu, SensorNoise};
use crate::log::{BaseLog, RobotLog};
use crate::next::fly::{Release, fly};
use crate::next::wave::Wave;
use aloft_body::{JointKind, Model, Phi, State};
use nalgebra::{UnitQuaternion, Vector3};
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};

/// The robot and its sensors.
#[derive(Debug, Clone, Copy)]
pub struct Rehearsal<'a> {
    /// Names, friction and reflected inertia of the joints.
    pub robot: &'a RobotModel,
    /// Its tree.
    pub model: &'a Model,
    /// Its true parameters, 10 a link.
    pub phi: &'a [Phi],
    /// The inertial unit.
    pub imu: &'a Imu,
    /// Noise of the sensors.
    pub noise: SensorNoise,
    /// Rate of the log, Hz.
    pub rate_hz: f64,
    /// Rate of the poses, Hz.
    pub base_hz: f64,
    /// The poses' time minus the log's of the same instant, s.
    pub offset_s: f64,
}

/// Steps of the path for each row of the log.
const FINE: usize = 4;
/// Encoders: steps in a turn (or in a metre).
const STEPS: f64 = 65_536.0;
/// Durations of holding, of speeding up before a flight and of slowing down after it, s.
const HELD_S: f64 = 0.4;
const PUSHED_S: f64 = 0.3;
const CAUGHT_S: f64 = 0.3;

/// The base over time: position and velocity in the world, rotation, angular velocity in its own
/// axes; and the joints.
#[derive(Default)]
struct Path {
    position: Vec<Vector3<f64>>,
    speed: Vec<Vector3<f64>>,
    rotation: Vec<UnitQuaternion<f64>>,
    turn: Vec<Vector3<f64>>,
    q: Vec<Vec<f64>>,
    dq: Vec<Vec<f64>>,
}

impl Path {
    /// From rest to a velocity (or back) on a way with a smooth rate: `share` goes from 0 to 1.
    fn ramp(&mut self, seconds: f64, rate_hz: f64, hold: &[f64], speed: Vector3<f64>, turn: Vector3<f64>, down: bool) {
        let (Some(p0), Some(r0)) = (self.position.last().copied(), self.rotation.last().copied()) else { return };
        let n = (seconds * rate_hz).round() as usize;
        for i in 1..=n {
            let s = i as f64 / n as f64;
            // the rate 3 s² − 2 s³ and its integral
            let (rate, way) = (s * s * (3.0 - 2.0 * s), s * s * s - 0.5 * s.powi(4));
            let (rate, way) = if down { (1.0 - rate, s - way) } else { (rate, way) };
            self.position.push(p0 + speed * (way * seconds));
            self.speed.push(speed * rate);
            self.rotation.push(r0 * UnitQuaternion::from_scaled_axis(turn * (way * seconds)));
            self.turn.push(turn * rate);
            self.q.push(hold.to_vec());
            self.dq.push(vec![0.0; hold.len()]);
        }
    }

    fn rest(&mut self, seconds: f64, rate_hz: f64, hold: &[f64]) {
        self.ramp(seconds, rate_hz, hold, Vector3::zeros(), Vector3::zeros(), false);
    }
}

impl Rehearsal<'_> {
    /// Log and poses of flights with the given turns at release, one after the other, and when they
    /// began and ended (s).
    pub fn record(&self, flights: &[(Wave, Vector3<f64>)], seed: u64) -> (RobotLog, BaseLog, Vec<(f64, f64)>) {
        let fine_hz = self.rate_hz * FINE as f64;
        let mut path = Path::default();
        let mut times = Vec::new();
        let Some((first, _)) = flights.first() else { return Default::default() };
        let at_rest = UnitQuaternion::from_euler_angles(0.1, -0.05, 0.3);
        path.position.push(Vector3::new(0.0, 0.0, 1.2));
        path.speed.push(Vector3::zeros());
        path.rotation.push(at_rest);
        path.turn.push(Vector3::zeros());
        path.q.push(first.hold.clone());
        path.dq.push(vec![0.0; first.hold.len()]);
        for (wave, turn) in flights {
            self.throw(&mut path, wave, *turn, fine_hz, &mut times);
        }
        self.measure(&path, fine_hz, seed, times)
    }

    fn throw(&self, path: &mut Path, wave: &Wave, turn: Vector3<f64>, fine_hz: f64, times: &mut Vec<(f64, f64)>) {
        path.rest(HELD_S, fine_hz, &wave.hold);
        let up = -self.model.gravity_mps2 * (0.5 * wave.duration_s);
        path.ramp(PUSHED_S, fine_hz, &wave.hold, up, turn, false);
        let (Some(p), Some(r)) = (path.position.last().copied(), path.rotation.last().copied()) else { return };
        // the base moves with `up`; its centre of mass is beside it and moves with the turn as well
        let mut state = State::new(self.model);
        let mut q = self.model.neutral();
        q[..3].copy_from_slice(p.as_slice());
        q[3..7].copy_from_slice(r.coords.as_slice());
        let one = |k: &JointKind| matches!(k, JointKind::Revolute(_) | JointKind::Prismatic(_));
        for (link, hold) in self.model.links.iter().filter(|l| one(&l.joint.kind)).zip(&wave.hold) {
            q[link.joint.q_offset] = *hold;
        }
        state.forward_position(self.model, &q);
        let centre = state.centre_of_mass(self.phi).1;
        let release = Release {
            centre_m: centre,
            speed_m_s: up + (r * turn).cross(&(centre - p)),
            rotation: r,
            turn_rad_s: turn,
        };
        let n = (wave.duration_s * fine_hz).round() as usize;
        let flown = fly(self.model, self.phi, &release, &|t| wave.at(t), n + 1, fine_hz, 4);
        let start = path.position.len() - 1;
        for i in 1..=n {
            let (q, v) = (flown.q(i), flown.v(i));
            let r = UnitQuaternion::from_quaternion(nalgebra::Quaternion::new(q[6], q[3], q[4], q[5]));
            path.position.push(Vector3::new(q[0], q[1], q[2]));
            path.speed.push(r * Vector3::new(v[0], v[1], v[2]));
            path.rotation.push(r);
            path.turn.push(Vector3::new(v[3], v[4], v[5]));
            let (q, dq) = wave.at(i as f64 / fine_hz);
            path.q.push(q);
            path.dq.push(dq);
        }
        times.push((start as f64 / fine_hz, (path.position.len() - 1) as f64 / fine_hz));
        let (speed, turn) = (path.speed[path.speed.len() - 1], path.turn[path.turn.len() - 1]);
        path.ramp(CAUGHT_S, fine_hz, &wave.hold, speed, turn, true);
        path.rest(HELD_S, fine_hz, &wave.hold);
    }

    fn measure(
        &self,
        path: &Path,
        fine_hz: f64,
        seed: u64,
        times: Vec<(f64, f64)>,
    ) -> (RobotLog, BaseLog, Vec<(f64, f64)>) {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        let mut noise = |sd: f64| -> Vector3<f64> {
            Vector3::from_fn(|_, _| sd * <StandardNormal as Distribution<f64>>::sample(&StandardNormal, &mut rng))
        };
        let (gyro_bias, acc_bias) = (noise(0.01), noise(0.05));
        let n = path.position.len();
        let joints = self.robot.joints.len();
        let mut log = RobotLog {
            file: "rehearsal".to_owned(),
            q: vec![Vec::new(); joints],
            dq: vec![Vec::new(); joints],
            torque: vec![Vec::new(); joints],
            command: vec![Vec::new(); joints],
            gyro: Some(Vec::new()),
            acc: Some(Vec::new()),
            ..RobotLog::default()
        };
        let (mut gyro, mut acc) = (Vec::new(), Vec::new());
        let lever = Vector3::from(self.imu.position_m);
        let [roll, pitch, yaw] = self.imu.rpy_rad;
        let mount = UnitQuaternion::from_euler_angles(roll, pitch, yaw);
        let one = |k: &JointKind| matches!(k, JointKind::Revolute(_) | JointKind::Prismatic(_));
        let places: Vec<(usize, usize)> = self
            .model
            .links
            .iter()
            .filter(|l| one(&l.joint.kind))
            .map(|l| (l.joint.q_offset, l.joint.v_offset))
            .collect();
        let mut state = State::new(self.model);
        let (mut q, mut v) = (self.model.neutral(), vec![0.0; self.model.nv]);
        let (mut a, mut tau) = (v.clone(), v.clone());
        for i in (FINE..n - FINE).step_by(FINE) {
            let slope = |x: &[Vector3<f64>]| (x[i + 1] - x[i - 1]) * (0.5 * fine_hz);
            let back = path.rotation[i].inverse();
            let (omega, alpha) = (path.turn[i], slope(&path.turn));
            let base = back * slope(&path.speed);
            let force = base - back * self.model.gravity_mps2 + alpha.cross(&lever) + omega.cross(&omega.cross(&lever));
            log.time_s.push(i as f64 / fine_hz);
            gyro.push(mount.inverse() * omega + gyro_bias + noise(self.noise.gyro_rad_s));
            acc.push(mount.inverse() * force + acc_bias + noise(self.noise.acc_m_s2));
            q[..3].copy_from_slice(path.position[i].as_slice());
            q[3..7].copy_from_slice(path.rotation[i].coords.as_slice());
            let own_speed = back * path.speed[i];
            v[..3].copy_from_slice(own_speed.as_slice());
            v[3..6].copy_from_slice(omega.as_slice());
            // derivative of the velocity in the base's own turning axes
            a[..3].copy_from_slice((base - omega.cross(&own_speed)).as_slice());
            a[3..6].copy_from_slice(alpha.as_slice());
            for (j, (iq, iv)) in places.iter().enumerate() {
                q[*iq] = path.q[i][j];
                v[*iv] = path.dq[i][j];
                a[*iv] = (path.dq[i + 1][j] - path.dq[i - 1][j]) * 0.5 * fine_hz;
            }
            state.forward_acceleration(self.model, &q, &v, &a);
            state.inverse_dynamics(self.model, self.phi, &mut tau);
            for (j, (joint, (_, iv))) in self.robot.joints.iter().zip(&places).enumerate() {
                let step = if joint.prismatic { 1.0 / STEPS } else { std::f64::consts::TAU / STEPS };
                log.q[j].push((path.q[i][j] / step).round() * step);
                let rate = path.dq[i][j];
                log.dq[j].push(rate + noise(self.noise.dq_rad_s).x);
                let own =
                    tau[*iv] + joint.armature * a[*iv] + joint.damping * rate + joint.friction * (rate / 0.05).tanh();
                log.torque[j].push(own + noise(self.noise.torque_nm).x);
            }
        }
        (log.gyro, log.acc) = (Some(gyro), Some(acc));
        let mut base = BaseLog { file: "rehearsal (base)".to_owned(), ..BaseLog::default() };
        let every = (fine_hz / self.base_hz).round().max(1.0) as usize;
        for i in (0..n).step_by(every) {
            let sd = self.noise.orientation_deg.to_radians();
            base.time_s.push(i as f64 / fine_hz + self.offset_s);
            base.position_m.push(path.position[i] + noise(self.noise.position_m));
            base.rotation.push(UnitQuaternion::from_scaled_axis(noise(sd)) * path.rotation[i]);
        }
        (log, base, times)
    }
}

impl RobotLog {
    /// The log as CSV with the columns that [`RobotLog::of`] reads.
    pub fn csv(&self, robot: &RobotModel) -> String {
        let unit = |prismatic: bool| if prismatic { "m" } else { "rad" };
        let mut head = vec!["time_s".to_owned()];
        let mut columns: Vec<Box<dyn Fn(usize) -> String + '_>> = vec![Box::new(|i| format!("{:.6}", self.time_s[i]))];
        for (j, joint) in robot.joints.iter().enumerate() {
            let unit = unit(joint.prismatic);
            let series = [
                (format!("q_{}_{unit}", joint.name), &self.q[j]),
                (format!("dq_{}_{unit}_s", joint.name), &self.dq[j]),
                (format!("tau_meas_{}_nm", joint.name), &self.torque[j]),
            ];
            for (name, values) in series.into_iter().filter(|s| !s.1.is_empty()) {
                head.push(name);
                columns.push(Box::new(move |i| format!("{:.6}", values[i])));
            }
        }
        for (name, unit, values) in [("gyro", "rad_s", &self.gyro), ("acc", "m_s2", &self.acc)] {
            let Some(values) = values else { continue };
            for (k, axis) in ["x", "y", "z"].iter().enumerate() {
                head.push(format!("{name}_{axis}_{unit}"));
                columns.push(Box::new(move |i| format!("{:.5}", values[i][k])));
            }
        }
        let mut out = head.join(",") + "\n";
        for i in 0..self.time_s.len() {
            out += &columns.iter().map(|c| c(i)).collect::<Vec<_>>().join(",");
            out.push('\n');
        }
        out
    }
}

impl BaseLog {
    /// The poses as CSV with the columns that [`BaseLog::of`] reads.
    pub fn csv(&self) -> String {
        let mut out = "time_s,x_m,y_m,z_m,qw,qx,qy,qz\n".to_owned();
        for ((t, p), r) in self.time_s.iter().zip(&self.position_m).zip(&self.rotation) {
            let q = r.quaternion();
            out += &format!("{t:.6},{:.6},{:.6},{:.6},{:.8},{:.8},{:.8},{:.8}\n", p.x, p.y, p.z, q.w, q.i, q.j, q.k);
        }
        out
    }
}
