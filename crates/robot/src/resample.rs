//! A log on a regular grid of times. Rows that the log lost stay missing.

use crate::RobotError;
use crate::log::RobotLog;
use nalgebra::Vector3;

/// The log's joints and inertial unit on a regular grid.
#[derive(Debug, Clone)]
pub(crate) struct Grid {
    /// Time of the first step by the robot's clock, s.
    pub start_s: f64,
    /// Interval, s.
    pub dt_s: f64,
    /// Steps.
    pub n: usize,
    /// Joint coordinates, `[joint][step]`; NaN in gaps.
    pub q: Vec<Vec<f64>>,
    /// Angular velocity; interpolated through gaps, which `sensors_valid` marks.
    pub gyro: Option<Vec<Vector3<f64>>>,
    /// Specific force; the same.
    pub acc: Option<Vec<Vector3<f64>>>,
    /// False in gaps of the log.
    pub sensors_valid: Vec<bool>,
    /// Remarks on gaps.
    pub warnings: Vec<String>,
}

/// Intervals longer than this many usual ones are gaps.
const GAP: f64 = 1.6;
/// Jitter of the rows' times above which values are interpolated, as a share of the interval.
const JITTER: f64 = 0.002;
/// Factor on the variance of an inertial unit's step within a gap.
const IN_GAP: f64 = 1e4;

impl Grid {
    /// Puts a log on the grid of its median interval.
    ///
    /// # Errors
    /// [`RobotError::Log`] for a log of which most is missing.
    pub(crate) fn of(log: &RobotLog) -> Result<Self, RobotError> {
        let times = &log.time_s;
        let (start_s, end_s) = (times[0], times[times.len() - 1]);
        // the mean interval of all steps that are no gaps is more exact than one rounded step
        let usual = log.interval_s();
        let regular: Vec<f64> = times.windows(2).map(|w| w[1] - w[0]).filter(|d| *d < GAP * usual).collect();
        let mean = regular.iter().sum::<f64>() / regular.len().max(1) as f64;
        let gaps: Vec<(f64, f64)> =
            times.windows(2).filter(|w| w[1] - w[0] >= GAP * usual).map(|w| (w[0], w[1] - w[0])).collect();
        // a rate is a round number more often than not; keep it then, so that files compare
        let rate = (1.0 / mean).round();
        let dt_s = if (mean * rate - 1.0).abs() < 1e-4 && rate > 0.0 { 1.0 / rate } else { mean };
        let n = ((end_s - start_s) / dt_s).round() as usize + 1;
        if n > 20 * times.len() {
            return Err(RobotError::log(
                &log.file,
                format!(
                    "{} rows over {:.1} s at intervals of {:.2} ms: most of the log is missing",
                    times.len(),
                    end_s - start_s,
                    dt_s * 1e3
                ),
                "log at a constant rate",
            ));
        }
        let mut warnings = Vec::new();
        if let Some(longest) = gaps.iter().max_by(|a, b| a.1.total_cmp(&b.1)) {
            warnings.push(format!(
                "{} gaps in the log, the longest of {:.3} s at {:.3} s: frames in them are left out",
                gaps.len(),
                longest.1,
                longest.0
            ));
        }
        // for each step: the row before it, and the share of the way to the next; none in gaps
        let mut row = 0;
        let place: Vec<Option<(usize, f64)>> = (0..n)
            .map(|i| {
                let t = start_s + i as f64 * dt_s;
                while row + 2 < times.len() && times[row + 1] <= t {
                    row += 1;
                }
                let width = times[row + 1] - times[row];
                let share = ((t - times[row]) / width).clamp(0.0, 1.0);
                let snapped = if (share * width) < JITTER * dt_s {
                    0.0
                } else if ((1.0 - share) * width) < JITTER * dt_s {
                    1.0
                } else {
                    share
                };
                (snapped == 0.0 || snapped == 1.0 || width < GAP * usual).then_some((row, snapped))
            })
            .collect();
        let at = |values: &[f64], i: usize| match place[i] {
            None => f64::NAN,
            Some((row, 0.0)) => values[row],
            Some((row, 1.0)) => values[row + 1],
            Some((row, share)) => cubic(times, values, row, share, GAP * usual),
        };
        let q: Vec<Vec<f64>> = log.q.iter().map(|values| (0..n).map(|i| at(values, i)).collect()).collect();
        let mut sensors_valid: Vec<bool> = place.iter().map(Option::is_some).collect();
        let mut vectors = |source: &Option<Vec<Vector3<f64>>>| {
            source.as_ref().map(|values| {
                let axes: Vec<Vec<f64>> = (0..3).map(|k| values.iter().map(|v| v[k]).collect()).collect();
                let mut out: Vec<Vector3<f64>> =
                    (0..n).map(|i| Vector3::new(at(&axes[0], i), at(&axes[1], i), at(&axes[2], i))).collect();
                bridge(&mut out, &mut sensors_valid);
                out
            })
        };
        let (gyro, acc) = (vectors(&log.gyro), vectors(&log.acc));
        Ok(Self { start_s, dt_s, n, q, gyro, acc, sensors_valid, warnings })
    }

    /// Raises variances of steps within gaps, where the sensors are interpolated.
    pub(crate) fn widen(&self, variance: &mut [f64]) {
        for (v, valid) in variance.iter_mut().zip(&self.sensors_valid) {
            if !valid {
                *v *= IN_GAP;
            }
        }
    }
}

/// Cubic through four rows at their own times (Lagrange); linear where one is missing or farther
/// away than `gap`.
fn cubic(times: &[f64], values: &[f64], row: usize, share: f64, gap: f64) -> f64 {
    let linear = values[row] + (values[row + 1] - values[row]) * share;
    let Some(first) = row.checked_sub(1).filter(|_| row + 2 < values.len()) else { return linear };
    let (x, y) = (&times[first..first + 4], &values[first..first + 4]);
    if y.iter().any(|v| !v.is_finite()) || x.windows(2).any(|w| w[1] - w[0] >= gap) {
        return linear;
    }
    let t = times[row] + share * (times[row + 1] - times[row]);
    (0..4).map(|i| y[i] * (0..4).filter(|j| *j != i).map(|j| (t - x[j]) / (x[i] - x[j])).product::<f64>()).sum()
}

/// Fills missing vectors linearly, and marks them.
fn bridge(values: &mut [Vector3<f64>], valid: &mut [bool]) {
    let good: Vec<usize> = (0..values.len()).filter(|&i| values[i].iter().all(|x| x.is_finite())).collect();
    let Some((&first, &last)) = good.first().zip(good.last()) else {
        values.fill(Vector3::zeros());
        valid.fill(false);
        return;
    };
    for i in 0..values.len() {
        if values[i].iter().all(|x| x.is_finite()) {
            continue;
        }
        valid[i] = false;
        values[i] = if i < first {
            values[first]
        } else if i > last {
            values[last]
        } else {
            let after = good.partition_point(|g| *g < i);
            let (a, b) = (good[after - 1], good[after]);
            values[a].lerp(&values[b], (i - a) as f64 / (b - a) as f64)
        };
    }
}

/// Standard deviation of an encoder: its step over √12, from the smallest difference between two
/// values that is no rounding of the file.
pub(crate) fn encoder_sd(values: &[f64]) -> f64 {
    let mut steps: Vec<f64> =
        values.windows(2).map(|w| (w[1] - w[0]).abs()).filter(|d| *d > 1e-9 && d.is_finite()).collect();
    if steps.len() < 20 {
        return 1e-5;
    }
    steps.sort_by(f64::total_cmp);
    // small steps are whole multiples of the encoder's; the smallest are single ones
    let step = steps[(steps.len() / 400).min(20)];
    (step / 12f64.sqrt()).clamp(1e-8, 1e-2)
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used, reason = "tests fail by panicking")]
    use super::*;

    fn log(times: Vec<f64>, of: impl Fn(f64) -> f64) -> RobotLog {
        let q = vec![times.iter().map(|t| of(*t)).collect()];
        RobotLog { file: "log.csv".to_owned(), time_s: times, q, ..RobotLog::default() }
    }

    #[test]
    fn a_regular_log_is_kept_as_it_is() {
        let log = log((0..500).map(|i| 100.0 + (i as f64 * 0.002 * 1e3).round() / 1e3).collect(), f64::sin);
        let grid = Grid::of(&log).unwrap();
        assert_eq!((grid.n, grid.dt_s), (500, 0.002));
        assert_eq!(grid.q[0], log.q[0]);
        assert!(grid.warnings.is_empty());
    }

    #[test]
    fn jitter_is_interpolated_and_gaps_stay_missing() {
        let mut times: Vec<f64> = (0..500).map(|i| i as f64 * 0.004 + 0.0006 * (1.7 * i as f64).sin()).collect();
        times.drain(200..230);
        let log = log(times, |t| (3.0 * t).sin());
        let grid = Grid::of(&log).unwrap();
        let missing = grid.q[0].iter().filter(|x| x.is_nan()).count();
        assert!((28..=32).contains(&missing), "{missing}");
        for (i, x) in grid.q[0].iter().enumerate().filter(|(_, x)| x.is_finite()) {
            let t = grid.start_s + i as f64 * grid.dt_s;
            assert!((x - (3.0 * t).sin()).abs() < 5e-5, "step {i}: {}", x - (3.0 * t).sin());
        }
        assert!(grid.warnings[0].starts_with("1 gaps in the log"), "{:?}", grid.warnings);
    }

    #[test]
    fn the_step_of_an_encoder_is_seen_in_its_values() {
        let step = std::f64::consts::TAU / 65536.0;
        let values: Vec<f64> = (0..4000).map(|i| ((0.01 * i as f64).sin() / step).round() * step).collect();
        assert!((encoder_sd(&values) / (step / 12f64.sqrt()) - 1.0).abs() < 0.01);
    }
}
