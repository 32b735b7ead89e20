//! Gaps of single markers.
//!
//! Soft tissue pulls every marker a little off its place on the link. While all are there the pose settles among
//! them; when one goes, the pose jumps by its share, and returns when it comes back. Twice differentiated, such a step of a
//! millimetre is larger than the motion. So in a short gap the marker is put where the tracked link carries it, with the
//! residual that it had in the link's frame at the edges, interpolated; and the frames of the gap are minimised again.
//! The substitutes steady the pose only: they count neither in residuals nor in standard deviations.

use crate::frame::Solver;
use crate::problem::Problem;
use aloft_body::Motion;
use aloft_trial::Trial;
use nalgebra::Vector3;
use rayon::prelude::*;

/// Frames at each edge over which the residual is averaged.
const EDGE: usize = 3;
/// Rounds of placing the substitutes and minimising.
const ROUNDS: usize = 4;

/// Movement of the substitutes below which they have settled, m.
const SETTLED_M: f64 = 2e-6;

/// A marker that stands in for a missing one: where it goes in its link's frame, m.
#[derive(Debug, Clone, Copy)]
struct Substitute {
    marker: usize,
    in_link: Vector3<f64>,
}

/// Solves the frames of short gaps again. Returns how many frames were touched.
pub(crate) fn bridge(
    problem: &Problem,
    trial: &Trial,
    sources: &[usize],
    motion: &mut Motion,
    longest: usize,
) -> usize {
    let substitutes = place(problem, trial, sources, motion, longest);
    let nq = motion.nq;
    let n = problem.markers.len();
    let frames: Vec<usize> = (0..substitutes.len()).filter(|&f| !substitutes[f].is_empty()).collect();
    let solved: Vec<(Vec<f64>, Vec<f64>)> = frames
        .par_chunks(64)
        .flat_map_iter(|piece| {
            let mut solver = Solver::new(problem);
            piece.iter().map(|&f| again(&mut solver, trial, sources, f, motion.q(f), &substitutes[f])).collect::<Vec<_>>()
        })
        .collect();
    for (&f, (q, residual_m)) in frames.iter().zip(&solved) {
        motion.q[f * nq..(f + 1) * nq].copy_from_slice(q);
        motion.residual_m[f * n..(f + 1) * n].copy_from_slice(residual_m);
    }
    frames.len()
}

/// One frame with its substitutes; joint coordinates and residuals of the markers that were measured.
fn again(
    solver: &mut Solver<'_>,
    trial: &Trial,
    sources: &[usize],
    frame: usize,
    q: &[f64],
    substitutes: &[Substitute],
) -> (Vec<f64>, Vec<f64>) {
    let problem = solver.problem;
    let mut q = q.to_vec();
    let mut pose = problem.tree.pose();
    for (target, &source) in solver.targets.iter_mut().zip(sources) {
        *target = trial.markers.trajectories[source][frame];
    }
    for round in 0..ROUNDS {
        problem.tree.forward(&q, &mut pose);
        let mut moved: f64 = 0.0;
        for s in substitutes {
            let link = problem.markers[s.marker].link;
            let place = pose.origin[link] + pose.rotation[link] * s.in_link;
            moved = moved.max((place - solver.targets[s.marker]).norm());
            solver.targets[s.marker] = place;
        }
        // in the first round there is nothing to compare with
        if round > 0 && moved < SETTLED_M {
            break;
        }
        solver.look();
        solver.minimise(&mut q);
    }
    let mut residual_m = vec![f64::NAN; problem.markers.len()];
    for &i in &solver.visible {
        if substitutes.iter().all(|s| s.marker != i) {
            residual_m[i] = solver.residual[i].norm();
        }
    }
    (q, residual_m)
}

/// Substitutes of each frame.
fn place(problem: &Problem, trial: &Trial, sources: &[usize], motion: &Motion, longest: usize) -> Vec<Vec<Substitute>> {
    let n_frames = motion.n_frames();
    let mut substitutes = vec![Vec::new(); n_frames];
    let mut pose = problem.tree.pose();
    for (marker, (tracked, &source)) in problem.markers.iter().zip(sources).enumerate() {
        let track = &trial.markers.trajectories[source];
        let seen = |f: usize| track[f].iter().all(|x| x.is_finite());
        let mut start = 0;
        while start < n_frames {
            if seen(start) {
                start += 1;
                continue;
            }
            let end = (start..n_frames).find(|&f| seen(f)).unwrap_or(n_frames);
            if start > 0 && end < n_frames && end - start <= longest {
                // mean place in the link's frame over the frames of one edge
                let mut edge = |from: usize, to: usize| {
                    let (mut sum, mut count) = (Vector3::zeros(), 0.0);
                    for f in (from..to).filter(|&f| seen(f) && motion.is_valid(f)) {
                        problem.tree.forward(motion.q(f), &mut pose);
                        sum += pose.rotation[tracked.link].transpose() * (track[f] - pose.origin[tracked.link]);
                        count += 1.0;
                    }
                    (count > 0.0).then(|| sum / count)
                };
                let before = edge(start.saturating_sub(EDGE), start);
                let after = edge(end, (end + EDGE).min(n_frames));
                if let (Some(before), Some(after)) = (before, after) {
                    for f in (start..end).filter(|&f| motion.is_valid(f)) {
                        let share = (f + 1 - start) as f64 / (end + 1 - start) as f64;
                        substitutes[f].push(Substitute { marker, in_link: before.lerp(&after, share) });
                    }
                }
            }
            start = end;
        }
    }
    substitutes
}
