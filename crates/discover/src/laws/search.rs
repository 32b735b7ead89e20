//! Rounds of the search: atlas, laws, a second factor, the simplest law that is as good, and again
//! on what remains.

use super::atlas::{Atlas, Group, Line, PlaceFrames, atlas};
use super::evidence::{DRAWS, Evidence};
use super::fit::{self, Fitted, STEPS, TRIED};
use super::formula::is_curve;
use super::intervals::widened;
use super::kinematics::{Action, Carrier, Variable};
use super::law::{Law, PointIs};
use super::near_joint::other_links;
use super::next::next_recording;
use super::off_link::ALSO;
use super::one_law::{OneLaw, SIMPLER, one_law};
use super::result::{Diagnosis, Entry, FoundLaw, LawKind, OpenWorld, Work};
use super::with_contact::{Flights, IN_FLIGHT, OfBoth, in_use, with_contact};
use super::wording;
use crate::candidate::Variant;
use crate::held_out::HeldOutResult;
use crate::options::DiscoverOptions;
use crate::problem::{Domain, Problem};
use crate::progress::Until;
use crate::result::{AgainstLaw, Estimate, FEWEST_CLUSTERS};
use crate::session::Session;
use crate::statistics::sign_flip_p;
use crate::thin::{FEWEST, with_at_most};
use aloft_effects::{Effect, EffectInstance, Scene, Target};
use nalgebra::DMatrix;

/// Laws are the answer if they leave no more than this multiple of the floor.
pub(super) const ANSWERED: f64 = 1.5;
/// Laws that leave more than this share of the error are not named.
const PART: f64 = 0.5;
/// Laws that leave more than this share of what the catalogue leaves are not named.
const BETTER: f64 = 0.85;
/// Share of the squared error that a product of two variables has to leave to be named before one.
const PRODUCT: f64 = 0.7;
/// Share of the error that a further law may leave on a person.
const FURTHER: f64 = 0.6;
/// Probability by chance below which a law is better than an effect whose form is in doubt.
const TRUER: f64 = 0.01;
/// Share of a named effect's error in flight and contact that a law leaves at most to take its
/// place.
const LESS_ON_BOTH: f64 = 0.93;
/// Most flights that the atlas is made of.
const MOST_IN_ATLAS: usize = 120;
/// Most flights in which the form of a law is sought: each of several hundred trial laws is fitted
/// again in every fold.
const MOST_FITTED: usize = 60;
/// Distance from a joint within which a force on a person may act on either link, beyond the
/// intervals of its point, which contain neither soft tissue nor errors of joint centres, m.
const NEAR_JOINT_M: f64 = 0.025;
/// Largest number of laws.
const ROUNDS: usize = 3;

impl AgainstLaw {
    /// True if the law leaves clearly less than every named effect, in recording after recording.
    pub(crate) fn is_for_the_law(&self) -> bool {
        self.error_ratio < LESS_ON_BOTH && self.p_value < TRUER
    }
}

/// A law as accepted in its round.
#[derive(Clone)]
struct Step {
    fitted: Fitted,
    /// Error with it over that without (root mean square).
    ratio: f64,
    /// Family-wise p-value of its entry.
    p: f64,
    /// Other carriers that the rows do not exclude.
    also: Vec<Carrier>,
    /// True if it was fitted to flights and contact.
    of_both: bool,
}

/// What laws have to do better than.
pub(crate) struct Rivals<'v, 'a> {
    /// Share of the error that the best effects of the catalogue leave.
    pub ratio: f64,
    /// Share that the best single effect leaves.
    pub single: f64,
    /// Number of unknowns if the best effects are of several kinds: a single law with fewer
    /// unknowns that leaves no more is simpler, if no single effect comes near it.
    pub several: Option<usize>,
    /// Squared held-out error by cluster of named effects whose strength does not follow their law.
    pub doubted: Option<Vec<f64>>,
    /// True if the named effects reach the floor's interval and nothing else is held against them:
    /// any law that leaves less is stated, for the stages to compare both.
    pub within_floor: bool,
    /// Lines towards points of the room along which effects found act: their strength may depend on
    /// something in another way than the effect says.
    pub lines: Vec<Line>,
    /// True if the named effects leave contact far above its floor: a law of both is stated even if
    /// it leaves up to [`IN_FLIGHT`] times their error in flight.
    pub far_in_contact: bool,
    /// The effects that the catalogue names, of which one is missing; empty if several are.
    pub named: &'v [Variant<'a>],
}

/// Searches for a law beyond the catalogue on what a model leaves in flight. `taken` are
/// identifiers of effects that exist. `None` if there are no
/// flights to search, or they do not determine the parameters.
pub(crate) fn search(
    session: &Session<'_>,
    accepted: &[EffectInstance<'_>],
    catalogue: Rivals<'_, '_>,
    taken: &[&str],
    until: &Until,
    options: &DiscoverOptions,
) -> Option<(OpenWorld, Option<AgainstLaw>)> {
    let everywhere = &in_use(session);
    let session = &everywhere.in_flight();
    let model_error = session.model_error[0];
    let with_plates = session.model_error[1].is_some();
    let model: Vec<String> = accepted.iter().map(|c| c.key(session.scene)).collect();
    let base = columns_of(session, accepted, &[], Domain::Flight)?;
    let plain = Problem::new(session, Domain::Flight, &base, options.fewest_trials, options.prior_weight).ok()?;
    if plain.clusters.len() < FEWEST_CLUSTERS {
        return None;
    }
    let before: f64 = plain.folds.iter().map(|f| f.error).sum();
    let person = session.prior.is_some();
    let believed = if person { options.belief_kinematics } else { options.belief };
    let mut laws: Vec<Step> = Vec::new();
    let mut first: Option<(Atlas, usize)> = None;
    let mut diagnosis = None;
    let mut next = None;
    let mut against = None;
    let mut left = before;
    for round in 0..ROUNDS {
        let problem = if round == 0 {
            plain_again(session, &base, &[], options)?
        } else {
            plain_again(session, &base, &laws, options)?
        };
        let now: f64 = problem.folds.iter().map(|f| f.error).sum();
        left = now;
        if round > 0 && model_error.is_some_and(|s| s.noise_floor > 0.0 && at_floor(&s, now / before)) {
            break;
        }
        // a session of many flights is searched in some of them, and laws are fitted to all
        let some = with_at_most(session, &problem, MOST_IN_ATLAS, FEWEST);
        let (in_some, of_some) = some.as_ref().map_or((session, &problem), |(s, p, _)| (s, p));
        let evidence = Evidence::new(of_some, DRAWS, options.seed ^ round as u64)?;
        let made = atlas(in_some, of_some, &evidence);
        let Some(best) = made.groups.first() else { break };
        let as_good = made.null.iter().filter(|r| **r <= best.score.ratio).count();
        let p = (as_good + 1) as f64 / (made.null.len() + 1) as f64;
        let groups = fit::distinct(&made.groups, TRIED);
        // errors that repeat in every trial of a person look like further laws
        let believed = if round > 0 && person { believed.min(FURTHER) } else { believed };
        // a free point or a second factor can remove more than a curve at the centre of mass
        let may_do = if round == 0 { believed.sqrt() } else { believed };
        let enough = best.score.ratio.sqrt() < may_do && p < 0.05;
        if round == 0 && p < 0.05 && best.score.ratio.sqrt() < 0.97 {
            let made = diagnose(in_some, of_some, &made, p);
            session.counter.so_far(&format!("the error in flight looks like {}", made.text));
            diagnosis = Some(made);
        }
        let mut law =
            if enough { one_law_of_many(session, &problem, &evidence, &groups, until, options) } else { None };
        let mut of_both = false;
        let mut p = p;
        if with_plates && !until.is_over() {
            let flights = Flights {
                session,
                problem: &problem,
                groups: &made.groups,
                law: law.as_ref(),
                lines: &catalogue.lines,
                named: if round == 0 { catalogue.named } else { &[] },
            };
            let extra = columns_of(everywhere, accepted, &laws, Domain::Both)?;
            if let Some(made) = with_contact(everywhere, &extra, &flights, believed, until, options) {
                let OfBoth { law: better, p: by_chance, against: beside } = made;
                (law, p, of_both) = (Some(better), by_chance, true);
                against = against.or(beside);
            }
        }
        if let Some(OneLaw { best: found, rival, also }) = law {
            let ratio = (found.error() / now).sqrt();
            let p_gain = sign_flip_p(
                &found.errors,
                &problem.folds.iter().map(|f| f.error).collect::<Vec<_>>(),
                2000,
                options.seed ^ 0x1a35,
            );
            if ratio < believed && p_gain < options.significance {
                if round == 0 {
                    next = rival.and_then(|r| next_recording(session, &found, &r));
                }
                session.counter.so_far(&wording::law_so_far(session, &found, ratio, round > 0));
                laws.push(Step { fitted: found, ratio, p, also, of_both });
            }
        }
        let count = laws.len();
        if round == 0 {
            first = Some((made, of_some.clusters.len()));
        }
        if count <= round || until.is_over() {
            break;
        }
        left = laws[count - 1].fitted.error();
    }
    // unknowns of all laws together
    let laws = refit(session, &base, laws, options);
    if let Some(last) = plain_again(session, &base, &laws, options) {
        left = if laws.is_empty() { before } else { last.folds.iter().map(|f| f.error).sum::<f64>().min(left) };
    }
    let (made, clusters) = first?;
    let ratio = (left / before).sqrt();
    let after = model_error.map(|s| s.held_out_error * ratio);
    let times_floor = model_error.filter(|s| s.noise_floor > 0.0).map(|s| s.held_out_error * ratio / s.noise_floor);
    let complete = !laws.is_empty()
        && (times_floor.is_some_and(|t| t <= ANSWERED) || model_error.is_some_and(|s| at_floor(&s, left / before)));
    let simpler = |most: usize| {
        let alone = laws.len() == 1 && laws[0].fitted.unknowns < most;
        alone && ratio <= SIMPLER * catalogue.ratio && ratio < BETTER * catalogue.single
    };
    // a law in place of an effect whose form is in doubt has to be better flight by flight
    let truer = |errors: &Vec<f64>| {
        let [law] = laws.as_slice() else { return false };
        let same = law.fitted.errors.len() == errors.len();
        same && sign_flip_p(&law.fitted.errors, errors, 2000, options.seed ^ 0xf02a) < TRUER
    };
    let of_both = laws.len() == 1 && laws[0].of_both;
    let against = against.filter(|_| of_both);
    let truer_on_both = against.as_ref().is_some_and(AgainstLaw::is_for_the_law);
    // all rows together say that an effect is at least as good
    let worse_on_both = against.as_ref().is_some_and(|a| a.error_ratio > 1.0);
    let any_better = (catalogue.far_in_contact && of_both && ratio <= IN_FLIGHT * catalogue.ratio)
        || ratio < if catalogue.within_floor { 1.0 } else { BETTER } * catalogue.ratio
        || catalogue.several.is_some_and(simpler)
        || catalogue.doubted.as_ref().is_some_and(truer)
        || truer_on_both;
    let better = any_better && !worse_on_both;
    let complete = complete && better;
    let named = complete || (better && ratio < PART);
    let found: Vec<FoundLaw> = if named {
        let mut ids: Vec<String> = taken.iter().map(|t| (*t).to_owned()).collect();
        let describe = |(i, l): (usize, &Step)| {
            let domain = if l.of_both { Domain::Both } else { Domain::Flight };
            let mut others = laws.clone();
            others.remove(i);
            let of = |laws: &[Step]| columns_of(everywhere, accepted, laws, domain);
            let models = of(&others).zip(of(&laws));
            describe(session, &mut ids, l, &|estimates| {
                if let Some((others, whole)) = &models {
                    widened(everywhere, domain, others, whole, &l.fitted, estimates, options);
                }
            })
        };
        laws.iter().enumerate().map(describe).collect()
    } else {
        Vec::new()
    };
    let mut null: Vec<f64> = made.null.iter().map(|r| r.sqrt()).collect();
    null.sort_by(f64::total_cmp);
    let atlas = fit::distinct(&made.groups, 10)
        .into_iter()
        .map(|g| Entry {
            carrier: g.carrier.name(session.scene),
            action: g.action,
            direction: g.direction,
            variable: variable_of(g, session.scene),
            held_out_ratio: g.score.ratio.sqrt(),
        })
        .collect();
    let ratio = if named { ratio } else { 1.0 };
    let held_out_error_after = after.filter(|_| named).or(model_error.map(|s| s.held_out_error)).unwrap_or(ratio);
    let mut out = OpenWorld {
        model,
        entries: made.tried,
        clusters,
        by_chance: null.get(null.len() / 20).copied().unwrap_or(f64::NAN),
        diagnosis,
        atlas,
        next: next.filter(|_| !found.is_empty()),
        laws: found,
        complete,
        times_floor_after: if named { times_floor } else { model_error.map(|s| s.held_out_error / s.noise_floor) },
        at_floor_after: model_error.and_then(|s| s.noise_floor_ci95.map(|_| s.reached_by(held_out_error_after))),
        held_out_error_after,
        times_floor_in_contact: None,
        stopped_after_s: options.budget_s.filter(|_| until.is_over()),
        words: String::new(),
    };
    out.words = wording::answer(&out);
    Some((out, against))
}

/// True if a share of the squared error stands within the floor's interval.
fn at_floor(model_error: &HeldOutResult, share: f64) -> bool {
    model_error.reached_by(model_error.held_out_error * share.sqrt())
}

/// Columns of effects of the model and of laws.
fn columns_of(
    session: &Session<'_>,
    accepted: &[EffectInstance<'_>],
    laws: &[Step],
    domain: Domain,
) -> Option<Vec<Vec<DMatrix<f64>>>> {
    let effects = accepted.iter().map(|c| session.columns_of(c, domain));
    effects
        .chain(laws.iter().map(|l| session.columns(&l.fitted.law, Target::Body, &l.fitted.nonlinear, domain)))
        .collect()
}

/// The problem with laws in the model.
fn plain_again(
    session: &Session<'_>,
    base: &[Vec<DMatrix<f64>>],
    laws: &[Step],
    options: &DiscoverOptions,
) -> Option<Problem> {
    let mut extra = base.to_vec();
    for Step { fitted: f, .. } in laws {
        extra.push(session.columns(&f.law, Target::Body, &f.nonlinear, Domain::Flight)?);
    }
    Problem::new(session, Domain::Flight, &extra, options.fewest_trials, options.prior_weight).ok()
}

/// [`one_law`]; in a session of many flights the form of the law is sought in some of them, and
/// the law is fitted to all.
fn one_law_of_many(
    session: &Session<'_>,
    problem: &Problem,
    evidence: &Evidence,
    groups: &[&Group],
    until: &Until,
    options: &DiscoverOptions,
) -> Option<OneLaw> {
    let Some((some, fewer, _)) = with_at_most(session, problem, MOST_FITTED, FEWEST) else {
        return one_law(session, problem, evidence, groups, Vec::new(), until);
    };
    let OneLaw { best, rival, also } =
        one_law(&some, &fewer, &Evidence::new(&fewer, DRAWS, options.seed)?, groups, Vec::new(), until)?;
    let again = |f: Fitted| fit::fit(session, problem, &f.law, f.nonlinear, STEPS);
    Some(OneLaw { best: again(best)?, rival: rival.and_then(again), also })
}

/// All laws again, each beside the others.
fn refit(
    session: &Session<'_>,
    base: &[Vec<DMatrix<f64>>],
    mut laws: Vec<Step>,
    options: &DiscoverOptions,
) -> Vec<Step> {
    if laws.len() < 2 {
        return laws;
    }
    for _ in 0..2 {
        // constants of a law of both are known better from all rows
        for i in 0..laws.len() {
            if laws[i].of_both {
                continue;
            }
            let mut others = laws.clone();
            others.remove(i);
            let Some(problem) = plain_again(session, base, &others, options) else { continue };
            let start = laws[i].fitted.nonlinear.clone();
            if let Some(better) = fit::fit(session, &problem, &laws[i].fitted.law, start, STEPS) {
                laws[i].fitted = better;
            }
        }
    }
    laws
}

/// The best entry of the atlas in numbers: the simplest of those that are nearly as good.
fn diagnose(session: &Session<'_>, problem: &Problem, atlas: &Atlas, p: f64) -> Diagnosis {
    let scene = session.scene;
    // one variable is preferred to a product of two, unless the product leaves much less
    let single = atlas.groups.iter().find(|g| g.is_one_dependence());
    let first = &atlas.groups[0];
    let best = single.filter(|s| first.score.ratio > PRODUCT * s.score.ratio).unwrap_or(first);
    let as_good =
        |g: &&Group| g.is_one_dependence() == best.is_one_dependence() && g.score.ratio <= 1.04 * best.score.ratio;
    let g = atlas
        .groups
        .iter()
        .filter(as_good)
        .min_by(|a, b| a.columns.cmp(&b.columns).then(a.score.ratio.total_cmp(&b.score.ratio)))
        .unwrap_or(best);
    let constant = atlas.groups.iter().find(|o| {
        o.variable == Variable::None
            && o.carrier == g.carrier
            && o.action == g.action
            && o.direction == g.direction
            && o.components == g.components
    });
    let plain: Vec<f64> = problem.folds.iter().map(|f| f.error).collect();
    let dependence_p = (g.variable != Variable::None)
        .then(|| sign_flip_p(&g.score.errors, constant.map_or(&plain, |c| &c.score.errors), 2000, 0x7157));
    let near = |o: &&Group| o.action == g.action && o.score.ratio <= ALSO * ALSO * best.score.ratio;
    let also = g.carrier.others(atlas.groups.iter().filter(near).map(|o| o.carrier));
    let mut out = Diagnosis {
        carrier: g.carrier.name(scene),
        also: also.into_iter().map(|c| c.name(scene)).collect(),
        action: g.action,
        direction: g.direction,
        variable: variable_of(g, scene),
        held_out_ratio: g.score.ratio.sqrt(),
        removes: 1.0 - g.score.ratio.sqrt(),
        family_wise_p: p,
        constant_ratio: constant.map(|c| c.score.ratio.sqrt()),
        dependence_p,
        curve: curve_of(g),
        text: String::new(),
    };
    let variables: Vec<Variable> =
        std::iter::once(g.variable).chain(g.second.map(|s| s.0)).filter(|v| *v != Variable::None).collect();
    out.text = wording::diagnosis(scene, &out, &variables);
    out
}

/// Variable of an entry in formulas, `a*b` for a product.
fn variable_of(g: &Group, scene: &Scene) -> String {
    let first = g.variable.formula(scene);
    g.second.map_or(first.clone(), |s| format!("{first}*{}", s.0.formula(scene)))
}

/// Strength over the variable for the component with the largest strength.
fn curve_of(g: &Group) -> Vec<[f64; 2]> {
    const POINTS: usize = 13;
    if g.frequency.is_some() || g.second.is_some() || g.variable == Variable::None || g.variable == Variable::Distance {
        return Vec::new();
    }
    let nb = g.columns / g.components.len().max(1);
    let x: Vec<f64> = (0..POINTS).map(|i| g.range.low + g.range.width() * i as f64 / (POINTS - 1) as f64).collect();
    let basis = super::atlas::splines(&x, g.range);
    let of = |d: usize| -> Vec<f64> {
        basis.chunks_exact(nb).map(|b| b.iter().enumerate().map(|(k, b)| b * g.score.theta[d * nb + k]).sum()).collect()
    };
    let size = |y: &[f64]| y.iter().map(|v| v * v).sum::<f64>();
    let all: Vec<Vec<f64>> = (0..g.components.len()).map(of).collect();
    let Some(largest) = all.into_iter().max_by(|a, b| size(a).total_cmp(&size(b))) else { return Vec::new() };
    x.into_iter().zip(largest).map(|(x, y)| [x, y]).collect()
}

/// Widens the intervals of coefficients and nonlinear parameters.
type Widen<'w> = &'w dyn Fn((&mut [Estimate], &mut [Estimate]));

/// A fitted law for users.
fn describe(session: &Session<'_>, ids: &mut Vec<String>, found: &Step, widen: Widen<'_>) -> FoundLaw {
    let scene = session.scene;
    let Step { fitted: f, ratio, p, also, of_both } = found;
    let mut law = f.law.clone();
    let carrier = law.carrier.name(scene);
    let stem: String = carrier.chars().map(|c| if c.is_ascii_alphanumeric() { c } else { '_' }).collect();
    law.id = (1..)
        .map(|n| if n == 1 { format!("law_{stem}") } else { format!("law_{stem}_{n}") })
        .find(|id| !ids.contains(id))
        .unwrap_or_default();
    ids.push(law.id.clone());
    let k = f.theta.len();
    let of = |i: usize| (f.se.get(i).copied().unwrap_or(f64::NAN), f.freedom.get(i).copied().unwrap_or(f64::NAN));
    let estimate = |name: String, unit: String, value: f64, i: usize, at_bound: bool| {
        let (se, freedom) = of(i);
        Estimate { name, value, se: f64::NAN, ci95: None, freedom: f64::NAN, at_bound, widening: 1.0, unit }
            .with_error(se, freedom)
    };
    let mut coefficients: Vec<Estimate> = law
        .coefficients(scene, Target::Body)
        .into_iter()
        .enumerate()
        .map(|(i, c)| estimate(c.name, c.unit, f.theta[i], i, false))
        .collect();
    let mut nonlinear: Vec<Estimate> = law
        .nonlinear(scene, Target::Body)
        .into_iter()
        .zip(&f.nonlinear)
        .enumerate()
        .map(|(j, (q, value))| {
            let at_bound = (value - q.lower).abs() < 1e-9 || (value - q.upper).abs() < 1e-9;
            estimate(q.name, q.unit, *value, k + j, at_bound)
        })
        .collect();
    widen((&mut coefficients, &mut nonlinear));
    let split = law.point_is.unknowns();
    let kind = if is_curve(&law) { LawKind::Curve } else { LawKind::Formula };
    let work = work(session, f);
    let point = point_of(&law, &f.nonlinear, &nonlinear);
    let slack_m = if session.prior.is_some() { NEAR_JOINT_M } else { 0.0 };
    let at_joint = other_links(&scene.model, law.carrier, &point, slack_m).into_iter().filter(|c| !also.contains(c));
    let also: Vec<String> = also.iter().copied().chain(at_joint).map(|c| c.name(scene)).collect();
    let found_in = if *of_both { "; found in flight and contact together" } else { "" };
    let text = wording::law(scene, &law, &f.nonlinear, &f.theta, work) + &wording::also(&also) + found_in;
    let values: Vec<&Estimate> = coefficients.iter().chain(&nonlinear[split..]).chain(&point).collect();
    let documentation = wording::documentation(&text, &values, *ratio, *p, *of_both);
    let mut effect = law.formula(scene, &f.nonlinear, documentation);
    effect.title = wording::title(scene, &law);
    FoundLaw {
        id: law.id.clone(),
        kind,
        carrier,
        also,
        action: law.action,
        direction: law.direction,
        variables: law
            .factors
            .iter()
            .filter(|f| f.variable != Variable::None)
            .map(|f| f.variable.formula(scene))
            .collect(),
        strength: law.strength(scene),
        point,
        coefficients,
        parameters: nonlinear[split..].to_vec(),
        held_out_ratio: *ratio,
        family_wise_p: *p,
        with_contact: *of_both,
        work,
        text,
        effect,
    }
}

/// Share of a link's axis along the force from which on a point's coordinate on it is not
/// determined.
const ALONG: f64 = 0.9;

/// Coordinates of the point in the link with their intervals; empty where they are given. A point
/// can be moved along its force: the coordinate along it has no interval, and its value is that of
/// the point of the line nearest to the centre of mass.
fn point_of(law: &Law, values: &[f64], fitted: &[Estimate]) -> Vec<Estimate> {
    match law.point_is {
        PointIs::Given => Vec::new(),
        PointIs::Free => fitted[..3].to_vec(),
        PointIs::OnPlane(axes) => {
            let (point, _, _) = law.divided(values);
            let freedom = fitted[0].freedom.min(fitted[1].freedom);
            let along = axes[0].cross(&axes[1]);
            (0..3)
                .map(|k| {
                    let across = (axes[0][k] * fitted[0].se).hypot(axes[1][k] * fitted[1].se);
                    let se = if along[k].abs() > ALONG { f64::NAN } else { across };
                    let name = format!("point_{}", ["x", "y", "z"][k]);
                    Estimate { name, value: point[k], ..fitted[0].clone() }.with_error(se, freedom)
                })
                .collect()
        }
    }
}

/// Work of a law over all flights.
pub(crate) fn work(session: &Session<'_>, f: &Fitted) -> Work {
    let (point, anchor, parts) = f.law.divided(&f.nonlinear);
    let frames = PlaceFrames::new(session, f.law.carrier, &point);
    let (mut taken, mut absolute, mut size) = (0.0, 0.0, 0.0);
    let mut strengths = Vec::new();
    for (frame, at) in frames.series.iter().flatten() {
        let v = f.vector(frame, at, &anchor, &parts, &mut strengths);
        let rate = match f.law.action {
            Action::Force => at.velocity,
            Action::Couple => at.omega,
        };
        let power = v.dot(&rate);
        absolute += power.abs();
        taken += (-power).max(0.0);
        size += v.norm() * rate.norm();
    }
    Work {
        taken: if absolute > 0.0 { taken / absolute } else { 0.0 },
        share: if size > 0.0 { absolute / size } else { 0.0 },
    }
}
