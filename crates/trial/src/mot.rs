//! MOT and STO tables, and ground reaction forces in them, to [`Plate`]s (still in source axes).
//!
//! Both header styles are read: `key=value` lines and the older `name …`, `datacolumns …`; the
//! table starts after `endheader` with a line of labels. Stated counts and times are checked
//! against the rows present (`crate::rows`): missing rows become missing samples, and a truncated
//! or unordered table is reported with its line. Forces act at a point p and come with a free
//! moment T: the moment about the world origin is p × F + T.
//!
//! Plates are read from the names of the columns: a quantity, an axis and a plate, as OpenSim,
//! MOtoNMS, OpenCap, AddBiomechanics and others write them (`ground_force_vx`, `1_ground_force_px`,
//! `ground_force1_vx`, `ground_torque1_x`, `R_ground_torque_y`, `ground_force_calcn_l_vx`,
//! `calcn_r_force_vx`, `FP1_vx`, `f1_x`, `Fx1`, `COPx1`). Columns that belong to no plate are
//! listed; `import: {forces: …}` assigns them. Empty cells do not exist here; `NaN`, `NULL`,
//! `None`, `N/A`, `-`, `1.#QNAN` and the like are missing samples.
//!
//! The times of the forces count by the clock of the markers. Times in milliseconds are told by
//! their length. Forces that have no time in common with the markers start with them if both last
//! equally long, and are refused otherwise; `import: {force_times: from_first_frame}` decides.
//! Every difference is a warning with its numbers.

use crate::force_columns::{Assigned, PlateColumns, as_stated, by_name};
use crate::missing::number;
use crate::rows::{Clock, Ending, Source, Stamp, TIME_UNITS_S, clock, decimals, ending};
use crate::trc::shorten;
use crate::{ForceTimes, ImportOptions, Plate, Trial, TrialError, Warning, WarningKind};
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
                // none: the last line of a truncated file, of which a remark tells
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

    /// The values of three columns in a row; zero for a component without a column.
    fn vector(&self, columns: [Option<usize>; 3], row: usize) -> Vector3<f64> {
        Vector3::from_fn(|axis, _| columns[axis].map_or(0.0, |column| self.columns[column][row]))
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
                // none: the error says what is expected
                Err(_) => Err(broken(index, line, &format!("a whole number behind `{}`", key.trim()))),
            };
        }
    }
    Ok(None)
}

/// The numbers of a row; NaN for missing values ([`crate::missing`]).
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
        match number(cell) {
            Some(value) => row.push(value),
            None => return Err(broken(index, cell, "a number")),
        }
    }
    if row.len() != width {
        return Err(broken(index, &format!("{} columns", row.len()), &format!("{width} columns")));
    }
    Ok(row)
}

/// Time of the first row, s; 0 without rows.
pub(crate) fn first_time_s(trial: &str, text: &str) -> Result<f64, TrialError> {
    let table = Table::from_mot(trial, text)?;
    Ok(table.columns.first().and_then(|times| times.first()).copied().unwrap_or(0.0))
}

/// Adds the plates of a ground reaction table to the trial (metres, newtons, source axes).
/// `first_frame_time_s` is the time of the first marker frame: plate samples are cut, or filled
/// with missing ones, so that both start together.
///
/// # Errors
/// Malformed line, a column that `options.forces` names and the table does not have, or times that
/// have none in common with those of the markers.
pub(crate) fn read_ground_reactions(
    trial: &mut Trial,
    text: &str,
    first_frame_time_s: f64,
    options: &ImportOptions,
) -> Result<(), TrialError> {
    let table = Table::from_mot(&trial.name, text)?;
    let Assigned { plates, unused } = match options.forces.is_empty() {
        true => by_name(&table.labels),
        false => as_stated(&trial.name, &table.labels, &options.forces)?,
    };
    trial.warnings.extend(table.warnings.iter().cloned());
    if table.columns[0].is_empty() {
        trial.warn(WarningKind::Plates, "MOT holds no rows: no plates");
        return Ok(());
    }
    let mut warnings = Vec::new();
    let clock = table.clock(&trial.name, &mut warnings)?;
    trial.warnings.append(&mut warnings);
    if !(clock.rate_hz > 0.0 && clock.rate_hz.is_finite()) {
        trial.warn(WarningKind::Plates, "MOT holds a single row, which has no rate: no plates");
        return Ok(());
    }
    trial.unused_columns = unused;
    if plates.is_empty() {
        trial.warn(WarningKind::Plates, "no column of the MOT file names a force on a plate: no plates");
        return Ok(());
    }
    let clock = in_seconds(trial, clock);
    let shift = shift_of(trial, &table, &clock, first_frame_time_s, options.force_times)?;
    for columns in &plates {
        let scale = scale_of(trial, &table, columns);
        trial.plates.push(plate_of(&table, &clock, columns, shift, scale));
    }
    Ok(())
}

/// The clock of the forces in seconds: times that fit the markers only in a smaller unit are in
/// that unit.
fn in_seconds(trial: &mut Trial, clock: Clock) -> Clock {
    let (rate_hz, frames) = (trial.markers.rate_hz, trial.markers.n_frames);
    let markers_s = frames.saturating_sub(1) as f64 / rate_hz;
    let forces_s = clock.end_s() - clock.start_s;
    // As seconds, there would be less than one sample a frame, over more than twice the time of the
    // markers; a plate is not slower than the cameras.
    let fits =
        |unit_s: f64| (0.5..=2.0).contains(&(forces_s * unit_s / markers_s)) && clock.rate_hz >= rate_hz * unit_s;
    let other = TIME_UNITS_S.into_iter().find(|(unit_s, _)| fits(*unit_s));
    let Some((unit_s, unit)) = other.filter(|_| markers_s > 0.0 && clock.rate_hz < rate_hz) else { return clock };
    trial.warn(
        WarningKind::Clock,
        format!(
            "MOT times from {} to {} are read as {unit}: as seconds they would last {:.0} times as long as the markers",
            clock.start_s,
            clock.end_s(),
            forces_s / markers_s
        ),
    );
    clock.in_unit(unit_s)
}

/// Samples by which the forces start after the first frame; negative if before it.
fn shift_of(
    trial: &mut Trial,
    table: &Table,
    clock: &Clock,
    first_frame_time_s: f64,
    times: ForceTimes,
) -> Result<f64, TrialError> {
    let (rate_hz, markers_hz) = (clock.rate_hz, trial.markers.rate_hz);
    if times == ForceTimes::FromFirstFrame || trial.markers.n_frames == 0 {
        return Ok(0.0);
    }
    let markers_s =
        [first_frame_time_s, first_frame_time_s + trial.markers.n_frames.saturating_sub(1) as f64 / markers_hz];
    let forces_s = [clock.start_s, clock.end_s()];
    let length = |span: [f64; 2]| span[1] - span[0];
    // one frame and one sample: files are cut at either
    let near_s = 1.0 / markers_hz + 1.0 / rate_hz;
    let spans = format!(
        "forces from {:.3} to {:.3} s, markers from {:.3} to {:.3} s",
        forces_s[0], forces_s[1], markers_s[0], markers_s[1]
    );
    if forces_s[0] > markers_s[1] + near_s || forces_s[1] < markers_s[0] - near_s {
        if (length(forces_s) - length(markers_s)).abs() > near_s {
            return Err(TrialError::NoCommonTime { trial: trial.name.clone(), forces_s, markers_s });
        }
        let message = format!("{spans}: no time in common, but the same length, so they are read as starting together");
        trial.warn(WarningKind::Clock, message);
        return Ok(0.0);
    }
    let (late_s, early_s) = (forces_s[0] - markers_s[0], markers_s[1] - forces_s[1]);
    let cut = trial.forces_truncated().is_some();
    if late_s > near_s || (early_s > near_s && !cut) {
        let without = (late_s.max(0.0) + early_s.max(0.0)).min(length(markers_s));
        let unknown = if table.stated_rows.is_none() { "; MOT states no number of rows" } else { "" };
        trial.warn(
            WarningKind::Clock,
            format!(
                "{spans}: {without:.3} s of the markers have no forces{unknown}; if both start together, set \
                 `import: {{force_times: from_first_frame}}`"
            ),
        );
    }
    let lead = late_s * rate_hz;
    let shift = lead.round();
    if (lead - shift).abs() > 0.25 {
        trial.warn(
            WarningKind::Rows,
            format!(
                "MOT starts {late_s:.4} s after the markers, not a whole number of samples; forces are off by {:.4} s",
                (shift - lead) / rate_hz
            ),
        );
    }
    Ok(shift)
}

/// The unit of a plate's points and moments, m; points far away are millimetres.
fn scale_of(trial: &mut Trial, table: &Table, columns: &PlateColumns) -> f64 {
    if columns.point.iter().all(Option::is_none) {
        let message =
            format!("MOT plate `{}` has no point of application: its moments are taken about the origin", columns.name);
        trial.warn(WarningKind::Plates, message);
        return 1.0;
    }
    let rows = 0..table.columns[0].len();
    let far = rows.map(|row| table.vector(columns.point, row).amax()).filter(|x| x.is_finite()).fold(0.0, f64::max);
    if far <= 50.0 {
        return 1.0;
    }
    let message = format!("MOT plate `{}` has points {far:.0} m away: read as millimetres (moments too)", columns.name);
    trial.warn(WarningKind::Units, message);
    1e-3
}

fn plate_of(table: &Table, clock: &Clock, columns: &PlateColumns, shift: f64, scale: f64) -> Plate {
    // Row of each sample; `None` where it is missing.
    let mut rows: Vec<Option<usize>> = vec![None; clock.n];
    for (row, place) in clock.places.iter().enumerate() {
        rows[*place] = Some(row);
    }
    let (skip, pad) = if shift < 0.0 { ((-shift) as usize, 0) } else { (0, shift as usize) };
    let mut plate = Plate {
        name: columns.name.clone(),
        rate_hz: clock.rate_hz,
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
        let force_n = table.vector(columns.force.map(Some), row);
        let point_m = table.vector(columns.point, row) * scale;
        let free_nm = table.vector(columns.moment, row) * scale;
        // Without contact, some programs write an undefined point: no force, no moment.
        let arm = if force_n == Vector3::zeros() { Vector3::zeros() } else { point_m.cross(&force_n) };
        plate.force_n.push(force_n);
        plate.moment_nm.push(arm + free_nm);
    }
    plate
}
