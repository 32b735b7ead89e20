//! Pairs of effects, for cases in which a single effect is a compromise between two others.
//!
//! Steady wind with drag, for instance, can be mistaken for drag in still air together with a tilt.
//! When the best single effect has been chosen, all pairs of other effects are screened by the gain
//! of their joint fit; the best are judged by held-out error, and a pair replaces the single effect
//! if it is better by as much as a second effect would have to be.

use crate::candidate::{Scored, Variant, score, solve};
use crate::judge::is_trivial;
use crate::ladder::Refit;
use crate::limits::{SAME, SMALLEST};
use crate::nonlinear::fitted;
use crate::problem::Problem;
use crate::rank::EffectScore;
use crate::session::Session;
use crate::statistics::sign_flip_p;
use nalgebra::DMatrix;
use rayon::prelude::*;

/// Number of variants of an effect that take part, and of pairs that are judged.
const VARIANTS: usize = 3;
const JUDGED: usize = 8;

/// What a search of pairs is given: the ranking, the effect that a pair is compared with, and the
/// effects that may take part.
pub(crate) struct Search<'s, 'e> {
    pub session: &'s Session<'s>,
    pub problem: &'s Problem,
    pub scores: &'s [EffectScore<'e>],
    /// Index of the effect chosen.
    pub best: usize,
    pub usable: &'s [bool],
    pub refit: &'s Refit<'s, 's>,
}

/// Two effects fitted together: the coefficients of each, their squared error on left-out rows, and
/// the effects of all pairs that leave nearly the same error.
pub(crate) type Pair<'e> = (Scored<'e>, Scored<'e>, f64, Vec<String>);

/// The pair that beats the effect chosen, if it leaves less than `ratio` of its error.
pub(crate) fn better_pair<'e>(search: &Search<'_, 'e>, ratio: f64) -> Option<Pair<'e>> {
    let pair = best_pair(search)?;
    let single = &search.scores[search.best].fold_error;
    let small = (pair.2 / single.iter().sum::<f64>()).sqrt() < ratio;
    (small && sign_flip_p(&pair.0.fold_error, single, 2000, search.refit.seed()) < 0.01).then_some(pair)
}

/// A pair that explains as much as the effect chosen, with no more unknowns: drag in still air and
/// a tilt, where wind was chosen. Asked only of effects that contain another one. No pair takes the
/// place of an effect that beside one half of it explains more than both halves.
pub(crate) fn pair_as_good<'e>(search: &Search<'_, 'e>) -> Option<Pair<'e>> {
    let chosen = &search.scores[search.best];
    if chosen.effect.about().contains.is_empty() {
        return None;
    }
    let pair = best_pair(search)?;
    let (single, refit) = (&chosen.fold_error, search.refit);
    let ratio = (single.iter().sum::<f64>() / pair.2).sqrt();
    let same = ratio > SAME[usize::from(search.session.prior.is_some())];
    let both_act = |half: &Scored<'e>| {
        let beside = refit.with(search.session, search.problem.domain, &half.variant)?;
        let error = fitted(search.session, &beside, &chosen.scored[chosen.best].variant)?.fold_error;
        let less = (error.iter().sum::<f64>() / pair.2).sqrt() < refit.options.belief;
        Some(less && sign_flip_p(&error, &pair.0.fold_error, 2000, refit.seed()) < 0.01)
    };
    if [&pair.0, &pair.1].into_iter().any(|half| both_act(half) == Some(true)) {
        return None;
    }
    (same || sign_flip_p(single, &pair.0.fold_error, 2000, refit.seed()) >= refit.options.significance).then_some(pair)
}

/// The pair of effects other than the one chosen that leaves the least error, of those with no more
/// unknowns together.
fn best_pair<'e>(search: &Search<'_, 'e>) -> Option<Pair<'e>> {
    let &Search { session, problem, scores, best, usable, refit } = search;
    let parts: Vec<(usize, Variant<'e>, Vec<DMatrix<f64>>)> = (0..scores.len())
        .into_par_iter()
        .filter(|&i| i != best && usable[i] && !scores[i].effect.about().by_group)
        .flat_map_iter(|i| {
            let mut order: Vec<&Scored<'e>> = scores[i].scored.iter().filter(|s| s.gain > 0.0).collect();
            order.sort_by(|a, b| b.gain.total_cmp(&a.gain));
            order.into_iter().take(VARIANTS).map(|s| s.variant.clone()).collect::<Vec<_>>().into_iter().filter_map(
                move |v| {
                    let columns = v.columns(session, problem)?;
                    Some((i, v, columns))
                },
            )
        })
        .collect();
    // a pair may not have more unknowns than the single effect
    let most = scores[best].scored[scores[best].best].variant.unknowns();
    let joint = |a: usize, b: usize| -> (Variant<'e>, Vec<DMatrix<f64>>) {
        let (ka, kb) = (parts[a].1.coefficients.len(), parts[b].1.coefficients.len());
        let columns = parts[a]
            .2
            .iter()
            .zip(&parts[b].2)
            .map(|(x, y)| {
                let mut wide = DMatrix::zeros(x.nrows(), ka + kb);
                wide.columns_mut(0, ka).copy_from(x);
                wide.columns_mut(ka, kb).copy_from(y);
                wide
            })
            .collect();
        let coefficients = parts[a].1.coefficients.iter().chain(&parts[b].1.coefficients).cloned().collect();
        (Variant { coefficients, ..parts[a].1.clone() }, columns)
    };
    let pairs: Vec<(usize, usize)> = (0..parts.len())
        .flat_map(|a| (a + 1..parts.len()).map(move |b| (a, b)))
        .filter(|&(a, b)| {
            let (x, y) = (scores[parts[a].0].effect, scores[parts[b].0].effect);
            let unknowns = parts[a].1.unknowns() + parts[b].1.unknowns();
            x.id() != y.id()
                && unknowns <= most
                // a gain of all plates with a wrong mass scales both sides of every row to zero
                && !x.about().aliases.contains(&y.id())
                && !x.about().contains.contains(&y.id())
                && !y.about().contains.contains(&x.id())
        })
        .collect();
    let mut gains: Vec<(f64, usize, usize)> = pairs
        .into_par_iter()
        .map(|(a, b)| {
            let (variant, columns) = joint(a, b);
            let (s, c) = problem.reduce_all(&columns);
            (solve(&s, &c, &variant.coefficients).1, a, b)
        })
        .collect();
    gains.sort_by(|x, y| y.0.total_cmp(&x.0).then((x.1, x.2).cmp(&(y.1, y.2))));
    let judged: Vec<(Scored<'e>, usize, usize, f64)> = gains
        .into_iter()
        .take(JUDGED)
        .map(|(_, a, b)| {
            let (variant, columns) = joint(a, b);
            let scored = score(problem, variant, &problem.reduce(&columns));
            let error = scored.fold_error.iter().sum::<f64>();
            (scored, a, b, error)
        })
        .collect();
    // on a rigid body a second effect that gains less than the smallest one accepted makes no pair
    let alone = |i: usize| scores[parts[i].0].fold_error.iter().sum::<f64>();
    let both_gain = |j: &(Scored<'e>, usize, usize, f64)| {
        session.prior.is_some() || (j.3 / alone(j.1).min(alone(j.2))).sqrt() < SMALLEST
    };
    let judged: Vec<(Scored<'e>, usize, usize, f64)> = judged.into_iter().filter(both_gain).collect();
    let own = |error: f64| !is_trivial(session, problem, error / problem.n_judged as f64);
    let least = judged.iter().filter(|j| own(j.3)).map(|j| j.3).fold(f64::INFINITY, f64::min);
    let same = SAME[usize::from(session.prior.is_some())];
    let mut near: Vec<_> = judged.into_iter().filter(|j| own(j.3) && (least / j.3).sqrt() > same).collect();
    near.sort_by(|x, y| x.3.total_cmp(&y.3));
    let mut ids: Vec<String> = Vec::new();
    let single = scores[best].effect.id();
    for part in near.iter().flat_map(|j| [j.1, j.2]) {
        let id = scores[parts[part].0].effect.id();
        let wider = scores[parts[part].0].effect.about().contains.contains(&single);
        if !wider && !ids.iter().any(|i| i == id) {
            ids.push(id.to_owned());
        }
    }
    let (scored, a, b, mut error) = near.into_iter().next()?;
    // the effect with more nonlinear parameters was fitted alone; fit it again together with the
    // other
    let nonlinear = |i: usize| parts[i].1.nonlinear.len();
    let (plain, bent) = if nonlinear(a) <= nonlinear(b) { (a, b) } else { (b, a) };
    let mut fold_error = scored.fold_error.clone();
    let mut refined = parts[bent].1.clone();
    if nonlinear(bent) > 0
        && let Some(beside) = refit.with(session, problem.domain, &parts[plain].1)
        && let Some(own) = fitted(session, &beside, &parts[bent].1)
    {
        let own_error = own.fold_error.iter().sum::<f64>();
        if own_error < error {
            (error, fold_error, refined) = (own_error, own.fold_error, own.variant);
        }
    }
    let ka = parts[a].1.coefficients.len();
    let kb = parts[b].1.coefficients.len();
    let part = |variant: &Variant<'e>, first: usize, k: usize| Scored {
        joint_se: Vec::new(),
        freedom: scored.freedom.get(first..first + k).unwrap_or_default().to_vec(),
        widening: Vec::new(),
        variant: variant.clone(),
        theta: scored.theta.rows(first, k).into_owned(),
        gain: scored.gain,
        fold_theta: scored.fold_theta.iter().map(|t| t.rows(first, k).into_owned()).collect(),
        fold_nonlinear: vec![variant.nonlinear.clone(); scored.fold_theta.len()],
        fold_gain: scored.fold_gain.clone(),
        fold_error: fold_error.clone(),
        s: scored.s.view((first, first), (k, k)).into_owned(),
    };
    let of = |i: usize| if i == bent { &refined } else { &parts[i].1 };
    Some((part(of(a), 0, ka), part(of(b), ka, kb), error, ids))
}

/// Largest share of the error of the model and of the best single effect that a pair may leave when
/// no single effect was accepted: chance has many pairs to choose from.
pub(crate) const ALONE: [f64; 2] = [0.6, 0.8];
/// The same of two loads where the plates show in which trials something was carried: fewer pairs,
/// and nothing of the trials is chosen.
pub(crate) const CARRIED: [f64; 2] = [0.75, 0.85];
/// Rounds in which the two effects of a pair are fitted again in turn.
const TURNS: usize = 2;

/// Two effects together where none alone is accepted: two of a kind on different links (a load on
/// both shanks), or two kinds. Each is fitted beside the other in turn; `None` if no pair explains
/// most of the error (`most`: [`ALONE`] or [`CARRIED`]). The last part are the effects of all pairs
/// that leave nearly the same error.
pub(crate) fn pair_alone<'a>(
    session: &Session<'_>,
    problem: &Problem,
    scores: &[EffectScore<'a>],
    usable: &[bool],
    refit: &Refit<'_, '_>,
    most: [f64; 2],
) -> Option<(Scored<'a>, Scored<'a>, f64, Vec<String>)> {
    let parts: Vec<(usize, Variant<'a>, Vec<DMatrix<f64>>)> = (0..scores.len())
        .into_par_iter()
        .filter(|&i| usable[i])
        .flat_map_iter(|i| {
            let mut order: Vec<&Scored<'a>> = scores[i].scored.iter().filter(|s| s.gain > 0.0).collect();
            order.sort_by(|a, b| b.gain.total_cmp(&a.gain));
            let mut targets = Vec::new();
            order.retain(|s| {
                let first = !targets.contains(&s.variant.target);
                targets.push(s.variant.target);
                first
            });
            order.into_iter().map(|s| s.variant.clone()).collect::<Vec<_>>().into_iter().filter_map(move |v| {
                let columns = v.columns(session, problem)?;
                Some((i, v, columns))
            })
        })
        .collect();
    let beside = |a: usize, b: usize| -> bool {
        let (x, y) = (&parts[a].1, &parts[b].1);
        let (p, q) = (x.effect.about(), y.effect.about());
        // loads are compared between the same two groups of trials
        let same_groups = !(p.by_group || q.by_group) || x.group == y.group;
        same_groups && !p.contains.contains(&q.id) && !q.contains.contains(&p.id) && !p.aliases.contains(&q.id)
    };
    let pairs: Vec<(usize, usize)> = (0..parts.len())
        .flat_map(|a| (a + 1..parts.len()).map(move |b| (a, b)))
        .filter(|&(a, b)| beside(a, b))
        .collect();
    let mut gains: Vec<(f64, usize, usize)> = pairs
        .into_par_iter()
        .map(|(a, b)| {
            let (ka, kb) = (parts[a].1.coefficients.len(), parts[b].1.coefficients.len());
            let columns: Vec<DMatrix<f64>> = parts[a]
                .2
                .iter()
                .zip(&parts[b].2)
                .map(|(x, y)| {
                    let mut wide = DMatrix::zeros(x.nrows(), ka + kb);
                    wide.columns_mut(0, ka).copy_from(x);
                    wide.columns_mut(ka, kb).copy_from(y);
                    wide
                })
                .collect();
            let coefficients: Vec<_> =
                parts[a].1.coefficients.iter().chain(&parts[b].1.coefficients).cloned().collect();
            let (s, c) = problem.reduce_all(&columns);
            (solve(&s, &c, &coefficients).1, a, b)
        })
        .collect();
    gains.sort_by(|x, y| y.0.total_cmp(&x.0).then((x.1, x.2).cmp(&(y.1, y.2))));
    let fit = |variant: &Variant<'a>, other: &Variant<'a>| -> Option<Scored<'a>> {
        fitted(session, &refit.with(session, problem.domain, other)?, variant)
    };
    let fitted: Vec<(Scored<'a>, Scored<'a>, f64)> = gains
        .into_par_iter()
        .take(JUDGED)
        .filter_map(|(_, a, b)| {
            let (mut x, mut y) = (fit(&parts[a].1, &parts[b].1)?, fit(&parts[b].1, &parts[a].1)?);
            for _ in 0..TURNS {
                x = fit(&x.variant, &y.variant)?;
                y = fit(&y.variant, &x.variant)?;
            }
            let error = y.fold_error.iter().sum::<f64>();
            (!is_trivial(session, problem, error / problem.n_judged as f64)).then_some((x, y, error))
        })
        .collect();
    // of pairs that leave nearly the same error, the one with the fewest unknowns; the others are
    // named beside it
    let least = fitted.iter().map(|f| f.2).fold(f64::INFINITY, f64::min);
    let same = SAME[usize::from(session.prior.is_some())];
    let mut near: Vec<(Scored<'a>, Scored<'a>, f64)> =
        fitted.into_iter().filter(|f| (least / f.2).sqrt() > same).collect();
    let unknowns = |f: &(Scored<'_>, Scored<'_>, f64)| f.0.variant.unknowns() + f.1.variant.unknowns();
    near.sort_by(|x, y| unknowns(x).cmp(&unknowns(y)).then(x.2.total_cmp(&y.2)));
    let mut ids: Vec<String> = Vec::new();
    for f in &near {
        for s in [&f.0, &f.1] {
            let id = s.variant.effect.id();
            let contains = s.variant.effect.about().contains;
            if !ids.iter().any(|i| i == id || contains.contains(&i.as_str())) {
                ids.push(id.to_owned());
            }
        }
    }
    let best = near.into_iter().next()?;
    let plain: Vec<f64> = problem.folds.iter().map(|f| f.error).collect();
    let whole: f64 = plain.iter().sum();
    let single = scores.iter().filter(|s| !s.placebo).map(|s| s.fold_error.iter().sum::<f64>()).fold(whole, f64::min);
    let small = (best.2 / whole).sqrt() < most[0] && (best.2 / single).sqrt() < most[1];
    let real = small && sign_flip_p(&best.1.fold_error, &plain, 2000, refit.seed()) < 0.01;
    real.then_some((best.0, best.1, best.2, ids))
}
