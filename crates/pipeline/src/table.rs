//! Tables of numbers on disk: Parquet through polars, written whole or not at all.

use crate::error::PipelineError;
use polars::prelude::*;
use std::collections::HashMap;
use std::fs::File;
use std::path::Path;

/// A table of `f64` columns of one length.
#[derive(Debug, Clone, Default)]
pub struct Table {
    names: Vec<String>,
    columns: Vec<Vec<f64>>,
}

impl Table {
    /// Appends a column.
    pub fn push(&mut self, name: impl Into<String>, values: Vec<f64>) {
        self.names.push(name.into());
        self.columns.push(values);
    }

    /// Appends columns from a frame-by-frame buffer of `names.len()` values a frame.
    pub fn push_rows(&mut self, names: &[String], rows: &[f64]) {
        let width = names.len();
        for (i, name) in names.iter().enumerate() {
            self.push(name.clone(), rows.iter().skip(i).step_by(width.max(1)).copied().collect());
        }
    }

    /// Column names in order.
    pub fn names(&self) -> &[String] {
        &self.names
    }

    /// Rows.
    pub fn height(&self) -> usize {
        self.columns.first().map_or(0, Vec::len)
    }

    /// Takes the columns out by position.
    pub fn into_columns(self) -> Vec<(String, Vec<f64>)> {
        self.names.into_iter().zip(self.columns).collect()
    }

    /// Takes the columns out by name.
    pub fn into_map(self) -> HashMap<String, Vec<f64>> {
        self.names.into_iter().zip(self.columns).collect()
    }

    /// The table as frame-by-frame buffer of columns `from..to`.
    pub fn rows(&self, from: usize, to: usize) -> Vec<f64> {
        let height = self.height();
        let mut out = Vec::with_capacity(height * (to - from));
        for row in 0..height {
            out.extend(self.columns[from..to].iter().map(|c| c[row]));
        }
        out
    }

    /// As a polars frame. NaN stays NaN.
    pub fn to_frame(&self) -> PolarsResult<DataFrame> {
        let columns =
            self.names.iter().zip(&self.columns).map(|(n, c)| Column::new(n.as_str().into(), c.as_slice())).collect();
        DataFrame::new(self.height(), columns)
    }

    /// Writes Parquet.
    pub fn write(&self, path: &Path) -> Result<(), PipelineError> {
        let table_error = |e: PolarsError| PipelineError::Table { path: path.to_path_buf(), problem: e.to_string() };
        let mut frame = self.to_frame().map_err(table_error)?;
        write_frame(&mut frame, path)
    }

    /// Reads Parquet; every column must be numeric.
    pub fn read(path: &Path) -> Result<Self, PipelineError> {
        let table_error = |e: PolarsError| PipelineError::Table { path: path.to_path_buf(), problem: e.to_string() };
        let file = File::open(path).map_err(PipelineError::io("open", path))?;
        let frame = ParquetReader::new(file).finish().map_err(table_error)?;
        let mut table = Self::default();
        for column in frame.columns() {
            let values = column.f64().map_err(table_error)?;
            table.push(column.name().as_str(), values.iter().map(|v| v.unwrap_or(f64::NAN)).collect());
        }
        Ok(table)
    }
}

/// Writes any frame as Parquet, uncompressed (noise does not compress; reading stays fast).
pub fn write_frame(frame: &mut DataFrame, path: &Path) -> Result<(), PipelineError> {
    let file = File::create(path).map_err(PipelineError::io("create", path))?;
    ParquetWriter::new(std::io::BufWriter::new(file))
        .with_compression(ParquetCompression::Uncompressed)
        .set_parallel(false)
        .finish(frame)
        .map_err(|e| PipelineError::Table { path: path.to_path_buf(), problem: e.to_string() })?;
    Ok(())
}

/// Writes any frame as CSV.
pub fn write_csv(frame: &mut DataFrame, path: &Path) -> Result<(), PipelineError> {
    let file = File::create(path).map_err(PipelineError::io("create", path))?;
    CsvWriter::new(std::io::BufWriter::new(file))
        .finish(frame)
        .map_err(|e| PipelineError::Table { path: path.to_path_buf(), problem: e.to_string() })
}
