//! The base's path from the inertial unit and the poses: first orientation, then position.
//!
//! Constants of the recording (biases, the offset of the clocks, a delay of the accelerometer) are
//! estimated with each; what is uncertain in them is part of the stated deviations.

use crate::RobotError;
use crate::fuse::{FuseInput, FusionReport, Path, Sensors, samples, too_few, within_reach};
use crate::inertial::{BETWEEN_SAMPLES, Moved, Turned, shifted};
use crate::resample::Grid;
use crate::smoother::{Axis, Constants, Sample, constants};
use nalgebra::{DMatrix, DVector, Isometry3, UnitQuaternion, Vector3};

/// Standard deviations of the constants before the recording.
const GYRO_BIAS_SD: f64 = 0.2;
const ACC_BIAS_SD: f64 = 1.0;
const OFFSET_SD_S: f64 = 0.02;
const DELAY_SD_S: f64 = 0.005;
const POSITION_PRIOR: [f64; 4] = [ACC_BIAS_SD, ACC_BIAS_SD, ACC_BIAS_SD, DELAY_SD_S];
/// Shares of the acceleration's change from sample to sample by which it may be off between them.
const BETWEEN: [f64; 8] = [0.05, 0.1, 0.2, 0.4, 0.7, 1.0, 1.5, 2.0];
/// Largest delay of the accelerometer that is believed, s.
const MOST_DELAY_S: f64 = 0.02;
/// Offset's standard deviation where both recordings have one clock, s.
const SAME_CLOCK_SD_S: f64 = 1e-9;

/// What the path depends on linearly: at the poses, and at every step; `[constant][place]`.
struct Columns {
    at_poses: Vec<Vec<Vector3<f64>>>,
    at_steps: Vec<Vec<Vector3<f64>>>,
}

impl Columns {
    /// The constants that leave the whitest innovations of `difference`.
    fn fit(&self, axis: &Axis, difference: &[Vector3<f64>], prior_sd: &[f64]) -> Option<Constants> {
        let white = |series: &[Vector3<f64>]| -> Vec<f64> {
            (0..3).flat_map(|k| axis.innovations(&series.iter().map(|v| v[k]).collect::<Vec<_>>())).collect()
        };
        let columns: Vec<Vec<f64>> = self.at_poses.iter().map(|c| white(c)).collect();
        constants(&white(difference), &columns, prior_sd)
    }

    /// Variance of the smoothed path at every step that comes from the constants' covariance, mean
    /// of the three axes.
    ///
    /// A constant that is off by δ moves the smoothed path by δ times the smoothed column less the
    /// column itself.
    fn variance(&self, axis: &Axis, covariance: &DMatrix<f64>) -> Vec<f64> {
        let n = self.at_steps.first().map_or(0, Vec::len);
        let mut out = vec![0.0; n];
        for k in 0..3 {
            let moved: Vec<Vec<f64>> = self
                .at_poses
                .iter()
                .zip(&self.at_steps)
                .map(|(poses, steps)| {
                    let smooth = axis.smooth(&poses.iter().map(|v| v[k]).collect::<Vec<_>>());
                    smooth.iter().zip(steps).map(|(s, own)| s - own[k]).collect()
                })
                .collect();
            for (i, out) in out.iter_mut().enumerate() {
                let c = DVector::from_iterator(moved.len(), moved.iter().map(|m| m[i]));
                *out += (c.transpose() * covariance * &c)[0] / 3.0;
            }
        }
        out
    }
}

/// Deviations of a smoothed path: the smoother's own and those of the constants, times the size of
/// the innovations where they are larger than stated.
fn deviations(axis: &Axis, columns: &Columns, found: &Constants) -> Vec<f64> {
    let ratio = found.mean_square.sqrt().max(1.0);
    let of_constants = columns.variance(axis, &found.covariance);
    axis.smoothed_sd().iter().zip(of_constants).map(|(sd, v)| ratio * (sd * sd + v).sqrt()).collect()
}

/// Orientation of the base with the constants it depends on.
struct Orientation {
    bias: Vector3<f64>,
    offset: f64,
    offset_sd: f64,
    sd: Vec<f64>,
}

/// Combines gyroscope, accelerometer and poses.
///
/// # Errors
/// [`RobotError::Log`] where poses do not overlap the log, or contradict the gyroscope.
pub(crate) fn with_inertial_unit(
    input: &FuseInput<'_>,
    grid: &Grid,
    sensors: &Sensors<'_>,
    report: &mut FusionReport,
) -> Result<Path, RobotError> {
    let mount = input.imu.map_or_else(UnitQuaternion::identity, |i| {
        UnitQuaternion::from_euler_angles(i.rpy_rad[0], i.rpy_rad[1], i.rpy_rad[2])
    });
    let gyro: Vec<Vector3<f64>> = sensors.gyro.iter().map(|g| mount * g).collect();
    let acc: Vec<Vector3<f64>> = sensors.acc.iter().map(|a| mount * a).collect();
    let turned = orientation(input, grid, sensors, &gyro, report)?;
    if !sensors.own_clock {
        report.clock_offset_s = Some(turned.offset);
        report.clock_offset_sd_s = Some(turned.offset_sd);
    }
    let (path, acc_bias) = position(input, grid, sensors, &gyro, &acc, &turned, report)?;
    for (what, ratio) in [("orientation", report.orientation_ratio), ("position", report.position_ratio)] {
        if ratio.is_some_and(|r| r > 3.0) {
            report.warnings.push(format!(
                "the base's {what} misses the inertial unit by {:.1} times the stated noise",
                ratio.unwrap_or(0.0)
            ));
        }
    }
    report.gyro_bias_rad_s = Some((mount.inverse() * turned.bias).into());
    report.acc_bias_m_s2 = Some((mount.inverse() * acc_bias).into());
    Ok(path)
}

/// Bias of the gyroscope and offset of the clocks, linearised anew three times.
fn orientation(
    input: &FuseInput<'_>,
    grid: &Grid,
    sensors: &Sensors<'_>,
    gyro: &[Vector3<f64>],
    report: &mut FusionReport,
) -> Result<Orientation, RobotError> {
    let (noise, base, dt) = (&input.noise, sensors.base, grid.dt_s);
    let free = if sensors.own_clock { SAME_CLOCK_SD_S } else { OFFSET_SD_S };
    let mut out = Orientation { bias: Vector3::zeros(), offset: sensors.start_offset, offset_sd: free, sd: Vec::new() };
    for round in 0..3 {
        let (rows, at) = samples(grid, base, out.offset);
        if rows.len() < 20 {
            return Err(too_few(base, rows.len()));
        }
        let turned = Turned::of(gyro, &out.bias, dt, base, &rows, &at);
        let axis = turned.axis(gyro, grid, &at, noise.gyro_rad_s, noise.orientation_deg.to_radians());
        let mut columns = Columns { at_poses: Vec::new(), at_steps: Vec::new() };
        for j in 0..3 {
            columns.at_poses.push(at.iter().map(|s| turned.drift[s.step].column(j).into_owned()).collect());
            columns.at_steps.push(turned.drift.iter().map(|d| d.column(j).into_owned()).collect());
        }
        columns.at_poses.push(turned.rate_in_world.iter().map(|w| -w).collect());
        columns.at_steps.push(vec![Vector3::zeros(); grid.n]);
        let found = columns
            .fit(&axis, &turned.difference, &[GYRO_BIAS_SD, GYRO_BIAS_SD, GYRO_BIAS_SD, free])
            .ok_or_else(|| too_few(base, rows.len()))?;
        out.bias += found.value.fixed_rows::<3>(0);
        out.offset += found.value[3];
        let ratio = found.mean_square.sqrt();
        report.orientation_ratio = Some(ratio);
        out.offset_sd = found.covariance[(3, 3)].sqrt() * ratio.max(1.0);
        if round == 2 {
            if ratio > 30.0 {
                return Err(RobotError::log(
                    &base.file,
                    format!(
                        "its rotation contradicts the gyroscope of {}: {ratio:.0} times the stated noise",
                        input.log.file
                    ),
                    "check the order of the quaternion (qw, qx, qy, qz: base to world), the axes of the gyroscope and its unit",
                ));
            }
            out.sd = deviations(&axis, &columns, &found);
        }
    }
    let (_, at) = samples(grid, base, out.offset);
    if at.len() < 20 {
        return Err(too_few(base, at.len()));
    }
    Ok(out)
}

/// Position of the base, with bias of the accelerometer, its delay against the gyroscope, and the
/// size of what it misses between its samples. The offset of the clocks is left as the orientation
/// gave it: forces that a drive holds from step to step act later than they are sampled, which
/// moves the path as an offset would.
fn position(
    input: &FuseInput<'_>,
    grid: &Grid,
    sensors: &Sensors<'_>,
    gyro: &[Vector3<f64>],
    acc: &[Vector3<f64>],
    known: &Orientation,
    report: &mut FusionReport,
) -> Result<(Path, Vector3<f64>), RobotError> {
    let (noise, base, dt) = (&input.noise, sensors.base, grid.dt_s);
    let lever = input.imu.map_or_else(Vector3::zeros, |i| Vector3::from(i.position_m));
    let gravity = input.model.gravity_mps2;
    let (rows, at) = samples(grid, base, known.offset);
    let turned = Turned::of(gyro, &known.bias, dt, base, &rows, &at);
    let axis = turned.axis(gyro, grid, &at, noise.gyro_rad_s, noise.orientation_deg.to_radians());
    let rotation = turned.smoothed(&axis);
    let rate: Vec<Vector3<f64>> = gyro.iter().map(|g| g - known.bias).collect();
    let (mut acc_bias, mut delay, mut between) = (Vector3::zeros(), 0.0, 0.0);
    let mut last: Option<Constants> = None;
    for round in 0..4 {
        let now = shifted(acc, delay / dt);
        let force: Vec<Vector3<f64>> = rotation.iter().zip(&now).map(|(r, a)| r * (a - acc_bias) + gravity).collect();
        let moved = Moved::of(&force, &rotation, &rate, dt, base, &rows, &at, &lever);
        let filter = |between: f64| {
            let variance = input_variance(&force, noise.acc_m_s2, between, grid);
            Axis::drifting(dt, variance, at.clone(), noise.position_m.powi(2), 100.0, 1e4)
        };
        let mut drifting = filter(between);
        // the path that follows the poses: its velocity is free of the accelerometer's accumulated
        // noise, with which the differences would be correlated
        let correction: Vec<Vec<nalgebra::Vector2<f64>>> = (0..3)
            .map(|k| drifting.smooth_states(&moved.difference.iter().map(|d| d[k]).collect::<Vec<_>>()))
            .collect();
        let speed: Vec<Vector3<f64>> = (0..grid.n)
            .map(|i| moved.speed[i] + Vector3::new(correction[0][i][1], correction[1][i][1], correction[2][i][1]))
            .collect();
        let columns = position_columns(&rotation, &rate, &force, &gravity, &speed, dt, &at);
        if let (3, Some(found)) = (round, &last) {
            // poses that are off in time move the base along its way, wrong orientations the lever
            let mut position_sd = deviations(&drifting, &columns, found);
            for (i, p) in position_sd.iter_mut().enumerate() {
                let v = speed[i] - rotation[i] * rate[i].cross(&lever);
                let lever = known.sd[i].powi(2) * lever.norm_squared() * 2.0;
                *p = (*p * *p + (lever + (v * known.offset_sd).norm_squared()) / 3.0).sqrt();
            }
            let pose = (0..grid.n)
                .map(|i| {
                    let p = moved.path[i] + Vector3::new(correction[0][i][0], correction[1][i][0], correction[2][i][0]);
                    Isometry3::from_parts((p - rotation[i] * lever).into(), rotation[i])
                })
                .collect();
            state_constants(found, delay, dt, report);
            report.orientation_sd_rad = middle(known.sd.clone());
            report.position_sd_m = middle(position_sd.clone());
            report.acc_sd_m_s2 =
                input_variance(&force, noise.acc_m_s2, between, grid).iter().map(|v| v.sqrt()).collect();
            report.measured = at.iter().map(|s| (s.step, s.after_s)).collect();
            let valid = within_reach(grid, &at);
            return Ok((Path { pose, valid, orientation_sd: known.sd.clone(), position_sd }, acc_bias));
        }
        if round == 1 {
            // likelihood of the innovations: the acceleration between samples is as uncertain as
            // the poses show it
            let likely = |axis: &Axis| {
                columns
                    .fit(axis, &moved.difference, &POSITION_PRIOR)
                    .map_or(f64::INFINITY, |c| c.mean_square * (3 * at.len()) as f64 + 3.0 * axis.log_variance())
            };
            let mut best = likely(&drifting);
            for candidate in BETWEEN {
                let axis = filter(candidate);
                let value = likely(&axis);
                if value < best {
                    (best, between, drifting) = (value, candidate, axis);
                }
            }
        }
        let found =
            columns.fit(&drifting, &moved.difference, &POSITION_PRIOR).ok_or_else(|| too_few(base, rows.len()))?;
        acc_bias += found.value.fixed_rows::<3>(0);
        delay = (delay + found.value[3]).clamp(-MOST_DELAY_S, MOST_DELAY_S);
        last = Some(found);
    }
    Err(too_few(base, 0))
}

/// Derivatives of the inertial unit's path to bias and delay.
fn position_columns(
    rotation: &[UnitQuaternion<f64>],
    rate: &[Vector3<f64>],
    force: &[Vector3<f64>],
    gravity: &Vector3<f64>,
    speed: &[Vector3<f64>],
    dt: f64,
    at: &[Sample],
) -> Columns {
    let n = rotation.len();
    let mut columns = Columns { at_poses: Vec::new(), at_steps: Vec::new() };
    let mut add = |value: Vec<Vector3<f64>>, slope: &dyn Fn(usize) -> Vector3<f64>| {
        columns.at_poses.push(at.iter().map(|s| value[s.step] + slope(s.step) * s.after_s).collect());
        columns.at_steps.push(value);
    };
    // twice the integral of what the constant adds to the acceleration
    let integrated = |of: &dyn Fn(usize) -> Vector3<f64>| {
        let (mut p, mut v) = (Vector3::zeros(), Vector3::zeros());
        let mut out = (Vec::with_capacity(n), Vec::with_capacity(n));
        for i in 0..n {
            out.0.push(p);
            out.1.push(v);
            let a = of(i);
            p += v * dt + a * (0.5 * dt * dt);
            v += a * dt;
        }
        out
    };
    for j in 0..3 {
        let axes = [Vector3::x(), Vector3::y(), Vector3::z()];
        let (p, v) = integrated(&|i| -(rotation[i] * axes[j]));
        add(p, &|i| v[i]);
    }
    // a later accelerometer in turning axes: R ȧ = d(R a)/dt − ω × (R a); the first part gives the
    // velocity
    let (p, v) = integrated(&|i| (rotation[i] * rate[i]).cross(&(force[i] - gravity)));
    add((0..n).map(|i| speed[i] - p[i]).collect(), &|i| force[i] - v[i]);
    columns
}

/// Variance of the acceleration in each step: noise, and what integration between samples may miss.
fn input_variance(force: &[Vector3<f64>], acc_sd: f64, between: f64, grid: &Grid) -> Vec<f64> {
    let mut variance: Vec<f64> = (0..grid.n)
        .map(|i| {
            let bend = |i: usize| (force[i + 1] - force[i] * 2.0 + force[i - 1]).norm();
            let slope = |i: usize| 0.5 * (force[i + 1] - force[i - 1]).norm();
            let inside = i > 0 && i + 1 < grid.n;
            let (bend, slope) = if inside { (bend(i), slope(i)) } else { (0.0, 0.0) };
            acc_sd.powi(2) + (BETWEEN_SAMPLES * bend).powi(2) + (between * slope).powi(2)
        })
        .collect();
    grid.widen(&mut variance);
    variance
}

/// Writes delay and size of the innovations into the report.
fn state_constants(found: &Constants, delay: f64, dt: f64, report: &mut FusionReport) {
    let ratio = found.mean_square.sqrt();
    let delay_sd = found.covariance[(3, 3)].sqrt() * ratio.max(1.0);
    report.position_ratio = Some(ratio);
    report.acc_delay_s = Some(delay);
    if delay.abs() > dt && delay.abs() > 5.0 * delay_sd {
        report.warnings.push(format!(
            "the accelerometer is {:.1} ms {} the gyroscope; this is taken into account",
            delay.abs() * 1e3,
            if delay > 0.0 { "behind" } else { "ahead of" }
        ));
    }
}

fn middle(mut values: Vec<f64>) -> f64 {
    aloft_signal::median(&mut values)
}
