//! Estimates joint centres, hinge axes and marker positions from moving trials.
//!
//! Landmarks locate a joint centre to a centimetre; a few seconds of movement locate it to a few
//! millimetres, because two links can only rotate about their common joint. All unknowns are
//! estimated together, from markers alone: positions of joint centres and markers in the static
//! posture, directions of hinge axes, and the posture of every frame. Postures are eliminated frame
//! by frame (variable projection: each is minimised for the present geometry, and its block is
//! removed from the normal equations by a Schur complement), which leaves one dense system of about
//! 150 unknowns. Blocks of frames that contradict each other about a joint take weight off what
//! they say about it ([`blocks`]).
//!
//! Geometry is stored as *positions in the static posture* ([`reference`]), so the prior of each
//! position depends on its landmarks only, whether or not neighbouring positions move. Directions
//! that the data do not determine – the orientation of frames at spherical joints, the position of
//! a hinge along its axis, the pose of the root – are fixed by these priors.
//!
//! Consequences for the user of a calibrated [`Subject`]: link frames have moved slightly, so
//! earlier values in link frames are no longer valid. `static_q` is recomputed, and the inertial
//! prior is transformed so that it stays in place in the static posture; to apply anthropometry to
//! the new segment lengths, call `aloft_scale::attach_prior` afterwards.

mod blocks;
mod bundle;
mod clip;
mod drawn;
mod geometry_error;
mod options;
mod reference;
mod report;
mod select;

pub use clip::Clip;
pub use geometry_error::GeometryError;
pub use options::CalibrateOptions;
pub use report::{CalibrationReport, JointChange, MarkerChange, TrialFit, contradiction};
pub use select::shares;

use crate::IkError;
use crate::problem::Problem;
use aloft_body::{Motion, Subject};
use aloft_trial::Trial;
use bundle::Bundle;
use rayon::prelude::*;
use reference::Reference;
use select::{FrameId, Selection};

/// A subject with calibrated geometry.
#[derive(Debug, Clone)]
pub struct Calibration {
    /// The calibrated subject; `static_q` is the static posture in the new coordinates.
    pub subject: Subject,
    /// Changes of the geometry and of the fit.
    pub report: CalibrationReport,
    /// Draws of what may be wrong with the geometry, from its posterior.
    pub errors: Vec<GeometryError>,
}

/// Refines joint centres, hinge axes and marker coordinates of a subject from moving trials.
///
/// The static posture takes part as data: the subject's markers at `static_q`. Frames are chosen
/// over all trials, identically on every call. Forces are not used.
///
/// # Errors
/// As [`crate::solve()`]; [`IkError::NothingToCalibrate`] if no trial has a solved frame;
/// [`IkError::Calibration`] if the system of equations cannot be solved.
pub fn calibrate(subject: &Subject, trials: &[&Trial], options: &CalibrateOptions) -> Result<Calibration, IkError> {
    options.check()?;
    let lengths: Vec<usize> = trials.iter().map(|t| t.markers.n_frames).collect();
    let clips: Vec<Clip> = trials
        .iter()
        .zip(shares(&lengths, options))
        .map(|(trial, share)| Clip::of(subject, trial, share, options))
        .collect::<Result<_, IkError>>()?;
    calibrate_clips(subject, &clips, options)
}

/// As [`calibrate()`], from frames already copied from the trials ([`shares`], [`Clip::of`]):
/// memory use does not grow with the trials.
///
/// # Errors
/// As [`calibrate()`].
pub fn calibrate_clips(subject: &Subject, clips: &[Clip], options: &CalibrateOptions) -> Result<Calibration, IkError> {
    options.check()?;
    let mut tracked: Vec<clip::Tracked> =
        clips.par_iter().map(|clip| clip.track(subject, &options.ik)).collect::<Result<_, IkError>>()?;
    let chosen = clip::selection(&tracked);
    if chosen.used.is_empty() {
        return Err(IkError::NothingToCalibrate { subject: subject.facts.name.clone(), trials: clips.len() });
    }
    let start = Reference::of(subject)?;
    let mut present = subject.clone();
    let mut report = CalibrationReport::start(&chosen, &tracked);
    let (mut errors, mut spread) = (Vec::new(), None);
    for round in 0..options.rounds {
        let trials: Vec<&Trial> = tracked.iter().map(|t| &t.trial).collect();
        let motions: Vec<&Motion> = tracked.iter().map(|t| &t.result.motion).collect();
        let problem = Problem::new(&present, &options.ik)?;
        let reference = Reference::of(&present)?;
        let mut bundle = Bundle::new(&present, problem, &start, reference, &chosen.used, &trials, &motions, options);
        report.iterations += bundle.run(options, spread)?;
        let (calibrated, uncertainty, drawn) = bundle.finish(&present)?;
        spread = Some(bundle.spread);
        (present, errors) = (calibrated, drawn);
        tracked.par_iter_mut().try_for_each(|t| t.track_again(&present, &options.ik))?;
        if round + 1 == options.rounds {
            report.finish(&present, &start, &uncertainty, options, &chosen, &tracked)?;
        }
    }
    present.provenance.push(format!(
        "geometry: calibrated over {} frames of {} trials, marker RMS {:.1} to {:.1} mm on held-out frames",
        report.frames_used,
        clips.len(),
        1e3 * report.held_out_rms_before_m,
        1e3 * report.held_out_rms_after_m
    ));
    Ok(Calibration { subject: present, report, errors })
}
