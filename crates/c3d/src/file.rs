//! The structure of a file.

use crate::{C3dError, Warning};

/// A whole C3D file.
#[derive(Debug, Clone)]
pub struct C3dFile {
    /// Point rate, Hz.
    pub point_rate_hz: f64,
    /// Number of the first frame (1-based).
    pub first_frame: u32,
    /// Frames that the file holds.
    pub n_frames: usize,
    /// Unit of the markers, as in POINT:UNITS (`mm`, `m` …).
    pub point_unit: String,
    /// Points: markers and computed points.
    pub points: Vec<Point>,
    /// Analog channels.
    pub analogs: Vec<Analog>,
    /// Analog samples a second.
    pub analog_rate_hz: f64,
    /// Events.
    pub events: Vec<FileEvent>,
    /// Force plates as described (not yet wrenches).
    pub plates: Vec<PlateDescription>,
    /// Oddities.
    pub warnings: Vec<Warning>,
}

/// What a stored point is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum PointKind {
    /// Marker.
    Marker,
    /// Listed in POINT:ANGLES.
    Angle,
    /// Force.
    Force,
    /// Moment.
    Moment,
    /// Power.
    Power,
    /// Scalar.
    Scalar,
}

/// One point over all frames.
#[derive(Debug, Clone)]
pub struct Point {
    /// Label as stored.
    pub label: String,
    /// Description as stored.
    pub description: String,
    /// What it is.
    pub kind: PointKind,
    /// Coordinates in the file's units; NaN where invalid.
    pub xyz: Vec<[f32; 3]>,
    /// Residual in the file's units (0 for computed), NaN where invalid.
    pub residual: Vec<f32>,
    /// Cameras that saw it, bit mask.
    pub cameras: Vec<u8>,
}

/// One analog channel, scaled.
#[derive(Debug, Clone)]
pub struct Analog {
    /// Label.
    pub label: String,
    /// Description.
    pub description: String,
    /// Unit as stated.
    pub unit: String,
    /// Values in that unit.
    pub values: Vec<f64>,
}

/// An event.
#[derive(Debug, Clone)]
pub struct FileEvent {
    /// Label.
    pub label: String,
    /// Context.
    pub context: String,
    /// Seconds on the clock of the original trial, in which frame 1 is 0 s.
    pub time_s: f64,
}

/// A plate as the file describes it.
#[derive(Debug, Clone)]
pub struct PlateDescription {
    /// Type 1-7.
    pub kind: i32,
    /// Corners in the file's point units, world frame of the file.
    pub corners: [[f64; 3]; 4],
    /// Origin in the file's point units.
    pub origin: [f64; 3],
    /// Zero-based indices into `analogs`.
    pub channels: Vec<usize>,
}

/// A plate's wrench on the subject, in the file's world axes, SI: force N, moment N·m about the origin of the file's world.
#[derive(Debug, Clone)]
pub struct PlateWrench {
    /// Force on the subject, N, at the analog rate.
    pub force_n: Vec<[f64; 3]>,
    /// Moment about the world origin, N·m.
    pub moment_nm: Vec<[f64; 3]>,
}

impl C3dFile {
    /// Reads a file from memory.
    pub fn from_bytes(_bytes: &[u8]) -> Result<Self, C3dError> {
        todo!()
    }
    /// Writes the file.
    pub fn to_bytes(&self) -> Result<Vec<u8>, C3dError> {
        todo!()
    }
    /// The calibrated wrench of plate `index` as reaction on the subject.
    pub fn plate_wrench(&self, _index: usize) -> Result<PlateWrench, C3dError> {
        todo!()
    }
}
