//! The single implementation of 95 % intervals: `value ± t(ν) · se`.
//!
//! A standard error estimated from few independent pieces of evidence is itself uncertain, and
//! Student's t with ν degrees of freedom accounts for that. ν is rarely an integer: it is the
//! Satterthwaite approximation of the number of independent squares in the variance (Bell and
//! McCaffrey 2002; Imbens and Kolesár 2016). Every table, report and file uses this interval.

/// 95 % interval of a value with standard error `se` (in its unit) with `freedom` degrees of
/// freedom (infinite: a normal distribution). `None` if the standard error is unknown: not finite,
/// negative, or without degrees of freedom.
pub fn interval95(value: f64, se: f64, freedom: f64) -> Option<[f64; 2]> {
    let half = half95(se, freedom)?;
    value.is_finite().then_some([value - half, value + half])
}

/// Half the width of that interval.
pub fn half95(se: f64, freedom: f64) -> Option<f64> {
    (se.is_finite() && se >= 0.0 && freedom > 0.0).then(|| t975(freedom) * se)
}

/// Half the width of an existing interval.
pub fn half_of(ci95: Option<[f64; 2]>) -> Option<f64> {
    ci95.map(|[low, high]| 0.5 * (high - low))
}

/// Sum of independent variances, each with its degrees of freedom, and those of the sum (Welch and
/// Satterthwaite): `(Σ v)² / Σ v²/ν`. A known variance has infinitely many degrees of freedom. The
/// sum has at least one.
pub fn satterthwaite(parts: &[(f64, f64)]) -> (f64, f64) {
    let sum: f64 = parts.iter().map(|p| p.0).sum();
    let spread: f64 = parts.iter().filter(|p| p.1.is_finite()).map(|(v, freedom)| v * v / freedom.max(1e-3)).sum();
    (sum, if spread > 0.0 { (sum * sum / spread).max(1.0) } else { f64::INFINITY })
}

/// 97.5 % point of Student's t with `freedom` degrees of freedom, not necessarily an integer;
/// values below one count as one.
///
/// Solves `P(|t| > q) = I_x(ν/2, 1/2) = 0.05`, `x = ν / (ν + q²)`, by bisection (Abramowitz and Stegun 26.7.1).
pub fn t975(freedom: f64) -> f64 {
    const Z: f64 = 1.959_963_984_540_054;
    if freedom.is_nan() {
        return f64::INFINITY;
    }
    let n = freedom.max(1.0);
    if n > 1e6 {
        return Z;
    }
    // 12.7 is the point for one degree of freedom
    let (mut low, mut high) = (Z, 12.8);
    for _ in 0..60 {
        let q = 0.5 * (low + high);
        if incomplete_beta(0.5 * n, 0.5, n / (n + q * q)) > 0.05 { low = q } else { high = q }
    }
    0.5 * (low + high)
}

/// Regularised incomplete beta function I_x(a, b) by its continued fraction (Lentz's method; Press et al., Numerical Recipes, 6.4).
fn incomplete_beta(a: f64, b: f64, x: f64) -> f64 {
    if x <= 0.0 || x >= 1.0 {
        return x.clamp(0.0, 1.0);
    }
    if x > (a + 1.0) / (a + b + 2.0) {
        return 1.0 - incomplete_beta(b, a, 1.0 - x);
    }
    let front = (ln_gamma(a + b) - ln_gamma(a) - ln_gamma(b) + a * x.ln() + b * (-x).ln_1p()).exp() / a;
    const TINY: f64 = 1e-300;
    let away = |y: f64| if y.abs() < TINY { TINY } else { y };
    let (mut c, mut d) = (1.0, away(1.0 - (a + b) * x / (a + 1.0)).recip());
    let mut fraction = d;
    for m in 1..400 {
        let m = f64::from(m);
        let even = m * (b - m) * x / ((a + 2.0 * m - 1.0) * (a + 2.0 * m));
        let odd = -(a + m) * (a + b + m) * x / ((a + 2.0 * m) * (a + 2.0 * m + 1.0));
        let mut change = 1.0;
        for term in [even, odd] {
            d = away(1.0 + term * d).recip();
            c = away(1.0 + term / c);
            change = c * d;
            fraction *= change;
        }
        if (change - 1.0).abs() < 1e-15 {
            break;
        }
    }
    front * fraction
}

/// Logarithm of the gamma function for positive numbers: Stirling's series after shifting the argument beyond ten.
fn ln_gamma(x: f64) -> f64 {
    let (mut x, mut shift) = (x, 0.0);
    while x < 10.0 {
        shift -= x.ln();
        x += 1.0;
    }
    let square = (x * x).recip();
    let series = (1.0 / 12.0 - square * (1.0 / 360.0 - square * (1.0 / 1260.0 - square / 1680.0))) / x;
    shift + (x - 0.5) * x.ln() - x + 0.5 * std::f64::consts::TAU.ln() + series
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Agreement with the tables (Abramowitz and Stegun, table 26.10), also between their entries.
    #[test]
    fn validate_points_of_students_t() {
        for (n, point) in [
            (1.0, 12.706_204_736),
            (2.0, 4.302_652_730),
            (3.0, 3.182_446_305),
            (5.0, 2.570_581_836),
            (10.0, 2.228_138_852),
            (30.0, 2.042_272_456),
            (120.0, 1.979_930_405),
        ] {
            assert!((t975(n) - point).abs() < 1e-7, "{n}: {}", t975(n));
        }
        let points: Vec<f64> = (0..60).map(|i| t975(1.0 + 0.37 * f64::from(i))).collect();
        assert!(points.windows(2).all(|w| w[1] < w[0]));
        assert!((t975(f64::INFINITY) - 1.959_963_984_54).abs() < 1e-9 && t975(0.2) == t975(1.0));
    }

    #[test]
    fn an_interval_needs_a_standard_error() {
        for (se, freedom) in [(f64::NAN, 3.0), (f64::INFINITY, 3.0), (-1.0, 3.0), (1.0, 0.0), (1.0, f64::NAN)] {
            assert_eq!(interval95(1.0, se, freedom), None, "{se} {freedom}");
        }
        assert_eq!(interval95(f64::NAN, 1.0, 3.0), None);
        assert_eq!(half_of(interval95(2.0, 0.0, 3.0)), Some(0.0));
    }

    #[test]
    fn degrees_of_freedom_lie_between_those_of_the_parts_and_their_sum() {
        for share in [0.0, 0.1, 0.5, 0.9, 1.0] {
            let (variance, freedom) = satterthwaite(&[(share, 3.0), (1.0 - share, 8.0)]);
            assert!((variance - 1.0).abs() < 1e-12 && (2.99..=11.01).contains(&freedom), "{share}: {freedom}");
        }
        assert_eq!(satterthwaite(&[(1.0, f64::INFINITY)]), (1.0, f64::INFINITY));
        assert!((satterthwaite(&[(1.0, 4.0), (1.0, f64::INFINITY)]).1 - 16.0).abs() < 1e-12);
    }
}
