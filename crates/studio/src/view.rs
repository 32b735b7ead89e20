//! What the panel shows, as JSON.

use crate::state::{Bench, Studio};
use aloft_analysis::effect::{Asked, history};
use aloft_analysis::freshness::freshness;
use aloft_analysis::promise::settings;
use aloft_compare::TrialSeries;
use aloft_study::subject_session::SubjectSession;
use aloft_workspace::error::PipelineError;
use serde_json::{Value, json};

/// Subject, model, switches with what the last discovery said about each, settings, recordings, work.
pub(crate) fn state(studio: &Studio) -> Result<Value, PipelineError> {
    let session = (studio.open)()?.refreshed()?;
    let fresh = freshness(&session)?;
    let history = history(&session).ok();
    let rungs: Vec<Value> = history
        .iter()
        .flat_map(|h| &h.revisions)
        .map(|r| {
            json!({
                "revision": r.revision, "action": r.action, "effects": r.effects, "errors": r.errors,
                "judged_on": r.judged_on, "void": r.void,
            })
        })
        .collect();
    let (switches, without, preparing, problem) = match studio.bench() {
        Bench::Ready(s, _) => (json!(s.switches()), json!(s.without_switch()), false, Value::Null),
        Bench::Preparing => (json!([]), json!([]), true, Value::Null),
        Bench::Without(problem, hint) => (json!([]), json!([]), false, json!({"problem": problem, "hint": hint})),
    };
    Ok(json!({
        "subject": session.facts.person.name,
        "pipeline": session.config_path.display().to_string(),
        "model": session.effects.iter().map(|e| &e.key).collect::<Vec<_>>(),
        "current": fresh.is_current(),
        "stale": fresh.describe(),
        "revisions": rungs,
        "switches": switches,
        "without_switch": without,
        "preparing": preparing,
        "problem": problem,
        "asked": asked(&session)?,
        "settings": settings(&session),
        "trials": session.trials.iter().filter(|t| t.role.is_dynamic()).map(|t| json!({
            "name": t.name, "role": t.role.word(), "excluded": t.excluded,
        })).collect::<Vec<_>>(),
        "busy": studio.queue.busy(),
    }))
}

/// What the last discovery said; null if nothing was asked.
fn asked(session: &SubjectSession) -> Result<Value, PipelineError> {
    let asked = Asked::read(session)?;
    let Some(d) = &asked.found else { return Ok(Value::Null) };
    let about = d.candidates.iter().filter(|c| !c.placebo).map(|c| {
        json!({
            "key": c.key, "held_out_ratio": finite(c.held_out_ratio), "ci95": c.ci95.map(finite),
            "believed": c.believed, "judged_on": c.judged_on, "family_wise_p": finite(c.family_wise_p),
        })
    });
    Ok(json!({
        "verdict": d.verdict, "words": d.words, "effects": d.effects,
        "found": d.found.iter().map(|f| &f.key).collect::<Vec<_>>(),
        "candidates": about.collect::<Vec<_>>(),
        "of_present_results": asked.is_of(session),
    }))
}

fn finite(x: f64) -> Option<f64> {
    Some(x).filter(|x| x.is_finite())
}

/// Measured and predicted wrench of a recording: root axes about the root origin.
pub(crate) fn curves(series: &TrialSeries) -> Value {
    let predicted = series.predicted.first().map_or(&[][..], Vec::as_slice);
    let component = |i: usize| predicted.iter().map(|w| finite(w[i])).collect::<Vec<_>>();
    json!({
        "trial": series.trial,
        "time_s": series.time_s,
        "predicted": (0..6).map(component).collect::<Vec<_>>(),
    })
}
