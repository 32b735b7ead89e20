//! A stretch of frames estimated together: the poses that fit the visible markers of every frame
//! and move smoothly.
//!
//! ```text
//!   minimise  Σ_f cost_f(q_f)  +  ½ Σ_f Σ_j (Δ³q)²_fj / v_j
//! ```
//!
//! cost_f is that of one frame (markers and soft priors, [`crate::frame`]); Δ³q is the third
//! difference over successive frames of coordinate j in the tangent space (rotations: the second
//! difference of the relative rotations of successive frames), and v_j its variance
//! ([`crate::roughness`]). The root has no such term: many markers determine it. This is the
//! discrete smoothing spline of degree five (white jerk: Wahba, *Spline Models for Observational
//! Data*, 1990, ch. 1) with the markers as measurements, minimised by damped Gauss-Newton steps.
//! The frames are coupled over three neighbours.

use crate::frame::Solver;
use crate::normal::Packed;
use crate::skyline::Skyline;
use crate::tree::{Tree, quaternion};
use aloft_body::JointKind;
use aloft_trial::Trial;
use nalgebra::{Matrix3, UnitQuaternion, Vector3};

/// Frames of a third difference.
const SPAN: usize = 4;
/// Rounds of placing the missing markers.
const ROUNDS: usize = 2;
/// Most steps of a round.
const STEPS: usize = 20;
/// Longest change of one coordinate in one step, rad or m.
const LONGEST: f64 = 0.5;
/// Change below which the steps end, rad or m.
const SETTLED: f64 = 1e-5;

/// A missing marker with the place that it is taken to have.
#[derive(Debug, Clone)]
pub(crate) struct Substitute {
    pub marker: usize,
    /// Position in the frame of its link, m: with the residual that the marker had at the edges of
    /// its gap.
    pub position: Vector3<f64>,
}

/// Shows the solver the markers of a frame.
pub(crate) fn look(solver: &mut Solver<'_>, trial: &Trial, sources: &[usize], frame: usize) {
    for (target, &source) in solver.targets.iter_mut().zip(sources) {
        *target = trial.markers.trajectories[source][frame];
    }
    solver.look();
}

/// Successive solved frames of a trial.
pub(crate) struct Passage<'a, 'b> {
    pub solver: &'a mut Solver<'b>,
    pub trial: &'a Trial,
    pub sources: &'a [usize],
    /// First frame.
    pub first: usize,
    /// Missing markers of every frame.
    pub substitutes: &'a [Vec<Substitute>],
    /// Coordinates that move smoothly in every frame: those of a link with all those above it. The
    /// others follow from their own frame alone.
    pub smooth: &'a [Vec<bool>],
    /// Variance of the third difference of every coordinate, in units of the frames' costs.
    pub rough: &'a [f64],
}

/// Linear equations of one step.
struct Equations {
    matrix: Skyline,
    /// Gradient of the smooth coordinates.
    gradient: Vec<f64>,
    /// Normal equations of every frame after the other coordinates were eliminated.
    frames: Vec<Packed>,
    /// Row of every smooth coordinate, `[frame][coordinate]`.
    row: Vec<Vec<Option<usize>>>,
}

impl Passage<'_, '_> {
    /// Minimises in place, one vector of coordinates a frame. Returns the standard deviation of
    /// every smooth coordinate in every frame (NaN for the others; for markers of the nominal
    /// deviation), if the problem asks for it.
    ///
    /// The first round uses the visible markers alone. In the others each missing marker stands
    /// where the pose of the round before carries it, displaced by its residual: the pose
    /// approaches the compromise that it would be with the marker, and what no visible marker
    /// determines moves by no more than these residuals.
    pub fn minimise(&mut self, q: &mut [Vec<f64>]) -> Option<Vec<Vec<f64>>> {
        let mut equations = self.form();
        let none: Vec<Vec<(usize, Vector3<f64>)>> = vec![Vec::new(); q.len()];
        self.settle(q, &none, &mut equations)?;
        for _ in 0..ROUNDS {
            let placed = self.placed(q);
            self.settle(q, &placed, &mut equations)?;
        }
        if !self.solver.problem.deviations {
            return None;
        }
        self.equations(q, &none, &mut equations)?;
        self.deviations(equations)
    }

    /// Places of the missing markers in the world at the poses `q`, m.
    fn placed(&self, q: &[Vec<f64>]) -> Vec<Vec<(usize, Vector3<f64>)>> {
        let problem = self.solver.problem;
        let mut pose = problem.tree.pose();
        let place = |(q, substitutes): (&Vec<f64>, &Vec<Substitute>)| {
            problem.tree.forward(q, &mut pose);
            let at = |s: &Substitute| {
                let link = problem.markers[s.marker].link;
                (s.marker, pose.origin[link] + pose.rotation[link] * s.position)
            };
            substitutes.iter().map(at).collect()
        };
        q.iter().zip(self.substitutes).map(place).collect()
    }

    /// Shows the solver a frame with its substitutes, and evaluates it.
    fn evaluate(&mut self, frame: usize, q: &[f64], placed: &[(usize, Vector3<f64>)]) -> f64 {
        look(self.solver, self.trial, self.sources, self.first + frame);
        for &(marker, place) in placed {
            self.solver.targets[marker] = place;
        }
        if !placed.is_empty() {
            self.solver.look();
        }
        self.solver.evaluate(q)
    }

    /// Minimises with fixed substitutes; `None` if a coordinate of a frame is undetermined.
    fn settle(&mut self, q: &mut [Vec<f64>], placed: &[Vec<(usize, Vector3<f64>)>], now: &mut Equations) -> Option<()> {
        let mut next: Vec<Vec<f64>> = q.to_vec();
        let mut cost = self.equations(q, placed, now)?;
        let mut damping = 0.0;
        for _ in 0..STEPS {
            let settled = loop {
                if damping > 1e6 {
                    break true;
                }
                if let Some(longest) = self.step(now, damping, q, &mut next) {
                    let there = self.cost(&next, placed);
                    if there <= cost + 1e-9 * cost.abs() || longest < 100.0 * SETTLED {
                        q.clone_from_slice(&next);
                        damping = if damping < 1e-6 { 0.0 } else { 0.1 * damping };
                        break longest < SETTLED;
                    }
                }
                damping = f64::max(1e-3, 10.0 * damping);
            };
            if settled {
                break;
            }
            cost = self.equations(q, placed, now)?;
        }
        Some(())
    }

    /// The zero equations.
    fn form(&self) -> Equations {
        let tree = &self.solver.problem.tree;
        let mut first = Vec::new();
        let mut row: Vec<Vec<Option<usize>>> = Vec::with_capacity(self.smooth.len());
        for (f, smooth) in self.smooth.iter().enumerate() {
            let mut of_frame: Vec<Option<usize>> = vec![None; tree.nv];
            for j in (0..tree.nv).filter(|&j| smooth[j]) {
                let own = first.len();
                let above = tree.ancestors[j].iter().find_map(|&a| of_frame[a]);
                // the first coordinate of the same part of the joint, three frames before or less
                let part = (0..=j)
                    .rev()
                    .take_while(|&k| tree.column_link[k] == tree.column_link[j] && smooth[k])
                    .last()
                    .unwrap_or(j);
                let run = (1..SPAN).take_while(|&d| d <= f && self.smooth[f - d][part]).last();
                let before = run.and_then(|d| row[f - d][part]);
                first.push(own.min(above.unwrap_or(own)).min(before.unwrap_or(own)));
                of_frame[j] = Some(own);
            }
            row.push(of_frame);
        }
        let gradient = vec![0.0; first.len()];
        Equations { matrix: Skyline::new(first), gradient, frames: vec![Packed::new(tree); row.len()], row }
    }

    /// One step from `q` to `next`; the longest change of a coordinate, rad or m.
    fn step(&self, equations: &Equations, damping: f64, q: &[Vec<f64>], next: &mut [Vec<f64>]) -> Option<f64> {
        let tree = &self.solver.problem.tree;
        let mut matrix = equations.matrix.clone();
        matrix.damp(damping);
        if !matrix.factorise() {
            return None;
        }
        let mut smooth: Vec<f64> = equations.gradient.iter().map(|g| -g).collect();
        matrix.solve(&mut smooth);
        let mut longest: f64 = 0.0;
        let steps: Vec<Vec<f64>> = (equations.frames.iter().zip(&equations.row))
            .zip(self.smooth)
            .map(|((normal, row), keep)| {
                let mut step: Vec<f64> = row.iter().map(|row| row.map_or(0.0, |row| smooth[row])).collect();
                normal.complete(tree, keep, &mut step);
                longest = step.iter().fold(longest, |m, s| m.max(s.abs()));
                step
            })
            .collect();
        if !longest.is_finite() {
            return None;
        }
        let scale = if longest > LONGEST { LONGEST / longest } else { 1.0 };
        for ((next, q), mut step) in next.iter_mut().zip(q).zip(steps) {
            step.iter_mut().for_each(|s| *s *= scale);
            tree.retract(q, &step, next);
        }
        Some(longest)
    }

    fn deviations(&self, equations: Equations) -> Option<Vec<Vec<f64>>> {
        let Equations { mut matrix, row, .. } = equations;
        if !matrix.factorise() {
            return None;
        }
        let variances = matrix.variances();
        let sd = |row: &Option<usize>| row.map_or(f64::NAN, |row| variances[row].max(0.0).sqrt());
        Some(row.iter().map(|of_frame| of_frame.iter().map(sd).collect()).collect())
    }

    /// Cost at `q`.
    fn cost(&mut self, q: &[Vec<f64>], placed: &[Vec<(usize, Vector3<f64>)>]) -> f64 {
        let mut cost = 0.0;
        for (i, (q, placed)) in q.iter().zip(placed).enumerate() {
            cost += self.evaluate(i, q, placed);
        }
        cost + self.smoothness(q, |_, _| {})
    }

    /// Fills the equations at `q`; the cost, or `None` if a coordinate of a frame is undetermined.
    fn equations(&mut self, q: &[Vec<f64>], placed: &[Vec<(usize, Vector3<f64>)>], out: &mut Equations) -> Option<f64> {
        let tree = &self.solver.problem.tree;
        out.matrix.clear();
        let mut cost = 0.0;
        for (i, (q, placed)) in q.iter().zip(placed).enumerate() {
            cost += self.evaluate(i, q, placed);
            let normal = &mut out.frames[i];
            normal.clone_from(self.solver.equations(q));
            if !normal.reduce(tree, &self.smooth[i]) {
                return None;
            }
            for j in 0..tree.nv {
                let Some(row) = out.row[i][j] else { continue };
                let at = normal.start[j];
                for (k, &above) in tree.ancestors[j].iter().chain([&j]).enumerate() {
                    if let Some(column) = out.row[i][above] {
                        out.matrix.add(row, column, normal.values[at + k]);
                    }
                }
                out.gradient[row] = normal.gradient[j];
            }
        }
        let Equations { matrix, gradient, row, .. } = out;
        cost += self.smoothness(q, |i, third| {
            let weight = Vector3::from_fn(|k, _| if k < third.n { 1.0 / self.rough[third.column + k] } else { 0.0 });
            let weighted = third.value.component_mul(&weight);
            for (a, x) in third.slopes.iter().enumerate() {
                let pull = x.tr_mul(&weighted);
                for k in 0..third.n {
                    let Some(here) = row[i + a][third.column + k] else { continue };
                    gradient[here] += pull[k];
                    for (b, y) in third.slopes[..=a].iter().enumerate() {
                        for l in 0..if a == b { k + 1 } else { third.n } {
                            if let Some(there) = row[i + b][third.column + l] {
                                let both = x.column(k).component_mul(&weight).dot(&y.column(l));
                                matrix.add(here, there, both);
                            }
                        }
                    }
                }
            }
        });
        Some(cost)
    }

    /// Part of the cost for third differences; calls `each(frame, difference)`.
    fn smoothness(&self, q: &[Vec<f64>], mut each: impl FnMut(usize, &Third)) -> f64 {
        let tree = &self.solver.problem.tree;
        let rates: Vec<Vec<f64>> = q.windows(2).map(|pair| change(tree, &pair[0], &pair[1])).collect();
        let mut cost = 0.0;
        for i in 0..(q.len() + 1).saturating_sub(SPAN) {
            for link in &tree.links {
                let (n, turns) = match link.kind {
                    JointKind::Spherical => (3, true),
                    JointKind::Revolute(_) | JointKind::Prismatic(_) => (1, false),
                    JointKind::Free | JointKind::Fixed => continue,
                };
                let columns = link.v_offset..link.v_offset + n;
                if (i..i + SPAN).all(|f| columns.clone().all(|j| self.smooth[f][j])) {
                    let third = Third::new(&rates[i..i + SPAN - 1], link.v_offset, n, turns);
                    cost += columns.zip(third.value.iter()).map(|(j, e)| 0.5 * e * e / self.rough[j]).sum::<f64>();
                    each(i, &third);
                }
            }
        }
        cost
    }
}

/// Third difference of one joint over four successive frames, and its derivatives by the steps of
/// these frames.
struct Third {
    /// First coordinate.
    column: usize,
    /// Number of coordinates.
    n: usize,
    value: Vector3<f64>,
    slopes: [Matrix3<f64>; 4],
}

impl Third {
    /// From the changes between the frames. The relative rotation u = log(AᵀB) changes by (I +
    /// ½[u]) b − (I − ½[u]) a when the two rotations are stepped by a and b in their own axes (to
    /// first order in u; Solà, Deray and Atchuthan, *A micro Lie theory for state estimation in
    /// robotics*, 2018, appendix B).
    fn new(rates: &[Vec<f64>], column: usize, n: usize, turns: bool) -> Self {
        let rate = |i: usize| Vector3::from_fn(|k, _| if k < n { rates[i][column + k] } else { 0.0 });
        let u = [rate(0), rate(1), rate(2)];
        let half = |u: &Vector3<f64>| if turns { 0.5 * u.cross_matrix() } else { Matrix3::zeros() };
        let after = u.map(|u| Matrix3::identity() + half(&u));
        let before = u.map(|u| Matrix3::identity() - half(&u));
        let slopes = [-before[0], after[0] + 2.0 * before[1], -2.0 * after[1] - before[2], after[2]];
        Self { column, n, value: u[2] - 2.0 * u[1] + u[0], slopes }
    }
}

/// Change of the joints from one pose to another in the tangent space, rotations in the axes of the
/// moving link; zero for the root.
pub(crate) fn change(tree: &Tree, from: &[f64], to: &[f64]) -> Vec<f64> {
    let mut out = vec![0.0; tree.nv];
    let turn = |at: usize| -> Vector3<f64> {
        let (a, b): (UnitQuaternion<f64>, UnitQuaternion<f64>) =
            (quaternion(&from[at..at + 4]), quaternion(&to[at..at + 4]));
        (a.inverse() * b).scaled_axis()
    };
    for link in &tree.links {
        let (iq, iv) = (link.q_offset, link.v_offset);
        match link.kind {
            JointKind::Spherical => out[iv..iv + 3].copy_from_slice(turn(iq).as_slice()),
            JointKind::Revolute(_) | JointKind::Prismatic(_) => out[iv] = to[iq] - from[iq],
            JointKind::Free | JointKind::Fixed => {}
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Slopes of the third difference of rotations against differences of the function itself.
    #[test]
    fn slopes_of_the_third_difference_are_its_derivatives() {
        let turn = |v: Vector3<f64>| UnitQuaternion::from_scaled_axis(v);
        let frame = |i: usize| turn(Vector3::new(0.3, -0.2, 0.5) + Vector3::new(0.02, 0.03, -0.01) * (i * i) as f64);
        let rates = |q: &[UnitQuaternion<f64>]| -> Vec<Vec<f64>> {
            q.windows(2).map(|p| (p[0].inverse() * p[1]).scaled_axis().as_slice().to_vec()).collect()
        };
        let q: Vec<UnitQuaternion<f64>> = (0..SPAN).map(frame).collect();
        let third = Third::new(&rates(&q), 0, 3, true);
        for (f, slope) in third.slopes.iter().enumerate() {
            for k in 0..3 {
                let step = Vector3::ith(k, 1e-6);
                let at = |sign: f64| {
                    let mut moved = q.clone();
                    moved[f] *= turn(step * sign);
                    Third::new(&rates(&moved), 0, 3, true).value
                };
                let expected = (at(1.0) - at(-1.0)) / 2e-6;
                // the slopes are of first order in the rotation between two frames, here 0.1 to 0.2
                // rad
                assert!((slope.column(k) - expected).norm() < 0.01, "frame {f}: {slope} {expected}");
            }
        }
    }
}
