//! Combines the evidence of plates and motion.

use crate::centre_of_mass::CentreOfMass;
use crate::explain::Clues;
use crate::free_acceleration::{Acceleration, inner};
use crate::free_fall::FreeFall;
use crate::from_motion::{Found, PlateEvidence, search, shortest_frames};
use crate::from_plates::{Unloaded, centroid_fall, frames_in, unloaded_stretches};
use crate::parabola::Parabola;
use crate::{
    EdgeSource, Flight, FlightError, FlightMethod, FlightOptions, FlightReport, FlightSource, FlightWarning, Rejected,
    RejectionReason, from_plates, plate_wrench_at_marker_rate, total_wrench,
};
use aloft_body::{Model, Motion, Phi};
use aloft_signal::upper_median;
use aloft_trial::{Markers, Trial};
use nalgebra::Vector3;
use std::ops::Range;

/// Tolerated time difference between plates and motion, in addition to the guards, without a
/// warning, s.
const AGREEMENT_S: f64 = 0.02;
/// Largest relative difference between the mean acceleration of a flight with unsteady motion,
/// found by plates, and that of the other flights.
const UNSTEADY: f64 = 0.2;
/// A body at rest accelerates by less than this fraction of gravity …
const AT_REST: f64 = 0.05;
/// … for at least this long in total, s.
const LEAST_REST_S: f64 = 0.15;

/// The flights that are stated, where the motion is solved.
fn stated(trial: &Trial, motion: Option<&Motion>, options: &FlightOptions) -> FlightReport {
    /// Fewest frames with an acceleration.
    const FEWEST: usize = 6;
    let n = motion.map_or(trial.markers.n_frames, Motion::n_frames);
    let rate_hz = motion.map_or(trial.markers.rate_hz, |m| m.rate_hz);
    let frame = |s: f64| ((s * rate_hz).round().max(0.0) as usize).min(n);
    let spans: Vec<Range<usize>> = match options.stated_s.as_slice() {
        [] => vec![0..n; 1],
        stated => stated.iter().map(|[from, to]| frame(*from)..frame(*to)).collect(),
    };
    let mut report = FlightReport { trial: trial.name.clone(), rate_hz, ..FlightReport::default() };
    for span in spans {
        let solved = |i: usize| motion.is_none_or(|m| m.is_valid(span.start + i));
        for run in aloft_signal::runs_where(span.len(), solved) {
            let (start, end) = (span.start + run.start, span.start + run.end);
            if run.len() < FEWEST {
                report.rejected.push(Rejected { start, end, reason: RejectionReason::TooShort });
                continue;
            }
            report.flights.push(Flight {
                start,
                end,
                source: FlightSource::Stated,
                takeoff_source: EdgeSource::Stated,
                landing_source: EdgeSource::Stated,
                mean_acceleration_mps2: [f64::NAN; 3],
            });
        }
    }
    report
}

/// Finds the flights of a trial with whatever it has: plates, motion (with model and prior
/// inertias), or both.
///
/// # Errors
/// The method requires data that the trial lacks, or `from_motion` fails.
pub fn find_flights(
    trial: &Trial,
    motion: Option<(&Model, &[Phi], &Motion)>,
    options: &FlightOptions,
) -> Result<FlightReport, FlightError> {
    let missing = |method, missing| FlightError::Missing { trial: trial.name.clone(), method, missing };
    let (n_frames, rate_hz) = (trial.markers.n_frames, trial.markers.rate_hz);
    let gravity =
        motion.map_or_else(|| Vector3::new(0.0, 0.0, -options.gravity_mps2), |(model, ..)| model.gravity_mps2);
    let bare = FlightOptions { margin_frames: 0, gravity_mps2: gravity.norm(), ..options.clone() };
    let (mut report, path) = match (options.method, motion, trial.plates.is_empty()) {
        (FlightMethod::Stated, _, _) => {
            let mut report = stated(trial, motion.map(|m| m.2), options);
            let path = match motion {
                Some((model, phi, motion)) => Some(weigh_flights(&mut report, model, phi, motion)?),
                None => None,
            };
            (report, path)
        }
        (FlightMethod::Plates, _, true) => return Err(missing("plates", "force plates")),
        (FlightMethod::Motion, None, _) => return Err(missing("motion", "a motion")),
        (FlightMethod::Auto, None, true) => return Err(missing("auto", "force plates or a motion")),
        (FlightMethod::Plates, _, false) | (FlightMethod::Auto, None, false) => {
            let mut report = from_plates(trial, n_frames, rate_hz, &bare);
            let path = match motion {
                Some((model, phi, motion)) => Some(weigh_flights(&mut report, model, phi, motion)?),
                None => None,
            };
            (report, path)
        }
        (FlightMethod::Motion, Some((model, phi, motion)), _)
        | (FlightMethod::Auto, Some((model, phi, motion)), true) => {
            let found = search(model, phi, motion, &bare, None)?;
            (found.report, Some(found.com_m))
        }
        (FlightMethod::Auto, Some((model, phi, motion)), false) => {
            let found = search(model, phi, motion, &bare, plate_evidence(trial, &bare).as_ref())?;
            (join(trial, motion, &found.report, Some(&found), &bare), Some(found.com_m))
        }
    };
    report.free_fall = FreeFall::of(&report.flights, &gravity, rate_hz, &bare, &Clues::default());
    if let (Some((_, phi, motion)), Some(path)) = (motion, path)
        && report.free_fall.as_ref().is_some_and(|f| f.differs)
    {
        let clues = clues(trial, phi, motion, &path, &report, &bare)?;
        report.free_fall = FreeFall::of(&report.flights, &gravity, rate_hz, &bare, &clues);
    }
    let off = report.free_fall.as_ref().and_then(FreeFall::warning);
    report.warnings.extend(off.map(|words| FlightWarning::FreeFall { words }));
    report.apply_margin(options.margin_frames, shortest_frames(rate_hz, options));
    Ok(report)
}

/// Evidence of the plates for each frame; `None` if no plate is ever stepped on or left.
fn plate_evidence(trial: &Trial, options: &FlightOptions) -> Option<PlateEvidence> {
    let (stretches, _) = unloaded_stretches(trial, options);
    if !stretches.iter().any(|s| s.loaded_before || s.loaded_after) {
        return None;
    }
    let frames = |s: &Unloaded| frames_in(s.from_s, s.to_s, trial.markers.n_frames, trial.markers.rate_hz);
    let mut unloaded = vec![false; trial.markers.n_frames];
    for s in &stretches {
        unloaded[frames(s)].fill(true);
    }
    let between_loads = stretches.iter().filter(|s| s.loaded_before && s.loaded_after).map(frames).collect();
    Some(PlateEvidence { unloaded, between_loads })
}

/// Sets the mean acceleration of the centre of mass in flights found by plates; returns the path of
/// the centre of mass, m.
fn weigh_flights(
    report: &mut FlightReport,
    model: &Model,
    phi: &[Phi],
    motion: &Motion,
) -> Result<Vec<Vector3<f64>>, FlightError> {
    let path = CentreOfMass::new(model, phi, motion)?.position_m;
    for flight in &mut report.flights {
        let frames = flight.start..flight.end.min(path.len()).max(flight.start);
        if let Some(parabola) = Parabola::fit(&path, frames, report.rate_hz) {
            flight.mean_acceleration_mps2 = parabola.acceleration_mps2().into();
        }
    }
    Ok(path)
}

/// Evidence outside the flights: the weight on the plates at rest, and the extent of the markers.
fn clues(
    trial: &Trial,
    phi: &[Phi],
    motion: &Motion,
    path: &[Vector3<f64>],
    report: &FlightReport,
    options: &FlightOptions,
) -> Result<Clues, FlightError> {
    let mass_kg: f64 = phi.iter().map(|p| p[0]).sum();
    let mut out = Clues { mass_kg, ..Clues::default() };
    if !trial.plates.is_empty() && options.gravity_mps2 > 0.0 && report.tare.len() == trial.plates.len() {
        let markers =
            Markers { rate_hz: trial.markers.rate_hz, n_frames: trial.markers.n_frames, ..Markers::default() };
        let mut tared = Trial { name: trial.name.clone(), plates: trial.plates.clone(), markers, ..Trial::default() };
        for (plate, tare) in tared.plates.iter_mut().zip(&report.tare) {
            for force in &mut plate.force_n {
                *force -= tare.force_n[0];
            }
        }
        let total = total_wrench(&plate_wrench_at_marker_rate(&tared, None)?);
        let acceleration = Acceleration::of(path, motion, options, 1.0)?;
        let mut loads: Vec<f64> = acceleration
            .mps2
            .iter()
            .zip(&total.force_n)
            .filter(|(a, f)| a.norm() < AT_REST * options.gravity_mps2 && f.z > options.threshold_n)
            .map(|(_, f)| f.z)
            .collect();
        if loads.len() as f64 > LEAST_REST_S * motion.rate_hz {
            out.rest_share = upper_median(&mut loads).map(|load| load / (mass_kg * options.gravity_mps2));
        }
    }
    if let Some(stature_m) = options.stature_m.filter(|s| *s > 0.0) {
        let needed = trial.markers.trajectories.len() * 7 / 10;
        let extent = |frame: usize| {
            let heights: Vec<f64> = trial
                .markers
                .trajectories
                .iter()
                .filter_map(|t| t.get(frame))
                .map(|p| p.z)
                .filter(|z| z.is_finite())
                .collect();
            let reach = heights.iter().fold([f64::INFINITY, f64::NEG_INFINITY], |r, z| [r[0].min(*z), r[1].max(*z)]);
            (heights.len() > needed.max(5)).then_some(reach[1] - reach[0])
        };
        let mut extents: Vec<f64> = (0..trial.markers.n_frames).filter_map(extent).collect();
        out.extent_share = upper_median(&mut extents).map(|extent| extent / stature_m);
    }
    Ok(out)
}

/// Combines flights from motion with the plates of the trial.
///
/// If both detect a flight, the plates define its edges, unless motion ends it earlier by more than
/// 20 ms and the guard (contact beside the plates). A flight detected by motion alone is accepted
/// if the plates are unloaded in it; one detected by plates alone is accepted if the motion was not
/// solved there.
pub fn combine(trial: &Trial, motion: &Motion, by_motion: &FlightReport, options: &FlightOptions) -> FlightReport {
    join(trial, motion, by_motion, None, options)
}

/// As [`combine`]. If the centre of mass is given, a flight between two loads of the plates is also
/// accepted where the motion is too unsteady to find its edges, provided that its mean acceleration
/// agrees with that of the others.
fn join(
    trial: &Trial,
    motion: &Motion,
    by_motion: &FlightReport,
    found: Option<&Found>,
    options: &FlightOptions,
) -> FlightReport {
    let (n_frames, rate_hz) = (trial.markers.n_frames, trial.markers.rate_hz);
    let by_plates = from_plates(trial, n_frames, rate_hz, options);
    let (stretches, _) = unloaded_stretches(trial, options);
    let shortest = ((options.min_duration_s * rate_hz).round() as usize).max(6);
    let guard_s = options.takeoff_guard_s.max(options.landing_guard_s);
    let tolerance = ((AGREEMENT_S + guard_s) * rate_hz).round() as usize;
    let mut report = FlightReport {
        trial: trial.name.clone(),
        rate_hz,
        tare: by_plates.tare.clone(),
        warnings: by_plates.warnings.iter().chain(&by_motion.warnings).cloned().collect(),
        rejected: by_motion.rejected.clone(),
        ..FlightReport::default()
    };
    for flight in &by_motion.flights {
        // The unloaded stretch with the largest overlap.
        let best = stretches
            .iter()
            .map(|s| (s, frames_in(s.from_s, s.to_s, n_frames, rate_hz)))
            .map(|(s, frames)| {
                let shared = frames.end.min(flight.end).saturating_sub(frames.start.max(flight.start));
                (shared, s, frames)
            })
            .max_by_key(|(shared, ..)| *shared);
        let Some((shared, stretch, frames)) = best.filter(|(shared, ..)| 2 * shared >= flight.n_frames()) else {
            let force_n = mean_force_n(trial, &report, flight);
            if force_n > options.threshold_n {
                let (start, end) = (flight.start, flight.end);
                report.rejected.push(Rejected { start, end, reason: RejectionReason::PlateLoaded { force_n } });
            } else {
                report.flights.push(flight.clone());
            }
            continue;
        };
        let mut joined = Flight { source: FlightSource::Both, ..flight.clone() };
        if stretch.loaded_before && frames.start + tolerance >= flight.start {
            (joined.start, joined.takeoff_source) = (frames.start, EdgeSource::Plates);
        } else {
            joined.start = joined.start.max(frames.start);
        }
        if stretch.loaded_after && frames.end <= flight.end + tolerance {
            (joined.end, joined.landing_source) = (frames.end, EdgeSource::Plates);
        } else {
            joined.end = joined.end.min(frames.end);
        }
        let early = flight.start + tolerance < frames.start || frames.end + tolerance < flight.end;
        if early {
            report.warnings.push(FlightWarning::EdgesDiffer {
                joined: joined.frames(),
                motion: flight.frames(),
                plates: frames,
                shared,
            });
        }
        if joined.n_frames() >= shortest {
            report.flights.push(joined);
        } else {
            let (start, end) = (joined.start, joined.end);
            report.rejected.push(Rejected { start, end, reason: RejectionReason::TooShort });
        }
    }
    for flight in &by_plates.flights {
        if report.flights.iter().any(|f| f.start < flight.end && flight.start < f.end) {
            continue;
        }
        let unsolved = flight.frames().filter(|&frame| frame >= motion.n_frames() || !motion.is_valid(frame)).count();
        if 3 * unsolved > flight.n_frames() {
            report.warnings.push(FlightWarning::Unsolved { frames: flight.frames(), unsolved });
            report.flights.push(flight.clone());
            continue;
        }
        let mean = found.and_then(|found| {
            let mean = Parabola::fit(&found.com_m, inner(&flight.frames()), rate_hz)?.acceleration_mps2();
            let free = found.free_mps2;
            ((mean - free).norm() < UNSTEADY * free.norm()).then_some(mean)
        });
        if let Some(mean) = mean {
            report.warnings.push(FlightWarning::Unsteady { frames: flight.frames() });
            report.flights.push(Flight { mean_acceleration_mps2: mean.into(), ..flight.clone() });
        } else {
            let vertical_mps2 = centroid_fall(trial, flight.start, flight.end).map_or(0.0, |c| c.acceleration_mps2.z);
            let (start, end) = (flight.start, flight.end);
            report.rejected.push(Rejected { start, end, reason: RejectionReason::NotFalling { vertical_mps2 } });
        }
    }
    report.flights.sort_by_key(|f| f.start);
    report.rejected.sort_by_key(|r| (r.start, r.end));
    report
}

/// Mean of the total force on all plates over a flight, N, tared.
fn mean_force_n(trial: &Trial, report: &FlightReport, flight: &Flight) -> f64 {
    let mut total = 0.0;
    for (plate, tare) in trial.plates.iter().zip(&report.tare) {
        let from = (flight.start as f64 / report.rate_hz * plate.rate_hz) as usize;
        let to = ((flight.end as f64 / report.rate_hz * plate.rate_hz) as usize).min(plate.force_n.len());
        let samples: Vec<_> =
            plate.force_n[from.min(to)..to].iter().filter(|f| f.iter().all(|x| x.is_finite())).collect();
        if !samples.is_empty() {
            total += samples.iter().map(|f| (**f - tare.force_n[0]).norm()).sum::<f64>() / samples.len() as f64;
        }
    }
    total
}
