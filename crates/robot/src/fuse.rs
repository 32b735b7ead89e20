//! Encoders, base pose and inertial unit to one [`Motion`] on the robot's clock.
//!
//! The base's orientation follows the gyroscope between poses, its position the accelerometer; the
//! poses hold both. In the world's axes the errors of orientation are three equal random walks and
//! those of position three equal integrated ones, so that each axis is smoothed alone
//! ([`crate::smoother`]). Biases of the sensors and the offset of the clocks are constants of the
//! recording and are estimated with it, the offset with an interval.
//!
//! Joint coordinates are the encoders' values. The drives' rates are not used: over a weak window
//! the encoder's differences are better by an order of magnitude.

use crate::description::{Imu, SensorNoise};
use crate::inertial::{BETWEEN_SAMPLES, Moved, Turned, shifted, twice_integrated};
use crate::log::{BaseLog, RobotLog};
use crate::resample::{Grid, encoder_sd};
use crate::smoother::{Axis, Sample, constants};
use crate::{RobotError, clock};
use aloft_body::{JointKind, Model, Motion};
use nalgebra::{Isometry3, UnitQuaternion, Vector3};
use serde::{Deserialize, Serialize};

/// How the sensors of one recording were combined.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct FusionReport {
    /// Recording.
    pub trial: String,
    /// Rows of the motion.
    pub frames: usize,
    /// Rows without a posture: encoders or poses missing.
    pub missing_frames: usize,
    /// The base's clock minus the robot's clock, s; none where it was not estimated.
    pub clock_offset_s: Option<f64>,
    /// Standard deviation of the offset, s.
    pub clock_offset_sd_s: Option<f64>,
    /// Delay of the accelerometer against the gyroscope, s.
    pub acc_delay_s: Option<f64>,
    /// Rows without a posture between the first and the last with one.
    pub inner_missing_frames: usize,
    /// Bias of the gyroscope, rad/s.
    pub gyro_bias_rad_s: Option<[f64; 3]>,
    /// Bias of the accelerometer, m/s².
    pub acc_bias_m_s2: Option<[f64; 3]>,
    /// Root mean square of the orientation's innovations in units of their stated size: about 1
    /// where the stated noise is right.
    pub orientation_ratio: Option<f64>,
    /// The same for the position.
    pub position_ratio: Option<f64>,
    /// Standard deviation of the smoothed orientation, rad (median).
    pub orientation_sd_rad: f64,
    /// Standard deviation of the smoothed position, m (median).
    pub position_sd_m: f64,
    /// Standard deviation of each joint's encoder, rad or m.
    pub encoder_sd: Vec<f64>,
    /// Noise of the sensors as used.
    pub noise: SensorNoise,
    /// Remarks.
    pub warnings: Vec<String>,
    /// When poses were measured: step of the motion and time after it, s.
    pub measured: Vec<(usize, f64)>,
}

/// What is known before the recording.
#[derive(Debug, Clone, Copy)]
pub struct FuseInput<'a> {
    /// Name of the recording.
    pub trial: &'a str,
    /// Model; its root is the link of the base recording.
    pub model: &'a Model,
    /// The log.
    pub log: &'a RobotLog,
    /// The base recording; the log's own base if none.
    pub base: Option<&'a BaseLog>,
    /// The inertial unit.
    pub imu: Option<&'a Imu>,
    /// Noise of the sensors.
    pub noise: SensorNoise,
}

/// Poses further than this from the motion's rows do not count as measuring them, s.
const REACH_S: f64 = 0.1;
/// Standard deviations of the constants before the recording.
const GYRO_BIAS_SD: f64 = 0.2;
const ACC_BIAS_SD: f64 = 1.0;
const OFFSET_SD_S: f64 = 0.02;
const DELAY_SD_S: f64 = 0.005;
/// Largest delay of the accelerometer that is believed, s.
const MOST_DELAY_S: f64 = 0.02;

/// Combines the sensors of a recording.
///
/// # Errors
/// [`RobotError::Log`] without a base pose, with poses that do not overlap the log, and with a
/// gyroscope that contradicts the poses.
pub fn fuse(input: &FuseInput<'_>) -> Result<(Motion, FusionReport), RobotError> {
    let log = input.log;
    let base = input.base.or(log.base.as_ref()).ok_or_else(|| {
        RobotError::log(
            &log.file,
            "no pose of the base: there is no base recording beside the log and the log has no pose columns",
            "put <recording>_base.csv beside it (time_s, x_m, y_m, z_m, qw, qx, qy, qz)",
        )
    })?;
    let own_clock = input.base.is_none();
    let mut report = FusionReport { trial: input.trial.to_owned(), noise: input.noise, ..FusionReport::default() };
    let rough = if own_clock { None } else { clock::rough_offset(log, base) };
    let start_offset = rough.map_or(0.0, |r| r.offset_s);
    let mut grid = Grid::of(log)?;
    report.warnings.append(&mut grid.warnings);
    report.encoder_sd = log.q.iter().map(|q| encoder_sd(q)).collect();
    let path = match (&grid.gyro, &grid.acc) {
        (Some(gyro), Some(acc)) => {
            let sensors = Sensors { gyro, acc, base, own_clock, start_offset };
            with_inertial_unit(input, &grid, &sensors, &mut report)?
        }
        _ => {
            if !own_clock {
                report.warnings.push(
                    "the log has no gyroscope and accelerometer: the offset of the clocks is taken as zero".to_owned(),
                );
            }
            poses_alone(input, &grid, base, &mut report)?
        }
    };
    let motion = assemble(input, &grid, &path, &mut report);
    if report.missing_frames == report.frames {
        return Err(RobotError::log(
            &base.file,
            format!(
                "its times {:.3} to {:.3} s do not overlap those of the log",
                base.time_s[0],
                base.time_s[base.time_s.len() - 1]
            ),
            "both recordings must be of the same motion, with clocks that differ by a constant",
        ));
    }
    Ok((motion, report))
}

/// The base over the grid.
struct Path {
    pose: Vec<Isometry3<f64>>,
    valid: Vec<bool>,
    orientation_sd: Vec<f64>,
    position_sd: Vec<f64>,
}

struct Sensors<'a> {
    gyro: &'a [Vector3<f64>],
    acc: &'a [Vector3<f64>],
    base: &'a BaseLog,
    own_clock: bool,
    start_offset: f64,
}

/// Rows of the base that fall on the grid for an offset, with their samples.
fn samples(grid: &Grid, base: &BaseLog, offset_s: f64) -> (Vec<usize>, Vec<Sample>) {
    let (mut rows, mut out) = (Vec::new(), Vec::new());
    for (row, t) in base.time_s.iter().enumerate() {
        let at = (t - offset_s - grid.start_s) / grid.dt_s;
        if base.is_valid(row) && at >= 0.0 && at < (grid.n - 1) as f64 {
            rows.push(row);
            out.push(Sample { step: at as usize, after_s: (at - at.floor()) * grid.dt_s });
        }
    }
    (rows, out)
}

fn too_few(base: &BaseLog, found: usize) -> RobotError {
    RobotError::log(
        &base.file,
        format!("{found} poses fall into the time of the log, expected 20 at least"),
        "both recordings must be of the same motion, with clocks that differ by a constant",
    )
}

fn with_inertial_unit(
    input: &FuseInput<'_>,
    grid: &Grid,
    sensors: &Sensors<'_>,
    report: &mut FusionReport,
) -> Result<Path, RobotError> {
    let (noise, base, dt) = (&input.noise, sensors.base, grid.dt_s);
    let mount = input.imu.map_or_else(UnitQuaternion::identity, |i| {
        UnitQuaternion::from_euler_angles(i.rpy_rad[0], i.rpy_rad[1], i.rpy_rad[2])
    });
    let lever = input.imu.map_or_else(Vector3::zeros, |i| Vector3::from(i.position_m));
    let gyro: Vec<Vector3<f64>> = sensors.gyro.iter().map(|g| mount * g).collect();
    let acc: Vec<Vector3<f64>> = sensors.acc.iter().map(|a| mount * a).collect();
    let g = input.model.gravity_mps2;
    let orientation_sd = noise.orientation_deg.to_radians();
    let free = if sensors.own_clock { 1e-9 } else { OFFSET_SD_S };

    // orientation: bias of the gyroscope and offset, linearised anew three times
    let mut bias = Vector3::zeros();
    let mut offset = sensors.start_offset;
    let mut offset_sd = free;
    for round in 0..3 {
        let (rows, at) = samples(grid, base, offset);
        if rows.len() < 20 {
            return Err(too_few(base, rows.len()));
        }
        let turned = Turned::of(&gyro, &bias, dt, base, &rows, &at);
        let axis = turned.axis(&gyro, grid, &at, noise.gyro_rad_s, orientation_sd);
        let mut white = vec![Vec::new(); 5];
        for k in 0..3 {
            let column = |of: &dyn Fn(usize) -> f64| axis.innovations(&(0..at.len()).map(of).collect::<Vec<_>>());
            white[0].extend(column(&|i| turned.difference[i][k]));
            for (j, white) in white[1..4].iter_mut().enumerate() {
                white.extend(column(&|i| turned.drift[i][(k, j)]));
            }
            white[4].extend(column(&|i| -turned.rate_in_world[i][k]));
        }
        let found = constants(&white[0], &white[1..], &[GYRO_BIAS_SD, GYRO_BIAS_SD, GYRO_BIAS_SD, free])
            .ok_or_else(|| too_few(base, rows.len()))?;
        bias += found.value.fixed_rows::<3>(0);
        offset += found.value[3];
        let ratio = found.mean_square.sqrt();
        report.orientation_ratio = Some(ratio);
        offset_sd = found.covariance[(3, 3)].sqrt() * ratio.max(1.0);
        if round == 2 && ratio > 30.0 {
            return Err(RobotError::log(
                &base.file,
                format!(
                    "its rotation contradicts the gyroscope of {}: {ratio:.0} times the stated noise",
                    input.log.file
                ),
                "check the order of the quaternion (qw, qx, qy, qz: base to world), the axes of the gyroscope and its unit",
            ));
        }
    }
    let (_, at) = samples(grid, base, offset);
    if at.len() < 20 {
        return Err(too_few(base, at.len()));
    }

    // position: bias of the accelerometer, and its delay against the gyroscope, which moves the path
    // as an offset of the clock would
    let mut acc_bias = Vector3::zeros();
    let (mut delay, mut delay_sd) = (0.0, f64::INFINITY);
    let mut path = None;
    for round in 0..4 {
        let (rows, at) = samples(grid, base, offset);
        let turned = Turned::of(&gyro, &bias, dt, base, &rows, &at);
        let axis = turned.axis(&gyro, grid, &at, noise.gyro_rad_s, orientation_sd);
        let rotation = turned.smoothed(&axis);
        let now = shifted(&acc, delay / dt);
        let force: Vec<Vector3<f64>> = rotation.iter().zip(&now).map(|(r, a)| r * (a - acc_bias) + g).collect();
        let moved = Moved::of(&force, &rotation, &gyro, dt, base, &rows, &at, &lever);
        let mut variance: Vec<f64> = (0..grid.n)
            .map(|i| {
                let bend = |i: usize| (force[i + 1] - force[i] * 2.0 + force[i - 1]).norm();
                let change = if i > 0 && i + 1 < grid.n { bend(i) } else { 0.0 };
                noise.acc_m_s2.powi(2) + (BETWEEN_SAMPLES * change).powi(2)
            })
            .collect();
        grid.widen(&mut variance);
        let drifting = Axis::drifting(dt, variance, at.clone(), noise.position_m.powi(2), 100.0, 1e4);
        if round == 3 {
            report.orientation_sd_rad = middle(axis.smoothed_sd());
            let position_sd = drifting.smoothed_sd();
            report.position_sd_m = middle(position_sd.clone());
            let correction: Vec<Vec<f64>> =
                (0..3).map(|k| drifting.smooth(&moved.difference.iter().map(|d| d[k]).collect::<Vec<_>>())).collect();
            let pose = (0..grid.n)
                .map(|i| {
                    let p = moved.path[i] + Vector3::new(correction[0][i], correction[1][i], correction[2][i]);
                    Isometry3::from_parts((p - rotation[i] * lever).into(), rotation[i])
                })
                .collect();
            report.measured = at.iter().map(|s| (s.step, s.after_s)).collect();
            let valid = within_reach(grid, &at);
            path = Some(Path { pose, valid, orientation_sd: axis.smoothed_sd(), position_sd });
            break;
        }
        let mut white = vec![Vec::new(); 5];
        let drift = twice_integrated(&rotation, dt, &at);
        for k in 0..3 {
            let column = |of: &dyn Fn(usize) -> f64| drifting.innovations(&(0..at.len()).map(of).collect::<Vec<_>>());
            white[0].extend(column(&|i| moved.difference[i][k]));
            for (j, white) in white[1..4].iter_mut().enumerate() {
                white.extend(column(&|i| drift[i][(k, j)]));
            }
            white[4].extend(column(&|i| moved.velocity[i][k]));
        }
        let found = constants(&white[0], &white[1..], &[ACC_BIAS_SD, ACC_BIAS_SD, ACC_BIAS_SD, DELAY_SD_S])
            .ok_or_else(|| too_few(base, rows.len()))?;
        acc_bias += found.value.fixed_rows::<3>(0);
        delay = (delay + found.value[3]).clamp(-MOST_DELAY_S, MOST_DELAY_S);
        let ratio = found.mean_square.sqrt();
        report.position_ratio = Some(ratio);
        delay_sd = found.covariance[(3, 3)].sqrt() * ratio.max(1.0);
    }
    report.acc_delay_s = Some(delay);
    if !sensors.own_clock {
        report.clock_offset_s = Some(offset);
        report.clock_offset_sd_s = Some(offset_sd);
    }
    if delay.abs() > dt && delay.abs() > 5.0 * delay_sd {
        report.warnings.push(format!(
            "the accelerometer is {:.1} ms {} the gyroscope; this is taken into account",
            delay.abs() * 1e3,
            if delay > 0.0 { "behind" } else { "ahead of" }
        ));
    }
    for (what, ratio) in [("orientation", report.orientation_ratio), ("position", report.position_ratio)] {
        if ratio.is_some_and(|r| r > 3.0) {
            report.warnings.push(format!(
                "the base's {what} misses the inertial unit by {:.1} times the stated noise",
                ratio.unwrap_or(0.0)
            ));
        }
    }
    report.gyro_bias_rad_s = Some((mount.inverse() * bias).into());
    report.acc_bias_m_s2 = Some((mount.inverse() * acc_bias).into());
    path.ok_or_else(|| too_few(base, 0))
}

fn middle(mut values: Vec<f64>) -> f64 {
    aloft_signal::median(&mut values)
}

/// Steps with a pose before and after within reach.
fn within_reach(grid: &Grid, at: &[Sample]) -> Vec<bool> {
    let reach = (REACH_S / grid.dt_s).ceil() as usize;
    let mut near = vec![false; grid.n];
    for pair in at.windows(2) {
        if pair[1].step - pair[0].step <= 2 * reach {
            near[pair[0].step..=pair[1].step + 1].fill(true);
        }
    }
    near.iter().zip(&grid.sensors_valid).map(|(a, b)| *a && *b).collect()
}

/// Without an inertial unit: poses interpolated to the grid.
fn poses_alone(
    input: &FuseInput<'_>,
    grid: &Grid,
    base: &BaseLog,
    report: &mut FusionReport,
) -> Result<Path, RobotError> {
    let (rows, at) = samples(grid, base, 0.0);
    if rows.len() < 20 {
        return Err(too_few(base, rows.len()));
    }
    let times: Vec<f64> = at.iter().map(|s| s.step as f64 * grid.dt_s + s.after_s).collect();
    let mut k = 0;
    let pose = (0..grid.n)
        .map(|i| {
            let t = i as f64 * grid.dt_s;
            while k + 2 < times.len() && times[k + 1] < t {
                k += 1;
            }
            let share = ((t - times[k]) / (times[k + 1] - times[k])).clamp(0.0, 1.0);
            let (a, b) = (rows[k], rows[k + 1]);
            let p = base.position_m[a].lerp(&base.position_m[b], share);
            let turn = (base.rotation[a].inverse() * base.rotation[b]).scaled_axis() * share;
            Isometry3::from_parts(p.into(), base.rotation[a] * UnitQuaternion::from_scaled_axis(turn))
        })
        .collect();
    report.measured = at.iter().map(|s| (s.step, s.after_s)).collect();
    report.orientation_sd_rad = input.noise.orientation_deg.to_radians();
    report.position_sd_m = input.noise.position_m;
    Ok(Path {
        pose,
        valid: within_reach(grid, &at),
        orientation_sd: vec![report.orientation_sd_rad; grid.n],
        position_sd: vec![report.position_sd_m; grid.n],
    })
}

fn assemble(input: &FuseInput<'_>, grid: &Grid, path: &Path, report: &mut FusionReport) -> Motion {
    let (nq, nv) = (input.model.nq, input.model.nv);
    let mut q = vec![f64::NAN; grid.n * nq];
    let mut q_sd = vec![0.0; grid.n * nv];
    let mut before: Option<UnitQuaternion<f64>> = None;
    let joints: Vec<_> =
        input.model.links.iter().filter(|l| l.joint.kind != JointKind::Free && l.joint.kind.nq() == 1).collect();
    for i in 0..grid.n {
        let sd = &mut q_sd[i * nv..(i + 1) * nv];
        sd[..3].fill(path.position_sd[i]);
        sd[3..6].fill(path.orientation_sd[i]);
        for (link, s) in joints.iter().zip(&report.encoder_sd) {
            sd[link.joint.v_offset] = *s;
        }
        if !path.valid[i] || grid.q.iter().any(|joint| !joint[i].is_finite()) {
            report.missing_frames += 1;
            continue;
        }
        let mut r = path.pose[i].rotation;
        if before.is_some_and(|b| b.coords.dot(&r.coords) < 0.0) {
            r = UnitQuaternion::new_unchecked(-r.into_inner());
        }
        before = Some(r);
        let frame = &mut q[i * nq..(i + 1) * nq];
        frame[..3].copy_from_slice(path.pose[i].translation.vector.as_slice());
        frame[3..7].copy_from_slice(r.coords.as_slice());
        for (link, values) in joints.iter().zip(&grid.q) {
            frame[link.joint.q_offset] = values[i];
        }
    }
    report.frames = grid.n;
    let solved: Vec<bool> = (0..grid.n).map(|i| q[i * nq].is_finite()).collect();
    if let (Some(first), Some(last)) = (solved.iter().position(|s| *s), solved.iter().rposition(|s| *s)) {
        report.inner_missing_frames = solved[first..=last].iter().filter(|s| !**s).count();
    }
    Motion { trial: input.trial.to_owned(), rate_hz: 1.0 / grid.dt_s, nq, nv, q, q_sd, ..Motion::default() }
}
