//! Whether markers were low-pass filtered before they were stored, and at which frequency.
//!
//! Above the frequencies of movement the spectrum of measured positions is the noise of cameras,
//! which is flat. After a filter it falls on and on. The density of positions is described as
//!
//! `S(f) = (a f⁻ᵖ + N) |H(f)|² + Q`
//!
//! with movement `a f⁻ᵖ`, noise before the filter `N`, a Butterworth filter of second order run
//! forwards and backwards `H`, and what was added after it `Q` (rounding). Splines and moving
//! averages fall about as fast; the frequency found is then that of the filter which resembles
//! them.

use crate::Trial;
use aloft_signal::welch;
use serde::{Deserialize, Serialize};
use std::f64::consts::PI;

/// Length of a segment of the spectrum, s, and its most samples.
const SEGMENT_S: f64 = 1.3;
const SEGMENT: usize = 256;
/// Most samples and markers that are looked at: enough for a spectrum of every long recording.
const SAMPLES: usize = 2_000;
const TRACKS: usize = 30;
/// Frequencies below this are posture, Hz.
const LOWEST_HZ: f64 = 2.5;
/// Highest frequency used, and highest cut-off that can be seen, as shares of half the rate.
const HIGHEST: f64 = 0.92;
const LATEST: f64 = 0.8;
/// Noise, m, below which no camera measures a marker: a quieter recording was smoothed.
const QUIETEST_MARKER_M: f64 = 5e-5;
/// The same for points that software finds in videos; their raw scatter is several millimetres.
const QUIETEST_ESTIMATE_M: f64 = 1e-3;
/// Largest share of the squared deviation without a filter that the filter may leave.
const LEFT: f64 = 0.3;
/// Cut-offs that are tried.
const CUTOFFS: i32 = 36;

/// Smoothing that was applied to markers before import.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Smoothing {
    /// Cut-off of each of the two passes, Hz; both together take half the power at 0.8 of it.
    pub cutoff_hz: f64,
}

/// The smoothing of a recording; `None` where the spectrum ends in noise, or is too short to tell.
/// `estimated` says that the points come from videos.
pub fn smoothing(trial: &Trial, estimated: bool) -> Option<Smoothing> {
    let rate = trial.markers.rate_hz;
    let nyquist = 0.5 * rate;
    let (frequency, density) = spectrum(trial)?;
    let points: Vec<Point> = frequency
        .iter()
        .zip(&density)
        .filter(|(f, d)| **f >= LOWEST_HZ && **f <= HIGHEST * nyquist && **d > 0.0)
        .map(|(f, d)| Point { f: *f, tangent: (PI * f / rate).tan(), density: *d, log: d.ln() })
        .collect();
    if points.len() < 12 {
        return None;
    }
    let mut upper: Vec<f64> = points.iter().filter(|p| p.f > 0.75 * nyquist).map(|p| p.density).collect();
    let end = aloft_signal::upper_median(&mut upper)?;
    let quietest = if estimated { QUIETEST_ESTIMATE_M } else { QUIETEST_MARKER_M };
    if (end * nyquist).sqrt() > quietest {
        return None;
    }
    let without = best(&points, end, None);
    let ratio = LATEST * nyquist / LOWEST_HZ;
    let (cutoff_hz, left) = (0..CUTOFFS)
        .map(|k| LOWEST_HZ * ratio.powf(f64::from(k) / f64::from(CUTOFFS - 1)))
        .map(|cutoff| (cutoff, best(&points, end, Some((PI * cutoff / rate).tan()))))
        .min_by(|a, b| a.1.total_cmp(&b.1))?;
    (left < LEFT * without).then_some(Smoothing { cutoff_hz })
}

/// Density of positions, m²/Hz: geometric mean over markers, so that a few computed points or lost
/// markers do not decide.
fn spectrum(trial: &Trial) -> Option<(Vec<f64>, Vec<f64>)> {
    let rate = trial.markers.rate_hz;
    let segment = ((SEGMENT_S * rate) as usize).clamp(48, SEGMENT);
    let n = trial.markers.n_frames;
    let used = n.min(SAMPLES);
    let first = (n - used) / 2;
    let step = trial.markers.trajectories.len().div_ceil(TRACKS).max(1);
    let (mut sum, mut frequency, mut tracks): (Vec<f64>, Vec<f64>, f64) = (Vec::new(), Vec::new(), 0.0);
    for track in trial.markers.trajectories.iter().step_by(step) {
        let mut own: Vec<f64> = Vec::new();
        for axis in 0..3 {
            // second differences: slow movement does not leak into the upper frequencies
            let part = track.get(first..first + used)?;
            let x: Vec<f64> = part.windows(3).map(|w| w[0][axis] - 2.0 * w[1][axis] + w[2][axis]).collect();
            let s = welch(&x, rate, segment);
            if s.segments > 0 {
                own.resize(s.density.len(), 0.0);
                own.iter_mut().zip(&s.density).for_each(|(a, d)| *a += d);
                frequency = s.frequency_hz;
            }
        }
        if own.iter().skip(1).any(|d| *d <= 0.0) || own.is_empty() {
            continue;
        }
        sum.resize(own.len(), 0.0);
        sum.iter_mut().zip(&own).for_each(|(a, d)| *a += d.ln());
        tracks += 1.0;
    }
    let gain = |f: f64| (2.0 * (PI * f / rate).sin()).powi(4).max(1e-300);
    let density = frequency.iter().zip(&sum).map(|(f, s)| (s / tracks).exp() / gain(*f)).collect();
    (tracks > 0.0).then_some((frequency, density))
}

struct Point {
    f: f64,
    tangent: f64,
    density: f64,
    log: f64,
}

/// Least squared deviation of the logarithms over slopes of movement and levels of noise, for one
/// filter (the tangent of its cut-off) or none. Each point counts as its share of the logarithm of
/// frequency.
fn best(points: &[Point], end: f64, cutoff: Option<f64>) -> f64 {
    let gain = |p: &Point| cutoff.map_or(1.0, |c| (1.0 + (p.tangent / c).powi(4)).powi(-2));
    let gains: Vec<f64> = points.iter().map(gain).collect();
    let levels = [0.08, 0.16, 0.24, 0.32, 0.4, 0.5].map(|share| points[(share * points.len() as f64) as usize].density);
    let mut least = f64::INFINITY;
    for slope in [3, 4, 5, 6] {
        // the level of movement from the lowest frequencies
        let start = points.iter().zip(&gains).take(4);
        let level = (start.map(|(p, g)| p.log - g.ln() + f64::from(slope) * p.f.ln()).sum::<f64>() / 4.0).exp();
        for before in levels.iter().map(|l| 0.7 * l).chain([0.0]) {
            for after in [0.0, end] {
                let deviation = |(p, gain): (&Point, &f64)| {
                    let modelled = (level * p.f.powi(-slope) + before) * gain + after;
                    (p.log - modelled.max(1e-300).ln()).powi(2) / p.f
                };
                least = least.min(points.iter().zip(&gains).map(deviation).sum());
            }
        }
    }
    least
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Markers;
    use aloft_signal::{Butterworth, CutoffCorrection, LowPass};
    use nalgebra::Vector3;

    /// A deterministic scatter between −1 and 1.
    fn scatter(seed: &mut u64) -> f64 {
        *seed = seed.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (*seed >> 11) as f64 / (1u64 << 52) as f64 - 1.0
    }

    /// Ten markers that move by filtered random walks, with noise, low-passed or not.
    fn recording(rate_hz: f64, noise_m: f64, cutoff_hz: Option<f64>) -> Trial {
        let mut seed = 7;
        let n = 600;
        let design = |order, cutoff_hz| {
            let pass = LowPass { order, cutoff_hz, correction: CutoffCorrection::None };
            Butterworth::design(pass, rate_hz).unwrap()
        };
        let trajectories = (0..10)
            .map(|_| {
                let axes: Vec<Vec<f64>> = (0..3)
                    .map(|_| {
                        // second integral of noise: density falls with the fourth power
                        let (mut v, mut x) = (0.0, 0.0);
                        let mut track: Vec<f64> = (0..n)
                            .map(|_| {
                                v = 0.98 * v + scatter(&mut seed) * 5.0 / rate_hz;
                                x = 0.995 * x + v / rate_hz;
                                x
                            })
                            .collect();
                        track.iter_mut().for_each(|x| *x += noise_m * scatter(&mut seed));
                        if let Some(cutoff_hz) = cutoff_hz {
                            design(2, cutoff_hz).filtfilt(&mut track);
                        }
                        track
                    })
                    .collect();
                (0..n).map(|f| Vector3::new(axes[0][f], axes[1][f], axes[2][f])).collect()
            })
            .collect();
        let labels = (0..10).map(|i| format!("m{i}")).collect();
        Trial { markers: Markers { rate_hz, first_frame: 1, n_frames: n, labels, trajectories }, ..Trial::default() }
    }

    #[test]
    fn the_cut_off_of_a_filter_is_found() {
        for (rate, cutoff) in [(100.0, 6.0), (100.0, 12.0), (200.0, 20.0), (120.0, 25.0), (250.0, 10.0)] {
            let found = smoothing(&recording(rate, 2e-3, Some(cutoff)), true).map(|s| s.cutoff_hz);
            let found = found.unwrap_or_else(|| panic!("{rate} Hz, {cutoff} Hz: nothing found"));
            assert!((found / cutoff - 1.0).abs() < 0.4, "{rate} Hz: {found} Hz, not {cutoff} Hz");
        }
    }

    #[test]
    fn measured_noise_is_not_smoothing() {
        for (rate, noise) in [(100.0, 3e-4), (200.0, 1.5e-4), (250.0, 2e-3)] {
            assert_eq!(smoothing(&recording(rate, noise, None), false), None, "{rate} Hz, {noise} m");
        }
        assert_eq!(smoothing(&recording(100.0, 5e-3, None), true), None, "raw keypoints");
        assert_eq!(smoothing(&Trial::default(), true), None);
    }
}
