//! Rows with the columns of all effects that can be switched, stored beside the factors of the
//! stages: `WORKSPACE/columns/<trial>/`. They take a few seconds to form for a person, and depend
//! on nothing but the recordings, the settings and the effects.
//!
//! A store is a cache: where it is missing, made from something else, or damaged, the rows are
//! formed again.

use aloft_compare::WindowRows;
use aloft_regressor::{Columns, Factor, RowKind, StretchKind};
use aloft_workspace::error::PipelineError;
use aloft_workspace::table::Table;
use aloft_workspace::{disk, seal};
use nalgebra::{DMatrix, Vector3};
use serde::{Deserialize, Serialize};
use std::path::Path;

/// Rows of one trial.
pub(crate) struct TrialColumns {
    /// Factors for identification; empty for a trial that takes no part in it.
    pub factors: Vec<Factor>,
    /// Windows for judging; none for a trial that was not compared.
    pub windows: Option<WindowRows>,
    /// Number of frames in which the columns of each effect are finite.
    pub finite: Vec<usize>,
}

#[derive(Serialize, Deserialize)]
struct FactorHead {
    stretch: usize,
    kind: StretchKind,
    rows: RowKind,
    columns: Columns,
    n_rows: usize,
    n_values: usize,
    /// Rows and values of the noise, which follow those of the factor.
    #[serde(default)]
    noise: Option<(usize, usize)>,
}

#[derive(Serialize, Deserialize)]
struct WindowsHead {
    effects: Vec<String>,
    centre_s: Vec<f64>,
    in_flight: Vec<bool>,
    path: Vec<[f64; 3]>,
    shape: (usize, usize),
}

#[derive(Serialize, Deserialize)]
struct Head {
    /// Hash of everything that the rows depend on.
    made_from: String,
    /// Hash of the values in the table beside this file.
    values: String,
    factors: Vec<FactorHead>,
    windows: Option<WindowsHead>,
    finite: Vec<usize>,
}

fn hash(values: &[f64]) -> String {
    let mut hasher = blake3::Hasher::new();
    for v in values {
        hasher.update(&v.to_le_bytes());
    }
    hasher.finalize().to_hex().to_string()
}

/// Stores the rows of a trial.
pub(crate) fn save(folder: &Path, made_from: &str, rows: &TrialColumns) -> Result<(), PipelineError> {
    disk::create_dir_all(folder)?;
    let mut values: Vec<f64> = Vec::new();
    let mut factors = Vec::with_capacity(rows.factors.len());
    for f in &rows.factors {
        values.extend(f.values());
        values.extend(f.noise().iter().flat_map(|noise| noise.values()));
        factors.push(FactorHead {
            stretch: f.stretch,
            kind: f.kind,
            rows: f.rows,
            columns: f.columns.clone(),
            n_rows: f.n_rows,
            n_values: f.values().len(),
            noise: f.noise().map(|noise| (noise.n_rows, noise.values().len())),
        });
    }
    let windows = rows.windows.as_ref().map(|w| {
        values.extend(w.rows.iter());
        WindowsHead {
            effects: w.effects.clone(),
            centre_s: w.centre_s.clone(),
            in_flight: w.in_flight.clone(),
            path: w.path.iter().map(|p| (*p).into()).collect(),
            shape: w.rows.shape(),
        }
    });
    let head =
        Head { made_from: made_from.to_owned(), values: hash(&values), factors, windows, finite: rows.finite.clone() };
    let mut table = Table::default();
    table.push("value", values);
    table.write(&folder.join("columns.parquet"))?;
    seal::write_whole(&folder.join("columns.json"), &head)
}

/// The stored rows of a trial, if they were made from the same and are undamaged.
pub(crate) fn load(folder: &Path, trial: &str, made_from: &str) -> Option<TrialColumns> {
    // none: columns that cannot be read are formed again
    let head: Head = seal::read(&folder.join("columns.json")).ok()?;
    if head.made_from != made_from {
        return None;
    }
    // none: as above
    let values = Table::read(&folder.join("columns.parquet")).ok()?.into_columns().into_iter().next()?.1;
    if hash(&values) != head.values {
        return None;
    }
    let mut rest = values.as_slice();
    let mut take = |n: usize| -> Option<&[f64]> {
        let (own, after) = rest.split_at_checked(n)?;
        rest = after;
        Some(own)
    };
    let mut factors = Vec::with_capacity(head.factors.len());
    for f in head.factors {
        let stretch = aloft_regressor::Stretch {
            trial: trial.to_owned(),
            index: f.stretch,
            kind: f.kind,
            first_frame: 0,
            end_frame: 0,
        };
        let mut part = |n_rows: usize, n_values: usize| {
            // none: as above
            Factor::from_values(&stretch, f.rows, f.columns.clone(), n_rows, take(n_values)?.to_vec()).ok()
        };
        let mut factor = part(f.n_rows, f.n_values)?;
        if let Some((n_rows, n_values)) = f.noise {
            // none: as above
            factor = factor.with_noise(part(n_rows, n_values)?).ok()?;
        }
        factors.push(factor);
    }
    let windows = match head.windows {
        None => None,
        Some(w) => Some(WindowRows {
            rows: DMatrix::from_column_slice(w.shape.0, w.shape.1, take(w.shape.0 * w.shape.1)?),
            effects: w.effects,
            centre_s: w.centre_s,
            in_flight: w.in_flight,
            path: w.path.into_iter().map(Vector3::from).collect(),
        }),
    };
    Some(TrialColumns { factors, windows, finite: head.finite })
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "tests fail by panicking")]
mod tests {
    use super::*;
    use aloft_regressor::Stretch;

    fn rows() -> TrialColumns {
        let stretch = Stretch::flight("t", 2, 0, 0);
        let columns =
            Columns { parameters: vec!["M".into(), "x".into()], effects: vec!["e.k".into()], of_tables: Vec::new() };
        let values = (0..10).map(|i| 0.1 * f64::from(i) + 1.0).collect();
        let noise = Factor::from_values(&stretch, RowKind::Weak, columns.clone(), 18, vec![0.25; 10]).unwrap();
        let factor =
            Factor::from_values(&stretch, RowKind::Weak, columns, 9, values).unwrap().with_noise(noise).unwrap();
        let windows = WindowRows {
            rows: DMatrix::from_fn(12, 4, |i, j| (i * 4 + j) as f64 / 3.0),
            effects: vec!["e.k".into()],
            centre_s: vec![0.1, 0.2],
            in_flight: vec![false, true],
            path: vec![Vector3::new(0.0, 1.0, 2.0), Vector3::zeros()],
        };
        TrialColumns { factors: vec![factor], windows: Some(windows), finite: vec![7] }
    }

    #[test]
    fn what_is_stored_comes_back_bit_by_bit() {
        let dir = tempfile::tempdir().unwrap();
        save(dir.path(), "a", &rows()).unwrap();
        let back = load(dir.path(), "t", "a").unwrap();
        assert_eq!((back.factors, back.finite), (rows().factors, rows().finite));
        let (a, b) = (back.windows.unwrap(), rows().windows.unwrap());
        assert_eq!(
            (a.rows, a.effects, a.centre_s, a.in_flight, a.path),
            (b.rows, b.effects, b.centre_s, b.in_flight, b.path)
        );
    }

    #[test]
    fn other_sources_and_damage_are_not_used() {
        let dir = tempfile::tempdir().unwrap();
        assert!(load(dir.path(), "t", "a").is_none());
        save(dir.path(), "a", &rows()).unwrap();
        assert!(load(dir.path(), "t", "b").is_none());
        let mut other = rows();
        other.windows.as_mut().unwrap().rows[(0, 0)] = 5.0;
        let second = tempfile::tempdir().unwrap();
        save(second.path(), "a", &other).unwrap();
        std::fs::copy(second.path().join("columns.parquet"), dir.path().join("columns.parquet")).unwrap();
        assert!(load(dir.path(), "t", "a").is_none(), "values that are not those of the head");
    }
}
