//! `check`: checks configuration, labels and files; changes nothing.

mod findings;

pub use self::findings::Finding;

pub(crate) use self::findings::{Remark, findings};
use crate::answers;
use crate::corrections::{Offer, offers};
use crate::explanations::{Explanation, explanations};
use crate::session_check::{SessionCheck, session_check};
use aloft_pipeline::corrected::refuse_unknown_plates;
use aloft_pipeline::graph::Recording;
use aloft_pipeline::made::as_made;
use aloft_pipeline::recording::{abridged, read_recording};
use aloft_pipeline::stages::filter::low_pass;
use aloft_pipeline::stages::import::{fits_enough, holds_enough};
use aloft_scale::check_span;
use aloft_study::subject_session::{Role, SubjectSession, TrialEntry};
use aloft_trial::{QualityOptions, Severity, apply_marker_set, assess};
use aloft_workspace::error::PipelineError;
use aloft_workspace::error::StageFailure;
use rayon::prelude::*;
use serde::Serialize;

/// Result of the check.
#[derive(Debug, Clone, Serialize)]
pub struct Check {
    /// Version of this structure.
    pub version: u32,
    /// One row per recording, with every remark.
    pub trials: Vec<CheckRow>,
    /// The same remarks by kind: one line each, with the recordings that it concerns.
    pub findings: Vec<Finding>,
    /// Remarks about the study as a whole.
    pub remarks: Vec<String>,
    /// Consistency of the recordings; no lines before a run.
    pub session: SessionCheck,
    /// Corrections that these measurements offer; applied only where the pipeline's `corrections`
    /// say so.
    pub offers: Vec<Offer>,
    /// What explains the lines of the session check that differ: corrections and effects, the
    /// likelier first.
    pub explanations: Vec<Explanation>,
}

/// One recording.
#[derive(Debug, Clone, Serialize)]
pub struct CheckRow {
    /// Trial name.
    pub name: String,
    /// Role, or `excluded`.
    pub role: String,
    /// Frames.
    pub frames: Option<usize>,
    /// Rate, Hz.
    pub rate_hz: Option<f64>,
    /// Markers of the set that were found, out of all.
    pub markers: String,
    /// Number of force plates.
    pub plates: Option<usize>,
    /// True when the recording cannot be used.
    pub broken: bool,
    /// Remarks.
    pub remarks: Vec<String>,
}

/// Reads every recording and reports what is missing.
///
/// # Errors
/// A correction that names a plate which no recording has.
pub fn check(session: &SubjectSession) -> Result<Check, PipelineError> {
    if session.id.subject.is_none() {
        // in a study of several, another session may have the plate
        refuse_unknown_plates(&[session])?;
    }
    let checked: Vec<(CheckRow, Vec<Remark>)> =
        session.trials.par_iter().map(|entry| check_one(session, entry)).collect();
    let findings = findings(checked.iter().map(|(row, remarks)| (row.name.as_str(), remarks.as_slice())));
    let trials: Vec<CheckRow> = checked.into_iter().map(|(row, _)| row).collect();
    let mut remarks = Vec::new();
    let count = |role: Role| session.included().filter(|t| t.role == role).count();
    if count(Role::Static) == 0
        && session.config.trials.static_frames.is_none()
        && session.robot.is_none()
        && session.osim.is_none()
    {
        remarks.push("no static trial: name frames of a dynamic trial under `trials: {static_frames: …}`".to_owned());
    }
    let statics = trials.iter().filter(|t| t.role == Role::Static.word()).count();
    if statics > 0 && trials.iter().filter(|t| t.role == Role::Static.word()).all(|t| t.broken) {
        remarks.push("no static trial can be used: the subject's model cannot be made".to_owned());
    }
    if !session.unmatched.is_empty() {
        let names: Vec<String> = session.unmatched.iter().map(|p| p.display().to_string()).collect();
        let what = match names.len() {
            1 => "1 recording matches no pattern of `trials` and is not used".to_owned(),
            n => format!("{n} recordings match no pattern of `trials` and are not used"),
        };
        remarks.push(format!("{what}: {}", abridged(&names)));
    }
    for e in &session.config.trials.exclude {
        if !session.trials.iter().any(|t| t.excluded.as_ref() == Some(&e.reason)) {
            remarks.push(format!("the exclusion of `{}` ({}) matches no trial", e.trial, e.reason));
        }
    }
    if count(Role::Validate) == 0 && !session.is_rigid() {
        remarks.push(
            "no trial is held out for comparison; each trial will be compared with parameters from the others"
                .to_owned(),
        );
    }
    if count(Role::Identify) == 0 {
        let patterns: Vec<String> = session.config.trials.identify.iter().map(|p| format!("`{p}`")).collect();
        remarks.push(format!(
            "no trial to identify from: no recording matches `trials: identify` ({})",
            patterns.join(", ")
        ));
    }
    if !session.is_rigid() && session.osim.is_none() {
        if session.facts.person.sex.is_none() {
            remarks.push("the subject's sex is not known: the mean of both sexes' tables is used".to_owned());
        }
        if session.facts.person.height_m.is_none() {
            remarks.push("the subject's stature is not known: segment lengths come from the markers alone".to_owned());
        }
    }
    let alone: Vec<String> = session
        .included()
        .filter(|t| t.file.extension().is_some_and(|e| e.eq_ignore_ascii_case("trc")) && t.forces.is_none())
        .map(|t| t.name.clone())
        .collect();
    if !alone.is_empty() {
        remarks.push(format!("no force file beside {}; see `trials: {{forces: …}}`", abridged(&alone)));
    }
    let measured = session_check(session)?;
    let offers = offers(&as_made(session)?, &measured)?;
    let asked = answers::present(session)?.map(|kept| kept.answer);
    let explanations = explanations(session, &measured, &offers, asked.as_ref());
    Ok(Check { version: 1, trials, findings, remarks, session: measured, offers, explanations })
}

/// Reads one recording; its row, and its remarks with their kinds.
fn check_one(session: &SubjectSession, entry: &TrialEntry) -> (CheckRow, Vec<Remark>) {
    let mut row = CheckRow {
        name: entry.name.clone(),
        role: entry.role.word().to_owned(),
        frames: None,
        rate_hz: None,
        markers: String::new(),
        plates: None,
        broken: false,
        remarks: Vec::new(),
    };
    let remarks = match &entry.excluded {
        Some(reason) => {
            row.role = "excluded".to_owned();
            vec![Remark::Other(format!("excluded: {reason}"))]
        }
        None => read_one(session, entry, &mut row).unwrap_or_else(|failure| {
            row.broken = true;
            let StageFailure { problem, hint, .. } = failure;
            vec![Remark::Broken { problem, path: entry.file.display().to_string(), hint }]
        }),
    };
    row.remarks = remarks.iter().map(ToString::to_string).collect();
    (row, remarks)
}

fn read_one(session: &SubjectSession, entry: &TrialEntry, row: &mut CheckRow) -> Result<Vec<Remark>, StageFailure> {
    if let Some(robot) = &session.robot {
        let import = session.import_of(Some(entry));
        let read = aloft_pipeline::stages::robot::read(
            robot,
            import,
            &session.config.corrections.of_recordings(),
            &Recording::of(entry),
        )?;
        row.frames = Some(read.log.time_s.len());
        row.rate_hz = Some(1.0 / read.log.interval_s());
        row.plates = Some(0);
        return Ok(read.remarks.into_iter().map(Remark::Other).collect());
    }
    let import = session.import_of(Some(entry));
    let mut trial = read_recording(import, &session.names_of_person(Some(entry)), &Recording::of(entry))?;
    holds_enough(import, &Recording::of(entry), &trial)?;
    let matched = apply_marker_set(&mut trial, &session.marker_set, &import.aliases);
    let quality = assess(&trial, Some(&matched), &[], &[], &QualityOptions::default());
    row.frames = Some(trial.markers.n_frames);
    row.rate_hz = Some(trial.markers.rate_hz);
    row.markers = format!("{}/{}", matched.present.len(), matched.present.len() + matched.missing.len());
    row.plates = Some(trial.plates.len());
    row.broken = quality.reasons.iter().any(|r| r.severity() == Severity::Unusable);
    let mut remarks = Vec::new();
    if let Err(e) = fits_enough(&session.marker_set, &Recording::of(entry), &trial, &matched) {
        row.broken = true;
        let path = entry.file.display().to_string();
        // what is missing is in this sentence already
        return Ok(vec![Remark::Broken { problem: e.problem, path, hint: e.hint }]);
    }
    if entry.role.is_dynamic()
        && let Err(e) = low_pass(&session.config.filter).describe(trial.markers.rate_hz)
    {
        row.broken = true;
        remarks.push(Remark::Broken { problem: format!("`filter`: {e}"), path: String::new(), hint: None });
    }
    // lengths in another unit are no noise of the markers
    if session.object.is_none()
        && session.osim.is_none()
        && let Err(e) = check_span(&trial, trial.markers.n_frames / 2)
    {
        row.broken = true;
        let path = entry.file.display().to_string();
        remarks.push(Remark::Broken { problem: e.to_string(), path, hint: None });
        return Ok(remarks);
    }
    remarks.extend(trial.warnings.into_iter().map(Remark::Import));
    remarks.extend(quality.reasons.into_iter().filter(|r| r.severity() != Severity::Note).map(Remark::Quality));
    if !matched.unknown.is_empty() {
        remarks.push(Remark::UnknownLabels(matched.unknown));
    }
    Ok(remarks)
}
