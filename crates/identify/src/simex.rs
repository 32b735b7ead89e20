//! Errors in variables: estimates the bias that noise in the regressors causes.
//!
//! Noise in the regressors biases least-squares estimates towards zero. SIMEX (Cook and Stefanski
//! 1994) measures the bias on the data at hand: noise of known size is added repeatedly, and the
//! drift of the estimate with the total variance is extrapolated back to zero noise. Weak rows
//! drift little, acceleration rows with gentle excitation drift a lot.

use crate::IdentifyError;
use aloft_body::{Model, Motion, State};
use aloft_regressor::CoordinateNoise;
use aloft_regressor::noise::coordinate_root;
use nalgebra::{DMatrix, DVector};
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};
use rayon::prelude::*;

/// A motion with white noise added to its coordinates, with the covariance given by `noise` times
/// `scale` squared. Depends only on the seed and the frame number. Velocities, accelerations and
/// standard deviations are dropped, because they belong to the motion without the noise.
///
/// # Errors
/// [`IdentifyError::Regressor`] if the noise does not fit the model.
pub fn add_noise(
    model: &Model,
    motion: &Motion,
    noise: &CoordinateNoise<'_>,
    scale: f64,
    seed: u64,
) -> Result<Motion, IdentifyError> {
    let mut out = motion.clone();
    out.v.clear();
    out.a.clear();
    out.q_sd.clear();
    let nv = model.nv;
    let mut state = State::new(model);
    let mut unit = vec![0.0; nv];
    let mut step = vec![0.0; nv];
    for frame in (0..motion.n_frames()).filter(|&f| motion.is_valid(f)) {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        rng.set_stream(frame as u64);
        unit.iter_mut().for_each(|u| *u = StandardNormal.sample(&mut rng));
        state.forward_position(model, motion.q(frame));
        let root = coordinate_root(model, motion, frame, noise, &state)?;
        for (i, step) in step.iter_mut().enumerate() {
            *step = scale * (0..nv).map(|j| root[(i, j)] * unit[j]).sum::<f64>();
        }
        model.integrate(motion.q(frame), &step, &mut out.q[frame * model.nq..(frame + 1) * model.nq]);
    }
    Ok(out)
}

/// Result of extrapolation to zero noise.
#[derive(Debug, Clone, PartialEq)]
pub struct Simex {
    /// Estimates without added noise.
    pub naive: DVector<f64>,
    /// Estimates extrapolated to noise-free data.
    pub extrapolated: DVector<f64>,
    /// `naive − extrapolated`: the bias caused by noise.
    pub bias: DVector<f64>,
    /// Standard error of the extrapolated values from the spread among replicates.
    pub extrapolation_se: DVector<f64>,
}

/// Runs `estimate(level, replicate)` for every level and replicate, in parallel, and extrapolates.
///
/// `level` is the variance of the added noise relative to that already in the data; `levels` should
/// begin with 0 (one call) and contain at least two more, such as 0.5, 1, 2. A parabola through the
/// means is extrapolated to −1.
///
/// # Errors
/// [`IdentifyError::TooFew`] without three levels including 0, or the error of an estimate.
pub fn simex(
    levels: &[f64],
    replicates: usize,
    estimate: impl Fn(f64, usize) -> Result<DVector<f64>, IdentifyError> + Sync,
) -> Result<Simex, IdentifyError> {
    let added: Vec<f64> = levels.iter().copied().filter(|l| *l > 0.0 && l.is_finite()).collect();
    if added.len() < 2 || replicates == 0 {
        return Err(IdentifyError::TooFew { what: "levels of added noise", needed: 2, found: added.len() });
    }
    let naive = estimate(0.0, 0)?;
    let calls: Vec<(f64, usize)> = added.iter().flat_map(|&l| (0..replicates).map(move |r| (l, r))).collect();
    let results: Vec<DVector<f64>> =
        calls.into_par_iter().map(|(level, replicate)| estimate(level, replicate)).collect::<Result<_, _>>()?;
    // c0 + c1 l + c2 l²: the level without added noise is one exact call and has the weight of a
    // mean
    let mut level_of = vec![0.0];
    level_of.extend(&added);
    let design = DMatrix::from_fn(level_of.len(), 3, |i, j| level_of[i].powi(j as i32));
    let pseudo = design
        .clone()
        .pseudo_inverse(1e-12)
        .map_err(|problem| IdentifyError::Numeric(format!("extrapolation of added noise: {problem}")))?;
    let at = DVector::from_column_slice(&[1.0, -1.0, 1.0]);
    let weights = pseudo.tr_mul(&at);
    let mut extrapolated = &naive * weights[0];
    let mut variance = DVector::zeros(naive.len());
    for (i, of_level) in results.chunks(replicates).enumerate() {
        let mean = of_level.iter().fold(DVector::zeros(naive.len()), |sum, x| sum + x) / replicates as f64;
        extrapolated += &mean * weights[i + 1];
        let w2 = weights[i + 1] * weights[i + 1] / replicates as f64 / (replicates as f64 - 1.0).max(1.0);
        for x in of_level {
            variance += (x - &mean).map(|d| d * d) * w2;
        }
    }
    let bias = &naive - &extrapolated;
    Ok(Simex { naive, extrapolated, bias, extrapolation_se: variance.map(f64::sqrt) })
}
