//! Entries of the atlas whose strength depends on two variables: a resistance that grows with the
//! speed and depends on something else (a drag that falls with the height, or on a link that turns
//! its broad side to the flow), a product of two places, angles or times; and which are kept.

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

/// Entries whose strength is a product of two places, angles or times: `like` with both variables,
/// and [xy, x, y] in every frame, by series, so that one of them may be counted from any zero. `of`
/// are variables with ranges and values.
pub(super) fn of_two_places<'v>(
    of: &'v [(Variable, Range, Vec<Vec<f64>>)],
    like: &'v Group,
) -> impl Iterator<Item = (Group, Vec<Vec<f64>>)> + 'v {
    let places = || of.iter().filter(|p| !p.0.is_rate());
    let pairs =
        places().enumerate().flat_map(move |(i, first)| places().skip(i + 1).map(move |second| (first, second)));
    pairs.map(move |((first, range, x), (second, of_second, y))| {
        let of_both = |(x, y): (&f64, &f64)| [x * y, *x, *y];
        let weight = x.iter().zip(y).map(|(x, y)| x.iter().zip(y).flat_map(of_both).collect()).collect();
        (Group { variable: *first, range: *range, second: Some((*second, *of_second)), ..like.clone() }, weight)
    })
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

    /// True if the strength depends on one variable, or on one of the pairs that flows and spins
    /// follow.
    pub fn is_one_dependence(&self) -> bool {
        self.second.is_none_or(|(second, _)| Variable::pairs_of(self.action).contains(&(self.variable, second)))
    }
}
