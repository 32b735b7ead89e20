//! Postures of a person: foot positions, trunk and arm angles, knee flexion.

use super::stance::{CHART_LEG, COM, FOOT, N_UPPER, OutOfReach, PELVIS, PLAN, Stance, UPPER, vector};
use crate::error::SimulateError;
use crate::motion::Jet;
use crate::random::Stream;
use nalgebra::Vector3;

/// Reason why one attempt at a trial failed.
#[derive(Debug)]
pub enum Stumble {
    /// Infeasible posture or motion, in words; another attempt may succeed.
    Infeasible(String),
    /// The equations of motion could not be solved.
    Failed(SimulateError),
}

impl Stumble {
    /// A leg that does not reach, with the phase in which it happened.
    pub fn reach(when: &str) -> impl Fn(OutOfReach) -> Self + '_ {
        move |OutOfReach| Self::Infeasible(format!("a leg does not reach {when}"))
    }
}
impl From<SimulateError> for Stumble {
    fn from(error: SimulateError) -> Self {
        Self::Failed(error)
    }
}

/// Positions of the feet on the floor (right and left, m) and toe-out (rad).
#[derive(Debug, Clone, Copy)]
pub struct Footing {
    /// Ball of each foot.
    pub ball: [Vector3<f64>; 2],
    /// Toe-out of each flat foot.
    pub toe_out: [f64; 2],
}

impl Footing {
    /// A comfortable stance astride the line between the plates.
    pub fn comfortable(height_m: f64, rng: &mut Stream) -> Self {
        let h = height_m / 1.7;
        let x = 0.06 * h + 0.01 * rng.moderate();
        let mut ball =
            |sign: f64| Vector3::new(x + 0.005 * rng.moderate(), sign * (0.125 * h + 0.006 * rng.moderate()), 0.0);
        let ball = [ball(-1.0), ball(1.0)];
        Self { ball, toe_out: [0.09 + 0.04 * rng.moderate(), 0.09 + 0.04 * rng.moderate()] }
    }

    /// Horizontal target of the centre of mass: between the feet, slightly behind the balls.
    pub fn middle(&self, height_m: f64) -> Vector3<f64> {
        (self.ball[0] + self.ball[1]) * 0.5 - Vector3::new(0.030 * height_m, 0.0, 0.0)
    }
}

/// Jets at rest in a plan posture.
pub fn rest(plan: &[f64; PLAN]) -> [Jet; PLAN] {
    plan.map(Jet::rest)
}

/// A plan posture: centre of mass over the feet, lowered until the knees are bent by `knee` (rad,
/// positive), heels raised by `pitch` (rad).
pub fn lowered(
    stance: &mut Stance<'_>,
    footing: &Footing,
    pelvis: Vector3<f64>,
    arms: &[Jet; N_UPPER],
    pitch: f64,
    knee: f64,
) -> Result<[f64; PLAN], OutOfReach> {
    let height_m = stance.person().height_m;
    let mut plan = [0.0; PLAN];
    let over = footing.middle(height_m);
    plan[COM..COM + 2].copy_from_slice(&[over.x, over.y]);
    plan[PELVIS..PELVIS + 3].copy_from_slice(pelvis.as_slice());
    for side in 0..2 {
        let i = FOOT[side];
        plan[i..i + 3].copy_from_slice(footing.ball[side].as_slice());
        plan[i + 5] = -pitch;
    }
    for (slot, jet) in plan[UPPER..].iter_mut().zip(arms) {
        *slot = jet.x;
    }
    let (mut low, mut high) = (0.25 * height_m, 0.75 * height_m);
    let mut guess = Vector3::new(over.x, over.y, 0.45 * height_m);
    for _ in 0..36 {
        plan[COM + 2] = 0.5 * (low + high);
        match stance.solve(&plan, &guess) {
            Ok(chart) if -0.5 * (chart[CHART_LEG[0] + 3] + chart[CHART_LEG[1] + 3]) > knee => {
                guess = vector(&chart, 0);
                low = plan[COM + 2];
            }
            _ => high = plan[COM + 2],
        }
    }
    plan[COM + 2] = low;
    stance.solve(&plan, &guess)?;
    Ok(plan)
}

/// Phase of the movement that determines the upper-body posture.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Moment {
    /// Upright standing.
    Stand,
    /// Lowest point of a countermovement.
    Crouch,
    /// Take-off.
    TakeOff,
    /// Touch-down.
    Landing,
    /// The static trial: arms held away from the body.
    Static,
}

/// Trunk flexion, arm flexion, arm abduction, elbow flexion (rad), and the variation between draws.
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
        out[i] = Jet { x: x + sd * spread * rng.moderate(), v: rate * (rate_mean + rate_sd * rng.moderate()), a: 0.0 };
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
