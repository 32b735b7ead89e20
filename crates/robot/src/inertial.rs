//! The base's orientation and path as the inertial unit alone gives them, compared with the poses:
//! what the smoothers correct, and how it depends on biases.

use crate::log::BaseLog;
use crate::resample::Grid;
use crate::smoother::{Axis, Sample};
use nalgebra::{UnitQuaternion, Vector3};

/// Share of the bend of a signal over two steps by which integration between samples may be wrong.
pub(crate) const BETWEEN_SAMPLES: f64 = 0.1;

/// Four samples around the step from `i` to `i + 1`, the ends repeated.
fn around(values: &[Vector3<f64>], i: usize) -> [Vector3<f64>; 4] {
    let last = values.len() - 1;
    [i.saturating_sub(1), i.min(last), (i + 1).min(last), (i + 2).min(last)].map(|k| values[k])
}

fn weighed(samples: &[Vector3<f64>; 4], weights: [f64; 4]) -> Vector3<f64> {
    samples.iter().zip(weights).map(|(s, w)| s * w).sum()
}

/// Mean over a step, from the cubic through four samples. With straight lines between samples (the
/// trapezoidal rule) a motion of angular frequency ω loses a share of `(ω dt)²/12`, which biases
/// first moments by as much.
fn mean_over(values: &[Vector3<f64>], i: usize) -> Vector3<f64> {
    weighed(&around(values, i), [-1.0 / 24.0, 13.0 / 24.0, 13.0 / 24.0, -1.0 / 24.0])
}

/// Twice integrated over a step, divided by its square, from the same cubic.
fn twice_over(values: &[Vector3<f64>], i: usize) -> Vector3<f64> {
    weighed(&around(values, i), [-1.0 / 45.0, 43.0 / 120.0, 11.0 / 60.0, -7.0 / 360.0])
}

/// A series of samples at times that are `steps` later, by the cubic through four samples.
pub(crate) fn shifted(values: &[Vector3<f64>], steps: f64) -> Vec<Vector3<f64>> {
    let last = values.len() - 1;
    (0..values.len())
        .map(|i| {
            let at = (i as f64 + steps).clamp(0.0, last as f64);
            let before = (at as usize).min(last.saturating_sub(1));
            let s = at - before as f64;
            let weights = [
                -s * (s - 1.0) * (s - 2.0) / 6.0,
                (s + 1.0) * (s - 1.0) * (s - 2.0) / 2.0,
                -(s + 1.0) * s * (s - 2.0) / 2.0,
                (s + 1.0) * s * (s - 1.0) / 6.0,
            ];
            weighed(&around(values, before), weights)
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
        let rate = |i: usize| gyro[i.min(n - 1)] - bias;
        // rotation over a step: the mean rate, and what turning axes add (Magnus expansion, second
        // order)
        let step = |i: usize| (mean_over(gyro, i) - bias) * dt + rate(i).cross(&rate(i + 1)) * (dt * dt / 12.0);
        // and over a part of it
        let part = |i: usize, t: f64| rate(i) * t + (rate(i + 1) - rate(i)) * (0.5 * t * t / dt);
        let mut rotation = Vec::with_capacity(n);
        let mut drift_at = Vec::with_capacity(n);
        let (mut r, mut drift) = (UnitQuaternion::identity(), nalgebra::Matrix3::zeros());
        for i in 0..n {
            rotation.push(r);
            drift_at.push(drift);
            drift -= r.to_rotation_matrix().into_inner() * dt;
            r *= UnitQuaternion::from_scaled_axis(step(i));
        }
        let here = |s: &Sample| rotation[s.step] * UnitQuaternion::from_scaled_axis(part(s.step, s.after_s));
        // one constant rotation puts the start into the world; what remains is small
        let middle = at.len() / 2;
        let align = base.rotation[rows[middle]] * here(&at[middle]).inverse();
        let centre = drift_at[at[middle].step];
        let mut out =
            Self { rotation: Vec::new(), difference: Vec::new(), drift: Vec::new(), rate_in_world: Vec::new() };
        for (row, s) in rows.iter().zip(at) {
            let modelled = align * here(s);
            out.difference.push((base.rotation[*row] * modelled.inverse()).scaled_axis());
            let share = s.after_s / dt;
            out.rate_in_world.push(modelled * rate(s.step).lerp(&rate(s.step + 1), share));
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
            let next = gyro[(s.step + 1).min(gyro.len() - 1)];
            let turn = gyro[s.step] * s.after_s + (next - gyro[s.step]) * (0.5 * s.after_s * s.after_s / dt);
            let turn = UnitQuaternion::from_scaled_axis(turn);
            base.position_m[row] + rotation[s.step] * (turn * lever)
        };
        // start near the truth, so that the numbers stay small
        let (first, last) = (0, at.len() - 1);
        let span = ((at[last].step - at[first].step) as f64 * dt).max(dt);
        let mean = (pose(rows[last], &at[last]) - pose(rows[first], &at[first])) / span;
        let mut fall = Vector3::zeros();
        let mut reach = Vector3::zeros();
        for i in at[first].step..at[last].step {
            reach += fall * dt + twice_over(force, i) * (dt * dt);
            fall += mean_over(force, i) * dt;
        }
        let mut v = mean - reach / span;
        let mut p = pose(rows[first], &at[first]) - v * (at[first].step as f64 * dt);
        let (mut path, mut speed) = (Vec::with_capacity(n), Vec::with_capacity(n));
        for i in 0..n {
            path.push(p);
            speed.push(v);
            p += v * dt + twice_over(force, i) * (dt * dt);
            v += mean_over(force, i) * dt;
        }
        let mut out = Self { path, difference: Vec::new(), speed };
        for (row, s) in rows.iter().zip(at) {
            let t = s.after_s;
            let slope = (force[(s.step + 1).min(n - 1)] - force[s.step]) / dt;
            let here =
                out.path[s.step] + out.speed[s.step] * t + force[s.step] * (0.5 * t * t) + slope * (t * t * t / 6.0);
            out.difference.push(pose(*row, s) - here);
        }
        out
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Straight lines between samples would lose 0.75 % of this motion.
    #[test]
    fn fast_motion_keeps_its_size_between_samples() {
        let (dt, omega) = (0.004, 75.0);
        let values: Vec<Vector3<f64>> = (0..800).map(|i| Vector3::x() * (omega * f64::from(i) * dt).cos()).collect();
        // the first and the last step have no neighbours
        let mut v = (omega * 2.0 * dt).sin() / omega;
        let (mut worst_v, mut worst_p) = (0.0f64, 0.0f64);
        for i in 2..797 {
            let (t, next) = (omega * f64::from(i) * dt, omega * f64::from(i + 1) * dt);
            worst_v = worst_v.max((v * omega - t.sin()).abs());
            v += mean_over(&values, i as usize).x * dt;
            let moved = t.sin() / omega * dt + twice_over(&values, i as usize).x * dt * dt;
            worst_p = worst_p.max((moved * omega * omega - (t.cos() - next.cos())).abs());
        }
        assert!(worst_v < 5e-4 && worst_p < 5e-5, "{worst_v} {worst_p}");
        let later = shifted(&values, 0.5);
        let error = (2..797).map(|i| (later[i].x - (omega * (i as f64 + 0.5) * dt).cos()).abs()).fold(0.0, f64::max);
        assert!(error < 3e-4, "{error}");
    }

    #[test]
    fn turning_axes_are_followed_by_the_gyroscope() {
        // a rotation whose axis moves: truth by small steps
        let rate = |t: f64| Vector3::new(6.0 * (20.0 * t).cos(), 5.0 * (27.0 * t).sin(), 4.0);
        let (dt, fine) = (0.004, 200);
        let mut truth = vec![UnitQuaternion::identity()];
        for i in 0..500 {
            let mut r = truth[i];
            for k in 0..fine {
                let t = (i as f64 + (k as f64 + 0.5) / fine as f64) * dt;
                r *= UnitQuaternion::from_scaled_axis(rate(t) * (dt / fine as f64));
            }
            truth.push(r);
        }
        let gyro: Vec<Vector3<f64>> = (0..=500).map(|i| rate(f64::from(i) * dt)).collect();
        let base = BaseLog {
            file: "base".to_owned(),
            time_s: (0..500).map(|i| f64::from(i) * dt).collect(),
            position_m: vec![Vector3::zeros(); 500],
            rotation: truth[..500].to_vec(),
        };
        let rows: Vec<usize> = (0..500).collect();
        let at: Vec<Sample> = rows.iter().map(|&step| Sample { step, after_s: 0.0 }).collect();
        let turned = Turned::of(&gyro, &Vector3::zeros(), dt, &base, &rows, &at);
        let worst = turned.difference.iter().map(Vector3::norm).fold(0.0, f64::max);
        assert!(worst < 3e-4, "{worst}");
    }
}
