//! Exercises with both feet on the plates, and quiet standing: a posture with slow sines on all
//! movable coordinates.

use super::Person;
use super::ground::{GroundMotion, PlanCurve};
use super::posture::{Footing, Moment, Stumble, lowered, rest, upper};
use super::stance::{COM, FOOT, PELVIS, Stance, UPPER};
use crate::physics::{Drive, Plant, Player, TrueMotion};
use crate::random::Stream;
use nalgebra::Vector3;

/// Main movement of an exercise.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Exercise {
    /// Deep, slow squats.
    Squat,
    /// Reaching with the arms.
    Reach,
    /// Turning and bending of the trunk.
    Turn,
}

/// One exercise, moving from the first frame to the last. `size` scales all amplitudes.
pub fn exercise_trial(
    person: &Person,
    plant: &Plant,
    exercise: Exercise,
    size: f64,
    tick_s: f64,
    ticks: usize,
    rng: &mut Stream,
) -> Result<TrueMotion, Stumble> {
    let footing = Footing::comfortable(person.height_m, rng);
    let mut stance = Stance::new(person, footing.toe_out);
    let mut arms = upper(Moment::Stand, 0.0, rng);
    for (shoulder, sign) in [(6, -1.0), (13, 1.0)] {
        arms[shoulder].x = sign * rng.between(0.55, 0.75);
        arms[shoulder + 2].x = rng.between(0.6, 0.85);
        arms[shoulder + 3].x = rng.between(0.8, 1.05);
    }
    let (squat, reach, turn) = match exercise {
        Exercise::Squat => (1.7, 0.8, 0.7),
        Exercise::Reach => (0.7, 1.3, 0.8),
        Exercise::Turn => (0.6, 0.8, 1.3),
    };
    let pelvis = Vector3::new(0.0, 0.0, -0.13 + 0.03 * rng.moderate());
    let knee = 0.85 + 0.3 * (squat - 0.6);
    let plan = lowered(&mut stance, &footing, pelvis, &arms, 0.0, knee).map_err(Stumble::reach("in the exercise"))?;
    let h = person.height_m / 1.7;
    let mut amplitudes = vec![(COM, 0.016 * h), (COM + 1, 0.028 * h), (COM + 2, 0.045 * h * squat)];
    amplitudes.extend([(PELVIS, 0.05), (PELVIS + 1, 0.08 * turn), (PELVIS + 2, 0.07)]);
    amplitudes.extend([(UPPER, 0.12 * turn), (UPPER + 1, 0.45 * turn), (UPPER + 2, 0.17 * turn)]);
    amplitudes.extend([(UPPER + 3, 0.10), (UPPER + 4, 0.22), (UPPER + 5, 0.11)]);
    for first in [UPPER + 6, UPPER + 13] {
        amplitudes.extend([(first, 0.42 * reach), (first + 1, 0.36 * reach), (first + 2, 0.42 * reach)]);
        amplitudes.extend([(first + 3, 0.26 * reach), (first + 4, 0.16), (first + 5, 0.18), (first + 6, 0.18)]);
    }
    amplitudes.extend([(FOOT[0] + 6, 0.05), (FOOT[1] + 6, 0.05)]);
    let mut curve = PlanCurve::through(&[(0.0, rest(&plan))]);
    for (i, amplitude) in amplitudes {
        let amplitude = size * amplitude * rng.between(0.75, 1.2);
        curve.sways.push((i, 0.8 * amplitude, rng.between(0.32, 0.75), rng.phase()));
        curve.sways.push((i, 0.3 * amplitude, rng.between(0.85, 1.4), rng.phase()));
    }
    play(stance, plant, &curve, tick_s, ticks)
}

/// Standing still with the arms away from the body.
pub fn static_trial(
    person: &Person,
    plant: &Plant,
    tick_s: f64,
    ticks: usize,
    rng: &mut Stream,
) -> Result<TrueMotion, Stumble> {
    let footing = Footing::comfortable(person.height_m, rng);
    let mut stance = Stance::new(person, footing.toe_out);
    let arms = upper(Moment::Static, 0.0, rng);
    let pelvis = Vector3::new(0.01 * rng.moderate(), 0.01 * rng.moderate(), -0.02 + 0.02 * rng.moderate());
    let plan = lowered(&mut stance, &footing, pelvis, &arms, 0.0, rng.between(0.22, 0.36))
        .map_err(Stumble::reach("in the static trial"))?;
    let mut curve = PlanCurve::through(&[(0.0, rest(&plan))]);
    for i in (0..FOOT[0]).chain(UPPER..UPPER + 20) {
        let amplitude = if i < PELVIS { 0.0015 } else { 0.005 } * rng.between(0.3, 1.0);
        curve.sways.push((i, amplitude, rng.between(0.15, 0.5), rng.phase()));
    }
    play(stance, plant, &curve, tick_s, ticks)
}

fn play(
    mut stance: Stance<'_>,
    plant: &Plant,
    curve: &PlanCurve,
    tick_s: f64,
    ticks: usize,
) -> Result<TrueMotion, Stumble> {
    let end = ticks as f64 * tick_s;
    let ground = GroundMotion::new(&mut stance, curve, [0.0, end], None, None)
        .map_err(Stumble::reach("somewhere in the exercise"))?;
    let model = &plant.model;
    let (mut q, mut v, mut a) = (model.neutral(), vec![0.0; model.nv], vec![0.0; model.nv]);
    ground.prescribe(0.0, &mut q, &mut v, &mut a);
    let mut player = Player::new(plant, tick_s, &q);
    player.advance(ticks, &vec![false; model.n_links()], &ground)?;
    Ok(player.finish())
}
