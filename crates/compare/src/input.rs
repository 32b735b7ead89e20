//! Input of a comparison: a body, models of it, and trials.

use crate::{CompareError, Measured, OffsetRange, PlateDrift};
use aloft_body::{BaseParameters, Model, Motion, Phi};
use aloft_regressor::EffectColumns;
use nalgebra::{DMatrix, DVector, Isometry3};
use serde::{Deserialize, Serialize};
use std::ops::Range;

/// The body that all models describe.
#[derive(Debug, Clone, Copy)]
pub struct Body<'a> {
    /// Kinematic tree with this body's geometry.
    pub model: &'a Model,
    /// Its base parameters.
    pub base: &'a BaseParameters,
    /// Link parameters that give the path about which weak windows take moments; the errors are
    /// exact for any values.
    pub prior: &'a [Phi],
}

/// One model of the body: a name and base parameters, the same for all trials or
/// (leave-one-trial-out) one set for each.
#[derive(Debug, Clone, PartialEq)]
pub struct Candidate {
    /// Name, for example `identified` or `prior`.
    pub name: String,
    /// Base parameters: one vector, or one for each trial.
    base: Vec<DVector<f64>>,
    /// Effects of this model and their coefficients: one list, or one for each trial.
    effects: Vec<Vec<(String, f64)>>,
}

impl Candidate {
    /// From link parameters (`[m, mc, I]` of every link).
    pub fn links(name: impl Into<String>, base: &BaseParameters, phi: &[Phi]) -> Self {
        Self::base(name, base.regroup(phi))
    }
    /// From base parameters φ_B.
    pub fn base(name: impl Into<String>, parameters: DVector<f64>) -> Self {
        Self { name: name.into(), base: vec![parameters], effects: Vec::new() }
    }
    /// From base parameters for each trial, in the order of the trials: those identified without
    /// that trial.
    pub fn per_trial(name: impl Into<String>, parameters: Vec<DVector<f64>>) -> Self {
        Self { name: name.into(), base: parameters, effects: Vec::new() }
    }
    /// Adds effects. Their columns come with each trial and are found by name; in a trial without
    /// such a column the effect is absent.
    #[must_use]
    pub fn with_effects(mut self, effects: impl IntoIterator<Item = (String, f64)>) -> Self {
        self.effects = vec![effects.into_iter().collect()];
        self
    }
    /// As [`Candidate::with_effects`], with separate coefficients for each trial.
    #[must_use]
    pub fn with_effects_per_trial(mut self, effects: Vec<Vec<(String, f64)>>) -> Self {
        self.effects = effects;
        self
    }
    pub(crate) fn parameters(&self, trial: usize) -> &DVector<f64> {
        &self.base[if self.base.len() == 1 { 0 } else { trial }]
    }
    pub(crate) fn coefficients(&self, trial: usize, columns: &[String]) -> DVector<f64> {
        let of_trial = self.effects.get(if self.effects.len() == 1 { 0 } else { trial });
        DVector::from_fn(columns.len(), |i, _| {
            of_trial.into_iter().flatten().filter(|(name, _)| *name == columns[i]).map(|(_, theta)| theta).sum()
        })
    }
    pub(crate) fn check(&self, body: &Body<'_>, trials: usize) -> Result<(), CompareError> {
        let length = |what, expected, found| CompareError::Length { of: self.name.clone(), what, expected, found };
        if self.base.len() != 1 && self.base.len() != trials {
            return Err(length("sets of base parameters, one for each trial", trials, self.base.len()));
        }
        if self.effects.len() > 1 && self.effects.len() != trials {
            return Err(length("sets of coefficients, one for each trial", trials, self.effects.len()));
        }
        match self.base.iter().find(|b| b.len() != body.base.len()) {
            Some(b) => Err(length("base parameters", body.base.len(), b.len())),
            None => Ok(()),
        }
    }
}

/// Source of the errors of a motion.
pub trait PoseErrors: std::fmt::Debug + Sync {
    /// The motion with one more draw of errors, in the frames for which `wanted` holds; only
    /// coordinates are filled. The same `seed` and `draw` give the same instrument errors in every
    /// trial of a subject.
    fn draw(&self, motion: &Motion, wanted: &dyn Fn(usize) -> bool, seed: u64, draw: u64) -> Motion;

    /// Several draws, as [`PoseErrors::draw`] gives them one by one, each in the frames for which
    /// `wanted` holds of the draw and the frame.
    fn draw_each(
        &self,
        motion: &Motion,
        wanted: &dyn Fn(u64, usize) -> bool,
        seed: u64,
        draws: Range<u64>,
    ) -> Vec<Motion> {
        draws.map(|draw| self.draw(motion, &|f| wanted(draw, f), seed, draw)).collect()
    }

    /// The motion as other geometries of the body would show it that the recordings allow, one for
    /// each draw; none where the geometry is known.
    fn with_geometry(&self, _motion: &Motion, _wanted: &dyn Fn(usize) -> bool) -> Vec<OtherGeometry> {
        Vec::new()
    }
}

/// A body whose geometry is another one.
#[derive(Debug, Clone)]
pub struct OtherGeometry {
    /// Its model.
    pub model: Model,
    /// Its coordinates, which leave the same markers.
    pub motion: Motion,
    /// For each link the motion from the own model's frame that carries its mass along.
    pub overlays: Vec<Isometry3<f64>>,
}

/// One trial.
#[derive(Debug, Clone, Copy)]
pub struct TrialInput<'a> {
    /// Filtered motion with velocities and accelerations.
    pub motion: &'a Motion,
    /// The same motion before filtering, for weak windows and the noise floor; without it neither
    /// is computed.
    pub unfiltered: Option<&'a Motion>,
    /// Measured wrench at the motion's frames, tared if possible; without plates only the flights
    /// of the trial are used.
    pub measured: Option<&'a Measured>,
    /// Flights, `first..end` (end not included).
    pub flights: &'a [Range<usize>],
    /// Frames in which everything that the body touches is measured; all if absent.
    pub complete: Option<&'a [bool]>,
    /// Errors of this trial's markers, from which the noise floor is drawn. Without them the floor
    /// uses white noise of the coordinates, estimated from the motion itself, and contains no soft
    /// tissue.
    pub errors: Option<&'a dyn PoseErrors>,
    /// Drift of the plates, for the noise floor; none if absent.
    pub drift: Option<&'a PlateDrift>,
    /// Columns of effects at the motion's frames.
    pub effects: Option<&'a EffectColumns>,
    /// Their wrenches through the filter of the motion, for the comparison frame by frame; none
    /// where they are compared unfiltered.
    pub effects_filtered: Option<&'a [DMatrix<f64>]>,
    /// True when no contact frame of this trial was used to identify any of the models.
    pub held_out_contact: bool,
    /// True when no flight of this trial was used to identify any of the models.
    pub held_out_flight: bool,
    /// True when a plate was loaded all the time, so that its unloaded reading is unknown. A
    /// constant wrench is then subtracted from the recording for each model
    /// ([`RecordingOffset`](crate::RecordingOffset)). No effect on a trial that has flights.
    pub untared: bool,
    /// Range of that constant by the plates' readings in other recordings; unlimited if absent.
    pub offset_range: Option<OffsetRange>,
}

impl<'a> TrialInput<'a> {
    /// A held-out trial without plates; set further fields as needed.
    pub fn new(motion: &'a Motion, flights: &'a [Range<usize>]) -> Self {
        Self {
            motion,
            unfiltered: None,
            measured: None,
            flights,
            complete: None,
            errors: None,
            drift: None,
            effects: None,
            effects_filtered: None,
            held_out_contact: true,
            held_out_flight: true,
            untared: false,
            offset_range: None,
        }
    }
    pub(crate) fn check(&self, body: &Body<'_>) -> Result<(), CompareError> {
        let m = self.motion;
        let n = m.n_frames();
        let length = |what, expected, found| {
            if expected == found {
                Ok(())
            } else {
                Err(CompareError::Length { of: m.trial.clone(), what, expected, found })
            }
        };
        length("coordinates a frame", body.model.nq, m.nq)?;
        length("velocities a frame", body.model.nv, m.nv)?;
        for (series, missing) in [(&m.v, "velocities"), (&m.a, "accelerations")] {
            if series.len() != n * m.nv {
                return Err(CompareError::NotFiltered { trial: m.trial.clone(), missing });
            }
        }
        if let Some(u) = self.unfiltered {
            length("coordinates a frame of the unfiltered motion", m.nq, u.nq)?;
            length("frames of the unfiltered motion", n, u.n_frames())?;
        }
        if let Some(w) = self.measured {
            length("frames of the measured wrench", n, w.filtered.len())?;
            length("frames of the unfiltered measured wrench", n, w.unfiltered.len())?;
        }
        if let Some(c) = self.complete {
            length("frames of the mask of complete measurement", n, c.len())?;
        }
        if let Some(e) = self.effects.filter(|e| !e.names.is_empty()) {
            length("frames of the effect columns", n, e.wrench.len())?;
            if let Some(filtered) = self.effects_filtered {
                length("frames of the filtered effect columns", n, filtered.len())?;
            }
            for w in e.wrench.iter().chain(self.effects_filtered.into_iter().flatten()) {
                length("effect columns of a frame", 6 * e.names.len(), w.len())?;
            }
        }
        Ok(())
    }
}

/// Options of a comparison.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct CompareOptions {
    /// Contact excluded on both sides of a flight, s.
    pub edge_s: f64,
    /// Time excluded at both ends of a flight, s: the time over which the filter spreads contact
    /// forces into it.
    pub flight_margin_s: f64,
    /// Frames excluded at both ends of every run without gaps, because of the filter's end effects.
    pub end_margin_frames: usize,
    /// Contact this close to a flight is called take-off or landing, s.
    pub transition_s: f64,
    /// Length of the weak windows in contact, s.
    pub window_s: f64,
    /// Length of the weak windows in flight, s; none: chosen by the length of each flight, as for
    /// the rows used in identification.
    pub flight_window_s: Option<f64>,
    /// Number of noise draws for the noise floor over weak windows (0: no floor is estimated).
    pub noise_draws: usize,
    /// Number of these draws that are filtered as well, for the noise floor on frames.
    pub frame_draws: usize,
    /// Standard deviation of the logarithm of true error over floor between bodies that the draws
    /// do not show: it widens the floor's interval.
    pub floor_spread: f64,
    /// Seed of the drawn noise.
    pub seed: u64,
    /// Mass of the body from a scale, kg. While the offset of an untared recording is estimated,
    /// each model is scaled to this mass, so that the offset does not hide a wrong mass. Without
    /// it, each model keeps its own mass.
    pub mass_kg: Option<f64>,
}

impl Default for CompareOptions {
    fn default() -> Self {
        Self {
            edge_s: 0.05,
            flight_margin_s: 0.07,
            end_margin_frames: 10,
            transition_s: 0.3,
            window_s: 0.3,
            flight_window_s: None,
            noise_draws: 8,
            frame_draws: 1,
            floor_spread: 0.0,
            seed: 1,
            mass_kg: None,
        }
    }
}

/// Data kept of a trial after its frames have been compared.
#[derive(Debug, Clone)]
pub(crate) struct TrialFacts {
    pub name: String,
    pub n_frames: usize,
    pub flights: usize,
    pub held_out_contact: bool,
    pub held_out_flight: bool,
    /// True if an offset of the recording is to be estimated.
    pub sought: bool,
}

impl TrialFacts {
    pub fn of(input: &TrialInput<'_>) -> Self {
        Self {
            name: input.motion.trial.clone(),
            n_frames: input.motion.n_frames(),
            flights: input.flights.len(),
            held_out_contact: input.held_out_contact,
            held_out_flight: input.held_out_flight,
            sought: crate::offset::sought(input),
        }
    }
}
