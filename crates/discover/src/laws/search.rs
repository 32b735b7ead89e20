//! Rounds of the search: atlas, laws, a second factor, the simplest law that is as good, and again
//! on what remains.

use super::atlas::{Atlas, Group, atlas};
use super::described::describe;
use super::diagnosis::{diagnose, variable_of};
use super::evidence::{DRAWS, Evidence};
use super::fit::{self, Fitted, STEPS, TRIED};
use super::intervals::widened;
use super::next::next_recording;
use super::one_law::{OneLaw, one_law};
use super::result::{Entry, FoundLaw, OpenWorld};
use super::stated::{ANSWERED, Rivals, Stated, Step, stated};
use super::with_contact::{Flights, OfBoth, in_use, with_contact};
use super::wording;
use crate::held_out::HeldOutResult;
use crate::options::DiscoverOptions;
use crate::problem::{Domain, Problem};
use crate::progress::Until;
use crate::result::{AgainstLaw, FEWEST_CLUSTERS};
use crate::session::Session;
use crate::statistics::sign_flip_p;
use crate::thin::{FEWEST, with_at_most};
use aloft_effects::{EffectInstance, Target};
use nalgebra::DMatrix;

/// Share of the error that a further law may leave on a person.
const FURTHER: f64 = 0.6;
/// Most flights that the atlas is made of.
const MOST_IN_ATLAS: usize = 120;
/// Most flights in which the form of a law is sought: each of several hundred trial laws is fitted
/// again in every fold.
const MOST_FITTED: usize = 60;
/// Largest number of laws.
const ROUNDS: usize = 3;

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
    let within_floor =
        times_floor.is_some_and(|t| t <= ANSWERED) || model_error.is_some_and(|s| at_floor(&s, left / before));
    let of_both = laws.len() == 1 && laws[0].of_both;
    let against = against.filter(|_| of_both);
    let Stated { named, complete } = stated(&laws, ratio, within_floor, &catalogue, against.as_ref(), options.seed);
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
