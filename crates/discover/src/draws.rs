//! Draws of errors as the comparison stores them, and as the rows of a session take them.

use nalgebra::{DMatrix, DVector};

/// Draws of the errors that a model with the true parameters would leave in the windows of one
/// trial: from the noise of its markers and plates, and from what the markers leave open of the
/// body's geometry.
#[derive(Debug, Clone, Copy)]
pub struct TrialDraws<'a> {
    /// Name of the trial.
    pub trial: &'a str,
    /// Middle frame of each window.
    pub centres: &'a [usize],
    /// True for windows in flight.
    pub in_flight: &'a [bool],
    /// For each draw six numbers for each window: force (N) and moment (N·m), world axes.
    pub errors: &'a [Vec<f32>],
    /// For each draw of the geometry how much it moves the zero of every joint coordinate, in the
    /// order of velocities, rad or m; empty where no geometry is drawn.
    pub zeros: &'a [Vec<f32>],
}

/// Draws of what the errors of a recording do to the rows of a session.
#[derive(Debug, Clone, Default)]
pub(crate) struct Drawn {
    /// Errors of the rows, by draw and block, in their weights.
    pub rows: Vec<Vec<DVector<f64>>>,
    /// By draw, how much the zero of every joint coordinate moves: the mean over the trials.
    pub zeros: Vec<Vec<f64>>,
}

/// Means over the trials.
pub(crate) fn mean_zeros(draws: &[TrialDraws<'_>]) -> Vec<Vec<f64>> {
    let with: Vec<&TrialDraws<'_>> = draws.iter().filter(|d| !d.zeros.is_empty() && !d.centres.is_empty()).collect();
    let n = with.iter().map(|d| d.zeros.len()).min().unwrap_or(0);
    let mean = |k: usize, c: usize| {
        with.iter().map(|d| d.zeros[k].get(c).map_or(0.0, |x| f64::from(*x))).sum::<f64>() / with.len() as f64
    };
    (0..n).map(|k| (0..with[0].zeros[k].len()).map(|c| mean(k, c)).collect()).collect()
}

/// Rows of the base parameters in the windows of one trial in contact, those of its draws.
#[derive(Debug, Clone, Copy)]
pub struct ContactRows<'a> {
    /// Name of the trial.
    pub trial: &'a str,
    /// Six rows for each window, force (N) and moment (N·m), one column for each base parameter.
    pub rows: &'a DMatrix<f64>,
}
