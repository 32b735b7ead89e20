//! A force towards a point of the room that is so far away that only the direction to it shows, and
//! how it changes along that direction: a force along an axis of the room that is linear in the
//! place.

use super::atlas::{ENDS, PlaceFrames};
use super::fit::{self, Fitted, STEPS};
use super::kinematics::{Direction, Variable};
use super::law::{Factor, Law};
use super::shape::{Range, Shape};
use crate::problem::Problem;
use crate::session::Session;
use nalgebra::Vector3;

/// Distance of the point in widths of the volume of the motion from which on it is far away.
const FAR: f64 = 3.0;
/// Cosine of the angle to an axis of the room below which the force is not along it.
const ALONG: f64 = 0.95;

/// A law towards a point far away as a force along an axis of the room. `None` for other laws, and
/// where the direction is oblique.
pub(super) fn along_axis(session: &Session<'_>, problem: &Problem, found: &Fitted) -> Option<Fitted> {
    let law = &found.law;
    let [factor] = law.factors.as_slice() else { return None };
    if law.direction != Direction::Towards {
        return None;
    }
    let (point, anchor, _) = law.divided(&found.nonlinear);
    let frames = PlaceFrames::new(session, law.carrier, &point);
    let range = |k: usize| frames.range(Variable::Place(k), &anchor, ENDS);
    let ranges = [range(0)?, range(1)?, range(2)?];
    let middle = Vector3::from(ranges.map(|r| 0.5 * (r.low + r.high)));
    let away = anchor - middle;
    let widest = ranges.iter().map(|r| r.width()).fold(0.0, f64::max);
    let k = away.iamax();
    if away.norm() < FAR * widest || away[k].abs() < ALONG * away.norm() {
        return None;
    }
    let factor = match factor.variable {
        Variable::None => Factor { range: Range { low: 0.0, high: 1.0 }, ..factor.clone() },
        Variable::Distance => {
            Factor { variable: Variable::Place(k), shape: Shape::Affine, range: ranges[k], fixed: None }
        }
        _ => return None,
    };
    let law = Law { direction: Direction::World, components: vec![k], factors: vec![factor], ..law.clone() };
    let mut start = found.nonlinear[..law.point_is.unknowns()].to_vec();
    start.extend(law.delay(&found.nonlinear));
    fit::fit(session, problem, &law, start, STEPS)
}
