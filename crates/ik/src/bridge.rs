//! Short gaps of single markers.
//!
//! Soft tissue displaces every marker slightly from its place on the link, and the pose is a
//! compromise between the markers. When one marker is missing, the pose jumps by that marker's
//! contribution, and jumps back when it returns. After two differentiations, such a step of a
//! millimetre is larger than the motion. If the marker was the only one that determined a rotation,
//! that rotation is undetermined. The frames of a short gap are therefore estimated again, all
//! together and with some frames on both sides ([`crate::passage`]): the motion that fits the
//! visible markers and is as smooth as the same motion is outside of its gaps. A missing marker is
//! replaced by a substitute at its place on the link plus its residual at the edges, in the link's
//! frame.
//!
//! Substitutes affect the pose only: they count neither in residuals nor in standard deviations.

use crate::frame::Solver;
use crate::passage::{Passage, Substitute, look};
use crate::problem::Problem;
use crate::roughness::Roughness;
use crate::tree::{NONE, quaternion};
use aloft_body::{JointKind, Motion};
use aloft_trial::Trial;
use nalgebra::{UnitQuaternion, Vector3};
use rayon::prelude::*;
use std::ops::Range;

/// Frames at each edge from which the rates of the cubics are taken.
const EDGE: usize = 3;
/// Stretch at each edge over which the residual of the marker is averaged, s. Its noise acts as a
/// constant force on the pose during the whole gap.
const RESIDUAL_S: f64 = 0.1;
/// Standard deviation of the difference between a joint and the cubic in the start of the estimate,
/// rad (m for prismatic joints).
const CUBIC_SD_RAD: f64 = 0.05;
/// Stretch on each side of a gap that is estimated with it, s. It gives rates at the edges.
const SIDE_S: f64 = 0.06;
/// Most frames estimated together, without the sides: more are cut into pieces that overlap by the
/// longest gap.
const TOGETHER: usize = 250;

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
    /// Links whose joints start from the cubic.
    branch: Vec<usize>,
}

/// Estimates the frames of short gaps again. Returns the number of frames with a gap.
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
    if of_frame.iter().all(Vec::is_empty) {
        return 0;
    }
    let side = ((SIDE_S * motion.rate_hz).round() as usize).max(2 * EDGE);
    let affected = smooth_coordinates(problem, &gaps, &(0..motion.n_frames()), 0);
    let roughness = Roughness::of(problem, trial, sources, motion, |f, j| !affected[f][j]);
    let (nq, nv, n) = (motion.nq, motion.nv, problem.markers.len());
    let pieces = pieces(&of_frame, side, longest);
    let changed = of_frame.iter().filter(|gaps| !gaps.is_empty()).count();
    let work = Work { problem, trial, sources, motion, gaps, of_frame, side, roughness };
    let solved: Vec<Vec<Bridged>> = pieces.par_iter().map(|piece| work.piece(piece)).collect();
    for bridged in solved.iter().flatten() {
        let f = bridged.frame;
        motion.q[f * nq..(f + 1) * nq].copy_from_slice(&bridged.q);
        if problem.deviations {
            motion.q_sd[f * nv..(f + 1) * nv].copy_from_slice(&bridged.q_sd);
        }
        motion.residual_m[f * n..(f + 1) * n].copy_from_slice(&bridged.residual_m);
    }
    changed
}

/// Frames that are estimated together, and those of them that are stored.
#[derive(Debug, Clone, PartialEq, Eq)]
struct Piece {
    stored: Range<usize>,
    together: Range<usize>,
}

/// Stretches of frames in gaps, joined where they are closer than a side.
fn pieces(of_frame: &[Vec<usize>], side: usize, longest: usize) -> Vec<Piece> {
    let n = of_frame.len();
    let mut stretches: Vec<Range<usize>> = Vec::new();
    for f in (0..n).filter(|&f| !of_frame[f].is_empty()) {
        match stretches.last_mut() {
            Some(last) if f <= last.end + side => last.end = f + 1,
            _ => stretches.push(f..f + 1),
        }
    }
    let mut out = Vec::new();
    for stretch in stretches {
        let count = stretch.len().div_ceil(TOGETHER);
        for i in 0..count {
            let cut = |i: usize| stretch.start + i * stretch.len() / count;
            let from = if i == 0 { side } else { side + longest };
            let to = if i + 1 == count { side } else { side + longest };
            let stored = cut(i)..cut(i + 1);
            out.push(Piece { together: stored.start.saturating_sub(from)..(stored.end + to).min(n), stored });
        }
    }
    out
}

struct Bridged {
    frame: usize,
    q: Vec<f64>,
    q_sd: Vec<f64>,
    residual_m: Vec<f64>,
}

/// A recording with its gaps.
struct Work<'a> {
    problem: &'a Problem,
    trial: &'a Trial,
    sources: &'a [usize],
    motion: &'a Motion,
    gaps: Vec<Gap>,
    /// Gaps of every solved frame.
    of_frame: Vec<Vec<usize>>,
    /// Frames on each side of a gap that are estimated with it.
    side: usize,
    roughness: Roughness,
}

impl Work<'_> {
    /// Estimates the frames of one piece again, those between two near gaps included; unsolved ones
    /// are not returned.
    fn piece(&self, piece: &Piece) -> Vec<Bridged> {
        let mut out = Vec::new();
        let mut at = piece.together.start;
        while at < piece.together.end {
            let solved = self.motion.is_valid(at);
            let other = (at..piece.together.end).find(|&f| self.motion.is_valid(f) != solved);
            let frames = at..other.unwrap_or(piece.together.end);
            at = frames.end;
            if solved && frames.clone().any(|f| piece.stored.contains(&f)) {
                out.extend(self.stretch(&frames, &piece.stored));
            }
        }
        out
    }

    /// Estimates successive solved frames together; returns those to be stored.
    fn stretch(&self, frames: &Range<usize>, stored: &Range<usize>) -> Vec<Bridged> {
        let Self { problem, trial, sources, motion, .. } = *self;
        let nv = problem.tree.nv;
        let mut solver = Solver::new(problem);
        let (mut q, substitutes): (Vec<Vec<f64>>, Vec<Vec<Substitute>>) =
            frames.clone().map(|f| self.start(f, &mut solver)).unzip();
        solver.rest_q.copy_from_slice(&problem.rest_q);
        solver.rest_weight.fill(problem.rest_weight);
        let rough = self.roughness.around(frames.clone());
        let smooth = smooth_coordinates(problem, &self.gaps, frames, self.side);
        let first = frames.start;
        let sd = Passage {
            solver: &mut solver,
            trial,
            sources,
            first,
            substitutes: &substitutes,
            smooth: &smooth,
            rough: &rough,
        }
        .minimise(&mut q);
        let scale = self.roughness.factor.sqrt();
        let result =
            frames.clone().zip(q).enumerate().filter(|(_, (f, _))| stored.contains(f)).map(|(i, (frame, q))| {
                look(&mut solver, trial, sources, frame);
                solver.evaluate(&q);
                let mut residual_m = vec![f64::NAN; problem.markers.len()];
                for &m in &solver.visible {
                    residual_m[m] = solver.residual[m].norm();
                }
                let mut q_sd = Vec::new();
                if problem.deviations {
                    q_sd.extend_from_slice(&motion.q_sd[frame * nv..(frame + 1) * nv]);
                    let smoothed = sd.iter().flat_map(|sd| sd[i].iter());
                    q_sd.iter_mut()
                        .zip(smoothed)
                        .filter(|(_, new)| new.is_finite())
                        .for_each(|(old, new)| *old = new * scale);
                }
                Bridged { frame, q, q_sd, residual_m }
            });
        result.collect()
    }

    /// Where the estimate of a frame starts, with its missing markers: from the visible markers,
    /// and from the cubics where these do not determine the pose. Frames without a gap start from
    /// their solution.
    fn start(&self, frame: usize, solver: &mut Solver<'_>) -> (Vec<f64>, Vec<Substitute>) {
        let (problem, tree) = (self.problem, &self.problem.tree);
        let mut q = self.motion.q(frame).to_vec();
        let gaps: Vec<&Gap> = self.of_frame[frame].iter().map(|&g| &self.gaps[g]).collect();
        if gaps.is_empty() {
            return (q, Vec::new());
        }
        solver.rest_q.copy_from_slice(&problem.rest_q);
        solver.rest_weight.fill(problem.rest_weight);
        for (gap, &link) in gaps.iter().flat_map(|gap| gap.branch.iter().map(move |link| (gap, link))) {
            let joint = &tree.links[link];
            cubic(self.motion, gap, frame, &joint.kind, joint.q_offset, &mut solver.rest_q);
            solver.rest_weight[link] = 1.0 / (CUBIC_SD_RAD * CUBIC_SD_RAD);
            if !problem.locked_link[link] {
                let at = joint.q_offset..joint.q_offset + joint.kind.nq();
                q[at.clone()].copy_from_slice(&solver.rest_q[at]);
            }
        }
        look(solver, self.trial, self.sources, frame);
        solver.minimize(&mut q);
        let substitute = |gap: &&Gap| {
            let share = (frame + 1 - gap.start) as f64 / (gap.end + 1 - gap.start) as f64;
            Substitute { marker: gap.marker, position: gap.before.lerp(&gap.after, share) }
        };
        let substitutes = gaps.iter().map(substitute).collect();
        (q, substitutes)
    }
}

/// Coordinates that are estimated as smooth in every frame: those of a link whose marker is
/// missing, of the links above it and of those that hang on it (an elbow's marker determines the
/// forearm, too), from one side of the gap to the other.
fn smooth_coordinates(problem: &Problem, gaps: &[Gap], frames: &Range<usize>, side: usize) -> Vec<Vec<bool>> {
    let tree = &problem.tree;
    let mut out = vec![vec![false; tree.nv]; frames.len()];
    for gap in gaps {
        let (from, to) = (gap.start.saturating_sub(side).max(frames.start), (gap.end + side).min(frames.end));
        let link = problem.markers[gap.marker].link;
        let near = |l: usize| tree.is_beyond(link, l) || tree.links[l].parent == link;
        let columns: Vec<usize> = (0..tree.nv).filter(|&j| near(tree.column_link[j]) && !problem.locked[j]).collect();
        for f in from..to.max(from) {
            columns.iter().for_each(|&j| out[f - frames.start][j] = true);
        }
    }
    out
}

/// One joint's coordinates in a gap: Hermite's cubic between the edges, rotations in the tangent
/// space of the first edge.
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
    let near = ((RESIDUAL_S * motion.rate_hz).round() as usize).max(1);
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
                let before = edge(start.saturating_sub(near), start);
                let after = edge(end, (end + near).min(n_frames));
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
