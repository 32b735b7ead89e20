//! Flights from motion alone: the centre of mass falls with g.

use crate::center_of_mass::CenterOfMass;
use crate::parabola::Parabola;
use crate::{EdgeSource, Flight, FlightError, FlightOptions, FlightReport, FlightSource, Rejected, RejectionReason};
use aloft_body::{Model, Motion, Phi};
use aloft_signal::{Butterworth, CutoffCorrection, LowPass, derivatives, runs_where};
use nalgebra::Vector3;
use std::ops::Range;

/// Finds the flights in a motion (positions suffice; filtered or not). `phi` are prior inertias in link frames.
///
/// The centre of mass is low-passed, differentiated twice and compared with gravity: vertical within a band about −g, horizontal
/// below a limit, short interruptions merged, long enough. Then the links' first moments are fitted to the parabolas
/// ([`FlightOptions::refine`]) and the search is repeated; guards are taken off both ends.
///
/// # Errors
/// Motion, model and inertias do not belong together, or the cut-off does not fit the rate.
pub fn from_motion(
    model: &Model,
    phi: &[Phi],
    motion: &Motion,
    options: &FlightOptions,
) -> Result<FlightReport, FlightError> {
    let rate_hz = motion.rate_hz;
    let gravity = model.gravity_mps2.norm();
    let mut report = FlightReport { trial: motion.trial.clone(), rate_hz, ..FlightReport::default() };
    let mut com = CenterOfMass::new(model, phi, motion)?;
    let shortest = ((options.min_duration_s * rate_hz).round() as usize).max(6);
    let guard = |seconds: f64| (seconds * rate_hz - 1e-9).ceil().max(0.0) as usize;
    let (takeoff_guard, landing_guard) = (guard(options.takeoff_guard_s), guard(options.landing_guard_s));
    let longest = (options.max_duration_s * rate_hz) as usize;

    let mut stretches = falling_stretches(&com, motion, gravity, options, 1.6)?;
    if options.refine {
        // Wide bands first: a wrong prior bends the path; then the bands as stated.
        for widen in [1.3, 1.0] {
            let inner: Vec<Range<usize>> = stretches
                .iter()
                .filter(|s| s.len() >= shortest && s.len() <= longest)
                .map(|s| s.start + s.len() * 15 / 100..s.end - s.len() * 15 / 100)
                .collect();
            com.refine(&inner, rate_hz, options.com_prior_sd_m, 0.001);
            stretches = falling_stretches(&com, motion, gravity, options, widen)?;
        }
    } else {
        stretches = falling_stretches(&com, motion, gravity, options, 1.0)?;
    }

    for stretch in stretches {
        if stretch.len() < shortest {
            continue;
        }
        let (start, end) = (stretch.start, stretch.end);
        if stretch.len() > longest {
            report.rejected.push(Rejected { start, end, reason: RejectionReason::TooLong });
            continue;
        }
        // Where the recording ends in the air there is no contact to keep away from, but the filter's own edge.
        let frames = start + takeoff_guard..end.saturating_sub(landing_guard).max(start + takeoff_guard);
        let parabola = Parabola::fit(&com.position_m, frames.clone(), rate_hz);
        if frames.len() < shortest {
            report.rejected.push(Rejected { start, end, reason: RejectionReason::TooShort });
            continue;
        }
        let edge = |open: bool| if open { EdgeSource::Recording } else { EdgeSource::Motion };
        let solved = |frame: usize| frame < motion.n_frames() && motion.is_valid(frame);
        report.flights.push(Flight {
            start: frames.start,
            end: frames.end,
            source: FlightSource::Motion,
            takeoff_source: edge(start == 0 || !solved(start - 1)),
            landing_source: edge(!solved(end)),
            mean_acceleration_mps2: parabola
                .map_or(Vector3::repeat(f64::NAN), |parabola| parabola.acceleration_mps2())
                .into(),
        });
    }
    report.apply_margin(options.margin_frames, shortest);
    Ok(report)
}

/// Stretches in which the acceleration of the centre of mass is that of a falling body; bands are `widen` times those of the options.
fn falling_stretches(
    com: &CenterOfMass,
    motion: &Motion,
    gravity_mps2: f64,
    options: &FlightOptions,
    widen: f64,
) -> Result<Vec<Range<usize>>, FlightError> {
    let n = com.position_m.len();
    let filter = LowPass { order: 2, cutoff_hz: options.com_cutoff_hz, correction: CutoffCorrection::None };
    let filter = Butterworth::design(filter, motion.rate_hz).map_err(|e| FlightError::Filter {
        trial: motion.trial.clone(),
        what: "centre of mass",
        problem: e.to_string(),
    })?;
    let mut acceleration: [Vec<f64>; 3] = Default::default();
    for (axis, out) in acceleration.iter_mut().enumerate() {
        let mut channel: Vec<f64> = com.position_m.iter().map(|p| p[axis]).collect();
        filter.filtfilt(&mut channel);
        *out = derivatives(&channel, motion.rate_hz).1;
    }
    let vertical = options.vertical_band_g * widen * gravity_mps2;
    let horizontal = options.horizontal_band_g * widen * gravity_mps2;
    let falls = |frame: usize| {
        let [x, y, z] = [0, 1, 2].map(|axis| acceleration[axis][frame]);
        (z + gravity_mps2).abs() < vertical && x.hypot(y) < horizontal
    };
    let merge = (options.merge_s * motion.rate_hz).round() as usize;
    let mut merged: Vec<Range<usize>> = Vec::new();
    for run in runs_where(n, falls) {
        match merged.last_mut() {
            Some(last) if run.start - last.end <= merge && last.len().max(run.len()) > merge => last.end = run.end,
            _ => merged.push(run),
        }
    }
    Ok(merged)
}
