//! White noise of the coordinates as the errors of the rows, where no comparison draws them.
//!
//! The covariance of that noise is estimated from the recording: the third difference of the steps
//! between frames is the fourth difference of the noise (70 times its variance), to which body
//! motion contributes nothing. Noise drawn from it is added to the motion, and the rows are formed
//! again.

use crate::DiscoverError;
use crate::draws::Drawn;
use crate::session::{Body, Session, TrialInput, moment_length_m};
use aloft_body::{Model, Motion};
use aloft_regressor::{Acting, RegressorError, Stretch, WeakOptions, weak_rows};
use nalgebra::{DMatrix, DVector};
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};
use rayon::prelude::*;
use std::sync::Arc;

/// Draws of the errors of the rows; as many as a comparison makes.
const DRAWS: u64 = 8;

impl Session<'_> {
    /// Takes the white noise of the coordinates alone for the errors of the recordings, where no
    /// comparison draws them ([`with_draws`](Self::with_draws)). Errors of geometry, skin and
    /// plates are not in it. `body`, `trials` and `options` are those of the session.
    ///
    /// # Errors
    /// [`DiscoverError::Regressor`] for trials that do not fit the model, [`DiscoverError::TooFew`]
    /// where the motions are too short to show their noise.
    pub fn with_white_noise(
        mut self,
        body: &Body<'_>,
        trials: &[TrialInput<'_>],
        options: &WeakOptions,
    ) -> Result<Self, DiscoverError> {
        let few =
            |found| DiscoverError::TooFew { what: "frames that show the noise of the coordinates", needed: 2, found };
        let root = noise_root(body.model, trials).ok_or_else(|| few(0))?;
        let jobs: Vec<(&TrialInput<'_>, &Stretch)> =
            trials.iter().flat_map(|t| t.stretches.iter().map(move |s| (t, s))).collect();
        let of_draw = |draw: u64| {
            let one =
                |(i, job): (usize, &(&TrialInput<'_>, &Stretch))| errors(body, options, *job, &root, draw, i as u64);
            let rows: Vec<Option<DVector<f64>>> = jobs.par_iter().enumerate().map(one).collect::<Result<_, _>>()?;
            Ok(rows.into_iter().flatten().collect::<Vec<_>>())
        };
        let rows = (0..DRAWS).map(of_draw).collect::<Result<Vec<_>, RegressorError>>()?;
        let fits = |rows: &Vec<DVector<f64>>| {
            rows.len() == self.blocks.len() && rows.iter().zip(&self.blocks).all(|(r, b)| r.len() == b.y.nrows())
        };
        if !rows.iter().all(fits) {
            return Err(few(rows.first().map_or(0, Vec::len)));
        }
        self.drawn = Arc::new(Drawn { rows, zeros: Vec::new() });
        self.warnings.push(
            "no comparison has drawn the errors of these windows: the white noise of the coordinates stands for them, without geometry, skin and plates"
                .to_owned(),
        );
        Ok(self)
    }

    /// True if the errors of the rows are drawn.
    pub fn has_draws(&self) -> bool {
        !self.drawn.rows.is_empty()
    }
}

/// Errors of the weighted rows of a stretch from noise of one draw; none if it is too short.
fn errors(
    body: &Body<'_>,
    options: &WeakOptions,
    (trial, stretch): (&TrialInput<'_>, &Stretch),
    root: &DMatrix<f64>,
    draw: u64,
    job: u64,
) -> Result<Option<DVector<f64>>, RegressorError> {
    let prior = body.base.regroup(body.phi);
    let mut rng = ChaCha8Rng::seed_from_u64(0x0a10_f7f1 ^ draw);
    rng.set_stream(job);
    let noisy = with_noise(body.model, trial.motion, stretch, root, &mut rng);
    let whole = Stretch { first_frame: 0, end_frame: noisy.n_frames(), ..stretch.clone() };
    let rows = |m: &Motion| {
        let zero = vec![nalgebra::Vector6::zeros(); m.n_frames()];
        let acting = Acting { measured: Some(&zero), effects: None };
        let mut rows = match weak_rows(body.model, body.base, body.phi, m, &whole, acting, options) {
            Ok(rows) => rows,
            Err(RegressorError::TooShort { .. }) => return Ok(None),
            Err(e) => return Err(e),
        };
        rows.apply_fixed_weights(moment_length_m(body, options));
        let row = |r: usize| (0..prior.len()).map(|c| rows.matrix[(r, c)] * prior[c]).sum::<f64>();
        Ok(Some(DVector::from_fn(rows.matrix.nrows(), |r, _| row(r))))
    };
    let (noisy, clean) = (rows(&noisy)?, rows(&cut_motion(trial.motion, stretch))?);
    Ok(noisy.zip(clean).filter(|(a, b)| a.len() == b.len()).map(|(a, b)| a - b))
}

fn cut_motion(motion: &Motion, stretch: &Stretch) -> Motion {
    let q = motion.q[stretch.first_frame * motion.nq..stretch.end_frame.min(motion.n_frames()) * motion.nq].to_vec();
    Motion { q, v: Vec::new(), a: Vec::new(), residual_m: Vec::new(), q_sd: Vec::new(), ..motion.clone() }
}

fn with_noise(model: &Model, motion: &Motion, stretch: &Stretch, root: &DMatrix<f64>, rng: &mut ChaCha8Rng) -> Motion {
    let mut out = cut_motion(motion, stretch);
    let mut moved = vec![0.0; model.nq];
    for frame in 0..out.n_frames() {
        let draw = DVector::from_fn(model.nv, |_, _| StandardNormal.sample(rng));
        if out.is_valid(frame) {
            let step: DVector<f64> = root * draw;
            model.integrate(out.q(frame), step.as_slice(), &mut moved);
            out.q[frame * model.nq..(frame + 1) * model.nq].copy_from_slice(&moved);
        }
    }
    out
}

/// Lower triangular root of the covariance of the coordinates' white noise.
fn noise_root(model: &Model, trials: &[TrialInput<'_>]) -> Option<DMatrix<f64>> {
    let nv = model.nv;
    let mut all: Vec<DVector<f64>> = Vec::new();
    let mut step = vec![0.0; nv];
    for trial in trials {
        let motion = trial.motion;
        for stretch in trial.stretches {
            let end = stretch.end_frame.min(motion.n_frames());
            for frame in (stretch.first_frame..end.saturating_sub(4)).step_by(3) {
                if (frame..frame + 5).all(|f| motion.is_valid(f)) {
                    let mut d = DVector::zeros(nv);
                    for (k, weight) in [-1.0, 3.0, -3.0, 1.0].iter().enumerate() {
                        model.difference(motion.q(frame + k), motion.q(frame + k + 1), &mut step);
                        for (x, s) in d.iter_mut().zip(&step) {
                            *x += weight * s;
                        }
                    }
                    all.push(d);
                }
            }
        }
    }
    if all.len() < 2 * nv {
        return None;
    }
    // outlying frames in any coordinate are not noise
    let median: Vec<f64> = (0..nv)
        .map(|c| {
            let mut x: Vec<f64> = all.iter().map(|d| d[c].abs()).collect();
            let mid = x.len() / 2;
            *x.select_nth_unstable_by(mid, f64::total_cmp).1
        })
        .collect();
    let mut covariance = DMatrix::zeros(nv, nv);
    let mut n = 0.0;
    for d in all.iter().filter(|d| d.iter().zip(&median).all(|(x, m)| x.abs() <= 7.5 * m)) {
        covariance += d * d.transpose();
        n += 1.0;
    }
    if n < nv as f64 {
        return None;
    }
    covariance /= 70.0 * n;
    let trace = covariance.trace() / nv as f64;
    if !(trace.is_finite() && trace > 0.0) {
        return None;
    }
    for i in 0..nv {
        covariance[(i, i)] += 1e-6 * trace.min(covariance[(i, i)]).max(1e-30) + 1e-18;
    }
    covariance.cholesky().map(|c| c.l())
}
