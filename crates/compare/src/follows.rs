//! Whether the plates follow the motion of a recording: agreement in time of two series of force.

use aloft_signal::mean_and_deviation;

/// Fewest frames of a correlation.
const FEWEST_FRAMES: usize = 50;
/// Length over which both forces are averaged, s: a force from second derivatives of markers is
/// noise frame by frame where the filter lets it pass.
const AVERAGED_S: f64 = 0.1;
/// Least deviation of a force that follows anything, as a share of its mean.
const LEAST_CHANGE: f64 = 0.1;

/// Correlation in time of the sizes of predicted and measured force, N, frame by frame, both
/// averaged over 0.1 s; frames in which one of them is not finite are left out. None of fewer than
/// 50 frames, or where the measured force changes by less than a tenth of its mean.
pub fn correlation_in_time(predicted_n: &[f64], measured_n: &[f64], rate_hz: f64) -> Option<f64> {
    let usable = |f: usize| predicted_n[f].is_finite() && measured_n[f].is_finite();
    let n = predicted_n.len().min(measured_n.len());
    let half = (0.5 * AVERAGED_S * rate_hz).round().clamp(0.0, 1e4) as usize;
    let averaged = |f: usize| {
        let near: Vec<usize> = (f.saturating_sub(half)..(f + half + 1).min(n)).filter(|&i| usable(i)).collect();
        let mean = |of: &[f64]| near.iter().map(|&i| of[i]).sum::<f64>() / near.len() as f64;
        (mean(predicted_n), mean(measured_n))
    };
    let (p, m): (Vec<f64>, Vec<f64>) = (0..n).filter(|&f| usable(f)).map(averaged).unzip();
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
        assert!((correlation_in_time(&own, &scaled, 100.0).unwrap() - 1.0).abs() < 1e-9);
        assert!(correlation_in_time(&own, &other, 100.0).unwrap().abs() < 0.3);
        // noise from frame to frame is no other motion
        let noisy: Vec<f64> = own.iter().enumerate().map(|(i, x)| x + if i % 2 == 0 { 1e3 } else { -1e3 }).collect();
        assert!(correlation_in_time(&noisy, &own, 100.0).unwrap() > 0.8);
        // standing still follows nothing
        assert_eq!(correlation_in_time(&own, &[700.0; 200], 100.0), None);
        assert_eq!(correlation_in_time(&own[..30], &own[..30], 100.0), None);
    }
}
