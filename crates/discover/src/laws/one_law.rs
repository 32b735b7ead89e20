//! The law for the best entries of the atlas: the simplest expression that is as good as the best,
//! with a second factor where that removes more, or a free curve.

use super::atlas::{ENDS, Group, MANY_LINKS, PlaceFrames, columns, of_clock, stride};
use super::delayed::{LATE_STEPS, delayed, may_be_late};
use super::evidence::Evidence;
use super::fit::{self, Fitted};
use super::kinematics::{Action, Carrier, Variable};
use super::law::{Factor, Law};
use super::off_link::{ALSO, on_its_link, on_neighbours};
use super::shape::{KNOTS, Range, Shape};
use crate::problem::Problem;
use crate::progress::{Part, Until};
use crate::session::Session;
use rayon::prelude::*;

/// A law may leave this much more error than the best one if it is simpler.
pub(super) const SIMPLER: f64 = 1.02;
/// A constant strength may leave this much more error than the best law on a person.
const PERSON: f64 = 1.11;
/// A curve is the answer if the best expression leaves this much more error.
const CURVE: f64 = 1.15;
/// A second factor has to leave less than this share of the error.
const SECOND: f64 = 0.85;

/// A law, the next best one that differs from it, and other carriers that the rows do not exclude.
pub(super) struct OneLaw {
    pub best: Fitted,
    pub rival: Option<Fitted>,
    pub also: Vec<Carrier>,
}

/// The law for the best entries: an expression, with a second factor where that removes more, or
/// the free curve. `more` holds further laws, already
/// fitted to these rows.
pub(super) fn one_law(
    session: &Session<'_>,
    problem: &Problem,
    evidence: &Evidence,
    groups: &[&Group],
    more: Vec<Fitted>,
    until: &Until,
) -> Option<OneLaw> {
    let evidence = &evidence.without_draws();
    let person = session.prior.is_some();
    let mut laws = fit::laws(session, problem, evidence, groups, until);
    laws.extend(more);
    laws.sort_by(|a, b| a.error().total_cmp(&b.error()));
    if person && !until.is_over() {
        laws.extend(on_neighbours(session, problem, &laws));
        laws.sort_by(|a, b| a.error().total_cmp(&b.error()));
    }
    if let Some(at) = on_its_link(session.scene, &laws).filter(|_| person) {
        laws[..=at].rotate_right(1);
    }
    let curves: Vec<Fitted> = groups.iter().take(3).filter_map(|g| fit::curve(session, problem, g)).collect();
    let curve = curves.into_iter().min_by(|a, b| a.error().total_cmp(&b.error()));
    let simple = simplest(&laws, person).cloned();
    let mut best = match (simple, curve) {
        (Some(law), Some(curve)) => {
            let ratio = (law.error() / curve.error()).sqrt();
            if ratio > CURVE { curve } else { law }
        }
        (law, curve) => law.or(curve)?,
    };
    // a product may begin with another law than the best single one
    let bases = of_places(std::iter::once(&best).chain(&laws).filter(|l| !l.law.delayed));
    // the clock has many frequencies: on a body of many links it is tried for the best law only
    let few_links = session.scene.model.n_links() <= MANY_LINKS;
    let mut products: Vec<Fitted> = bases
        .into_iter()
        .enumerate()
        .filter(|_| !until.is_over())
        .filter_map(|(i, l)| second_factor(session, problem, evidence, l, few_links || i == 0))
        .collect();
    let waves = laws.iter().filter(|l| wave_of_the_clock(l).is_some()).take(2);
    products.extend(waves.filter(|_| !until.is_over()).filter_map(|l| travelling(session, problem, l)));
    let at_once = at_once(session, problem, std::iter::once(&best).chain(&laws).filter(|l| !l.law.delayed));
    session.counter.begin(Part::Delays, LATE_STEPS * at_once.len());
    let with_delay = |base: &Fitted| simplest(&delayed(session, problem, base, until), person).cloned();
    let late: Vec<Fitted> = at_once.iter().filter_map(with_delay).collect();
    let least = |laws: &[Fitted]| laws.iter().min_by(|a, b| a.error().total_cmp(&b.error())).cloned();
    // an expression with a delay is simpler than a curve
    let is_curve = best.law.factors.iter().any(|f| f.shape == Shape::Curve);
    if let Some(law) = least(&late).filter(|l| is_curve && l.error() <= SIMPLER * SIMPLER * best.error()) {
        best = law;
    }
    let further = least(&[least(&late), least(&products)].into_iter().flatten().collect::<Vec<_>>());
    if let Some(law) = further.filter(|l| l.error() < SECOND * SECOND * best.error()) {
        best = law;
    }
    let best = fit::simplify(session, problem, best);
    let rival = laws.iter().find(|l| !l.is_like(&best)).cloned();
    let also = best.law.carrier.others(as_good(&best, &laws, &late).map(|l| l.law.carrier));
    Some(OneLaw { best, rival, also })
}

/// Laws of one variable that may act late: the first ones of the first places and directions, and
/// the variables of the first law there, each alone. Without its delay a law can look like a
/// product with a second variable.
fn at_once<'l>(
    session: &Session<'_>,
    problem: &Problem,
    laws: impl Iterator<Item = &'l Fitted> + Clone,
) -> Vec<Fitted> {
    let mut out: Vec<Fitted> = of_places(laws.clone().filter(|l| may_be_late(l))).into_iter().cloned().collect();
    for law in of_places(laws) {
        for factor in &law.law.factors {
            let is_tried = |o: &Fitted| {
                o.law.carrier == law.law.carrier
                    && o.law.direction == law.law.direction
                    && o.law.action == law.law.action
                    && o.law.factors[0].variable == factor.variable
            };
            if !out.iter().any(is_tried) {
                out.extend(with_only(session, problem, law, factor.variable).filter(may_be_late));
            }
        }
    }
    out
}

/// The law with its factor of `variable` alone, fitted again; none if it has no such factor, or
/// depends on a point of the room.
fn with_only(session: &Session<'_>, problem: &Problem, law: &Fitted, variable: Variable) -> Option<Fitted> {
    let at = law.law.factors.iter().position(|f| f.variable == variable)?;
    if law.law.has_anchor() {
        return None;
    }
    if law.law.factors.len() == 1 {
        return Some(law.clone());
    }
    let (_, _, parts) = law.law.divided(&law.nonlinear);
    let only = Law { factors: vec![law.law.factors[at].clone()], ..law.law.clone() };
    let start = [&law.nonlinear[..law.law.point_is.unknowns()], parts[at]].concat();
    fit::fit(session, problem, &only, start, fit::STEPS)
}

/// Laws that leave hardly more error than the best one. Beside a law with a delay these are laws
/// that do so without its delay, unless a delay on their place was tried and leaves more.
fn as_good<'l>(best: &'l Fitted, laws: &'l [Fitted], late: &'l [Fitted]) -> impl Iterator<Item = &'l Fitted> {
    let by_action = |l: &&Fitted| l.law.action == best.law.action;
    let on = |l: &Fitted, carrier| l.law.carrier == carrier;
    let at_once = laws.iter().filter(move |l| by_action(l) && !l.law.delayed);
    let here = at_once.clone().filter(|l| on(l, best.law.carrier)).map(Fitted::error).fold(f64::INFINITY, f64::min);
    let without = if best.law.delayed && here.is_finite() { here } else { best.error() };
    let refused = move |l: &Fitted| {
        let there = late.iter().chain(laws).filter(|o| o.law.delayed && by_action(o) && on(o, l.law.carrier));
        let least = there.map(Fitted::error).fold(f64::INFINITY, f64::min);
        best.law.delayed && least.is_finite() && least > ALSO * ALSO * best.error()
    };
    at_once.filter(move |l| l.error() <= ALSO * ALSO * without && !refused(l))
}

/// The first of the laws of each of the first three places and directions.
fn of_places<'l>(laws: impl Iterator<Item = &'l Fitted>) -> Vec<&'l Fitted> {
    let mut out: Vec<&Fitted> = Vec::new();
    for l in laws {
        let same = |o: &&Fitted| {
            o.law.carrier == l.law.carrier && o.law.direction == l.law.direction && o.law.action == l.law.action
        };
        if out.len() < 3 && !out.iter().any(same) {
            out.push(l);
        }
    }
    out
}

/// The simplest law whose error is as good as the best one's.
fn simplest(laws: &[Fitted], person: bool) -> Option<&Fitted> {
    let best = laws.first()?;
    let n = best.errors.len() as f64;
    let as_good = |f: &&Fitted| {
        // fewer unknowns are no reason to move a force to another link
        if f.law.carrier != best.law.carrier || f.law.action != best.law.action {
            return false;
        }
        let d: Vec<f64> = f.errors.iter().zip(&best.errors).map(|(a, b)| a - b).collect();
        let mean = d.iter().sum::<f64>() / n;
        let sd = (d.iter().map(|x| (x - mean) * (x - mean)).sum::<f64>() / (n - 1.0).max(1.0)).sqrt();
        let ratio = (f.error() / best.error()).sqrt();
        // soft tissue imitates smooth dependences: on a person they need stronger evidence
        let constant = f.law.factors.iter().all(|f| f.shape == Shape::Constant)
            && f.law.carrier == best.law.carrier
            && f.law.action == best.law.action
            && f.law.direction == best.law.direction;
        ratio <= SIMPLER || (person && constant && ratio <= PERSON) || (mean <= sd / n.sqrt() && ratio <= 1.05)
    };
    // of two variables that serve equally well, the speed describes a resistance rather than one
    // component of the velocity
    let one_sided = |f: &Fitted| {
        let magnitude = f.law.direction.magnitude();
        magnitude.is_some_and(|m| f.law.factors.iter().any(|f| f.variable != m && f.variable != Variable::None))
    };
    // one variable is simpler than two, whatever the number of unknowns
    let key = |f: &Fitted| (f.law.factors.len(), f.unknowns, one_sided(f));
    laws.iter().filter(as_good).min_by(|a, b| key(a).cmp(&key(b)).then(a.error().total_cmp(&b.error())))
}

/// The factor of a law that is nothing but a wave of the clock.
fn wave_of_the_clock(law: &Fitted) -> Option<&Factor> {
    let [only] = &law.law.factors[..] else { return None };
    let wave = matches!(only.shape, Shape::Sine | Shape::Wave | Shape::WaveAbout);
    (wave && only.variable == Variable::Clock && !law.law.delayed).then_some(only)
}

/// A wave of the clock as one that travels through the room: waves of clock and place, of which the
/// products of sines and cosines hold both directions of travel.
fn travelling(session: &Session<'_>, problem: &Problem, law: &Fitted) -> Option<Fitted> {
    /// Steps of a fit from each start, of which the best is fitted to the end.
    const FEW: usize = 2;
    let of_clock = wave_of_the_clock(law)?;
    let (point, anchor, _) = law.law.divided(&law.nonlinear);
    let frames = PlaceFrames::new(session, law.law.carrier, &point);
    let places = (0..3).filter_map(|axis| {
        let variable = Variable::Place(axis);
        Some((variable, frames.range(variable, &anchor, ENDS)?))
    });
    let starts: Vec<(Law, Vec<f64>)> = places
        .flat_map(|(variable, range)| {
            let clock = Factor { shape: Shape::Wave, ..of_clock.clone() };
            let place = Factor { variable, shape: Shape::Wave, range, fixed: None };
            let with = Law { factors: vec![clock, place], ..law.law.clone() };
            Shape::Wave
                .starts(range, false)
                .into_iter()
                .map(move |p| (with.clone(), [law.nonlinear.as_slice(), &p].concat()))
        })
        .collect();
    let begun = starts.into_par_iter().filter_map(|(law, start)| fit::fit(session, problem, &law, start, FEW));
    let best = begun.collect::<Vec<_>>().into_iter().min_by(|a, b| a.error().total_cmp(&b.error()))?;
    fit::fit(session, problem, &best.law, best.nonlinear.clone(), fit::STEPS)
}

/// A variable that may be a second factor of a law.
struct Second {
    /// Share of the error that a curve of it, or a wave of the clock, leaves.
    ratio: f64,
    variable: Variable,
    range: Range,
    /// Angular frequency of the wave, rad/s.
    frequency: Option<f64>,
}

impl Second {
    /// Shapes with the values of their parameters from which a fit starts.
    fn shapes(&self) -> Vec<(Shape, Vec<f64>)> {
        if let Some(k) = self.frequency {
            return vec![(Shape::WaveAbout, vec![k])];
        }
        Shape::of(self.variable.is_signed(), false, false)
            .into_iter()
            .filter(|s| !matches!(s, Shape::Sine | Shape::Wave))
            .flat_map(|s| s.starts(self.range, false).into_iter().map(move |p| (s, p)))
            .collect()
    }
}

/// A law times a function of a second variable, of the clock only if `of_the_clock`.
fn second_factor(
    session: &Session<'_>,
    problem: &Problem,
    evidence: &Evidence,
    law: &Fitted,
    of_the_clock: bool,
) -> Option<Fitted> {
    let scene = session.scene;
    let (point, anchor, parts) = law.law.divided(&law.nonlinear);
    let frames = PlaceFrames::new(session, law.law.carrier, &point);
    // the whole force of the law as one column
    let unit: Vec<Vec<Vec<[f64; 6]>>> = law
        .frames(session)
        .iter()
        .map(|t| {
            let mut strengths = Vec::new();
            let column = t
                .iter()
                .map(|at| {
                    let v = law.vector(at, &anchor, &parts, &mut strengths);
                    let m = at.now.position.cross(&v);
                    match law.law.action {
                        Action::Force => [v.x, v.y, v.z, m.x, m.y, m.z],
                        Action::Couple => [0.0, 0.0, 0.0, v.x, v.y, v.z],
                    }
                })
                .collect();
            vec![column]
        })
        .collect();
    let stride = stride(session);
    let score_of = |shape: Shape, p: &[f64], variable: Variable, range| {
        let nb = shape.terms();
        let mut buffer = [0.0; KNOTS];
        let weight: Vec<Vec<f64>> = frames
            .values(variable, &anchor)
            .iter()
            .map(|t| {
                let mut w = Vec::with_capacity(t.len() * nb);
                for x in t {
                    shape.values(*x, p, range, &mut buffer[..nb]);
                    w.extend_from_slice(&buffer[..nb]);
                }
                w
            })
            .collect();
        let made = columns(session, problem, &unit, &weight, nb, stride);
        if !made.iter().all(|c| c.iter().all(|x| x.is_finite())) {
            return None;
        }
        let all: Vec<usize> = (0..nb).collect();
        evidence.score(&evidence.prepare(&made, nb), &all).map(|s| s.ratio)
    };
    let is_new = |v: Variable| law.law.factors.iter().all(|f| f.variable != v);
    let mut tried: Vec<Second> = Variable::of(scene)
        .into_par_iter()
        .filter(|v| *v != Variable::None && is_new(*v))
        .filter_map(|variable| {
            let range = frames.range(variable, &anchor, ENDS)?;
            let ratio = score_of(Shape::Curve, &[], variable, range)?;
            Some(Second { ratio, variable, range, frequency: None })
        })
        .collect();
    let variable = Variable::Clock;
    if let Some(range) = frames.range(variable, &anchor, 0.0).filter(|_| of_the_clock && is_new(variable)) {
        let of = |k: f64| {
            let ratio = score_of(Shape::WaveAbout, &[k], variable, range)?;
            Some(Second { ratio, variable, range, frequency: Some(k) })
        };
        let waves: Vec<Second> = of_clock(&frames).into_par_iter().filter_map(of).collect();
        tried.extend(waves.into_iter().min_by(|a, b| a.ratio.total_cmp(&b.ratio)));
    }
    tried.sort_by(|a, b| a.ratio.total_cmp(&b.ratio));
    let plain = law.error() / evidence.plain[0];
    let mut best: Option<Fitted> = None;
    for second in tried.into_iter().take(3) {
        if second.ratio > SECOND * SECOND * plain {
            break;
        }
        let Second { variable, range, .. } = second;
        let mut shapes: Vec<(f64, Shape, Vec<f64>)> = second
            .shapes()
            .into_iter()
            .filter(|(s, _)| law.law.terms() * s.terms() <= 4)
            .filter_map(|(s, p)| Some((score_of(s, &p, variable, range)?, s, p)))
            .collect();
        shapes.sort_by(|a, b| a.0.total_cmp(&b.0));
        let mut seen: Vec<Shape> = Vec::new();
        for (_, shape, p) in shapes {
            if seen.contains(&shape) {
                continue;
            }
            seen.push(shape);
            if seen.len() > 3 {
                break;
            }
            let mut with: Law = law.law.clone();
            // a constant first factor is replaced, not multiplied
            with.factors.retain(|f| f.shape != Shape::Constant);
            with.factors.push(Factor { variable, shape, range, fixed: None });
            let start = [law.nonlinear.as_slice(), p.as_slice()].concat();
            if let Some(f) = fit::fit(session, problem, &with, start, 15)
                && best.as_ref().is_none_or(|b| f.error() < b.error())
            {
                best = Some(f);
            }
        }
    }
    best
}
