//! The structure of a file: typed fields for readers of recordings, and the parameter tree as
//! stored.

use std::sync::Arc;

use crate::{ByteOrder, HeaderEvent, Parameters, SegmentPoses, Storage, Warning, layout::Layout};

/// A whole C3D file.
///
/// [`C3dFile::to_bytes`] writes the typed fields: it updates the standard parameters to agree with
/// them and leaves all other parameters unchanged.
#[derive(Debug, Clone)]
pub struct C3dFile {
    /// Point rate, Hz.
    pub point_rate_hz: f64,
    /// Number of the first frame (1-based).
    pub first_frame: u32,
    /// Frames present in the file.
    pub n_frames: usize,
    /// Unit of the markers, as in POINT:UNITS (`mm`, `m` …); `mm` if not stated.
    pub point_unit: String,
    /// Points: markers and computed points.
    pub points: Vec<Point>,
    /// Analog channels.
    pub analogs: Vec<Analog>,
    /// Analog sampling rate, Hz.
    pub analog_rate_hz: f64,
    /// Events of the group EVENT, or those of the header if that group has none.
    pub events: Vec<FileEvent>,
    /// Force plates as described (not yet converted to wrenches).
    pub plates: Vec<PlateDescription>,
    /// Poses of body segments, which markerless software stores (group ROTATION); empty in other
    /// files.
    pub poses: SegmentPoses,
    /// Warnings.
    pub warnings: Vec<Warning>,
    /// All groups and parameters as stored.
    pub groups: Parameters,
    /// Events of the header.
    pub header_events: Vec<HeaderEvent>,
    /// Byte order of the source and of the written file.
    pub byte_order: ByteOrder,
    /// Integer or float samples, in the source and in the written file.
    pub storage: Storage,
    /// POINT:SCALE without its sign: unit of integer coordinates, and of residuals in both
    /// storages.
    pub point_scale: f32,
    /// ANALOG:GEN_SCALE.
    pub analog_general_scale: f64,
    /// Whether raw integer samples and offsets of the channels are unsigned.
    pub analog_unsigned: bool,
    /// Source of the bytes, so that rewriting can preserve what the typed fields cannot represent.
    pub(crate) source: Option<Source>,
}

/// Header and samples as they were read.
#[derive(Debug, Clone)]
pub(crate) struct Source {
    pub header: Box<[u8; 512]>,
    pub data: Arc<[u8]>,
    pub layout: Layout,
    pub order: ByteOrder,
    pub point_scale: f32,
    pub analog_unsigned: bool,
    /// Whether the header counts frames from 0.
    pub frames_from_zero: bool,
}

/// Kind of a stored point.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum PointKind {
    /// Marker.
    #[default]
    Marker,
    /// Listed in POINT:ANGLES.
    Angle,
    /// Listed in POINT:FORCES.
    Force,
    /// Listed in POINT:MOMENTS.
    Moment,
    /// Listed in POINT:POWERS.
    Power,
    /// Listed in POINT:SCALARS.
    Scalar,
}

impl PointKind {
    /// The computed kinds, each with the name of its list.
    pub const LISTS: [(&'static str, Self); 5] = [
        ("ANGLES", Self::Angle),
        ("FORCES", Self::Force),
        ("MOMENTS", Self::Moment),
        ("POWERS", Self::Power),
        ("SCALARS", Self::Scalar),
    ];
}

/// One point over all frames.
#[derive(Debug, Clone, Default)]
pub struct Point {
    /// Label as stored, without surrounding blanks.
    pub label: String,
    /// Description as stored.
    pub description: String,
    /// Kind.
    pub kind: PointKind,
    /// Unit stated in the file for this kind of point.
    pub unit: String,
    /// Coordinates in the file's units; NaN where invalid.
    pub xyz: Vec<[f32; 3]>,
    /// Residual in the file's units (0 for computed), NaN where invalid.
    pub residual: Vec<f32>,
    /// Cameras that saw the point, bit mask.
    pub cameras: Vec<u8>,
}

/// One analog channel, scaled.
#[derive(Debug, Clone, Default)]
pub struct Analog {
    /// Label.
    pub label: String,
    /// Description.
    pub description: String,
    /// Unit as stated.
    pub unit: String,
    /// ANALOG:SCALE of this channel.
    pub scale: f64,
    /// ANALOG:OFFSET of this channel, in raw counts.
    pub offset: f64,
    /// Values in that unit: (raw − offset) × scale × general scale.
    pub values: Vec<f64>,
}

/// An event.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct FileEvent {
    /// Label.
    pub label: String,
    /// Context; empty where the file has none.
    pub context: String,
    /// Seconds on the clock of the original trial, on which frame 1 is at 0 s.
    pub time_s: f64,
    /// Subject; empty where the file has none.
    pub subject: String,
    /// Description; empty where the file has none.
    pub description: String,
}

/// A plate as the file describes it.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct PlateDescription {
    /// Type 1-7.
    pub kind: i32,
    /// Corners in the file's point units, world frame of the file.
    pub corners: [[f64; 3]; 4],
    /// Origin in the file's point units: from the sensor's origin to the centre of the surface, in
    /// plate axes (its z is usually negative: the plate's z points down). Type 3 holds sensor
    /// distances a, b and the depth.
    pub origin: [f64; 3],
    /// Zero-based indices into `analogs`.
    pub channels: Vec<usize>,
    /// CAL_MATRIX of this plate, `matrix[row][column]` with a row for each output; empty where the
    /// file has none.
    pub calibration: Vec<Vec<f64>>,
    /// FORCE_PLATFORM:ZERO as stored: first and last frame of the unloaded baseline, 1-based; (0,
    /// 0) and (1, 0) mean none.
    pub zero_frames: [i32; 2],
}

/// A plate's wrench on the subject, in the file's world axes, SI: force N, moment N·m about the
/// origin of the file's world.
#[derive(Debug, Clone, Default)]
pub struct PlateWrench {
    /// Force on the subject, N, at the analog rate.
    pub force_n: Vec<[f64; 3]>,
    /// Moment about the world origin, N·m.
    pub moment_nm: Vec<[f64; 3]>,
    /// Decisions and repairs: sign, units, baseline.
    pub warnings: Vec<Warning>,
}

impl C3dFile {
    /// Index of a point by its label as stored.
    pub fn point_index(&self, label: &str) -> Option<usize> {
        self.points.iter().position(|p| p.label == label)
    }
    /// The markers, without computed points.
    pub fn markers(&self) -> impl Iterator<Item = &Point> {
        self.points.iter().filter(|p| p.kind == PointKind::Marker)
    }
    /// Analog samples in one point frame; 0 without channels.
    pub fn samples_per_frame(&self) -> usize {
        let samples = self.analogs.first().map_or(0, |a| a.values.len());
        samples.checked_div(self.n_frames).unwrap_or(0)
    }
    /// Whether unsignedness was inferred from the samples rather than stated in ANALOG:FORMAT.
    pub(crate) fn unsigned_by_inference(&self) -> bool {
        self.source
            .as_ref()
            .is_some_and(|s| s.analog_unsigned == self.analog_unsigned && self.groups.get("ANALOG", "FORMAT").is_none())
    }
    /// Metres in one point unit; `None` for an unknown unit.
    pub fn metres_per_point_unit(&self) -> Option<f64> {
        crate::unit::metres_per(&self.point_unit)
    }
}
