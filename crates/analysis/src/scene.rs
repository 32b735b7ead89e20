//! The calibrated body with its effects: the scene in which columns are formed, and the physical
//! ranges of the coefficients of a model's effects.

use aloft_body::Subject;
use aloft_effects::Scene;
use aloft_study::effects::KnownEffects;
use aloft_study::subject_session::SubjectSession;
use aloft_workspace::artifact::plate_centres;
use aloft_workspace::disk::is_there;
use aloft_workspace::error::PipelineError;
use aloft_workspace::json::read_json;
use aloft_workspace::manifest::WHOLE_STUDY;
use aloft_workspace::workspace::Workspace;
use std::collections::BTreeMap;

/// The scene of a calibrated body, in which effects have their coefficients.
pub(crate) fn scene(session: &SubjectSession) -> Result<Scene, PipelineError> {
    let ws = Workspace::open(&session.workspace);
    let subject: Subject = read_json(&ws.place("calibrate", WHOLE_STUDY).join("subject.json"))?;
    let mut centres = Vec::new();
    for t in session.included() {
        let place = ws.place("import", &t.name);
        // a recording that was not imported, and a robot's log, have no plates
        let made = is_there(&place.join("trial.json"))?;
        let plates = if made { plate_centres(&place)? } else { Vec::new() };
        if !plates.is_empty() {
            centres = plates;
            break;
        }
    }
    Ok(Scene::new(&subject.model, &subject.prior_phi(), &centres))
}

/// Units and physical ranges of the coefficients of a model's effects, by their names in the
/// parameters.
pub(crate) fn of_coefficients(session: &SubjectSession) -> Result<BTreeMap<String, (String, [f64; 2])>, PipelineError> {
    let scene = scene(session)?;
    let known = KnownEffects::of(&session.own_effects, &scene)?;
    let mut out = BTreeMap::new();
    for effect in session.effects.iter().filter(|e| !e.is_of_joints()) {
        let choice = known.choice(&scene, effect)?;
        for c in choice.effect.coefficients(&scene, choice.target) {
            out.insert(format!("{}.{}", effect.key, c.name), (c.unit.to_string(), [c.lower, c.upper]));
        }
    }
    Ok(out)
}

/// Places, lengths and other nonlinear unknowns that the effects of a model hold at the values that
/// the model states: name in the parameters, value and unit; nothing before a body was calibrated.
pub(crate) fn held(session: &SubjectSession) -> Result<Vec<(String, f64, String)>, PipelineError> {
    let with: Vec<_> = session.effects.iter().filter(|e| !e.is_of_joints() && !e.nonlinear.is_empty()).collect();
    let subject = Workspace::open(&session.workspace).place("calibrate", WHOLE_STUDY).join("subject.json");
    if with.is_empty() || !is_there(&subject)? {
        return Ok(Vec::new());
    }
    let scene = scene(session)?;
    let known = KnownEffects::of(&session.own_effects, &scene)?;
    let mut out = Vec::new();
    for effect in with {
        let choice = known.choice(&scene, effect)?;
        for p in choice.effect.nonlinear(&scene, choice.target) {
            let value = effect.nonlinear.get(&p.name).copied();
            out.extend(value.map(|v| (format!("{}.{}", effect.key, p.name), v, p.unit)));
        }
    }
    Ok(out)
}
