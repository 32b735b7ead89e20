//! Tidy Parquet: one row per value (subject, trial, frame, time, quantity, name, axis, unit,
//! value), for analysis across trials.

use crate::channels::channels;
use crate::parquet::{self, Compression};
use crate::{ExportError, Format, OutFile, SubjectExport, TrialExport};
use polars::prelude::*;

/// The format.
pub static FORMAT: Format = Format {
    name: "parquet",
    title: "tidy (long) table, Z up",
    readers: "pandas, polars, R arrow, DuckDB",
    trial: Some(write),
    subject: None,
};

fn write(subject: &SubjectExport, trial: &TrialExport) -> Result<Vec<OutFile>, ExportError> {
    let path = format!("Tables/{}.parquet", trial.stem());
    let failed = |e: PolarsError| ExportError::Table { path: path.clone(), problem: e.to_string() };
    let channels = channels(subject, trial);
    let n = trial.n_frames();
    let rows = n * channels.len();
    let repeated = |of: &dyn Fn(usize) -> String| -> Vec<String> {
        (0..channels.len()).flat_map(|c| std::iter::repeat_n(of(c), n)).collect()
    };
    let each_frame = |of: &dyn Fn(usize) -> f64| -> Vec<f64> {
        (0..channels.len()).flat_map(|_| (0..n).map(of).collect::<Vec<_>>()).collect()
    };
    let frames: Vec<i64> = (0..channels.len()).flat_map(|_| 1..=n as i64).collect();
    let in_flight: Vec<bool> = (0..channels.len())
        .flat_map(|_| (0..n).map(|f| trial.flights.iter().any(|r| r.contains(&f))).collect::<Vec<_>>())
        .collect();
    let values: Vec<f64> = channels.iter().flat_map(|c| c.values.iter().copied()).collect();
    let text = |name: &str, values: Vec<String>| Column::new(name.into(), values);
    let columns = vec![
        text("subject", vec![subject.id.clone(); rows]),
        text("trial", vec![trial.name.clone(); rows]),
        Column::new("frame".into(), frames),
        Column::new("time_s".into(), each_frame(&|f| trial.time_s(f))),
        Column::new("in_flight".into(), in_flight),
        text("quantity", repeated(&|c| channels[c].quantity.to_owned())),
        text("name", repeated(&|c| channels[c].name.clone())),
        text("axis", repeated(&|c| channels[c].axis.to_owned())),
        text("unit", repeated(&|c| channels[c].unit.to_owned())),
        Column::new("value".into(), values),
    ];
    let names: Vec<String> = columns.iter().map(|c| c.name().to_string()).collect();
    let frame = DataFrame::new(rows, columns).map_err(failed)?;
    let mut bytes = Vec::new();
    // names, frames and times repeat; values do not
    let dictionary = |i: usize| !matches!(names[i].as_str(), "in_flight" | "value");
    parquet::write(&frame, &mut bytes, Compression::Snappy, dictionary).map_err(failed)?;
    let what = format!("{} series of {}, one row a value; NaN is missing", channels.len(), trial.name);
    Ok(vec![OutFile { path, bytes, what }])
}
