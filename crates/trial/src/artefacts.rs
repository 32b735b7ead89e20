//! Detects spikes and label swaps in marker trajectories; repairs them only on request.
//!
//! A spike: a marker leaves its path for a few frames and returns, with an acceleration that a body
//! cannot reach. A swap: two markers, of one segment or of two, whose distances to the other
//! markers of their segments fit far better with the labels exchanged, or that take each other's
//! places from one frame to the next, and back. Exchanged markers are missing for those frames
//! unless they are repaired.

use crate::{Markers, Trial};
use aloft_signal::median;
use nalgebra::Vector3;
use serde::{Deserialize, Serialize};
use std::ops::Range;

/// Thresholds for artefacts.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct ArtefactOptions {
    /// Repair: spikes become missing (to be filled as gaps), swapped labels are exchanged back.
    /// Otherwise spikes stay, and swapped markers are missing.
    pub repair: bool,
    /// Longest spike, frames.
    pub spike_frames: usize,
    /// Smallest spike, m.
    pub spike_floor_m: f64,
    /// Accelerations up to this are considered plausible, m/s².
    pub plausible_acceleration_mps2: f64,
    /// Smallest mean distance error that is reported as a swap, m.
    pub swap_floor_m: f64,
}

impl Default for ArtefactOptions {
    fn default() -> Self {
        Self {
            repair: false,
            spike_frames: 4,
            spike_floor_m: 0.008,
            plausible_acceleration_mps2: 400.0,
            swap_floor_m: 0.012,
        }
    }
}

/// Kind of artefact.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum FindingKind {
    /// The marker leaves its path and returns.
    Spike,
    /// Two markers carry each other's label.
    Swap {
        /// The other marker.
        with: String,
    },
}

/// One artefact found.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Finding {
    /// Kind.
    pub kind: FindingKind,
    /// Marker.
    pub marker: String,
    /// First frame (index from 0).
    pub first_frame: usize,
    /// Last frame.
    pub last_frame: usize,
    /// Distance from the path (spike) or mean error of the distances to the segment's other markers
    /// (swap), m.
    pub size_m: f64,
    /// Whether it was repaired.
    pub repaired: bool,
}

impl std::fmt::Display for Finding {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match &self.kind {
            FindingKind::Spike => write!(f, "spike of {:.0} mm in `{}`", self.size_m * 1e3, self.marker)?,
            FindingKind::Swap { with } => write!(f, "`{}` and `{with}` carry each other's label", self.marker)?,
        }
        write!(f, ", frames {} to {}", self.first_frame, self.last_frame)?;
        match &self.kind {
            _ if self.repaired => write!(f, " (repaired)"),
            FindingKind::Swap { .. } => write!(f, " (left out)"),
            FindingKind::Spike => Ok(()),
        }
    }
}

/// Finds swaps by the markers' distances within `segments`, then spikes in all markers; repairs
/// where the options ask for it, and leaves swapped markers out where they do not.
pub fn find_artefacts(trial: &mut Trial, segments: &[Vec<String>], options: &ArtefactOptions) -> Vec<Finding> {
    let mut findings = Vec::new();
    let index = |label: &String| trial.markers.index(label);
    let segments: Vec<Vec<usize>> = segments.iter().map(|s| s.iter().filter_map(index).collect()).collect();
    find_swaps(&mut trial.markers, &segments, options, &mut findings);
    for marker in 0..trial.markers.labels.len() {
        find_spikes(&mut trial.markers, marker, options, &mut findings);
    }
    findings
}

/// Spikes of one marker.
fn find_spikes(markers: &mut Markers, marker: usize, options: &ArtefactOptions, findings: &mut Vec<Finding>) {
    let step_s = 1.0 / markers.rate_hz;
    let label = markers.labels[marker].clone();
    let track = &mut markers.trajectories[marker];
    let n = track.len();
    let visible = |p: &Vector3<f64>| p.iter().all(|x| x.is_finite());
    // The median distance from the midpoint of the neighbours measures noise and ordinary
    // acceleration.
    let mut usual: Vec<f64> =
        track.windows(3).filter(|w| w.iter().all(visible)).map(|w| (w[1] - (w[0] + w[2]) * 0.5).norm()).collect();
    let usual = median(&mut usual);
    if !usual.is_finite() {
        return;
    }
    let mut frame = 1;
    while frame + 1 < n {
        let mut found = 0;
        for width in 1..=options.spike_frames {
            let end = frame + width;
            if end >= n || !track[frame - 1..=end].iter().all(visible) {
                break;
            }
            let chord_s = (width + 1) as f64 * step_s;
            // Under constant acceleration a, a path deviates from the chord over a time T by at
            // most a T²/8.
            let bound = options.plausible_acceleration_mps2 * chord_s * chord_s / 8.0;
            let limit = options.spike_floor_m.max(bound).max(12.0 * usual * (width * width) as f64);
            let (a, b) = (track[frame - 1], track[end]);
            let mut least = f64::INFINITY;
            let mut most = 0.0_f64;
            for (step, p) in track[frame..end].iter().enumerate() {
                let off = (p - a.lerp(&b, (step + 1) as f64 / (width + 1) as f64)).norm();
                least = least.min(off);
                most = most.max(off);
            }
            // Out and back: all frames in between are off the chord, and the chord is short
            // compared with the excursion.
            if least > limit && (b - a).norm() < 0.7 * most + usual * (width + 1) as f64 * 4.0 {
                findings.push(Finding {
                    kind: FindingKind::Spike,
                    marker: label.clone(),
                    first_frame: frame,
                    last_frame: end - 1,
                    size_m: most,
                    repaired: options.repair,
                });
                found = width;
                break;
            }
        }
        if found > 0 && options.repair {
            track[frame..frame + found].fill(Vector3::repeat(f64::NAN));
        }
        frame += found.max(1);
    }
}

/// The other markers of a marker's segment, with the usual distances to them.
type Mates = Vec<(usize, f64)>;

/// Swaps of two markers whose segments have others.
fn find_swaps(markers: &mut Markers, segments: &[Vec<usize>], options: &ArtefactOptions, findings: &mut Vec<Finding>) {
    // medians are valid if a swap lasts less than half of the recording
    let usual = |i: usize, k: usize| {
        let between = |f: usize| Some((markers.position(i, f)? - markers.position(k, f)?).norm());
        median(&mut (0..markers.n_frames).filter_map(between).collect::<Vec<f64>>())
    };
    let mates: Vec<(usize, Mates)> = segments
        .iter()
        .flat_map(|s| s.iter().map(move |&i| (i, s)))
        .map(|(i, s)| {
            let others = s.iter().filter(|&&k| k != i).map(|&k| (k, usual(i, k)));
            (i, others.filter(|(_, d)| d.is_finite()).collect::<Mates>())
        })
        .filter(|(_, mates)| !mates.is_empty())
        .collect();
    // frames in which a marker does not fit its own segment
    let off = |(i, mates): &(usize, Mates), f: usize| {
        let own = markers.position(*i, f)?;
        let errors = mates.iter().filter_map(|(k, d)| Some(((own - markers.position(*k, f)?).norm() - d).abs()));
        let (sum, count) = errors.fold((0.0, 0.0), |s, e| (s.0 + e, s.1 + 1.0));
        (count > 0.0).then(|| sum / count)
    };
    let mut pairs: Vec<(usize, usize)> = Vec::new();
    for f in 0..markers.n_frames {
        let apart: Vec<usize> =
            (0..mates.len()).filter(|&a| off(&mates[a], f).is_some_and(|e| e > options.swap_floor_m)).collect();
        for (at, &a) in apart.iter().enumerate() {
            for &b in &apart[at + 1..] {
                if !pairs.contains(&(a, b))
                    && swap_size(markers, &mates[a], &mates[b], f).is_some_and(|s| s.is_sure(options))
                {
                    pairs.push((a, b));
                }
            }
        }
    }
    for (a, b) in pairs {
        let sizes: Vec<Option<Swap>> =
            (0..markers.n_frames).map(|f| swap_size(markers, &mates[a], &mates[b], f)).collect();
        let (i, j) = (mates[a].0, mates[b].0);
        let sure = |f: usize| sizes[f].is_some_and(|s| s.is_sure(options));
        // where the two are near each other, both ways fit: the better one, next to where it is
        // sure
        let better = |f: usize| sizes[f].is_some_and(|s| s.exchanged < s.as_is);
        for run in aloft_signal::runs_where(markers.n_frames, better) {
            // of a segment with two markers either may be the one: its path jumps where the swap
            // begins
            let alone = mates[a].1.len().min(mates[b].1.len()) < 2;
            if !run.clone().any(sure) || !steadier_exchanged(markers, i, j, &run).unwrap_or(!alone) {
                continue;
            }
            let size_m = run.clone().filter_map(|f| Some(sizes[f]?.as_is)).fold(0.0, f64::max);
            findings.push(exchange(markers, [i, j], run, size_m, options));
        }
    }
    // two markers that take each other's places from one frame to the next, and back again later
    for i in 0..markers.labels.len() {
        for j in i + 1..markers.labels.len() {
            let places: Vec<(usize, f64)> =
                (1..markers.n_frames).filter_map(|f| Some((f, trade(markers, [i, j], f, options)?))).collect();
            for pair in places.chunks_exact(2) {
                let size_m = pair[0].1.max(pair[1].1);
                findings.push(exchange(markers, [i, j], pair[0].0..pair[1].0, size_m, options));
            }
        }
    }
}

/// Exchanges the labels of two markers in a run of frames, or leaves both out there.
fn exchange(
    markers: &mut Markers,
    [i, j]: [usize; 2],
    run: Range<usize>,
    size_m: f64,
    options: &ArtefactOptions,
) -> Finding {
    let finding = Finding {
        kind: FindingKind::Swap { with: markers.labels[j].clone() },
        marker: markers.labels[i].clone(),
        first_frame: run.start,
        last_frame: run.end - 1,
        size_m,
        repaired: options.repair,
    };
    for f in run {
        let (own, other) = (markers.trajectories[i][f], markers.trajectories[j][f]);
        let missing = Vector3::repeat(f64::NAN);
        let [now, then] = if options.repair { [other, own] } else { [missing; 2] };
        (markers.trajectories[i][f], markers.trajectories[j][f]) = (now, then);
    }
    finding
}

/// Mean way of two markers into a frame, if each comes to where the other one was.
fn trade(markers: &Markers, [i, j]: [usize; 2], f: usize, options: &ArtefactOptions) -> Option<f64> {
    let at = |m: usize, f: usize| markers.position(m, f);
    let (i0, i1) = (at(i, f - 1)?, at(i, f)?);
    let way_of_i = (i1 - i0).norm();
    if way_of_i <= options.swap_floor_m {
        return None;
    }
    let (j0, j1) = (at(j, f - 1)?, at(j, f)?);
    let ways = |a: f64, b: f64| Swap { as_is: 0.5 * a, exchanged: 0.5 * b };
    let swap = ways(way_of_i + (j1 - j0).norm(), (j1 - i0).norm() + (i1 - j0).norm());
    swap.is_sure(options).then_some(swap.as_is)
}

/// True if the paths of two markers jump less at the ends of a run if their labels are exchanged in
/// it; none if no end can be seen.
fn steadier_exchanged(markers: &Markers, i: usize, j: usize, run: &Range<usize>) -> Option<bool> {
    let ends = [(run.start.checked_sub(1), run.start), (Some(run.end), run.end - 1)];
    let (mut as_is, mut exchanged, mut seen) = (0.0, 0.0, false);
    for (outside, inside) in ends {
        let at = |m: usize, f: usize| if f < markers.n_frames { markers.position(m, f) } else { None };
        let Some((i0, j0)) = outside.and_then(|f| Some((at(i, f)?, at(j, f)?))) else { continue };
        let (Some(i1), Some(j1)) = (at(i, inside), at(j, inside)) else { continue };
        as_is += (i1 - i0).norm() + (j1 - j0).norm();
        exchanged += (j1 - i0).norm() + (i1 - j0).norm();
        seen = true;
    }
    seen.then_some(exchanged < as_is)
}

/// Mean errors of the distances of two markers to their segments' other markers.
#[derive(Clone, Copy)]
struct Swap {
    as_is: f64,
    exchanged: f64,
}

impl Swap {
    /// True if exchanging the labels removes at least 70 % of an error that is large.
    fn is_sure(self, options: &ArtefactOptions) -> bool {
        self.as_is > options.swap_floor_m && self.exchanged < 0.3 * self.as_is
    }
}

fn swap_size(markers: &Markers, (i, of_i): &(usize, Mates), (j, of_j): &(usize, Mates), f: usize) -> Option<Swap> {
    let (own, other) = (markers.position(*i, f)?, markers.position(*j, f)?);
    let (mut as_is, mut exchanged, mut count) = (0.0, 0.0, 0.0);
    for (here, there, mates, not) in [(own, other, of_i, j), (other, own, of_j, i)] {
        for (k, usual) in mates.iter().filter(|(k, _)| k != not) {
            let Some(mate) = markers.position(*k, f) else { continue };
            as_is += ((here - mate).norm() - usual).abs();
            exchanged += ((there - mate).norm() - usual).abs();
            count += 1.0;
        }
    }
    // one distance of each: a marker that slid fits no better elsewhere by chance
    (count >= 2.0).then(|| Swap { as_is: as_is / count, exchanged: exchanged / count })
}
