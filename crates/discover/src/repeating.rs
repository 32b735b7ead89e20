//! Errors that repeat from trial to trial and therefore do not show in the scatter of a coefficient
//! over trials.
//!
//! The prior of the inertial parameters is the same in every trial, and so is its error. A standard
//! error is therefore at least that of the joint posterior, `√(σ²[S⁻¹]ₖₖ)` per independent row.
//!
//! Soft tissue displacement follows the posture, and jumps resemble each other: markers slide the
//! same way in every trial. The slide, linear in the angles of each joint, is modelled as a random
//! number `δ ~ N(0, τ²)` (m/rad) per joint, angle and axis. τ is estimated from the rows (type II
//! maximum likelihood, with the inertial parameters and the model's effects projected out; MacKay,
//! Neural Computation 4, 1992, 415-447), and the change of a coefficient caused by `δ` is `S⁻¹ Cᵀ D
//! δ`, with the Gram matrix `S = CᵀC` and the columns `D` of the slides not explained by the model.
//!
//! The geometry of the calibrated body is the same in every trial, too. The comparison draws what
//! the markers leave open of it ([`TrialDraws`](crate::TrialDraws)); a standard error is at least
//! what these draws cause.

use crate::candidate::{Variant, pseudo_inverse};
use crate::options::DiscoverOptions;
use crate::problem::{Domain, OVERLAP, Problem};
use crate::result::Estimate;
use crate::session::Session;
use aloft_effects::{EFFECTS, Effect, Target};
use aloft_identify::{half_of, satterthwaite};
use nalgebra::{DMatrix, DVector};
use rayon::prelude::*;

/// Values of τ²/σ² that are tried, a factor of 2 apart.
const GRID: std::ops::Range<i32> = -20..60;

/// Columns of the repeating errors (markers that slide on every link), by block; `None` if no joint
/// turns or only stored rows are available.
fn slides(session: &Session<'_>, domain: Domain) -> Option<Vec<DMatrix<f64>>> {
    let repeating = EFFECTS.iter().copied().filter(|e| e.about().usual_sd > 0.0);
    let slides = |(e, target): &(&dyn Effect, Target)| {
        e.coefficients(session.scene, *target).first().is_some_and(|c| c.unit == "m/rad")
    };
    let all: Vec<(&dyn Effect, Target)> = repeating
        .flat_map(|e| e.targets(session.scene).into_iter().map(move |target| (e, target)))
        .filter(slides)
        .collect();
    let of_links: Vec<Vec<DMatrix<f64>>> =
        all.into_par_iter().filter_map(|(effect, target)| session.columns(effect, target, &[], domain)).collect();
    let width: usize = of_links.iter().map(|c| c[0].ncols()).sum();
    (width > 0).then(|| {
        (0..session.blocks.len())
            .map(|b| {
                let mut wide = DMatrix::zeros(of_links[0][b].nrows(), width);
                let mut at = 0;
                for c in &of_links {
                    wide.columns_mut(at, c[b].ncols()).copy_from(&c[b]);
                    at += c[b].ncols();
                }
                wide
            })
            .collect()
    })
}

/// τ² of the slides, estimated with the complete model, (m/rad)².
fn slide_variance(problem: &Problem, slides: &[DMatrix<f64>]) -> f64 {
    let (s, c) = problem.reduce_all(&problem.gather(slides));
    let eigen = s.symmetric_eigen();
    let z = eigen.eigenvectors.tr_mul(&c);
    let seen: Vec<(f64, f64)> =
        eigen.eigenvalues.iter().zip(z.iter()).filter(|(l, _)| **l > 0.0).map(|(l, z)| (*l, z * z)).collect();
    // windows overlap, so there are fewer independent rows, with the same variance each
    let n = problem.clusters.iter().map(|c| c.n_rows as f64).sum::<f64>();
    let score = |ratio: f64| {
        let gain: f64 = seen.iter().map(|(l, z)| ratio * z / (1.0 + ratio * l)).sum();
        let variance = ((problem.rss - gain) / n).max(f64::MIN_POSITIVE);
        let spread: f64 = seen.iter().map(|(l, _)| (ratio * l / OVERLAP).ln_1p()).sum();
        (n / OVERLAP * variance.ln() + spread, ratio * variance)
    };
    let scale = seen.iter().map(|(l, _)| l).fold(0.0f64, |a, l| a.max(*l));
    if scale == 0.0 {
        return 0.0;
    }
    let plain = score(0.0).0;
    GRID.map(|e| score(2f64.powi(e) / scale * OVERLAP))
        .min_by(|a, b| a.0.total_cmp(&b.0))
        .filter(|best| best.0 < plain)
        .map_or(0.0, |best| best.1)
}

/// Columns of an effect with their slopes, and what the model leaves undetermined of them.
struct Own {
    /// Columns `[C | ∂(Cθ)/∂p]` by cluster.
    columns: Vec<DMatrix<f64>>,
    /// Inverse of their Gram matrix.
    inverse: DMatrix<f64>,
    /// Variance that slides cause in each unknown.
    slides: Vec<f64>,
}

impl Own {
    fn new(
        session: &Session<'_>,
        domain: Domain,
        without: &Problem,
        complete: &Problem,
        columns: Vec<DMatrix<f64>>,
    ) -> Self {
        let k = columns[0].ncols();
        let Some(slides) = slides(session, domain) else {
            let inverse = pseudo_inverse(&without.reduce_all(&columns).0);
            return Self { columns, inverse, slides: vec![0.0; k] };
        };
        let variance = slide_variance(complete, &slides);
        let both: Vec<DMatrix<f64>> = columns
            .iter()
            .zip(without.gather(&slides))
            .map(|(c, d)| {
                let mut wide = DMatrix::zeros(c.nrows(), k + d.ncols());
                wide.columns_mut(0, k).copy_from(c);
                wide.columns_mut(k, d.ncols()).copy_from(&d);
                wide
            })
            .collect();
        let (s, _) = without.reduce_all(&both);
        let inverse = pseudo_inverse(&s.view((0, 0), (k, k)).into_owned());
        let reach = &inverse * s.view((0, k), (k, s.ncols() - k));
        let slides = (0..k).map(|i| variance * reach.row(i).norm_squared()).collect();
        Self { columns, inverse, slides }
    }
}

/// Increases the standard errors of an effect by the errors that repeat: `others` are the columns
/// of the rest of the model, `whole` those of all of it, and `further` says for each draw what the
/// geometry changes in the rows because the effect depends on it. The factors of the intervals go
/// into [`Estimate::widening`], so that the model gives intervals that are as wide.
pub(crate) fn widen(
    session: &Session<'_>,
    domain: Domain,
    others: &[Vec<DMatrix<f64>>],
    whole: &[Vec<DMatrix<f64>>],
    variant: &Variant<'_>,
    (coefficients, nonlinear): (&mut [Estimate], &mut [Estimate]),
    further: &dyn Fn(usize) -> Option<Vec<DVector<f64>>>,
    options: &DiscoverOptions,
) {
    let new = |extra, variance| {
        Problem::with_variance(session, domain, extra, options.fewest_trials, options.prior_weight, variance)
    };
    let Some(complete) = session.or_named(new(whole, None)) else { return };
    // weight the prior by the residual of the complete model
    let Some(without) = session.or_named(new(others, Some(complete.variance))) else { return };
    let theta = DVector::from_iterator(coefficients.len(), coefficients.iter().map(|e| e.value));
    let Some(columns) = crate::nonlinear::columns_and_slopes(session, &without, variant, &theta) else { return };
    let own = Own::new(session, domain, &without, &complete, columns);
    let drawn = session.drawn_deviations(&without, &own.columns, further);
    let row = if session.prior.is_some() { OVERLAP * complete.variance } else { 0.0 };
    let estimates = coefficients.iter_mut().chain(nonlinear.iter_mut());
    for (i, (e, repeats)) in estimates.zip(&own.slides).enumerate() {
        // the repeating part is estimated from many columns, the scatter over clusters from few
        let seen = ((e.se * e.se).max(row * own.inverse[(i, i)]), e.freedom);
        let drawn = drawn.as_ref().map(|(sd, freedom)| (sd[i] * sd[i], *freedom));
        // both hold the noise; the draws also hold the geometry, the same in all recordings
        let seen = drawn.filter(|d| d.0 > seen.0).unwrap_or(seen);
        let (total, freedom) = satterthwaite(&[seen, (*repeats, f64::INFINITY)]);
        let before = half_of(e.ci95);
        *e = e.clone().with_error(total.sqrt(), freedom);
        if let (Some(before), Some(after)) = (before, half_of(e.ci95))
            && after > before
            && before > 0.0
        {
            e.widening *= after / before;
        }
    }
}
