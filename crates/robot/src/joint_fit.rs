//! Friction, reflected inertia and gains of the joints' torques, together with the base parameters.
//!
//! The base rows determine the inertial parameters without any torque. The torque rows
//! ([`crate::torque`]) then say what the joints do; they also inform the inertial parameters, with
//! the weight at which whole recordings left out are predicted best by the base rows alone. That
//! weight is zero where the law of friction or the gains are wrong.

use crate::model::{RobotJoint, RobotModel};
use crate::normal::Normal;
use crate::torque::UNKNOWNS;
use aloft_identify::Prior;
use aloft_regressor::Factor;
use nalgebra::{DMatrix, DVector};
use serde::{Deserialize, Serialize};

/// Weights of torque rows that are tried, relative to rows of their own spread.
const WEIGHTS: [f64; 5] = [0.0, 0.03, 0.1, 0.3, 1.0];
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

/// Fits joints and base parameters. None if rows or prior cannot be solved, or no flight has
/// torques.
pub fn joint_fit(robot: &RobotModel, rows: &JointRows<'_>) -> Option<JointFit> {
    let p = rows.prior.mean.len();
    let columns = &rows.torque.first()?.columns;
    let n = columns.len() - 1;
    if rows.torque.iter().any(|f| f.columns != *columns) {
        return None;
    }
    // effects of the base rows stand before the joints' own unknowns, laws of joints after them
    let own = format!("{}.{}", robot.joints.first()?.name, UNKNOWNS[0]);
    let first_own = p + columns.effects.iter().position(|name| *name == own)?;
    if rows.base.iter().any(|f| f.columns.len() != first_own + 1) {
        return None;
    }
    let (prior, nominal) = before(robot, rows, first_own, n)?;
    let base_weight = rows.base_row_sd.powi(-2);
    let sum = |factors: &[Factor], weight: f64, keep: &dyn Fn(&Factor) -> bool| {
        let mut out = Normal::zeros(n);
        factors.iter().filter(|f| keep(f)).for_each(|f| out.add(f, weight));
        out
    };
    let everything: &dyn Fn(&Factor) -> bool = &|_| true;
    let (base, torque) = (sum(rows.base, base_weight, everything), sum(rows.torque, 1.0, everything));
    // the spread of torque rows about the base rows' answer: their scale, once and for all
    let (first, _) = prior.plus(&base, 1.0).plus(&torque, 1e-3).solve()?;
    let all: Vec<&Factor> = rows.torque.iter().collect();
    let (rss, count) = squares(&all, &first);
    let ratio = (rss / count.max(1) as f64).sqrt();
    let unit = ratio.max(1.0).powi(-2);

    let mut names: Vec<&str> = rows.base.iter().map(|f| f.trial.as_str()).collect();
    names.dedup();
    // with a single recording, flights are left out instead
    let single = names.len() < 2;
    let groups: Vec<(&str, Option<usize>)> = if single {
        rows.base.iter().map(|f| (f.trial.as_str(), Some(f.stretch))).collect()
    } else {
        names.iter().map(|n| (*n, None)).collect()
    };
    let mut tried: Vec<Tried> = Vec::new();
    let left: Vec<(Normal, Normal, Vec<&Factor>)> = groups
        .iter()
        .map(|(trial, flight)| {
            let held = |f: &Factor| f.trial == *trial && flight.is_none_or(|s| s == f.stretch);
            (
                sum(rows.base, base_weight, &|f| !held(f)),
                sum(rows.torque, 1.0, &|f| !held(f)),
                rows.base.iter().filter(|f| held(f)).collect(),
            )
        })
        .collect();
    for weight in WEIGHTS {
        let (mut total, mut count) = (0.0, 0);
        for (base, torque, held) in &left {
            let (x, _) = prior.plus(base, 1.0).plus(torque, weight * unit).solve()?;
            let (s, c) = squares(held, &x);
            (total, count) = (total + s, count + c);
        }
        tried.push(Tried { weight, held_out_rms: (total / count.max(1) as f64).sqrt() });
    }
    let best = tried.iter().min_by(|a, b| a.held_out_rms.total_cmp(&b.held_out_rms))?.weight;
    // joints: with the base rows in full weight, torque rows in their own
    let (x, covariance) = prior.plus(&base, 1.0).plus(&torque, unit).solve()?;
    // neighbouring windows overlap by three quarters: a row counts as a quarter, so that intervals
    // are twice as wide as those of independent rows
    const OVERLAP: f64 = 2.0;
    let (rss, count) = squares(&all, &x);
    let (inertial, inertial_covariance) = prior.plus(&base, 1.0).plus(&torque, best * unit).solve()?;
    let joints = robot
        .joints
        .iter()
        .enumerate()
        .map(|(j, joint)| {
            let estimate = |k: usize| {
                let at = first_own + UNKNOWNS.len() * j + k;
                let half = 1.96 * OVERLAP * covariance[(at, at)].max(0.0).sqrt();
                Estimate { value: x[at], ci95: [x[at] - half, x[at] + half], nominal: nominal[UNKNOWNS.len() * j + k] }
            };
            let error = estimate(3);
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
            let half = 1.96 * OVERLAP * covariance[(at, at)].max(0.0).sqrt();
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
        base_sd: (0..p).map(|i| inertial_covariance[(i, i)].max(0.0).sqrt()).collect(),
        torque_ratio: (rss / count.max(1) as f64).sqrt(),
        rows: count,
    })
}
