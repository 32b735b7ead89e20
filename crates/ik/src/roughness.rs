//! How rough a recorded motion is: variances of third differences, for estimates across gaps.
//!
//! Human motion has far more jerk at a landing than in the air, so the variance is local. It is
//! measured from coordinates that no gap affects, over a lag at which motion exceeds noise, and
//! carried over to the spacing of the frames as that of white jerk (variance ∝ lag⁵). Noise is not
//! subtracted: too large a variance leaves more to the markers, too small a one falsifies the
//! motion at take-off and landing.

use crate::frame::Solver;
use crate::passage::{change, look};
use crate::problem::Problem;
use aloft_body::Motion;
use aloft_trial::Trial;
use std::ops::Range;

/// Lag of the third difference, s.
const LAG_S: f64 = 0.05;
/// Distance from a gap within which frames count, s.
const NEAR_S: f64 = 0.25;
/// Fewest differences near a gap; with fewer, all of the trial count.
const FEWEST: usize = 12;
/// Most frames from which the variance of the residuals is taken.
const SAMPLES: usize = 32;

/// Third differences of a trial.
#[derive(Debug, Clone)]
pub(crate) struct Roughness {
    /// Frame at the middle, and squared difference of every coordinate, (rad or m)²; NaN where a
    /// gap is too near.
    differences: Vec<(usize, Vec<f64>)>,
    /// Number of coordinates.
    nv: usize,
    /// From the variance at the lag to that at one frame, in units of the frames' costs.
    scale: f64,
    /// Distance in frames.
    near: usize,
    /// Variance of the residuals in units of the nominal one.
    pub factor: f64,
}

impl Roughness {
    /// From the coordinates that no gap affects: those for which `whole(frame, coordinate)` holds.
    pub fn of(
        problem: &Problem,
        trial: &Trial,
        sources: &[usize],
        motion: &Motion,
        whole: impl Fn(usize, usize) -> bool,
    ) -> Self {
        let tree = &problem.tree;
        let n = motion.n_frames();
        let lag = ((LAG_S * motion.rate_hz).round() as usize).max(1);
        let third = |first: usize| -> Option<Vec<f64>> {
            let frames = [first, first + lag, first + 2 * lag, first + 3 * lag];
            if !frames.iter().all(|&f| motion.is_valid(f)) {
                return None;
            }
            let rate = |k: usize| change(tree, motion.q(frames[k]), motion.q(frames[k + 1]));
            let (a, b, c) = (rate(0), rate(1), rate(2));
            let square = |j: usize| {
                if frames.iter().all(|&f| whole(f, j)) { (c[j] - 2.0 * b[j] + a[j]).powi(2) } else { f64::NAN }
            };
            Some((0..tree.nv).map(square).collect())
        };
        let differences = (0..n.saturating_sub(3 * lag)).filter_map(|f| Some((f + 3 * lag / 2, third(f)?))).collect();
        // Variance of the residuals in units of the nominal one.
        let mut solver = Solver::new(problem);
        let samples: Vec<usize> = (0..n).filter(|&f| motion.is_valid(f)).collect();
        let (mut factor, mut used) = (0.0, 0.0);
        for &f in samples.iter().step_by(samples.len().div_ceil(SAMPLES).max(1)) {
            look(&mut solver, trial, sources, f);
            solver.evaluate(motion.q(f));
            if solver.prepare(motion.q(f)) {
                solver.inverse.invert(tree, &solver.factor, tree.nv);
                factor += solver.variance_factor();
                used += 1.0;
            }
        }
        let factor = if factor > 0.0 { factor / used } else { 1.0 };
        let near = (NEAR_S * motion.rate_hz).round() as usize;
        Self { differences, nv: tree.nv, scale: (lag as f64).powi(-5) / factor, near, factor }
    }

    /// Variance of the third difference over successive frames near a stretch of frames, by
    /// coordinate, in units of the frames' costs.
    pub fn around(&self, frames: Range<usize>) -> Vec<f64> {
        let near = frames.start.saturating_sub(self.near)..frames.end + self.near;
        let variance = |j: usize, range: &Range<usize>, fewest: usize| {
            let chosen = self.differences.iter().filter(|(f, d)| range.contains(f) && d[j].is_finite());
            let (sum, count) = chosen.fold((0.0, 0), |(sum, count), (_, d)| (sum + d[j], count + 1));
            (count >= fewest).then(|| sum / count as f64).filter(|v| *v > 0.0)
        };
        (0..self.nv)
            .map(|j| variance(j, &near, FEWEST).or_else(|| variance(j, &(0..usize::MAX), 1)))
            .map(|v| v.map_or(f64::MAX.sqrt(), |v| v * self.scale))
            .collect()
    }
}
