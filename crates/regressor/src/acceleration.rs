//! The paper's rows: six per frame from filtered accelerations, in root axes about the root origin.
//!
//! `Y_O(q, q̇, q̈) φ = F_ext` (Ayusawa, Venture, Nakamura 2010, eqs. 5 and 6), regrouped to base
//! parameters. Input: filtered `Motion` and flights; output: one [`Factor`] per stretch.

use crate::stretch::Acting;
use crate::weak_windows::check_base;
use crate::{Columns, Factor, RegressorError, RowKind, Stretch, StretchKind};
use aloft_body::{BaseParameters, FrameBatch, LANES, Model, Motion, State};
use faer::Mat;
use nalgebra::{DMatrix, Vector3};
use serde::{Deserialize, Serialize};
use std::array::from_fn;

/// Options of acceleration rows.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct AccelerationOptions {
    /// Time excluded at both ends of a stretch, s: the filter spreads contact forces that far into
    /// a flight.
    pub margin_s: f64,
    /// Weight of the three force rows, 1/N.
    pub force_weight: f64,
    /// Weight of the three moment rows, 1/(N·m).
    pub moment_weight: f64,
}

impl Default for AccelerationOptions {
    /// 70 ms margins (the support of a third-order 10 Hz zero-phase filter), newtons and newton
    /// metres with equal weight as in the paper.
    fn default() -> Self {
        Self { margin_s: 0.07, force_weight: 1.0, moment_weight: 1.0 }
    }
}

/// Factor of one stretch from acceleration rows.
///
/// Frames with NaN are left out. The motion must carry velocities and accelerations.
///
/// # Errors
/// [`RegressorError::NotFiltered`] without velocities or accelerations,
/// [`RegressorError::TooShort`] when no frame is left, [`RegressorError::NoWrench`] for contact
/// without plates.
pub fn acceleration_factor(
    model: &Model,
    base: &BaseParameters,
    motion: &Motion,
    stretch: &Stretch,
    acting: Acting<'_>,
    options: &AccelerationOptions,
) -> Result<Factor, RegressorError> {
    stretch.check(model, motion)?;
    check_base(model, base, &stretch.trial)?;
    acting.check(motion, stretch)?;
    for (series, missing) in [(&motion.v, "velocities"), (&motion.a, "accelerations")] {
        if series.len() != motion.n_frames() * motion.nv {
            return Err(RegressorError::NotFiltered { trial: motion.trial.clone(), missing });
        }
    }
    let margin = (options.margin_s.max(0.0) * motion.rate_hz).round() as usize;
    let frames: Vec<usize> = (stretch.first_frame + margin..stretch.end_frame.saturating_sub(margin))
        .filter(|&f| {
            motion.is_valid(f)
                && motion.v(f).iter().chain(motion.a(f)).all(|x| x.is_finite())
                && acting.is_finite(stretch, f)
        })
        .collect();
    if frames.is_empty() {
        return Err(RegressorError::TooShort {
            trial: stretch.trial.clone(),
            stretch: stretch.index,
            frames: 0,
            needed: 1,
        });
    }
    let columns = Columns {
        parameters: base.parameters.iter().map(|p| p.name.clone()).collect(),
        effects: acting.effects.map_or_else(Vec::new, |e| e.names.clone()),
        of_tables: acting.effects.map_or_else(Vec::new, |e| e.of_tables.clone()),
    };
    let (p, k) = (base.len(), acting.n_effects());
    let mut rows = Mat::<f64>::zeros(6 * frames.len(), p + k + 1);
    let weights = [options.force_weight, options.moment_weight];
    let mut batch = FrameBatch::new(model);
    let mut lanes = vec![[0.0; LANES]; 6 * p];
    let mut state = State::new(model);
    let acts = acting.effects.is_some() || stretch.kind != StretchKind::Flight;
    // the rows of a batch are ordered by axis: R does not depend on their order
    for (b, group) in frames.chunks(LANES).enumerate() {
        let (first, width) = (6 * LANES * b, group.len());
        // the last frame fills the unused lanes of the last batch
        let frame = |lane: usize| group[lane.min(width - 1)];
        batch.forward_acceleration(
            model,
            &from_fn(|lane| motion.q(frame(lane))),
            &from_fn(|lane| motion.v(frame(lane))),
            &from_fn(|lane| motion.a(frame(lane))),
        );
        batch.base_wrench_rows(base, &mut lanes);
        for (c, entries) in lanes.chunks_exact(6).enumerate() {
            let column = &mut rows.col_as_slice_mut(c)[first..first + 6 * width];
            for (r, (to, from)) in column.chunks_exact_mut(width).zip(entries).enumerate() {
                for (to, from) in to.iter_mut().zip(from) {
                    *to = weights[r / 3] * from;
                }
            }
        }
        if !acts {
            continue;
        }
        for (lane, &frame) in group.iter().enumerate() {
            state.forward_position(model, motion.q(frame));
            let world_from_root = state.world_from_link[0];
            let into_root = |force: Vector3<f64>, moment: Vector3<f64>| {
                let about_root = moment - world_from_root.translation.vector.cross(&force);
                let rotation = world_from_root.rotation.inverse();
                (rotation * force, rotation * about_root)
            };
            let mut put = |column: usize, sign: f64, force: Vector3<f64>, moment: Vector3<f64>| {
                let (force, moment) = into_root(force, moment);
                for axis in 0..3 {
                    rows[(first + width * axis + lane, column)] = sign * weights[0] * force[axis];
                    rows[(first + width * (3 + axis) + lane, column)] = sign * weights[1] * moment[axis];
                }
            };
            if let Some(effects) = acting.effects {
                for e in 0..k {
                    let column = effects.wrench[frame].column(e);
                    put(p + e, -1.0, column.fixed_rows::<3>(0).into(), column.fixed_rows::<3>(3).into());
                }
            }
            let wrench = acting.wrench(stretch, frame);
            put(p + k, 1.0, wrench.fixed_rows::<3>(0).into(), wrench.fixed_rows::<3>(3).into());
        }
    }
    if let Some(effects) = acting.effects {
        effects.add_changes(&mut rows, p);
    }
    Factor::from_rows(stretch, RowKind::Acceleration, columns, rows.as_ref())
}

/// Workspace that computes the 6 × n_base rows of one frame without allocating; [`FrameBatch`] does
/// eight frames at a time, faster.
#[derive(Debug, Clone)]
pub struct AccelerationRows<'a> {
    model: &'a Model,
    base: &'a BaseParameters,
    state: State,
    rows: DMatrix<f64>,
}

impl<'a> AccelerationRows<'a> {
    /// Workspace for one model.
    pub fn new(model: &'a Model, base: &'a BaseParameters) -> Self {
        Self { model, base, state: State::new(model), rows: DMatrix::zeros(6, base.len()) }
    }
    /// Rows of one frame in root axes about the root origin: three of force (N per unit), three of
    /// moment (N·m per unit).
    pub fn base_rows(&mut self, q: &[f64], v: &[f64], a: &[f64]) -> &DMatrix<f64> {
        self.state.forward_acceleration(self.model, q, v, a);
        self.state.base_wrench_rows(self.model, self.base, &mut self.rows);
        &self.rows
    }
    /// Pose of the root in the world, for the frame of the last call of
    /// [`AccelerationRows::base_rows`].
    pub fn world_from_root(&self) -> &nalgebra::Isometry3<f64> {
        &self.state.world_from_link[0]
    }
}
