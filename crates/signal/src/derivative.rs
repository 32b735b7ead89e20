//! Finite-difference derivatives of fourth order.
//!
//! Applied after the filter to obtain joint velocities and accelerations.

use crate::runs::finite_runs;

/// Minimum number of samples in a run with derivatives: required by the one-sided second derivative
/// of fourth order.
pub const SHORTEST_RUN: usize = 6;

// Weights on consecutive samples; row i is the derivative at sample i of the stencil. From the
// Lagrange interpolant through the samples.
const FIRST: [[f64; 5]; 3] = [
    [-25.0 / 12.0, 4.0, -3.0, 4.0 / 3.0, -0.25],
    [-0.25, -5.0 / 6.0, 1.5, -0.5, 1.0 / 12.0],
    [1.0 / 12.0, -2.0 / 3.0, 0.0, 2.0 / 3.0, -1.0 / 12.0],
];
const SECOND: [[f64; 6]; 3] = [
    [15.0 / 4.0, -77.0 / 6.0, 107.0 / 6.0, -13.0, 61.0 / 12.0, -5.0 / 6.0],
    [5.0 / 6.0, -1.25, -1.0 / 3.0, 7.0 / 6.0, -0.5, 1.0 / 12.0],
    [-1.0 / 12.0, 4.0 / 3.0, -2.5, 4.0 / 3.0, -1.0 / 12.0, 0.0],
];

/// First and second derivative by fourth-order central differences (one-sided of the same order at
/// the ends of every NaN-free run).
///
/// Both have the length of `signal`, in units per second and per second squared; missing samples,
/// and runs shorter than [`SHORTEST_RUN`], give NaN.
pub fn derivatives(signal: &[f64], rate_hz: f64) -> (Vec<f64>, Vec<f64>) {
    let mut first = vec![f64::NAN; signal.len()];
    let mut second = vec![f64::NAN; signal.len()];
    for run in finite_runs(signal) {
        if run.len() >= SHORTEST_RUN {
            derivatives_of_run(&signal[run.clone()], 1, 0, rate_hz, &mut first[run.clone()], &mut second[run]);
        }
    }
    (first, second)
}

/// Derivatives of one run without gaps inside interleaved data: sample i of the channel is
/// `signal[i * stride + channel]`, and the results are written at the same indices. The run must
/// have at least [`SHORTEST_RUN`] samples; shorter ones are set to NaN.
pub fn derivatives_of_run(
    signal: &[f64],
    stride: usize,
    channel: usize,
    rate_hz: f64,
    first: &mut [f64],
    second: &mut [f64],
) {
    let n = signal.len() / stride;
    let at = |i: usize| i * stride + channel;
    if n < SHORTEST_RUN {
        for i in 0..n {
            first[at(i)] = f64::NAN;
            second[at(i)] = f64::NAN;
        }
        return;
    }
    let x = |i: usize| signal[at(i)];
    let rate2 = rate_hz * rate_hz;
    for i in 0..n {
        let (d1, d2) = if i < 2 {
            (dot(&FIRST[i], x, |k| k), dot(&SECOND[i], x, |k| k))
        } else if i + 2 < n {
            (dot(&FIRST[2], x, |k| i - 2 + k), dot(&SECOND[2][..5], x, |k| i - 2 + k))
        } else {
            // Mirrored: odd derivatives change sign.
            let edge = n - 1 - i;
            (-dot(&FIRST[edge], x, |k| n - 1 - k), dot(&SECOND[edge], x, |k| n - 1 - k))
        };
        first[at(i)] = d1 * rate_hz;
        second[at(i)] = d2 * rate2;
    }
}

#[inline(always)]
fn dot(weights: &[f64], x: impl Fn(usize) -> f64, index: impl Fn(usize) -> usize) -> f64 {
    weights.iter().enumerate().map(|(k, w)| w * x(index(k))).sum()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn exact_on_polynomials_of_fourth_degree_up_to_the_ends() {
        let rate = 50.0;
        let t: Vec<f64> = (0..9).map(|i| i as f64 / rate).collect();
        let x: Vec<f64> = t.iter().map(|t| 3.0 - t + 2.0 * t * t - 5.0 * t.powi(3) + 7.0 * t.powi(4)).collect();
        let (v, a) = derivatives(&x, rate);
        for (i, t) in t.iter().enumerate() {
            assert!((v[i] - (-1.0 + 4.0 * t - 15.0 * t * t + 28.0 * t.powi(3))).abs() < 1e-11);
            assert!((a[i] - (4.0 - 30.0 * t + 84.0 * t * t)).abs() < 1e-9, "{i}");
        }
    }

    #[test]
    fn error_falls_with_the_fourth_power_of_the_step() {
        let error = |rate: f64| {
            let x: Vec<f64> = (0..(rate as usize)).map(|i| (6.0 * i as f64 / rate).sin()).collect();
            let (v, a) = derivatives(&x, rate);
            (0..x.len()).fold((0.0f64, 0.0f64), |e, i| {
                let p = 6.0 * i as f64 / rate;
                (e.0.max((v[i] - 6.0 * p.cos()).abs()), e.1.max((a[i] + 36.0 * p.sin()).abs()))
            })
        };
        let (coarse, fine) = (error(100.0), error(200.0));
        assert!(coarse.0 / fine.0 > 13.0 && coarse.1 / fine.1 > 13.0, "{coarse:?} {fine:?}");
    }

    #[test]
    fn runs_are_apart_and_short_ones_are_missing() {
        let mut x: Vec<f64> = (0..20).map(|i| i as f64).collect();
        x[5] = f64::NAN; // leaves 5 samples before: too few
        let (v, a) = derivatives(&x, 10.0);
        assert!(v[..6].iter().chain(&a[..6]).all(|d| d.is_nan()));
        assert!(v[6..].iter().all(|d| (d - 10.0).abs() < 1e-12));
        assert!(a[6..].iter().all(|d| d.abs() < 1e-9));
    }
}
