//! A trial with everything that the comparison reads.

use super::Params;
use crate::plate_zeros::{SessionZeros, Zero};
use crate::results::Results;
use crate::stages::calibrate::geometry_errors;
use crate::stages::filter::low_pass;
use crate::stages::robot::RobotErrors;
use crate::stages::shared::fit_options;
use crate::trial_rows::{TrialRows, effect_columns};
use aloft_body::{Motion, Subject};
use aloft_compare::{
    Measured, OffsetRange, OtherGeometry, PlateDrift, PoseErrors, TareReadings, TrialInput, measured_wrench,
};
use aloft_ik::MarkerErrors;
use aloft_regressor::{EffectColumns, overlays};
use aloft_signal::{Butterworth, LowPass};
use aloft_study::calendar::Calendar;
use aloft_study::subject_session::Role;
use aloft_workspace::error::StageFailure;
use nalgebra::DMatrix;
use rayon::prelude::*;
use std::ops::Range;
use std::sync::Arc;

/// One trial with everything that the comparison reads.
pub struct ComparedTrial {
    /// Trial name.
    pub name: String,
    /// Role.
    pub role: Role,
    /// Filtered motion.
    pub filtered: Motion,
    /// Motion before filtering.
    pub unfiltered: Motion,
    /// Plates, tared; none if the trial has none.
    pub measured: Option<Measured>,
    /// Flights.
    pub flights: Vec<Range<usize>>,
    /// Frames in which all external forces on the body are measured.
    pub complete: Vec<bool>,
    /// Errors of markers or sensors, if the noise floor is to be computed.
    pub errors: Option<Box<dyn PoseErrors + Send>>,
    /// Drift of the plates, if the noise floor is to be computed.
    pub drift: Option<PlateDrift>,
    /// Columns of the model's effects.
    pub effects: Option<EffectColumns>,
    /// Their wrenches, filtered like the motion and the plates; none without plates.
    pub effects_filtered: Option<Vec<DMatrix<f64>>>,
    /// True if a plate was never unloaded, so that its reading at rest is not known.
    pub untared: bool,
    /// Range of that reading by the other recordings.
    pub offset_range: Option<OffsetRange>,
}

/// Errors of a trial's markers, from which the comparison draws, and the subject with other
/// geometries that the calibration allows.
#[derive(Debug)]
pub struct DrawnErrors {
    markers: MarkerErrors,
    subject: Subject,
    geometries: Vec<Subject>,
}

impl PoseErrors for DrawnErrors {
    fn draw(&self, motion: &Motion, wanted: &dyn Fn(usize) -> bool, seed: u64, draw: u64) -> Motion {
        self.markers.draw(motion, wanted, seed, draw)
    }
    fn draw_each(
        &self,
        motion: &Motion,
        wanted: &dyn Fn(u64, usize) -> bool,
        seed: u64,
        draws: Range<u64>,
    ) -> Vec<Motion> {
        self.markers.draw_each(motion, wanted, seed, draws)
    }
    fn with_geometry(&self, motion: &Motion, wanted: &dyn Fn(usize) -> bool) -> Vec<OtherGeometry> {
        let seen = self.markers.with_geometry(motion, wanted, &self.geometries);
        let own = (&self.subject.model, self.subject.markers.as_slice());
        let of = |(other, motion): (&Subject, Motion)| OtherGeometry {
            model: other.model.clone(),
            motion,
            overlays: overlays(own, (&other.model, &other.markers)),
        };
        self.geometries.iter().zip(seen).map(of).collect()
    }
}

impl ComparedTrial {
    /// Adds the errors of the markers about the motion, and the drift of the plates estimated from
    /// the other trials, for the noise floor.
    pub(super) fn with_errors(
        mut self,
        params: &Params,
        results: Results<'_>,
        subject: &Subject,
        readings: &[(String, TareReadings)],
    ) -> Result<Self, StageFailure> {
        if let Some(measured) = &self.measured {
            let others: Vec<&TareReadings> = readings.iter().filter(|r| r.0 != self.name).map(|r| &r.1).collect();
            let own = readings.iter().find(|r| r.0 == self.name).map(|r| r.1.times_s.clone()).unwrap_or_default();
            self.drift = PlateDrift::of(&others, &measured.noise_density, own);
        }
        if let Some(sensors) = RobotErrors::load(results, &self.unfiltered)? {
            self.errors = Some(Box::new(sensors));
            return Ok(self);
        }
        let mut subject = subject.clone();
        let options = fit_options(params.ik_of(&self.name), results, &mut subject)?;
        let (trial, _) = results.load_labelled_markers(&self.name)?;
        let of = if params.is_rigid { MarkerErrors::of_rigid } else { MarkerErrors::of };
        let errors = of(&subject, &trial, &self.unfiltered, &options).map_err(|e| StageFailure::new(e.to_string()))?;
        let geometries = geometry_errors(results)?
            .iter()
            .map(|e| e.applied(&subject).map_err(|e| StageFailure::new(e.to_string())))
            .collect::<Result<Vec<_>, _>>()?;
        let drawn = |markers| DrawnErrors { markers, subject, geometries };
        self.errors = errors.map(|markers| Box::new(drawn(markers)) as Box<dyn PoseErrors + Send>);
        Ok(self)
    }

    /// From the data of a trial's rows; `others` are the trials whose plates say what its own read
    /// unloaded.
    pub fn of(
        params: &Params,
        results: Results<'_>,
        role: Role,
        name: &str,
        others: &SessionZeros<'_>,
        rows: TrialRows,
    ) -> Result<Self, StageFailure> {
        let effects = effect_columns(&params.effects, &rows)?;
        Self::with_columns(params, results, role, name, others, rows, effects)
    }

    /// The same with columns of effects that were formed before.
    pub fn with_columns(
        params: &Params,
        results: Results<'_>,
        role: Role,
        name: &str,
        others: &SessionZeros<'_>,
        rows: TrialRows,
        effects: Option<EffectColumns>,
    ) -> Result<Self, StageFailure> {
        let TrialRows { trial, flights, .. } = &rows;
        let flights = flights.clone();
        let (rate_hz, frames) = (rows.motion.rate_hz, rows.motion.n_frames());
        let measured = if trial.plates.is_empty() {
            None
        } else {
            let filter = Some(low_pass(&params.filter));
            let m = measured_wrench(name, &trial.plates, rate_hz, frames, filter)
                .map_err(|e| StageFailure::new(e.to_string()))?;
            Some(m)
        };
        let complete = completely_measured(&rows.covered, &flights, frames);
        let effects_filtered = match (&effects, &measured) {
            (Some(effects), Some(_)) => Some(low_passed(effects, &rows.motion, low_pass(&params.filter))?),
            _ => None,
        };
        let tares = results.load_tares(name)?;
        let zero = Zero::of(name, &tares, others)?;
        let (untared, offset_range) = (measured.is_some() && zero.unknown, zero.range);
        Ok(Self {
            name: name.to_owned(),
            role,
            filtered: lean(
                rows.filtered.ok_or_else(|| StageFailure::new(format!("{name}: no filtered motion to compare")))?,
            ),
            unfiltered: lean(rows.motion),
            measured,
            flights,
            complete,
            errors: None,
            drift: None,
            effects,
            effects_filtered,
            untared,
            offset_range,
        })
    }
}

impl ComparedTrial {
    /// The trial at an index as input of the comparison; `validation` is true if some trial is held
    /// out as a whole ([`has_validation`]).
    pub fn input(&self, i: usize, held_out: HeldOut, validation: bool, left_out: Option<&[bool]>) -> TrialInput<'_> {
        let every = held_out == HeldOut::EveryTrial || !validation;
        TrialInput {
            unfiltered: Some(&self.unfiltered),
            measured: self.measured.as_ref(),
            complete: Some(&self.complete),
            errors: self.errors.as_ref().map(|e| &**e as &dyn PoseErrors),
            drift: self.drift.as_ref(),
            effects: self.effects.as_ref(),
            effects_filtered: self.effects_filtered.as_deref(),
            untared: self.untared,
            offset_range: self.offset_range,
            held_out_contact: if every { self.measured.is_some() } else { self.role == Role::Validate },
            held_out_flight: left_out.map_or(every || self.role == Role::Validate, |l| l[i]),
            ..TrialInput::new(&self.filtered, &self.flights)
        }
    }
}

/// Unit wrenches of effects through the filter of the motion and the plates, beside which they
/// stand frame by frame. Runs that are too short for the filter have none.
fn low_passed(effects: &EffectColumns, motion: &Motion, filter: LowPass) -> Result<Vec<DMatrix<f64>>, StageFailure> {
    let mut out = effects.wrench.clone();
    let channels = 6 * effects.names.len();
    let seen = |f: usize, m: &DMatrix<f64>| motion.is_valid(f) && m.ncols() == effects.names.len();
    let mut data: Vec<f64> = Vec::with_capacity(channels * out.len());
    for (f, m) in out.iter().enumerate() {
        if seen(f, m) {
            data.extend_from_slice(m.as_slice());
        } else {
            data.extend(std::iter::repeat_n(f64::NAN, channels));
        }
    }
    let design = Butterworth::design(filter, motion.rate_hz).map_err(|e| StageFailure::new(e.to_string()))?;
    design.filtfilt_interleaved(&mut data, channels);
    for (m, filtered) in out.iter_mut().zip(data.chunks_exact(channels)) {
        *m = DMatrix::from_column_slice(6, effects.names.len(), filtered);
    }
    Ok(out)
}

/// A motion without the parts that the comparison does not read: marker residuals and standard
/// deviations.
fn lean(mut motion: Motion) -> Motion {
    (motion.residual_m, motion.marker_labels, motion.q_sd) = (Vec::new(), Vec::new(), Vec::new());
    motion
}

/// Loads the trials for which every earlier stage succeeded.
pub fn load_trials(
    params: &Params,
    results: Results<'_>,
    calendar: &(dyn Fn() -> Result<Arc<Calendar>, StageFailure> + Sync),
    trials: &[(String, Role)],
) -> Result<Vec<ComparedTrial>, StageFailure> {
    let subject = results.load_subject("calibrate")?;
    let names: Vec<String> = trials.iter().map(|(name, _)| name.clone()).collect();
    let zeros = SessionZeros::new(results, &names);
    trials
        .par_iter()
        .map(|(name, role)| {
            let rows = TrialRows::load(results, Some(&params.filter), &calendar, name, &subject)?;
            ComparedTrial::of(params, results, *role, name, &zeros, rows)
        })
        .collect()
}

/// Frames in which all external forces are known: in flight always; on the ground only where the
/// plates measure all that the body touches.
fn completely_measured(covered: &[bool], flights: &[Range<usize>], frames: usize) -> Vec<bool> {
    (0..frames).map(|f| flights.iter().any(|r| r.contains(&f)) || covered.get(f).copied().unwrap_or(false)).collect()
}

/// True if a trial that takes no part in identification was measured by plates; models are then
/// judged on such trials. Otherwise every trial in turn is left out.
pub fn has_validation(trials: &[ComparedTrial]) -> bool {
    trials.iter().any(|t| t.role == Role::Validate && t.measured.is_some())
}

/// Which trials count as held out when a pipeline's models are compared.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum HeldOut {
    /// Trials that take no part in identification; every trial if there are none (models then have
    /// one set of parameters per trial).
    Validation,
    /// Every trial (models have one set of parameters per trial).
    EveryTrial,
}
