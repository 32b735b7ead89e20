//! `corrections:` of a pipeline: what the session check offers, and the rung of the ladder that
//! corrections make.
//!
//! Nothing is corrected unless the user writes it into the pipeline. A run with other corrections
//! than the last revision has is a revision of its own: the effects stay, the measurements change.

use crate::compare::compare_if_made;
use crate::explanations::key_may_change;
use crate::history::{made_for, reached};
use crate::session_check::{LineStatus, SessionCheck, SessionLine};
use aloft_flight::{FlightReport, PlateTare, TareSource};
use aloft_pipeline::made::as_made;
use aloft_study::config::CorrectionsConfig;
use aloft_study::revision::{Revision, Revisions};
use aloft_study::subject_session::SubjectSession;
use aloft_trial::vertical_of_fall;
use aloft_workspace::error::PipelineError;
use aloft_workspace::json::read_json_if_there;
use aloft_workspace::workspace::Workspace;
use nalgebra::Vector3;
use serde::Serialize;
use std::collections::BTreeMap;
use std::fmt::Write;

/// A correction that the recordings offer.
#[derive(Debug, Clone, Serialize)]
pub struct Offer {
    /// Key under `corrections`.
    pub key: &'static str,
    /// The lines to write there, YAML without indentation.
    pub yaml: String,
    /// The measurement that it rests on, and what else could explain it.
    pub evidence: String,
}

/// Least scatter between recordings, N, below which a plate's zero counts as one value.
const SAME_ZERO_N: f64 = 3.0;
/// Smallest zero worth correcting, N.
const LEAST_ZERO_N: f64 = 2.0;

/// True if an effect of the model may be the reason of a difference.
fn may_be_an_effect(session: &SubjectSession, line: &str) -> bool {
    session.effects.iter().any(|e| key_may_change(&e.key, line))
}

/// The corrections that a session's measurements offer; those that its results already contain are
/// not offered again, since the measurements then agree. The measurements do not use the model, so
/// what an effect of the model may have caused is not offered ([`crate::explanations`]).
///
/// # Errors
/// A result is there and cannot be read.
pub fn offers(session: &SubjectSession, check: &SessionCheck) -> Result<Vec<Offer>, PipelineError> {
    let mut out = Vec::new();
    let differs = |l: &&SessionLine| l.status == LineStatus::Differs && !may_be_an_effect(session, l.id);
    let line = |id: &str| check.lines.iter().filter(differs).find(|l| l.id == id);
    let interval = |l: &SessionLine| {
        l.ci95.map_or(String::new(), |[a, b]| {
            let d = l.digits();
            format!(" (95 %: {a:.d$} to {b:.d$})")
        })
    };
    let applied = &session.config.corrections;
    if let Some(l) = line("plate_delay") {
        let total = applied.plate_delay_s + 1e-3 * l.value;
        out.push(Offer {
            key: "plate_delay_s",
            yaml: format!("plate_delay_s: {total:.4}"),
            evidence: format!(
                "plates {} by {:.1} ms{} in {} contacts between flights",
                if l.value > 0.0 { "late" } else { "early" },
                l.value.abs(),
                interval(l),
                l.n
            ),
        });
    }
    if let Some(l) = line("impulse_mass") {
        out.push(Offer {
            key: "mass_kg",
            yaml: format!("mass_kg: {:.2}", l.value),
            evidence: format!(
                "impulse between flights gives {:.2} kg{} against {:.2} kg stated, in {} contacts; a gain of all plates of {:+.1} % \
                 explains it as well",
                l.value,
                interval(l),
                l.expected.unwrap_or(f64::NAN),
                l.n,
                100.0 * (l.value / l.expected.unwrap_or(f64::NAN) - 1.0)
            ),
        });
    }
    out.extend(plate_zeros(session)?);
    if let Some(l) = line("vertical")
        && let Some(fall) = mean_fall(session)?
        && let Some([x, y]) = vertical_of_fall(&fall)
    {
        let [a, b] = applied.vertical_deg;
        out.push(Offer {
            key: "vertical_deg",
            yaml: format!("vertical_deg: [{:.3}, {:.3}]", a + x, b + y),
            evidence: format!("free fall leans by {:.2}°{} against the stated vertical", l.value, interval(l)),
        });
    }
    if let Some(l) = line("free_fall")
        && l.value > 0.0
    {
        let ratio = 1.0 / l.value.sqrt();
        let total = ratio * if applied.rate_ratio > 0.0 { applied.rate_ratio } else { 1.0 };
        out.push(Offer {
            key: "rate_ratio",
            yaml: format!("rate_ratio: {total:.5}"),
            evidence: format!(
                "free fall is {:.4} g{} in {} recordings; lengths that are wrong by the factor {:.4}, or a steady support, explain it as \
                 well",
                l.value,
                interval(l),
                l.n,
                l.value
            ),
        });
    }
    Ok(out)
}

/// Force, N, and moment, N·m, of an unloaded plate.
type Reading = (Vector3<f64>, Vector3<f64>);

/// Zeros of plates that are never unloaded in some recordings and agree among the others.
fn plate_zeros(session: &SubjectSession) -> Result<Option<Offer>, PipelineError> {
    let ws = Workspace::open(&session.workspace);
    let mut known: BTreeMap<String, Vec<Reading>> = BTreeMap::new();
    let mut unknown: BTreeMap<String, Vec<String>> = BTreeMap::new();
    for trial in session.included().filter(|t| t.role.is_dynamic()) {
        if ws.manifest_if_there("flight", &trial.name)?.is_none_or(|m| !m.is_ok()) {
            return Ok(None);
        }
        let tares: Option<Vec<PlateTare>> = read_json_if_there(&ws.place("flight", &trial.name).join("tare.json"))?;
        let Some(tares) = tares else { return Ok(None) };
        for t in tares {
            if t.source == TareSource::None {
                unknown.entry(t.plate).or_default().push(trial.name.clone());
            } else {
                let mean = |v: &[Vector3<f64>]| v.iter().sum::<Vector3<f64>>() / v.len().max(1) as f64;
                known.entry(t.plate.clone()).or_default().push((mean(&t.force_n), mean(&t.moment_nm)));
            }
        }
    }
    let (mut yaml, mut evidence) = (String::from("plate_zero:"), Vec::new());
    for (plate, trials) in &unknown {
        let Some(values) = known.get(plate) else { continue };
        let n = values.len() as f64;
        let force = values.iter().map(|v| v.0).sum::<Vector3<f64>>() / n;
        let moment = values.iter().map(|v| v.1).sum::<Vector3<f64>>() / n;
        let scatter = values.iter().map(|v| (v.0 - force).norm()).fold(0.0, f64::max);
        if force.norm() < LEAST_ZERO_N || scatter > SAME_ZERO_N {
            continue;
        }
        // what was taken off at import comes on top
        let before = session.config.corrections.plate_zero.get(plate).copied().unwrap_or_default();
        let (force, moment) = (force + Vector3::from(before.force_n), moment + Vector3::from(before.moment_nm));
        let list = |v: &Vector3<f64>| format!("[{:.2}, {:.2}, {:.2}]", v.x, v.y, v.z);
        let name = aloft_study::quote::yaml(plate);
        let _ = write!(yaml, "\n  {name}: {{force_n: {}, moment_nm: {}}}", list(&force), list(&moment));
        evidence.push(format!(
            "{plate} reads {:.1} N unloaded in {} recordings (within {scatter:.1} N) and is never unloaded in {}",
            force.norm(),
            values.len(),
            trials.join(", ")
        ));
    }
    Ok((!evidence.is_empty()).then(|| Offer { key: "plate_zero", yaml, evidence: evidence.join("; ") }))
}

/// Mean acceleration in flight over all recordings, m/s².
fn mean_fall(session: &SubjectSession) -> Result<Option<Vector3<f64>>, PipelineError> {
    let ws = Workspace::open(&session.workspace);
    let (mut sum, mut n) = (Vector3::zeros(), 0.0);
    for trial in session.included().filter(|t| t.role.is_dynamic()) {
        let report: Option<FlightReport> = read_json_if_there(&ws.place("flight", &trial.name).join("flights.json"))?;
        let Some(fall) = report.and_then(|r| r.free_fall) else { continue };
        sum += Vector3::from(fall.acceleration_mps2) * fall.flights as f64;
        n += fall.flights as f64;
    }
    Ok((n > 0.0).then(|| sum / n))
}

/// The offers as a block of the pipeline, with the evidence as comments.
pub fn to_yaml(offers: &[Offer]) -> String {
    let mut text = String::from("corrections:\n");
    for offer in offers {
        let _ = writeln!(text, "  # {}", offer.evidence);
        for line in offer.yaml.lines() {
            let _ = writeln!(text, "  {line}");
        }
    }
    text
}

/// Before a run that will change the corrections: keeps what the present results reached, which
/// the run replaces.
pub fn keep_reached(session: &SubjectSession) -> Result<(), PipelineError> {
    let mut all = Revisions::load(&session.workspace)?;
    let ws = Workspace::open(&session.workspace);
    let made = as_made(session)?.config.corrections;
    let Some(last) = all.revisions.last_mut() else { return Ok(()) };
    if session.config.corrections == last.corrections || made != last.corrections || !made_for(&ws, &last.effects)? {
        return Ok(());
    }
    let Some(view) = compare_if_made(session)? else { return Ok(()) };
    last.reached = Some(reached(session, &view)?);
    all.save(&session.workspace)
}

/// After a run: corrections that the last revision does not have make a new one.
pub fn add_rung(session: &SubjectSession) -> Result<Option<String>, PipelineError> {
    let mut all = Revisions::load(&session.workspace)?;
    let ws = Workspace::open(&session.workspace);
    let Some(last) = all.revisions.last() else { return Ok(None) };
    let made = as_made(session)?.config.corrections;
    if made == last.corrections || !made_for(&ws, &last.effects)? {
        return Ok(None);
    }
    if last.reached.is_none() {
        // nothing was reached without them: there is no rung below
        if let Some(last) = all.revisions.last_mut() {
            last.corrections = made;
        }
        all.save(&session.workspace)?;
        return Ok(None);
    }
    let action = action(&last.corrections, &made);
    let next = Revision { corrections: made, ..all.next(action.clone(), last.effects.clone()) };
    all.revisions.push(next);
    all.save(&session.workspace)?;
    Ok(Some(action))
}

/// What changed, as the ladder shows it.
fn action(before: &CorrectionsConfig, now: &CorrectionsConfig) -> String {
    let (a, b) = (before.keys(), now.keys());
    let added: Vec<&str> = b.iter().filter(|k| !a.contains(k)).copied().collect();
    let removed: Vec<&str> = a.iter().filter(|k| !b.contains(k)).copied().collect();
    match (added.as_slice(), removed.as_slice()) {
        ([], []) => format!("correct {} anew", b.join(", ")),
        ([], gone) => format!("without the correction of {}", gone.join(", ")),
        (new, []) => format!("correct {}", new.join(", ")),
        (new, gone) => format!("correct {} instead of {}", new.join(", "), gone.join(", ")),
    }
}
