//! Recommends motions that would determine poorly observed parameters: in words from parameter
//! names, and quantitatively by adding simulated motions.
//!
//! A candidate motion swings one joint (or spins the whole body) during a short flight; the root
//! follows from conserved angular momentum, so the motion is physically possible. Its rows are
//! added to the recorded ones, and the standard deviations of all parameters are compared before
//! and after.

use crate::system::System;
use crate::{Determination, IdentifyError, LinkPrior};
use aloft_body::{BaseParameters, JointKind, Model, Motion, Phi, State};
use aloft_regressor::{Acting, Factor, Stretch, WeakOptions, weak_factor};
use nalgebra::{DMatrix, DVector, Vector3, Vector6};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

/// Largest number of lines of advice in words.
const LINES: usize = 5;

/// A motion to record next.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct Advice {
    /// The motion in a few words.
    pub motion: String,
    /// The motion and the parameters that it would determine.
    pub text: String,
}

/// Advice from how well each parameter is observed: links with most hardly observed parameters
/// first. Turning over in the air is recommended only where it is safe.
pub(crate) fn in_words(model: &Model, parameters: &[(String, Determination)], turning_over: bool) -> Vec<Advice> {
    let mut lines: Vec<(usize, Advice)> = Vec::new();
    for (i, link) in model.links.iter().enumerate() {
        let own: Vec<&str> = parameters
            .iter()
            .filter(|(_, s)| *s == Determination::Hardly)
            .filter_map(|(name, _)| match name.rsplit_once('.') {
                Some((owner, what)) if owner == link.name => Some(what),
                None if i == 0 => Some(name.as_str()),
                _ => None,
            })
            .collect();
        if own.is_empty() {
            continue;
        }
        let (motion, more) = match &link.joint.kind {
            JointKind::Free if model.encoders => (
                "let it turn faster in the air".to_owned(),
                ", about each of its axes and both ways, as far as is safe for the robot",
            ),
            JointKind::Free if !turning_over => (
                "jump with quarter turns to both sides".to_owned(),
                ", and tip the trunk forwards, backwards and sideways in the air, as far as is safe for the subject",
            ),
            JointKind::Free => (
                "turn the whole body in the air".to_owned(),
                ", about each of its axes and both ways (somersault, side tilt, twist)",
            ),
            JointKind::Spherical => (
                format!("swing `{}` in the air", link.name),
                ", to and fro and sideways, and roll it about its own axis",
            ),
            JointKind::Revolute(_) => {
                (format!("bend and stretch `{}` quickly in the air", link.name), ", while its parent turns")
            }
            JointKind::Prismatic(_) => (format!("slide `{}` to and fro in the air", link.name), ""),
            JointKind::Fixed => continue,
        };
        let text = format!("{motion}{more}: would show {}", own.join(", "));
        lines.push((own.len(), Advice { motion, text }));
    }
    // stable sort: links of equal rank stay in model order
    lines.sort_by_key(|l| std::cmp::Reverse(l.0));
    lines.into_iter().take(LINES).map(|l| l.1).collect()
}

/// Size of the simulated motions.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct AdviceOptions {
    /// Duration of a flight, s.
    pub flight_s: f64,
    /// Sampling rate, Hz.
    pub rate_hz: f64,
    /// Amplitude of a joint's swing, rad (m for prismatic joints: a tenth of it).
    pub amplitude_rad: f64,
    /// Frequency of the swing, Hz.
    pub frequency_hz: f64,
    /// Angular velocity of a spin of the whole body, rad/s.
    pub spin_rad_s: f64,
    /// Number of flights of each kind.
    pub flights: usize,
    /// Whether spins about horizontal axes (somersaults, cartwheels) are candidates; without it the
    /// whole body spins about the axis that is nearest to the vertical.
    pub turning_over: bool,
}

impl Default for AdviceOptions {
    /// Three flights of half a second, swings of 30° at 2 Hz, a spin of 3 rad/s.
    fn default() -> Self {
        Self {
            flight_s: 0.5,
            rate_hz: 100.0,
            amplitude_rad: 0.52,
            frequency_hz: 2.0,
            spin_rad_s: 3.0,
            flights: 3,
            turning_over: true,
        }
    }
}

/// Expected benefit of one kind of motion.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct MotionAdvice {
    /// The motion in words.
    pub motion: String,
    /// Link that it moves.
    pub link: String,
    /// Share by which the standard deviations of the worst parameters shrink (geometric mean over
    /// the worst quarter).
    pub gain: f64,
    /// Parameters that improve most: name, present and expected standard deviation, in their unit.
    pub best: Vec<(String, f64, f64)>,
}

/// Ranks kinds of motion by how much they would improve the parameters with the largest
/// uncertainty, the best first.
///
/// `recorded` are the factors of weak rows with fixed weights (built with `weak`), `posture` is a
/// typical posture in flight (length nq), `row_sd` is the standard deviation of a row as given in
/// [`crate::Parameters`].
///
/// # Errors
/// As [`crate::identify`]; [`IdentifyError::Length`] for a posture of the wrong length.
pub fn excitation_advice(
    model: &Model,
    base: &BaseParameters,
    recorded: &[Factor],
    mass_kg: f64,
    prior: &LinkPrior,
    posture: &[f64],
    row_sd: f64,
    weak: &WeakOptions,
    options: &AdviceOptions,
) -> Result<Vec<MotionAdvice>, IdentifyError> {
    if posture.len() != model.nq {
        return Err(IdentifyError::Length {
            what: "coordinates of the posture",
            expected: model.nq,
            found: posture.len(),
        });
    }
    let phi = prior.phi();
    let base_prior = prior.base(base)?;
    let merged = Factor::merge(recorded)?.with_effects(&[])?;
    let variance = row_sd * row_sd;
    let sd_of = |factor: &Factor| -> Result<DVector<f64>, IdentifyError> {
        let system = System::new(factor, mass_kg, Some(&base_prior))?;
        Ok(system.covariance(variance, variance).diagonal().map(|v| v.max(0.0).sqrt()))
    };
    let now = sd_of(&merged)?;
    // remaining share of the prior's standard deviation, without the mass
    let left: Vec<f64> =
        (0..now.len()).map(|i| if i == 0 { 0.0 } else { now[i] / base_prior.covariance[(i, i)].sqrt() }).collect();
    let mut worst: Vec<usize> = (1..left.len()).collect();
    worst.sort_by(|&a, &b| left[b].total_cmp(&left[a]));
    worst.truncate((left.len() / 4).max(1));
    let upright = upright_axis(model, posture);
    let mut out: Vec<MotionAdvice> = candidates(model)
        .into_par_iter()
        .filter(|c| !c.spin || options.turning_over || c.axis == upright)
        .map(|candidate| {
            let motion = synthesise(model, &phi, posture, &candidate, options);
            let stretch = Stretch::flight(motion.trial.clone(), 0, 0, motion.n_frames());
            let factor = weak_factor(model, base, &phi, &motion, &stretch, Acting::nothing(), weak, None)?
                .scaled((options.flights as f64).sqrt());
            let then = sd_of(&merged.merged_with(&factor)?)?;
            let log_gain: f64 = worst.iter().map(|&i| (then[i] / now[i]).ln()).sum::<f64>() / worst.len() as f64;
            let mut best: Vec<usize> = (1..now.len()).collect();
            best.sort_by(|&a, &b| (then[a] / now[a]).total_cmp(&(then[b] / now[b])));
            let best = best.into_iter().take(5).map(|i| (base.parameters[i].name.clone(), now[i], then[i])).collect();
            Ok(MotionAdvice {
                motion: candidate.describe(model, options),
                link: model.links[candidate.link].name.clone(),
                gain: 1.0 - log_gain.exp(),
                best,
            })
        })
        .collect::<Result<_, IdentifyError>>()?;
    out.sort_by(|a, b| b.gain.total_cmp(&a.gain));
    Ok(out)
}

/// One joint about one of its axes, or the whole body.
struct Candidate {
    link: usize,
    /// Index into v.
    velocity: usize,
    axis: usize,
    spin: bool,
}

impl Candidate {
    fn describe(&self, model: &Model, options: &AdviceOptions) -> String {
        let link = &model.links[self.link];
        let axis = ["x", "y", "z"][self.axis];
        if self.spin {
            return format!(
                "{} flights with the whole body turning at {:.0}°/s about the {axis} axis of `{}`",
                options.flights,
                options.spin_rad_s.to_degrees(),
                link.name
            );
        }
        let about = match link.joint.kind {
            JointKind::Spherical => format!(" about its {axis} axis"),
            _ => String::new(),
        };
        format!(
            "{} flights with `{}` swinging{about} by ±{:.0}° at {:.1} Hz",
            options.flights,
            link.name,
            options.amplitude_rad.to_degrees(),
            options.frequency_hz
        )
    }
}

/// Axis of the root that is nearest to the vertical in a posture.
fn upright_axis(model: &Model, posture: &[f64]) -> usize {
    let mut state = State::new(model);
    state.forward_position(model, posture);
    let Some(root) = state.world_from_link.first() else { return 2 };
    let vertical = root.rotation.inverse() * -model.gravity_mps2;
    vertical.iamax()
}

fn candidates(model: &Model) -> Vec<Candidate> {
    let mut out = Vec::new();
    for (i, link) in model.links.iter().enumerate() {
        let first = link.joint.v_offset;
        match link.joint.kind {
            JointKind::Free => {
                out.extend((0..3).map(|axis| Candidate { link: i, velocity: first + 3 + axis, axis, spin: true }));
            }
            JointKind::Spherical => {
                out.extend((0..3).map(|axis| Candidate { link: i, velocity: first + axis, axis, spin: false }));
            }
            JointKind::Revolute(_) | JointKind::Prismatic(_) => {
                out.push(Candidate { link: i, velocity: first, axis: 2, spin: false });
            }
            JointKind::Fixed => {}
        }
    }
    out
}

/// A flight in which the candidate's joint swings and the root follows from conserved momentum.
/// Unless the candidate is a spin, the body tumbles slowly about all axes: without rotation almost
/// no parameter is observable.
fn synthesise(model: &Model, phi: &[Phi], posture: &[f64], candidate: &Candidate, options: &AdviceOptions) -> Motion {
    const SUBSTEPS: usize = 4;
    let n = (options.flight_s * options.rate_hz).round().max(1.0) as usize + 1;
    let step = 1.0 / (options.rate_hz * SUBSTEPS as f64);
    let mut state = State::new(model);
    let mut q = posture.to_vec();
    let mut moved = q.clone();
    let mut v = vec![0.0; model.nv];
    state.forward_position(model, &q);
    let (mass, centre) = state.centre_of_mass(phi);
    // start: whole-body spin about the root's axis, or a slow tumble
    let spin = if candidate.spin {
        let mut axis = Vector3::zeros();
        axis[candidate.axis] = options.spin_rad_s;
        axis
    } else {
        Vector3::new(0.5, 0.5, 0.5)
    };
    v[3..6].copy_from_slice(spin.as_slice());
    state.forward_velocity(model, &q, &v);
    let angular = momentum(&state, phi, &centre).fixed_rows::<3>(3).into_owned();
    let mut out = Motion {
        trial: "candidate".to_owned(),
        rate_hz: options.rate_hz,
        nq: model.nq,
        nv: model.nv,
        q: Vec::with_capacity(n * model.nq),
        ..Motion::default()
    };
    let scale = match model.links[candidate.link].joint.kind {
        JointKind::Prismatic(_) => 0.1 * options.amplitude_rad,
        _ => options.amplitude_rad,
    };
    let omega = std::f64::consts::TAU * options.frequency_hz;
    let rise = 0.5 * options.flight_s;
    let mut matrix = DMatrix::zeros(6, 6);
    for sub in 0..n * SUBSTEPS {
        if sub % SUBSTEPS == 0 {
            out.q.extend_from_slice(&q);
        }
        // midpoint rule: velocities at half a step
        let time = (sub as f64 + 0.5) * step;
        let linear = -model.gravity_mps2 * rise + model.gravity_mps2 * time;
        v.fill(0.0);
        if !candidate.spin {
            v[candidate.velocity] = scale * omega * (omega * time).cos();
        }
        let target = Vector6::from_iterator((linear * mass).iter().chain(angular.iter()).copied());
        for half in 0..2 {
            let here: &[f64] = if half == 0 { &q } else { &moved };
            state.forward_position(model, here);
            let centre = state.centre_of_mass(phi).1;
            v[..6].fill(0.0);
            state.forward_velocity(model, here, &v);
            let own = momentum(&state, phi, &centre);
            let joints = v[6..].to_vec();
            v.fill(0.0);
            for c in 0..6 {
                v[c] = 1.0;
                state.forward_velocity(model, here, &v);
                matrix.set_column(c, &momentum(&state, phi, &centre));
                v[c] = 0.0;
            }
            v[6..].copy_from_slice(&joints);
            let root = matrix.clone().lu().solve(&DVector::from_column_slice((target - own).as_slice()));
            if let Some(root) = root {
                v[..6].copy_from_slice(root.as_slice());
            }
            let length = if half == 0 { 0.5 * step } else { step };
            let change: Vec<f64> = v.iter().map(|x| x * length).collect();
            model.integrate(&q, &change, &mut moved);
        }
        q.copy_from_slice(&moved);
    }
    out
}

/// Linear and angular momentum about a point.
fn momentum(state: &State, phi: &[Phi], about: &Vector3<f64>) -> Vector6<f64> {
    let mut out = Vector6::zeros();
    for ((pose, velocity), phi) in state.world_from_link.iter().zip(&state.velocity).zip(phi) {
        let (v, w): (Vector3<f64>, Vector3<f64>) =
            (velocity.fixed_rows::<3>(0).into(), velocity.fixed_rows::<3>(3).into());
        let mc = aloft_body::inertia::first_moment(phi);
        let linear = pose.rotation * (v * phi[0] + w.cross(&mc));
        let angular = pose.rotation * (mc.cross(&v) + aloft_body::inertia::inertia_about_origin(phi) * w)
            + (pose.translation.vector - about).cross(&linear);
        for axis in 0..3 {
            out[axis] += linear[axis];
            out[3 + axis] += angular[axis];
        }
    }
    out
}
