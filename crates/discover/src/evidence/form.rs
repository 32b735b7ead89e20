//! Whether what was found has the form that its law states.
//!
//! An effect can stand in for another law: a resistance proportional to speed for one that grows
//! with its square root, a spring for a field. Its force then has the right place and direction and
//! the wrong strength. The force of the effect, as fitted, times a function of one variable is
//! therefore one more explanation beside it: times the logarithm of its own strength (the first
//! change of a power), times a line or a curve in a variable of the motion; and its rate, the first
//! change of a delay. They share the prior of one explanation, and are named by the same odds, each
//! beside the plain force.

use super::by_recording::ln_odds;
use super::explanation::Explanation;
use super::model::Model;
use super::posterior::ln_sum;
use super::priors::{IDEALISED, ODDS};
use crate::candidate::{Variant, pseudo_solve};
use crate::laws::{
    Carrier, PlaceFrames, Range, SPLINES, Variable, carriers, columns, range_of, splines, stride, variable_in_words,
};
use crate::problem::{Fold, Problem, ReducedFold};
use crate::result::{Found, Misfit};
use crate::session::Session;
use aloft_effects::{Columns, Effect, ParameterKind, Target};
use nalgebra::{DMatrix, Vector3};
use rayon::prelude::*;

/// Force and moment about the world origin in every frame, one column, by series.
type Wrenches = Vec<Vec<Vec<[f64; 6]>>>;

/// On what a strength may depend.
#[derive(Debug, Clone, Copy, PartialEq)]
enum On {
    /// The strength itself: another power of it.
    Strength,
    /// The motion as it was earlier.
    Delay,
    /// A variable of the motion.
    Variable(Variable),
}

/// A function of the motion, with its values by series, `columns` a frame.
struct Product {
    carrier: Carrier,
    on: On,
    values: Vec<Vec<f64>>,
    columns: usize,
}

/// The likeliest dependence of the strength of an effect found on something that its law does not
/// describe, if it has odds of 20 to 1 by rows and by recordings. `model` contains the effects;
/// `removed` is the sum of squares that they took away.
pub(super) fn misfit(model: &Model<'_>, kept: &[Explanation<'_>], found: &[Found], removed: f64) -> Option<Misfit> {
    let Model { session, problem, likelihood, .. } = model;
    let mut tried = Vec::new();
    for (i, (of, found)) in
        kept.iter().zip(found).enumerate().filter(|(_, (k, _))| k.acts_in_flight() && k.variant.effect.has_wrench())
    {
        let theta: Vec<f64> = found.coefficients.iter().map(|e| e.value).collect();
        let unit = wrenches(session, &of.variant, &theta);
        let rate = rates(session, &unit);
        let rows = |unit: &Wrenches, values: &[Vec<f64>], k: usize| {
            columns(session, problem, unit, values, k, stride(session))
        };
        // inertia that an effect adds carries the errors of accelerations, which pull its size
        // down: of the force alone a part is left
        let own = rows(&unit, &unit.iter().map(|t| vec![1.0; t[0].len()]).collect::<Vec<_>>(), 1);
        let (own_s, own_c) = problem.reduce_all(&own);
        let of_own = own_c.dot(&pseudo_solve(&own_s, &own_c));
        let nothing = likelihood.of_squares(problem.rss - of_own);
        let odds = |product: Product| {
            let unit = if product.on == On::Delay { &rate } else { &unit };
            let made = rows(unit, &product.values, product.columns);
            let made: Vec<DMatrix<f64>> = own.iter().zip(&made).map(|(a, b)| beside(a, b)).collect();
            let usable = made.iter().all(|c| c.iter().all(|x| x.is_finite()));
            let (s, c) = problem.reduce_all(Some(&made).filter(|_| usable)?);
            let gain = c.dot(&pseudo_solve(&s, &c)) - of_own;
            let seen = (1..c.len()).filter(|&k| s[(k, k)] > 0.0).count();
            let ln = likelihood.of_squares(problem.rss - of_own - gain) - likelihood.of_coefficients(seen) - nothing;
            // the law of an effect is an idealisation
            (gain > IDEALISED * removed).then_some((ln, i, product, made))
        };
        let all = products(session, of, &unit);
        tried.extend(all.into_par_iter().map(odds).collect::<Vec<_>>());
    }
    let number = tried.len().max(1) as f64;
    let all: Vec<_> = tried.into_iter().flatten().collect();
    let by_rows = ln_sum(all.iter().map(|t| t.0)) - number.ln();
    let (_, at, product, made) = all.into_iter().max_by(|a, b| a.0.total_cmp(&b.0))?;
    let by_recording = gain_by_recording(problem, &made);
    let ln_odds = by_rows.min(by_recording);
    (ln_odds > ODDS.ln()).then(|| Misfit {
        effect: found[at].key.clone(),
        carrier: product.carrier.name(session.scene),
        variable: match product.on {
            On::Strength => "strength".to_owned(),
            On::Delay => "delay".to_owned(),
            On::Variable(v) => v.formula(session.scene),
        },
        words: match product.on {
            On::Strength => "grows in another way than its law says".to_owned(),
            On::Delay => "follows the motion later or earlier than its law says".to_owned(),
            On::Variable(v) => format!(
                "depends on {} (`{}`) in another way than its law says",
                variable_in_words(v, session.scene),
                product.carrier.name(session.scene)
            ),
        },
        ln_odds,
    })
}

/// A special case of what was found that acts late, if it is as likely: a stream of air straight
/// down looks like a resistance of still air that follows the motion later. `model` lacks the
/// effect; the special case has its places.
pub(super) fn late(model: &Model<'_>, found: &Explanation<'_>, effects: &[&dyn Effect], key: &str) -> Option<Misfit> {
    let Model { session, problem, likelihood, .. } = model;
    let of_coefficients = |k: usize| likelihood.of_coefficients(k);
    // what the unknown places cost; the special case has a part of them
    let of_unknowns = likelihood.of_squares(found.left) - found.ln_likelihood - of_coefficients(found.theta.len());
    let places = found.variant.effect.nonlinear(session.scene, found.variant.target);
    let odds = |effect: &&dyn Effect| {
        let at = |name: &str| places.iter().position(|p| p.name == name).map(|i| found.variant.nonlinear[i]);
        let unknowns = effect.nonlinear(session.scene, found.variant.target);
        let nonlinear: Vec<f64> = unknowns.iter().map(|p| at(&p.name)).collect::<Option<_>>()?;
        let group = found.variant.group.clone();
        let of = Variant { group, ..Variant::new(session, *effect, found.variant.target, nonlinear) };
        let mut all = of.columns(session, problem)?;
        let k = of.coefficients.len();
        for j in 0..k {
            let theta: Vec<f64> = (0..k).map(|i| f64::from(u8::from(i == j))).collect();
            // a delay up to its second order
            let rate = rates(session, &wrenches(session, &of, &theta));
            for rate in [rates(session, &rate), rate] {
                let ones: Vec<Vec<f64>> = rate.iter().map(|t| vec![1.0; t[0].len()]).collect();
                let rows = columns(session, problem, &rate, &ones, 1, stride(session));
                all.iter_mut().zip(&rows).for_each(|(a, b)| *a = beside(a, b));
            }
        }
        let (s, c) = problem.reduce_all(&all);
        let left = problem.rss - c.dot(&pseudo_solve(&s, &c));
        let share = unknowns.len() as f64 / places.len().max(1) as f64;
        let ln = likelihood.of_squares(left) - of_coefficients(k + 1) - share * of_unknowns;
        Some((effect.id().to_owned(), ln - found.ln_likelihood))
    };
    let contains = found.variant.effect.about().contains;
    let special = effects.iter().filter(|e| contains.contains(&e.id()) && e.has_wrench());
    let (id, ln_odds) = special.filter_map(odds).max_by(|a, b| a.1.total_cmp(&b.1))?;
    (ln_odds > -ODDS.ln()).then(|| Misfit {
        effect: key.to_owned(),
        carrier: carrier_of(&found.variant).name(session.scene),
        variable: "delay".to_owned(),
        words: format!("is not told from that of `{id}` that follows the motion later or earlier"),
        ln_odds,
    })
}

fn beside(a: &DMatrix<f64>, b: &DMatrix<f64>) -> DMatrix<f64> {
    let mut out = a.clone().resize_horizontally(a.ncols() + b.ncols(), 0.0);
    out.columns_mut(a.ncols(), b.ncols()).copy_from(b);
    out
}

/// Odds that recordings left out one by one give columns beside the first of them.
fn gain_by_recording(problem: &Problem, columns: &[DMatrix<f64>]) -> f64 {
    let first: Vec<DMatrix<f64>> = columns.iter().map(|c| c.columns(0, 1).into_owned()).collect();
    let (without, with) = (problem.reduce(&first), problem.reduce(columns));
    let left = |fold: &Fold, r: &ReducedFold| (&fold.test - &r.test * pseudo_solve(&r.s, &r.c)).norm_squared();
    let folds = problem.folds.iter().zip(without.folds.iter().zip(&with.folds));
    let gains = folds.map(|(fold, (without, with))| (left(fold, without) / left(fold, with)).ln());
    ln_odds(&gains.filter(|g| g.is_finite()).collect::<Vec<_>>())
}

/// What the strength could depend on: itself; variables of the effect's link, or of the whole body
/// and, on bodies of few links, of each of them; the distance from the effect's own point of the
/// room.
fn products(session: &Session<'_>, of: &Explanation<'_>, unit: &Wrenches) -> Vec<Product> {
    let own = logarithm(unit).map(|own| {
        let bent = own.iter().map(|t| t.iter().flat_map(|x| [*x, x * x]).collect()).collect();
        [(own, 1), (bent, 2)].map(|(values, columns)| Product {
            carrier: carrier_of(&of.variant),
            on: On::Strength,
            values,
            columns,
        })
    });
    let mut out: Vec<Product> = own.into_iter().flatten().collect();
    let ones = unit.iter().map(|t| vec![1.0; t[0].len()]).collect();
    out.push(Product { carrier: carrier_of(&of.variant), on: On::Delay, values: ones, columns: 1 });
    for (carrier, variable, anchor) in variables(session, of) {
        let frames = PlaceFrames::new(session, carrier, &point(session, carrier));
        let values = frames.values(variable, &anchor);
        let Some(range) = range_of(&values) else { continue };
        let on = On::Variable(variable);
        let line = values.iter().map(|x| line(x, range, variable.is_signed())).collect();
        out.push(Product { carrier, on, values: line, columns: 1 });
        let curve = values.iter().map(|x| splines(x, range)).collect();
        out.push(Product { carrier, on, values: curve, columns: SPLINES });
    }
    out
}

fn carrier_of(of: &Variant<'_>) -> Carrier {
    match of.target {
        Target::Link(i) => Carrier::Link(i),
        _ => Carrier::Body,
    }
}

/// On bodies with more links an effect on the whole body is compared with the motion of the whole
/// body only.
const FEW_LINKS: usize = 4;

fn variables(session: &Session<'_>, of: &Explanation<'_>) -> Vec<(Carrier, Variable, Vector3<f64>)> {
    let (scene, variant) = (session.scene, &of.variant);
    let places: Vec<Carrier> = match variant.target {
        Target::Link(i) => vec![Carrier::Link(i)],
        _ if scene.model.n_links() <= FEW_LINKS => carriers(scene),
        _ => vec![Carrier::Body],
    };
    let mut anchor: [Option<f64>; 3] = [None; 3];
    for (q, value) in variant.effect.nonlinear(scene, variant.target).iter().zip(&variant.nonlinear) {
        if let ParameterKind::PointInWorld(axis) = q.kind {
            anchor[axis] = Some(*value);
        }
    }
    let of_place = |carrier: Carrier| {
        let plain = Variable::of(scene).into_iter().filter(|v| *v != Variable::None);
        let mut out: Vec<_> = plain.map(|variable| (carrier, variable, Vector3::zeros())).collect();
        if let [Some(x), Some(y), Some(z)] = anchor {
            out.push((carrier, Variable::Distance, Vector3::new(x, y, z)));
        }
        out
    };
    places.into_iter().flat_map(of_place).collect()
}

/// The link's centre of mass; the origin for the whole body.
fn point(session: &Session<'_>, carrier: Carrier) -> Vector3<f64> {
    match carrier {
        Carrier::Body => Vector3::zeros(),
        Carrier::Link(i) => session.scene.link_com_m[i],
    }
}

/// Logarithm of the strength of a force, of a couple without force, over its largest value, by
/// series; none of a force that is zero everywhere.
fn logarithm(unit: &Wrenches) -> Option<Vec<Vec<f64>>> {
    /// Share of the largest strength below which the logarithm stays the same.
    const LEAST: f64 = 0.02;
    let norm = |w: &[f64]| w.iter().map(|x| x * x).sum::<f64>().sqrt();
    let largest =
        |of: &std::ops::Range<usize>| unit.iter().flat_map(|t| &t[0]).map(|w| norm(&w[of.clone()])).fold(0.0, f64::max);
    let of = [0..3, 3..6].into_iter().find(|of| largest(of) > 0.0)?;
    let most = largest(&of);
    let log = |w: &[f64; 6]| (norm(&w[of.clone()]) / most).max(LEAST).ln();
    Some(unit.iter().map(|t| t[0].iter().map(log).collect()).collect())
}

/// A straight line in a variable that takes both signs, else in its logarithm.
fn line(values: &[f64], range: Range, signed: bool) -> Vec<f64> {
    let (middle, half) = (0.5 * (range.low + range.high), 0.5 * range.width());
    if signed {
        return values.iter().map(|x| (x - middle) / half).collect();
    }
    let least = range.low.max(0.05 * range.reach());
    values.iter().map(|x| (x.max(least) / range.reach()).ln()).collect()
}

/// Rates of wrenches; zero at the ends of what follows frame by frame.
fn rates(session: &Session<'_>, unit: &Wrenches) -> Wrenches {
    let of_series = |(series, unit): (&aloft_effects::Series<'_>, &Vec<Vec<[f64; 6]>>)| {
        let (frames, unit) = (series.motion_frames(), &unit[0]);
        let rate = |f: usize| {
            let inside = f > 0 && f + 1 < unit.len() && frames[f + 1] - frames[f - 1] == 2;
            let of = |k: usize| 0.5 * series.rate_hz * (unit[f + 1][k] - unit[f - 1][k]);
            if inside { std::array::from_fn(of) } else { [0.0; 6] }
        };
        vec![(0..unit.len()).map(rate).collect()]
    };
    session.series.iter().flatten().zip(unit).map(of_series).collect()
}

/// Force and moment about the world origin of an effect as fitted.
fn wrenches(session: &Session<'_>, variant: &Variant<'_>, theta: &[f64]) -> Wrenches {
    let k = variant.coefficients.len();
    let of_series = |(at, series): (usize, &aloft_effects::Series<'_>)| {
        let mut out = Columns::zeros(series.len(), k);
        if variant.group.is_empty() || variant.group[at / 2] {
            variant.effect.evaluate(series, variant.target, &variant.nonlinear, &mut out);
        }
        let frame = |f: usize| {
            let mut sum = [0.0; 6];
            for (c, value) in theta.iter().enumerate() {
                for (s, x) in sum.iter_mut().zip(out.wrench(f, c)) {
                    *s += value * x;
                }
            }
            sum
        };
        vec![(0..series.len()).map(frame).collect()]
    };
    session.series.iter().flatten().enumerate().map(of_series).collect()
}
