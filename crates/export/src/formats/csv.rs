//! Wide CSV: one row per frame, one column per series, units in the headings.

use crate::channels::channels;
use crate::names::csv_cell;
use crate::number::fixed;
use crate::{ExportError, Format, OutFile, SubjectExport, TrialExport};

/// The format.
pub static FORMAT: Format = Format {
    name: "csv",
    title: "wide table, units in the headings, Z up",
    readers: "spreadsheets, R, MATLAB, pandas",
    trial: Some(write),
    subject: None,
};

fn write(subject: &SubjectExport, trial: &TrialExport) -> Result<Vec<OutFile>, ExportError> {
    let channels = channels(subject, trial);
    let mut text = "frame,time [s],in_flight".to_owned();
    for channel in &channels {
        text.push(',');
        text.push_str(&csv_cell(&channel.heading()));
    }
    text.push('\n');
    for f in 0..trial.n_frames() {
        let in_flight = u8::from(trial.flights.iter().any(|r| r.contains(&f)));
        text.push_str(&format!("{},{},{in_flight}", f + 1, fixed(trial.time_s(f), 8)));
        for channel in &channels {
            text.push(',');
            if channel.values[f].is_finite() {
                text.push_str(&fixed(channel.values[f], 7));
            }
        }
        text.push('\n');
    }
    let what = format!("{} series of {}, one column each; empty cells are missing", channels.len(), trial.name);
    Ok(vec![OutFile::text(format!("Tables/{}.csv", trial.stem()), text, what)])
}
