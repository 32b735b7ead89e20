//! From an entry of the atlas to a law: shapes with their parameters are screened linearly, the
//! best are fitted with point, anchor and parameters free, again in every fold.

use super::atlas::{ENDS, Group, PlaceFrames, columns, stride};
use super::evidence::Evidence;
use super::far_point::along_axis;
use super::kinematics::{Action, Carrier, Direction, Variable};
use super::law::{Factor, Law, LawFrame, PointIs};
use super::shape::{KNOTS, Range, Shape};
use super::two_variables::RESISTANCE;
use crate::candidate::{Variant, score};
use crate::nonlinear::{improve, score_fitted};
use crate::problem::Problem;
use crate::progress::{Part, Until};
use crate::session::Session;
use aloft_effects::{Effect, Series, Target};
use nalgebra::{DMatrix, DVector, Vector3};
use rayon::prelude::*;

/// Gauss-Newton steps of a fit.
pub(crate) const STEPS: usize = 15;
/// Entries of the atlas for which laws are fitted.
pub(crate) const TRIED: usize = 12;
/// Shapes of one entry that are fitted.
const SHAPES: usize = 4;

/// A law fitted to all rows, with its held-out errors.
#[derive(Debug, Clone)]
pub(crate) struct Fitted {
    pub law: Law,
    pub nonlinear: Vec<f64>,
    pub theta: DVector<f64>,
    /// Squared held-out error by cluster.
    pub errors: Vec<f64>,
    /// Standard errors of coefficients, then of nonlinear parameters; with the degrees of freedom.
    pub se: Vec<f64>,
    pub freedom: Vec<f64>,
    pub unknowns: usize,
}

impl Fitted {
    /// Force (N) or couple (N·m) in a frame, world axes.
    pub fn vector(
        &self,
        LawFrame { now, then }: &LawFrame<'_>,
        anchor: &Vector3<f64>,
        parts: &[&[f64]],
        strengths: &mut Vec<f64>,
    ) -> Vector3<f64> {
        let parameters = self.law.parameters_of(parts);
        let mut v = Vector3::zeros();
        for (frame, at, share) in then.iter().filter(|(_, _, share)| *share != 0.0) {
            self.law.strengths(frame, at, anchor, &parameters, strengths);
            let mut i = 0;
            for s in strengths.iter() {
                for &k in &self.law.components {
                    v += self.law.direction.vector_of(k, at, now, anchor) * (self.theta[i] * s * share);
                    i += 1;
                }
            }
        }
        v
    }

    /// Frames of a session with the motion that the law follows there, by series.
    pub fn frames<'s>(&self, session: &'s Session<'_>) -> Vec<Vec<LawFrame<'s>>> {
        let (point, _, _) = self.law.divided(&self.nonlinear);
        let delay = self.law.delay(&self.nonlinear);
        let of = |series: &'s Series<'_>| {
            series.instants().map(|(i, frame)| self.law.at(series, i, &frame, &point, delay)).collect()
        };
        let in_use = session.series_in_use();
        session.series.iter().flatten().zip(in_use).map(|(s, used)| if used { of(s) } else { Vec::new() }).collect()
    }

    /// True if place, direction and variables are those of another law, and both or neither are
    /// late.
    pub fn is_like(&self, other: &Self) -> bool {
        let of = |f: &Self| {
            let variables: Vec<Variable> = f.law.factors.iter().map(|f| f.variable).collect();
            (f.law.carrier, f.law.action, f.law.direction, variables, f.law.delayed)
        };
        of(self) == of(other)
    }

    /// Squared held-out error.
    pub fn error(&self) -> f64 {
        self.errors.iter().sum()
    }
}

/// Fits a law from starting values of its nonlinear parameters. The values of the fit are within
/// the law's bounds, so that the law can be stated and added with them.
pub(crate) fn fit(
    session: &Session<'_>,
    problem: &Problem,
    law: &Law,
    mut start: Vec<f64>,
    steps: usize,
) -> Option<Fitted> {
    let bounds = law.nonlinear(session.scene, Target::Body);
    start.iter_mut().zip(&bounds).for_each(|(x, b)| *x = x.clamp(b.lower, b.upper));
    let variant = Variant::new(session, law, Target::Body, start);
    let fitted = bounds.len();
    let scored = if fitted == 0 {
        let columns = variant.columns(session, problem)?;
        score(problem, variant, &problem.reduce(&columns))
    } else {
        let (better, _) = improve(session, problem, &variant, steps)?;
        score_fitted(session, problem, better)?
    };
    let k = scored.theta.len();
    let se = if scored.joint_se.is_empty() {
        (0..k)
            .map(|i| {
                let left: Vec<f64> = scored.fold_theta.iter().map(|t| t[i]).collect();
                crate::statistics::jackknife_se(&left)
            })
            .collect()
    } else {
        scored.joint_se.clone()
    };
    scored.fold_error.iter().all(|e| e.is_finite()).then(|| Fitted {
        law: law.clone(),
        nonlinear: scored.variant.nonlinear.clone(),
        unknowns: law.unknowns(session.scene),
        theta: scored.theta,
        errors: scored.fold_error,
        se,
        freedom: scored.freedom,
    })
}

/// A law with a shape, and the start of its nonlinear parameters.
struct Start {
    law: Law,
    nonlinear: Vec<f64>,
    ratio: f64,
}

/// The law of an entry with a shape and values of its parameters.
fn law_of(group: &Group, shape: Shape, values: &[f64], free_point: bool) -> (Law, Vec<f64>) {
    let variable = if shape == Shape::Constant { Variable::None } else { group.variable };
    let free_point = free_point && group.action == Action::Force && group.carrier != Carrier::Body;
    let law = Law {
        id: "law".to_owned(),
        carrier: group.carrier,
        action: group.action,
        direction: group.direction,
        components: group.components.clone(),
        factors: vec![Factor { variable, shape, range: group.range, fixed: None }],
        point: group.point,
        point_is: if free_point { PointIs::Free } else { PointIs::Given },
        zeros: Vec::new(),
        delayed: false,
    };
    let mut start = Vec::new();
    if free_point {
        start.extend(group.point.iter());
    }
    if law.has_anchor() {
        start.extend(group.anchor.iter());
    }
    start.extend(values);
    (law, start)
}

/// Laws for one entry: each shape from its best start.
fn starts(session: &Session<'_>, problem: &Problem, evidence: &Evidence, group: &Group) -> Vec<Start> {
    if let Some((variable, range)) = group.second.filter(|_| group.is_resistance_of_two()) {
        return resistances(session, problem, evidence, group, variable, range);
    }
    if let Some((variable, range)) = group.second {
        let of = |(first, shape, values): (Shape, Shape, &[f64])| {
            let (mut law, mut nonlinear) = law_of(group, first, &[], true);
            law.factors.push(Factor { variable, shape, range, fixed: None });
            nonlinear.extend(values);
            Start { law, nonlinear, ratio: group.score.ratio }
        };
        let mut shapes: Vec<(Shape, Shape, &[f64])> = vec![(Shape::Linear, Shape::Linear, &[])];
        if variable.is_rate() {
            shapes.push((Shape::Linear, Shape::EvenPower, &[1.0]));
        } else {
            shapes.push((Shape::Linear, Shape::Affine, &[]));
        }
        if group.is_of_two_places() {
            shapes.extend([Shape::Linear, Shape::Affine].map(|second| (Shape::Affine, second, &[][..])));
        }
        return shapes.into_iter().map(of).collect();
    }
    let frames = PlaceFrames::new(session, group.carrier, &group.point);
    let distance = group.variable == Variable::Distance;
    let mut shapes = vec![Shape::Constant];
    match group.variable {
        Variable::None => {}
        v => {
            let periodic = v == Variable::Clock || group.frequency.is_some();
            shapes.extend(Shape::of(v.is_signed(), distance, periodic));
        }
    }
    screened(session, problem, evidence, group, &frames, &shapes, None)
}

/// Laws for a resistance with a free power of the speed that depends on another variable.
fn resistances(
    session: &Session<'_>,
    problem: &Problem,
    evidence: &Evidence,
    group: &Group,
    variable: Variable,
    range: Range,
) -> Vec<Start> {
    let frames = PlaceFrames::new(session, group.carrier, &group.point);
    let speeds = frames.values(Variable::Speed, &group.anchor);
    let sizes: Vec<Vec<f64>> = speeds.iter().map(|t| t.iter().map(|v| v.powf(RESISTANCE)).collect()).collect();
    let of_speed = Factor { variable: Variable::Speed, shape: Shape::EvenPower, range: group.range, fixed: None };
    let shapes: Vec<Shape> = Shape::of(variable.is_signed(), false, false)
        .into_iter()
        .filter(|s| !matches!(s, Shape::Sine | Shape::Wave))
        .collect();
    let other = Group { variable, range, second: None, ..group.clone() };
    let mut out = screened(session, problem, evidence, &other, &frames, &shapes, Some(&sizes));
    for start in &mut out {
        start.law.factors.insert(0, of_speed.clone());
        start.nonlinear.insert(start.law.point_is.unknowns(), RESISTANCE);
    }
    out
}

/// Values of a shape's parameters from which a fit starts, for an entry.
fn parameters(shape: Shape, group: &Group) -> Vec<Vec<f64>> {
    let Some(k) = group.frequency else {
        return shape.starts(group.range, group.variable == Variable::Distance);
    };
    match shape {
        Shape::Sine | Shape::Wave | Shape::WaveAbout => vec![vec![k]],
        Shape::Pulses => {
            let phases = (0..8).map(|i| f64::from(i) * std::f64::consts::FRAC_PI_4 - std::f64::consts::PI);
            phases.flat_map(|a| [-0.5, 0.0, 0.5].map(|b| vec![k, a, b])).collect()
        }
        _ => vec![Vec::new()],
    }
}

/// Shapes for an entry, each from its best start, best first. `times` multiplies the strength in
/// every frame, by series.
fn screened(
    session: &Session<'_>,
    problem: &Problem,
    evidence: &Evidence,
    group: &Group,
    frames: &PlaceFrames<'_>,
    shapes: &[Shape],
    times: Option<&[Vec<f64>]>,
) -> Vec<Start> {
    let unit = frames.unit(group.action, group.direction, &group.components, &group.anchor);
    let values = frames.values(group.variable, &group.anchor);
    let stride = stride(session);
    let mut out: Vec<Start> = Vec::new();
    for &shape in shapes {
        let nb = shape.terms();
        let mut best: Option<Start> = None;
        for p in parameters(shape, group) {
            let mut buffer = [0.0; KNOTS];
            let weight: Vec<Vec<f64>> = values
                .iter()
                .enumerate()
                .map(|(series, t)| {
                    let mut w = Vec::with_capacity(t.len() * nb);
                    for (i, x) in t.iter().enumerate() {
                        shape.values(*x, &p, group.range, &mut buffer[..nb]);
                        let factor = times.map_or(1.0, |of| of[series][i]);
                        w.extend(buffer[..nb].iter().map(|b| b * factor));
                    }
                    w
                })
                .collect();
            let made = columns(session, problem, &unit, &weight, nb, stride);
            if !made.iter().all(|c: &DMatrix<f64>| c.iter().all(|x| x.is_finite())) {
                continue;
            }
            let all: Vec<usize> = (0..made[0].ncols()).collect();
            let Some(score) = evidence.score(&evidence.prepare(&made, 0), &all) else { continue };
            if best.as_ref().is_none_or(|b| score.ratio < b.ratio) {
                let (law, nonlinear) = law_of(group, shape, &p, true);
                best = Some(Start { law, nonlinear, ratio: score.ratio });
            }
        }
        out.extend(best);
    }
    out.sort_by(|a, b| a.ratio.total_cmp(&b.ratio));
    out
}

/// Entries of the atlas that differ in place, direction or variable, best first.
pub(crate) fn distinct(groups: &[Group], most: usize) -> Vec<&Group> {
    let mut out: Vec<&Group> = Vec::new();
    for g in groups {
        let same = |o: &&Group| {
            o.carrier == g.carrier
                && o.action == g.action
                && o.direction == g.direction
                && o.variable == g.variable
                && o.second.map(|s| s.0) == g.second.map(|s| s.0)
                && (g.frequency.is_none() || o.frequency.is_some())
        };
        if !out.iter().any(same) {
            out.push(g);
        }
        if out.len() == most {
            break;
        }
    }
    out
}

/// Places and directions, best first.
pub(super) fn places<'g>(groups: &[&'g Group], most: usize) -> Vec<&'g Group> {
    let mut out: Vec<&Group> = Vec::new();
    for g in groups {
        let same = |o: &&Group| o.carrier == g.carrier && o.action == g.action && o.direction == g.direction;
        if g.direction != Direction::Towards && g.second.is_none() && !out.iter().any(same) {
            out.push(g);
        }
        if out.len() == most {
            break;
        }
    }
    out
}

/// Shapes that are tried in every variable.
const EVERYWHERE: [Shape; 5] = [Shape::Linear, Shape::Affine, Shape::Switch, Shape::RampUp, Shape::RampDown];

/// Laws with a straight line or a threshold in any variable, for the place and direction of an
/// entry: a smooth curve does not follow a threshold, and a curve with many values predicts a
/// flight beyond the range of the others worse than a line, so their variable need not be among the
/// best.
fn in_every_variable(session: &Session<'_>, problem: &Problem, evidence: &Evidence, group: &Group) -> Vec<Start> {
    let frames = PlaceFrames::new(session, group.carrier, &group.point);
    let mut out: Vec<Start> = Vec::new();
    for variable in Variable::of(session.scene) {
        let Some(range) = frames.range(variable, &group.anchor, ENDS) else { continue };
        let of = Group { variable, range, frequency: None, ..group.clone() };
        out.extend(screened(session, problem, evidence, &of, &frames, &EVERYWHERE, None));
    }
    out.sort_by(|a, b| a.ratio.total_cmp(&b.ratio));
    out
}

/// Fits laws to the best entries of the atlas, best first.
pub(crate) fn laws(
    session: &Session<'_>,
    problem: &Problem,
    evidence: &Evidence,
    groups: &[&Group],
    until: &Until,
) -> Vec<Fitted> {
    let begun: Vec<Start> = groups
        .par_iter()
        .flat_map_iter(|g| starts(session, problem, evidence, g).into_iter().take(SHAPES).collect::<Vec<_>>())
        .collect();
    let best: Vec<&Group> = places(groups, 3);
    let everywhere: Vec<Start> = best
        .par_iter()
        .flat_map_iter(|g| {
            in_every_variable(session, problem, evidence, g).into_iter().take(SHAPES).collect::<Vec<_>>()
        })
        .collect();
    // identical laws come from entries that differ in the variable only
    let mut unique: Vec<Start> = Vec::new();
    for s in begun.into_iter().chain(everywhere) {
        if !unique.iter().any(|u| u.law == s.law && u.nonlinear == s.nonlinear) {
            unique.push(s);
        }
    }
    session.counter.begin(Part::Laws, unique.len());
    let one = |s: Start| {
        let fitted = if until.is_over() { None } else { fit(session, problem, &s.law, s.nonlinear, STEPS) };
        session.counter.one();
        fitted
    };
    let mut out: Vec<Fitted> = unique.into_par_iter().filter_map(one).collect();
    out.sort_by(|a, b| a.error().total_cmp(&b.error()));
    out
}

/// The free curve of an entry, with a free point.
pub(crate) fn curve(session: &Session<'_>, problem: &Problem, group: &Group) -> Option<Fitted> {
    if group.second.is_some() {
        return None;
    }
    let shape = match group.variable {
        Variable::None => Shape::Constant,
        _ if group.frequency.is_some() => Shape::WaveAbout,
        _ => Shape::Curve,
    };
    let values = group.frequency.map_or_else(Vec::new, |k| vec![k]);
    let (mut law, start) = law_of(group, shape, &values, true);
    if shape == Shape::Curve {
        // the ends of a curve need rows in every fold
        let frames = PlaceFrames::new(session, group.carrier, &group.point);
        let range = frames.range(group.variable, &group.anchor, 0.05)?;
        law.factors.iter_mut().for_each(|f| f.range = range);
    }
    fit(session, problem, &law, start, STEPS)
}

/// Simpler forms of a law that leave nearly the same error: an axis of the room for a point far
/// away, the point at the centre of mass, a power that is a small integer or a half.
pub(crate) fn simplify(session: &Session<'_>, problem: &Problem, found: Fitted) -> Fitted {
    /// Largest growth of the squared error.
    const MORE: f64 = 1.02;
    let near = along_axis(session, problem, &found).filter(|f| f.error() <= MORE * found.error());
    let mut best = near.unwrap_or(found);
    let (point, anchor, parts) = best.law.divided(&best.nonlinear);
    let parts: Vec<Vec<f64>> = parts.into_iter().map(<[f64]>::to_vec).collect();
    let of_point = best.nonlinear[..best.law.point_is.unknowns()].to_vec();
    // a power that is nearly a simple number
    for (i, p) in parts.iter().enumerate() {
        let shape = best.law.factors[i].shape;
        if !matches!(shape, Shape::Power | Shape::EvenPower) || best.law.factors[i].fixed.is_some() {
            continue;
        }
        let n = p[0];
        let near = (n * 2.0).round() / 2.0;
        if near == 0.0 || (n - near).abs() > 0.15 {
            continue;
        }
        let mut law = best.law.clone();
        let plain = shape == Shape::Power || !law.factors[i].variable.is_signed();
        if near == 1.0 && plain {
            law.factors[i].shape = Shape::Linear;
        } else {
            law.factors[i].fixed = Some(vec![near]);
        }
        let mut start = of_point.clone();
        if law.has_anchor() {
            start.extend(anchor.iter());
        }
        for (j, q) in parts.iter().enumerate().filter(|(j, _)| *j != i) {
            if law.factors[j].fixed.is_none() {
                start.extend(q);
            }
        }
        start.extend(law.delay(&best.nonlinear));
        if let Some(simple) = fit(session, problem, &law, start, STEPS)
            && simple.error() <= MORE * best.error()
        {
            best = simple;
        }
    }
    if best.law.point_is == PointIs::Free {
        let com = session.scene.link_com_m[best.law.carrier.link()];
        let rest = best.nonlinear[3..].to_vec();
        let at_com = Law { point_is: PointIs::Given, point: com, ..best.law.clone() };
        if let Some(simple) = fit(session, problem, &at_com, rest.clone(), STEPS)
            && simple.error() <= MORE * best.error()
        {
            return simple;
        }
        // the point of the line of action that is closest to the centre of mass
        if let Some(along) = constant_in_link(&best) {
            let foot = point - along * along.dot(&(point - com));
            let a = along.cross(&Vector3::ith(along.iamin(), 1.0)).normalize();
            let law = Law { point_is: PointIs::OnPlane([a, along.cross(&a)]), point: foot, ..best.law.clone() };
            let start = [&[0.0, 0.0], rest.as_slice()].concat();
            if let Some(simple) = fit(session, problem, &law, start, STEPS)
                && simple.error() <= MORE * best.error()
            {
                best = simple;
            }
        }
    }
    best
}

/// Direction of a force that keeps it in the link, link axes; `None` for others.
fn constant_in_link(f: &Fitted) -> Option<Vector3<f64>> {
    let law = &f.law;
    if law.action != Action::Force || law.direction != Direction::Link || law.terms() != 1 {
        return None;
    }
    let mut v = Vector3::zeros();
    for (k, x) in law.components.iter().zip(f.theta.iter()) {
        v[*k] = *x;
    }
    (v.norm() > 0.0).then(|| v.normalize())
}
