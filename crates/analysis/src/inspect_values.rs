//! `inspect --values`: the values of markers, plates, computed points and analog channels of a
//! file.

use crate::inspect::read_contents;
use aloft_c3d::C3dFile;
use aloft_export::csv_cell;
use aloft_study::nearest::hint;
use aloft_study::quote;
use aloft_trial::Trial;
use aloft_workspace::error::PipelineError;
use nalgebra::Vector3;
use serde::Serialize;
use std::fmt::Write;
use std::path::Path;

/// Values of a file over time.
#[derive(Debug, Clone, Serialize)]
pub struct Values {
    /// Version of this structure.
    pub version: u32,
    /// File.
    pub file: String,
    /// Rate of the rows, Hz.
    pub rate_hz: f64,
    /// Number of the first row as the file counts frames; samples of plates and channels count from
    /// 1.
    pub first: u32,
    /// Columns after frame and time.
    pub columns: Vec<Column>,
}

/// One column.
#[derive(Debug, Clone, Serialize)]
pub struct Column {
    /// Name with component and unit: `LASI.x_m`, `FP1.force_z_n`.
    pub name: String,
    /// Values; null where missing.
    pub values: Vec<f64>,
}

/// What can be shown: a label with its columns, at one rate.
struct Item {
    label: String,
    rate_hz: f64,
    first: u32,
    columns: Vec<Column>,
}

fn three(label: &str, what: &str, unit: &str, values: &[Vector3<f64>]) -> Vec<Column> {
    ["x", "y", "z"]
        .iter()
        .enumerate()
        .map(|(i, axis)| Column {
            name: format!("{label}.{what}{axis}{unit}"),
            values: values.iter().map(|v| v[i]).collect(),
        })
        .collect()
}

fn items(trial: &Trial, c3d: Option<&C3dFile>) -> Vec<Item> {
    let markers = &trial.markers;
    let at_frames = |label: &str, columns| Item {
        label: label.to_owned(),
        rate_hz: markers.rate_hz,
        first: markers.first_frame.max(1),
        columns,
    };
    let mut out: Vec<Item> = markers
        .labels
        .iter()
        .zip(&markers.trajectories)
        .map(|(label, track)| at_frames(label, three(label, "", "_m", track)))
        .collect();
    for c in &trial.computed {
        let unit = if c.unit.is_empty() { String::new() } else { format!("_{}", c.unit) };
        out.push(at_frames(&c.label, three(&c.label, "", &unit, &c.values)));
    }
    for plate in &trial.plates {
        let mut columns = three(&plate.name, "force_", "_n", &plate.force_n);
        columns.extend(three(&plate.name, "moment_", "_nm", &plate.moment_nm));
        out.push(Item { label: plate.name.clone(), rate_hz: plate.rate_hz, first: 1, columns });
    }
    if let Some(file) = c3d {
        for a in &file.analogs {
            let unit = if a.unit.is_empty() { String::new() } else { format!("_{}", a.unit) };
            let column = Column { name: format!("{}{unit}", a.label), values: a.values.clone() };
            out.push(Item { label: a.label.clone(), rate_hz: file.analog_rate_hz, first: 1, columns: vec![column] });
        }
    }
    out
}

/// Reads the values of the named markers, plates, computed points or analog channels; of all
/// markers without names. Positions are metres and forces newtons in the world of the recording (Z
/// up); computed points and channels have the file's own units.
///
/// # Errors
/// The file cannot be read; a name that it does not have; names with different rates.
pub fn values(file: &Path, names: &[String]) -> Result<Values, PipelineError> {
    let name = aloft_study::recordings::stem_of(file);
    let (trial, c3d) = read_contents(&name, file)?;
    let shown = file.display().to_string();
    let all = items(&trial, c3d.as_ref());
    let mut chosen: Vec<&Item> = Vec::new();
    if names.is_empty() {
        chosen.extend(all.iter().take(trial.markers.labels.len()));
    }
    for name in names {
        let found = all
            .iter()
            .find(|i| i.label == *name)
            .or_else(|| all.iter().find(|i| i.label.eq_ignore_ascii_case(name)))
            .ok_or_else(|| {
                let known: Vec<&str> = all.iter().map(|i| i.label.as_str()).collect();
                PipelineError::request_hint(format!("{shown} has no `{name}`"), hint(name, &known, "it has"))
            })?;
        chosen.push(found);
    }
    let Some(first) = chosen.first() else {
        let example = all.first().map_or("FP1", |i| i.label.as_str());
        return Err(PipelineError::request_hint(
            format!("{shown} has no markers"),
            format!(
                "name a plate or a channel: `{}`; `aloft inspect` lists them",
                quote::line(quote::option("values", example))
            ),
        ));
    };
    if let Some(other) = chosen.iter().find(|i| (i.rate_hz - first.rate_hz).abs() > 1e-6) {
        return Err(PipelineError::request_hint(
            format!(
                "`{}` has {} Hz and `{}` {} Hz: they do not fit into one table",
                first.label, first.rate_hz, other.label, other.rate_hz
            ),
            "ask for them one after the other",
        ));
    }
    Ok(Values {
        version: 1,
        file: shown,
        rate_hz: first.rate_hz,
        first: first.first,
        columns: chosen.iter().flat_map(|i| i.columns.clone()).collect(),
    })
}

/// A comma and the shortest number with this value; in exponents where zeros would hide it.
fn cell(v: f64) -> String {
    if v == 0.0 || (1e-4..1e15).contains(&v.abs()) { format!(",{v}") } else { format!(",{v:e}") }
}

impl Values {
    fn rows(&self) -> usize {
        self.columns.iter().map(|c| c.values.len()).max().unwrap_or(0)
    }

    /// The values as CSV: frame, time from the first row, columns; empty cells where missing.
    pub fn to_csv(&self) -> String {
        let mut out = String::from("frame,time_s");
        for c in &self.columns {
            let _ = write!(out, ",{}", csv_cell(&c.name));
        }
        for row in 0..self.rows() {
            let _ = write!(out, "\n{},{}", self.first as usize + row, row as f64 / self.rate_hz);
            for c in &self.columns {
                match c.values.get(row).filter(|v| v.is_finite()) {
                    Some(v) => out.push_str(&cell(*v)),
                    None => out.push(','),
                }
            }
        }
        out
    }

    /// The values as a table for people: metres to 0.1 mm, other units to four digits.
    pub fn to_text(&self) -> String {
        let digits = |name: &str| if name.ends_with("_m") { 4 } else { 3 };
        let mut rows: Vec<Vec<String>> = vec![
            ["frame", "time s"]
                .into_iter()
                .map(str::to_owned)
                .chain(self.columns.iter().map(|c| c.name.clone()))
                .collect(),
        ];
        for row in 0..self.rows() {
            let mut cells = vec![(self.first as usize + row).to_string(), format!("{:.4}", row as f64 / self.rate_hz)];
            cells.extend(self.columns.iter().map(|c| match c.values.get(row).filter(|v| v.is_finite()) {
                Some(v) => format!("{v:.*}", digits(&c.name)),
                None => "–".to_owned(),
            }));
            rows.push(cells);
        }
        let width = |i: usize| rows.iter().map(|r| r[i].chars().count()).max().unwrap_or(0);
        let widths: Vec<usize> = (0..rows[0].len()).map(width).collect();
        let line =
            |r: &Vec<String>| r.iter().zip(&widths).map(|(c, w)| format!("{c:>w$}")).collect::<Vec<_>>().join("  ");
        rows.iter().map(line).collect::<Vec<_>>().join("\n")
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "tests fail by panicking")]
mod tests {
    use super::*;
    use aloft_c3d::C3dBuilder;

    #[test]
    fn values_are_those_of_the_file_and_unknown_names_get_a_suggestion() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("a.c3d");
        let points: Vec<[f32; 3]> = (0..5u8).map(|i| [f32::from(i), 20.0, 1000.0]).collect();
        let file = C3dBuilder::new(100.0).marker("LASI", points).build().unwrap();
        std::fs::write(&path, file.to_bytes().unwrap()).unwrap();
        let found = values(&path, &["lasi".to_owned()]).unwrap();
        let csv = found.to_csv();
        let lines: Vec<&str> = csv.lines().collect();
        assert_eq!(lines[0], "frame,time_s,LASI.x_m,LASI.y_m,LASI.z_m");
        assert_eq!(lines.len(), 6);
        let third: Vec<f64> = lines[3].split(',').map(|c| c.parse().unwrap()).collect();
        assert!(third.iter().zip([3.0, 0.02, 0.002, 0.02, 1.0]).all(|(a, b)| (a - b).abs() < 1e-6), "{third:?}");
        assert!(found.to_text().lines().nth(1).unwrap().contains("0.0200"));
        let wrong = values(&path, &["LASY".to_owned()]).unwrap_err();
        let PipelineError::Request { hint: Some(hint), .. } = wrong else { unreachable!("{wrong}") };
        assert!(hint.contains("`LASI`"), "{hint}");
    }
}
