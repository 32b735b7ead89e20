//! Which explanations are tried on these recordings, each at the optimum of its unknowns.

use super::by_recording::ln_choices;
use super::explanation::Explanation;
use super::model::Model;
use super::posterior::EffectPosterior;
use super::priors::{FAR_BEHIND, SHARE, STEPS, TO_THE_END};
use super::starts::starts;
use crate::candidate::{Variant, solve};
use crate::nonlinear::{columns_and_slopes, improve};
use crate::options::DiscoverOptions;
use aloft_effects::{Effect, Target};
use nalgebra::{DMatrix, DVector};
use rayon::prelude::*;

/// Explanations by effects and targets; an effect that cannot act here has none. What is far behind
/// the best of all is not fitted further: it would hold no probability. Fits begin where those of
/// `before` ended, on the targets that have any.
pub(super) fn explanations<'a>(
    model: &Model<'_>,
    effects: &[&'a dyn Effect],
    before: Option<&[EffectPosterior<'a>]>,
    options: &DiscoverOptions,
) -> Vec<Vec<Explanation<'a>>> {
    let Model { session, problem, likelihood, .. } = model;
    let tried: Vec<&'a dyn Effect> =
        effects.iter().copied().filter(|e| options.asks_for(*e) && model.may_show(*e)).collect();
    let begin = |effect: &&'a dyn Effect| {
        let of = before.and_then(|all| all.iter().find(|e| e.is_of(*effect)));
        let mut found = of.map(|of| of.again(session, problem)).unwrap_or_default();
        // a target that was far behind beside another model need not be so beside this one
        let ended: Vec<Target> = found.iter().map(|(v, _)| v.target).collect();
        found.extend(starts(model, *effect).into_iter().filter(|(v, _)| !ended.contains(&v.target)));
        session.counter.one();
        found
    };
    let mut all: Vec<Vec<(Variant<'a>, f64)>> = tried.iter().map(begin).collect();
    let worth = |gain: f64| likelihood.of_squares(problem.rss - gain);
    let nothing = worth(0.0);
    let most_of = |of: &[(Variant<'a>, f64)]| of.iter().map(|v| v.1).fold(0.0, f64::max);
    for (steps, share) in STEPS {
        let most = all.iter().map(|of| most_of(of)).fold(0.0, f64::max);
        let near = |gain: f64, most: f64| gain >= share * most || worth(gain) > worth(most) - FAR_BEHIND;
        for of in &mut all {
            let own = most_of(of);
            of.retain(|v| near(v.1, own));
        }
        // what its coefficients alone cost more than it gains is not fitted further, either
        let may_matter = |(variant, gain): &(Variant<'a>, f64)| {
            let cost = likelihood.of_coefficients(variant.coefficients.len());
            near(*gain, most) && (steps == STEPS[0].0 || worth(*gain) - cost > nothing)
        };
        let further = |v: &mut (Variant<'a>, f64)| {
            let unknowns = !v.0.effect.nonlinear(session.scene(), v.0.target).is_empty();
            if unknowns
                && v.1 > 0.0
                && may_matter(v)
                && let Some(better) = improve(session, problem, &v.0, steps)
            {
                *v = better;
            }
        };
        all.par_iter_mut().flatten().for_each(further);
    }
    let of_effect = |of: Vec<(Variant<'a>, f64)>| -> Vec<Explanation<'a>> {
        of.into_par_iter().filter_map(|(variant, _)| explained(model, variant)).collect()
    };
    let mut all: Vec<Vec<Explanation<'a>>> = all.into_iter().map(of_effect).filter(|of| !of.is_empty()).collect();
    let best = all.iter().flatten().map(|e| e.ln_likelihood).fold(nothing, f64::max);
    for of in &mut all {
        let in_some: Vec<_> = of.par_iter().filter_map(|e| in_some_recordings(model, e, best)).collect();
        of.extend(in_some);
    }
    all
}

/// The evidence of a variant as it is, in the metric of the noise as identification has it: what it
/// leaves over the noise that the rows have with it.
/// None if its columns say nothing that the model does not.
pub(super) fn explained<'a>(model: &Model<'_>, variant: Variant<'a>) -> Option<Explanation<'a>> {
    let Model { session, problem, likelihood, .. } = model;
    let columns = variant.columns(session, problem)?;
    let (s, c) = problem.reduce_all(&columns);
    if s.iter().all(|x| *x == 0.0) {
        return None;
    }
    // errors of the motion are in the columns as in the rows; a column that is noise says nothing
    let errors = model.row_errors(&variant);
    let (of_columns, with_rows, of_rows) = problem.of_errors(&columns, &errors);
    if !errors.is_empty() && (0..c.len()).any(|i| s[(i, i)] > 0.0 && of_columns[(i, i)] >= s[(i, i)]) {
        return None;
    }
    let (theta, _) = solve(&(&s - &of_columns), &(&c - &with_rows), &variant.coefficients);
    let form = |s: &DMatrix<f64>, c: &DVector<f64>| 2.0 * c.dot(&theta) - theta.dot(&(s * &theta));
    // the noise of the rows with it, over that without: a body that is taken away leaves none
    let noise = if of_rows > 0.0 { 1.0 - form(&of_columns, &with_rows) / of_rows } else { 1.0 };
    let left = (problem.rss - form(&s, &c)) / noise.max(f64::MIN_POSITIVE);
    let unknowns = variant.effect.nonlinear(session.scene(), variant.target);
    let of_unknowns = if unknowns.is_empty() {
        0.0
    } else {
        let joint = problem.reduce_all(&columns_and_slopes(session, problem, &variant, &theta)?).0;
        likelihood.of_unknowns(&joint, theta.len(), &unknowns, left)
    };
    let ln_likelihood = likelihood.of_squares(left) - likelihood.of_coefficients(theta.len()) - of_unknowns;
    Some(Explanation { variant, theta, left, ln_likelihood })
}

/// The same effect in some of the recordings, at any one cut through its sizes in each of them.
/// There are `n − 1` such cuts and half of the probability is for "in all".
/// `best` is the likeliest explanation so far.
fn in_some_recordings<'a>(model: &Model<'_>, everywhere: &Explanation<'a>, best: f64) -> Option<Explanation<'a>> {
    let Model { session, problem, likelihood, .. } = model;
    let variant = &everywhere.variant;
    if !variant.group.is_empty() || !variant.effect.has_wrench() {
        return None;
    }
    let mut trials: Vec<usize> = problem.clusters.iter().map(|c| c.trial).collect();
    trials.sort_unstable();
    trials.dedup();
    if trials.len() < 3 {
        return None;
    }
    let columns = variant.columns(session, problem)?;
    let by_trial: Vec<DMatrix<f64>> = columns
        .iter()
        .zip(&problem.clusters)
        .map(|(c, cluster)| {
            let signal = c * &everywhere.theta;
            DMatrix::from_fn(c.nrows(), trials.len(), |i, j| if trials[j] == cluster.trial { signal[i] } else { 0.0 })
        })
        .collect();
    let (s, c) = problem.reduce_all(&by_trial);
    let size = crate::candidate::pseudo_solve(&s, &c);
    let mut order: Vec<usize> = (0..trials.len()).collect();
    order.sort_by(|&a, &b| size[b].total_cmp(&size[a]));
    let gain = |of: &[usize]| {
        let right: f64 = of.iter().map(|&i| c[i]).sum();
        let square: f64 = of.iter().flat_map(|&i| of.iter().map(move |&j| (i, j))).map(|at| s[at]).sum();
        if square > 0.0 && right > 0.0 { right * right / square } else { 0.0 }
    };
    // in this direction, or what is below the others in the other
    let cuts = (1..order.len()).flat_map(|cut| [&order[..cut], &order[cut..]]);
    let chosen = cuts.max_by(|a, b| gain(a).total_cmp(&gain(b)))?;
    // set by set it has to be likelier than in all recordings before it is fitted to them
    let cost = likelihood.of_squares(everywhere.left) - everywhere.ln_likelihood;
    let mut group = vec![false; session.trials.len()];
    chosen.iter().for_each(|&i| group[trials[i]] = true);
    let of_choice = ln_choices(problem, &group);
    let here = likelihood.of_squares(problem.rss - gain(chosen)) - cost - of_choice;
    let reach = likelihood.of_squares(problem.rss) + SHARE * (best - likelihood.of_squares(problem.rss));
    if here < everywhere.ln_likelihood || here < reach.min(best - FAR_BEHIND) {
        return None;
    }
    let some = Variant { group, ..variant.clone() };
    let some = improve(session, problem, &some, TO_THE_END).map_or(some, |better| better.0);
    let mut found = explained(model, some)?;
    // 2 (n - 1) sets that one order offers, of 2^n - 2: how many of them were tried does not matter
    // as much as how many there are with so many recordings
    found.ln_likelihood -= of_choice;
    Some(found)
}
