//! The recording: markers, plates, events and computed points.

use crate::{RecordedAt, Warning, WarningKind};
use aloft_c3d::PointKind;
use nalgebra::{Rotation3, Vector3};
use serde::{Deserialize, Serialize};

/// Marker trajectories, m, world frame.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct Markers {
    /// Sampling rate, Hz.
    pub rate_hz: f64,
    /// Number of the first frame in the source (1-based as in C3D).
    pub first_frame: u32,
    /// Number of frames.
    pub n_frames: usize,
    /// Labels, canonical after a marker set was applied.
    pub labels: Vec<String>,
    /// `trajectories[marker][frame]`, m; NaN where missing.
    pub trajectories: Vec<Vec<Vector3<f64>>>,
}

impl Markers {
    /// Index of a label.
    pub fn index(&self, label: &str) -> Option<usize> {
        self.labels.iter().position(|l| l == label)
    }
    /// Position, or `None` where missing.
    pub fn position(&self, marker: usize, frame: usize) -> Option<Vector3<f64>> {
        let p = self.trajectories[marker][frame];
        p.iter().all(|x| x.is_finite()).then_some(p)
    }
}

/// One force plate: the reaction on the subject, in the world frame.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct Plate {
    /// Name (`FP1` …).
    pub name: String,
    /// Sampling rate of the forces, Hz (the analog rate).
    pub rate_hz: f64,
    /// Corners, m, world frame (empty if the source does not state them).
    pub corners_m: Vec<Vector3<f64>>,
    /// Force on the subject, N, world frame.
    pub force_n: Vec<Vector3<f64>>,
    /// Moment on the subject about the world origin, N·m, world frame.
    pub moment_nm: Vec<Vector3<f64>>,
}

/// An event in the recording.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Event {
    /// Label, for example `Foot Off`.
    pub label: String,
    /// Context, for example `Left`; empty if the source has none.
    pub context: String,
    /// Seconds since the first frame of this recording.
    pub time_s: f64,
}

/// A computed point (angle, force, moment, power, scalar) that software stored among the markers;
/// units as in the source.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct ComputedPoint {
    /// Label.
    pub label: String,
    /// Kind; never [`PointKind::Marker`].
    pub kind: PointKind,
    /// Unit as the source states it.
    pub unit: String,
    /// Values per frame; NaN where missing.
    pub values: Vec<Vector3<f64>>,
}

impl ComputedPoint {
    /// True for forces and moments.
    pub(crate) fn is_vector(&self) -> bool {
        matches!(self.kind, PointKind::Force | PointKind::Moment)
    }
    /// True for vectors in laboratory axes (ground reactions). Joint forces and moments are stored
    /// in the axes of a segment that the file does not define, angles are not vectors, and powers
    /// and scalars have no direction.
    pub fn in_laboratory_axes(&self) -> bool {
        self.is_vector() && self.label.to_ascii_lowercase().contains("groundreaction")
    }
}

/// One recording in SI and one world frame.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct Trial {
    /// Name: the file's stem.
    pub name: String,
    /// Markers.
    pub markers: Markers,
    /// Plates; empty if the recording has none.
    pub plates: Vec<Plate>,
    /// Events.
    pub events: Vec<Event>,
    /// Computed points, kept separate from the markers.
    pub computed: Vec<ComputedPoint>,
    /// Rotation applied to all data to make Z vertical.
    pub world_from_source: Rotation3<f64>,
    /// When the recording was made, if its file states it.
    pub recorded: Option<RecordedAt>,
    /// The person whose markers these are, if the file (SUBJECTS:NAMES) or the labels say so.
    pub person: Option<String>,
    /// Everybody whose markers the file holds, if these are several people.
    pub people: Vec<String>,
    /// Columns of the force file that belong to no plate.
    pub unused_columns: Vec<String>,
    /// Time of the first frame by the frame numbers or the time column of the source, s.
    pub start_s: f64,
    /// Irregularities found during import.
    pub warnings: Vec<Warning>,
}

impl Trial {
    /// Adds a warning.
    pub(crate) fn warn(&mut self, kind: WarningKind, message: impl Into<String>) {
        self.warnings.push(Warning::new(kind, message));
    }

    /// Frames present and frames declared in a truncated recording; `None` for a complete one.
    pub fn truncated(&self) -> Option<(usize, usize)> {
        self.warnings.iter().find_map(|w| match w.kind {
            WarningKind::Truncated { held, stated } => Some((held, stated)),
            _ => None,
        })
    }

    /// Rows present and rows declared in a truncated force file; `None` for a complete one.
    pub fn forces_truncated(&self) -> Option<(usize, usize)> {
        self.warnings.iter().find_map(|w| match w.kind {
            WarningKind::ForcesTruncated { held, stated } => Some((held, stated)),
            _ => None,
        })
    }
}
