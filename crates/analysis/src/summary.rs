//! `summary`: one row per trial over all subjects and sessions, with quality-control reasons from a
//! closed list.

use crate::freshness::{NotCurrent, freshness};
use crate::outputs;
use aloft_pipeline::graph::Scope;
use aloft_pipeline::manifests::Manifests;
use aloft_pipeline::stages::STAGES;
use aloft_regressor::weak_windows::force_scale_n;
use aloft_study::data_set::DataSet;
use aloft_study::quote::{self, visible};
use aloft_study::recordings::SessionId;
use aloft_study::subject_session::{Role, SubjectSession, TrialEntry};
use aloft_workspace::disk::{self, Temporary};
use aloft_workspace::error::PipelineError;
use aloft_workspace::limits;
use aloft_workspace::manifest::{Manifest, Outcome, WHOLE_STUDY};
use aloft_workspace::qc::{QcLevel, QcReason};
use aloft_workspace::table::{write_csv, write_frame};
use aloft_workspace::workspace::Workspace;
use polars::prelude::{Column, DataFrame, PolarsError};
use serde::Serialize;
use std::path::{Path, PathBuf};

/// Error as a share of body weight above which the comparison is flagged (Hicks et al., J. Biomech.
/// Eng. 137, 2015, section 4).
const COMPARISON_LIMIT: f64 = 0.05;

/// The table of all trials.
#[derive(Debug, Clone, Serialize)]
pub struct Summary {
    /// Version of this structure.
    pub version: u32,
    /// One row per trial, and one for each subject or session whose trials are not known.
    pub rows: Vec<SummaryRow>,
    /// What each reason that occurs means, and what to do about it.
    pub reasons: Vec<ReasonText>,
    /// Results that differ from what the pipeline and the recordings would give now.
    pub stale: Vec<StaleOf>,
}

/// A result that is not current, with its subject and session.
#[derive(Debug, Clone, Serialize)]
pub struct StaleOf {
    /// Subject.
    pub subject: Option<String>,
    /// Session.
    pub session: Option<String>,
    /// The result.
    #[serde(flatten)]
    pub result: NotCurrent,
}

/// Explanation of a reason.
#[derive(Debug, Clone, Serialize)]
pub struct ReasonText {
    /// Word used in the table.
    pub reason: &'static str,
    /// Number of rows with this reason.
    pub trials: usize,
    /// What it means.
    pub meaning: &'static str,
    /// What to do about it.
    pub advice: &'static str,
}

/// One trial. A value is none if the stage that provides it has no result.
#[derive(Debug, Clone, Default, Serialize)]
pub struct SummaryRow {
    /// Subject.
    pub subject: String,
    /// Session.
    pub session: Option<String>,
    /// Trial, or `_study` for a subject that cannot be processed.
    pub trial: String,
    /// Role.
    pub role: String,
    /// `ok`, `warning`, `failed`, `excluded`.
    pub qc: String,
    /// Reasons, most serious first: words of [`QcReason`].
    pub reasons: Vec<QcReason>,
    /// Length, s.
    pub duration_s: Option<f64>,
    /// Number of markers of the set that were found.
    pub markers: Option<u64>,
    /// Number of markers of the set that are missing.
    pub missing_markers: Option<u64>,
    /// Number of gaps over all markers, as measured.
    pub gaps: Option<u64>,
    /// Longest gap, s.
    pub longest_gap_s: Option<f64>,
    /// Root mean square distance of the static trial's markers from rigid segments, mm (one value
    /// per session).
    pub scaling_error_mm: Option<f64>,
    /// Root mean square marker error of inverse kinematics, mm.
    pub ik_error_mm: Option<f64>,
    /// Frames for which inverse kinematics found no posture.
    pub unsolved_frames: Option<u64>,
    /// Flights.
    pub flights: Option<u64>,
    /// Total time in flight, s.
    pub flight_s: Option<f64>,
    /// Deviation of the mean acceleration of the centre of mass in flight from g, percent.
    pub free_fall_error_percent: Option<f64>,
    /// σ_{N−1}/σ_N of the session's flights (one value per session).
    pub sigma_ratio: Option<f64>,
    /// Held-out error over the weak windows of the trial in flight, N.
    pub flight_error_n: Option<f64>,
    /// The same in contact.
    pub contact_error_n: Option<f64>,
    /// Mean absolute force error of the model against the plates in contact, single frames, N.
    pub contact_force_n: Option<f64>,
    /// The same for moments, N·m.
    pub contact_moment_nm: Option<f64>,
    /// Mean absolute residual force of the model in flight, single frames, N.
    pub flight_force_n: Option<f64>,
    /// The same for moments, N·m.
    pub flight_moment_nm: Option<f64>,
    /// What failed or was left out, in words.
    pub message: Option<String>,
    /// What to do about it.
    pub hint: Option<String>,
    /// Command that repeats only this trial, if something failed.
    pub again: Option<String>,
}

/// Shell command that repeats only one trial (or the study-wide stages of one session); `words`
/// holds the pipeline and the folders.
pub fn again(words: &str, id: &SessionId, trial: &str) -> String {
    let mut chosen = Vec::new();
    let trial = (trial != WHOLE_STUDY).then(|| trial.to_owned());
    for (flag, name) in [("subject", &id.subject), ("session", &id.session), ("trial", &trial)] {
        chosen.extend(name.iter().flat_map(|n| quote::option(flag, &quote::pattern(n))));
    }
    let chosen = quote::line(chosen);
    format!("aloft run {words}{}{chosen}", if chosen.is_empty() { "" } else { " " })
}

/// Builds the table from the results of the stages; `words` holds the pipeline and the folders for
/// the commands that repeat a trial.
pub fn summary(set: &DataSet, words: &str) -> Result<Summary, PipelineError> {
    let (mut rows, mut stale) = (Vec::new(), Vec::new());
    for session in &set.members {
        rows.extend(rows_of(session, words)?);
        let id = &session.id;
        stale.extend(freshness(session)?.stale.into_iter().map(|result| StaleOf {
            subject: id.subject.clone(),
            session: id.session.clone(),
            result,
        }));
    }
    for b in &set.broken {
        rows.push(SummaryRow {
            subject: b.id.subject.clone().unwrap_or_default(),
            session: b.id.session.clone(),
            trial: WHOLE_STUDY.to_owned(),
            reasons: vec![QcReason::SubjectUnknown],
            message: Some(b.failure.problem.clone()),
            hint: b.failure.hint.clone(),
            again: Some(again(words, &b.id, WHOLE_STUDY)),
            ..SummaryRow::default()
        });
    }
    for (id, reason) in &set.excluded {
        rows.push(SummaryRow {
            subject: id.subject.clone().unwrap_or_default(),
            session: id.session.clone(),
            trial: WHOLE_STUDY.to_owned(),
            reasons: vec![QcReason::Excluded],
            message: Some(reason.clone()),
            ..SummaryRow::default()
        });
    }
    for row in &mut rows {
        row.reasons.sort();
        row.reasons.dedup();
        row.qc = row.reasons.iter().map(|r| r.level()).max().unwrap_or(QcLevel::Ok).word().to_owned();
    }
    rows.sort_by(|a, b| (&a.subject, &a.session, &a.trial).cmp(&(&b.subject, &b.session, &b.trial)));
    let reasons = QcReason::ALL
        .iter()
        .map(|r| (r, rows.iter().filter(|row| row.reasons.contains(r)).count()))
        .filter(|(_, n)| *n > 0)
        .map(|(r, trials)| ReasonText { reason: r.code(), trials, meaning: r.meaning(), advice: r.advice() })
        .collect();
    Ok(Summary { version: 1, rows, reasons, stale })
}

/// The rows of one subject or session; `words` holds the pipeline and the folders of printed
/// commands.
pub fn rows_of(session: &SubjectSession, words: &str) -> Result<Vec<SummaryRow>, PipelineError> {
    let ws = Workspace::open(&session.workspace);
    let manifests = Manifests::read_and_examine(session, &ws, STAGES)?;
    let made = aloft_pipeline::made::as_made(session)?;
    let grid = super::status::grid(session, &ws, &manifests)?;
    // after a failed session-wide stage, the trials have no results from later stages
    let failed_study = STAGES.iter().filter(|s| s.scope == Scope::Session).find_map(|s| {
        manifests.get(s.name, WHOLE_STUDY).and_then(|m| match &m.outcome {
            Outcome::Failed(f) => Some((s.name, f.clone())),
            Outcome::Ok => None,
        })
    });
    let name = session.id.subject.clone().unwrap_or_else(|| session.facts.person.name.clone());
    session
        .trials
        .iter()
        .zip(&grid.rows)
        .map(|(trial, cells)| {
            let mut row = SummaryRow {
                subject: name.clone(),
                session: session.id.session.clone(),
                trial: trial.name.clone(),
                role: trial.role.word().to_owned(),
                ..SummaryRow::default()
            };
            if let Some(reason) = &trial.excluded {
                row.reasons.push(QcReason::Excluded);
                row.message = Some(reason.clone());
                return Ok(row);
            }
            figures(&mut row, &made, trial, &manifests)?;
            let is = |word: &str| cells.cells.iter().any(|c| c == word);
            let own = STAGES.iter().find_map(|s| match manifests.get(s.name, &trial.name).map(|m| &m.outcome) {
                Some(Outcome::Failed(f)) if is("failed") => Some((s.name, f)),
                _ => None,
            });
            if let Some((stage, failure)) = own {
                row.reasons.push(failure.reason.unwrap_or(match stage {
                    "import" => QcReason::UnreadableFile,
                    "ik" => QcReason::IkFailed,
                    _ => QcReason::StageFailed,
                }));
                row.message = Some(format!("{stage}: {}", failure.problem));
                row.hint.clone_from(&failure.hint);
                row.again = Some(again(words, &session.id, &trial.name));
            } else if is("blocked") {
                let (stage, failure) = failed_study.clone().unzip();
                row.reasons.push(if stage == Some("scale") { QcReason::ScalingFailed } else { QcReason::Blocked });
                if let (Some(stage), Some(failure)) = (stage, failure) {
                    row.message = Some(format!("{stage}: {}", failure.problem));
                    row.hint = failure.hint;
                }
                row.again = Some(again(words, &session.id, WHOLE_STUDY));
            } else if is("stale") || is("missing") || is("damaged") {
                row.reasons.push(QcReason::NotRun);
            }
            Ok(row)
        })
        .collect()
}

fn number(m: Option<&Manifest>, key: &str) -> Option<f64> {
    m.and_then(|m| m.summary.get(key)).and_then(serde_json::Value::as_f64)
}

fn count(m: Option<&Manifest>, key: &str) -> Option<u64> {
    m.and_then(|m| m.summary.get(key)).and_then(serde_json::Value::as_u64)
}

/// Values of one trial and the reasons that follow from them.
///
/// # Errors
/// The reasons in a manifest cannot be read: the recording would seem to have none.
fn figures(
    row: &mut SummaryRow,
    session: &SubjectSession,
    trial: &TrialEntry,
    manifests: &Manifests,
) -> Result<(), PipelineError> {
    // results of stages after a failed one are of an earlier recording or setting
    let position = |name: &str| STAGES.iter().position(|s| s.name == name);
    let failed = STAGES
        .iter()
        .find(|s| manifests.get(s.name, &trial.name).is_some_and(|m| !m.is_ok()))
        .and_then(|s| position(s.name));
    let valid = |stage: &str| failed.is_none_or(|f| position(stage).is_some_and(|at| at < f));
    let own = |stage: &str| manifests.get(stage, &trial.name).filter(|m| m.is_ok() && valid(stage));
    let once = |stage: &str| manifests.get(stage, WHOLE_STUDY).filter(|m| m.is_ok());
    let import = own("import");
    row.duration_s = number(import, "duration_s");
    row.markers = count(import, "markers");
    row.missing_markers = count(import, "missing_markers");
    row.gaps = count(import, "gaps");
    row.longest_gap_s = number(import, "longest_gap_s");
    for m in [import, own("ik"), own("flight")].into_iter().flatten() {
        let Some(list) = m.summary.get("qc") else { continue };
        let reasons: Vec<QcReason> = serde_json::from_value(list.clone()).map_err(|e| {
            let problem = format!("`{}` of {}: its reasons cannot be read: {e}", m.stage, m.trial);
            PipelineError::request_hint(problem, "another version made this result; `aloft run` makes it again")
        })?;
        row.reasons.extend(reasons);
    }
    row.scaling_error_mm = number(once("scale"), "scaling_error_mm");
    if trial.role == Role::Static && row.scaling_error_mm.is_some_and(|e| e > limits::SCALING_MM) {
        row.reasons.push(QcReason::ScalingErrorLarge);
    }
    let ik = own("ik");
    row.ik_error_mm = number(ik, "marker_rms_mm");
    row.unsolved_frames = count(ik, "unsolved_frames");
    if row.ik_error_mm.is_some_and(|e| e > limits::MARKER_RMS_MM[1]) {
        row.reasons.push(QcReason::IkErrorLarge);
    }
    if row.unsolved_frames.is_some_and(|n| n > 0) {
        row.reasons.push(QcReason::UnsolvedFrames);
    }
    if !trial.role.is_dynamic() {
        return Ok(());
    }
    let flight = own("flight");
    row.flights = count(flight, "flights");
    row.flight_s = number(flight, "flight_s");
    row.free_fall_error_percent = number(flight, "gravity_error_percent");
    if row.free_fall_error_percent.is_some_and(|e| e.abs() > limits::FREE_FALL_PERCENT[1]) {
        row.reasons.push(QcReason::FreeFallOff);
    }
    let rows = session.config.regressor.rows.word();
    let identify = once("identify");
    row.sigma_ratio = number(identify, &format!("sigma_ratio_{rows}"));
    if identify.is_some_and(|m| m.summary.get("gate_passed") == Some(&serde_json::Value::Bool(false))) {
        row.reasons.push(QcReason::WeaklyIdentified);
    }
    let errors = once("compare")
        .filter(|_| failed.is_none())
        .and_then(|m| m.summary.get("trials"))
        .and_then(|t| t.get(&trial.name));
    let error = |phase: &str, what: &str| errors?.get(phase)?.get(what)?.as_f64();
    row.flight_error_n = error("flight", "held_out_error");
    row.contact_error_n = error("contact", "held_out_error");
    row.contact_force_n = error("contact", "force_n");
    row.contact_moment_nm = error("contact", "moment_nm");
    row.flight_force_n = error("flight", "force_n");
    row.flight_moment_nm = error("flight", "moment_nm");
    let weight = force_scale_n(session.facts.person.mass_kg, session.facts.gravity_mps2);
    let judged = once("compare").is_none_or(|m| m.summary.get("judged") != Some(&serde_json::Value::Bool(false)));
    if judged && [row.contact_force_n, row.flight_force_n].iter().flatten().any(|e| *e > COMPARISON_LIMIT * weight) {
        row.reasons.push(QcReason::ComparisonLarge);
    }
    // remarks that no reason of the list covers; import, ik and flight have their own reasons, the
    // first two for markers only
    let robot = session.robot.is_some();
    let covered = |stage: &str| stage == "flight" || (!robot && matches!(stage, "import" | "ik"));
    let remarks = STAGES.iter().any(|s| {
        matches!(s.scope, Scope::Trial(_)) && !covered(s.name) && own(s.name).is_some_and(|m| !m.warnings.is_empty())
    });
    if remarks {
        row.reasons.push(QcReason::Remarks);
    }
    Ok(())
}

impl Summary {
    /// The table as a polars frame: one column per field; reasons separated by `;`.
    pub fn to_frame(&self) -> Result<DataFrame, PolarsError> {
        let text = |f: fn(&SummaryRow) -> Option<String>, name: &str| {
            Column::new(name.into(), self.rows.iter().map(f).collect::<Vec<Option<String>>>())
        };
        let float = |f: fn(&SummaryRow) -> Option<f64>, name: &str| {
            Column::new(name.into(), self.rows.iter().map(f).collect::<Vec<Option<f64>>>())
        };
        let whole = |f: fn(&SummaryRow) -> Option<u64>, name: &str| {
            Column::new(name.into(), self.rows.iter().map(f).map(|n| n.map(|n| n as i64)).collect::<Vec<Option<i64>>>())
        };
        DataFrame::new(
            self.rows.len(),
            vec![
                text(|r| Some(r.subject.clone()), "subject"),
                text(|r| r.session.clone(), "session"),
                text(|r| Some(r.trial.clone()), "trial"),
                text(|r| Some(r.role.clone()), "role"),
                text(|r| Some(r.qc.clone()), "qc"),
                text(|r| Some(codes(&r.reasons, ";")), "reasons"),
                float(|r| r.duration_s, "duration_s"),
                whole(|r| r.markers, "markers"),
                whole(|r| r.missing_markers, "missing_markers"),
                whole(|r| r.gaps, "gaps"),
                float(|r| r.longest_gap_s, "longest_gap_s"),
                float(|r| r.scaling_error_mm, "scaling_error_mm"),
                float(|r| r.ik_error_mm, "ik_error_mm"),
                whole(|r| r.unsolved_frames, "unsolved_frames"),
                whole(|r| r.flights, "flights"),
                float(|r| r.flight_s, "flight_s"),
                float(|r| r.free_fall_error_percent, "free_fall_error_percent"),
                float(|r| r.sigma_ratio, "sigma_ratio"),
                float(|r| r.flight_error_n, "flight_error_n"),
                float(|r| r.contact_error_n, "contact_error_n"),
                float(|r| r.contact_force_n, "contact_force_n"),
                float(|r| r.contact_moment_nm, "contact_moment_nm"),
                float(|r| r.flight_force_n, "flight_force_n"),
                float(|r| r.flight_moment_nm, "flight_moment_nm"),
                text(|r| r.message.clone(), "message"),
                text(|r| r.hint.clone(), "hint"),
                text(|r| r.again.clone(), "again"),
            ],
        )
    }

    /// Writes `summary.csv`, `summary.parquet` and `summary.txt` of a study, each completely or not
    /// at all; returns the path of the CSV file.
    pub fn write(&self, set: &DataSet) -> Result<PathBuf, PipelineError> {
        let folder = &set.workspace;
        let members: Vec<&SubjectSession> = set.members.iter().collect();
        let recording = outputs::begin(folder, &outputs::SUMMARY, &members)?;
        let path = folder.join("summary.csv");
        let wrong = |e: PolarsError| PipelineError::Table { path: path.clone(), problem: e.to_string() };
        let mut frame = self.to_frame().map_err(wrong)?;
        for (name, write) in
            [("summary.csv", write_csv as fn(&mut DataFrame, &Path) -> _), ("summary.parquet", write_frame)]
        {
            let new = Temporary::beside(&folder.join(name))?;
            write(&mut frame, new.path())?;
            new.place()?;
        }
        disk::write_whole(&folder.join("summary.txt"), format!("{}\n", self.to_text()).as_bytes())?;
        recording.done()?;
        Ok(path)
    }

    /// The table as text, followed by the meaning of its reasons.
    pub fn to_text(&self) -> String {
        let several = self.rows.iter().any(|r| r.session.is_some());
        let mut header = vec!["subject"];
        if several {
            header.push("session");
        }
        header.extend([
            "trial",
            "role",
            "markers",
            "gaps",
            "scaling mm",
            "IK mm",
            "flights",
            "fall %",
            "σ ratio",
            "flight N",
            "contact N",
            "qc",
            "reasons",
        ]);
        let mut table: Vec<Vec<String>> = vec![header.into_iter().map(str::to_owned).collect()];
        for r in &self.rows {
            let mut cells = vec![visible(&r.subject)];
            if several {
                cells.push(visible(r.session.as_deref().unwrap_or_default()));
            }
            let markers = match (r.markers, r.missing_markers) {
                (Some(m), Some(n)) => format!("{m}/{}", m + n),
                _ => "–".to_owned(),
            };
            cells.extend([
                visible(&r.trial),
                r.role.clone(),
                markers,
                r.gaps.map_or("–".to_owned(), |n| n.to_string()),
                fixed(r.scaling_error_mm, 1),
                fixed(r.ik_error_mm, 1),
                r.flights.map_or("–".to_owned(), |n| n.to_string()),
                fixed(r.free_fall_error_percent, 1),
                fixed(r.sigma_ratio, 1),
                figure(r.flight_error_n),
                figure(r.contact_error_n),
                r.qc.clone(),
                codes(&r.reasons, " "),
            ]);
            table.push(cells);
        }
        let columns = table[0].len();
        let width = |c: usize| table.iter().map(|row| row.get(c).map_or(0, |s| s.chars().count())).max().unwrap_or(0);
        let widths: Vec<usize> = (0..columns).map(width).collect();
        let left = |c: usize| c < columns - 11 || c >= columns - 2;
        let mut lines: Vec<String> = table
            .iter()
            .map(|row| {
                let cells: Vec<String> = row
                    .iter()
                    .enumerate()
                    .map(|(c, s)| {
                        let pad = " ".repeat(widths[c].saturating_sub(s.chars().count()));
                        if left(c) { format!("{s}{pad}") } else { format!("{pad}{s}") }
                    })
                    .collect();
                cells.join("  ").trim_end().to_owned()
            })
            .collect();
        let n = |word: &str| self.rows.iter().filter(|r| r.qc == word).count();
        lines.push(format!(
            "{} trials: {} ok, {} with warnings, {} failed, {} excluded",
            self.rows.len(),
            n("ok"),
            n("warning"),
            n("failed"),
            n("excluded")
        ));
        for r in &self.reasons {
            lines.push(format!("  {} ({}): {} {}", r.reason, r.trials, r.meaning, r.advice));
        }
        lines.join("\n")
    }
}

fn codes(reasons: &[QcReason], between: &str) -> String {
    reasons.iter().map(|r| r.code()).collect::<Vec<_>>().join(between)
}

fn figure(value: Option<f64>) -> String {
    value.map_or("–".to_owned(), |v| aloft_compare::significant(v, 3))
}

fn fixed(value: Option<f64>, decimals: usize) -> String {
    value.filter(|v| v.is_finite()).map_or("–".to_owned(), |v| format!("{v:.decimals$}"))
}
