//! Kalman smoothers of one axis, and regression with their errors: the arithmetic behind
//! [`crate::fuse`].
//!
//! A state follows a random walk (orientation) or an integrated one (position), driven by inputs
//! already subtracted; measurements of it are taken at some samples. Constants that the inputs and
//! measurements depend on linearly (biases, the offset of clocks) are estimated exactly: the same
//! filter is run over the data and over each constant's sensitivity, and the innovations, which are
//! white, are regressed on one another.

use nalgebra::{DMatrix, DVector, Matrix2, RowVector2, Vector2};
use std::sync::OnceLock;

/// When the state is measured.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sample {
    /// Step of the grid at or before the measurement.
    pub step: usize,
    /// Time after that step, s.
    pub after_s: f64,
}

/// A filter of one axis with two states, value and rate. With `rate_noise` the rate is driven by
/// white noise; without it the value alone is.
#[derive(Debug, Clone)]
pub struct Axis {
    dt_s: f64,
    /// Variance of the input in every step: of the rate's change where the state has a rate,
    /// otherwise of the value's change.
    step_variance: Vec<f64>,
    has_rate: bool,
    measured: Vec<Sample>,
    variance: f64,
    #[cfg(test)]
    initial: Matrix2<f64>,
    /// Gain and variance of each innovation, once for all series: they do not depend on values.
    gains: Vec<(Vector2<f64>, f64)>,
    /// Variances before and after each step's measurements.
    forward: Vec<(Matrix2<f64>, Matrix2<f64>)>,
    backward: OnceLock<Vec<Matrix2<f64>>>,
}

impl Axis {
    /// A random walk: the value changes by white noise of `step_variance[i]` in each step.
    pub fn walk(dt_s: f64, step_variance: Vec<f64>, measured: Vec<Sample>, variance: f64, start_variance: f64) -> Self {
        let initial = Matrix2::new(start_variance, 0.0, 0.0, 0.0);
        Self::new(dt_s, step_variance, false, measured, variance, initial)
    }

    /// An integrated random walk: the rate's derivative has variance `step_variance[i]` in each
    /// step.
    pub fn drifting(
        dt_s: f64,
        step_variance: Vec<f64>,
        measured: Vec<Sample>,
        variance: f64,
        start_variance: f64,
        start_rate_variance: f64,
    ) -> Self {
        let initial = Matrix2::new(start_variance, 0.0, 0.0, start_rate_variance);
        Self::new(dt_s, step_variance, true, measured, variance, initial)
    }

    fn new(
        dt_s: f64,
        step_variance: Vec<f64>,
        has_rate: bool,
        measured: Vec<Sample>,
        variance: f64,
        initial: Matrix2<f64>,
    ) -> Self {
        let mut axis = Self {
            dt_s,
            step_variance,
            has_rate,
            measured,
            variance,
            #[cfg(test)]
            initial,
            gains: Vec::new(),
            forward: Vec::new(),
            backward: OnceLock::new(),
        };
        let (f, mut p) = (axis.transition(), initial);
        let mut k = 0;
        for i in 0..axis.step_variance.len() {
            if i > 0 {
                p = f * p * f.transpose() + axis.noise(i - 1);
            }
            let before = p;
            while let Some(sample) = axis.measured.get(k).filter(|s| s.step == i) {
                let h = axis.row(sample);
                let s = (h * p * h.transpose())[0] + axis.variance;
                let gain = p * h.transpose() / s;
                p -= gain * h * p;
                p = (p + p.transpose()) * 0.5;
                axis.gains.push((gain, s));
                k += 1;
            }
            axis.forward.push((before, p));
        }
        axis
    }

    /// Sum of the logarithms of the innovations' variances: with their mean square it makes their
    /// likelihood.
    pub fn log_variance(&self) -> f64 {
        self.gains.iter().map(|g| g.1.ln()).sum()
    }

    fn transition(&self) -> Matrix2<f64> {
        if self.has_rate { Matrix2::new(1.0, self.dt_s, 0.0, 1.0) } else { Matrix2::identity() }
    }

    fn noise(&self, step: usize) -> Matrix2<f64> {
        let v = self.step_variance[step];
        if self.has_rate {
            let g = Vector2::new(0.5 * self.dt_s * self.dt_s, self.dt_s);
            g * g.transpose() * v
        } else {
            Matrix2::new(v, 0.0, 0.0, 0.0)
        }
    }

    fn row(&self, sample: &Sample) -> RowVector2<f64> {
        RowVector2::new(1.0, if self.has_rate { sample.after_s } else { 0.0 })
    }

    /// Innovations of a series of measurements, divided by their standard deviations, so that white
    /// noise of the stated size gives unit variance.
    pub fn innovations(&self, values: &[f64]) -> Vec<f64> {
        let f = self.transition();
        let mut x = Vector2::zeros();
        let mut step = 0;
        let mut out = Vec::with_capacity(values.len());
        for ((sample, (gain, s)), value) in self.measured.iter().zip(&self.gains).zip(values) {
            while step < sample.step {
                x = f * x;
                step += 1;
            }
            let e = value - (self.row(sample) * x)[0];
            x += gain * e;
            out.push(e / s.sqrt());
        }
        out
    }

    /// The state's value at every step, from all measurements.
    pub fn smooth(&self, values: &[f64]) -> Vec<f64> {
        self.smooth_states(values).iter().map(|x| x[0]).collect()
    }

    /// The state's value and rate at every step, from all measurements.
    pub fn smooth_states(&self, values: &[f64]) -> Vec<Vector2<f64>> {
        let f = self.transition();
        let n = self.forward.len();
        let mut states = Vec::with_capacity(n);
        let mut x = Vector2::zeros();
        let mut k = 0;
        for i in 0..n {
            if i > 0 {
                x = f * x;
            }
            while let Some(sample) = self.measured.get(k).filter(|s| s.step == i) {
                x += self.gains[k].0 * (values[k] - (self.row(sample) * x)[0]);
                k += 1;
            }
            states.push(x);
        }
        let backward = self.backward();
        for i in (0..n.saturating_sub(1)).rev() {
            let gain = backward[i];
            let ahead = states[i + 1] - f * states[i];
            states[i] += gain * ahead;
        }
        states
    }

    /// The smoother's gain at every step but the last, made once for all series.
    fn backward(&self) -> &[Matrix2<f64>] {
        self.backward.get_or_init(|| (0..self.forward.len().saturating_sub(1)).map(|i| self.smoother_gain(i)).collect())
    }

    fn smoother_gain(&self, i: usize) -> Matrix2<f64> {
        let f = self.transition();
        let ahead = self.forward[i + 1].0;
        if self.has_rate {
            let inverse = ahead.try_inverse().unwrap_or_else(Matrix2::zeros);
            self.forward[i].1 * f.transpose() * inverse
        } else {
            Matrix2::new(self.forward[i].1[(0, 0)] / ahead[(0, 0)].max(f64::MIN_POSITIVE), 0.0, 0.0, 0.0)
        }
    }

    /// Standard deviation of the smoothed value at every step.
    pub fn smoothed_sd(&self) -> Vec<f64> {
        let n = self.forward.len();
        let mut out = vec![0.0; n];
        let Some(last) = self.forward.last() else { return out };
        let mut p = last.1;
        out[n - 1] = p[(0, 0)].max(0.0).sqrt();
        let backward = self.backward();
        for i in (0..n - 1).rev() {
            let gain = backward[i];
            p = self.forward[i].1 + gain * (p - self.forward[i + 1].0) * gain.transpose();
            out[i] = p[(0, 0)].max(0.0).sqrt();
        }
        out
    }
}

/// Constants from the whitened innovations of data and of sensitivities, with Gaussian priors about
/// zero.
#[derive(Debug, Clone, PartialEq)]
pub struct Constants {
    /// Estimates.
    pub value: DVector<f64>,
    /// Covariance for errors of the stated size.
    pub covariance: DMatrix<f64>,
    /// Mean square of the innovations that remain: 1 where noise has the stated size.
    pub mean_square: f64,
}

/// Regresses `data = Σ_j constant_j sensitivity_j + white noise`; `prior_sd` are standard
/// deviations about zero.
pub fn constants(data: &[f64], sensitivity: &[Vec<f64>], prior_sd: &[f64]) -> Option<Constants> {
    let n = sensitivity.len();
    let mut normal = DMatrix::from_diagonal(&DVector::from_iterator(n, prior_sd.iter().map(|s| s.powi(-2))));
    let mut right = DVector::zeros(n);
    for i in 0..n {
        for j in 0..=i {
            let dot: f64 = sensitivity[i].iter().zip(&sensitivity[j]).map(|(a, b)| a * b).sum();
            normal[(i, j)] += dot;
            if i != j {
                normal[(j, i)] += dot;
            }
        }
        right[i] = sensitivity[i].iter().zip(data).map(|(a, b)| a * b).sum();
    }
    // scaled to a unit diagonal: biases and offsets differ by orders of magnitude
    let scale = DVector::from_iterator(n, normal.diagonal().iter().map(|d| d.max(f64::MIN_POSITIVE).sqrt().recip()));
    let scaled = DMatrix::from_fn(n, n, |i, j| normal[(i, j)] * scale[i] * scale[j]);
    let inverse = scaled.cholesky()?.inverse();
    let covariance = DMatrix::from_fn(n, n, |i, j| inverse[(i, j)] * scale[i] * scale[j]);
    let value = &covariance * right;
    let rest: f64 = (0..data.len())
        .map(|k| {
            let fitted: f64 = sensitivity.iter().zip(value.iter()).map(|(s, v)| s[k] * v).sum();
            (data[k] - fitted).powi(2)
        })
        .sum();
    Some(Constants { value, covariance, mean_square: rest / data.len().max(1) as f64 })
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used, reason = "tests fail by panicking")]
    use super::*;
    use rand::SeedableRng;
    use rand_chacha::ChaCha8Rng;
    use rand_distr::{Distribution, StandardNormal};

    fn dense(axis: &Axis, n: usize, values: &[f64]) -> (Vec<f64>, Vec<f64>) {
        // the whole problem as one least-squares solution over all states
        let mut normal = DMatrix::<f64>::zeros(2 * n, 2 * n);
        let mut right = DVector::<f64>::zeros(2 * n);
        let eps = 1e-14;
        let regular = |m: Matrix2<f64>| (m + Matrix2::identity() * eps).try_inverse().unwrap();
        let first = regular(axis.initial);
        normal.view_mut((0, 0), (2, 2)).copy_from(&first);
        let f = axis.transition();
        for i in 0..n - 1 {
            let w = regular(axis.noise(i));
            let mut view = normal.view_mut((2 * i, 2 * i), (4, 4));
            let mut a = nalgebra::Matrix2x4::zeros();
            a.fixed_view_mut::<2, 2>(0, 0).copy_from(&-f);
            a.fixed_view_mut::<2, 2>(0, 2).copy_from(&Matrix2::identity());
            view += a.transpose() * w * a;
        }
        for (sample, value) in axis.measured.iter().zip(values) {
            let h = axis.row(sample);
            let mut view = normal.view_mut((2 * sample.step, 2 * sample.step), (2, 2));
            view += h.transpose() * h / axis.variance;
            for k in 0..2 {
                right[2 * sample.step + k] += h[k] * value / axis.variance;
            }
        }
        let covariance = normal.try_inverse().unwrap();
        let x = &covariance * right;
        ((0..n).map(|i| x[2 * i]).collect(), (0..n).map(|i| covariance[(2 * i, 2 * i)].sqrt()).collect())
    }

    #[test]
    fn the_smoother_is_the_least_squares_solution() {
        let n = 40;
        let measured: Vec<Sample> = (0..16).map(|k| Sample { step: (k * 5) / 2, after_s: 0.003 }).collect();
        let mut rng = ChaCha8Rng::seed_from_u64(3);
        let values: Vec<f64> = measured.iter().map(|_| StandardNormal.sample(&mut rng)).collect();
        let axis = Axis::drifting(0.02, vec![4.0; n], measured.clone(), 0.01, 1.0, 1.0);
        let (expected, sd) = dense(&axis, n, &values);
        for (i, (found, found_sd)) in axis.smooth(&values).iter().zip(axis.smoothed_sd()).enumerate() {
            assert!((found - expected[i]).abs() < 1e-4, "step {i}: {found} {}", expected[i]);
            assert!((found_sd - sd[i]).abs() < 1e-4 * sd[i].max(0.1), "step {i}: {found_sd} {}", sd[i]);
        }
    }

    #[test]
    fn constants_are_found_with_honest_intervals() {
        // a walk with a constant drift and an offset of every second measurement
        let (n, dt) = (400, 0.01);
        let measured: Vec<Sample> = (0..n).map(|step| Sample { step, after_s: 0.0 }).collect();
        let drift: Vec<f64> = (0..n).map(|i| i as f64 * dt).collect();
        let step: Vec<f64> = (0..n).map(|i| (i % 2) as f64).collect();
        let axis = Axis::walk(dt, vec![1e-4; n], measured, 0.04, 100.0);
        let (mut inside, mut white) = (0, 0.0);
        for seed in 0..200 {
            let mut rng = ChaCha8Rng::seed_from_u64(seed);
            let mut normal = || -> f64 { StandardNormal.sample(&mut rng) };
            let mut walk = 0.0;
            let data: Vec<f64> = (0..n)
                .map(|i| {
                    walk += 0.01 * normal();
                    walk + 0.5 * drift[i] - 0.3 * step[i] + 0.2 * normal()
                })
                .collect();
            let columns = [axis.innovations(&drift), axis.innovations(&step)];
            let found = constants(&axis.innovations(&data), &columns, &[10.0, 10.0]).unwrap();
            for (k, truth) in [0.5, -0.3].iter().enumerate() {
                inside += usize::from((found.value[k] - truth).abs() < 1.96 * found.covariance[(k, k)].sqrt());
            }
            white += found.mean_square / 200.0;
        }
        assert!((366..=392).contains(&inside), "{inside} of 400");
        assert!((white - 1.0).abs() < 0.02, "{white}");
    }
}
