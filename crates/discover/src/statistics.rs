//! Resampling over clusters.

use aloft_identify::interval::t975;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

/// Draws of cluster weights (multinomial), the same for every caller.
pub(crate) fn resamples(n: usize, draws: usize, seed: u64) -> Vec<Vec<f64>> {
    (0..draws)
        .map(|draw| {
            let mut rng = ChaCha8Rng::seed_from_u64(seed);
            rng.set_stream(draw as u64);
            let mut weights = vec![0.0; n];
            for _ in 0..n {
                weights[rng.random_range(0..n)] += 1.0;
            }
            weights
        })
        .collect()
}

/// 95 % interval of `√(Σe/Σe₀)`: the wider of the percentile interval over clusters and, with few
/// of them, the jackknife interval with Student's t.
pub(crate) fn ratio_interval(error: &[f64], plain: &[f64], weights: &[Vec<f64>]) -> [f64; 2] {
    let ratio = |w: &dyn Fn(usize) -> f64| -> f64 {
        let (e, p) = (0..error.len()).fold((0.0, 0.0), |s, g| (s.0 + w(g) * error[g], s.1 + w(g) * plain[g]));
        (e / p).sqrt()
    };
    let mut draws: Vec<f64> = weights.iter().map(|w| ratio(&|g| w[g])).filter(|r| r.is_finite()).collect();
    draws.sort_by(f64::total_cmp);
    let at = |share: f64| draws.get(((draws.len() as f64 - 1.0) * share).round() as usize).copied().unwrap_or(f64::NAN);
    let (mut low, mut high) = (at(0.025), at(0.975));
    let used: Vec<usize> = (0..error.len()).filter(|&g| plain[g] > 0.0).collect();
    let n = used.len();
    if (2..12).contains(&n) {
        let centre = ratio(&|_| 1.0).ln();
        let left: Vec<f64> = used.iter().map(|&out| ratio(&|g| if g == out { 0.0 } else { 1.0 }).ln()).collect();
        let mean = left.iter().sum::<f64>() / n as f64;
        let variance = left.iter().map(|x| (x - mean) * (x - mean)).sum::<f64>() * (n as f64 - 1.0) / n as f64;
        let half = t975((n - 1) as f64) * variance.sqrt();
        low = low.min((centre - half).exp());
        high = high.max((centre + half).exp());
    }
    [low, high]
}

/// Probability that random signs of the clusters' differences give a sum as large; small if `worse`
/// has the larger error throughout.
pub(crate) fn sign_flip_p(better: &[f64], worse: &[f64], draws: usize, seed: u64) -> f64 {
    let d: Vec<f64> = better.iter().zip(worse).map(|(a, b)| b - a).filter(|d| *d != 0.0).collect();
    let sum: f64 = d.iter().sum();
    let n = d.len();
    if n == 0 || sum <= 0.0 {
        return 1.0;
    }
    let tolerance = 1e-12 * d.iter().map(|x| x.abs()).sum::<f64>();
    let exact = n <= 11;
    let total = if exact { 1usize << n } else { draws };
    let mut hits = 0;
    for draw in 0..total {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        rng.set_stream(draw as u64);
        let flipped: f64 = d
            .iter()
            .enumerate()
            .map(|(i, x)| {
                let minus = if exact { (draw >> i) & 1 == 1 } else { rng.random_bool(0.5) };
                if minus { -x } else { *x }
            })
            .sum();
        if flipped >= sum - tolerance {
            hits += 1;
        }
    }
    if exact { hits as f64 / total as f64 } else { (hits + 1) as f64 / (total + 1) as f64 }
}

/// Jackknife standard error from leave-one-out values.
pub(crate) fn jackknife_se(values: &[f64]) -> f64 {
    let n = values.len() as f64;
    if n < 2.0 {
        return f64::NAN;
    }
    let mean = values.iter().sum::<f64>() / n;
    (values.iter().map(|x| (x - mean) * (x - mean)).sum::<f64>() * (n - 1.0) / n).sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn equal_errors_have_a_ratio_of_one() {
        let e = [1.0, 2.0, 3.0, 4.0];
        let interval = ratio_interval(&e, &e, &resamples(4, 50, 1));
        assert!((interval[0] - 1.0).abs() < 1e-12 && (interval[1] - 1.0).abs() < 1e-12);
        assert_eq!(sign_flip_p(&e, &e, 100, 1), 1.0);
    }

    #[test]
    fn a_model_that_is_better_everywhere_is_told_apart() {
        let better = [1.0; 8];
        let worse = [1.5, 1.6, 1.4, 1.2, 1.9, 1.3, 1.5, 1.5];
        assert!((sign_flip_p(&better, &worse, 100, 1) - 1.0 / 256.0).abs() < 1e-12);
    }
}
