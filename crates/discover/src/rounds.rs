//! The rounds of a discovery: each ranks the effects against the model that holds what earlier
//! rounds found, and adds an effect or a pair.

use crate::DiscoverError;
use crate::candidate::Scored;
use crate::conclude::RoundResults;
use crate::held_out::HeldOutResult;
use crate::judge::AtFloor;
use crate::ladder::{Refit, as_found, extra_columns, key_of, to_build_on};
use crate::limits::limit;
use crate::nonlinear::settled;
use crate::not_tried::not_tried;
use crate::options::DiscoverOptions;
use crate::pairs::{ALONE, CARRIED, Pair, Search, better_pair, pair_alone, pair_as_good};
use crate::problem::{Domain, Problem};
use crate::rank::{EffectScore, judged_in};
use crate::result::{FEWEST_CLUSTERS, NotTried, Round, Verdict};
use crate::rivals::Rival;
use crate::round::{Ask, run_round, wanted};
use crate::session::Session;
use crate::shown_in_both::also_in_flight;
use crate::wording;
use aloft_effects::{Effect, EffectInstance};
use nalgebra::DMatrix;

/// A pair of effects has to reduce the error below this share of that of the best single effect.
const PAIR: f64 = 0.93;

/// Rounds in flight, then in contact, and what they found so far.
pub(crate) struct Rounds<'s, 'a> {
    pub session: &'s Session<'s>,
    /// Effects to rank.
    pub effects: &'s [&'a dyn Effect],
    /// Effects of the model.
    pub accepted: &'s [EffectInstance<'a>],
    pub options: &'s DiscoverOptions,
    pub made: RoundResults<'a>,
}

/// The ranking of one round, with the effect to build on.
struct Ranked<'r, 'a> {
    domain: Domain,
    problem: &'r Problem,
    scores: &'r [EffectScore<'a>],
    /// The effect that the round names and builds on.
    chosen: Option<&'r Rival<'a>>,
    at_floor: Option<&'r AtFloor>,
}

impl<'a> Ranked<'_, 'a> {
    /// Held-out mean square of the rows without and with the chosen effect.
    fn mean_squares(&self) -> [f64; 2] {
        let plain = self.problem.plain();
        [plain, self.chosen.map_or(plain, |r| self.mean_square(r.error()))]
    }

    fn mean_square(&self, squared_error: f64) -> f64 {
        squared_error / self.problem.n_judged as f64
    }

    /// True for effects that may be part of a pair and that `further` allows.
    fn usable(&self, options: &DiscoverOptions, further: impl Fn(&EffectScore<'a>) -> bool) -> Vec<bool> {
        self.scores.iter().map(|s| !s.placebo && further(s) && limit(s.effect, false, options) > 0.0).collect()
    }
}

impl<'a> Rounds<'_, 'a> {
    /// Ranks and adds until nothing more is found in a domain. Returns the floor of the error
    /// before anything was found; none without a comparison.
    pub fn in_domain(&mut self, domain: Domain) -> Result<Option<AtFloor>, DiscoverError> {
        let mut first_gain: Option<f64> = None;
        let mut at_floor: Option<AtFloor> = None;
        if domain == Domain::Contact {
            self.drop_what_contact_contradicts();
        }
        for _ in 0..self.options.rounds.max(1) {
            let extra = extra_columns(self.session, domain, self.accepted, &self.made.kept, &self.made.found);
            let problem = match self.problem(domain, &extra) {
                Ok(problem) => problem,
                // too few contact stretches: keep the result from the flights
                Err(DiscoverError::TooFew { .. }) if !self.made.rounds.is_empty() => break,
                Err(e) => return Err(e),
            };
            let plain = problem.plain();
            if self.made.kept.is_empty() {
                at_floor = self.session.model_error[usize::from(domain == Domain::Contact)]
                    .map(|model_error| AtFloor { model_error, scale: model_error.held_out_error / plain.sqrt() });
            } else if at_floor.as_ref().is_some_and(|f| self.nothing_left(domain, f, plain)) {
                break;
            }
            let (mut round, scores, rivals) = self.rank(domain, &problem, &extra, at_floor.as_ref());
            if self.made.rounds.is_empty() {
                self.made.errors[0] = plain;
            }
            self.leaves(domain, plain);
            let chosen = names(&round).then(|| to_build_on(&rivals, &round.effects, self.options)).flatten();
            let ranked = Ranked { domain, problem: &problem, scores: &scores, chosen, at_floor: at_floor.as_ref() };
            self.compare_with_flights(&ranked, &mut round);
            let [_, left] = ranked.mean_squares();
            if let (Some(first), Some(_)) = (first_gain, chosen)
                && plain - left < 0.01 * first
            {
                leave_to_the_first(&mut round);
            }
            if let Some(pair) = self.pair(&ranked, &round) {
                first_gain = first_gain.or(Some(plain - left));
                self.join_pair(&ranked, round, pair);
                continue;
            }
            let go_on = names(&round);
            let sure = round.verdict == Verdict::Supported;
            let mut join = Vec::new();
            if let (true, Some(rival)) = (go_on, chosen) {
                first_gain = first_gain.or(Some(plain - left));
                join = self.single(&ranked, rival, &mut round);
            }
            self.made.rounds.push(round);
            if !go_on {
                break;
            }
            self.join(join);
            // no single effect is named, so further rounds have no definite model to extend
            if !sure && self.made.rounds.len() >= self.options.rounds {
                break;
            }
        }
        Ok(at_floor)
    }

    fn problem(&self, domain: Domain, extra: &[Vec<DMatrix<f64>>]) -> Result<Problem, DiscoverError> {
        Problem::new(self.session, domain, extra, self.options.fewest_trials, self.options.prior_weight)
    }

    fn refit(&self) -> Refit<'_, 'a> {
        let (kept, found) = (&self.made.kept, &self.made.found);
        Refit { accepted: self.accepted, kept, found, options: self.options }
    }

    /// States what the rows of a domain leave; contact counts where there are no flights.
    fn leaves(&mut self, domain: Domain, mean_square: f64) {
        if domain == Domain::Flight || !self.made.has_flights {
            self.made.errors[1] = mean_square;
        }
    }

    /// What flights name has to hold in contact.
    fn drop_what_contact_contradicts(&mut self) {
        let Some(why) = self.refit().contradicted(self.session) else { return };
        let made = &mut self.made;
        for round in made.rounds.iter_mut().filter(|r| names(r)) {
            round.words = format!("{}; not named, because {why}", round.words);
            round.superseded = true;
        }
        let keys: Vec<String> = made.found.iter().map(|f| format!("`{}`", f.key)).collect();
        made.contradicted = Some(format!("{} would lower the error in flight, but {why}", keys.join(" and ")));
        (made.kept, made.found, made.errors[1]) = (Vec::new(), Vec::new(), made.errors[0]);
    }

    /// An error at its floor leaves nothing to explain: further effects would fit errors that
    /// repeat. A rigid body has no such errors, and a small second effect can hide within the
    /// floor's interval.
    fn nothing_left(&self, domain: Domain, floor: &AtFloor, plain: f64) -> bool {
        let rigid = self.session.prior.is_none() && domain == Domain::Flight;
        if rigid { floor.times(plain) <= 1.0 } else { floor.reached_by(plain) }
    }

    /// Ranks all effects against the present model, and notes those that cannot be ranked.
    fn rank(
        &mut self,
        domain: Domain,
        problem: &Problem,
        extra: &[Vec<DMatrix<f64>>],
        at_floor: Option<&AtFloor>,
    ) -> (Round, Vec<EffectScore<'a>>, Vec<Rival<'a>>) {
        let ask = Ask {
            session: self.session,
            problem,
            extra,
            effects: self.effects,
            beside: self.refit(),
            first_round: self.made.kept.is_empty(),
            has_flights: self.made.has_flights,
            at_floor,
        };
        let ranking = run_round(&ask);
        // an effect whose law gives no numbers cannot be ranked; report it, so that the result is
        // not taken for "nothing missing"
        let unranked = |e: &dyn Effect| {
            let listed =
                ranking.1.iter().any(|s| s.effect.id() == e.id()) || ask.already().any(|(a, _)| a.id() == e.id());
            wanted(e, self.options)
                && judged_in(e, domain)
                && (!listed || aloft_effects::effect(e.id()).is_err())
                && !self.made.left_out.iter().any(|l| l.effect == e.id())
        };
        let missing: Vec<NotTried> =
            self.effects.iter().filter(|e| unranked(**e)).filter_map(|e| not_tried(self.session, *e, domain)).collect();
        self.made.left_out.extend(missing);
        ranking
    }

    /// An error of the plates and a force on the body look the same in contact: a force that
    /// flights show as well stands beside an effect of the plates.
    fn compare_with_flights(&self, of: &Ranked<'_, 'a>, round: &mut Round) {
        let flight = self.made.rounds.iter().find(|r| r.judged_on == wording::domain(Domain::Flight));
        if let (Domain::Contact, Some(rival), Some(flight)) = (of.domain, of.chosen, flight) {
            let judged = |e: &&&dyn Effect| wanted(**e, self.options) && judged_in(**e, Domain::Flight);
            let forces: Vec<&dyn Effect> = self.effects.iter().filter(judged).copied().collect();
            let in_some = !rival.scored.variant.group.is_empty();
            let left = of.mean_square(rival.error());
            also_in_flight(self.session, of.problem, &forces, flight, left, in_some, round);
        }
    }

    /// Two effects that explain what one does not.
    fn pair(&self, of: &Ranked<'_, 'a>, round: &Round) -> Option<Pair<'a>> {
        self.pair_for_one(of, round).or_else(|| self.pair_of_none(of, round))
    }

    /// Two effects in place of the chosen one, if it leaves the error above its floor.
    fn pair_for_one(&self, of: &Ranked<'_, 'a>, round: &Round) -> Option<Pair<'a>> {
        let rival = of.chosen.filter(|_| names(round))?;
        if of.at_floor.is_some_and(|f| f.reached_by(of.mean_square(rival.error()))) {
            return None;
        }
        // an effect that reproduces the named one at the edge of its range is named, too
        let limit_of_named = |id: &str| round.rival_tests.iter().any(|d| d.only_as_limit && d.effect == id);
        let named = |id: &str| round.effects.iter().any(|e| e == id) || limit_of_named(id);
        let usable = of.usable(self.options, |s| {
            let more = s.effect.about().contains.contains(&rival.id());
            !more && !named(s.effect.id())
        });
        let (a, b, error, _) = better_pair(&self.search(of, rival, &usable, &self.refit()), PAIR)?;
        let ids = ids_of(&a, &b);
        Some((a, b, error, ids))
    }

    fn search<'r>(
        &'r self,
        of: &Ranked<'r, 'a>,
        rival: &Rival<'_>,
        usable: &'r [bool],
        refit: &'r Refit<'r, 'r>,
    ) -> Search<'r, 'a> {
        let (problem, scores) = (of.problem, of.scores);
        Search { session: self.session, problem, scores, best: rival.index, usable, refit }
    }

    /// Two effects can hide each other: where the best single one leaves the error far above its
    /// floor, or none is accepted, pairs are tried without a winner.
    fn pair_of_none(&self, of: &Ranked<'_, 'a>, round: &Round) -> Option<Pair<'a>> {
        let (session, options) = (self.session, self.options);
        let [plain, left] = of.mean_squares();
        let share = if names(round) { (left / plain).max(0.0).sqrt() } else { 1.0 };
        let remains = session.model_error[usize::from(of.domain == Domain::Contact)]
            .map(|s| HeldOutResult { held_out_error: s.held_out_error * share, ..s });
        // where the plates show in which trials something was carried, loads on two links are tried
        // with less error left, too
        let carried = of.domain == Domain::Flight && session.shows_loads_on_plates();
        let far = remains.is_some_and(|s| s.is_far());
        let tried = far || (carried && remains.is_some_and(|s| s.is_above()));
        if !(self.made.kept.is_empty() && round.clusters >= FEWEST_CLUSTERS && tried) {
            return None;
        }
        let usable = of.usable(options, |s| far || s.effect.about().by_group);
        let most = if far { ALONE } else { CARRIED };
        let refit = self.refit();
        let any = pair_alone(session, of.problem, of.scores, &usable, &refit, most)?;
        // an effect that contains another one counts only if it does better
        let wider = |i: usize| {
            let contains = of.scores[i].effect.about().contains;
            (0..of.scores.len()).any(|j| usable[j] && contains.contains(&of.scores[j].effect.id()))
        };
        let plain: Vec<bool> = (0..of.scores.len()).map(|i| usable[i] && !wider(i)).collect();
        let better = |p: &Pair<'_>| (any.2 / p.2).sqrt() < options.belief;
        match pair_alone(session, of.problem, of.scores, &plain, &refit, most) {
            Some(pair) if !better(&pair) => Some(pair),
            _ => Some(any),
        }
    }

    /// Names a pair and adds both effects to the model.
    fn join_pair(&mut self, of: &Ranked<'_, 'a>, mut round: Round, pair: Pair<'a>) {
        let (a, b, error, ids) = pair;
        let plain = of.problem.plain();
        let share = 100.0 * (of.mean_square(error) / plain).sqrt();
        let keys = [&a, &b].map(|s| key_of(self.session, s));
        let one = of.chosen.filter(|_| names(&round)).map(|r| {
            let left = 100.0 * (of.mean_square(r.error()) / plain).sqrt();
            (key_of(self.session, &r.scored), left)
        });
        round.words = wording::pair(&keys, share, one);
        let both = ids_of(&a, &b);
        let sure_of_both = ids.iter().all(|id| both.contains(id));
        round.verdict = if sure_of_both { Verdict::Supported } else { Verdict::OneOf };
        round.effects = ids;
        round.missing = both.len();
        round.joined = both;
        self.made.rounds.push(round);
        self.leaves(of.domain, of.mean_square(error));
        self.join(vec![a, b]);
    }

    /// The chosen effect, or the pair that is as good and joins the model in its place.
    fn single(&mut self, of: &Ranked<'_, 'a>, rival: &Rival<'a>, round: &mut Round) -> Vec<Scored<'a>> {
        let settled = settled(self.session, of.problem, &rival.scored);
        let its = as_found(self.session, &settled);
        if let Some(c) = round.candidates.iter_mut().find(|c| c.key == its.key) {
            (c.coefficients, c.nonlinear) = (its.coefficients, its.nonlinear);
        }
        let mut join = vec![settled];
        round.missing = 1;
        let mut left = of.mean_square(rival.error());
        // one that contains the chosen effect is no part of a pair beside it
        let usable = of.usable(self.options, |s| !s.effect.about().contains.contains(&rival.id()));
        if let Some((a, b, error, ids)) = pair_as_good(&self.search(of, rival, &usable, &self.refit())) {
            let keys = [&a, &b].map(|s| key_of(self.session, s));
            round.verdict = Verdict::OneOf;
            // the simpler of equals joins the model
            let pair_joins = error < rival.error();
            if pair_joins {
                left = of.mean_square(error);
                join = vec![a, b];
            }
            let share = (left / of.problem.plain()).sqrt();
            round.words = wording::or_pair(&round.effects, &keys, pair_joins, share);
            let named = std::mem::take(&mut round.effects);
            round.effects = in_order(if pair_joins { [ids, named] } else { [named, ids] });
        }
        self.leaves(of.domain, left);
        round.joined = join.iter().map(|s| s.variant.effect.id().to_owned()).collect();
        join
    }

    fn join(&mut self, effects: Vec<Scored<'a>>) {
        for scored in effects {
            self.made.found.push(as_found(self.session, &scored));
            self.made.kept.push(scored.variant);
        }
    }
}

/// True if a round names an effect.
fn names(round: &Round) -> bool {
    matches!(round.verdict, Verdict::Supported | Verdict::OneOf)
}

/// Names nothing: what remains is probably left over from a large effect that the model does not
/// describe exactly.
fn leave_to_the_first(round: &mut Round) {
    round.words = format!(
        "what remains is below a tenth of the effect found before and may be left over from it; {}",
        round.words
    );
    round.verdict = Verdict::NothingMissing;
    round.effects.clear();
}

fn ids_of(a: &Scored<'_>, b: &Scored<'_>) -> Vec<String> {
    vec![a.variant.effect.id().to_owned(), b.variant.effect.id().to_owned()]
}

/// Two lists one after the other, each name once.
fn in_order(lists: [Vec<String>; 2]) -> Vec<String> {
    let mut out: Vec<String> = Vec::new();
    for id in lists.into_iter().flatten() {
        if !out.contains(&id) {
            out.push(id);
        }
    }
    out
}
