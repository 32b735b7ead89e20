//! The frames of a recording that a calibration uses, copied so that the rest of the recording can
//! be freed.

use super::select::spread;
use super::{CalibrateOptions, FrameId, Selection};
use crate::problem::{FEWEST_MARKERS, Problem};
use crate::solve::{Piece, match_markers, track, track_each};
use crate::{IkError, IkOptions, IkReport, IkResult};
use aloft_body::{Motion, Subject};
use aloft_trial::{Markers, Trial};
use std::ops::Range;

/// Frames of one trial, each with the few preceding frames from which it is tracked.
#[derive(Debug, Clone)]
pub struct Clip {
    /// Markers of the subject in the kept frames, concatenated.
    trial: Trial,
    /// Ranges of kept frames that are consecutive in the recording.
    runs: Vec<Range<usize>>,
    /// Frames that take part, as indices into the kept ones, and whether they are held out.
    chosen: Vec<(usize, bool)>,
}

impl Clip {
    /// Copies `share` frames for use from a trial, and as many for a check ([`super::shares`]).
    ///
    /// # Errors
    /// [`IkError::TooFewMarkers`] when fewer than three markers are common to trial and subject.
    pub fn of(subject: &Subject, trial: &Trial, share: usize, options: &CalibrateOptions) -> Result<Self, IkError> {
        let mut problem = Problem::new(subject, &options.ik)?;
        let sources = match_markers(&mut problem, subject, trial)?;
        let markers = &trial.markers;
        let there = |source: usize, f: usize| {
            markers.trajectories[source].get(f).is_some_and(|p| p.iter().all(|x| x.is_finite()))
        };
        let seen: Vec<usize> =
            (0..markers.n_frames).map(|f| sources.iter().filter(|&&s| there(s, f)).count()).collect();
        let (mut kept, mut runs, mut chosen) = (Vec::<usize>::new(), Vec::<Range<usize>>::new(), Vec::new());
        for (frame, held_out) in spread(&seen, FEWEST_MARKERS, share) {
            let next = kept.last().map_or(0, |last| last + 1);
            let from = frame.saturating_sub(options.ik.warm_up_frames).max(next);
            match runs.last_mut() {
                Some(run) if from == next => run.end += frame + 1 - from,
                _ => runs.push(kept.len()..kept.len() + frame + 1 - from),
            }
            kept.extend(from..=frame);
            chosen.push((kept.len() - 1, held_out));
        }
        let all: Vec<usize> = (0..markers.labels.len()).filter(|i| sources.contains(i)).collect();
        Ok(Self { trial: cut(trial, &all, &kept), runs, chosen })
    }

    /// The chosen frames with their postures. Frames that cannot be solved, or fit far worse than
    /// the others of the trial, are omitted.
    pub(crate) fn track(&self, subject: &Subject, options: &IkOptions) -> Result<Tracked, IkError> {
        let (problem, sources) = self.problem(subject, options)?;
        let mut whole = Piece::default();
        for run in &self.runs {
            let piece = track(&problem, options, &self.trial, &sources, run.start, run.start, run.end);
            whole.q.extend(piece.q);
            whole.residual_m.extend(piece.residual_m);
        }
        let kept = gather(&self.trial, &problem, whole);
        let mut errors_m: Vec<f64> = kept.report.frame_rms_m.iter().copied().filter(|r| r.is_finite()).collect();
        let limit = 3.0 * aloft_signal::upper_median(&mut errors_m).unwrap_or(f64::NAN);
        let fits = |&(f, _): &(usize, bool)| kept.motion.is_valid(f) && kept.report.frame_rms_m[f] <= limit;
        let good: Vec<(usize, bool)> = self.chosen.iter().copied().filter(fits).collect();
        let frames: Vec<usize> = good.iter().map(|g| g.0).collect();
        let all: Vec<usize> = (0..self.trial.markers.labels.len()).collect();
        let trial = cut(&self.trial, &all, &frames);
        let n = problem.markers.len();
        let piece = Piece {
            q: frames.iter().flat_map(|&f| kept.motion.q(f).iter().copied()).collect(),
            residual_m: frames.iter().flat_map(|&f| kept.motion.residual_m[f * n..(f + 1) * n].to_vec()).collect(),
            ..Piece::default()
        };
        let result = gather(&trial, &problem, piece);
        Ok(Tracked { trial, result, held_out: good.iter().map(|g| g.1).collect() })
    }

    fn problem(&self, subject: &Subject, options: &IkOptions) -> Result<(Problem, Vec<usize>), IkError> {
        problem_of(subject, &self.trial, options)
    }
}

/// The chosen frames of one trial with their postures.
#[derive(Debug, Clone)]
pub(crate) struct Tracked {
    /// Markers of these frames.
    pub trial: Trial,
    /// Their postures and fit.
    pub result: IkResult,
    held_out: Vec<bool>,
}

impl Tracked {
    /// Solves the postures for another geometry, starting from the present ones.
    pub fn track_again(&mut self, subject: &Subject, options: &IkOptions) -> Result<(), IkError> {
        let (problem, sources) = problem_of(subject, &self.trial, options)?;
        let piece = track_each(&problem, options, &self.trial, &sources, &self.result);
        self.result = gather(&self.trial, &problem, piece);
        Ok(())
    }
}

/// The frames of all trials, grouped by role.
pub(crate) fn selection(tracked: &[Tracked]) -> Selection {
    let mut selection = Selection::default();
    for (trial, t) in tracked.iter().enumerate() {
        for (frame, held_out) in t.held_out.iter().enumerate() {
            let id = FrameId { trial, frame };
            if *held_out { selection.held_out.push(id) } else { selection.used.push(id) }
        }
    }
    selection
}

fn problem_of(subject: &Subject, trial: &Trial, options: &IkOptions) -> Result<(Problem, Vec<usize>), IkError> {
    let mut problem = Problem::new(subject, options)?;
    problem.deviations = false;
    let sources = match_markers(&mut problem, subject, trial)?;
    Ok((problem, sources))
}

/// Some frames of some markers of a trial.
fn cut(trial: &Trial, markers: &[usize], frames: &[usize]) -> Trial {
    let from = &trial.markers;
    let markers = Markers {
        rate_hz: from.rate_hz,
        first_frame: from.first_frame,
        n_frames: frames.len(),
        labels: markers.iter().map(|&m| from.labels[m].clone()).collect(),
        trajectories: markers.iter().map(|&m| frames.iter().map(|&f| from.trajectories[m][f]).collect()).collect(),
    };
    Trial { name: trial.name.clone(), markers, ..Trial::default() }
}

fn gather(trial: &Trial, problem: &Problem, piece: Piece) -> IkResult {
    let motion = Motion {
        trial: trial.name.clone(),
        rate_hz: trial.markers.rate_hz,
        nq: problem.tree.nq,
        nv: problem.tree.nv,
        q: piece.q,
        residual_m: piece.residual_m,
        marker_labels: problem.markers.iter().map(|m| m.label.clone()).collect(),
        ..Motion::default()
    };
    let solved: Vec<bool> = (0..motion.n_frames()).map(|f| motion.is_valid(f)).collect();
    let report = IkReport::gather(&trial.name, &motion.marker_labels, &motion.residual_m, &solved);
    IkResult { motion, report }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::solve;
    use crate::solve::tests::{person, shake};
    use nalgebra::Vector3;

    #[test]
    fn cut_frames_are_tracked_as_in_the_whole_recording() {
        let (subject, mut trial) = person(400);
        shake(&mut trial);
        trial.markers.trajectories[7][100..130].fill(Vector3::repeat(f64::NAN));
        let options = CalibrateOptions::default();
        let n = subject.markers.len();
        let seen: Vec<usize> = (0..400).map(|f| if (100..130).contains(&f) { n - 1 } else { n }).collect();
        // A calibration uses measured markers only; gaps are bridged in motions only.
        let plain = IkOptions { bridge_gaps_s: 0.0, ..options.ik.clone() };
        let whole = solve(&subject, &trial, &plain).unwrap();
        // Separate, adjacent, and all of them.
        for (share, kept) in [(10, 20 * 9), (40, 400), (300, 400)] {
            let clip = Clip::of(&subject, &trial, share, &options).unwrap();
            let chosen = spread(&seen, FEWEST_MARKERS, share);
            assert!(clip.trial.markers.n_frames <= kept && clip.chosen.len() == chosen.len());
            let mut tracked = clip.track(&subject, &options.ik).unwrap();
            assert_eq!(tracked.held_out, chosen.iter().map(|c| c.1).collect::<Vec<_>>());
            let once = tracked.result.motion.clone();
            tracked.track_again(&subject, &options.ik).unwrap();
            let mut gap = vec![0.0; subject.model.nv];
            for (i, (f, _)) in chosen.iter().enumerate() {
                for found in [&once, &tracked.result.motion] {
                    subject.model.difference(whole.motion.q(*f), found.q(i), &mut gap);
                    let sd = &whole.motion.q_sd[f * gap.len()..(f + 1) * gap.len()];
                    assert!(gap.iter().zip(sd).all(|(g, sd)| g.abs() < 2e-3 * sd), "frame {f} of {share}");
                }
            }
        }
    }
}
