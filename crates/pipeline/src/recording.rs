//! Reading one recording from disk, before a marker set is applied.

use crate::graph::Recording;
use aloft_study::config::ImportConfig;
use aloft_study::quote;
use aloft_study::recordings::bids_beside;
use aloft_trial::{BidsMotion, ImportOptions, Trial, TrialError};
use aloft_workspace::error::{PipelineError, StageFailure};
use aloft_workspace::input;
use aloft_workspace::qc::QcReason;
use std::path::Path;

/// Reads a recording with the settings of the pipeline, before a marker set is applied. Of several
/// people in it, the one with the first of the names `people` is read.
pub fn read_recording(import: &ImportConfig, people: &[String], recording: &Recording) -> Result<Trial, StageFailure> {
    let options = ImportOptions { people: people.to_vec(), ..import.options() };
    read_file(&recording.name, &recording.file, recording.forces.as_deref(), &options)
}

/// The failure of a recording that cannot be read, with what to do.
pub fn unreadable(name: &str, file: &Path, error: &TrialError) -> StageFailure {
    let name = quote::yaml(&quote::pattern(name));
    let exclude = format!("exclude it: `trials: {{exclude: [{{trial: {name}, reason: …}}]}}`");
    let (hint, reason) = match error {
        TrialError::SeveralPeople { .. } => {
            ("name the one to use: `import: {person: …}`".to_owned(), QcReason::SeveralPeople)
        }
        TrialError::NoCommonTime { .. } => (
            format!("if both start together, set `import: {{force_times: from_first_frame}}`; or {exclude}"),
            QcReason::ClocksDiffer,
        ),
        TrialError::ForceColumn { .. } => {
            ("correct the names under `import: {forces: …}`".to_owned(), QcReason::UnreadableFile)
        }
        _ => (format!("export or copy it again, or {exclude}"), QcReason::UnreadableFile),
    };
    StageFailure::with_hint(format!("{}: {error}", file.display()), hint).because(reason)
}

/// The failure of a path that is no readable file.
pub fn unopened(name: &str, error: PipelineError) -> StageFailure {
    let failure = StageFailure::from(error);
    let name = quote::yaml(&quote::pattern(name));
    let out = format!("or exclude it: `trials: {{exclude: [{{trial: {name}, reason: …}}]}}`");
    let hint = failure.hint.map_or_else(|| format!("make it readable, {out}"), |hint| format!("{hint}; {out}"));
    StageFailure::with_hint(failure.problem, hint).because(QcReason::UnreadableFile)
}

/// Reads one recording from disk.
pub fn read_file(
    name: &str,
    file: &Path,
    forces: Option<&Path>,
    options: &ImportOptions,
) -> Result<Trial, StageFailure> {
    let label = |e: TrialError| {
        let of_forces = matches!(e, TrialError::Text { format: "MOT", .. } | TrialError::ForceColumn { .. });
        unreadable(name, forces.filter(|_| of_forces).unwrap_or(file), &e)
    };
    let closed = |e: PipelineError| unopened(name, e);
    if file.extension().is_some_and(|e| e.eq_ignore_ascii_case("trc")) {
        let trc = input::lossy(file).map_err(closed)?;
        let mot = forces.map(input::lossy).transpose().map_err(closed)?;
        return Trial::from_trc_mot(name, &trc, mot.as_deref(), options).map_err(label);
    }
    if aloft_study::recordings::is_bids(file) {
        return read_bids(name, file, options);
    }
    let bytes = input::bytes(file).map_err(closed)?;
    Trial::from_c3d(name, &bytes, options).map_err(label)
}

fn read_bids(name: &str, file: &Path, options: &ImportOptions) -> Result<Trial, StageFailure> {
    let lossy = |p: &Path| input::lossy(p).map_err(|e| unopened(name, e));
    let files = bids_beside(file);
    let ending = |end: &str| files.iter().find(|f| f.to_string_lossy().ends_with(end));
    let json = |end: &str| -> Result<serde_json::Value, StageFailure> {
        let Some(path) = ending(end) else { return Ok(serde_json::Value::Null) };
        aloft_workspace::json::read_json(path).map_err(|e| unopened(name, e))
    };
    let Some(channels) = ending("_channels.tsv") else {
        return Err(StageFailure::with_hint(
            format!(
                "{}: there is no {}_channels.tsv beside it",
                file.display(),
                aloft_study::recordings::stem_of(file)
            ),
            "BIDS-Motion keeps the names of the columns in that file: export it, too",
        )
        .because(QcReason::UnreadableFile));
    };
    let (motion, channels) = (lossy(file)?, lossy(channels)?);
    let frames = json("_channels.json")?;
    let levels = frames.pointer("/reference_frame/Levels").and_then(serde_json::Value::as_object);
    let axes = levels.and_then(|levels| {
        let own = frame_of_positions(&channels).and_then(|name| levels.get(name));
        own.or_else(|| levels.values().next().filter(|_| levels.len() == 1))?.get("SpatialAxes")?.as_str()
    });
    let about = json("_motion.json")?;
    let number = |key: &str| about.get(key).and_then(serde_json::Value::as_f64);
    let (rate_hz, duration_s) = (number("SamplingFrequency"), number("RecordingDuration"));
    let source = BidsMotion { motion: &motion, channels: &channels, rate_hz, duration_s, spatial_axes: axes };
    let mut trial = Trial::from_bids_motion(name, &source, options).map_err(|e| unreadable(name, file, &e))?;
    if let Some(scans) = ending("_scans.tsv") {
        trial.recorded = acquired(&lossy(scans)?, file);
    }
    Ok(trial)
}

/// The reference frame of the channels of positions in a `_channels.tsv`; other channels, such as
/// angles of joints, may have frames of their own.
fn frame_of_positions(channels: &str) -> Option<&str> {
    let mut lines = channels.lines().map(|l| l.split('\t').map(str::trim).collect::<Vec<_>>());
    let head = lines.next()?;
    let column = |name: &str| head.iter().position(|h| h.trim_start_matches('\u{feff}').eq_ignore_ascii_case(name));
    let (kind, frame) = (column("type")?, column("reference_frame")?);
    lines.find(|cells| cells.get(kind) == Some(&"POS"))?.get(frame).copied()
}

/// The first few of a list of names.
pub fn abridged(names: &[String]) -> String {
    let shown: Vec<&str> = names.iter().take(8).map(String::as_str).collect();
    if names.len() > 8 { format!("{} … ({} in all)", shown.join(", "), names.len()) } else { shown.join(", ") }
}

/// `acq_time` of a recording from the scans table of its session (BIDS).
fn acquired(scans: &str, file: &Path) -> Option<aloft_trial::RecordedAt> {
    let mut lines = scans.lines().map(|l| l.split('\t').map(str::trim).collect::<Vec<_>>());
    let header = lines.next()?;
    let column = |name: &str| header.iter().position(|h| *h == name);
    let (names, times) = (column("filename")?, column("acq_time")?);
    let own = file.file_name()?.to_string_lossy().into_owned();
    let row = lines.find(|row| row.get(names).is_some_and(|n| n.rsplit('/').next() == Some(own.as_str())))?;
    aloft_trial::recorded_at(row.get(times)?, "scans.tsv acq_time")
}
