//! What errors of the markers do to a calibrated geometry.

use super::blocks::Equations;
use super::bundle::{Bundle, Frame, Scratch, Settled, perpendicular};
use super::geometry_error::{DRAWS, GeometryError, generator};
use crate::frame::Solver;
use crate::marker_errors::{ERROR_SEED, SPEAKS, donors, kept_shares, sizes, turned_donor};
use crate::tree::NONE;
use aloft_body::{GeometryEquations, Motion, Subject};
use nalgebra::{Cholesky, DMatrix, DVector, Dyn, Matrix3, Vector3};
use rand_distr::{Distribution, StandardNormal};
use rayon::prelude::*;
use std::ops::Range;

/// For each marker of one draw: the marker whose residual it takes, and its rotation and scale.
type Turned = Vec<Option<(usize, Matrix3<f64>)>>;

impl Bundle {
    /// Draws of what may be wrong with this geometry: the linear response of the estimate to errors
    /// of the markers, drawn as those of a motion ([`crate::MarkerErrors`]), to joints that each
    /// block sees elsewhere, and to a prior that is wrong by its own covariance. `factor` is that
    /// of the normal equations; `None` where those of a block are not finite.
    ///
    /// The inverse of the normal matrix would not do: the weight of a frame stands for errors that
    /// are alike in all frames, and an error that follows the posture moves the geometry without a
    /// trace in the residuals.
    pub fn errors(
        &self,
        like: &Subject,
        blocks: &[Equations],
        factor: &Cholesky<f64, Dyn>,
    ) -> Option<Vec<GeometryError>> {
        let mut rng = generator(DRAWS);
        let drawn = self.spread.drawn(blocks, &self.drawn_gradients(), || StandardNormal.sample(&mut rng))?;
        let error = |k: usize| {
            let mut rng = generator(k);
            let mut normal = || -> f64 { StandardNormal.sample(&mut rng) };
            let prior = self.precision.map(|p| p.sqrt() * normal());
            self.as_error(like, &factor.solve(&(drawn.column(k) + prior)))
        };
        Some((0..DRAWS).map(error).collect())
    }

    fn as_error(&self, like: &Subject, step: &DVector<f64>) -> GeometryError {
        let three = |at: usize| Vector3::new(step[at], step[at + 1], step[at + 2]);
        let mut out = GeometryError::none(like);
        for (k, &m) in self.marker_of.iter().enumerate() {
            out.marker_m[m] = three(self.layout.marker[k]);
        }
        for link in 0..self.layout.centre.len() {
            if self.layout.centre[link] != NONE {
                out.centre_m[link] = three(self.layout.centre[link]);
            }
            if self.layout.axis[link] != NONE {
                let at = self.layout.axis[link];
                let [a, b] = perpendicular(&self.present.axis[link]);
                out.axis[link] = a * step[at] + b * step[at + 1];
            }
        }
        out
    }

    /// Gradient of each block's cost by the geometry, postures eliminated: one column for each draw
    /// of the markers' errors in the moving frames.
    fn drawn_gradients(&self) -> Vec<DMatrix<f64>> {
        let n = self.moving.markers.len();
        let moving: Vec<&Frame> = self.frames.iter().filter(|f| !f.is_static).collect();
        // residuals in the axes of their links
        let residual = |frame: &Frame| -> Vec<Option<Vector3<f64>>> {
            if frame.is_static {
                return vec![None; n];
            }
            let mut solver = Solver::new(&self.moving);
            solver.targets.copy_from_slice(&frame.targets);
            solver.look();
            solver.evaluate(&frame.q);
            let mut out = vec![None; n];
            for &k in &solver.visible {
                let link = self.moving.markers[k].link;
                out[k] = Some(-(solver.pose.rotation[link].transpose() * solver.residual[k]));
            }
            out
        };
        let residuals: Vec<Vec<Option<Vector3<f64>>>> = self.frames.par_iter().map(residual).collect();
        let seen: Vec<f64> = (0..n)
            .map(|k| {
                let own = residuals.iter().filter_map(|r| r[k]);
                let (sum, count) = own.fold((0.0, 0usize), |(s, c), r| (s + r.norm_squared(), c + 1));
                if count == 0 { 0.0 } else { sum / count as f64 }
            })
            .collect();
        let motion = Motion {
            nq: self.moving.tree.nq,
            nv: self.moving.tree.nv,
            q: moving.iter().flat_map(|f| f.q.iter().copied()).collect(),
            ..Motion::default()
        };
        let all: Vec<usize> = (0..moving.len()).collect();
        let kept = kept_shares(&self.moving, &motion, &all);
        let size = sizes(&kept, &seen);
        let speaks: Vec<bool> = (0..n).map(|k| kept[(k, k)] >= 3.0 * SPEAKS && seen[k] > 0.0).collect();
        let turned: Vec<Turned> = (0..DRAWS)
            .map(|draw| {
                let of = |k: usize| {
                    let among = donors(&self.moving, k, &speaks);
                    let (donor, turn) = turned_donor(ERROR_SEED, draw as u64, self.marker_of[k] as u64, &among)?;
                    Some((donor, turn * (size[k] / seen[donor]).sqrt()))
                };
                (0..n).map(of).collect()
            })
            .collect();
        let of = |part: &Range<usize>| {
            let (frames, residuals) = (&self.frames[part.clone()], &residuals[part.clone()]);
            let (mut scratch, mut sums) = (Scratch::new(self), vec![DVector::zeros(self.layout.size); DRAWS]);
            for (frame, residual) in frames.iter().zip(residuals).filter(|(frame, _)| !frame.is_static) {
                self.add_drawn(frame, residual, &turned, &mut scratch, &mut sums);
            }
            DMatrix::from_columns(&sums)
        };
        self.parts.par_iter().map(of).collect()
    }

    /// Adds the gradients of one frame, one for each draw.
    fn add_drawn(
        &self,
        frame: &Frame,
        residual: &[Option<Vector3<f64>>],
        turned: &[Turned],
        scratch: &mut Scratch,
        sums: &mut [DVector<f64>],
    ) {
        let Some(solver) = self.solver_at(frame, scratch) else { return };
        let nv = self.moving.tree.nv;
        let mut equations = GeometryEquations::new(self.layout.size, nv);
        let mut postures: Vec<DVector<f64>> = turned.iter().map(|_| DVector::zeros(nv)).collect();
        for &k in &solver.visible {
            self.columns_of(k, &frame.q, &solver, scratch);
            let (weight, link) = (solver.weight(k), self.moving.markers[k].link);
            equations.add_point(weight, &Vector3::zeros(), &scratch.columns, &scratch.motions);
            for ((turned, sum), posture) in turned.iter().zip(sums.iter_mut()).zip(&mut postures) {
                let Some((donor, turn)) = &turned[k] else { continue };
                let Some(own) = residual[*donor] else { continue };
                let error = solver.pose.rotation[link] * (turn * own) * weight;
                scratch.columns.iter().for_each(|(i, column)| sum[*i] += column.dot(&error));
                scratch.motions.iter().for_each(|(c, motion)| posture[*c] += motion.dot(&error));
            }
        }
        let mut further: Vec<(DVector<f64>, &mut DVector<f64>)> = postures.into_iter().zip(sums.iter_mut()).collect();
        let settled = Settled { solver: &solver, locked: &self.moving.locked };
        equations.eliminate_posture_with(&settled, None, &mut further);
    }
}
