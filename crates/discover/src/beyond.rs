//! The search beyond the catalogue as part of a discovery: when it is made, and when its laws
//! replace what the catalogue names.

use crate::by_stages::Staged;
use crate::candidate::Variant;
use crate::held_out::HeldOutResult;
use crate::ladder::extra_columns;
use crate::laws::{Direction, Doubted, FormLimits, FoundLaw, Line, OpenWorld, Together};
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

/// Searches for laws beyond the catalogue where flights leave an error above the interval of its
/// floor, where the catalogue needs effects of several kinds, or where the strength of a named
/// effect does not follow its law, and lets laws that convince replace what the catalogue names.
/// `in_doubt` are effects that are not named because their size may be zero: a law has to do
/// better.
pub(crate) fn look_beyond(
    session: &Session<'_>,
    accepted: &[EffectInstance<'_>],
    effects: &[&dyn Effect],
    kept: &[Variant<'_>],
    in_doubt: &[Variant<'_>],
    refuted: bool,
    left: &[Option<HeldOutResult>; 2],
    out: &mut Discovery,
    until: &Until,
    options: &DiscoverOptions,
) {
    let several = kept.iter().any(|v| v.effect.id() != kept[0].effect.id());
    let named = matches!(out.verdict, Verdict::Supported | Verdict::OneOf);
    // an effect with the wrong law can fit flights and leave contact far above its floor
    let acting = kept.iter().any(|v| v.effect.acts().in_flight() && v.effect.acts().in_contact());
    let far_in_contact = acting && left[1].as_ref().is_some_and(HeldOutResult::is_far);
    let problem_with = |kept: &[Variant<'_>], found: &[Found]| {
        let extra = extra_columns(session, Domain::Flight, accepted, kept, found);
        Problem::new(session, Domain::Flight, &extra, options.fewest_trials, options.prior_weight).ok()
    };
    let with_effects =
        (named && !kept.is_empty() && !until.is_over()).then(|| problem_with(kept, &out.found)).flatten();
    let limits = FormLimits {
        person: options.belief_kinematics,
        noise: left[0].and_then(|s| s.noise_floor_ci95.map(|ci| ci[0] / s.held_out_error)).unwrap_or(0.0),
        removed: {
            let rows = (out.held_out_error, out.held_out_error_after);
            let both = session.model_error[0].zip(left[0]);
            let (before, after) = both.map_or(rows, |(b, a)| (b.held_out_error, a.held_out_error));
            (before / after).powi(2) - 1.0
        },
    };
    let misfit = |problem: &Problem, kept: &[Variant<'_>], found: &[Found]| {
        crate::laws::misfit(session, problem, kept, found, &limits, options.seed)
    };
    out.misfit = with_effects.as_ref().and_then(|problem| misfit(problem, kept, &out.found));
    // one effect of which the answer names several is compared as each of them
    let others = match (kept, &out.groups[..]) {
        ([one], [_]) if named => other_members(session, effects, one, out),
        _ => Vec::new(),
    };
    // on people errors that repeat change the strength of right effects, too
    let refuted_at = out.misfit.as_ref().and_then(|m| out.found.iter().position(|f| f.key == m.effect));
    if let Some(at) = refuted_at.filter(|_| session.prior.is_none()) {
        let has_one = |(v, f): &(Variant<'_>, Found)| {
            let (mut kept, mut found) = (kept.to_vec(), out.found.clone());
            kept[at] = v.clone();
            found[at] = f.clone();
            let of = |problem: Problem| misfit(&problem, std::slice::from_ref(v), std::slice::from_ref(f)).is_some();
            problem_with(&kept, &found).is_some_and(of)
        };
        let all = other_members(session, effects, &kept[at], out).iter().all(has_one);
        out.misfit.iter_mut().for_each(|m| m.of_all_named = all);
    }
    // an anchor at the end of the range, or beyond any wall, is a sign of another law
    let far_away = kept.iter().any(|v| is_far_away(session, v));
    let late = kept.iter().any(|v| may_be_late(session, v));
    let remains = left[0].as_ref().is_some_and(HeldOutResult::may_hold_more);
    let several_above = several && session.model_error[0].as_ref().is_some_and(HeldOutResult::may_hold_more);
    // an effect that stands in for a law of another form can reach a wide interval of the floor;
    // where contact can tell the two apart, any error above the floor is a reason to ask
    let above_in_contact = acting && left[1].as_ref().is_some_and(HeldOutResult::is_above);
    let compared_there = acting && session.prior.is_some() && left[1].is_some();
    let above = |s: &HeldOutResult| s.may_hide_more() || compared_there && s.times_floor() > 1.0;
    // so is an anchor whose place the recordings do not show
    let unknown_place = kept.iter().zip(&out.found).any(|(v, f)| has_unknown_place(session, v, &f.nonlinear));
    let may_hide = far_away || late || unknown_place || above_in_contact || left[0].as_ref().is_some_and(above);
    let hides = far_in_contact || with_effects.is_some() && may_hide;
    // soft tissue imitates laws; on a rigid body the flights tell an effect from a law
    let in_flight = session.prior.is_none() && kept.iter().any(|v| v.effect.acts().in_flight());
    let enough = with_effects.as_ref().is_some_and(|p| p.folds.len() >= MANY_SIGNS);
    let compared = in_flight && enough && left[0].is_some_and(|s| s.times_floor() > 1.0);
    // a floor that is known roughly can hide a law, too; on people it is often wide
    let may_hide_in_floor =
        session.prior.is_some() && !named && left[0].as_ref().is_some_and(HeldOutResult::may_hide_more);
    let asked = remains || several_above || hides || may_hide_in_floor || out.misfit.is_some();
    if !(asked || compared) {
        return;
    }
    if until.is_over() {
        let budget = options.budget_s.unwrap_or_default();
        out.warnings
            .push(format!("the search beyond the catalogue was not begun: the budget of {budget} s was used up"));
        return;
    }
    session.counter.so_far(&wording::so_far(out, session.model_error[0], left[0]));
    let first = out.rounds.first().map_or(&out.candidates, |r| &r.candidates);
    // what contact contradicts is no rival, nor is what is physically impossible
    let possible = first.iter().filter(|c| c.plausible && !c.placebo && !refuted);
    let single = possible.map(|c| c.held_out_ratio).fold(1.0, f64::min);
    let ratio = (out.held_out_error_after / out.held_out_error).min(single);
    let taken: Vec<&str> = effects.iter().map(|e| e.id()).collect();
    let unknowns: usize = kept.iter().map(Variant::unknowns).sum();
    // of several that are named each has to be in doubt; on people that is not asked
    let alone = session.prior.is_some() || others.is_empty();
    let refuted_form = out.misfit.as_ref().is_some_and(|m| m.of_all_named || alone);
    let of_another_form = refuted_form || far_away || late;
    // on people errors that repeat change the strength of right effects, too
    let by_form = refuted_form && session.prior.is_none();
    let errors = with_effects.as_ref().map(|p| p.folds.iter().map(|f| f.error).collect::<Vec<f64>>());
    let together = errors.clone().filter(|_| kept.len() > 1).map(|errors| {
        let effects = kept.iter().map(|v| v.effect.id().to_owned()).collect();
        Together { effects, errors }
    });
    let doubt = |errors| Doubted { errors, by_form };
    let doubted = errors.filter(|_| of_another_form).map(doubt);
    let within_floor = (hides || compared) && !of_another_form && !remains && !several_above;
    let members = match kept {
        [one] if named && out.groups.len() == 1 => {
            let not_named = if session.prior.is_none() { as_good_as(session, effects, one, first) } else { Vec::new() };
            std::iter::once(one).chain(others.iter().map(|(v, _)| v)).cloned().chain(not_named).collect()
        }
        _ => in_doubt.to_vec(),
    };
    let rival = crate::laws::Rivals {
        ratio,
        single,
        several: several.then_some(unknowns),
        doubted,
        within_floor,
        lines: kept.iter().filter_map(|v| Line::of(session.scene, v)).collect(),
        far_in_contact,
        named: &members,
        together,
        one_effect: named && kept.len() == 1,
        only_compared: compared && !asked,
    };
    let Some((made, against)) = crate::laws::search(session, accepted, rival, &taken, until, options) else { return };
    out.against = against;
    let points_down = kept.iter().zip(&out.found).any(|(v, f)| delay_or_wind(session, v, &f.nonlinear).is_some());
    let too_much = out.leaves_too_much(session.model_error[0], left[0], in_flight);
    let refuted_alone = out.is_of_another_form() || points_down || too_much;
    let open = out.open.insert(made);
    let staged = where_they_act(session, open).map(|s| s.errors);
    open.times_floor_in_contact = staged.and_then(|s| s[1]).map(|e| e.times_floor()).filter(|t| t.is_finite());
    if let Some([Some(s), _]) = &staged {
        open.judged_by_stages(s);
    }
    // a law that contact refuses is not stated
    let of_law = open.laws.first().filter(|_| open.complete).map(|l| l.id.clone());
    let with = staged.and_then(|s| s[1]);
    let refused = of_law.and_then(|id| Refused::by_stages(&id, &id, session.model_error[1], with));
    if let (Some(no), Some(model_error)) = (refused, &session.model_error[0]) {
        out.warnings.push(no.words);
        open.without_laws(model_error);
        open.times_floor_in_contact = None;
    }
    // errors of the time base or of lengths look like a constant force in flight, and like many
    // things in contact
    if let (Some(model_error), Some([Some(flights), Some(contact)])) = (&session.model_error[0], staged)
        && contact.times_floor() > POOR_TIMES_FLOOR
        && open.does_no_better_than_constant(flights.held_out_error / model_error.held_out_error)
    {
        open.without_laws(model_error);
        open.times_floor_in_contact = None;
    }
    // a force of constant size is what the catalogue's own forces, gravity and frame rate look like
    let constant = open.laws.iter().all(|l| l.variables.is_empty() && l.direction != Direction::Towards);
    let less = |place: usize| {
        let laws = staged.and_then(|s| s[place]);
        laws.zip(left[place]).is_some_and(|(laws, e)| laws.held_out_error < LESS * e.held_out_error)
    };
    let in_doubt = out.against.as_ref().is_some_and(AgainstLaw::is_against_the_effect);
    let takes_its_place = out.against.as_ref().is_some_and(AgainstLaw::is_for_the_law)
        || open.complete && (less(0) || far_in_contact && less(1));
    // where the effect reaches the floor, too, a law that leaves a little less is not stated either
    if let Some(model_error) = session.model_error[0].as_ref().filter(|_| within_floor && in_doubt && !takes_its_place)
    {
        open.without_laws(model_error);
    }
    // a law that does better on all rows refutes the effect, even if too much remains to state it
    let refuted = in_doubt && open.laws.is_empty();
    let stands = within_floor && !(in_doubt || takes_its_place);
    if (named || far_in_contact) && (constant && !refuted || stands) {
        if named && !refuted_alone {
            // what the catalogue names stands, unless a law leaves less
            out.open = None;
        } else if let Some(model_error) = &session.model_error[0] {
            open.without_laws(model_error);
        }
        return;
    }
    let limit = if session.prior.is_some() { options.belief_kinematics } else { options.belief };
    let acts = refuted
        || open.diagnosis.as_ref().is_some_and(|d| d.held_out_ratio < limit && d.family_wise_p < options.significance);
    // within the interval of the floor a place and a direction are no evidence that something acts:
    // errors that repeat have them, too
    let only_within_floor = may_hide_in_floor && !(several_above || hides);
    if !remains && !named && open.laws.is_empty() && (only_within_floor || !acts) {
        // an error at its floor is not described further
        out.open = None;
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
}

impl Discovery {
    /// True if an effect that is missing, or each of those of which it is one, has another form
    /// than its law says: something acts like it, and what is not known. Where it stands beside
    /// others, these may stand in for the same law. On people errors that repeat change the
    /// strength of right effects.
    pub(crate) fn is_of_another_form(&self) -> bool {
        let named = matches!(self.verdict, Verdict::Supported | Verdict::OneOf);
        named && self.misfit.as_ref().is_some_and(|m| m.of_all_named)
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
        let named = matches!(self.verdict, Verdict::Supported | Verdict::OneOf);
        let flights = |r: &Round| r.judged_on == wording::domain(Domain::Flight) && r.clusters >= MANY_CLUSTERS;
        let more = before.zip(left).is_some_and(|(before, left)| left.is_not_reached_from(before.held_out_error));
        rigid && named && self.rounds.iter().any(flights) && more
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
