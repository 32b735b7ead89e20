//! What the panel shows, as JSON.

use crate::state::{Studio, SwitchState};
use aloft_analysis::promise::settings;
use aloft_analysis::{notes, own_laws};
use aloft_compare::TrialSeries;
use aloft_workspace::error::PipelineError;
use serde_json::{Value, json};

/// Subject, model, switches with what the last discovery said about each, settings, recordings,
/// work.
pub(crate) fn state(studio: &Studio) -> Result<Value, PipelineError> {
    let session = (studio.open)()?.refreshed()?;
    let (switches, without, preparing, problem) = match studio.switch_state() {
        SwitchState::Ready(s, _) => (s.switches().to_vec(), json!(s.without_switch()), false, Value::Null),
        SwitchState::Preparing => (Vec::new(), json!([]), true, Value::Null),
        SwitchState::Without(problem, hint) => {
            (Vec::new(), json!([]), false, json!({"problem": problem, "hint": hint}))
        }
    };
    let mut state = aloft_report::panel_state(&session, &switches)?;
    let trials = session.trials.iter().filter(|t| t.role.is_dynamic());
    let trials = trials.map(|t| json!({"name": t.name, "role": t.role.word(), "excluded": t.excluded}));
    for (name, value) in [
        ("pipeline", json!(session.config_path.display().to_string())),
        ("without_switch", without),
        ("preparing", json!(preparing)),
        ("problem", problem),
        ("settings", json!(settings(&session))),
        ("trials", json!(trials.collect::<Vec<_>>())),
        ("session", json!(session.id.to_string())),
        ("several_subjects", json!(studio.open_set.is_some())),
        ("busy", json!(studio.queue.busy())),
        ("law_words", json!(own_laws::vocabulary(&session)?)),
        ("drafts", json!(studio.drafts().iter().map(|d| &d.spec).collect::<Vec<_>>())),
        ("notes", json!(notes::read(&session)?)),
    ] {
        state[name] = value;
    }
    Ok(state)
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
