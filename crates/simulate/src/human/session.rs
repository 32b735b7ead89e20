//! Simulates a person's trials one by one, each redrawn until the motion is feasible for a person.

use super::Person;
use super::exercise::{Exercise, exercise_trial, static_trial};
use super::jump::jump_trial;
use super::posture::Stumble;
use crate::error::SimulateError;
use crate::measure::feet::FootPrints;
use crate::physics::{Plant, TrueMotion};
use crate::random::Stream;
use crate::scenario::{JumpProtocol, Scenario};

/// Number of attempts at a trial before the scenario is reported as infeasible.
const ATTEMPTS: usize = 24;
/// Share of the stance in which the centre of pressure may leave the feet (around take-off and
/// landing).
const STRAY: f64 = 0.05;

/// Kind of a trial.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum HumanTrial {
    /// Standing still.
    Static,
    /// Jumps; number from 1.
    Jump(usize),
    /// Exercise; number from 1.
    Exercise(usize),
}

impl HumanTrial {
    /// Name of the recording.
    pub fn name(self) -> String {
        match self {
            Self::Static => "static".to_owned(),
            Self::Jump(n) => format!("jump{n:02}"),
            Self::Exercise(n) => format!("exercise{n:02}"),
        }
    }
    /// Kind as written in `subject.yaml`.
    pub fn kind(self) -> &'static str {
        match self {
            Self::Static => "static",
            Self::Jump(_) => "jump",
            Self::Exercise(_) => "exercise",
        }
    }
    /// All trials of a protocol in the order of the session.
    pub fn all(protocol: &JumpProtocol) -> Vec<Self> {
        std::iter::once(Self::Static)
            .chain((1..=protocol.jumps).map(Self::Jump))
            .chain((1..=protocol.exercises).map(Self::Exercise))
            .collect()
    }
}

/// A simulated trial.
#[derive(Debug, Clone)]
pub struct Played {
    /// True motion.
    pub motion: TrueMotion,
    /// Styles of the flights.
    pub styles: Vec<&'static str>,
    /// Number of attempts needed.
    pub attempts: usize,
}

/// Simulates a trial. `tick_s` is the true length of a tick; trial lengths are in nominal seconds
/// of `ticks_per_s` ticks.
pub fn play(
    scenario: &Scenario,
    person: &Person,
    plant: &Plant,
    protocol: &JumpProtocol,
    trial: HumanTrial,
    tick_s: f64,
) -> Result<Played, SimulateError> {
    let name = trial.name();
    let ticks = |seconds: f64| (seconds / tick_s).round().max(10.0) as usize;
    let mut problem = String::new();
    for attempt in 1..=ATTEMPTS {
        let rng = &mut Stream::new(scenario.seed, &format!("{name}/motion/{attempt}"));
        let size = 0.93f64.powi(attempt as i32 - 1);
        let played = match trial {
            HumanTrial::Static => {
                static_trial(person, plant, tick_s, ticks(protocol.static_s), rng).map(|motion| (motion, Vec::new()))
            }
            HumanTrial::Exercise(n) => {
                let exercise = [Exercise::Squat, Exercise::Reach, Exercise::Turn][(n - 1) % 3];
                let length = ticks(protocol.exercise_s);
                exercise_trial(person, plant, exercise, size, tick_s, length, rng).map(|motion| (motion, Vec::new()))
            }
            HumanTrial::Jump(_) => {
                jump_trial(person, plant, protocol, tick_s, rng).map(|trial| (trial.motion, trial.styles))
            }
        };
        match played {
            Ok((motion, styles)) => {
                let stray = FootPrints::of(person, &motion).stray_share(&motion);
                if stray <= STRAY {
                    return Ok(Played { motion, styles, attempts: attempt });
                }
                problem = format!("the centre of pressure leaves the feet for {:.0} % of the stance", 100.0 * stray);
            }
            Err(Stumble::Infeasible(what)) => problem = what,
            Err(Stumble::Failed(error)) => return Err(error),
        }
    }
    Err(SimulateError::Infeasible { scenario: scenario.name.clone(), trial: name, attempts: ATTEMPTS, problem })
}
