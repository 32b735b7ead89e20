//! Covariance of weak rows from the noise of markers or coordinates, and whitening with it.
//!
//! To first order a row is linear in the errors δq of every frame that its window covers: through
//! C(q) with ψ̈, through H(q, q̇) with ψ̇ and the weights of the central differences. Overlapping
//! windows share frames, so their rows are correlated; with white errors of constant size this is
//! the Gram matrix of ψ̈. Here the sensitivities `∂(Cφ)/∂q`, `∂(Hφ)/∂q`, `∂(Hφ)/∂q̇` of the prior
//! body are propagated frame by frame together with slowly decaying errors (soft tissue), and the
//! rows are multiplied by the inverse Cholesky factor. The covariance depends only on the prior and
//! the noise, never on residuals; even so, ranking of effects should use fixed weights.

use crate::body_windows::moments;
use crate::velocities::{CENTRAL, Velocity};
use crate::weak_windows::WeakRows;
use crate::{RegressorError, Stretch};
use aloft_body::{JointKind, Model, ModelMarker, Motion, Phi, State};
use faer::Mat;
use faer::linalg::solvers::Solve;
use nalgebra::{DMatrix, SMatrix, Vector3};
use rayon::prelude::*;

/// Coordinates that move the markers by less than this lever (m per rad) count as unobserved.
const UNSEEN_LEVER_M: f64 = 1e-3;

/// Errors of the coordinates in one frame.
#[derive(Debug, Clone, Copy)]
pub enum CoordinateNoise<'a> {
    /// Independent coordinates, one standard deviation for each of the nv velocities' directions
    /// (m, rad).
    PerCoordinate(&'a [f64]),
    /// [`Motion::q_sd`] of each frame, coordinates taken as independent.
    FromMotion,
    /// The same for every frame: a root L (nv × nv) of the coordinates' covariance L Lᵀ.
    Root(&'a DMatrix<f64>),
    /// Propagated from markers through least-squares inverse kinematics: `sd² (Σ JᵀJ)⁻¹` over the
    /// markers, all of them visible.
    Markers {
        /// Markers and the links that carry them; a marker with zero weight is left out.
        markers: &'a [ModelMarker],
        /// Standard deviation of a marker coordinate, m.
        sd_m: f64,
    },
}

/// Noise of a recording.
#[derive(Debug, Clone, Copy)]
pub struct Noise<'a> {
    /// White part, independent in every frame.
    pub coordinates: CoordinateNoise<'a>,
    /// Slow part with the same spatial covariance, as a multiple of the white standard deviation (0
    /// for none): soft tissue.
    pub slow: f64,
    /// Time constant with which the slow part decays to 1/e, s.
    pub slow_time_s: f64,
}

impl<'a> Noise<'a> {
    /// White noise alone.
    pub fn white(coordinates: CoordinateNoise<'a>) -> Self {
        Self { coordinates, slow: 0.0, slow_time_s: 0.1 }
    }
}

/// Share of the mean variance added to every row, so that nearly identical windows do not amplify
/// rounding errors.
const FLOOR: f64 = 1e-6;

/// Covariance of the unweighted rows, (6 windows)².
///
/// # Errors
/// [`RegressorError::Length`] if standard deviations do not fit the model,
/// [`RegressorError::Numeric`] if markers leave the coordinates undetermined.
pub(crate) fn row_covariance(
    model: &Model,
    prior: &[Phi],
    motion: &Motion,
    stretch: &Stretch,
    rows: &WeakRows,
    noise: &Noise<'_>,
) -> Result<Mat<f64>, RegressorError> {
    let nv = model.nv;
    check_noise(model, motion, &noise.coordinates)?;
    let half = rows.test.half;
    let reach = half + CENTRAL.len() - 1;
    let first = rows.centres.iter().min().map_or(0, |c| c.saturating_sub(reach)).max(stretch.first_frame);
    let end = (rows.centres.iter().max().map_or(0, |c| c + reach + 1)).min(stretch.end_frame);
    let frames: Vec<Option<FrameNoise>> = (first..end)
        .into_par_iter()
        .map(|f| {
            if motion.is_valid(f) {
                FrameNoise::of(model, prior, motion, f, first, end, noise).map(Some)
            } else {
                Ok(None)
            }
        })
        .collect::<Result<_, _>>()?;
    let mut sensitivity = Mat::<f64>::zeros(6 * rows.centres.len(), (end - first) * nv);
    for (w, &centre) in rows.centres.iter().enumerate() {
        for i in 0..rows.test.n_frames() {
            let frame = centre - half + i;
            let Some(Some(here)) = frames.get(frame - first) else { continue };
            let origin = &rows.origin[w][i];
            let d = (origin.position - here.fixed).cross_matrix();
            let velocity = origin.velocity.cross_matrix();
            let (psi_dot, psi_ddot) = (rows.test.psi_dot[i], rows.test.psi_ddot[i]);
            for c in 0..nv {
                let first_moment: Vector3<f64> = here.by_q.fixed_view::<3, 1>(0, c).into();
                let linear: Vector3<f64> = here.by_q.fixed_view::<3, 1>(3, c).into();
                let angular: Vector3<f64> = here.by_q.fixed_view::<3, 1>(6, c).into();
                let about = angular - d * linear + velocity * first_moment;
                for axis in 0..3 {
                    sensitivity[(6 * w + axis, (frame - first) * nv + c)] += psi_ddot * first_moment[axis];
                    sensitivity[(6 * w + 3 + axis, (frame - first) * nv + c)] -= psi_dot * about[axis];
                }
                let linear: Vector3<f64> = here.by_v.fixed_view::<3, 1>(0, c).into();
                let angular: Vector3<f64> = here.by_v.fixed_view::<3, 1>(3, c).into();
                let about = (angular - d * linear) * (-psi_dot * motion.rate_hz);
                for (k, weight) in CENTRAL[here.reach].iter().enumerate() {
                    for (sign, other) in [(1.0, frame + k + 1), (-1.0, frame - k - 1)] {
                        for axis in 0..3 {
                            sensitivity[(6 * w + 3 + axis, (other - first) * nv + c)] += sign * weight * about[axis];
                        }
                    }
                }
            }
        }
    }
    // errors of unit variance: multiply every frame's block by the root of its covariance
    let mut whitened = Mat::<f64>::zeros(sensitivity.nrows(), sensitivity.ncols());
    for (f, frame) in frames.iter().enumerate() {
        let Some(frame) = frame else { continue };
        let block = sensitivity.subcols(f * nv, nv) * &frame.root;
        whitened.subcols_mut(f * nv, nv).copy_from(block);
    }
    let mut covariance = &whitened * whitened.transpose();
    if noise.slow > 0.0 {
        let faded = fade(&whitened, nv, (-1.0 / (noise.slow_time_s * motion.rate_hz)).exp());
        let slow = &whitened * faded.transpose();
        covariance += faer::Scale(noise.slow * noise.slow) * &slow;
    }
    Ok(covariance)
}

/// Multiplies the rows by the inverse Cholesky factor of their covariance: the result has unit
/// variance and no correlation.
pub(crate) fn whiten(
    model: &Model,
    prior: &[Phi],
    motion: &Motion,
    stretch: &Stretch,
    rows: &mut WeakRows,
    noise: &Noise<'_>,
) -> Result<(), RegressorError> {
    let mut covariance = row_covariance(model, prior, motion, stretch, rows, noise)?;
    let n = covariance.nrows();
    // separate floors for forces and moments, because their units differ
    for part in 0..2 {
        let of_part = |i: &usize| (i % 6) / 3 == part;
        let mean = (0..n).filter(of_part).map(|i| covariance[(i, i)]).sum::<f64>() / (n / 2).max(1) as f64;
        for i in (0..n).filter(of_part) {
            covariance[(i, i)] += FLOOR * mean;
        }
    }
    let numeric = |problem: &str| RegressorError::Numeric {
        trial: stretch.trial.clone(),
        stretch: stretch.index,
        problem: problem.to_owned(),
    };
    let cholesky = covariance
        .llt(faer::Side::Lower)
        .map_err(|_| numeric("the covariance of the weak rows is not positive definite"))?;
    cholesky.L().solve_lower_triangular_in_place(rows.matrix.as_mut());
    Ok(())
}

fn check_noise(model: &Model, motion: &Motion, noise: &CoordinateNoise<'_>) -> Result<(), RegressorError> {
    let (expected, found) = match *noise {
        CoordinateNoise::PerCoordinate(sd) => (model.nv, sd.len()),
        CoordinateNoise::FromMotion => (motion.n_frames() * model.nv, motion.q_sd.len()),
        CoordinateNoise::Root(root) => (model.nv * model.nv, root.len()),
        CoordinateNoise::Markers { .. } => return Ok(()),
    };
    if expected == found {
        return Ok(());
    }
    Err(RegressorError::Length {
        trial: motion.trial.clone(),
        what: "standard deviations of the coordinates",
        expected,
        found,
    })
}

/// Exponential decay in time over blocks of `nv` columns: `out_i = Σ_j a^|i−j| x_j`.
fn fade(x: &Mat<f64>, nv: usize, a: f64) -> Mat<f64> {
    let n = x.ncols() / nv.max(1);
    let mut forward = x.clone();
    let mut backward = x.clone();
    for i in 1..n {
        for c in 0..nv {
            for r in 0..x.nrows() {
                forward[(r, i * nv + c)] += a * forward[(r, (i - 1) * nv + c)];
            }
        }
    }
    for i in (0..n.saturating_sub(1)).rev() {
        for c in 0..nv {
            for r in 0..x.nrows() {
                backward[(r, i * nv + c)] += a * backward[(r, (i + 1) * nv + c)];
            }
        }
    }
    forward + backward - x
}

/// Sensitivities of the prior body's first moment and momentum about a fixed point to errors in one
/// frame.
struct FrameNoise {
    /// With respect to δq: rows C, P, H.
    by_q: DMatrix<f64>,
    /// With respect to δq̇: rows P, H.
    by_v: DMatrix<f64>,
    /// Root of the covariance of δq, nv × nv.
    root: Mat<f64>,
    fixed: Vector3<f64>,
    /// Number of frames on each side used for the velocity.
    reach: usize,
}

impl FrameNoise {
    fn of(
        model: &Model,
        prior: &[Phi],
        motion: &Motion,
        frame: usize,
        first: usize,
        end: usize,
        noise: &Noise<'_>,
    ) -> Result<Self, RegressorError> {
        let nv = model.nv;
        let mut state = State::new(model);
        let q = motion.q(frame);
        // the run of valid frames around this one limits the reach of the central difference
        let seen = |k: usize| {
            (1..=k).all(|j| {
                frame >= first + j && frame + j < end && motion.is_valid(frame - j) && motion.is_valid(frame + j)
            })
        };
        let reach = (1..CENTRAL.len()).take_while(|&k| seen(k)).last().unwrap_or(0);
        let v = Velocity::new(model).at(model, motion, frame - reach, frame + reach + 1, frame).to_vec();
        state.forward_velocity(model, q, &v);
        let fixed = state.centre_of_mass(prior).1;
        let mut by_q = DMatrix::zeros(9, nv);
        let mut by_v = DMatrix::zeros(6, nv);
        let mut direction = vec![0.0; nv];
        let mut moved = vec![0.0; model.nq];
        const STEP: f64 = 1e-5;
        for c in 0..nv {
            let mut sides = [SMatrix::<f64, 9, 1>::zeros(); 2];
            for (side, sign) in sides.iter_mut().zip([1.0, -1.0]) {
                direction[c] = sign * STEP;
                model.integrate(q, &direction, &mut moved);
                state.forward_velocity(model, &moved, &v);
                *side = moments(&state, prior, &fixed);
            }
            by_q.set_column(c, &((sides[0] - sides[1]) / (2.0 * STEP)));
            direction[c] = 1.0;
            state.forward_velocity(model, q, &direction);
            by_v.set_column(c, &moments(&state, prior, &fixed).fixed_rows::<6>(3));
            direction[c] = 0.0;
        }
        // velocities refer to moving axes, so an error δ of a rotation also rotates them: δω = δ̇ +
        // ω × δ, and for the root's path, differentiated in the world, δv = δ̇ + ω × δ + v × δθ
        for link in &model.links {
            let first = link.joint.v_offset;
            let cross = |at: usize| Vector3::new(v[at], v[at + 1], v[at + 2]).cross_matrix();
            let blocks: &[(usize, usize, usize)] = match link.joint.kind {
                JointKind::Free => &[(0, 0, 3), (0, 3, 0), (3, 3, 3)],
                JointKind::Spherical => &[(0, 0, 0)],
                _ => &[],
            };
            for &(of, by, velocity) in blocks {
                let turned = by_v.columns(first + of, 3) * cross(first + velocity);
                let mut target = by_q.view_mut((3, first + by), (6, 3));
                target += turned;
            }
        }
        state.forward_position(model, q);
        let root = coordinate_root(model, motion, frame, &noise.coordinates, &state)?;
        Ok(Self { by_q, by_v, root, fixed, reach })
    }
}

/// Root L of the covariance LLᵀ of the coordinates' errors in one frame, nv × nv. `state` must hold
/// the poses of the frame.
///
/// [`RegressorError::Length`] if standard deviations do not fit the model,
/// [`RegressorError::Numeric`] if one is negative or not finite.
pub fn coordinate_root(
    model: &Model,
    motion: &Motion,
    frame: usize,
    noise: &CoordinateNoise<'_>,
    state: &State,
) -> Result<Mat<f64>, RegressorError> {
    let nv = model.nv;
    check_noise(model, motion, noise)?;
    let numeric = |problem: String| RegressorError::Numeric {
        trial: motion.trial.clone(),
        stretch: 0,
        problem: format!("frame {frame}: {problem}"),
    };
    let diagonal = |sd: &[f64]| {
        if sd.iter().all(|s| s.is_finite() && *s >= 0.0) {
            Ok(Mat::from_fn(nv, nv, |i, j| if i == j { sd[i] } else { 0.0 }))
        } else {
            Err(numeric("a standard deviation is negative or not finite".to_owned()))
        }
    };
    match *noise {
        CoordinateNoise::PerCoordinate(sd) => diagonal(sd),
        CoordinateNoise::FromMotion => diagonal(&motion.q_sd[frame * nv..(frame + 1) * nv]),
        CoordinateNoise::Root(root) => Ok(Mat::from_fn(nv, nv, |i, j| root[(i, j)])),
        CoordinateNoise::Markers { markers, sd_m } => {
            let mut information = DMatrix::<f64>::zeros(nv, nv);
            let mut jacobian = DMatrix::zeros(3, nv);
            for marker in markers.iter().filter(|m| m.weight > 0.0 && m.link < model.n_links()) {
                state.point_jacobian(model, marker.link, &marker.position_m, &mut jacobian);
                information.gemm_tr(1.0, &jacobian, &jacobian, 1.0);
            }
            // inverse kinematics leaves a coordinate that no marker determines at its value, so
            // noise does not move it
            let (mut damped, mut seen) = (information.clone(), information);
            for i in 0..nv {
                damped[(i, i)] += UNSEEN_LEVER_M * UNSEEN_LEVER_M;
                seen[(i, i)] += 1e-6 * UNSEEN_LEVER_M * UNSEEN_LEVER_M;
            }
            let undetermined = || numeric("the markers leave the coordinates undetermined".to_owned());
            let factor = |m: &DMatrix<f64>| {
                Mat::from_fn(nv, nv, |i, j| m[(i, j)]).llt(faer::Side::Lower).map_err(|_| undetermined())
            };
            // noise of damped least squares: (N + ε)⁻¹ N (N + ε)⁻¹, so a root is (N + ε)⁻¹ N^½
            let mut root = factor(&seen)?.L().to_owned();
            factor(&damped)?.solve_in_place(root.as_mut());
            Ok(faer::Scale(sd_m) * &root)
        }
    }
}
