//! Effects as switches: what the held-out error, the parameters and the coefficients of the model
//! are with any choice of effects, within a fraction of a second and with the numbers that `effect
//! add` gives.
//!
//! [`Switches::prepare`] forms the columns of every effect once, beside those of the body: in the
//! triangle of each flight, from which parameters are identified, and in the weak windows, in which
//! models are judged. A choice of effects then picks columns. Nothing else differs from the stages
//! `regressor`, `identify` and `compare`: each trial is predicted from parameters that were
//! identified without it. Only the weight of the prior is that of the present model, and of contact
//! where both use it; a run would choose these again.

use crate::compare::compare;
use crate::effect::Asked;
use crate::held_out::{HeldOutError, best_grades, weight_n};
use crate::history::with_reference;
use crate::results::with_results;
use crate::switch_contact::uses_contact;
use crate::switch_pools::{Merged, Pool, Pools};
use crate::switch_rows::{Judged, drop_without_numbers, params_of, rows_of};
use aloft_body::Subject;
use aloft_compare::{AgainstFloor, Candidate, Graded, NoiseFloor, TrialSeries, size_of_windows};
use aloft_identify::Parameters;
use aloft_pipeline::plate_zeros::SessionZeros;
use aloft_pipeline::stages::compare::{self as stage, ComparedTrial, Floor, HeldOut};
use aloft_pipeline::stages::identify::{PointEstimate, Predicting};
use aloft_pipeline::trial_rows::TrialRows;
use aloft_regressor::{Factor, StretchKind, limits};
use aloft_study::config::Rows;
use aloft_study::effects::{KnownEffects, OwnEffect};
use aloft_study::revision::ModelEffect;
use aloft_study::subject_session::SubjectSession;
use aloft_workspace::disk::{is_there, read};
use aloft_workspace::error::{PipelineError, StageFailure};
use aloft_workspace::manifest::WHOLE_STUDY;
use aloft_workspace::workspace::Workspace;
use nalgebra::Vector6;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};
use std::collections::HashMap;
use std::sync::{Arc, Mutex, PoisonError};

/// Where an effect comes from.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum From {
    /// The catalogue.
    Catalogue,
    /// The pipeline, or the folder `effects` beside it.
    Own,
    /// A law that the last discovery found.
    Found,
    /// Written in the page and not kept yet.
    Draft,
}

/// What a model is identified and judged without.
#[derive(Debug, Clone, Default, PartialEq, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct LeftOut {
    /// Whole trials.
    pub trials: Vec<String>,
    /// Stretches of time: flights that they touch do not identify, windows whose middle is in them
    /// do not judge.
    pub stretches: Vec<Cut>,
}

/// A stretch of time in a trial, s since its first frame.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Cut {
    /// Trial.
    pub trial: String,
    /// Begin.
    pub from_s: f64,
    /// End.
    pub to_s: f64,
}

impl LeftOut {
    fn cuts<'a>(&'a self, trial: &'a str) -> impl Iterator<Item = &'a Cut> + 'a {
        self.stretches.iter().filter(move |c| c.trial == trial)
    }

    /// True if a factor of one of these trials takes part in identification.
    fn keeps(&self, f: &Factor, trials: &[Judged]) -> bool {
        let flights = trials.iter().find(|t| t.name == f.trial).map_or(&[][..], |t| &t.flights_s);
        let flight = if f.kind == StretchKind::Flight { flights.get(f.stretch) } else { None };
        let touched = flight.is_some_and(|[a, b]| self.cuts(&f.trial).any(|c| c.from_s < *b && c.to_s > *a));
        !self.trials.contains(&f.trial) && !touched
    }
}

/// An effect that can be switched on.
#[derive(Debug, Clone, Serialize)]
pub struct Switch {
    /// Key of the effect with its target, as accepted by `effect add`.
    pub key: String,
    /// Short title of the effect.
    pub title: String,
    /// True if the present model holds it.
    pub in_model: bool,
    /// Names of its coefficients with their units.
    pub coefficients: Vec<(String, String)>,
    /// Values of its nonlinear parameters, as the last discovery found them.
    pub nonlinear: Vec<(String, f64)>,
    /// Where it comes from.
    pub from: From,
}

/// An effect without a switch, and why.
#[derive(Debug, Clone, Serialize)]
pub struct WithoutSwitch {
    /// Key of the effect.
    pub key: String,
    /// Reason.
    pub because: String,
}

/// A model with the chosen effects.
#[derive(Debug, Clone, Serialize)]
pub struct Switched {
    /// Keys of its effects.
    pub effects: Vec<String>,
    /// Held-out error, noise floor and their ratio, in flight and in held-out contact.
    pub errors: Vec<HeldOutError>,
    /// Coefficients of its effects by name.
    pub coefficients: Vec<(String, f64)>,
    /// Base parameters: name, value, unit.
    pub base: Vec<(String, f64, String)>,
    /// Held-out error of each trial, N.
    pub trials: Vec<TrialError>,
    /// Trials that could not be predicted without their own flights.
    pub remarks: Vec<String>,
}

/// Held-out error of one trial over its weak windows, N.
#[derive(Debug, Clone, Serialize)]
pub struct TrialError {
    /// Trial.
    pub trial: String,
    /// In flight; none without flights, or if its flights are not held out.
    pub flight: Option<f64>,
    /// In contact; none without plates, or if its contact is not held out.
    pub contact: Option<f64>,
    /// True if it was left out of the study.
    pub left_out: bool,
}

/// The effects of a study as switches.
pub struct Switches {
    pub(crate) session: SubjectSession,
    pub(crate) subject: Subject,
    pub(crate) predicting: Predicting,
    pub(crate) parameters: Parameters,
    pub(crate) floor: Option<NoiseFloor>,
    switches: Vec<Switch>,
    without_switch: Vec<WithoutSwitch>,
    /// Effects with columns, in the order of the switches.
    pub(crate) effects: Vec<ModelEffect>,
    /// Names of the columns of each effect.
    pub(crate) columns: Vec<Vec<String>>,
    pub(crate) training: Vec<Factor>,
    pub(crate) pools: Pools,
    /// Pools without what was left out last, for the next flip.
    other: Mutex<Option<(LeftOut, Arc<Pools>)>>,
    pub(crate) trials: Vec<Judged>,
    /// The best grades that errors may have.
    pub(crate) best: Vec<Graded>,
    /// Whether contact takes part in the identification of the present model.
    pub(crate) contact: bool,
    /// Weights of contact of models that use it where the present one does not, by their effects.
    pub(crate) weights: Mutex<HashMap<Vec<String>, Option<f64>>>,
    /// Keys of the present model's effects.
    pub(crate) present: Vec<String>,
    /// Keys of the effects that the last discovery found.
    pub(crate) found: Vec<String>,
}

/// Hash of what switches depend on: the comparison and all that it was made from, the model, the
/// last discovery, and the laws of the user's own.
pub fn fingerprint(session: &SubjectSession, drafts: &[OwnEffect]) -> Result<String, PipelineError> {
    let ws = Workspace::open(&session.workspace);
    let mut hasher = blake3::Hasher::new();
    for stage in ["compare", "identify"] {
        hasher.update(ws.output(stage, WHOLE_STUDY)?.as_bytes());
    }
    for file in ["model.json", "discovery.json"] {
        let path = session.workspace.join(file);
        if is_there(&path)? {
            hasher.update(&read(&path)?);
        }
        hasher.update(&[0]);
    }
    for own in session.own_effects.iter().chain(drafts) {
        hasher.update(OwnEffect::text_of(&own.spec)?.as_bytes());
    }
    Ok(hasher.finalize().to_hex().to_string())
}

pub(crate) fn stop(e: impl std::fmt::Display) -> StageFailure {
    StageFailure::new(e.to_string())
}

/// The study with the laws that the discovery found and with drafts as effects of its own, and
/// where each of its own effects comes from.
fn with_laws(
    mut session: SubjectSession,
    asked: &Asked,
    drafts: &[OwnEffect],
) -> Result<(SubjectSession, HashMap<String, From>), PipelineError> {
    let mut origin: HashMap<String, From> =
        session.own_effects.iter().map(|o| (o.spec.id.clone(), From::Own)).collect();
    let laws = asked.found.iter().filter_map(|d| d.open.as_ref()).flat_map(|o| &o.laws);
    let laws =
        laws.map(|l| OwnEffect::described(&l.effect).map(|o| (o, From::Found))).collect::<Result<Vec<_>, _>>()?;
    for (own, from) in laws.into_iter().chain(drafts.iter().map(|d| (d.clone(), From::Draft))) {
        if !origin.contains_key(&own.spec.id) {
            origin.insert(own.spec.id.clone(), from);
            session.own_effects.push(own);
        }
    }
    Ok((session, origin))
}

/// Share of the noise floor below which no model of a body can stand: the effects reproduce the
/// body's own weight, and the mass from the scale is all that is left of it.
const IMPOSSIBLE: f64 = 0.05;
/// The answer in such a case; the page that is sent says the same.
const REPLACED: &str = "these effects together can replace the body's weight, so the model cannot be evaluated";

impl Switches {
    /// Forms the columns of every effect that the last discovery ranked, of the laws that it found,
    /// of the pipeline's own effects and of `drafts`, and of the effects of the present model.
    /// `told` receives how many trials are ready, and how many there are.
    ///
    /// # Errors
    /// Results that are missing or damaged; rows other than weak ones, in which effects have no
    /// columns of this kind.
    pub fn prepare(
        session: &SubjectSession,
        drafts: &[OwnEffect],
        told: &(dyn Fn(usize, usize) + Sync),
    ) -> Result<Self, PipelineError> {
        if session.config.regressor.rows != Rows::Weak {
            return Err(PipelineError::request_hint(
                "effects can be switched on weak rows only, and this pipeline identifies from acceleration rows",
                "set `regressor: {rows: weak}`; `aloft effect add` works on both",
            ));
        }
        let view = compare(session)?;
        let session = with_reference(session)?;
        let asked = Asked::read(&session)?;
        let (session, origin) = with_laws(session, &asked, drafts)?;
        let scene = asked.scene(&session)?;
        let known = KnownEffects::of(&session.own_effects, &scene)?;
        // laws of joints change nothing in the rows of the body
        let mut effects: Vec<ModelEffect> = session.effects.iter().filter(|e| !e.is_of_joints()).cloned().collect();
        let mut without_switch: Vec<WithoutSwitch> = Vec::new();
        let ranked = asked.found.iter().flat_map(|d| &d.candidates).map(|c| c.key.clone());
        let found = asked.found.iter().flat_map(|d| &d.found).map(|f| f.key.clone());
        let laws = session.own_effects.iter().map(|o| o.spec.id.clone());
        for key in found.chain(laws).chain(ranked) {
            match asked.chosen(&known, &scene, &key, &[]) {
                Ok((chosen, _)) if effects.iter().any(|e| e.key == chosen.key) => {}
                Ok((chosen, _)) => effects.push(chosen),
                Err(e) => without_switch.push(WithoutSwitch { key, because: e.to_string() }),
            }
        }
        let (comparison, to_correct) = (view.comparison, view.to_correct);
        let contact = session.identifies_from_contact();
        with_results(&session, |made| {
            let parameters = made
                .results
                .load_parameters(Rows::Weak)?
                .ok_or_else(|| stop("nothing was identified from weak rows"))?;
            let subject = made.results.load_subject("calibrate")?;
            let (training, trials) = loop {
                let of_contact = contact || effects.iter().any(|e| uses_contact(&session, vec![e.clone()]));
                let rows = rows_of(made, &subject, &effects, &comparison, of_contact, told)?;
                let dropped = drop_without_numbers(&session.effects, &rows.finite, &mut effects);
                if dropped.is_empty() {
                    break (rows.training, rows.trials);
                }
                without_switch.extend(dropped);
            };
            let (mut switches, mut columns) = (Vec::new(), Vec::new());
            for e in &effects {
                let choice = known.choice(&scene, e).map_err(stop)?;
                columns.push(choice.names(&scene));
                let units = choice.effect.coefficients(&scene, choice.target);
                switches.push(Switch {
                    key: e.key.clone(),
                    title: Some(choice.effect.title()).filter(|t| !t.is_empty()).unwrap_or(e.id()).to_owned(),
                    in_model: session.effects.contains(e),
                    coefficients: units.iter().map(|c| (c.name.to_string(), c.unit.to_string())).collect(),
                    nonlinear: e.nonlinear.iter().map(|(n, v)| (n.clone(), *v)).collect(),
                    from: origin.get(e.id()).copied().unwrap_or(From::Catalogue),
                });
            }
            let predicting = Predicting::like(&subject, &parameters)?;
            let weight = predicting.contact_weight().filter(|_| contact);
            Ok(Self {
                pools: Pools::of(&training.iter().collect::<Vec<_>>(), &predicting, weight, &columns)?,
                other: Mutex::default(),
                predicting,
                best: best_grades(parameters.gate.passed, to_correct.as_ref()),
                session: made.session.clone(),
                subject,
                parameters,
                floor: comparison.noise_floor,
                switches,
                without_switch,
                effects,
                columns,
                training,
                trials,
                contact,
                weights: Mutex::default(),
                found: asked.found.iter().flat_map(|d| &d.found).map(|f| f.key.clone()).collect(),
                present: session.effects.iter().filter(|e| !e.is_of_joints()).map(|e| e.key.clone()).collect(),
            })
        })
    }

    /// The switches: effects of the model first, then those of the discovery, best first.
    pub fn switches(&self) -> &[Switch] {
        &self.switches
    }

    /// Effects without a switch, and why.
    pub fn without_switch(&self) -> &[WithoutSwitch] {
        &self.without_switch
    }

    /// The study with the definitions of all laws that are among the switches.
    pub fn session(&self) -> &SubjectSession {
        &self.session
    }

    /// The chosen effects as a model stores them, in the given order.
    ///
    /// # Errors
    /// A key that has no switch.
    pub fn chosen(&self, keys: &[String]) -> Result<Vec<ModelEffect>, PipelineError> {
        keys.iter().map(|key| Ok(self.effects[self.index(key)?].clone())).collect()
    }

    fn index(&self, key: &str) -> Result<usize, PipelineError> {
        self.effects.iter().position(|e| e.key == key).ok_or_else(|| {
            let known: Vec<&str> = self.effects.iter().map(|e| e.key.as_str()).collect();
            PipelineError::request_hint(
                format!("there is no switch for `{key}`"),
                aloft_study::nearest::hint(key, &known, "there are"),
            )
        })
    }

    /// The model with these effects, identified and judged without `left_out`, in the geometry of
    /// the present results.
    ///
    /// # Errors
    /// A key without a switch; rows that do not determine the parameters.
    pub fn model(&self, keys: &[String], left_out: &LeftOut) -> Result<Switched, PipelineError> {
        let names = self.names(keys)?;
        let failed = |f: StageFailure| PipelineError::Request { problem: f.problem, hint: f.hint };
        let other;
        let pools = if *left_out == LeftOut::default() {
            &self.pools
        } else {
            other = self.pools_without(left_out).map_err(failed)?;
            &*other
        };
        let weight = self.weight(keys, &names)?;
        let all = self.solve(&pools.all, &names, weight).map_err(failed)?;
        let judged: Vec<Predicted<'_>> = self
            .trials
            .par_iter()
            .filter(|t| !left_out.trials.contains(&t.name))
            .map(|trial| {
                let (own, remark) = self.own(pools, trial, &names, weight, &all);
                let windows = trial.windows.as_ref();
                let errors = windows.map_or_else(Vec::new, |w| w.errors(&own.0, &own.1, trial.offset.as_ref()));
                let cut = |at: f64| left_out.cuts(&trial.name).any(|c| (c.from_s..=c.to_s).contains(&at));
                let counts = windows.iter().flat_map(|w| &w.centre_s).map(|at| !cut(*at)).collect();
                Predicted { trial, errors, counts, remark }
            })
            .collect();
        // the reading at rest of plates that were never unloaded follows from the model, frame by
        // frame
        let present = self.present == keys;
        let known = present || !self.trials.iter().any(|t| t.in_contact && t.offset.is_some());
        let place = |flying: bool| {
            let counted =
                judged.iter().filter(|p| if flying { p.trial.in_flight } else { p.trial.in_contact && known });
            let floor = self.floor.as_ref().and_then(|f| if flying { f.flight_floor } else { f.contact_floor });
            let windows = counted.flat_map(|p| p.of_kind(flying));
            against(if flying { "flight" } else { "contact" }, size_of_windows(windows)?, floor)
        };
        let weight_n = weight_n(&self.session);
        let errors = [true, false].into_iter().filter_map(place);
        let errors: Vec<HeldOutError> =
            errors.map(|a| HeldOutError::of(&a, &[], weight_n).at_best(&self.best)).collect();
        if errors.iter().any(|e| e.noise_floor.is_some_and(|floor| e.held_out_error < IMPOSSIBLE * floor)) {
            return Err(PipelineError::request(REPLACED));
        }
        let trials = self.trials.iter().map(|t| {
            let own = judged.iter().find(|p| p.trial.name == t.name);
            let size = |flying: bool, counts: bool| Some(size_of_windows(own.filter(|_| counts)?.of_kind(flying))?.0);
            TrialError {
                trial: t.name.clone(),
                flight: size(true, t.in_flight),
                contact: size(false, t.in_contact && (present || t.offset.is_none())),
                left_out: own.is_none(),
            }
        });
        let base = self.parameters.base.iter().zip(all.0.iter());
        Ok(Switched {
            effects: keys.to_vec(),
            errors,
            coefficients: all.1.clone(),
            base: base.map(|(b, value)| (b.name.clone(), *value, b.unit.clone())).collect(),
            trials: trials.collect(),
            remarks: judged.iter().filter_map(|p| p.remark.clone()).collect(),
        })
    }

    /// Predicted and measured wrench of a trial, frame by frame, of the model with these effects
    /// identified without the trial.
    ///
    /// # Errors
    /// As [`Switches::model`]; a trial that was not compared.
    pub fn series(&self, trial: &str, keys: &[String]) -> Result<TrialSeries, PipelineError> {
        let names = self.names(keys)?;
        let others: Vec<String> = self.trials.iter().map(|t| t.name.clone()).collect();
        let judged = self.trials.iter().find(|t| t.name == trial).ok_or_else(|| {
            let known: Vec<&str> = self.trials.iter().map(|t| t.name.as_str()).collect();
            let hint = aloft_study::nearest::hint(trial, &known, "there are");
            PipelineError::request_hint(format!("no recording `{trial}` was compared"), hint)
        })?;
        let chosen = self.chosen(keys)?;
        let weight = self.weight(keys, &names)?;
        with_results(&self.session, |made| {
            let all = self.solve(&self.pools.all, &names, weight)?;
            let (own, _) = self.own(&self.pools, judged, &names, weight, &all);
            let (params, _) = params_of(&self.session, &chosen);
            let filter = &made.session.config.filter;
            let rows = TrialRows::load(made.results, Some(filter), &|| made.calendar(), trial, &self.subject)?;
            let zeros = SessionZeros::new(made.results, &others);
            let compared = ComparedTrial::of(&params, made.results, judged.role, trial, &zeros, rows)?;
            let candidate = Candidate::per_trial("identified", vec![own.0]).with_effects_per_trial(vec![own.1]);
            let floor = self.floor.as_ref().map_or(Floor::Drawn(0, None), Floor::Known);
            let (trials, models) = ([compared], [candidate]);
            let (_, series) =
                stage::compare_models(&params, &self.subject, &trials, &models, HeldOut::EveryTrial, None, floor)?;
            series.into_iter().next().ok_or_else(|| stop(format!("{trial} has no frames to compare")))
        })
    }

    /// Names of the columns of these effects.
    fn names(&self, keys: &[String]) -> Result<Vec<&str>, PipelineError> {
        let mut out = Vec::new();
        for key in keys {
            out.extend(self.columns[self.index(key)?].iter().map(String::as_str));
        }
        Ok(out)
    }

    /// Parameters for predicting a trial, identified without it; those of all trials, with a
    /// remark, if nothing would be left.
    fn own(
        &self,
        pools: &Pools,
        t: &Judged,
        names: &[&str],
        weight: Option<f64>,
        all: &PointEstimate,
    ) -> (PointEstimate, Option<String>) {
        let Some(rest) = pools.without.get(&t.name) else { return (all.clone(), None) };
        match self.solve(rest, names, weight) {
            Ok(found) => (found, None),
            Err(e) => (all.clone(), Some(format!("{} could not be left out: {}", t.name, e.problem))),
        }
    }

    /// Rotated rows answer at once; where there are none, where they hold contact with another
    /// weight, or where these columns cannot be told apart, the merged rows are solved as the
    /// stages do.
    fn solve(&self, pool: &Pool, names: &[&str], weight: Option<f64>) -> Result<PointEstimate, StageFailure> {
        let rotated = pool.estimate(names).filter(|_| weight == self.present_weight());
        rotated.map_or_else(|| self.solve_merged(&pool.merged, names, weight), Ok)
    }

    /// What [`Self::solve`] gives, without rotated rows.
    fn solve_merged(
        &self,
        merged: &Merged,
        names: &[&str],
        weight: Option<f64>,
    ) -> Result<PointEstimate, StageFailure> {
        self.predicting.solve_merged(&merged.with_effects(names, weight)?)
    }

    /// Pools of the trials that are left; those of the last request are kept.
    fn pools_without(&self, left_out: &LeftOut) -> Result<Arc<Pools>, StageFailure> {
        let mut held = self.other.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some((_, pools)) = held.as_ref().filter(|(of, _)| of == left_out) {
            return Ok(Arc::clone(pools));
        }
        let kept: Vec<&Factor> = self.training.iter().filter(|f| left_out.keeps(f, &self.trials)).collect();
        let pools = Arc::new(Pools::of(&kept, &self.predicting, self.present_weight(), &self.columns)?);
        *held = Some((left_out.clone(), Arc::clone(&pools)));
        Ok(pools)
    }
}

/// A trial predicted by a model.
struct Predicted<'a> {
    trial: &'a Judged,
    /// Error in each window.
    errors: Vec<Vector6<f64>>,
    /// False for windows that were left out.
    counts: Vec<bool>,
    remark: Option<String>,
}

impl Predicted<'_> {
    /// Errors in the windows of one kind of motion.
    fn of_kind(&self, flying: bool) -> impl Iterator<Item = &Vector6<f64>> {
        let kinds = self.trial.windows.iter().flat_map(|w| &w.in_flight);
        let all = self.errors.iter().zip(kinds).zip(&self.counts);
        all.filter(move |((_, in_flight), counts)| **in_flight == flying && **counts).map(|((e, _), _)| e)
    }
}

fn against(
    judged_on: &str,
    (held_out_error, force_n, moment_nm, windows): (f64, f64, f64, usize),
    floor: Option<aloft_compare::Floor>,
) -> Option<AgainstFloor> {
    Some(AgainstFloor {
        judged_on: judged_on.to_owned(),
        held_out_error,
        held_out_force_n: Some(force_n),
        held_out_moment_nm: Some(moment_nm),
        windows,
        floor,
        times_floor: floor.and_then(|f| limits::times_floor(held_out_error, f.noise_floor, f.ci95)),
        at_floor: floor.and_then(|f| limits::at_floor(held_out_error, f.noise_floor, f.ci95)),
    })
}
