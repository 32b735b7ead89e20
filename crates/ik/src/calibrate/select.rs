//! Which frames take part, and which are kept aside to see what a calibration gains.

use super::CalibrateOptions;
use crate::IkResult;

/// A frame of a trial.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct FrameId {
    pub trial: usize,
    pub frame: usize,
}

/// Frames used and frames held out, interleaved in time.
#[derive(Debug, Clone, Default)]
pub(crate) struct Selection {
    pub used: Vec<FrameId>,
    pub held_out: Vec<FrameId>,
}

/// Spreads the frames evenly over trials and over each trial's time. In each stretch of time the frame with the fewest
/// missing markers is taken, the one nearest the middle among equals; stretches alternate between use and check.
pub(crate) fn frames(tracked: &[IkResult], options: &CalibrateOptions) -> Selection {
    let mut selection = Selection::default();
    let usable: Vec<Vec<usize>> = tracked.iter().map(usable).collect();
    // trials with few frames leave their share to the others
    let mut share = vec![0; tracked.len()];
    let mut order: Vec<usize> = (0..tracked.len()).collect();
    order.sort_by_key(|&t| (usable[t].len(), t));
    let mut left = options.frames;
    for (done, &t) in order.iter().enumerate() {
        let fair = left.div_ceil(tracked.len() - done);
        share[t] = fair.min(usable[t].len().div_ceil(2));
        left -= share[t].min(left);
    }
    for t in 0..tracked.len() {
        let (frames, stretches) = (&usable[t], 2 * share[t]);
        let missing = |f: usize| {
            let n = tracked[t].motion.marker_labels.len();
            tracked[t].motion.residual_m[f * n..(f + 1) * n].iter().filter(|r| !r.is_finite()).count()
        };
        for s in 0..stretches {
            let (from, to) = (s * frames.len() / stretches, (s + 1) * frames.len() / stretches);
            let middle = (from + to) / 2;
            let best = (from..to).min_by_key(|&i| (missing(frames[i]), i.abs_diff(middle), i));
            let Some(i) = best else { continue };
            let id = FrameId { trial: t, frame: frames[i] };
            if s % 2 == 0 { selection.used.push(id) } else { selection.held_out.push(id) }
        }
    }
    selection
}

/// Solved frames whose fit is not far worse than the trial's own.
fn usable(result: &IkResult) -> Vec<usize> {
    let mut sorted: Vec<f64> = result.report.frame_rms_m.iter().copied().filter(|r| r.is_finite()).collect();
    if sorted.is_empty() {
        return Vec::new();
    }
    sorted.sort_by(f64::total_cmp);
    let limit = 3.0 * sorted[sorted.len() / 2];
    (0..result.motion.n_frames())
        .filter(|&f| result.motion.is_valid(f) && result.report.frame_rms_m[f] <= limit)
        .collect()
}
