//! Stretches of a signal without missing samples. Filters and derivatives are applied within these
//! and never across a gap.

use std::ops::Range;

/// The maximal stretches of finite samples, in order.
pub fn finite_runs(signal: &[f64]) -> Vec<Range<usize>> {
    runs_where(signal.len(), |i| signal[i].is_finite())
}

/// The maximal stretches of indices below `n` for which `keep` holds, in order.
pub fn runs_where(n: usize, keep: impl Fn(usize) -> bool) -> Vec<Range<usize>> {
    let mut runs = Vec::new();
    let mut start = None;
    for i in 0..n {
        match (keep(i), start) {
            (true, None) => start = Some(i),
            (false, Some(s)) => {
                runs.push(s..i);
                start = None;
            }
            _ => {}
        }
    }
    if let Some(s) = start {
        runs.push(s..n);
    }
    runs
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn unit_runs_cover_exactly_the_finite_samples() {
        let nan = f64::NAN;
        assert_eq!(finite_runs(&[nan, 1.0, 2.0, nan, nan, 3.0]), vec![1..3, 5..6]);
        assert_eq!(finite_runs(&[1.0, f64::INFINITY, 1.0]), vec![0..1, 2..3]);
        assert!(finite_runs(&[]).is_empty());
        assert!(finite_runs(&[nan, nan]).is_empty());
    }

    proptest! {
        #[test]
        fn prop_runs_are_maximal_and_cover_what_holds(holds in prop::collection::vec(any::<bool>(), 0..80)) {
            let runs = runs_where(holds.len(), |i| holds[i]);
            let covered: Vec<bool> = (0..holds.len()).map(|i| runs.iter().any(|r| r.contains(&i))).collect();
            prop_assert_eq!(&covered, &holds);
            // Ascending, not empty, and separated by at least one index for which the condition
            // does not hold.
            prop_assert!(runs.iter().all(|r| !r.is_empty()));
            prop_assert!(runs.windows(2).all(|w| w[0].end < w[1].start));
        }
    }
}
