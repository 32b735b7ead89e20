//! Ranks every effect against the model: variants, selection among them inside each fold, and the
//! null distribution of the best.

use crate::candidate::{Scored, Variant, pseudo_inverse, score, solve};
use crate::groups::group;
use crate::nonlinear::{FULL_STEPS, improve, score_fitted, with_joint_errors};
use crate::problem::{Domain, FlippedFold, OVERLAP, Problem, Reduced};
use crate::session::Session;
use aloft_effects::{Effect, Target};
use nalgebra::{DMatrix, DVector};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rayon::prelude::*;

/// Gauss-Newton steps of the first pass.
const QUICK_STEPS: usize = 5;
/// Share of the squared error that an effect has to remove before `Target::Shape` is tried.
const SHAPED: f64 = 0.5;
/// Mean size in the trials without an effect, relative to that in the trials with it, below which
/// it counts as absent; and the gap between the two sets in standard errors.
const ABSENT: f64 = 0.25;
const CLEARLY: f64 = 4.0;
/// Number of targets whose best start is fitted with the full number of steps.
const FINISHED: usize = 4;

/// An effect with its variants and its nested held-out error.
pub(crate) struct EffectScore<'a> {
    pub effect: &'a dyn Effect,
    pub scored: Vec<Scored<'a>>,
    /// Index of the variant selected from all rows.
    pub best: usize,
    /// Squared error by fold, with the variant selected without that fold.
    pub fold_error: Vec<f64>,
    pub placebo: bool,
    null: Vec<NullVariant>,
}

/// What a variant's folds need for sign flips.
struct NullVariant {
    /// `Cᵀr` by cluster.
    u: Vec<DVector<f64>>,
    /// `AᵀC` by cluster.
    ac: Vec<DMatrix<f64>>,
    /// By fold, the inverse of the Gram matrix and the columns of the judged rows, parameters
    /// projected out.
    folds: Vec<(DMatrix<f64>, DMatrix<f64>)>,
    unknowns: usize,
    /// Bounds of a single coefficient.
    bounds: Option<(f64, f64)>,
}

impl NullVariant {
    /// `AᵀC` over all clusters.
    fn whole(&self) -> DMatrix<f64> {
        let mut sum = DMatrix::zeros(self.ac[0].nrows(), self.ac[0].ncols());
        self.ac.iter().for_each(|a| sum += a);
        sum
    }

    /// `Cᵀr`, one column for each cluster.
    fn right(&self) -> DMatrix<f64> {
        DMatrix::from_columns(&self.u)
    }
}

/// The variant that a draw of signs selects, what it is worth, and its coefficients.
#[derive(Clone)]
struct Selected<'v> {
    worth: f64,
    variant: &'v NullVariant,
    theta: DVector<f64>,
}

impl EffectScore<'_> {
    /// Held-out mean square.
    pub fn mean_square(&self, problem: &Problem) -> f64 {
        self.fold_error.iter().sum::<f64>() / problem.n_judged as f64
    }
}

/// Information criterion with the correction for small samples (Hurvich and Tsai 1989): a variant
/// with as many unknowns as there are independent observations is never chosen.
fn criterion(gain: f64, rss: f64, n_rows: f64, unknowns: usize) -> f64 {
    let (n, k) = (n_rows / OVERLAP, unknowns as f64);
    let spare = n - k - 1.0;
    if spare <= 0.0 {
        return f64::INFINITY;
    }
    n * ((rss - gain).max(1e-9 * rss) / rss).ln() + 2.0 * k * n / spare
}

/// Scores all variants of an effect on all targets that are not `taken`; `None` if it cannot act
/// here. With `acting` the effect acts only in those trials; otherwise it acts in all of them or,
/// if the trials fall into two clear sets, in one of these.
pub(crate) fn score_effect<'a>(
    session: &Session<'_>,
    problem: &Problem,
    effect: &'a dyn Effect,
    taken: &[Target],
    acting: Option<&[bool]>,
    placebo: bool,
    refine: bool,
) -> Option<EffectScore<'a>> {
    let mut targets = effect.targets(session.scene);
    targets.retain(|t| !taken.contains(t));
    let nonlinear = targets.iter().any(|t| !effect.nonlinear(session.scene, *t).is_empty());
    let screened = screen(session, problem, effect, &targets, acting);
    if screened.is_empty() {
        return None;
    }
    let flips = problem.flip_parts();
    let reduced: Vec<(Variant<'a>, Reduced, NullVariant)> = screened
        .into_iter()
        .map(|(variant, columns)| {
            let reduced = problem.reduce(&columns);
            let (u, ac) = flips.candidate(&columns);
            let null = NullVariant {
                u,
                ac,
                folds: reduced.folds.iter().map(|f| (pseudo_inverse(&f.s), f.test.clone())).collect(),
                unknowns: variant.unknowns(),
                bounds: match variant.coefficients.as_slice() {
                    [only] => Some((only.lower, only.upper)),
                    _ => None,
                },
            };
            (variant, reduced, null)
        })
        .collect();
    let mut scored = Vec::new();
    let mut null = Vec::new();
    for (variant, reduced, of_null) in reduced {
        scored.push(score(problem, variant, &reduced));
        null.push(of_null);
    }
    // everything that the effect does is part of the model already (a load in every trial of a body
    // without a prior)
    if scored.iter().all(|s| s.s.iter().all(|x| *x == 0.0)) {
        return None;
    }
    if nonlinear && refine {
        // a few steps from every start, then all steps for the best
        let mut tried: Vec<(Variant<'a>, f64)> = promising(session, &scored)
            .into_par_iter()
            .filter_map(|variant| improve(session, problem, &variant, QUICK_STEPS))
            .collect();
        tried.sort_by(|a, b| b.1.total_cmp(&a.1));
        let mut targets = Vec::new();
        tried.retain(|(v, _)| {
            let first = !targets.contains(&v.target);
            targets.push(v.target);
            first
        });
        let fitted: Vec<Option<Scored<'a>>> = tried
            .into_par_iter()
            .take(FINISHED)
            .map(|(variant, _)| {
                let (better, _) = improve(session, problem, &variant, FULL_STEPS)?;
                Some(as_load(session, problem, score_fitted(session, problem, better)?))
            })
            .collect();
        scored.extend(fitted.into_iter().flatten());
    }
    let n_rows: f64 = problem.clusters.iter().map(|c| c.n_rows as f64).sum();
    if refine && !placebo && acting.is_none() {
        let worth = |s: &Scored<'_>| criterion(s.gain, problem.rss, n_rows, unknowns_of(s));
        let mut order: Vec<usize> = (0..scored.len()).collect();
        order.sort_by(|&a, &b| worth(&scored[a]).total_cmp(&worth(&scored[b])));
        let mut targets = Vec::new();
        order.retain(|&i| {
            let first = !targets.contains(&scored[i].variant.target);
            targets.push(scored[i].variant.target);
            first
        });
        let in_part: Vec<Option<Scored<'a>>> =
            order.into_par_iter().take(FINISHED).map(|i| in_some_trials(session, problem, &scored[i])).collect();
        scored.extend(in_part.into_iter().flatten());
    }
    let pick = |gain: &dyn Fn(&Scored<'_>) -> f64, rss: f64, n_rows: f64| {
        let of: Vec<f64> = scored.iter().map(|s| criterion(gain(s), rss, n_rows, unknowns_of(s))).collect();
        let least = of.iter().copied().fold(f64::INFINITY, f64::min);
        // among targets that the rows cannot tell apart, prefer the link nearest to the root
        (0..scored.len())
            .filter(|&i| of[i] <= least + 1.0)
            .min_by(|&a, &b| scored[a].variant.target.cmp(&scored[b].variant.target).then(of[a].total_cmp(&of[b])))
            .unwrap_or(0)
    };
    let best = pick(&|s| s.gain, problem.rss, n_rows);
    let fold_error = (0..problem.folds.len())
        .map(|g| {
            let n = n_rows - problem.clusters[g].n_rows as f64;
            scored[pick(&|s| s.fold_gain[g], problem.folds[g].train, n)].fold_error[g]
        })
        .collect();
    if refine && !placebo {
        scored[best] = with_joint_errors(session, problem, scored[best].clone());
    }
    Some(EffectScore { effect, scored, best, fold_error, placebo, null })
}

/// Number of unknowns of a variant; the choice of the trials in which it acts counts as two.
fn unknowns_of(s: &Scored<'_>) -> usize {
    let chosen = !s.variant.group.is_empty() && !s.variant.effect.about().by_group;
    s.variant.unknowns() + if chosen { 2 } else { 0 }
}

/// Error of a load over that of something taken away in the other trials up to which the load is
/// preferred on a person.
const LOAD_ALIKE: f64 = 1.05;

/// A load that was found as something taken away in some trials, as a load in the others if that
/// fits as well: unnamed groups have no order.
fn as_load<'a>(session: &Session<'_>, problem: &Problem, scored: Scored<'a>) -> Scored<'a> {
    // named groups have an order
    let told = session.groups.iter().any(Option::is_some);
    if !scored.variant.effect.about().by_group || told || scored.theta.iter().any(|x| *x >= 0.0) {
        return scored;
    }
    let others: Vec<bool> = scored.variant.group.iter().map(|acts| !acts).collect();
    // errors of the motion act on the whole inertia, which the load adds to
    let share = scored.theta.iter().map(|x| x.abs()).sum::<f64>() / session.mass_kg;
    // a prior hardly tells a load from something taken away; what is carried is likelier
    let alike = if session.prior.is_some() { LOAD_ALIKE } else { 1.01 };
    let equal = alike * (1.0 + share).powi(4);
    let turned = Variant { group: others, fitted: 0, ..scored.variant.clone() };
    improve(session, problem, &turned, FULL_STEPS)
        .filter(|(_, gain)| problem.rss - gain <= equal * (problem.rss - scored.gain))
        .and_then(|(better, _)| score_fitted(session, problem, better))
        .filter(|load| load.theta.iter().all(|x| *x > 0.0))
        .unwrap_or(scored)
}

/// The variant acting only in those trials that show it, if the trials fall into two clear sets:
/// its size in the one is far above, in the other near zero.
fn in_some_trials<'a>(session: &Session<'_>, problem: &Problem, scored: &Scored<'a>) -> Option<Scored<'a>> {
    // a load in some trials is `payload`, which also changes the body's mass
    if !scored.variant.effect.has_wrench() {
        return None;
    }
    let mut trials: Vec<usize> = problem.clusters.iter().map(|c| c.trial).collect();
    trials.sort_unstable();
    trials.dedup();
    if trials.len() < 4 {
        return None;
    }
    let columns = scored.variant.columns(session, problem)?;
    let wide: Vec<DMatrix<f64>> = columns
        .iter()
        .zip(&problem.clusters)
        .map(|(c, cluster)| {
            let signal = c * &scored.theta;
            DMatrix::from_fn(c.nrows(), trials.len(), |i, j| if trials[j] == cluster.trial { signal[i] } else { 0.0 })
        })
        .collect();
    let (s, c) = problem.reduce_all(&wide);
    let size = crate::candidate::pseudo_solve(&s, &c);
    let n_rows: f64 = problem.clusters.iter().map(|c| c.n_rows as f64).sum();
    let variance = OVERLAP * (problem.rss - c.dot(&size)).max(0.0) / n_rows;
    let se = |i: usize| if s[(i, i)] > 0.0 { (variance / s[(i, i)]).sqrt() } else { f64::INFINITY };
    let mut order: Vec<usize> = (0..trials.len()).collect();
    order.sort_by(|&a, &b| size[a].total_cmp(&size[b]));
    let gap = |i: usize| size[order[i]] - size[order[i - 1]];
    let cut = (1..order.len()).max_by(|&a, &b| gap(a).total_cmp(&gap(b)))?;
    let (without, with) = order.split_at(cut);
    if with.len() < 2 || without.len() < 2 {
        return None;
    }
    let mean = |of: &[usize]| of.iter().map(|&i| size[i]).sum::<f64>() / of.len() as f64;
    let noise = (se(order[cut]).powi(2) + se(order[cut - 1]).powi(2)).sqrt();
    if !(mean(without).abs() < ABSENT * mean(with) && gap(cut) > 0.5 * mean(with) && gap(cut) > CLEARLY * noise) {
        return None;
    }
    let mut group = vec![false; session.trials.len()];
    with.iter().for_each(|&i| group[trials[i]] = true);
    let variant = Variant { group, ..scored.variant.clone() };
    if variant.fitted > 0 {
        let (better, _) = improve(session, problem, &variant, FULL_STEPS)?;
        return score_fitted(session, problem, better);
    }
    let columns = variant.columns(session, problem)?;
    Some(score(problem, variant, &problem.reduce(&columns)))
}

/// Variants used as starts: the best of every target, at most nine in all, and the next two of the
/// best target.
fn promising<'a>(session: &Session<'_>, scored: &[Scored<'a>]) -> Vec<Variant<'a>> {
    let mut order: Vec<usize> = (0..scored.len()).filter(|&i| scored[i].gain > 0.0).collect();
    order.sort_by(|&a, &b| scored[b].gain.total_cmp(&scored[a].gain));
    let mut out: Vec<Variant<'a>> = Vec::new();
    for &i in &order {
        let v = &scored[i].variant;
        if v.effect.nonlinear(session.scene, v.target).is_empty() {
            continue;
        }
        let of_target = out.iter().filter(|o| o.target == v.target).count();
        let first = out.first().is_none_or(|o| o.target == v.target);
        if of_target < if first { 3 } else { 1 } && out.len() < 9 {
            out.push(v.clone());
        }
    }
    out
}

pub(crate) type Screened<'a> = Vec<(Variant<'a>, Vec<DMatrix<f64>>)>;

/// Variants at given values with their columns: all targets at the starts that gave the largest
/// gain on the first target.
pub(crate) fn screen<'a>(
    session: &Session<'_>,
    problem: &Problem,
    effect: &'a dyn Effect,
    targets: &[Target],
    acting: Option<&[bool]>,
) -> Screened<'a> {
    const FEW: usize = 4;
    const MANY: usize = 60;
    let by_group = effect.about().by_group;
    let loaded = if by_group { group(session, problem, effect, targets) } else { None };
    if by_group && loaded.is_none() {
        return Vec::new();
    }
    let mut out: Screened<'a> = Vec::new();
    let mut chosen: Option<Vec<usize>> = None;
    let mut gained = 0.0f64;
    for &target in targets {
        // the shape of links only modifies an effect that already explains most of the error
        if target == Target::Shape && gained < SHAPED * problem.rss {
            continue;
        }
        let starts = effect.starts(session.scene, target);
        let indices: Vec<usize> = match &chosen {
            Some(chosen) => chosen.iter().copied().filter(|&i| i < starts.len()).collect(),
            None => (0..starts.len()).collect(),
        };
        let made: Vec<(usize, f64, Variant<'a>, Vec<DMatrix<f64>>)> = indices
            .into_par_iter()
            .filter_map(|i| {
                let mut variant = Variant::new(session, effect, target, starts[i].clone());
                variant.group = acting.map(<[bool]>::to_vec).unwrap_or_default();
                if let Some(loaded) = &loaded {
                    variant.group.clone_from(loaded);
                }
                let columns = variant.columns(session, problem)?;
                let (s, c) = problem.reduce_all(&columns);
                let gain = solve(&s, &c, &variant.coefficients).1;
                Some((i, gain, variant, columns))
            })
            .collect();
        let mut order: Vec<(usize, f64)> = made.iter().map(|m| (m.0, m.1)).collect();
        order.sort_by(|a, b| b.1.total_cmp(&a.1));
        gained = order.first().map_or(gained, |o| gained.max(o.1));
        if chosen.is_none() && starts.len() > FEW {
            chosen = Some(order.iter().take(FEW).map(|o| o.0).collect());
        }
        // of many starts keep the best, and a sample of the others for the null distribution
        let best: Vec<usize> = order.iter().take(MANY / 10).map(|o| o.0).collect();
        let stride = made.len().div_ceil(MANY).max(1);
        out.extend(made.into_iter().filter(|m| m.0 % stride == 0 || best.contains(&m.0)).map(|m| (m.2, m.3)));
    }
    out
}

/// Smallest held-out ratio over all effects for each draw of random signs of the clusters'
/// residuals.
pub(crate) fn null_ratios(problem: &Problem, scores: &[EffectScore<'_>], draws: usize, seed: u64) -> Vec<f64> {
    let n = problem.clusters.len();
    // few clusters have few sign patterns; flipping all signs together does not count as another
    // one
    let patterns = if n <= 12 { (1usize << (n - 1)) - 1 } else { usize::MAX };
    let draws = draws.min(patterns);
    if draws == 0 {
        return Vec::new();
    }
    let signs_of = |draw: usize| -> Vec<f64> {
        if patterns <= draws {
            (0..n).map(|g| if g > 0 && ((draw + 1) >> (g - 1)) & 1 == 1 { -1.0 } else { 1.0 }).collect()
        } else {
            let mut rng = ChaCha8Rng::seed_from_u64(seed);
            rng.set_stream(draw as u64);
            (0..n).map(|_| if rng.random_bool(0.5) { 1.0 } else { -1.0 }).collect()
        }
    };
    let signs: Vec<Vec<f64>> = (0..draws).map(signs_of).collect();
    let parts = problem.flip_parts();
    let folds: Vec<Vec<FlippedFold>> = signs.par_iter().map(|s| parts.folds(s)).collect();
    let signs = DMatrix::from_fn(n, draws, |g, d| signs[d][g]);
    // all draws of a fold together: what belongs to a variant is read once for all of them
    let solutions: Vec<DMatrix<f64>> =
        (0..n).map(|g| DMatrix::from_columns(&folds.iter().map(|f| f[g].x.column(0)).collect::<Vec<_>>())).collect();
    let least = scores
        .par_iter()
        .filter(|s| !s.placebo)
        .map(|score| {
            let null: Vec<_> = score.null.iter().map(|v| (v, v.whole(), v.right() * &signs)).collect();
            let by_fold: Vec<Vec<f64>> =
                (0..n).into_par_iter().map(|g| left_out(problem, &null, g, &signs, &folds, &solutions[g])).collect();
            (0..draws).map(|d| by_fold.iter().map(|errors| errors[d]).sum()).collect()
        })
        .reduce(
            || vec![f64::INFINITY; draws],
            |a: Vec<f64>, b: Vec<f64>| a.into_iter().zip(b).map(|(x, y)| x.min(y)).collect(),
        );
    let plain = folds.iter().map(|f| f.iter().map(|fold| fold.error).sum::<f64>());
    least.into_iter().zip(plain).map(|(best, plain)| (best / plain).sqrt()).collect()
}

/// Squared error of fold `g` for each draw of signs, with the variant that the other folds select.
/// Each variant comes with `AᵀC` over all clusters and with `Σ s Cᵀr` (one column for each draw);
/// `solutions` holds the fold's parameters, one column for each draw.
fn left_out(
    problem: &Problem,
    null: &[(&NullVariant, DMatrix<f64>, DMatrix<f64>)],
    g: usize,
    signs: &DMatrix<f64>,
    folds: &[Vec<FlippedFold>],
    solutions: &DMatrix<f64>,
) -> Vec<f64> {
    let n_rows: f64 = problem.clusters.iter().map(|c| c.n_rows as f64).sum();
    let n_train = n_rows - problem.clusters[g].n_rows as f64;
    let mut chosen: Vec<Option<Selected<'_>>> = vec![None; folds.len()];
    for (v, whole, right) in null {
        let mut c = right - &v.u[g] * signs.row(g);
        c.gemm_tr(-1.0, &(whole - &v.ac[g]), solutions, 1.0);
        let mut theta = &v.folds[g].0 * &c;
        if let Some((lower, upper)) = v.bounds {
            theta.row_mut(0).apply(|x| *x = x.clamp(lower, upper));
        }
        for (d, best) in chosen.iter_mut().enumerate() {
            let theta = theta.column(d);
            let worth = criterion(c.column(d).dot(&theta), folds[d][g].train, n_train, v.unknowns);
            if worth < best.as_ref().map_or(f64::INFINITY, |b| b.worth) {
                *best = Some(Selected { worth, variant: v, theta: theta.into_owned() });
            }
        }
    }
    let error =
        |fold: &FlippedFold, best: Selected<'_>| (&fold.test - &best.variant.folds[g].1 * best.theta).norm_squared();
    folds.iter().zip(chosen).map(|(fold, best)| best.map_or(0.0, |best| error(&fold[g], best))).collect()
}

/// Cosine of a fitted signal (by cluster) with its best approximation by columns, inertial
/// parameters projected out: 1 if they can reproduce it.
pub(crate) fn cosine(problem: &Problem, signal: &[DVector<f64>], cb: &[DMatrix<f64>]) -> f64 {
    let k = cb[0].ncols();
    let both: Vec<DMatrix<f64>> = signal
        .iter()
        .zip(cb)
        .map(|(x, y)| {
            let mut wide = DMatrix::zeros(y.nrows(), k + 1);
            wide.columns_mut(0, k).copy_from(y);
            wide.set_column(k, x);
            wide
        })
        .collect();
    let (s, _) = problem.reduce_all(&both);
    let own = s[(k, k)];
    if own <= 0.0 {
        return 0.0;
    }
    let cross = s.view((0, k), (k, 1)).into_owned().column(0).into_owned();
    let inside = cross.dot(&(pseudo_inverse(&s.view((0, 0), (k, k)).into_owned()) * &cross));
    (inside / own).clamp(0.0, 1.0).sqrt()
}

/// True if an effect is judged in a domain. What also acts in the air is judged in the air alone:
/// on the plates a force on the body cannot be told from an error of the plates or of the model.
pub(crate) fn judged_in(effect: &dyn Effect, domain: Domain) -> bool {
    match domain {
        Domain::Flight => effect.acts().in_flight(),
        Domain::Contact => effect.acts().in_contact() && !effect.acts().in_flight(),
        Domain::Both => effect.acts().in_contact() && effect.acts().in_flight(),
    }
}
