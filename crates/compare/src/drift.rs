//! How force plates drift, from what they read unloaded in one flight after the other.
//!
//! Amplifiers wander by some tenths of a newton in seconds. In a flight nothing touches a plate, so that its reading there is known; between
//! and without flights it is not, and the wander is an error of the measurement that no model can explain. The wander is taken as a
//! random walk of the total wrench: the difference of the readings in two flights of a recording that are τ apart has covariance `C τ + 2 N`,
//! with N the covariance of one reading (white noise of the plates over the length of a flight). C is estimated over the recordings
//! of a subject other than the one that is judged.

use nalgebra::{Matrix6, Vector6};
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};

/// Variance of a median over that of a mean, for normal noise.
const MEDIAN: f64 = std::f64::consts::FRAC_PI_2;

/// What all plates together read unloaded in the flights of one recording.
#[derive(Debug, Clone, Default)]
pub struct TareReadings {
    /// Middle of each flight, s.
    pub times_s: Vec<f64>,
    /// Force (N) and moment about the world origin (N·m), world axes.
    pub wrench: Vec<Vector6<f64>>,
    /// Mean time over which a reading was taken, s.
    pub length_s: f64,
}

/// A random walk of the total wrench of the plates, and when a recording shows it.
#[derive(Debug, Clone)]
pub struct PlateDrift {
    /// Root of the walk's covariance a second, about the world origin (N/√s, N·m/√s).
    root: Matrix6<f64>,
    /// Times at which this recording's plates were seen unloaded, s: the walk is known there.
    times_s: Vec<f64>,
}

impl PlateDrift {
    /// From the readings of other recordings. `noise_density` is the one-sided white density of the total wrench, `times_s` when the plates of the
    /// recording in question were unloaded. `None` where no other recording has two flights.
    pub fn of(others: &[&TareReadings], noise_density: &Vector6<f64>, times_s: Vec<f64>) -> Option<Self> {
        let (mut sum, mut squares) = (Matrix6::zeros(), 0.0);
        for readings in others {
            let noise = noise_density * (MEDIAN / readings.length_s.max(1e-3));
            for j in 1..readings.times_s.len() {
                for i in 0..j {
                    let apart = readings.times_s[j] - readings.times_s[i];
                    let change = readings.wrench[j] - readings.wrench[i];
                    // the density over twice the length is the variance of a mean; two readings are compared
                    sum += (change * change.transpose() - Matrix6::from_diagonal(&noise)) * apart;
                    squares += apart * apart;
                }
            }
        }
        if squares <= 0.0 || !sum.iter().all(|x| x.is_finite()) {
            return None;
        }
        let rate = sum / squares;
        // newtons and newton metres alike: in units of what the channels show
        let scale = rate.diagonal().map(|x| x.abs().max(f64::MIN_POSITIVE).sqrt());
        let unit = Matrix6::from_fn(|i, j| rate[(i, j)] / (scale[i] * scale[j]));
        let eigen = unit.symmetric_eigen();
        let roots = eigen.eigenvalues.map(|l| l.max(0.0).sqrt());
        let root = Matrix6::from_diagonal(&scale) * eigen.eigenvectors * Matrix6::from_diagonal(&roots);
        Some(Self { root, times_s })
    }

    /// Variance of the walk in one second, each component (N², (N·m)²).
    pub fn variance_per_s(&self) -> Vector6<f64> {
        (self.root * self.root.transpose()).diagonal()
    }

    /// One walk at `n` frames, less straight lines between the times at which the recording shows it (constants beyond).
    pub(crate) fn draw(&self, n: usize, rate_hz: f64, rng: &mut ChaCha8Rng) -> Vec<Vector6<f64>> {
        let step = rate_hz.sqrt().recip();
        let mut at = Vector6::zeros();
        let walk: Vec<Vector6<f64>> = (0..n)
            .map(|_| {
                let normal = Vector6::from_fn(|_, _| -> f64 { StandardNormal.sample(rng) });
                at += self.root * normal * step;
                at
            })
            .collect();
        let known: Vec<(f64, Vector6<f64>)> = self
            .times_s
            .iter()
            .filter(|t| t.is_finite() && **t >= 0.0)
            .filter_map(|t| walk.get((t * rate_hz).round() as usize).map(|w| (*t, *w)))
            .collect();
        let Some(&(_, start)) = known.first() else { return walk };
        let seen = |t: f64| match known.iter().position(|k| k.0 >= t) {
            Some(0) => start,
            None => known[known.len() - 1].1,
            Some(next) => {
                let ((t0, a), (t1, b)) = (known[next - 1], known[next]);
                a + (b - a) * ((t - t0) / (t1 - t0))
            }
        };
        walk.iter().enumerate().map(|(f, w)| w - seen(f as f64 / rate_hz)).collect()
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "tests")]
mod tests {
    use super::*;
    use rand::SeedableRng;

    #[test]
    fn prop_a_walk_is_recovered_from_readings_and_vanishes_where_it_is_known() {
        let truth = PlateDrift {
            root: Matrix6::from_fn(|i, j| if i == j { 0.1 + 0.05 * i as f64 } else if i == j + 3 { 0.08 } else { 0.0 }),
            times_s: Vec::new(),
        };
        let (rate_hz, length_s) = (100.0, 0.5);
        let density = Vector6::repeat(2e-3);
        let mut rng = ChaCha8Rng::seed_from_u64(5);
        let readings: Vec<TareReadings> = (0..400)
            .map(|_| {
                let walk = truth.draw(500, rate_hz, &mut rng);
                let times_s = vec![1.0, 2.0, 3.5];
                let sd = (0.5 * MEDIAN * density[0] / length_s).sqrt();
                let wrench = times_s
                    .iter()
                    .map(|t: &f64| {
                        walk[(t * rate_hz) as usize]
                            + Vector6::from_fn(|_, _| -> f64 { StandardNormal.sample(&mut rng) }) * sd
                    })
                    .collect();
                TareReadings { times_s, wrench, length_s }
            })
            .collect();
        let all: Vec<&TareReadings> = readings.iter().collect();
        let found = PlateDrift::of(&all, &density, vec![1.0, 4.0]).unwrap();
        let (a, b) = (found.root * found.root.transpose(), truth.root * truth.root.transpose());
        assert!((a - b).norm() < 0.15 * b.norm(), "{a} {b}");
        let walk = found.draw(500, rate_hz, &mut rng);
        assert!(walk[100].norm() < 1e-12 && walk[400].norm() < 1e-12 && walk[250].norm() > 0.0);
        assert!(PlateDrift::of(&[], &density, Vec::new()).is_none());
        assert!(PlateDrift::of(&[&TareReadings::default()], &density, Vec::new()).is_none());
    }
}
