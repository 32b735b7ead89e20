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

use crate::combine::with_inertial_unit;
use crate::description::{Imu, SensorNoise};
use crate::impact::impacts;
use crate::log::{BaseLog, RobotLog};
use crate::resample::{Grid, encoder_sd};
use crate::smoother::Sample;
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
    /// Standard deviation of the acceleration in every step of the motion, m/s²: noise, and what
    /// the accelerometer misses between its samples. Empty without an inertial unit.
    #[serde(default)]
    pub acc_sd_m_s2: Vec<f64>,
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
    /// Rows of the log up to this far apart are interpolated, with the error of the interpolation
    /// in the noise, s.
    pub bridged_s: f64,
}

/// Poses further than this from the motion's rows do not count as measuring them, s.
const REACH_S: f64 = 0.1;

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
    let mut grid = Grid::of(log, input.bridged_s)?;
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
pub(crate) struct Path {
    pub(crate) pose: Vec<Isometry3<f64>>,
    pub(crate) valid: Vec<bool>,
    pub(crate) orientation_sd: Vec<f64>,
    pub(crate) position_sd: Vec<f64>,
}

pub(crate) struct Sensors<'a> {
    pub(crate) gyro: &'a [Vector3<f64>],
    pub(crate) acc: &'a [Vector3<f64>],
    pub(crate) base: &'a BaseLog,
    pub(crate) own_clock: bool,
    pub(crate) start_offset: f64,
}

/// Rows of the base that fall on the grid for an offset, with their samples.
pub(crate) fn samples(grid: &Grid, base: &BaseLog, offset_s: f64) -> (Vec<usize>, Vec<Sample>) {
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

pub(crate) fn too_few(base: &BaseLog, found: usize) -> RobotError {
    RobotError::log(
        &base.file,
        format!("{found} poses fall into the time of the log, expected 20 at least"),
        "both recordings must be of the same motion, with clocks that differ by a constant",
    )
}

/// Steps with a pose before and after within reach.
pub(crate) fn within_reach(grid: &Grid, at: &[Sample]) -> Vec<bool> {
    let reach = (REACH_S / grid.dt_s).ceil() as usize;
    let mut near = vec![false; grid.n];
    for pair in at.windows(2) {
        if pair[1].step - pair[0].step <= 2 * reach {
            near[pair[0].step..=pair[1].step + 1].fill(true);
        }
    }
    near.iter().zip(&grid.usable).map(|(a, b)| *a && *b).collect()
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
    let pose: Vec<Isometry3<f64>> = (0..grid.n)
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
    let mut valid = within_reach(grid, &at);
    let positions: Vec<Vector3<f64>> = rows.iter().map(|&row| base.position_m[row]).collect();
    let hit = impacts(&times, &positions);
    if let Some(first) = hit.first() {
        report.warnings.push(format!(
            "{} poses fall within impacts, the first at {:.3} s: they are left out, and the motion before and after each impact is smoothed separately",
            hit.len(),
            times[*first]
        ));
    }
    for k in hit {
        // the steps next to the pose
        let (from, to) = (at[k].step.max(1) - 1, (at[k].step + 1).min(grid.n - 1));
        let near = |i: &usize| (*i as f64 * grid.dt_s - times[k]).abs() < 0.75 * grid.dt_s;
        (from..=to).filter(near).for_each(|i| valid[i] = false);
    }
    report.measured = at.iter().map(|s| (s.step, s.after_s)).collect();
    report.orientation_sd_rad = input.noise.orientation_deg.to_radians();
    report.position_sd_m = input.noise.position_m;
    Ok(Path {
        pose,
        valid,
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
        for ((link, s), bridge) in joints.iter().zip(&report.encoder_sd).zip(&grid.q_sd) {
            sd[link.joint.v_offset] = s.hypot(bridge[i]);
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
