//! A simulated laboratory up to the start of discovery: motion by inverse kinematics, flights, an
//! inaccurate prior.

use aloft_body::{BaseParameters, LinkInertia, Motion, Phi, State, subject::PriorSd};
use aloft_discover::{Body, Session, TrialInput, scene_of};
use aloft_effects::Scene;
use aloft_identify::{LinkPrior, Prior, Symmetry};
use aloft_regressor::{Stretch, WeakOptions};
use aloft_simulate::truth::flight_frames;
use aloft_simulate::{Lab, LabTrial, Scenario, simulate};
use nalgebra::{DMatrix, DVector, Vector3};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rayon::prelude::*;

pub fn scenario(human: bool, seed: u64, hidden: &serde_json::Value) -> Scenario {
    let sex = if seed.is_multiple_of(2) { "F" } else { "M" };
    let body = if human {
        serde_json::json!({"kind": "human", "protocol": {"exercises": 0},
            "person": {"sex": sex, "height_m": 1.6 + 0.03 * (seed % 7) as f64, "mass_kg": 55.0 + 4.0 * (seed % 6) as f64}})
    } else {
        serde_json::json!({"kind": "chain"})
    };
    let all = serde_json::json!({"name": format!("lab{seed}"), "seed": seed, "body": body, "hidden": hidden});
    serde_json::from_value(all).unwrap()
}

/// Data available at the start of discovery.
pub struct Recorded {
    pub lab: Lab,
    motions: Vec<Motion>,
    stretches: Vec<Vec<Stretch>>,
    base: BaseParameters,
    phi: Vec<Phi>,
    prior: Option<Prior>,
    mass_kg: f64,
}

impl Recorded {
    /// `None` if the simulator cannot make the recordings (for example a person who could not
    /// land).
    pub fn new(human: bool, seed: u64, hidden: &serde_json::Value) -> Option<Self> {
        let scenario = scenario(human, seed, hidden);
        let lab = simulate(&scenario).ok()?;
        let model = &lab.body.model;
        let mut motions = Vec::new();
        let mut stretches = Vec::new();
        for trial in lab.trials.iter().filter(|t| !t.motion.flights.is_empty()) {
            let motion = motion(&lab, trial, scenario.capture.point_rate_hz);
            let end = motion.n_frames();
            let flights = flight_frames(&trial.motion, lab.ticks_per_frame);
            let flight =
                |(i, f): (usize, &[usize; 2])| Stretch::flight(trial.name.clone(), i, f[0] + 2, (f[1] - 1).min(end));
            stretches.push(flights.iter().enumerate().map(flight).collect());
            motions.push(motion);
        }
        let base = BaseParameters::of(model);
        let links = off(&lab.body.phi, seed);
        let phi = links.iter().map(LinkInertia::to_phi).collect();
        let sd = vec![PriorSd { mass_rel: 0.1, com_m: 0.015, radius_rel: 0.1, together: 0.0 }; links.len()];
        let prior = LinkPrior::new(&links, &sd, Symmetry::from_names(model).as_ref()).unwrap().base(&base).unwrap();
        let mass_kg = lab.body.phi.iter().map(|p| p[0]).sum();
        Some(Self { motions, stretches, base, phi, prior: human.then_some(prior), mass_kg, lab })
    }

    pub fn with<T>(&self, f: impl FnOnce(&Scene, &Session<'_>) -> T) -> T {
        let body = Body {
            model: &self.lab.body.model,
            base: &self.base,
            phi: &self.phi,
            prior: self.prior.as_ref(),
            mass_kg: self.mass_kg,
            plate_centres_m: &[],
        };
        let trials: Vec<TrialInput<'_>> = self
            .motions
            .iter()
            .zip(&self.stretches)
            .map(|(motion, stretches)| TrialInput {
                motion,
                stretches,
                measured: None,
                plates: &[],
                group: None,
                session_time_s: 0.0,
            })
            .collect();
        let scene = scene_of(&body, &trials);
        let session = Session::new(&body, &scene, &trials, &WeakOptions::default())
            .unwrap()
            .with_white_noise(&body, &trials, &WeakOptions::default())
            .unwrap();
        f(&scene, &session)
    }
}

/// Inverse kinematics in the true geometry, from the true pose.
pub fn motion(lab: &Lab, trial: &LabTrial, rate_hz: f64) -> Motion {
    let model = &lab.body.model;
    let markers: Vec<Option<(usize, Vector3<f64>)>> = trial
        .markers
        .labels
        .iter()
        .map(|l| lab.truth.markers.get(l).map(|(link, p)| (model.link_index(link).unwrap(), Vector3::from(*p))))
        .collect();
    let frames: Vec<Vec<f64>> = (0..trial.markers.n_frames)
        .into_par_iter()
        .map(|frame| {
            let tick = (frame * lab.ticks_per_frame).min(trial.motion.n_ticks() - 1);
            let mut q = trial.motion.q(tick).to_vec();
            let mut moved = q.clone();
            let mut state = State::new(model);
            let mut jacobian = DMatrix::zeros(3, model.nv);
            for _ in 0..4 {
                state.forward_position(model, &q);
                let mut normal = DMatrix::<f64>::identity(model.nv, model.nv) * 1e-7;
                let mut right = DVector::<f64>::zeros(model.nv);
                for (m, marker) in markers.iter().enumerate() {
                    let (Some((link, p)), Some(seen)) = (marker, trial.markers.position(m, frame)) else { continue };
                    state.point_jacobian(model, *link, p, &mut jacobian);
                    normal.gemm_tr(1.0, &jacobian, &jacobian, 1.0);
                    right += jacobian.tr_mul(&(seen - state.point_in_world(*link, p)));
                }
                let step = normal.cholesky().unwrap().solve(&right);
                model.integrate(&q, step.as_slice(), &mut moved);
                q.copy_from_slice(&moved);
            }
            q
        })
        .collect();
    Motion { trial: trial.name.clone(), rate_hz, nq: model.nq, nv: model.nv, q: frames.concat(), ..Motion::default() }
}

/// Prior of the links: masses, centres of mass and inertias with errors typical of anthropometric
/// tables.
pub fn off(phi: &[Phi], seed: u64) -> Vec<LinkInertia> {
    let mut rng = ChaCha8Rng::seed_from_u64(seed ^ 0x0ff);
    let mut r = |s: f64| s * (2.0 * rng.random::<f64>() - 1.0) * 1.7;
    let total: f64 = phi.iter().map(|p| p[0]).sum();
    let mut links: Vec<LinkInertia> = phi
        .iter()
        .map(|p| {
            let mut l = LinkInertia::from_phi(p);
            l.mass_kg *= 1.0 + r(0.08);
            l.com_m += Vector3::new(r(0.01), r(0.01), r(0.01));
            l.inertia_com_kgm2 *= 1.0 + r(0.15);
            l
        })
        .collect();
    let sum: f64 = links.iter().map(|l| l.mass_kg).sum();
    for l in &mut links {
        l.mass_kg *= total / sum;
        l.inertia_com_kgm2 *= total / sum;
    }
    links
}
