//! Errors of a fused motion, drawn from the sensors' noise: what a comparison's floor is made of.
//!
//! Noise of the gyroscope, the accelerometer and the poses passes through the same smoothers that
//! made the motion, so that the errors have its spectrum; encoders have white errors of their step.
//! An error of the clocks' offset moves the base along its way against the joints.

use crate::fuse::FusionReport;
use crate::smoother::{Axis, Sample};
use aloft_body::Motion;
use nalgebra::{Quaternion, UnitQuaternion, Vector3};
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};

/// Draws errors of one recording.
#[derive(Debug, Clone)]
pub struct SensorErrors {
    report: FusionReport,
    orientation: Axis,
    position: Axis,
    samples: Vec<Sample>,
    dt_s: f64,
    inertial: bool,
}

impl SensorErrors {
    /// From the report of a recording and the rate of its motion.
    pub fn new(report: FusionReport, rate_hz: f64) -> Self {
        let dt_s = 1.0 / rate_hz;
        let samples: Vec<Sample> = report.measured.iter().map(|&(step, after_s)| Sample { step, after_s }).collect();
        let (n, noise) = (report.frames, report.noise);
        let acc_sd = |i: usize| report.acc_sd_m_s2.get(i).copied().unwrap_or(noise.acc_m_s2);
        let orientation = Axis::walk(
            dt_s,
            vec![(noise.gyro_rad_s * dt_s).powi(2); n],
            samples.clone(),
            noise.orientation_deg.to_radians().powi(2),
            1.0,
        );
        let position = Axis::drifting(
            dt_s,
            (0..n).map(|i| acc_sd(i).powi(2)).collect(),
            samples.clone(),
            noise.position_m.powi(2),
            100.0,
            1e4,
        );
        let inertial = report.gyro_bias_rad_s.is_some();
        Self { report, orientation, position, samples, dt_s, inertial }
    }

    /// The motion with one draw of errors, in the frames for which `wanted` holds; only coordinates
    /// are filled, all others are NaN.
    pub fn draw(&self, motion: &Motion, wanted: &dyn Fn(usize) -> bool, seed: u64, draw: u64) -> Motion {
        self.draw_times(1.0, motion, wanted, seed, draw)
    }

    /// The motion with the errors of one draw added and subtracted, in all its frames. They depend
    /// on where the recording begins and on its length, not on its name.
    pub fn pair(&self, motion: &Motion, seed: u64, draw: u64) -> [Motion; 2] {
        let n = motion.n_frames();
        let begins: Vec<i64> =
            (0..n).find(|i| motion.is_valid(*i)).into_iter().flat_map(|i| motion.thousandths(i)).collect();
        let unnamed = Motion { trial: format!("{n} {begins:?}"), ..motion.clone() };
        [1.0, -1.0].map(|sign| {
            let drawn = self.draw_times(sign, &unnamed, &|_| true, seed, draw);
            Motion { trial: motion.trial.clone(), ..drawn }
        })
    }

    fn draw_times(&self, sign: f64, motion: &Motion, wanted: &dyn Fn(usize) -> bool, seed: u64, draw: u64) -> Motion {
        // another stream for every recording: its sensors' noise is its own
        let mut rng = ChaCha8Rng::seed_from_u64(of_recording(&motion.trial, seed));
        rng.set_stream(draw);
        let mut normal = || -> f64 {
            let x: f64 = StandardNormal.sample(&mut rng);
            sign * x
        };
        let n = motion.n_frames();
        let errors: Vec<Vec<f64>> = (0..6).map(|k| self.path(n, k < 3, &mut normal)).collect();
        // by how much a wrong offset of the clocks moves the base in each frame: a part of the way
        // to the next
        let late = self.report.clock_offset_sd_s.unwrap_or(0.0) * normal() / self.dt_s;
        let joints = motion.nq.saturating_sub(7);
        let mut q = vec![f64::NAN; motion.q.len()];
        for i in 0..n {
            let encoder: Vec<f64> =
                (0..joints).map(|j| self.report.encoder_sd.get(j).unwrap_or(&0.0) * normal()).collect();
            if !wanted(i) || !motion.is_valid(i) {
                continue;
            }
            let (from, to) = (motion.q(i), &mut q[i * motion.nq..(i + 1) * motion.nq]);
            to.copy_from_slice(from);
            let turn = |q: &[f64]| UnitQuaternion::from_quaternion(Quaternion::new(q[6], q[3], q[4], q[5]));
            let r = turn(from);
            let mut way = Vector3::zeros();
            let mut turned = Vector3::new(errors[3][i], errors[4][i], errors[5][i]);
            if i + 1 < n && motion.is_valid(i + 1) {
                let next = motion.q(i + 1);
                way = Vector3::new(next[0] - from[0], next[1] - from[1], next[2] - from[2]) * late;
                turned += (turn(next) * r.inverse()).scaled_axis() * late;
            }
            for k in 0..3 {
                to[k] += errors[k][i] + way[k];
            }
            let turned = UnitQuaternion::from_scaled_axis(turned) * r;
            let sign = if turned.coords.dot(&r.coords) < 0.0 { -1.0 } else { 1.0 };
            to[3..7].copy_from_slice((turned.coords * sign).as_slice());
            for (value, e) in to[7..].iter_mut().zip(encoder) {
                *value += e;
            }
        }
        Motion {
            q,
            v: Vec::new(),
            a: Vec::new(),
            q_sd: Vec::new(),
            residual_m: Vec::new(),
            marker_labels: Vec::new(),
            ..motion.clone()
        }
    }

    /// Error of one axis over `n` frames: of the position or of the orientation.
    fn path(&self, n: usize, position: bool, normal: &mut dyn FnMut() -> f64) -> Vec<f64> {
        let noise = &self.report.noise;
        let pose_sd = if position { noise.position_m } else { noise.orientation_deg.to_radians() };
        if !self.inertial {
            return (0..n).map(|_| pose_sd * normal()).collect();
        }
        // the inertial unit's own error, then what the smoother makes of it
        let (mut value, mut rate) = (0.0, 0.0);
        let mut drifted = Vec::with_capacity(n);
        for i in 0..n {
            drifted.push((value, rate));
            if position {
                let a = self.report.acc_sd_m_s2.get(i).unwrap_or(&noise.acc_m_s2) * normal();
                value += rate * self.dt_s + 0.5 * a * self.dt_s * self.dt_s;
                rate += a * self.dt_s;
            } else {
                value += noise.gyro_rad_s * self.dt_s * normal();
            }
        }
        let measured: Vec<f64> = self
            .samples
            .iter()
            .map(|s| {
                let (value, rate) = drifted.get(s.step).copied().unwrap_or((0.0, 0.0));
                pose_sd * normal() - value - rate * s.after_s
            })
            .collect();
        let axis = if position { &self.position } else { &self.orientation };
        axis.smooth(&measured).iter().zip(&drifted).map(|(correction, d)| d.0 + correction).collect()
    }
}

/// Torques with one draw of white noise, `[joint][frame]`; `sd` is that of each joint. Every
/// recording has noise of its own.
pub fn noisy_torques(torques: &[Vec<f64>], sd: &[f64], trial: &str, seed: u64, draw: u64) -> Vec<Vec<f64>> {
    let mut rng = ChaCha8Rng::seed_from_u64(of_recording(trial, !seed));
    rng.set_stream(draw);
    let mut noisy = |values: &Vec<f64>, sd: f64| -> Vec<f64> {
        values
            .iter()
            .map(|t| {
                let e: f64 = StandardNormal.sample(&mut rng);
                t + sd * e
            })
            .collect()
    };
    torques.iter().zip(sd).map(|(values, sd)| noisy(values, *sd)).collect()
}

/// Variance of the fourth difference of white noise of variance 1.
const FOURTH_DIFFERENCE: f64 = 70.0;

/// Standard deviation of the white noise in pieces of a signal, from the median size of their
/// fourth differences, to which slow changes contribute nothing. It is an upper limit where the
/// signal itself changes from sample to sample. None for fewer than 50.
pub fn white_sd(pieces: &[Vec<f64>]) -> Option<f64> {
    const FEWEST: usize = 50;
    /// Median of the absolute value of a standard normal variable.
    const MEDIAN: f64 = 0.674_489_75;
    let fourth = |w: &[f64]| (w[0] - 4.0 * w[1] + 6.0 * w[2] - 4.0 * w[3] + w[4]).abs();
    let mut all: Vec<f64> = pieces.iter().flat_map(|p| p.windows(5).map(fourth)).filter(|d| d.is_finite()).collect();
    (all.len() >= FEWEST).then(|| aloft_signal::median(&mut all) / MEDIAN / FOURTH_DIFFERENCE.sqrt())
}

/// Another seed for every recording.
fn of_recording(trial: &str, seed: u64) -> u64 {
    trial.bytes().fold(seed, |h, b| h.wrapping_mul(0x100_0000_01b3) ^ u64::from(b))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::SensorNoise;

    #[test]
    fn drawn_errors_have_the_size_that_the_smoother_states() {
        let n = 3000;
        let noise = SensorNoise {
            position_m: 3e-4,
            orientation_deg: 0.05,
            gyro_rad_s: 0.004,
            acc_m_s2: 0.04,
            ..SensorNoise::default()
        };
        let report = FusionReport {
            frames: n,
            noise,
            gyro_bias_rad_s: Some([0.0; 3]),
            encoder_sd: vec![1e-5],
            measured: (0..n * 2 / 5).map(|k| (k * 5 / 2, 0.0)).collect(),
            ..FusionReport::default()
        };
        let errors = SensorErrors::new(report, 500.0);
        let mut q = Vec::new();
        for _ in 0..n {
            q.extend([0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.3]);
        }
        let motion = Motion { trial: "t".to_owned(), rate_hz: 500.0, nq: 8, nv: 7, q, ..Motion::default() };
        let (mut p, mut o, mut j) = (0.0, 0.0, 0.0);
        for draw in 0..8 {
            let drawn = errors.draw(&motion, &|_| true, 1, draw);
            for i in 500..2500 {
                let x = drawn.q(i);
                p += x[0] * x[0];
                o += 4.0 * x[3] * x[3];
                j += (x[7] - 0.3).powi(2);
            }
        }
        let rms = |s: f64| (s / 16_000.0).sqrt();
        let (stated_p, stated_o) = (errors.position.smoothed_sd()[1500], errors.orientation.smoothed_sd()[1500]);
        assert!((rms(p) / stated_p - 1.0).abs() < 0.25, "{} {stated_p}", rms(p));
        assert!((rms(o) / stated_o - 1.0).abs() < 0.35, "{} {stated_o}", rms(o));
        assert!((rms(j) / 1e-5 - 1.0).abs() < 0.05);
        assert_eq!(errors.draw(&motion, &|_| true, 1, 3).q, errors.draw(&motion, &|_| true, 1, 3).q);
    }

    #[test]
    fn white_noise_of_a_torque_is_found_beside_its_motion() {
        let slow: Vec<f64> = (0..2000).map(|i| 8.0 * (0.02 * f64::from(i)).sin()).collect();
        let noisy = noisy_torques(&[slow], &[0.1], "a", 3, 0);
        let found = white_sd(&noisy).unwrap_or(f64::NAN);
        assert!((found - 0.1).abs() < 0.01, "{found}");
        assert!(white_sd(&[vec![0.0; 20]]).is_none());
    }
}
