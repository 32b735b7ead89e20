//! Entries of the atlas for a resistance that grows with the speed and depends on a second
//! variable: a drag that falls with the height, or on a link that turns its broad side to the flow.

use super::atlas::{ENDS, Group, PlaceFrames, SPLINES, splines};
use super::kinematics::{Direction, Variable};
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

/// Drops resistances with a second variable that leave hardly less error than those of one variable
/// in the same place: a resistance fits with every second variable.
pub(super) fn without_idle_factors(groups: &mut Vec<Group>) {
    let of_one = |g: &Group| g.direction == Direction::AgainstVelocity && g.second.is_none();
    let best = groups.iter().filter(|g| of_one(g)).map(|g| g.score.ratio).fold(1.0, f64::min);
    groups.retain(|g| !g.is_resistance_of_two() || g.score.ratio < SECOND_VARIABLE * best);
}

impl Group {
    /// True for an entry of [`resistance`].
    pub fn is_resistance_of_two(&self) -> bool {
        self.direction == Direction::AgainstVelocity && self.columns == SPLINES && self.second.is_some()
    }
}
