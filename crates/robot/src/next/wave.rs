//! Trajectories of joints: quintic B-splines that start and end at rest.

use serde::{Deserialize, Serialize};

/// Joints that leave a posture, move, and come back to it.
///
/// Joint j is at `hold[j] + Σ_k control[j][k] B(t/Δ − k)` with the cardinal quintic B-spline B
/// (support 0 to 6). The splines are non-negative and add up to at most 1, so that a coordinate
/// stays between the posture and its control values, and its rate below the largest step of
/// neighbouring ones divided by Δ. Position, rate and the next three derivatives are continuous,
/// and at rest at both ends.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Wave {
    /// Posture before and after, rad or m, one value a joint.
    pub hold: Vec<f64>,
    /// Control values of each joint as differences from the posture, rad or m.
    pub control: Vec<Vec<f64>>,
    /// Duration, s.
    pub duration_s: f64,
}

/// Signs times binomial coefficients of the sixth difference.
const SIXTH: [f64; 7] = [1.0, -6.0, 15.0, -20.0, 15.0, -6.0, 1.0];

/// The spline and its derivative at `u`.
fn spline(u: f64) -> (f64, f64) {
    if !(0.0..=6.0).contains(&u) {
        return (0.0, 0.0);
    }
    let (mut value, mut slope) = (0.0, 0.0);
    for (i, c) in SIXTH.iter().enumerate() {
        let x = (u - i as f64).max(0.0);
        let fourth = x * x * x * x;
        value += c * fourth * x / 120.0;
        slope += c * fourth / 24.0;
    }
    (value, slope)
}

impl Wave {
    /// Distance of neighbouring knots, s.
    pub fn step_s(&self) -> f64 {
        let count = self.control.first().map_or(1, Vec::len);
        self.duration_s / (count + 5) as f64
    }

    /// Coordinates and rates at a time, one value a joint; the posture before and after.
    pub fn at(&self, time_s: f64) -> (Vec<f64>, Vec<f64>) {
        let step = self.step_s();
        let values = self.control.first().map_or(0, Vec::len);
        let basis: Vec<(f64, f64)> = (0..values).map(|k| spline(time_s / step - k as f64)).collect();
        let sum = |control: &Vec<f64>, part: &dyn Fn(&(f64, f64)) -> f64| -> f64 {
            control.iter().zip(&basis).map(|(c, b)| c * part(b)).sum()
        };
        let q = self.hold.iter().zip(&self.control).map(|(h, c)| h + sum(c, &|b| b.0)).collect();
        let dq = self.control.iter().map(|c| sum(c, &|b| b.1) / step).collect();
        (q, dq)
    }

    /// Bound of a joint's rate: the largest step of neighbouring control values over Δ, rad/s or
    /// m/s.
    pub fn rate_bound(&self, joint: usize) -> f64 {
        let c = &self.control[joint];
        let ends = [c.first(), c.last()].into_iter().flatten().map(|x| x.abs());
        c.windows(2).map(|w| (w[1] - w[0]).abs()).chain(ends).fold(0.0, f64::max) / self.step_s()
    }

    /// The same with all excursions multiplied.
    pub fn scaled(&self, by: f64) -> Self {
        let control = self.control.iter().map(|c| c.iter().map(|x| x * by).collect()).collect();
        Self { control, ..self.clone() }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_wave_is_at_rest_at_both_ends_and_within_its_bounds() {
        let wave = Wave { hold: vec![0.2], control: vec![vec![1.0, -0.7, 0.9, 0.4]], duration_s: 0.6 };
        let bound = wave.rate_bound(0);
        assert!((bound - 1.7 / (0.6 / 9.0)).abs() < 1e-9);
        let mut before = wave.at(0.0);
        assert_eq!(before, (vec![0.2], vec![0.0]));
        let h = 1e-5;
        for i in 1..=60_000 {
            let now = wave.at(f64::from(i) * h);
            assert!(now.0[0] < 1.2 && now.0[0] > -0.5 && now.1[0].abs() <= bound);
            let slope = (now.0[0] - before.0[0]) / h;
            assert!((slope - 0.5 * (now.1[0] + before.1[0])).abs() < 1e-6, "{i}");
            before = now;
        }
        assert!((before.0[0] - 0.2).abs() < 1e-9 && before.1[0].abs() < 1e-9);
    }
}
