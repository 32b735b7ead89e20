//! Drift of force plates, estimated from their unloaded readings in successive flights.
//!
//! Amplifiers drift by some tenths of a newton within seconds. In a flight nothing touches a plate,
//! so that its true load is zero; between flights and without flights the drift is unknown, and it
//! is an error of the measurement that no model can explain. Over the seconds of a recording each
//! plate is assumed to drift linearly, with its own rate for force and moment about its centre: the
//! difference of the readings in two flights of a recording that are τ apart has variance `s² τ² +
//! 2 n`, n the variance of one reading (white noise of the plates over the length of a flight). s²
//! is estimated over the recordings of a subject except the one being judged, with all plates and
//! both horizontal axes pooled, since a few recordings give only a few differences. So few that s²
//! is uncertain by a third and more; each draw therefore uses another s² that fits the readings.

use nalgebra::{Vector3, Vector4, Vector6};
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rand_distr::{ChiSquared, Distribution, StandardNormal};

/// Variance of a median over that of a mean, for normal noise.
const MEDIAN: f64 = std::f64::consts::FRAC_PI_2;
const RATE_SEED: u64 = 0x6472_6966;

/// Unloaded readings of the plates in the flights of one recording.
#[derive(Debug, Clone, Default)]
pub struct TareReadings {
    /// Middle of each flight, s.
    pub times_s: Vec<f64>,
    /// For each plate: its centre (world, m), and in each flight its force (N) and moment about the
    /// world origin (N·m), world axes.
    pub plates: Vec<(Vector3<f64>, Vec<Vector6<f64>>)>,
    /// Mean averaging time of a reading, s.
    pub length_s: f64,
}

/// Linear drift of the plates, and the times at which a recording shows them unloaded.
#[derive(Debug, Clone)]
pub struct PlateDrift {
    /// Mean squares from which the variance of the rate follows: of a horizontal force, the
    /// vertical force ((N/s)²), a horizontal moment and the vertical moment about the plate's
    /// centre ((N·m/s)²).
    rate: [RateEstimate; 4],
    /// Centres of the plates, m.
    centres: Vec<Vector3<f64>>,
    /// Times at which the plates of this recording were unloaded, s: the drift is known there.
    times_s: Vec<f64>,
}

/// An estimate of the variance of a rate of drift.
#[derive(Debug, Clone, Copy, PartialEq)]
struct RateEstimate {
    /// Mean square of the differences of readings over their squared distances in time.
    seen: f64,
    /// The part of it that white noise of the readings causes.
    noise: f64,
    /// Degrees of freedom of `seen`.
    freedom: f64,
}

impl RateEstimate {
    /// Fewest degrees of freedom that are assumed; with two or fewer the mean does not exist.
    const FEWEST: f64 = 3.0;

    /// From the sums of each plate in each recording: squared differences and their noise, both
    /// times the squared distance in time, and the fourth power of that distance.
    fn of(units: &[(f64, f64, f64)]) -> Self {
        let squares: f64 = units.iter().map(|u| u.2).sum();
        let seen = units.iter().map(|u| u.0).sum::<f64>() / squares;
        let noise = units.iter().map(|u| u.1).sum::<f64>() / squares;
        let n = units.len() as f64;
        let scatter: f64 = units.iter().map(|u| (u.0 - seen * u.2).powi(2)).sum();
        let variance = scatter * n / (n - 1.0) / squares.powi(2);
        // a multiple of χ² with ν degrees of freedom has variance 2 mean² / ν
        let freedom = if variance > 0.0 { 2.0 * seen * seen / variance } else { Self::FEWEST };
        Self { seen, noise, freedom: freedom.clamp(Self::FEWEST, n.max(Self::FEWEST)) }
    }

    /// The estimated variance.
    fn variance(&self) -> f64 {
        (self.seen - self.noise).max(0.0)
    }

    /// A variance that fits the readings: `seen` is a multiple of χ², so that the true mean square
    /// is `seen ν / χ²`.
    fn drawn(&self, rng: &mut ChaCha8Rng) -> f64 {
        // none: the freedom is at least that of one reading, for which the distribution exists
        let Ok(chi) = ChiSquared::new(self.freedom) else { return self.variance() };
        (self.seen * self.freedom / chi.sample(rng).max(f64::MIN_POSITIVE) - self.noise).max(0.0)
    }
}

/// The variances of the four kinds for the six axes.
fn each_axis(four: Vector4<f64>) -> Vector6<f64> {
    Vector6::new(four[0], four[0], four[1], four[2], four[2], four[3])
}

fn about(wrench: &Vector6<f64>, point: &Vector3<f64>) -> Vector6<f64> {
    let force: Vector3<f64> = wrench.fixed_rows::<3>(0).into();
    let moment: Vector3<f64> = wrench.fixed_rows::<3>(3).into();
    let m = moment - point.cross(&force);
    Vector6::new(force.x, force.y, force.z, m.x, m.y, m.z)
}

/// White density of one plate about its centre, from that of the sum of `centres.len()` identical
/// plates about the world origin.
fn density_of_one(total: &Vector6<f64>, centres: &[Vector3<f64>]) -> Vector6<f64> {
    let n = centres.len().max(1) as f64;
    let force: Vector3<f64> = total.fixed_rows::<3>(0) / n;
    let mut out = total / n;
    for axis in 0..3 {
        let (y, z) = ((axis + 1) % 3, (axis + 2) % 3);
        let lever: f64 = centres.iter().map(|c| c[y].powi(2) * force[z] + c[z].powi(2) * force[y]).sum::<f64>() / n;
        out[3 + axis] = (out[3 + axis] - lever).max(0.0);
    }
    out
}

impl PlateDrift {
    /// Estimates the drift from the readings of other recordings. `noise_density` is the one-sided
    /// white density of the total wrench about the world origin, `times_s` the times at which the
    /// plates of the recording in question were unloaded. `None` if no other recording has two
    /// flights.
    pub fn of(others: &[&TareReadings], noise_density: &Vector6<f64>, times_s: Vec<f64>) -> Option<Self> {
        // of each plate in each recording: for six axes (squared differences, their noise, weight)
        let mut units: Vec<[(f64, f64, f64); 6]> = Vec::new();
        for readings in others {
            let centres: Vec<Vector3<f64>> = readings.plates.iter().map(|p| p.0).collect();
            // the variance of a mean is the density over twice the length; the difference of two
            // readings has twice that
            let noise = density_of_one(noise_density, &centres) * (MEDIAN / readings.length_s.max(1e-3));
            for (centre, wrench) in &readings.plates {
                let mut unit = [(0.0, 0.0, 0.0); 6];
                for j in 1..readings.times_s.len().min(wrench.len()) {
                    for i in 0..j {
                        let apart = readings.times_s[j] - readings.times_s[i];
                        let change = about(&(wrench[j] - wrench[i]), centre);
                        for (axis, unit) in unit.iter_mut().enumerate() {
                            unit.0 += (change[axis] * apart).powi(2);
                            unit.1 += noise[axis] * apart.powi(2);
                            unit.2 += apart.powi(4);
                        }
                    }
                }
                if unit[0].2 > 0.0 {
                    units.push(unit);
                }
            }
        }
        if units.is_empty() || !units.iter().flatten().all(|u| u.0.is_finite() && u.1.is_finite()) {
            return None;
        }
        let axis = |i: usize| -> Vec<(f64, f64, f64)> { units.iter().map(|u| u[i]).collect() };
        // both horizontal axes, of a plate in a recording each a unit of its own
        let both = |i: usize| RateEstimate::of(&[axis(i), axis(i + 1)].concat());
        let rate = [both(0), RateEstimate::of(&axis(2)), both(3), RateEstimate::of(&axis(5))];
        let centres = others.iter().find(|r| !r.plates.is_empty())?.plates.iter().map(|p| p.0).collect();
        Some(Self { rate, centres, times_s })
    }

    /// Variance of one plate's rate of drift, about its centre ((N/s)², (N·m/s)²).
    pub fn rate_variance(&self) -> Vector6<f64> {
        each_axis(Vector4::from_fn(|i, _| self.rate[i].variance()))
    }

    /// Variances of the rate for one draw, the same in every recording: they stem from the same
    /// readings.
    pub(crate) fn drawn_variance(&self, seed: u64, draw: u64) -> Vector6<f64> {
        let mut rng = ChaCha8Rng::seed_from_u64(seed ^ RATE_SEED);
        rng.set_stream(draw);
        each_axis(Vector4::from_fn(|i, _| self.rate[i].drawn(&mut rng)))
    }

    /// Sum of the plates' drifts about the world origin at `n` frames, after taring: linear between
    /// the times at which the recording shows the plates unloaded, constant beyond. `variance` is
    /// that of the rates.
    pub(crate) fn draw(
        &self,
        variance: &Vector6<f64>,
        n: usize,
        rate_hz: f64,
        rng: &mut ChaCha8Rng,
    ) -> Vec<Vector6<f64>> {
        let mut rate = Vector6::zeros();
        for centre in &self.centres {
            let own = variance.map(|r| -> f64 {
                let normal: f64 = StandardNormal.sample(rng);
                r.sqrt() * normal
            });
            rate += about(&own, &-centre);
        }
        let walk: Vec<Vector6<f64>> = (0..n).map(|f| rate * (f as f64 / rate_hz)).collect();
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
    fn a_drift_is_recovered_from_readings_and_vanishes_where_it_is_known() {
        let centres: [Vector3<f64>; 2] = [Vector3::new(0.3, 0.2, 0.0), Vector3::new(-0.3, 0.1, 0.01)];
        let rate = Vector6::new(0.02, 0.02, 0.05, 0.001, 0.001, 0.003);
        let none = RateEstimate { seen: 0.0, noise: 0.0, freedom: 3.0 };
        let one = |centre| PlateDrift { rate: [none; 4], centres: vec![centre], times_s: Vec::new() };
        let (rate_hz, length_s) = (100.0, 0.5);
        let (force, moment) = (2e-3, 2e-4);
        let mut rng = ChaCha8Rng::seed_from_u64(5);
        let mut density = Vector6::zeros();
        let own = Vector6::new(force, force, force, moment, moment, moment);
        for c in centres {
            for axis in 0..3 {
                let (y, z) = ((axis + 1) % 3, (axis + 2) % 3);
                density[axis] += force;
                density[3 + axis] += moment + (c[y].powi(2) + c[z].powi(2)) * force;
            }
        }
        let readings: Vec<TareReadings> = (0..300)
            .map(|_| {
                let times_s = vec![1.0, 2.0, 3.5];
                let sd = own.map(|d: f64| (0.5 * MEDIAN * d / length_s).sqrt());
                let plates = centres
                    .iter()
                    .map(|c| {
                        let walk = one(*c).draw(&rate, 500, rate_hz, &mut rng);
                        let mut read = |t: &f64| {
                            let noise = sd.map(|s| -> f64 {
                                let normal: f64 = StandardNormal.sample(&mut rng);
                                s * normal
                            });
                            walk[(t * rate_hz) as usize] + about(&noise, &-c)
                        };
                        (*c, times_s.iter().map(&mut read).collect())
                    })
                    .collect();
                TareReadings { times_s, plates, length_s }
            })
            .collect();
        let all: Vec<&TareReadings> = readings.iter().collect();
        let found = PlateDrift::of(&all, &density, vec![1.0, 4.0]).unwrap();
        for axis in 0..6 {
            let ratio = found.rate_variance()[axis] / rate[axis];
            assert!((0.8..1.25).contains(&ratio), "axis {axis}: {ratio}");
        }
        let walk = found.draw(&rate, 500, rate_hz, &mut rng);
        // a linear drift is known between two readings, not beyond them
        assert!(
            walk[100].norm() < 1e-12 && walk[250].norm() < 1e-12 && walk[20].norm() > 1e-3 && walk[480].norm() > 1e-3
        );
        // 1200 differences of each horizontal axis: the drawn variances scatter by a few percent
        let drawn: Vec<f64> = (0..50).map(|k| found.drawn_variance(1, k)[0] / rate[0]).collect();
        assert!(drawn.iter().all(|x| (0.6..1.6).contains(x)), "{drawn:?}");
        assert!(PlateDrift::of(&[], &density, Vec::new()).is_none());
        assert!(PlateDrift::of(&[&TareReadings::default()], &density, Vec::new()).is_none());
    }

    #[test]
    fn a_variance_of_few_readings_is_drawn_as_uncertain_as_it_is() {
        // ten units of one normal rate each: χ² with ten degrees of freedom
        let mut rng = ChaCha8Rng::seed_from_u64(2);
        let mut inside = 0;
        let sets = 400;
        for _ in 0..sets {
            let units: Vec<(f64, f64, f64)> = (0..10)
                .map(|_| {
                    let normal: f64 = StandardNormal.sample(&mut rng);
                    (normal * normal, 0.0, 1.0)
                })
                .collect();
            let found = RateEstimate::of(&units);
            let mut drawn: Vec<f64> = (0..200).map(|_| found.drawn(&mut rng)).collect();
            drawn.sort_by(f64::total_cmp);
            inside += usize::from((drawn[5]..drawn[194]).contains(&1.0));
        }
        // the middle 95 % of the draws
        let share = inside as f64 / sets as f64;
        assert!((0.88..0.99).contains(&share), "{share}");
    }
}
