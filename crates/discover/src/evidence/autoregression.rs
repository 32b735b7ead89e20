//! How the errors of rows follow each other over windows.

use super::priors::MOST_LINKED;
/// Variance and autocorrelation of one axis in one kind of motion.
pub(super) struct Pooled {
    pub variance: f64,
    /// Autocorrelation by lag in window steps.
    correlation: Vec<f64>,
}

impl Pooled {
    /// Of series of equal step; none if all are zero.
    pub fn of(series: &[Vec<f64>], lags: usize) -> Option<Self> {
        let count: usize = series.iter().map(Vec::len).sum();
        let variance = series.iter().flatten().map(|x| x * x).sum::<f64>() / count.max(1) as f64;
        (variance > 0.0).then(|| Self { variance, correlation: autocorrelation(series, lags) })
    }

    pub fn correlation(&self, lag: usize) -> f64 {
        self.correlation.get(lag).copied().unwrap_or(0.0)
    }
}

/// Autocorrelation, up to a lag, of the autoregression that Burg's method finds in all series
/// together (Burg 1975): positive definite, and without the leakage of a taper, which would take a
/// slow error for a fast one. Its order has the least Akaike information.
fn autocorrelation(series: &[Vec<f64>], lags: usize) -> Vec<f64> {
    let count: usize = series.iter().map(Vec::len).sum();
    let (mut ahead, mut behind) = (series.to_vec(), series.to_vec());
    // of an order: its coefficients, and the autocorrelation that it describes
    let (mut coefficients, mut correlation) = (Vec::<f64>::new(), vec![1.0]);
    let mut best = (coefficients.clone(), correlation.clone());
    let (mut variance, mut least) = (1.0f64, 0.0);
    for order in 1..=MOST_LINKED {
        let (mut product, mut squares) = (0.0, 0.0);
        for (f, b) in ahead.iter().zip(&behind) {
            for t in order..f.len() {
                product += f[t] * b[t - 1];
                squares += f[t] * f[t] + b[t - 1] * b[t - 1];
            }
        }
        if squares <= 0.0 {
            break;
        }
        let reflection = 2.0 * product / squares;
        for (f, b) in ahead.iter_mut().zip(&mut behind) {
            for t in (order..f.len()).rev() {
                let (before, after) = (f[t], b[t - 1]);
                f[t] = before - reflection * after;
                b[t] = after - reflection * before;
            }
        }
        // Levinson's recursion
        correlation.push(predicted(&coefficients, &correlation) + reflection * variance);
        let reversed: Vec<f64> = coefficients.iter().rev().copied().collect();
        coefficients.iter_mut().zip(&reversed).for_each(|(a, r)| *a -= reflection * r);
        coefficients.push(reflection);
        variance *= 1.0 - reflection * reflection;
        let information = count as f64 * variance.max(f64::MIN_POSITIVE).ln() + 2.0 * order as f64;
        if information < least {
            (least, best) = (information, (coefficients.clone(), correlation.clone()));
        }
    }
    let (coefficients, mut out) = best;
    while out.len() <= lags {
        out.push(predicted(&coefficients, &out));
    }
    out.truncate(lags + 1);
    out
}

/// The next value of a series from those before it.
fn predicted(coefficients: &[f64], before: &[f64]) -> f64 {
    coefficients.iter().zip(before.iter().rev()).map(|(a, x)| a * x).sum()
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::DMatrix;
    use rand::SeedableRng;
    use rand_chacha::ChaCha8Rng;
    use rand_distr::{Distribution, StandardNormal};

    /// Series of an autoregression of first order, in pieces as flights have them.
    fn series(rho: f64, pieces: usize, length: usize) -> Vec<Vec<f64>> {
        let mut rng = ChaCha8Rng::seed_from_u64(5);
        let mut normal = || -> f64 { StandardNormal.sample(&mut rng) };
        let mut piece = || {
            let mut x = normal();
            let mut out = Vec::new();
            for _ in 0..length {
                out.push(x);
                x = rho * x + (1.0 - rho * rho).sqrt() * normal();
            }
            out
        };
        (0..pieces).map(|_| piece()).collect()
    }

    #[test]
    fn short_pieces_give_the_autocorrelation_of_the_process() {
        for rho in [0.0, 0.5, 0.95] {
            let found = autocorrelation(&series(rho, 2000, 12), 20);
            let off = (0..=20).map(|k| (found[k] - rho.powi(k as i32)).abs()).fold(0.0, f64::max);
            assert!(off < 0.06, "{rho}: {off}");
        }
        let pooled = Pooled::of(&series(0.5, 400, 12), 3).unwrap();
        assert!((pooled.variance - 1.0).abs() < 0.05 && pooled.correlation(9) == 0.0);
        assert!(Pooled::of(&[vec![0.0; 5]], 3).is_none());
    }

    /// Errors that hardly change within a piece, in windows that overlap: the covariance stays
    /// positive definite, and no taper makes fast errors of them.
    #[test]
    fn the_covariance_of_slow_errors_is_positive_definite() {
        let overlapping = |x: &Vec<f64>| x.windows(4).map(|w| w.iter().sum()).collect();
        let slow: Vec<Vec<f64>> = series(0.999, 50, 30).iter().map(overlapping).collect();
        let found = autocorrelation(&slow, 26);
        let covariance = DMatrix::from_fn(27, 27, |a, b| found[a.abs_diff(b)]);
        assert!(covariance.cholesky().is_some());
        assert!(found[10] > 0.9, "{found:?}");
    }
}
