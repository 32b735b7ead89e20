//! Poses of body segments, which markerless software stores in a block of its own (group ROTATION):
//! for each frame and segment a 4×4 matrix, column by column, and a reliability, 17 floats.

use crate::{
    ByteOrder, C3dError, C3dFile, Parameter, Parameters, Warning, WarningKind,
    header::BLOCK,
    number::{Dec, Intel, Mips, Order},
};

/// Floats of one pose: the matrix and the reliability.
const FLOATS: usize = 17;
/// Bytes of one pose.
const BYTES: usize = 4 * FLOATS;

/// One segment over all frames.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct SegmentTrack {
    /// Label as stored (`pelvis_4X4`).
    pub label: String,
    /// World from segment, a 4×4 matrix column by column; the translation in the file's point unit.
    /// NaN where the software has no pose.
    pub matrix: Vec<[f32; 16]>,
    /// Reliability as stored; −1 where there is no pose.
    pub reliability: Vec<f32>,
}

/// The segments of a recording, all with the same number of frames.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct SegmentPoses {
    /// Poses a second.
    pub rate_hz: f64,
    /// The segments.
    pub segments: Vec<SegmentTrack>,
}

impl SegmentPoses {
    /// Number of frames.
    pub fn n_frames(&self) -> usize {
        self.segments.first().map_or(0, |s| s.matrix.len())
    }
}

/// Poses a frame that the file states (ROTATION:USED); `None` without such a block.
pub(crate) fn stated(groups: &Parameters) -> Option<usize> {
    groups.get("ROTATION", "USED").and_then(|p| p.count()).filter(|n| *n > 0)
}

/// First byte of the block as the file states it, where the samples end; the file's length without
/// one.
pub(crate) fn start(groups: &Parameters, samples: usize, length: usize) -> usize {
    let start = groups.get("ROTATION", "DATA_START").and_then(|p| p.count()).filter(|n| *n > 0);
    let start = start.map(|n| (n - 1).saturating_mul(BLOCK)).filter(|s| *s >= samples && *s <= length);
    start.filter(|_| stated(groups).is_some()).unwrap_or(length)
}

/// Reads the block. `frames` are those that the header states, `after` is the byte behind the
/// samples.
pub(crate) fn read(
    bytes: &[u8],
    groups: &Parameters,
    order: ByteOrder,
    frames: usize,
    point_rate_hz: f64,
    after: usize,
    warnings: &mut Vec<Warning>,
) -> SegmentPoses {
    let Some(used) = stated(groups) else { return SegmentPoses::default() };
    let number = |name: &str| groups.get("ROTATION", name).and_then(|p| p.number());
    let stated_start = groups.get("ROTATION", "DATA_START").and_then(|p| p.count()).filter(|n| *n > 0);
    let start = match stated_start.map(|n| (n - 1).saturating_mul(BLOCK)) {
        Some(start) if start >= after.min(bytes.len()) && start <= bytes.len() => start,
        other => {
            let message = format!(
                "ROTATION:DATA_START is byte {}; the poses are taken from byte {after}, behind the samples",
                other.map_or("unknown".to_owned(), |s| s.to_string())
            );
            warnings.push(Warning::new(WarningKind::Contradiction, message));
            after.min(bytes.len())
        }
    };
    let ratio = number("RATIO").filter(|r| *r >= 1.0 && r.is_finite()).map_or(1, |r| r.round() as usize);
    let wanted = frames.saturating_mul(ratio);
    let held = (bytes.len() - start) / used.saturating_mul(BYTES).max(1);
    let n = if wanted == 0 { held } else { held.min(wanted) };
    if n < wanted {
        let message = format!("byte {}: {n} of {wanted} stated frames of segment poses", bytes.len());
        warnings.push(Warning::new(WarningKind::Truncated { held: n, stated: wanted }, message));
    }
    if n == 0 {
        return SegmentPoses::default();
    }
    let labels = groups.merged_strings("ROTATION", "LABELS");
    let mut segments: Vec<SegmentTrack> = (0..used)
        .map(|i| SegmentTrack {
            label: labels.get(i).map_or_else(|| format!("segment{}", i + 1), |l| l.trim().to_owned()),
            matrix: Vec::with_capacity(n),
            reliability: Vec::with_capacity(n),
        })
        .collect();
    let data = &bytes[start..start + n * used * BYTES];
    match order {
        ByteOrder::Intel => decode::<Intel>(data, &mut segments),
        ByteOrder::Dec => decode::<Dec>(data, &mut segments),
        ByteOrder::Mips => decode::<Mips>(data, &mut segments),
    }
    let rate_hz = number("RATE").filter(|r| *r > 0.0 && r.is_finite()).unwrap_or(point_rate_hz * ratio as f64);
    SegmentPoses { rate_hz, segments }
}

fn decode<O: Order>(data: &[u8], segments: &mut [SegmentTrack]) {
    let used = segments.len();
    for (i, pose) in data.chunks_exact(BYTES).enumerate() {
        let mut floats = pose.chunks_exact(4).map(|b| O::f32([b[0], b[1], b[2], b[3]]));
        let mut matrix = [f32::NAN; 16];
        for cell in &mut matrix {
            *cell = floats.next().unwrap_or(f32::NAN);
        }
        let segment = &mut segments[i % used];
        segment.matrix.push(matrix);
        segment.reliability.push(floats.next().unwrap_or(-1.0));
    }
}

/// Checks the poses of a file that is to be written, and makes its group agree with them.
pub(crate) fn sync(file: &C3dFile, groups: &mut Parameters) -> Result<(), C3dError> {
    let fail = |problem: String| C3dError::Write { item: "ROTATION".to_owned(), problem };
    let n = file.poses.n_frames();
    if let Some(count) = stated(groups)
        && file.poses.segments.is_empty()
    {
        return Err(fail(format!(
            "the recording held {count} segment poses a frame, which were not read and would be lost"
        )));
    }
    let Some(first) = file.poses.segments.first() else { return Ok(()) };
    if let Some(odd) = file.poses.segments.iter().find(|s| s.matrix.len() != n || s.reliability.len() != n) {
        return Err(fail(format!("segment {} has other frames than {} ({n})", odd.label, first.label)));
    }
    let ratio = (file.poses.rate_hz / file.point_rate_hz).round();
    let points = if file.points.is_empty() && file.analogs.is_empty() { n } else { file.n_frames };
    if !(1.0..=255.0).contains(&ratio) || points * ratio as usize != n {
        return Err(fail(format!(
            "{n} poses at {} Hz beside {points} frames at {} Hz",
            file.poses.rate_hz, file.point_rate_hz
        )));
    }
    let count = i16::try_from(file.poses.segments.len()).map_err(|_| fail("more than 32,767 segments".to_owned()))?;
    if stated(groups) == Some(file.poses.segments.len()) {
        // as it was read
        return Ok(());
    }
    let labels: Vec<&str> = file.poses.segments.iter().map(|s| s.label.as_str()).collect();
    if labels.len() > 255 {
        return Err(fail("more than 255 segments".to_owned()));
    }
    groups.set("ROTATION", Parameter::texts("LABELS", &labels));
    groups.set("ROTATION", Parameter::integer("USED", count));
    groups.set("ROTATION", Parameter::float("RATE", file.poses.rate_hz as f32));
    groups.set("ROTATION", Parameter::integer("RATIO", ratio as i16));
    groups.set("ROTATION", Parameter::integer("DATA_START", 1));
    Ok(())
}

/// Appends the block.
pub(crate) fn push(file: &C3dFile, out: &mut Vec<u8>) {
    for frame in 0..file.poses.n_frames() {
        for segment in &file.poses.segments {
            for value in segment.matrix[frame].iter().chain([&segment.reliability[frame]]) {
                out.extend_from_slice(&file.byte_order.f32_bytes(*value));
            }
        }
    }
}
