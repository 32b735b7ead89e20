//! Forces on the body beside errors of the plates.
//!
//! In contact a force on the body cannot be told from an error of the plates: gravity that is
//! tilted looks like a plate that was not zeroed. Forces are therefore judged in flight. A force
//! that lowers the error in flight, though not enough to be accepted, and explains the contact as
//! well as an error of the plates does, is named beside it. An error of the plates that comes and
//! goes with the recordings can be a load that was carried in them, even where flights show nothing
//! of it.

use crate::problem::Problem;
use crate::rank::score_effect;
use crate::result::{Round, Verdict};
use crate::session::Session;
use aloft_effects::Effect;
use rayon::prelude::*;

/// Error in contact with the force over that with the error of the plates, up to which it counts as
/// equally good.
const AS_GOOD: f64 = 1.1;
/// Error in flight with a load over that without it, above which flights contradict it.
const CONTRADICTED: f64 = 1.03;

/// Adds to a round in contact the forces that flights show, too weakly to be accepted, and that
/// leave no more of the error (`mean_square` of rows) in contact than the effect found there; if
/// that effect acts `in_some` recordings only, loads that flights do not contradict, too.
pub(crate) fn also_in_flight(
    session: &Session<'_>,
    problem: &Problem,
    forces: &[&dyn Effect],
    flight: &Round,
    mean_square: f64,
    in_some: bool,
    round: &mut Round,
) {
    let of_flight = |id: &str| flight.candidates.iter().find(|c| c.effect == id);
    let weakly = |id: &str| {
        of_flight(id).is_some_and(|c| {
            !c.believed && !c.placebo && c.plausible && c.held_out_ratio < flight.threshold && c.ci95[1] < 1.0
        })
    };
    let carried = |e: &dyn Effect| {
        let contradicted = of_flight(e.id()).is_none_or(|c| c.held_out_ratio > CONTRADICTED);
        in_some && e.about().by_group && !contradicted
    };
    let mut alike: Vec<(usize, String)> = forces
        .par_iter()
        .filter(|e| e.acts().in_contact() && (weakly(e.id()) || carried(**e)))
        .filter_map(|e| {
            let score = score_effect(session, problem, *e, &[], None, false, true)?;
            let unknowns = score.scored[score.best].variant.unknowns();
            let equal = score.mean_square(problem) < AS_GOOD * AS_GOOD * mean_square;
            equal.then(|| (unknowns, e.id().to_owned()))
        })
        .collect();
    alike.sort();
    if alike.is_empty() {
        return;
    }
    let names: Vec<String> = alike.into_iter().map(|(_, id)| id).collect();
    let list = names.iter().map(|n| format!("`{n}`")).collect::<Vec<_>>().join(", ");
    let why = if in_some { "which explains as much in contact" } else { "which would also lower the error in flight" };
    round.words = format!("{} (or {list}, {why})", round.words);
    round.effects.extend(names);
    round.verdict = Verdict::OneOf;
}
