//! Kinematics of each recording, one row each: marker error, flights, free fall.

use aloft_pipeline::stages::STAGES;
use aloft_pipeline::stages::flight::gravity_error_percent;
use aloft_study::subject_session::SubjectSession;
use aloft_workspace::error::{PipelineError, StageFailure};
use aloft_workspace::json::read_json_if_there;
use aloft_workspace::manifest::{Manifest, Outcome};
use aloft_workspace::workspace::Workspace;
use serde::Serialize;

/// One trial's kinematics.
#[derive(Debug, Clone, Serialize)]
pub struct KinematicsRow {
    /// Trial name.
    pub trial: String,
    /// Role.
    pub role: &'static str,
    /// Root mean square marker error, mm.
    pub marker_rms_mm: Option<f64>,
    /// Flights.
    pub flights: Option<u64>,
    /// Mean vertical acceleration of the prior's centre of mass in flight over −g, minus one,
    /// percent.
    pub gravity_error_percent: Option<f64>,
}

/// Marker error, flights and the free-fall check of every dynamic trial.
///
/// # Errors
/// A result of the stage `flight` exists and cannot be read.
pub fn kinematics(session: &SubjectSession, ws: &Workspace) -> Result<Vec<KinematicsRow>, PipelineError> {
    session
        .included()
        .filter(|t| t.role.is_dynamic())
        .map(|t| {
            let failed = failed_stage(ws, &t.name)?.map(|(stage, _)| stage);
            // what later stages left is of an earlier recording or setting
            let valid = |stage: &str| {
                let at = |name: &str| STAGES.iter().position(|s| s.name == name);
                failed.is_none_or(|f| at(stage) < at(f))
            };
            let flights: Option<aloft_flight::FlightReport> =
                read_json_if_there(&ws.place("flight", &t.name).join("flights.json"))?.filter(|_| valid("flight"));
            let ik = ws.manifest("ik", &t.name)?.filter(|_| valid("ik"));
            let gravity_error_percent =
                flights.as_ref().and_then(|r| gravity_error_percent(r, session.facts.gravity_mps2));
            Ok(KinematicsRow {
                trial: t.name.clone(),
                role: t.role.word(),
                marker_rms_mm: ik.and_then(|m| m.summary.get("marker_rms_mm").and_then(serde_json::Value::as_f64)),
                flights: flights.map(|r| r.flights.len() as u64),
                gravity_error_percent,
            })
        })
        .collect()
}

/// The first stage of a trial that failed. Results of later stages, if there are any, are of an
/// earlier run and no longer valid.
///
/// # Errors
/// A manifest is there and cannot be read.
pub fn failed_stage(ws: &Workspace, trial: &str) -> Result<Option<(&'static str, StageFailure)>, PipelineError> {
    for s in STAGES {
        if let Some(Manifest { outcome: Outcome::Failed(f), .. }) = ws.manifest(s.name, trial)? {
            return Ok(Some((s.name, f)));
        }
    }
    Ok(None)
}
