//! The marginal likelihood of an explanation: linear algebra and one integral.
//!
//! In units of the noise the rows are `b = A z + C θ + ε` with `ε ~ N(0, s²)`, z ~ N(0, 1) for a
//! body with a prior and flat without. With z projected out, R is the sum of squares that an
//! explanation leaves, over n rows. The size s² has an inverse gamma prior with ν degrees of
//! freedom about 1, cut off below 1: an error below the noise of the recordings is no evidence.
//! Then
//!
//! ```text
//! Z(R) ∝ ∫_{s²>1} (s²)^(−a − 1) exp(−(R+ν)/(2 s²)) ds²,     a = (n+ν)/2
//!      ∝ ((R+ν)/2)^(−a) γ(a, (R+ν)/2)
//! ```
//!
//! with the lower incomplete gamma function γ. Each coefficient costs `½ ln(1 + n)` (a prior with
//! the information of one row), and nonlinear unknowns `½ Σ ln(1 + λ/12)` with λ the eigenvalues of
//! their information per squared range (Laplace, a uniform prior's variance).

use super::priors::NOISE_FREEDOM;
use crate::candidate::pseudo_inverse;
use aloft_effects::NonlinearParameter;
use aloft_signal::ln_gamma_lower;
use nalgebra::DMatrix;

/// What all explanations of a session share.
#[derive(Debug, Clone, Copy)]
pub(super) struct Likelihood {
    /// Rows, less the parameters that they alone determine.
    pub n: f64,
}

impl Likelihood {
    /// Logarithm of Z(R), up to a constant.
    pub fn of_squares(self, left: f64) -> f64 {
        let a = 0.5 * (self.n + NOISE_FREEDOM);
        let half = 0.5 * (left.max(0.0) + NOISE_FREEDOM);
        ln_gamma_lower(a, half) - a * half.ln()
    }

    /// Root mean square that is left, in units of the noise.
    pub fn in_noise(self, left: f64) -> f64 {
        (left.max(0.0) / self.n.max(1.0)).sqrt()
    }

    /// Cost of `k` coefficients.
    pub fn of_coefficients(self, k: usize) -> f64 {
        0.5 * k as f64 * self.n.max(1.0).ln_1p()
    }

    /// Cost of nonlinear unknowns: `joint` is the Gram matrix of `[C | ∂(Cθ)/∂p]` with the body's
    /// parameters projected out, of which the first `k` columns are C.
    pub fn of_unknowns(self, joint: &DMatrix<f64>, k: usize, unknowns: &[NonlinearParameter], left: f64) -> f64 {
        let m = unknowns.len();
        if m == 0 || joint.nrows() != k + m {
            return 0.0;
        }
        let cross = joint.view((0, k), (k, m));
        let alone = joint.view((0, 0), (k, k)).into_owned();
        let given = joint.view((k, k), (m, m)) - cross.tr_mul(&(pseudo_inverse(&alone) * cross));
        let range = |i: usize| {
            let range = unknowns[i].upper - unknowns[i].lower;
            if range.is_finite() { range } else { unknowns[i].scale * 12f64.sqrt() }
        };
        let size = self.in_noise(left).max(1.0).powi(2);
        let scaled =
            DMatrix::from_fn(m, m, |i, j| 0.5 * (given[(i, j)] + given[(j, i)]) * range(i) * range(j) / (12.0 * size));
        scaled.symmetric_eigenvalues().iter().map(|l| 0.5 * l.max(0.0).ln_1p()).sum()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Against the integral by the midpoint rule in ln s².
    #[test]
    fn validate_marginal_likelihood_of_the_size() {
        let likelihood = Likelihood { n: 60.0 };
        let by_sum = |left: f64| {
            let a = 0.5 * (60.0 + NOISE_FREEDOM);
            let steps = 200_000;
            let (to, mut sum) = (8.0_f64, 0.0);
            for i in 0..steps {
                let u = to * (f64::from(i) + 0.5) / f64::from(steps);
                sum += (-a * u - 0.5 * (left + NOISE_FREEDOM) * (-u).exp()).exp() * to / f64::from(steps);
            }
            sum.ln()
        };
        let constant = likelihood.of_squares(60.0) - by_sum(60.0);
        for left in [0.0, 20.0, 45.0, 80.0, 200.0, 900.0] {
            let apart = likelihood.of_squares(left) - by_sum(left) - constant;
            assert!(apart.abs() < 1e-6, "{left}: {apart}");
        }
        // below the noise the error says nothing more than its own exponential
        let gain = likelihood.of_squares(0.0) - likelihood.of_squares(30.0);
        assert!(gain < 15.0, "{gain}");
    }
}
