//! `import`: one recording to a [`Trial`] in SI and the world frame, labels canonical, short gaps filled, artefacts found.

use crate::graph::{Need, Recording, Scope, Stage, StageInputs, StageReport, StageWork, parameters_of, run_of};
use aloft_study::config::{ImportConfig, Vertical};
use aloft_study::quote;
use aloft_study::recordings::bids_beside;
use aloft_study::robot::RobotSetup;
use aloft_study::subject_session::{Role, SubjectSession, TrialEntry};
use aloft_trial::{
    ArtefactOptions, BidsMotion, Corrections, GapOptions, ImportOptions, MarkerSet, QualityOptions, Severity, Trial,
    TrialQuality, UpAxis,
};
use aloft_trial::{
    MarkerSetMatch, QualityReason, apply_marker_set, assess, fill_gaps, find_artefacts, limits_to_missing,
};
use aloft_workspace::artifact::save_trial;
use aloft_workspace::error::{PipelineError, StageFailure};
use aloft_workspace::json::write_json;
use aloft_workspace::qc::QcReason;
use serde::{Deserialize, Serialize};
use serde_json::json;

/// The stage.
pub static STAGE: Stage = Stage {
    name: "import",
    version: 5,
    scope: Scope::Trial(&[Role::Static, Role::Calibration, Role::Identify, Role::Validate]),
    seconds: 0.03,
    reads: "C3D, TRC with MOT, or BIDS-Motion; marker set (robots: joint log, base pose)",
    gives: "markers, plates, events in SI and one world frame; quality table",
    needs: &[Need::Recording],
    parameters: parameters_of::<Work>,
    run: run_of::<Work>,
};

/// Parameters of the stage.
#[derive(Debug, Serialize)]
pub struct Params {
    import: ImportConfig,
    marker_set: MarkerSet,
    #[serde(skip_serializing_if = "Corrections::is_empty")]
    corrections: Corrections,
    #[serde(skip_serializing_if = "Option::is_none")]
    robot: Option<RobotSetup>,
}

/// Work of the stage.
#[derive(Debug)]
pub struct Work;

impl StageWork for Work {
    type Params = Params;
    fn params(session: &SubjectSession, trial: Option<&TrialEntry>) -> Params {
        Params {
            import: session.import_of(trial).clone(),
            marker_set: session.marker_set.clone(),
            corrections: session.config.corrections.of_recordings(),
            robot: session.robot.clone(),
        }
    }
    fn run(params: &Params, inputs: &StageInputs<'_>) -> Result<StageReport, StageFailure> {
        run(params, inputs)
    }
}

/// Contents of `quality.json`.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct ImportRecord {
    /// Labels found, missing, unknown.
    pub matched: MarkerSetMatch,
    /// Every fill.
    pub fills: Vec<aloft_trial::GapFill>,
    /// Spikes and label swaps.
    pub findings: Vec<aloft_trial::Finding>,
    /// Quality of the trial.
    pub quality: TrialQuality,
}

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

fn unreadable(name: &str, file: &std::path::Path, error: &aloft_trial::TrialError) -> StageFailure {
    let name = quote::yaml(&quote::pattern(name));
    StageFailure::with_hint(
        format!("{}: {error}", file.display()),
        format!(
            "export or copy the recording again, or leave it out: `trials: {{exclude: [{{trial: {name}, reason: …}}]}}`"
        ),
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

fn run(params: &Params, inputs: &StageInputs<'_>) -> Result<StageReport, StageFailure> {
    let Params { import, marker_set, corrections, robot } = params;
    if let Some(robot) = robot {
        return super::robot::import(robot, import, inputs);
    }
    let recording = inputs.recording()?;
    let mut trial = read_recording(import, recording)?;
    let held = trial.truncated();
    holds_enough(import, recording, &trial)?;
    let corrected = corrections.apply(&mut trial);
    let matched = apply_marker_set(&mut trial, marker_set, &import.aliases);
    if matched.present.is_empty() {
        return Err(StageFailure::with_hint(
            format!(
                "{}: none of the {} markers of the set `{}` is in the recording; it has {}",
                recording.file.display(),
                marker_set.markers.len(),
                marker_set.name,
                abridged(&trial.markers.labels),
            ),
            "choose another `marker_set`, or map the labels under `import: {aliases: …}`",
        )
        .because(QcReason::NoMarkers));
    }
    let wanted = marker_set.markers.iter().filter(|m| m.tracking && !m.optional && !m.static_only).count();
    let found = wanted.saturating_sub(matched.missing.len());
    if (found as f64) < LEAST_FIT * wanted as f64 {
        return Err(StageFailure::with_hint(
            format!(
                "{}: only {found} of {wanted} markers of the set `{}` are in the recording ({:.0} %); it has {}",
                recording.file.display(),
                marker_set.name,
                100.0 * found as f64 / wanted as f64,
                abridged(&trial.markers.labels),
            ),
            "another `marker_set` fits better, or map the labels under `import: {aliases: {MyLabel: LASI}}`; a set is a \
             YAML file with a label, a link and a landmark a line, and `marker_set: path/to/file.yaml` uses it",
        )
        .because(QcReason::NoMarkers));
    }
    let segments = marker_set.segments();
    let artefacts = ArtefactOptions { repair: import.repair, ..ArtefactOptions::default() };
    let findings = find_artefacts(&mut trial, &segments, &artefacts);
    let gaps = GapOptions {
        cubic_limit_s: import.fill_gaps_s,
        rigid_limit_s: import.rigid_fill_s.max(import.fill_gaps_s),
        ..GapOptions::default()
    };
    let fills = fill_gaps(&mut trial, &segments, &gaps);
    let quality = assess(&trial, Some(&matched), &fills, &findings, &QualityOptions::default());
    if let Some(reason) = quality.reasons.iter().find(|r| r.severity() == Severity::Unusable) {
        return Err(StageFailure::with_hint(
            format!("{}: {reason}", recording.file.display()),
            "exclude the trial with a reason under `trials: {exclude: …}`, or export it again",
        )
        .because(reason.into()));
    }
    let cut = limits_to_missing(&mut trial);
    trial.warnings.extend(cut);
    save_trial(inputs.out, &trial)?;
    let mut done = StageReport::default();
    done.note("frames", trial.markers.n_frames);
    done.note("rate_hz", trial.markers.rate_hz);
    if !corrected.is_empty() {
        done.note("corrected", json!(corrected));
    }
    done.note("markers", matched.present.len());
    done.note("missing_markers", matched.missing.len());
    done.note("plates", trial.plates.len());
    done.note("filled_gaps", fills.len());
    done.note("duration_s", quality.duration_s);
    if let Some(at) = &trial.recorded {
        done.note("recorded", json!(at));
    }
    if let Some(found) = aloft_trial::smoothing(&trial, marker_set.markerless.is_some()) {
        done.note("smoothed_hz", (10.0 * found.cutoff_hz).round() / 10.0);
        done.warnings.push(smoothed(&found));
    }
    done.note("gaps", quality.markers.iter().map(|m| m.gaps).sum::<usize>());
    let longest = quality.markers.iter().map(|m| m.longest_gap_frames).max().unwrap_or(0);
    done.note("longest_gap_s", longest as f64 / trial.markers.rate_hz);
    let mut reasons: Vec<QcReason> =
        quality.reasons.iter().filter(|r| r.severity() != Severity::Note).map(QcReason::from).collect();
    reasons.extend(held.map(|_| QcReason::FramesLost));
    reasons.extend(trial.forces_truncated().map(|_| QcReason::PlateIncomplete));
    reasons.sort();
    reasons.dedup();
    done.note("qc", json!(reasons));
    let gaps_left: usize = trial
        .markers
        .labels
        .iter()
        .zip(&trial.markers.trajectories)
        .filter(|(l, _)| matched.present.contains(l))
        .map(|(_, t)| t.iter().filter(|p| !p.x.is_finite()).count())
        .sum();
    done.note("missing_samples", gaps_left);
    done.warnings.extend(trial.warnings.iter().map(ToString::to_string));
    done.warnings.extend(told(&quality.reasons));
    write_json(&inputs.out.join("quality.json"), &ImportRecord { matched, fills, findings, quality })?;
    Ok(done)
}

/// What smoothing before import means for the results.
pub fn smoothed(found: &aloft_trial::Smoothing) -> String {
    format!(
        "the markers were smoothed before they were stored (about {:.0} Hz): forces of faster movement are lost, so their noise underestimates their error",
        found.cutoff_hz
    )
}

/// Share of a marker set's markers that a recording has to have.
const LEAST_FIT: f64 = 0.5;
/// Number of long gaps that are named one by one.
const NAMED_GAPS: usize = 4;

/// The reasons as warnings; many long gaps (a person who walks through the volume) are one.
fn told(reasons: &[QualityReason]) -> Vec<String> {
    let warned = || reasons.iter().filter(|r| r.severity() == Severity::Warning);
    let gaps: Vec<(&String, usize, usize)> = warned()
        .filter_map(|r| match r {
            QualityReason::LongGap { marker, first_frame, last_frame } => Some((marker, *first_frame, *last_frame)),
            _ => None,
        })
        .collect();
    let many = gaps.len() > NAMED_GAPS;
    let mut out: Vec<String> =
        warned().filter(|r| !(many && matches!(r, QualityReason::LongGap { .. }))).map(ToString::to_string).collect();
    if let (true, Some((marker, first, last))) = (many, gaps.iter().max_by_key(|g| g.2 - g.1)) {
        let mut markers: Vec<&&String> = gaps.iter().map(|g| &g.0).collect();
        markers.sort();
        markers.dedup();
        out.push(format!(
            "{} markers are missing in {} stretches that are too long to fill; the longest: `{marker}` in frames {} to {}",
            markers.len(),
            gaps.len(),
            first + 1,
            last + 1
        ));
    }
    out
}

/// A truncated file is used as far as it goes, unless it holds less than the pipeline's
/// `least_fraction` of the declared frames.
pub fn holds_enough(import: &ImportConfig, recording: &Recording, trial: &Trial) -> Result<(), StageFailure> {
    let markers = trial.truncated().map(|counts| (counts, &recording.file));
    let forces = trial.forces_truncated().zip(recording.forces.as_ref());
    for ((held, stated), file) in markers.into_iter().chain(forces) {
        if (held as f64) < import.least_fraction * stated as f64 {
            return Err(StageFailure::with_hint(
                format!("{}: file truncated: {held} of {stated} declared frames present", file.display()),
                "copy the recording again, or set `import: {least_fraction: …}` to use what is there",
            )
            .because(QcReason::TruncatedFile));
        }
    }
    Ok(())
}

/// The first few of a list of names.
pub fn abridged(names: &[String]) -> String {
    let shown: Vec<&str> = names.iter().take(8).map(String::as_str).collect();
    if names.len() > 8 { format!("{} … ({} in all)", shown.join(", "), names.len()) } else { shown.join(", ") }
}
