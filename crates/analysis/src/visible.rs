//! Check that `effect add` makes before it changes anything: can the recordings used for
//! identification determine the effect at all?

use crate::results::with_results;
use aloft_effects::{ActsIn, EffectInstance, Scene};
use aloft_identify::{Estimator, Unseen, Visible};
use aloft_pipeline::stages::acceleration::{self, acceleration_factors};
use aloft_pipeline::stages::identify::{self, estimator};
use aloft_pipeline::stages::regressor::{self, weak_factors};
use aloft_pipeline::trial_rows::TrialRows;
use aloft_regressor::{Factor, StretchKind};
use aloft_study::config::Rows;
use aloft_study::revision::ModelEffect;
use aloft_study::subject_session::SubjectSession;
use aloft_workspace::error::{PipelineError, StageFailure};
use rayon::prelude::*;

/// Maximum number of trials named in a message.
const NAMED: usize = 4;

/// Refuses the last of `effects` if the rows of identification determine none of its coefficients,
/// or if it duplicates another effect of the model; `choice` is the same effect bound to `scene`.
/// An effect with some determined coefficients is accepted: `parameters` shows which are not.
pub fn refuse_invisible(
    session: &SubjectSession,
    effects: &[ModelEffect],
    choice: &EffectInstance<'_>,
    scene: &Scene,
) -> Result<(), PipelineError> {
    let (key, names) = (choice.key(scene), choice.names(scene));
    let own_estimator = estimator(&identify::Params::of(session), session.config.regressor.rows);
    let model = SubjectSession { effects: effects.to_vec(), ..session.clone() };
    let contact = model.identifies_from_contact();
    let factors = with_results(&model, |made| {
        let kind = model.config.regressor.rows;
        let (weak, acceleration) = (regressor::Params::of(&model, None), acceleration::Params::of(&model));
        let filter = (kind == Rows::Acceleration).then_some(&made.session.config.filter);
        let (results, subject) = (made.results, made.results.load_subject("calibrate")?);
        let each: Vec<Vec<Factor>> = made
            .training()
            .par_iter()
            .map(|name| {
                let rows = TrialRows::load(results, filter, &|| made.calendar(), name, &subject)?;
                let (factors, _) = match kind {
                    Rows::Weak => weak_factors(&weak, &rows)?,
                    Rows::Acceleration => acceleration_factors(&acceleration, &rows)?,
                };
                let used = |f: &Factor| contact || f.kind == StretchKind::Flight;
                Ok(factors.into_iter().map(|(_, f)| f).filter(used).collect())
            })
            .collect::<Result<_, StageFailure>>()?;
        Ok(each.concat())
    })?;
    if factors.is_empty() {
        return Ok(());
    }
    let has_prior = matches!(own_estimator, Estimator::Regularised { .. } | Estimator::NoiseMetric);
    let visible = Visible::among(&factors, has_prior).map_err(|e| PipelineError::request(e.to_string()))?;
    let own: Vec<(&str, &Unseen)> = visible.unseen().filter(|(n, _)| names.iter().any(|own| own == n)).collect();
    let repeated = own.iter().find_map(|(name, why)| match why {
        Unseen::Repeats(with) => {
            let others: Vec<String> = with.iter().filter(|w| !names.contains(w)).cloned().collect();
            (!others.is_empty()).then_some((*name, Unseen::Repeats(others)))
        }
        _ => None,
    });
    let (name, why) = match (repeated, own.first()) {
        (Some(found), _) => found,
        (None, Some((name, why))) if own.len() == names.len() => (*name, (*why).clone()),
        _ => return Ok(()),
    };
    let what = if names.len() == 1 { String::new() } else { format!(" (`{name}`)") };
    let problem =
        format!("`{key}` is not added: the rows of {} do not determine it{what}: {}", rows(&factors), why.describe());
    let hint = match why {
        Unseen::Zero if !contact && choice.effect.acts() == ActsIn::Contact => {
            "an effect of the plates needs contact in identification: take `contact: false` out of `identify`"
        }
        Unseen::Zero => "record motion in which it acts",
        Unseen::Repeats(_) => "remove the other effect first: see `aloft history` and `aloft effect remove`",
        Unseen::Body(_) => {
            "record trials with it and trials without it, so that the body's parameters cannot take its place"
        }
        Unseen::TooFewRows => "record more flights, or identify with tables (`estimator: regularised`)",
    };
    Err(PipelineError::request_hint(problem, hint))
}

/// The rows in words: numbers of trials, flights and contact stretches.
fn rows(factors: &[Factor]) -> String {
    let mut trials: Vec<&str> = factors.iter().map(|f| f.trial.as_str()).collect();
    trials.dedup();
    let contacts = factors.iter().filter(|f| f.kind == StretchKind::Contact).count();
    let named = trials.iter().take(NAMED).map(|t| format!("`{t}`")).collect::<Vec<_>>().join(", ");
    let more = trials.len().saturating_sub(NAMED);
    let more = if more > 0 { format!(" and {more} more") } else { String::new() };
    let contacts = if contacts > 0 { format!(", {contacts} contact stretches") } else { ", no contact".to_owned() };
    format!("{named}{more} ({} flights{contacts})", factors.iter().filter(|f| f.kind != StretchKind::Contact).count())
}
