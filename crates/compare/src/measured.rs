//! Measured wrench of the plates at the frames of the motion: filtered like the motion, and
//! unfiltered for weak windows.

use crate::CompareError;
use crate::errors::joined;
use aloft_signal::{Butterworth, CutoffCorrection, Interpolation, LowPass, resample};
use aloft_trial::Plate;
use nalgebra::Vector6;
use serde::{Deserialize, Serialize};

/// Sum of all plates at the frames of a motion: world force (N) on the body and moment (N·m) about
/// the world origin; NaN where missing.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct Measured {
    /// Filtered with the low-pass of the motion.
    pub filtered: Vec<Vector6<f64>>,
    /// Not filtered, except against aliasing where the plates are faster than the cameras.
    pub unfiltered: Vec<Vector6<f64>>,
    /// White noise of the sum, one-sided density in N²/Hz and (N·m)²/Hz, from fourth differences of
    /// the plates' own samples. These retain frequencies near half the plates' rate, where body
    /// motion contributes nothing. A lower bound if the plates were already filtered.
    pub noise_density: Vector6<f64>,
}

/// Plates whose rate is within this factor of the marker rate need no anti-aliasing filter.
const FASTER: f64 = 1.2;

/// Brings plates to `n_frames` frames at `rate_hz` (frame k and analog sample 0 of the recording
/// share the time of frame 0). Plates must be tared. Without plates everything is zero: no
/// instrumented surface was touched.
///
/// # Errors
/// A filter that does not fit a plate's rate.
pub fn measured_wrench(
    trial: &str,
    plates: &[Plate],
    rate_hz: f64,
    n_frames: usize,
    filter: Option<LowPass>,
) -> Result<Measured, CompareError> {
    let times_s: Vec<f64> = (0..n_frames).map(|k| k as f64 / rate_hz).collect();
    let mut sum = Measured {
        filtered: vec![Vector6::zeros(); n_frames],
        unfiltered: vec![Vector6::zeros(); n_frames],
        noise_density: Vector6::zeros(),
    };
    for plate in plates {
        let failed = |source| CompareError::Plate { trial: trial.to_owned(), plate: plate.name.clone(), source };
        let n = plate.force_n.len().min(plate.moment_nm.len());
        let mut samples: Vec<f64> =
            (0..n).flat_map(|i| <[f64; 6]>::from(joined(&plate.force_n[i], &plate.moment_nm[i]))).collect();
        for (axis, density) in noise_density(&samples, plate.rate_hz).into_iter().enumerate() {
            sum.noise_density[axis] += density;
        }
        let mut unfiltered = samples.clone();
        if plate.rate_hz > FASTER * rate_hz {
            let against_folding = LowPass { order: 4, cutoff_hz: 0.4 * rate_hz, correction: CutoffCorrection::Winter };
            Butterworth::design(against_folding, plate.rate_hz)
                .map_err(failed)?
                .filtfilt_interleaved(&mut unfiltered, 6);
        }
        if let Some(filter) = filter {
            Butterworth::design(filter, plate.rate_hz).map_err(failed)?.filtfilt_interleaved(&mut samples, 6);
        } else {
            samples.clone_from(&unfiltered);
        }
        for (series, out) in [(&samples, &mut sum.filtered), (&unfiltered, &mut sum.unfiltered)] {
            let mut channel = vec![0.0; n];
            for axis in 0..6 {
                for (i, x) in channel.iter_mut().enumerate() {
                    *x = series[6 * i + axis];
                }
                let at_frames = resample(&channel, plate.rate_hz, 0.0, &times_s, Interpolation::Cubic);
                for (w, x) in out.iter_mut().zip(at_frames) {
                    w[axis] += x;
                }
            }
        }
    }
    Ok(sum)
}

/// Variance of fourth differences of white noise of variance one: Σ binomial(4, k)².
pub(crate) const FOURTH_DIFFERENCE: f64 = 70.0;

/// One-sided white density of six interleaved channels by the median absolute fourth difference;
/// exact zeros (plates clipped when unloaded) do not count.
fn noise_density(samples: &[f64], rate_hz: f64) -> [f64; 6] {
    std::array::from_fn(|axis| {
        let x = |i: usize| samples[6 * i + axis];
        let n = samples.len() / 6;
        let mut differences: Vec<f64> = (4..n)
            .filter(|&i| (0..5).all(|k| x(i - k).is_finite()) && (0..5).any(|k| x(i - k) != 0.0))
            .map(|i| (x(i) - 4.0 * x(i - 1) + 6.0 * x(i - 2) - 4.0 * x(i - 3) + x(i - 4)).abs())
            .collect();
        let sd = median_scale(&mut differences) / FOURTH_DIFFERENCE.sqrt();
        2.0 * sd * sd / rate_hz
    })
}

/// Standard deviation of a normal distribution with this median absolute value; 0 without values.
pub(crate) fn median_scale(absolute: &mut [f64]) -> f64 {
    aloft_signal::upper_median(absolute).map_or(0.0, |median| median / 0.674_489_750_196_081_7)
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::Vector3;
    use rand::SeedableRng;
    use rand_distr::{Distribution, StandardNormal};

    #[test]
    fn slow_forces_and_their_noise_come_through() {
        let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(3);
        let slow = |t: f64| 300.0 + 100.0 * (6.0 * t).sin();
        let n = 3000;
        let plate = |share: f64, rng: &mut rand_chacha::ChaCha8Rng| Plate {
            name: "FP".into(),
            rate_hz: 1000.0,
            corners_m: Vec::new(),
            force_n: (0..n)
                .map(|i| {
                    let noise: f64 = StandardNormal.sample(rng);
                    Vector3::new(0.0, 0.0, share * slow(i as f64 / 1000.0) + noise)
                })
                .collect(),
            moment_nm: vec![Vector3::zeros(); n],
        };
        let plates = [plate(0.3, &mut rng), plate(0.7, &mut rng)];
        let filter = LowPass { order: 3, cutoff_hz: 10.0, correction: CutoffCorrection::None };
        let m = measured_wrench("t", &plates, 200.0, 600, Some(filter)).unwrap();
        // two plates of 1 N at 1000 Hz: 2 · 2/1000
        assert!((m.noise_density[2] / 0.004 - 1.0).abs() < 0.1, "{}", m.noise_density[2]);
        for k in 40..560 {
            assert!((m.filtered[k][2] - slow(k as f64 / 200.0)).abs() < 1.5);
            assert!((m.unfiltered[k][2] - slow(k as f64 / 200.0)).abs() < 5.0);
        }
        let none = measured_wrench("t", &[], 200.0, 5, Some(filter)).unwrap();
        assert_eq!(none.filtered, vec![Vector6::zeros(); 5]);
    }

    #[test]
    fn a_filter_that_does_not_fit_names_the_plate() {
        let plate = Plate { name: "FP2".into(), rate_hz: 15.0, ..Plate::default() };
        let filter = LowPass { order: 3, cutoff_hz: 10.0, correction: CutoffCorrection::None };
        let error = measured_wrench("jump01", &[plate], 10.0, 5, Some(filter)).unwrap_err();
        assert!(error.to_string().starts_with("jump01, plate FP2: cut-off 10 Hz"), "{error}");
    }
}
