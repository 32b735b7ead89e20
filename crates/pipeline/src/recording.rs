//! Reading one recording from disk, before a marker set is applied.

use crate::graph::Recording;
use aloft_study::config::{ImportConfig, Vertical};
use aloft_study::quote;
use aloft_study::recordings::bids_beside;
use aloft_trial::{BidsMotion, ImportOptions, Trial, UpAxis};
use aloft_workspace::error::{PipelineError, StageFailure};
use aloft_workspace::qc::QcReason;

/// Reads a recording with the settings of the pipeline, before a marker set is applied.
pub fn read_recording(import: &ImportConfig, recording: &Recording) -> Result<Trial, StageFailure> {
    let options = ImportOptions {
        up_axis: match import.up_axis {
            Vertical::Auto => None,
            Vertical::X => Some(UpAxis::X),
            Vertical::Y => Some(UpAxis::Y),
            Vertical::Z => Some(UpAxis::Z),
        },
        strip_prefix: import.strip_prefix,
        point_unit: import.point_unit.clone(),
        ..ImportOptions::default()
    };
    read_file(&recording.name, &recording.file, recording.forces.as_deref(), &options)
}

/// The failure of a recording that cannot be read, with what to do.
pub fn unreadable(name: &str, file: &std::path::Path, error: &aloft_trial::TrialError) -> StageFailure {
    let name = quote::yaml(&quote::pattern(name));
    StageFailure::with_hint(
        format!("{}: {error}", file.display()),
        format!("export or copy it again, or exclude it: `trials: {{exclude: [{{trial: {name}, reason: …}}]}}`"),
    )
    .because(QcReason::UnreadableFile)
}

/// Reads one recording from disk.
pub fn read_file(
    name: &str,
    file: &std::path::Path,
    forces: Option<&std::path::Path>,
    options: &ImportOptions,
) -> Result<Trial, StageFailure> {
    let label = |e: aloft_trial::TrialError| unreadable(name, file, &e);
    if file.extension().is_some_and(|e| e.eq_ignore_ascii_case("trc")) {
        let text = |p: &std::path::Path| {
            std::fs::read(p).map(|b| String::from_utf8_lossy(&b).into_owned()).map_err(PipelineError::io("read", p))
        };
        let trc = text(file)?;
        let mot = forces.map(text).transpose()?;
        return Trial::from_trc_mot(name, &trc, mot.as_deref(), options).map_err(label);
    }
    if aloft_study::recordings::is_bids(file) {
        return read_bids(name, file, options);
    }
    let bytes = std::fs::read(file).map_err(PipelineError::io("read", file))?;
    Trial::from_c3d(name, &bytes, options).map_err(label)
}

fn read_bids(name: &str, file: &std::path::Path, options: &ImportOptions) -> Result<Trial, StageFailure> {
    let lossy = |p: &std::path::Path| {
        std::fs::read(p).map(|b| String::from_utf8_lossy(&b).into_owned()).map_err(PipelineError::io("read", p))
    };
    let files = bids_beside(file);
    let ending = |end: &str| files.iter().find(|f| f.to_string_lossy().ends_with(end));
    let json = |end: &str| -> Result<serde_json::Value, PipelineError> {
        ending(end).map_or(Ok(serde_json::Value::Null), |p| aloft_workspace::json::read_json(p))
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
    let frames = json("_channels.json")?;
    let axes = frames
        .pointer("/reference_frame/Levels")
        .and_then(serde_json::Value::as_object)
        .and_then(|levels| levels.values().find_map(|l| l.get("SpatialAxes")?.as_str()));
    let (motion, channels) = (lossy(file)?, lossy(channels)?);
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

/// The first few of a list of names.
pub fn abridged(names: &[String]) -> String {
    let shown: Vec<&str> = names.iter().take(8).map(String::as_str).collect();
    if names.len() > 8 { format!("{} … ({} in all)", shown.join(", "), names.len()) } else { shown.join(", ") }
}

/// `acq_time` of a recording from the scans table of its session (BIDS).
fn acquired(scans: &str, file: &std::path::Path) -> Option<aloft_trial::RecordedAt> {
    let mut lines = scans.lines().map(|l| l.split('\t').map(str::trim).collect::<Vec<_>>());
    let header = lines.next()?;
    let column = |name: &str| header.iter().position(|h| *h == name);
    let (names, times) = (column("filename")?, column("acq_time")?);
    let own = file.file_name()?.to_string_lossy().into_owned();
    let row = lines.find(|row| row.get(names).is_some_and(|n| n.rsplit('/').next() == Some(own.as_str())))?;
    aloft_trial::recorded_at(row.get(times)?, "scans.tsv acq_time")
}
