//! MOT and STO tables, and ground reaction forces in them, to [`Plate`]s (still in source axes).
//!
//! Both header styles are read: `key=value` lines and the older `name …`, `datacolumns …`; the table starts after `endheader`
//! with a line of labels. Forces act at a point p and come with a free moment T: the moment about the world origin is p × F + T.

use crate::trc::{rate_from_times, shorten};
use crate::{Plate, Trial, TrialError};
use nalgebra::Vector3;

/// A table of numbers over time.
#[derive(Debug, Clone, PartialEq)]
pub struct Table {
    /// Column labels, `time` first.
    pub labels: Vec<String>,
    /// `columns[label][row]`, as many as labels.
    pub columns: Vec<Vec<f64>>,
    /// Header lines before `endheader`.
    pub header: Vec<String>,
}

impl Table {
    /// Reads MOT or STO text. `trial` is for messages.
    ///
    /// # Errors
    /// Names the line, what stands there and what was expected.
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
        let header = lines[..end].iter().map(|l| l.trim().to_owned()).collect();
        let label_line = (end + 1..lines.len())
            .find(|&i| !lines[i].trim().is_empty())
            .ok_or_else(|| broken(end + 1, "", "a line of column labels"))?;
        let labels: Vec<String> = lines[label_line].split_whitespace().map(str::to_owned).collect();
        if !labels.first().is_some_and(|l| l.eq_ignore_ascii_case("time")) {
            return Err(broken(label_line, lines[label_line], "column labels that begin with `time`"));
        }
        let mut columns: Vec<Vec<f64>> = vec![Vec::new(); labels.len()];
        for (index, line) in lines.iter().enumerate().skip(label_line + 1) {
            if line.trim().is_empty() {
                continue;
            }
            let mut cells = 0;
            for cell in line.split_whitespace() {
                let Some(column) = columns.get_mut(cells) else {
                    return Err(broken(index, cell, &format!("{} columns", labels.len())));
                };
                match cell.parse::<f64>() {
                    Ok(value) => column.push(if value.is_finite() { value } else { f64::NAN }),
                    Err(_) => return Err(broken(index, cell, "a number")),
                }
                cells += 1;
            }
            if cells != labels.len() {
                return Err(broken(index, &format!("{cells} columns"), &format!("{} columns", labels.len())));
            }
        }
        Ok(Self { labels, columns, header })
    }
}

/// What a ground reaction column holds.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Quantity {
    Force,
    Point,
    Moment,
}

/// Splits a label into the plate's key, the quantity and the axis: `1_ground_force_vx`, `ground_force_r_px`, `ground_torque_2_x`,
/// `ground_moment_1_mx`, `FP1_ground_force_vz` …
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

/// Adds the plates of a ground reaction table to the trial (metres, newtons, source axes). `first_frame_time_s` is the time of
/// the first marker frame: plate samples are cut, or filled with missing ones, so that both start together.
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
    let times = &table.columns[0];
    if times.is_empty() {
        trial.warnings.push("MOT holds no rows: no plates".to_owned());
        return Ok(());
    }
    let rate_hz = rate_from_times(times, 0.0, "MOT", &mut trial.warnings);
    if !(rate_hz > 0.0 && rate_hz.is_finite()) {
        trial.warnings.push("MOT times do not increase: no plates".to_owned());
        return Ok(());
    }
    let lead = (times[0] - first_frame_time_s) * rate_hz;
    let shift = lead.round();
    if (lead - shift).abs() > 0.25 {
        trial.warnings.push(format!(
            "MOT starts {:.4} s after the markers, not a whole number of samples; forces are off by {:.4} s",
            lead / rate_hz,
            (shift - lead) / rate_hz
        ));
    }
    let limit =
        10.0 * (table.columns[0].len() as f64 + trial.markers.n_frames as f64 * rate_hz / trial.markers.rate_hz);
    if shift.abs() > limit {
        trial.warnings.push(format!("MOT starts {:.1} s away from the markers: no plates", lead / rate_hz));
        return Ok(());
    }

    let mut found_any = false;
    for columns in &plates {
        let [force, point, moment] = columns.at;
        let [Some(fx), Some(fy), Some(fz)] = force else {
            trial.warnings.push(format!("MOT columns `{}` hold no complete force: left out", columns.key));
            continue;
        };
        found_any = true;
        let vector = |indices: [Option<usize>; 3], row: usize| {
            Vector3::from_fn(|axis, _| indices[axis].map_or(0.0, |column| table.columns[column][row]))
        };
        let mut scale = 1.0;
        if point.iter().all(Option::is_none) {
            trial.warnings.push(format!(
                "MOT plate `{}` has no point of application: its moments are taken about the origin",
                columns.key
            ));
        } else {
            let far =
                (0..times.len()).map(|row| vector(point, row).amax()).filter(|x| x.is_finite()).fold(0.0, f64::max);
            if far > 50.0 {
                scale = 1e-3;
                trial.warnings.push(format!(
                    "MOT plate `{}` has points {far:.0} m away: read as millimetres (moments too)",
                    columns.key
                ));
            }
        }
        let rows = times.len();
        let (skip, pad) = if shift < 0.0 { ((-shift) as usize, 0) } else { (0, shift as usize) };
        let mut plate = Plate {
            name: if columns.key.is_empty() { "FP".to_owned() } else { columns.key.clone() },
            rate_hz,
            corners_m: Vec::new(),
            force_n: vec![Vector3::repeat(f64::NAN); pad],
            moment_nm: vec![Vector3::repeat(f64::NAN); pad],
        };
        for row in skip..rows {
            let force_n = Vector3::new(table.columns[fx][row], table.columns[fy][row], table.columns[fz][row]);
            let point_m = vector(point, row) * scale;
            let free_nm = vector(moment, row) * scale;
            // Off contact some programs write an undefined point: no force, no moment.
            let arm = if force_n == Vector3::zeros() { Vector3::zeros() } else { point_m.cross(&force_n) };
            plate.force_n.push(force_n);
            plate.moment_nm.push(arm + free_nm);
        }
        trial.plates.push(plate);
    }
    if !found_any {
        trial.warnings.push(format!(
            "MOT holds no ground reaction columns (found `{}` …): no plates",
            table.labels.get(1).map_or("", String::as_str)
        ));
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
