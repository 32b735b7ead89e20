//! Selects the frames that a calibration uses, and those held out to measure the improvement.

use super::CalibrateOptions;

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

/// Number of frames of each trial that a calibration uses (it holds out as many again): the same
/// number from each trial, as far as the lengths allow.
pub fn shares(lengths: &[usize], options: &CalibrateOptions) -> Vec<usize> {
    // The unused share of short trials goes to the others.
    let mut share = vec![0; lengths.len()];
    let mut order: Vec<usize> = (0..lengths.len()).collect();
    order.sort_by_key(|&t| (lengths[t], t));
    let mut left = options.frames;
    for (done, &t) in order.iter().enumerate() {
        let fair = left.div_ceil(lengths.len() - done);
        share[t] = fair.min(lengths[t].div_ceil(2));
        left -= share[t].min(left);
    }
    share
}

/// Spreads `2 share` frames evenly over a trial's time, among those with enough markers. In each
/// interval the frame with the most markers is taken, on a tie the one nearest the middle;
/// intervals alternate between use (false) and check (true).
pub(crate) fn spread(seen: &[usize], fewest: usize, share: usize) -> Vec<(usize, bool)> {
    let frames: Vec<usize> = (0..seen.len()).filter(|&f| seen[f] >= fewest).collect();
    let stretches = 2 * share.min(frames.len().div_ceil(2));
    (0..stretches)
        .filter_map(|s| {
            let (from, to) = (s * frames.len() / stretches, (s + 1) * frames.len() / stretches);
            let middle = (from + to) / 2;
            let best = (from..to).max_by_key(|&i| (seen[frames[i]], std::cmp::Reverse((i.abs_diff(middle), i))));
            best.map(|i| (frames[i], s % 2 == 1))
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn unit_short_trials_leave_their_share_to_the_others() {
        let options = CalibrateOptions { frames: 100, ..CalibrateOptions::default() };
        assert_eq!(shares(&[1000, 20, 1000], &options), [45, 10, 45]);
        assert_eq!(shares(&[5, 3], &options), [3, 2]);
        // More trials than frames: one frame each until none are left.
        assert_eq!(shares(&[10; 150], &options).iter().sum::<usize>(), 100);
    }

    #[test]
    fn unit_frames_are_spread_over_time_and_prefer_markers() {
        let mut seen = vec![9; 40];
        assert_eq!(spread(&seen, 3, 2), [(5, false), (15, true), (25, false), (35, true)]);
        seen[5] = 8;
        seen[30..].fill(2);
        assert_eq!(spread(&seen, 3, 2), [(3, false), (11, true), (18, false), (26, true)]);
        assert_eq!(spread(&[2; 10], 3, 2), []);
    }
}
