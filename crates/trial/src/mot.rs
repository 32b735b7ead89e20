//! MOT and STO tables, and ground reaction forces in them, to [`Plate`]s (still in source axes).
//!
//! Both header styles are read: `key=value` lines and the older `name …`, `datacolumns …`; the
//! table starts after `endheader` with a line of labels. Stated counts and times are checked
//! against the rows present (`crate::rows`): missing rows become missing samples, and a truncated
//! or unordered table is reported with its line. Forces act at a point p and come with a free
//! moment T: the moment about the world origin is p × F + T.

use crate::rows::{Clock, Ending, Source, Stamp, clock, decimals, ending};
use crate::trc::shorten;
use crate::{Plate, Trial, TrialError, Warning, WarningKind};
use nalgebra::Vector3;

/// A table of numbers over time.
#[derive(Debug, Clone, PartialEq)]
pub struct Table {
    /// Column labels, `time` first.
    pub labels: Vec<String>,
    /// `columns[label][row]`, one column per label.
    pub columns: Vec<Vec<f64>>,
    /// Header lines before `endheader`.
    pub header: Vec<String>,
    /// Line of each row in the text, counted from 1.
    pub lines: Vec<usize>,
    /// Irregularities: a truncated table, counts that contradict the rows present.
    pub warnings: Vec<Warning>,
    /// Number of rows stated in the header, and the line that states it.
    stated_rows: Option<(usize, usize)>,
    /// Decimals of the time in each row.
    decimals: Vec<i32>,
}

impl Table {
    /// Reads MOT or STO text. `trial` is used in messages.
    ///
    /// # Errors
    /// Malformed line: the error names it with the value found and the value expected.
    pub fn from_mot(trial: &str, text: &str) -> Result<Self, TrialError> {
        let broken = |line: usize, found: &str, expected: &str| TrialError::Text {
            trial: trial.to_owned(),
            format: "MOT",
            line: line + 1,
            found: shorten(found),
            expected: expected.to_owned(),
        };
        let lines: Vec<&str> = text.lines().collect();
        let end = lines
            .iter()
            .take(10_000)
            .position(|l| l.trim().eq_ignore_ascii_case("endheader"))
            .ok_or_else(|| broken(0, lines.first().unwrap_or(&""), "a header that ends with `endheader`"))?;
        let header: Vec<String> = lines[..end].iter().map(|l| l.trim().to_owned()).collect();
        let stated_rows = stated(&header, &["nrows", "datarows"], &broken)?;
        let stated_columns = stated(&header, &["ncolumns", "datacolumns"], &broken)?;
        let label_line = (end + 1..lines.len())
            .find(|&i| !lines[i].trim().is_empty())
            .ok_or_else(|| broken(end + 1, "", "a line of column labels"))?;
        let labels: Vec<String> = lines[label_line].split_whitespace().map(str::to_owned).collect();
        if !labels.first().is_some_and(|l| l.eq_ignore_ascii_case("time")) {
            return Err(broken(label_line, lines[label_line], "column labels that begin with `time`"));
        }
        let mut out = Self {
            columns: vec![Vec::new(); labels.len()],
            labels,
            header,
            lines: Vec::new(),
            warnings: Vec::new(),
            stated_rows,
            decimals: Vec::new(),
        };
        if let Some((stated, line)) = stated_columns.filter(|(n, _)| *n != out.labels.len()) {
            out.warnings.push(Warning::new(
                WarningKind::Contradiction,
                format!(
                    "MOT line {line} states {stated} columns but line {} names {}; the names are used",
                    label_line + 1,
                    out.labels.len()
                ),
            ));
        }
        let data: Vec<(usize, &str)> = lines
            .iter()
            .enumerate()
            .skip(label_line + 1)
            .filter(|(_, l)| !l.trim().is_empty())
            .map(|(i, l)| (i, *l))
            .collect();
        let open_end = !text.ends_with(['\n', '\r']);
        for (at, (index, line)) in data.iter().enumerate() {
            let cut_here = open_end && at + 1 == data.len() && index + 1 == lines.len();
            let mut row = match read_row(&broken, *index, line, out.labels.len()) {
                Ok(row) => row,
                // An incomplete last line indicates a truncated copy.
                Err(_) if cut_here => {
                    out.break_off(index + 1);
                    continue;
                }
                Err(e) => return Err(e),
            };
            if cut_here && !line.ends_with(char::is_whitespace) {
                let last = line.split_whitespace().next_back().unwrap_or("");
                match ending(last, data[..at].iter().filter_map(|(_, l)| l.split_whitespace().next_back())) {
                    Ending::Whole => {}
                    Ending::Cut => {
                        out.break_off(index + 1);
                        continue;
                    }
                    Ending::Doubtful => {
                        if let Some(value) = row.iter_mut().skip(1).next_back() {
                            *value = f64::NAN;
                        }
                        let message = format!(
                            "MOT line {}: the file ends without a line break, so its last number may be cut; \
                             it is left out",
                            index + 1
                        );
                        out.warnings.push(Warning::new(WarningKind::Rows, message));
                    }
                }
            }
            out.decimals.push(line.split_whitespace().next().map_or(0, decimals));
            out.lines.push(index + 1);
            for (column, value) in out.columns.iter_mut().zip(row) {
                column.push(value);
            }
        }
        Ok(out)
    }

    fn break_off(&mut self, line: usize) {
        self.warnings.push(Warning::new(
            WarningKind::Rows,
            format!("MOT line {line}: the file ends inside this line; its row is left out"),
        ));
    }

    /// Assigns the rows to samples and checks their number against the stated one.
    fn clock(&self, trial: &str, warnings: &mut Vec<Warning>) -> Result<Clock, TrialError> {
        let of = Source { trial, format: "MOT" };
        let mut stamps = Vec::with_capacity(self.lines.len());
        for ((line, time_s), decimals) in self.lines.iter().zip(&self.columns[0]).zip(&self.decimals) {
            if !time_s.is_finite() {
                return Err(of.wrong(*line, "a time that is no number", "a time in seconds"));
            }
            stamps.push(Stamp { line: *line, time_s: *time_s, decimals: *decimals, number: None });
        }
        let clock = clock(of, &stamps, None, warnings)?;
        if let Some((stated, line)) = self.stated_rows
            && stated != clock.n
            && stated != stamps.len()
        {
            let held = clock.n;
            warnings.push(if held < stated {
                let last = self.lines.last().copied().unwrap_or(line);
                let message = format!(
                    "forces truncated: {stated} rows stated (MOT line {line}), the file ends in row {held} (line {last})"
                );
                Warning::new(WarningKind::ForcesTruncated { held, stated }, message)
            } else {
                let message = format!("MOT line {line} states {stated} rows but {held} are in the file; all are used");
                Warning::new(WarningKind::Contradiction, message)
            });
        }
        Ok(clock)
    }
}

/// A count that the header states under one of these keys (`nRows=10`, `datarows 10`), and its
/// line.
fn stated(
    header: &[String],
    keys: &[&str],
    broken: &impl Fn(usize, &str, &str) -> TrialError,
) -> Result<Option<(usize, usize)>, TrialError> {
    for (index, line) in header.iter().enumerate() {
        let (key, value) = line.split_once('=').or_else(|| line.split_once(char::is_whitespace)).unwrap_or((line, ""));
        if keys.iter().any(|k| key.trim().eq_ignore_ascii_case(k)) {
            return match value.trim().parse::<usize>() {
                Ok(count) => Ok(Some((count, index + 1))),
                Err(_) => Err(broken(index, line, &format!("a whole number behind `{}`", key.trim()))),
            };
        }
    }
    Ok(None)
}

/// The numbers of a row; NaN for cells that are not numbers.
fn read_row(
    broken: &impl Fn(usize, &str, &str) -> TrialError,
    index: usize,
    line: &str,
    width: usize,
) -> Result<Vec<f64>, TrialError> {
    let mut row = Vec::with_capacity(width);
    for cell in line.split_whitespace() {
        if row.len() == width {
            return Err(broken(index, cell, &format!("{width} columns")));
        }
        match cell.parse::<f64>() {
            Ok(value) => row.push(if value.is_finite() { value } else { f64::NAN }),
            Err(_) => return Err(broken(index, cell, "a number")),
        }
    }
    if row.len() != width {
        return Err(broken(index, &format!("{} columns", row.len()), &format!("{width} columns")));
    }
    Ok(row)
}

/// Quantity of a ground reaction column.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Quantity {
    Force,
    Point,
    Moment,
}

/// Splits a label into the plate's key, the quantity and the axis: `1_ground_force_vx`,
/// `ground_force_r_px`, `ground_torque_2_x`, `ground_moment_1_mx`, `FP1_ground_force_vz` …
fn parse_column(label: &str) -> Option<(String, Quantity, usize)> {
    let lower = label.to_ascii_lowercase();
    if !(lower.contains("force") || lower.contains("torque") || lower.contains("moment") || lower.contains("grf")) {
        return None;
    }
    let axis = match lower.as_bytes().last()? {
        b'x' => 0,
        b'y' => 1,
        b'z' => 2,
        _ => return None,
    };
    let mut tokens: Vec<&str> = lower.split(['_', '.', ' ']).filter(|t| !t.is_empty()).collect();
    let tail = tokens.pop()?;
    let quantity = match &tail[..tail.len() - 1] {
        "v" | "f" => Quantity::Force,
        "p" | "cop" => Quantity::Point,
        "m" | "t" => Quantity::Moment,
        "" if tokens.iter().any(|t| *t == "torque" || *t == "moment" || *t == "m") => Quantity::Moment,
        "" if tokens.contains(&"v") => Quantity::Force,
        "" if tokens.iter().any(|t| *t == "p" || *t == "cop") => Quantity::Point,
        _ => return None,
    };
    tokens.retain(|t| {
        !matches!(*t, "ground" | "force" | "torque" | "moment" | "reaction" | "grf" | "v" | "p" | "m" | "cop")
    });
    Some((tokens.join("_"), quantity, axis))
}

/// Columns of one plate: `[force, point, moment][axis]`.
struct PlateColumns {
    key: String,
    at: [[Option<usize>; 3]; 3],
}

/// Time of the first row, s; 0 without rows.
pub(crate) fn first_time_s(trial: &str, text: &str) -> Result<f64, TrialError> {
    let table = Table::from_mot(trial, text)?;
    Ok(table.columns.first().and_then(|times| times.first()).copied().unwrap_or(0.0))
}

/// Adds the plates of a ground reaction table to the trial (metres, newtons, source axes).
/// `first_frame_time_s` is the time of the first marker frame: plate samples are cut, or filled
/// with missing ones, so that both start together.
pub(crate) fn read_ground_reactions(trial: &mut Trial, text: &str, first_frame_time_s: f64) -> Result<(), TrialError> {
    let table = Table::from_mot(&trial.name, text)?;
    let mut plates: Vec<PlateColumns> = Vec::new();
    for (column, label) in table.labels.iter().enumerate().skip(1) {
        let Some((key, quantity, axis)) = parse_column(label) else { continue };
        let slot = match plates.iter().position(|p| p.key == key) {
            Some(slot) => slot,
            None => {
                plates.push(PlateColumns { key, at: [[None; 3]; 3] });
                plates.len() - 1
            }
        };
        plates[slot].at[quantity as usize][axis] = Some(column);
    }
    trial.warnings.extend(table.warnings.iter().cloned());
    let times = &table.columns[0];
    if times.is_empty() {
        trial.warn(WarningKind::Plates, "MOT holds no rows: no plates");
        return Ok(());
    }
    let mut warnings = Vec::new();
    let clock = table.clock(&trial.name, &mut warnings)?;
    trial.warnings.append(&mut warnings);
    let rate_hz = clock.rate_hz;
    if !(rate_hz > 0.0 && rate_hz.is_finite()) {
        trial.warn(WarningKind::Plates, "MOT holds a single row, which has no rate: no plates");
        return Ok(());
    }
    // Row of each sample; `None` where it is missing.
    let mut rows: Vec<Option<usize>> = vec![None; clock.n];
    for (row, place) in clock.places.iter().enumerate() {
        rows[*place] = Some(row);
    }
    let markers_end_s = first_frame_time_s + trial.markers.n_frames.saturating_sub(1) as f64 / trial.markers.rate_hz;
    let early_s = markers_end_s - (times[0] + (clock.n - 1) as f64 / rate_hz);
    if table.stated_rows.is_none() && early_s > 1.5 / trial.markers.rate_hz.min(rate_hz) {
        trial.warn(
            WarningKind::Missing,
            format!("MOT states no number of rows and ends {early_s:.3} s before the markers"),
        );
    }
    let lead = (times[0] - first_frame_time_s) * rate_hz;
    let shift = lead.round();
    if (lead - shift).abs() > 0.25 {
        trial.warn(
            WarningKind::Rows,
            format!(
                "MOT starts {:.4} s after the markers, not a whole number of samples; forces are off by {:.4} s",
                lead / rate_hz,
                (shift - lead) / rate_hz
            ),
        );
    }
    let limit = 10.0 * (clock.n as f64 + trial.markers.n_frames as f64 * rate_hz / trial.markers.rate_hz);
    if shift.abs() > limit {
        trial.warn(WarningKind::Plates, format!("MOT starts {:.1} s away from the markers: no plates", lead / rate_hz));
        return Ok(());
    }

    let mut found_any = false;
    for columns in &plates {
        let [force, point, moment] = columns.at;
        let [Some(fx), Some(fy), Some(fz)] = force else {
            trial.warn(WarningKind::Plates, format!("MOT columns `{}` hold no complete force: left out", columns.key));
            continue;
        };
        found_any = true;
        let vector = |indices: [Option<usize>; 3], row: usize| {
            Vector3::from_fn(|axis, _| indices[axis].map_or(0.0, |column| table.columns[column][row]))
        };
        let mut scale = 1.0;
        if point.iter().all(Option::is_none) {
            trial.warn(
                WarningKind::Plates,
                format!(
                    "MOT plate `{}` has no point of application: its moments are taken about the origin",
                    columns.key
                ),
            );
        } else {
            let far =
                (0..times.len()).map(|row| vector(point, row).amax()).filter(|x| x.is_finite()).fold(0.0, f64::max);
            if far > 50.0 {
                scale = 1e-3;
                trial.warn(
                    WarningKind::Units,
                    format!(
                        "MOT plate `{}` has points {far:.0} m away: read as millimetres (moments too)",
                        columns.key
                    ),
                );
            }
        }
        let (skip, pad) = if shift < 0.0 { ((-shift) as usize, 0) } else { (0, shift as usize) };
        let mut plate = Plate {
            name: if columns.key.is_empty() { "FP".to_owned() } else { columns.key.clone() },
            rate_hz,
            corners_m: Vec::new(),
            force_n: vec![Vector3::repeat(f64::NAN); pad],
            moment_nm: vec![Vector3::repeat(f64::NAN); pad],
        };
        for row in rows.iter().skip(skip) {
            let Some(row) = *row else {
                plate.force_n.push(Vector3::repeat(f64::NAN));
                plate.moment_nm.push(Vector3::repeat(f64::NAN));
                continue;
            };
            let force_n = Vector3::new(table.columns[fx][row], table.columns[fy][row], table.columns[fz][row]);
            let point_m = vector(point, row) * scale;
            let free_nm = vector(moment, row) * scale;
            // Without contact, some programs write an undefined point: no force, no moment.
            let arm = if force_n == Vector3::zeros() { Vector3::zeros() } else { point_m.cross(&force_n) };
            plate.force_n.push(force_n);
            plate.moment_nm.push(arm + free_nm);
        }
        trial.plates.push(plate);
    }
    if !found_any {
        trial.warn(
            WarningKind::Plates,
            format!(
                "MOT holds no ground reaction columns (found `{}` …): no plates",
                table.labels.get(1).map_or("", String::as_str)
            ),
        );
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn regress_column_names_of_five_programs() {
        let case = |label: &str| parse_column(label).map(|(key, quantity, axis)| (key, quantity as usize, axis));
        for (label, key, quantity, axis) in [
            ("ground_force_vx", "", 0, 0),
            ("1_ground_force_vy", "1", 0, 1),
            ("l_ground_force_pz", "l", 1, 2),
            ("ground_torque_y", "", 2, 1),
            ("1_ground_torque_z", "1", 2, 2),
            ("ground_force_2_vx", "2", 0, 0),
            ("ground_force_2_px", "2", 1, 0),
            ("ground_force_2_mz", "2", 2, 2),
            ("ground_moment_3_mx", "3", 2, 0),
            ("ground_torque_3_x", "3", 2, 0),
            ("ground_force_calcn_r_vy", "calcn_r", 0, 1),
            ("R_ground_force_vx", "r", 0, 0),
        ] {
            assert_eq!(case(label), Some((key.to_owned(), quantity, axis)), "{label}");
        }
        assert_eq!(case("pelvis_tx"), None);
        assert_eq!(case("knee_angle_r"), None);
    }
}
