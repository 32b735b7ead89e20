//! The base's orientation and path as the inertial unit alone gives them, compared with the poses:
//! what the smoothers correct, and how it depends on biases.

use crate::log::BaseLog;
use crate::resample::Grid;
use crate::smoother::{Axis, Sample};
use nalgebra::{UnitQuaternion, Vector3};

/// Share of the bend of a signal over two steps by which integration between samples may be wrong.
pub(crate) const BETWEEN_SAMPLES: f64 = 0.1;

/// A series of samples at times that are `steps` later, by linear interpolation.
pub(crate) fn shifted(values: &[Vector3<f64>], steps: f64) -> Vec<Vector3<f64>> {
    let last = values.len() - 1;
    (0..values.len())
        .map(|i| {
            let at = (i as f64 + steps).clamp(0.0, last as f64);
            let before = (at as usize).min(last.saturating_sub(1));
            values[before].lerp(&values[(before + 1).min(last)], at - before as f64)
        })
        .collect()
}

/// The base's orientation as the gyroscope gives it, compared with the poses.
pub(crate) struct Turned {
    pub(crate) rotation: Vec<UnitQuaternion<f64>>,
    /// Rotation from the gyroscope's orientation to the pose's, world axes, rad.
    pub(crate) difference: Vec<Vector3<f64>>,
    /// Derivative of the orientation error to the bias, at every step.
    pub(crate) drift: Vec<nalgebra::Matrix3<f64>>,
    /// Angular velocity at the poses, world axes.
    pub(crate) rate_in_world: Vec<Vector3<f64>>,
}

impl Turned {
    pub(crate) fn of(
        gyro: &[Vector3<f64>],
        bias: &Vector3<f64>,
        dt: f64,
        base: &BaseLog,
        rows: &[usize],
        at: &[Sample],
    ) -> Self {
        let n = gyro.len();
        let rate = |i: usize| 0.5 * (gyro[i] + gyro[(i + 1).min(n - 1)]) - bias;
        let mut rotation = Vec::with_capacity(n);
        let mut drift_at = Vec::with_capacity(n);
        let (mut r, mut drift) = (UnitQuaternion::identity(), nalgebra::Matrix3::zeros());
        for i in 0..n {
            rotation.push(r);
            drift_at.push(drift);
            drift -= r.to_rotation_matrix().into_inner() * dt;
            r *= UnitQuaternion::from_scaled_axis(rate(i) * dt);
        }
        let here = |s: &Sample| rotation[s.step] * UnitQuaternion::from_scaled_axis(rate(s.step) * s.after_s);
        // one constant rotation puts the start into the world; what remains is small
        let middle = at.len() / 2;
        let align = base.rotation[rows[middle]] * here(&at[middle]).inverse();
        let centre = drift_at[at[middle].step];
        let mut out =
            Self { rotation: Vec::new(), difference: Vec::new(), drift: Vec::new(), rate_in_world: Vec::new() };
        for (row, s) in rows.iter().zip(at) {
            let modelled = align * here(s);
            out.difference.push((base.rotation[*row] * modelled.inverse()).scaled_axis());
            out.rate_in_world.push(modelled * rate(s.step));
        }
        let into_world = align.to_rotation_matrix().into_inner();
        out.drift = drift_at.iter().map(|d| into_world * (d - centre)).collect();
        out.rotation = rotation.into_iter().map(|r| align * r).collect();
        out
    }

    pub(crate) fn axis(&self, gyro: &[Vector3<f64>], grid: &Grid, at: &[Sample], gyro_sd: f64, pose_sd: f64) -> Axis {
        let bend = |i: usize| (gyro[i + 1] - gyro[i] * 2.0 + gyro[i - 1]).norm();
        let mut variance: Vec<f64> = (0..gyro.len())
            .map(|i| {
                let change = if i > 0 && i + 1 < gyro.len() { bend(i) } else { 0.0 };
                (gyro_sd.powi(2) + (BETWEEN_SAMPLES * change).powi(2)) * grid.dt_s.powi(2)
            })
            .collect();
        grid.widen(&mut variance);
        Axis::walk(grid.dt_s, variance, at.to_vec(), pose_sd * pose_sd, 1.0)
    }

    pub(crate) fn smoothed(&self, axis: &Axis) -> Vec<UnitQuaternion<f64>> {
        let by_axis: Vec<Vec<f64>> =
            (0..3).map(|k| axis.smooth(&self.difference.iter().map(|d| d[k]).collect::<Vec<_>>())).collect();
        self.rotation
            .iter()
            .enumerate()
            .map(|(i, r)| {
                UnitQuaternion::from_scaled_axis(Vector3::new(by_axis[0][i], by_axis[1][i], by_axis[2][i])) * r
            })
            .collect()
    }
}

/// The inertial unit's path as the accelerometer gives it, compared with the poses.
pub(crate) struct Moved {
    pub(crate) path: Vec<Vector3<f64>>,
    pub(crate) difference: Vec<Vector3<f64>>,
    /// Its velocity at every step.
    pub(crate) speed: Vec<Vector3<f64>>,
}

impl Moved {
    pub(crate) fn of(
        force: &[Vector3<f64>],
        rotation: &[UnitQuaternion<f64>],
        gyro: &[Vector3<f64>],
        dt: f64,
        base: &BaseLog,
        rows: &[usize],
        at: &[Sample],
        lever: &Vector3<f64>,
    ) -> Self {
        let n = force.len();
        let pose = |row: usize, s: &Sample| {
            let turn = UnitQuaternion::from_scaled_axis(gyro[s.step] * s.after_s);
            base.position_m[row] + rotation[s.step] * (turn * lever)
        };
        // start near the truth, so that the numbers stay small
        let (first, last) = (0, at.len() - 1);
        let span = ((at[last].step - at[first].step) as f64 * dt).max(dt);
        let mean = (pose(rows[last], &at[last]) - pose(rows[first], &at[first])) / span;
        let mut fall = Vector3::zeros();
        let mut reach = Vector3::zeros();
        for i in at[first].step..at[last].step {
            reach += fall * dt + (force[i] * 2.0 + force[i + 1]) * (dt * dt / 6.0);
            fall += (force[i] + force[i + 1]) * (0.5 * dt);
        }
        let mut v = mean - reach / span;
        let mut p = pose(rows[first], &at[first]) - v * (at[first].step as f64 * dt);
        let (mut path, mut speed) = (Vec::with_capacity(n), Vec::with_capacity(n));
        for i in 0..n {
            path.push(p);
            speed.push(v);
            let next = force[(i + 1).min(n - 1)];
            p += v * dt + (force[i] * 2.0 + next) * (dt * dt / 6.0);
            v += (force[i] + next) * (0.5 * dt);
        }
        let mut out = Self { path, difference: Vec::new(), speed };
        for (row, s) in rows.iter().zip(at) {
            let t = s.after_s;
            let here = out.path[s.step] + out.speed[s.step] * t + force[s.step] * (0.5 * t * t);
            out.difference.push(pose(*row, s) - here);
        }
        out
    }
}
