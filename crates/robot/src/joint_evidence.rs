//! What held-out flights say of each joint's torque: rows over short windows, predicted from the
//! other flights together with the base rows.
//!
//! The base rows determine the body; the rows of one joint beside them determine its reflected
//! inertia, friction and gain. What they leave in flights that took no part is the held-out error
//! of that joint, N·m. [`JointFolds::reduced`] prepares the test of further columns: everything
//! that body and joint explain is projected out of them, once for each flight that is left out.

use crate::joint_fit::{EFFECT_SD, body_prior, spread};
use crate::model::RobotModel;
use crate::normal::{Normal, Solver};
use crate::torque::{TorqueRows, UNKNOWNS};
use aloft_body::BaseParameters;
use aloft_effects::EffectInstance;
use aloft_identify::Prior;
use aloft_regressor::Factor;
use nalgebra::{DMatrix, DVector};

/// Length of windows, s: shorter than for identification, because laws of friction act near rest.
pub const WINDOW_S: f64 = 0.12;
/// Recordings are the unit of evidence if there are at least this many, flights otherwise.
const FEWEST_TRIALS: usize = 6;

/// Rows of one joint in one flight, as torques: N·m, or N for a slide.
#[derive(Debug, Clone)]
pub struct JointBlock {
    /// Recording.
    pub trial: String,
    /// Index of the flight in it.
    pub flight: usize,
    /// Columns of the body (base parameters, effects of the base rows), then [`UNKNOWNS`], then
    /// laws in the model.
    pub x: DMatrix<f64>,
    /// Measured torque.
    pub y: DVector<f64>,
    /// Columns to try.
    pub candidates: DMatrix<f64>,
    /// Stated standard deviation of the rows.
    pub sd: f64,
}

/// A flight whose torques can be judged.
#[derive(Debug)]
pub struct JointFlight {
    /// Recording.
    pub trial: String,
    /// Index of the flight in it.
    pub flight: usize,
    /// Its rows.
    pub rows: TorqueRows,
    /// Effects of the base rows that are a change of inertia, as
    /// [`crate::torque::TorqueEffects::carried`].
    pub carried: Vec<(String, Option<DVector<f64>>)>,
    /// Windows of each joint in which it moves, and the share of them near rest: see [`moving`].
    pub moving: Vec<Vec<(usize, f64)>>,
}

/// Largest share of a window near rest.
const MOST_AT_REST: f64 = 0.05;

/// Windows of each joint that are judged, each with its share near rest. A joint that sticks takes
/// any torque up to its friction, so that windows with more than a twentieth near rest are left
/// out.
pub fn moving(rows: &TorqueRows) -> Vec<Vec<(usize, f64)>> {
    let of =
        |j: usize| rows.at_rest(j).iter().copied().enumerate().filter(|(_, share)| *share <= MOST_AT_REST).collect();
    (0..rows.n_joints()).map(of).collect()
}

impl JointFlight {
    /// The rows of windows that are judged.
    fn kept(&self, j: usize, all: &DMatrix<f64>) -> DMatrix<f64> {
        let at: Vec<usize> = self.moving[j].iter().map(|m| m.0).collect();
        all.select_rows(&at)
    }

    fn columns(
        &self,
        j: usize,
        links: &DMatrix<f64>,
        to_full: &DMatrix<f64>,
        laws: &[EffectInstance<'_>],
    ) -> DMatrix<f64> {
        let body = links * to_full;
        let mut columns: Vec<DVector<f64>> = body.column_iter().map(|c| c.into_owned()).collect();
        let nothing = || DVector::zeros(body.nrows());
        columns.extend(self.carried.iter().map(|(_, c)| c.as_ref().map_or_else(nothing, |c| &body * c)));
        columns.extend(self.rows.own(j));
        columns.extend(self.laws(j, laws));
        if columns.is_empty() {
            DMatrix::zeros(body.nrows(), 0)
        } else {
            DMatrix::from_columns(&columns) / self.rows.area_s()
        }
    }

    fn laws(&self, j: usize, laws: &[EffectInstance<'_>]) -> Vec<DVector<f64>> {
        let own = |law: &EffectInstance<'_>| {
            self.rows.law(law).into_iter().filter(|(at, _)| *at == j).map(|(_, c)| c).collect::<Vec<_>>()
        };
        laws.iter().flat_map(own).collect()
    }

    /// Rows of a joint with the laws of the model and columns to try; both act on this joint.
    pub fn block(
        &self,
        j: usize,
        base: &BaseParameters,
        laws: &[EffectInstance<'_>],
        candidates: &[EffectInstance<'_>],
    ) -> JointBlock {
        let area = self.rows.area_s();
        let tried = self.laws(j, candidates);
        let windows = self.rows.n_windows();
        let weights = self.rows.weights(j);
        let variance = weights.iter().map(|w| (w * area).powi(-2)).sum::<f64>() / windows.max(1) as f64;
        let candidates =
            if tried.is_empty() { DMatrix::zeros(windows, 0) } else { DMatrix::from_columns(&tried) / area };
        let y = self.rows.measured(j) / area;
        JointBlock {
            trial: self.trial.clone(),
            flight: self.flight,
            x: self.kept(j, &self.columns(j, &self.rows.links(j), &base.to_full, laws)),
            y: DVector::from_iterator(self.moving[j].len(), self.moving[j].iter().map(|m| y[m.0])),
            candidates: self.kept(j, &candidates),
            sd: variance.sqrt(),
        }
    }

    /// What given unknowns leave in a joint's rows, N·m.
    pub fn left(&self, j: usize, base: &BaseParameters, laws: &[EffectInstance<'_>], x: &DVector<f64>) -> DVector<f64> {
        // the body's parameters once instead of all columns
        let (p, carried) = (base.len(), self.carried.len());
        let mut body = x.rows(0, p).into_owned();
        for (k, (_, change)) in self.carried.iter().enumerate() {
            if let Some(change) = change {
                body += change * x[p + k];
            }
        }
        let mut out = self.rows.measured(j) - self.rows.links(j) * (&base.to_full * body);
        let own = self.rows.own(j).into_iter().chain(self.laws(j, laws));
        for (k, column) in own.enumerate() {
            out -= column * x[p + carried + k];
        }
        out /= self.rows.area_s();
        DVector::from_iterator(self.moving[j].len(), self.moving[j].iter().map(|m| out[m.0]))
    }

    /// Sum of squares that sticking may leave in the windows of a joint: within its share near rest
    /// friction is anywhere between plus and minus its size.
    pub fn sticking(&self, j: usize, friction: f64) -> f64 {
        self.moving[j].iter().map(|m| (friction * m.1).powi(2) / 3.0).sum()
    }
}

/// One joint.
#[derive(Debug, Clone)]
pub struct JointEvidence {
    /// Name.
    pub name: String,
    /// Link that it carries.
    pub link: usize,
    /// Flights.
    pub blocks: Vec<JointBlock>,
}

/// What the base rows say of the body, flight by flight.
#[derive(Debug, Clone)]
pub struct BodyEvidence {
    prior: Normal,
    flights: Vec<(String, usize, Normal)>,
    parameters: usize,
    n: usize,
}

impl BodyEvidence {
    /// From the factors of flights, in columns `[φ_B | effects | measured]`. None if the prior
    /// cannot be used.
    pub fn of(prior: &Prior, mass_kg: f64, factors: &[Factor], row_sd: f64) -> Option<Self> {
        let n = factors.first()?.columns.len() - 1;
        let flights = factors
            .iter()
            .filter(|f| f.columns.len() == n + 1)
            .map(|f| {
                let mut normal = Normal::zeros(n);
                normal.add(f, row_sd.powi(-2));
                (f.trial.clone(), f.stretch, normal)
            })
            .collect();
        Some(Self { prior: body_prior(prior, mass_kg, n)?, flights, parameters: prior.mean.len(), n })
    }

    /// Number of unknowns of the body.
    pub fn unknowns(&self) -> usize {
        self.n
    }
}

/// One flight (or recording) left out, with everything that the rest explains projected out.
#[derive(Debug, Clone)]
pub struct ReducedFold {
    /// Information of the candidates' columns in the rest.
    pub s: DMatrix<f64>,
    /// Its right-hand side.
    pub t: DVector<f64>,
    /// What the rest leaves in the rows that were left out, N·m.
    pub residual: DVector<f64>,
    /// The same of the candidates' columns.
    pub columns: DMatrix<f64>,
    /// `t` of residuals of the whole fit, by cluster whose signs are kept.
    pub null_t: DMatrix<f64>,
    /// `residual` of them.
    pub null_residual: DMatrix<f64>,
}

/// The evidence of one joint, ready to test columns.
#[derive(Debug)]
pub struct JointFolds<'a> {
    joint: &'a JointEvidence,
    clusters: Vec<Vec<usize>>,
    by_trial: bool,
    prior: Normal,
    body: Vec<Normal>,
    own: Vec<Normal>,
    all_body: Normal,
    all_own: Normal,
    weight: f64,
    solution: DVector<f64>,
}

/// Fewest clusters of which one can be left out.
const FEWEST_CLUSTERS: usize = 3;

impl<'a> JointFolds<'a> {
    /// Fits a joint beside the body. None with fewer than three flights, or if the rows cannot be
    /// solved.
    pub fn of(joint: &'a JointEvidence, body: &BodyEvidence, robot: &RobotModel) -> Option<Self> {
        let first = joint.blocks.first()?;
        let n = first.x.ncols();
        let nominal = robot.joint(&joint.name)?;
        let mut trials: Vec<&str> = joint.blocks.iter().map(|b| b.trial.as_str()).collect();
        trials.dedup();
        let by_trial = trials.len() >= FEWEST_TRIALS;
        let clusters: Vec<Vec<usize>> = if by_trial {
            let of = |t: &&str| (0..joint.blocks.len()).filter(|&i| joint.blocks[i].trial == *t).collect();
            trials.iter().map(of).collect()
        } else {
            (0..joint.blocks.len()).map(|i| vec![i]).collect()
        };
        if clusters.len() < FEWEST_CLUSTERS || n < body.n + UNKNOWNS.len() {
            return None;
        }
        let mut prior = Normal::zeros(n);
        place(&mut prior, &body.prior, 1.0);
        // flights without rows of this joint say what the body is, too
        let own = |f: &(String, usize, Normal)| joint.blocks.iter().any(|b| b.trial == f.0 && b.flight == f.1);
        body.flights.iter().filter(|f| !own(f)).for_each(|f| place(&mut prior, &f.2, 1.0));
        for at in (body.parameters..body.n).chain(body.n + UNKNOWNS.len()..n) {
            prior.matrix[(at, at)] += EFFECT_SD.powi(-2);
        }
        let values = [nominal.armature, nominal.damping, nominal.friction, 0.0, 0.0];
        for (k, (value, sd)) in values.iter().zip(spread(nominal)).enumerate() {
            prior.matrix[(body.n + k, body.n + k)] += sd.powi(-2);
            prior.right[body.n + k] += value * sd.powi(-2);
        }
        let of_body = |members: &Vec<usize>| {
            let mut out = Normal::zeros(n);
            for &i in members {
                let block = &joint.blocks[i];
                for (_, _, flight) in body.flights.iter().filter(|f| f.0 == block.trial && f.1 == block.flight) {
                    place(&mut out, flight, 1.0);
                }
            }
            out
        };
        let of_own = |members: &Vec<usize>| {
            let mut out = Normal::zeros(n);
            for &i in members {
                let (x, y) = (&joint.blocks[i].x, &joint.blocks[i].y);
                out.matrix += x.transpose() * x;
                out.right += x.transpose() * y;
            }
            out
        };
        let rows: usize = joint.blocks.iter().map(|b| b.y.len()).sum();
        let variance = joint.blocks.iter().map(|b| b.sd * b.sd * b.y.len() as f64).sum::<f64>() / rows.max(1) as f64;
        let all = |parts: &[Normal]| parts.iter().fold(Normal::zeros(n), |sum, part| sum.plus(part, 1.0));
        let (body, own): (Vec<Normal>, Vec<Normal>) =
            (clusters.iter().map(of_body).collect(), clusters.iter().map(of_own).collect());
        let mut out = Self {
            joint,
            all_body: all(&body),
            all_own: all(&own),
            body,
            own,
            clusters,
            by_trial,
            prior,
            weight: variance.recip(),
            solution: DVector::zeros(n),
        };
        // the scale of the rows, once and for all: their spread where that is larger than stated
        for _ in 0..2 {
            out.solution =
                Solver::of(&out.without(None).matrix)?.solve(&column(&out.without(None).right)).column(0).into_owned();
            let squares: f64 = out.left().iter().map(DVector::norm_squared).sum();
            out.weight = variance.max(squares / rows.max(1) as f64).recip();
        }
        Some(out)
    }

    /// Normal equations of all clusters but one.
    fn without(&self, cluster: Option<usize>) -> Normal {
        let out = self.prior.plus(&self.all_body, 1.0).plus(&self.all_own, self.weight);
        let Some(g) = cluster else { return out };
        out.plus(&self.body[g], -1.0).plus(&self.own[g], -self.weight)
    }

    /// What the whole fit leaves, by cluster.
    fn left(&self) -> Vec<DVector<f64>> {
        let of = |members: &Vec<usize>| {
            let parts: Vec<f64> = members
                .iter()
                .flat_map(|&i| {
                    let b = &self.joint.blocks[i];
                    (&b.y - &b.x * &self.solution).iter().copied().collect::<Vec<_>>()
                })
                .collect();
            DVector::from_vec(parts)
        };
        self.clusters.iter().map(of).collect()
    }

    /// Unknowns of body and joint from all flights.
    pub fn solution(&self) -> &DVector<f64> {
        &self.solution
    }

    /// True if whole recordings are left out, false for flights.
    pub fn by_trial(&self) -> bool {
        self.by_trial
    }

    /// Number of rows.
    pub fn rows(&self) -> usize {
        self.joint.blocks.iter().map(|b| b.y.len()).sum()
    }

    /// Columns of a cluster's blocks, stacked.
    fn stacked(&self, g: usize, of: impl Fn(&JointBlock) -> &DMatrix<f64>) -> DMatrix<f64> {
        let width = self.clusters[g].first().map_or(0, |&i| of(&self.joint.blocks[i]).ncols());
        let height = self.clusters[g].iter().map(|&i| self.joint.blocks[i].y.len()).sum();
        let mut out = DMatrix::zeros(height, width);
        let mut at = 0;
        for &i in &self.clusters[g] {
            let part = of(&self.joint.blocks[i]);
            out.rows_mut(at, part.nrows()).copy_from(part);
            at += part.nrows();
        }
        out
    }

    /// Root mean square of what flights that were left out keep, N·m; none if a fold cannot be
    /// solved.
    pub fn held_out_nm(&self) -> Option<f64> {
        let mut squares = 0.0;
        for g in 0..self.clusters.len() {
            let rest = self.without(Some(g));
            let x = Solver::of(&rest.matrix)?.solve(&column(&rest.right)).column(0).into_owned();
            for &i in &self.clusters[g] {
                let b = &self.joint.blocks[i];
                squares += (&b.y - &b.x * &x).norm_squared();
            }
        }
        Some((squares / self.rows().max(1) as f64).sqrt())
    }

    /// All folds, the last with nothing left out; candidates that body and joint explain completely
    /// have no information.
    pub fn reduced(&self) -> Option<Vec<ReducedFold>> {
        let n = self.clusters.len();
        let x: Vec<DMatrix<f64>> = (0..n).map(|g| self.stacked(g, |b| &b.x)).collect();
        let c: Vec<DMatrix<f64>> = (0..n).map(|g| self.stacked(g, |b| &b.candidates)).collect();
        let left = self.left();
        let w = self.weight;
        let cross: Vec<DMatrix<f64>> = (0..n).map(|g| x[g].transpose() * &c[g] * w).collect();
        let squares: Vec<DMatrix<f64>> = (0..n).map(|g| c[g].transpose() * &c[g] * w).collect();
        let of_x: Vec<DVector<f64>> = (0..n).map(|g| x[g].transpose() * &left[g] * w).collect();
        let of_c: Vec<DVector<f64>> = (0..n).map(|g| c[g].transpose() * &left[g] * w).collect();
        let y = |g: usize| -> DVector<f64> { &left[g] + &x[g] * &self.solution };
        let measured: Vec<DVector<f64>> = (0..n).map(|g| c[g].transpose() * y(g) * w).collect();
        let k = c.first()?.ncols();
        (0..=n)
            .map(|out| {
                let fold = (out < n).then_some(out);
                let rest = self.without(fold);
                let solver = Solver::of(&rest.matrix)?;
                let plain = solver.solve(&column(&rest.right)).column(0).into_owned();
                let kept = || (0..n).filter(move |g| Some(*g) != fold);
                let sum =
                    |parts: &[DMatrix<f64>]| kept().fold(DMatrix::zeros(parts[0].nrows(), k), |s, g| s + &parts[g]);
                let crossed = sum(&cross);
                let z = solver.solve(&crossed);
                let s = sum(&squares) - crossed.transpose() * &z;
                let t = kept().fold(DVector::zeros(k), |t, g| t + &measured[g]) - crossed.transpose() * &plain;
                let mut null_t = DMatrix::zeros(k, n);
                for g in kept() {
                    null_t.set_column(g, &(&of_c[g] - z.transpose() * &of_x[g]));
                }
                let Some(f) = fold else {
                    let nothing = DMatrix::zeros(0, n);
                    return Some(ReducedFold {
                        s,
                        t,
                        residual: DVector::zeros(0),
                        columns: DMatrix::zeros(0, k),
                        null_t,
                        null_residual: nothing,
                    });
                };
                let mut by_cluster = DMatrix::zeros(self.solution.len(), n);
                for g in kept() {
                    by_cluster.set_column(g, &of_x[g]);
                }
                let mut null_residual = -(&x[f] * solver.solve(&by_cluster));
                null_residual.set_column(f, &left[f]);
                let residual = &left[f] + &x[f] * (&self.solution - &plain);
                Some(ReducedFold { s, t, residual, columns: &c[f] - &x[f] * z, null_t, null_residual })
            })
            .collect()
    }
}

/// Floor from draws of the errors, each a sum of squares over a number of rows: geometric mean of
/// their root mean squares, and the 95 % interval in which that of another set of recordings lies.
/// None with fewer than two draws.
pub fn floor_of_draws(draws: &[(f64, usize)]) -> Option<(f64, [f64; 2])> {
    let logs: Vec<f64> = draws.iter().filter(|d| d.1 > 0).map(|d| 0.5 * (d.0 / d.1 as f64).ln()).collect();
    let n = logs.len() as f64;
    if logs.len() < 2 || logs.iter().any(|l| !l.is_finite()) {
        return None;
    }
    let mean = logs.iter().sum::<f64>() / n;
    let variance = logs.iter().map(|l| (l - mean).powi(2)).sum::<f64>() / (n - 1.0);
    let reach = (aloft_signal::t975(n - 1.0) * (variance * (1.0 + 1.0 / n)).sqrt()).exp();
    let floor = mean.exp();
    Some((floor, [floor / reach, floor * reach]))
}

/// Adds a smaller system to the first unknowns of a larger one.
fn place(to: &mut Normal, from: &Normal, weight: f64) {
    let n = from.right.len();
    let mut view = to.matrix.view_mut((0, 0), (n, n));
    view += &from.matrix * weight;
    let mut right = to.right.rows_mut(0, n);
    right += &from.right * weight;
}

fn column(v: &DVector<f64>) -> DMatrix<f64> {
    DMatrix::from_column_slice(v.len(), 1, v.as_slice())
}
