//! Reads TRC text (markers) into the marker part of a [`Trial`], still in source axes. Empty cells
//! and words for a missing value ([`crate::missing`]) are missing.
//!
//! The stated counts, the frame numbers and the times are checked against the rows present
//! ([`crate::rows`]): missing rows become missing frames, and a truncated, shifted or unordered
//! table is reported with its line. The times count: where the stated rate differs from theirs, or
//! is not stated, their rate is used, with a warning.

use crate::missing::{is_missing, number};
use crate::options::disambiguate;
use crate::people;
use crate::rows::{Ending, RATES_HZ, Source, Stamp, clock, decimals, ending};
use crate::{ImportOptions, Markers, Trial, TrialError, Warning, WarningKind};
use aloft_c3d::metres_per;
use nalgebra::Vector3;
use std::collections::BTreeMap;

/// Reads the markers into `trial` (metres, source axes) and returns the time of the first frame, s.
///
/// # Errors
/// Malformed line: the error names it with the value found and the value expected.
pub(crate) fn read_trc(trial: &mut Trial, text: &str, options: &ImportOptions) -> Result<f64, TrialError> {
    let name = trial.name.clone();
    let broken = |line: usize, found: &str, expected: &str| TrialError::Text {
        trial: name.clone(),
        format: "TRC",
        line: line + 1,
        found: shorten(found),
        expected: expected.to_owned(),
    };
    let lines: Vec<&str> = text.lines().map(|l| l.trim_end_matches('\r')).collect();
    let first = lines.first().copied().unwrap_or("");
    if !first.trim_start_matches('\u{feff}').trim_start().starts_with("PathFileType") {
        return Err(broken(0, first, "the word `PathFileType`"));
    }
    let header = header(&lines, &mut trial.warnings);
    // the times count: without a rate they alone tell it
    let rate = ["DataRate", "CameraRate", "OrigDataRate"].iter().find_map(|k| Some((k, *header.get(k)?)));
    let stated_hz = match rate.map(|(key, v)| (key, v, v.parse::<f64>())) {
        Some((_, _, Ok(rate))) if RATES_HZ.contains(&rate) => Some(rate),
        // none: the error names what stands there
        Some((key, found, Err(_))) if !is_missing(found) => {
            return Err(broken(2, found, &format!("a rate between 0.001 and 1000000 Hz under `{key}`")));
        }
        found => {
            let what = found.map_or("no `DataRate`".to_owned(), |(key, v, _)| format!("`{v}` under `{key}`"));
            trial.warn(WarningKind::Clock, format!("TRC line 3 states {what}: the rate is that of the times"));
            None
        }
    };
    let count = |key: &str| -> Result<Option<usize>, TrialError> {
        let Some(cell) = header.get(key) else { return Ok(None) };
        let expected = format!("a whole number under `{key}`");
        // none: what is no whole number is refused in the next line
        let number = cell.parse::<f64>().ok().filter(|n| n.fract() == 0.0 && (0.0..1e9).contains(n));
        number.map(|n| Some(n as usize)).ok_or_else(|| broken(2, cell, &expected))
    };
    let (stated_frames, stated_markers) = (count("NumFrames")?, count("NumMarkers")?);
    let unit = options.point_unit.as_deref().or(header.get("Units").copied()).unwrap_or("");
    let metres = match metres_per(unit) {
        Some(metres) => metres,
        None => return Err(TrialError::Unit { trial: name, place: "TRC line 3, `Units`", found: unit.to_owned() }),
    };

    let label_line = lines.get(3).copied().unwrap_or("");
    let mut cells = label_line.split('\t').map(bare);
    if !cells.next().unwrap_or("").starts_with("Frame") {
        return Err(broken(3, label_line, "`Frame#`, `Time` and the labels"));
    }
    let labels: Vec<String> = cells.skip(1).filter(|c| !c.is_empty()).map(str::to_owned).collect();
    if labels.is_empty() {
        return Err(TrialError::NoMarkers { trial: name, found: "no label on TRC line 4".to_owned() });
    }
    if let Some(stated) = stated_markers.filter(|s| *s != labels.len()) {
        trial.warn(
            WarningKind::Contradiction,
            format!(
                "TRC line 3 states {stated} markers (`NumMarkers`) but line 4 names {}; the names are used",
                labels.len()
            ),
        );
    }
    let axes = lines.get(4).copied().unwrap_or("");
    if axes.split('\t').next().is_some_and(|c| c.trim().parse::<f64>().is_ok()) {
        return Err(broken(4, axes, "the line `X1 Y1 Z1 …` before the first frame"));
    }
    let chosen = people::choose(&labels, options.strip_prefix, &options.people, &[]);
    chosen.tell(trial);

    let mut warnings: Vec<Warning> = Vec::new();
    let n_markers = labels.len();
    let of = Source { trial: &trial.name, format: "TRC" };
    let data: Vec<(usize, &str)> =
        lines.iter().enumerate().skip(5).filter(|(_, l)| !l.trim().is_empty()).map(|(i, l)| (i, *l)).collect();
    let open_end = !text.ends_with(['\n', '\r']);
    let mut stamps: Vec<Stamp> = Vec::with_capacity(data.len());
    let mut rows: Vec<Vec<Vector3<f64>>> = Vec::with_capacity(data.len());
    let mut short: Option<(usize, usize, usize)> = None;
    for (at, (index, line)) in data.iter().enumerate() {
        let cut_here = open_end && at + 1 == data.len() && index + 1 == lines.len();
        match read_row(&broken, *index, line, &labels, metres) {
            // An incomplete last line indicates a truncated copy.
            Ok(row) if cut_here && row.cells < 2 + 3 * n_markers => break_off(&mut warnings, index + 1),
            // none: the last line of a truncated file, of which a remark tells
            Err(_) if cut_here => break_off(&mut warnings, index + 1),
            Err(e) => return Err(e),
            Ok(mut row) => {
                if cut_here {
                    let cells: Vec<&str> = line.split('\t').map(str::trim).collect();
                    let last = (2..cells.len()).rev().find(|&c| !cells[c].is_empty());
                    let above =
                        |c: usize| data[..at].iter().filter_map(move |(_, l)| l.split('\t').nth(c).map(str::trim));
                    match last.map(|c| (c, ending(cells[c], above(c)))) {
                        // A tab after the number terminates it.
                        _ if line.ends_with('\t') => {}
                        Some((_, Ending::Whole)) => {}
                        Some((_, Ending::Cut)) => {
                            break_off(&mut warnings, index + 1);
                            continue;
                        }
                        Some((c, Ending::Doubtful)) => {
                            row.points[(c - 2) / 3].fill(f64::NAN);
                            let message = format!(
                                "TRC line {}: the file ends without a line break, so its last number may be cut; \
                                 that point is left out",
                                index + 1
                            );
                            warnings.push(Warning::new(WarningKind::Rows, message));
                        }
                        None => {}
                    }
                }
                if row.cells < 2 + 3 * n_markers {
                    let (n, ..) = short.get_or_insert((0, index + 1, row.cells));
                    *n += 1;
                }
                stamps.push(row.stamp);
                rows.push(row.points);
            }
        }
    }
    if let Some((n, line, cells)) = short {
        let message = format!(
            "{n} TRC rows end early (the first is line {line}: {cells} of {} columns); \
             the markers behind are missing there",
            2 + 3 * n_markers
        );
        warnings.push(Warning::new(WarningKind::Rows, message));
    }
    let clock = clock(of, &stamps, stated_hz, &mut warnings)?;
    let last_line = stamps.last().map_or(5, |s| s.line);
    match stated_frames {
        None => {
            let message = "TRC line 2 has no `NumFrames`: whether all frames are there is not known";
            warnings.push(Warning::new(WarningKind::Missing, message));
        }
        Some(stated) if clock.n < stated => {
            let held = clock.n;
            let message = format!(
                "truncated: {stated} frames stated (TRC line 3), the file ends in frame {held} (line {last_line})"
            );
            warnings.push(Warning::new(WarningKind::Truncated { held, stated }, message));
        }
        Some(stated) if stated != clock.n && stated != stamps.len() => {
            let message = format!(
                "TRC line 3 states {stated} frames (`NumFrames`) but {} are in the file; all are used",
                clock.n
            );
            warnings.push(Warning::new(WarningKind::Contradiction, message));
        }
        Some(_) => {}
    }
    let mut tracks: Vec<Vec<Vector3<f64>>> = vec![vec![Vector3::repeat(f64::NAN); clock.n]; n_markers];
    for (place, points) in clock.places.iter().zip(&rows) {
        for (track, point) in tracks.iter_mut().zip(points) {
            track[*place] = *point;
        }
    }
    let mut kept = chosen.labels.iter();
    tracks.retain(|_| kept.next().is_some_and(Option::is_some));
    let mut labels: Vec<String> = chosen.labels.into_iter().flatten().collect();
    disambiguate(&mut labels, &mut warnings);
    if options.zero_is_missing {
        zeros_to_missing(&mut tracks);
    }
    // none: numbering that does not begin with a whole number begins with 1
    let first_frame = stamps.first().and_then(|s| u32::try_from(s.number?).ok()).unwrap_or(1);
    trial.warnings.append(&mut warnings);
    trial.markers = Markers { rate_hz: clock.rate_hz, first_frame, n_frames: clock.n, labels, trajectories: tracks };
    Ok(clock.start_s)
}

/// The words of line 2 with the values of line 3. Some files separate the values by several tabs:
/// where a key would have none, they are taken in their order.
fn header<'t>(lines: &[&'t str], warnings: &mut Vec<Warning>) -> BTreeMap<&'t str, &'t str> {
    let cells = |i: usize| lines.get(i).map(|l| l.split('\t').map(bare).collect::<Vec<_>>()).unwrap_or_default();
    let (keys, mut values) = (cells(1), cells(2));
    let named = keys.iter().filter(|k| !k.is_empty()).count();
    let filled = values.iter().filter(|v| !v.is_empty()).count();
    let apart = keys.iter().enumerate().any(|(i, k)| k.is_empty() != values.get(i).is_none_or(|v| v.is_empty()));
    if apart && named == filled && keys[..named].iter().all(|k| !k.is_empty()) {
        values.retain(|v| !v.is_empty());
        let message = "TRC line 3: values are not below their names in line 2; they are taken in their order";
        warnings.push(Warning::new(WarningKind::Contradiction, message));
    }
    keys.into_iter().zip(values).collect()
}

/// A word of the header without blanks and quotation marks around it.
fn bare(cell: &str) -> &str {
    cell.trim().trim_matches('"').trim()
}

fn break_off(warnings: &mut Vec<Warning>, line: usize) {
    warnings.push(Warning::new(
        WarningKind::Rows,
        format!("TRC line {line}: the file ends inside this line; its row is left out"),
    ));
}

/// One row of the table.
struct Row {
    stamp: Stamp,
    points: Vec<Vector3<f64>>,
    /// Cells that belong to the table.
    cells: usize,
}

fn read_row(
    broken: &impl Fn(usize, &str, &str) -> TrialError,
    index: usize,
    line: &str,
    labels: &[String],
    metres: f64,
) -> Result<Row, TrialError> {
    let cells: Vec<&str> = line.split('\t').map(str::trim).collect();
    let width = 2 + 3 * labels.len();
    let cell = |i: usize| cells.get(i).copied().unwrap_or("");
    let frame = match cell(0).parse::<f64>() {
        Ok(number) if number.fract() == 0.0 && number.abs() < 1e12 => number as i64,
        _ => return Err(broken(index, cell(0), "a frame number")),
    };
    let time_s = match cell(1).parse::<f64>() {
        Ok(time) if time.is_finite() => time,
        _ => return Err(broken(index, cell(1), "a time in seconds")),
    };
    if let Some(extra) = cells.iter().skip(width).find(|c| !c.is_empty()) {
        return Err(broken(index, extra, &format!("{width} columns")));
    }
    let held = cells.len().min(width);
    if held < width && !(held - 2).is_multiple_of(3) {
        return Err(broken(index, &format!("{held} columns"), &format!("{width} columns")));
    }
    let mut points = Vec::with_capacity(labels.len());
    for (m, label) in labels.iter().enumerate() {
        let mut point = Vector3::repeat(f64::NAN);
        let own = [cell(2 + 3 * m), cell(3 + 3 * m), cell(4 + 3 * m)];
        let empty = own.iter().filter(|c| c.is_empty()).count();
        if empty == 1 || empty == 2 {
            // A missing cell shifts all that follow.
            let found = format!("{} of 3 coordinates of {label}", 3 - empty);
            return Err(broken(index, &found, "all three, or empty cells for a marker that was not seen"));
        }
        for (axis, text) in own.iter().enumerate().filter(|(_, c)| !c.is_empty()) {
            match number(text) {
                Some(value) => point[axis] = value * metres,
                None => return Err(broken(index, text, "a number or an empty cell")),
            }
        }
        if point.iter().any(|x| x.is_nan()) {
            point.fill(f64::NAN);
        }
        points.push(point);
    }
    let stamp = Stamp { line: index + 1, time_s, decimals: decimals(cell(1)), number: Some(frame) };
    Ok(Row { stamp, points, cells: held })
}

/// A marker at exactly (0, 0, 0) in some frames but not in all was missing in those frames.
fn zeros_to_missing(tracks: &mut [Vec<Vector3<f64>>]) {
    for track in tracks {
        let seen_elsewhere = track.iter().any(|p| p.iter().any(|&x| x.is_finite() && x != 0.0));
        if seen_elsewhere {
            for point in track.iter_mut().filter(|p| p.iter().all(|&x| x == 0.0)) {
                point.fill(f64::NAN);
            }
        }
    }
}

/// Text for messages: one line, at most 40 characters, quoted.
pub(crate) fn shorten(text: &str) -> String {
    let clean: String = text.trim().chars().map(|c| if c.is_control() { ' ' } else { c }).take(40).collect();
    if clean.is_empty() { "nothing".to_owned() } else { format!("`{clean}`") }
}
