//! Tables of numbers on disk: Parquet through polars, written completely or not at all.

use crate::disk;
use crate::error::PipelineError;
use aloft_export::parquet::{self, Compression};
use polars::prelude::*;
use std::collections::HashMap;
use std::io::Write;
use std::path::Path;

/// A table of `f64` columns of equal length.
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

    /// Appends columns from a frame-by-frame buffer with `names.len()` values per frame.
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

    /// Number of rows.
    pub fn height(&self) -> usize {
        self.columns.first().map_or(0, Vec::len)
    }

    /// Returns the columns in order.
    pub fn into_columns(self) -> Vec<(String, Vec<f64>)> {
        self.names.into_iter().zip(self.columns).collect()
    }

    /// Returns the columns by name.
    pub fn into_map(self) -> HashMap<String, Vec<f64>> {
        self.names.into_iter().zip(self.columns).collect()
    }

    /// The columns `from..to` as a frame-by-frame buffer.
    pub fn rows(&self, from: usize, to: usize) -> Vec<f64> {
        let height = self.height();
        let mut out = Vec::with_capacity(height * (to - from));
        for row in 0..height {
            out.extend(self.columns[from..to].iter().map(|c| c[row]));
        }
        out
    }

    /// Converts to a polars frame. NaN stays NaN.
    pub fn to_frame(&self) -> PolarsResult<DataFrame> {
        let columns =
            self.names.iter().zip(&self.columns).map(|(n, c)| Column::new(n.as_str().into(), c.as_slice())).collect();
        DataFrame::new(self.height(), columns)
    }

    /// Writes Parquet without compression (noise does not compress) and without statistics; a
    /// column with only a few different values gets a dictionary.
    pub fn write(&self, path: &Path) -> Result<(), PipelineError> {
        let mut file = disk::create(path)?;
        self.write_to(&mut file)
            .map_err(|e| PipelineError::Table { path: path.to_path_buf(), problem: e.to_string() })?;
        file.flush().map_err(PipelineError::io("write", path))
    }

    fn write_to(&self, file: impl Write) -> PolarsResult<()> {
        parquet::write(&self.to_frame()?, file, Compression::None, |i| repeats(&self.columns[i]))
    }

    /// Reads Parquet; every column must be numeric.
    pub fn read(path: &Path) -> Result<Self, PipelineError> {
        let table_error = |e: PolarsError| PipelineError::Table { path: path.to_path_buf(), problem: e.to_string() };
        let bytes = disk::read(path)?;
        let frame = parquet::read(bytes).map_err(table_error)?;
        let mut table = Self::default();
        for column in frame.columns() {
            let values = column.f64().map_err(table_error)?;
            let values = match values.cont_slice() {
                Ok(slice) => slice.to_vec(),
                // none: a column with missing values is copied, one without is taken as it is
                Err(_) => values.iter().map(|v| v.unwrap_or(f64::NAN)).collect(),
            };
            table.push(column.name().as_str(), values);
        }
        Ok(table)
    }
}

/// Reads a table as polars holds it, with columns of any kind: no value is converted.
pub fn read_frame(path: &Path) -> Result<DataFrame, PipelineError> {
    let bytes = disk::read(path)?;
    parquet::read(bytes).map_err(|e| PipelineError::Table { path: path.to_path_buf(), problem: e.to_string() })
}

/// Reads Parquet of another program: every column of numbers or truth values; of points in time and
/// durations seconds, a unit at the end of their name changed to `_s`. Other columns are left out.
pub fn read_numbers(path: &Path) -> Result<Table, PipelineError> {
    let bytes = disk::read(path)?;
    let columns = parquet::read_numbers(&bytes)
        .map_err(|e| PipelineError::Table { path: path.to_path_buf(), problem: e.to_string() })?;
    let mut table = Table::default();
    for (name, values, time) in columns {
        let stem = ["_ns", "_us", "_ms"].iter().find_map(|unit| name.strip_suffix(unit)).filter(|_| time);
        table.push(stem.map_or_else(|| name.clone(), |stem| format!("{stem}_s")), values);
    }
    Ok(table)
}

/// True if a sample of a column holds only a few different values.
fn repeats(values: &[f64]) -> bool {
    const SAMPLE: usize = 64;
    let mut sample = [0; SAMPLE];
    for (i, s) in sample.iter_mut().enumerate() {
        let Some(value) = values.get(i * values.len() / SAMPLE) else { return true };
        *s = value.to_bits();
    }
    sample.sort_unstable();
    sample.windows(2).filter(|w| w[0] != w[1]).count() < SAMPLE / 4
}

/// Writes any frame as Parquet, uncompressed; text columns are written as dictionaries.
pub fn write_frame(frame: &mut DataFrame, path: &Path) -> Result<(), PipelineError> {
    let mut file = disk::create(path)?;
    let text: Vec<bool> = frame.columns().iter().map(|c| c.dtype().is_string()).collect();
    parquet::write(frame, &mut file, Compression::None, |i| text[i])
        .map_err(|e| PipelineError::Table { path: path.to_path_buf(), problem: e.to_string() })?;
    file.flush().map_err(PipelineError::io("write", path))
}

/// Writes any frame as CSV; missing values are empty fields, texts that a spreadsheet would compute
/// as formulas begin with an apostrophe.
pub fn write_csv(frame: &mut DataFrame, path: &Path) -> Result<(), PipelineError> {
    let problem = |problem: String| PipelineError::Table { path: path.to_path_buf(), problem };
    let mut writer = csv::Writer::from_writer(disk::create(path)?);
    let columns = frame.columns();
    writer
        .write_record(columns.iter().map(|c| aloft_export::no_formula(c.name().as_str()).into_owned()))
        .map_err(|e| problem(e.to_string()))?;
    for row in 0..frame.height() {
        let field = |c: &Column| -> Result<String, PipelineError> {
            Ok(match c.get(row).map_err(|e| problem(e.to_string()))? {
                AnyValue::Null => String::new(),
                AnyValue::String(text) => aloft_export::no_formula(text).into_owned(),
                AnyValue::StringOwned(text) => aloft_export::no_formula(&text).into_owned(),
                AnyValue::Float64(value) => format!("{value:?}"),
                other => other.to_string(),
            })
        };
        let record = columns.iter().map(field).collect::<Result<Vec<_>, _>>()?;
        writer.write_record(record).map_err(|e| problem(e.to_string()))?;
    }
    writer.flush().map_err(PipelineError::io("write", path))
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "tests fail by panicking")]
mod tests {
    use super::*;

    /// Tables read back are identical bit by bit, whether written by this writer or by polars' own.
    #[test]
    fn tables_come_back_as_polars_would_write_them() {
        let dir = tempfile::tempdir().unwrap();
        let (ours, plain) = (dir.path().join("a.parquet"), dir.path().join("b.parquet"));
        for height in [0, 1, 2, 63, 64, 1000, 300_000] {
            let mut table = Table::default();
            table.push("time", (0..height).map(|f| f as f64 / 200.0).collect());
            table.push("noise", (0..height).map(|f| (f as f64).sin()).collect());
            table.push("gaps", (0..height).map(|f| if f % 7 < 3 { f64::NAN } else { -0.0 }).collect());
            table.push("still", vec![f64::NEG_INFINITY; height]);
            table.write(&ours).unwrap();
            write_frame(&mut table.to_frame().unwrap(), &plain).unwrap();
            for path in [&ours, &plain] {
                let back = Table::read(path).unwrap();
                assert_eq!(back.names(), table.names());
                for (a, b) in back.columns.iter().zip(&table.columns) {
                    let bits = |v: &[f64]| v.iter().map(|x| x.to_bits()).collect::<Vec<u64>>();
                    assert_eq!(bits(a), bits(b), "{height} rows");
                }
            }
            let size = |p: &Path| std::fs::metadata(p).unwrap().len();
            assert!(size(&ours) < size(&plain) + 512, "{height} rows: {} and {} bytes", size(&ours), size(&plain));
        }
    }
}
