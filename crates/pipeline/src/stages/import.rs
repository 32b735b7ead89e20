//! `import`: one recording to a [`Trial`] in SI and the world frame, labels canonical, short gaps
//! filled, artefacts found.

use crate::graph::{Need, Recording, Scope, Stage, StageInputs, StageReport, StageWork, parameters_of, run_of};
use crate::recording::{abridged, read_recording};
use aloft_study::config::ImportConfig;
use aloft_study::robot::RobotSetup;
use aloft_study::subject_session::{Role, SubjectSession, TrialEntry};
use aloft_trial::{ArtefactOptions, Corrections, GapOptions, MarkerSet, QualityOptions, Severity, Trial, TrialQuality};
use aloft_trial::{
    MarkerSetMatch, QualityReason, WarningKind, apply_marker_set, assess, fill_gaps, find_artefacts, limits_to_missing,
};
use aloft_workspace::artifact::save_trial;
use aloft_workspace::error::StageFailure;
use aloft_workspace::json::write_json;
use aloft_workspace::qc::QcReason;
use serde::{Deserialize, Serialize};
use serde_json::json;

/// The stage.
pub static STAGE: Stage = Stage {
    name: "import",
    version: 13,
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
    people: Vec<String>,
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
            people: session.names_of_person(trial),
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
    /// Sketch of the samples, by which recordings of the same motion are found.
    #[serde(default)]
    pub samples: Vec<u64>,
    /// The same of the forces of the plates; empty in workspaces of earlier versions.
    #[serde(default)]
    pub plate_samples: Vec<u64>,
}

fn run(params: &Params, inputs: &StageInputs<'_>) -> Result<StageReport, StageFailure> {
    let Params { import, people, marker_set, corrections, robot } = params;
    if let Some(robot) = robot {
        return super::robot::import(robot, import, corrections, inputs);
    }
    let recording = inputs.recording()?;
    let mut trial = read_recording(import, people, recording)?;
    let held = trial.truncated();
    holds_enough(import, recording, &trial)?;
    // as measured: a correction of one recording must not hide that another one has the same forces
    let plate_samples = aloft_trial::plate_sketch(&trial.plates);
    let corrected = corrections.apply(&mut trial);
    let matched = apply_marker_set(&mut trial, marker_set, &import.aliases);
    fits_enough(marker_set, recording, &trial, &matched)?;
    let segments = marker_set.segments();
    let samples = aloft_trial::sample_sketch(&trial.markers);
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
    let copies = trial.warnings.iter().filter(|w| w.kind == WarningKind::HeldMarkers).map(|w| w.message.clone());
    let exchanged = quality.reasons.iter().filter(|r| matches!(r, QualityReason::LabelSwap { .. }));
    let left_out: Vec<String> = copies.chain(exchanged.map(ToString::to_string)).collect();
    if !left_out.is_empty() {
        done.note("left_out", json!(left_out));
    }
    if let Some(at) = &trial.recorded {
        done.note("recorded", json!(at));
    }
    if let Some(person) = &trial.person {
        done.note("person", person.as_str());
    }
    if !trial.people.is_empty() {
        done.note("people", json!(trial.people));
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
    let said = |kind: WarningKind| trial.warnings.iter().any(|w| w.kind == kind);
    reasons.extend(said(WarningKind::Clock).then_some(QcReason::ClocksDiffer));
    reasons.extend(said(WarningKind::HeldMarkers).then_some(QcReason::HeldMarker));
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
    done.warnings.extend(texts_of(&quality.reasons));
    let record = ImportRecord { matched, fills, findings, quality, samples, plate_samples };
    write_json(&inputs.out.join("quality.json"), &record)?;
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
fn texts_of(reasons: &[QualityReason]) -> Vec<String> {
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

/// Refuses a recording whose labels have too little in common with the marker set.
///
/// # Errors
/// None, or too few, of the set's markers are in the recording.
pub fn fits_enough(
    marker_set: &MarkerSet,
    recording: &Recording,
    trial: &Trial,
    matched: &MarkerSetMatch,
) -> Result<(), StageFailure> {
    if matched.present.is_empty() {
        return Err(StageFailure::with_hint(
            format!(
                "{}: none of the {} markers of the set `{}` is in the recording; it has {}",
                recording.file.display(),
                marker_set.markers.len(),
                marker_set.name,
                abridged(&trial.markers.labels),
            ),
            "choose another `marker_set`, map the labels under `import: {aliases: {MyLabel: LASI}}`, or let \
             `aloft markerset draft FOLDER` propose a set from the recordings",
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
            "choose another `marker_set`, map the labels under `import: {aliases: {MyLabel: LASI}}`, or let \
             `aloft markerset draft FOLDER` propose a set from the recordings",
        )
        .because(QcReason::NoMarkers));
    }
    Ok(())
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
