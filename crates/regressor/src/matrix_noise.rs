//! Errors of the rows' matrix: the noise that measured motion brings into `[Y | −E | w]`.
//!
//! The rows are computed from measured coordinates q, so every column has an error ΔA, and least
//! squares, which puts all error on the right-hand side, shrinks what this noise can imitate
//! (Fuller, *Measurement Error Models*, 1987). What estimation needs is the Gram of the errors,
//! `S = E[ΔAᵀΔA]`, in the weights of the rows. It is computed from antithetic draws: with the
//! coordinates' errors δ_d of one draw,
//!
//! ```text
//! ΔA_d = (A(q ⊕ δ_d) − A(q ⊖ δ_d)) / 2,     S ≈ (1/D) Σ_d ΔA_dᵀ ΔA_d = TᵀT
//! ```
//!
//! in which every even order of δ cancels. The rows of a draw are those that the disturbed
//! recording would have given: the same windows, the same differences in time, the moment origin
//! along the disturbed path. Errors of different frames are independent, or those of a smoother
//! ([`MotionErrors`]). A draw depends on the frames of the stretch alone, so that T is the same on
//! any machine and under any name.

use crate::noise::{CoordinateNoise, coordinate_root};
use crate::stretch::Acting;
use crate::weak_windows::{WeakOptions, weak_rows};
use crate::{EffectColumns, RegressorError, Stretch};
use aloft_body::{BaseParameters, Model, Motion, Phi, State};
use faer::Mat;
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};

/// Unit wrenches of the model's effects along a disturbed motion; none without effects.
pub type EffectsAt<'a> = &'a dyn Fn(&Motion) -> Result<Option<EffectColumns>, RegressorError>;

/// Errors of a motion.
#[derive(Debug, Clone, Copy)]
pub enum MotionErrors<'a> {
    /// Independent in every frame, with this covariance of its coordinates.
    White(CoordinateNoise<'a>),
    /// The recording with the errors of each draw added and subtracted, for errors that a smoother
    /// or a filter has linked over time. Their number is the number of draws.
    Drawn(&'a [[Motion; 2]]),
}

/// What the errors of a stretch's rows are drawn from.
#[derive(Clone, Copy)]
pub struct MatrixNoise<'a> {
    /// Errors of the motion.
    pub motion: MotionErrors<'a>,
    /// Columns of the effects along another motion.
    pub effects_at: EffectsAt<'a>,
}

impl std::fmt::Debug for MatrixNoise<'_> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("MatrixNoise").field("motion", &self.motion).finish_non_exhaustive()
    }
}

impl<'a> MatrixNoise<'a> {
    /// Number of antithetic pairs of a stretch. A chain of 30 flights has some 2,000 rows, of which
    /// two draws give each direction of S to about 3 %.
    pub const DRAWS: usize = 2;

    /// White noise of the coordinates, in [`Self::DRAWS`] draws.
    pub fn white(coordinates: CoordinateNoise<'a>, effects_at: EffectsAt<'a>) -> Self {
        Self { motion: MotionErrors::White(coordinates), effects_at }
    }

    /// Number of antithetic pairs.
    fn draws(&self) -> usize {
        match self.motion {
            MotionErrors::White(_) => Self::DRAWS,
            MotionErrors::Drawn(pairs) => pairs.len(),
        }
    }
}

/// Unweighted errors of the rows of one stretch: for each draw a matrix of the shape of
/// [`WeakRows::matrix`](crate::WeakRows), divided by √D. `shape` gives the number of rows.
///
/// # Errors
/// [`RegressorError::Length`] if standard deviations do not fit the model, and as
/// [`weak_factor`](crate::weak_factor()).
pub(crate) fn row_errors(
    model: &Model,
    base: &BaseParameters,
    prior: &[Phi],
    motion: &Motion,
    stretch: &Stretch,
    acting: Acting<'_>,
    options: &WeakOptions,
    noise: &MatrixNoise<'_>,
) -> Result<Vec<Mat<f64>>, RegressorError> {
    let draws = noise.draws();
    let scale = 0.5 / (draws.max(1) as f64).sqrt();
    let side = |disturbed: &Motion| {
        let effects = (noise.effects_at)(disturbed)?;
        let acting = Acting { effects: effects.as_ref(), ..acting };
        weak_rows(model, base, prior, disturbed, stretch, acting, options).map(|rows| rows.matrix)
    };
    let roots = match noise.motion {
        MotionErrors::White(coordinates) => frame_roots(model, motion, stretch, &coordinates)?,
        MotionErrors::Drawn(_) => Vec::new(),
    };
    (0..draws)
        .map(|draw| {
            let (ahead, behind) = match noise.motion {
                MotionErrors::White(_) => {
                    let of = |sign: f64| side(&disturb(model, motion, stretch, &roots, draw, sign));
                    (of(1.0)?, of(-1.0)?)
                }
                MotionErrors::Drawn(pairs) => {
                    let [plus, minus] = &pairs[draw];
                    (side(plus)?, side(minus)?)
                }
            };
            if (ahead.nrows(), ahead.ncols()) != (behind.nrows(), behind.ncols()) {
                return Err(RegressorError::Numeric {
                    trial: stretch.trial.clone(),
                    stretch: stretch.index,
                    problem: "the errors of the rows have another shape than the rows".to_owned(),
                });
            }
            Ok(faer::Scale(scale) * (ahead - behind))
        })
        .collect()
}

/// A motion with white noise of its coordinates in some stretches, added and subtracted: an
/// antithetic pair for each of `draws` draws, the same as those of [`MatrixNoise`].
///
/// # Errors
/// [`RegressorError::Length`] if standard deviations do not fit the model.
pub fn disturbed(
    model: &Model,
    motion: &Motion,
    stretches: &[Stretch],
    noise: &CoordinateNoise<'_>,
    draws: usize,
) -> Result<Vec<[Motion; 2]>, RegressorError> {
    let mut out: Vec<[Motion; 2]> = vec![[motion.clone(), motion.clone()]; draws];
    for stretch in stretches {
        let roots = frame_roots(model, motion, stretch, noise)?;
        for (draw, pair) in out.iter_mut().enumerate() {
            for (side, sign) in pair.iter_mut().zip([1.0, -1.0]) {
                let moved = disturb(model, motion, stretch, &roots, draw, sign);
                let frames = stretch.first_frame * model.nq..stretch.end_frame * model.nq;
                side.q[frames.clone()].copy_from_slice(&moved.q[frames]);
                (side.v, side.a) = (Vec::new(), Vec::new());
            }
        }
    }
    Ok(out)
}

/// Root of the coordinates' covariance in every frame of the stretch; none where the motion is not
/// valid.
fn frame_roots(
    model: &Model,
    motion: &Motion,
    stretch: &Stretch,
    noise: &CoordinateNoise<'_>,
) -> Result<Vec<Option<Mat<f64>>>, RegressorError> {
    let mut state = State::new(model);
    (stretch.first_frame..stretch.end_frame)
        .map(|frame| {
            if !motion.is_valid(frame) {
                return Ok(None);
            }
            state.forward_position(model, motion.q(frame));
            coordinate_root(model, motion, frame, noise, &state).map(Some)
        })
        .collect()
}

/// The motion with the errors of one draw, times `sign`.
fn disturb(
    model: &Model,
    motion: &Motion,
    stretch: &Stretch,
    roots: &[Option<Mat<f64>>],
    draw: usize,
    sign: f64,
) -> Motion {
    let mut out = motion.clone();
    (out.v, out.a) = (Vec::new(), Vec::new());
    let nv = model.nv;
    let (mut unit, mut step) = (vec![0.0; nv], vec![0.0; nv]);
    for (frame, root) in (stretch.first_frame..).zip(roots) {
        let Some(root) = root else { continue };
        let mut rng = ChaCha8Rng::seed_from_u64(seed(motion, stretch, draw));
        rng.set_stream(frame as u64);
        unit.iter_mut().for_each(|u| *u = StandardNormal.sample(&mut rng));
        for (i, step) in step.iter_mut().enumerate() {
            *step = sign * (0..nv).map(|j| root[(i, j)] * unit[j]).sum::<f64>();
        }
        model.integrate(motion.q(frame), &step, &mut out.q[frame * model.nq..(frame + 1) * model.nq]);
    }
    out
}

/// Seed of a draw, from the frames of the stretch and where it begins (FNV-1a): recordings under
/// other names and in other formats give the same numbers, and two recordings do not share their
/// errors, which would not average out.
fn seed(motion: &Motion, stretch: &Stretch, draw: usize) -> u64 {
    let kind = match stretch.kind {
        crate::StretchKind::Flight => 0_u64,
        crate::StretchKind::Contact => 1,
        crate::StretchKind::Merged => 2,
    };
    let numbers = [kind, stretch.first_frame as u64, stretch.end_frame as u64, draw as u64];
    let place = motion.thousandths(stretch.first_frame).map(|q| q as u64);
    let bytes = numbers.into_iter().chain(place).flat_map(u64::to_le_bytes);
    bytes.fold(0xcbf2_9ce4_8422_2325, |hash, byte| (hash ^ u64::from(byte)).wrapping_mul(0x0100_0000_01b3))
}
