//! The comparison over weak windows: `∫ψ (predicted − measured) dt / ∫ψ dt`, without filter or
//! second derivatives.
//!
//! On single frames the noise of twice-differentiated positions masks the error of the model; over
//! a window of 0.3 s the noise is an order of magnitude smaller, and the remaining error is the
//! model's. World axes, moments about a smooth path near the centre of mass.

use crate::errors::{Sums, halves, joined};
use crate::frames::{WindowSample, complete};
use crate::noise_floor::constant_wrench;
use crate::phase::weak_stretches;
use crate::{Body, Candidate, CompareError, CompareOptions, RecordingOffset, TrialInput};
use aloft_body::Motion;
use aloft_regressor::{Acting, RegressorError, Stretch, WeakOptions, WeakRows, weak_rows};
use nalgebra::{DMatrix, DVector, Vector3, Vector6};
use std::ops::Range;

/// The weak windows of one trial as rows, from which the error of any model follows without its
/// frames.
#[derive(Debug, Clone)]
pub struct WindowRows {
    /// Six rows per window, `[Y_B | −E | w]` over ∫ψ: force (N), then moment (N·m), world axes.
    pub rows: DMatrix<f64>,
    /// Names of the effects' columns.
    pub effects: Vec<String>,
    /// Middle of each window since the first frame, s.
    pub centre_s: Vec<f64>,
    /// True for windows in flight, false for contact; contact comes first.
    pub in_flight: Vec<bool>,
    /// Mean of the point about which moments are taken, m.
    pub path: Vec<Vector3<f64>>,
}

impl WindowRows {
    /// Forms the rows of a trial; none without unfiltered motion.
    ///
    /// # Errors
    /// Rows that cannot be formed.
    pub fn of(body: &Body<'_>, input: &TrialInput<'_>, options: &CompareOptions) -> Result<Option<Self>, CompareError> {
        let Some(motion) = input.unfiltered else { return Ok(None) };
        let (contact, flights) = stretches(input, motion, options);
        let effects = input.effects.map_or_else(Vec::new, |e| e.names.clone());
        let acting = Acting { measured: input.measured.map(|m| m.unfiltered.as_slice()), effects: input.effects };
        let runs =
            contact.iter().enumerate().map(|run| (run, false)).chain(flights.iter().enumerate().map(|run| (run, true)));
        let mut out =
            Self { rows: DMatrix::zeros(0, 0), effects, centre_s: Vec::new(), in_flight: Vec::new(), path: Vec::new() };
        let mut parts: Vec<DMatrix<f64>> = Vec::new();
        for ((i, run), flying) in runs {
            let Some(rows) = run_rows(body, motion, i, run, flying, acting, options)? else { continue };
            let per_second = 1.0 / rows.test.integral_s();
            let m = &rows.matrix;
            parts.push(DMatrix::from_fn(m.nrows(), m.ncols(), |i, j| m[(i, j)] * per_second));
            out.centre_s.extend(rows.centres.iter().map(|c| *c as f64 / motion.rate_hz));
            out.in_flight.extend(rows.centres.iter().map(|_| flying));
            out.path.extend(path(&rows));
        }
        let columns = body.base.len() + out.effects.len() + 1;
        out.rows = DMatrix::zeros(parts.iter().map(DMatrix::nrows).sum(), columns);
        let mut at = 0;
        for part in parts {
            out.rows.view_mut((at, 0), part.shape()).copy_from(&part);
            at += part.nrows();
        }
        Ok(Some(out))
    }

    /// Error of a model in each window: base parameters, coefficients of effects by name (effects
    /// without a column here are absent), and the offset of an untared recording, which acts in
    /// contact.
    pub fn errors(
        &self,
        base: &DVector<f64>,
        coefficients: &[(String, f64)],
        offset: Option<&RecordingOffset>,
    ) -> Vec<Vector6<f64>> {
        let p = base.len();
        let mut all = self.rows.columns(0, p) * base - self.rows.column(self.rows.ncols() - 1);
        for (name, theta) in coefficients {
            if let Some(k) = self.effects.iter().position(|e| e == name) {
                all.axpy(*theta, &self.rows.column(p + k), 1.0);
            }
        }
        let offset = offset.map(RecordingOffset::wrench);
        let one = |w: usize| {
            let e = Vector6::from_fn(|axis, _| all[6 * w + axis]);
            offset.as_ref().filter(|_| !self.in_flight[w]).map_or(e, |o| e + about(o, &self.path[w]))
        };
        (0..self.centre_s.len()).map(one).collect()
    }
}

impl WindowRows {
    /// Rows of the base parameters in the windows in contact: force (N) and moment (N·m), six rows
    /// for each. In an untared recording, from which the constant wrench that fits best is
    /// subtracted, each column without the constant that fits it best.
    pub fn contact_columns(&self, parameters: usize, untared: bool) -> DMatrix<f64> {
        let contact: Vec<usize> = (0..self.in_flight.len()).filter(|&w| !self.in_flight[w]).collect();
        let mut out = DMatrix::zeros(6 * contact.len(), parameters);
        for (i, &w) in contact.iter().enumerate() {
            out.rows_mut(6 * i, 6).copy_from(&self.rows.view((6 * w, 0), (6, parameters)));
        }
        if untared {
            let path: Vec<Vector3<f64>> = contact.iter().map(|&w| self.path[w]).collect();
            for mut column in out.column_iter_mut() {
                let own: Vec<Vector6<f64>> =
                    (0..path.len()).map(|i| Vector6::from_fn(|axis, _| column[6 * i + axis])).collect();
                let Some(constant) = constant_wrench(path.iter().zip(&own)) else { continue };
                for (i, place) in path.iter().enumerate() {
                    let off = about(&constant, place);
                    (0..6).for_each(|axis| column[6 * i + axis] -= off[axis]);
                }
            }
        }
        out
    }
}

/// The held-out error over windows, N: root mean square of the force, with the moment over a lever
/// of 0.1 m, as [`WindowErrors::size`](crate::WindowErrors::size); with force (N) and moment (N·m)
/// alone. None without windows.
pub fn size_of_windows<'a>(errors: impl IntoIterator<Item = &'a Vector6<f64>>) -> Option<(f64, f64, f64, usize)> {
    let mut sums = Sums::default();
    errors.into_iter().for_each(|e| sums.add(e));
    let windows = sums.windows();
    (windows.windows > 0)
        .then(|| (windows.size(), windows.force_n.norm_rms(), windows.moment_nm.norm_rms(), windows.windows))
}

/// Errors over the windows of one trial, `[contact, flight]` for each model.
#[derive(Debug, Clone)]
pub(crate) struct TrialWindows {
    pub contact: Vec<Sums>,
    pub flight: Vec<Sums>,
    /// Errors in contact, without subtracting the recording's offset.
    pub contact_as_measured: Vec<Sums>,
    /// Every window, the offset subtracted.
    pub windows: Vec<Window>,
}

/// One window: its middle frame and the error of each model.
#[derive(Debug, Clone)]
pub(crate) struct Window {
    pub centre: usize,
    pub in_flight: bool,
    pub residual: Vec<Vector6<f64>>,
}

impl Window {
    /// The window as a sample of its trial.
    pub fn into_sample(self, time_s: &[f64]) -> WindowSample {
        let centre_s = time_s.get(self.centre).copied().unwrap_or(f64::NAN);
        WindowSample { centre_s, in_flight: self.in_flight, residual: self.residual }
    }
}

pub(crate) fn trial_windows(
    body: &Body<'_>,
    candidates: &[Candidate],
    index: usize,
    input: &TrialInput<'_>,
    offsets: &[Option<RecordingOffset>],
    options: &CompareOptions,
) -> Result<TrialWindows, CompareError> {
    let mut out = TrialWindows {
        contact: vec![Sums::default(); candidates.len()],
        flight: vec![Sums::default(); candidates.len()],
        contact_as_measured: vec![Sums::default(); candidates.len()],
        windows: Vec::new(),
    };
    let Some(motion) = input.unfiltered else { return Ok(out) };
    let series = input.measured.map(|m| m.unfiltered.as_slice());
    let (contact, flights) = stretches(input, motion, options);
    let parameters: Vec<&DVector<f64>> = candidates.iter().map(|c| c.parameters(index)).collect();
    let names = input.effects.map_or(&[][..], |e| &e.names);
    let coefficients: Vec<DVector<f64>> = candidates.iter().map(|c| c.coefficients(index, names)).collect();
    let acting = Acting { measured: series, effects: input.effects };
    for (i, run) in contact.iter().enumerate() {
        let found = window_residuals(body, motion, i, run, false, acting, options, &parameters, &coefficients)?;
        for (w, (path, &centre)) in found.path.iter().zip(&found.centres).enumerate() {
            let mut residual = Vec::with_capacity(candidates.len());
            for (c, windows) in found.residual.iter().enumerate() {
                let e = windows[w];
                out.contact_as_measured[c].add(&e);
                let left = offsets[c].as_ref().map_or(e, |o| e + about(&o.wrench(), path));
                out.contact[c].add(&left);
                residual.push(left);
            }
            out.windows.push(Window { centre, in_flight: false, residual });
        }
    }
    for (i, run) in flights.iter().enumerate() {
        let found = window_residuals(body, motion, i, run, true, acting, options, &parameters, &coefficients)?;
        for (sums, windows) in out.flight.iter_mut().zip(&found.residual) {
            windows.iter().for_each(|e| sums.add(e));
        }
        out.windows.extend(found.centres.iter().enumerate().map(|(w, &centre)| Window {
            centre,
            in_flight: true,
            residual: found.residual.iter().map(|windows| windows[w]).collect(),
        }));
    }
    Ok(out)
}

/// A wrench about the world origin, with its moment taken about another point.
pub(crate) fn about(wrench: &Vector6<f64>, point: &Vector3<f64>) -> Vector6<f64> {
    let (force, moment) = halves(wrench);
    joined(&force, &(moment - point.cross(&force)))
}

/// Window averages of one run.
#[derive(Debug, Clone)]
pub(crate) struct RunWindows {
    /// Averages of the error, `[model][window]`.
    pub residual: Vec<Vec<Vector6<f64>>>,
    /// Averages of the point about which moments are taken, one for each window, m.
    pub path: Vec<Vector3<f64>>,
    /// Middle frames.
    pub centres: Vec<usize>,
}

/// Runs of contact and flights for windows.
pub(crate) fn stretches(
    input: &TrialInput<'_>,
    motion: &Motion,
    options: &CompareOptions,
) -> (Vec<Range<usize>>, Vec<Range<usize>>) {
    let series = input.measured.map(|m| m.unfiltered.as_slice());
    weak_stretches(
        motion.n_frames(),
        motion.rate_hz,
        input.flights,
        |f| motion.is_valid(f),
        |f| complete(input, series, f).is_some(),
        options,
    )
}

/// Window averages of the error in one run; empty if the run is shorter than a window (in contact)
/// or than the shortest window (flights use shorter windows if necessary).
pub(crate) fn window_residuals(
    body: &Body<'_>,
    motion: &Motion,
    index: usize,
    run: &Range<usize>,
    flying: bool,
    acting: Acting<'_>,
    options: &CompareOptions,
    parameters: &[&DVector<f64>],
    coefficients: &[DVector<f64>],
) -> Result<RunWindows, CompareError> {
    let nothing = RunWindows { residual: vec![Vec::new(); parameters.len()], path: Vec::new(), centres: Vec::new() };
    Ok(run_rows(body, motion, index, run, flying, acting, options)?.map_or(nothing, |rows| RunWindows {
        residual: residuals(&rows, parameters, coefficients),
        path: path(&rows),
        centres: rows.centres,
    }))
}

/// Weak rows of one run; none if it is too short for a window.
fn run_rows(
    body: &Body<'_>,
    motion: &Motion,
    index: usize,
    run: &Range<usize>,
    flying: bool,
    acting: Acting<'_>,
    options: &CompareOptions,
) -> Result<Option<WeakRows>, CompareError> {
    let Some((stretch, weak)) = windows_of(motion, index, run, flying, options) else { return Ok(None) };
    match weak_rows(body.model, body.base, body.prior, motion, &stretch, acting, &weak) {
        Ok(rows) => Ok(Some(rows)),
        Err(RegressorError::TooShort { .. }) => Ok(None),
        Err(error) => Err(error.into()),
    }
}

/// A run as a stretch, and the layout of windows in it; none if it is too short for one.
pub(crate) fn windows_of(
    motion: &Motion,
    index: usize,
    run: &Range<usize>,
    flying: bool,
    options: &CompareOptions,
) -> Option<(Stretch, WeakOptions)> {
    if flying {
        let weak = WeakOptions { window_s: options.flight_window_s, ..WeakOptions::default() };
        return Some((Stretch::flight(&motion.trial, index, run.start, run.end), weak));
    }
    let weak = WeakOptions { window_s: Some(options.window_s), ..WeakOptions::default() };
    let long = run.len() as f64 / motion.rate_hz >= options.window_s;
    long.then(|| (Stretch::contact(&motion.trial, index, run.start, run.end), weak))
}

/// ∫ψ o dt / ∫ψ dt of the moment origin o in each window.
fn path(rows: &WeakRows) -> Vec<Vector3<f64>> {
    let per_second = 1.0 / rows.test.integral_s();
    let psi = &rows.test.psi;
    rows.origin
        .iter()
        .map(|origin| origin.iter().zip(psi).map(|(o, psi)| o.position * (psi * per_second)).sum())
        .collect()
}

/// The weak rows times the parameters of each model, over ∫ψ.
fn residuals(rows: &WeakRows, parameters: &[&DVector<f64>], coefficients: &[DVector<f64>]) -> Vec<Vec<Vector6<f64>>> {
    let m = &rows.matrix;
    let per_second = 1.0 / rows.test.integral_s();
    let last = m.ncols() - 1;
    let errors = |(phi, theta): (&&DVector<f64>, &DVector<f64>)| {
        let error = |i: usize| -> f64 {
            let body: f64 = phi.iter().enumerate().map(|(j, x)| m[(i, j)] * x).sum();
            // columns of effects already include their minus sign
            let effects: f64 = theta.iter().enumerate().map(|(k, x)| m[(i, phi.len() + k)] * x).sum();
            (body + effects - m[(i, last)]) * per_second
        };
        (0..rows.centres.len()).map(|w| Vector6::from_fn(|axis, _| error(6 * w + axis))).collect()
    };
    parameters.iter().zip(coefficients).map(errors).collect()
}
