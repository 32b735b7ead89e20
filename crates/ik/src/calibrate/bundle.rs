//! Joint estimation of geometry and postures.

use super::CalibrateOptions;
use super::blocks::{Equations, Spread, parts};
use super::geometry_error::GeometryError;
use super::reference::Reference;
use super::select::FrameId;
use crate::IkError;
use crate::frame::Solver;
use crate::problem::Problem;
use crate::tree::NONE;
use aloft_body::{GeometryEquations, JointKind, Motion, PostureFactor, Subject};
use aloft_trial::Trial;
use nalgebra::{DMatrix, DVector, Matrix3, Vector3};
use rayon::prelude::*;
use std::ops::Range;

/// Frames whose postures are settled together; fixed, so that sums do not depend on the number of
/// threads.
const PIECE: usize = 16;

/// Median length of a vector with three independent normal components of standard deviation 1.
const MEDIAN_LENGTH: f64 = 1.538;

/// Standard deviation per component of vectors with these lengths, from their median; 0 without
/// vectors. Reorders the slice.
fn typical_deviation(lengths: &mut [f64]) -> f64 {
    aloft_signal::upper_median(lengths).map_or(0.0, |median| median / MEDIAN_LENGTH)
}

/// One frame with its posture.
#[derive(Debug, Clone)]
pub(super) struct Frame {
    /// Measured positions of the problem's markers, m.
    pub(super) targets: Vec<Vector3<f64>>,
    /// Posture, with hinge angles relative to the static posture.
    pub(super) q: Vec<f64>,
    pub(super) is_static: bool,
}

/// Index of each unknown in the parameter vector.
#[derive(Debug, Clone)]
pub(super) struct Layout {
    /// Of each tracked marker.
    pub(super) marker: Vec<usize>,
    /// Of each link's joint centre, `NONE` if it has none.
    pub(super) centre: Vec<usize>,
    /// Of each hinge axis, `NONE` for other joints.
    pub(super) axis: Vec<usize>,
    pub(super) size: usize,
}

impl Layout {
    /// Unknowns of each centre and each axis.
    fn joints(&self) -> Vec<Range<usize>> {
        let of = |at: &Vec<usize>, n| at.iter().filter(|a| **a != NONE).map(move |a| *a..a + n).collect::<Vec<_>>();
        [of(&self.centre, 3), of(&self.axis, 2)].concat()
    }
}

/// Posterior standard deviations.
#[derive(Debug, Clone)]
pub(crate) struct Uncertainty {
    /// Of each link's joint centre, m, root mean square over axes; NaN for the root.
    pub centre_m: Vec<f64>,
    /// Of each hinge's axis, rad; NaN elsewhere.
    pub axis_rad: Vec<f64>,
}

/// State of a calibration.
#[derive(Debug, Clone)]
pub(crate) struct Bundle {
    /// Weights of a moving frame.
    pub(super) moving: Problem,
    /// The same with the weights for the static posture.
    standing: Problem,
    /// Index of the subject's marker for each tracked one.
    pub(super) marker_of: Vec<usize>,
    /// Geometry from landmarks: centre of the priors.
    landmarks: Reference,
    pub(super) present: Reference,
    pub(super) frames: Vec<Frame>,
    /// Frames of each block ([`super::blocks`]).
    pub(super) parts: Vec<Range<usize>>,
    pub(super) layout: Layout,
    /// Inverse variance of each unknown's prior.
    pub(super) precision: DVector<f64>,
    /// How far blocks of frames see the joints from each other.
    pub(super) spread: Spread,
}

/// Posture of a frame at its minimum, with coordinates that are not free.
pub(super) struct Settled<'s, 'p> {
    pub(super) solver: &'s Solver<'p>,
    pub(super) locked: &'s [bool],
}

impl PostureFactor for Settled<'_, '_> {
    // H = LᵀDL, so H_pq H⁻¹ H_qp = (L⁻ᵀH_qp)ᵀ D⁻¹ (L⁻ᵀH_qp)
    fn half_solve(&self, x: &mut [f64]) {
        for (value, locked) in x.iter_mut().zip(self.locked) {
            if *locked {
                *value = 0.0;
            }
        }
        self.solver.factor.solve_upper(&self.solver.problem.tree, x);
    }
    fn inverse_pivot(&self, k: usize) -> f64 {
        let factor = &self.solver.factor;
        1.0 / factor.values[factor.diagonal(&self.solver.problem.tree, k)]
    }
}

impl Bundle {
    pub fn new(
        subject: &Subject,
        mut problem: Problem,
        landmarks: &Reference,
        present: Reference,
        used: &[FrameId],
        trials: &[&Trial],
        motions: &[&Motion],
        options: &CalibrateOptions,
    ) -> Self {
        problem.markers.retain(|m| trials.iter().any(|t| t.markers.index(&m.label).is_some()));
        let marker_of: Vec<usize> = problem.markers.iter().filter_map(|m| subject.marker_index(&m.label)).collect();
        // Centres of the priors, in the frames of the present subject, because orientation and
        // angles refer to it.
        let landmarks =
            Reference { rotation: present.rotation.clone(), angle: present.angle.clone(), ..landmarks.clone() };
        problem.hinges.clear();
        problem.limits.clear();
        let mut frames = Vec::with_capacity(used.len() + 1);
        let rezeroed = |q: &[f64], problem: &Problem| {
            let mut q = q.to_vec();
            for (i, link) in problem.tree.links.iter().enumerate() {
                if let JointKind::Revolute(_) = link.kind {
                    q[link.q_offset] -= present.angle[i];
                }
            }
            q
        };
        problem.rest_q = rezeroed(&problem.rest_q, &problem);
        frames.push(Frame {
            targets: marker_of.iter().map(|&m| landmarks.marker[m]).collect(),
            q: problem.rest_q.clone(),
            is_static: true,
        });
        let mut distances: Vec<Vec<f64>> = vec![Vec::new(); problem.markers.len()];
        for id in used {
            let markers = &trials[id.trial].markers;
            let targets = problem
                .markers
                .iter()
                .map(|m| {
                    let place = markers.index(&m.label).and_then(|i| markers.trajectories[i].get(id.frame));
                    place.copied().unwrap_or(Vector3::repeat(f64::NAN))
                })
                .collect();
            let motion = motions[id.trial];
            let n = motion.marker_labels.len();
            let residuals = &motion.residual_m[id.frame * n..(id.frame + 1) * n];
            for (label, r) in motion.marker_labels.iter().zip(residuals).filter(|(_, r)| r.is_finite()) {
                if let Some(k) = problem.markers.iter().position(|m| m.label == *label) {
                    distances[k].push(*r);
                }
            }
            frames.push(Frame { targets, q: rezeroed(motion.q(id.frame), &problem), is_static: false });
        }
        // Each marker has its own error level: skin over the trunk moves farther than skin over the
        // foot.
        let noise_m: Vec<f64> =
            distances.iter_mut().map(|d| options.marker_noise_m.max(typical_deviation(d))).collect();
        for (marker, noise_m) in problem.markers.iter_mut().zip(&noise_m) {
            marker.weight *= (options.ik.marker_sd_m / noise_m).powi(2);
            marker.huber = options.huber_factor * MEDIAN_LENGTH * noise_m;
        }
        let weighed = |factor: f64| {
            let mut problem = problem.clone();
            problem.markers.iter_mut().for_each(|m| m.weight *= factor);
            problem.rest_weight *= factor;
            problem
        };
        let (layout, precision) = lay_out(&problem, options);
        let mut bundle = Self {
            moving: weighed(options.frame_weight),
            standing: weighed(options.static_weight),
            marker_of,
            landmarks,
            present,
            // the static posture is the first frame
            parts: parts(std::iter::once(None).chain(used.iter().map(|id| Some(id.trial)))),
            frames,
            spread: Spread::none(layout.joints()),
            layout,
            precision,
        };
        bundle.apply();
        bundle
    }

    fn apply(&mut self) {
        self.present.apply(&mut self.moving, &self.marker_of);
        self.present.apply(&mut self.standing, &self.marker_of);
    }

    /// Minimises, with the spread of the blocks that an earlier round found and then with its own;
    /// returns the number of steps.
    pub fn run(&mut self, options: &CalibrateOptions, spread: Option<Spread>) -> Result<usize, IkError> {
        if let Some(spread) = spread {
            self.spread = spread;
        }
        let steps = self.descend(options)?;
        let found = self.spread.estimated(&self.blocks(), &self.precision, &self.deviation());
        self.spread = found.ok_or_else(|| self.failure("the normal equations are not positive definite"))?;
        Ok(steps + self.descend(options)?)
    }

    fn descend(&mut self, options: &CalibrateOptions) -> Result<usize, IkError> {
        let (mut cost, mut matrix, mut gradient) = self.settled()?;
        let mut damping = 0.0;
        let mut steps = 0;
        while steps < options.max_iterations {
            let (frames, present) = (self.frames.clone(), self.present.clone());
            loop {
                steps += 1;
                let mut damped = matrix.clone();
                for i in 0..self.layout.size {
                    damped[(i, i)] *= 1.0 + damping;
                }
                let Some(factor) = damped.cholesky() else {
                    return Err(self.failure("the normal equations are not positive definite"));
                };
                let step = -factor.solve(&gradient);
                self.advance(&present, &step);
                let tried = self.settled()?;
                let gain = -step.dot(&gradient);
                if tried.0 <= cost {
                    let converged = gain < 1e-4 * (1.0 + tried.0.abs());
                    (cost, matrix, gradient) = tried;
                    damping = if damping < 1e-3 { 0.0 } else { 0.1 * damping };
                    if converged {
                        return Ok(steps);
                    }
                    break;
                }
                self.frames.clone_from(&frames);
                self.present = present.clone();
                self.apply();
                if steps >= options.max_iterations || gain < 1e-6 * (1.0 + cost.abs()) {
                    return Ok(steps);
                }
                damping = f64::max(1e-2, 10.0 * damping);
            }
        }
        Ok(steps)
    }

    /// Minimises the postures; cost, normal matrix and gradient of the geometry.
    fn settled(&mut self) -> Result<(f64, DMatrix<f64>, DVector<f64>), IkError> {
        let cost = self.settle() + self.prior_cost();
        let found = self.spread.together(&self.blocks());
        let ((mut matrix, mut gradient), less) =
            found.ok_or_else(|| self.failure("the normal equations are not finite"))?;
        let deviation = self.deviation();
        for i in 0..self.layout.size {
            matrix[(i, i)] += self.precision[i];
            gradient[i] += self.precision[i] * deviation[i];
        }
        Ok((cost - less, matrix, gradient))
    }

    fn failure(&self, problem: &'static str) -> IkError {
        IkError::Calibration { subject: self.moving.tree.links[0].name.clone(), frames: self.frames.len(), problem }
    }

    /// Minimises the cost of every posture for the present geometry; returns the sum of the costs.
    fn settle(&mut self) -> f64 {
        let (moving, standing) = (&self.moving, &self.standing);
        let costs: Vec<f64> = self
            .frames
            .par_chunks_mut(PIECE)
            .map(|piece| {
                let mut cost = 0.0;
                for frame in piece {
                    let mut solver = Solver::new(if frame.is_static { standing } else { moving });
                    solver.targets.copy_from_slice(&frame.targets);
                    if solver.look() {
                        cost += solver.minimize(&mut frame.q).cost;
                    }
                }
                cost
            })
            .collect();
        costs.iter().sum()
    }

    /// Normal equations of the geometry of each block, each frame's posture eliminated.
    fn blocks(&self) -> Vec<Equations> {
        let of = |piece: &[Frame]| {
            let mut sums = GeometryEquations::new(self.layout.size, self.moving.tree.nv);
            let mut scratch = Scratch::new(self);
            for frame in piece {
                self.add_frame(frame, &mut scratch, &mut sums);
            }
            sums.finish()
        };
        self.parts.par_iter().map(|part| of(&self.frames[part.clone()])).collect()
    }

    /// The equations of a frame's posture, and in `scratch` the rotation of each link since the
    /// static posture; none for a frame that shows too few markers.
    pub(super) fn solver_at(&self, frame: &Frame, scratch: &mut Scratch) -> Option<Solver<'_>> {
        let mut solver = Solver::new(if frame.is_static { &self.standing } else { &self.moving });
        solver.targets.copy_from_slice(&frame.targets);
        if !solver.look() {
            return None;
        }
        solver.evaluate(&frame.q);
        if !solver.prepare(&frame.q) {
            return None;
        }
        for (i, turned) in scratch.turned.iter_mut().enumerate() {
            *turned = solver.pose.rotation[i] * self.present.rotation[i].transpose();
        }
        Some(solver)
    }

    fn add_frame(&self, frame: &Frame, scratch: &mut Scratch, sums: &mut GeometryEquations) {
        let Some(solver) = self.solver_at(frame, scratch) else { return };
        for &k in &solver.visible {
            self.columns_of(k, &frame.q, &solver, scratch);
            sums.add_point(solver.weight(k), &solver.residual[k], &scratch.columns, &scratch.motions);
        }
        let problem = if frame.is_static { &self.standing } else { &self.moving };
        sums.eliminate_posture(&Settled { solver: &solver, locked: &problem.locked }, None);
    }

    /// Derivatives of a marker's position with respect to each geometry unknown and each posture
    /// coordinate.
    pub(super) fn columns_of(&self, k: usize, q: &[f64], solver: &Solver<'_>, scratch: &mut Scratch) {
        let tree = &solver.problem.tree;
        let marker = &solver.problem.markers[k];
        let point = solver.residual[k] + solver.targets[k];
        let arm = point - solver.pose.reference;
        scratch.columns.clear();
        scratch.motions.clear();
        for i in 0..3 {
            scratch.columns.push((self.layout.marker[k] + i, scratch.turned[marker.link].column(i).into_owned()));
        }
        let mut link = marker.link;
        while link != NONE {
            let joint = &tree.links[link];
            for c in joint.v_offset..joint.v_offset + joint.kind.nv() {
                scratch.motions.push((c, solver.pose.linear[c] + solver.pose.angular[c].cross(&arm)));
            }
            if joint.parent != NONE {
                let above = &scratch.turned[joint.parent];
                if self.layout.centre[link] != NONE {
                    let shift: Matrix3<f64> = above - scratch.turned[link];
                    for i in 0..3 {
                        scratch.columns.push((self.layout.centre[link] + i, shift.column(i).into_owned()));
                    }
                }
                if self.layout.axis[link] != NONE {
                    let u = self.present.axis[link];
                    let (sin, cos) = q[joint.q_offset].sin_cos();
                    for (i, b) in perpendicular(&u).iter().enumerate() {
                        let turn = above * (b * sin + u.cross(b) * (1.0 - cos));
                        scratch
                            .columns
                            .push((self.layout.axis[link] + i, turn.cross(&(point - solver.pose.origin[link]))));
                    }
                }
            }
            link = joint.parent;
        }
    }

    /// Sets the geometry to `from` plus a step.
    fn advance(&mut self, from: &Reference, step: &DVector<f64>) {
        let three = |at: usize| Vector3::new(step[at], step[at + 1], step[at + 2]);
        for (k, &m) in self.marker_of.iter().enumerate() {
            self.present.marker[m] = from.marker[m] + three(self.layout.marker[k]);
        }
        for link in 0..self.layout.centre.len() {
            if self.layout.centre[link] != NONE {
                self.present.centre[link] = from.centre[link] + three(self.layout.centre[link]);
            }
            if self.layout.axis[link] != NONE {
                let at = self.layout.axis[link];
                let [a, b] = perpendicular(&from.axis[link]);
                self.present.axis[link] = (from.axis[link] + a * step[at] + b * step[at + 1]).normalize();
            }
        }
        self.apply();
    }

    /// Present geometry minus landmarks, in parameter order.
    fn deviation(&self) -> DVector<f64> {
        let mut out = DVector::zeros(self.layout.size);
        let mut put = |at: usize, d: Vector3<f64>| out.fixed_rows_mut::<3>(at).copy_from(&d);
        for (k, &m) in self.marker_of.iter().enumerate() {
            put(self.layout.marker[k], self.present.marker[m] - self.landmarks.marker[m]);
        }
        for link in 0..self.layout.centre.len() {
            if self.layout.centre[link] != NONE {
                put(self.layout.centre[link], self.present.centre[link] - self.landmarks.centre[link]);
            }
        }
        for link in 0..self.layout.axis.len() {
            if self.layout.axis[link] != NONE {
                let at = self.layout.axis[link];
                let away = self.present.axis[link] - self.landmarks.axis[link];
                for (i, b) in perpendicular(&self.present.axis[link]).iter().enumerate() {
                    out[at + i] = away.dot(b);
                }
            }
        }
        out
    }

    fn prior_cost(&self) -> f64 {
        0.5 * self.deviation().iter().zip(&self.precision).map(|(d, p)| p * d * d).sum::<f64>()
    }

    /// The calibrated subject, the uncertainty of its geometry, and draws of its errors. `like` is
    ///  the subject at the start of this round.
    pub fn finish(&self, like: &Subject) -> Result<(Subject, Uncertainty, Vec<GeometryError>), IkError> {
        let singular = || self.failure("the normal equations are not positive definite");
        let blocks = self.blocks();
        let ((mut matrix, _), _) = self.spread.together(&blocks).ok_or_else(singular)?;
        for i in 0..self.layout.size {
            matrix[(i, i)] += self.precision[i];
        }
        let factor = matrix.cholesky().ok_or_else(singular)?;
        let variance = factor.inverse().diagonal();
        let errors = self.errors(like, &blocks, &factor).ok_or_else(singular)?;
        let root_mean = |at: usize, n: usize| {
            if at == NONE { f64::NAN } else { ((at..at + n).map(|i| variance[i]).sum::<f64>() / n as f64).sqrt() }
        };
        let uncertainty = Uncertainty {
            centre_m: self.layout.centre.iter().map(|&at| root_mean(at, 3)).collect(),
            axis_rad: self.layout.axis.iter().map(|&at| root_mean(at, 2)).collect(),
        };
        let subject = self.present.subject(like, &self.frames[0].q, &self.standing.tree)?;
        Ok((subject, uncertainty, errors))
    }
}

/// Scratch memory for one block of frames.
pub(super) struct Scratch {
    pub(super) turned: Vec<Matrix3<f64>>,
    pub(super) columns: Vec<(usize, Vector3<f64>)>,
    pub(super) motions: Vec<(usize, Vector3<f64>)>,
}

impl Scratch {
    pub(super) fn new(bundle: &Bundle) -> Self {
        let tree = &bundle.moving.tree;
        Self { turned: vec![Matrix3::identity(); tree.links.len()], columns: Vec::new(), motions: Vec::new() }
    }
}

/// Two unit vectors that complete a direction to a frame.
pub(super) fn perpendicular(u: &Vector3<f64>) -> [Vector3<f64>; 2] {
    let smallest = u.iamin();
    let mut e = Vector3::zeros();
    e[smallest] = 1.0;
    let a = u.cross(&e).normalize();
    [a, u.cross(&a)]
}

fn lay_out(problem: &Problem, options: &CalibrateOptions) -> (Layout, DVector<f64>) {
    let mut precision = Vec::new();
    let mut place = |n: usize, sd: f64| {
        let at = precision.len();
        precision.resize(at + n, 1.0 / (sd * sd));
        at
    };
    let links = &problem.tree.links;
    let marker = problem.markers.iter().map(|_| place(3, options.marker_sd_m)).collect();
    let turns = |kind: &JointKind| matches!(kind, JointKind::Spherical | JointKind::Revolute(_));
    let centre = links
        .iter()
        .map(|l| if l.parent != NONE && turns(&l.kind) { place(3, options.joint_sd(&l.name)) } else { NONE })
        .collect();
    let axis = links
        .iter()
        .map(|l| {
            let hinge = matches!(l.kind, JointKind::Revolute(_)) && l.parent != NONE;
            if hinge { place(2, options.axis_sd(&l.name)) } else { NONE }
        })
        .collect();
    let size = precision.len();
    (Layout { marker, centre, axis, size }, DVector::from_vec(precision))
}
