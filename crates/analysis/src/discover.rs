//! `discover`: ranks the effects that the model may be missing, from the motion and the flights in
//! the workspace, and tests how well this works on these recordings.

use crate::answers;
use crate::compare::compare_if_made;
use crate::drawn_errors::{contact_rows, drawn};
use crate::held_out::HeldOutError;
use crate::joint_laws::joint_laws;
pub use crate::kept::{Kept, looked_at};
use crate::promise::{Promised, promised};
use crate::question::question;
use crate::repeated::refuse_repeated;
use crate::results::with_results;
use aloft_body::{BaseParameters, Subject};
use aloft_compare::Comparison;
use aloft_discover::{
    Body, ContactRows, DiscoverOptions, Discovery, Found, FoundLaw, HeldOutResult, SelfTest, SelfTestOptions,
    SelfTestProgress, Session, Staged, StagedCoefficient, Told, TrialDraws, TrialInput, Verdict, discover as rank,
    scene_of,
};
use aloft_effects::{Effect, EffectInstance, PlateSeries};
use aloft_flight::{FlightReport, PlateTare, TareSource};
use aloft_identify::{EffectEstimate, LinkPrior, Prior};
use aloft_pipeline::stages::compare::floor_spread;
use aloft_pipeline::trial_rows::TrialRows;
use aloft_regressor::{MatrixNoise, WeakOptions};
use aloft_study::calendar::Calendar;
use aloft_study::effects::KnownEffects;
use aloft_study::effects::asks_session_time;
use aloft_study::revision::ModelEffect;
use aloft_study::subject_session::SubjectSession;
use aloft_workspace::error::PipelineError;
use aloft_workspace::json::read_json_if_there;
use aloft_workspace::manifest::WHOLE_STUDY;
use aloft_workspace::seal;
use aloft_workspace::workspace::Workspace;
use nalgebra::Vector3;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};
use std::sync::{Mutex, PoisonError};

/// Region in which the body moved. The columns of some effects refer to it; it is stored with a
/// discovery for `effect add`.
#[derive(Debug, Clone, Copy, Serialize, Deserialize)]
pub struct Volume {
    /// Centre, world, m.
    pub middle_m: [f64; 3],
    /// Standard deviation of the body's positions about the centre, m.
    pub reach_m: f64,
}

/// Wraps an answer; an error if the results changed while it was computed.
fn kept<T>(session: &SubjectSession, made_from: String, answer: T) -> Result<Kept<T>, PipelineError> {
    if looked_at(session)? != made_from {
        return Err(PipelineError::request_hint(
            format!("the results in {} changed during the analysis", session.workspace.display()),
            "repeat when no run is active",
        ));
    }
    Ok(Kept { made_from, errors_after: Vec::new(), question: None, answer })
}

/// Results of a study, loaded for ranking.
pub struct Evidence {
    rows: Vec<TrialRows>,
    groups: Vec<Option<String>>,
    subject: Subject,
    base: BaseParameters,
    phi: Vec<aloft_body::Phi>,
    prior: Option<Prior>,
    plate_centres_m: Vec<Vector3<f64>>,
    weak: WeakOptions,
}

/// Input of a ranking: the evidence as a session, the effects to try, and the effects of the model.
pub struct RankingInputs<'a> {
    /// Rows and columns.
    pub session: Session<'a>,
    /// Effects to try, the user's own last.
    pub effects: Vec<&'a dyn Effect>,
    /// Effects of the model.
    pub accepted: Vec<EffectInstance<'a>>,
}

impl Evidence {
    /// Loads the results of the earlier stages.
    pub fn load(session: &SubjectSession) -> Result<Self, PipelineError> {
        let (subject, names, rows) = with_results(session, |made| {
            let subject = made.results.load_subject("calibrate")?;
            let load = |name: &String| TrialRows::load(made.results, None, &|| made.calendar(), name, &subject);
            let names: Vec<String> = made.trials.iter().map(|(name, _)| name.clone()).collect();
            let rows = names.par_iter().map(load).collect::<Result<Vec<_>, _>>()?;
            Ok((subject, names, rows))
        })?;
        if let Some(unseen) = subject.model.unseen_parts() {
            return Err(PipelineError::request_hint(
                format!("no effect can be told: {unseen} move unseen, so the equations of the whole body do not hold"),
                "record markers on them, and use the model `human34`",
            ));
        }
        if let Some(points) = &subject.estimated {
            return Err(PipelineError::request_hint(
                format!(
                    "no effect can be told: {} places joints some {:.0} mm from the bones', which looks like an effect in every recording",
                    points.source,
                    1e3 * points.position_sd_m
                ),
                "record with markers where effects or masses are asked for; joint angles and times of flights hold",
            ));
        }
        let groups = names.iter().map(|name| session.trial(name).and_then(|t| t.group.clone())).collect();
        let base = BaseParameters::of(&subject.model);
        let wrong = |e: &dyn std::fmt::Display| PipelineError::request(e.to_string());
        let phi = subject.prior_phi();
        let prior = if session.object.is_some() {
            None
        } else {
            let links = LinkPrior::of_subject(&subject).map_err(|e| wrong(&e))?;
            Some(links.base(&base).map_err(|e| wrong(&e))?)
        };
        let mut rows = rows;
        let plate_centres_m = same_plates(&mut rows);
        let window = session.config.regressor.window_s;
        let weak = WeakOptions { window_s: (window > 0.0).then_some(window), ..WeakOptions::default() };
        Ok(Self { rows, groups, subject, base, phi, prior, plate_centres_m, weak })
    }

    fn body(&self) -> Body<'_> {
        Body {
            model: &self.subject.model,
            base: &self.base,
            phi: &self.phi,
            prior: self.prior.as_ref(),
            mass_kg: self.subject.facts.mass_kg,
            plate_centres_m: &self.plate_centres_m,
        }
    }

    /// Calls `with` on the session of these recordings with all effects that the study knows.
    pub fn with<T>(
        &self,
        session: &SubjectSession,
        with: impl FnOnce(&RankingInputs<'_>) -> Result<T, PipelineError>,
    ) -> Result<T, PipelineError> {
        self.with_progress(session, false, &|_| {}, with)
    }

    /// The same, with the rows along disturbed motions where `disturbs`; `tell` receives how far a
    /// discovery is, and what it knows already.
    fn with_progress<T>(
        &self,
        session: &SubjectSession,
        disturbs: bool,
        tell: &(dyn Fn(Told<'_>) + Sync),
        with: impl FnOnce(&RankingInputs<'_>) -> Result<T, PipelineError>,
    ) -> Result<T, PipelineError> {
        let body = self.body();
        let trials: Vec<TrialInput<'_>> = self
            .rows
            .iter()
            .zip(&self.groups)
            .map(|(r, group)| TrialInput {
                motion: &r.motion,
                stretches: &r.stretches,
                measured: r.wrench.as_deref(),
                plates: &r.plates,
                group: group.as_deref(),
                session_time_s: r.session_time_s,
            })
            .collect();
        let scene = scene_of(&body, &trials);
        let prepared =
            Session::new(&body, &scene, &trials, &self.weak).map_err(|e| PipelineError::request(e.to_string()))?;
        let comparison = compared(session)?;
        let standing = |place: &str| comparison.as_ref().and_then(|c| standing(c, place));
        let wrong = |e: &dyn std::fmt::Display| PipelineError::request(e.to_string());
        let draws_of_motion = if disturbs { MatrixNoise::DRAWS } else { 0 };
        let disturbed = self
            .rows
            .par_iter()
            .map(|r| r.disturbed(draws_of_motion).map_err(|e| wrong(&e.problem)))
            .collect::<Result<Vec<_>, _>>()?;
        let zeros = comparison.as_ref().map(unknown_zeros).unwrap_or_default();
        let prepared = prepared.with_unknown_zeros(&zeros.iter().map(String::as_str).collect::<Vec<_>>());
        let known = KnownEffects::of(&session.own_effects, &scene)?;
        let accepted = session.effects.iter().map(|e| known.choice(&scene, e)).collect::<Result<Vec<_>, _>>()?;
        // laws of joints exert nothing on the body as a whole
        let accepted = accepted.into_iter().filter(|c| !c.effect.acts().in_joints()).collect();
        let prepared = prepared.with_model_error(standing("flight"), standing("contact")).with_progress(tell);
        let draws = drawn(session)?;
        let contact = match standing("contact") {
            Some(e) if e.is_above() => contact_rows(session, &draws)?,
            _ => Vec::new(),
        };
        let borrowed: Vec<TrialDraws<'_>> = draws
            .iter()
            .map(|d| TrialDraws {
                trial: &d.trial,
                centres: &d.centres,
                in_flight: &d.in_flight,
                errors: &d.errors,
                zeros: &d.zeros,
            })
            .collect();
        let rows: Vec<ContactRows<'_>> = contact.iter().map(|(trial, rows)| ContactRows { trial, rows }).collect();
        // rows along the disturbed motions, a pair for each draw; none if a recording has none
        let n = disturbed.iter().map(Vec::len).min().unwrap_or(0);
        let along = |draw: usize, side: usize| {
            let moved: Vec<TrialInput<'_>> =
                trials.iter().zip(&disturbed).map(|(t, of)| TrialInput { motion: &of[draw][side], ..*t }).collect();
            Session::new(&body, &scene, &moved, &self.weak).map_err(|e| wrong(&e))
        };
        let pairs = (0..n).map(|d| Ok([along(d, 0)?, along(d, 1)?])).collect::<Result<Vec<_>, PipelineError>>()?;
        let prepared = prepared.with_disturbed(pairs);
        let spread = floor_spread(session.is_rigid());
        let mut prepared = prepared.with_draws(&borrowed, &rows, spread);
        if disturbs && !prepared.has_draws() {
            prepared = prepared.with_white_noise(&body, &trials, &self.weak).map_err(|e| wrong(&e))?;
        }
        with(&RankingInputs { session: prepared, effects: known.all(), accepted })
    }
}

/// Gives every trial the plates of the whole session, in the order of their names, so that a plate
/// is the same one in every trial: a trial in which one was not recorded reads zero there. Returns
/// the centres, m.
fn same_plates(rows: &mut [TrialRows]) -> Vec<Vector3<f64>> {
    let mut names: Vec<(String, Vector3<f64>)> = Vec::new();
    for row in rows.iter() {
        for (plate, centre) in row.trial.plates.iter().zip(&row.plate_centres_m) {
            if !names.iter().any(|(n, _)| *n == plate.name) {
                names.push((plate.name.clone(), *centre));
            }
        }
    }
    let alike = |row: &TrialRows| {
        row.plates.is_empty() || row.trial.plates.iter().map(|p| &p.name).eq(names.iter().map(|(n, _)| n))
    };
    if rows.iter().all(alike) {
        return names.into_iter().map(|(_, c)| c).collect();
    }
    names.sort_by(|a, b| a.0.cmp(&b.0));
    for row in rows.iter_mut().filter(|r| !r.plates.is_empty()) {
        let frames = row.motion.n_frames();
        let silent =
            || PlateSeries { force_n: vec![Vector3::zeros(); frames], moment_nm: vec![Vector3::zeros(); frames] };
        let own = |name: &String| row.trial.plates.iter().position(|p| p.name == *name);
        row.plates = names.iter().map(|(name, _)| own(name).map_or_else(silent, |i| row.plates[i].clone())).collect();
        row.plate_centres_m = names.iter().map(|(_, centre)| *centre).collect();
    }
    names.into_iter().map(|(_, c)| c).collect()
}

/// True if every recording with plates shows what they read without a load.
fn zeros_are_known(session: &SubjectSession) -> Result<bool, PipelineError> {
    let ws = Workspace::open(&session.workspace);
    let mut tares: Vec<PlateTare> = Vec::new();
    for t in session.included().filter(|t| t.role.is_dynamic()) {
        let own = read_json_if_there::<Vec<PlateTare>>(&ws.place("flight", &t.name).join("tare.json"))?;
        tares.extend(own.into_iter().flatten());
    }
    Ok(!tares.is_empty() && tares.iter().all(|t| t.source != TareSource::None))
}

/// The comparison that the stage `compare` stored; none if nothing was compared.
fn compared(session: &SubjectSession) -> Result<Option<Comparison>, PipelineError> {
    let folder = Workspace::open(&session.workspace).place("compare", WHOLE_STUDY);
    read_json_if_there(&folder.join("comparison.json"))
}

/// Recordings of which the comparison takes a constant of the plates off.
fn unknown_zeros(comparison: &Comparison) -> Vec<String> {
    comparison.first.trials.iter().filter(|t| t.untared).map(|t| t.trial.clone()).collect()
}

/// Held-out error and noise floor that the comparison found in flight or in contact.
fn standing(comparison: &Comparison, place: &str) -> Option<HeldOutResult> {
    let against = comparison.against_floor.iter().find(|a| a.judged_on == place)?;
    let floor = against.floor?;
    Some(HeldOutResult {
        held_out_error: against.held_out_error,
        noise_floor: floor.noise_floor,
        noise_floor_ci95: floor.ci95,
        by_parameters: None,
    })
}

/// A held-out error as the ranking takes it; none without a floor.
fn standing_of(e: &HeldOutError) -> Option<HeldOutResult> {
    let noise_floor = e.noise_floor?;
    Some(HeldOutResult {
        held_out_error: e.held_out_error,
        noise_floor,
        noise_floor_ci95: e.noise_floor_ci95,
        by_parameters: None,
    })
}

/// The effects and laws that were last computed by the stages, and their errors.
type LastComputed = (Vec<Found>, Vec<String>, Vec<HeldOutError>);

/// The discovery as `--json` shows it.
#[derive(Debug, Clone, Serialize)]
pub struct DiscoveryView {
    /// The answer.
    #[serde(flatten)]
    pub discovery: Discovery,
    /// Held-out error, noise floor and their ratio of the present model, in flight and in held-out
    /// contact.
    pub errors: Vec<HeldOutError>,
    /// The same with all effects found added to the model; empty if none was found or if the
    /// results were not up to date.
    pub errors_after: Vec<HeldOutError>,
    /// Parts of the answer that could not be computed, with the reason: the estimates of the
    /// ranking stand in their place, and the answer is not stored. Empty for a whole answer.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub not_computed: Vec<String>,
    /// Why the answer could not be stored; none where it was stored, or where a part is missing.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub not_stored: Option<String>,
}

impl DiscoveryView {
    /// True if the answer is complete and stands in the workspace, so that `effect add` finds it.
    pub fn is_kept(&self) -> bool {
        self.not_computed.is_empty() && self.not_stored.is_none()
    }
}

/// Models that the stages were to compute and could not, each with its reason, once.
#[derive(Default)]
struct NotComputed(Mutex<Vec<String>>);

impl NotComputed {
    /// The model, or none where it cannot be computed; the reason is kept.
    fn or_named(&self, made: Result<Option<Promised>, PipelineError>, what: &[String]) -> Option<Promised> {
        made.unwrap_or_else(|e| {
            let model = format!("the model with {}: ", what.join(" and "));
            let mut all = self.0.lock().unwrap_or_else(PoisonError::into_inner);
            // the same model is asked for more than once
            if !all.iter().any(|line| line.starts_with(&model)) {
                all.push(format!("{model}{e}"));
            }
            None
        })
    }

    fn into_inner(self) -> Vec<String> {
        self.0.into_inner().unwrap_or_else(PoisonError::into_inner)
    }
}

/// Ranks the catalogue and the study's own effects against the present model, and stores the answer
/// next to the results for `effect add` and `report`.
/// `tell` receives how far it is, and what it knows already.
pub fn discover(
    session: &SubjectSession,
    options: &DiscoverOptions,
    tell: &(dyn Fn(Told<'_>) + Sync),
) -> Result<DiscoveryView, PipelineError> {
    refuse_repeated(session)?;
    let (made_from, asked) = (looked_at(session)?, question(session, options)?);
    Evidence::load(session)?
        .with_progress(session, true, tell, |bench| found(session, bench, options, made_from, asked))
}

/// The stored answer for the present model, if it was computed from the present results.
///
/// # Errors
/// The model or the answer is damaged or cannot be read.
pub fn latest(session: &SubjectSession) -> Result<Option<Discovery>, PipelineError> {
    Ok(answers::present(session)?.map(|kept| kept.answer))
}

/// The last stored answer for an earlier model, if it was computed from the present results, with
/// the keys of the effects that this model held.
///
/// # Errors
/// As [`latest`].
pub fn earlier(session: &SubjectSession) -> Result<Option<(Discovery, Vec<String>)>, PipelineError> {
    answers::earlier(session)
}

/// Largest share of the error in contact that laws may leave of what the best effect of the
/// catalogue leaves there, if they are to explain what looks like a wrong mass.
const FAR_LESS: f64 = 0.5;

/// True if what was found leaves far less of the error in contact than each effect of the catalogue
/// by itself, a wrong mass and a gain of the plates among them.
fn least_in_contact(found: &Discovery, before: &[HeldOutError], after: &[HeldOutError]) -> bool {
    let of = |all: &[HeldOutError]| all.iter().find(|e| e.judged_on == "contact").map(|e| e.held_out_error);
    let Some(left) = of(after).zip(of(before)).map(|(a, b)| a / b) else { return false };
    let in_contact = found.candidates.iter().filter(|c| c.judged_on == "contact");
    let best = in_contact.map(|c| c.held_out_ratio).fold(1.0, f64::min);
    left < FAR_LESS * best
}

fn found(
    session: &SubjectSession,
    bench: &RankingInputs<'_>,
    options: &DiscoverOptions,
    made_from: String,
    asked: Option<String>,
) -> Result<DiscoveryView, PipelineError> {
    let ids: Vec<&str> = bench.effects.iter().map(|e| e.id()).collect();
    if let Some(unknown) = options.only.iter().chain(&options.without).find(|n| !ids.contains(&n.as_str())) {
        return Err(PipelineError::request_hint(
            format!("there is no effect `{unknown}`"),
            aloft_study::nearest::hint(unknown, &ids, "there are"),
        ));
    }
    let scene = bench.session.scene();
    let volume = Volume { middle_m: scene.volume_centre_m.into(), reach_m: scene.volume_reach_m };
    let view = compare_if_made(session)?;
    let to_correct = view.as_ref().and_then(|v| v.to_correct.clone());
    let errors = view.map(|v| v.errors).unwrap_or_default();
    let mut options = options.clone();
    if options.only.is_empty() && zeros_are_known(session)? {
        let shown = bench.effects.iter().filter(|e| e.about().shows_unloaded).map(|e| e.id().to_owned());
        options.without.extend(shown);
    }
    let last: Mutex<Option<LastComputed>> = Mutex::new(None);
    let id_of = |l: &&FoundLaw| format!("{} {:?} {}", l.id, l.effect.acts, l.sized_with_contact);
    let ids = |laws: &[&FoundLaw]| laws.iter().map(id_of).collect::<Vec<_>>();
    let not_computed = NotComputed::default();
    let promise = |found: &[Found], laws: &[&FoundLaw]| {
        let keys = found.iter().map(|f| f.key.clone()).chain(laws.iter().map(|l| l.id.clone())).collect::<Vec<_>>();
        not_computed.or_named(promised(session, found, laws, volume), &keys)
    };
    let by_stages = |found: &[Found], laws: &[&FoundLaw]| {
        let made = promise(found, laws)?;
        let of = |place| made.errors.iter().find(|e| e.judged_on == place).and_then(standing_of);
        let coefficient =
            |e: &EffectEstimate| StagedCoefficient { name: e.name.clone(), value: e.value, se: (e.se, e.freedom) };
        let staged = Staged {
            errors: ["flight", "contact"].map(of),
            coefficients: made.coefficients.iter().map(coefficient).collect(),
        };
        *last.lock().unwrap_or_else(PoisonError::into_inner) = Some((found.to_vec(), ids(laws), made.errors));
        Some(staged)
    };
    let prepared = bench.session.clone().with_stages(&by_stages);
    let mut found = rank(&prepared, &bench.effects, &bench.accepted, &options)
        .map_err(|e| PipelineError::request(e.to_string()))?;
    let failed = std::mem::take(&mut found.failed);
    let laws: Vec<&FoundLaw> = found.open.iter().flat_map(|o| &o.laws).collect();
    let done = last.lock().unwrap_or_else(PoisonError::into_inner).take();
    // where the stages cannot compute it, the estimate of the ranking stands
    let same = |effects: &[Found]| {
        effects.len() == found.found.len() && effects.iter().zip(&found.found).all(|(a, b)| a.is_same_effect(b))
    };
    let errors_after = match done.filter(|(effects, with, _)| *with == ids(&laws) && same(effects)) {
        Some((_, _, errors)) => errors,
        None => promise(&found.found, &laws).map(|made| made.errors).unwrap_or_default(),
    };
    if let Some(c) = found.candidates.iter().find(|c| asks_session_time(&c.effect) && c.believed) {
        let calendar = Calendar::of(session, &Workspace::open(&session.workspace))?;
        found.advice.push(format!("`{}` rests on the times of the session, from {}", c.effect, calendar.words));
    }
    let named = matches!(found.verdict, Verdict::Supported | Verdict::OneOf);
    // laws that leave flights at their floor, and contact at its floor or far below what a wrong
    // mass or plate would leave, explain what looks like a wrong mass
    let at_floor = |place| errors_after.iter().any(|e| e.judged_on == place && e.at_floor == Some(true));
    let complete = found.open.as_ref().is_some_and(|o| o.complete && !o.laws.is_empty());
    let by_laws =
        complete && at_floor("flight") && (at_floor("contact") || least_in_contact(&found, &errors, &errors_after));
    // an effect of gravity's size or direction is another name of what has to be corrected
    // none: a law of the user's own is no name of gravity
    let shows = |id: &String| aloft_effects::effect(id).is_ok_and(|e| e.about().shows_in_free_fall);
    let of_gravity = found.effects.iter().any(shows);
    let to_correct = to_correct.filter(|c| c.void || !named || (c.first && of_gravity));
    match to_correct {
        Some(wrong) if by_laws => found.advice.push(format!("if the law is not real: {}", wrong.words)),
        Some(wrong) => {
            // errors that cannot be judged leave nothing unexplained and name nothing, unless the
            // correction is itself one of the effects
            if wrong.void && (found.verdict == Verdict::Unexplained || named && !wrong.offered) {
                found.verdict = Verdict::NotDetectable;
                found.effects.clear();
                found.groups.clear();
                found.candidates.iter_mut().for_each(|c| c.believed = false);
            }
            doubt(&mut found, &wrong.words);
            found.advice.insert(0, wrong.words.clone());
            found.to_correct = Some(wrong.words);
        }
        // free fall is checked without any plate or model: one error of the time base or of the
        // length scale shows up in several effects
        None if of_gravity => found.advice.splice(..0, free_fall(session)?).for_each(drop),
        None => {}
    }
    if found.verdict == Verdict::NothingMissing
        && let Some(words) = errors.iter().find(|e| e.judged_on == "flight").and_then(wide_floor)
    {
        doubt(&mut found, &words);
    }
    // the ranking's own estimate is relative and from other folds; state what the ladder will show
    let judged = found.rounds.first().map(|r| r.judged_on.clone());
    if let Some(e) = errors_after.iter().find(|e| Some(&e.judged_on) == judged.as_ref()) {
        found.held_out_error_after = e.held_out_error;
    }
    for (i, step) in found.ladder.iter_mut().enumerate() {
        let first = found.found.get(..=i).unwrap_or_default();
        // an effect before the last keeps the values that it has beside those after it
        let after = if first.len() == found.found.len() {
            errors_after.clone()
        } else {
            promise(first, &[]).map(|made| made.errors).unwrap_or_default()
        };
        let of = |all: &[HeldOutError]| all.iter().find(|e| e.judged_on == step.judged_on).map(|e| e.held_out_error);
        step.left_of_error = of(&after).zip(of(&errors)).map(|(a, b)| a / b).filter(|share| share.is_finite());
    }
    if let Some(after) = errors_after.iter().find(|e| e.judged_on == "flight").and_then(standing_of) {
        found.restate_laws(&after);
    }
    found.joints = joint_laws(session, &found, &options)?;
    // JSON has no NaN: an error that is no number is not kept
    let mut answer = kept(session, made_from, found)?;
    answer.question = asked;
    answer.errors_after = errors_after.into_iter().filter(|e| e.held_out_error.is_finite()).collect();
    // a part may be missing because of the machine: the next answer may be whole
    let mut not_computed = not_computed.into_inner();
    not_computed.extend(failed.into_iter().map(|why| format!("a model that the ranking tried: {why}")));
    let not_stored = if not_computed.is_empty() { store(session, &answer, volume).err() } else { None };
    Ok(DiscoveryView {
        discovery: answer.answer,
        errors,
        errors_after: answer.errors_after,
        not_computed,
        not_stored: not_stored.map(|e| e.to_string()),
    })
}

/// Stores an answer for `effect add`, `report` and the next time that the same is asked.
fn store(session: &SubjectSession, answer: &Kept<Discovery>, volume: Volume) -> Result<(), PipelineError> {
    seal::write_whole(&session.workspace.join("discovery.json"), answer)?;
    answers::keep(session, answer)?;
    seal::write_whole(&session.workspace.join("discovery_volume.json"), &volume)
}

/// An answer that nothing is missing does not stand beside what contradicts it, and what
/// contradicts it is the first reason why nothing can be said.
fn doubt(found: &mut Discovery, why: &str) {
    if matches!(found.verdict, Verdict::NothingMissing | Verdict::NotDetectable) {
        found.verdict = Verdict::NotDetectable;
        found.words = format!("not detectable: {why}");
    }
}

/// A floor below which more hides than *nothing missing* should mean, in words.
fn wide_floor(e: &HeldOutError) -> Option<String> {
    /// Share of the weight; the same from which `run` asks to check the markers.
    const WIDE: f64 = 0.05;
    let floor_n = e.noise_floor?;
    let share = floor_n / e.held_out_error * e.held_out_error_of_weight?;
    (share > WIDE).then(|| {
        format!(
            "the errors of the markers alone leave {} N in flight, {:.0} % of the weight, and what is smaller cannot be seen",
            aloft_compare::significant(floor_n, 3),
            100.0 * share
        )
    })
}

/// Free acceleration measured by the stage `flight`, if it differs from the stated gravity in most
/// trials with flights.
fn free_fall(session: &SubjectSession) -> Result<Option<String>, PipelineError> {
    let workspace = Workspace::open(&session.workspace);
    let (mut trials, mut words) = (0, Vec::new());
    for trial in session.included() {
        let path = workspace.place("flight", &trial.name).join("flights.json");
        if let Some(fall) = read_json_if_there::<FlightReport>(&path)?.and_then(|report| report.free_fall) {
            trials += 1;
            words.extend(fall.warning().map(|words| (words, fall.size_differs())));
        }
    }
    let (differing, first) = (words.len(), words.into_iter().next());
    Ok(first.filter(|_| 2 * differing > trials).map(|(first, in_size)| {
        let alike = if in_size {
            "`gravity_scale`, `body_mass` and a gain of all plates of the same size"
        } else {
            "`gravity_tilt`, a wind and other constant forces to that side"
        };
        format!("{differing} of {trials} trials with flights: {first}. Correct this first: {alike} then share this one cause")
    }))
}

/// Rejects a user-defined effect whose law gives no numbers on these recordings, since nothing can
/// be computed with it.
pub fn refuse_without_numbers(session: &SubjectSession, effect: &ModelEffect) -> Result<(), PipelineError> {
    if !session.own_effects.iter().any(|o| o.spec.id == effect.id()) {
        return Ok(());
    }
    Evidence::load(session)?.with(session, |bench| {
        let choice = KnownEffects::of(&session.own_effects, bench.session.scene())?;
        let choice = choice.choice(bench.session.scene(), effect)?;
        match bench.session.without_numbers(&choice) {
            Some(why) => Err(PipelineError::request_hint(
                format!("`{}` cannot be added: {why}", effect.key),
                "correct its formulas, so that they hold wherever they act",
            )),
            None => Ok(()),
        }
    })
}

/// How often effects injected into these recordings are identified correctly.
#[derive(Debug, Clone, Serialize)]
pub struct SelfTested {
    /// Version of this structure.
    pub version: u32,
    /// Subject name.
    pub subject: String,
    /// The table.
    pub self_test: SelfTest,
}

/// Injects effects of known size into the study's recordings and tries to find them; the answer is
/// stored next to the results.
pub fn self_test(
    session: &SubjectSession,
    options: &DiscoverOptions,
    told: &(dyn Fn(usize, usize) + Sync),
) -> Result<SelfTested, PipelineError> {
    let made_from = looked_at(session)?;
    Evidence::load(session)?.with_progress(session, true, &|_| {}, |bench| {
        let options = SelfTestOptions { discover: options.clone(), ..SelfTestOptions::default() };
        let each = |p: &SelfTestProgress<'_>| told(p.done, p.of);
        let table = aloft_discover::self_test(&bench.session, &bench.effects, &bench.accepted, &options, &each)
            .map_err(|e| PipelineError::request(e.to_string()))?;
        let out = SelfTested { version: 1, subject: session.facts.person.name.clone(), self_test: table };
        let answer = kept(session, made_from, out)?;
        seal::write_whole(&session.workspace.join("self_test.json"), &answer)?;
        Ok(answer.answer)
    })
}

/// Options that restrict the ranking to some effects, or leave some out; `closed` leaves out the
/// search beyond the catalogue, and `budget_s` limits it.
pub fn options(only: Vec<String>, without: Vec<String>, closed: bool, budget_s: Option<f64>) -> DiscoverOptions {
    DiscoverOptions { only, without, closed, budget_s, ..DiscoverOptions::default() }
}
