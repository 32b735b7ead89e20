//! The search beyond the catalogue as part of a discovery: when it is made, and when its laws
//! replace what the catalogue names.

use crate::by_stages::Staged;
use crate::candidate::Variant;
use crate::held_out::HeldOutResult;
use crate::ladder::extra_columns;
use crate::laws::{Direction, Doubted, FormLimits, FoundLaw, Line, OpenWorld, Rivals, Together};
use crate::only_as_limit::{delay_or_wind, has_unknown_place, is_far_away, may_be_late};
use crate::options::DiscoverOptions;
use crate::problem::{Domain, Problem};
use crate::progress::Until;
use crate::refused::Refused;
use crate::result::{AgainstLaw, Candidate, Discovery, Found, MANY_CLUSTERS, Round, Verdict};
use crate::session::Session;
use crate::sizes::predicts_as_well;
use crate::wording;
use aloft_effects::{Effect, EffectInstance};
use aloft_regressor::POOR_TIMES_FLOOR;

/// Share of the error that named effects leave within the floor's interval, above which laws do not
/// take their place.
const LESS: f64 = 0.8;

/// Fewest clusters of which fewer than one in a hundred patterns of signs are as good as the best.
const MANY_SIGNS: usize = 8;

/// Largest share of the error in contact that a law of both may leave.
const IN_CONTACT: f64 = 0.9;

/// What the catalogue says, and what it leaves, before the search beyond it.
pub(crate) struct Beyond<'s, 'a> {
    pub session: &'s Session<'s>,
    /// Effects of the model.
    pub accepted: &'s [EffectInstance<'a>],
    /// Effects of the catalogue.
    pub effects: &'s [&'a dyn Effect],
    /// Effects found.
    pub kept: &'s [Variant<'a>],
    /// Effects that are not named because their size may be zero: a law has to do better.
    pub in_doubt: &'s [Variant<'a>],
    /// True if contact contradicts what flights found.
    pub refuted: bool,
    /// Errors with what was found, in flight and in contact.
    pub left: &'s [Option<HeldOutResult>; 2],
    pub until: &'s Until,
    pub options: &'s DiscoverOptions,
}

/// Why laws are sought, and what they have to do better than.
struct Reasons {
    /// True if the catalogue names what is missing.
    named: bool,
    /// True if the catalogue needs effects of several kinds.
    several: bool,
    /// True if contact is left far above its floor by effects that act there and in flight.
    far_in_contact: bool,
    /// True if flights are left above their floor.
    remains: bool,
    /// True if the effects of several kinds remove an error that is above its floor.
    several_above: bool,
    /// True if what is named reaches the floor and shows a sign of another law.
    hides: bool,
    /// True if nothing is named, and a wide interval of the floor may hide a law.
    in_floor: bool,
    /// True if what is named is compared with the first law, whatever it leaves.
    compared: bool,
    /// True if the form of the effect that is named is refuted.
    refuted_form: bool,
    /// True if that or its place is a sign of another law.
    of_another_form: bool,
}

impl Reasons {
    /// True if something besides a comparison asks for laws.
    fn asked(&self, out: &Discovery) -> bool {
        self.remains || self.several_above || self.hides || self.in_floor || out.misfit.is_some()
    }

    /// True if named effects reach the floor and nothing else is held against them.
    fn within_floor(&self) -> bool {
        (self.hides || self.compared) && !(self.of_another_form || self.remains || self.several_above)
    }
}

impl<'a> Beyond<'_, 'a> {
    /// Searches for laws where flights leave an error above the interval of its floor, where the
    /// catalogue needs effects of several kinds, or where the strength of a named effect does not
    /// follow its law, and lets laws that convince replace what the catalogue names.
    pub fn look(&self, out: &mut Discovery) {
        let (session, options) = (self.session, self.options);
        let named = is_named(out);
        let beside = (named && !self.kept.is_empty() && !self.until.is_over())
            .then(|| self.problem(self.kept, &out.found))
            .flatten();
        // one effect of which the answer names several is compared as each of them
        let others = match (self.kept, &out.groups[..]) {
            ([one], [_]) if named => other_members(session, self.effects, one, out),
            _ => Vec::new(),
        };
        self.compare_strength(beside.as_ref(), out);
        let why = self.reasons(beside.as_ref(), &others, out);
        if !(why.asked(out) || why.compared) {
            return;
        }
        if self.until.is_over() {
            let budget = options.budget_s.unwrap_or_default();
            out.warnings
                .push(format!("the search beyond the catalogue was not begun: the budget of {budget} s was used up"));
            return;
        }
        session.counter.so_far(&wording::so_far(out, session.model_error[0], self.left[0]));
        let members = self.members(&others, out);
        let rivals = self.rivals(&why, beside.as_ref(), &members, out);
        let taken: Vec<&str> = self.effects.iter().map(|e| e.id()).collect();
        let made = crate::laws::search(session, self.accepted, rivals, &taken, self.until, options);
        if let Some((open, against)) = made {
            out.against = against;
            self.conclude(&why, open, out);
        }
    }

    /// The flights with effects in the model.
    fn problem(&self, kept: &[Variant<'_>], found: &[Found]) -> Option<Problem> {
        let extra = extra_columns(self.session, Domain::Flight, self.accepted, kept, found);
        Problem::if_possible(self.session, Domain::Flight, &extra, self.options)
    }

    /// Notes in the answer where the strength of a named effect does not follow its law, and
    /// whether that holds for each effect of which it is one.
    fn compare_strength(&self, beside: Option<&Problem>, out: &mut Discovery) {
        let Some(problem) = beside else { return };
        let left = self.left[0];
        let rows = (out.held_out_error, out.held_out_error_after);
        let both = self.session.model_error[0].zip(left);
        let (before, after) = both.map_or(rows, |(b, a)| (b.held_out_error, a.held_out_error));
        let limits = FormLimits {
            person: self.options.belief_kinematics,
            noise: left.and_then(|s| s.noise_floor_ci95.map(|ci| ci[0] / s.held_out_error)).unwrap_or(0.0),
            removed: (before / after).powi(2) - 1.0,
        };
        let misfit = |problem: &Problem, kept: &[Variant<'_>], found: &[Found]| {
            crate::laws::misfit(self.session, problem, kept, found, &limits, self.options.seed)
        };
        out.misfit = misfit(problem, self.kept, &out.found);
        // on people errors that repeat change the strength of right effects, too
        let refuted = out.misfit.as_ref().filter(|_| self.session.prior.is_none());
        let Some(at) = refuted.and_then(|m| out.found.iter().position(|f| f.key == m.effect)) else { return };
        let has_one = |(v, f): &(Variant<'a>, Found)| {
            let (mut kept, mut found) = (self.kept.to_vec(), out.found.clone());
            kept[at] = v.clone();
            found[at] = f.clone();
            let of = |problem: Problem| misfit(&problem, std::slice::from_ref(v), std::slice::from_ref(f)).is_some();
            self.problem(&kept, &found).is_some_and(of)
        };
        let all = other_members(self.session, self.effects, &self.kept[at], out).iter().all(has_one);
        out.misfit.iter_mut().for_each(|m| m.of_all_named = all);
    }

    /// Why laws are sought. `others` are what the answer names in place of the one effect found.
    fn reasons(&self, beside: Option<&Problem>, others: &[(Variant<'a>, Found)], out: &Discovery) -> Reasons {
        let (session, kept) = (self.session, self.kept);
        let [flights, contact] = self.left.each_ref().map(Option::as_ref);
        let (named, person) = (is_named(out), session.prior.is_some());
        let several = kept.iter().any(|v| v.effect.id() != kept[0].effect.id());
        // an effect with the wrong law can fit flights and leave contact far above its floor
        let acting = kept.iter().any(|v| v.effect.acts().in_flight() && v.effect.acts().in_contact());
        let far_in_contact = acting && contact.is_some_and(HeldOutResult::is_far);
        let remains = flights.is_some_and(HeldOutResult::may_hold_more);
        let several_above = several && session.model_error[0].as_ref().is_some_and(HeldOutResult::may_hold_more);
        // an anchor at the end of the range, or beyond any wall, is a sign of another law
        let far_away = kept.iter().any(|v| is_far_away(session, v));
        let late = kept.iter().any(|v| may_be_late(session, v));
        // so is an anchor whose place the recordings do not show
        let unknown_place = kept.iter().zip(&out.found).any(|(v, f)| has_unknown_place(session, v, &f.nonlinear));
        // an effect that stands in for a law of another form can reach a wide interval of the
        // floor; where contact can tell the two apart, any error above the floor is a reason to ask
        let above_in_contact = acting && contact.is_some_and(HeldOutResult::is_above);
        let compared_there = acting && person && contact.is_some();
        let above = |s: &HeldOutResult| s.may_hide_more() || compared_there && s.times_floor() > 1.0;
        let may_hide = far_away || late || unknown_place || above_in_contact || flights.is_some_and(above);
        // soft tissue imitates laws; on a rigid body the flights tell an effect from a law
        let in_flight = !person && self.act_in_flight();
        let enough = beside.is_some_and(|p| p.folds.len() >= MANY_SIGNS);
        // of several that are named each has to be in doubt; on people that is not asked
        let alone = person || others.is_empty();
        let refuted_form = out.misfit.as_ref().is_some_and(|m| m.of_all_named || alone);
        Reasons {
            named,
            several,
            far_in_contact,
            remains,
            several_above,
            hides: far_in_contact || beside.is_some() && may_hide,
            // a floor that is known roughly can hide a law, too; on people it is often wide
            in_floor: person && !named && flights.is_some_and(HeldOutResult::may_hide_more),
            compared: in_flight && enough && flights.is_some_and(|s| s.times_floor() > 1.0),
            refuted_form,
            of_another_form: refuted_form || far_away || late,
        }
    }

    fn act_in_flight(&self) -> bool {
        self.kept.iter().any(|v| v.effect.acts().in_flight())
    }

    /// The ranking of the first round.
    fn ranking<'o>(&self, out: &'o Discovery) -> &'o [Candidate] {
        out.rounds.first().map_or(&out.candidates, |r| &r.candidates)
    }

    /// Effects of which one is missing: a law has to do better than each.
    fn members(&self, others: &[(Variant<'a>, Found)], out: &Discovery) -> Vec<Variant<'a>> {
        match self.kept {
            [one] if is_named(out) && out.groups.len() == 1 => {
                let rigid = self.session.prior.is_none();
                let as_good = || as_good_as(self.session, self.effects, one, self.ranking(out));
                let not_named = if rigid { as_good() } else { Vec::new() };
                std::iter::once(one).chain(others.iter().map(|(v, _)| v)).cloned().chain(not_named).collect()
            }
            _ => self.in_doubt.to_vec(),
        }
    }

    /// What a law has to do better than.
    fn rivals<'v>(
        &self,
        why: &Reasons,
        beside: Option<&Problem>,
        members: &'v [Variant<'a>],
        out: &Discovery,
    ) -> Rivals<'v, 'a> {
        let (session, kept) = (self.session, self.kept);
        // what contact contradicts is no rival, nor is what is physically impossible
        let possible = self.ranking(out).iter().filter(|c| c.plausible && !c.placebo && !self.refuted);
        let single = possible.map(|c| c.held_out_ratio).fold(1.0, f64::min);
        let errors = beside.map(|p| p.folds.iter().map(|f| f.error).collect::<Vec<f64>>());
        // on people errors that repeat change the strength of right effects, too
        let by_form = why.refuted_form && session.prior.is_none();
        Rivals {
            ratio: (out.held_out_error_after / out.held_out_error).min(single),
            single,
            several: why.several.then(|| kept.iter().map(Variant::unknowns).sum()),
            doubted: errors.clone().filter(|_| why.of_another_form).map(|errors| Doubted { errors, by_form }),
            within_floor: why.within_floor(),
            lines: kept.iter().filter_map(|v| Line::of(session.scene, v)).collect(),
            far_in_contact: why.far_in_contact,
            named: members,
            together: errors.filter(|_| kept.len() > 1).map(|errors| {
                let effects = kept.iter().map(|v| v.effect.id().to_owned()).collect();
                Together { effects, errors }
            }),
            one_effect: why.named && kept.len() == 1,
            only_compared: why.compared && !why.asked(out),
        }
    }

    /// Lets what the search found take the place of the catalogue's answer, or drops it.
    fn conclude(&self, why: &Reasons, mut open: OpenWorld, out: &mut Discovery) {
        let (session, options) = (self.session, self.options);
        let refuted_alone = self.is_refuted_alone(out);
        let staged = self.by_stages(&mut open, &mut out.warnings);
        // a force of constant size looks like the catalogue's own forces, gravity and frame rate
        let constant = open.laws.iter().all(|l| l.variables.is_empty() && l.direction != Direction::Towards);
        let less = |place: usize| {
            let laws = staged.and_then(|s| s[place]);
            laws.zip(self.left[place]).is_some_and(|(laws, e)| laws.held_out_error < LESS * e.held_out_error)
        };
        let in_doubt = out.against.as_ref().is_some_and(AgainstLaw::is_against_the_effect);
        let takes_its_place = out.against.as_ref().is_some_and(AgainstLaw::is_for_the_law)
            || open.complete && (less(0) || why.far_in_contact && less(1));
        // where the effect reaches the floor, too, a law that leaves a little less is not stated
        if why.within_floor() && in_doubt && !takes_its_place {
            self.without_laws(&mut open);
        }
        // a law that does better on all rows refutes the effect, even if it is not stated
        let refuted = in_doubt && open.laws.is_empty();
        let stands = why.within_floor() && !(in_doubt || takes_its_place);
        if (why.named || why.far_in_contact) && (constant && !refuted || stands) {
            // what the catalogue names stands, unless a law leaves less
            if !why.named || refuted_alone {
                self.without_laws(&mut open);
                out.open = Some(open);
            }
            return;
        }
        let limit = if session.prior.is_some() { options.belief_kinematics } else { options.belief };
        let described = open.diagnosis.as_ref();
        let acts =
            refuted || described.is_some_and(|d| d.held_out_ratio < limit && d.family_wise_p < options.significance);
        // within the interval of the floor a place and a direction are no evidence that something
        // acts: errors that repeat have them, too
        let only_within_floor = why.in_floor && !(why.several_above || why.hides);
        if !why.remains && !why.named && open.laws.is_empty() && (only_within_floor || !acts) {
            // an error at its floor is not described further
            return;
        }
        if !open.laws.is_empty() || acts {
            out.verdict = Verdict::Unexplained;
            out.effects.clear();
            out.groups.clear();
        }
        if !open.laws.is_empty() || refuted {
            // effects that removed a part of the error stood in for the law
            out.misfit = None;
            out.found.clear();
            out.ladder.clear();
            out.held_out_error_after = open.held_out_error_after;
        }
        out.open = Some(open);
    }

    /// True if what is named does not stand, whatever law there is.
    fn is_refuted_alone(&self, out: &Discovery) -> bool {
        let found = self.kept.iter().zip(&out.found);
        let rigid = self.session.prior.is_none() && self.act_in_flight();
        out.is_of_another_form()
            || found.into_iter().any(|(v, f)| delay_or_wind(self.session, v, &f.nonlinear).is_some())
            || out.leaves_too_much(self.session.model_error[0], self.left[0], rigid)
    }

    /// Errors with the laws in the model, by the stages. Drops laws that contact refuses, or that
    /// do no better than a force of constant size.
    fn by_stages(&self, open: &mut OpenWorld, warnings: &mut Vec<String>) -> Option<[Option<HeldOutResult>; 2]> {
        let model_error = &self.session.model_error;
        let staged = where_they_act(self.session, open).map(|s| s.errors);
        open.times_floor_in_contact = staged.and_then(|s| s[1]).map(|e| e.times_floor()).filter(|t| t.is_finite());
        if let Some([Some(s), _]) = &staged {
            open.judged_by_stages(s);
        }
        let of_law = open.laws.first().filter(|_| open.complete).map(|l| l.id.clone());
        let with = staged.and_then(|s| s[1]);
        let refused = of_law.and_then(|id| Refused::by_stages(&id, &id, model_error[1], with));
        if let (Some(no), Some(_)) = (refused, &model_error[0]) {
            warnings.push(no.words);
            self.without_laws(open);
            open.times_floor_in_contact = None;
        }
        // errors of the time base or of lengths look like a constant force in flight, and like many
        // things in contact
        if let (Some(before), Some([Some(flights), Some(contact)])) = (&model_error[0], staged)
            && contact.times_floor() > POOR_TIMES_FLOOR
            && open.does_no_better_than_constant(flights.held_out_error / before.held_out_error)
        {
            self.without_laws(open);
            open.times_floor_in_contact = None;
        }
        staged
    }

    fn without_laws(&self, open: &mut OpenWorld) {
        if let Some(model_error) = &self.session.model_error[0] {
            open.without_laws(model_error);
        }
    }
}

fn is_named(out: &Discovery) -> bool {
    matches!(out.verdict, Verdict::Supported | Verdict::OneOf)
}

impl Discovery {
    /// True if an effect that is missing, or each of those of which it is one, has another form
    /// than its law says: something acts like it, and what is not known. Where it stands beside
    /// others, these may stand in for the same law. On people errors that repeat change the
    /// strength of right effects.
    pub(crate) fn is_of_another_form(&self) -> bool {
        is_named(self) && self.misfit.as_ref().is_some_and(|m| m.of_all_named)
    }

    /// True if named effects on a rigid body leave more in many flights than the right ones would:
    /// no soft tissue is in the floor. Of a strong effect a little is left by its own
    /// simplification. `before` and `left` are the errors without and with them.
    pub(crate) fn leaves_too_much(
        &self,
        before: Option<HeldOutResult>,
        left: Option<HeldOutResult>,
        rigid: bool,
    ) -> bool {
        let flights = |r: &Round| r.judged_on == wording::domain(Domain::Flight) && r.clusters >= MANY_CLUSTERS;
        let more = before.zip(left).is_some_and(|(before, left)| left.is_not_reached_from(before.held_out_error));
        rigid && is_named(self) && self.rounds.iter().any(flights) && more
    }
}

/// Effects of the ranking that leave no more error than the one found: a law has to do better than
/// these, too, whatever the reason why they are not named.
fn as_good_as<'a>(
    session: &Session<'_>,
    effects: &[&'a dyn Effect],
    found: &Variant<'a>,
    ranking: &[Candidate],
) -> Vec<Variant<'a>> {
    let id = found.effect.id();
    let of_found = ranking.iter().find(|c| c.effect == id).map_or(0.0, |c| c.held_out_ratio);
    let as_good =
        ranking.iter().filter(|c| c.effect != id && c.plausible && !c.placebo && c.held_out_ratio <= of_found);
    // what is compared with contact has to act there
    let acts = |v: &Variant<'_>| {
        let (there, here) = (v.effect.acts(), found.effect.acts());
        there.in_flight() && (there.in_contact() || !here.in_contact())
    };
    as_good.filter_map(|c| Variant::of_candidate(session, effects, c)).filter(acts).collect()
}

/// The effects that the answer names in place of the one found, with the values of their own fits.
fn other_members<'a>(
    session: &Session<'_>,
    effects: &[&'a dyn Effect],
    found: &Variant<'a>,
    out: &Discovery,
) -> Vec<(Variant<'a>, Found)> {
    let id = found.effect.id();
    let rounds = out.rounds.iter().filter(|r| !r.superseded && r.joined.iter().any(|j| j == id));
    let named = rounds.flat_map(|r| r.candidates.iter().filter(|c| r.effects.contains(&c.effect) && c.effect != id));
    named.filter_map(|c| Some((Variant::of_candidate(session, effects, c)?, Found::of(c)))).collect()
}

/// Errors with the laws of a search in the model, by the stages. Laws are fitted to flights; if
/// they also lower the error in contact, of which the search has no row, they become laws of both,
/// with sizes from both where these predict as well.
fn where_they_act(session: &Session<'_>, open: &mut OpenWorld) -> Option<Staged> {
    let in_flight = session.by_stages.with_laws(&open.laws)?;
    let everywhere: Vec<FoundLaw> = open.laws.iter().map(FoundLaw::acting_everywhere).collect();
    let sized: Vec<FoundLaw> =
        everywhere.iter().map(|law| FoundLaw { sized_with_contact: true, ..law.clone() }).collect();
    let Some(contact) = in_flight.errors[1] else { return Some(in_flight) };
    let limit = IN_CONTACT * contact.held_out_error.min(session.model_error[1].map_or(0.0, |e| e.held_out_error));
    let Some(from_flights) = session.by_stages.with_laws(&everywhere) else { return Some(in_flight) };
    let from_both = session.by_stages.with_laws(&sized).filter(|s| predicts_as_well(from_flights.errors, s.errors));
    let (laws, both) = from_both.map_or((everywhere, from_flights), |both| (sized, both));
    if both.errors[1].is_none_or(|e| e.held_out_error >= limit) {
        return Some(in_flight);
    }
    open.laws = laws;
    Some(both)
}
