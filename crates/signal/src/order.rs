//! Medians, quantiles, means and deviations of plain samples.
//!
//! Two medians are in use, and they differ for an even number of values: [`median`] is the mean of
//! the two middle values, [`upper_median`] the upper one of them, which is always a value of the
//! sample.

use crate::student::t975;

/// Median of finite values: the mean of the two middle ones if their number is even; NaN without
/// values. Reorders the slice.
pub fn median(values: &mut [f64]) -> f64 {
    let n = values.len();
    let Some(upper) = upper_median(values) else { return f64::NAN };
    if n % 2 == 1 {
        return upper;
    }
    let lower = values[..n / 2].iter().copied().fold(f64::NEG_INFINITY, f64::max);
    0.5 * (lower + upper)
}

/// The middle value, or the upper of the two middle ones; `None` without values. Reorders the slice
/// deterministically.
pub fn upper_median(values: &mut [f64]) -> Option<f64> {
    if values.is_empty() {
        return None;
    }
    let middle = values.len() / 2;
    Some(*values.select_nth_unstable_by(middle, f64::total_cmp).1)
}

/// Median of the finite values, and the upper median of their absolute distances from it, both by
/// [`upper_median`]; `None` without finite values. Keeps only the finite values' distances in
/// `values`.
pub fn median_and_deviation(values: &mut Vec<f64>) -> Option<(f64, f64)> {
    values.retain(|x| x.is_finite());
    let centre = upper_median(values)?;
    for value in values.iter_mut() {
        *value = (*value - centre).abs();
    }
    Some((centre, upper_median(values)?))
}

/// Mean and standard deviation of a sample (`n − 1` in the denominator, NaN for one value); `None`
/// without values.
pub fn mean_and_deviation(values: &[f64]) -> Option<(f64, f64)> {
    let n = values.len() as f64;
    let mean = values.iter().sum::<f64>() / n;
    let square: f64 = values.iter().map(|v| (v - mean).powi(2)).sum();
    (n > 0.0).then(|| (mean, if n > 1.0 { (square / (n - 1.0)).sqrt() } else { f64::NAN }))
}

/// Mean of a sample, and how far from it one more value may lie: half the 95 % prediction interval
/// of a normal distribution. `further` is a standard deviation by which the new value varies and
/// the sample does not; the degrees of freedom of the sum are Satterthwaite's. `None` without
/// values; with one value, infinite or NaN.
pub fn one_more(values: &[f64], further: f64) -> Option<(f64, f64)> {
    /// Degrees of freedom beyond which Student's t is normal.
    const MOST_FREEDOM: f64 = 1e6;
    let n = values.len() as f64;
    let (mean, deviation) = mean_and_deviation(values)?;
    let predicted = deviation.powi(2) * (1.0 + 1.0 / n);
    let total = predicted + further * further;
    let freedom = (n - 1.0) * (total / predicted).powi(2);
    Some((mean, t975(freedom.min(MOST_FREEDOM)) * total.sqrt()))
}

/// The value below which `part` of `of` equal parts of an ascending sample lie, rounded down to a
/// value of the sample; `None` without values.
pub fn quantile_of_sorted(sorted: &[f64], part: usize, of: usize) -> Option<f64> {
    sorted.get(sorted.len().checked_sub(1)? * part / of).copied()
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn unit_medians_of_odd_even_and_empty_samples() {
        assert_eq!(median(&mut [3.0, 1.0, 2.0]), 2.0);
        assert_eq!(median(&mut [4.0, 1.0, 2.0, 3.0]), 2.5);
        assert!(median(&mut []).is_nan());
        assert_eq!(upper_median(&mut [4.0, 1.0, 2.0, 3.0]), Some(3.0));
        assert_eq!(upper_median(&mut []), None);
        assert_eq!(median_and_deviation(&mut vec![1.0, f64::NAN, 2.0, 5.0]), Some((2.0, 1.0)));
        assert_eq!(median_and_deviation(&mut vec![f64::NAN]), None);
        assert_eq!(quantile_of_sorted(&[1.0, 2.0, 3.0, 4.0, 5.0], 1, 4), Some(2.0));
        assert_eq!(quantile_of_sorted(&[], 1, 4), None);
    }

    /// Without further variation it is the prediction interval of Student's t, with much of it that
    /// of the further variation alone.
    #[test]
    fn one_more_value_lies_within_the_prediction_interval() {
        let (mean, reach) = one_more(&[1.0, 2.0, 3.0], 0.0).unwrap();
        assert_eq!(mean, 2.0);
        assert!((reach - t975(2.0) * (4.0_f64 / 3.0).sqrt()).abs() < 1e-12, "{reach}");
        let (_, reach) = one_more(&[1.0, 1.0 + 1e-6, 1.0 - 1e-6], 0.5).unwrap();
        assert!((reach - 0.5 * 1.959_963_984_54).abs() < 1e-5, "{reach}");
        assert!(one_more(&[], 1.0).is_none() && one_more(&[1.0], 0.0).unwrap().1.is_nan());
    }

    proptest! {
        #[test]
        fn prop_medians_are_those_of_the_sorted_sample(values in prop::collection::vec(-1e6..1e6_f64, 1..60)) {
            let mut sorted = values.clone();
            sorted.sort_by(f64::total_cmp);
            let n = sorted.len();
            prop_assert_eq!(upper_median(&mut values.clone()), Some(sorted[n / 2]));
            prop_assert_eq!(median(&mut values.clone()), 0.5 * (sorted[(n - 1) / 2] + sorted[n / 2]));
        }
    }
}
