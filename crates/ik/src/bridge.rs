//! Short gaps of single markers.
//!
//! Soft tissue displaces every marker slightly from its place on the link, and the pose is a
//! compromise between the markers. When one marker is missing, the pose jumps by that marker's
//! contribution, and jumps back when it returns. After two differentiations, such a step of a
//! millimetre is larger than the motion. If the marker was the only one that determined a rotation,
//! that rotation is undetermined. The frames of a short gap are therefore minimised again with two
//! additions:
//!
//! * the joints of the marker's branch are weakly attracted to a cubic between the edges of the
//!   gap, which takes effect only where the other markers do not determine the pose;
//! * the marker is replaced by a substitute at its place on the link plus its residual at the
//!   edges, in the link's frame.
//!
//! The substitutes affect the pose only: they count neither in residuals nor in standard
//! deviations.

use crate::frame::Solver;
use crate::problem::Problem;
use crate::tree::{NONE, quaternion};
use aloft_body::{JointKind, Motion};
use aloft_trial::Trial;
use nalgebra::{UnitQuaternion, Vector3};
use rayon::prelude::*;

/// Frames at each edge over which residual and rate are averaged.
const EDGE: usize = 3;
/// Rounds of placing the substitutes and minimising the cost.
const ROUNDS: usize = 4;
/// Movement below which the substitutes have converged, m.
const SETTLED_M: f64 = 2e-6;
/// Standard deviation of the difference between a joint and the cubic, rad (m for prismatic
/// joints).
const CUBIC_SD_RAD: f64 = 0.05;

/// A gap of one marker.
#[derive(Debug, Clone)]
struct Gap {
    marker: usize,
    start: usize,
    end: usize,
    /// Frames at the edges of the cubic: those of the gap, or of all overlapping gaps on the
    /// branch.
    from: usize,
    to: usize,
    /// Position in the link's frame at both edges, m.
    before: Vector3<f64>,
    after: Vector3<f64>,
    /// Links whose joints are attracted to the cubic.
    branch: Vec<usize>,
}

/// Solves the frames of short gaps again. Returns the number of frames changed.
pub(crate) fn bridge(
    problem: &Problem,
    trial: &Trial,
    sources: &[usize],
    motion: &mut Motion,
    longest: usize,
) -> usize {
    let gaps = find_gaps(problem, trial, sources, motion, longest);
    let mut of_frame: Vec<Vec<usize>> = vec![Vec::new(); motion.n_frames()];
    for (g, gap) in gaps.iter().enumerate() {
        (gap.start..gap.end).filter(|&f| motion.is_valid(f)).for_each(|f| of_frame[f].push(g));
    }
    let frames: Vec<usize> = (0..of_frame.len()).filter(|&f| !of_frame[f].is_empty()).collect();
    let (nq, nv, n) = (motion.nq, motion.nv, problem.markers.len());
    let solved: Vec<Bridged> = frames
        .par_chunks(64)
        .flat_map_iter(|piece| {
            let mut solver = Solver::new(problem);
            let one = |&f: &usize| {
                for (target, &source) in solver.targets.iter_mut().zip(sources) {
                    *target = trial.markers.trajectories[source][f];
                }
                let gaps: Vec<&Gap> = of_frame[f].iter().map(|&g| &gaps[g]).collect();
                again(&mut solver, motion, f, &gaps)
            };
            piece.iter().map(one).collect::<Vec<_>>()
        })
        .collect();
    for (&f, bridged) in frames.iter().zip(&solved) {
        motion.q[f * nq..(f + 1) * nq].copy_from_slice(&bridged.q);
        if problem.deviations {
            motion.q_sd[f * nv..(f + 1) * nv].copy_from_slice(&bridged.q_sd);
        }
        motion.residual_m[f * n..(f + 1) * n].copy_from_slice(&bridged.residual_m);
    }
    frames.len()
}

struct Bridged {
    q: Vec<f64>,
    q_sd: Vec<f64>,
    residual_m: Vec<f64>,
}

/// Solves one frame again with the gaps that contain it.
fn again(solver: &mut Solver<'_>, motion: &Motion, frame: usize, gaps: &[&Gap]) -> Bridged {
    let problem = solver.problem;
    let tree = &problem.tree;
    solver.rest_q.copy_from_slice(&problem.rest_q);
    solver.rest_weight.fill(problem.rest_weight);
    let mut q = motion.q(frame).to_vec();
    for gap in gaps {
        for &link in &gap.branch {
            cubic(motion, gap, frame, &tree.links[link].kind, tree.links[link].q_offset, &mut solver.rest_q);
            solver.rest_weight[link] = 1.0 / (CUBIC_SD_RAD * CUBIC_SD_RAD);
            let at = tree.links[link].q_offset;
            let nq = tree.links[link].kind.nq();
            if !problem.locked_link[link] {
                q[at..at + nq].copy_from_slice(&solver.rest_q[at..at + nq]);
            }
        }
    }
    solver.look();
    solver.minimize(&mut q);
    let mut pose = tree.pose();
    for round in 0..ROUNDS {
        tree.forward(&q, &mut pose);
        let mut moved: f64 = 0.0;
        for gap in gaps {
            let share = (frame + 1 - gap.start) as f64 / (gap.end + 1 - gap.start) as f64;
            let link = problem.markers[gap.marker].link;
            let place = pose.origin[link] + pose.rotation[link] * gap.before.lerp(&gap.after, share);
            moved = moved.max((place - solver.targets[gap.marker]).norm());
            solver.targets[gap.marker] = place;
        }
        // There is nothing to compare with in the first round.
        if round > 0 && moved < SETTLED_M {
            break;
        }
        solver.look();
        solver.minimize(&mut q);
    }
    for gap in gaps {
        solver.targets[gap.marker] = Vector3::repeat(f64::NAN);
    }
    solver.look();
    solver.evaluate(&q);
    let nv = tree.nv;
    let mut q_sd = Vec::new();
    if problem.deviations {
        q_sd.extend_from_slice(&motion.q_sd[frame * nv..(frame + 1) * nv]);
    }
    if problem.deviations && solver.covariance(&q) {
        let factor = solver.variance_factor();
        for (column, sd) in q_sd.iter_mut().enumerate().filter(|(c, _)| !problem.locked[*c]) {
            *sd = (factor * solver.variance(column)).max(0.0).sqrt();
        }
    }
    let mut residual_m = vec![f64::NAN; problem.markers.len()];
    for &i in &solver.visible {
        residual_m[i] = solver.residual[i].norm();
    }
    Bridged { q, q_sd, residual_m }
}

/// One joint's coordinates in a gap: Hermite's cubic between the edges, rotations in the tangent space of the first edge.
fn cubic(motion: &Motion, gap: &Gap, frame: usize, kind: &JointKind, at: usize, out: &mut [f64]) {
    let (a, b) = (gap.from, gap.to);
    // The outer ends of the stretches from which rates are computed.
    let a0 = (a.saturating_sub(EDGE)..=a).find(|&f| motion.is_valid(f)).unwrap_or(a);
    let last = (b + EDGE).min(motion.n_frames() - 1);
    let b1 = (b..=last).rev().find(|&f| motion.is_valid(f)).unwrap_or(b);
    let length = (b - a) as f64;
    let s = (frame - a) as f64 / length;
    let (s2, s3) = (s * s, s * s * s);
    let (h_a, h_end, h_b) = (s3 - 2.0 * s2 + s, 3.0 * s2 - 2.0 * s3, s3 - s2);
    let scale_a = if a > a0 { length / (a - a0) as f64 } else { 0.0 };
    let scale_b = if b1 > b { length / (b1 - b) as f64 } else { 0.0 };
    match kind {
        JointKind::Spherical => {
            let turn = |f: usize| quaternion(&motion.q(f)[at..at + 4]);
            let log = |from: usize, to: usize| (turn(from).inverse() * turn(to)).scaled_axis();
            let middle = log(a, b);
            let (rate_a, rate_b) = (log(a0, a) * scale_a, log(b, b1) * scale_b);
            let x = rate_a * h_a + middle * h_end + rate_b * h_b;
            let value = turn(a) * UnitQuaternion::from_scaled_axis(x);
            out[at..at + 4].copy_from_slice(value.coords.as_slice());
        }
        JointKind::Revolute(_) | JointKind::Prismatic(_) => {
            let value = |f: usize| motion.q(f)[at];
            let (rate_a, rate_b) = ((value(a) - value(a0)) * scale_a, (value(b1) - value(b)) * scale_b);
            out[at] = value(a) + rate_a * h_a + (value(b) - value(a)) * h_end + rate_b * h_b;
        }
        JointKind::Free | JointKind::Fixed => {}
    }
}

/// Finds the gaps that can be bridged.
fn find_gaps(problem: &Problem, trial: &Trial, sources: &[usize], motion: &Motion, longest: usize) -> Vec<Gap> {
    let n_frames = motion.n_frames();
    let mut gaps = Vec::new();
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
            let inside = start > 0 && end < n_frames && end - start <= longest;
            if inside && motion.is_valid(start - 1) && motion.is_valid(end) {
                // Mean position in the link's frame over the frames of one edge.
                let mut edge = |from: usize, to: usize| {
                    let (mut sum, mut count) = (Vector3::zeros(), 0.0);
                    for f in (from..to).filter(|&f| seen(f) && motion.is_valid(f)) {
                        problem.tree.forward(motion.q(f), &mut pose);
                        sum += pose.rotation[tracked.link].transpose() * (track[f] - pose.origin[tracked.link]);
                        count += 1.0;
                    }
                    sum / count
                };
                let before = edge(start.saturating_sub(EDGE), start);
                let after = edge(end, (end + EDGE).min(n_frames));
                let branch = branch(problem, tracked.link);
                gaps.push(Gap { marker, start, end, from: start - 1, to: end, before, after, branch });
            }
            start = end;
        }
    }
    join(problem, &mut gaps, motion, 3 * longest);
    gaps
}

/// Moves the edges of cubics out of other gaps on the same branch, where poses are equally
/// uncertain, provided that the cubics stay short.
fn join(problem: &Problem, gaps: &mut [Gap], motion: &Motion, longest: usize) {
    let link = |gap: &Gap| problem.markers[gap.marker].link;
    loop {
        let mut changed = false;
        for i in 0..gaps.len() {
            let (mut from, mut to) = (gaps[i].from, gaps[i].to);
            for other in gaps.iter().filter(|o| o.branch.contains(&link(&gaps[i])) || link(o) == link(&gaps[i])) {
                if other.start <= to && other.end > from {
                    from = from.min(other.start - 1);
                    to = to.max(other.end);
                }
            }
            let wider = from < gaps[i].from || to > gaps[i].to;
            if wider && to - from <= longest && motion.is_valid(from) && motion.is_valid(to) {
                (gaps[i].from, gaps[i].to) = (from, to);
                changed = true;
            }
        }
        if !changed {
            return;
        }
    }
}

/// Links on the path through a link: its ancestors, itself and its descendants, without the root.
fn branch(problem: &Problem, link: usize) -> Vec<usize> {
    let links = &problem.tree.links;
    let above = |mut from: usize, to: usize| {
        while from != to && from != NONE {
            from = links[from].parent;
        }
        from == to
    };
    (1..links.len()).filter(|&l| above(link, l) || above(l, link)).collect()
}
