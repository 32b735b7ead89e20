//! Postures of trunk and arms, drawn around what people do when they stand, crouch, take off and land.

use super::stance::N_UPPER;
use crate::motion::Jet;
use crate::random::Stream;

/// What the upper body is doing.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Moment {
    /// Upright and quiet.
    Stand,
    /// Deepest point of a countermovement.
    Crouch,
    /// Leaving the ground.
    TakeOff,
    /// Meeting the ground.
    Landing,
    /// The static trial: arms held away from the body.
    Static,
}

/// Trunk flexion, arm flexion, arm abduction, elbow flexion (rad), and how much each draw differs.
fn typical(moment: Moment) -> [f64; 5] {
    match moment {
        Moment::Stand => [0.05, 0.0, 0.22, 0.25, 0.5],
        Moment::Crouch => [0.28, -0.75, 0.25, 0.55, 1.0],
        Moment::TakeOff => [0.10, 1.0, 0.30, 0.55, 1.0],
        Moment::Landing => [0.20, 0.45, 0.40, 0.7, 1.0],
        Moment::Static => [0.0, 0.0, 0.88, 0.12, 0.35],
    }
}

/// Twenty jets: torso, head, right arm, elbow, hand, left arm, elbow, hand.
pub fn upper(moment: Moment, vigour: f64, rng: &mut Stream) -> [Jet; N_UPPER] {
    let [trunk, arm, abduction, elbow, spread] = typical(moment);
    let mut out = [Jet::default(); N_UPPER];
    let moving = moment == Moment::TakeOff || moment == Moment::Landing;
    let rate = if moving { vigour } else { 0.0 };
    let mut put = |i: usize, x: f64, sd: f64, rate_mean: f64, rate_sd: f64| {
        out[i] = Jet {
            x: x + sd * spread * rng.moderate(),
            v: rate * (rate_mean + rate_sd * rng.moderate()),
            a: 0.0,
        };
    };
    let lift = if moment == Moment::TakeOff { 3.0 } else { -0.8 };
    put(0, 0.0, 0.05, 0.0, 0.3);
    put(1, 0.0, 0.08, 0.0, 0.5);
    put(2, -trunk, 0.08, if moment == Moment::TakeOff { 0.8 } else { -0.5 }, 0.3);
    for axis in 0..3 {
        put(3 + axis, 0.0, 0.06, 0.0, 0.4);
    }
    for (first, sign) in [(6, -1.0), (13, 1.0)] {
        put(first, sign * abduction, 0.08, 0.0, 0.6);
        put(first + 1, 0.0, 0.1, 0.0, 0.5);
        put(first + 2, arm, 0.15, lift, 0.8);
        put(first + 3, elbow, 0.12, 0.0, 0.8);
        for axis in 0..3 {
            put(first + 4 + axis, 0.0, 0.1, 0.0, 0.6);
        }
    }
    out
}
