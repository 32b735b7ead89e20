//! Simulated laboratories with a hidden effect: how often is the right name given, and how often a wrong one?
//!
//! The simulator's physics is not that of the columns. Kinematics are those of a good calibration: inverse kinematics from the measured markers (noise,
//! soft tissue, gaps) in the true geometry, priors that are off by as much as priors are. `ALOFT_LABS=n` runs n seeds of every case.
#![allow(clippy::unwrap_used, clippy::print_stdout, reason = "a test that fails should say where")]

use aloft_body::{BaseParameters, LinkInertia, Motion, Phi, State, subject::PriorSd};
use aloft_discover::*;
use aloft_identify::{LinkPrior, Symmetry};
use aloft_regressor::{Stretch, WeakOptions};
use aloft_simulate::truth::flight_frames;
use aloft_simulate::{Lab, Scenario, simulate};
use nalgebra::{DMatrix, DVector, Vector3};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rayon::prelude::*;
use std::collections::BTreeMap;
use std::time::Instant;

fn scenario(human: bool, seed: u64, hidden: &serde_json::Value) -> Scenario {
    let body = if human {
        serde_json::json!({"kind": "human", "person": {"sex": if seed.is_multiple_of(2) {"F"} else {"M"}, "height_m": 1.6 + 0.03 * (seed % 7) as f64, "mass_kg": 55.0 + 4.0 * (seed % 6) as f64}, "protocol": {"exercises": 0}})
    } else {
        serde_json::json!({"kind": "chain"})
    };
    serde_json::from_value(
        serde_json::json!({"name": format!("lab{seed}"), "seed": seed, "body": body, "hidden": hidden}),
    )
    .unwrap()
}

/// Inverse kinematics in the true geometry, from the true pose.
fn motion(lab: &Lab, trial: &aloft_simulate::LabTrial, rate_hz: f64) -> Motion {
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

fn off(phi: &[Phi], seed: u64) -> Vec<LinkInertia> {
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

fn run(human: bool, seed: u64, hidden: &serde_json::Value) -> Option<Discovery> {
    let scenario = scenario(human, seed, hidden);
    let lab = match simulate(&scenario) {
        Ok(lab) => lab,
        Err(e) => {
            println!("  not simulated: {e}");
            return None;
        }
    };
    let model = &lab.body.model;
    let rate_hz = scenario.capture.point_rate_hz;
    let mut motions = Vec::new();
    let mut stretches = Vec::new();
    for trial in lab.trials.iter().filter(|t| !t.motion.flights.is_empty()) {
        let motion = motion(&lab, trial, rate_hz);
        let flights = flight_frames(&trial.motion, lab.ticks_per_frame);
        let end = motion.n_frames();
        stretches.push(
            flights
                .iter()
                .enumerate()
                .map(|(i, f)| Stretch::flight(trial.name.clone(), i, f[0] + 2, (f[1] - 1).min(end)))
                .collect::<Vec<_>>(),
        );
        motions.push(motion);
    }
    let base = BaseParameters::of(model);
    let links = off(&lab.body.phi, seed);
    let phi: Vec<Phi> = links.iter().map(LinkInertia::to_phi).collect();
    let sd = vec![PriorSd { mass_rel: 0.1, com_m: 0.015, radius_rel: 0.1 }; links.len()];
    let prior = LinkPrior::new(&links, &sd, Symmetry::from_names(model).as_ref()).unwrap().base(&base).unwrap();
    let mass_kg = lab.body.phi.iter().map(|p| p[0]).sum();
    let body = Body { model, base: &base, phi: &phi, prior: human.then_some(&prior), mass_kg, plate_centers_m: &[] };
    let trials: Vec<TrialInput<'_>> = motions
        .iter()
        .zip(&stretches)
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
    let session = Session::new(&body, &scene, &trials, &WeakOptions::default()).unwrap();
    let start = Instant::now();
    let found = discover(&session, &catalogue(), &[], &DiscoverOptions::default()).unwrap();
    println!("    {:.1} s", start.elapsed().as_secs_f64());
    Some(found)
}

fn cases(human: bool) -> Vec<(&'static str, serde_json::Value)> {
    let j = |s: &str| serde_json::from_str(s).unwrap();
    if human {
        vec![
            ("", j("[]")),
            ("quadratic_drag", j(r#"[{"effect":"quadratic_drag","drag_area_m2":3.0}]"#)),
            ("gravity_tilt", j(r#"[{"effect":"gravity_tilt","about_x_deg":0.8,"about_y_deg":-0.6}]"#)),
            ("gravity_scale", j(r#"[{"effect":"time_base","true_rate_hz":201.5}]"#)),
            (
                "tether",
                j(
                    r#"[{"effect":"tether","link":"pelvis","anchor_m":[-2.5,0.4,1.5],"rest_length_m":1.2,"stiffness_npm":15}]"#,
                ),
            ),
            (
                "constant_force",
                j(r#"[{"effect":"constant_force","link":"torso","point_m":[0,0.2,0],"force_n":[8,5,0]}]"#),
            ),
            ("flywheel", j(r#"[{"effect":"flywheel","link":"torso","momentum_nms":[0.5,2.0,0.5]}]"#)),
            ("wind", j(r#"[{"effect":"wind","velocity_mps":[5,2,0],"drag_area_m2":0.8}]"#)),
            ("thrust", j(r#"[{"effect":"thrust","link":"torso","force_n":[10,0,5]}]"#)),
            (
                "payload",
                j(
                    r#"[{"effect":"payload","link":"shank_r","point_m":[0,-0.2,0],"mass_kg":1.5,"trials":["jump05","jump06","jump07","jump08"]}]"#,
                ),
            ),
        ]
    } else {
        vec![
            ("", j("[]")),
            ("quadratic_drag", j(r#"[{"effect":"quadratic_drag","drag_area_m2":0.01}]"#)),
            ("linear_drag", j(r#"[{"effect":"linear_drag","coefficient_nspm":0.02}]"#)),
            ("rotational_drag", j(r#"[{"effect":"rotational_drag","coefficient_nmsprad":0.0004}]"#)),
            ("wind", j(r#"[{"effect":"wind","velocity_mps":[3,1,0],"drag_area_m2":0.01}]"#)),
            ("gravity_tilt", j(r#"[{"effect":"gravity_tilt","about_x_deg":0.15,"about_y_deg":-0.1}]"#)),
            ("gravity_scale", j(r#"[{"effect":"gravity_scale","factor":1.004}]"#)),
            ("gravity_scale", j(r#"[{"effect":"time_base","true_rate_hz":200.4}]"#)),
            (
                "tether",
                j(
                    r#"[{"effect":"tether","link":"link0","anchor_m":[0.8,0.4,3.0],"rest_length_m":0.5,"stiffness_npm":0.3,"damping_nspm":0.02}]"#,
                ),
            ),
            ("crane", j(r#"[{"effect":"crane","link":"link0","pulley_m":[0.5,0.3,2.8],"tension_n":0.2}]"#)),
            (
                "constant_force",
                j(r#"[{"effect":"constant_force","link":"link1","point_m":[0,0,0],"force_n":[0.05,0.03,0]}]"#),
            ),
            ("flywheel", j(r#"[{"effect":"flywheel","link":"link1","momentum_nms":[0.001,0.0005,0]}]"#)),
            (
                "rotor",
                j(
                    r#"[{"effect":"rotor","link":"link0","axis":[0,1,0],"mean_nms":0.001,"swing_nms":0.0008,"frequency_hz":2.3}]"#,
                ),
            ),
            ("thrust", j(r#"[{"effect":"thrust","link":"link0","force_n":[0.05,0.0,0.08]}]"#)),
            ("added_mass", j(r#"[{"effect":"added_mass","link":"link1","point_m":[-0.15,0,0],"mass_kg":0.01}]"#)),
            (
                "payload",
                j(
                    r#"[{"effect":"payload","link":"link1","point_m":[-0.1,0,0],"mass_kg":0.02,"trials":["throws_04","throws_05"]}]"#,
                ),
            ),
            (
                "wobbling_mass",
                j(
                    r#"[{"effect":"wobbling_mass","link":"link0","point_m":[0,0.1,0],"mass_kg":0.1,"frequency_hz":7,"damping_ratio":0.15}]"#,
                ),
            ),
            (
                "quadratic_drag+gravity_tilt",
                j(
                    r#"[{"effect":"quadratic_drag","drag_area_m2":0.01},{"effect":"gravity_tilt","about_x_deg":0.15,"about_y_deg":-0.1}]"#,
                ),
            ),
            (
                "tether+flywheel",
                j(
                    r#"[{"effect":"tether","link":"link0","anchor_m":[0.8,0.4,3.0],"rest_length_m":0.5,"stiffness_npm":0.3},{"effect":"flywheel","link":"link1","momentum_nms":[0.001,0.0005,0]}]"#,
                ),
            ),
        ]
    }
}

#[test]
fn validate_labs() {
    let Some(seeds) = std::env::var("ALOFT_LABS").ok().and_then(|n| n.parse::<u64>().ok()) else {
        println!("skipped: ALOFT_LABS=n runs n seeds of every simulated laboratory");
        return;
    };
    let which = std::env::var("ALOFT_LABS_OF").unwrap_or_else(|_| "chain human".into());
    let mut table: BTreeMap<String, [usize; 5]> = BTreeMap::new();
    for word in which.split_whitespace() {
        let human = word == "human";
        for seed in 1..=seeds {
            let only = std::env::var("ALOFT_LABS_ONLY").unwrap_or_default();
            for (name, hidden) in
                cases(human).into_iter().filter(|c| only.is_empty() || only.split_whitespace().any(|o| o == c.0))
            {
                let Some(d) = run(human, seed, &hidden) else { continue };
                let claimed = matches!(d.verdict, Verdict::Supported | Verdict::OneOf);
                let truth: Vec<&str> = name.split('+').filter(|n| !n.is_empty()).collect();
                let outcome = if truth.is_empty() {
                    if claimed { 3 } else { 0 }
                } else if !claimed {
                    4
                } else if truth.iter().all(|t| d.effects.iter().any(|e| e == t)) {
                    if d.effects.len() == truth.len() { 0 } else { 1 }
                } else if truth.iter().any(|t| d.effects.iter().any(|e| e == t)) {
                    2
                } else {
                    3
                };
                table.entry(format!("{word} {name}")).or_default()[outcome] += 1;
                println!(
                    "== {word} {seed} `{name}` -> {:?} {:?} [{}] floor {:.4} error {:.4} after {:.4}",
                    d.verdict,
                    d.effects,
                    ["hit", "class", "part", "WRONG", "missed"][outcome],
                    d.noise_floor,
                    d.held_out_error,
                    d.held_out_error_after
                );
                for f in &d.found {
                    println!(
                        "      found {} {}",
                        f.key,
                        f.coefficients
                            .iter()
                            .chain(&f.nonlinear)
                            .map(|e| format!("{} {:.4}±{:.4}", e.name, e.value, e.se))
                            .collect::<Vec<_>>()
                            .join(", ")
                    );
                }
                for r in &d.rounds {
                    let top: Vec<String> =
                        r.candidates.iter().take(5).map(|c| format!("{} {:.3}", c.key, c.held_out_ratio)).collect();
                    println!("      {} thr {:.3}: {}", r.judged_on, r.threshold, top.join(", "));
                }
            }
        }
    }
    println!("{:40} hit class part wrong missed", "");
    let mut sum = [0; 5];
    for (name, row) in &table {
        println!("{name:40} {row:?}");
        for (s, r) in sum.iter_mut().zip(row) {
            *s += r;
        }
    }
    println!("{:40} {sum:?}", "all");
    let all: usize = sum.iter().sum();
    assert!(20 * sum[3] <= all.max(20), "{} wrong names among {all}", sum[3]);
}
