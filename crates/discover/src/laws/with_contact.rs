//! The law that flights and contact show together.
//!
//! A force that acts whenever the body moves also acts on the ground. There the plates measure for
//! longer, and over a wider range of postures and speeds. The places and directions that fit the
//! flights best are tried with every variable on the rows of both. A law of both replaces the law
//! of the flights unless the flights contradict it.

use super::atlas::{
    Group, Line, MANY_LINKS, POWERS, PlaceFrames, SPLINES, Towards, anchors, columns, curve_of, stride, towards,
};
use super::evidence::{DRAWS, Evidence};
use super::fit::{self, Fitted, STEPS, TRIED, places};
use super::kinematics::{Action, Carrier, Direction, Variable};
use super::one_law::{OneLaw, one_law};
use super::two_variables::{Resistance, resistance, without_idle_factors};
use crate::options::DiscoverOptions;
use crate::problem::{Domain, Problem};
use crate::progress::{Part, Until};
use crate::session::Session;
use crate::thin::{FEWEST, with_at_most};
use aloft_regressor::StretchKind;
use nalgebra::{DMatrix, Vector3};
use rayon::prelude::*;

/// Places and directions that are tried: those that fit the flights best.
const PLACES: usize = 24;
/// Links on which a force towards points of the room is tried.
const TOWARDS: usize = 3;
/// Most flights and contact stretches from which a law is sought.
const MOST_STRETCHES: usize = 160;
/// A law of both may leave this much more error in flight than the law of the flights alone.
pub(super) const IN_FLIGHT: f64 = 1.15;

/// Most rows of contact in one recording: 250 windows, about 20 s. The search inverts a matrix of
/// this size for each recording.
const MOST_ROWS: usize = 1500;

/// The session with all flights and, of each recording, the first contact stretches that together
/// have at most [`MOST_ROWS`].
pub(super) fn in_use<'a>(session: &Session<'a>) -> Session<'a> {
    let mut rows = vec![0; session.series.len()];
    let kept: Vec<bool> = session
        .blocks
        .iter()
        .map(|b| {
            let more = rows[b.trial] + b.y.nrows();
            let fits = b.kind != StretchKind::Contact || more <= MOST_ROWS;
            if b.kind == StretchKind::Contact && fits {
                rows[b.trial] = more;
            }
            fits
        })
        .collect();
    session.with_rows_of(&kept)
}

/// What was found in flight.
pub(super) struct Flights<'s, 'a> {
    pub session: &'s Session<'a>,
    pub problem: &'s Problem,
    /// Best entries of their atlas.
    pub groups: &'s [Group],
    /// Law of the flights alone.
    pub law: Option<&'s OneLaw>,
    /// Lines along which effects found in flight act.
    pub lines: &'s [Line],
}

/// A law of flights and contact.
pub(super) struct OfBoth {
    pub law: OneLaw,
    /// Probability by chance.
    pub p: f64,
}

/// The law of flights and contact together with its probability by chance, if it leaves less than
/// `believed` of the error on the rows of both, and less than the root of `believed` on those of
/// flights. `extra` holds the columns of the model's effects and laws on all rows.
pub(super) fn with_contact(
    session: &Session<'_>,
    extra: &[Vec<DMatrix<f64>>],
    flights: &Flights<'_, '_>,
    believed: f64,
    until: &Until,
    options: &DiscoverOptions,
) -> Option<OfBoth> {
    let all = Problem::if_possible(session, Domain::Both, extra, options)?;
    let some = with_at_most(session, &all, MOST_STRETCHES, FEWEST);
    let (session, both) = some.as_ref().map_or((session, &all), |(s, p, _)| (s, p));
    let evidence = Evidence::new(both, DRAWS, options.seed)?;
    let tried = places(&flights.groups.iter().collect::<Vec<_>>(), PLACES);
    session.counter.begin(Part::WithContact, tried.len());
    let in_place = |place: &Group| {
        let made = with_every_variable(session, both, &evidence, place);
        session.counter.one();
        made
    };
    let mut made: Vec<Group> = tried.into_par_iter().flat_map_iter(in_place).collect();
    made.sort_by(|a, b| a.score.ratio.total_cmp(&b.score.ratio));
    let mut forces: Vec<Group> = Vec::new();
    for g in made.iter().filter(|g| g.action == Action::Force) {
        if forces.len() < TOWARDS && !forces.iter().any(|f| f.carrier == g.carrier) {
            forces.push(g.clone());
        }
    }
    made.extend(forces.iter().flat_map(|place| towards_every_point(session, both, &evidence, place)));
    if let Some(like) = forces.first() {
        made.extend(flights.lines.iter().flat_map(|line| along_line(session, both, &evidence, line, like)));
    }
    made.sort_by(|a, b| a.score.ratio.total_cmp(&b.score.ratio));
    let best = made.first()?;
    let as_good = |draw: &usize| made.iter().any(|g| g.score.null[*draw] <= best.score.ratio);
    let p = ((0..DRAWS).filter(as_good).count() + 1) as f64 / (DRAWS + 1) as f64;
    // a second factor or a threshold can remove more than a curve of one variable
    let may_do = best.score.ratio.sqrt() < believed.sqrt();
    if p >= options.significance || !may_do || until.is_over() {
        return None;
    }
    let groups = fit::distinct(&made, TRIED);
    let again = |f: &Fitted| fit::fit(session, both, &f.law, f.nonlinear.clone(), STEPS);
    let of_flights = flights.law.iter().flat_map(|l| std::iter::once(&l.best).chain(&l.rival)).filter_map(again);
    let OneLaw { best, rival, also } = one_law(session, both, &evidence, &groups, of_flights.collect(), until)?;
    let plain = |p: &Problem| p.folds.iter().map(|f| f.error).sum::<f64>();
    let left = best.error() / plain(both);
    let best = judged_in_flight(flights, best)?;
    let left_in_flight = best.error() / plain(flights.problem);
    let worse = flights.law.is_some_and(|l| best.error() > IN_FLIGHT * IN_FLIGHT * l.best.error());
    // squared errors; flights alone are fewer, so a larger share may remain there
    (left < believed * believed && left_in_flight < believed && !worse).then(|| {
        let rival = rival.and_then(|r| judged_in_flight(flights, r));
        OfBoth { law: OneLaw { best, rival, also }, p }
    })
}

/// A law of both with its held-out errors on flights.
fn judged_in_flight(flights: &Flights<'_, '_>, law: Fitted) -> Option<Fitted> {
    let errors = fit::fit(flights.session, flights.problem, &law.law, law.nonlinear.clone(), 0)?.errors;
    Some(Fitted { errors, ..law })
}

/// Entries of a place and direction with a free curve of each variable.
fn with_every_variable(session: &Session<'_>, both: &Problem, evidence: &Evidence, place: &Group) -> Vec<Group> {
    let frames = PlaceFrames::new(session, place.carrier, &place.point);
    let unit = frames.unit(place.action, place.direction, &place.components, &place.anchor);
    let of = |variable: Variable| {
        let (range, weight, nb) = curve_of(&frames, variable, &place.anchor)?;
        let entry = Group { variable, range, frequency: None, ..place.clone() };
        scored(session, both, evidence, &unit, &weight, nb, entry)
    };
    let mut out: Vec<Group> = Variable::of(session.scene).into_iter().filter_map(of).collect();
    let is_drag = place.action == Action::Force && place.direction == Direction::AgainstVelocity;
    if is_drag && session.scene.model.n_links() > MANY_LINKS {
        let of_two = |variable: Variable| {
            let Resistance { speed, range, weight } = resistance(&frames, variable)?;
            let second = Some((variable, range));
            let entry = Group { variable: Variable::Speed, range: speed, second, frequency: None, ..place.clone() };
            scored(session, both, evidence, &unit, &weight, SPLINES, entry)
        };
        let others = Variable::of(session.scene).into_iter().filter(|v| *v != Variable::None && !v.is_rate());
        out.extend(others.filter_map(of_two));
        without_idle_factors(&mut out);
    }
    out
}

/// Entries of a force of a place towards points of the room.
fn towards_every_point(session: &Session<'_>, both: &Problem, evidence: &Evidence, place: &Group) -> Vec<Group> {
    let frames = PlaceFrames::new(session, place.carrier, &place.point);
    let of = |anchor: Vector3<f64>| {
        let Towards { unit, weight, range } = towards(&frames, &anchor)?;
        let at = Group { direction: Direction::Towards, components: vec![0], anchor, ..place.clone() };
        let entry = Group { variable: Variable::Distance, range, frequency: None, second: None, ..at };
        scored(session, both, evidence, &unit, &weight, POWERS, entry)
    };
    anchors(session.scene, &frames).into_par_iter().filter_map(of).collect()
}

/// Entries of a force along a line, with powers of the distance and a free curve of each variable.
/// `like` is any entry of a force.
fn along_line(session: &Session<'_>, both: &Problem, evidence: &Evidence, line: &Line, like: &Group) -> Vec<Group> {
    let (carrier, point, anchor) = (Carrier::Link(line.link), line.point, line.anchor);
    let frames = PlaceFrames::new(session, carrier, &point);
    let at = Group { carrier, point, anchor, direction: Direction::Towards, components: vec![0], ..like.clone() };
    let of_distance = towards(&frames, &anchor).and_then(|Towards { unit, weight, range }| {
        let entry = Group { variable: Variable::Distance, range, frequency: None, second: None, ..at.clone() };
        scored(session, both, evidence, &unit, &weight, POWERS, entry)
    });
    let mut out = with_every_variable(session, both, evidence, &at);
    out.extend(of_distance);
    out
}

/// An entry with its score on the rows of both; `None` if its columns are not finite or not seen.
fn scored(
    session: &Session<'_>,
    both: &Problem,
    evidence: &Evidence,
    unit: &[Vec<Vec<[f64; 6]>>],
    weight: &[Vec<f64>],
    nb: usize,
    entry: Group,
) -> Option<Group> {
    let made = columns(session, both, unit, weight, nb, stride(session));
    if !made.iter().all(|c| c.iter().all(|x| x.is_finite())) {
        return None;
    }
    let all: Vec<usize> = (0..made[0].ncols()).collect();
    let score = evidence.score(&evidence.prepare(&made, if nb == SPLINES { nb } else { 0 }), &all)?;
    Some(Group { columns: all.len(), score, ..entry })
}
