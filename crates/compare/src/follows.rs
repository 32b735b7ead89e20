//! Whether the plates follow the motion of a recording: agreement in time of two series of force.

use aloft_signal::mean_and_deviation;

/// Fewest frames of a correlation.
const FEWEST_FRAMES: usize = 50;
/// Least deviation of a force that follows anything, as a share of its mean.
const LEAST_CHANGE: f64 = 0.1;

/// Correlation in time of the sizes of predicted and measured force, frame by frame; frames in
/// which one of them is not finite are left out. None of fewer than 50 frames, or where the
/// measured force changes by less than a tenth of its mean.
pub fn correlation_in_time(predicted_n: &[f64], measured_n: &[f64]) -> Option<f64> {
    let both = predicted_n.iter().zip(measured_n).filter(|(p, m)| p.is_finite() && m.is_finite());
    let (p, m): (Vec<f64>, Vec<f64>) = both.unzip();
    let ((mean_p, sd_p), (mean_m, sd_m)) = (mean_and_deviation(&p)?, mean_and_deviation(&m)?);
    if p.len() < FEWEST_FRAMES || sd_m < LEAST_CHANGE * mean_m.abs() || sd_p <= 0.0 {
        return None;
    }
    let sum: f64 = p.iter().zip(&m).map(|(p, m)| (p - mean_p) * (m - mean_m)).sum();
    Some(sum / ((p.len() - 1) as f64 * sd_p * sd_m))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_gain_follows_and_another_motion_does_not() {
        let force = |f: f64| (0..200).map(|i| 700.0 + 300.0 * (f * f64::from(i)).sin()).collect::<Vec<f64>>();
        let (own, other) = (force(0.1), force(0.137));
        let scaled: Vec<f64> = own.iter().map(|x| 0.8 * x - 30.0).collect();
        assert!((correlation_in_time(&own, &scaled).unwrap() - 1.0).abs() < 1e-9);
        assert!(correlation_in_time(&own, &other).unwrap().abs() < 0.3);
        // standing still follows nothing
        assert_eq!(correlation_in_time(&own, &[700.0; 200]), None);
        assert_eq!(correlation_in_time(&own[..30], &own[..30]), None);
    }
}
