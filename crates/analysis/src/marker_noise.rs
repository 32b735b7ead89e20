//! White noise of markers, from their own trajectories.

use aloft_trial::Markers;

/// Sum of squared binomial coefficients of a fourth difference.
const FOURTH_DIFFERENCE: f64 = 70.0;

/// White noise of one coordinate, mm: median over markers and axes of the median absolute fourth
/// difference.
pub(crate) fn white_noise_mm(markers: &Markers) -> Option<f64> {
    let mut each = Vec::new();
    for track in &markers.trajectories {
        for axis in 0..3 {
            let mut steps: Vec<f64> = track
                .windows(5)
                .map(|w| (w[0][axis] - 4.0 * w[1][axis] + 6.0 * w[2][axis] - 4.0 * w[3][axis] + w[4][axis]).abs())
                .filter(|d| d.is_finite())
                .collect();
            if steps.len() > 20
                && let Some(median) = aloft_signal::upper_median(&mut steps)
            {
                each.push(1e3 * median / 0.674_489_750_196_081_7 / FOURTH_DIFFERENCE.sqrt());
            }
        }
    }
    aloft_signal::upper_median(&mut each)
}
