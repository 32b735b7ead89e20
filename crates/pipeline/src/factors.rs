//! Files of the stages that give factors: one triangular factor a stretch, and what errors that
//! repeat do to their rows.

use aloft_regressor::{Columns, Factor, RepeatedErrors, RowKind, Stretch};
use aloft_study::config::Rows;
use aloft_workspace::error::PipelineError;
use aloft_workspace::json::{read_json, read_json_if_there, write_json};
use aloft_workspace::table::Table;
use nalgebra::DMatrix;
use serde::{Deserialize, Serialize};
use std::path::Path;

/// Factors by stretch, and remarks about them.
pub type FactorsAndRemarks = (Vec<(Stretch, Factor)>, Vec<String>);

#[derive(Serialize, Deserialize)]
struct FactorHead {
    stretch: Stretch,
    rows: RowKind,
    columns: Columns,
    n_rows: usize,
    n_values: usize,
    /// The triangle of the errors of the rows, whose values follow; none where it is unknown.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    noise: Option<NoiseHead>,
}

#[derive(Serialize, Deserialize)]
struct NoiseHead {
    n_rows: usize,
    n_values: usize,
}

/// Writes `factors.json` and `factors.parquet`.
pub fn save_factors(dir: &Path, factors: &[(Stretch, Factor)]) -> Result<(), PipelineError> {
    save_named(dir, "factors", factors)
}

/// The same under another name than `factors`.
pub fn save_named(dir: &Path, name: &str, factors: &[(Stretch, Factor)]) -> Result<(), PipelineError> {
    let heads: Vec<FactorHead> = factors
        .iter()
        .map(|(stretch, f)| FactorHead {
            stretch: stretch.clone(),
            rows: f.rows,
            columns: f.columns.clone(),
            n_rows: f.n_rows,
            n_values: f.values().len(),
            noise: f.noise().map(|noise| NoiseHead { n_rows: noise.n_rows, n_values: noise.values().len() }),
        })
        .collect();
    write_json(&dir.join(format!("{name}.json")), &heads)?;
    let mut table = Table::default();
    let noise = |f: &Factor| f.noise().map(|noise| noise.values().to_vec()).unwrap_or_default();
    table.push("value", factors.iter().flat_map(|(_, f)| f.values().iter().copied().chain(noise(f))).collect());
    table.write(&dir.join(format!("{name}.parquet")))
}

/// Reads the stage's files for a trial: each stretch with its factor.
pub fn load_factors(dir: &Path) -> Result<Vec<(Stretch, Factor)>, PipelineError> {
    load_named(dir, "factors")
}

/// The same under another name than `factors`.
pub fn load_named(dir: &Path, name: &str) -> Result<Vec<(Stretch, Factor)>, PipelineError> {
    let heads: Vec<FactorHead> = read_json(&dir.join(format!("{name}.json")))?;
    if heads.is_empty() {
        // a table without rows has no columns to read
        return Ok(Vec::new());
    }
    let path = dir.join(format!("{name}.parquet"));
    let values = Table::read(&path)?.into_columns().into_iter().next().map(|c| c.1).unwrap_or_default();
    let mut at = 0_usize;
    let mut out = Vec::new();
    for head in heads {
        let wrong = |problem: String| PipelineError::Table { path: path.clone(), problem };
        let mut part = |n_rows: usize, n_values: usize| {
            let part = at.checked_add(n_values).and_then(|end| values.get(at..end));
            let part = part.ok_or_else(|| wrong("fewer values than factors.json says".to_owned()))?;
            at += n_values;
            Factor::from_values(&head.stretch, head.rows, head.columns.clone(), n_rows, part.to_vec())
                .map_err(|e| wrong(e.to_string()))
        };
        let mut factor = part(head.n_rows, head.n_values)?;
        if let Some(NoiseHead { n_rows, n_values }) = head.noise {
            factor = factor.with_noise(part(n_rows, n_values)?).map_err(|e| wrong(e.to_string()))?;
        }
        out.push((head.stretch, factor));
    }
    Ok(out)
}

#[derive(Serialize, Deserialize)]
struct RepeatedHead {
    stretch: Stretch,
    rows: usize,
    markers: usize,
    geometry: usize,
}

/// Writes `repeated.json` and `repeated.parquet`: what draws of errors of the markers and of the
/// geometry do to the weak rows of each stretch.
pub fn save_repeated(dir: &Path, errors: &[(Stretch, RepeatedErrors)]) -> Result<(), PipelineError> {
    let heads: Vec<RepeatedHead> = errors
        .iter()
        .map(|(stretch, e)| RepeatedHead {
            stretch: stretch.clone(),
            rows: e.markers.nrows(),
            markers: e.markers.ncols(),
            geometry: e.geometry.ncols(),
        })
        .collect();
    write_json(&dir.join("repeated.json"), &heads)?;
    let mut table = Table::default();
    table.push("value", errors.iter().flat_map(|(_, e)| e.markers.iter().chain(e.geometry.iter()).copied()).collect());
    table.write(&dir.join("repeated.parquet"))
}

/// Reads them for a trial of a person; nothing for objects.
pub fn load_repeated(dir: &Path) -> Result<Vec<(Stretch, RepeatedErrors)>, PipelineError> {
    let heads: Option<Vec<RepeatedHead>> = read_json_if_there(&dir.join("repeated.json"))?;
    let Some(heads) = heads else { return Ok(Vec::new()) };
    let path = dir.join("repeated.parquet");
    let values = Table::read(&path)?.into_columns().into_iter().next().map(|c| c.1).unwrap_or_default();
    let mut at = 0_usize;
    heads
        .into_iter()
        .map(|head| {
            let mut part = |columns: usize| {
                let end = head.rows.checked_mul(columns).filter(|_| head.rows > 0).and_then(|n| at.checked_add(n));
                let part = end.and_then(|end| values.get(at..end)).ok_or_else(|| PipelineError::Table {
                    path: path.clone(),
                    problem: "fewer values than repeated.json says".to_owned(),
                })?;
                at += part.len();
                Ok::<_, PipelineError>(DMatrix::from_column_slice(head.rows, columns, part))
            };
            Ok((head.stretch, RepeatedErrors { markers: part(head.markers)?, geometry: part(head.geometry)? }))
        })
        .collect()
}

/// Kind of rows for the word used in the configuration.
pub fn row_kind(rows: Rows) -> RowKind {
    match rows {
        Rows::Acceleration => RowKind::Acceleration,
        Rows::Weak => RowKind::Weak,
    }
}
