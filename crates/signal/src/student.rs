//! Points of Student's t distribution: the one implementation behind every interval.

/// 97.5 % point of Student's t with `freedom` degrees of freedom.
pub fn t975(freedom: f64) -> f64 {
    two_sided(freedom, 0.05, 1.959_963_984_540_054, 12.8)
}

/// 99.95 % point of Student's t with `freedom` degrees of freedom.
pub fn t9995(freedom: f64) -> f64 {
    two_sided(freedom, 0.001, 3.290_526_731_491_894, 637.0)
}

/// The point q with `P(|t| > q) = outside`. Degrees of freedom need not be an integer; values below
/// one count as one. `normal` is the point for infinitely many, `most` above that for one.
///
/// Solves `I_x(ν/2, 1/2) = outside`, `x = ν / (ν + q²)`, by bisection (Abramowitz and Stegun
/// 26.7.1).
fn two_sided(freedom: f64, outside: f64, normal: f64, most: f64) -> f64 {
    if freedom.is_nan() {
        return f64::INFINITY;
    }
    let n = freedom.max(1.0);
    if n > 1e6 {
        return normal;
    }
    let (mut low, mut high) = (normal, most);
    for _ in 0..60 {
        let q = 0.5 * (low + high);
        if incomplete_beta(0.5 * n, 0.5, n / (n + q * q)) > outside { low = q } else { high = q }
    }
    0.5 * (low + high)
}

/// Regularised incomplete beta function I_x(a, b) by its continued fraction (Lentz's method; Press
/// et al., Numerical Recipes, 6.4).
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

/// Logarithm of the gamma function for positive numbers: Stirling's series after shifting the
/// argument beyond ten.
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

/// Logarithm of the lower incomplete gamma function `γ(a, x) = ∫₀ˣ t^(a−1) e^(−t) dt`, a and x
/// positive: its series below a + 1, the complement's continued fraction above (Press et al.,
/// Numerical Recipes, 6.2).
pub fn ln_gamma_lower(a: f64, x: f64) -> f64 {
    const MOST: usize = 100_000;
    if x < a + 1.0 {
        let (mut term, mut sum) = (a.recip(), a.recip());
        for k in 1..MOST {
            term *= x / (a + k as f64);
            sum += term;
            if term < 1e-16 * sum {
                break;
            }
        }
        return a * x.ln() - x + sum.ln();
    }
    const TINY: f64 = 1e-300;
    let mut b = x + 1.0 - a;
    let (mut c, mut d) = (TINY.recip(), b.recip());
    let mut fraction = d;
    for i in 1..MOST {
        let i = i as f64;
        let an = -i * (i - a);
        b += 2.0;
        d = an * d + b;
        d = if d.abs() < TINY { TINY } else { d }.recip();
        c = b + an / c;
        c = if c.abs() < TINY { TINY } else { c };
        fraction *= c * d;
        if (c * d - 1.0).abs() < 1e-15 {
            break;
        }
    }
    let upper = (a * x.ln() - x - ln_gamma(a)).exp() * fraction;
    ln_gamma(a) + (-upper).ln_1p()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// scipy.special: `log(gammainc(a, x)) + gammaln(a)`.
    #[test]
    fn validate_incomplete_gamma_function() {
        for (a, x, value) in [
            (0.5, 0.1, -0.491_037_104_229_828_05),
            (0.5, 3.0, 0.557_955_748_879_596_5),
            (10.0, 4.0, 7.989_908_953_396_341),
            (10.0, 14.0, 12.685_968_301_776_107),
            (800.0, 500.0, 4_465.977_233_421_398),
            (800.0, 805.0, 4_544.712_100_118_470_5),
            (800.0, 1200.0, 4_545.266_118_970_373),
        ] {
            let apart = ln_gamma_lower(a, x) - value;
            assert!(apart.abs() < 1e-10 * f64::abs(value).max(1.0), "{a} {x}: {apart}");
        }
    }

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
        for (n, point) in [(1.0, 636.619_249), (7.0, 5.407_883), (30.0, 3.645_959)] {
            assert!((t9995(n) - point).abs() < 1e-5, "{n}: {}", t9995(n));
        }
        assert!((t975(f64::INFINITY) - 1.959_963_984_54).abs() < 1e-9 && t975(0.2) == t975(1.0));
    }
}
