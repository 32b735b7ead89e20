//! What is missing shows in the recordings one by one, not only in their sum.
//!
//! A likelihood counts rows. Errors of the model that no noise describes (a trunk that bends, skin)
//! repeat within a recording, so that thousands of rows can be one piece of evidence. The gain of
//! an explanation is therefore also judged with recordings (stretches, where they are few) as the
//! units: the mean logarithm by which their squared errors fall (which a single wild recording does
//! not carry) against its scatter, as the odds of Student's t with a prior that has the information
//! of one recording (Rouder et al. 2009; Schwarz's approximation).

use crate::candidate::Scored;
use crate::problem::Problem;

/// Logarithm of the odds for a mean gain above zero; of recordings in which the explanation acts,
/// less what it costs to choose these among all. A load is something that some recordings carry,
/// and pays for no choice.
pub(super) fn ln_odds_by_recording(problem: &Problem, scored: &Scored<'_>) -> f64 {
    let group = &scored.variant.group;
    let chosen = !group.is_empty() && !scored.variant.effect.about().by_group;
    let cost = if chosen { ln_choices(problem, group) } else { 0.0 };
    let acts = |g: usize| group.is_empty() || group[problem.clusters[g].trial];
    let gains: Vec<f64> = (0..problem.folds.len())
        .filter(|&g| acts(g) && !problem.clusters[g].judged.is_empty())
        .map(|g| (problem.folds[g].error / scored.fold_error[g]).ln())
        .filter(|gain| gain.is_finite())
        .collect();
    ln_odds(&gains) - cost
}

/// Logarithm of the number of sets of as many recordings as `group` has, and of the sizes that a
/// set can have: the prior of a set of recordings.
pub(super) fn ln_choices(problem: &Problem, group: &[bool]) -> f64 {
    let mut trials: Vec<usize> = problem.clusters.iter().map(|c| c.trial).collect();
    trials.sort_unstable();
    trials.dedup();
    let (n, k) = (trials.len(), trials.iter().filter(|t| group[**t]).count());
    let ways: f64 = (0..k).map(|i| ((n - i) as f64 / (i + 1) as f64).ln()).sum();
    ways + (n.max(2) as f64 - 1.0).ln()
}

/// Logarithm of the odds for a mean above zero.
pub(super) fn ln_odds(gains: &[f64]) -> f64 {
    let n = gains.len() as f64;
    if gains.len() < 2 {
        return f64::NEG_INFINITY;
    }
    let mean = gains.iter().sum::<f64>() / n;
    if mean <= 0.0 {
        return f64::NEG_INFINITY;
    }
    let variance = gains.iter().map(|g| (g - mean).powi(2)).sum::<f64>() / (n - 1.0);
    let square = mean * mean * n / variance.max(f64::MIN_POSITIVE);
    0.5 * n * (square / (n - 1.0)).ln_1p() - 0.5 * n.ln()
}

#[cfg(test)]
mod tests {
    use super::ln_odds;

    #[test]
    fn a_gain_in_one_recording_is_no_evidence_and_one_in_all_is() {
        assert!(ln_odds(&[5.0, 0.0, 0.1, -0.1, 0.2, 0.0, 0.1, 0.0]) < 20f64.ln());
        assert!(ln_odds(&[0.5, 0.6, 0.4, 0.7, 0.5, 0.6, 0.8, 0.5]) > 20f64.ln());
        // half of the recordings with twice the gain
        assert!(ln_odds(&[0.5, 1.0, 0.5, 1.0, 0.5, 1.0, 0.5, 1.0]) > 20f64.ln());
        assert!(ln_odds(&[-1.0, -2.0, -1.0]).is_infinite() && ln_odds(&[3.0]).is_infinite());
    }
}
