//! First step of scaling: the frames in which the body stands still, and the position of every
//! marker in them.

use crate::ScaleError;
use crate::geometry::{median, median_point};
use aloft_trial::Trial;
use nalgebra::Vector3;
use serde::{Deserialize, Serialize};
use std::ops::Range;

/// Options for finding quiet frames.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct QuietOptions {
    /// Length of the window that must be the quietest of the trial, s.
    pub window_s: f64,
    /// Frames whose markers stay, root mean square, within this distance of that window's medians
    /// are used as well, m.
    pub radius_m: f64,
}

impl Default for QuietOptions {
    fn default() -> Self {
        Self { window_s: 0.5, radius_m: 0.005 }
    }
}

/// Position of each marker of a trial while the body stood still.
#[derive(Debug, Clone, PartialEq)]
pub struct StaticPose {
    /// Frames used, 0-based.
    pub frames: Vec<usize>,
    /// Median position of each marker of the trial over these frames, m, world; `None` where it was
    /// never seen.
    pub positions: Vec<Option<Vector3<f64>>>,
    /// Root mean square distance of each marker from its median, m; NaN where it was never seen.
    pub spread_m: Vec<f64>,
}

impl StaticPose {
    /// From the quietest part of a static trial, or from the frames given by the user (then all of
    /// them are used).
    ///
    /// # Errors
    /// [`ScaleError::NoFrames`] for an empty trial, a range outside it, or frames in which no
    /// marker is seen.
    pub fn find(trial: &Trial, frames: Option<&Range<usize>>, options: &QuietOptions) -> Result<Self, ScaleError> {
        let n = trial.markers.n_frames;
        let fail = |problem: String| ScaleError::NoFrames { trial: trial.name.clone(), problem };
        if n == 0 || trial.markers.trajectories.is_empty() {
            return Err(fail("the trial holds no marker frames".into()));
        }
        let frames: Vec<usize> = match frames {
            Some(r) if r.start < r.end && r.end <= n => r.clone().collect(),
            Some(r) => return Err(fail(format!("frames {}..{} asked for, the trial has {n}", r.start, r.end))),
            None => quiet_frames(trial, options),
        };
        let mut pose = Self::at(trial, frames);
        if pose.positions.iter().all(Option::is_none) {
            return Err(fail("no marker is visible in them".into()));
        }
        pose.frames.shrink_to_fit();
        Ok(pose)
    }

    fn at(trial: &Trial, frames: Vec<usize>) -> Self {
        let mut positions = Vec::with_capacity(trial.markers.labels.len());
        let mut spread_m = Vec::with_capacity(trial.markers.labels.len());
        for trajectory in &trial.markers.trajectories {
            let seen = frames.iter().filter_map(|&f| trajectory.get(f));
            let place = median_point(seen.clone());
            spread_m.push(place.map_or(f64::NAN, |m| {
                let (sum, n) = seen
                    .map(|p| (p - m).norm_squared())
                    .filter(|d| d.is_finite())
                    .fold((0.0, 0usize), |(s, n), d| (s + d, n + 1));
                (sum / n.max(1) as f64).sqrt()
            }));
            positions.push(place);
        }
        Self { frames, positions, spread_m }
    }

    /// Median over markers of the spread, m: the noise level in a good static, centimetres if the
    /// body moved.
    pub fn typical_spread_m(&self) -> f64 {
        median(self.spread_m.iter().copied())
    }
}

/// Mean over markers of the positional variance in a window, from running sums over its frames.
fn window_variance(trajectories: &[Vec<Vector3<f64>>], window: Range<usize>) -> f64 {
    let mut total = 0.0;
    let mut markers = 0usize;
    let need = window.len().div_ceil(2);
    for t in trajectories {
        let points = t[window.clone()].iter().filter(|p| p.x.is_finite() && p.y.is_finite() && p.z.is_finite());
        let (mut n, mut sum, mut square) = (0usize, Vector3::zeros(), 0.0);
        let mut origin = None;
        for p in points {
            let d = p - *origin.get_or_insert(*p);
            n += 1;
            sum += d;
            square += d.norm_squared();
        }
        if n >= need {
            let n = n as f64;
            total += square / n - (sum / n).norm_squared();
            markers += 1;
        }
    }
    // A window that shows only half of the markers is not better because it is quieter.
    if markers == 0 {
        f64::INFINITY
    } else {
        total / markers as f64 * (trajectories.len() as f64 / markers as f64).powi(4)
    }
}

fn quiet_frames(trial: &Trial, options: &QuietOptions) -> Vec<usize> {
    let m = &trial.markers;
    let n = m.trajectories.iter().map(Vec::len).min().unwrap_or(0).min(m.n_frames);
    let length = ((options.window_s * m.rate_hz).round() as usize).clamp(1, n.max(1));
    let step = (length / 4).max(1);
    let mut best = (f64::INFINITY, 0);
    let mut start = 0;
    while start + length <= n {
        let variance = window_variance(&m.trajectories, start..start + length);
        if variance < best.0 {
            best = (variance, start);
        }
        start += step;
    }
    let centre = StaticPose::at(trial, (best.1..(best.1 + length).min(n)).collect());
    (0..n)
        .filter(|&f| {
            let (sum, count) = m
                .trajectories
                .iter()
                .zip(&centre.positions)
                .filter_map(|(t, c)| c.map(|c| (t[f] - c).norm_squared()))
                .filter(|d| d.is_finite())
                .fold((0.0, 0usize), |(s, k), d| (s + d, k + 1));
            count > 0 && (sum / count as f64).sqrt() < options.radius_m.max(3.0 * best.0.max(0.0).sqrt())
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use aloft_trial::Markers;

    fn trial(positions: impl Fn(usize) -> f64, n: usize) -> Trial {
        let trajectories =
            (0..3).map(|k| (0..n).map(|f| Vector3::new(positions(f) + k as f64, 0.0, 1.0)).collect()).collect();
        Trial {
            name: "made".into(),
            markers: Markers {
                rate_hz: 100.0,
                first_frame: 1,
                n_frames: n,
                labels: (0..3).map(|k| format!("M{k}")).collect(),
                trajectories,
            },
            ..Trial::default()
        }
    }

    #[test]
    fn quiet_frames_leave_out_the_walk_to_the_place() {
        let t = trial(|f| if f < 200 { 0.01 * (200 - f) as f64 } else { 0.0 }, 400);
        let pose = StaticPose::find(&t, None, &QuietOptions::default()).unwrap();
        assert!(pose.frames.iter().all(|&f| f >= 199), "{:?}", pose.frames.first());
        assert!(pose.frames.len() >= 200);
        assert!(pose.positions[1].unwrap().x - 1.0 < 1e-12);
    }

    #[test]
    fn named_frames_are_taken_as_they_are_and_checked() {
        let t = trial(|f| f as f64, 10);
        let pose = StaticPose::find(&t, Some(&(2..5)), &QuietOptions::default()).unwrap();
        assert_eq!(pose.frames, vec![2, 3, 4]);
        assert_eq!(pose.positions[0].unwrap().x, 3.0);
        assert!(StaticPose::find(&t, Some(&(8..12)), &QuietOptions::default()).is_err());
        assert!(StaticPose::find(&Trial::default(), None, &QuietOptions::default()).is_err());
    }
}
