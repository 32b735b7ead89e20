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
//! along the disturbed path. Errors of different frames are independent. A draw depends on the
//! names of the recording and of the stretch alone, so that T is the same on any machine.

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

/// What the errors of a stretch's rows are drawn from.
#[derive(Clone, Copy)]
pub struct MatrixNoise<'a> {
    /// Errors of the coordinates in one frame.
    pub coordinates: CoordinateNoise<'a>,
    /// Columns of the effects along another motion.
    pub effects_at: EffectsAt<'a>,
    /// Number of antithetic pairs.
    pub draws: usize,
}

impl std::fmt::Debug for MatrixNoise<'_> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("MatrixNoise").field("coordinates", &self.coordinates).field("draws", &self.draws).finish()
    }
}

impl<'a> MatrixNoise<'a> {
    /// Number of antithetic pairs of a stretch. A chain of 30 flights has some 2,000 rows, of which
    /// two draws give each direction of S to about 3 %.
    pub const DRAWS: usize = 2;

    /// Noise of a model whose effects do not depend on the motion's errors.
    pub fn new(coordinates: CoordinateNoise<'a>, effects_at: EffectsAt<'a>) -> Self {
        Self { coordinates, effects_at, draws: Self::DRAWS }
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
    let scale = 0.5 / (noise.draws.max(1) as f64).sqrt();
    let roots = frame_roots(model, motion, stretch, &noise.coordinates)?;
    (0..noise.draws)
        .map(|draw| {
            let side = |sign: f64| {
                let disturbed = disturb(model, motion, stretch, &roots, draw, sign);
                let effects = (noise.effects_at)(&disturbed)?;
                let acting = Acting { effects: effects.as_ref(), ..acting };
                weak_rows(model, base, prior, &disturbed, stretch, acting, options).map(|rows| rows.matrix)
            };
            let (ahead, behind) = (side(1.0)?, side(-1.0)?);
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
        let mut rng = ChaCha8Rng::seed_from_u64(seed(stretch, draw));
        rng.set_stream(frame as u64);
        unit.iter_mut().for_each(|u| *u = StandardNormal.sample(&mut rng));
        for (i, step) in step.iter_mut().enumerate() {
            *step = sign * (0..nv).map(|j| root[(i, j)] * unit[j]).sum::<f64>();
        }
        model.integrate(motion.q(frame), &step, &mut out.q[frame * model.nq..(frame + 1) * model.nq]);
    }
    out
}

/// Seed of a draw, from the names of the recording and the stretch (FNV-1a).
fn seed(stretch: &Stretch, draw: usize) -> u64 {
    let kind = match stretch.kind {
        crate::StretchKind::Flight => 0_u64,
        crate::StretchKind::Contact => 1,
        crate::StretchKind::Merged => 2,
    };
    let numbers = [kind, stretch.index as u64, draw as u64];
    let bytes = stretch.trial.bytes().chain(numbers.iter().flat_map(|n| n.to_le_bytes()));
    bytes.fold(0xcbf2_9ce4_8422_2325, |hash, byte| (hash ^ u64::from(byte)).wrapping_mul(0x0100_0000_01b3))
}
