//! Updates the standard parameters from the typed fields before a file is written.
//!
//! Each piece is decoded as by the reader and left unchanged if it already gives the content of the
//! fields, so that rewriting an unchanged file changes no parameter.

use crate::{
    C3dError, C3dFile, FileEvent, Parameter, Parameters, PointKind, Storage, Values,
    events::{events_of_group, events_of_header},
    layout::Layout,
    plate_reader::{channels_of_kind, read_plates},
    poses,
    read::{decide_analog_rate, describe_analogs, describe_points, trial_range},
};

/// The parameters for the present state of the file.
pub(crate) fn synchronized(file: &C3dFile, layout: &Layout) -> Result<Parameters, C3dError> {
    let mut groups = file.groups.clone();
    sync_points(file, layout, &mut groups)?;
    sync_trial(file, &mut groups);
    sync_analogs(file, layout, &mut groups)?;
    sync_events(file, &mut groups)?;
    sync_plates(file, &mut groups)?;
    poses::sync(file, &mut groups)?;
    Ok(groups)
}

/// POINT:DATA_START.
pub(crate) fn set_data_start(groups: &mut Parameters, block: usize) {
    set_count(groups, "POINT", "DATA_START", block);
}

/// ROTATION:DATA_START.
pub(crate) fn set_poses_start(groups: &mut Parameters, block: usize) {
    set_count(groups, "ROTATION", "DATA_START", block);
}

fn set_count(groups: &mut Parameters, group: &str, name: &str, count: usize) {
    if groups.get(group, name).and_then(|p| p.count()) != Some(count) {
        let word = u16::try_from(count).unwrap_or(u16::MAX);
        groups.set(group, Parameter::integer(name, word as i16));
    }
}

fn set_float(groups: &mut Parameters, group: &str, name: &str, value: f32) {
    if groups.get(group, name).and_then(|p| p.number()).map(|v| v as f32) != Some(value) {
        groups.set(group, Parameter::float(name, value));
    }
}

/// Writes `NAME`, `NAME2` … with 255 entries each and removes surplus lists of an older version.
fn set_parts<T>(
    groups: &mut Parameters,
    group: &str,
    name: &str,
    entries: &[T],
    make: impl Fn(&str, &[T]) -> Parameter,
) -> Result<(), C3dError> {
    let mut parts = 0;
    for (k, part) in entries.chunks(255).enumerate() {
        let part_name = if k == 0 { name.to_owned() } else { format!("{name}{}", k + 1) };
        let parameter = make(&part_name, part);
        if parameter.announced() != parameter.values.len() {
            return Err(C3dError::Write {
                item: format!("parameter {group}:{part_name}"),
                problem: "a text of more than 255 bytes".into(),
            });
        }
        groups.set(group, parameter);
        parts = k + 1;
    }
    if parts == 0 {
        groups.set(group, make(name, &[]));
        parts = 1;
    }
    for k in parts + 1..=300 {
        if groups.remove(group, &format!("{name}{k}")).is_none() {
            break;
        }
    }
    Ok(())
}

fn set_texts(groups: &mut Parameters, group: &str, name: &str, texts: &[&str]) -> Result<(), C3dError> {
    set_parts(groups, group, name, texts, Parameter::texts)
}

fn sync_points(file: &C3dFile, layout: &Layout, groups: &mut Parameters) -> Result<(), C3dError> {
    let n = layout.n_frames;
    set_count(groups, "POINT", "USED", layout.n_points);
    let sign = if layout.storage == Storage::Float { -1.0 } else { 1.0 };
    set_float(groups, "POINT", "SCALE", sign * file.point_scale.abs());
    set_float(groups, "POINT", "RATE", file.point_rate_hz as f32);
    if groups.get("POINT", "DATA_START").is_none() {
        set_data_start(groups, 2);
    }
    set_count(groups, "POINT", "FRAMES", n.min(65_535));
    if n > 65_535 || groups.get("POINT", "LONG_FRAMES").is_some() {
        set_float(groups, "POINT", "LONG_FRAMES", n as f32);
    }
    let fresh = file.source.is_none();
    let (mut now, unit) = describe_points(groups, layout, &mut Vec::new());
    let stated = groups.get("POINT", "UNITS").is_some();
    if unit != file.point_unit || (!stated && fresh) {
        groups.set("POINT", Parameter::text("UNITS", &file.point_unit));
        now = describe_points(groups, layout, &mut Vec::new()).0;
    }
    if (fresh && groups.get("POINT", "LABELS").is_none())
        || now.iter().zip(&file.points).any(|(a, b)| a.label != b.label)
    {
        let labels: Vec<&str> = file.points.iter().map(|p| p.label.as_str()).collect();
        set_texts(groups, "POINT", "LABELS", &labels)?;
    }
    if now.iter().zip(&file.points).any(|(a, b)| a.description != b.description)
        || (fresh && groups.get("POINT", "DESCRIPTIONS").is_none())
    {
        let descriptions: Vec<&str> = file.points.iter().map(|p| p.description.as_str()).collect();
        set_texts(groups, "POINT", "DESCRIPTIONS", &descriptions)?;
    }
    let now = describe_points(groups, layout, &mut Vec::new()).0;
    for (list, kind) in PointKind::LISTS {
        let differs = now.iter().zip(&file.points).any(|(a, b)| (a.kind == kind) != (b.kind == kind));
        let unit_name = format!("{}_UNITS", &list[..list.len() - 1]);
        if differs {
            let labels: Vec<&str> = file.points.iter().filter(|p| p.kind == kind).map(|p| p.label.as_str()).collect();
            set_texts(groups, "POINT", list, &labels)?;
        }
        let unit = file.points.iter().find(|p| p.kind == kind && !p.unit.is_empty()).map(|p| p.unit.as_str());
        if let Some(unit) = unit
            && groups.get("POINT", &unit_name).and_then(|p| p.string()).as_deref() != Some(unit)
        {
            groups.set("POINT", Parameter::text(&unit_name, unit));
        }
    }
    Ok(())
}

/// TRIAL:ACTUAL_START_FIELD and ACTUAL_END_FIELD, if the header's words are too small or the file
/// contained them.
fn sync_trial(file: &C3dFile, groups: &mut Parameters) {
    let first = file.first_frame as usize;
    let last = (first + file.n_frames).saturating_sub(1);
    let needed = last > 65_535 || groups.get("TRIAL", "ACTUAL_START_FIELD").is_some();
    if needed && trial_range(groups) != Some((first, last)) {
        for (name, frame) in [("ACTUAL_START_FIELD", first), ("ACTUAL_END_FIELD", last)] {
            let words = [(frame & 0xffff) as u16 as i16, (frame >> 16) as u16 as i16];
            groups.set("TRIAL", Parameter::integers(name, words.to_vec()));
        }
    }
}

fn sync_analogs(file: &C3dFile, layout: &Layout, groups: &mut Parameters) -> Result<(), C3dError> {
    let n = layout.n_channels;
    if n == 0 && file.source.is_some() && groups.group("ANALOG").is_none() {
        return Ok(());
    }
    set_count(groups, "ANALOG", "USED", n);
    if n == 0 && file.source.is_some() {
        return Ok(());
    }
    let rate = file.point_rate_hz * layout.samples_per_frame.max(1) as f64;
    let read = decide_analog_rate(groups, layout, file.point_rate_hz, &mut Vec::new());
    let missing = file.source.is_none() && groups.get("ANALOG", "RATE").is_none();
    if missing || (read / rate - 1.0).abs() > 1e-3 {
        set_float(groups, "ANALOG", "RATE", rate as f32);
    }
    set_float(groups, "ANALOG", "GEN_SCALE", file.analog_general_scale as f32);
    let format = groups.get("ANALOG", "FORMAT").and_then(|p| p.string()).unwrap_or_default().to_ascii_uppercase();
    let by_format = format.starts_with("UNSIGNED");
    if file.analog_unsigned != by_format
        && (file.analog_unsigned || !format.is_empty())
        && !file.unsigned_by_inference()
    {
        groups.set("ANALOG", Parameter::text("FORMAT", if file.analog_unsigned { "UNSIGNED" } else { "SIGNED" }));
    }
    let now = describe_analogs(groups, layout, file.analog_unsigned, &mut Vec::new());
    let fresh = file.source.is_none();
    let missing = |groups: &Parameters, name: &str| groups.get("ANALOG", name).is_none();
    let differ =
        |f: &dyn Fn(&crate::Analog, &crate::Analog) -> bool| now.iter().zip(&file.analogs).any(|(a, b)| f(a, b));
    if (fresh && missing(groups, "LABELS")) || differ(&|a, b| a.label != b.label) {
        let labels: Vec<&str> = file.analogs.iter().map(|a| a.label.as_str()).collect();
        set_texts(groups, "ANALOG", "LABELS", &labels)?;
    }
    if differ(&|a, b| a.description != b.description) || (fresh && missing(groups, "DESCRIPTIONS")) {
        let descriptions: Vec<&str> = file.analogs.iter().map(|a| a.description.as_str()).collect();
        set_texts(groups, "ANALOG", "DESCRIPTIONS", &descriptions)?;
    }
    if differ(&|a, b| a.unit != b.unit) || (fresh && missing(groups, "UNITS")) {
        let units: Vec<&str> = file.analogs.iter().map(|a| a.unit.as_str()).collect();
        set_texts(groups, "ANALOG", "UNITS", &units)?;
    }
    if differ(&|a, b| (a.scale as f32).to_bits() != (b.scale as f32).to_bits()) || (fresh && missing(groups, "SCALE")) {
        let scales: Vec<f32> = file.analogs.iter().map(|a| a.scale as f32).collect();
        set_parts(groups, "ANALOG", "SCALE", &scales, |name, part| Parameter::floats(name, part.to_vec()))?;
    }
    if differ(&|a, b| a.offset != b.offset) || (fresh && missing(groups, "OFFSET")) {
        sync_offsets(file, groups)?;
    }
    Ok(())
}

/// Offsets as 16-bit words if they are integers that fit, otherwise as floats.
fn sync_offsets(file: &C3dFile, groups: &mut Parameters) -> Result<(), C3dError> {
    let offsets: Vec<f64> = file.analogs.iter().map(|a| a.offset).collect();
    let range = if file.analog_unsigned { 0.0..=65_535.0 } else { -32_768.0..=32_767.0 };
    if offsets.iter().all(|o| o.fract() == 0.0 && range.contains(o)) {
        let words: Vec<i16> = offsets.iter().map(|o| *o as i32 as u16 as i16).collect();
        set_parts(groups, "ANALOG", "OFFSET", &words, |name, part| Parameter::integers(name, part.to_vec()))
    } else {
        let floats: Vec<f32> = offsets.iter().map(|o| *o as f32).collect();
        set_parts(groups, "ANALOG", "OFFSET", &floats, |name, part| Parameter::floats(name, part.to_vec()))
    }
}

fn sync_events(file: &C3dFile, groups: &mut Parameters) -> Result<(), C3dError> {
    let mut now = events_of_group(groups, &mut Vec::new());
    if now.is_empty() {
        now = events_of_header(&file.header_events);
    }
    if now == file.events {
        return Ok(());
    }
    let events: Vec<&FileEvent> = file.events.iter().collect();
    set_count(groups, "EVENT", "USED", events.len());
    let texts = |f: fn(&FileEvent) -> &str| events.iter().map(|e| f(e)).collect::<Vec<_>>();
    set_texts(groups, "EVENT", "CONTEXTS", &texts(|e| &e.context))?;
    set_texts(groups, "EVENT", "LABELS", &texts(|e| &e.label))?;
    set_texts(groups, "EVENT", "DESCRIPTIONS", &texts(|e| &e.description))?;
    set_texts(groups, "EVENT", "SUBJECTS", &texts(|e| &e.subject))?;
    let times: Vec<[f32; 2]> = events.iter().map(|e| minutes_and_seconds(e.time_s)).collect();
    set_parts(groups, "EVENT", "TIMES", &times, |name, part| {
        Parameter::new(name, vec![2, part.len() as u8], Values::Floats(part.concat()))
    })?;
    let icons: Vec<i16> = events.iter().map(|e| icon(&e.label)).collect();
    set_parts(groups, "EVENT", "ICON_IDS", &icons, |name, part| Parameter::integers(name, part.to_vec()))?;
    let flags: Vec<u8> = events.iter().map(|e| u8::from(e.context.eq_ignore_ascii_case("General"))).collect();
    set_parts(groups, "EVENT", "GENERIC_FLAGS", &flags, |name, part| {
        Parameter::new(name, vec![part.len() as u8], Values::Bytes(part.to_vec()))
    })?;
    if groups.group("EVENT_CONTEXT").is_none() {
        groups.set("EVENT_CONTEXT", Parameter::integer("USED", 3));
        groups.set("EVENT_CONTEXT", Parameter::integers("ICON_IDS", vec![0; 3]));
        groups.set("EVENT_CONTEXT", Parameter::texts("LABELS", &["Left", "Right", "General"]));
        groups.set("EVENT_CONTEXT", Parameter::texts("DESCRIPTIONS", &["Left side", "Right side", "Both or neither"]));
        let colours = vec![255, 0, 0, 0, 255, 0, 0, 0, 255];
        groups.set("EVENT_CONTEXT", Parameter::new("COLOURS", vec![3, 3], Values::Integers(colours)));
    }
    Ok(())
}

/// Separates whole minutes, so that seconds keep their precision in single precision.
fn minutes_and_seconds(time_s: f64) -> [f32; 2] {
    let minutes = (time_s / 60.0).trunc();
    [minutes as f32, (time_s - 60.0 * minutes) as f32]
}

/// Icon codes used by programs: 1 foot strike, 2 foot off, 0 anything else.
fn icon(label: &str) -> i16 {
    match label {
        "Foot Strike" => 1,
        "Foot Off" => 2,
        _ => 0,
    }
}

fn sync_plates(file: &C3dFile, groups: &mut Parameters) -> Result<(), C3dError> {
    let now = read_plates(groups, file.analogs.len(), &mut Vec::new());
    // Compared as text, so that a corner of NaN equals itself.
    if format!("{now:?}") == format!("{:?}", file.plates) {
        return Ok(());
    }
    let plates = &file.plates;
    let n = u8::try_from(plates.len()).map_err(|_| C3dError::Write {
        item: "plates".into(),
        problem: format!("{} of them, the format holds 255", plates.len()),
    })?;
    let group = "FORCE_PLATFORM";
    set_count(groups, group, "USED", plates.len());
    groups.set(group, Parameter::integers("TYPE", plates.iter().map(|p| p.kind as i16).collect()));
    let zero = plates.first().map_or([0; 2], |p| p.zero_frames);
    groups.set(group, Parameter::integers("ZERO", zero.map(|z| z.clamp(0, 32_767) as i16).to_vec()));
    let corners = plates.iter().flat_map(|p| p.corners.as_flattened()).map(|x| *x as f32).collect();
    groups.set(group, Parameter::new("CORNERS", vec![3, 4, n], Values::Floats(corners)));
    let origins = plates.iter().flat_map(|p| p.origin).map(|x| x as f32).collect();
    groups.set(group, Parameter::new("ORIGIN", vec![3, n], Values::Floats(origins)));

    let rows = plates.iter().map(|p| p.channels.len().max(channels_of_kind(p.kind))).max().unwrap_or(6);
    let mut channels = Vec::with_capacity(rows * plates.len());
    for plate in plates {
        channels.extend(plate.channels.iter().map(|c| (c + 1) as u16 as i16));
        channels.resize(channels.len() + rows - plate.channels.len(), 0);
    }
    let rows = u8::try_from(rows).unwrap_or(u8::MAX);
    groups.set(group, Parameter::new("CHANNEL", vec![rows, n], Values::Integers(channels)));

    if plates.iter().any(|p| !p.calibration.is_empty()) {
        let (rows, columns) = plates
            .iter()
            .fold((0, 0), |(r, c), p| (r.max(p.calibration.len()), c.max(p.calibration.first().map_or(0, Vec::len))));
        let mut values = Vec::with_capacity(rows * columns * plates.len());
        for plate in plates {
            for column in 0..columns {
                for row in 0..rows {
                    let value = plate.calibration.get(row).and_then(|r| r.get(column));
                    values.push(value.map_or(0.0, |x| *x as f32));
                }
            }
        }
        let size = [rows, columns].map(|d| u8::try_from(d).unwrap_or(u8::MAX));
        groups.set(group, Parameter::new("CAL_MATRIX", vec![size[0], size[1], n], Values::Floats(values)));
    } else {
        groups.remove(group, "CAL_MATRIX");
    }
    Ok(())
}
