//! Weak rows: momentum and first moment integrated against smooth test functions; no second
//! derivative of measured data, no filter.
//!
//! For a window inside a stretch let `o(t)` be a smooth path with known derivatives, fitted to the
//! path of the prior's centre of mass: in flight a parabola with acceleration g, in contact a
//! cubic. With the first moment of mass `C = Σ m (r − o)` and the angular momentum `H = Σ (r − o) ×
//! m (ṙ − ȯ) + I ω` about that path, the following holds exactly for any such path:
//!
//! ```text
//!  ∫ψ̈ C dt − ∫ψ m (g − ö) dt        = ∫ψ f dt                 three rows of force: positions only
//! −∫ψ̇ H dt − ∫ψ C × (g − ö) dt      = ∫ψ (n₀ − o × f) dt       three rows of moment: velocities too
//! ```
//!
//! with the applied force f and its moment n₀ about the world origin, world axes. In flight g − ö =
//! 0 and both right-hand sides vanish: the path falls with the body, so the large numbers of
//! translation do not enter the moment rows, nor does their noise. Everything is linear in φ. Force
//! rows are divided by `F ∫ψ`, moment rows by `F ℓ ∫ψ` with the force F = M g (fixed weights,
//! independent of residuals; [`force_scale_n`] where gravity is weak or absent); alternatively
//! [`crate::noise`] whitens them if parameters, not effects, are estimated.

use crate::stretch::Acting;
use crate::test_function::{MIN_HALF_WINDOW, TestFunction, window_centres};
use crate::velocities::{run_velocities, valid_runs};
use crate::{RegressorError, Stretch, StretchKind};
use aloft_body::{BaseParameters, FrameBatch, FrameBlock, LANES, Model, Motion, Phi, State};
use faer::Mat;
use fearless_simd::{Level, Simd, SimdBase, dispatch, f64x8};
use nalgebra::{DMatrix, Vector3, Vector6};
use serde::{Deserialize, Serialize};
use std::array::from_fn;

/// Options of weak rows.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct WeakOptions {
    /// Length of a window, s; if absent, 0.6 of the stretch, within 0.15 to 0.4 s.
    pub window_s: Option<f64>,
    /// Step between windows in window lengths.
    pub hop: f64,
    /// Power p of ψ = (1 − τ²)^p.
    pub power: u32,
    /// Time excluded at both ends of a stretch, s.
    pub margin_s: f64,
    /// Length ℓ that converts moments into forces in the fixed weights, m; if absent,
    /// [`body_radius_m`](crate::body_radius_m) of the prior.
    pub moment_length_m: Option<f64>,
}

impl Default for WeakOptions {
    fn default() -> Self {
        Self { window_s: None, hop: 0.25, power: 5, margin_s: 0.0, moment_length_m: None }
    }
}

impl WeakOptions {
    /// Frames on each side of a window's centre for a stretch of `n_frames`.
    pub(crate) fn half_window(&self, n_frames: usize, rate_hz: f64) -> usize {
        let duration_s = n_frames as f64 / rate_hz;
        let window_s = self.window_s.unwrap_or_else(|| (0.6 * duration_s).clamp(0.15, 0.4)).min(duration_s);
        let half = (window_s * rate_hz / 2.0).round() as usize;
        half.saturating_sub(1).max(MIN_HALF_WINDOW)
    }
}

/// Weak rows of one stretch before weighting.
#[derive(Debug, Clone)]
pub struct WeakRows {
    /// Six rows per window (force x y z in N·s, moment x y z in N·m·s), columns `[Y | −E | w]`.
    pub matrix: Mat<f64>,
    /// Frame at the centre of each window.
    pub centres: Vec<usize>,
    /// The test function of all windows.
    pub test: TestFunction,
    /// Path of the moment origin at the frames of each window, m, world.
    pub origin: Vec<Vec<Origin>>,
    /// Force F of the fixed weights, N: [`force_scale_n`] of the prior's mass.
    pub force_scale_n: f64,
}

/// Gravity below which force rows are no longer expressed in body weights, m/s².
const LEAST_ACCELERATION_MPS2: f64 = 1.0;

/// The force that makes weak rows dimensionless, N: the body's weight, or its mass times 1 m/s² if
/// gravity is weaker than that (an asteroid, orbit). It is one constant of the laboratory for all
/// rows of a study: estimates, ratios of errors and choices based on them do not depend on it, only
/// the unit of the rows. It is a continuous function of gravity.
pub fn force_scale_n(mass_kg: f64, gravity_mps2: f64) -> f64 {
    mass_kg * gravity_mps2.max(LEAST_ACCELERATION_MPS2)
}

/// Moment origin at one instant, world.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Origin {
    /// Position, m.
    pub position: Vector3<f64>,
    /// Velocity, m/s.
    pub velocity: Vector3<f64>,
}

impl WeakRows {
    /// Divides force rows by `F ∫ψ` and moment rows by `F ℓ ∫ψ`.
    pub fn apply_fixed_weights(&mut self, moment_length_m: f64) {
        let force = 1.0 / (self.force_scale_n * self.test.integral_s());
        let moment = force / moment_length_m;
        for i in 0..self.matrix.nrows() {
            let weight = if i % 6 < 3 { force } else { moment };
            for j in 0..self.matrix.ncols() {
                self.matrix[(i, j)] *= weight;
            }
        }
    }
}

/// First moment C, momentum P and angular momentum H of the frames of a run about one fixed point,
/// for all base columns.
struct RunRows {
    /// The fixed point, world, m.
    fixed: Vector3<f64>,
    /// Length of a series: one number per frame, plus padding.
    stride: usize,
    /// Series `9 * column + row` over the frames; rows C (3), P (3), H (3).
    series: Vec<f64>,
    /// Centre of mass of the prior, world, m.
    path: Vec<Vector3<f64>>,
}

/// Weak rows of one stretch, unweighted: [`weak_factor`](crate::weak_factor) weights them and
/// reduces them to a triangle.
///
/// # Errors
/// As [`weak_factor`](crate::weak_factor).
pub fn weak_rows(
    model: &Model,
    base: &BaseParameters,
    prior: &[Phi],
    motion: &Motion,
    stretch: &Stretch,
    acting: Acting<'_>,
    options: &WeakOptions,
) -> Result<WeakRows, RegressorError> {
    stretch.check(model, motion)?;
    acting.check(motion, stretch)?;
    check_base(model, base, &stretch.trial)?;
    if prior.len() != model.n_links() {
        return Err(RegressorError::Length {
            trial: stretch.trial.clone(),
            what: "links of the prior",
            expected: model.n_links(),
            found: prior.len(),
        });
    }
    if !(options.hop > 0.0 && options.hop <= 1.0) {
        return Err(RegressorError::Option { option: "hop", problem: format!("{} is not within 0 to 1", options.hop) });
    }
    let margin = (options.margin_s.max(0.0) * motion.rate_hz).round() as usize;
    let (first, end) = (stretch.first_frame + margin, stretch.end_frame.saturating_sub(margin));
    let half = options.half_window(end.saturating_sub(first + 2), motion.rate_hz);
    let test = TestFunction::new(half, options.power, motion.rate_hz)?;
    let hop = ((options.hop * test.length_s() * motion.rate_hz).floor() as usize).max(1);
    let runs = valid_runs(first, end, |f| motion.is_valid(f) && acting.is_finite(stretch, f));
    let windows: Vec<(usize, usize, Vec<usize>)> = runs
        .iter()
        .map(|&(a, b)| (a, b, window_centres(a + 1, b.saturating_sub(1), half, hop)))
        .filter(|w| !w.2.is_empty())
        .collect();
    let n_windows: usize = windows.iter().map(|w| w.2.len()).sum();
    if n_windows == 0 {
        return Err(RegressorError::TooShort {
            trial: stretch.trial.clone(),
            stretch: stretch.index,
            frames: runs.iter().map(|(a, b)| b - a).max().unwrap_or(0),
            needed: test.n_frames() + 2,
        });
    }
    let (p, k) = (base.len(), acting.n_effects());
    let mut out = WeakRows {
        matrix: Mat::zeros(6 * n_windows, p + k + 1),
        centres: Vec::with_capacity(n_windows),
        test,
        origin: Vec::with_capacity(n_windows),
        force_scale_n: force_scale_n(prior.iter().map(|phi| phi[0]).sum(), model.gravity_mps2.norm()),
    };
    let mut weights = Vec::new();
    for (start, end, centres) in &windows {
        let run = run_rows(model, base, prior, motion, *start, *end);
        for &centre in centres {
            let begin = centre - half - start;
            let (origin, fall) =
                fit_origin(&run.path[begin..begin + out.test.n_frames()], &out.test, stretch.kind, &model.gravity_mps2);
            window_weights(&mut weights, &out.test, &run.fixed, &origin, &fall);
            let row = 6 * out.centres.len();
            for c in 0..p {
                let to = &mut out.matrix.col_as_slice_mut(c)[row..row + 6];
                to.copy_from_slice(&window_sums(&run, c, begin, &weights));
            }
            for (i, at) in origin.iter().enumerate() {
                let frame = centre - half + i;
                let psi = out.test.psi[i];
                let mut add = |column: usize, sign: f64, force: Vector3<f64>, moment: Vector3<f64>| {
                    let about = moment - at.position.cross(&force);
                    for axis in 0..3 {
                        out.matrix[(row + axis, column)] += sign * psi * force[axis];
                        out.matrix[(row + 3 + axis, column)] += sign * psi * about[axis];
                    }
                };
                if let Some(effects) = acting.effects {
                    for e in 0..k {
                        let unit = effects.wrench[frame].column(e);
                        add(p + e, -1.0, unit.fixed_rows::<3>(0).into(), unit.fixed_rows::<3>(3).into());
                    }
                }
                let wrench: Vector6<f64> = acting.wrench(stretch, frame);
                add(p + k, 1.0, wrench.fixed_rows::<3>(0).into(), wrench.fixed_rows::<3>(3).into());
            }
            out.centres.push(centre);
            out.origin.push(origin);
        }
    }
    if let Some(effects) = acting.effects {
        effects.add_changes(&mut out.matrix, p);
    }
    Ok(out)
}

pub(crate) fn check_base(model: &Model, base: &BaseParameters, trial: &str) -> Result<(), RegressorError> {
    if base.is_empty() || base.from_full.ncols() != 10 * model.n_links() {
        return Err(RegressorError::Length {
            trial: trial.to_owned(),
            what: "link parameters that the base parameters regroup",
            expected: 10 * model.n_links(),
            found: base.from_full.ncols(),
        });
    }
    Ok(())
}

/// Rows of every frame of a run about one fixed point, that point, and the path of the prior's
/// centre of mass.
fn run_rows(model: &Model, base: &BaseParameters, prior: &[Phi], motion: &Motion, start: usize, end: usize) -> RunRows {
    let p = base.len();
    let mut state = State::new(model);
    state.forward_position(model, motion.q((start + end) / 2));
    let fixed = state.centre_of_mass(prior).1;
    let n = end - start;
    let velocities = run_velocities(model, motion, start, end);
    let stride = n.next_multiple_of(LANES);
    // a window reads whole vectors; beyond its end the weights are zero
    let mut out = RunRows { fixed, stride, series: vec![0.0; 9 * p * stride + LANES], path: Vec::with_capacity(n) };
    let mut batch = FrameBatch::new(model);
    let mut momentum = vec![[0.0; LANES]; 6 * p];
    let mut first_moment = vec![[0.0; LANES]; 3 * p];
    for begin in (start..end).step_by(LANES) {
        // the last frame fills the unused lanes of the last batch
        let frame = |lane: usize| (begin + lane).min(end - 1);
        let v: [&[f64]; LANES] = from_fn(|lane| &velocities[(frame(lane) - start) * model.nv..][..model.nv]);
        batch.forward_velocity(model, &from_fn(|lane| motion.q(frame(lane))), &v, &fixed);
        batch.first_moment_rows(base, &mut first_moment);
        batch.momentum_rows(base, &mut momentum);
        for c in 0..p {
            let rows = first_moment[3 * c..3 * c + 3].iter().chain(&momentum[6 * c..6 * c + 6]);
            for (r, lanes) in rows.enumerate() {
                let at = (9 * c + r) * stride + begin - start;
                out.series[at..at + LANES].copy_from_slice(lanes);
            }
        }
        let width = LANES.min(end - begin);
        out.path.extend(batch.centre_of_mass(prior)[..width].iter().map(|x| x + fixed));
    }
    out
}

/// A smooth path through the centre of mass over one window, and `g − ö` along it.
pub(crate) fn fit_origin(
    path: &[Vector3<f64>],
    test: &TestFunction,
    kind: StretchKind,
    gravity: &Vector3<f64>,
) -> (Vec<Origin>, Vec<Vector3<f64>>) {
    let reach = test.length_s() / 2.0;
    let flying = kind == StretchKind::Flight;
    let degree = if flying { 1 } else { 3 };
    // normal equations in Legendre-like scaled powers; windows are symmetric, so they are well
    // conditioned
    let n = degree + 1;
    let mut normal = DMatrix::<f64>::zeros(n, n);
    let mut right = DMatrix::<f64>::zeros(n, 3);
    for (i, point) in path.iter().enumerate() {
        let t = test.time_s(i);
        let target = if flying { point - gravity * (0.5 * t * t) } else { *point };
        for a in 0..n {
            let pa = (t / reach).powi(a as i32);
            for b in 0..n {
                normal[(a, b)] += pa * (t / reach).powi(b as i32);
            }
            for axis in 0..3 {
                right[(a, axis)] += pa * target[axis];
            }
        }
    }
    let c = normal.lu().solve(&right).unwrap_or_else(|| DMatrix::zeros(n, 3));
    let coefficient = |a: usize| -> Vector3<f64> {
        if a < n { Vector3::new(c[(a, 0)], c[(a, 1)], c[(a, 2)]) / reach.powi(a as i32) } else { Vector3::zeros() }
    };
    let (c0, c1, c2, c3) = (coefficient(0), coefficient(1), coefficient(2), coefficient(3));
    let g = if flying { *gravity } else { Vector3::zeros() };
    let mut origin = Vec::with_capacity(path.len());
    let mut fall = Vec::with_capacity(path.len());
    for i in 0..path.len() {
        let t = test.time_s(i);
        origin.push(Origin {
            position: c0 + c1 * t + c2 * (t * t) + c3 * (t * t * t) + g * (0.5 * t * t),
            velocity: c1 + c2 * (2.0 * t) + c3 * (3.0 * t * t) + g * t,
        });
        fall.push(if flying { Vector3::zeros() } else { gravity - (c2 * 2.0 + c3 * (6.0 * t)) });
    }
    (origin, fall)
}

/// Weights of a frame's first moment and momenta in a window; see [`window_weights`].
#[derive(Debug, Clone, Copy)]
struct Weights {
    /// ψ̈
    second: FrameBlock,
    /// −ψ̇
    first: FrameBlock,
    /// ψ̇ d: the moment arm that transfers H from the fixed point to the moving origin
    arm: [FrameBlock; 3],
    /// ψ (g − ö) − ψ̇ ȯ
    turn: [FrameBlock; 3],
    /// d, subtracted from the first moment of the whole mass
    shift: [FrameBlock; 3],
    /// ψ (g − ö), added to the force by the whole mass
    fall: [FrameBlock; 3],
}

const NO_WEIGHTS: Weights = Weights {
    second: [0.0; LANES],
    first: [0.0; LANES],
    arm: [[0.0; LANES]; 3],
    turn: [[0.0; LANES]; 3],
    shift: [[0.0; LANES]; 3],
    fall: [[0.0; LANES]; 3],
};

/// The six rows of a window are sums over its frames, with `C′ = C − d` for the whole mass and C
/// for all other parameters:
///
/// ```text
/// force   ψ̈ C′ − ψ (g − ö) m
/// moment  −ψ̇ (H − d × P + ȯ × C′) + ψ (g − ö) × C′  =  −ψ̇ H + (ψ̇ d) × P + (ψ (g − ö) − ψ̇ ȯ) × C′
/// ```
fn window_weights(
    out: &mut Vec<Weights>,
    test: &TestFunction,
    fixed: &Vector3<f64>,
    origin: &[Origin],
    fall: &[Vector3<f64>],
) {
    out.clear();
    out.resize(origin.len().div_ceil(LANES), NO_WEIGHTS);
    for (i, (origin, fall)) in origin.iter().zip(fall).enumerate() {
        let (weights, lane) = (&mut out[i / LANES], i % LANES);
        let d = origin.position - fixed;
        weights.second[lane] = test.psi_ddot[i];
        weights.first[lane] = -test.psi_dot[i];
        for axis in 0..3 {
            weights.arm[axis][lane] = test.psi_dot[i] * d[axis];
            weights.fall[axis][lane] = test.psi[i] * fall[axis];
            weights.turn[axis][lane] = test.psi[i] * fall[axis] - test.psi_dot[i] * origin.velocity[axis];
            weights.shift[axis][lane] = d[axis];
        }
    }
}

/// The six rows of a window in base column `c`; the window begins at frame `begin` of the run. The
/// first base parameter is the whole mass, so a shift of the origin affects only that column.
fn window_sums(run: &RunRows, c: usize, begin: usize, weights: &[Weights]) -> [f64; 6] {
    let series = |r: usize| {
        let first = (9 * c + r) * run.stride + begin;
        run.series[first..first + weights.len() * LANES].as_chunks::<LANES>().0
    };
    let frames: [&[FrameBlock]; 9] = from_fn(series);
    let mut sums = [[0.0; LANES]; 6];
    dispatch!(Level::new(), simd => if c == 0 {
        sum_lanes::<_, true>(simd, &frames, weights, &mut sums);
    } else {
        sum_lanes::<_, false>(simd, &frames, weights, &mut sums);
    });
    sums.map(|lanes| lanes.iter().sum())
}

#[inline(always)]
fn sum_lanes<S: Simd, const WHOLE_MASS: bool>(
    simd: S,
    frames: &[&[FrameBlock]; 9],
    weights: &[Weights],
    sums: &mut [FrameBlock; 6],
) {
    let zero = f64x8::splat(simd, 0.0);
    let load = |lanes: &[FrameBlock; 3]| -> [f64x8<S>; 3] { from_fn(|axis| f64x8::load_array_ref(simd, &lanes[axis])) };
    let (mut force, mut moment) = ([zero; 3], [zero; 3]);
    for (i, w) in weights.iter().enumerate() {
        let at = |r: usize| f64x8::load_array_ref(simd, &frames[r][i]);
        let mut c = [at(0), at(1), at(2)];
        let (p, h) = ([at(3), at(4), at(5)], [at(6), at(7), at(8)]);
        if WHOLE_MASS {
            let (shift, fall) = (load(&w.shift), load(&w.fall));
            for axis in 0..3 {
                c[axis] -= shift[axis];
                force[axis] -= fall[axis];
            }
        }
        let (arm, turn) = (load(&w.arm), load(&w.turn));
        let second = f64x8::load_array_ref(simd, &w.second);
        let first = f64x8::load_array_ref(simd, &w.first);
        for axis in 0..3 {
            let (y, z) = ((axis + 1) % 3, (axis + 2) % 3);
            force[axis] += second * c[axis];
            moment[axis] += first * h[axis] + (arm[y] * p[z] - arm[z] * p[y]) + (turn[y] * c[z] - turn[z] * c[y]);
        }
    }
    for axis in 0..3 {
        force[axis].store_array(&mut sums[axis]);
        moment[axis].store_array(&mut sums[3 + axis]);
    }
}
