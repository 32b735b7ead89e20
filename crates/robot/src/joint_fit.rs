//! Friction, reflected inertia and gains of the joints' torques, together with the base parameters.
//!
//! The base rows determine the inertial parameters without any torque. The torque rows
//! ([`crate::torque`]) then say what the joints do; they also inform the inertial parameters, with
//! the weight at which whole recordings left out are predicted best by the base rows alone. That
//! weight is zero where the law of friction or the gains are wrong.

use crate::model::{RobotJoint, RobotModel};
use crate::normal::{Normal, Solver};
use crate::torque::{BEND, GAIN, UNKNOWNS};
use aloft_identify::{Prior, satterthwaite};
use aloft_regressor::Factor;
use nalgebra::{DMatrix, DVector};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};
use std::ops::Range;

/// Weights of torque rows that are tried, relative to rows of their own spread.
const WEIGHTS: [f64; 5] = [0.0, 0.03, 0.1, 0.3, 1.0];
/// Place of the delay among [`UNKNOWNS`].
const DELAY: usize = 4;
/// Rounds in which gain and delay are linearised about the last estimate.
const ROUNDS: usize = 4;
/// Standard deviation of a torque's gain about 1 before any motion.
const GAIN_SD: f64 = 0.05;
/// Standard deviation of a torque's delay before any motion, s.
const DELAY_SD_S: f64 = 0.005;
/// Standard deviation of an effect's coefficient before any motion, SI units.
pub(crate) const EFFECT_SD: f64 = 1e3;
/// Standard deviation of the mass from the scale, as a share.
const MASS_SD: f64 = 1e-4;

/// A value with its 95 % interval.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Estimate {
    /// Value.
    pub value: f64,
    /// 95 % interval.
    pub ci95: [f64; 2],
    /// What the model file says.
    pub nominal: f64,
}

/// One joint.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct JointEstimate {
    /// Name.
    pub name: String,
    /// Reflected inertia, kg·m² (or kg).
    pub armature: Estimate,
    /// Viscous friction, N·m·s/rad (or N·s/m).
    pub damping: Estimate,
    /// Coulomb friction, N·m (or N).
    pub friction: Estimate,
    /// Gain of the measured torque: reading over torque.
    pub gain: Estimate,
    /// Time by which the measured torque is later than the encoders, s; half a step of a drive that
    /// holds its torque from step to step, with the opposite sign.
    pub delay_s: Estimate,
}

/// Held-out error of the base rows for one weight of the torque rows.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Tried {
    /// Weight.
    pub weight: f64,
    /// Root mean square of the base rows of recordings that were left out.
    pub held_out_rms: f64,
}

/// A coefficient of a law of a joint that the model holds.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct LawEstimate {
    /// Effect, joint and coefficient: `stribeck[l_knee].extra`.
    pub name: String,
    /// Value.
    pub value: f64,
    /// 95 % interval.
    pub ci95: [f64; 2],
}

/// Result of the fit.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct JointFit {
    /// The joints, in the model's order.
    pub joints: Vec<JointEstimate>,
    /// Laws of joints in the model.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub laws: Vec<LawEstimate>,
    /// Weight of the torque rows for the inertial parameters.
    pub weight: f64,
    /// Weights that were tried.
    pub tried: Vec<Tried>,
    /// Names of the base parameters.
    pub base_names: Vec<String>,
    /// Base parameters from base and torque rows together.
    pub base: Vec<f64>,
    /// Their standard deviations.
    pub base_sd: Vec<f64>,
    /// Root mean square of the torque rows' residuals in units of their stated size: about 1 where
    /// the law of friction and the noise are as assumed.
    pub torque_ratio: f64,
    /// Number of torque rows.
    pub rows: usize,
}

/// The rows of all flights of a robot.
#[derive(Debug, Clone, Copy)]
pub struct JointRows<'a> {
    /// Base rows, one factor a flight.
    pub base: &'a [Factor],
    /// Torque rows, one factor a flight.
    pub torque: &'a [Factor],
    /// For each of them and each joint: the sum over its rows of the variance that the torque's
    /// noise has in a row ([`crate::torque::torque_factor`]).
    pub noise: &'a [Vec<f64>],
    /// Standard deviation of a base row.
    pub base_row_sd: f64,
    /// Prior of the base parameters.
    pub prior: &'a Prior,
    /// Mass from the scale, kg.
    pub mass_kg: f64,
}

/// The prior of the base parameters and the mass from the scale, as the first of `n` unknowns.
pub(crate) fn body_prior(prior: &Prior, mass_kg: f64, n: usize) -> Option<Normal> {
    let p = prior.mean.len();
    let mut out = Normal::zeros(n);
    let sd = DVector::from_fn(p, |i, _| prior.covariance[(i, i)].max(0.0).sqrt().max(1e-12));
    let correlation = DMatrix::from_fn(p, p, |i, j| {
        let c = prior.covariance[(i, j)] / (sd[i] * sd[j]);
        if i == j { 1.0 + 1e-9 } else { c }
    });
    let inverse = correlation.cholesky()?.inverse();
    let information = DMatrix::from_fn(p, p, |i, j| inverse[(i, j)] / (sd[i] * sd[j]));
    out.right.rows_mut(0, p).copy_from(&(&information * &prior.mean));
    out.matrix.view_mut((0, 0), (p, p)).copy_from(&information);
    let mass = (MASS_SD * mass_kg).powi(-2);
    out.matrix[(0, 0)] += mass;
    out.right[0] += mass * mass_kg;
    Some(out)
}

/// Standard deviations of a joint's own unknowns before any motion. Wide: data sheets of friction
/// are off by half, and a model without them says zero.
pub(crate) fn spread(joint: &RobotJoint) -> [f64; 5] {
    [joint.armature.max(0.02), joint.damping.max(0.5), joint.friction.max(0.5), GAIN_SD, DELAY_SD_S]
}

/// What is known before any motion: the prior of the base parameters, the mass, the model file's
/// joints.
fn before(robot: &RobotModel, rows: &JointRows<'_>, first: usize, n: usize) -> Option<(Normal, Vec<f64>)> {
    let p = rows.prior.mean.len();
    let mut out = body_prior(rows.prior, rows.mass_kg, n)?;
    // coefficients of effects: any value that a robot can have
    for at in (p..first).chain(first + UNKNOWNS.len() * robot.joints.len()..n) {
        out.matrix[(at, at)] += EFFECT_SD.powi(-2);
    }
    let mut nominal = Vec::new();
    for (j, joint) in robot.joints.iter().enumerate() {
        let values = [joint.armature, joint.damping, joint.friction, 0.0, 0.0];
        for (k, (value, sd)) in values.iter().zip(spread(joint)).enumerate() {
            let at = first + UNKNOWNS.len() * j + k;
            out.matrix[(at, at)] += sd.powi(-2);
            out.right[at] += value * sd.powi(-2);
        }
        nominal.extend(values);
    }
    Some((out, nominal))
}

fn squares(factors: &[&Factor], x: &DVector<f64>) -> (f64, usize) {
    factors.iter().fold((0.0, 0), |(s, n), f| {
        let part = x.rows(0, f.columns.len() - 1).into_owned();
        (s + f.sum_of_squares(&part), n + f.n_rows)
    })
}

/// Standard errors of unknowns and their degrees of freedom from the spread among flights.
///
/// With the information A of everything, A_g of flight g and P of the prior, the estimate without
/// flight g differs from the whole one by `d_g = (A − A_g)⁻¹ s_g`, with the flight's score `s_g`.
/// `Σ d_g²` is the jackknife's variance (CR3). It is scaled so that it has no bias if the rows'
/// errors are independent and of one size, `c A⁻¹ (A − P) A⁻¹ c` instead of the trace of the
/// quadratic form's matrix M. Degrees of freedom are those of Bell and McCaffrey (2002), `tr(M)² /
/// tr(M²)`. The prior's own error adds `c A⁻¹ P A⁻¹ c`.
fn spread_of(whole: &Normal, prior: &Normal, parts: &[Normal], of: Range<usize>) -> Option<Vec<(f64, f64)>> {
    let (x, inverse) = whole.solve()?;
    let (n, of) = (x.len(), of.collect::<Vec<usize>>());
    let unit = DMatrix::from_fn(n, of.len(), |i, k| f64::from(u8::from(i == of[k])));
    let by_part = parts.par_iter().map(|part| {
        let rest = Solver::of(&(&whole.matrix - &part.matrix))?;
        let score = &part.right - &part.matrix * &x;
        let moved = rest.solve(&DMatrix::from_column_slice(n, 1, score.as_slice()));
        let by = &part.matrix * rest.solve(&unit);
        let diagonal: Vec<f64> = (0..of.len()).map(|k| by.column(k).dot(&inverse.column(of[k]))).collect();
        Some((of.iter().map(|at| moved[(*at, 0)]).collect::<Vec<f64>>(), diagonal, by))
    });
    let by_part: Vec<(Vec<f64>, Vec<f64>, DMatrix<f64>)> = by_part.collect::<Option<_>>()?;
    let mut squares = vec![0.0; of.len()];
    let (mut diagonal, mut reach) = (Vec::new(), Vec::new());
    for (moved, own, by) in by_part {
        squares.iter_mut().zip(moved).for_each(|(s, m)| *s += m * m);
        diagonal.push(own);
        reach.push(by);
    }
    let turned: Vec<DMatrix<f64>> = reach.par_iter().map(|b| &inverse * b).collect();
    Some(
        of.iter()
            .enumerate()
            .map(|(k, &at)| {
                let c = inverse.column(at);
                let by_prior = c.dot(&(&prior.matrix * c)).max(0.0);
                let by_rows = (inverse[(at, at)] - by_prior).max(0.0);
                let trace: f64 = diagonal.iter().map(|d| d[k]).sum();
                let mut square = 0.0;
                for g in 0..parts.len() {
                    for h in 0..parts.len() {
                        let m = if g == h { diagonal[g][k] } else { -reach[g].column(k).dot(&turned[h].column(k)) };
                        square += m * m;
                    }
                }
                let variance = if trace > 0.0 { squares[k] * by_rows / trace } else { 0.0 };
                let freedom = if square > 0.0 { trace * trace / square } else { f64::INFINITY };
                let (sum, freedom) = satterthwaite(&[(variance, freedom), (by_prior, f64::INFINITY)]);
                (sum.sqrt(), freedom)
            })
            .collect(),
    )
}

/// Where the torque of a joint is linearised.
#[derive(Debug, Clone, Copy, Default)]
struct About {
    gain_error: f64,
    delay_s: f64,
}

/// Rows `[columns | measured]` of one flight, with the shifted torque (1 + κ) S(δ), S = M − δ M′ +
/// ½ δ² M″ − ⅙ δ³ M‴, linearised about the error κ of the gain and the delay δ of each joint. The
/// columns of the factor are −M, M′ and, the last ones, −M″ and M‴; those of κ and δ become −S and
/// −(1 + κ) S′.
fn linearised(factor: &Factor, first_own: usize, about: &[About]) -> DMatrix<f64> {
    let whole = factor.dense();
    let n = whole.ncols() - 1 - 2 * about.len();
    let mut rows = whole.columns(0, n + 1).into_owned();
    rows.set_column(n, &whole.column(whole.ncols() - 1));
    for (j, About { gain_error, delay_s }) in about.iter().enumerate() {
        let gain = first_own + UNKNOWNS.len() * j + GAIN;
        let delay = first_own + UNKNOWNS.len() * j + DELAY;
        let (first, second, third) = (whole.column(delay), whole.column(n + 2 * j), whole.column(n + 2 * j + 1));
        // S − M and S′
        let d = *delay_s;
        let change = -(first * d) - second * (0.5 * d * d) - third * (d * d * d / 6.0);
        let slope = -first - second * d - third * (0.5 * d * d);
        rows.column_mut(gain).axpy(-1.0, &change, 1.0);
        rows.set_column(delay, &(&slope * -(1.0 + gain_error)));
        rows.column_mut(n).axpy(1.0, &change, 1.0);
        rows.column_mut(n).axpy(-(1.0 + gain_error) * d, &slope, 1.0);
    }
    rows
}

/// Fits joints and base parameters. None if rows or prior cannot be solved, or no flight has
/// torques.
///
/// The measured torque is also the column of its gain, with the same noise. Least squares would
/// take that noise for torque without motion, and shrink the torque: gains come out too large by a
/// part of their interval that grows with the number of rows. The known variance is therefore
/// subtracted from the normal equations (corrected least squares; Fuller, *Measurement Error
/// Models*, 1987, ch. 2). Where flights determine a gain so badly that this leaves no information,
/// the noise stays in.
pub fn joint_fit(robot: &RobotModel, rows: &JointRows<'_>) -> Option<JointFit> {
    fit(robot, rows, 1.0).or_else(|| fit(robot, rows, 0.0))
}

/// What stays the same while gains and delays are linearised again.
struct Problem<'a> {
    robot: &'a RobotModel,
    rows: &'a JointRows<'a>,
    /// Number of unknowns, and the first of the joints' own.
    n: usize,
    first_own: usize,
    /// Share of the noise's variance that is subtracted.
    corrected: f64,
    prior: Normal,
    nominal: Vec<f64>,
    /// Base rows of each flight, weighted.
    base: Vec<Normal>,
}

/// The torques linearised, and the answer.
struct Linear {
    /// Torque rows of each flight.
    torque: Vec<Normal>,
    /// Weight of torque rows by their spread.
    unit: f64,
    x: DVector<f64>,
    /// Root mean square of what torque rows keep.
    ratio: f64,
}

fn total<'n>(n: usize, parts: impl Iterator<Item = &'n Normal>) -> Normal {
    parts.fold(Normal::zeros(n), |mut sum, part| {
        sum.matrix += &part.matrix;
        sum.right += &part.right;
        sum
    })
}

/// The fit with a share of the noise's variance subtracted.
fn fit(robot: &RobotModel, rows: &JointRows<'_>, corrected: f64) -> Option<JointFit> {
    let problem = Problem::of(robot, rows, corrected)?;
    let mut about = vec![About::default(); robot.joints.len()];
    let mut linear = problem.linear(&about)?;
    for _ in 1..ROUNDS {
        for (j, about) in about.iter_mut().enumerate() {
            let own = problem.first_own + UNKNOWNS.len() * j;
            *about = About { gain_error: linear.x[own + GAIN], delay_s: linear.x[own + DELAY] };
        }
        linear = problem.linear(&about)?;
    }
    problem.result(&linear)
}

impl<'a> Problem<'a> {
    fn of(robot: &'a RobotModel, rows: &'a JointRows<'a>, corrected: f64) -> Option<Self> {
        let p = rows.prior.mean.len();
        let columns = &rows.torque.first()?.columns;
        let bends = columns.effects.iter().filter(|name| name.ends_with(&format!(".{BEND}"))).count();
        let n = (columns.len() - 1).checked_sub(2 * bends)?;
        if bends != robot.joints.len()
            || rows.torque.iter().any(|f| f.columns != *columns)
            || rows.noise.len() != rows.torque.len()
        {
            return None;
        }
        // effects of the base rows stand before the joints' own unknowns, laws of joints after them
        let own = format!("{}.{}", robot.joints.first()?.name, UNKNOWNS[0]);
        let first_own = p + columns.effects.iter().position(|name| *name == own)?;
        if rows.base.iter().any(|f| f.columns.len() != first_own + 1) {
            return None;
        }
        let (prior, nominal) = before(robot, rows, first_own, n)?;
        let weight = rows.base_row_sd.powi(-2);
        let base = rows.base.par_iter().map(|f| {
            let mut out = Normal::zeros(n);
            out.add(f, weight);
            out
        });
        let base = base.collect();
        Some(Self { robot, rows, n, first_own, corrected, prior, nominal, base })
    }

    /// Torque rows linearised about gains and delays, and the answer with them.
    fn linear(&self, about: &[About]) -> Option<Linear> {
        let rows = self.rows;
        let flights: Vec<(DMatrix<f64>, Normal)> = rows
            .torque
            .par_iter()
            .zip(rows.noise)
            .map(|(factor, noise)| {
                let of_flight = linearised(factor, self.first_own, about);
                let mut normal = Normal::zeros(self.n);
                normal.add_rows(&of_flight, 1.0);
                for (j, variance) in noise.iter().enumerate() {
                    let gain = self.first_own + UNKNOWNS.len() * j + GAIN;
                    normal.matrix[(gain, gain)] -= self.corrected * variance;
                    normal.right[gain] += self.corrected * variance;
                }
                (of_flight, normal)
            })
            .collect();
        let left = |x: &DVector<f64>| {
            let squares = flights.iter().map(|(r, _)| (r.columns(0, self.n) * x - r.column(self.n)).norm_squared());
            let count: usize = rows.torque.iter().map(|f| f.n_rows).sum();
            (squares.sum::<f64>() / count.max(1) as f64).sqrt()
        };
        let known = self.prior.plus(&total(self.n, self.base.iter()), 1.0);
        let torque = total(self.n, flights.iter().map(|f| &f.1));
        // the spread of torque rows about the base rows' answer: their scale, once and for all
        let first = known.plus(&torque, 1e-3).solution()?;
        let unit = left(&first).max(1.0).powi(-2);
        let x = known.plus(&torque, unit).solution()?;
        let ratio = left(&x);
        Some(Linear { torque: flights.into_iter().map(|f| f.1).collect(), unit, x, ratio })
    }

    /// Values with intervals, and the weight of the torque rows for the body.
    fn result(&self, linear: &Linear) -> Option<JointFit> {
        let Self { robot, rows, n, first_own, .. } = *self;
        let p = rows.prior.mean.len();
        let columns = &rows.torque.first()?.columns;
        let Linear { torque, unit, x, ratio } = linear;
        let mut names: Vec<&str> = rows.base.iter().map(|f| f.trial.as_str()).collect();
        names.dedup();
        // with a single recording, flights are left out instead
        let groups: Vec<(&str, Option<usize>)> = if names.len() < 2 {
            rows.base.iter().map(|f| (f.trial.as_str(), Some(f.stretch))).collect()
        } else {
            names.iter().map(|n| (*n, None)).collect()
        };
        let folds: Vec<(Normal, Normal, Vec<&Factor>)> = groups
            .iter()
            .map(|(trial, flight)| {
                let held = |f: &Factor| f.trial == *trial && flight.is_none_or(|s| s == f.stretch);
                let kept = |factors: &'a [Factor], parts: &[Normal]| {
                    total(n, factors.iter().zip(parts).filter(|(f, _)| !held(f)).map(|(_, part)| part))
                };
                (
                    self.prior.plus(&kept(rows.base, &self.base), 1.0),
                    kept(rows.torque, torque),
                    rows.base.iter().filter(|f| held(f)).collect(),
                )
            })
            .collect();
        let tried = WEIGHTS.par_iter().map(|weight| {
            let (mut sum, mut count) = (0.0, 0);
            for (known, torque, held) in &folds {
                let (s, c) = squares(held, &known.plus(torque, weight * unit).solution()?);
                (sum, count) = (sum + s, count + c);
            }
            Some(Tried { weight: *weight, held_out_rms: (sum / count.max(1) as f64).sqrt() })
        });
        let tried: Vec<Tried> = tried.collect::<Option<_>>()?;
        let best = tried.iter().min_by(|a, b| a.held_out_rms.total_cmp(&b.held_out_rms))?.weight;
        // joints: with the base rows in full weight, torque rows in their own
        let known = self.prior.plus(&total(n, self.base.iter()), 1.0);
        let all = total(n, torque.iter());
        let parts = |weight: f64| -> Vec<Normal> {
            let of = |(b, base): (&Factor, &Normal)| {
                let own = rows.torque.iter().zip(torque).filter(|(t, _)| t.trial == b.trial && t.stretch == b.stretch);
                base.plus(&total(n, own.map(|o| o.1)), weight)
            };
            rows.base.iter().zip(&self.base).map(of).collect()
        };
        let spread = spread_of(&known.plus(&all, *unit), &self.prior, &parts(*unit), first_own..n)?;
        let half_of = |at: usize| {
            let (sd, freedom) = spread[at - first_own];
            aloft_identify::half95(sd, freedom).unwrap_or(f64::INFINITY)
        };
        let of_body = known.plus(&all, best * unit);
        let inertial = of_body.solution()?;
        let inertial_spread = spread_of(&of_body, &self.prior, &parts(best * unit), 0..p)?;
        let joints = robot
            .joints
            .iter()
            .enumerate()
            .map(|(j, joint)| {
                let estimate = |k: usize| {
                    let at = first_own + UNKNOWNS.len() * j + k;
                    let half = half_of(at);
                    Estimate {
                        value: x[at],
                        ci95: [x[at] - half, x[at] + half],
                        nominal: self.nominal[UNKNOWNS.len() * j + k],
                    }
                };
                let error = estimate(GAIN);
                let gain = |e: f64| 1.0 / (1.0 + e);
                JointEstimate {
                    name: joint.name.clone(),
                    armature: estimate(0),
                    damping: estimate(1),
                    friction: estimate(2),
                    gain: Estimate {
                        value: gain(error.value),
                        ci95: [gain(error.ci95[1]), gain(error.ci95[0])],
                        nominal: 1.0,
                    },
                    delay_s: estimate(4),
                }
            })
            .collect();
        let of_laws = first_own + UNKNOWNS.len() * robot.joints.len();
        let laws = (of_laws..n)
            .map(|at| {
                let half = half_of(at);
                LawEstimate { name: columns.effects[at - p].clone(), value: x[at], ci95: [x[at] - half, x[at] + half] }
            })
            .collect();
        Some(JointFit {
            joints,
            laws,
            weight: best,
            tried,
            base_names: rows.torque[0].columns.parameters.clone(),
            base: inertial.rows(0, p).iter().copied().collect(),
            base_sd: inertial_spread.iter().map(|s| s.0).collect(),
            torque_ratio: *ratio,
            rows: rows.torque.iter().map(|f| f.n_rows).sum(),
        })
    }
}
