//! A log on a regular grid of times. Short gaps are bridged, with the error of the bridge; what is
//! longer stays missing.

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
    /// Joint coordinates, `[joint][step]`; NaN in gaps that are not bridged.
    pub q: Vec<Vec<f64>>,
    /// Standard deviation of the interpolation in bridged gaps, `[joint][step]`; 0 elsewhere.
    pub q_sd: Vec<Vec<f64>>,
    /// Angular velocity; interpolated through gaps, which `sensors_valid` marks.
    pub gyro: Option<Vec<Vector3<f64>>>,
    /// Specific force; the same.
    pub acc: Option<Vec<Vector3<f64>>>,
    /// False in gaps of the inertial unit.
    sensors_valid: Vec<bool>,
    /// False in gaps of the inertial unit that are not bridged.
    pub usable: Vec<bool>,
    /// Remarks on gaps.
    pub warnings: Vec<String>,
}

/// Intervals longer than this many usual ones are gaps.
const GAP: f64 = 1.6;
/// Jitter of the rows' times above which values are interpolated, as a share of the interval.
const JITTER: f64 = 0.002;
/// Factor on the variance of an inertial unit's step within a gap.
const IN_GAP: f64 = 1e4;
/// Places on either side of a gap at which its interpolation is tried on rows that are known: with
/// two fifths of them at hand its error is known to a tenth.
const TRIED: usize = 50;

impl Grid {
    /// Puts a log on the grid of its median interval. Rows that are no farther apart than
    /// `bridged_s` are interpolated where rows or cells between them are missing, with the error
    /// that the interpolation has on known rows nearby.
    ///
    /// # Errors
    /// [`RobotError::Log`] for a log of which most is missing.
    pub(crate) fn of(log: &RobotLog, bridged_s: f64) -> Result<Self, RobotError> {
        let times = &log.time_s;
        let (start_s, end_s) = (times[0], times[times.len() - 1]);
        // the mean interval of all steps that are no gaps is more exact than one rounded step
        let usual = log.interval_s();
        let regular: Vec<f64> = times.windows(2).map(|w| w[1] - w[0]).filter(|d| *d < GAP * usual).collect();
        let mean = regular.iter().sum::<f64>() / regular.len().max(1) as f64;
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
        let steps = Steps { times, start_s, dt_s, n, usual };
        let (q, q_sd): (Vec<_>, Vec<_>) = log.q.iter().map(|values| steps.series(values, bridged_s)).unzip();
        let mut sensors_valid = vec![true; n];
        let mut vectors = |source: &Option<Vec<Vector3<f64>>>| {
            source.as_ref().map(|values| {
                let axes: Vec<Vec<f64>> = (0..3)
                    .map(|k| steps.series(&values.iter().map(|v| v[k]).collect::<Vec<_>>(), GAP * usual).0)
                    .collect();
                let mut out: Vec<Vector3<f64>> =
                    (0..n).map(|i| Vector3::new(axes[0][i], axes[1][i], axes[2][i])).collect();
                bridge(&mut out, &mut sensors_valid);
                out
            })
        };
        let (gyro, acc) = (vectors(&log.gyro), vectors(&log.acc));
        let mut usable = Vec::with_capacity(n);
        for run in sensors_valid.chunk_by(|a, b| a == b) {
            // n missing steps lie between rows that are n + 1 steps apart
            let short = (run.len() + 1) as f64 * dt_s <= bridged_s + JITTER * dt_s;
            usable.extend(run.iter().map(|valid| *valid || short));
        }
        let mut warnings: Vec<String> = steps.remark(bridged_s).into_iter().collect();
        let cells = log.q.iter().flatten().filter(|x| !x.is_finite()).count();
        if cells > 0 {
            warnings.push(format!("{cells} cells of joint columns hold no number and count as gaps in that joint"));
        }
        Ok(Self { start_s, dt_s, n, q, q_sd, gyro, acc, sensors_valid, usable, warnings })
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

/// The steps of a grid, and the rows of the log that they lie between.
struct Steps<'a> {
    times: &'a [f64],
    start_s: f64,
    dt_s: f64,
    n: usize,
    /// Median interval of the rows, s.
    usual: f64,
}

impl Steps<'_> {
    /// A column at the steps, and the standard deviation of its interpolation in gaps. NaN where
    /// the known rows before and after a step are farther apart than `bridged_s`.
    fn series(&self, values: &[f64], bridged_s: f64) -> (Vec<f64>, Vec<f64>) {
        let (mut out, mut sd) = (vec![f64::NAN; self.n], vec![0.0; self.n]);
        let (times, values): (Vec<f64>, Vec<f64>) =
            self.times.iter().zip(values).filter(|(_, v)| v.is_finite()).map(|(t, v)| (*t, *v)).unzip();
        let known = Known { times, values, gap: GAP * self.usual };
        if known.times.len() < 2 {
            return (out, sd);
        }
        let (mut row, mut tried) = (0, None);
        for i in 0..self.n {
            let t = self.start_s + i as f64 * self.dt_s;
            while row + 2 < known.times.len() && known.times[row + 1] <= t {
                row += 1;
            }
            let (before, after) = (known.times[row], known.times[row + 1]);
            if (t - before).abs() < JITTER * self.dt_s {
                out[i] = known.values[row];
            } else if (t - after).abs() < JITTER * self.dt_s {
                out[i] = known.values[row + 1];
            } else if t < before || t > after {
                continue;
            } else if after - before < known.gap {
                out[i] = known.cubic(row, t);
            } else if after - before <= bridged_s + JITTER * self.dt_s {
                // one trial for all steps of a gap
                if tried.is_none_or(|(of, _)| of != row) {
                    let rows = ((after - before) / self.usual).round() as usize;
                    tried = Some((row, known.tried(row, rows)));
                }
                if let (Some((_, Some(error))), Some(four)) = (tried, known.four(row, row + 1)) {
                    (out[i], sd[i]) = (lagrange(four.0, four.1, t), error);
                }
            }
        }
        (out, sd)
    }

    /// What was done with gaps between rows.
    fn remark(&self, bridged_s: f64) -> Option<String> {
        let gaps = || self.times.windows(2).map(|w| (w[0], w[1] - w[0])).filter(|g| g.1 >= GAP * self.usual);
        let longest = gaps().max_by(|a, b| a.1.total_cmp(&b.1))?;
        let (all, open) = (gaps().count(), gaps().filter(|g| g.1 > bridged_s + JITTER * self.dt_s).count());
        let what = match open {
            0 => "all are interpolated, and the interpolation error is part of the noise".to_owned(),
            _ if open == all => "frames in them are left out".to_owned(),
            _ => format!("frames in {open} of them are left out, the others are interpolated"),
        };
        Some(format!("{all} gaps in the log, the longest of {:.3} s at {:.3} s: {what}", longest.1, longest.0))
    }
}

/// Rows of a column that have a value.
struct Known {
    times: Vec<f64>,
    values: Vec<f64>,
    /// Interval from which on rows are missing between two others, s.
    gap: f64,
}

/// Four times and values.
type Four = ([f64; 4], [f64; 4]);

impl Known {
    /// Rows `a` and `b` with one before and one after them.
    fn four(&self, a: usize, b: usize) -> Option<Four> {
        let rows = [a.checked_sub(1)?, a, b, b + 1];
        (b + 1 < self.times.len()).then(|| (rows.map(|r| self.times[r]), rows.map(|r| self.values[r])))
    }

    /// Between a row and the next one: cubic through four rows, linear where one of them is
    /// missing.
    fn cubic(&self, row: usize, t: f64) -> f64 {
        let close = |four: &Four| four.0.windows(2).all(|w| w[1] - w[0] < self.gap);
        match self.four(row, row + 1).filter(close) {
            Some((x, y)) => lagrange(x, y, t),
            None => {
                let share = (t - self.times[row]) / (self.times[row + 1] - self.times[row]);
                self.values[row] + (self.values[row + 1] - self.values[row]) * share
            }
        }
    }

    /// Root mean square error of the cubic over a gap of `rows` intervals, where known rows near
    /// `row` are left out; none where no such rows are.
    fn tried(&self, row: usize, rows: usize) -> Option<f64> {
        let (mut squares, mut count) = (0.0, 0);
        for a in row.saturating_sub(TRIED + rows)..=row + TRIED {
            let b = a + rows;
            let Some((x, y)) = self.four(a, b) else { continue };
            let all = &self.times[a - 1..=b + 1];
            if all.windows(2).any(|w| w[1] - w[0] >= self.gap) {
                continue;
            }
            for left_out in a + 1..b {
                squares += (lagrange(x, y, self.times[left_out]) - self.values[left_out]).powi(2);
                count += 1;
            }
        }
        (count > 0).then(|| (squares / f64::from(count)).sqrt())
    }
}

/// The cubic through four points.
fn lagrange(x: [f64; 4], y: [f64; 4], t: f64) -> f64 {
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
        let grid = Grid::of(&log, 0.0).unwrap();
        assert_eq!((grid.n, grid.dt_s), (500, 0.002));
        assert_eq!(grid.q[0], log.q[0]);
        assert!(grid.warnings.is_empty());
    }

    #[test]
    fn jitter_is_interpolated_and_gaps_stay_missing() {
        let mut times: Vec<f64> = (0..500).map(|i| i as f64 * 0.004 + 0.0006 * (1.7 * i as f64).sin()).collect();
        times.drain(200..230);
        let log = log(times, |t| (3.0 * t).sin());
        let grid = Grid::of(&log, 0.0).unwrap();
        let missing = grid.q[0].iter().filter(|x| x.is_nan()).count();
        assert!((28..=32).contains(&missing), "{missing}");
        for (i, x) in grid.q[0].iter().enumerate().filter(|(_, x)| x.is_finite()) {
            let t = grid.start_s + i as f64 * grid.dt_s;
            assert!((x - (3.0 * t).sin()).abs() < 5e-5, "step {i}: {}", x - (3.0 * t).sin());
        }
        assert!(grid.warnings[0].starts_with("1 gaps in the log"), "{:?}", grid.warnings);
    }

    /// One row in twenty and single cells: bridged within the error that is stated, which does not
    /// come from the function that made the values.
    #[test]
    fn short_gaps_are_bridged_with_their_error() {
        let mut times: Vec<f64> = (0..1000).map(|i| f64::from(i) * 0.004).collect();
        let motion = |t: f64| (9.0 * t).sin() + 0.3 * (40.0 * t).sin();
        times.retain(|t| ((t / 0.004).round() as usize) % 20 != 7);
        times.drain(505..508);
        let mut log = log(times, motion);
        log.q[0][300..302].fill(f64::NAN);
        let grid = Grid::of(&log, 0.017).unwrap();
        assert_eq!(grid.q[0].iter().filter(|x| x.is_nan()).count(), 0);
        assert!(grid.usable.iter().all(|u| *u));
        let bridged: Vec<(f64, f64)> = (0..grid.n)
            .filter(|&i| grid.q_sd[0][i] > 0.0)
            .map(|i| (grid.q[0][i] - motion(i as f64 * 0.004), grid.q_sd[0][i]))
            .collect();
        assert!(bridged.len() >= 52, "{}", bridged.len());
        let ratio = (bridged.iter().map(|(e, sd)| (e / sd).powi(2)).sum::<f64>() / bridged.len() as f64).sqrt();
        assert!((0.5..1.6).contains(&ratio), "{ratio}");
        assert!(grid.warnings[0].ends_with("part of the noise"), "{:?}", grid.warnings);
        // longer ones stay missing
        let grid = Grid::of(&log, 0.009).unwrap();
        assert_eq!(grid.q[0].iter().filter(|x| x.is_nan()).count(), 5);
        assert!(grid.warnings[0].contains("frames in 1 of them are left out"), "{:?}", grid.warnings);
    }

    #[test]
    fn the_step_of_an_encoder_is_seen_in_its_values() {
        let step = std::f64::consts::TAU / 65536.0;
        let values: Vec<f64> = (0..4000).map(|i| ((0.01 * i as f64).sin() / step).round() * step).collect();
        assert!((encoder_sd(&values) / (step / 12f64.sqrt()) - 1.0).abs() < 0.01);
    }
}
