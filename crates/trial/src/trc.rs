//! TRC text (markers) to the marker part of a [`Trial`], still in source axes. Empty cells and `NaN` are missing.

use crate::options::{disambiguate, metres_per, split_prefix};
use crate::{ImportOptions, Markers, Trial, TrialError};
use nalgebra::Vector3;
use std::collections::BTreeMap;

/// Reads the markers into `trial` (metres, source axes) and returns the time of the first frame, s.
///
/// # Errors
/// Names the line, what stands there and what was expected.
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
    let keys: Vec<&str> = lines.get(1).map(|l| l.split('\t').map(str::trim).collect()).unwrap_or_default();
    let values: Vec<&str> = lines.get(2).map(|l| l.split('\t').map(str::trim).collect()).unwrap_or_default();
    let header: BTreeMap<&str, &str> = keys.iter().copied().zip(values).collect();
    let rate_hz = match header.get("DataRate").map(|v| v.parse::<f64>()) {
        Some(Ok(rate)) if rate > 0.0 && rate.is_finite() => rate,
        _ => return Err(broken(2, header.get("DataRate").unwrap_or(&"nothing"), "a rate above 0 under `DataRate`")),
    };
    let unit = options.point_unit.as_deref().or(header.get("Units").copied()).unwrap_or("");
    let metres = match metres_per(unit) {
        Some(metres) => metres,
        None => return Err(TrialError::Unit { trial: name, place: "TRC line 3, `Units`", found: unit.to_owned() }),
    };

    let label_line = lines.get(3).copied().unwrap_or("");
    let mut cells = label_line.split('\t').map(str::trim);
    if !cells.next().unwrap_or("").starts_with("Frame") {
        return Err(broken(3, label_line, "`Frame#`, `Time` and the labels"));
    }
    let mut labels: Vec<String> = cells.skip(1).filter(|c| !c.is_empty()).map(str::to_owned).collect();
    if labels.is_empty() {
        return Err(TrialError::NoMarkers { trial: name, found: "no label on TRC line 4".to_owned() });
    }
    if let Some(Ok(stated)) = header.get("NumMarkers").map(|v| v.parse::<usize>())
        && stated != labels.len()
    {
        trial.warnings.push(format!("TRC states {stated} markers but names {}; the names are used", labels.len()));
    }
    if options.strip_prefix {
        for label in &mut labels {
            *label = split_prefix(label).0.to_owned();
        }
    }
    disambiguate(&mut labels, &mut trial.warnings);

    let n_markers = labels.len();
    let mut tracks: Vec<Vec<Vector3<f64>>> = vec![Vec::new(); n_markers];
    let mut times: Vec<f64> = Vec::new();
    let mut first_frame = 1_u32;
    let mut last_number: Option<i64> = None;
    let mut lost = 0_usize;
    for (index, line) in lines.iter().enumerate().skip(5) {
        if line.trim().is_empty() {
            continue;
        }
        let mut cells = line.split('\t').map(str::trim);
        let number_cell = cells.next().unwrap_or("");
        let number = match number_cell.parse::<f64>() {
            Ok(number) if number.is_finite() && number.abs() < 1e12 => number as i64,
            _ => return Err(broken(index, number_cell, "a frame number")),
        };
        let time_cell = cells.next().unwrap_or("");
        let time = match time_cell.parse::<f64>() {
            Ok(time) if time.is_finite() => time,
            _ => return Err(broken(index, time_cell, "a time in seconds")),
        };
        match last_number {
            None => first_frame = u32::try_from(number).unwrap_or(1),
            // Lost rows are missing frames, so that the time base stays whole; beyond a bound the numbers mean something else.
            Some(last) if number > last + 1 => {
                let rows = (number - last - 1) as usize;
                if rows <= 10 + times.len() {
                    lost += rows;
                    for row in 0..rows {
                        times.push(time - (rows - row) as f64 / rate_hz);
                        for track in &mut tracks {
                            track.push(Vector3::repeat(f64::NAN));
                        }
                    }
                }
            }
            Some(_) => {}
        }
        last_number = Some(number);
        times.push(time);
        for track in &mut tracks {
            let mut point = Vector3::repeat(f64::NAN);
            for axis in 0..3 {
                let cell = cells.next().unwrap_or("");
                if cell.is_empty() {
                    continue;
                }
                match cell.parse::<f64>() {
                    Ok(value) if value.is_finite() => point[axis] = value * metres,
                    Ok(_) => {}
                    Err(_) => return Err(broken(index, cell, "a number or an empty cell")),
                }
            }
            if point.iter().any(|x| x.is_nan()) {
                point.fill(f64::NAN);
            }
            track.push(point);
        }
        if let Some(extra) = cells.find(|cell| !cell.is_empty()) {
            return Err(broken(index, extra, &format!("{} columns", 2 + 3 * n_markers)));
        }
    }
    if lost > 0 {
        trial.warnings.push(format!("{lost} frames are not in the file; they are kept as missing"));
    }
    if options.zero_is_missing {
        zeros_to_missing(&mut tracks);
    }
    let n_frames = times.len();
    let rate_hz = rate_from_times(&times, rate_hz, "TRC", &mut trial.warnings);
    trial.markers = Markers { rate_hz, first_frame, n_frames, labels, trajectories: tracks };
    Ok(times.first().copied().unwrap_or(0.0))
}

/// A marker at exactly (0, 0, 0) in some frames and elsewhere in others was not seen there.
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

/// The stated rate, unless the time column says otherwise by more than half a percent.
pub(crate) fn rate_from_times(times: &[f64], stated_hz: f64, place: &str, warnings: &mut Vec<String>) -> f64 {
    if let (Some(first), Some(last)) = (times.first(), times.last())
        && last > first
    {
        let measured_hz = (times.len() - 1) as f64 / (last - first);
        if stated_hz <= 0.0 || (measured_hz / stated_hz - 1.0).abs() > 0.005 {
            if stated_hz > 0.0 {
                warnings.push(format!(
                    "{place} states {stated_hz} Hz but its times run at {measured_hz:.3} Hz; the times are used"
                ));
            }
            // Times are printed with few digits: a rate within 0.05 % of a whole number is that number.
            let whole = measured_hz.round();
            return if whole > 0.0 && (measured_hz / whole - 1.0).abs() < 5e-4 { whole } else { measured_hz };
        }
    }
    stated_hz
}

/// Text for messages: one line, at most 40 characters, quoted.
pub(crate) fn shorten(text: &str) -> String {
    let clean: String = text.trim().chars().map(|c| if c.is_control() { ' ' } else { c }).take(40).collect();
    if clean.is_empty() { "nothing".to_owned() } else { format!("`{clean}`") }
}
