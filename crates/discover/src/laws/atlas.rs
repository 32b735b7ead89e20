//! The atlas: every place, direction and variable with a free curve of strength against the
//! variable, all linear, ranked by held-out error.

use super::evidence::{Evidence, Score};
use super::kinematics::{Action, Carrier, Direction, Instant, Variable};
use super::shape::Range;
use super::two_variables::{Resistance, of_two_places, resistance, without_idle_factors};
use crate::candidate::Variant;
use crate::problem::Problem;
use crate::progress::Part;
use crate::session::Session;
use aloft_body::JointKind;
use aloft_effects::{EffectFrame, ParameterKind, Scene, Target};
use nalgebra::{DMatrix, Vector3};
use rayon::prelude::*;

/// Number of cubic B-splines of a curve.
pub(crate) const SPLINES: usize = 6;
/// Bodies with more links than this get two points a link, its centre of mass and its proximal
/// joint, and fewer clocks and anchors.
pub(super) const MANY_LINKS: usize = 4;
/// Number of groups kept.
const KEPT: usize = 300;

/// One entry of the atlas.
#[derive(Debug, Clone)]
pub(crate) struct Group {
    pub carrier: Carrier,
    pub point: Vector3<f64>,
    pub action: Action,
    pub direction: Direction,
    pub components: Vec<usize>,
    pub variable: Variable,
    pub range: Range,
    /// Second variable of a product, with its range.
    pub second: Option<(Variable, Range)>,
    pub anchor: Vector3<f64>,
    /// Angular frequency of a periodic entry, rad/s.
    pub frequency: Option<f64>,
    /// Number of columns.
    pub columns: usize,
    pub score: Score,
}

/// All entries, best first, and the best ratio under each pattern of random signs.
pub(crate) struct Atlas {
    pub groups: Vec<Group>,
    /// Squared ratio of the best entry under each pattern of signs.
    pub null: Vec<f64>,
    /// Number of entries that were scored.
    pub tried: usize,
}

/// Frames with the kinematics of one place: flights and contact of the first trial, of the second …
/// ([`Session::series_of`]).
pub(crate) struct PlaceFrames<'s> {
    pub series: Vec<Vec<(EffectFrame<'s>, Instant)>>,
}

impl<'s> PlaceFrames<'s> {
    /// Series of which no rows are in use (see [`crate::thin`], [`Session::in_flight`]) have no
    /// frames.
    pub fn new(session: &'s Session<'_>, carrier: Carrier, point: &Vector3<f64>) -> Self {
        let in_use = session.series_in_use();
        let of = |(series, in_use): (&'s aloft_effects::Series<'_>, bool)| {
            let frames = series.instants().map(|(_, f)| (f, Instant::of(&f, carrier, point)));
            if in_use { frames.collect() } else { Vec::new() }
        };
        Self { series: session.series.iter().flatten().zip(in_use).map(of).collect() }
    }

    /// Wrench of the unit vector of each component, by series.
    pub fn unit(
        &self,
        action: Action,
        direction: Direction,
        components: &[usize],
        anchor: &Vector3<f64>,
    ) -> Vec<Vec<Vec<[f64; 6]>>> {
        self.series
            .iter()
            .map(|frames| {
                components
                    .iter()
                    .map(|&k| {
                        frames
                            .iter()
                            .map(|(_, at)| {
                                let v = direction.vector(k, at, anchor);
                                let m = at.position.cross(&v);
                                match action {
                                    Action::Force => [v.x, v.y, v.z, m.x, m.y, m.z],
                                    Action::Couple => [0.0, 0.0, 0.0, v.x, v.y, v.z],
                                }
                            })
                            .collect()
                    })
                    .collect()
            })
            .collect()
    }

    /// Values of a variable by series.
    pub fn values(&self, variable: Variable, anchor: &Vector3<f64>) -> Vec<Vec<f64>> {
        self.series.iter().map(|t| t.iter().map(|(f, at)| variable.value(f, at, anchor)).collect()).collect()
    }

    /// Range of a variable without `share` of the frames at either end; `None` if it does not vary.
    /// The time since take-off, which is zero in contact, has its range in flight.
    pub fn range(&self, variable: Variable, anchor: &Vector3<f64>, share: f64) -> Option<Range> {
        let mut values = self.values(variable, anchor);
        if variable == Variable::SinceTakeOff {
            for (x, frames) in values.iter_mut().zip(&self.series) {
                if frames.first().is_some_and(|(f, _)| !f.flight) {
                    x.clear();
                }
            }
        }
        range_within(&values, share)
    }
}

/// Share of the frames at either end that a range leaves out.
pub(crate) const ENDS: f64 = 0.01;

/// Quantiles 1 and 99 % of all values; `None` if the variable does not vary.
pub(crate) fn range_of(values: &[Vec<f64>]) -> Option<Range> {
    range_within(values, ENDS)
}

/// Quantiles `share` and 1 − `share` of all values; `None` if the variable does not vary.
fn range_within(values: &[Vec<f64>], share: f64) -> Option<Range> {
    let mut all: Vec<f64> = values.iter().flatten().copied().filter(|x| x.is_finite()).collect();
    if all.len() < 20 {
        return None;
    }
    let last = (all.len() - 1) as f64;
    let mut at = |share: f64| *all.select_nth_unstable_by((last * share) as usize, f64::total_cmp).1;
    let range = Range { low: at(share), high: at(1.0 - share) };
    (range.high - range.low > 1e-9 * (1.0 + range.reach())).then_some(range)
}

/// Values of uniform cubic B-splines over a range, `SPLINES` a frame.
pub(crate) fn splines(values: &[f64], range: Range) -> Vec<f64> {
    let mut out = vec![0.0; values.len() * SPLINES];
    let pieces = (SPLINES - 3) as f64;
    for (x, b) in values.iter().zip(out.chunks_exact_mut(SPLINES)) {
        let u = ((x - range.low) / range.width()).clamp(0.0, 1.0) * pieces;
        let i = (u.floor() as usize).min(SPLINES - 4);
        let t = u - i as f64;
        let s = 1.0 - t;
        b[i] = s * s * s / 6.0;
        b[i + 1] = (3.0 * t * t * t - 6.0 * t * t + 4.0) / 6.0;
        b[i + 2] = (3.0 * s * s * s - 6.0 * s * s + 4.0) / 6.0;
        b[i + 3] = t * t * t / 6.0;
    }
    out
}

/// Columns by cluster of unit wrenches times weights.
pub(crate) fn columns(
    session: &Session<'_>,
    problem: &Problem,
    unit: &[Vec<Vec<[f64; 6]>>],
    weight: &[Vec<f64>],
    nb: usize,
    stride: usize,
) -> Vec<DMatrix<f64>> {
    problem
        .clusters
        .iter()
        .map(|c| {
            let mut out = DMatrix::zeros(c.b.len(), unit[session.series_of(c.blocks[0])].len() * nb);
            let mut at = 0;
            for &i in &c.blocks {
                let series = session.series_of(i);
                let rows = session.modulated(i, &unit[series], &weight[series], nb, stride);
                out.view_mut((at, 0), rows.shape()).copy_from(&rows);
                at += rows.nrows();
            }
            out
        })
        .collect()
}

/// Quadrature step: rows are smooth test functions of a motion below 20 Hz, so 100 Hz is enough.
pub(crate) fn stride(session: &Session<'_>) -> usize {
    let rate = session.series.iter().flatten().map(|s| s.rate_hz).fold(0.0, f64::max);
    ((rate / 100.0).floor() as usize).max(1)
}

/// Points of a carrier at which forces are tried: the centre of mass and the proximal joint; on
/// bodies of few links the other ends, too.
pub(crate) fn points(scene: &Scene, carrier: Carrier) -> Vec<Vector3<f64>> {
    let Carrier::Link(i) = carrier else { return vec![Vector3::zeros()] };
    let com = scene.link_com_m[i];
    // the ends of the link: its joints, and their reflections at the centre of mass
    let mut out = vec![com];
    let mut ends = vec![Vector3::zeros()];
    if scene.model.n_links() <= MANY_LINKS {
        ends.push(com * 2.0);
        for link in scene.model.links.iter().filter(|l| l.parent == Some(i)) {
            let joint = link.joint.parent_from_joint.translation.vector;
            ends.extend([joint, com * 2.0 - joint]);
        }
    }
    for e in ends {
        if out.iter().all(|o| (o - e).norm() > 0.04) {
            out.push(e);
        }
    }
    out
}

/// All carriers of a body.
pub(crate) fn carriers(scene: &Scene) -> Vec<Carrier> {
    let links = (0..scene.model.n_links()).map(Carrier::Link);
    std::iter::once(Carrier::Body).chain(links).collect()
}

struct Placement {
    carrier: Carrier,
    point: Vector3<f64>,
    first_point: bool,
}

/// Scores the whole atlas on the residuals.
pub(crate) fn atlas(session: &Session<'_>, problem: &Problem, evidence: &Evidence) -> Atlas {
    let scene = session.scene;
    let jobs: Vec<Placement> = carriers(scene)
        .into_iter()
        .flat_map(|carrier| {
            let of = move |(i, point)| Placement { carrier, point, first_point: i == 0 };
            points(scene, carrier).into_iter().enumerate().map(of)
        })
        .collect();
    let draws = evidence.plain.len() - 1;
    session.counter.begin(Part::Atlas, jobs.len());
    let one = |job: &Placement| {
        let made = place(session, problem, evidence, job);
        session.counter.one();
        made
    };
    let parts: Vec<Atlas> = jobs.par_iter().map(one).collect();
    let mut out = Atlas { groups: Vec::new(), null: vec![1.0; draws], tried: 0 };
    for part in parts {
        out.groups.extend(part.groups);
        out.tried += part.tried;
        for (a, b) in out.null.iter_mut().zip(part.null) {
            *a = a.min(b);
        }
    }
    sort(&mut out.groups);
    out
}

fn sort(groups: &mut Vec<Group>) {
    groups.sort_by(|a, b| a.score.ratio.total_cmp(&b.score.ratio));
    groups.truncate(KEPT);
}

/// Entries of one place.
fn place(session: &Session<'_>, problem: &Problem, evidence: &Evidence, job: &Placement) -> Atlas {
    let scene = session.scene;
    let frames = PlaceFrames::new(session, job.carrier, &job.point);
    let none = Vector3::zeros();
    let mut out = Atlas { groups: Vec::new(), null: vec![1.0; evidence.plain.len() - 1], tried: 0 };
    let stride = stride(session);
    // variables that are the same all over a link are tried at its centre of mass only
    let every_variable = job.first_point || scene.model.n_links() <= MANY_LINKS;
    let weights: Vec<(Variable, Range, Vec<Vec<f64>>, usize)> = Variable::of(scene)
        .into_iter()
        .filter(|v| every_variable || v.is_of_point())
        .filter_map(|v| curve_of(&frames, v, &none).map(|(range, weight, nb)| (v, range, weight, nb)))
        .collect();
    let resists = job.first_point && scene.model.n_links() > MANY_LINKS;
    // a product of a rate and a place shows in neither alone if it is odd in both
    let products: Vec<(Variable, Range, Vec<Vec<f64>>)> = Variable::of(scene)
        .into_iter()
        .filter(|v| job.first_point && *v != Variable::None)
        .filter_map(|v| Some((v, frames.range(v, &none, ENDS)?, frames.values(v, &none))))
        .collect();
    let waves = if job.first_point { Periodic::of(scene, &frames) } else { Vec::new() };
    let mut add = |unit: &[Vec<Vec<[f64; 6]>>], base: &Group, choices: &[&[usize]], weight: &[Vec<f64>], nb: usize| {
        let columns = columns(session, problem, unit, weight, nb, stride);
        if !columns.iter().all(|c| c.iter().all(|x| x.is_finite())) {
            return;
        }
        let prepared = evidence.prepare(&columns, if nb == SPLINES { nb } else { 0 });
        for choice in choices {
            let of: Vec<usize> = choice.iter().flat_map(|d| d * nb..(d + 1) * nb).collect();
            let Some(score) = evidence.score(&prepared, &of) else { continue };
            out.tried += 1;
            for (a, b) in out.null.iter_mut().zip(&score.null) {
                *a = a.min(*b);
            }
            if score.ratio < 1.0 {
                out.groups.push(Group { components: choice.to_vec(), columns: of.len(), score, ..base.clone() });
            }
        }
    };
    let blank = |action, direction| Group {
        carrier: job.carrier,
        point: job.point,
        action,
        direction,
        components: Vec::new(),
        variable: Variable::None,
        range: Range { low: 0.0, high: 1.0 },
        second: None,
        anchor: none,
        frequency: None,
        columns: 0,
        score: Score { ratio: 1.0, null: Vec::new(), errors: Vec::new(), theta: nalgebra::DVector::zeros(0) },
    };
    for action in [Action::Force, Action::Couple] {
        // a couple has no point, and none on the whole body as such: the root's axes carry it
        if action == Action::Couple && (!job.first_point || job.carrier == Carrier::Body) {
            continue;
        }
        for direction in Direction::FIXED {
            if action == Action::Couple
                && matches!(direction, Direction::AcrossVelocity | Direction::AcrossVelocityInLink)
            {
                continue;
            }
            let all: Vec<usize> = (0..direction.components()).collect();
            let unit = frames.unit(action, direction, &all, &none);
            for (variable, range, weight, nb) in &weights {
                let base = Group { variable: *variable, range: *range, ..blank(action, direction) };
                add(&unit, &base, direction.choices(), weight, *nb);
            }
            if scene.model.n_links() <= MANY_LINKS && job.first_point {
                for (rate, of_rate, x) in products.iter().filter(|p| p.0.is_rate()) {
                    for (place, of_place, y) in products.iter().filter(|p| !p.0.is_rate()) {
                        let base = Group {
                            variable: *rate,
                            range: *of_rate,
                            second: Some((*place, *of_place)),
                            ..blank(action, direction)
                        };
                        let weight: Vec<Vec<f64>> = x
                            .iter()
                            .zip(y)
                            .map(|(x, y)| x.iter().zip(y).flat_map(|(x, y)| [x * y, *x]).collect())
                            .collect();
                        add(&unit, &base, direction.choices(), &weight, 2);
                    }
                }
                for (base, weight) in of_two_places(&products, &blank(action, direction)) {
                    add(&unit, &base, direction.choices(), &weight, 3);
                }
            }
            if action == Action::Force && direction == Direction::AgainstVelocity && resists {
                for (variable, _, _) in products.iter().filter(|p| !p.0.is_rate()) {
                    let Some(Resistance { speed, range, weight }) = resistance(&frames, *variable) else { continue };
                    let second = Some((*variable, range));
                    let base = Group { variable: Variable::Speed, range: speed, second, ..blank(action, direction) };
                    add(&unit, &base, direction.choices(), &weight, SPLINES);
                }
            }
            if direction == Direction::Link && job.first_point {
                for (first, second) in Variable::pairs_of(action) {
                    let of = |v: Variable| products.iter().find(|p| p.0 == v);
                    let (Some((x, of_x, xs)), Some((y, of_y, ys))) = (of(first), of(second)) else { continue };
                    let base =
                        Group { variable: *x, range: *of_x, second: Some((*y, *of_y)), ..blank(action, direction) };
                    let nb = if y.is_signed() { 2 } else { 1 };
                    let both = |(x, y): (&f64, &f64)| [x * y, x * y.abs()].into_iter().take(nb);
                    let weight: Vec<Vec<f64>> =
                        xs.iter().zip(ys).map(|(x, y)| x.iter().zip(y).flat_map(both).collect()).collect();
                    add(&unit, &base, direction.choices(), &weight, nb);
                }
            }
            let periodic = matches!(direction, Direction::World | Direction::Link | Direction::AgainstVelocity);
            if periodic && job.first_point && (all.len() == 3 || scene.model.n_links() <= MANY_LINKS) {
                for Periodic { variable, range, frequencies } in &waves {
                    let values = frames.values(*variable, &none);
                    for k in frequencies {
                        let of = |t: &Vec<f64>| t.iter().flat_map(|t| [1.0, (k * t).cos(), (k * t).sin()]).collect();
                        let weight: Vec<Vec<f64>> = values.iter().map(of).collect();
                        let base = Group {
                            variable: *variable,
                            frequency: Some(*k),
                            range: *range,
                            ..blank(action, direction)
                        };
                        add(&unit, &base, &[if all.len() == 3 { &[0, 1, 2] } else { &[0] }], &weight, 3);
                    }
                }
            }
        }
    }
    let anchors = if every_variable { anchors(scene, &frames) } else { Vec::new() };
    for anchor in anchors {
        let Some(Towards { unit, weight, range }) = towards(&frames, &anchor) else { continue };
        let base = Group { variable: Variable::Distance, range, anchor, ..blank(Action::Force, Direction::Towards) };
        add(&unit, &base, &[&[0]], &weight, POWERS);
    }
    without_idle_factors(&mut out.groups);
    sort(&mut out.groups);
    out
}

/// A free curve of a variable at a place: its range, the values of its functions in every frame, by
/// series, and their number (one for a constant). `None` if the variable does not vary.
pub(super) fn curve_of(
    frames: &PlaceFrames<'_>,
    variable: Variable,
    anchor: &Vector3<f64>,
) -> Option<(Range, Vec<Vec<f64>>, usize)> {
    let values = frames.values(variable, anchor);
    if variable == Variable::None {
        return Some((Range { low: 0.0, high: 1.0 }, values, 1));
    }
    let range = frames.range(variable, anchor, ENDS)?;
    Some((range, values.iter().map(|x| splines(x, range)).collect(), SPLINES))
}

/// A line from a point of a link to one of the room.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Line {
    /// Index of the link.
    pub link: usize,
    /// Point on the link, link frame, m.
    pub point: Vector3<f64>,
    /// Point of the room, world, m.
    pub anchor: Vector3<f64>,
}

impl Line {
    /// The line along which an effect acts, if it pulls a link towards a point of the room.
    pub fn of(scene: &Scene, variant: &Variant<'_>) -> Option<Self> {
        let Target::Link(link) = variant.target else { return None };
        if !variant.effect.has_wrench() {
            return None;
        }
        let mut point = scene.link_com_m[link];
        let mut anchor = [None; 3];
        for (q, value) in variant.effect.nonlinear(scene, variant.target).iter().zip(&variant.nonlinear) {
            match q.kind {
                ParameterKind::PointInWorld(axis) => anchor[axis] = Some(*value),
                ParameterKind::PointOnLink(axis) => point[axis] = *value,
                _ => {}
            }
        }
        let [Some(x), Some(y), Some(z)] = anchor else { return None };
        Some(Self { link, point, anchor: Vector3::new(x, y, z) })
    }
}

/// A force of a place towards a point of the room: unit wrench, and four powers of the logarithm of
/// the distance in every frame, by series.
pub(super) struct Towards {
    pub unit: Vec<Vec<Vec<[f64; 6]>>>,
    pub weight: Vec<Vec<f64>>,
    /// Range of the distance, m.
    pub range: Range,
}

/// Number of powers of [`Towards`].
pub(super) const POWERS: usize = 4;

/// The force of a place towards `anchor` (world, m); `None` if the distance does not vary.
pub(super) fn towards(frames: &PlaceFrames<'_>, anchor: &Vector3<f64>) -> Option<Towards> {
    let values = frames.values(Variable::Distance, anchor);
    let logs: Vec<Vec<f64>> = values.iter().map(|t| t.iter().map(|d| d.max(1e-6).ln()).collect()).collect();
    let (range, of_logs) = (range_of(&values)?, range_of(&logs)?);
    let powers = |l: &f64| {
        let x = (l - of_logs.low) / of_logs.width() * 2.0 - 1.0;
        [1.0, x, x * x, x * x * x]
    };
    let weight = logs.iter().map(|t| t.iter().flat_map(powers).collect()).collect();
    Some(Towards { unit: frames.unit(Action::Force, Direction::Towards, &[0], anchor), weight, range })
}

/// A variable on which a force may depend periodically, with the frequencies that are tried.
struct Periodic {
    variable: Variable,
    range: Range,
    /// Angular frequencies, radians per unit of the variable.
    frequencies: Vec<f64>,
}

impl Periodic {
    /// The clock, and angles of hinges that turn over: a free curve over many turns is too coarse
    /// for what repeats with every turn.
    fn of(scene: &Scene, frames: &PlaceFrames<'_>) -> Vec<Self> {
        const TURN: f64 = 2.0 * std::f64::consts::PI;
        let mut out = Vec::new();
        for variable in std::iter::once(Variable::Clock).chain(Variable::of(scene)) {
            let range = range_of(&frames.values(variable, &Vector3::zeros()));
            match (variable, range) {
                (Variable::Clock, range) => out.push(Self {
                    variable,
                    range: range.unwrap_or(Range { low: 0.0, high: 1.0 }),
                    frequencies: of_clock(frames),
                }),
                (Variable::JointAngle(i), Some(range)) => {
                    let turns = matches!(scene.model.links[i].joint.kind, JointKind::Revolute(_));
                    if turns && range.width() > TURN {
                        // from what a free curve does not follow, in the steps of the clock
                        let step = 0.4 * TURN / range.width();
                        let first = 1.5 * TURN / range.width();
                        let n = ((variable.fastest().unwrap_or(0.0) - first) / step).max(0.0) as usize;
                        let frequencies = (0..=n).map(|k| first + step * k as f64).collect();
                        out.push(Self { variable, range, frequencies });
                    }
                }
                _ => {}
            }
        }
        out
    }
}

/// Angular frequencies of the clock, rad/s: steps that lose no line between them, up to
/// [`Variable::fastest`].
pub(super) fn of_clock(frames: &PlaceFrames<'_>) -> Vec<f64> {
    let long = |t: &Vec<(EffectFrame<'_>, Instant)>| match (t.first(), t.last()) {
        (Some(a), Some(b)) => b.0.time_s - a.0.time_s,
        _ => 0.0,
    };
    let duration = frames.series.iter().map(long).fold(0.5, f64::max);
    let step = 0.4 / duration;
    let first = (0.4 / duration).max(0.15);
    let turn = 2.0 * std::f64::consts::PI;
    let most = Variable::Clock.fastest().unwrap_or(0.0) / turn;
    let n = (((most - first) / step) as usize).min(400);
    (0..n).map(|i| (first + step * i as f64) * turn).collect()
}

/// Anchors around the volume of the motion, world, m.
pub(super) fn anchors(scene: &Scene, frames: &PlaceFrames<'_>) -> Vec<Vector3<f64>> {
    let values: Vec<Vec<Vec<f64>>> = (0..3).map(|k| frames.values(Variable::Place(k), &Vector3::zeros())).collect();
    let Some(ranges) = values.iter().map(|v| range_of(v)).collect::<Option<Vec<Range>>>() else { return Vec::new() };
    let few = scene.model.n_links() > MANY_LINKS;
    let steps: &[f64] = if few { &[-2.0, -0.7, 0.5, 1.7, 3.0] } else { &[-2.2, -1.1, -0.3, 0.5, 1.3, 2.1, 3.2] };
    let place = |k: usize, share: f64| {
        let middle = 0.5 * (ranges[k].low + ranges[k].high);
        middle + (share - 0.5) * ranges[k].width().max(0.6)
    };
    let mut out = Vec::new();
    for &x in steps {
        for &y in steps {
            for &z in steps {
                out.push(Vector3::new(place(0, x), place(1, y), place(2, z)));
            }
        }
    }
    out
}
