//! One frame: damped Gauss-Newton on the manifold of joint coordinates.

use crate::normal::{Moments, Packed};
use crate::problem::{FEWEST_MARKERS, Problem};
use crate::tree::{Pose, quaternion};
use aloft_body::JointKind;
use nalgebra::Vector3;

/// A step is skipped if its predicted gain is below this fraction of the tolerance.
const FORESEEN: f64 = 1e-2;

/// Result of a minimisation.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Fit {
    /// ½ Σ w r² plus the soft priors.
    pub cost: f64,
    pub iterations: usize,
    pub converged: bool,
}

/// Scratch memory for one sequence of frames. Nothing is allocated after construction.
#[derive(Debug, Clone)]
pub(crate) struct Solver<'a> {
    pub problem: &'a Problem,
    /// Measured positions of the problem's markers, m; NaN where missing.
    pub targets: Vec<Vector3<f64>>,
    /// Visible markers.
    pub visible: Vec<usize>,
    pub pose: Pose,
    /// Model minus measured, m, of the visible markers at the last evaluation.
    pub residual: Vec<Vector3<f64>>,
    moments: Vec<Moments>,
    normal: Packed,
    pub factor: Packed,
    pub inverse: Packed,
    /// Coordinates to which joints are attracted.
    pub rest_q: Vec<f64>,
    /// Weight of the attraction, by link, 1/rad² (1/m² for prismatic joints).
    pub rest_weight: Vec<f64>,
    step: Vec<f64>,
    q_try: Vec<f64>,
    /// True if `factor` is valid for the result of the last minimisation.
    factor_serves: bool,
    /// True if `moments` have already been accumulated towards the root.
    gathered: bool,
}

impl<'a> Solver<'a> {
    pub fn new(problem: &'a Problem) -> Self {
        let tree = &problem.tree;
        let n = problem.markers.len();
        let packed = Packed::new(tree);
        Self {
            problem,
            targets: vec![Vector3::repeat(f64::NAN); n],
            visible: Vec::with_capacity(n),
            pose: tree.pose(),
            residual: vec![Vector3::zeros(); n],
            moments: vec![Moments::default(); tree.links.len()],
            normal: packed.clone(),
            factor: packed.clone(),
            inverse: packed,
            rest_q: problem.rest_q.clone(),
            rest_weight: vec![problem.rest_weight; tree.links.len()],
            step: vec![0.0; tree.nv],
            q_try: vec![0.0; tree.nq],
            factor_serves: false,
            gathered: false,
        }
    }

    /// Records which targets are visible. False if there are too few to start.
    pub fn look(&mut self) -> bool {
        self.visible.clear();
        for (i, target) in self.targets.iter().enumerate() {
            if target.x.is_finite() && target.y.is_finite() && target.z.is_finite() {
                self.visible.push(i);
            }
        }
        self.visible.len() >= FEWEST_MARKERS
    }

    /// Cost at `q`; also updates poses, residuals and moments.
    pub fn evaluate(&mut self, q: &[f64]) -> f64 {
        let problem = self.problem;
        self.gathered = false;
        self.factor_serves = false;
        problem.tree.forward(q, &mut self.pose);
        let reference = self.pose.origin[0];
        self.moments.fill(Moments::default());
        let mut cost = 0.0;
        for &i in &self.visible {
            let marker = &problem.markers[i];
            let point = self.pose.origin[marker.link] + self.pose.rotation[marker.link] * marker.position;
            let residual = point - self.targets[i];
            let squared = residual.norm_squared();
            let mut weight = marker.weight;
            if squared > marker.huber * marker.huber {
                let distance = squared.sqrt();
                cost += weight * marker.huber * (distance - 0.5 * marker.huber);
                weight *= marker.huber / distance;
            } else {
                cost += 0.5 * weight * squared;
            }
            self.residual[i] = residual;
            self.moments[marker.link].add_point(&(point - reference), weight, &residual);
        }
        cost + self.prior_cost(q)
    }

    fn prior_cost(&self, q: &[f64]) -> f64 {
        let problem = self.problem;
        let mut cost = 0.0;
        for (link, weight) in problem.tree.links.iter().zip(&self.rest_weight) {
            let at = link.q_offset;
            match link.kind {
                JointKind::Spherical => {
                    let dot: f64 = (at..at + 4).map(|i| q[i] * self.rest_q[i]).sum();
                    cost += 2.0 * weight * (1.0 - dot * dot);
                }
                JointKind::Revolute(_) | JointKind::Prismatic(_) => {
                    cost += 0.5 * weight * (q[at] - self.rest_q[at]).powi(2);
                }
                JointKind::Free | JointKind::Fixed => {}
            }
        }
        for hinge in &problem.hinges {
            let excess = self.limit_excess(hinge.flexion(q[hinge.q_index]));
            cost += 0.5 * problem.limit_weight * excess * excess;
        }
        for limit in &problem.limits {
            let [swing, twist] = limit.excess(&q[limit.q_index..limit.q_index + 4]);
            if swing != 0.0 || twist != 0.0 {
                cost += 0.5 * problem.limit_weight * (swing * swing + twist * twist);
            }
        }
        cost
    }

    /// Joints beyond their ranges at `q`: link and excess, rad.
    pub fn beyond(&self, q: &[f64]) -> impl Iterator<Item = (usize, f64)> + '_ {
        let problem = self.problem;
        let hinges: Vec<(usize, f64)> =
            problem.hinges.iter().map(|h| (h.link, self.limit_excess(h.flexion(q[h.q_index])).abs())).collect();
        let others: Vec<(usize, f64)> = problem
            .limits
            .iter()
            .map(|l| (l.link, l.excess(&q[l.q_index..l.q_index + 4]).map(f64::abs).into_iter().fold(0.0, f64::max)))
            .collect();
        hinges.into_iter().chain(others).filter(|(_, excess)| *excess > 0.0)
    }

    /// Signed excess of a flexion beyond the soft limits, rad.
    fn limit_excess(&self, flexion: f64) -> f64 {
        if flexion < -self.problem.overextension {
            flexion + self.problem.overextension
        } else if flexion > self.problem.flexion_limit {
            flexion - self.problem.flexion_limit
        } else {
            0.0
        }
    }

    /// Normal equations at the last evaluated `q`.
    fn linearise(&mut self, q: &[f64]) {
        if self.gathered {
            self.evaluate(q);
        }
        self.gathered = true;
        let problem = self.problem;
        let tree = &problem.tree;
        tree.columns(&mut self.pose);
        self.normal.assemble(tree, &self.pose, &mut self.moments);
        for (link, &weight) in tree.links.iter().zip(&self.rest_weight) {
            let (iq, iv) = (link.q_offset, link.v_offset);
            match link.kind {
                JointKind::Spherical => {
                    let turn = quaternion(&self.rest_q[iq..iq + 4]).inverse() * quaternion(&q[iq..iq + 4]);
                    let pull = turn.imag() * (2.0 * turn.w * weight);
                    for i in 0..3 {
                        self.normal.gradient[iv + i] += pull[i];
                        let at = self.normal.diagonal(tree, iv + i);
                        self.normal.values[at] += weight;
                    }
                }
                JointKind::Revolute(_) | JointKind::Prismatic(_) => {
                    self.normal.gradient[iv] += weight * (q[iq] - self.rest_q[iq]);
                    let at = self.normal.diagonal(tree, iv);
                    self.normal.values[at] += weight;
                }
                JointKind::Free | JointKind::Fixed => {}
            }
        }
        for hinge in &problem.hinges {
            let excess = self.limit_excess(hinge.flexion(q[hinge.q_index]));
            if excess != 0.0 {
                self.normal.gradient[hinge.v_index] += problem.limit_weight * excess * hinge.sense;
                let at = self.normal.diagonal(tree, hinge.v_index);
                self.normal.values[at] += problem.limit_weight;
            }
        }
        for limit in &problem.limits {
            let at_q = &q[limit.q_index..limit.q_index + 4];
            let excess = limit.excess(at_q);
            if excess == [0.0; 2] {
                continue;
            }
            for (e, slope) in excess.iter().zip(limit.slopes(at_q)) {
                let size: f64 = slope.iter().map(|s| s.abs()).sum();
                for (i, s) in slope.iter().enumerate() {
                    self.normal.gradient[limit.v_index + i] += problem.limit_weight * e * s;
                    // sums of rows on the diagonal bound the block from above
                    let at = self.normal.diagonal(tree, limit.v_index + i);
                    self.normal.values[at] += problem.limit_weight * s.abs() * size;
                }
            }
        }
        if problem.any_locked {
            self.normal.lock(tree, &problem.locked);
        }
    }

    /// Minimises in place, starting from `q`. Afterwards poses and residuals belong to the result.
    pub fn minimize(&mut self, q: &mut [f64]) -> Fit {
        let problem = self.problem;
        let tree = &problem.tree;
        let mut cost = self.evaluate(q);
        let mut damping = 0.0;
        let mut fit = Fit { cost, iterations: 0, converged: false };
        // Gain of the previous step, if it was a full one.
        let mut gain_before = None;
        while fit.iterations < problem.max_iterations {
            self.linearise(q);
            let accepted = loop {
                if damping > 1e9 {
                    break None;
                }
                if !self.factor.factorise(tree, &self.normal, damping) {
                    damping = f64::max(1e-6, 10.0 * damping);
                    continue;
                }
                for (step, gradient) in self.step.iter_mut().zip(&self.normal.gradient) {
                    *step = -gradient;
                }
                self.factor.solve(tree, &mut self.step);
                let gain: f64 = -self.step.iter().zip(&self.normal.gradient).map(|(s, g)| s * g).sum::<f64>();
                let longest = self.step.iter().fold(0.0, |m: f64, s| m.max(s.abs()));
                let full = damping == 0.0 && longest <= 1.0;
                if longest > 1.0 {
                    self.step.iter_mut().for_each(|s| *s /= longest);
                }
                tree.retract(q, &self.step, &mut self.q_try);
                let q_try = std::mem::take(&mut self.q_try);
                let cost_try = self.evaluate(&q_try);
                self.q_try = q_try;
                fit.iterations += 1;
                if cost_try <= cost + 1e-12 * cost + 1e-12 {
                    break Some((cost_try, gain, full));
                }
                if fit.iterations >= problem.max_iterations {
                    break None;
                }
                damping = f64::max(1e-3, 10.0 * damping);
            };
            let Some((cost_new, gain, full)) = accepted else {
                cost = self.evaluate(q);
                break;
            };
            q.copy_from_slice(&self.q_try);
            cost = cost_new;
            // Full steps converge at least linearly: predict the gain of the next one.
            let next = match gain_before {
                Some(before) if full && gain < before => gain * (gain / before),
                _ => gain,
            };
            if gain < problem.tolerance || next < FORESEEN * problem.tolerance {
                fit.converged = true;
                self.factor_serves = damping == 0.0;
                break;
            }
            gain_before = full.then_some(gain);
            damping = if damping < 1e-6 { 0.0 } else { 0.1 * damping };
        }
        fit.cost = cost;
        fit
    }

    /// Weight of a marker at the last evaluation, 1/m².
    pub fn weight(&self, marker: usize) -> f64 {
        let distance = self.residual[marker].norm();
        let marker = &self.problem.markers[marker];
        if distance > marker.huber { marker.weight * marker.huber / distance } else { marker.weight }
    }

    /// Normal equations at `q`, which must be the last evaluated one.
    pub fn equations(&mut self, q: &[f64]) -> &Packed {
        self.linearise(q);
        &self.normal
    }

    /// Factorises the normal equations at `q`, which must be the last evaluated one. False if a
    /// coordinate is undetermined.
    pub fn prepare(&mut self, q: &[f64]) -> bool {
        self.linearise(q);
        self.factor.factorise(&self.problem.tree, &self.normal, 0.0)
    }

    /// Covariance at `q` for markers of their nominal variance, into [`Solver::inverse`]. False if
    /// a coordinate is undetermined.
    ///
    /// After a converged minimisation its last factor is reused (one small step before `q`).
    pub fn covariance(&mut self, q: &[f64]) -> bool {
        if !self.factor_serves && !self.prepare(q) {
            return false;
        }
        // Without standard deviations only the root's are needed.
        let rows = if self.problem.deviations { self.problem.tree.nv } else { 6 };
        self.inverse.invert(&self.problem.tree, &self.factor, rows);
        true
    }

    /// Variance of one coordinate from [`Solver::covariance`].
    pub fn variance(&self, column: usize) -> f64 {
        self.inverse.values[self.inverse.diagonal(&self.problem.tree, column)]
    }

    /// Ratio of the residuals' variance to the nominal one, by degrees of freedom. Needs
    /// [`Solver::covariance`].
    pub fn variance_factor(&self) -> f64 {
        let problem = self.problem;
        let chi2: f64 = self.visible.iter().map(|&i| problem.markers[i].weight * self.residual[i].norm_squared()).sum();
        let mut spent = 0.0;
        for (column, locked) in problem.locked.iter().enumerate() {
            let link = problem.tree.column_link[column];
            let prior = match problem.tree.links[link].kind {
                JointKind::Free | JointKind::Fixed => 0.0,
                _ => self.rest_weight[link],
            };
            if !locked {
                spent += 1.0 - (prior * self.variance(column)).min(1.0);
            }
        }
        chi2 / f64::max(1.0, 3.0 * self.visible.len() as f64 - spent)
    }

    /// Root mean square of the visible residuals, m.
    pub fn rms(&self) -> f64 {
        let sum: f64 = self.visible.iter().map(|&i| self.residual[i].norm_squared()).sum();
        (sum / self.visible.len() as f64).sqrt()
    }
}
