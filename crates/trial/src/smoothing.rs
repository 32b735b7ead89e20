//! Whether markers were low-pass filtered before they were stored, and where.
//!
//! Above the frequencies of movement the spectrum of measured positions is the cameras' noise, which
//! is flat. Software that smooths (markerless tracking, many exports) leaves a spectrum that falls on
//! and on. It is described by two straight lines in logarithms: movement falls with one slope, and
//! beyond the cut-off with a much steeper one. A Butterworth filter of second order, run forwards and
//! backwards, adds −8 to the slope; splines and moving averages add about as much.

use crate::Trial;
use aloft_signal::spectrum::welch;
use serde::{Deserialize, Serialize};

/// Length of a segment of the spectrum, s.
const SEGMENT_S: f64 = 1.3;
/// Frequencies below this are posture, not noise, Hz.
const LOWEST_HZ: f64 = 2.5;
/// Highest frequency used, as a share of half the rate.
const HIGHEST: f64 = 0.92;
/// Largest share of half the rate at which a cut-off can be seen.
const LATEST: f64 = 0.7;
/// Smallest steepening at the cut-off, and largest slope beyond it (density against frequency).
const STEEPER: f64 = 3.0;
const STEEP: f64 = -6.5;
/// Noise of cameras, m, below which no measurement is: markers whose density at the upper end is
/// lower were smoothed or rounded.
const QUIETEST_M: f64 = 5e-5;
/// Least share of the squared deviation from one line that two lines remove.
const EXPLAINED: f64 = 0.5;

/// Smoothing that was applied to markers before import.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Smoothing {
    /// Frequency above which movement is attenuated, Hz.
    pub cutoff_hz: f64,
}

/// The smoothing of a recording; `None` where the spectrum ends in noise, or is too short to tell.
pub fn smoothing(trial: &Trial) -> Option<Smoothing> {
    let rate = trial.markers.rate_hz;
    let segment = ((SEGMENT_S * rate) as usize).max(48);
    let mut sum: Vec<f64> = Vec::new();
    let mut frequency = Vec::new();
    let mut n = 0.0;
    for track in &trial.markers.trajectories {
        for axis in 0..3 {
            // second differences weigh the window's leakage of slow movement away
            let x: Vec<f64> =
                track.windows(3).map(|w| (w[0][axis] - 2.0 * w[1][axis] + w[2][axis]) * rate * rate).collect();
            let s = welch(&x, rate, segment);
            if s.segments == 0 {
                continue;
            }
            sum.resize(s.density.len(), 0.0);
            sum.iter_mut().zip(&s.density).for_each(|(a, d)| *a += d);
            frequency = s.frequency_hz;
            n += 1.0;
        }
    }
    let nyquist = 0.5 * rate;
    // densities of positions, in logarithms
    let points: Vec<(f64, f64)> = frequency
        .iter()
        .zip(&sum)
        .filter(|(f, d)| **f >= LOWEST_HZ && **f <= HIGHEST * nyquist && **d > 0.0)
        .map(|(f, d)| {
            let gain = (2.0 * rate * (std::f64::consts::PI * f / rate).sin()).powi(4);
            (f.ln(), (d / n / gain).ln())
        })
        .collect();
    if points.len() < 12 {
        return None;
    }
    let upper: Vec<f64> = points.iter().filter(|p| p.0 > (0.75 * nyquist).ln()).map(|p| p.1.exp()).collect();
    let floor_m = (aloft_signal::median(&mut upper.clone()) * nyquist).sqrt();
    if floor_m > QUIETEST_M {
        return None;
    }
    knee(&points, (LATEST * nyquist).ln())
}

/// Two joined lines; the place where they join.
fn knee(points: &[(f64, f64)], latest: f64) -> Option<Smoothing> {
    // what was rounded away is flat again at the upper end: it is left out
    let least = points.iter().map(|p| p.1).fold(f64::INFINITY, f64::min);
    let end = points.iter().position(|p| p.1 < least + 1.0).map_or(points.len(), |i| (i + 1).max(12).min(points.len()));
    let points = &points[..end];
    // points are even in frequency; each counts as much as its share of the logarithm
    let weight = |i: usize| {
        let (a, b) = (points[i.saturating_sub(1)].0, points[(i + 1).min(points.len() - 1)].0);
        (b - a).max(1e-6)
    };
    let one = fit(points, &weight, f64::INFINITY)?;
    let mut best: Option<(f64, [f64; 3], f64)> = None;
    for k in 3..points.len().saturating_sub(3) {
        let at = points[k].0;
        if at > latest {
            break;
        }
        let Some((line, left)) = fit(points, &weight, at) else { continue };
        if best.is_none_or(|b| left < b.2) {
            best = Some((at, line, left));
        }
    }
    let (at, line, left) = best?;
    let (before, beyond) = (line[1], line[1] + line[2]);
    let found = beyond < STEEP && before - beyond > STEEPER && left < (1.0 - EXPLAINED) * one.1;
    found.then(|| Smoothing { cutoff_hz: at.exp() })
}

/// Weighted least squares of `a + b x + c max(0, x − at)`; coefficients and the sum of squares.
fn fit(points: &[(f64, f64)], weight: &dyn Fn(usize) -> f64, at: f64) -> Option<([f64; 3], f64)> {
    use nalgebra::{Matrix3, Vector3};
    let row = |x: f64| Vector3::new(1.0, x, (x - at).max(0.0));
    let (mut normal, mut right) = (Matrix3::zeros(), Vector3::zeros());
    for (i, (x, y)) in points.iter().enumerate() {
        let r = row(*x);
        normal += weight(i) * r * r.transpose();
        right += weight(i) * *y * r;
    }
    if at.is_infinite() {
        normal[(2, 2)] = 1.0;
    }
    let c = normal.lu().solve(&right)?;
    let left = points.iter().enumerate().map(|(i, (x, y))| weight(i) * (y - row(*x).dot(&c)).powi(2)).sum();
    Some(([c[0], c[1], c[2]], left))
}
