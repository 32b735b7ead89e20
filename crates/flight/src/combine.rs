//! Plates and motion together: each says what the other cannot see.

use crate::from_plates::{centroid_acceleration, frames_in, unloaded_stretches};
use crate::{
    EdgeSource, Flight, FlightError, FlightMethod, FlightOptions, FlightReport, FlightSource, Rejected,
    RejectionReason, from_motion, from_plates,
};
use aloft_body::{Model, Motion, Phi};
use aloft_trial::Trial;

/// Time by which plates and motion may differ, beyond the guards, before it is worth a warning, s.
const AGREEMENT_S: f64 = 0.02;

/// Finds the flights of a trial with whatever it has: plates, motion (with model and prior inertias), or both.
///
/// # Errors
/// The method asks for what the trial lacks, or [`from_motion`] fails.
pub fn find_flights(
    trial: &Trial,
    motion: Option<(&Model, &[Phi], &Motion)>,
    options: &FlightOptions,
) -> Result<FlightReport, FlightError> {
    let missing = |method, missing| FlightError::Missing { trial: trial.name.clone(), method, missing };
    let (n_frames, rate_hz) = (trial.markers.n_frames, trial.markers.rate_hz);
    match (options.method, motion, trial.plates.is_empty()) {
        (FlightMethod::Plates, _, true) => Err(missing("plates", "force plates")),
        (FlightMethod::Motion, None, _) => Err(missing("motion", "a motion")),
        (FlightMethod::Auto, None, true) => Err(missing("auto", "force plates or a motion")),
        (FlightMethod::Plates, _, false) | (FlightMethod::Auto, None, false) => {
            Ok(from_plates(trial, n_frames, rate_hz, options))
        }
        (FlightMethod::Motion, Some((model, phi, motion)), _)
        | (FlightMethod::Auto, Some((model, phi, motion)), true) => from_motion(model, phi, motion, options),
        (FlightMethod::Auto, Some((model, phi, motion)), false) => {
            let bare = FlightOptions { margin_frames: 0, ..options.clone() };
            let by_motion = from_motion(model, phi, motion, &bare)?;
            let mut report = combine(trial, motion, &by_motion, &bare);
            let shortest = ((options.min_duration_s * rate_hz).round() as usize).max(6);
            report.apply_margin(options.margin_frames, shortest);
            Ok(report)
        }
    }
}

/// Joins flights from motion with the plates of the trial.
///
/// Where both tell a flight, each edge is the plates', unless motion ends the flight earlier by more than 20 ms and the guard (contact
/// beside the plates). A flight that only motion tells stands if the plates carry nothing in it; one that only the plates tell stands if the
/// motion was not solved there.
pub fn combine(trial: &Trial, motion: &Motion, by_motion: &FlightReport, options: &FlightOptions) -> FlightReport {
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
        // The unloaded stretch that shares most frames with it.
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
            report.warnings.push(format!(
                "flight in frames {} to {}: motion says {} to {}, plates {} to {} ({shared} frames in common)",
                joined.start, joined.end, flight.start, flight.end, frames.start, frames.end
            ));
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
            report.warnings.push(format!(
                "flight in frames {} to {}: told by the plates alone, {unsolved} frames of the motion are not solved",
                flight.start, flight.end
            ));
            report.flights.push(flight.clone());
        } else {
            let vertical_mps2 = centroid_acceleration(trial, flight.start, flight.end).unwrap_or(f64::NAN);
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
