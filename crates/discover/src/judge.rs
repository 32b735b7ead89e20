//! Interprets a ranking: which effects are plausible and accepted, which cannot be told apart, and
//! the verdict.

use crate::candidate::Scored;
use crate::exchange::exchange;
use crate::held_out::HeldOutResult;
use crate::ladder::{is_at_bound, key_of};
use crate::limits::SAME;
use crate::only_as_limit::{is_at_far_edge, is_only_a_limit};
use crate::options::DiscoverOptions;
use crate::problem::Problem;
use crate::rank::{EffectScore, cosine};
use crate::result::{Alternative, Candidate, Confusion, Estimate, MANY_CLUSTERS, RivalTest, Verdict};
use crate::rivals::{Rival, is_alias};
use crate::session::{Block, Session};
use crate::statistics::{jackknife_se, sign_flip_p};
use aloft_effects::{About, Coefficient, ParameterKind};
use nalgebra::{DMatrix, DVector};
use rayon::prelude::*;

/// Where the exchange test cannot be made, the better effect must leave less than this share of the
/// other's error.
const NEARLY: f64 = 0.94;
/// On a person an effect with more than twice the unknowns of another is separated from it without
/// the exchange test only below this share of the other's error.
const CLEARLY: f64 = 0.85;

/// The best variant of every target, best first.
pub(crate) fn alternatives(session: &Session<'_>, problem: &Problem, score: &EffectScore<'_>) -> Vec<Alternative> {
    let mut out: Vec<Alternative> = Vec::new();
    let mut order: Vec<&Scored<'_>> = score.scored.iter().collect();
    order.sort_by(|a, b| a.fold_error.iter().sum::<f64>().total_cmp(&b.fold_error.iter().sum()));
    for s in order {
        let key = key_of(session, s);
        if out.len() < 5 && !out.iter().any(|a| a.key == key) {
            let error: f64 = s.fold_error.iter().sum::<f64>() / problem.n_judged as f64;
            out.push(Alternative { key, held_out_ratio: (error / problem.plain()).sqrt() });
        }
    }
    out
}

/// True if the error is far below what noise alone leaves. Columns that, together with those of the
/// model, reproduce the body's own weight and inertia fit anything, because in flight only the mass
/// from the scale fixes the size of the parameters.
pub(crate) fn is_trivial(session: &Session<'_>, problem: &Problem, mean_square: f64) -> bool {
    let noise = session.noise.map_or(0.0, |n| 0.5 * (n[0] + n[1]));
    mean_square < (0.04 * noise).max(1e-5 * problem.plain())
}

/// Held-out root mean squares of forces (N) and moments (N·m).
pub(crate) fn parts(session: &Session<'_>, problem: &Problem) -> [f64; 2] {
    let mut sums = [0.0; 2];
    let mut counts = [0.0; 2];
    for (cluster, fold) in problem.clusters.iter().zip(&problem.folds) {
        let mut kinds = Vec::new();
        for &i in &cluster.blocks {
            kinds.extend((0..session.blocks[i].y.nrows()).map(|row| usize::from(!Block::is_force(row))));
        }
        for (x, &row) in fold.test.iter().zip(&cluster.judged) {
            sums[kinds[row]] += x * x;
            counts[kinds[row]] += 1.0;
        }
    }
    [(sums[0] / counts[0]).sqrt() * session.unit[0], (sums[1] / counts[1]).sqrt() * session.unit[1]]
}

/// How often each effect comes first over resamples of clusters.
pub(crate) fn chosen_shares(scores: &[EffectScore<'_>], weights: &[Vec<f64>]) -> Vec<f64> {
    let mut wins = vec![0.0; scores.len()];
    for w in weights {
        let sum = |s: &EffectScore<'_>| -> f64 { s.fold_error.iter().zip(w).map(|(e, w)| e * w).sum() };
        let first = (0..scores.len()).min_by(|&a, &b| sum(&scores[a]).total_cmp(&sum(&scores[b])));
        if let Some(i) = first {
            wins[i] += 1.0;
        }
    }
    wins.iter().map(|n| n / weights.len().max(1) as f64).collect()
}

/// True if no coefficient is at a physical bound and not all are zero.
pub(crate) fn plausible(scored: &Scored<'_>, estimates: &[Estimate]) -> bool {
    let bounds = &scored.variant.coefficients;
    let mut moved = false;
    for (bound, estimate) in bounds.iter().zip(estimates) {
        let away_from_zero = |b: f64| if b == 0.0 { f64::INFINITY } else { b };
        if is_at_bound(estimate.value, [away_from_zero(bound.lower), away_from_zero(bound.upper)]) {
            return false;
        }
        moved |= estimate.value != 0.0;
    }
    // a coefficient of one permitted sign is zero if the data ask for the other sign
    let about = scored.variant.effect.about();
    let absent = |(b, e): (&Coefficient, &Estimate)| b.lower == 0.0 && e.value <= 0.0;
    let all_absent = bounds.iter().zip(estimates).filter(|(b, _)| !about.is_accompanied_by(&b.name)).all(absent);
    moved && !all_absent && accompanied(&about, bounds, estimates).is_none()
}

/// Names of the coefficients that make an effect, if none of them differs from zero, and of those
/// that accompany them and do: a line of no stiffness that only damps is no line, and a jet of no
/// force that only turns is no jet.
pub(crate) fn accompanied(
    about: &About<'_>,
    coefficients: &[Coefficient],
    estimates: &[Estimate],
) -> Option<[Vec<String>; 2]> {
    let is_seen = |e: &Estimate| e.ci95.is_some_and(|[low, high]| low > 0.0 || high < 0.0);
    let (main, others): (Vec<_>, Vec<_>) =
        coefficients.iter().zip(estimates).partition(|(c, _)| !about.is_accompanied_by(&c.name));
    let names = |of: &[(&Coefficient, &Estimate)]| of.iter().map(|(c, _)| c.name.clone()).collect();
    let seen: Vec<_> = others.into_iter().filter(|(_, e)| is_seen(e)).collect();
    (!seen.is_empty() && !main.iter().any(|(_, e)| is_seen(e))).then(|| [names(&main), names(&seen)])
}

/// Name of the one coefficient that makes an effect, if its interval contains zero. Where several
/// coefficients make the effect, each interval may contain zero although their sum differs from it:
/// nothing is told of them, nor of a coefficient without an interval.
pub(crate) fn may_be_zero(about: &About<'_>, coefficients: &[Coefficient], estimates: &[Estimate]) -> Option<String> {
    let mut main = coefficients.iter().zip(estimates).filter(|(c, _)| !about.is_accompanied_by(&c.name));
    let (Some((coefficient, its)), None) = (main.next(), main.next()) else { return None };
    let [low, high] = its.ci95?;
    (low <= 0.0 && high >= 0.0).then(|| coefficient.name.clone())
}

/// True if what makes an effect is one vector, or several, and the intervals of all its components
/// contain zero.
pub(crate) fn no_component_is_seen(about: &About<'_>, coefficients: &[Coefficient], estimates: &[Estimate]) -> bool {
    let mut main = coefficients.iter().zip(estimates).filter(|(c, _)| !about.is_accompanied_by(&c.name)).peekable();
    main.peek().is_some()
        && main.all(|(c, e)| {
            let of_vector = matches!(c.kind, ParameterKind::VectorInWorld(_) | ParameterKind::VectorOnLink(_));
            of_vector && e.ci95.is_some_and(|[low, high]| low <= 0.0 && high >= 0.0)
        })
}

/// Effect size at which the held-out ratio falls below the limit of acceptance in four of five
/// sessions; infinite where the effect cannot be accepted. The tests against chance, placebos and
/// rivals are not in it.
pub(crate) fn minimum_detectable(problem: &Problem, scored: &Scored<'_>, noise_square: f64, threshold: f64) -> f64 {
    let unit = &scored.variant.coefficients[0].unit;
    let of_unit: Vec<usize> =
        (0..scored.variant.coefficients.len()).filter(|&k| scored.variant.coefficients[k].unit == *unit).collect();
    let energy = of_unit.iter().map(|&k| scored.s[(k, k)]).sum::<f64>() / of_unit.len() as f64;
    if energy <= 0.0 || threshold <= 0.0 {
        return f64::INFINITY;
    }
    let n = problem.clusters.iter().map(|c| c.n_rows as f64).sum::<f64>();
    let size = (n * noise_square * (threshold.powi(-2) - 1.0) / energy).sqrt();
    let se = |k: usize| jackknife_se(&scored.fold_theta.iter().map(|t| t[k]).collect::<Vec<_>>());
    let se = of_unit.iter().map(|&k| se(k).powi(2)).sum::<f64>().sqrt() / (of_unit.len() as f64).sqrt();
    size + 0.84 * if se.is_finite() { se.min(size) } else { 0.0 }
}

/// Columns of an effect, cluster by cluster, and the signal that its fitted coefficients give.
struct FittedColumns {
    columns: Vec<DMatrix<f64>>,
    signal: Vec<DVector<f64>>,
}

/// Fills in the confusions: every accepted effect against all others, the rest against the best.
pub(crate) fn confusions(
    session: &Session<'_>,
    problem: &Problem,
    scores: &[EffectScore<'_>],
    candidates: &mut [Candidate],
    options: &DiscoverOptions,
) {
    let made: Vec<Option<FittedColumns>> = scores
        .par_iter()
        .map(|s| {
            let best = &s.scored[s.best];
            let columns = best.variant.columns(session, problem).filter(|_| !s.placebo)?;
            let signal = columns.iter().map(|c| c * &best.theta).collect();
            Some(FittedColumns { columns, signal })
        })
        .collect();
    let all: Vec<Vec<Confusion>> = (0..scores.len())
        .into_par_iter()
        .map(|a| {
            if scores[a].placebo {
                return Vec::new();
            }
            let mut out = Vec::new();
            for b in (0..scores.len()).filter(|&b| b != a && !scores[b].placebo) {
                let (Some(one), Some(other)) = (&made[a], &made[b]) else { continue };
                let cosine = cosine(problem, &one.signal, &other.columns);
                if cosine > 0.9 {
                    let (ea, eb) = (&scores[a].fold_error, &scores[b].fold_error);
                    let ahead = ea.iter().sum::<f64>() <= eb.iter().sum::<f64>();
                    let (better, worse) = if ahead { (ea, eb) } else { (eb, ea) };
                    out.push(Confusion {
                        effect: scores[b].effect.id().to_owned(),
                        cosine,
                        p_value: sign_flip_p(better, worse, 1000, options.seed),
                        separate_by: scores[a].effect.about().told_apart_by(&scores[b].effect.about()).to_owned(),
                    });
                }
            }
            out.sort_by(|p, q| q.cosine.total_cmp(&p.cosine));
            out
        })
        .collect();
    for (candidate, confused) in candidates.iter_mut().zip(all) {
        candidate.confused_with = confused;
    }
}

/// The floor of a comparison, for mean squares of rows.
pub(crate) struct AtFloor {
    pub model_error: HeldOutResult,
    /// Error of the comparison, N, over the root mean square of rows, for the same model.
    pub scale: f64,
}

impl AtFloor {
    /// True if a mean square of rows is not above the floor.
    pub fn reached_by(&self, mean_square: f64) -> bool {
        self.model_error.reached_by(mean_square.sqrt() * self.scale)
    }
    /// Root of a mean square of rows in multiples of the floor.
    pub fn times(&self, mean_square: f64) -> f64 {
        mean_square.sqrt() * self.scale / self.model_error.noise_floor
    }
}

/// Verdict and names: the accepted effects that no other one beats by more than chance and
/// repeating errors explain, the one with the fewest unknowns first.
pub(crate) fn judge(
    session: &Session<'_>,
    problem: &Problem,
    rivals: &[Rival<'_>],
    options: &DiscoverOptions,
) -> (Verdict, Vec<String>, Vec<RivalTest>) {
    let believed = || rivals.iter().filter(|r| r.believed);
    let Some(first) = believed().min_by(|a, b| a.error().total_cmp(&b.error())) else {
        let hopeless = problem.clusters.iter().filter(|c| !c.judged.is_empty()).count() < 4;
        return (if hopeless { Verdict::NotDetectable } else { Verdict::NothingMissing }, Vec::new(), Vec::new());
    };
    // a generalisation needs the same advantage as any other effect, because its extra freedom also
    // fits repeating errors
    let simpler = believed()
        .filter(|r| {
            first.scored.variant.effect.about().contains.contains(&r.id())
                && (first.error() / r.error()).sqrt() > options.belief
        })
        .min_by(|a, b| a.error().total_cmp(&b.error()));
    let best = simpler.unwrap_or(first);
    let mut rival_tests: Vec<RivalTest> = rivals
        .iter()
        .filter(|r| r.index != best.index)
        .map(|r| test_rival(session, problem, best, r, options))
        .collect();
    let unknowns = |r: &Rival<'_>| r.scored.variant.unknowns();
    // On a person errors repeat in every trial (soft tissue, the prior), and the effect with more
    // freedom fits them better whichever is true. The simplest effect that leaves no more than a
    // perfect model would is not excluded.
    let mut spared = None;
    let simplest = believed()
        .filter(|r| r.at_floor && !is_at_far_edge(session, &r.scored.variant))
        .min_by(|a, b| unknowns(a).cmp(&unknowns(b)).then(a.error().total_cmp(&b.error())));
    if let Some(test) = simplest.and_then(|r| rival_tests.iter_mut().find(|d| d.separated && d.effect == r.id())) {
        test.separated = false;
        spared = simplest.map(|r| r.index);
    }
    let mut class: Vec<&Rival<'_>> =
        rivals.iter().filter(|r| !rival_tests.iter().any(|d| d.separated && d.effect == r.id())).collect();
    // an effect that contains another one counts only if it does better; errors of a rigid body do
    // not repeat, so that its further unknowns gain nothing there by themselves
    let rigid = session.prior.is_none();
    let does_better = |r: &Rival<'_>, than: &Rival<'_>| {
        let p = || sign_flip_p(&r.fold_error, &than.fold_error, 2000, options.seed ^ 0x9e4a);
        rigid && (r.error() / than.error()).sqrt() < SAME[0] && p() < options.significance
    };
    let members: Vec<&Rival<'_>> = class.iter().copied().filter(|r| r.believed).collect();
    class.retain(|r| {
        let contains = r.scored.variant.effect.about().contains;
        members.iter().filter(|m| contains.contains(&m.id())).all(|m| does_better(r, m))
    });
    // a richer effect whose advantage over a simpler one is smaller than it would be if it were
    // true
    let falls_short = |x: &Rival<'_>, y: &Rival<'_>| {
        let made =
            |truth: &Rival<'_>| exchange(session, problem, &x.scored, &y.scored, &truth.scored, options.seed ^ 0x5407);
        made(x).is_some_and(|m| m.missed_by((y.error() / x.error()).ln(), || made(y)))
    };
    // a few flights of a rigid body say too little about what a true effect would gain
    let few = rigid && problem.clusters.len() < MANY_CLUSTERS;
    let short: Vec<usize> = class
        .iter()
        .filter(|_| !few)
        .filter(|x| {
            // one that does better flight by flight is not dropped for a small advantage
            let simpler = |y: &&Rival<'_>| {
                y.believed && Some(y.index) != spared && unknowns(x) > unknowns(y) && !does_better(x, y)
            };
            class.iter().copied().filter(simpler).any(|y| falls_short(x, y))
        })
        .map(|x| x.index)
        .collect();
    class.retain(|r| !short.contains(&r.index));
    let inside = |r: &Rival<'_>| !is_at_far_edge(session, &r.scored.variant);
    let limits: Vec<usize> = class
        .iter()
        .filter(|x| {
            let mut others = class.iter().filter(|y| y.believed && inside(y));
            if inside(x) {
                others.any(|y| is_only_a_limit(session, problem, y, x, options))
            } else {
                others.count() > 0
            }
        })
        .map(|x| x.index)
        .collect();
    for rival in class.iter().filter(|r| limits.contains(&r.index)) {
        match rival_tests.iter_mut().find(|d| d.effect == rival.id()) {
            Some(test) => test.only_as_limit = true,
            // the best one, of which there is no test
            None => rival_tests.push(RivalTest {
                effect: rival.id().to_owned(),
                error_ratio: 1.0,
                p_value: 1.0,
                if_true: None,
                separated: false,
                only_as_limit: true,
            }),
        }
    }
    class.retain(|r| !limits.contains(&r.index));
    class.sort_by(|a, b| unknowns(a).cmp(&unknowns(b)).then(a.error().total_cmp(&b.error())));
    let names: Vec<String> = class.iter().map(|r| r.id().to_owned()).collect();
    (if names.len() == 1 { Verdict::Supported } else { Verdict::OneOf }, names, rival_tests)
}

/// Whether the recordings distinguish effect `a` from effect `b`, which has the larger error.
fn test_rival(
    session: &Session<'_>,
    problem: &Problem,
    a: &Rival<'_>,
    b: &Rival<'_>,
    options: &DiscoverOptions,
) -> RivalTest {
    // errors of the motion act on the whole inertia, that of an effect included: in a model with
    // more of it the same noise leaves a larger error, which is no evidence
    let inertia = |r: &Rival<'_>| {
        let added_kg = r.scored.variant.effect.added_inertia_kg(r.scored.theta.as_slice());
        (1.0 + added_kg / session.mass_kg).max(0.1)
    };
    let scale = (inertia(b) / inertia(a)).powi(2);
    let ratio = (a.error() / b.error() * scale).sqrt();
    let of_b: Vec<f64> = b.fold_error.iter().map(|e| e / scale).collect();
    let p_value = sign_flip_p(&a.fold_error, &of_b, 2000, options.seed ^ 0xc1a5);
    let alias = is_alias(a.scored.variant.effect, a.scored.variant.target, b.id(), b.scored.variant.target);
    // more freedom fits the repeating errors of a person better, whichever effect is true
    let freer = session.prior.is_some() && a.scored.variant.unknowns() > 2 * b.scored.variant.unknowns();
    let mut out = RivalTest {
        effect: b.id().to_owned(),
        error_ratio: ratio,
        p_value,
        if_true: None,
        separated: ratio < if freer { CLEARLY } else { options.belief },
        only_as_limit: false,
    };
    // aliases differ in the scale of the error that they leave, which is no evidence for either
    if alias || ratio > SAME[usize::from(session.prior.is_some())] || p_value >= options.significance {
        out.separated = false;
    } else if session.prior.is_none() && a.scored.variant.unknowns() <= b.scored.variant.unknowns() {
        // the better one has no more freedom than the other: repeating errors do not favour it
        out.separated = true;
    } else if !out.separated {
        let made = exchange(session, problem, &a.scored, &b.scored, &b.scored, options.seed ^ 0xe8c4);
        out.if_true = made.map(|m| [m.mean, m.sd]);
        out.separated = made.map_or(ratio < NEARLY, |m| m.exceeded_by(-2.0 * ratio.ln()));
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    fn estimate(value: f64, half: Option<f64>) -> Estimate {
        Estimate {
            name: String::new(),
            value,
            se: f64::NAN,
            ci95: half.map(|h| [value - h, value + h]),
            freedom: f64::NAN,
            at_bound: false,
            widening: 1.0,
            unit: String::new(),
        }
    }

    /// What makes an effect: the force of a jet, the stiffness of a line, the mass that hangs.
    #[test]
    fn an_effect_of_which_only_what_accompanies_it_is_seen_is_told() {
        let of = |accompanying: &[&str], names: &[&str], estimates: &[Estimate]| {
            let coefficients: Vec<Coefficient> = names.iter().map(|n| Coefficient::free(*n, "1")).collect();
            accompanied(&About { accompanying, ..About::PLAIN }, &coefficients, estimates)
        };
        let zero = || estimate(1.0, Some(1.5));
        let seen = || estimate(-2.0, Some(0.5));
        let six = ["force_x", "force_y", "force_z", "moment_x", "moment_y", "moment_z"];
        let jet = |estimates: [Estimate; 6]| of(&["moment"], &six, &estimates);
        let told = [&six[..3], &["moment_z"]].map(|names| names.iter().map(|n| (*n).to_owned()).collect());
        assert_eq!(jet([zero(), zero(), zero(), zero(), zero(), seen()]), Some(told));
        assert!(jet([zero(), seen(), zero(), zero(), zero(), seen()]).is_none());
        // nothing is seen of it at all, as of a line whose anchor is unknown
        assert!(jet(std::array::from_fn(|_| zero())).is_none());
        let line = ["stiffness", "damping"];
        assert!(of(&["damping"], &line, &[zero(), seen()]).is_some());
        assert!(of(&["damping"], &line, &[estimate(3.0, Some(1.0)), seen()]).is_none());
        assert!(of(&["hanging"], &["mass", "hanging"], &[estimate(0.0, None), seen()]).is_some());
        // areas of several links all make the drag
        assert!(of(&[], &["area_link0", "area_link1"], &[zero(), seen()]).is_none());
    }

    #[test]
    fn a_vector_of_which_no_component_is_seen_is_told() {
        let force = Coefficient::vector_in_world("force", "N", 1e3);
        let of = |values: [f64; 3]| {
            let estimates = values.map(|v| estimate(v, Some(1.0)));
            no_component_is_seen(&About::PLAIN, &force, &estimates)
        };
        assert!(of([0.5, -0.2, 0.9]));
        assert!(!of([0.5, -2.4, 0.9]));
        let areas = ["a", "b", "c"].map(|n| Coefficient::free(n, "m^2"));
        let zero = [0.1, 0.1, 0.1].map(|v| estimate(v, Some(1.0)));
        assert!(!no_component_is_seen(&About::PLAIN, &areas, &zero));
    }

    #[test]
    fn an_effect_whose_size_may_be_zero_is_told() {
        let of = |accompanying: &[&str], names: &[&str], estimates: &[Estimate]| {
            let coefficients: Vec<Coefficient> = names.iter().map(|n| Coefficient::free(*n, "1")).collect();
            may_be_zero(&About { accompanying, ..About::PLAIN }, &coefficients, estimates)
        };
        let zero = || estimate(1.0, Some(1.5));
        let line = ["stiffness", "damping"];
        assert_eq!(of(&["damping"], &line, &[zero(), zero()]), Some("stiffness".to_owned()));
        assert!(of(&["damping"], &line, &[estimate(3.0, Some(1.0)), zero()]).is_none());
        assert!(of(&["damping"], &line, &[estimate(3.0, None), zero()]).is_none());
        // each area may be zero, both together not
        assert!(of(&[], &["area_link0", "area_link1"], &[zero(), zero()]).is_none());
    }
}
