//! Power spectral density by Welch's method, to assess noise and choose filters.

use serde::{Deserialize, Serialize};
use std::f64::consts::TAU;

/// Bins that are summed together: one sum alone waits for each of its additions.
const BINS: usize = 8;

/// One-sided power spectral density.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Spectrum {
    /// Frequencies from 0 to half the rate, Hz.
    pub frequency_hz: Vec<f64>,
    /// Density, signal unit squared per Hz; its integral over frequency is the variance.
    pub density: Vec<f64>,
    /// Number of segments averaged; zero if the signal had no complete segment, in which case the
    /// density is NaN.
    pub segments: usize,
}

/// Welch's averaged periodogram: segments of `segment` samples (at least 2), half overlapping, mean
/// removed, Hann window, within the runs of a signal without missing samples. The numbers are those
/// of `scipy.signal.welch` with its defaults.
pub fn welch(signal: &[f64], rate_hz: f64, segment: usize) -> Spectrum {
    let n = segment.max(2);
    let bins = n / 2 + 1;
    let frequency_hz = (0..bins).map(|k| k as f64 * rate_hz / n as f64).collect();
    let window: Vec<f64> = (0..n).map(|i| 0.5 - 0.5 * (TAU * i as f64 / n as f64).cos()).collect();
    let scale = 1.0 / (rate_hz * window.iter().map(|w| w * w).sum::<f64>());
    // One table of the circle is used for every bin: segments are short, and a plain sum is
    // accurate and fast enough.
    let circle: Vec<(f64, f64)> = (0..n).map(|i| (TAU * i as f64 / n as f64).sin_cos()).collect();
    let mut density = vec![0.0; bins];
    let mut segments = 0;
    let mut x = vec![0.0; n];
    for run in crate::finite_runs(signal) {
        let run = &signal[run];
        for start in (0..).step_by(n - n / 2).take_while(|s| s + n <= run.len()) {
            let part = &run[start..start + n];
            let mean = part.iter().sum::<f64>() / n as f64;
            for i in 0..n {
                x[i] = (part[i] - mean) * window[i];
            }
            for (first, some) in (0..).step_by(BINS).zip(density.chunks_mut(BINS)) {
                let (mut re, mut im, mut at) = ([0.0; BINS], [0.0; BINS], [0; BINS]);
                // the last group may have more bins than there are
                let step: [usize; BINS] = std::array::from_fn(|lane| (first + lane) % n);
                for x in &x {
                    for lane in 0..BINS {
                        let (sine, cosine) = circle[at[lane]];
                        re[lane] += x * cosine;
                        im[lane] -= x * sine;
                        at[lane] += step[lane];
                        if at[lane] >= n {
                            at[lane] -= n;
                        }
                    }
                }
                for (lane, d) in some.iter_mut().enumerate() {
                    let k = first + lane;
                    // Negative frequencies are added, except for the two bins that mirror
                    // themselves.
                    let fold = if k == 0 || 2 * k == n { 1.0 } else { 2.0 };
                    *d += fold * scale * (re[lane] * re[lane] + im[lane] * im[lane]);
                }
            }
            segments += 1;
        }
    }
    density.iter_mut().for_each(|d| *d = if segments == 0 { f64::NAN } else { *d / segments as f64 });
    Spectrum { frequency_hz, density, segments }
}
