//! What was corrected in the measurements and taken off them, for the methods paragraph: a number
//! in a paper is not the measured one unless this says so.

use aloft_compare::{Comparison, RecordingOffset, TrialComparison, significant};
use aloft_flight::{FlightReport, PlateTare, TareSource};
use aloft_study::subject_session::SubjectSession;
use aloft_workspace::error::PipelineError;
use aloft_workspace::json::read_json_if_there;
use aloft_workspace::workspace::Workspace;

/// Most recordings that are named one by one.
const NAMED: usize = 4;

fn figure(x: f64) -> String {
    significant(x, 3)
}

fn vector(v: &[f64; 3]) -> String {
    v.map(figure).join(", ")
}

/// `corrections:` of the pipeline; empty without any.
pub(crate) fn corrected(session: &SubjectSession) -> String {
    let c = &session.config.corrections;
    let keys = c.keys();
    let mut parts = Vec::new();
    if keys.contains(&"plate_delay_s") {
        parts.push(format!("plates {} s late against the cameras", figure(c.plate_delay_s)));
    }
    for (plate, zero) in &c.plate_zero {
        let (force, moment) = (vector(&zero.force_n), vector(&zero.moment_nm));
        parts.push(format!("zero of plate {plate} ({force}) N and ({moment}) N·m about the world origin"));
    }
    if keys.contains(&"vertical_deg") {
        let [x, y] = c.vertical_deg.map(figure);
        parts.push(format!("vertical turned by {x}° about x and {y}° about y"));
    }
    if keys.contains(&"rate_ratio") {
        parts.push(format!("rate of cameras and plates {} times the stated one", significant(c.rate_ratio, 5)));
    }
    if let Some(mass_kg) = c.mass_kg {
        let stated = session.facts.stated_mass_kg.map_or(String::new(), |kg| format!(" instead of {kg} kg as stated"));
        parts.push(format!("body mass {mass_kg} kg{stated}"));
    }
    if parts.is_empty() { String::new() } else { format!(" The recordings were corrected: {}.", parts.join("; ")) }
}

/// How the zeros of the plates were found, and the force that was taken off; empty without plates.
///
/// # Errors
/// Results that are damaged.
pub(crate) fn tared(session: &SubjectSession, ws: &Workspace) -> Result<String, PipelineError> {
    let mut all: Vec<(String, PlateTare)> = Vec::new();
    for trial in session.included().filter(|t| t.role.is_dynamic()) {
        let path = ws.place("flight", &trial.name).join("flights.json");
        if let Some(report) = read_json_if_there::<FlightReport>(&path)? {
            all.extend(report.tare.into_iter().map(|tare| (trial.name.clone(), tare)));
        }
    }
    let of = |source: TareSource, words: &str| {
        let own: Vec<&(String, PlateTare)> = all.iter().filter(|(_, t)| t.source == source).collect();
        let mut trials: Vec<&str> = own.iter().map(|(trial, _)| trial.as_str()).collect();
        trials.dedup();
        let forces = own.iter().flat_map(|(_, t)| &t.force_n).map(|f| f.norm()).filter(|f| f.is_finite());
        let [least, most] = forces.fold([f64::INFINITY, 0.0_f64], |[a, b], f| [a.min(f), b.max(f)]);
        (!trials.is_empty())
            .then(|| format!("{words} in {} ({} to {} N)", count(trials.len()), figure(least), figure(most)))
    };
    let parts: Vec<String> = [
        of(TareSource::Flights, "from their readings during flights"),
        of(TareSource::OwnReadings, "from their own quiet readings"),
    ]
    .into_iter()
    .flatten()
    .collect();
    if parts.is_empty() {
        return Ok(String::new());
    }
    Ok(format!(" Readings of unloaded plates were subtracted, {}.", parts.join(", ")))
}

/// Constants that were subtracted from recordings whose plates were never unloaded, and the error
/// as measured; empty without such recordings.
pub(crate) fn subtracted(c: &Comparison) -> String {
    let model = &c.first;
    let of = |t: &TrialComparison| t.offset.as_ref().filter(|_| t.contact.frames > 0).cloned();
    let all: Vec<(&str, RecordingOffset)> =
        model.trials.iter().filter_map(|t| Some((t.trial.as_str(), of(t)?))).collect();
    if all.is_empty() {
        return String::new();
    }
    let each: Vec<String> = all
        .iter()
        .map(|(trial, o)| format!("{trial}: ({}) N and ({}) N·m", vector(&o.force_n), vector(&o.moment_nm)))
        .collect();
    let sizes = if each.len() <= NAMED {
        format!(" ({})", each.join("; "))
    } else {
        let force = all.iter().map(|(_, o)| o.force_n.iter().map(|x| x * x).sum::<f64>().sqrt());
        let [least, most] = force.fold([f64::INFINITY, 0.0_f64], |[a, b], f| [a.min(f), b.max(f)]);
        format!(" (forces of {} to {} N)", figure(least), figure(most))
    };
    let mut t = format!(
        " In {} the plates were never unloaded, so that their zero is not known: for each model a constant wrench about the world origin, \
         fitted to the difference between plates and model, was subtracted{sizes}. A constant error of the model of this size would not \
         show.",
        count(all.len())
    );
    let (weak, frames) = (&model.held_out_weak_as_measured, &model.held_out_as_measured);
    if model.trials.iter().any(|t| t.held_out_contact && t.offset.is_some()) {
        if weak.windows > 0 {
            t.push_str(&format!(
                " As measured, without this subtraction, the error in held-out contact was {} N.",
                figure(weak.size())
            ));
        } else if frames.frames > 0 {
            t.push_str(&format!(
                " As measured, without this subtraction, the mean absolute error on single frames of held-out contact was {} N.",
                figure(frames.force_n.mean_mae())
            ));
        }
    }
    t
}

fn count(recordings: usize) -> String {
    if recordings == 1 { "one recording".to_owned() } else { format!("{recordings} recordings") }
}
