//! Winter's residual analysis: what a low-pass removes at each cut-off, and below which cut-off it
//! removes signal.
//!
//! Helps users to choose a cut-off. At high cut-offs a filter removes noise only, and the residual
//! increases almost linearly as the cut-off decreases; the value of that line at zero frequency
//! estimates the noise. The suggested cut-off is the one whose residual equals that noise, so that
//! signal distortion and remaining noise are of equal size (D. A. Winter, Biomechanics and Motor
//! Control of Human Movement).

use crate::butterworth::{Butterworth, DesignError, LowPass};
use serde::{Deserialize, Serialize};

/// Minimum number of cut-offs for a line.
const FEWEST_IN_LINE: usize = 5;
/// Fraction of the variance that a line must explain to be accepted as straight.
const STRAIGHT: f64 = 0.98;

/// Cut-off against residual.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct ResidualAnalysis {
    /// Cut-offs tried, Hz, ascending.
    pub cutoff_hz: Vec<f64>,
    /// Root mean square of signal minus filtered signal, in the signal's unit.
    pub residual_rms: Vec<f64>,
    /// Noise by extrapolating the straight part to zero frequency, in the signal's unit; `None` if
    /// no straight part was found.
    pub noise_rms: Option<f64>,
    /// Cut-off at which the residual equals the noise, Hz.
    pub suggested_cutoff_hz: Option<f64>,
}

/// Half-hertz steps from 1 Hz to 30 Hz, or to 0.35 of the sampling rate where that is lower.
pub fn default_cutoffs(rate_hz: f64) -> Vec<f64> {
    let top = (0.35 * rate_hz).min(30.0);
    (2..).map(|i| 0.5 * f64::from(i)).take_while(|f| *f <= top).collect()
}

/// Residuals of channels in one unit (for example the three axes of a marker), each a slice of
/// samples with NaN where missing. `shape` gives order and correction; its cut-off is replaced by
/// each of `cutoffs_hz`, which must ascend.
///
/// # Errors
/// An order or cut-off that is not valid at this rate.
pub fn residual_analysis(
    channels: &[&[f64]],
    rate_hz: f64,
    shape: LowPass,
    cutoffs_hz: &[f64],
) -> Result<ResidualAnalysis, DesignError> {
    let mut filtered = Vec::new();
    let mut residual_rms = Vec::with_capacity(cutoffs_hz.len());
    for &cutoff_hz in cutoffs_hz {
        let filter = Butterworth::design(LowPass { cutoff_hz, ..shape }, rate_hz)?;
        let (mut sum, mut n) = (0.0, 0usize);
        for channel in channels {
            filtered.clear();
            filtered.extend_from_slice(channel);
            filter.filtfilt(&mut filtered);
            for (x, y) in channel.iter().zip(&filtered).filter(|(_, y)| y.is_finite()) {
                sum += (x - y) * (x - y);
                n += 1;
            }
        }
        residual_rms.push(if n == 0 { f64::NAN } else { (sum / n as f64).sqrt() });
    }
    let noise_rms = (0..cutoffs_hz.len().saturating_sub(FEWEST_IN_LINE - 1))
        .map(|first| line(&cutoffs_hz[first..], &residual_rms[first..]))
        .find(|l| l.explained >= STRAIGHT)
        .map(|l| l.at_zero)
        .filter(|noise| *noise > 0.0);
    let suggested_cutoff_hz = noise_rms.and_then(|noise| crossing(cutoffs_hz, &residual_rms, noise));
    Ok(ResidualAnalysis { cutoff_hz: cutoffs_hz.to_vec(), residual_rms, noise_rms, suggested_cutoff_hz })
}

struct Line {
    at_zero: f64,
    explained: f64,
}

fn line(x: &[f64], y: &[f64]) -> Line {
    let n = x.len() as f64;
    let (mx, my) = (x.iter().sum::<f64>() / n, y.iter().sum::<f64>() / n);
    let (mut xx, mut xy, mut yy) = (0.0, 0.0, 0.0);
    for (x, y) in x.iter().zip(y) {
        xx += (x - mx) * (x - mx);
        xy += (x - mx) * (y - my);
        yy += (y - my) * (y - my);
    }
    let slope = xy / xx;
    // A residual must increase towards low cut-offs; otherwise the line does not describe noise.
    let explained = if slope < 0.0 && yy > 0.0 { xy * xy / (xx * yy) } else { 0.0 };
    Line { at_zero: my - slope * mx, explained }
}

/// First cut-off at which the decreasing residual reaches the level, by linear interpolation.
fn crossing(x: &[f64], y: &[f64], level: f64) -> Option<f64> {
    let i = y.iter().position(|y| *y <= level)?;
    if i == 0 {
        return Some(x[0]);
    }
    Some(x[i - 1] + (x[i] - x[i - 1]) * (y[i - 1] - level) / (y[i - 1] - y[i]))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::butterworth::CutoffCorrection;

    #[test]
    fn noise_and_band_of_a_known_signal_are_found() {
        let rate = 200.0;
        let mut seed = 7u64;
        // Sum of twelve uniform numbers: nearly normal, standard deviation 1.
        let mut normal = || {
            (0..12).fold(-6.0, |s, _| {
                seed = seed.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
                s + (seed >> 11) as f64 / (1u64 << 53) as f64
            })
        };
        let x: Vec<f64> = (0..4000)
            .map(|i| {
                let t = i as f64 / rate;
                (t * 6.0).sin() + 0.3 * (t * 18.0).sin() + 0.02 * normal()
            })
            .collect();
        let shape = LowPass { order: 2, cutoff_hz: 6.0, correction: CutoffCorrection::Winter };
        let table = residual_analysis(&[&x], rate, shape, &default_cutoffs(rate)).unwrap();
        let (noise, cutoff) = (table.noise_rms.unwrap(), table.suggested_cutoff_hz.unwrap());
        assert!((noise - 0.02).abs() < 0.002, "{noise}");
        assert!((4.0..12.0).contains(&cutoff), "{cutoff}");
        assert!(table.residual_rms.windows(2).all(|w| w[1] <= w[0]));
    }

    #[test]
    fn nothing_is_suggested_without_samples() {
        let shape = LowPass { order: 2, cutoff_hz: 6.0, correction: CutoffCorrection::None };
        let table = residual_analysis(&[&[f64::NAN; 40]], 100.0, shape, &default_cutoffs(100.0)).unwrap();
        assert!(table.residual_rms.iter().all(|r| r.is_nan()) && table.suggested_cutoff_hz.is_none());
    }
}
