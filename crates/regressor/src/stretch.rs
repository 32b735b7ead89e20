//! A stretch of frames from which rows are formed: a flight, or a contact phase with a wrench
//! measured by plates; and the forces acting in it.

use crate::RegressorError;
use aloft_body::{Model, Motion};
use faer::Mat;
use nalgebra::{DMatrix, DVector, Vector6};
use serde::{Deserialize, Serialize};

/// Forces that act on the body during a stretch.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum StretchKind {
    /// Gravity only.
    Flight,
    /// Gravity and a measured wrench (the paper's eq. 6).
    Contact,
    /// Several stretches merged.
    Merged,
}

/// Frames `first_frame .. end_frame` (end not included) of one trial.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Stretch {
    /// Name of the trial.
    pub trial: String,
    /// Index of the stretch in its trial, from zero.
    pub index: usize,
    /// Kind of the stretch.
    pub kind: StretchKind,
    /// First frame.
    pub first_frame: usize,
    /// One past the last frame.
    pub end_frame: usize,
}

impl Stretch {
    /// A flight.
    pub fn flight(trial: impl Into<String>, index: usize, first_frame: usize, end_frame: usize) -> Self {
        Self { trial: trial.into(), index, kind: StretchKind::Flight, first_frame, end_frame }
    }
    /// A contact phase.
    pub fn contact(trial: impl Into<String>, index: usize, first_frame: usize, end_frame: usize) -> Self {
        Self { trial: trial.into(), index, kind: StretchKind::Contact, first_frame, end_frame }
    }
    /// Number of frames.
    pub fn n_frames(&self) -> usize {
        self.end_frame.saturating_sub(self.first_frame)
    }
    pub(crate) fn check(&self, model: &Model, motion: &Motion) -> Result<(), RegressorError> {
        for (what, expected, found) in
            [("coordinates a frame", model.nq, motion.nq), ("velocities a frame", model.nv, motion.nv)]
        {
            if expected != found {
                return Err(RegressorError::Length { trial: motion.trial.clone(), what, expected, found });
            }
        }
        if self.end_frame > motion.n_frames() || self.first_frame >= self.end_frame {
            return Err(RegressorError::OutOfRange {
                trial: self.trial.clone(),
                stretch: self.index,
                first: self.first_frame,
                end: self.end_frame,
                n_frames: motion.n_frames(),
            });
        }
        Ok(())
    }
}

/// Unit wrenches of candidate effects in every frame of a motion: the effect `k` with coefficient
/// `θ` exerts `θ · (force, moment)` on the whole body.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct EffectColumns {
    /// Names of the columns.
    pub names: Vec<String>,
    /// One matrix per frame of the motion, 6 × k: world force (N per unit of the coefficient) and
    /// moment about the world origin (N·m per unit). A frame with NaN gives no rows.
    pub wrench: Vec<DMatrix<f64>>,
    /// Change of the base parameters (SI units) for a unit of each coefficient: a load, a wrong
    /// mass. Its columns are formed from the rows of the body themselves, `−E = Y δ`. None for an
    /// effect that is a wrench alone; empty if all are.
    pub inertia: Vec<Option<DVector<f64>>>,
    /// Names of the columns that change what tables say of the body: combinations of the body's own
    /// columns, which a prior from tables separates from the body's parameters.
    pub of_tables: Vec<String>,
}

impl EffectColumns {
    /// No effects.
    pub fn none() -> Self {
        Self::default()
    }
    pub(crate) fn check(&self, motion: &Motion) -> Result<(), RegressorError> {
        if self.names.is_empty() {
            return Ok(());
        }
        if self.wrench.len() != motion.n_frames() {
            return Err(RegressorError::Length {
                trial: motion.trial.clone(),
                what: "frames of the effect columns",
                expected: motion.n_frames(),
                found: self.wrench.len(),
            });
        }
        if !self.inertia.is_empty() && self.inertia.len() != self.names.len() {
            return Err(RegressorError::Length {
                trial: motion.trial.clone(),
                what: "effects that change the inertia",
                expected: self.names.len(),
                found: self.inertia.len(),
            });
        }
        match self.wrench.iter().find(|w| w.nrows() != 6 || w.ncols() != self.names.len()) {
            Some(bad) => Err(RegressorError::Length {
                trial: motion.trial.clone(),
                what: "entries of an effect's wrench matrix",
                expected: 6 * self.names.len(),
                found: bad.len(),
            }),
            None => Ok(()),
        }
    }
    /// Effects that change the base parameters: index and change.
    pub fn changes(&self) -> impl Iterator<Item = (usize, &DVector<f64>)> {
        self.inertia.iter().enumerate().filter_map(|(e, change)| Some((e, change.as_ref()?)))
    }
    /// Adds `Y δ` to the columns of effects that change the inertia, in rows `[Y | −E | w]`.
    pub(crate) fn add_changes(&self, rows: &mut Mat<f64>, n_parameters: usize) {
        for (e, change) in self.changes() {
            for (c, size) in change.iter().enumerate().take(n_parameters).filter(|(_, size)| **size != 0.0) {
                for i in 0..rows.nrows() {
                    let add = size * rows[(i, c)];
                    rows[(i, n_parameters + e)] += add;
                }
            }
        }
    }
    pub(crate) fn is_finite(&self, frame: usize) -> bool {
        self.names.is_empty() || self.wrench[frame].iter().all(|x| x.is_finite())
    }
}

/// Forces on the body other than gravity, frame by frame.
#[derive(Debug, Clone, Copy, Default)]
pub struct Acting<'a> {
    /// Wrench measured by the plates, at the frames of the motion: world force (N) and moment about
    /// the world origin (N·m) on the body. Required for contact stretches, ignored in flights. NaN
    /// frames give no rows.
    pub measured: Option<&'a [Vector6<f64>]>,
    /// Columns of candidate effects.
    pub effects: Option<&'a EffectColumns>,
}

impl Acting<'_> {
    /// Gravity only.
    pub fn nothing() -> Self {
        Self::default()
    }
    pub(crate) fn n_effects(&self) -> usize {
        self.effects.map_or(0, |e| e.names.len())
    }
    pub(crate) fn check(&self, motion: &Motion, stretch: &Stretch) -> Result<(), RegressorError> {
        if let Some(effects) = self.effects {
            effects.check(motion)?;
        }
        if stretch.kind == StretchKind::Contact {
            match self.measured {
                None => {
                    return Err(RegressorError::NoWrench { trial: stretch.trial.clone(), stretch: stretch.index });
                }
                Some(wrench) if wrench.len() != motion.n_frames() => {
                    return Err(RegressorError::Length {
                        trial: motion.trial.clone(),
                        what: "frames of the measured wrench",
                        expected: motion.n_frames(),
                        found: wrench.len(),
                    });
                }
                Some(_) => {}
            }
        }
        Ok(())
    }
    /// Measured wrench of a frame; zero in flight.
    pub(crate) fn wrench(&self, stretch: &Stretch, frame: usize) -> Vector6<f64> {
        match (stretch.kind, self.measured) {
            (StretchKind::Contact, Some(measured)) => measured[frame],
            _ => Vector6::zeros(),
        }
    }
    pub(crate) fn is_finite(&self, stretch: &Stretch, frame: usize) -> bool {
        self.effects.is_none_or(|e| e.is_finite(frame)) && self.wrench(stretch, frame).iter().all(|x| x.is_finite())
    }
}
