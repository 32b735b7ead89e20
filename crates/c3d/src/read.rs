//! Converts bytes to [`C3dFile`]: header, parameters, sizes, samples, and their description in the
//! standard groups.

use std::{
    collections::{HashMap, HashSet},
    sync::Arc,
};

use crate::{
    Analog, ByteOrder, C3dError, C3dFile, Parameters, Point, PointKind, Storage, Warning, WarningKind,
    events::{events_of_group, events_of_header},
    file::Source,
    header::{BLOCK, Header},
    layout::{Fit, Layout, Statements, choose},
    parameter_reader::read_parameters,
    plate_reader::read_plates,
    poses,
    samples::{AnalogScale, decode_analogs, decode_points},
    text,
};

impl C3dFile {
    /// Reads a file from memory.
    ///
    /// Memory use is bounded by a small multiple of the input's length. Irregularities that do not
    /// prevent reading go to [`C3dFile::warnings`]; a truncated file gives the frames present.
    ///
    /// # Errors
    /// [`C3dError::NotC3d`], [`C3dError::TooShort`], [`C3dError::Parameter`],
    /// [`C3dError::DataStart`]: each states the place.
    pub fn from_bytes(bytes: &[u8]) -> Result<Self, C3dError> {
        let mut warnings = Vec::new();
        let Some(header_block) = bytes.first_chunk::<BLOCK>() else {
            if let Some(&found) = bytes.get(1).filter(|b| **b != 0x50) {
                return Err(C3dError::NotC3d { offset: 1, found, expected: "0x50" });
            }
            return Err(C3dError::TooShort { length: bytes.len(), needed: BLOCK, what: "the header" });
        };
        if header_block[1] != 0x50 {
            return Err(C3dError::NotC3d { offset: 1, found: header_block[1], expected: "0x50" });
        }
        if header_block[0] == 0 {
            return Err(C3dError::NotC3d { offset: 0, found: 0, expected: "the block number of the parameters" });
        }
        let section = (usize::from(header_block[0]) - 1) * BLOCK;
        let Some(&[_, _, n_blocks, processor]) = bytes.get(section..).and_then(|b| b.first_chunk::<4>()) else {
            return Err(C3dError::TooShort { length: bytes.len(), needed: section + 4, what: "the parameter section" });
        };
        let order = order_of(processor, section, header_block, bytes.len(), &mut warnings)?;
        let header = Header::read(header_block, order);
        let nominal_end = section + usize::from(n_blocks) * BLOCK;
        let end = if header.data_start > section { nominal_end.max(header.data_start) } else { bytes.len() };
        let groups = read_parameters(bytes, section + 4, end, order, &mut warnings)?;

        let start = data_start(&header, &groups, section, bytes.len(), &mut warnings)?;
        let samples_end = poses::start(&groups, start, bytes.len());
        let (layout, first_frame, frames) = decide_layout(&header, &groups, samples_end - start, start, &mut warnings);
        let data = &bytes[start..start + layout.frame_bytes() * layout.n_frames];

        let point_scale = decide_point_scale(&header, &groups, layout.storage, &mut warnings);
        let point_rate_hz = decide_point_rate(&header, &groups, &layout, &mut warnings);
        let analog_rate_hz = decide_analog_rate(&groups, &layout, point_rate_hz, &mut warnings);

        let (mut points, point_unit) = describe_points(&groups, &layout, &mut warnings);
        decode_points(data, &layout, order, point_scale, &mut points);

        let general = groups.get("ANALOG", "GEN_SCALE").and_then(|p| p.number());
        let general = match general {
            Some(value) if value.is_finite() && (value != 0.0 || layout.n_channels == 0) => value,
            Some(value) => {
                let message = format!("ANALOG:GEN_SCALE is {value}; taken as 1");
                warnings.push(Warning::new(WarningKind::Analogs, message));
                1.0
            }
            None => 1.0,
        };
        let unsigned = raw_is_unsigned(&groups, &layout, data, order);
        let mut analogs = describe_analogs(&groups, &layout, unsigned, &mut warnings);
        let scales: Vec<AnalogScale> =
            analogs.iter().map(|a| AnalogScale { offset: a.offset, scale: a.scale * general }).collect();
        decode_analogs(data, &layout, order, unsigned, &scales, &mut analogs);

        let after = (start + data.len()).div_ceil(BLOCK) * BLOCK;
        let poses = poses::read(bytes, &groups, order, frames, point_rate_hz, after, &mut warnings);

        let mut events = events_of_group(&groups, &mut warnings);
        if events.is_empty() {
            events = events_of_header(&header.events);
        }
        let plates = read_plates(&groups, layout.n_channels, &mut warnings);
        let source = Source {
            header: Box::new(*header_block),
            data: Arc::from(data),
            layout,
            order,
            point_scale,
            analog_unsigned: unsigned,
            frames_from_zero: header.first_frame == 0 && first_frame == 1,
        };
        Ok(Self {
            point_rate_hz,
            first_frame,
            n_frames: if layout.n_frames > 0 { layout.n_frames } else { poses.n_frames() },
            point_unit,
            points,
            analogs,
            analog_rate_hz,
            events,
            plates,
            poses,
            warnings,
            groups,
            header_events: header.events,
            byte_order: order,
            storage: layout.storage,
            point_scale,
            analog_general_scale: general,
            analog_unsigned: unsigned,
            source: Some(source),
        })
    }
}

/// The byte order; if the processor byte is unknown, the one in which the header is plausible.
fn order_of(
    processor: u8,
    section: usize,
    header_block: &[u8; BLOCK],
    length: usize,
    warnings: &mut Vec<Warning>,
) -> Result<ByteOrder, C3dError> {
    if let Some(order) = ByteOrder::from_processor(processor) {
        return Ok(order);
    }
    let plausible = |order: ByteOrder| {
        let header = Header::read(header_block, order);
        header.data_start > section && header.data_start <= length && header.rate_hz > 0.1 && header.rate_hz < 1e5
    };
    match [ByteOrder::Intel, ByteOrder::Dec, ByteOrder::Mips].into_iter().find(|o| plausible(*o)) {
        Some(order) => {
            let message = format!(
                "byte {}: processor {processor} is not 84, 85 or 86; the header makes sense as {order:?}",
                section + 3
            );
            warnings.push(Warning::new(WarningKind::Contradiction, message));
            Ok(order)
        }
        None => Err(C3dError::NotC3d { offset: section + 3, found: processor, expected: "processor 84, 85 or 86" }),
    }
}

/// Start of the samples: the header's word, or POINT:DATA_START if that is impossible.
fn data_start(
    header: &Header,
    groups: &Parameters,
    section: usize,
    length: usize,
    warnings: &mut Vec<Warning>,
) -> Result<usize, C3dError> {
    let stated = groups.get("POINT", "DATA_START").and_then(|p| p.count()).filter(|n| *n > 0);
    let by_parameter = stated.map(|n| (n - 1).saturating_mul(BLOCK));
    let possible = |start: usize| start > section && start <= length;
    let start = match by_parameter {
        _ if possible(header.data_start) => header.data_start,
        Some(start) if possible(start) => start,
        _ => return Err(C3dError::DataStart { offset: 16, start: header.data_start, length }),
    };
    if by_parameter.is_some_and(|other| other != header.data_start) {
        let message = format!(
            "samples start at byte {} by the header, at {} by POINT:DATA_START; {start} taken",
            header.data_start,
            by_parameter.unwrap_or(0)
        );
        warnings.push(Warning::new(WarningKind::Contradiction, message));
    }
    Ok(start)
}

/// Chooses the sizes that agree with the file's length; also returns the number of the first frame.
fn decide_layout(
    header: &Header,
    groups: &Parameters,
    available: usize,
    start: usize,
    warnings: &mut Vec<Warning>,
) -> (Layout, u32, usize) {
    let count = |group: &str, name: &str| groups.get(group, name).and_then(|p| p.count());
    let mut statements = Statements::default();

    let by_parameter = groups.get("POINT", "SCALE").and_then(|p| p.number()).filter(|s| *s != 0.0 && s.is_finite());
    if let Some(scale) = by_parameter {
        statements.storages.push(if scale < 0.0 { Storage::Float } else { Storage::Integer });
    }
    if !statements.storages.contains(&header.storage()) {
        statements.storages.push(header.storage());
    }

    statements.points.push(header.n_points);
    statements.points.extend(count("POINT", "USED").filter(|n| *n != header.n_points));

    let per_frame = header.samples_per_frame.max(1);
    if header.analog_stride.is_multiple_of(per_frame) {
        statements.analogs.push((header.analog_stride / per_frame, per_frame));
    }
    if let Some(used) = count("ANALOG", "USED") {
        if used > 0 && header.analog_stride.is_multiple_of(used) {
            statements.analogs.push((used, header.analog_stride / used));
        }
        let rate = |group: &str| groups.get(group, "RATE").and_then(|p| p.number());
        if let (Some(analog), Some(point)) = (rate("ANALOG"), rate("POINT")) {
            let ratio = (analog / point).round();
            if (1.0..=65_535.0).contains(&ratio) {
                statements.analogs.push((used.min(65_535), ratio as usize));
            }
        }
        statements.analogs.push((used.min(65_535), per_frame));
    }
    if statements.analogs.is_empty() {
        statements.analogs.push((header.analog_stride, 1));
    }

    let by_header = (header.last_frame + 1).checked_sub(header.first_frame);
    let trial = trial_range(groups);
    let by_trial = trial.and_then(|(first, last)| (last + 1).checked_sub(first));
    let long = count("POINT", "LONG_FRAMES");
    let frames = count("POINT", "FRAMES");
    let longer = |n: Option<usize>| n.filter(|n| *n > 0);
    // A last frame of 65,535, or one that agrees with a longer count modulo 65,536, indicates an
    // overflow.
    let wrapped = header.last_frame == 65_535
        || [by_trial, long]
            .into_iter()
            .flatten()
            .any(|n| n > 65_535 && by_header.is_none_or(|h| n % 65_536 == h % 65_536));
    let order = if wrapped {
        [longer(by_trial), longer(long), longer(by_header), longer(frames)]
    } else {
        [longer(by_header), longer(by_trial), longer(long), longer(frames)]
    };
    statements.frames.extend(order.into_iter().flatten());
    if statements.frames.is_empty() {
        statements.frames.push(0);
    }

    let (mut layout, fit) = choose(&statements, available);
    let stated = layout.n_frames;
    if layout.n_frames == 0 || layout.frame_bytes() == 0 {
        layout.n_frames = 0;
        layout.n_points = layout.n_points.min(groups.merged_strings("POINT", "LABELS").len());
        layout.n_channels = layout.n_channels.min(groups.merged_strings("ANALOG", "LABELS").len());
        if poses::stated(groups).is_none() {
            warnings.push(Warning::new(WarningKind::Missing, format!("byte {start}: no frames")));
        }
    }
    if layout.n_frames > 0 || poses::stated(groups).is_none() {
        warn_about_layout(header, groups, &layout, fit, start, by_header, by_trial, warnings);
    }

    let by_trial_first = trial
        .filter(|_| by_trial == Some(layout.n_frames) || by_header != Some(layout.n_frames))
        .filter(|(first, _)| first % 65_536 == header.first_frame || by_header != Some(layout.n_frames));
    let first = by_trial_first.map_or(header.first_frame, |(first, _)| first);
    if first == 0 && layout.n_frames > 0 {
        let message = "header: frames are counted from 0; the first is taken as frame 1".to_owned();
        warnings.push(Warning::new(WarningKind::Contradiction, message));
    }
    (layout, u32::try_from(first).unwrap_or(1).max(1), stated)
}

/// TRIAL:ACTUAL_START_FIELD and ACTUAL_END_FIELD, each of two words, the lower first.
pub(crate) fn trial_range(groups: &Parameters) -> Option<(usize, usize)> {
    let field = |name: &str| {
        let words = groups.get("TRIAL", name)?.counts();
        let low = words.first().copied().flatten()?;
        let high = words.get(1).copied().flatten().unwrap_or(0);
        (low <= 65_535 && high <= 65_535 || words.len() == 1).then(|| low + high * 65_536)
    };
    Some((field("ACTUAL_START_FIELD")?, field("ACTUAL_END_FIELD")?))
}

fn warn_about_layout(
    header: &Header,
    groups: &Parameters,
    layout: &Layout,
    fit: Fit,
    start: usize,
    by_header: Option<usize>,
    by_trial: Option<usize>,
    warnings: &mut Vec<Warning>,
) {
    let mut contradiction = |message: String| warnings.push(Warning::new(WarningKind::Contradiction, message));
    let n = layout.n_frames;
    match fit {
        Fit::Exact => {}
        Fit::Surplus { bytes } => contradiction(format!("{bytes} bytes behind the last of {n} frames were not read")),
        Fit::Truncated { stated } => {
            let place = start + n * layout.frame_bytes();
            let message = format!("truncated: {stated} frames stated, the file ends in frame {} (byte {place})", n + 1);
            warnings.push(Warning::new(WarningKind::Truncated { held: n, stated }, message));
            return;
        }
    }
    if by_header.is_some_and(|h| h != n && h % 65_536 != n % 65_536 && header.last_frame != 65_535) {
        contradiction(format!(
            "header: frames {} to {}; the file's length holds {n} frames, which were read",
            header.first_frame, header.last_frame
        ));
    }
    if by_trial.is_some_and(|t| t != n) {
        contradiction(format!("TRIAL: {} frames; {n} were read", by_trial.unwrap_or(0)));
    }
    let used = |group: &str| groups.get(group, "USED").and_then(|p| p.count());
    for (group, stated, taken) in
        [("POINT", used("POINT"), layout.n_points), ("ANALOG", used("ANALOG"), layout.n_channels)]
    {
        if let Some(stated) = stated
            && stated != taken
        {
            contradiction(format!("{group}:USED is {stated}, the samples agree with {taken}"));
        }
    }
    let stride = layout.n_channels * layout.samples_per_frame;
    if header.analog_stride != stride && (header.analog_stride != 0 || layout.n_channels != 0) {
        contradiction(format!(
            "header: {} analog numbers a frame, the samples agree with {stride}",
            header.analog_stride
        ));
    }
    if header.storage() != layout.storage {
        contradiction(format!("header: scale {}; samples are {:?}", header.scale, layout.storage));
    }
}

fn decide_point_scale(header: &Header, groups: &Parameters, storage: Storage, warnings: &mut Vec<Warning>) -> f32 {
    let usable = |s: &f32| s.is_finite() && *s != 0.0;
    let by_header = Some(header.scale).filter(usable);
    let by_parameter = groups.get("POINT", "SCALE").and_then(|p| p.number()).map(|s| s as f32).filter(usable);
    if let (Some(h), Some(p)) = (by_header, by_parameter)
        && h != p
        && h.signum() == p.signum()
    {
        let relative = ((h - p) / p).abs();
        let message =
            format!("header: scale {h}, POINT:SCALE {p} (relative difference {relative:.1e}); POINT:SCALE taken");
        warnings.push(Warning::new(WarningKind::Contradiction, message));
    }
    match by_parameter.or(by_header) {
        Some(scale) => scale.abs(),
        None => {
            if storage == Storage::Integer {
                warnings.push(Warning::new(WarningKind::Missing, "no scale of the points; taken as 1"));
            }
            1.0
        }
    }
}

/// The rate of the points: POINT:RATE, the header, the analog rate over its samples a frame, or the
/// rate of the cameras; 0 where the file states none.
fn decide_point_rate(header: &Header, groups: &Parameters, layout: &Layout, warnings: &mut Vec<Warning>) -> f64 {
    let usable = |r: &f64| r.is_finite() && *r > 0.0;
    let by_header = Some(f64::from(header.rate_hz)).filter(usable);
    let by_parameter = groups.get("POINT", "RATE").and_then(|p| p.number()).filter(usable);
    match (by_parameter, by_header) {
        (Some(rate), other) => {
            if let Some(h) = other
                && h != rate
            {
                let message = format!("header: {h} Hz, POINT:RATE {rate} Hz; POINT:RATE taken");
                warnings.push(Warning::new(WarningKind::Contradiction, message));
            }
            rate
        }
        (None, Some(rate)) => {
            let message = format!("POINT:RATE missing; {rate} Hz taken from the header");
            warnings.push(Warning::new(WarningKind::Missing, message));
            rate
        }
        (None, None) => {
            let number = |group, name| groups.get(group, name).and_then(|p| p.number()).filter(usable);
            let by_channels =
                number("ANALOG", "RATE").filter(|_| layout.n_channels > 0 && layout.samples_per_frame > 0);
            let by_channels = by_channels.map(|rate| rate / layout.samples_per_frame as f64);
            let found = by_channels
                .map(|rate| (rate, "ANALOG:RATE and its samples a frame"))
                .or_else(|| number("TRIAL", "CAMERA_RATE").map(|rate| (rate, "TRIAL:CAMERA_RATE")));
            let message = match found {
                Some((rate, from)) => format!("no point rate in parameters or header; {rate} Hz taken from {from}"),
                None => "no point rate anywhere in the file".to_owned(),
            };
            warnings.push(Warning::new(WarningKind::Missing, message));
            found.map_or(0.0, |f| f.0)
        }
    }
}

pub(crate) fn decide_analog_rate(
    groups: &Parameters,
    layout: &Layout,
    point_rate_hz: f64,
    warnings: &mut Vec<Warning>,
) -> f64 {
    let by_layout = point_rate_hz * layout.samples_per_frame.max(1) as f64;
    if layout.n_channels == 0 {
        return by_layout;
    }
    let stated = groups.get("ANALOG", "RATE").and_then(|p| p.number()).filter(|r| r.is_finite() && *r > 0.0);
    match stated {
        Some(rate) if (rate / by_layout - 1.0).abs() < 1e-3 => rate,
        Some(rate) => {
            let message = format!(
                "ANALOG:RATE {rate} Hz, but {} samples a frame at {point_rate_hz} Hz are {by_layout} Hz, which was taken",
                layout.samples_per_frame
            );
            warnings.push(Warning::new(WarningKind::Contradiction, message));
            by_layout
        }
        None => {
            let message = format!("ANALOG:RATE missing; {by_layout} Hz from samples a frame");
            warnings.push(Warning::new(WarningKind::Missing, message));
            by_layout
        }
    }
}

/// Points with labels, kinds and units, without samples. Also returns the markers' unit.
pub(crate) fn describe_points(
    groups: &Parameters,
    layout: &Layout,
    warnings: &mut Vec<Warning>,
) -> (Vec<Point>, String) {
    let mut labels = groups.merged_strings("POINT", "LABELS").into_iter();
    let mut descriptions = groups.merged_strings("POINT", "DESCRIPTIONS").into_iter();
    let unit = groups.get("POINT", "UNITS").and_then(|p| p.string()).filter(|u| !u.is_empty());
    let unit = unit.unwrap_or_else(|| {
        if layout.n_points > 0 {
            warnings.push(Warning::new(WarningKind::Missing, "POINT:UNITS missing; taken as mm"));
        }
        "mm".to_owned()
    });
    let mut kinds: HashMap<String, (PointKind, String)> = HashMap::new();
    for (list, kind) in PointKind::LISTS {
        let kind_unit = groups.get("POINT", &format!("{}_UNITS", &list[..list.len() - 1])).and_then(|p| p.string());
        for label in groups.merged_strings("POINT", list) {
            if !label.is_empty() {
                kinds.entry(label).or_insert_with(|| (kind, kind_unit.clone().unwrap_or_default()));
            }
        }
    }
    let n_labels = labels.len();
    let mut points = Vec::with_capacity(layout.n_points);
    for i in 0..layout.n_points {
        let label = labels.next().unwrap_or_else(|| format!("*{}", i + 1));
        let listed = kinds.get(&label).or_else(|| kinds.get(text::strip_subject(&label)));
        let (kind, unit) = listed.cloned().unwrap_or_else(|| (PointKind::Marker, unit.clone()));
        points.push(Point {
            label,
            description: descriptions.next().unwrap_or_default(),
            kind,
            unit,
            ..Point::default()
        });
    }
    if n_labels < layout.n_points {
        let message =
            format!("POINT:LABELS names {n_labels} of {} points; the others are called *number", layout.n_points);
        warnings.push(Warning::new(WarningKind::Labels, message));
    }
    warn_about_labels(&points, warnings);
    (points, unit)
}

fn warn_about_labels(points: &[Point], warnings: &mut Vec<Warning>) {
    let mut seen: HashMap<&str, usize> = HashMap::new();
    for point in points.iter().filter(|p| !text::is_unlabelled(&p.label)) {
        *seen.entry(&point.label).or_default() += 1;
    }
    let mut doubled: Vec<&str> = seen.iter().filter(|(_, n)| **n > 1).map(|(label, _)| *label).collect();
    doubled.sort_unstable();
    if !doubled.is_empty() {
        let message = format!("labels that occur more than once: {}", doubled.join(", "));
        warnings.push(Warning::new(WarningKind::Labels, message));
    }
    // Old exporters truncate labels to four characters and keep the full names as descriptions.
    let longest = points.iter().map(|p| p.label.len()).max().unwrap_or(0);
    let fuller = points.iter().filter(|p| p.description.len() > p.label.len()).count();
    let descriptions: HashSet<&str> = points.iter().map(|p| p.description.as_str()).collect();
    if longest == 4 && !doubled.is_empty() && 2 * fuller > points.len() && descriptions.len() > seen.len() {
        let message = "labels are cut to four characters; POINT:DESCRIPTIONS holds the full names".to_owned();
        warnings.push(Warning::new(WarningKind::Labels, message));
    }
}

/// Whether raw integers and offsets are unsigned: stated by ANALOG:FORMAT, or inferred if a 16-bit
/// channel that requires it exceeds 32,767.
pub(crate) fn raw_is_unsigned(groups: &Parameters, layout: &Layout, data: &[u8], order: ByteOrder) -> bool {
    match groups.get("ANALOG", "FORMAT").and_then(|p| p.string()).map(|f| f.to_ascii_uppercase()) {
        Some(format) if format.starts_with("UNSIGNED") => return true,
        Some(format) if format.starts_with("SIGNED") => return false,
        _ => {}
    }
    let bits = groups.get("ANALOG", "BITS").and_then(|p| p.count());
    let offsets = groups.merged_numbers("ANALOG", "OFFSET");
    let negative = |channel: usize| offsets.get(channel).is_some_and(|o| *o < 0.0);
    if layout.n_channels == 0 || !(0..layout.n_channels).any(negative) {
        return false;
    }
    match layout.storage {
        // Integers above 32,767 look negative: treat them as unsigned only if the offsets of 16-bit
        // channels require it.
        Storage::Integer => bits == Some(16),
        Storage::Float => {
            let frame = layout.frame_bytes().max(1);
            matches!(bits, None | Some(16))
                && data.chunks_exact(frame).any(|f| {
                    let samples = f[layout.point_bytes()..].chunks_exact(4).enumerate();
                    samples
                        .filter(|(i, _)| negative(i % layout.n_channels))
                        .any(|(_, c)| order.f32([c[0], c[1], c[2], c[3]]) > 32_767.0)
                })
        }
    }
}

/// Channels with labels, units and scaling, without samples.
pub(crate) fn describe_analogs(
    groups: &Parameters,
    layout: &Layout,
    unsigned: bool,
    warnings: &mut Vec<Warning>,
) -> Vec<Analog> {
    let n = layout.n_channels;
    if n == 0 {
        return Vec::new();
    }
    let mut labels = groups.merged_strings("ANALOG", "LABELS").into_iter();
    let mut descriptions = groups.merged_strings("ANALOG", "DESCRIPTIONS").into_iter();
    let mut units = groups.merged_strings("ANALOG", "UNITS").into_iter();
    let scales = groups.merged_numbers("ANALOG", "SCALE");
    let offsets = groups.merged_numbers("ANALOG", "OFFSET");
    for (name, count) in [("LABELS", labels.len()), ("SCALE", scales.len()), ("OFFSET", offsets.len())] {
        if count < n {
            let instead = ["the others are called *number", "1 taken for the others", "0 taken for the others"]
                [["LABELS", "SCALE", "OFFSET"].iter().position(|k| *k == name).unwrap_or(0)];
            let message = format!("ANALOG:{name} holds {count} of {n} channels; {instead}");
            warnings.push(Warning::new(WarningKind::Analogs, message));
        }
    }
    let mut analogs = Vec::with_capacity(n);
    let mut zero_scales = 0_usize;
    for i in 0..n {
        let scale = scales.get(i).copied().unwrap_or(1.0);
        zero_scales += usize::from(scale == 0.0);
        let offset = offsets.get(i).copied().filter(|o| o.is_finite()).unwrap_or(0.0);
        analogs.push(Analog {
            label: labels.next().unwrap_or_else(|| format!("*{}", i + 1)),
            description: descriptions.next().unwrap_or_default(),
            unit: units.next().unwrap_or_default(),
            scale,
            offset: if unsigned && offset < 0.0 { offset + 65_536.0 } else { offset },
            values: Vec::new(),
        });
    }
    if zero_scales > 0 {
        let message = format!("ANALOG:SCALE is 0 for {zero_scales} channels: their values are all 0");
        warnings.push(Warning::new(WarningKind::Analogs, message));
    }
    analogs
}
