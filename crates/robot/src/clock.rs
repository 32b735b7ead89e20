//! A first estimate of the offset between two clocks from the speed of rotation, which needs
//! neither axes nor a common origin of time.

use crate::log::{BaseLog, RobotLog};
use nalgebra::Vector3;

/// Rate at which the speeds are compared, Hz.
const RATE_HZ: f64 = 200.0;
/// Correlation below which no offset is believed.
const LEAST_CORRELATION: f64 = 0.7;
/// Fastest rotation below which a recording counts as at rest, rad/s.
pub(crate) const AT_REST_RAD_S: f64 = 0.3;

/// Result of the search.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RoughOffset {
    /// The base's time minus the log's time of the same instant, s.
    pub offset_s: f64,
    /// Correlation of the speeds at that offset.
    pub correlation: f64,
}

/// Angular velocity of the base in its own axes by central differences over `reach` rows, rad/s,
/// with the times.
pub(crate) fn base_rates(base: &BaseLog, reach: usize) -> Vec<(f64, Vector3<f64>)> {
    let n = base.time_s.len();
    (reach..n.saturating_sub(reach))
        .filter(|&i| base.is_valid(i - reach) && base.is_valid(i + reach) && base.is_valid(i))
        .map(|i| {
            let (a, b) = (&base.rotation[i - reach], &base.rotation[i + reach]);
            let dt = base.time_s[i + reach] - base.time_s[i - reach];
            let turn = (a.inverse() * b).scaled_axis() / dt;
            // the difference is along axes half-way between, which are those of row i
            (base.time_s[i], turn)
        })
        .collect()
}

/// Speeds on a regular grid from `start`, by linear interpolation; NaN outside and in gaps.
fn on_grid(samples: &[(f64, f64)], start_s: f64, n: usize) -> Vec<f64> {
    let mut at = 0;
    (0..n)
        .map(|i| {
            let t = start_s + i as f64 / RATE_HZ;
            while at + 1 < samples.len() && samples[at + 1].0 < t {
                at += 1;
            }
            let (Some(a), Some(b)) = (samples.get(at), samples.get(at + 1)) else { return f64::NAN };
            if t < a.0 || t > b.0 || b.0 - a.0 > 0.05 {
                return f64::NAN;
            }
            a.1 + (b.1 - a.1) * (t - a.0) / (b.0 - a.0)
        })
        .collect()
}

/// Searches the offset at which the speeds of rotation by the gyroscope and by the base's pose
/// agree best; none if the log has no gyroscope, the base hardly turns, or no offset fits.
pub fn rough_offset(log: &RobotLog, base: &BaseLog) -> Option<RoughOffset> {
    let gyro = log.gyro.as_ref()?;
    let of_log: Vec<(f64, f64)> =
        log.time_s.iter().zip(gyro).filter(|(_, g)| g.norm().is_finite()).map(|(t, g)| (*t, g.norm())).collect();
    let of_base: Vec<(f64, f64)> = base_rates(base, 2).into_iter().map(|(t, w)| (t, w.norm())).collect();
    let fastest = of_log.iter().map(|s| s.1).fold(0.0, f64::max);
    let (first, last) = (of_log.first()?, of_log.last()?);
    let (base_first, base_last) = (of_base.first()?, of_base.last()?);
    if fastest < AT_REST_RAD_S {
        return None;
    }
    if (last.0 - first.0).max(base_last.0 - base_first.0) > LONGEST_S {
        return None;
    }
    let n = ((last.0 - first.0) * RATE_HZ) as usize;
    let m = ((base_last.0 - base_first.0) * RATE_HZ) as usize;
    let x = on_grid(&of_log, first.0, n);
    let y = on_grid(&of_base, base_first.0, m);
    // long recordings are first compared on means of several steps, then closely about the best
    let by = n.max(m).div_ceil(MOST_STEPS).max(1);
    let all = -(n as i64)..m as i64;
    let lags = match by {
        1 => all,
        _ => {
            let (x, y) = (means(&x, by), means(&y, by));
            let (_, lag) = best_lag(&x, &y, -(x.len() as i64)..y.len() as i64)?;
            let (middle, reach) = (lag * by as i64, 2 * by as i64);
            all.start.max(middle - reach)..all.end.min(middle + reach)
        }
    };
    let (correlation, lag) = best_lag(&x, &y, lags)?;
    // a parabola through the neighbours: a fraction of a step
    let (before, after) = (score(&x, &y, lag - 1), score(&x, &y, lag + 1));
    let bend = before - 2.0 * correlation + after;
    let part = if bend < 0.0 { (0.5 * (before - after) / bend).clamp(-0.5, 0.5) } else { 0.0 };
    Some(RoughOffset { offset_s: base_first.0 - first.0 + (lag as f64 + part) / RATE_HZ, correlation })
}

/// Longest recording whose clock is sought, s.
const LONGEST_S: f64 = 86_400.0;
/// Most steps that are compared at every lag.
const MOST_STEPS: usize = 8000;

/// Means of groups of `by` values; NaN where more than half of a group is not known.
fn means(x: &[f64], by: usize) -> Vec<f64> {
    x.chunks(by)
        .map(|c| {
            let known = c.iter().filter(|v| !v.is_nan());
            let n = known.clone().count();
            if 2 * n < by { f64::NAN } else { known.sum::<f64>() / n as f64 }
        })
        .collect()
}

/// The lag with the largest correlation above the least that counts; of equal ones the first.
fn best_lag(x: &[f64], y: &[f64], lags: std::ops::Range<i64>) -> Option<(f64, i64)> {
    let mut best: Option<(f64, i64)> = None;
    for lag in lags {
        let r = score(x, y, lag);
        if r > best.map_or(LEAST_CORRELATION, |b| b.0) {
            best = Some((r, lag));
        }
    }
    best
}

/// Correlation of two series where the second shows the same instant `lag` steps later; NaN if they
/// overlap too little.
fn score(x: &[f64], y: &[f64], lag: i64) -> f64 {
    let least = (0.4 * x.len().min(y.len()) as f64) as usize;
    let (mut count, mut sx, mut sy, mut sxx, mut syy, mut sxy) = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0);
    for (i, a) in x.iter().enumerate() {
        // none: beyond the ends of the series there is nothing to compare
        let Some(b) = usize::try_from(i as i64 + lag).ok().and_then(|j| y.get(j)) else { continue };
        if a.is_nan() || b.is_nan() {
            continue;
        }
        count += 1.0;
        sx += a;
        sy += b;
        sxx += a * a;
        syy += b * b;
        sxy += a * b;
    }
    let spread = (sxx - sx * sx / count) * (syy - sy * sy / count);
    if count < least.max(20) as f64 || spread <= 0.0 { f64::NAN } else { (sxy - sx * sy / count) / spread.sqrt() }
}
