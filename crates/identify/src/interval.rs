//! The single implementation of 95 % intervals: `value ± t(ν) · se`.
//!
//! A standard error estimated from few independent pieces of evidence is itself uncertain, and
//! Student's t with ν degrees of freedom accounts for that. ν is rarely an integer: it is the
//! Satterthwaite approximation of the number of independent squares in the variance (Bell and
//! McCaffrey 2002; Imbens and Kolesár 2016). Every table, report and file uses this interval.

pub use aloft_signal::t975;

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

/// A variance that rounding made slightly negative is zero; one that is not a number remains so.
pub(crate) fn not_negative(variance: f64) -> f64 {
    if variance < 0.0 { 0.0 } else { variance }
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_interval_needs_a_standard_error() {
        for (se, freedom) in [(f64::NAN, 3.0), (f64::INFINITY, 3.0), (-1.0, 3.0), (1.0, 0.0), (1.0, f64::NAN)] {
            assert_eq!(interval95(1.0, se, freedom), None, "{se} {freedom}");
        }
        assert_eq!(interval95(f64::NAN, 1.0, 3.0), None);
        assert_eq!(half_of(interval95(2.0, 0.0, 3.0)), Some(0.0));
        let (variance, freedom) = satterthwaite(&[(f64::NAN, 3.0), (1.0, 8.0)]);
        assert_eq!(interval95(1.0, not_negative(variance).sqrt(), freedom), None);
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
