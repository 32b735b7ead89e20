//! Test functions of the weak rows: ψ(τ) = (1 − τ²)^p on a window, sampled, with quadrature that is
//! exact for low polynomials.
//!
//! Integrals are replaced by sums. Small corrections of the sampled ψ̇ and ψ̈ (a smooth bump times
//! a low polynomial, of minimal degree) make summation by parts exact for polynomials in time up to
//! the fourth degree: `Σ ψ̇ tᵏ = −k Σ ψ tᵏ⁻¹` and `Σ ψ̈ tᵏ = k (k−1) Σ ψ tᵏ⁻²`. A body in ballistic
//! flight therefore gives rows of exact zeros, for any position of the world origin; without the
//! corrections Σψ̈ ≠ 0 would cause an apparent first moment.

use crate::RegressorError;
use nalgebra::{DMatrix, DVector};

/// ψ, ψ̇ and ψ̈ at the frames of a window, times the frame interval (so that sums are integrals).
#[derive(Debug, Clone, PartialEq)]
pub struct TestFunction {
    /// Frames on each side of the centre; the window has `2 half + 1` frames and ψ is zero one
    /// frame outside it.
    pub half: usize,
    /// Frame interval, s.
    pub step_s: f64,
    /// ψ dt, s.
    pub psi: Vec<f64>,
    /// ψ̇ dt.
    pub psi_dot: Vec<f64>,
    /// ψ̈ dt, 1/s.
    pub psi_ddot: Vec<f64>,
}

/// Fewest frames on each side of a window's centre.
pub const MIN_HALF_WINDOW: usize = 4;

impl TestFunction {
    /// Samples ψ = (1 − τ²)^power over `2 half + 1` frames at `rate_hz`.
    ///
    /// # Errors
    /// [`RegressorError::Option`] for a power below 3 (its second derivative jumps at the ends) or
    /// above 12, for fewer than [`MIN_HALF_WINDOW`] frames on each side, and for a rate that is not
    /// positive.
    pub fn new(half: usize, power: u32, rate_hz: f64) -> Result<Self, RegressorError> {
        if !(3..=12).contains(&power) {
            return Err(RegressorError::Option { option: "power", problem: format!("{power} is not within 3 to 12") });
        }
        if half < MIN_HALF_WINDOW {
            return Err(RegressorError::Option {
                option: "window_s",
                problem: format!("{} frames, at least {} are needed", 2 * half + 1, 2 * MIN_HALF_WINDOW + 1),
            });
        }
        if !(rate_hz > 0.0 && rate_hz.is_finite()) {
            return Err(RegressorError::Option { option: "rate_hz", problem: format!("{rate_hz} Hz") });
        }
        let step_s = 1.0 / rate_hz;
        let reach_s = (half + 1) as f64 * step_s;
        let n = f64::from(power);
        let taus: Vec<f64> = (0..=2 * half).map(|i| (i as f64 - half as f64) / (half + 1) as f64).collect();
        let sample = |f: &dyn Fn(f64, f64) -> f64| -> Vec<f64> { taus.iter().map(|&x| f(x, 1.0 - x * x)).collect() };
        let p = power as i32;
        let psi = sample(&|_, u| step_s * u.powi(p));
        let mut psi_dot = sample(&|x, u| -2.0 * n * x * u.powi(p - 1) * step_s / reach_s);
        let mut psi_ddot = sample(&|x, u| {
            (4.0 * n * (n - 1.0) * x * x * u.powi(p - 2) - 2.0 * n * u.powi(p - 1)) * step_s / (reach_s * reach_s)
        });
        let moment = |k: i32| -> f64 { taus.iter().zip(&psi).map(|(x, w)| w * x.powi(k)).sum() };
        // odd moments of ψ̇ and even moments of ψ̈; the others vanish by symmetry
        correct(&mut psi_dot, &taus, p, &[(1, -moment(0) / reach_s), (3, -3.0 * moment(2) / reach_s)]);
        let area = reach_s * reach_s;
        correct(&mut psi_ddot, &taus, p, &[(0, 0.0), (2, 2.0 * moment(0) / area), (4, 12.0 * moment(2) / area)]);
        Ok(Self { half, step_s, psi, psi_dot, psi_ddot })
    }

    /// Number of frames in the window.
    pub fn n_frames(&self) -> usize {
        2 * self.half + 1
    }
    /// Length of the support of ψ, s.
    pub fn length_s(&self) -> f64 {
        2.0 * (self.half + 1) as f64 * self.step_s
    }
    /// ∫ψ dt, s.
    pub fn integral_s(&self) -> f64 {
        self.psi.iter().sum()
    }
    /// Seconds from the centre of the window to its frame `i`.
    pub fn time_s(&self, i: usize) -> f64 {
        (i as f64 - self.half as f64) * self.step_s
    }
}

/// Adds `(1−τ²)^(power−2) Σ cⱼ τ^kⱼ` so that the moments `Σ w τ^k` take their exact values.
fn correct(weights: &mut [f64], taus: &[f64], power: i32, wanted: &[(i32, f64)]) {
    let bump: Vec<f64> = taus.iter().map(|x| (1.0 - x * x).powi(power - 2)).collect();
    let sum = |k: i32, w: &[f64]| -> f64 { taus.iter().zip(w).map(|(x, b)| b * x.powi(k)).sum() };
    let n = wanted.len();
    let matrix = DMatrix::from_fn(n, n, |i, j| sum(wanted[i].0 + wanted[j].0, &bump));
    // twice: the second pass removes rounding errors
    for _ in 0..2 {
        let missing = DVector::from_fn(n, |i, _| wanted[i].1 - sum(wanted[i].0, weights));
        if let Some(c) = matrix.clone().lu().solve(&missing) {
            for ((weight, x), b) in weights.iter_mut().zip(taus).zip(&bump) {
                *weight += b * wanted.iter().zip(c.iter()).map(|((k, _), c)| c * x.powi(*k)).sum::<f64>();
            }
        }
    }
}

/// Centres of windows over the frames `start .. end` of a run: as many as needed for steps of at
/// most `hop` frames, evenly spaced, with the first and last window touching the ends. Empty if the
/// run is shorter than the window.
pub fn window_centres(start: usize, end: usize, half: usize, hop: usize) -> Vec<usize> {
    let length = end.saturating_sub(start);
    if length < 2 * half + 1 {
        return Vec::new();
    }
    let span = length - (2 * half + 1);
    let steps = span.div_ceil(hop.max(1));
    (0..=steps).map(|i| start + half + (i * span + steps / 2).checked_div(steps).unwrap_or(0)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn summation_by_parts_is_exact_for_polynomials() {
        for (half, power, rate) in [(4, 5, 100.0), (10, 5, 100.0), (39, 5, 200.0), (20, 3, 120.0), (15, 8, 60.0)] {
            let f = TestFunction::new(half, power, rate).unwrap();
            let t: Vec<f64> = (0..f.n_frames()).map(|i| f.time_s(i)).collect();
            let reach = f.length_s() / 2.0;
            let sum = |w: &[f64], k: i32| -> f64 { t.iter().zip(w).map(|(t, w)| w * t.powi(k)).sum() };
            for k in 0..=4 {
                let scale = f.integral_s() * reach.powi(k);
                let first = sum(&f.psi_dot, k) + f64::from(k) * if k > 0 { sum(&f.psi, k - 1) } else { 0.0 };
                let second =
                    sum(&f.psi_ddot, k) - f64::from(k * (k - 1)) * if k > 1 { sum(&f.psi, k - 2) } else { 0.0 };
                assert!(first.abs() < 1e-13 * scale / reach, "{half} {power} {k}: {first:e}");
                assert!(second.abs() < 1e-12 * scale / reach / reach, "{half} {power} {k}: {second:e}");
            }
        }
    }

    #[test]
    fn corrections_are_small() {
        let f = TestFunction::new(20, 5, 100.0).unwrap();
        let reach = f.length_s() / 2.0;
        for i in 0..f.n_frames() {
            let x = f.time_s(i) / reach;
            let exact = -10.0 * x * (1.0 - x * x).powi(4) * f.step_s / reach;
            assert!((f.psi_dot[i] - exact).abs() < 1e-4 * f.step_s / reach);
        }
        // ∫(1−τ²)⁵dτ = 2·(2·4·6·8·10)/(3·5·7·9·11)
        assert!((f.integral_s() / reach - 2.0 * 3840.0 / 10395.0).abs() < 1e-7);
    }

    #[test]
    fn windows_touch_both_ends() {
        let centres = window_centres(100, 160, 19, 10);
        assert_eq!(centres.first(), Some(&119));
        assert_eq!(centres.last(), Some(&140));
        assert!(centres.windows(2).all(|w| w[1] > w[0] && w[1] - w[0] <= 11));
        assert_eq!(window_centres(0, 39, 19, 5), vec![19]);
        assert!(window_centres(0, 38, 19, 5).is_empty());
    }

    #[test]
    fn powers_and_lengths_that_cannot_be_are_refused() {
        assert!(TestFunction::new(20, 2, 100.0).is_err());
        assert!(TestFunction::new(3, 5, 100.0).is_err());
        assert!(TestFunction::new(20, 5, f64::NAN).is_err());
    }
}
