//! Values of a sampled signal at other times, for example plates at 1000 Hz at the camera frames.

use crate::butterworth::{Butterworth, DesignError, LowPass};
use serde::{Deserialize, Serialize};

/// Interpolation between samples.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Interpolation {
    /// Straight line between two samples.
    Linear,
    /// Cubic through four samples (parabola or line where a neighbour is missing).
    #[default]
    Cubic,
}

/// Values at `times_s`, where sample i was taken at `start_s + i / rate_hz`. NaN outside the signal
/// and next to a missing sample; times within 1e-6 of a sample's own time give that sample.
pub fn resample(signal: &[f64], rate_hz: f64, start_s: f64, times_s: &[f64], how: Interpolation) -> Vec<f64> {
    times_s.iter().map(|t| value_at(signal, (t - start_s) * rate_hz, how)).collect()
}

/// Resamples a signal: filters forward and backward at its own rate, then interpolates with cubics.
/// The cut-off must be below half the rate of `times_s` to avoid aliasing.
///
/// # Errors
/// A filter that is not valid at `rate_hz`.
pub fn filter_and_resample(
    signal: &[f64],
    rate_hz: f64,
    start_s: f64,
    times_s: &[f64],
    filter: LowPass,
) -> Result<Vec<f64>, DesignError> {
    let mut smooth = signal.to_vec();
    Butterworth::design(filter, rate_hz)?.filtfilt(&mut smooth);
    Ok(resample(&smooth, rate_hz, start_s, times_s, Interpolation::Cubic))
}

fn value_at(signal: &[f64], position: f64, how: Interpolation) -> f64 {
    let nearest = position.round();
    if !(nearest >= 0.0 && nearest < signal.len() as f64) {
        return f64::NAN;
    }
    if (position - nearest).abs() < 1e-6 {
        return signal[nearest as usize];
    }
    let floor = position.floor();
    if floor < 0.0 || floor as usize + 1 >= signal.len() {
        return f64::NAN;
    }
    let (i, u) = (floor as usize, position - floor);
    let (x1, x2) = (signal[i], signal[i + 1]);
    if how == Interpolation::Linear || !(x1.is_finite() && x2.is_finite()) {
        return x1 + u * (x2 - x1);
    }
    let neighbour = |k: Option<usize>| k.and_then(|k| signal.get(k)).copied().filter(|x| x.is_finite());
    let line = x1 + u * (x2 - x1);
    // Newton's form on the available samples; the curvature is a second difference.
    match (neighbour(i.checked_sub(1)), neighbour(Some(i + 2))) {
        (Some(x0), Some(x3)) => {
            let (left, right) = (x0 - 2.0 * x1 + x2, x1 - 2.0 * x2 + x3);
            line + u * (u - 1.0) * 0.5 * (left + (u + 1.0) / 3.0 * (right - left))
        }
        (Some(x0), None) => line + u * (u - 1.0) * 0.5 * (x0 - 2.0 * x1 + x2),
        (None, Some(x3)) => line + u * (u - 1.0) * 0.5 * (x1 - 2.0 * x2 + x3),
        (None, None) => line,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::butterworth::CutoffCorrection;

    #[test]
    fn cubic_is_exact_on_cubics_and_never_reaches_across_a_gap() {
        let f = |t: f64| 1.0 - 2.0 * t + 3.0 * t * t - 0.5 * t.powi(3);
        let mut x: Vec<f64> = (0..20).map(|i| f(2.0 + i as f64 / 10.0)).collect();
        let times: Vec<f64> = (0..37).map(|i| 2.13 + 0.047 * i as f64).take_while(|t| *t < 3.8).collect();
        for (t, y) in times.iter().zip(resample(&x, 10.0, 2.0, &times, Interpolation::Cubic)) {
            assert!((y - f(*t)).abs() < 1e-12, "{t}: {y} {}", f(*t));
        }
        x[10] = f64::NAN;
        let y = resample(&x, 10.0, 2.0, &[2.85, 2.95, 3.0, 3.05, 3.1, 3.9, 3.91, 1.99], Interpolation::Cubic);
        assert!(y[0].is_finite() && y[1].is_nan() && y[2].is_nan() && y[3].is_nan() && (y[4] - f(3.1)).abs() < 1e-12);
        assert!((y[5] - f(3.9)).abs() < 1e-12 && y[6].is_nan() && y[7].is_nan());
    }

    #[test]
    fn slow_signals_survive_the_way_to_another_rate() {
        let f = |t: f64| (6.0 * t).sin();
        let x: Vec<f64> = (0..1000).map(|i| f(i as f64 / 1000.0) + 0.1 * (2500.0 * i as f64 / 1000.0).sin()).collect();
        let times: Vec<f64> = (20..170).map(|i| i as f64 / 200.0 + 0.0003).collect();
        let filter = LowPass { order: 3, cutoff_hz: 30.0, correction: CutoffCorrection::None };
        for (t, y) in times.iter().zip(filter_and_resample(&x, 1000.0, 0.0, &times, filter).unwrap()) {
            assert!((y - f(*t)).abs() < 1e-3, "{t}: {y}");
        }
    }
}
