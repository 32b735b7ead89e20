//! The data of the page, read from the workspace once.

use aloft_analysis::answers::of_revisions;
use aloft_analysis::compare::{ComparisonView, compare_if_made};
use aloft_analysis::corrections::{Offer, offers};
use aloft_analysis::discover::{Kept, looked_at};
use aloft_analysis::freshness::{Freshness, freshness};
use aloft_analysis::history::{History, history};
use aloft_analysis::kinematics::{KinematicsRow, kinematics};
use aloft_analysis::next_step::is_joint_above;
use aloft_analysis::parameters::{ParametersView, parameters_if_made};
use aloft_analysis::session_check::{SessionCheck, session_check};
use aloft_analysis::summary::rows_of;
use aloft_body::{Motion, Subject};
use aloft_compare::Grade;
use aloft_discover::Discovery;
use aloft_flight::FlightReport;
use aloft_pipeline::stages::STAGES;
use aloft_pipeline::stages::import::ImportRecord;
use aloft_signal::residual_analysis::ResidualAnalysis;
use aloft_study::commands::command;
use aloft_study::revision::Revisions;
use aloft_study::subject_session::{SubjectSession, TrialEntry};
use aloft_workspace::artifact::load_motion;
use aloft_workspace::disk::is_there;
use aloft_workspace::error::{PipelineError, StageFailure};
use aloft_workspace::json::read_json_if_there;
use aloft_workspace::manifest::{Manifest, Outcome, WHOLE_STUDY};
use aloft_workspace::qc::QcReason;
use aloft_workspace::seal;
use aloft_workspace::table::Table;
use aloft_workspace::warning::StageWarning;
use aloft_workspace::workspace::Workspace;
use rayon::prelude::*;
use std::collections::HashMap;
use std::path::Path;

/// A study as the page presents it. A result that does not exist is missing, never an error: the
/// page states that.
pub struct Story<'a> {
    /// The study.
    pub session: &'a SubjectSession,
    /// Its workspace.
    pub ws: Workspace,
    /// Recordings, in the order of the study.
    pub trials: Vec<TrialStory<'a>>,
    /// The model after calibration.
    pub subject: Option<Subject>,
    /// Model against measurement.
    pub comparison: Option<ComparisonView>,
    /// The identified parameters.
    pub found: Option<ParametersView>,
    /// Answers of `discover` for each model of the history: number of the last revision that holds
    /// it, and answer; in the order of these numbers.
    pub discoveries: Vec<(usize, Kept<Discovery>)>,
    /// Hash of the results that `discover` would read.
    pub looked_at: String,
    /// Revisions of the model.
    pub history: History,
    /// What the recordings say about themselves.
    pub checked: SessionCheck,
    /// The corrections that they offer.
    pub offered: Vec<Offer>,
    /// What people wrote about the study.
    pub notes: String,
    /// True if the torque of some joint is above its floor.
    pub joint_above: bool,
    /// Results that are not up to date.
    pub freshness: Freshness,
    /// Failures of study-wide stages.
    pub failures: Vec<(&'static str, StageFailure)>,
}

/// One recording.
pub struct TrialStory<'a> {
    /// Name, role and files.
    pub entry: &'a TrialEntry,
    /// Manifest of the import.
    pub import: Option<Manifest>,
    /// Quality of the recording.
    pub quality: Option<ImportRecord>,
    /// Marker error, flights, free fall.
    pub kinematics: Option<KinematicsRow>,
    /// Joint motion from inverse kinematics; none if it was not solved.
    pub motion: Option<Motion>,
    /// Flights.
    pub flights: Option<FlightReport>,
    /// Residual analysis: what each cut-off would remove.
    pub analysis: Option<ResidualAnalysis>,
    /// Measured and predicted wrench by column.
    pub series: Option<HashMap<String, Vec<f64>>>,
    /// Stages that failed.
    pub failures: Vec<(&'static str, StageFailure)>,
    /// Warnings of the stages.
    pub warnings: Vec<StageWarning>,
    /// Reasons for which the summary warns of the recording.
    pub reasons: Vec<QcReason>,
    /// Error of the model on this recording, where it errs most; none without a floor.
    pub against_floor: Option<TrialAgainstFloor>,
}

/// Error over the windows of one recording beside the study's noise floor, which has no interval
/// for a single recording.
pub struct TrialAgainstFloor {
    /// `flight` or `contact`.
    pub place: &'static str,
    /// Error over floor.
    pub times_floor: f64,
    /// Its grade.
    pub grade: Grade,
}

impl<'a> Story<'a> {
    /// Reads a workspace: `study` with the settings that its results were made with, `now` with the
    /// present ones.
    ///
    /// # Errors
    /// The workspace has no results; a file in it is damaged.
    pub fn read(session: &'a SubjectSession, now: &SubjectSession) -> Result<Self, PipelineError> {
        let ws = Workspace::open(&session.workspace);
        let imported = session.trials.iter().map(|t| ws.manifest("import", &t.name)).collect::<Result<Vec<_>, _>>()?;
        if imported.iter().all(Option::is_none) {
            return Err(PipelineError::request_hint(
                format!("nothing was run in {}", session.workspace.display()),
                format!("run `{}` first", command(session, "run", None)),
            ));
        }
        let freshness = freshness(now)?;
        freshness.refuse_damaged(session, &[])?;
        let rows = kinematics(session, &ws)?;
        let comparison = compare_if_made(session)?;
        let summary = rows_of(now, "")?;
        let trials = session
            .trials
            .par_iter()
            .map(|entry| {
                let mut trial = TrialStory::read(&ws, entry, &rows)?;
                let own = summary.iter().find(|r| r.trial == entry.name);
                trial.reasons = own.map_or_else(Vec::new, |r| r.reasons.clone());
                if trial.failures.is_empty() {
                    trial.against_floor = comparison.as_ref().and_then(|v| against_floor(&v.comparison, &entry.name));
                }
                Ok(trial)
            })
            .collect::<Result<_, PipelineError>>()?;
        let mut failures = Vec::new();
        for s in STAGES {
            if let Some(Manifest { outcome: Outcome::Failed(f), .. }) = ws.manifest(s.name, WHOLE_STUDY)? {
                failures.push((s.name, f));
            }
        }
        let checked = session_check(session)?;
        let joint_above = freshness.is_current() && comparison.is_some() && is_joint_above(session)?;
        Ok(Self {
            trials,
            failures,
            joint_above,
            freshness,
            subject: read_json_if_there(&ws.place("calibrate", WHOLE_STUDY).join("subject.json"))?,
            comparison,
            found: parameters_if_made(session)?,
            offered: offers(session, &checked)?,
            checked,
            notes: aloft_analysis::notes::read(session)?,
            discoveries: discoveries(session)?,
            looked_at: looked_at(session)?,
            history: history(session)?,
            session,
            ws,
        })
    }

    /// Recordings whose motion is analysed and that were not excluded.
    pub fn dynamic(&self) -> impl Iterator<Item = &TrialStory<'a>> {
        self.trials.iter().filter(|t| t.entry.role.is_dynamic() && t.entry.excluded.is_none())
    }

    /// Number of recordings that share the size limit of the page.
    pub fn n_dynamic(&self) -> usize {
        self.dynamic().count().max(1)
    }

    /// The latest answer of `discover`.
    pub fn discovery(&self) -> Option<&Discovery> {
        self.discoveries.last().map(|d| &d.1.answer)
    }
}

/// The larger of a recording's errors over windows in flight and contact, over the floor of the
/// study.
fn against_floor(c: &aloft_compare::Comparison, trial: &str) -> Option<TrialAgainstFloor> {
    let own = c.first.trials.iter().find(|t| t.trial == trial)?;
    let floor = c.noise_floor.as_ref()?;
    let of = |place, errors: &aloft_compare::WindowErrors, floor: Option<aloft_compare::Floor>| {
        let (error, floor) = (errors.size(), floor?.noise_floor);
        let (times_floor, grade) = (error / floor, Grade::of(error, Some(floor), None));
        (errors.windows > 0 && grade != Grade::NotJudged).then_some(TrialAgainstFloor { place, times_floor, grade })
    };
    // contact that took part in identification and that no floor was computed for is not judged
    let contact = if own.held_out_contact { of("contact", &own.contact_weak, floor.contact_floor) } else { None };
    let flight = of("flight", &own.flight_weak, floor.flight_floor);
    [flight, contact].into_iter().flatten().max_by(|a, b| a.times_floor.total_cmp(&b.times_floor))
}

/// The answers stored for each model of the history; if there are none, the latest answer.
fn discoveries(session: &SubjectSession) -> Result<Vec<(usize, Kept<Discovery>)>, PipelineError> {
    let mut all = of_revisions(session)?;
    if all.is_empty()
        && let Some(last) = seal::read_if_there(&session.workspace.join("discovery.json"))?
    {
        let revisions = Revisions::load(&session.workspace)?.revisions.len();
        all.push((revisions.saturating_sub(1), last));
    }
    Ok(all)
}

impl<'a> TrialStory<'a> {
    fn read(ws: &Workspace, entry: &'a TrialEntry, rows: &[KinematicsRow]) -> Result<Self, PipelineError> {
        let name = entry.name.as_str();
        let (mut failures, mut warnings) = (Vec::new(), Vec::new());
        for stage in STAGES {
            let Some(m) = ws.manifest(stage.name, name)? else { continue };
            warnings.extend(m.warnings);
            if let Outcome::Failed(f) = m.outcome {
                failures.push((stage.name, f));
            }
        }
        let series = ws.place("compare", WHOLE_STUDY).join(format!("series_{name}.parquet"));
        // results of a recording that failed are from an earlier run: none of them is shown
        let whole = failures.is_empty();
        let solved = ws.place("ik", name);
        let has = |file: &Path| -> Result<bool, PipelineError> { Ok(whole && is_there(file)?) };
        Ok(Self {
            entry,
            import: ws.manifest("import", name)?,
            quality: read_json_if_there(&ws.place("import", name).join("quality.json"))?,
            kinematics: rows.iter().find(|k| whole && k.trial == name).cloned(),
            motion: if has(&solved.join("motion.json"))? { Some(load_motion(&solved)?) } else { None },
            flights: if whole { read_json_if_there(&ws.place("flight", name).join("flights.json"))? } else { None },
            analysis: if whole {
                read_json_if_there(&ws.place("filter", name).join("residual_analysis.json"))?
            } else {
                None
            },
            series: if has(&series)? { Some(Table::read(&series)?.into_map()) } else { None },
            failures,
            warnings,
            reasons: Vec::new(),
            against_floor: None,
        })
    }

    /// Identifier of the chapter about this recording.
    pub fn anchor(&self) -> String {
        super::wording::anchor("trial", &self.entry.name)
    }

    /// A figure from the manifest of the import.
    pub fn noted(&self, key: &str) -> Option<f64> {
        self.import.as_ref()?.summary.get(key)?.as_f64()
    }

    /// Length, s.
    pub fn duration_s(&self) -> Option<f64> {
        Some(self.noted("frames")? / self.noted("rate_hz")?)
    }

    /// Share of marker samples that were never measured, percent.
    pub fn missing_percent(&self) -> Option<f64> {
        let markers = &self.quality.as_ref()?.quality.markers;
        let present: f64 = markers.iter().map(|m| m.present_fraction).sum();
        (!markers.is_empty()).then(|| 100.0 * (1.0 - present / markers.len() as f64))
    }

    /// Number of flights.
    pub fn n_flights(&self) -> Option<usize> {
        self.flights.as_ref().map(|f| f.flights.len())
    }
}
