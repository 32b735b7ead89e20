//! Entries of the atlas for a resistance that grows with the speed and depends on a second
//! variable: a drag that falls with the height, or on a link that turns its broad side to the flow;
//! and which entries of two variables are kept.

use super::atlas::{ENDS, Group, PlaceFrames, SPLINES, splines};
use super::kinematics::{Action, Direction, Variable};
use super::shape::Range;
use nalgebra::Vector3;

/// Power of the speed in entries of resistances that depend on another variable: between those of
/// slow and of fast flow. The laws that are fitted to them have a free power.
pub(super) const RESISTANCE: f64 = 1.5;
/// A resistance that depends on a second variable has to leave less than this share of the squared
/// error of the best of one variable in the same place.
const SECOND_VARIABLE: f64 = 0.9;
/// A resistance at a place that grows with a power of the speed and depends on another variable.
pub(super) struct Resistance {
    /// Range of the speed, m/s.
    pub speed: Range,
    /// Range of the other variable.
    pub range: Range,
    /// Power of the speed times each of [`SPLINES`] functions of the other variable, by series.
    pub weight: Vec<Vec<f64>>,
}

/// A resistance with a free curve of a variable; `None` if one of them does not vary.
pub(super) fn resistance(frames: &PlaceFrames<'_>, variable: Variable) -> Option<Resistance> {
    let none = Vector3::zeros();
    let (speed, range) = (frames.range(Variable::Speed, &none, ENDS)?, frames.range(variable, &none, ENDS)?);
    let speeds = frames.values(Variable::Speed, &none);
    let of = |(x, v): (&Vec<f64>, &Vec<f64>)| {
        let mut out = splines(x, range);
        for (b, v) in out.chunks_exact_mut(SPLINES).zip(v) {
            let size = v.powf(RESISTANCE);
            b.iter_mut().for_each(|b| *b *= size);
        }
        out
    };
    Some(Resistance { speed, range, weight: frames.values(variable, &none).iter().zip(&speeds).map(of).collect() })
}

/// Drops resistances with a second variable, and products of two places or angles, that leave
/// hardly less error than those of one variable in the same place: what depends on one variable
/// fits with every second one.
pub(super) fn without_idle_factors(groups: &mut Vec<Group>) {
    let ratios = groups.iter().filter(|g| g.second.is_none()).map(|g| (g.action, g.direction, g.score.ratio));
    let of_one: Vec<(Action, Direction, f64)> = ratios.collect();
    let best = |g: &Group| {
        let same = of_one.iter().filter(|o| (o.0, o.1) == (g.action, g.direction));
        same.map(|o| o.2).fold(1.0, f64::min)
    };
    let needs_two = |g: &Group| g.score.ratio < SECOND_VARIABLE * best(g);
    groups.retain(|g| !(g.is_resistance_of_two() || g.is_of_two_places()) || needs_two(g));
}

impl Group {
    /// True for an entry of [`resistance`].
    pub fn is_resistance_of_two(&self) -> bool {
        self.direction == Direction::AgainstVelocity && self.columns == SPLINES && self.second.is_some()
    }

    /// True for a product of two variables that are no rates.
    pub fn is_of_two_places(&self) -> bool {
        self.second.is_some_and(|(second, _)| !self.variable.is_rate() && !second.is_rate())
    }
}
