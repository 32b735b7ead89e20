//! `history`: the revisions of a model, and what each of them reached.

use crate::compare::{ComparisonView, JudgedOn, compare, compare_if_made};
use crate::held_out::{HeldOutError, best_grades, weight_n};
use crate::scene::{held, of_coefficients};
use aloft_compare::{POOR_TIMES_FLOOR, significant};
use aloft_effects::ActsIn;
use aloft_identify::Parameters;
use aloft_pipeline::made::{compared_effects, made_with};
use aloft_pipeline::results::parameters_file;
use aloft_robot::joint_fit::JointFit;
use aloft_study::revision::{JointReached, Judged, ModelEffect, Reached, ReachedCoefficient, Revision, Revisions};
use aloft_study::subject_session::SubjectSession;
use aloft_workspace::error::PipelineError;
use aloft_workspace::json::read_json_if_there;
use aloft_workspace::manifest::WHOLE_STUDY;
use aloft_workspace::workspace::Workspace;
use serde::Serialize;
use std::collections::BTreeMap;

/// The ladder as `history --json` shows it.
#[derive(Debug, Clone, Serialize)]
pub struct History {
    /// Version of this structure.
    pub version: u32,
    /// Subject name.
    pub subject: String,
    /// Revisions, oldest first.
    pub revisions: Vec<HistoryRow>,
}

/// One revision.
#[derive(Debug, Clone, Serialize)]
pub struct HistoryRow {
    /// Revision number.
    pub revision: usize,
    /// Action that made it.
    pub action: String,
    /// Effects of the model.
    pub effects: Vec<String>,
    /// Corrections of the recordings, by their keys.
    pub corrections: Vec<&'static str>,
    /// Held-out error over weak windows where the effect acts (`judged_on`), N: root mean square
    /// force, with moments over a lever arm of 0.1 m.
    pub held_out_error: Option<f64>,
    /// The same for the revision before.
    pub held_out_error_before: Option<f64>,
    /// Noise floor, N: the held-out error that a perfect model would leave, simulated from the
    /// errors of the markers and the plates.
    pub noise_floor: Option<f64>,
    /// 95 % interval of the noise floor, N: the range in which the error of a perfect model falls.
    pub noise_floor_ci95: Option<[f64; 2]>,
    /// Held-out error divided by the noise floor.
    pub times_floor: Option<f64>,
    /// True if the held-out error is not above the interval of the noise floor.
    pub at_floor: Option<bool>,
    /// Share of the mean square error that noise does not explain.
    pub explainable: Option<f64>,
    /// Motion on which the held-out error is computed.
    pub judged_on: Option<JudgedOn>,
    /// Held-out error, noise floor and their ratio, in flight and in held-out contact.
    pub errors: Vec<HeldOutError>,
    /// How the trials in the errors differ from those of the revision before, or from those when
    /// this revision was made; none if they are the same or not known.
    pub trials_changed: Option<String>,
    /// Error and noise floor in flight, N.
    pub flight: Option<Judged>,
    /// Error and noise floor in held-out contact, N.
    pub contact: Option<Judged>,
    /// Error in flight, N.
    pub flight_error: Option<f64>,
    /// σ_{N−1}/σ_N.
    pub sigma_ratio: Option<f64>,
    /// Marker error, mean over trials, mm.
    pub marker_rms_mm: Option<f64>,
    /// The same for the revision before.
    pub marker_rms_before_mm: Option<f64>,
    /// Coefficients.
    pub coefficients: Vec<HistoryCoefficient>,
    /// Of the last revision: places, lengths and other values that its effects hold.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub held: Vec<HeldValue>,
    /// Held-out errors of the torques of joints whose laws this revision changed, now and before.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub joints: Vec<HistoryJoint>,
    /// Largest change of a base parameter against the revision before: name and change.
    pub largest_change: Option<(String, f64)>,
    /// Change of every base parameter against the revision before: name and change.
    pub base_change: Vec<(String, f64)>,
    /// Reason why the gain does not count; none if it counts.
    pub void: Option<String>,
    /// What explained the recordings as well as an effect of the model when it was added, by the
    /// key of that effect: other effects, or the same effect on other links.
    #[serde(skip_serializing_if = "BTreeMap::is_empty")]
    pub confusable: BTreeMap<String, Vec<String>>,
    /// What the coefficients and their intervals do not show: what else is missing, which
    /// coefficients are outside their physical range, and what explained the recordings as well as
    /// an effect of the model when it was added.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub cautions: Vec<String>,
    /// An effect of the model that the recordings do not show: `discover` had not named it when it
    /// was added, or a coefficient of it is outside its physical range.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub not_shown: Option<String>,
}

/// Torque of a joint whose laws a revision changed.
#[derive(Debug, Clone, Serialize)]
pub struct HistoryJoint {
    /// Held-out error and floor.
    #[serde(flatten)]
    pub now: JointReached,
    /// Held-out error divided by the floor.
    pub times_floor: Option<f64>,
    /// Held-out error of the revision before.
    pub held_out_error_before: Option<f64>,
}

/// One coefficient with its interval.
#[derive(Debug, Clone, Serialize)]
pub struct HistoryCoefficient {
    /// Name.
    pub name: String,
    /// Value.
    pub value: f64,
    /// Standard error.
    pub se: f64,
    /// 95 % interval, the same as in `parameters`; none if the standard error is not known.
    pub ci95: Option<[f64; 2]>,
    /// Unit; empty in models written before units were stored.
    pub unit: String,
}

/// A value of an effect that is not fitted again.
#[derive(Debug, Clone, Serialize)]
pub struct HeldValue {
    /// Name.
    pub name: String,
    /// Value.
    pub value: f64,
    /// Unit.
    pub unit: String,
}

/// Stages whose results the last revision is read from.
pub const READS: [&str; 2] = ["compare", "identify"];

/// Reads the revisions, and adds what the present one reached.
pub fn history(session: &SubjectSession) -> Result<History, PipelineError> {
    let mut all = Revisions::load(&session.workspace)?;
    let ws = Workspace::open(&session.workspace);
    // results of another model do not belong to this revision: keep what was recorded when it was
    // made
    let mut since_made = None;
    if let Some(last) = all.revisions.last_mut()
        && made_for(&ws, &last.effects)?
        && aloft_pipeline::made::as_made(session)?.config.corrections == last.corrections
    {
        let mut now = reached(session, &compare(session)?)?;
        // errors of torques are those of the moment when the revision was made, if its results are
        // still the same
        now.joints = last.reached.iter().filter(|r| r.from == now.from).flat_map(|r| r.joints.clone()).collect();
        since_made = last.reached.as_ref().and_then(|made| trials_changed(made, &now, "when it was made"));
        last.reached = Some(now);
    }
    let acts = |e: &ModelEffect| acts_in(session, e);
    let weight = weight_n(&aloft_pipeline::made::as_made(session)?);
    let mut rows: Vec<HistoryRow> = (0..all.revisions.len()).map(|i| row(&all.revisions, i, &acts, weight)).collect();
    if let Some(last) = rows.last_mut() {
        last.trials_changed = since_made.or(last.trials_changed.take());
        last.held = held(session)?.into_iter().map(|(name, value, unit)| HeldValue { name, value, unit }).collect();
        last.cautions.extend(without_others(session, &last.effects)?);
        if let Some(c) = compare_if_made(session)?.and_then(|view| view.to_correct) {
            let best = best_grades(true, Some(&c));
            last.errors = std::mem::take(&mut last.errors).into_iter().map(|e| e.at_best(&best)).collect();
            last.at_floor = last.at_floor.map(|at| at && !c.void);
        }
    }
    Ok(History { version: 1, subject: session.facts.person.name.clone(), revisions: rows })
}

/// What `discover` found beside an effect of the model and is not in the model: the values and
/// intervals of the answer are those of a model with all of it.
fn without_others(session: &SubjectSession, held: &[String]) -> Result<Option<String>, PipelineError> {
    let Some((d, then)) = crate::answers::earlier(session)? else { return Ok(None) };
    let laws = d.open.iter().filter(|o| o.complete).flat_map(|o| &o.laws).map(|l| &l.id);
    let named: Vec<&String> = d.found.iter().map(|f| &f.key).chain(laws).filter(|k| !then.contains(k)).collect();
    let missing: Vec<String> = named.iter().filter(|k| !held.contains(k)).map(|k| format!("`{k}`")).collect();
    Ok((!missing.is_empty() && missing.len() < named.len()).then(|| {
        format!(
            "these values and intervals are of a model without {}, which `discover` found as well; its own are of the model with all of them",
            missing.join(", ")
        )
    }))
}

/// True if the comparison in a workspace was made with these effects and with the parameters stored
/// next to it.
///
/// # Errors
/// A manifest is there and cannot be read.
pub(crate) fn made_for(ws: &Workspace, effects: &[ModelEffect]) -> Result<bool, PipelineError> {
    let Some(compared) = ws.usable("compare", WHOLE_STUDY)? else { return Ok(false) };
    if compared_effects(&compared).is_none_or(|e| e != effects) {
        return Ok(false);
    }
    for (input, hash) in &compared.inputs {
        if let Some((stage, trial)) = input.split_once('/')
            && ws.manifest(stage, trial)?.is_none_or(|m| m.output != *hash)
        {
            return Ok(false);
        }
    }
    Ok(true)
}

fn acts_in(session: &SubjectSession, effect: &ModelEffect) -> ActsIn {
    let own = session.own_effects.iter().find(|o| o.spec.id == effect.id()).map(|o| o.spec.acts);
    // none: a law that was deleted is in no list; it may act anywhere
    own.or_else(|| aloft_effects::effect(effect.id()).ok().map(|e| e.acts())).unwrap_or(ActsIn::Both)
}

/// Where a revision is judged: where the effects that it changed act, or in flight if they act in
/// both. The first revision is judged where the second is.
fn judged(revisions: &[Revision], i: usize, acts: &dyn Fn(&ModelEffect) -> ActsIn) -> Option<bool> {
    let (a, b) = match i {
        0 => (revisions.first()?, revisions.get(1)?),
        _ => (&revisions[i - 1], &revisions[i]),
    };
    let changed =
        a.effects.iter().filter(|e| !b.effects.contains(e)).chain(b.effects.iter().filter(|e| !a.effects.contains(e)));
    let kinds: Vec<ActsIn> = changed.map(acts).collect();
    if kinds.is_empty() && a.corrections != b.corrections {
        return Some(a.corrections.act_in_flight() || b.corrections.act_in_flight());
    }
    // laws of joints act in no motion of the body; they are judged on torques
    let kinds: Vec<ActsIn> = kinds.into_iter().filter(|k| !k.in_joints()).collect();
    (!kinds.is_empty()).then(|| kinds.iter().any(|k| k.in_flight()))
}

/// Factor by which the marker error may grow before a gain no longer counts.
const WORSE_MARKERS: f64 = 1.02;

/// How the trials in the errors differ; none if they are the same, or not known.
fn trials_changed(before: &Reached, now: &Reached, when: &str) -> Option<String> {
    let (a, b) = (before.trials.as_ref()?, now.trials.as_ref()?);
    let only = |x: &[String], y: &[String]| x.iter().filter(|t| !y.contains(t)).cloned().collect::<Vec<_>>().join(", ");
    let (lost, added) = (only(a, b), only(b, a));
    let parts: Vec<String> = [("without", lost), ("with", added)]
        .into_iter()
        .filter(|(_, names)| !names.is_empty())
        .map(|(word, names)| format!("{word} {names}"))
        .collect();
    (!parts.is_empty()).then(|| format!("the set of trials is not that {when}: now {}", parts.join(" and ")))
}

fn row(revisions: &[Revision], i: usize, acts: &dyn Fn(&ModelEffect) -> ActsIn, weight_n: f64) -> HistoryRow {
    let r = &revisions[i];
    let now = r.reached.as_ref();
    let old = i.checked_sub(1).and_then(|j| revisions[j].reached.as_ref());
    let in_flight = judged(revisions, i, acts);
    let pick = |reached: &Reached| match in_flight {
        Some(true) => reached.flight.or(reached.contact),
        Some(false) => reached.contact.or(reached.flight),
        None => reached.flight.or(reached.contact),
    };
    let on_flight = |reached: &Reached| match in_flight {
        Some(false) => reached.contact.is_none(),
        _ => reached.flight.is_some(),
    };
    let base_change: Vec<(String, f64)> = now
        .zip(old)
        .map(|(n, o)| n.base.iter().zip(&o.base).map(|(a, b)| (a.0.clone(), a.1 - b.1)).collect())
        .unwrap_or_default();
    let largest_change = base_change.iter().max_by(|a, b| a.1.abs().total_cmp(&b.1.abs())).cloned();
    let void = now.zip(old).and_then(|(n, o)| {
        if n.made_with != o.made_with {
            return Some(format!(
                "void: made with other settings or recordings than revision {}, so their errors cannot be compared",
                i - 1
            ));
        }
        (n.marker_rms_mm > WORSE_MARKERS * o.marker_rms_mm).then(|| {
            format!(
                "void: marker error grew from {:.2} to {:.2} mm, so the lower force error came with a worse fit of the markers",
                o.marker_rms_mm, n.marker_rms_mm
            )
        })
    });
    let here = now.and_then(pick);
    let far = here.and_then(|j| j.times_floor()).filter(|times| *times >= POOR_TIMES_FLOOR);
    let still_missing = far.filter(|_| now.is_some_and(|n| !n.coefficients.is_empty())).map(|times| {
        format!(
            "the error is {} times its floor: what is still missing may shift these values beyond their intervals",
            significant(times, 2)
        )
    });
    let outside = now.iter().flat_map(|n| &n.coefficients).filter_map(outside_its_range);
    let cautions = still_missing
        .into_iter()
        .chain(now.and_then(|n| only_together(&n.coefficients)))
        .chain(outside)
        .chain(r.confusable.iter().map(as_well))
        .chain(r.doubted.iter().map(|(key, why)| format!("`discover` had not named `{key}` when it was added: {why}")))
        .collect();
    HistoryRow {
        revision: r.number,
        action: r.action.clone(),
        effects: r.effects.iter().map(|e| e.key.clone()).collect(),
        corrections: r.corrections.keys(),
        held_out_error: here.map(|j| j.error_n),
        held_out_error_before: old.and_then(pick).map(|j| j.error_n),
        noise_floor: here.and_then(|j| j.noise_n),
        noise_floor_ci95: here.and_then(|j| j.noise_ci95),
        times_floor: here.and_then(|j| j.times_floor()),
        at_floor: here.and_then(|j| j.at_floor()),
        explainable: here.and_then(|j| j.explainable()),
        judged_on: now.map(|n| if on_flight(n) { JudgedOn::Flight } else { JudgedOn::Contact }),
        errors: now.map_or(Vec::new(), |n| {
            let places = [("flight", &n.flight), ("contact", &n.contact)];
            places
                .into_iter()
                .filter_map(|(place, j)| Some(HeldOutError::of_revision(place, j.as_ref()?, weight_n)))
                .collect()
        }),
        trials_changed: now
            .zip(old)
            .and_then(|(n, o)| trials_changed(o, n, &format!("of revision {}", i.saturating_sub(1)))),
        flight: now.and_then(|n| n.flight),
        contact: now.and_then(|n| n.contact),
        flight_error: now.and_then(|n| n.flight).map(|j| j.error_n),
        sigma_ratio: now.map(|n| n.sigma_ratio),
        marker_rms_mm: now.map(|n| n.marker_rms_mm),
        marker_rms_before_mm: old.map(|n| n.marker_rms_mm),
        coefficients: now
            .map(|n| {
                let of = |c: &ReachedCoefficient| HistoryCoefficient {
                    name: c.name.clone(),
                    value: c.value,
                    se: c.se,
                    ci95: c.ci95,
                    unit: c.unit.clone(),
                };
                n.coefficients.iter().map(of).collect()
            })
            .unwrap_or_default(),
        held: Vec::new(),
        joints: joints_changed(revisions, i),
        largest_change,
        base_change,
        void,
        confusable: r.confusable.clone(),
        cautions,
        not_shown: not_shown_of(r),
    }
}

/// What it means that some coefficients have no interval beside others that have one.
fn only_together(coefficients: &[ReachedCoefficient]) -> Option<String> {
    let without: Vec<String> =
        coefficients.iter().filter(|c| c.ci95.is_none()).map(|c| format!("`{}`", c.name)).collect();
    let some = !without.is_empty() && without.len() < coefficients.len();
    some.then(|| format!("{} have no interval: the recordings do not determine each of them alone", without.join(", ")))
}

/// [`HistoryRow::not_shown`] of the present model.
pub(crate) fn not_shown(session: &SubjectSession) -> Result<Option<String>, PipelineError> {
    Ok(Revisions::load(&session.workspace)?.revisions.last().and_then(not_shown_of))
}

fn not_shown_of(now: &Revision) -> Option<String> {
    let outside = |e: &ModelEffect| {
        let mut own = now.reached.iter().flat_map(|r| &r.coefficients).filter(|c| c.range.is_some());
        own.any(|c| c.name.strip_prefix(&e.key).is_some_and(|rest| rest.starts_with('.')))
    };
    let found = now.effects.iter().rev().find(|e| now.doubted.contains_key(&e.key) || outside(e))?;
    Some(found.key.clone())
}

/// What it means that a coefficient is outside its physical range; none if it is inside.
fn outside_its_range(c: &ReachedCoefficient) -> Option<String> {
    let range = c.range.as_ref()?;
    Some(format!(
        "{} is {}, outside its physical range ({range}): the recordings do not show this effect with the place and the \
         parameters that it has in the model",
        c.name,
        significant(c.value, 2)
    ))
}

/// What explained the recordings as well as an effect when it was added.
fn as_well((key, others): (&String, &Vec<String>)) -> String {
    let id = |key: &str| key.split('[').next().map(str::to_owned);
    let may = if others.iter().all(|o| id(o) == id(key)) { "act on another link" } else { "be another effect" };
    let others: Vec<String> = others.iter().map(|o| format!("`{o}`")).collect();
    format!("`{key}` may {may}: when it was added, {} explained the recordings as well", others.join(", "))
}

/// Errors of the joints whose laws differ from those of the revision before.
fn joints_changed(revisions: &[Revision], i: usize) -> Vec<HistoryJoint> {
    let Some(before) = i.checked_sub(1).map(|j| &revisions[j]) else { return Vec::new() };
    let now = &revisions[i];
    let differs = |joint: &str| {
        let place = format!("[{joint}]");
        let of = |r: &Revision| r.effects.iter().filter(|e| e.key.ends_with(&place) && e.is_of_joints()).count();
        of(now) != of(before)
    };
    let old = |joint: &str| before.reached.as_ref()?.joints.iter().find(|j| j.joint == joint).map(|j| j.held_out_error);
    let all = now.reached.iter().flat_map(|r| &r.joints).filter(|j| differs(&j.joint));
    all.map(|j| HistoryJoint { times_floor: j.times_floor(), held_out_error_before: old(&j.joint), now: j.clone() })
        .collect()
}

/// What the present results reached.
pub fn reached(session: &SubjectSession, view: &ComparisonView) -> Result<Reached, PipelineError> {
    let session = &aloft_pipeline::made::as_made(session)?;
    let c = &view.comparison;
    let ws = Workspace::open(&session.workspace);
    let place = ws.place("identify", WHOLE_STUDY).join(parameters_file(session.config.regressor.rows));
    let parameters: Option<Parameters> = read_json_if_there(&place)?;
    let rms: Vec<f64> = view.kinematics.iter().filter_map(|k| k.marker_rms_mm).collect();
    let of = |place: &str| {
        c.against_floor.iter().find(|a| a.judged_on == place).map(|a| Judged {
            error_n: a.held_out_error,
            noise_n: a.floor.map(|f| f.noise_floor),
            noise_ci95: a.floor.and_then(|f| f.ci95),
            force_n: a.held_out_force_n,
            moment_nm: a.held_out_moment_nm,
            windows: a.windows,
            gate_passed: Some(view.parameters.gate_passed),
        })
    };
    // laws of joints stand beside the parameters of the body, in the fit of the torques
    let fit = ws.place("identify", WHOLE_STUDY).join("joints.json");
    let laws = read_json_if_there::<JointFit>(&fit)?.map_or(Vec::new(), |fit| fit.laws);
    let half = |ci: [f64; 2]| 0.5 * (ci[1] - ci[0]);
    let laws = laws.into_iter().map(|l| ReachedCoefficient {
        name: l.name,
        value: l.value,
        se: half(l.ci95) / 1.96,
        ci95: Some(l.ci95),
        unit: String::new(),
        range: None,
    });
    let known = if session.effects.is_empty() { BTreeMap::new() } else { of_coefficients(session)? };
    let outside = |name: &str, value: f64| known.get(name).and_then(|(_, range)| out_of(*range, value));
    let unit = |name: &str| known.get(name).map_or(String::new(), |(unit, _)| unit.clone());
    let mut trials: Vec<String> = c.first.trials.iter().map(|t| t.trial.clone()).collect();
    trials.sort();
    Ok(Reached {
        from: ws.output("compare", WHOLE_STUDY)?,
        made_with: made_with(session, &ws)?,
        flight: of("flight"),
        contact: of("contact"),
        sigma_ratio: view.parameters.sigma_ratio,
        marker_rms_mm: rms.iter().sum::<f64>() / rms.len().max(1) as f64,
        // coefficients that the rows do not determine have no value to show
        coefficients: parameters
            .iter()
            .flat_map(|p| &p.effects)
            .filter(|e| e.not_determined.is_none())
            .map(|e| ReachedCoefficient {
                name: e.name.clone(),
                value: e.value,
                se: e.se,
                ci95: e.ci95,
                unit: unit(&e.name),
                range: outside(&e.name, e.value),
            })
            .chain(laws)
            .collect(),
        base: parameters.iter().flat_map(|p| &p.base).map(|b| (b.name.clone(), b.value)).collect(),
        trials: Some(trials),
        joints: Vec::new(),
    })
}

/// A range in words, if a value is outside.
fn out_of([low, high]: [f64; 2], value: f64) -> Option<String> {
    let words = match (low.is_finite(), high.is_finite()) {
        (true, true) => format!("{low} to {high}"),
        (true, false) => format!("at least {low}"),
        _ => format!("at most {high}"),
    };
    (value < low || value > high).then_some(words)
}

/// The study with the effects of its present model, and with the body about which columns of
/// effects are formed: that of the model without effects, as `effect add` stores it.
pub(crate) fn with_reference(session: &SubjectSession) -> Result<SubjectSession, PipelineError> {
    let mut all = Revisions::load(&session.workspace)?;
    let now = reached(session, &compare(session)?)?;
    if let Some(last) = all.revisions.last_mut() {
        last.reached = Some(now);
    }
    Ok(SubjectSession { effects: all.effects(), plain_base: all.plain_base(), ..session.clone() })
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "tests fail by panicking")]
mod tests {
    use super::*;

    fn reached(flight_n: f64, contact_n: f64, marker_rms_mm: f64) -> Reached {
        let judged = |error_n| {
            let (force_n, moment_nm, gate_passed) = (Some(error_n), Some(0.0), Some(true));
            let (noise_n, noise_ci95) = (Some(1.0), Some([0.8, 1.3]));
            Some(Judged { error_n, noise_n, noise_ci95, force_n, moment_nm, windows: 10, gate_passed })
        };
        Reached {
            from: String::new(),
            made_with: String::new(),
            flight: judged(flight_n),
            contact: judged(contact_n),
            sigma_ratio: 30.0,
            marker_rms_mm,
            coefficients: vec![ReachedCoefficient {
                name: "drag.area".into(),
                value: 0.02,
                se: 0.001,
                ci95: Some([0.018, 0.022]),
                unit: "m²".into(),
                range: None,
            }],
            base: vec![("M".into(), 60.0), ("MCx".into(), 0.01 * flight_n)],
            trials: Some(vec!["jump01".into(), "jump02".into()]),
            joints: Vec::new(),
        }
    }

    fn revisions(second: Reached, key: &str) -> Vec<Revision> {
        let revision = |number, effects, reached| Revision {
            number,
            action: String::new(),
            effects,
            reached,
            corrections: Default::default(),
            confusable: Default::default(),
            doubted: Default::default(),
        };
        let effect = ModelEffect { key: key.to_owned(), ..ModelEffect::default() };
        vec![revision(0, Vec::new(), Some(reached(4.0, 6.0, 1.2))), revision(1, vec![effect], Some(second))]
    }

    fn acts(effect: &ModelEffect) -> ActsIn {
        aloft_effects::effect(effect.id()).map(|e| e.acts()).unwrap()
    }

    #[test]
    fn a_revision_is_judged_where_its_effect_acts() {
        for (key, place, before, now) in [
            ("quadratic_drag", "held-out flight", 4.0, 2.0),
            ("residual_contact[foot_l]", "held-out flight", 4.0, 2.0),
            ("plate_tare[plate1]", "held-out contact", 6.0, 3.0),
        ] {
            let all = revisions(reached(2.0, 3.0, 1.2), key);
            let (first, second) = (row(&all, 0, &acts, 600.0), row(&all, 1, &acts, 600.0));
            assert_eq!(second.judged_on.map(JudgedOn::describe), Some(place), "{key}");
            assert_eq!((second.held_out_error_before, second.held_out_error), (Some(before), Some(now)));
            assert_eq!((first.held_out_error, first.judged_on.map(JudgedOn::describe)), (Some(before), Some(place)));
            assert!((second.explainable.unwrap() - (1.0 - 1.0 / now.powi(2))).abs() < 1e-12);
            assert_eq!(second.largest_change.as_ref().map(|c| c.0.as_str()), Some("MCx"));
        }
    }

    #[test]
    fn a_gain_that_comes_with_worse_markers_is_void() {
        let good = row(&revisions(reached(2.0, 3.0, 1.21), "tether"), 1, &acts, 600.0);
        assert!(good.void.is_none());
        let bad = row(&revisions(reached(2.0, 3.0, 1.5), "tether"), 1, &acts, 600.0);
        assert!(bad.void.unwrap().contains("1.20 to 1.50 mm"));
        assert_eq!((bad.marker_rms_before_mm, bad.marker_rms_mm), (Some(1.2), Some(1.5)));
    }

    #[test]
    fn a_change_of_the_trials_is_said() {
        let mut lost = reached(1.0, 1.0, 1.2);
        lost.trials = Some(vec!["jump01".into(), "jump03".into()]);
        let words = row(&revisions(lost.clone(), "tether"), 1, &acts, 600.0).trials_changed.unwrap();
        assert_eq!(words, "the set of trials is not that of revision 0: now without jump02 and with jump03");
        assert!(row(&revisions(reached(1.0, 1.0, 1.2), "tether"), 1, &acts, 600.0).trials_changed.is_none());
        // models written before the trials were stored
        lost.trials = None;
        assert!(row(&revisions(lost, "tether"), 1, &acts, 600.0).trials_changed.is_none());
    }
}
