//! Reads BIDS-Motion, `_motion.tsv` (numbers without a header) with its `_channels.tsv`, into a
//! [`Trial`]. Position channels are markers; BIDS has no force plates.
//!
//! Format: Brain Imaging Data Structure 1.9, modality-specific files, *Motion*.

use crate::frozen::frozen_to_missing;
use crate::missing::{is_missing, number};
use crate::options::{disambiguate, require_content, to_world};
use crate::people;
use crate::rows::{Ending, ending};
use crate::trc::shorten;
use crate::{ImportOptions, Markers, Trial, TrialError, UpAxis, WarningKind};
use aloft_c3d::metres_per;
use nalgebra::Vector3;

/// The texts of one BIDS-Motion recording.
#[derive(Debug, Clone, Copy)]
pub struct BidsMotion<'a> {
    /// `_motion.tsv`.
    pub motion: &'a str,
    /// `_channels.tsv`.
    pub channels: &'a str,
    /// `SamplingFrequency` of `_motion.json`, Hz; if absent, the column `sampling_frequency` of the
    /// channels.
    pub rate_hz: Option<f64>,
    /// `RecordingDuration` of `_motion.json`, s: tells whether all rows are there.
    pub duration_s: Option<f64>,
    /// `SpatialAxes` of the reference frame (`_channels.json`), such as `ALS`: direction of each
    /// axis; if absent, Z is up.
    pub spatial_axes: Option<&'a str>,
}

/// One position channel: column, marker, axis, and metres per unit.
struct Channel {
    column: usize,
    marker: usize,
    axis: usize,
    metres: f64,
}

impl Trial {
    /// Reads a BIDS-Motion recording. `n/a` is missing, and so are the words of [`crate::missing`].
    /// An incomplete last line is left out, and a
    /// recording that is shorter than stated is reported as truncated.
    ///
    /// # Errors
    /// Malformed line (the error names it), or no frames, position channels or sampling rate.
    pub fn from_bids_motion(name: &str, source: &BidsMotion<'_>, options: &ImportOptions) -> Result<Self, TrialError> {
        if source.motion.trim().is_empty() {
            return Err(TrialError::EmptyFile { trial: name.to_owned() });
        }
        let mut trial = Self { name: name.to_owned(), ..Self::default() };
        let (labels, channels, stated_hz, n_columns) = read_channels(&mut trial, source.channels, options)?;
        let rate_hz = source.rate_hz.or(stated_hz).unwrap_or(f64::NAN);
        if !(rate_hz.is_finite() && rate_hz > 0.0) {
            return Err(TrialError::Rate { trial: name.to_owned(), place: "SamplingFrequency", found: rate_hz });
        }
        let mut trajectories = vec![Vec::new(); labels.len()];
        let rows: Vec<(usize, &str)> =
            source.motion.lines().enumerate().filter(|(_, l)| !l.trim().is_empty()).collect();
        let open_end = !source.motion.ends_with(['\n', '\r']);
        for (at, (index, line)) in rows.iter().copied().enumerate() {
            let cells: Vec<&str> = line.trim_end_matches('\r').split('\t').map(str::trim).collect();
            let last_number = if open_end && at + 1 == rows.len() {
                match cut(&rows, &cells, n_columns) {
                    Ending::Whole => None,
                    Ending::Cut => {
                        let message =
                            format!("_motion.tsv: the file ends inside line {}, which is left out", index + 1);
                        trial.warn(WarningKind::Rows, message);
                        break;
                    }
                    Ending::Doubtful => cells.len().checked_sub(1),
                }
            } else {
                None
            };
            if cells.len() != n_columns {
                return Err(TrialError::Text {
                    trial: name.to_owned(),
                    format: "_motion.tsv",
                    line: index + 1,
                    found: format!("{} columns", cells.len()),
                    expected: format!("{n_columns}, as _channels.tsv has rows"),
                });
            }
            let mut points = vec![Vector3::repeat(f64::NAN); labels.len()];
            for channel in &channels {
                let cell = cells[channel.column];
                let value = number(cell).ok_or_else(|| TrialError::Text {
                    trial: name.to_owned(),
                    format: "_motion.tsv",
                    line: index + 1,
                    found: shorten(cell),
                    expected: "a number or n/a".to_owned(),
                })?;
                if Some(channel.column) != last_number {
                    points[channel.marker][channel.axis] = value * channel.metres;
                }
            }
            if last_number.is_some() {
                let message = format!(
                    "_motion.tsv line {}: the file ends without a line break, so its last number may be cut; it is left out",
                    index + 1
                );
                trial.warn(WarningKind::Rows, message);
            }
            for (path, mut point) in trajectories.iter_mut().zip(points) {
                if point.iter().any(|x| x.is_nan()) {
                    point.fill(f64::NAN);
                }
                path.push(point);
            }
        }
        let chosen = people::choose(&labels, options.strip_prefix, &options.people, &[]);
        chosen.tell(&mut trial);
        let mut kept = chosen.labels.iter();
        trajectories.retain(|_| kept.next().is_some_and(Option::is_some));
        let mut labels: Vec<String> = chosen.labels.into_iter().flatten().collect();
        disambiguate(&mut labels, &mut trial.warnings);
        let n_frames = trajectories.first().map_or(0, Vec::len);
        warn_of_length(&mut trial, n_frames, source.duration_s.map(|s| s * rate_hz));
        trial.markers = Markers { rate_hz, first_frame: 1, n_frames, labels, trajectories };
        require_content(&trial, || "no channel of type POS".to_owned())?;
        people::require_one(&trial)?;
        frozen_to_missing(&mut trial);
        to_world(&mut trial, options, source.spatial_axes.and_then(up_of_axes), UpAxis::Z);
        Ok(trial)
    }
}

/// Whether the last row of an unterminated table is cut: by its number of columns, or by the length
/// of its last number against those above it.
fn cut(rows: &[(usize, &str)], cells: &[&str], n_columns: usize) -> Ending {
    let (Some(last), Some(column)) = (cells.last(), cells.len().checked_sub(1)) else { return Ending::Cut };
    if cells.len() < n_columns || last.is_empty() {
        return Ending::Cut;
    }
    if number(last).is_none() {
        return Ending::Cut;
    }
    let above = rows[..rows.len() - 1].iter().filter_map(|(_, l)| l.split('\t').nth(column).map(str::trim));
    ending(last, above)
}

/// Compares the rows with the stated duration.
fn warn_of_length(trial: &mut Trial, held: usize, stated: Option<f64>) {
    let Some(stated) = stated.filter(|n| n.is_finite() && *n >= 1.0).map(|n| n.round() as usize) else {
        let message = "_motion.json states no `RecordingDuration`: whether all frames are there is not known";
        trial.warn(WarningKind::Missing, message);
        return;
    };
    match stated.saturating_sub(held) {
        0 if held > stated + 1 => {
            let message =
                format!("_motion.json states a duration of {stated} frames, {held} are in the file; all are used");
            trial.warn(WarningKind::Contradiction, message);
        }
        0 => {}
        // a duration from the first to the last sample is one interval shorter, never longer
        _ => {
            let message = format!("truncated: _motion.json states {stated} frames, the file ends in frame {held}");
            trial.warn(WarningKind::Truncated { held, stated }, message);
        }
    }
}

/// The axis that points to Superior (or away from Inferior) in a word such as `ALS`.
fn up_of_axes(word: &str) -> Option<UpAxis> {
    let place = word.trim().to_ascii_uppercase().chars().position(|c| c == 'S' || c == 'I')?;
    let up = word.trim().to_ascii_uppercase().chars().nth(place) == Some('S');
    (place < 3).then(|| UpAxis::from_index(place, up))
}

/// True if the last row of an unterminated table of channels is cut: cells are missing, or the last
/// is the beginning of one above it.
fn is_cut(rows: &[(usize, &str)], cells: &[&str], n_columns: usize) -> bool {
    let Some(last) = cells.last() else { return true };
    let mut above =
        rows[..rows.len() - 1].iter().filter_map(|(_, l)| l.split('\t').nth(cells.len() - 1).map(str::trim));
    let begins = |whole: &str| whole.len() > last.len() && whole.starts_with(last);
    cells.len() < n_columns || last.is_empty() || above.any(begins)
}

type Channels = (Vec<String>, Vec<Channel>, Option<f64>, usize);

fn read_channels(trial: &mut Trial, text: &str, options: &ImportOptions) -> Result<Channels, TrialError> {
    let name = trial.name.clone();
    let broken = |line: usize, found: &str, expected: &str| TrialError::Text {
        trial: name.clone(),
        format: "_channels.tsv",
        line,
        found: shorten(found),
        expected: expected.to_owned(),
    };
    let mut lines = text.trim_start_matches('\u{feff}').lines().map(|l| l.trim_end_matches('\r'));
    let first = lines.next().unwrap_or("");
    let header: Vec<&str> = first.split('\t').map(str::trim).collect();
    let place = |key: &str| header.iter().position(|h| *h == key);
    let (Some(name_at), Some(component_at), Some(type_at), Some(units_at)) =
        (place("name"), place("component"), place("type"), place("units"))
    else {
        return Err(broken(1, first, "the columns name, component, type, tracked_point, units"));
    };
    let mut labels: Vec<String> = Vec::new();
    let mut channels: Vec<Channel> = Vec::new();
    let mut rate = None;
    let mut n_columns = 0;
    let mut without_axis = 0;
    let rows: Vec<(usize, &str)> = lines.enumerate().filter(|(_, l)| !l.trim().is_empty()).collect();
    let open_end = !text.ends_with(['\n', '\r']);
    for (at, (index, line)) in rows.iter().copied().enumerate() {
        let column = n_columns;
        n_columns += 1;
        let cells: Vec<&str> = line.split('\t').map(str::trim).collect();
        if open_end && at + 1 == rows.len() && is_cut(&rows, &cells, header.len()) {
            return Err(broken(index + 2, line, "a whole last line; the file ends inside it: copy it again"));
        }
        let cell = |at: usize| cells.get(at).copied().unwrap_or("");
        if !cell(type_at).eq_ignore_ascii_case("POS") {
            continue;
        }
        // a coordinate along a joint, not one of a point in space
        if matches!(cell(component_at), "" | "n/a" | "N/A") {
            without_axis += 1;
            continue;
        }
        let axis = match cell(component_at) {
            "x" | "X" => 0,
            "y" | "Y" => 1,
            "z" | "Z" => 2,
            other => return Err(broken(index + 2, other, "the component x, y or z of a position")),
        };
        let unit = options.point_unit.as_deref().unwrap_or(cell(units_at));
        let Some(metres) = metres_per(unit) else {
            return Err(TrialError::Unit { trial: name, place: "_channels.tsv, `units`", found: unit.to_owned() });
        };
        let own = cell(name_at);
        let point = place("tracked_point").map(cell).filter(|p| !is_missing(p));
        // Without a tracked point the channel name identifies the marker, with the axis at the end:
        // `LKNE_x`.
        let bare =
            own.strip_suffix(['x', 'y', 'z', 'X', 'Y', 'Z']).map_or(own, |n| n.trim_end_matches(['_', '-', '.']));
        let label = point.unwrap_or(bare);
        let label = label.to_owned();
        // The channels of a point are consecutive; a repeated point is another marker of the same
        // name.
        let known = labels.len().checked_sub(1).filter(|last| labels[*last] == label);
        let marker = match known {
            Some(last) if !channels.iter().any(|c| c.marker == last && c.axis == axis) => last,
            _ => {
                labels.push(label);
                labels.len() - 1
            }
        };
        if let (None, Some(stated)) = (rate, place("sampling_frequency").map(cell).filter(|c| !is_missing(c))) {
            rate = Some(stated.parse().map_err(|_| broken(index + 2, stated, "a number under `sampling_frequency`"))?);
        }
        channels.push(Channel { column, marker, axis, metres });
    }
    if without_axis > 0 {
        let channels = if without_axis == 1 { "channel" } else { "channels" };
        let message = format!(
            "_channels.tsv: {without_axis} {channels} of type POS with the component n/a: not points in space, not read"
        );
        trial.warn(WarningKind::Missing, message);
    }
    Ok((labels, channels, rate, n_columns))
}
