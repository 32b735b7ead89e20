//! Comparison of models with measurements over all trials.

use crate::breakdown::{Counting, Grouping};
use crate::errors::{Sums, WrenchSums, halves};
use crate::follows::correlation_in_time;
use crate::frames::{TrialFrames, trial_frames};
use crate::input::TrialFacts;
use crate::noise_floor::{TrialFloor, explainable, trial_floor};
use crate::segments::SegmentSums;
use crate::windows::{TrialWindows, trial_windows};
use crate::wording::{describe, describe_beside, worst_places};
use crate::{
    Body, Candidate, CompareError, CompareOptions, FlightErrors, Floor, Group, NoiseFloor, RecordingOffset,
    SegmentShare, Smooth, TrialInput, TrialSeries, WindowErrors, WrenchErrors,
};
use aloft_regressor::limits::{at_floor, times_floor};
use aloft_signal::LowPass;
use nalgebra::Vector6;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

/// One model compared with the measurements of all trials.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct ModelComparison {
    /// Name of the model.
    pub model: String,
    /// Frames in contact of held-out trials. Empty if no trial is held out; the breakdown then
    /// covers all trials. The offset of untared recordings is subtracted, as in every figure not
    /// marked "as measured".
    pub held_out: WrenchErrors,
    /// The same over weak windows.
    pub held_out_weak: WindowErrors,
    /// As `held_out`, without subtracting the offset of untared recordings; equal if there are
    /// none.
    pub held_out_as_measured: WrenchErrors,
    /// As `held_out_weak`, without subtracting the offset.
    pub held_out_weak_as_measured: WindowErrors,
    /// Residual wrench in flight: of held-out flights if there are any, else of all.
    pub flight: FlightErrors,
    /// The same frames, root and world axes.
    pub flight_wrench: WrenchErrors,
    /// The same over weak windows.
    pub flight_weak: WindowErrors,
    /// Trial by trial.
    pub trials: Vec<TrialComparison>,
    /// By trial, phase, flight, time in flight, speed, acceleration, turning, posture: of held-out
    /// frames if there are any, else of all.
    pub breakdown: Vec<Group>,
    /// Link by link, the largest share first; over contact, or over flights without contact.
    pub segments: Vec<SegmentShare>,
    /// Link by link over flights; empty without flights.
    #[serde(default)]
    pub segments_in_flight: Vec<SegmentShare>,
}

/// One trial of one model.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct TrialComparison {
    /// Name.
    pub trial: String,
    /// True when its contact was not used to identify.
    pub held_out_contact: bool,
    /// True when its flights were not used to identify.
    pub held_out_flight: bool,
    /// Number of flights.
    pub flights: usize,
    /// True when its plates were never unloaded ([`TrialInput::untared`], and no flights).
    pub untared: bool,
    /// Offset subtracted for this model; none if the plates were tared, the contact was too short
    /// for an offset (2 s), or the model has no mass that could be scaled to the known one.
    pub offset: Option<RecordingOffset>,
    /// Frames in contact, the offset subtracted.
    pub contact: WrenchErrors,
    /// Frames in flight (the measured wrench is zero).
    pub flight: WrenchErrors,
    /// Weak windows in contact, the offset subtracted.
    pub contact_weak: WindowErrors,
    /// Frames in contact, without subtracting the offset.
    pub contact_as_measured: WrenchErrors,
    /// Weak windows in contact, without subtracting the offset.
    pub contact_weak_as_measured: WindowErrors,
    /// Weak windows in flight.
    pub flight_weak: WindowErrors,
    /// Correlation in time of the sizes of predicted and measured force in contact; none where the
    /// force hardly changes.
    #[serde(default)]
    pub plates_correlation: Option<f64>,
}

/// The whole comparison: the first model in full, then the others.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(from = "StoredComparison")]
pub struct Comparison {
    /// The first model.
    #[serde(flatten)]
    pub first: ModelComparison,
    /// The other models, on the same frames of the same motion.
    pub beside: Vec<ModelComparison>,
    /// Errors of the first model axis by axis, body and world.
    #[serde(default)]
    pub axes: Vec<AxisRow>,
    /// Error of the first model relative to the noise floor: in flight, then in held-out contact.
    #[serde(default)]
    pub against_floor: Vec<AgainstFloor>,
    /// Error that a perfect model would leave; none where no unfiltered motion was given or no
    /// draws were asked for.
    pub noise_floor: Option<NoiseFloor>,
    /// Options of the comparison.
    pub options: CompareOptions,
    /// Where the first model's error stands out, the most useful first.
    #[serde(default)]
    pub worst: Vec<WorstPlace>,
    /// Where the first model has its largest errors, in words.
    pub words: Vec<String>,
    /// The other models' errors in words.
    #[serde(default)]
    pub words_beside: Vec<BesideWords>,
}

/// A comparison as it is stored, with the fields of the first model named one by one: fields behind
/// `flatten` are held before their types are known, and a number that is not defined could not be
/// read.
#[derive(Deserialize)]
struct StoredComparison {
    model: String,
    held_out: WrenchErrors,
    held_out_weak: WindowErrors,
    held_out_as_measured: WrenchErrors,
    held_out_weak_as_measured: WindowErrors,
    flight: FlightErrors,
    flight_wrench: WrenchErrors,
    flight_weak: WindowErrors,
    trials: Vec<TrialComparison>,
    breakdown: Vec<Group>,
    segments: Vec<SegmentShare>,
    #[serde(default)]
    segments_in_flight: Vec<SegmentShare>,
    beside: Vec<ModelComparison>,
    #[serde(default)]
    axes: Vec<AxisRow>,
    #[serde(default)]
    against_floor: Vec<AgainstFloor>,
    noise_floor: Option<NoiseFloor>,
    options: CompareOptions,
    #[serde(default)]
    worst: Vec<WorstPlace>,
    words: Vec<String>,
    #[serde(default)]
    words_beside: Vec<BesideWords>,
}

impl From<StoredComparison> for Comparison {
    fn from(s: StoredComparison) -> Self {
        Self {
            first: ModelComparison {
                model: s.model,
                held_out: s.held_out,
                held_out_weak: s.held_out_weak,
                held_out_as_measured: s.held_out_as_measured,
                held_out_weak_as_measured: s.held_out_weak_as_measured,
                flight: s.flight,
                flight_wrench: s.flight_wrench,
                flight_weak: s.flight_weak,
                trials: s.trials,
                breakdown: s.breakdown,
                segments: s.segments,
                segments_in_flight: s.segments_in_flight,
            },
            beside: s.beside,
            axes: s.axes,
            against_floor: s.against_floor,
            noise_floor: s.noise_floor,
            options: s.options,
            worst: s.worst,
            words: s.words,
            words_beside: s.words_beside,
        }
    }
}

/// The error of another model in words.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct BesideWords {
    /// Name of the model.
    pub model: String,
    /// One sentence.
    pub words: String,
}

/// A trial, flight, phase or part of a flight whose error stands out.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct WorstPlace {
    /// `trial`, `phase`, `flight` or `part of the flight`.
    pub what: String,
    /// Name.
    pub name: String,
    /// Its error over the median error of its kind.
    pub times_median: f64,
}

impl Comparison {
    /// All models, the first one first.
    pub fn models(&self) -> impl Iterator<Item = &ModelComparison> {
        std::iter::once(&self.first).chain(&self.beside)
    }
    /// Share of the first model's mean square error not explained by noise, `(frames, weak
    /// windows)`, in contact if there is held-out contact, else in flight.
    pub fn explainable(&self) -> Option<(f64, f64)> {
        let floor = self.noise_floor.as_ref()?;
        let m = &self.first;
        let share = explainable;
        Some(if m.held_out.frames > 0 {
            (share(m.held_out.size(), floor.contact.size()), share(m.held_out_weak.size(), floor.contact_weak.size()))
        } else {
            (share(m.flight_wrench.size(), floor.flight.size()), share(m.flight_weak.size(), floor.flight_weak.size()))
        })
    }
}

/// The held-out error over weak windows of one kind of motion, with the noise floor.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct AgainstFloor {
    /// `flight` or `contact`.
    pub judged_on: String,
    /// Held-out error of the model, N: force, and moment over a lever of 0.1 m.
    pub held_out_error: f64,
    /// Its force alone: root mean square of the length of the force error, N. None in comparisons
    /// made before it was stored.
    #[serde(default)]
    pub held_out_force_n: Option<f64>,
    /// Its moment alone, N·m.
    #[serde(default)]
    pub held_out_moment_nm: Option<f64>,
    /// Number of windows.
    #[serde(default)]
    pub windows: usize,
    /// Error that a perfect model would leave; none if it was not estimated.
    pub floor: Option<Floor>,
    /// Held-out error over floor; none where the floor is known too roughly to judge the error.
    pub times_floor: Option<f64>,
    /// True if a perfect model could have left as much: the error is not above the floor's
    /// interval.
    pub at_floor: Option<bool>,
}

impl AgainstFloor {
    fn of(judged_on: &str, errors: &WindowErrors, floor: Option<Floor>) -> Option<Self> {
        let held_out_error = errors.size();
        (errors.windows > 0).then(|| Self {
            judged_on: judged_on.to_owned(),
            held_out_error,
            held_out_force_n: Some(errors.force_n.norm_rms()),
            held_out_moment_nm: Some(errors.moment_nm.norm_rms()),
            windows: errors.windows,
            floor,
            times_floor: floor.and_then(|f| times_floor(held_out_error, f.noise_floor, f.ci95)),
            at_floor: floor.and_then(|f| at_floor(held_out_error, f.noise_floor, f.ci95)),
        })
    }
    /// Both kinds of motion, where there are windows.
    fn both(model: &ModelComparison, floor: Option<&NoiseFloor>) -> Vec<Self> {
        let flight = Self::of("flight", &model.flight_weak, floor.and_then(|f| f.flight_floor));
        let contact = Self::of("contact", &model.held_out_weak, floor.and_then(|f| f.contact_floor));
        flight.into_iter().chain(contact).collect()
    }
}

/// The error along one axis, with the part caused by noise.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct AxisRow {
    /// `body` (root axes) or `world`.
    pub axes: String,
    /// `x`, `y` or `z`.
    pub axis: String,
    /// Force, N: root mean square, signed mean, root mean square of the noise.
    #[serde(with = "crate::errors::nullable")]
    pub force_n: [f64; 3],
    /// Moment, N·m, in the same order.
    #[serde(with = "crate::errors::nullable")]
    pub moment_nm: [f64; 3],
    /// Share of the mean square not explained by noise, force and moment; none where the noise is
    /// unknown.
    pub explainable: [Option<f64>; 2],
}

fn axis_rows(errors: &WrenchErrors, floor: Option<&WrenchErrors>) -> Vec<AxisRow> {
    let floor = floor.filter(|f| f.frames > 0);
    let mut out = Vec::new();
    for axes in ["body", "world"] {
        let pick = |e: &WrenchErrors| {
            if axes == "body" { (e.force_n, e.moment_nm) } else { (e.force_world_n, e.moment_world_nm) }
        };
        let (force, moment) = pick(errors);
        let noise = floor.map(pick);
        for (i, axis) in ["x", "y", "z"].into_iter().enumerate() {
            let of_noise =
                |which: usize| noise.map_or(f64::NAN, |n| if which == 0 { n.0.rmse[i] } else { n.1.rmse[i] });
            let share =
                |rmse: f64, noise: f64| (rmse.is_finite() && noise.is_finite()).then(|| explainable(rmse, noise));
            out.push(AxisRow {
                axes: axes.to_owned(),
                axis: axis.to_owned(),
                force_n: [force.rmse[i], force.bias[i], of_noise(0)],
                moment_nm: [moment.rmse[i], moment.bias[i], of_noise(1)],
                explainable: [share(force.rmse[i], of_noise(0)), share(moment.rmse[i], of_noise(1))],
            });
        }
    }
    out
}

/// How the motion was filtered, so that drawn noise can be filtered the same way.
#[derive(Clone, Copy)]
pub struct Filtering<'a> {
    /// The filter of motion and plates.
    pub filter: Option<LowPass>,
    /// Filters a motion and takes its derivatives, as was done for [`TrialInput::motion`].
    pub smooth: Smooth<'a>,
}

/// Source of the noise floor.
#[derive(Clone, Copy)]
pub enum Noise<'a> {
    /// No noise floor.
    Unknown,
    /// Estimated by drawing noise and processing it like the data, with the parameters of a model
    /// (the first one if none is given).
    Drawn {
        /// How the motion was filtered.
        filtering: Filtering<'a>,
        /// The model.
        of: Option<&'a Candidate>,
    },
    /// Taken from an earlier comparison of the same motion with the same options.
    Known(&'a NoiseFloor),
}

/// Compares models of one body with the measurements of several trials. Trials run in parallel; the
/// result does not depend on scheduling.
///
/// The second element of the result holds the series of each trial, for plots.
///
/// # Errors
/// No model; lengths that do not fit; motions without derivatives.
pub fn compare(
    body: &Body<'_>,
    candidates: &[Candidate],
    trials: &[TrialInput<'_>],
    noise: Noise<'_>,
    options: &CompareOptions,
) -> Result<(Comparison, Vec<TrialSeries>), CompareError> {
    compare_each(body, candidates, trials.len(), |i| Ok(&trials[i]), |_, t| **t, noise, options)
}

/// Results of one trial.
struct Compared {
    facts: TrialFacts,
    frames: TrialFrames,
    windows: TrialWindows,
    floor: TrialFloor,
}

/// The same for trials that are read on demand and dropped afterwards: no more of them are in
/// memory than there are threads. `read` gives a trial by its index, `input` borrows it as input.
///
/// # Errors
/// As [`compare`], and those of `read`.
pub fn compare_each<T, E: From<CompareError> + Send>(
    body: &Body<'_>,
    candidates: &[Candidate],
    trials: usize,
    read: impl Fn(usize) -> Result<T, E> + Sync,
    input: impl for<'a> Fn(usize, &'a T) -> TrialInput<'a> + Sync,
    noise: Noise<'_>,
    options: &CompareOptions,
) -> Result<(Comparison, Vec<TrialSeries>), E> {
    let first = candidates.first().ok_or(CompareError::NoModel)?;
    check_body(body)?;
    candidates.iter().try_for_each(|c| c.check(body, trials))?;
    let drawn = match noise {
        Noise::Drawn { filtering, of } if options.noise_draws > 0 => {
            let of = of.unwrap_or(first);
            of.check(body, trials)?;
            Some((filtering, of))
        }
        _ => None,
    };
    let one = |i: usize| -> Result<Compared, E> {
        let trial = read(i)?;
        let input = input(i, &trial);
        input.check(body)?;
        let frames = trial_frames(body, candidates, i, &input, options);
        let windows = trial_windows(body, candidates, i, &input, &frames.offsets, options)?;
        let floor = match drawn {
            Some((Filtering { filter, smooth }, of)) => trial_floor(body, of, i, &input, filter, smooth, options)?,
            None => TrialFloor::default(),
        };
        Ok(Compared { facts: TrialFacts::of(&input), frames, windows, floor })
    };
    let all: Vec<Compared> = (0..trials).into_par_iter().map(one).collect::<Result<_, E>>()?;
    let (mut facts, mut frames) = (Vec::with_capacity(trials), Vec::with_capacity(trials));
    let (mut windows, mut floors) = (Vec::with_capacity(trials), Vec::with_capacity(trials));
    for c in all {
        facts.push(c.facts);
        frames.push(c.frames);
        windows.push(c.windows);
        floors.push(c.floor);
    }
    let counting = Counting::new(&facts, &frames);
    let grouping = Grouping::new(&facts, &frames, &counting);
    let noise_floor = match noise {
        Noise::Known(floor) => Some(floor.clone()),
        _ => drawn.and_then(|_| NoiseFloor::of(&floors, &facts, &counting, &grouping, options.floor_spread)),
    };
    drop(floors);
    let models: Vec<ModelComparison> = candidates
        .par_iter()
        .enumerate()
        .map(|(c, candidate)| {
            let mut model = model_comparison(body, candidate, c, &facts, &frames, &windows, &counting);
            model.breakdown = grouping.breakdown(&frames, &windows, c);
            model
        })
        .collect();
    let mut models = models.into_iter();
    let Some(first) = models.next() else { return Err(CompareError::NoModel.into()) };
    let beside: Vec<ModelComparison> = models.collect();
    let against_floor = AgainstFloor::both(&first, noise_floor.as_ref());
    let worst = worst_places(&first);
    let words = describe(&first, noise_floor.as_ref(), &against_floor);
    let words_beside = describe_beside(&beside, &against_floor);
    let axes = if first.held_out.frames > 0 {
        axis_rows(&first.held_out, noise_floor.as_ref().map(|f| &f.contact))
    } else {
        axis_rows(&first.flight_wrench, noise_floor.as_ref().map(|f| &f.flight))
    };
    let options = *options;
    let comparison =
        Comparison { first, beside, axes, against_floor, noise_floor, options, worst, words, words_beside };
    let with_windows = |(frames, windows): (TrialFrames, TrialWindows)| TrialSeries {
        windows: windows.windows.into_iter().map(|w| w.into_sample(&frames.series.time_s)).collect(),
        ..frames.series
    };
    Ok((comparison, frames.into_iter().zip(windows).map(with_windows).collect()))
}

fn check_body(body: &Body<'_>) -> Result<(), CompareError> {
    let links = body.model.n_links();
    let length = |what, expected, found| {
        if expected == found {
            Ok(())
        } else {
            Err(CompareError::Length { of: body.model.name.clone(), what, expected, found })
        }
    };
    length("link parameters that the base parameters regroup", 10 * links, body.base.from_full.ncols())?;
    length("links of the prior", links, body.prior.len())
}

/// Correlation in time of one model's force with that of the plates, over the frames in contact.
fn plates_correlation(series: &TrialSeries, c: usize) -> Option<f64> {
    let contact = |f: &usize| series.phase[*f].is_some_and(|p| p.is_contact());
    let sizes = |wrenches: &[Vector6<f64>]| -> Vec<f64> {
        let at = |f: usize| if contact(&f) { halves(&wrenches[f]).0.norm() } else { f64::NAN };
        (0..series.phase.len()).map(at).collect()
    };
    let rate_hz = series.time_s.get(1).map_or(f64::NAN, |t| (t - series.time_s[0]).recip());
    correlation_in_time(&sizes(&series.predicted[c]), &sizes(&series.measured), rate_hz)
}

fn model_comparison(
    body: &Body<'_>,
    candidate: &Candidate,
    c: usize,
    inputs: &[TrialFacts],
    frames: &[TrialFrames],
    windows: &[TrialWindows],
    counting: &Counting,
) -> ModelComparison {
    let (mut contact, mut flight) = (WrenchSums::default(), WrenchSums::default());
    let (mut contact_weak, mut flight_weak) = (Sums::default(), Sums::default());
    let (mut as_measured, mut weak_as_measured) = (WrenchSums::default(), Sums::default());
    let mut contact_segments =
        SegmentSums::new(body.model.n_links(), inputs.first().map_or(0, |_| segments_of(frames)));
    let mut flight_segments = contact_segments.clone();
    let mut trials = Vec::with_capacity(inputs.len());
    for ((input, frames), windows) in inputs.iter().zip(frames).zip(windows) {
        let (mut of_contact, mut of_flight) = (WrenchSums::default(), WrenchSums::default());
        for r in &frames.records {
            let sums = if r.place.phase.is_contact() { &mut of_contact } else { &mut of_flight };
            sums.add(&r.residual[c], &r.world_from_root.rotation);
        }
        if input.held_out_contact {
            contact.merge(&of_contact);
            contact_weak.merge(&windows.contact[c]);
            as_measured.merge(&frames.contact_as_measured[c]);
            weak_as_measured.merge(&windows.contact_as_measured[c]);
        }
        if counting.contact(input) {
            contact_segments.merge(&frames.contact_segments);
        }
        if counting.flight(input) {
            flight.merge(&of_flight);
            flight_weak.merge(&windows.flight[c]);
            flight_segments.merge(&frames.flight_segments);
        }
        trials.push(TrialComparison {
            trial: input.name.clone(),
            held_out_contact: input.held_out_contact,
            held_out_flight: input.held_out_flight,
            flights: input.flights,
            untared: input.sought,
            offset: frames.offsets[c],
            contact: of_contact.errors(),
            flight: of_flight.errors(),
            contact_weak: windows.contact[c].windows(),
            flight_weak: windows.flight[c].windows(),
            contact_as_measured: frames.contact_as_measured[c].errors(),
            contact_weak_as_measured: windows.contact_as_measured[c].windows(),
            plates_correlation: plates_correlation(&frames.series, c),
        });
    }
    let flight_wrench = flight.errors();
    let any_flight = frames.iter().any(|t| t.records.iter().any(|r| !r.place.phase.is_contact()));
    let any_contact = frames.iter().any(|t| t.records.iter().any(|r| r.place.phase.is_contact()));
    let segments = if inputs.is_empty() {
        Vec::new()
    } else if any_contact {
        contact_segments.shares(body.model, c)
    } else {
        flight_segments.shares(body.model, c)
    };
    ModelComparison {
        model: candidate.name.clone(),
        held_out: contact.errors(),
        held_out_weak: contact_weak.windows(),
        held_out_as_measured: as_measured.errors(),
        held_out_weak_as_measured: weak_as_measured.windows(),
        flight: (&flight_wrench).into(),
        flight_wrench,
        flight_weak: flight_weak.windows(),
        trials,
        breakdown: Vec::new(),
        segments,
        segments_in_flight: if any_flight && !inputs.is_empty() {
            flight_segments.shares(body.model, c)
        } else {
            Vec::new()
        },
    }
}

/// Number of models for which segment sums are formed.
fn segments_of(frames: &[TrialFrames]) -> usize {
    frames.first().map_or(0, |f| f.series.predicted.len())
}
