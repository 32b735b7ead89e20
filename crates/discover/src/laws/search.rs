//! Rounds of the search: atlas, laws, a second factor, the simplest law that is as good, and again
//! on what remains.

use super::atlas::{Atlas, Group, atlas};
use super::described::describe;
use super::diagnosis::{diagnose, variable_of};
use super::evidence::{DRAWS, Evidence};
use super::fit::{self, Fitted, STEPS, TRIED};
use super::intervals::widened;
use super::kinematics::Carrier;
use super::next::next_recording;
use super::off_link::ALSO;
use super::one_law::{OneLaw, one_law};
use super::result::{Diagnosis, Entry, FoundLaw, NextRecording, OpenWorld};
use super::stated::{ANSWERED, Rivals, Stated, Step, stated};
use super::with_contact::{Flights, in_use, with_contact};
use super::wording;
use crate::held_out::HeldOutResult;
use crate::options::DiscoverOptions;
use crate::problem::{Domain, Problem};
use crate::progress::Until;
use crate::result::FEWEST_CLUSTERS;
use crate::session::Session;
use crate::statistics::sign_flip_p;
use crate::thin::{FEWEST, with_at_most};
use aloft_effects::{EffectInstance, Scene, Target};
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
/// What a search works on.
struct Searched<'s, 'a> {
    /// Flights and contact that are in use.
    everywhere: &'s Session<'a>,
    /// The flights of these.
    flights: &'s Session<'a>,
    accepted: &'s [EffectInstance<'a>],
    /// Columns of the model's effects in flight.
    base: Vec<Vec<DMatrix<f64>>>,
    until: &'s Until,
    options: &'s DiscoverOptions,
}

/// What one round found.
struct Round {
    atlas: Atlas,
    /// Number of flights or trials of the atlas.
    clusters: usize,
    diagnosis: Option<Diagnosis>,
    law: Option<Step>,
    /// The recording that tells the law from the next best one.
    next: Option<NextRecording>,
}

/// Searches for a law beyond the catalogue on what a model leaves in flight. `taken` are
/// identifiers of effects that exist. `None` if there are no flights to search, or they do not
/// determine the parameters.
pub(crate) fn search(
    session: &Session<'_>,
    accepted: &[EffectInstance<'_>],
    catalogue: &Rivals,
    taken: &[&str],
    until: &Until,
    options: &DiscoverOptions,
) -> Option<OpenWorld> {
    let everywhere = &in_use(session);
    let flights = &everywhere.in_flight();
    let base = columns_of(flights, accepted, &[], Domain::Flight)?;
    let searched = Searched { everywhere, flights, accepted, base, until, options };
    let model_error = flights.model_error[0];
    let plain = searched.with(&[])?;
    if plain.clusters.len() < FEWEST_CLUSTERS {
        return None;
    }
    let before = squared_error(&plain);
    let mut laws: Vec<Step> = Vec::new();
    let mut first: Option<Round> = None;
    let mut left = before;
    for number in 0..ROUNDS {
        let problem = searched.with(&laws)?;
        left = squared_error(&problem);
        if number > 0 && model_error.is_some_and(|s| s.noise_floor > 0.0 && at_floor(&s, left / before)) {
            break;
        }
        let Some(mut made) = searched.round(number, &problem, &laws, catalogue)? else { break };
        let law = made.law.take();
        first.get_or_insert(made);
        let Some(law) = law else { break };
        let of_law = law.fitted.error();
        laws.push(law);
        if until.is_over() {
            break;
        }
        left = of_law;
    }
    // unknowns of all laws together
    let laws = searched.refit(laws);
    if let Some(last) = searched.with(&laws) {
        left = if laws.is_empty() { before } else { squared_error(&last).min(left) };
    }
    let first = first?;
    let ratio = (left / before).sqrt();
    let after = model_error.map(|s| s.held_out_error * ratio);
    let times_floor = model_error.filter(|s| s.noise_floor > 0.0).map(|s| s.held_out_error * ratio / s.noise_floor);
    let within_floor =
        times_floor.is_some_and(|t| t <= ANSWERED) || model_error.is_some_and(|s| at_floor(&s, left / before));
    let Stated { named, complete } = stated(&laws, ratio, within_floor, catalogue);
    let found = if named { searched.described(&laws, taken) } else { Vec::new() };
    let ratio = if named { ratio } else { 1.0 };
    let held_out_error_after = after.filter(|_| named).or(model_error.map(|s| s.held_out_error)).unwrap_or(ratio);
    let mut out = OpenWorld {
        model: accepted.iter().map(|c| c.key(session.scene)).collect(),
        entries: first.atlas.tried,
        clusters: first.clusters,
        by_chance: by_chance(&first.atlas),
        diagnosis: first.diagnosis,
        atlas: entries(&first.atlas, session.scene),
        next: first.next.filter(|_| !found.is_empty()),
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
    Some(out)
}

impl Searched<'_, '_> {
    /// The problem with laws in the model.
    fn with(&self, laws: &[Step]) -> Option<Problem> {
        let mut extra = self.base.clone();
        for Step { fitted: f, .. } in laws {
            extra.push(self.flights.columns(&f.law, Target::Body, &f.nonlinear, Domain::Flight)?);
        }
        let options = self.options;
        Problem::if_possible(self.flights, Domain::Flight, &extra, options)
    }

    /// One round on `problem`, which holds the laws of the rounds before: atlas, law in flight, law
    /// of flights and contact. The inner `None`: nothing can be scored.
    fn round(&self, number: usize, problem: &Problem, laws: &[Step], catalogue: &Rivals) -> Option<Option<Round>> {
        let Self { everywhere, flights: session, until, options, .. } = *self;
        let person = session.prior.is_some();
        // a session of many flights is searched in some of them, and laws are fitted to all
        let some = with_at_most(session, problem, MOST_IN_ATLAS, FEWEST);
        let (in_some, of_some) = some.as_ref().map_or((session, problem), |(s, p, _)| (s, p));
        let evidence = Evidence::new(of_some, DRAWS, options.seed ^ number as u64)?;
        let atlas = atlas(in_some, of_some, &evidence);
        let Some(best) = atlas.groups.first() else { return Some(None) };
        let as_good = atlas.null.iter().filter(|r| **r <= best.score.ratio).count();
        let mut p = (as_good + 1) as f64 / (atlas.null.len() + 1) as f64;
        // errors that repeat in every trial of a person look like further laws
        let believed = match (number, person) {
            (0, true) => options.belief_kinematics,
            (_, true) => options.belief_kinematics.min(FURTHER),
            (_, false) => options.belief,
        };
        // a free point or a second factor can remove more than a curve at the centre of mass
        let may_do = if number == 0 { believed.sqrt() } else { believed };
        let diagnosis = (number == 0 && p < 0.05 && best.score.ratio.sqrt() < 0.97).then(|| {
            let made = diagnose(in_some, of_some, &atlas, p);
            // what is left of the parameters looks like some force, too
            let of_parameters = session.model_error[0].is_some_and(|s| s.may_be_of_parameters());
            if !of_parameters {
                session.counter.so_far(&format!("the error in flight looks like {}", made.text));
            }
            made
        });
        let groups = fit::distinct(&atlas.groups, TRIED);
        let enough = best.score.ratio.sqrt() < may_do && p < 0.05;
        let mut law = if enough { one_law_of_many(session, problem, &evidence, &groups, until, options) } else { None };
        let mut of_both = false;
        if session.model_error[1].is_some() && !until.is_over() {
            let flights =
                Flights { session, problem, groups: &atlas.groups, law: law.as_ref(), lines: &catalogue.lines };
            let extra = columns_of(everywhere, self.accepted, laws, Domain::Both)?;
            if let Some(made) = with_contact(everywhere, &extra, &flights, believed, until, options) {
                (law, p, of_both) = (Some(made.law), made.p, true);
            }
        }
        let mut out = Round { clusters: of_some.clusters.len(), atlas, diagnosis, law: None, next: None };
        let Some(OneLaw { best: found, rival, mut also }) = law else { return Some(Some(out)) };
        let ratio = (found.error() / squared_error(problem)).sqrt();
        let elsewhere = out.diagnosis.as_ref().and_then(|d| pointed_elsewhere(d, &out.atlas, &found, ratio, session));
        also.extend(elsewhere.filter(|c| !also.contains(c)));
        let without: Vec<f64> = problem.folds.iter().map(|f| f.error).collect();
        let p_gain = sign_flip_p(&found.errors, &without, 2000, options.seed ^ 0x1a35);
        let limit = if of_both { believed.sqrt() } else { believed };
        if ratio < limit && p_gain < options.significance {
            out.next = rival.filter(|_| number == 0).and_then(|r| next_recording(session, &found, &r));
            session.counter.so_far(&wording::law_so_far(session, &found, ratio, number > 0));
            out.law = Some(Step { fitted: found, ratio, p, also, of_both });
        }
        Some(Some(out))
    }

    /// All laws again, each beside the others.
    fn refit(&self, mut laws: Vec<Step>) -> Vec<Step> {
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
                let Some(problem) = self.with(&others) else { continue };
                let start = laws[i].fitted.nonlinear.clone();
                if let Some(better) = fit::fit(self.flights, &problem, &laws[i].fitted.law, start, STEPS) {
                    laws[i].fitted = better;
                }
            }
        }
        laws
    }

    /// Laws for users, each with intervals beside the others. `taken` are identifiers that exist.
    fn described(&self, laws: &[Step], taken: &[&str]) -> Vec<FoundLaw> {
        let mut ids: Vec<String> = taken.iter().map(|t| (*t).to_owned()).collect();
        let one = |(i, l): (usize, &Step)| {
            let domain = if l.of_both { Domain::Both } else { Domain::Flight };
            let mut others = laws.to_vec();
            others.remove(i);
            let of = |laws: &[Step]| columns_of(self.everywhere, self.accepted, laws, domain);
            let models = of(&others).zip(of(laws));
            describe(self.flights, &mut ids, l, &|estimates| {
                if let Some((others, whole)) = &models {
                    widened(self.everywhere, domain, others, whole, &l.fitted, estimates, self.options);
                }
            })
        };
        laws.iter().enumerate().map(one).collect()
    }
}

/// The link to which the diagnosis points, if a law on another link leaves hardly less error than
/// the curve there: the law's form may be another than the true one, which moves it.
fn pointed_elsewhere(
    diagnosis: &Diagnosis,
    atlas: &Atlas,
    law: &Fitted,
    ratio: f64,
    session: &Session<'_>,
) -> Option<Carrier> {
    let as_much = law.law.action == diagnosis.action && ALSO * ratio > diagnosis.held_out_ratio;
    let carriers = atlas.groups.iter().map(|g| g.carrier).filter(|c| as_much && *c != law.law.carrier);
    let mut there = carriers.filter(|c| c.name(session.scene) == diagnosis.carrier);
    there.next()
}

/// Squared held-out error of a problem.
fn squared_error(problem: &Problem) -> f64 {
    problem.folds.iter().map(|f| f.error).sum()
}

/// Share of the error that the best entry leaves in one of twenty patterns of random signs.
fn by_chance(atlas: &Atlas) -> f64 {
    let mut null: Vec<f64> = atlas.null.iter().map(|r| r.sqrt()).collect();
    null.sort_by(f64::total_cmp);
    null.get(null.len() / 20).copied().unwrap_or(f64::NAN)
}

/// The best entries of an atlas for users.
fn entries(atlas: &Atlas, scene: &Scene) -> Vec<Entry> {
    let of = |g: &Group| Entry {
        carrier: g.carrier.name(scene),
        action: g.action,
        direction: g.direction,
        variable: variable_of(g, scene),
        held_out_ratio: g.score.ratio.sqrt(),
    };
    fit::distinct(&atlas.groups, 10).into_iter().map(of).collect()
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
