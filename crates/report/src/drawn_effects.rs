//! Effects as things to draw: forces where they act, lines to fixed points of the room, masses at
//! their points. Only the declarations of effects are used; none is referred to by name.

use super::place_errors::asked;
use super::story::Story;
use aloft_body::{Motion, Subject};
use aloft_effects::{Columns, EffectInstance, EffectKind, ParameterKind, Scene, Series, Span, TrialMotion};
use aloft_flight::Flight;
use aloft_page::{ArrowOf, Arrows, MassAt};
use aloft_study::effects::KnownEffects;
use aloft_study::revision::ModelEffect;
use nalgebra::Vector3;
use std::collections::{BTreeMap, HashMap};

/// An effect with the values of its coefficients.
pub struct Valued {
    /// The effect, as a revision stores it.
    pub effect: ModelEffect,
    /// Values of its coefficients by name.
    pub coefficients: BTreeMap<String, f64>,
    /// True if `discover` found it and the model does not hold it.
    pub suspected: bool,
}

/// Effects of the model; without any, the effects that `discover` found missing.
pub fn valued(story: &Story<'_>) -> Vec<Valued> {
    // laws of joints have no force on the body as a whole
    let own: Vec<&ModelEffect> = story.session.effects.iter().filter(|e| !e.is_of_joints()).collect();
    if !own.is_empty() {
        let Some(found) = &story.found else { return Vec::new() };
        let all: HashMap<String, f64> = found.parameters.coefficients().into_iter().collect();
        let of = |e: &ModelEffect| {
            let prefix = format!("{}.", e.key);
            let own = all.iter().filter_map(|(name, v)| Some((name.strip_prefix(&prefix)?.to_owned(), *v)));
            Valued { effect: e.clone(), coefficients: own.collect(), suspected: false }
        };
        return own.into_iter().map(of).collect();
    }
    let of = |f: &aloft_discover::Found| {
        let values = |list: &[aloft_discover::Estimate]| list.iter().map(|e| (e.name.clone(), e.value)).collect();
        let effect = ModelEffect {
            key: f.key.clone(),
            nonlinear: values(&f.nonlinear),
            trials: f.trials.clone(),
            ..ModelEffect::default()
        };
        Valued { effect, coefficients: values(&f.coefficients), suspected: true }
    };
    asked(story).map_or_else(Vec::new, |d| d.found.iter().map(of).collect())
}

/// Everything that effects add to the picture of a recording.
#[derive(Default)]
pub struct Drawn {
    /// Forces and moments, `frames[frame of the motion]`.
    pub arrows: Vec<Arrows>,
    /// Masses.
    pub masses: Vec<MassAt>,
    /// Names of effects that have no place in space.
    pub unplaced: Vec<String>,
    /// Force of all effects of the model in each frame of the motion, N, world axes; NaN where it
    /// is not known.
    pub total_n: Vec<Vector3<f64>>,
}

/// Most arrows of one effect in a frame.
const MOST_ARROWS: usize = 16;

/// Evaluates the effects over a recording.
pub fn drawn(
    story: &Story<'_>,
    subject: &Subject,
    motion: &Motion,
    flights: &[Flight],
    plates: &[Vector3<f64>],
) -> Drawn {
    let effects = valued(story);
    let mut out = Drawn::default();
    if effects.is_empty() {
        return out;
    }
    let scene = Scene::new(&subject.model, &subject.prior_phi(), plates);
    let without = || Drawn { unplaced: effects.iter().map(|v| v.effect.key.clone()).collect(), ..Drawn::default() };
    // none: the figure names the effects that it cannot show
    let Ok(known) = KnownEffects::of(&story.session.own_effects, &scene) else { return without() };
    let spans = spans(motion.n_frames(), flights);
    let trial = TrialMotion { motion, spans: &spans, plates: &[], session_time_s: 0.0 };
    // none: as above
    let Ok(series) = Series::new(&scene, &trial) else { return without() };
    out.total_n = vec![Vector3::repeat(f64::NAN); motion.n_frames()];
    series.motion_frames().iter().for_each(|f| out.total_n[*f] = Vector3::zeros());
    for valued in effects.iter().filter(|v| v.effect.trials.is_empty() || v.effect.trials.contains(&motion.trial)) {
        let Some(choice) = choose(&known, &scene, &valued.effect) else {
            out.unplaced.push(valued.effect.key.clone());
            continue;
        };
        one(&series, &scene, &choice, valued, motion.n_frames(), &mut out);
    }
    out
}

/// The effect bound to the scene. A nonlinear parameter that lies outside its bounds there, because
/// the region of motion differs, is set as it is.
fn choose<'k>(known: &'k KnownEffects, scene: &Scene, effect: &ModelEffect) -> Option<EffectInstance<'k>> {
    // none: the figure names the effect as one that it cannot show
    let mut choice = EffectInstance::among(&effect.key, scene, &known.all()).ok()?;
    let parameters = choice.effect.nonlinear(scene, choice.target);
    for (k, p) in parameters.iter().enumerate() {
        if let Some(value) = effect.nonlinear.get(&p.name) {
            *choice.nonlinear.get_mut(k)? = *value;
        }
    }
    Some(choice)
}

/// Flights, and what lies between them.
fn spans(n: usize, flights: &[Flight]) -> Vec<Span> {
    let mut out = Vec::new();
    let mut at = 0;
    for f in flights.iter().map(Flight::frames) {
        if f.start > at {
            out.push(Span { first_frame: at, end_frame: f.start, flight: false });
        }
        out.push(Span { first_frame: f.start, end_frame: f.end, flight: true });
        at = f.end;
    }
    if at < n {
        out.push(Span { first_frame: at, end_frame: n, flight: false });
    }
    out
}

/// Largest number of characters of a label in the figure.
const LONGEST_LABEL: usize = 40;

fn one(
    series: &Series<'_>,
    scene: &Scene,
    choice: &EffectInstance<'_>,
    valued: &Valued,
    frames: usize,
    out: &mut Drawn,
) {
    // long titles would cover the figure
    let title = choice.effect.title();
    let name = if title.len() > LONGEST_LABEL { choice.effect.id() } else { title }.to_owned();
    let coefficients = choice.effect.coefficients(scene, choice.target);
    let values: Vec<f64> = coefficients
        .iter()
        .map(|c| valued.coefficients.get(&c.name).copied().filter(|v| v.is_finite()).unwrap_or(0.0))
        .collect();
    let parameters = choice.effect.nonlinear(scene, choice.target);
    let position = |wanted: fn(usize) -> ParameterKind| -> Option<[f64; 3]> {
        let at = |k: usize| parameters.iter().position(|p| p.kind == wanted(k)).map(|i| choice.nonlinear[i]);
        Some([at(0)?, at(1)?, at(2)?])
    };
    // a mass changes the inertia of a link
    if choice.effect.inertia(scene, choice.target, &choice.nonlinear).is_some()
        && let (Some(at_m), Some(k)) =
            (position(ParameterKind::PointOnLink), coefficients.iter().position(|c| c.unit == "kg"))
    {
        let mass_kg = values[k];
        let name = format!("{name} {} kg", super::wording::number(mass_kg));
        out.masses.push(MassAt { name, segment: choice.target.link(), at_m, mass_kg, suspected: valued.suspected });
    }
    if choice.effect.kind() == EffectKind::Artefact {
        out.unplaced.push(valued.effect.key.clone());
        return;
    }
    if !choice.effect.has_wrench() {
        return;
    }
    let mut columns = Columns::recording(series.len(), coefficients.len());
    choice.effect.evaluate(series, choice.target, &choice.nonlinear, &mut columns);
    // forces at one point add up; free moments too, drawn at the target or at the centre of mass
    let mut forces: Vec<Vec<(Vector3<f64>, Vector3<f64>)>> = vec![Vec::new(); series.len()];
    let mut couples = vec![Vector3::zeros(); series.len()];
    for a in columns.applied() {
        let own = a.vector * values[a.column];
        match a.at_m {
            None => couples[a.frame] += own,
            Some(at) => match forces[a.frame].iter_mut().find(|(p, _)| (*p - at).norm() < 1e-9) {
                Some((_, force)) => *force += own,
                None => forces[a.frame].push((at, own)),
            },
        }
    }
    // a pure couple has no arrow
    let acts = forces.iter().flatten().any(|(_, force)| force.norm() > 1e-9);
    let most = if acts { forces.iter().map(Vec::len).max().unwrap_or(0).min(MOST_ARROWS) } else { 0 };
    let none = [[f64::NAN; 3]; 2];
    let mut arrows = vec![vec![none; most]; frames];
    let mut rings = vec![vec![none]; frames];
    let mut turns = false;
    for (i, &frame) in series.motion_frames().iter().enumerate() {
        let mut own = std::mem::take(&mut forces[i]);
        if !valued.suspected {
            out.total_n[frame] += own.iter().map(|f| f.1).sum::<Vector3<f64>>();
        }
        if own.len() > most {
            own.sort_by(|a, b| b.1.norm().total_cmp(&a.1.norm()));
        }
        for (slot, (at, force)) in arrows[frame].iter_mut().zip(own) {
            *slot = [at.into(), force.into()];
        }
        if couples[i].norm() > 1e-9 {
            let link = choice.target.link();
            let at = series.links(i).get(link).map_or(series.frame(i).com, |l| l.point(&scene.link_com_m[link]));
            rings[frame][0] = [at.into(), couples[i].into()];
            turns = true;
        }
    }
    let base = Arrows { name, suspected: valued.suspected, ..Arrows::default() };
    if turns {
        out.arrows.push(Arrows { of: ArrowOf::Couple, frames: rings, ..base.clone() });
    }
    if most > 0 {
        out.arrows.push(Arrows {
            of: ArrowOf::Effect,
            frames: arrows,
            anchor_m: position(ParameterKind::PointInWorld),
            ..base
        });
    }
}

/// Displacement of the centre of mass in each frame if the forces of the effects had not acted
/// since the start of the flight, m: minus the twice integrated acceleration. NaN outside flights.
pub fn ghost(total_n: &[Vector3<f64>], flights: &[Flight], mass_kg: f64, rate_hz: f64) -> Vec<Vector3<f64>> {
    let mut out = vec![Vector3::repeat(f64::NAN); total_n.len()];
    let h = 1.0 / rate_hz;
    for range in flights.iter().map(Flight::frames) {
        let (mut at, mut speed) = (Vector3::zeros(), Vector3::zeros());
        for f in range.start..range.end.min(total_n.len()) {
            let here = total_n[f] * (-1.0 / mass_kg);
            if !here.iter().all(|v| v.is_finite()) {
                break;
            }
            if f > range.start {
                let before = total_n[f - 1] * (-1.0 / mass_kg);
                at += speed * h + (before * 2.0 + here) * (h * h / 6.0);
                speed += (before + here) * (0.5 * h);
            }
            out[f] = at;
        }
    }
    out
}

/// Units of the coefficients of the model's effects, by `key.name`.
pub fn units(story: &Story<'_>) -> HashMap<String, String> {
    let Some(subject) = &story.subject else { return HashMap::new() };
    let scene = Scene::new(&subject.model, &subject.prior_phi(), &[]);
    // none: an effect of an earlier revision may be gone; its numbers stand without a unit
    let Ok(known) = KnownEffects::of(&story.session.own_effects, &scene) else { return HashMap::new() };
    let keys = story.history.revisions.iter().flat_map(|r| &r.effects);
    let mut out = HashMap::new();
    for key in keys {
        // none: as above
        let Ok(choice) = EffectInstance::among(key, &scene, &known.all()) else { continue };
        for c in choice.effect.coefficients(&scene, choice.target) {
            out.insert(format!("{key}.{}", c.name), c.unit);
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;
    use aloft_flight::{EdgeSource, FlightSource};

    fn flight(start: usize, end: usize) -> Flight {
        let mean_acceleration_mps2 = [0.0, 0.0, -9.81];
        let (takeoff_source, landing_source) = (EdgeSource::Motion, EdgeSource::Motion);
        Flight { start, end, source: FlightSource::Motion, takeoff_source, landing_source, mean_acceleration_mps2 }
    }

    #[test]
    fn the_ghost_falls_as_if_the_force_had_not_acted() {
        let force = vec![Vector3::new(0.0, 0.0, 20.0); 60];
        let out = ghost(&force, &[flight(10, 50)], 10.0, 100.0);
        let t = 39.0 / 100.0;
        assert!((out[49].z + 0.5 * 2.0 * t * t).abs() < 1e-9, "{}", out[49].z);
        assert_eq!(out[10].norm(), 0.0);
        assert!(out[5].x.is_nan() && out[55].x.is_nan());
    }

    #[test]
    fn spans_cover_the_recording_once() {
        let all = spans(100, &[flight(10, 20), flight(30, 40)]);
        let frames: Vec<(usize, usize, bool)> = all.iter().map(|s| (s.first_frame, s.end_frame, s.flight)).collect();
        assert_eq!(frames, [(0, 10, false), (10, 20, true), (20, 30, false), (30, 40, true), (40, 100, false)]);
    }
}
