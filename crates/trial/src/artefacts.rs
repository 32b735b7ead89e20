//! Detects spikes and label swaps in marker trajectories; repairs them only on request.
//!
//! A spike: a marker leaves its path for a few frames and returns, with an acceleration that a body
//! cannot reach. A swap: two markers of one segment whose distances to the segment's other markers
//! fit far better with the labels exchanged.

use crate::{Markers, Trial};
use aloft_signal::median;
use nalgebra::Vector3;
use serde::{Deserialize, Serialize};

/// Thresholds for artefacts.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct ArtefactOptions {
    /// Repair: spikes become missing (to be filled as gaps), swapped labels are exchanged back.
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
        if self.repaired { write!(f, " (repaired)") } else { Ok(()) }
    }
}

/// Finds swaps inside `segments`, then spikes in all markers; repairs where the options ask for it.
pub fn find_artefacts(trial: &mut Trial, segments: &[Vec<String>], options: &ArtefactOptions) -> Vec<Finding> {
    let mut findings = Vec::new();
    for segment in segments {
        let members: Vec<usize> = segment.iter().filter_map(|label| trial.markers.index(label)).collect();
        find_swaps(&mut trial.markers, &members, options, &mut findings);
    }
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

/// Swaps between the members of one segment.
fn find_swaps(markers: &mut Markers, members: &[usize], options: &ArtefactOptions, findings: &mut Vec<Finding>) {
    let n = members.len();
    if n < 3 {
        return;
    }
    // Typical distances; the medians are valid if a swap lasts less than half of the recording.
    let mut usual = vec![f64::NAN; n * n];
    for i in 0..n {
        for j in i + 1..n {
            let mut distances: Vec<f64> = (0..markers.n_frames)
                .filter_map(|frame| {
                    Some((markers.position(members[i], frame)? - markers.position(members[j], frame)?).norm())
                })
                .collect();
            usual[i * n + j] = median(&mut distances);
            usual[j * n + i] = usual[i * n + j];
        }
    }
    for i in 0..n {
        for j in i + 1..n {
            let mut run: Option<(usize, f64)> = None;
            for frame in 0..=markers.n_frames {
                let size = if frame < markers.n_frames {
                    swap_size(markers, members, &usual, i, j, frame, options)
                } else {
                    None
                };
                match (size, run) {
                    (Some(size), None) => run = Some((frame, size)),
                    (Some(size), Some((first, largest))) => run = Some((first, largest.max(size))),
                    (None, Some((first, size_m))) => {
                        findings.push(Finding {
                            kind: FindingKind::Swap { with: markers.labels[members[j]].clone() },
                            marker: markers.labels[members[i]].clone(),
                            first_frame: first,
                            last_frame: frame - 1,
                            size_m,
                            repaired: options.repair,
                        });
                        if options.repair {
                            for swapped in first..frame {
                                let other = markers.trajectories[members[j]][swapped];
                                let own = std::mem::replace(&mut markers.trajectories[members[i]][swapped], other);
                                markers.trajectories[members[j]][swapped] = own;
                            }
                        }
                        run = None;
                    }
                    (None, None) => {}
                }
            }
        }
    }
}

/// Mean distance error of members `i` and `j` in one frame, if exchanging them removes at least 70
/// % of it.
fn swap_size(
    markers: &Markers,
    members: &[usize],
    usual: &[f64],
    i: usize,
    j: usize,
    frame: usize,
    options: &ArtefactOptions,
) -> Option<f64> {
    let n = members.len();
    let own = markers.position(members[i], frame)?;
    let other = markers.position(members[j], frame)?;
    let (mut as_is, mut exchanged, mut count) = (0.0, 0.0, 0.0);
    for k in (0..n).filter(|&k| k != i && k != j) {
        let Some(mate) = markers.position(members[k], frame) else { continue };
        let (to_own, to_other) = ((own - mate).norm(), (other - mate).norm());
        let (usual_own, usual_other) = (usual[i * n + k], usual[j * n + k]);
        if !(usual_own.is_finite() && usual_other.is_finite()) {
            continue;
        }
        as_is += (to_own - usual_own).abs() + (to_other - usual_other).abs();
        exchanged += (to_own - usual_other).abs() + (to_other - usual_own).abs();
        count += 2.0;
    }
    (count > 0.0 && as_is > options.swap_floor_m * count && exchanged < 0.3 * as_is).then(|| as_is / count)
}
