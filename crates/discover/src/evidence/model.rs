//! The rows with the effects of a model in them: flights and contact together, in units of the
//! noise.

use super::explanation::Explanation;
use super::likelihood::Likelihood;
use super::noise::InNoiseUnits;
use crate::DiscoverError;
use crate::candidate::Variant;
use crate::ladder::extra_columns;
use crate::options::DiscoverOptions;
use crate::problem::{Cluster, RowErrors};
use crate::problem::{Domain, Problem};
use crate::result::Found;
use crate::session::Session;
use aloft_effects::{Effect, EffectInstance};
use aloft_regressor::StretchKind;
use nalgebra::{DMatrix, DVector};

/// Half of what groups of columns differ by, by group and block; without those that one side lacks.
fn half(ahead: &[Vec<DMatrix<f64>>], behind: &[Vec<DMatrix<f64>>]) -> Vec<Vec<DMatrix<f64>>> {
    ahead.iter().zip(behind).map(|(a, b)| a.iter().zip(b).map(|(a, b)| (a - b) * 0.5).collect()).collect()
}

/// The problem of a model, and what explanations beside it are worth.
pub(super) struct Model<'a> {
    pub units: &'a InNoiseUnits<'a>,
    pub session: &'a Session<'a>,
    pub problem: Problem,
    /// The rows of flights alone, which are fewer, if there are others.
    pub flights: Option<Problem>,
    pub likelihood: Likelihood,
    /// What drawn errors of the motion change in the columns of the model's effects, by draw,
    /// group of columns and block.
    errors: Vec<Vec<Vec<DMatrix<f64>>>>,
}

impl<'a> Model<'a> {
    /// Rows with accepted effects and those found so far, the slopes of their nonlinear unknowns
    /// and the errors that all recordings share.
    pub fn of(
        units: &'a InNoiseUnits<'a>,
        accepted: &[EffectInstance<'_>],
        kept: &[Explanation<'_>],
        found: &[Found],
        options: &DiscoverOptions,
    ) -> Result<Self, DiscoverError> {
        let session = &units.session;
        let variants: Vec<_> = kept.iter().map(|k| k.variant.clone()).collect();
        let mut extra = extra_columns(session, Domain::Both, accepted, &variants, found);
        let along = |s: &Session<'_>| extra_columns(s, Domain::Both, accepted, &variants, found);
        let errors: Vec<_> =
            session.disturbed.iter().map(|[ahead, behind]| half(&along(ahead), &along(behind))).collect();
        let free: usize = extra.iter().map(|e| e[0].ncols()).sum();
        let shared = units.shared[0].ncols();
        extra.push(units.shared.clone());
        let of_domain = |domain| {
            let problem = Problem::with_variance(session, domain, &extra, options.fewest_trials, 1.0, Some(1.0))?;
            // columns have unit length: a coefficient of unit variance has that of the length
            let mut ridge = problem.ridge.clone();
            let first = ridge.len() - shared;
            for c in 0..shared {
                let square: f64 = units.shared.iter().map(|m| m.column(c).norm_squared()).sum();
                ridge[first + c] = if square > 0.0 { square.recip() } else { 1.0 };
            }
            problem.with_ridge(ridge)
        };
        let problem = of_domain(Domain::Both)?;
        let has = |contact: bool| {
            session.blocks.iter().any(|b| b.y.nrows() > 0 && (b.kind == StretchKind::Contact) == contact)
        };
        let flights = if has(true) && has(false) { session.or_named(of_domain(Domain::Flight)) } else { None };
        let of_body = if session.prior.is_some() { 0 } else { session.blocks[0].y.ncols() - 1 };
        let likelihood = Likelihood { n: units.rows.saturating_sub(free + of_body) as f64 };
        Ok(Self { units, session, problem, flights, likelihood, errors })
    }

    /// What drawn errors of the motion change in the columns of a variant, and in the rows beside
    /// them, by draw and cluster; none where no motion is drawn.
    pub fn row_errors(&self, variant: &Variant<'_>) -> Vec<Vec<RowErrors>> {
        let at = |s: &Session<'_>| variant.blocks_at(s, &self.problem, &variant.nonlinear);
        let of_draw = |d: usize| -> Option<Vec<RowErrors>> {
            let [ahead, behind] = &self.session.disturbed[d];
            let columns = half(&[at(ahead)?], &[at(behind)?]).pop()?;
            Some(self.problem.clusters.iter().map(|cluster| self.of_cluster(d, cluster, &columns)).collect())
        };
        (0..self.units.errors.len()).filter_map(of_draw).collect()
    }

    fn of_cluster(&self, draw: usize, cluster: &Cluster, columns: &[DMatrix<f64>]) -> RowErrors {
        let (of_rows, of_effects) = (&self.units.errors[draw], &self.errors[draw]);
        let (n, k, m) = (cluster.b.len(), columns[0].ncols(), self.problem.norms.len());
        let p = of_rows[cluster.blocks[0]].rows.ncols();
        let mut out =
            RowErrors { rows: DMatrix::zeros(n, p + m), measured: DVector::zeros(n), columns: DMatrix::zeros(n, k) };
        let mut at = 0;
        for &i in &cluster.blocks {
            let block = &self.session.blocks[i];
            let h = of_rows[i].measured.len();
            if h > 0 {
                out.rows.view_mut((at, 0), (h, p)).copy_from(&of_rows[i].rows);
                out.measured.rows_mut(at, h).copy_from(&of_rows[i].measured);
                out.columns.rows_mut(at, h).copy_from(&block.as_measured_of(&columns[i]));
                let mut column = 0;
                for group in of_effects {
                    let own = block.as_measured_of(&group[i]);
                    for (own, norm) in own.column_iter().zip(self.problem.norms.iter().skip(column)) {
                        out.rows.view_mut((at, p + column), (h, 1)).copy_from(&(own * *norm));
                        column += 1;
                    }
                }
            }
            at += h;
        }
        out
    }

    /// True if these recordings can show an effect. Without flights errors of the plates and of the
    /// stated mass alone: what acts in the air, too, cannot be told from them on the plates.
    pub fn may_show(&self, effect: &dyn Effect) -> bool {
        let acts = effect.acts();
        let flights = self.session.blocks.iter().any(|b| b.kind != StretchKind::Contact);
        !acts.in_joints() && (flights || !acts.in_flight())
    }

    /// Root mean square of what the model leaves, in units of the noise.
    pub fn left(&self) -> f64 {
        self.likelihood.in_noise(self.problem.rss)
    }
}
