//! The quietest frames of a folder, to stand in for a static trial.

use super::look::Determination;
use aloft_trial::Trial;
use nalgebra::Vector3;

/// Length of the stretch, s.
const LENGTH_S: f64 = 0.3;
/// Share of the markers that have to be seen in it.
const SEEN: f64 = 0.9;

/// A quiet stretch of a recording.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Quiet {
    /// First and last frame, counted from zero.
    pub first: usize,
    pub last: usize,
    /// Root mean square distance of the median marker from its mean place, m.
    pub spread_m: f64,
}

/// The quietest stretch of all recordings in which the body stands: the mean marker is as high
/// above the lowest one as in the tallest stretch, within 8 % (a crouch lowers it by more, raised
/// arms lift it by less).
pub(super) fn quietest<'a>(rest: &[&'a Determination]) -> Option<(&'a Determination, Quiet)> {
    let all: Vec<(&Determination, Quiet, f64)> =
        rest.iter().flat_map(|d| stretches(&d.trial).into_iter().map(move |(q, height)| (*d, q, height))).collect();
    let tallest = all.iter().map(|a| a.2).fold(0.0, f64::max);
    all.into_iter()
        .filter(|a| a.2 > 0.92 * tallest)
        .min_by(|a, b| a.1.spread_m.total_cmp(&b.1.spread_m))
        .map(|(d, q, _)| (d, q))
}

/// Stretches with nearly all markers, and the height of the mean marker above the lowest one, m.
fn stretches(trial: &Trial) -> Vec<(Quiet, f64)> {
    let markers = &trial.markers;
    let length = ((LENGTH_S * markers.rate_hz).round() as usize).max(8);
    let mut out = Vec::new();
    let mut first = 0;
    while first + length <= markers.n_frames {
        let mut spreads = Vec::new();
        let (mut low, mut sum) = (f64::INFINITY, 0.0);
        for track in &markers.trajectories {
            let part = &track[first..first + length];
            if part.iter().any(|p| !p.x.is_finite()) {
                continue;
            }
            let mean = part.iter().sum::<Vector3<f64>>() / length as f64;
            let square: f64 = part.iter().map(|p| (p - mean).norm_squared()).sum();
            spreads.push((square / length as f64).sqrt());
            (low, sum) = (low.min(mean.z), sum + mean.z);
        }
        if spreads.len() as f64 >= SEEN * markers.trajectories.len() as f64
            && let Some(spread_m) = aloft_signal::upper_median(&mut spreads)
        {
            let height_m = sum / spreads.len() as f64 - low;
            out.push((Quiet { first, last: first + length - 1, spread_m }, height_m));
        }
        first += (length / 3).max(1);
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;
    use aloft_trial::Markers;

    #[test]
    fn the_quiet_second_is_found() {
        let moving = |f: usize| if (100..200).contains(&f) { 0.0 } else { 0.3 * (0.1 * f as f64).sin() };
        let track = |z: f64| (0..400).map(|f| Vector3::new(moving(f), 0.0, z)).collect();
        let markers = Markers {
            rate_hz: 100.0,
            first_frame: 1,
            n_frames: 400,
            labels: vec!["A".into(), "B".into()],
            trajectories: vec![track(0.1), track(1.5)],
        };
        let found = stretches(&Trial { markers, ..Trial::default() });
        let best = found.iter().min_by(|a, b| a.0.spread_m.total_cmp(&b.0.spread_m));
        assert!(best.is_some_and(|(q, height)| q.first >= 100 && q.last < 200 && (height - 0.7).abs() < 1e-9));
    }
}
