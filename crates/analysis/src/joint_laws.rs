//! Laws of a robot's joints: what the torques leave in flights that were left out, and which law is
//! missing.

use crate::results::{Made, with_results};
use aloft_discover::{DiscoverOptions, Discovery, JointDiscovery, JointInput, JointSearch, Verdict, discover_joints};
use aloft_effects::{EFFECTS, Effect, EffectInstance};
use aloft_pipeline::joint_torques::JointTorques;
use aloft_robot::joint_evidence::ReducedFold;
use aloft_study::effects::KnownEffects;
use aloft_study::revision::JointReached;
use aloft_study::subject_session::SubjectSession;
use aloft_workspace::error::{PipelineError, StageFailure};
use std::sync::OnceLock;

/// The torques as the search asks them, and the first error that could not be computed.
struct Torques<'a> {
    of: &'a JointTorques<'a>,
    failed: OnceLock<StageFailure>,
}

impl JointSearch for Torques<'_> {
    fn folds(
        &self,
        joint: usize,
        model: &[EffectInstance<'_>],
        tried: &[EffectInstance<'_>],
    ) -> Option<Vec<ReducedFold>> {
        self.of.folds(joint, model, tried)
    }

    fn reached(&self, joint: usize, model: &[EffectInstance<'_>]) -> Option<(f64, Option<(f64, [f64; 2])>)> {
        match self.of.error(joint, model) {
            Ok(error) => error.map(|e| (e.held_out, e.floor)),
            Err(why) => {
                self.failed.get_or_init(|| why);
                None
            }
        }
    }
}

/// Calls `work` with the torques of a robot's joints; none where a log holds no torques, or they
/// are not used.
fn with_torques<T>(
    session: &SubjectSession,
    work: impl FnOnce(&Made<'_>, &JointTorques<'_>) -> Result<T, StageFailure>,
) -> Result<Option<T>, PipelineError> {
    let Some(robot) = &session.robot else { return Ok(None) };
    with_results(session, |made| {
        let model = made.session.model_effects();
        let torques = JointTorques::load(robot, made.results, &made.training(), &model, &|| made.calendar())?;
        torques.map(|t| work(made, &t)).transpose()
    })
}

/// Why the torques are not searched before the rows of the body are in order; none if they are.
fn waits_for(body: &Discovery) -> Option<String> {
    let found: Vec<String> = body.found.iter().map(|f| format!("`{}`", f.key)).collect();
    match body.verdict {
        Verdict::NothingMissing | Verdict::NotDetectable => None,
        Verdict::Unexplained => {
            Some("the motion of the body itself is not explained yet, and that shows in every joint".to_owned())
        }
        Verdict::Supported | Verdict::OneOf => {
            Some(format!("add {} first: what the body lacks shows in the joints, too", found.join(" and ")))
        }
    }
}

/// Searches the joints for missing laws; none without torques, or if only effects of the body are
/// asked for. `body` is the answer for the rows of the body.
pub(crate) fn joint_laws(
    session: &SubjectSession,
    body: &Discovery,
    options: &DiscoverOptions,
) -> Result<Option<JointDiscovery>, PipelineError> {
    let wanted: Vec<&dyn Effect> = EFFECTS
        .iter()
        .copied()
        .filter(|e| e.acts().in_joints())
        .filter(|e| options.only.is_empty() || options.only.iter().any(|o| o == e.id()))
        .filter(|e| !options.without.iter().any(|o| o == e.id()))
        .collect();
    if wanted.is_empty() {
        return Ok(None);
    }
    with_torques(session, |made, torques| {
        let known = KnownEffects::of(&session.own_effects, &torques.scene)?;
        let model = torques.laws(&known, &made.session.model_effects())?;
        let waits = waits_for(body);
        let inputs: Vec<JointInput> = torques
            .joints()
            .into_iter()
            .zip(torques.errors(&model)?)
            .map(|((name, link, unit), error)| JointInput {
                name,
                link,
                unit: unit.to_owned(),
                rows: error.as_ref().map_or(0, |e| e.rows),
                held_out_error: error.as_ref().map_or(f64::NAN, |e| e.held_out),
                // a body that lacks something has wrong gains, and with them another floor
                floor: error.and_then(|e| e.floor).filter(|_| waits.is_none()),
            })
            .collect();
        let search = Torques { of: torques, failed: OnceLock::new() };
        let found = discover_joints(&torques.scene, &inputs, &model, &wanted, &search, waits.as_deref(), options);
        search.failed.into_inner().map_or(Ok(found), Err)
    })
}

/// Held-out error and floor of every joint with the laws of the present model; empty without
/// torques.
pub(crate) fn joint_errors(session: &SubjectSession) -> Result<Vec<JointReached>, PipelineError> {
    let found = with_torques(session, |made, torques| {
        let known = KnownEffects::of(&session.own_effects, &torques.scene)?;
        let model = torques.laws(&known, &made.session.model_effects())?;
        let each = torques.joints().into_iter().zip(torques.errors(&model)?);
        let of =
            |((joint, _, unit), error): ((String, usize, &str), Option<aloft_pipeline::joint_torques::JointError>)| {
                let error = error?;
                Some(JointReached {
                    joint,
                    unit: unit.to_owned(),
                    held_out_error: error.held_out,
                    noise_floor: error.floor.map(|f| f.0),
                    noise_floor_ci95: error.floor.map(|f| f.1),
                })
            };
        Ok(each.filter_map(of).collect())
    })?;
    Ok(found.unwrap_or_default())
}

/// Refuses a law of a joint where no torques are used.
pub(crate) fn refuse_without_torques(session: &SubjectSession, key: &str) -> Result<(), PipelineError> {
    match with_torques(session, |_, _| Ok(()))? {
        Some(()) => Ok(()),
        None => Err(PipelineError::request_hint(
            format!("`{key}` is not added: it acts in the torques of a joint, and no torques are used here"),
            "log `tau_meas_JOINT_nm` for every joint; `aloft run --details` says why torques were not used",
        )),
    }
}
