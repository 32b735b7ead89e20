//! Quality of a recording: one row per marker, and reasons from a closed list for the trial.

use crate::artefacts::{Finding, FindingKind};
use crate::force_columns::in_words;
use crate::gaps::{GapFill, missing_runs};
use crate::labels::MarkerSetMatch;
use crate::{Plate, Trial};
use aloft_signal::median;
use nalgebra::Vector3;
use serde::{Deserialize, Serialize};

/// Thresholds for reporting.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct QualityOptions {
    /// Gaps longer than this are reported, s.
    pub long_gap_s: f64,
    /// Marker noise above this is reported, m (one axis).
    pub noise_limit_m: f64,
    /// Recordings shorter than this are reported, s.
    pub short_trial_s: f64,
    /// Whether force plates are expected.
    pub plates_expected: bool,
}

impl Default for QualityOptions {
    fn default() -> Self {
        Self { long_gap_s: 0.25, noise_limit_m: 0.002, short_trial_s: 0.1, plates_expected: false }
    }
}

/// Quality of one marker in one trial. Gaps are counted before filling.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct MarkerQuality {
    /// Label.
    pub label: String,
    /// Fraction of frames in which the marker was measured.
    pub present_fraction: f64,
    /// Number of gaps.
    pub gaps: usize,
    /// Frames of the longest gap.
    pub longest_gap_frames: usize,
    /// Frames that were filled.
    pub filled_frames: usize,
    /// Spikes found.
    pub spikes: usize,
    /// Label swaps found that involve this marker.
    pub swaps: usize,
    /// Standard deviation of the noise along one axis, m, root mean square of the three axes; NaN
    /// with too few frames.
    pub noise_rms_m: f64,
}

/// Severity of a reason.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Severity {
    /// For information.
    Note,
    /// Results may be less accurate.
    Warning,
    /// The trial cannot be used.
    Unusable,
}

/// Reasons to review a trial: the complete list.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(tag = "reason", rename_all = "snake_case")]
pub enum QualityReason {
    /// No marker is visible in any frame.
    EmptyTrial,
    /// No marker of the set was found.
    NoMarkers,
    /// The recording is very short.
    ShortTrial {
        /// Duration, s.
        duration_s: f64,
    },
    /// A marker of the set is not in the recording, or never visible.
    MissingMarker {
        /// Label.
        marker: String,
    },
    /// A gap that was not filled.
    LongGap {
        /// Label.
        marker: String,
        /// First missing frame (index from 0).
        first_frame: usize,
        /// Last missing frame.
        last_frame: usize,
    },
    /// A marker with spikes.
    Spikes {
        /// Label.
        marker: String,
        /// Number of spikes.
        count: usize,
    },
    /// Two labels are exchanged for some frames.
    LabelSwap {
        /// Label.
        marker: String,
        /// Label of the other marker.
        with: String,
        /// First frame (index from 0).
        first_frame: usize,
        /// Last frame.
        last_frame: usize,
        /// Whether they were exchanged back; otherwise both are missing in these frames.
        #[serde(default)]
        repaired: bool,
    },
    /// A marker with noise above the limit.
    NoisyMarker {
        /// Label.
        marker: String,
        /// Standard deviation along one axis, m.
        noise_rms_m: f64,
    },
    /// Plates were expected but are absent.
    NoPlates,
    /// A plate whose force stays at its extreme value.
    PlateSaturated {
        /// Plate.
        plate: String,
        /// Samples at the extreme value.
        samples: usize,
    },
    /// A plate with samples that are not numbers.
    PlateIncomplete {
        /// Plate.
        plate: String,
        /// Number of such samples.
        samples: usize,
    },
    /// A plate that records only zeros.
    PlateSilent {
        /// Plate.
        plate: String,
    },
    /// Columns of the force file that belong to no plate.
    ColumnsNotUsed {
        /// Their labels.
        columns: Vec<String>,
    },
}

impl QualityReason {
    /// Severity of this reason.
    pub fn severity(&self) -> Severity {
        match self {
            Self::EmptyTrial | Self::NoMarkers => Severity::Unusable,
            Self::NoPlates | Self::PlateSilent { .. } => Severity::Note,
            _ => Severity::Warning,
        }
    }
}

impl std::fmt::Display for QualityReason {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::EmptyTrial => write!(f, "no marker is visible in any frame"),
            Self::NoMarkers => write!(f, "no marker of the set was found; hint: `marker_set` or `aliases`"),
            Self::ShortTrial { duration_s } => write!(f, "only {duration_s:.3} s long"),
            Self::MissingMarker { marker } => write!(f, "marker `{marker}` is missing"),
            Self::LongGap { marker, first_frame, last_frame } => {
                let (first, last) = (first_frame + 1, last_frame + 1);
                write!(f, "marker `{marker}` is missing in frames {first} to {last}")
            }
            Self::Spikes { marker, count } => write!(f, "marker `{marker}` has {count} spikes"),
            Self::LabelSwap { marker, with, first_frame, last_frame, repaired } => {
                let (first, last) = (first_frame + 1, last_frame + 1);
                let then = if *repaired { "exchanged back" } else { "they are missing there" };
                write!(f, "markers `{marker}` and `{with}` are exchanged in frames {first} to {last}: {then}")
            }
            Self::NoisyMarker { marker, noise_rms_m } => {
                write!(f, "marker `{marker}` is noisy: {:.2} mm along an axis", noise_rms_m * 1e3)
            }
            Self::NoPlates => write!(f, "no force plates"),
            Self::PlateSaturated { plate, samples } => {
                write!(f, "plate `{plate}` is saturated for {samples} samples")
            }
            Self::PlateIncomplete { plate, samples } => write!(f, "plate `{plate}` lacks {samples} samples"),
            Self::PlateSilent { plate } => write!(f, "plate `{plate}` records nothing"),
            Self::ColumnsNotUsed { columns } => write!(
                f,
                "columns of the force file that belong to no plate are not used: {}; `import: {{forces: …}}` assigns them",
                in_words(columns)
            ),
        }
    }
}

/// Quality of one trial.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct TrialQuality {
    /// Trial.
    pub trial: String,
    /// Number of frames.
    pub n_frames: usize,
    /// Duration, s.
    pub duration_s: f64,
    /// One row per marker, in the order of the recording.
    pub markers: Vec<MarkerQuality>,
    /// Reasons to review the trial, most severe first.
    pub reasons: Vec<QualityReason>,
}

/// Assesses a trial after labelling, artefact detection and filling; `fills` and `findings` are
/// their results.
pub fn assess(
    trial: &Trial,
    matched: Option<&MarkerSetMatch>,
    fills: &[GapFill],
    findings: &[Finding],
    options: &QualityOptions,
) -> TrialQuality {
    let markers = &trial.markers;
    let duration_s = markers.n_frames as f64 / markers.rate_hz;
    let mut reasons = Vec::new();
    let mut rows = Vec::with_capacity(markers.labels.len());
    let mut any_visible = false;
    for (label, track) in markers.labels.iter().zip(&markers.trajectories) {
        // Filled samples count as missing.
        let mut measured = track.clone();
        let mut filled_frames = 0;
        for fill in fills.iter().filter(|fill| &fill.marker == label) {
            let end = (fill.last_frame + 1).min(measured.len());
            measured[fill.first_frame.min(end)..end].fill(Vector3::repeat(f64::NAN));
            filled_frames += end.saturating_sub(fill.first_frame);
        }
        let gaps = missing_runs(&measured);
        let missing: usize = gaps.iter().map(|(start, end)| end - start).sum();
        let row = MarkerQuality {
            label: label.clone(),
            present_fraction: (measured.len() - missing) as f64 / measured.len().max(1) as f64,
            gaps: gaps.len(),
            longest_gap_frames: gaps.iter().map(|(start, end)| end - start).max().unwrap_or(0),
            filled_frames,
            spikes: findings.iter().filter(|x| &x.marker == label && x.kind == FindingKind::Spike).count(),
            swaps: findings
                .iter()
                .filter(|x| match &x.kind {
                    FindingKind::Swap { with } => &x.marker == label || with == label,
                    FindingKind::Spike => false,
                })
                .count(),
            noise_rms_m: noise_rms_m(&measured),
        };
        any_visible |= missing < measured.len();
        let known = matched.is_none_or(|m| m.present.contains(label));
        if known && missing < measured.len() {
            for (start, end) in missing_runs(track) {
                if (end - start) as f64 > options.long_gap_s * markers.rate_hz {
                    reasons.push(QualityReason::LongGap {
                        marker: label.clone(),
                        first_frame: start,
                        last_frame: end - 1,
                    });
                }
            }
            if row.spikes > 0 {
                reasons.push(QualityReason::Spikes { marker: label.clone(), count: row.spikes });
            }
            if row.noise_rms_m > options.noise_limit_m {
                reasons.push(QualityReason::NoisyMarker { marker: label.clone(), noise_rms_m: row.noise_rms_m });
            }
        }
        rows.push(row);
    }
    for finding in findings {
        if let FindingKind::Swap { with } = &finding.kind {
            reasons.push(QualityReason::LabelSwap {
                marker: finding.marker.clone(),
                with: with.clone(),
                first_frame: finding.first_frame,
                last_frame: finding.last_frame,
                repaired: finding.repaired,
            });
        }
    }
    if !any_visible {
        reasons.push(QualityReason::EmptyTrial);
    }
    if let Some(matched) = matched {
        if matched.present.is_empty() {
            reasons.push(QualityReason::NoMarkers);
        } else {
            reasons.extend(matched.missing.iter().map(|m| QualityReason::MissingMarker { marker: m.clone() }));
        }
    }
    if duration_s < options.short_trial_s {
        reasons.push(QualityReason::ShortTrial { duration_s });
    }
    if trial.plates.is_empty() && options.plates_expected {
        reasons.push(QualityReason::NoPlates);
    }
    for plate in &trial.plates {
        reasons.extend(plate_reasons(plate));
    }
    if !trial.unused_columns.is_empty() {
        reasons.push(QualityReason::ColumnsNotUsed { columns: trial.unused_columns.clone() });
    }
    reasons.sort_by_key(|reason| std::cmp::Reverse(reason.severity()));
    TrialQuality { trial: trial.name.clone(), n_frames: markers.n_frames, duration_s, markers: rows, reasons }
}

/// Standard deviation of white noise along one axis, from fourth differences: their variance is
/// C(8,4) = 70 times that of the noise, while smooth motion nearly cancels. The median over the
/// frames excludes impacts.
fn noise_rms_m(track: &[Vector3<f64>]) -> f64 {
    let mut sum = 0.0;
    for axis in 0..3 {
        let mut differences: Vec<f64> = track
            .windows(5)
            .map(|w| (w[0][axis] - 4.0 * w[1][axis] + 6.0 * w[2][axis] - 4.0 * w[3][axis] + w[4][axis]).abs())
            .filter(|d| d.is_finite())
            .collect();
        if differences.len() < 20 {
            return f64::NAN;
        }
        // The median absolute value of a normal variable is 0.6745 standard deviations.
        let deviation = median(&mut differences) / 0.674_489_75;
        sum += deviation * deviation / 70.0;
    }
    (sum / 3.0).sqrt()
}

/// Checks a plate for saturation, missing samples and lack of signal.
fn plate_reasons(plate: &Plate) -> Vec<QualityReason> {
    let mut reasons = Vec::new();
    let incomplete = plate.force_n.iter().filter(|f| !f.iter().all(|x| x.is_finite())).count();
    if incomplete > 0 {
        reasons.push(QualityReason::PlateIncomplete { plate: plate.name.clone(), samples: incomplete });
    }
    if !plate.force_n.is_empty() && plate.force_n.iter().all(|f| *f == Vector3::zeros()) {
        reasons.push(QualityReason::PlateSilent { plate: plate.name.clone() });
    }
    // A clipped amplifier repeats its end value exactly.
    let mut worst = 0;
    for axis in 0..3 {
        let extreme = plate.force_n.iter().map(|f| f[axis].abs()).filter(|x| x.is_finite()).fold(0.0, f64::max);
        if extreme < 50.0 {
            continue;
        }
        let mut run = 0;
        for force in &plate.force_n {
            run = if force[axis].abs() >= extreme * (1.0 - 1e-6) { run + 1 } else { 0 };
            worst = worst.max(run);
        }
    }
    if worst >= 5 {
        reasons.push(QualityReason::PlateSaturated { plate: plate.name.clone(), samples: worst });
    }
    reasons
}
