//! The rows from which [`crate::switches`] are made: factors for identification, and windows for
//! judging, with the columns of all effects.

use crate::results::Made;
use crate::stored_columns::{self, TrialColumns};
use crate::switches::{WithoutSwitch, stop};
use aloft_body::{BaseParameters, Subject};
use aloft_compare::{Body, Comparison, RecordingOffset, WindowRows};
use aloft_pipeline::graph::results_hash;
use aloft_pipeline::plate_zeros::SessionZeros;
use aloft_pipeline::stages::below_all_rows;
use aloft_pipeline::stages::compare::{self as stage, ComparedTrial, HeldOut, compare_options};
use aloft_pipeline::stages::regressor::{self, weak_factors_with};
use aloft_pipeline::trial_rows::{TrialRows, effect_columns};
use aloft_regressor::{EffectColumns, Factor, StretchKind};
use aloft_study::revision::ModelEffect;
use aloft_study::subject_session::{Role, SubjectSession};
use aloft_workspace::error::StageFailure;
use aloft_workspace::key::key;
use rayon::prelude::*;
use serde_json::json;
use std::sync::atomic::{AtomicUsize, Ordering};

/// One trial of the comparison.
pub(crate) struct Judged {
    pub name: String,
    pub role: Role,
    pub windows: Option<WindowRows>,
    pub in_flight: bool,
    pub in_contact: bool,
    pub offset: Option<RecordingOffset>,
    /// Begin and end of each flight, s since the first frame.
    pub flights_s: Vec<[f64; 2]>,
}

/// Settings of the stages for a model with these effects.
pub(crate) fn params_of(session: &SubjectSession, effects: &[ModelEffect]) -> (stage::Params, regressor::Params) {
    let with = SubjectSession { effects: effects.to_vec(), ..session.clone() };
    (stage::Params::of(&with), regressor::Params::of(&with, None))
}

/// Takes out effects whose columns are not finite in frames in which those of others are: in a
/// joint matrix they would cost all effects these frames. `finite` holds the number of finite
/// frames of each effect in each trial.
pub(crate) fn drop_without_numbers(
    kept: &[ModelEffect],
    finite: &[Vec<usize>],
    effects: &mut Vec<ModelEffect>,
) -> Vec<WithoutSwitch> {
    let acting = |t: &Vec<usize>| t.iter().copied().filter(|n| *n != DOES_NOT_ACT).max().unwrap_or(0);
    let most: Vec<usize> = finite.iter().map(acting).collect();
    let whole = |e: usize| finite.iter().zip(&most).all(|(t, m)| t[e] == *m || t[e] == DOES_NOT_ACT);
    let mut out = Vec::new();
    let mut at = 0..effects.len();
    effects.retain(|e| {
        let keep = at.next().is_none_or(whole) || kept.contains(e);
        if !keep {
            let because = "its law gives no numbers in some frames of these recordings".to_owned();
            out.push(WithoutSwitch { key: e.key.clone(), because });
        }
        keep
    });
    out
}

/// Stands for the number of finite frames of an effect that does not act in a trial: its columns
/// are zero in every frame, also in those outside flights, where nothing is computed.
const DOES_NOT_ACT: usize = usize::MAX;

/// Number of frames with finite columns of each effect, or [`DOES_NOT_ACT`].
fn finite_frames(effects: &[ModelEffect], columns: Option<&EffectColumns>) -> Vec<usize> {
    let own = |e: &ModelEffect| -> Vec<usize> {
        let names = columns.iter().flat_map(|c| &c.names).enumerate();
        names.filter(|(_, n)| n.rsplit_once('.').is_some_and(|(key, _)| key == e.key)).map(|(i, _)| i).collect()
    };
    let changes: Vec<usize> = columns.iter().flat_map(|c| c.changes()).map(|(i, _)| i).collect();
    let zero = |i: usize| columns.iter().flat_map(|c| &c.wrench).all(|w| w.column(i).iter().all(|x| *x == 0.0));
    let finite = |of: Vec<usize>| {
        if !of.is_empty() && of.iter().all(|i| !changes.contains(i) && zero(*i)) {
            return DOES_NOT_ACT;
        }
        let frames = columns.iter().flat_map(|c| &c.wrench);
        frames.filter(|w| of.iter().all(|i| w.column(*i).iter().all(|x| x.is_finite()))).count()
    };
    effects.iter().map(|e| finite(own(e))).collect()
}

/// Rows of all trials.
pub(crate) struct AllRows {
    /// Factors for identification.
    pub training: Vec<Factor>,
    /// Trials of the comparison.
    pub trials: Vec<Judged>,
    /// Number of frames with finite columns, by trial and effect.
    pub finite: Vec<Vec<usize>>,
}

/// Factors for identification, and windows for judging, with the columns of all effects.
pub(crate) fn rows_of(
    made: &Made<'_>,
    subject: &Subject,
    effects: &[ModelEffect],
    comparison: &Comparison,
    contact: bool,
    told: &(dyn Fn(usize, usize) + Sync),
) -> Result<AllRows, StageFailure> {
    let (params, weak) = params_of(made.session, effects);
    let options = compare_options(&params, subject);
    let base = BaseParameters::of(&subject.model);
    let prior = subject.prior_phi();
    let body = Body { model: &subject.model, base: &base, prior: &prior };

    let compared = &comparison.first.trials;
    // as the comparison counts: held-out flights if there are any, else all
    let any = compared.iter().any(|t| t.held_out_flight && t.flight.frames > 0);
    let names: Vec<String> = made.trials.iter().map(|(name, _)| name.clone()).collect();
    let zeros = SessionZeros::new(made.results, &names);
    let done = AtomicUsize::new(0);
    let form = |name: &str, role: Role, compared: bool| -> Result<TrialColumns, StageFailure> {
        let filter = compared.then_some(&made.session.config.filter);
        let rows = TrialRows::load(made.results, filter, &|| made.calendar(), name, subject)?;
        let columns = effect_columns(&weak.effects, &rows)?;
        let finite = finite_frames(effects, columns.as_ref());
        let mut factors = Vec::new();
        if role == Role::Identify {
            let used = |f: &Factor| contact || f.kind == StretchKind::Flight;
            let formed = weak_factors_with(&weak, &rows, columns.as_ref())?.0;
            factors.extend(formed.into_iter().map(|(_, f)| f).filter(used));
        }
        let windows = if compared {
            let trial = ComparedTrial::with_columns(&params, made.results, role, name, &zeros, rows, columns)?;
            WindowRows::of(&body, &trial.input(0, HeldOut::Validation, true, None), &options).map_err(stop)?
        } else {
            None
        };
        Ok(TrialColumns { factors, windows, finite })
    };
    let settings = json!({"version": VERSION, "weak": key(&weak), "compare": key(&params), "options": key(&options), "contact": contact});
    let each: Vec<(TrialColumns, Option<Judged>)> = made
        .trials
        .par_iter()
        .map(|(name, role)| {
            let own = compared.iter().find(|t| t.trial == *name);
            let folder = made.session.workspace.join(FOLDER).join(name);
            let made_from = made_from(made, name, *role, own.is_some(), &settings)?;
            let mut formed = match stored_columns::load(&folder, name, &made_from) {
                Some(stored) => stored,
                None => {
                    let formed = form(name, *role, own.is_some())?;
                    // a store that cannot be written costs time, not results
                    let _ = stored_columns::save(&folder, &made_from, &formed);
                    formed
                }
            };
            let windows = formed.windows.take();
            let flights = made.results.load_flights(name)?;
            let second = |frame: usize| frame as f64 / flights.rate_hz;
            let flights_s = flights.flights.iter().map(|f| [second(f.start), second(f.end)]).collect();
            let judged = own.map(|t| Judged {
                name: name.clone(),
                role: *role,
                windows,
                in_flight: t.held_out_flight || !any,
                in_contact: t.held_out_contact,
                offset: t.offset,
                flights_s,
            });
            told(done.fetch_add(1, Ordering::Relaxed) + 1, made.trials.len());
            Ok((formed, judged))
        })
        .collect::<Result<_, StageFailure>>()?;
    let (formed, judged): (Vec<_>, Vec<_>) = each.into_iter().unzip();
    Ok(AllRows {
        finite: formed.iter().map(|f| f.finite.clone()).collect(),
        training: formed.into_iter().flat_map(|f| f.factors).collect(),
        trials: judged.into_iter().flatten().collect(),
    })
}

/// Folder of the stored rows in a workspace.
const FOLDER: &str = "columns";
/// Version of the stored rows; to be raised when they change.
const VERSION: u32 = 4;

/// Hash of everything that the rows of a trial depend on.
fn made_from(
    made: &Made<'_>,
    trial: &str,
    role: Role,
    compared: bool,
    settings: &serde_json::Value,
) -> Result<String, StageFailure> {
    let mut hasher = blake3::Hasher::new();
    hasher.update(settings.to_string().as_bytes());
    hasher.update(format!("{} {compared}", role.word()).as_bytes());
    let Some(trial) = made.session.trials.iter().find(|t| t.name == trial) else { return Ok(String::new()) };
    hasher.update(results_hash(made.workspace, below_all_rows(trial, made.session))?.as_bytes());
    Ok(hasher.finalize().to_hex().to_string())
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A load that some recordings do not carry takes no switch from the effects that act in all of
    /// them; an effect without numbers loses its own.
    #[test]
    fn effects_that_do_not_act_in_a_trial_cost_no_other_its_switch() {
        let of = |key: &str| ModelEffect { key: key.to_owned(), ..ModelEffect::default() };
        let mut effects = vec![of("drag"), of("payload[arm]"), of("law")];
        let finite = [vec![40, DOES_NOT_ACT, 40], vec![40, 40, 39]];
        let without = drop_without_numbers(&[], &finite, &mut effects);
        let keys: Vec<&str> = effects.iter().map(|e| e.key.as_str()).collect();
        assert_eq!(keys, ["drag", "payload[arm]"]);
        assert_eq!(without.len(), 1);
    }
}
