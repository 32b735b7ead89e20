//! Tracks a trial frame by frame.
//!
//! Each frame starts from the extrapolated motion of the two preceding frames. It is restarted from
//! several closed-form guesses if there is no preceding frame, or if its fit is suddenly worse.
//! Hinges whose markers cannot distinguish the two sides of a bent limb are also started on the
//! flexed side whenever they are near or beyond straight. Long trials are split into sequences of
//! fixed length, each with a few warm-up frames, so that the result does not depend on the number
//! of threads.

use crate::bridge::bridge;
use crate::frame::{Fit, Solver};
use crate::problem::{FEWEST_MARKERS, Problem};
use crate::{BeyondRange, IkError, IkOptions, IkReport};
use aloft_body::{JointKind, Motion, Subject};
use aloft_trial::Trial;
use nalgebra::Vector3;
use rayon::prelude::*;

/// Flexion below which the flexed side of a watched hinge is tried as well, rad.
const NEAR_STRAIGHT_RAD: f64 = 0.15;
/// Increase of χ² that is always accepted for a fit on the flexed side.
const FLEXED_SLACK: f64 = 9.0;

/// Most segments that are turned to their markers in one frame.
const MOST_TURNED: usize = 4;
/// Share of the cost below which a turned segment is kept.
const TURNED_COST: f64 = 0.8;

/// Motion of one trial and its fit to the markers.
#[derive(Debug, Clone, PartialEq)]
pub struct IkResult {
    /// Joint coordinates (world frame, SI), residuals and standard deviations; velocities and
    /// accelerations are empty.
    pub motion: Motion,
    /// Figures by marker and by frame.
    pub report: IkReport,
}

/// Finds the joint coordinates of every frame of a trial.
///
/// Weighted non-linear least squares over all coordinates: ½ Σ w_k |p_k(q) − y_k|² / σ² plus soft
/// priors, where p_k is a model marker and y_k the measured one, matched by label. Markers missing
/// in a frame are omitted; gaps up to `bridge_gaps_s` are bridged. Frames in which the root is
/// undetermined are NaN in the motion and counted in the report.
///
/// `motion.q_sd` holds standard deviations from the inverse of the normal equations, scaled by each
/// frame's residual variance (in the tangent space of `v`: m and rad).
///
/// # Errors
/// [`IkError::TooFewMarkers`] when fewer than three markers are common to trial and subject;
/// [`IkError::Mismatch`] and [`IkError::Option`] when subject or options do not match the model.
pub fn solve(subject: &Subject, trial: &Trial, options: &IkOptions) -> Result<IkResult, IkError> {
    solve_with(subject, trial, options, true)
}

/// Keeps the problem's markers that the trial contains; returns their indices in the trial.
pub(crate) fn match_markers(problem: &mut Problem, subject: &Subject, trial: &Trial) -> Result<Vec<usize>, IkError> {
    let all: Vec<String> = problem.markers.iter().map(|m| m.label.clone()).collect();
    problem.markers.retain(|m| trial.markers.index(&m.label).is_some());
    if problem.markers.len() < FEWEST_MARKERS {
        return Err(IkError::TooFewMarkers {
            trial: trial.name.clone(),
            subject: subject.facts.name.clone(),
            found: problem.markers.len(),
            needed: FEWEST_MARKERS,
            expected: all.join(" "),
        });
    }
    Ok(problem.markers.iter().filter_map(|m| trial.markers.index(&m.label)).collect())
}

/// [`solve`], but `motion.q_sd` stays empty unless `deviations` is set; all else is the same.
fn solve_with(subject: &Subject, trial: &Trial, options: &IkOptions, deviations: bool) -> Result<IkResult, IkError> {
    let mut problem = Problem::new(subject, options)?;
    problem.deviations = deviations;
    let all: Vec<String> = problem.markers.iter().map(|m| m.label.clone()).collect();
    let sources = match_markers(&mut problem, subject, trial)?;
    let n_frames = trial.markers.n_frames;
    let n_pieces = n_frames.div_ceil(options.chunk_frames);
    let pieces: Vec<Piece> = (0..n_pieces)
        .into_par_iter()
        .map(|i| {
            let start = i * options.chunk_frames;
            let end = (start + options.chunk_frames).min(n_frames);
            track(&problem, options, trial, &sources, start.saturating_sub(options.warm_up_frames), start, end)
        })
        .collect();

    let labels: Vec<String> = problem.markers.iter().map(|m| m.label.clone()).collect();
    let (nq, nv, n) = (problem.tree.nq, problem.tree.nv, labels.len());
    let mut motion = Motion {
        trial: trial.name.clone(),
        rate_hz: trial.markers.rate_hz,
        nq,
        nv,
        q: Vec::with_capacity(n_frames * nq),
        residual_m: Vec::with_capacity(n_frames * n),
        q_sd: Vec::with_capacity(if deviations { n_frames * nv } else { 0 }),
        marker_labels: labels,
        ..Motion::default()
    };
    for piece in &pieces {
        motion.q.extend_from_slice(&piece.q);
        motion.residual_m.extend_from_slice(&piece.residual_m);
        motion.q_sd.extend_from_slice(&piece.q_sd);
    }
    // each piece counts the turns of its hinges from the posture at rest
    problem.tree.make_continuous(&mut motion.q);
    let longest = (options.bridge_gaps_s * motion.rate_hz + 1e-9).max(0.0) as usize;
    let n_bridged = if longest > 0 { bridge(&problem, trial, &sources, &mut motion, longest) } else { 0 };
    problem.tree.make_continuous(&mut motion.q);
    let solved: Vec<bool> = (0..n_frames).map(|f| motion.is_valid(f)).collect();
    let mut report = IkReport::gather(&trial.name, &motion.marker_labels, &motion.residual_m, &solved);
    report.n_bridged = n_bridged;
    for piece in &pieces {
        report.n_unconverged += piece.n_unconverged;
        report.n_restarts += piece.n_restarts;
        report.n_branch_changes += piece.n_branch_changes;
        report.n_turned += piece.n_turned;
        report.mean_iterations += piece.iterations as f64;
    }
    report.beyond_range = beyond_range(&problem, &motion);
    report.mean_iterations /= n_frames.max(1) as f64;
    report.missing_labels = all.into_iter().filter(|l| trial.markers.index(l).is_none()).collect();
    report.unused_labels = trial.markers.labels.iter().filter(|l| !motion.marker_labels.contains(l)).cloned().collect();
    Ok(IkResult { motion, report })
}

/// Joints beyond their ranges in a motion, the farthest first.
fn beyond_range(problem: &Problem, motion: &Motion) -> Vec<BeyondRange> {
    let solver = Solver::new(problem);
    let mut found: std::collections::BTreeMap<usize, BeyondRange> = std::collections::BTreeMap::new();
    for frame in (0..motion.n_frames()).filter(|f| motion.is_valid(*f)) {
        for (link, excess) in solver.beyond(motion.q(frame)) {
            let entry = found.entry(link).or_insert_with(|| BeyondRange {
                link: problem.tree.links[link].name.clone(),
                n_frames: 0,
                worst_frame: frame,
                worst_deg: 0.0,
            });
            entry.n_frames += 1;
            if excess.to_degrees() > entry.worst_deg {
                (entry.worst_frame, entry.worst_deg) = (frame, excess.to_degrees());
            }
        }
    }
    let mut out: Vec<BeyondRange> = found.into_values().collect();
    out.sort_by(|a, b| b.worst_deg.total_cmp(&a.worst_deg));
    out
}

/// Frames `start..end` of a trial.
#[derive(Debug, Default)]
pub(crate) struct Piece {
    pub q: Vec<f64>,
    pub residual_m: Vec<f64>,
    pub q_sd: Vec<f64>,
    pub n_unconverged: usize,
    pub n_restarts: usize,
    pub n_branch_changes: usize,
    pub n_turned: usize,
    pub iterations: usize,
}

/// State carried from frame to frame.
struct Memory {
    last: Vec<f64>,
    before: Vec<f64>,
    /// Number of consecutive frames stored: 0, 1 or 2.
    depth: usize,
    /// True once any frame was solved.
    any: bool,
    rms: f64,
}

/// Frames `start..end`, tracked in one sequence from the frame `from` on.
pub(crate) fn track(
    problem: &Problem,
    options: &IkOptions,
    trial: &Trial,
    sources: &[usize],
    from: usize,
    start: usize,
    end: usize,
) -> Piece {
    let (nq, nv, n) = (problem.tree.nq, problem.tree.nv, problem.markers.len());
    let mut piece = Piece {
        q: vec![f64::NAN; (end - start) * nq],
        residual_m: vec![f64::NAN; (end - start) * n],
        q_sd: if problem.deviations { vec![f64::NAN; (end - start) * nv] } else { Vec::new() },
        ..Piece::default()
    };
    let mut solver = Solver::new(problem);
    let mut tracker = Tracker { q: problem.rest_q.clone(), other: problem.rest_q.clone(), options };
    let mut memory =
        Memory { last: problem.rest_q.clone(), before: problem.rest_q.clone(), depth: 0, any: false, rms: f64::NAN };
    for frame in from..end {
        for (target, &source) in solver.targets.iter_mut().zip(sources) {
            *target = trial.markers.trajectories[source].get(frame).copied().unwrap_or(Vector3::repeat(f64::NAN));
        }
        let outcome = if solver.look() { tracker.frame(&mut solver, &memory) } else { Outcome::default() };
        if frame >= start {
            piece.iterations += outcome.iterations;
            piece.n_restarts += usize::from(outcome.restarted);
            piece.n_branch_changes += usize::from(outcome.branch_changed);
            piece.n_turned += usize::from(outcome.turned);
        }
        if !outcome.solved {
            memory.depth = 0;
            continue;
        }
        memory.before.copy_from_slice(&memory.last);
        memory.last.copy_from_slice(&tracker.q);
        memory.depth =
            if outcome.restarted || outcome.branch_changed || outcome.turned { 1 } else { (memory.depth + 1).min(2) };
        memory.any = true;
        memory.rms = solver.rms();
        if frame >= start {
            let at = frame - start;
            piece.n_unconverged += usize::from(!outcome.converged);
            piece.q[at * nq..(at + 1) * nq].copy_from_slice(&tracker.q);
            for &i in &solver.visible {
                piece.residual_m[at * n + i] = solver.residual[i].norm();
            }
            if !problem.deviations {
                continue;
            }
            let factor = solver.variance_factor();
            for column in 0..nv {
                let locked = problem.locked[column];
                piece.q_sd[at * nv + column] =
                    if locked { 0.0 } else { (factor * solver.variance(column)).max(0.0).sqrt() };
            }
        }
    }
    piece
}

/// Independent frames, each from its own initial posture. A frame that cannot be solved keeps that
/// posture.
pub(crate) fn track_each(
    problem: &Problem,
    options: &IkOptions,
    trial: &Trial,
    sources: &[usize],
    near: &IkResult,
) -> Piece {
    let n = problem.markers.len();
    let mut piece =
        Piece { q: near.motion.q.clone(), residual_m: vec![f64::NAN; near.motion.n_frames() * n], ..Piece::default() };
    let mut solver = Solver::new(problem);
    let mut tracker = Tracker { q: problem.rest_q.clone(), other: problem.rest_q.clone(), options };
    let rest = || problem.rest_q.clone();
    let mut memory = Memory { last: rest(), before: rest(), depth: 1, any: true, rms: f64::NAN };
    for (frame, q) in piece.q.chunks_exact_mut(problem.tree.nq).enumerate() {
        for (target, &source) in solver.targets.iter_mut().zip(sources) {
            *target = trial.markers.trajectories[source][frame];
        }
        memory.last.copy_from_slice(q);
        memory.rms = near.report.frame_rms_m[frame];
        if solver.look() && tracker.frame(&mut solver, &memory).solved {
            q.copy_from_slice(&tracker.q);
            for &i in &solver.visible {
                piece.residual_m[frame * n + i] = solver.residual[i].norm();
            }
        }
    }
    piece
}

/// Fits of single frames, for comparing what the same frames would be with other labels.
pub(crate) struct Single<'p> {
    solver: Solver<'p>,
    tracker: Tracker<'p>,
    memory: Memory,
}

/// Lever with which an angle beyond a joint's range counts as an error of a marker, m.
const RANGE_LEVER_M: f64 = 0.1;

impl<'p> Single<'p> {
    pub fn new(problem: &'p Problem, options: &'p IkOptions) -> Self {
        let rest = || problem.rest_q.clone();
        Self {
            solver: Solver::new(problem),
            tracker: Tracker { q: rest(), other: rest(), options },
            memory: Memory { last: rest(), before: rest(), depth: 0, any: false, rms: f64::NAN },
        }
    }

    /// Root mean square distance of the markers at `place` (by index of the problem's markers),
    /// together with what joints are beyond their ranges, m; none for a frame that cannot be
    /// solved.
    pub fn error(&mut self, place: impl Fn(usize) -> Option<Vector3<f64>>) -> Option<f64> {
        for (i, target) in self.solver.targets.iter_mut().enumerate() {
            *target = place(i).unwrap_or(Vector3::repeat(f64::NAN));
        }
        if !self.solver.look() || !self.tracker.frame(&mut self.solver, &self.memory).solved {
            return None;
        }
        let beyond: f64 = self.solver.beyond(&self.tracker.q).map(|(_, excess)| excess * excess).sum();
        let rms = self.solver.rms();
        let n = self.solver.visible.len() as f64;
        Some((rms * rms + RANGE_LEVER_M * RANGE_LEVER_M * beyond / n).sqrt())
    }

    /// Markers seen in the frame that was fitted last (index of the problem's markers), each with
    /// its distance from the model, m.
    pub fn distances(&self) -> impl Iterator<Item = (usize, f64)> + '_ {
        self.solver.visible.iter().map(|&i| (i, self.solver.residual[i].norm()))
    }

    /// Joints beyond their ranges in the frame that was fitted last: link and excess, rad.
    pub fn beyond(&self) -> impl Iterator<Item = (usize, f64)> + '_ {
        self.solver.beyond(&self.tracker.q)
    }
}

#[derive(Debug, Clone, Copy, Default)]
struct Outcome {
    solved: bool,
    converged: bool,
    restarted: bool,
    branch_changed: bool,
    turned: bool,
    iterations: usize,
}

struct Tracker<'o> {
    /// Result of the frame.
    q: Vec<f64>,
    other: Vec<f64>,
    options: &'o IkOptions,
}

impl Tracker<'_> {
    fn frame(&mut self, solver: &mut Solver<'_>, memory: &Memory) -> Outcome {
        let tree = &solver.problem.tree;
        let mut outcome = Outcome::default();
        let mut best: Option<Fit> = None;
        if memory.depth > 0 {
            if memory.depth > 1 {
                tree.extrapolate(&memory.before, &memory.last, &mut self.q);
            } else {
                self.q.copy_from_slice(&memory.last);
            }
            let fit = solver.minimize(&mut self.q);
            outcome.iterations += fit.iterations;
            best = Some(fit);
        }
        let jumped = solver.rms() > self.options.restart_factor * memory.rms + self.options.restart_margin_m;
        if best.is_none_or(|fit| jumped || !fit.cost.is_finite()) {
            outcome.restarted = true;
            best = self.start_afresh(solver, memory, best, &mut outcome);
        }
        let Some(mut fit) = best else { return outcome };
        let plain = outcome.iterations == fit.iterations;
        for index in 0..solver.problem.hinges.len() {
            if solver.problem.hinges[index].watched || outcome.restarted {
                fit = self.try_flexed(solver, index, fit, &mut outcome);
            }
        }
        fit = self.turn_segments(solver, fit, &mut outcome);
        if !plain || outcome.iterations != fit.iterations {
            // Another start was tried last: restore poses and residuals of the one that was kept.
            solver.evaluate(&self.q);
        }
        outcome.converged = fit.converged;
        outcome.solved = fit.cost.is_finite() && solver.covariance(&self.q) && self.root_is_known(solver);
        outcome
    }

    /// The best of several starts that do not depend on the preceding frame; `best` belongs to
    /// `self.q`.
    fn start_afresh(
        &mut self,
        solver: &mut Solver<'_>,
        memory: &Memory,
        mut best: Option<Fit>,
        outcome: &mut Outcome,
    ) -> Option<Fit> {
        for attempt in 0..5 {
            let ready = match attempt {
                0 | 1 => solver.start_at_rest(&mut self.other, true),
                2 | 3 => solver.start_at_rest(&mut self.other, false),
                _ => {
                    self.other.copy_from_slice(&memory.last);
                    memory.any
                }
            };
            if !ready {
                continue;
            }
            if attempt == 1 || attempt == 3 {
                solver.descend(&mut self.other);
            }
            let fit = solver.minimize(&mut self.other);
            outcome.iterations += fit.iterations;
            if fit.cost.is_finite() && best.is_none_or(|b| fit.cost < b.cost * (1.0 - 1e-9)) {
                best = Some(fit);
                std::mem::swap(&mut self.q, &mut self.other);
            }
        }
        best
    }

    /// Tries the flexed side of a hinge near or beyond straight, and keeps it unless the fit is
    /// clearly worse.
    fn try_flexed(&mut self, solver: &mut Solver<'_>, index: usize, fit: Fit, outcome: &mut Outcome) -> Fit {
        let hinge = &solver.problem.hinges[index];
        let now = hinge.flexion(self.q[hinge.q_index]);
        if now > NEAR_STRAIGHT_RAD {
            return fit;
        }
        self.other.copy_from_slice(&self.q);
        if !solver.start_flexed(hinge, &mut self.other) {
            return fit;
        }
        let tried = solver.minimize(&mut self.other);
        outcome.iterations += tried.iterations;
        let then = hinge.flexion(self.other[hinge.q_index]);
        let allowed = if now < 0.0 && then > 0.0 {
            fit.cost * (1.0 + self.options.flexed_tolerance) + 0.5 * FLEXED_SLACK
        } else if now >= 0.0 && then < 0.0 {
            fit.cost / (1.0 + self.options.flexed_tolerance) - 0.5 * FLEXED_SLACK
        } else {
            fit.cost * (1.0 - 1e-9)
        };
        if tried.cost.is_finite() && tried.cost < allowed {
            outcome.branch_changed |= (now - then).abs() > 0.02;
            std::mem::swap(&mut self.q, &mut self.other);
            return tried;
        }
        fit
    }

    /// Turns segments to the pose that their own markers show, where these keep their shape but lie
    /// far from the model: a wrong branch, which no step of the minimisation leaves.
    fn turn_segments(&mut self, solver: &mut Solver<'_>, mut fit: Fit, outcome: &mut Outcome) -> Fit {
        for _ in 0..MOST_TURNED {
            if outcome.iterations != fit.iterations {
                solver.evaluate(&self.q);
            }
            let Some((link, rotation)) = solver.turned_segment() else { break };
            self.other.copy_from_slice(&self.q);
            solver.start_turned(link, &rotation, &mut self.other);
            let tried = solver.minimize(&mut self.other);
            outcome.iterations += tried.iterations;
            if !(tried.cost.is_finite() && tried.cost < TURNED_COST * fit.cost) {
                solver.evaluate(&self.q);
                break;
            }
            std::mem::swap(&mut self.q, &mut self.other);
            outcome.turned = true;
            fit = tried;
        }
        fit
    }

    /// True if the markers determine the root's pose; needs the covariance.
    fn root_is_known(&self, solver: &Solver<'_>) -> bool {
        let root = &solver.problem.tree.links[0];
        if root.kind != JointKind::Free {
            return true;
        }
        let limit = self.options.root_sd_limit_m;
        // Rotations count by the displacement of a point 0.1 m away.
        (0..6).all(|i| {
            let arm = if i < 3 { 1.0 } else { 0.1 };
            solver.variance(root.v_offset + i).max(0.0).sqrt() * arm < limit
        })
    }
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;
    use aloft_body::subject::PriorSd;
    use aloft_body::{LinkInertia, Model, ModelMarker, ModelSpec, PersonFacts, State};
    use aloft_trial::Markers;
    use nalgebra::Matrix3;

    /// A person with the human model, three markers per link, and a smooth motion of `n_frames`
    /// frames.
    pub(crate) fn person(n_frames: usize) -> (Subject, Trial) {
        let spec: ModelSpec = serde_yaml::from_str(include_str!("../../../configs/models/human34.yaml")).unwrap();
        let mut model = Model::from_spec(&spec).unwrap();
        for (i, link) in model.links.iter_mut().enumerate().skip(1) {
            let x = i as f64;
            link.joint.parent_from_joint.translation.vector = Vector3::new(0.1 * x.sin(), -0.3, 0.1 * x.cos());
        }
        let markers: Vec<ModelMarker> = (0..3 * model.n_links())
            .map(|i| ModelMarker {
                label: format!("m{i}"),
                link: i / 3,
                position_m: Vector3::new((i as f64).sin(), (1.7 * i as f64).cos(), (2.3 * i as f64).sin()) * 0.1,
                weight: 1.0,
            })
            .collect();
        let mut state = State::new(&model);
        let mut trajectories = vec![Vec::new(); markers.len()];
        for f in 0..n_frames {
            let dv: Vec<f64> = (0..model.nv).map(|k| 0.2 * (0.02 * f as f64 + k as f64).sin()).collect();
            let mut q = model.neutral();
            model.integrate(&model.neutral(), &dv, &mut q);
            state.forward_position(&model, &q);
            for (path, marker) in trajectories.iter_mut().zip(&markers) {
                path.push(state.point_in_world(marker.link, &marker.position_m));
            }
        }
        let labels = markers.iter().map(|m| m.label.clone()).collect();
        let markers_of = Markers { rate_hz: 200.0, first_frame: 1, n_frames, labels, trajectories };
        let trial = Trial { name: "smooth".into(), markers: markers_of, ..Trial::default() };
        let n = model.n_links();
        let inertia =
            LinkInertia { mass_kg: 1.0, com_m: Vector3::zeros(), inertia_com_kgm2: Matrix3::identity() * 0.01 };
        let subject = Subject {
            facts: PersonFacts { name: "person".into(), sex: None, height_m: None, mass_kg: n as f64 },
            markers,
            prior: vec![inertia; n],
            prior_sd: vec![PriorSd { mass_rel: 0.1, com_m: 0.01, radius_rel: 0.1, together: 0.0 }; n],
            static_q: model.neutral(),
            provenance: Vec::new(),
            model,
            estimated: None,
            boxes: Vec::new(),
        };
        (subject, trial)
    }

    #[test]
    fn a_tracked_frame_allocates_nothing() {
        let (subject, trial) = person(120);
        let options = IkOptions::default();
        let problem = Problem::new(&subject, &options).unwrap();
        let sources: Vec<usize> = (0..problem.markers.len()).collect();
        let count = |end: usize| {
            let mut solved = false;
            let info = allocation_counter::measure(|| {
                let piece = track(&problem, &options, &trial, &sources, 0, 0, end);
                solved = piece.q.iter().all(|x| x.is_finite()) && piece.n_unconverged == 0;
            });
            assert!(solved);
            info.count_total
        };
        assert_eq!(count(120), count(30));
    }

    #[test]
    fn without_deviations_all_else_is_the_same() {
        let (subject, mut trial) = person(80);
        // Some gaps, so that bridging is included.
        for f in 20..30 {
            trial.markers.trajectories[7][f] = Vector3::repeat(f64::NAN);
        }
        let full = solve(&subject, &trial, &IkOptions::default()).unwrap();
        let mut lean = solve_with(&subject, &trial, &IkOptions::default(), false).unwrap();
        assert!(full.report.n_bridged > 0 && lean.motion.q_sd.is_empty());
        lean.motion.q_sd.clone_from(&full.motion.q_sd);
        let bits = |m: &Motion| m.q.iter().chain(&m.residual_m).map(|x| x.to_bits()).collect::<Vec<u64>>();
        assert_eq!(bits(&full.motion), bits(&lean.motion));
        assert_eq!(full.report.frame_rms_m, lean.report.frame_rms_m);
    }

    /// Moves every marker by 0.1 mm to a few millimetres, differently in every frame.
    pub(crate) fn shake(trial: &mut Trial) {
        for (i, path) in trial.markers.trajectories.iter_mut().enumerate() {
            for (f, p) in path.iter_mut().enumerate() {
                let x = (7919 * i + 104_729 * f) as f64;
                *p += Vector3::new(x.sin(), (1.3 * x).cos(), (0.7 * x).sin()) * 2e-3;
            }
        }
    }

    /// Compares a minimisation that ends on the predicted gain with one that continues until steps
    /// vanish.
    #[test]
    fn foreseen_steps_would_not_have_mattered() {
        let (subject, mut trial) = person(60);
        shake(&mut trial);
        let fast = solve(&subject, &trial, &IkOptions::default()).unwrap();
        let plain = solve(&subject, &trial, &IkOptions { tolerance_sd: 1e-8, ..IkOptions::default() }).unwrap();
        assert!(fast.report.mean_iterations + 0.5 < plain.report.mean_iterations);
        let mut gap = vec![0.0; subject.model.nv];
        for f in 0..60 {
            subject.model.difference(plain.motion.q(f), fast.motion.q(f), &mut gap);
            let sd = &plain.motion.q_sd[f * gap.len()..(f + 1) * gap.len()];
            assert!(gap.iter().zip(sd).all(|(g, sd)| g.abs() < 1e-3 * sd), "frame {f}");
            let other = &fast.motion.q_sd[f * gap.len()..(f + 1) * gap.len()];
            assert!(other.iter().zip(sd).all(|(a, b)| (a / b - 1.0).abs() < 1e-3), "frame {f}");
        }
    }
}
