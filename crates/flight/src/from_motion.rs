//! Flights from motion alone: the centre of mass falls with a constant acceleration.

use crate::centre_of_mass::CentreOfMass;
use crate::explain::Clues;
use crate::free_acceleration::{Acceleration, SLOW, Search, flight_shortening, inner, longest_frames};
use crate::free_fall::FreeFall;
use crate::parabola::Parabola;
use crate::{
    EdgeSource, Flight, FlightError, FlightOptions, FlightReport, FlightSource, FlightWarning, Rejected,
    RejectionReason,
};
use aloft_body::{Model, Motion, Phi, STANDARD_GRAVITY_MPS2};
use nalgebra::Vector3;
use std::ops::Range;

/// An acceleration other than the stated gravity is preferred if it explains this many times as
/// many frames.
const CLEARLY_MORE: f64 = 1.5;
/// If the stated gravity is below this fraction of the Earth's, the search also uses a lower
/// cut-off.
const WEAK: f64 = 0.5;
/// If only edges distinguish flights from dips, a flight lasts at least this fraction of the
/// longest one.
const BRIEF: f64 = 0.15;
/// Relative deviation from the stated gravity above which the search for flights is repeated about
/// their own acceleration.
const RECENTER: f64 = 0.1;

/// Finds the flights in a motion (positions suffice; filtered or not). `phi` are prior inertias in
/// link frames.
///
/// The centre of mass is low-passed, differentiated twice and compared with the free acceleration,
/// in one band along it and one across it; short interruptions are merged and short stretches
/// rejected. Then the links' first moments are fitted to the parabolas ([`FlightOptions::refine`])
/// and the search is repeated; guards are removed from both ends. The free acceleration is the
/// stated gravity if that explains the motion, otherwise the constant acceleration of any magnitude
/// and direction that does; [`FlightReport::free_fall`] compares it with the stated one. If the
/// stated gravity is zero, a free body moves uniformly.
///
/// # Errors
/// Motion, model and inertias do not match, or the cut-off is not valid at this rate.
pub fn from_motion(
    model: &Model,
    phi: &[Phi],
    motion: &Motion,
    options: &FlightOptions,
) -> Result<FlightReport, FlightError> {
    let found = search(model, phi, motion, options, None)?;
    let mut report = found.report;
    report.free_fall = FreeFall::of(&report.flights, &model.gravity_mps2, motion.rate_hz, options, &Clues::default());
    let off = report.free_fall.as_ref().and_then(FreeFall::warning);
    report.warnings.extend(off.map(|words| FlightWarning::FreeFall { words }));
    report.apply_margin(options.margin_frames, shortest_frames(motion.rate_hz, options));
    Ok(report)
}

/// Shortest flight, frames.
pub(crate) fn shortest_frames(rate_hz: f64, options: &FlightOptions) -> usize {
    ((options.min_duration_s * rate_hz).round() as usize).max(6)
}

/// Result of a search in a motion: margins still included, [`FlightReport::free_fall`] not yet
/// computed.
pub(crate) struct Found {
    pub report: FlightReport,
    /// Centre of mass after the fit of first moments, m.
    pub com_m: Vec<Vector3<f64>>,
    /// The free acceleration that was searched for, m/s².
    pub free_mps2: Vector3<f64>,
}

/// Evidence of the plates for each frame.
pub(crate) struct PlateEvidence {
    /// True in frames in which no plate is loaded.
    pub unloaded: Vec<bool>,
    /// Frames between one load and the next.
    pub between_loads: Vec<Range<usize>>,
}

/// The search; with plates, an acceleration other than the stated gravity is taken from unloaded
/// frames only.
pub(crate) fn search(
    model: &Model,
    phi: &[Phi],
    motion: &Motion,
    options: &FlightOptions,
    plates: Option<&PlateEvidence>,
) -> Result<Found, FlightError> {
    let stated = model.gravity_mps2;
    let prior = CentreOfMass::new(model, phi, motion)?;
    let size = stated.norm();
    let is_weak = |free: &Vector3<f64>| free.norm() < WEAK * STANDARD_GRAVITY_MPS2;
    // The dip before a jump resembles weak gravity; without plates, its gradual edges distinguish
    // it from a flight.
    let sharp = |free: &Vector3<f64>| {
        size > 0.0 && plates.is_none() && (is_weak(free) || (free - stated).norm() > RECENTER * size)
    };
    let about = |free: Vector3<f64>, slowness: f64| {
        search_about(prior.clone(), motion, options, Wanted { free, slowness, sharp: sharp(&free) })
    };
    if size == 0.0 {
        return about(stated, SLOW);
    }
    // The lower cut-off blurs edges, so it is used only if the usual one finds fewer flight frames.
    let either = |free: Vector3<f64>, with_slow: bool| -> Result<Found, FlightError> {
        let usual = about(free, 1.0)?;
        if !with_slow {
            return Ok(usual);
        }
        let slow = about(free, SLOW)?;
        Ok(if slow.report.flight_frames() > usual.report.flight_frames() { slow } else { usual })
    };
    // In a short recording noise is spread over few frames; about their parabola the lower cut-off
    // blurs nothing.
    let short = motion.n_frames() as f64 <= aloft_signal::SHORT_RUN_S * motion.rate_hz;
    let mut found = either(stated, is_weak(&stated) || short)?;
    // A single short toss has no edges that tell flight from sliding or swinging at another
    // acceleration.
    if short && plates.is_none() {
        return Ok(found);
    }
    let allowed = |frame: usize| plates.is_none_or(|p| p.unloaded.get(frame).copied().unwrap_or(true));
    let least = options.least_free_g * size;
    let wanted = |level: f64, before_fit: bool| Search {
        stated_mps2: size,
        shortest: shortest_frames(motion.rate_hz, options),
        shortest_alone: ((options.min_free_duration_s / level * motion.rate_hz).round() as usize).max(6),
        least_mps2: least,
        before_fit,
        between_loads: plates.map_or(&[], |p| &p.between_loads),
        allowed: &allowed,
    };
    let mut best = None;
    for (level, before_fit) in [(1.0, false), (SLOW, false), (1.0, true)] {
        let acceleration = Acceleration::of(&prior.position_m, motion, options, level)?;
        let wanted = wanted(level, before_fit);
        if let Some((free, frames)) = acceleration.find(options, &wanted) {
            best = Some((free, frames, acceleration.frames_at(&stated, options, &wanted), before_fit));
            break;
        }
    }
    if let Some((free, frames, as_stated, before_fit)) = best {
        let flights = &found.report.flights;
        let as_found = flights.iter().map(|f| f.frames().filter(|f| allowed(*f)).count()).sum::<usize>();
        let as_stated = as_stated.max(as_found);
        if (free - stated).norm() > RECENTER * size && frames as f64 > CLEARLY_MORE * as_stated as f64 {
            let other = either(free, is_weak(&free))?;
            // The fit of first moments must not justify stretches that it has created itself.
            let strict = Acceleration::of(&other.com_m, motion, options, 1.0)?;
            let holds = !before_fit
                || strict.frames_at(&other.free_mps2, options, &wanted(1.0, false)) * 2 > other.report.flight_frames();
            if !other.report.flights.is_empty() && holds {
                found = other;
            }
        }
    }
    // A band about the wrong centre cuts flights short: repeat the search about their own
    // acceleration.
    for _ in 0..2 {
        match mean_acceleration(&found.report.flights) {
            Some(mean)
                if (mean - found.free_mps2).norm() > RECENTER * found.free_mps2.norm() && mean.norm() >= least =>
            {
                let again = either(mean, is_weak(&mean))?;
                if again.report.flight_frames() < found.report.flight_frames() {
                    break;
                }
                found = again;
            }
            _ => break,
        }
    }
    Ok(found)
}

/// Mean acceleration of flights, weighted by their frames, m/s².
pub(crate) fn mean_acceleration(flights: &[Flight]) -> Option<Vector3<f64>> {
    let (mut sum, mut n) = (Vector3::zeros(), 0.0);
    for flight in flights {
        let mean = Vector3::from(flight.mean_acceleration_mps2);
        if mean.iter().all(|x| x.is_finite()) {
            sum += mean * flight.n_frames() as f64;
            n += flight.n_frames() as f64;
        }
    }
    (n > 0.0).then(|| sum / n)
}

/// Target of a search in a motion.
#[derive(Clone, Copy)]
struct Wanted {
    /// Free acceleration, m/s².
    free: Vector3<f64>,
    /// Factor on the cut-off of the centre of mass.
    slowness: f64,
    /// Whether flights must have sharp edges.
    sharp: bool,
}

/// Flights in which the centre of mass accelerates with `free`.
fn search_about(
    mut com: CentreOfMass,
    motion: &Motion,
    options: &FlightOptions,
    wanted: Wanted,
) -> Result<Found, FlightError> {
    let Wanted { free, slowness, sharp } = wanted;
    let rate_hz = motion.rate_hz;
    let mut report = FlightReport { trial: motion.trial.clone(), rate_hz, ..FlightReport::default() };
    let shortest =
        (shortest_frames(rate_hz, options) as f64 * flight_shortening(free.norm())).round().max(6.0) as usize;
    let guard = |seconds: f64| (seconds / slowness * rate_hz - 1e-9).ceil().max(0.0) as usize;
    let (takeoff_guard, landing_guard) = (guard(options.takeoff_guard_s), guard(options.landing_guard_s));
    let longest = longest_frames(free.norm(), rate_hz, options);
    let stretches_of = |com: &CentreOfMass, widen: f64| -> Result<Vec<Range<usize>>, FlightError> {
        Ok(Acceleration::of(&com.position_m, motion, options, slowness)?.stretches(&free, options, widen, |_| true))
    };

    let mut stretches;
    if options.refine {
        // Wide bands first, because a wrong prior distorts the path; then the stated bands.
        stretches = stretches_of(&com, 1.6)?;
        for widen in [1.3, 1.0] {
            let inside: Vec<Range<usize>> =
                stretches.iter().filter(|s| s.len() >= shortest && s.len() <= longest).map(inner).collect();
            com.refine(&inside, rate_hz, options.com_prior_sd_m, 0.001);
            stretches = stretches_of(&com, widen)?;
        }
    } else {
        stretches = stretches_of(&com, 1.0)?;
    }

    let acceleration = Acceleration::of(&com.position_m, motion, options, slowness)?;
    let longest_found = stretches.iter().map(Range::len).filter(|n| *n <= longest).max().unwrap_or(0) as f64;
    for stretch in stretches {
        if stretch.len() < shortest {
            continue;
        }
        let (start, end) = (stretch.start, stretch.end);
        if stretch.len() > longest {
            report.rejected.push(Rejected { start, end, reason: RejectionReason::TooLong });
            continue;
        }
        if sharp && (!acceleration.is_sharp(&stretch, &free) || (stretch.len() as f64) < BRIEF * longest_found) {
            report.rejected.push(Rejected { start, end, reason: RejectionReason::Gradual });
            continue;
        }
        let solved = |frame: usize| frame < motion.n_frames() && motion.is_valid(frame);
        let (begins, ends) = (start == 0 || !solved(start - 1), !solved(end));
        // Where the recording ends in flight there is no contact to exclude, only the edge of the
        // filter, which a short run does not have.
        let short = acceleration.is_in_short_run(&stretch);
        let guard = |open: bool, frames: usize| if open && short { 0 } else { frames };
        let from = start + guard(begins, takeoff_guard);
        let frames = from..end.saturating_sub(guard(ends, landing_guard)).max(from);
        let parabola = Parabola::fit(&com.position_m, frames.clone(), rate_hz);
        if frames.len() < shortest {
            report.rejected.push(Rejected { start, end, reason: RejectionReason::TooShort });
            continue;
        }
        // two falls with a bounce between them that no frame shows are none together
        let mean = parabola.map(|parabola| parabola.acceleration_mps2());
        if let Some(mean) = mean.filter(|mean| !Acceleration::within(mean, &free, options, 1.0)) {
            report.rejected.push(Rejected {
                start,
                end,
                reason: RejectionReason::NotFalling { vertical_mps2: mean.z },
            });
            continue;
        }
        let edge = |open: bool| if open { EdgeSource::Recording } else { EdgeSource::Motion };
        report.flights.push(Flight {
            start: frames.start,
            end: frames.end,
            source: FlightSource::Motion,
            takeoff_source: edge(begins),
            landing_source: edge(ends),
            mean_acceleration_mps2: mean.unwrap_or_else(|| Vector3::repeat(f64::NAN)).into(),
        });
    }
    Ok(Found { report, com_m: com.position_m, free_mps2: free })
}
