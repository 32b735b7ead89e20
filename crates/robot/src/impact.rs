//! Impacts in the path of a body: single samples in which its velocity jumps.
//!
//! A body that hits the floor changes its velocity within a few milliseconds. A low-pass filter
//! that reaches across spreads the impact over the flight before it. Samples in an impact are
//! therefore left out, and what is before and after is smoothed apart. Hands and joints spread what
//! they do over many samples, which the samples around then show, too.

use aloft_body::STANDARD_GRAVITY_MPS2;
use nalgebra::Vector3;

/// Acceleration of a single sample beside those around it, in multiples of gravity, that only an
/// impact has: half a metre per second within 10 ms.
const IMPACT_G: f64 = 5.0;
/// The same in medians of its scatter, so that noise is none.
const SCATTER: f64 = 10.0;
/// Samples on either side that one is compared with, and those next to it that an impact reaches.
const AROUND: usize = 8;
const REACHED: usize = 2;

/// Samples in impacts: times, s; positions, m.
pub(crate) fn impacts(times: &[f64], positions: &[Vector3<f64>]) -> Vec<usize> {
    let n = positions.len().min(times.len());
    let acceleration: Vec<Option<Vector3<f64>>> = (0..n)
        .map(|i| {
            if i == 0 || i + 1 >= n {
                return None;
            }
            let (h, k) = (times[i] - times[i - 1], times[i + 1] - times[i]);
            let change = (positions[i + 1] - positions[i]) / k - (positions[i] - positions[i - 1]) / h;
            // samples that were lost are no impact
            (k < 1.6 * h && h < 1.6 * k).then(|| change * (2.0 / (h + k)))
        })
        .collect();
    let off: Vec<f64> = (0..n)
        .map(|i| {
            let Some(own) = acceleration[i] else { return 0.0 };
            let around = (i.saturating_sub(AROUND)..(i + AROUND + 1).min(n)).filter(|j| j.abs_diff(i) > REACHED);
            let others: Vec<Vector3<f64>> = around.filter_map(|j| acceleration[j]).collect();
            if others.len() < AROUND / 2 {
                return 0.0;
            }
            let of_axis = |k: usize| aloft_signal::median(&mut others.iter().map(|a| a[k]).collect::<Vec<_>>());
            (own - Vector3::from_fn(|k, _| of_axis(k))).norm()
        })
        .collect();
    let usual = aloft_signal::median(&mut off.iter().copied().filter(|x| *x > 0.0).collect::<Vec<_>>());
    let limit = (IMPACT_G * STANDARD_GRAVITY_MPS2).max(SCATTER * usual);
    (0..n).filter(|i| off[*i] > limit).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn path(of: impl Fn(f64) -> f64) -> Vec<usize> {
        let times: Vec<f64> = (0..120).map(|i| f64::from(i) / 148.0).collect();
        // noise of 0.2 mm that no generator made
        let noise = |i: usize| 2e-4 * (1e4 * (i as f64 + 1.0).sin()).fract();
        let positions: Vec<Vector3<f64>> =
            times.iter().enumerate().map(|(i, t)| Vector3::new(0.5 * t, noise(i), of(*t))).collect();
        impacts(&times, &positions)
    }

    #[test]
    fn a_bounce_is_found_and_flight_and_a_fast_swing_are_none() {
        // falls from 0.6 m, and bounces with half of the velocity
        let hit = (2.0f64 * 0.6 / 9.81).sqrt();
        let bounce = |t: f64| match t - hit {
            s if s < 0.0 => 0.6 - 4.905 * t * t,
            s => 0.5 * 9.81 * hit * s - 4.905 * s * s,
        };
        let found = path(bounce);
        assert!(!found.is_empty() && found.iter().all(|i| (*i as f64 / 148.0 - hit).abs() < 0.015), "{found:?}");
        assert!(path(|t| 2.0 * t - 4.905 * t * t).is_empty());
        // 8 g by a hand at 3 Hz
        assert!(path(|t| 0.22 * (18.85 * t).sin()).is_empty());
        assert!(impacts(&[], &[]).is_empty() && impacts(&[0.0, 0.1], &[Vector3::zeros(); 2]).is_empty());
    }
}
