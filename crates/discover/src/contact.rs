//! What contact says of effects that were found in flight.
//!
//! The effects that a round in flight names are fitted to flights alone. A force that is always
//! there shows in contact as well, where the plates measure what weight and motion leave, with less
//! noise than a flight has and in other postures and at other places. Among effects that flights
//! cannot tell apart, one that leaves much more error in contact than another one is ruled out,
//! although it is fitted to flights and contact together there. Effects with which contact has more
//! error than without them are contradicted: they do not act as they are said to act.
//!
//! The same is asked once more of the model that all stages compute. Errors that repeat from flight
//! to flight (soft tissue, wrong tables) can be imitated by a force, and the parameters then absorb
//! the opposite of it; with the right effect the parameters become better, and the error in contact
//! falls or stays. There the parameters are those that the user will get.

use crate::ladder::{Refit, extra_columns};
use crate::problem::{Domain, Problem};
use crate::rank::score_effect;
use crate::rivals::Rival;
use crate::session::Session;
use crate::statistics::sign_flip_p;
use aloft_effects::Target;
use rayon::prelude::*;

/// Ratio of mean square errors, in contact times in flight, over the effect that is best in
/// contact, above which an effect is ruled out. What flights prefer has to be worse in contact.
const WORSE: f64 = 1.25;
/// The ratio in contact alone that is needed as well.
const WORSE_IN_CONTACT: f64 = 1.1;
/// Mean square error in contact with effects over that without them, above which contact
/// contradicts them.
const CONTRADICTED: f64 = 1.1;

impl Refit<'_, '_> {
    /// Rows of flights and contact, judged in contact, with or without the effects found; none if
    /// contact cannot be judged.
    pub(crate) fn in_contact(&self, session: &Session<'_>, with_found: bool) -> Option<Problem> {
        let (kept, found) = if with_found { (self.kept, self.found) } else { Default::default() };
        let extra = extra_columns(session, Domain::Contact, self.accepted, kept, found);
        let options = self.options;
        Problem::if_possible(session, Domain::Contact, &extra, options)
    }

    /// Compares in contact the effects that a round in flight cannot tell apart, and those that fit
    /// flights only at the far edge of their range (`limits`).
    pub(crate) fn by_plates(
        &self,
        session: &Session<'_>,
        rivals: &[Rival<'_>],
        effects: &[String],
        limits: &[String],
    ) -> Option<ByPlates> {
        let options = self.options;
        let is_named = |r: &Rival<'_>| effects.iter().any(|id| id == r.id());
        let compared: Vec<&Rival<'_>> =
            rivals.iter().filter(|r| is_named(r) || limits.iter().any(|id| id == r.id())).collect();
        if compared.len() < 2 {
            return None;
        }
        let problem = self.in_contact(session, true)?;
        let left: Vec<(&Rival<'_>, Vec<f64>)> = compared
            .into_par_iter()
            .filter_map(|r| {
                let variant = &r.scored.variant;
                let same = self.kept.iter().filter(|v| v.effect.id() == r.id());
                let taken: Vec<Target> = same.map(|v| v.target).collect();
                let acting = Some(&variant.group[..]).filter(|g| !g.is_empty());
                let score = score_effect(session, &problem, variant.effect, &taken, acting, false, true)?;
                Some((r, score.fold_error))
            })
            .collect();
        let sum = |errors: &[f64]| errors.iter().sum::<f64>();
        let less = |a: &[f64], b: &[f64]| sign_flip_p(a, b, 2000, options.seed ^ 0xc047) < options.significance;
        let least_of = |of: &dyn Fn(&Rival<'_>) -> bool| {
            left.iter().filter(|(r, _)| of(r)).min_by(|a, b| sum(&a.1).total_cmp(&sum(&b.1)))
        };
        // one that fits flights at the edge of its range is named where contact prefers it
        let simplest = least_of(&is_named)?;
        let inside: Vec<String> = left
            .iter()
            .filter(|(r, e)| !is_named(r) && sum(e) < sum(&simplest.1) && less(e, &simplest.1))
            .map(|(r, _)| r.id().to_owned())
            .collect();
        let stands = |r: &Rival<'_>| is_named(r) || inside.iter().any(|id| id == r.id());
        let (best, least) = least_of(&stands)?;
        let plain: f64 = problem.folds.iter().map(|f| f.error).sum();
        if sum(least) >= plain {
            return None;
        }
        let worse = |r: &Rival<'_>, errors: &[f64]| {
            let ratio = sum(errors) / sum(least);
            ratio > WORSE_IN_CONTACT && ratio * r.error() / best.error() > WORSE && less(least, errors)
        };
        let (out, stay): (Vec<_>, Vec<_>) =
            left.iter().filter(|(r, _)| stands(r)).partition(|(r, errors)| worse(r, errors));
        // one that narrowly missed acceptance cannot rule the others out
        if (out.is_empty() && inside.is_empty()) || !stay.iter().any(|(r, _)| r.believed) {
            return None;
        }
        let share = |errors: &[f64]| 100.0 * (sum(errors) / plain).sqrt();
        let each: Vec<String> = out.iter().map(|(r, e)| format!("`{}` ({:.0} %)", r.id(), share(e))).collect();
        let words = if out.is_empty() {
            String::new()
        } else {
            format!(
                "the force plates speak against {}: `{}` leaves {:.0} % of the error in contact",
                each.join(" and "),
                best.id(),
                share(least)
            )
        };
        Some(ByPlates { ruled_out: out.iter().map(|(r, _)| r.id().to_owned()).collect(), inside, words })
    }

    /// In words, if contact has clearly more error with the effects found than without them.
    pub(crate) fn contradicted(&self, session: &Session<'_>) -> Option<String> {
        if !self.kept.iter().any(|v| v.effect.acts().in_contact()) {
            return None;
        }
        let errors = |with_found| -> Option<Vec<f64>> {
            Some(self.in_contact(session, with_found)?.folds.iter().map(|f| f.error).collect())
        };
        let (without, with) = (errors(false)?, errors(true)?);
        let ratio = with.iter().sum::<f64>() / without.iter().sum::<f64>();
        let p = sign_flip_p(&without, &with, 2000, self.seed() ^ 0xc048);
        (ratio > CONTRADICTED && p < self.options.significance).then(|| {
            format!(
                "the force plates contradict it: the held-out error in contact would rise to {:.0} % of what it is",
                100.0 * ratio.sqrt()
            )
        })
    }
}

/// What contact says of effects that flights cannot tell apart.
pub(crate) struct ByPlates {
    /// Effects that contact rules out.
    pub ruled_out: Vec<String>,
    /// Effects that fit flights at the far edge of their range only, and contact inside of it.
    pub inside: Vec<String>,
    /// What is ruled out, in words.
    pub words: String,
}
