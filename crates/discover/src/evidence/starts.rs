//! Where the fits of an effect begin: on each target the best of its starting values.

use super::model::Model;
use crate::candidate::{Variant, solve};
use crate::groups::group;
use crate::problem::Problem;
use aloft_effects::{Effect, Target};
use rayon::prelude::*;

/// Share of the squared error that an effect has to remove before `Target::Shape` is tried: the
/// shape of links only modifies an effect that already explains most of the error.
const SHAPED: f64 = 0.5;

/// Starting values that are tried on every target: those that gained most on the first one.
const FEW: usize = 4;

/// The best start of every target, with its gain. What acts in the air is sought on flights, which
/// have fewer rows, and its gain is that on all rows.
pub(super) fn starts<'a>(model: &Model<'_>, effect: &'a dyn Effect) -> Vec<(Variant<'a>, f64)> {
    let Model { session, problem, .. } = model;
    let targets = effect.targets(session.scene);
    let by_group = effect.about().by_group;
    let loaded = if by_group { group(session, problem, effect, &targets) } else { None };
    if by_group && loaded.is_none() {
        return Vec::new();
    }
    let screened = model.flights.as_ref().filter(|_| effect.acts().in_flight()).unwrap_or(problem);
    let gain = |variant: &Variant<'a>, problem: &Problem| {
        let (s, c) = problem.reduce_all(&variant.columns(session, problem)?);
        Some(solve(&s, &c, &variant.coefficients).1)
    };
    let mut out: Vec<(Variant<'a>, f64)> = Vec::new();
    let mut chosen: Option<Vec<usize>> = None;
    for target in targets {
        let gained = out.iter().map(|v| v.1).fold(0.0, f64::max);
        if target == Target::Shape && gained < SHAPED * problem.rss {
            continue;
        }
        let starts = effect.starts(session.scene, target);
        let tried: Vec<usize> = match &chosen {
            Some(chosen) => chosen.iter().copied().filter(|&i| i < starts.len()).collect(),
            None => (0..starts.len()).collect(),
        };
        let at = |i: usize| {
            let mut variant = Variant::new(session, effect, target, starts[i].clone());
            if let Some(loaded) = &loaded {
                variant.group.clone_from(loaded);
            }
            let gain = gain(&variant, screened)?;
            Some((i, variant, gain))
        };
        let mut made: Vec<(usize, Variant<'a>, f64)> = tried.into_par_iter().filter_map(at).collect();
        made.sort_by(|a, b| b.2.total_cmp(&a.2));
        if chosen.is_none() && starts.len() > FEW {
            chosen = Some(made.iter().take(FEW).map(|m| m.0).collect());
        }
        let best = made.into_iter().next().map(|(_, variant, gain)| (variant, gain));
        out.extend(best.and_then(|(variant, of_screen)| {
            let all = if std::ptr::eq(screened, problem) { of_screen } else { gain(&variant, problem)? };
            Some((variant, all))
        }));
    }
    out
}
