//! Effect of marker errors on a solved motion: the random error behind the floor of a comparison.
//!
//! A marker's error is its measured position minus the position it would have if fixed to its link:
//! camera noise, movement of the skin over the bone, errors of a filled gap. Inverse kinematics
//! absorbs a part of it and leaves the rest as the marker's residual. To first order, in one frame,
//!
//! ```text
//!   δq = G e,  G = H⁻¹ Jᵀ W        what the errors e of all markers do to the pose
//!   d  = P e,  P = I − J G         what they leave as residuals
//! ```
//!
//! with the Jacobian J of the markers, their weights W, and the normal matrix H of the fit (soft
//! priors included). Only markers enter: no force, no plate, no equation of motion. A physical
//! effect that the body model lacks acts on the body, and the markers follow the body, so it leaves
//! no trace in d. Errors estimated from d can therefore not absorb it.
//!
//! **Size.** Errors of different markers are taken as independent and those of one marker as
//! isotropic, with variance σ²_k per axis. Then the mean square of the residual of marker m is Σ_k
//! B_mk σ²_k, B_mk = ‖P_mk‖² (Frobenius norm of a 3 × 3 block, mean over frames). The σ²_k follow
//! from the observed mean squares by multiplicative updates, which keep them positive and draw
//! those that the residuals do not determine (a single marker on an upper arm) towards the mean of
//! all markers. Mean squares are those of the second difference over [`LAG_S`], the band to which a
//! window of 0.3 s is sensitive.
//!
//! **Uncertainty.** A variance that a few time courses tell is uncertain; ν_k = B_kk times the
//! number of independent time courses is taken for its degrees of freedom, and every draw uses
//! other variances that fit the residuals (`σ²_k χ²/ν_k`).
//!
//! **Time course.** No spectrum is assumed, white or other: each marker's error follows the time
//! course of its own residual in the axes of its link (or that of a nearby marker if its own
//! residual carries little information), rotated by a random rotation that is the same in all
//! frames and all trials of a draw. The rotated errors are no longer residuals of the fit, so they
//! move the pose as real errors do: with full covariance between coordinates, between frames and
//! between trials.
//!
//! Not included: a movement common to all markers of a link, because the fit follows it and leaves
//! no residual.
//!
//! **Geometry.** A calibration leaves joint centres, hinge axes and marker places uncertain.
//! Another geometry γ of the same subject shows the same markers by other poses,
//! `δq = G (p(q; γ₀) − p(q; γ))`, which [`MarkerErrors::with_geometry`] computes for draws of γ.

use crate::frame::Solver;
use crate::problem::{Hinge, Problem};
use crate::segments::{Cluster, clusters};
use crate::solve::match_markers;
use crate::tree::{NONE, Pose, Tree};
use crate::{IkError, IkOptions};
use aloft_body::{Motion, Subject};
use aloft_trial::Trial;
use nalgebra::{DMatrix, DVector, Matrix3, Rotation3, Unit, Vector3, Vector4};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};
use std::ops::Range;

/// Seed under which a comparison and a calibration draw the same errors of the markers.
pub const ERROR_SEED: u64 = 1;

/// Lag of the second difference by which errors are measured, s: a window of 0.3 s, in which ψ̈
/// changes sign twice, is most sensitive to 1/(2 lag) = 6.7 Hz.
const LAG_S: f64 = 0.075;
/// Frames of a trial at which the fraction of an error that remains as residual is computed.
const SAMPLES: usize = 8;
/// Fewest degrees of freedom of a marker's variance.
const FEWEST_FREEDOM: f64 = 3.0;
const SIZE_SEED: u64 = 0x7369_7a65;
/// Minimum fraction of a marker's error that must remain in its residual for its time course to be
/// used.
pub(crate) const SPEAKS: f64 = 0.25;
/// Weight of the mean of all markers in the variance of one, in numbers of residuals (a marker has
/// three at most).
const PRIOR_WEIGHT: f64 = 0.5;
/// Longest step of a coordinate, rad, for which the first order is sufficient: the second is a
/// tenth of it.
const FIRST_ORDER_RAD: f64 = 0.2;
/// Largest change of a coordinate from one frame to the next that is extrapolated, rad or m (half
/// of it for rotations).
const STEADY: f64 = 0.05;
/// Multiplicative updates of the variances.
const UPDATES: usize = 40;

/// Errors of the markers of one trial: time course and size.
#[derive(Debug, Clone)]
pub struct MarkerErrors {
    problem: Problem,
    /// Random stream of each marker, by its index in the subject.
    stream: Vec<u64>,
    /// Residual (measured − model) of each marker in its link's axes, m, `[marker][frame]`; gaps
    /// are bridged by straight lines.
    residual: Vec<Vec<Vector3<f64>>>,
    /// Mean square of the second difference of each residual over six (that of the residual, were
    /// it white), m².
    seen: Vec<f64>,
    /// The same of each marker's error, all three axes, m².
    size: Vec<f64>,
    /// Degrees of freedom with which `size` is known.
    freedom: Vec<f64>,
    /// For each marker, the markers whose residual may provide its time course.
    donors: Vec<Vec<usize>>,
}

/// Time course of a marker in a draw: index of the residual, scale and rotation; none without one.
type Course = Option<(usize, Matrix3<f64>)>;

impl MarkerErrors {
    /// Computed from the recording and its solved motion; `None` if no frame is solved.
    ///
    /// # Errors
    /// As [`solve`](crate::solve()).
    pub fn of(subject: &Subject, trial: &Trial, motion: &Motion, options: &IkOptions) -> Result<Option<Self>, IkError> {
        Self::of_residuals(subject, trial, motion, options, &[])
    }

    /// The same for a body without skin: errors of markers of a link that has three or more are
    /// read from the link's own rigid fit (module `segments`), so that an error of the
    /// model's joints or of a marker's place does not count as noise.
    ///
    /// # Errors
    /// As [`solve`](crate::solve()).
    pub fn of_rigid(
        subject: &Subject,
        trial: &Trial,
        motion: &Motion,
        options: &IkOptions,
    ) -> Result<Option<Self>, IkError> {
        let clusters: Vec<Cluster> = clusters(subject, trial).into_iter().flatten().collect();
        Self::of_residuals(subject, trial, motion, options, &clusters)
    }

    fn of_residuals(
        subject: &Subject,
        trial: &Trial,
        motion: &Motion,
        options: &IkOptions,
        clusters: &[Cluster],
    ) -> Result<Option<Self>, IkError> {
        let mut problem = Problem::new(subject, options)?;
        // Markers that were never visible carry no information and do not affect the fit.
        let ever = |label: &str| {
            let index = trial.markers.index(label);
            index.is_some_and(|i| trial.markers.trajectories[i].iter().any(|p| p.x.is_finite()))
        };
        problem.markers.retain(|m| ever(&m.label));
        let sources = match_markers(&mut problem, subject, trial)?;
        for marker in &mut problem.markers {
            marker.huber = f64::INFINITY;
        }
        let n = motion.n_frames().min(trial.markers.n_frames);
        let solved: Vec<usize> = (0..n).filter(|&f| motion.is_valid(f)).collect();
        if solved.is_empty() || motion.nq != problem.tree.nq {
            return Ok(None);
        }
        let mut pose = problem.tree.pose();
        let mut residual = vec![vec![Vector3::repeat(f64::NAN); motion.n_frames()]; problem.markers.len()];
        for &f in &solved {
            problem.tree.forward(motion.q(f), &mut pose);
            for ((marker, &source), out) in problem.markers.iter().zip(&sources).zip(&mut residual) {
                let seen = trial.markers.trajectories[source][f];
                out[f] = pose.rotation[marker.link].transpose() * (seen - pose.origin[marker.link]) - marker.position;
            }
        }
        let label = |m: &crate::problem::Tracked| subject.markers.iter().position(|s| s.label == m.label);
        let of_subject: Vec<usize> = problem.markers.iter().map(|m| label(m).unwrap_or(usize::MAX)).collect();
        for cluster in clusters {
            for (own, m) in cluster.residual.iter().zip(&cluster.markers) {
                if let Some(at) = of_subject.iter().position(|i| i == m) {
                    residual[at] = own.clone();
                    residual[at].resize(motion.n_frames(), Vector3::repeat(f64::NAN));
                }
            }
        }
        let lag = ((LAG_S * motion.rate_hz).round() as usize).max(1);
        residual.iter_mut().for_each(|r| bridge(r));
        let seen: Vec<f64> = residual.iter().map(|r| mean_square(r, lag)).collect();
        let stream = problem.markers.iter().map(|m| label(m).unwrap_or(0) as u64).collect();
        let mut kept = kept_shares(&problem, motion, &solved);
        for cluster in clusters {
            let Some(shares) = cluster.kept() else { continue };
            let at: Vec<Option<usize>> =
                cluster.markers.iter().map(|m| of_subject.iter().position(|i| i == m)).collect();
            for (a, row) in at.iter().enumerate().filter_map(|(a, row)| Some((a, (*row)?))) {
                kept.row_mut(row).fill(0.0);
                for (b, column) in at.iter().enumerate().filter_map(|(b, column)| Some((b, (*column)?))) {
                    kept[(row, column)] = shares[(a, b)];
                }
            }
        }
        let size = sizes(&kept, &seen);
        let speaks: Vec<bool> = (0..seen.len()).map(|m| kept[(m, m)] >= 3.0 * SPEAKS && seen[m] > 0.0).collect();
        let courses = independent_courses(&residual, lag);
        let freedom = (0..seen.len()).map(|m| (kept[(m, m)] * courses).max(FEWEST_FREEDOM)).collect();
        let donors = (0..seen.len()).map(|m| donors(&problem, m, &speaks)).collect();
        Ok(Some(Self { problem, stream, residual, seen, size, freedom, donors }))
    }

    /// Root mean square of the errors, one axis, m, of each marker by label, for the band to which
    /// the windows are sensitive.
    pub fn sizes_m(&self) -> impl Iterator<Item = (&str, f64)> {
        self.problem.markers.iter().zip(&self.size).map(|(m, s)| (m.label.as_str(), (s / 3.0).sqrt()))
    }

    /// The motion with newly drawn errors in the frames for which `wanted` holds; the others are
    /// unchanged. The same `seed` and `draw` give the markers the same rotations in every trial of
    /// a subject.
    pub fn draw(&self, motion: &Motion, wanted: &dyn Fn(usize) -> bool, seed: u64, draw: u64) -> Motion {
        let mut out = coordinates_of(motion);
        self.draw_into(std::slice::from_mut(&mut out), motion, &|_, f| wanted(f), seed, draw);
        out
    }

    /// Several draws, `draws.start` first, each in the frames for which `wanted` holds of the draw
    /// and the frame. What a pose does with errors is the same in every draw, so that this costs
    /// much less than drawing one after the other; the numbers are the same.
    pub fn draw_each(
        &self,
        motion: &Motion,
        wanted: &dyn Fn(u64, usize) -> bool,
        seed: u64,
        draws: Range<u64>,
    ) -> Vec<Motion> {
        let mut out: Vec<Motion> = draws.clone().map(|_| coordinates_of(motion)).collect();
        self.draw_into(&mut out, motion, wanted, seed, draws.start);
        out
    }

    /// Draws into motions that hold the coordinates without errors; `first` is the first draw.
    fn draw_into(
        &self,
        out: &mut [Motion],
        motion: &Motion,
        wanted: &dyn Fn(u64, usize) -> bool,
        seed: u64,
        first: u64,
    ) {
        let tree = &self.problem.tree;
        let turned: Vec<Vec<Course>> = (first..).take(out.len()).map(|draw| self.turned(seed, draw)).collect();
        let mut response = Response::new(&self.problem);
        let mut step = vec![0.0; tree.nv];
        for f in 0..motion.n_frames().min(self.residual.first().map_or(0, Vec::len)) {
            if !motion.is_valid(f) {
                continue;
            }
            let mut ready = false;
            for ((draw, turned), out) in (first..).zip(&turned).zip(&mut *out) {
                if !wanted(draw, f) {
                    continue;
                }
                if !ready && !response.at(motion.q(f)) {
                    break;
                }
                ready = true;
                let error =
                    |m: usize| turned[m].map_or_else(Vector3::zeros, |(donor, turn)| turn * self.residual[donor][f]);
                response.step(&error, &mut step);
                if step.iter().all(|x| x.is_finite()) {
                    let moved = &mut out.q[f * motion.nq..(f + 1) * motion.nq];
                    tree.retract(motion.q(f), &step, moved);
                    if !is_small(&step) {
                        let place = |m: usize| response.place(m, &error(m));
                        let targets: Vec<Vector3<f64>> = (0..self.seen.len()).map(place).collect();
                        response.solver.targets = targets;
                        settle(&mut response.solver, motion.q(f), moved);
                        // the solver is at another pose now
                        ready = false;
                    }
                }
            }
        }
    }

    /// Time course of each marker in a draw.
    fn turned(&self, seed: u64, draw: u64) -> Vec<Course> {
        let of = |m: usize| {
            let (donor, turn) = turned_donor(seed, draw, self.stream[m], &self.donors[m])?;
            let size = self.size[m] * self.of_estimate(m, seed, draw);
            Some((donor, turn * (size / self.seen[donor]).sqrt()))
        };
        (0..self.seen.len()).map(of).collect()
    }

    /// A variance that fits the residuals over the estimated one, χ²/ν with ν degrees of freedom
    /// (Wilson and Hilferty 1931): of mean one, so that the errors of all markers together keep
    /// their size, and the same quantile for a marker in every trial of a draw.
    fn of_estimate(&self, m: usize, seed: u64, draw: u64) -> f64 {
        let mut rng = ChaCha8Rng::seed_from_u64(seed ^ SIZE_SEED);
        rng.set_stream((draw << 20) | self.stream[m]);
        let normal: f64 = StandardNormal.sample(&mut rng);
        let share = 2.0 / (9.0 * self.freedom[m]);
        (1.0 - share + normal * share.sqrt()).max(0.0).powi(3)
    }

    /// The motion as other geometries of the same subject would show it, one for each of `others`
    /// ([`GeometryError::applied`](crate::GeometryError::applied)): the poses that keep the markers
    /// where they are, to first order, in the frames for which `wanted` holds.
    pub fn with_geometry(&self, motion: &Motion, wanted: &dyn Fn(usize) -> bool, others: &[Subject]) -> Vec<Motion> {
        let tree = &self.problem.tree;
        let mut out: Vec<Motion> = others.iter().map(|_| coordinates_of(motion)).collect();
        let problems: Vec<Problem> = others.iter().map(|other| self.problem_of(other)).collect();
        let mut solvers: Vec<Solver<'_>> = problems.iter().map(with_all_markers).collect();
        let mut trails: Vec<Trail> = others.iter().map(|_| Trail::new(tree)).collect();
        let mut response = Response::new(&self.problem);
        let mut step = vec![0.0; tree.nv];
        let (mut places, mut missed) = (Vec::new(), Vec::new());
        for f in 0..motion.n_frames() {
            if !motion.is_valid(f) || !wanted(f) || !response.at(motion.q(f)) {
                continue;
            }
            places.clear();
            places.extend((0..self.seen.len()).map(|m| response.place(m, &Vector3::zeros())));
            for ((solver, trail), out) in solvers.iter_mut().zip(&mut trails).zip(&mut out) {
                solver.problem.tree.forward(motion.q(f), &mut solver.pose);
                // how far the other geometry misses each marker, in the axes of its link
                missed.clear();
                let pairs = self.problem.markers.iter().zip(&solver.problem.markers);
                missed.extend(pairs.zip(&places).map(|((marker, its), place)| {
                    let seen = solver.pose.origin[its.link] + solver.pose.rotation[its.link] * its.position;
                    response.pose().rotation[marker.link].transpose() * (place - seen)
                }));
                response.step(&|m| missed[m], &mut step);
                if step.iter().all(|x| x.is_finite()) {
                    let moved = &mut out.q[f * motion.nq..(f + 1) * motion.nq];
                    tree.retract(motion.q(f), &step, moved);
                    if !is_small(&step) {
                        solver.targets.copy_from_slice(&places);
                        trail.settle(solver, f, motion.q(f), moved);
                    }
                }
            }
        }
        out
    }

    /// The fit of another geometry to the same markers.
    fn problem_of(&self, other: &Subject) -> Problem {
        let mut problem = self.problem.clone();
        problem.tree = Tree::new(&other.model);
        for (marker, &index) in problem.markers.iter_mut().zip(&self.stream) {
            marker.position = other.markers.get(index as usize).map_or(marker.position, |o| o.position_m);
        }
        problem
    }
}

/// The fit to the solver's targets, started from the pose `q` and written to `moved`, where one
/// step is too long for its first order: when a limb is nearly straight, errors of millimetres turn
/// it about its length by a radian, which the first order would continue to any angle. Joints are
/// attracted to `q`.
fn settle(solver: &mut Solver<'_>, q: &[f64], moved: &mut [f64]) {
    solver.rest_q.copy_from_slice(q);
    moved.copy_from_slice(q);
    if !solver.minimize(moved).cost.is_finite() {
        moved.copy_from_slice(q);
    }
}

/// What another geometry does to the poses of consecutive frames: it changes slowly, so that the
/// fit of the next frame needs one or two steps from where the last two lead.
struct Trail {
    /// The frame after the last one.
    next: usize,
    /// Number of consecutive frames before it, up to two.
    known: usize,
    before: Vec<f64>,
    last: Vec<f64>,
    foreseen: Vec<f64>,
}

impl Trail {
    fn new(tree: &Tree) -> Self {
        let change = vec![0.0; tree.nq];
        Self { next: 0, known: 0, before: change.clone(), last: change.clone(), foreseen: change }
    }

    /// [`settle`] in frame `f`, started where the last frames lead.
    fn settle(&mut self, solver: &mut Solver<'_>, f: usize, q: &[f64], moved: &mut [f64]) {
        let tree = &solver.problem.tree;
        if self.next != f {
            self.known = 0;
        }
        let steady = |(a, b): (&f64, &f64)| (a - b).abs() < STEADY;
        let mut fitted = false;
        if self.known > 0 {
            if self.known > 1 && self.before.iter().zip(&self.last).all(steady) {
                tree.extrapolate(&self.before, &self.last, &mut self.foreseen);
                tree.changed(q, &self.foreseen, moved);
            } else {
                tree.changed(q, &self.last, moved);
            }
            solver.rest_q.copy_from_slice(q);
            // markers may fit a limb that is nearly straight on either side, and the way from frame
            // to frame could lead to the other one
            let converged = solver.minimize(moved).converged;
            let same_side = |hinge: &Hinge| hinge.flexion(moved[hinge.q_index]) * hinge.flexion(q[hinge.q_index]) > 0.0;
            fitted = converged && solver.problem.hinges.iter().all(same_side);
        }
        if !fitted {
            settle(solver, q, moved);
        }
        std::mem::swap(&mut self.before, &mut self.last);
        tree.change(q, moved, &mut self.last);
        self.known = if fitted { 2 } else { 1 };
        self.next = f + 1;
    }
}

/// A solver that sees all markers of its problem.
fn with_all_markers(problem: &Problem) -> Solver<'_> {
    let mut solver = Solver::new(problem);
    solver.visible = (0..problem.markers.len()).collect();
    // residuals do not affect the normal matrix, because weights are constant
    solver.targets.fill(Vector3::zeros());
    solver
}

/// True for a step for which the first order is sufficient.
fn is_small(step: &[f64]) -> bool {
    step.iter().all(|x| x.abs() < FIRST_ORDER_RAD)
}

/// The coordinates of a motion alone.
fn coordinates_of(motion: &Motion) -> Motion {
    Motion {
        trial: motion.trial.clone(),
        rate_hz: motion.rate_hz,
        nq: motion.nq,
        nv: motion.nv,
        q: motion.q.clone(),
        ..Motion::default()
    }
}

/// The marker whose time course a draw gives to a marker, of those that may, and a random rotation;
/// none if no marker may. `stream` is the marker's index in the subject.
pub(crate) fn turned_donor(seed: u64, draw: u64, stream: u64, among: &[usize]) -> Option<(usize, Matrix3<f64>)> {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    rng.set_stream((draw << 20) | stream);
    let turn = random_rotation(&mut rng);
    let donor = *among.get(rng.random_range(0..among.len().max(1)))?;
    Some((donor, turn))
}

/// Linear interpolation across missing samples; constant before the first and after the last one.
fn bridge(series: &mut [Vector3<f64>]) {
    let known: Vec<usize> = (0..series.len()).filter(|&f| series[f].x.is_finite()).collect();
    let (Some(&first), Some(&last)) = (known.first(), known.last()) else {
        series.fill(Vector3::zeros());
        return;
    };
    let (start, end) = (series[first], series[last]);
    series[..first].fill(start);
    series[last + 1..].fill(end);
    for pair in known.windows(2) {
        let (a, b) = (pair[0], pair[1]);
        let (from, to) = (series[a], series[b]);
        for f in a + 1..b {
            series[f] = from + (to - from) * ((f - a) as f64 / (b - a) as f64);
        }
    }
}

/// Mean square of the second difference over six, which for a white series is its own mean square.
fn mean_square(series: &[Vector3<f64>], lag: usize) -> f64 {
    let n = series.len().saturating_sub(2 * lag);
    let sum: f64 = (0..n).map(|f| (series[f] - 2.0 * series[f + lag] + series[f + 2 * lag]).norm_squared()).sum();
    if n == 0 { 0.0 } else { sum / (6.0 * n as f64) }
}

/// Number of independent time courses in the second differences of all residuals: `(tr C)² / ‖C‖²`
/// of their covariance over markers and axes. Skin that follows a few joints has a few, white noise
/// as many as there are coordinates.
fn independent_courses(residual: &[Vec<Vector3<f64>>], lag: usize) -> f64 {
    let frames = residual.first().map_or(0, Vec::len).saturating_sub(2 * lag);
    let differences = DMatrix::from_fn(3 * residual.len(), frames, |i, f| {
        let series = &residual[i / 3];
        series[f][i % 3] - 2.0 * series[f + lag][i % 3] + series[f + 2 * lag][i % 3]
    });
    let covariance = &differences * differences.transpose();
    let (trace, squares) = (covariance.trace(), covariance.norm_squared());
    if squares > 0.0 { trace * trace / squares } else { 1.0 }
}

/// B: squared norms of the blocks of P = I − J H⁻¹ Jᵀ W, mean over some of the solved frames,
/// markers × markers.
pub(crate) fn kept_shares(problem: &Problem, motion: &Motion, solved: &[usize]) -> DMatrix<f64> {
    let n = problem.markers.len();
    let mut out = DMatrix::zeros(n, n);
    let mut response = Response::new(problem);
    let mut used = 0.0;
    let samples = SAMPLES.min(solved.len());
    for i in 0..samples {
        let frame = solved[(2 * i + 1) * solved.len() / (2 * samples)];
        if !response.at(motion.q(frame)) {
            continue;
        }
        let jacobian = response.jacobian();
        // H⁻¹ Jᵀ, column by column
        let mut gain = jacobian.transpose();
        for mut column in gain.column_iter_mut() {
            let mut x: Vec<f64> = column.iter().copied().collect();
            response.solve(&mut x);
            column.copy_from_slice(&x);
        }
        let moved = &jacobian * gain;
        for m in 0..n {
            for k in 0..n {
                let weight = problem.markers[k].weight;
                for a in 0..3 {
                    for b in 0..3 {
                        let own = if m == k && a == b { 1.0 } else { 0.0 };
                        out[(m, k)] += (own - weight * moved[(3 * m + a, 3 * k + b)]).powi(2);
                    }
                }
            }
        }
        used += 1.0;
    }
    if used > 0.0 { out / used } else { DMatrix::identity(n, n) * 3.0 }
}

/// Mean squares of the errors (three axes) from those of the residuals.
pub(crate) fn sizes(kept: &DMatrix<f64>, seen: &[f64]) -> Vec<f64> {
    let n = seen.len();
    let mean = seen.iter().sum::<f64>() / kept.sum().max(f64::MIN_POSITIVE);
    let seen = DVector::from_column_slice(seen);
    let mut variance = DVector::from_element(n, mean);
    let weight: Vec<f64> = (0..n).map(|k| kept.column(k).sum()).collect();
    for _ in 0..UPDATES {
        let expected = kept * &variance;
        let ratio = DVector::from_fn(n, |m, _| if expected[m] > 0.0 { seen[m] / expected[m] } else { 1.0 });
        let pull = kept.tr_mul(&ratio);
        for k in 0..n {
            variance[k] = (variance[k] * pull[k] + PRIOR_WEIGHT * mean) / (weight[k] + PRIOR_WEIGHT);
        }
    }
    variance.iter().map(|v| 3.0 * v).collect()
}

/// Markers whose residual may represent the error of marker `m`: its own if it carries enough
/// information, otherwise those on the nearest links.
pub(crate) fn donors(problem: &Problem, m: usize, speaks: &[bool]) -> Vec<usize> {
    if speaks[m] {
        return vec![m];
    }
    let above = |link: usize| {
        let mut path = vec![link];
        let mut at = link;
        while problem.tree.links[at].parent != NONE {
            at = problem.tree.links[at].parent;
            path.push(at);
        }
        path
    };
    let own = above(problem.markers[m].link);
    let distance = |link: usize| {
        let path = above(link);
        let shared = path.iter().filter(|l| own.contains(l)).count();
        path.len() + own.len() - 2 * shared
    };
    let others: Vec<(usize, usize)> =
        (0..speaks.len()).filter(|&k| speaks[k]).map(|k| (k, distance(problem.markers[k].link))).collect();
    let nearest = others.iter().map(|o| o.1).min().unwrap_or(0);
    others.into_iter().filter(|o| o.1 == nearest).map(|o| o.0).collect()
}

/// Uniform over all rotations (a uniform unit quaternion).
fn random_rotation(rng: &mut ChaCha8Rng) -> Matrix3<f64> {
    let v = Vector4::from_fn(|_, _| StandardNormal.sample(rng));
    let q = Unit::new_normalize(nalgebra::Quaternion::from(v));
    Rotation3::from(q).into_inner()
}

/// Linear response of the fit to displaced markers in one frame, with all markers of the trial
/// visible.
struct Response<'a> {
    solver: Solver<'a>,
    force: Vec<Vector3<f64>>,
    torque: Vec<Vector3<f64>>,
}

impl<'a> Response<'a> {
    fn new(problem: &'a Problem) -> Self {
        let links = problem.tree.links.len();
        Self {
            solver: with_all_markers(problem),
            force: vec![Vector3::zeros(); links],
            torque: vec![Vector3::zeros(); links],
        }
    }

    /// Computes the normal matrix at a pose; false if a coordinate is undetermined.
    fn at(&mut self, q: &[f64]) -> bool {
        self.solver.evaluate(q);
        self.solver.prepare(q)
    }

    fn pose(&self) -> &Pose {
        &self.solver.pose
    }

    /// World position of a marker that is displaced in the axes of its link, m.
    fn place(&self, m: usize, displaced: &Vector3<f64>) -> Vector3<f64> {
        let marker = &self.solver.problem.markers[m];
        let pose = self.pose();
        pose.origin[marker.link] + pose.rotation[marker.link] * (marker.position + displaced)
    }

    fn arm(&self, m: usize) -> Vector3<f64> {
        self.place(m, &Vector3::zeros()) - self.pose().reference
    }

    fn solve(&self, x: &mut [f64]) {
        self.solver.factor.solve(&self.solver.problem.tree, x);
    }

    /// Derivatives of the marker positions by the coordinates, 3 markers × nv, world axes; zero for
    /// locked coordinates.
    fn jacobian(&self) -> DMatrix<f64> {
        let problem = self.solver.problem;
        let tree = &problem.tree;
        let mut out = DMatrix::zeros(3 * problem.markers.len(), tree.nv);
        for (m, marker) in problem.markers.iter().enumerate() {
            let arm = self.arm(m);
            let mut link = marker.link;
            while link != NONE {
                for column in (0..tree.nv).filter(|&c| tree.column_link[c] == link && !problem.locked[c]) {
                    let moved = self.pose().linear[column] + self.pose().angular[column].cross(&arm);
                    out.fixed_view_mut::<3, 1>(3 * m, column).copy_from(&moved);
                }
                link = tree.links[link].parent;
            }
        }
        out
    }

    /// δq = H⁻¹ Jᵀ W e for errors `e` of the markers in the axes of their links.
    fn step(&mut self, error: &dyn Fn(usize) -> Vector3<f64>, out: &mut [f64]) {
        let problem = self.solver.problem;
        let tree = &problem.tree;
        self.force.fill(Vector3::zeros());
        self.torque.fill(Vector3::zeros());
        for (m, marker) in problem.markers.iter().enumerate() {
            let pull = self.solver.pose.rotation[marker.link] * error(m) * marker.weight;
            let arm = self.arm(m);
            self.torque[marker.link] += arm.cross(&pull);
            self.force[marker.link] += pull;
        }
        for link in (1..tree.links.len()).rev() {
            let parent = tree.links[link].parent;
            if parent != NONE {
                let (force, torque) = (self.force[link], self.torque[link]);
                self.force[parent] += force;
                self.torque[parent] += torque;
            }
        }
        for (column, x) in out.iter_mut().enumerate() {
            let link = tree.column_link[column];
            let pose = &self.solver.pose;
            *x = if problem.locked[column] {
                0.0
            } else {
                pose.linear[column].dot(&self.force[link]) + pose.angular[column].dot(&self.torque[link])
            };
        }
        self.solver.factor.solve(tree, out);
    }
}
