//! Data of a simulated laboratory: motions by inverse kinematics, flights, contact on plates, and
//! prior knowledge of the body.

use crate::labs::{motion, off};
use aloft_body::{BaseParameters, LinkInertia, Model, Motion, Phi, subject::PriorSd};
use aloft_discover::{
    Addition, Body, DiscoverOptions, Estimate, Session, TrialInput, addition, catalogue, discover, scene_of,
};
use aloft_effects::{EffectInstance, PlateSeries, Scene};
use aloft_identify::{LinkPrior, Prior, Symmetry};
use aloft_regressor::{Stretch, StretchKind, WeakOptions};
use aloft_simulate::truth::flight_frames;
use aloft_simulate::{Lab, LabTrial, Scenario, simulate};
use nalgebra::{Vector3, Vector6};
use serde_json::{Value, json};

/// Simulates a session; `body` and `capture` as in a scenario.
pub fn lab(body: &Value, capture: &Value, seed: u64, hidden: &Value) -> Lab {
    let all = json!({"name": "recovery", "seed": seed, "body": body, "capture": capture, "hidden": hidden});
    let scenario: Scenario = serde_json::from_value(all).unwrap();
    simulate(&scenario).unwrap()
}

/// Prior knowledge of the inertial parameters.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Known {
    /// Only the mass.
    Mass,
    /// Anthropometric tables, with errors typical of them.
    Tables,
    /// Everything, to a thousandth.
    All,
}

/// One recording as input of discovery.
#[derive(Clone)]
pub struct Recording {
    pub motion: Motion,
    pub stretches: Vec<Stretch>,
    pub plates: Vec<PlateSeries>,
    pub session_time_s: f64,
}

/// All inputs of a fit.
#[derive(Clone)]
pub struct Evidence {
    pub model: Model,
    pub links: Vec<LinkInertia>,
    pub known: Known,
    pub mass_kg: f64,
    pub centres_m: Vec<Vector3<f64>>,
    pub trials: Vec<Recording>,
    pub options: WeakOptions,
}

/// Motions of those trials of a session that are used.
pub fn motions(lab: &Lab) -> Vec<Motion> {
    moving(lab).map(|(_, t)| motion(lab, t, t.markers.rate_hz)).collect()
}

/// Trials with flights or exercises, with their indices in the session.
pub fn moving(lab: &Lab) -> impl Iterator<Item = (usize, &LabTrial)> {
    lab.trials.iter().enumerate().filter(|(_, t)| t.kind == "exercise" || !t.motion.flights.is_empty())
}

impl Evidence {
    /// Motions and plates of a session, `spacing_s` between the starts of its trials.
    pub fn new(lab: &Lab, motions: &[Motion], known: Known, spacing_s: f64) -> Self {
        let model = lab.body.model.clone();
        let links: Vec<LinkInertia> = match known {
            Known::All => lab.body.phi.iter().map(LinkInertia::from_phi).collect(),
            _ => off(&lab.body.phi, 1),
        };
        let mass_kg = lab.body.phi.iter().map(|p| p[0]).sum::<f64>();
        let centres_m = lab.trials[0].plates.iter().map(|p| p.geometry.centre()).collect();
        let trials = moving(lab)
            .zip(motions)
            .map(|((index, trial), motion)| recording(lab, trial, motion, mass_kg, spacing_s * index as f64))
            .collect();
        Self { model, links, known, mass_kg, centres_m, trials, options: WeakOptions::default() }
    }

    /// Scene and session of the evidence.
    pub fn with<T>(&self, f: impl FnOnce(&Scene, &Session<'_>) -> T) -> T {
        let (base, phi, prior) = (BaseParameters::of(&self.model), self.phi(), self.prior());
        let body = Body {
            model: &self.model,
            base: &base,
            phi: &phi,
            prior: prior.as_ref(),
            mass_kg: self.mass_kg,
            plate_centres_m: &self.centres_m,
        };
        let measured: Vec<Option<Vec<Vector6<f64>>>> = self.trials.iter().map(|t| whole(&t.plates)).collect();
        let trials: Vec<TrialInput<'_>> = self
            .trials
            .iter()
            .zip(&measured)
            .map(|(t, measured)| TrialInput {
                motion: &t.motion,
                stretches: &t.stretches,
                measured: measured.as_deref(),
                plates: &t.plates,
                group: None,
                session_time_s: t.session_time_s,
            })
            .collect();
        let scene = scene_of(&body, &trials);
        let session = Session::new(&body, &scene, &trials, &self.options)
            .unwrap()
            .with_white_noise(&body, &trials, &self.options)
            .unwrap();
        f(&scene, &session)
    }

    /// Inertial parameters of the prior.
    pub fn phi(&self) -> Vec<Phi> {
        self.links.iter().map(LinkInertia::to_phi).collect()
    }

    fn prior(&self) -> Option<Prior> {
        let sure = match self.known {
            Known::Mass => return None,
            Known::Tables => 1.0,
            Known::All => 1e-5,
        };
        let sd = PriorSd { mass_rel: 0.1 * sure, com_m: 0.015 * sure, radius_rel: 0.1 * sure, together: 0.0 };
        let sides = Symmetry::from_names(&self.model);
        let of_links = LinkPrior::new(&self.links, &vec![sd; self.links.len()], sides.as_ref()).unwrap();
        Some(of_links.base(&BaseParameters::of(&self.model)).unwrap())
    }

    /// Keeps only stretches of one kind, and the trials that have some.
    pub fn only(mut self, kind: StretchKind) -> Self {
        for t in &mut self.trials {
            t.stretches.retain(|s| s.kind == kind);
        }
        self.trials.retain(|t| !t.stretches.is_empty());
        self
    }

    /// Fits an effect together with the inertial parameters and the effects in `beside`, with
    /// nonlinear parameters fixed at `set`, in `trials` only.
    pub fn fit(&self, beside: &[&str], key: &str, set: &[(&str, f64)], trials: &[String]) -> Addition {
        self.with(|scene, session| {
            let parse = |k: &str| EffectInstance::parse(k, scene).unwrap();
            let beside: Vec<EffectInstance<'_>> = beside.iter().map(|k| parse(k)).collect();
            let mut choice = parse(key).in_trials(trials);
            for (name, value) in set {
                choice.set(scene, name, *value).unwrap();
            }
            addition(session, &beside, &choice, &options(&[])).unwrap()
        })
    }

    /// Key, coefficients and nonlinear parameters of an effect whose target and nonlinear
    /// parameters are estimated too.
    pub fn search(&self, effect: &str) -> (String, Vec<Estimate>) {
        self.with(|_, session| {
            let d = discover(session, &catalogue(), &[], &options(&[effect])).unwrap();
            let c = d.candidates.iter().find(|c| c.effect == effect).unwrap();
            (c.key.clone(), c.coefficients.iter().chain(&c.nonlinear).cloned().collect())
        })
    }
}

fn options(only: &[&str]) -> DiscoverOptions {
    let only = only.iter().map(|n| (*n).to_owned()).collect();
    DiscoverOptions { only, rounds: 1, null_draws: 20, ..DiscoverOptions::default() }
}

/// Sum of the plates.
fn whole(plates: &[PlateSeries]) -> Option<Vec<Vector6<f64>>> {
    let n = plates.first()?.force_n.len();
    let sum = |f: usize| {
        plates.iter().fold(Vector6::zeros(), |s, p| {
            let (force, moment) = (&p.force_n[f], &p.moment_nm[f]);
            s + Vector6::new(force.x, force.y, force.z, moment.x, moment.y, moment.z)
        })
    };
    Some((0..n).map(sum).collect())
}

/// Plates averaged over each frame, flights slightly shorter than the true ones, contact where the
/// plates carry the body.
fn recording(lab: &Lab, trial: &LabTrial, motion: &Motion, mass_kg: f64, session_time_s: f64) -> Recording {
    let n = motion.n_frames();
    let per_frame = trial.plates.first().map_or(1, |p| p.channels[0].len() / n);
    let half = (per_frame - 1) / 2;
    let plates: Vec<PlateSeries> = trial
        .plates
        .iter()
        .map(|p| {
            let fast = p.plate("", 1.0);
            let mean = |x: &[Vector3<f64>], f: usize| {
                let block = &x[(f * per_frame).saturating_sub(half)..(f * per_frame + half + 1).min(x.len())];
                block.iter().sum::<Vector3<f64>>() / block.len() as f64
            };
            PlateSeries {
                force_n: (0..n).map(|f| mean(&fast.force_n, f)).collect(),
                moment_nm: (0..n).map(|f| mean(&fast.moment_nm, f)).collect(),
            }
        })
        .collect();
    let flights = flight_frames(&trial.motion, lab.ticks_per_frame);
    let name = &trial.name;
    let mut stretches: Vec<Stretch> = flights
        .iter()
        .enumerate()
        .map(|(i, f)| Stretch::flight(name.clone(), i, f[0] + 2, (f[1] - 1).min(n)))
        .collect();
    let edge = (0.05 * motion.rate_hz).ceil() as usize;
    let load = |f: usize| plates.iter().map(|p| p.force_n[f].z).sum::<f64>();
    let stands = |f: usize| {
        f < n
            && !plates.is_empty()
            && load(f) > 0.2 * 9.81 * mass_kg
            && flights.iter().all(|x| f + edge < x[0] || f > x[1] + edge)
    };
    let mut start = None;
    for f in 0..=n {
        match (start, stands(f)) {
            (None, true) => start = Some(f),
            (Some(s), false) => {
                if f - s >= (0.2 * motion.rate_hz) as usize {
                    stretches.push(Stretch::contact(name.clone(), stretches.len(), s, f));
                }
                start = None;
            }
            _ => {}
        }
    }
    Recording { motion: motion.clone(), stretches, plates, session_time_s }
}
