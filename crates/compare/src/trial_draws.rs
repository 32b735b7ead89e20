//! The draws behind the noise floor, trial by trial, for studies of what such errors do.

use crate::input::TrialFacts;
use aloft_body::{FrameDifferences, LANES, Model, Motion};
use nalgebra::Vector6;
use serde::{Deserialize, Serialize};
use std::array::from_fn;

/// Error of one draw in one window: force (N) and moment (N·m), world axes.
#[derive(Debug, Clone)]
pub(crate) struct DrawnWindow {
    pub draw: usize,
    /// Middle frame.
    pub centre: usize,
    pub contact: bool,
    pub error: Vector6<f64>,
}

/// Draws of the errors in the windows of one trial that a model with the true parameters would
/// leave in the geometry of the calibration: errors of markers and plates, and of that geometry.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct TrialDraws {
    /// Name of the trial.
    pub trial: String,
    /// Middle frame of each window.
    pub centres: Vec<usize>,
    /// True for windows in flight.
    pub in_flight: Vec<bool>,
    /// True if the error of its windows in contact is reported; false if they only identify.
    pub held_out_contact: bool,
    /// For each draw the errors of the windows in their order, six numbers each: force (N) and
    /// moment (N·m), world axes.
    pub errors: Vec<Vec<f32>>,
    /// For each draw of the geometry how much it moves the zero of every joint coordinate: the mean
    /// over the frames, in the order of velocities, rad or m. Empty where no geometry is drawn.
    #[serde(default)]
    pub zeros: Vec<Vec<f32>>,
}

impl TrialDraws {
    /// From the draws of the noise, those of the geometry (each with its errors in the windows, in
    /// their order) and the changes of the joints that these bring.
    pub(crate) fn of(
        facts: &TrialFacts,
        windows: &[DrawnWindow],
        geometry: &[Vec<Vector6<f64>>],
        zeros: &[Vec<f32>],
    ) -> Self {
        let first: Vec<&DrawnWindow> = windows.iter().filter(|w| w.draw == 0).collect();
        let mut errors: Vec<Vec<f32>> = Vec::new();
        for w in windows {
            if errors.len() <= w.draw {
                errors.resize(w.draw + 1, Vec::new());
            }
            let of_geometry = geometry.get(w.draw).and_then(|g| g.get(errors[w.draw].len() / 6));
            let error = w.error + of_geometry.copied().unwrap_or_else(Vector6::zeros);
            errors[w.draw].extend(error.iter().map(|x| *x as f32));
        }
        Self {
            trial: facts.name.clone(),
            held_out_contact: facts.held_out_contact,
            centres: first.iter().map(|w| w.centre).collect(),
            in_flight: first.iter().map(|w| !w.contact).collect(),
            errors,
            zeros: zeros.to_vec(),
        }
    }
}

/// Mean change of every joint coordinate from one motion to another, over the frames for which
/// `wanted` holds.
pub(crate) fn mean_change(model: &Model, from: &Motion, to: &Motion, wanted: &dyn Fn(usize) -> bool) -> Vec<f32> {
    let frames: Vec<usize> =
        (0..from.n_frames()).filter(|&f| wanted(f) && from.is_valid(f) && to.is_valid(f)).collect();
    let differences = FrameDifferences::default();
    let (mut sum, mut change) = (vec![0.0; model.nv], vec![[0.0; LANES]; model.nv]);
    for some in frames.chunks(LANES) {
        // the last frame fills the unused lanes
        let at = |lane: usize| some[lane.min(some.len() - 1)];
        differences.between(model, &from_fn(|lane| from.q(at(lane))), &from_fn(|lane| to.q(at(lane))), &mut change);
        for lane in 0..some.len() {
            sum.iter_mut().zip(&change).for_each(|(s, c)| *s += c[lane]);
        }
    }
    sum.iter().map(|s| (s / frames.len().max(1) as f64) as f32).collect()
}
