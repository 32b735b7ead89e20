//! One round of a discovery: all effects ranked against the model, and the ranking judged.

use crate::judge::{
    AtFloor, alternatives, chosen_shares, confusions, is_trivial, judge, minimum_detectable, parts, plausible,
};
use crate::ladder::{Refit, estimates, group_names, key_of, to_build_on};
use crate::limits::{SMALLEST, limit, limit_by_number};
use crate::options::DiscoverOptions;
use crate::other_trials::tell_other_trials;
use crate::placebo::PLACEBOS;
use crate::problem::{Domain, Problem};
use crate::rank::{EffectScore, judged_in, null_ratios, score_effect};
use crate::result::{Candidate, FEWEST_CLUSTERS, MANY_CLUSTERS, RivalTest, Round, Verdict};
use crate::rivals::{Rival, rivals};
use crate::session::Session;
use crate::statistics::{ratio_interval, resamples};
use crate::wording;
use aloft_effects::{Effect, Family, Target};
use nalgebra::DMatrix;
use rayon::prelude::*;

/// Below this multiple of the floor an effect on a person has to leave less than `STRONG` of the
/// error.
const NEAR_FLOOR: f64 = 2.0;
const STRONG: f64 = 0.70;

/// True if the options ask for an effect.
pub(crate) fn wanted(effect: &dyn Effect, options: &DiscoverOptions) -> bool {
    let named = |list: &[String]| list.iter().any(|n| n == effect.id());
    (options.only.is_empty() || named(&options.only)) && !named(&options.without)
}

/// True for an effect that cannot be found again beside those found before: an alias of one of
/// them, a generalisation of it, or the same on the whole body. A second one of a kind on another
/// link or plate can. Without flights, an alias on any target counts: gains of single plates
/// together with a wrong mass would scale both sides of every row to zero.
fn excluded(effect: &dyn Effect, already: &[(&dyn Effect, Target)], has_flights: bool) -> bool {
    already.iter().any(|(found, target)| {
        let again = found.id() == effect.id() && !matches!(target, Target::Link(_) | Target::Plate(_));
        // what contains the effect found (wind contains drag) would only describe it once more
        let wider = effect.about().contains.contains(&found.id());
        again || wider || (found.about().aliases.contains(&effect.id()) && (!has_flights || *target == Target::Body))
    })
}

/// What a round ranks, and the model that an effect would join.
pub(crate) struct Ask<'r, 'a> {
    pub session: &'r Session<'r>,
    pub problem: &'r Problem,
    /// Columns of the model in the problem.
    pub extra: &'r [Vec<DMatrix<f64>>],
    /// Effects to rank.
    pub effects: &'r [&'a dyn Effect],
    /// The model in the problem.
    pub beside: Refit<'r, 'a>,
    /// True if a single effect may explain everything.
    pub first_round: bool,
    pub has_flights: bool,
    pub at_floor: Option<&'r AtFloor>,
}

/// What an effect has to leave to be accepted.
struct Limits {
    /// Ratios of held-out errors of the best effect by chance, smallest first.
    null: Vec<f64>,
    /// Quantiles 0.01, 0.05 and 0.5 of `null`.
    quantiles: [f64; 3],
    /// Clusters with judged rows.
    clusters: usize,
    /// True if there are too few clusters to name anything.
    few: bool,
    threshold: f64,
    /// Limit for a small force on a rigid body; 0 for none.
    sharper: f64,
    near_floor: bool,
    first_round: bool,
}

impl Limits {
    /// Largest ratio at which an effect is accepted.
    fn of(&self, effect: &dyn Effect, options: &DiscoverOptions) -> f64 {
        let limit = limit(effect, self.first_round, options);
        let limit = if self.near_floor && !effect.about().by_group { limit.min(STRONG) } else { limit };
        let small = if effect.about().family == Family::Forces { self.sharper } else { 0.0 };
        self.threshold.min(limit).max(small)
    }

    /// Largest ratio at which any effect is accepted.
    fn largest(&self) -> f64 {
        self.threshold.max(self.sharper)
    }
}

/// What a round says.
struct Judged {
    verdict: Verdict,
    effects: Vec<String>,
    tests: Vec<RivalTest>,
    /// What the plates say about effects that flights do not tell apart.
    by_plates: Vec<String>,
}

impl Judged {
    fn words(&self, candidates: &[Candidate], few: bool) -> String {
        let at_edge: Vec<&str> = self.tests.iter().filter(|d| d.only_as_limit).map(|d| d.effect.as_str()).collect();
        let said = wording::round(self.verdict, &self.effects, &at_edge, candidates, few);
        std::iter::once(said).chain(self.by_plates.iter().cloned()).collect::<Vec<_>>().join("; ")
    }
}

/// Ranks all effects on a problem and judges the ranking.
pub(crate) fn run_round<'a>(ask: &Ask<'_, 'a>) -> (Round, Vec<EffectScore<'a>>, Vec<Rival<'a>>) {
    let (session, problem, options) = (ask.session, ask.problem, ask.beside.options);
    let scores = ask.scores();
    let limits = ask.limits(&scores);
    let mut candidates = ask.candidates(&scores, &limits);
    confusions(session, problem, &scores, &mut candidates, options);
    let (sharp, mut rivals) = rivals(session, problem, ask.extra, &scores, &candidates, options);
    let sharp = sharp.as_ref().unwrap_or(problem);
    if let (true, Domain::Flight, Some(floor)) = (session.prior.is_some(), problem.domain, ask.at_floor) {
        for rival in &mut rivals {
            rival.at_floor = floor.times(rival.error() / sharp.n_judged as f64) <= 1.0;
        }
    }
    let mut judged = ask.judged(sharp, &mut rivals);
    ask.put_first(&rivals, &mut judged.effects, &mut candidates);
    ask.add_what_looks_alike(&rivals, &mut judged);
    if limits.few || candidates.iter().all(|c| c.placebo) {
        judged.verdict = Verdict::NotDetectable;
    }
    let words = judged.words(&candidates, limits.few);
    let round = Round {
        judged_on: wording::domain(problem.domain).to_owned(),
        model: ask.model(),
        held_out_error: problem.plain().sqrt() * session.unit[0],
        held_out_parts: parts(session, problem),
        threshold: limits.largest(),
        null_quantiles: limits.quantiles,
        clusters: limits.clusters,
        verdict: judged.verdict,
        effects: judged.effects,
        joined: Vec::new(),
        missing: 0,
        superseded: false,
        words,
        rival_tests: judged.tests,
        candidates,
    };
    (round, scores, rivals)
}

impl<'a> Ask<'_, 'a> {
    /// Effects of the model with their targets.
    pub fn already(&self) -> impl Iterator<Item = (&'a dyn Effect, Target)> {
        let of_user = self.beside.accepted.iter().map(|c| (c.effect, c.target));
        of_user.chain(self.beside.kept.iter().map(|v| (v.effect, v.target)))
    }

    /// Names of the effects of the model.
    fn model(&self) -> Vec<String> {
        let of_user = self.beside.accepted.iter().map(|c| c.key(self.session.scene));
        of_user.chain(self.beside.found.iter().map(|f| f.key.clone())).collect()
    }

    /// Targets on which an effect is in the model.
    fn taken(&self, effect: &dyn Effect) -> Vec<Target> {
        self.already().filter(|(a, _)| a.id() == effect.id()).map(|(_, target)| target).collect()
    }

    /// Effects that are ranked, and placebos, which are marked.
    fn tried(&self) -> Vec<(&'a dyn Effect, bool)> {
        // beside a force that flights show, the zero of a plate would only undo what the force does
        // in contact; recordings that show it are not in doubt
        let flights_show_one =
            !self.beside.kept.is_empty() || self.beside.accepted.iter().any(|a| a.effect.acts().in_flight());
        let zeros_known = flights_show_one && self.session.blocks.iter().any(|b| b.zero.is_some());
        let already: Vec<_> = self.already().collect();
        let possible = |e: &&dyn Effect| {
            !(zeros_known && e.about().shows_unloaded)
                && wanted(*e, self.beside.options)
                && judged_in(*e, self.problem.domain)
                && !excluded(*e, &already, self.has_flights)
        };
        let placebos = PLACEBOS.iter().map(|p| (p as &dyn Effect, true));
        self.effects.iter().copied().filter(possible).map(|e| (e, false)).chain(placebos).collect()
    }

    /// The ranking, smallest held-out error first.
    fn scores(&self) -> Vec<EffectScore<'a>> {
        let (session, problem) = (self.session, self.problem);
        let score = |&(e, placebo): &(&'a dyn Effect, bool)| {
            let scored = score_effect(session, problem, e, &self.taken(e), None, placebo, true);
            session.counter.one();
            scored
        };
        let mut scores: Vec<EffectScore<'a>> = self.tried().par_iter().filter_map(score).collect();
        let by_error =
            |a: &EffectScore<'_>, b: &EffectScore<'_>| a.mean_square(problem).total_cmp(&b.mean_square(problem));
        scores.sort_by(by_error);
        // where the best effect acts in some trials only, every other one is given the same trials
        let best = scores.first().filter(|s| !s.effect.about().by_group);
        let acting = best.map(|s| s.scored[s.best].variant.group.clone()).filter(|group| !group.is_empty());
        if let Some(acting) = acting {
            let there = |s: &EffectScore<'a>| {
                let whole = s.placebo || s.effect.about().by_group;
                let taken = self.taken(s.effect);
                (!whole).then(|| score_effect(session, problem, s.effect, &taken, Some(&acting), false, true)).flatten()
            };
            let again: Vec<Option<EffectScore<'a>>> = scores.par_iter().map(there).collect();
            for (score, again) in scores.iter_mut().zip(again) {
                if let Some(again) = again.filter(|a| by_error(a, score).is_lt()) {
                    *score = again;
                }
            }
            scores.sort_by(by_error);
        }
        self.tell_other_trials(&mut scores);
        scores
    }

    /// What acts in some trials may also act in those that flights say nothing of.
    fn tell_other_trials(&self, scores: &mut [EffectScore<'a>]) {
        let in_some = |s: &EffectScore<'_>| {
            let comes_and_goes = s.scored.iter().any(|v| !v.variant.group.is_empty());
            comes_and_goes && s.effect.acts().in_contact() && !s.placebo
        };
        if self.problem.domain != Domain::Flight || !scores.iter().any(in_some) {
            return;
        }
        let Some(contact) = self.beside.in_contact(self.session, true) else { return };
        for score in scores.iter_mut().filter(|s| in_some(s)) {
            tell_other_trials(self.session, self.problem, &contact, score);
        }
    }

    /// Limits from chance, from the number of clusters, and from what errors that repeat imitate.
    fn limits(&self, scores: &[EffectScore<'_>]) -> Limits {
        let (session, problem, options) = (self.session, self.problem, self.beside.options);
        let mut null = null_ratios(problem, scores, options.null_draws, options.seed);
        null.sort_by(f64::total_cmp);
        let quantile = |share: f64| null.get((share * null.len() as f64) as usize).copied().unwrap_or(f64::NAN);
        let quantiles = [quantile(0.01), quantile(0.05), quantile(0.5)];
        // with few clusters there are few sign patterns, the original one among them
        let clusters = problem.clusters.iter().filter(|c| !c.judged.is_empty()).count();
        let few = clusters < FEWEST_CLUSTERS;
        let largest = limit_by_number(problem.clusters.len(), options);
        // with few sign patterns, and nonlinear parameters kept at their starts, the 5 % quantile
        // is too lenient
        let by_chance = quantiles[usize::from(clusters >= MANY_CLUSTERS)];
        let threshold = if few {
            largest
        } else if by_chance.is_finite() {
            largest.min(by_chance)
        } else {
            options.belief.min(0.8)
        };
        let (plain, in_flight) = (problem.plain(), problem.domain == Domain::Flight);
        // On a person errors repeat from trial to trial (soft tissue, the prior), and where they
        // are most of what is left an effect that imitates them fits well. Differences between
        // groups of trials do not repeat.
        let near_floor =
            session.prior.is_some() && in_flight && self.at_floor.is_some_and(|f| f.times(plain) < NEAR_FLOOR);
        // The errors of a rigid body do not repeat. A small effect is accepted there if it gains
        // twice as much as one in a hundred would by chance: the more flights, the smaller the
        // effect. The first one has to bring the error to its floor: a share of a large error is
        // not what is missing.
        let rigid = session.prior.is_none() && in_flight;
        let small_is_all = !self.first_round || self.at_floor.is_none_or(|f| f.reached_by(plain * SMALLEST.powi(2)));
        let sharper = if rigid && small_is_all && clusters >= MANY_CLUSTERS && quantiles[0].is_finite() {
            quantiles[0].powi(2).min(SMALLEST)
        } else {
            0.0
        };
        let first_round = self.first_round;
        Limits { null, quantiles, clusters, few, threshold, sharper, near_floor, first_round }
    }

    /// The ranking in the terms of the answer, with what is accepted.
    fn candidates(&self, scores: &[EffectScore<'_>], limits: &Limits) -> Vec<Candidate> {
        let (session, problem, options) = (self.session, self.problem, self.beside.options);
        let plain = problem.plain();
        let plain_errors: Vec<f64> = problem.folds.iter().map(|f| f.error).collect();
        let weights = resamples(problem.folds.len(), options.resamples, options.seed ^ 0x5eed);
        let shares = chosen_shares(scores, &weights);
        let smallest =
            |of: bool| scores.iter().filter(|s| s.placebo == of).map(|s| s.mean_square(problem)).fold(plain, f64::min);
        let [best_square, placebo] = [false, true].map(smallest);
        let candidate = |(score, share): (&EffectScore<'_>, &f64)| {
            let best = &score.scored[score.best];
            let mean_square = score.mean_square(problem);
            let ratio = (mean_square / plain).sqrt();
            let ci95 = ratio_interval(&score.fold_error, &plain_errors, &weights);
            let (coefficients, nonlinear) = estimates(session, best);
            let plausible = plausible(best, &coefficients);
            let beaten = limits.null.iter().filter(|n| **n <= ratio).count();
            let accepted_below = limits.of(score.effect, options);
            let believed = !limits.few
                && !score.placebo
                && plausible
                && ratio < accepted_below
                && ci95[1] < 1.0
                && mean_square < placebo
                && !is_trivial(session, problem, mean_square);
            Candidate {
                effect: score.effect.id().to_owned(),
                key: key_of(session, best),
                target: best.variant.target,
                kind: score.effect.kind(),
                class: score.effect.about().class.to_owned(),
                judged_on: wording::domain(problem.domain).to_owned(),
                held_out_ratio: ratio,
                accepted_below,
                ci95,
                chosen_share: *share,
                family_wise_p: (beaten + 1) as f64 / (limits.null.len() + 1) as f64,
                minimum_detectable: minimum_detectable(
                    problem,
                    best,
                    best_square,
                    if limits.few { 0.0 } else { accepted_below },
                ),
                coefficients,
                nonlinear,
                trials: group_names(session, best),
                confused_with: Vec::new(),
                plausible,
                believed,
                placebo: score.placebo,
                alternatives: alternatives(session, problem, score),
                evidence: None,
            }
        };
        scores.par_iter().zip(&shares).map(candidate).collect()
    }

    /// The verdict on the rivals, from flights and from what the plates say about them. What the
    /// plates rule out leaves the rivals.
    fn judged(&self, sharp: &Problem, rivals: &mut Vec<Rival<'a>>) -> Judged {
        let (session, options) = (self.session, self.beside.options);
        let mut by_plates: Vec<String> = Vec::new();
        loop {
            let (mut verdict, mut effects, mut tests) = judge(session, sharp, rivals, options);
            let at_edge: Vec<String> = tests.iter().filter(|d| d.only_as_limit).map(|d| d.effect.clone()).collect();
            let named = matches!(verdict, Verdict::OneOf | Verdict::Supported) && self.problem.domain == Domain::Flight;
            let plates = named.then(|| self.beside.by_plates(session, rivals, &effects, &at_edge)).flatten();
            let Some(plates) = plates else { return Judged { verdict, effects, tests, by_plates } };
            by_plates.extend(Some(plates.words).filter(|words| !words.is_empty()));
            if plates.ruled_out.is_empty() {
                effects.extend(plates.inside.iter().cloned());
                for test in tests.iter_mut().filter(|d| plates.inside.contains(&d.effect)) {
                    test.only_as_limit = false;
                }
                verdict = if effects.len() == 1 { Verdict::Supported } else { Verdict::OneOf };
                return Judged { verdict, effects, tests, by_plates };
            }
            // others may have been left out in favour of what the plates rule out
            rivals.retain(|r| !plates.ruled_out.iter().any(|id| id == r.id()));
        }
    }

    /// The effect that the answer describes, that joins the model in later rounds and that the user
    /// is told to add is one and the same: it is named first, on the link on which it joins.
    fn put_first(&self, rivals: &[Rival<'_>], effects: &mut [String], candidates: &mut [Candidate]) {
        let session = self.session;
        let Some(first) = to_build_on(rivals, effects, self.beside.options) else { return };
        let Some(at) = effects.iter().position(|id| id == first.id()) else { return };
        effects[..=at].rotate_right(1);
        let key = key_of(session, &first.scored);
        if let Some(c) = candidates.iter_mut().find(|c| c.effect == first.id() && c.key != key) {
            (c.coefficients, c.nonlinear) = estimates(session, &first.scored);
            (c.key, c.target, c.trials) = (key, first.scored.variant.target, group_names(session, &first.scored));
        }
    }

    /// Names what an effect at its value looks like on a person.
    fn add_what_looks_alike(&self, rivals: &[Rival<'_>], judged: &mut Judged) {
        if self.session.prior.is_none() {
            return;
        }
        let possible = |id: &str| {
            !self.already().any(|(e, _)| e.id() == id)
                && self.effects.iter().any(|e| e.id() == id && wanted(*e, self.beside.options))
        };
        let named = rivals.iter().filter(|r| judged.effects.iter().any(|id| id == r.id()));
        let alike: Vec<&str> = named
            .flat_map(|r| r.scored.variant.effect.looks_like(r.scored.theta.as_slice()))
            .copied()
            .filter(|id| possible(id))
            .collect();
        for id in alike {
            if !judged.effects.iter().any(|e| e == id) {
                judged.effects.push(id.to_owned());
                judged.verdict = Verdict::OneOf;
            }
        }
    }
}
