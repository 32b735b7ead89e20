//! Effects added to truth motions with marker noise: named, or not claimed where there is nothing.

#[path = "../../regressor/tests/common/mod.rs"]
mod common;

use aloft_body::Motion;
use aloft_discover::*;
use aloft_effects::{Choice, Scene};
use aloft_regressor::{Stretch, WeakOptions};
use std::time::Instant;

struct Lab {
    truth: common::Truth,
    motion: Motion,
    stretches: Vec<Stretch>,
}

fn lab(name: &str, noise_m: f64, seed: u64) -> Lab {
    let truth = common::load(name);
    let motion = if noise_m > 0.0 { truth.noisy(noise_m, seed) } else { truth.motion.clone() };
    let stretches = truth.stretches();
    Lab { truth, motion, stretches }
}

impl Lab {
    fn with<T>(&self, f: impl FnOnce(&Scene, Session<'_>) -> T) -> T {
        let body = Body {
            model: &self.truth.model,
            base: &self.truth.base,
            phi: &self.truth.phi,
            prior: None,
            mass_kg: self.truth.mass(),
            plate_centers_m: &[],
        };
        let trials = [TrialInput {
            motion: &self.motion,
            stretches: &self.stretches,
            measured: None,
            plates: &[],
            group: None,
            session_time_s: 0.0,
        }];
        let scene = scene_of(&body, &trials);
        let session = Session::new(&body, &scene, &trials, &WeakOptions::default()).unwrap();
        f(&scene, session)
    }
}

fn print(d: &Discovery) {
    println!("  {:?} {:?} | floor {:.4} error {:.4} after {:.4}", d.verdict, d.effects, d.noise_floor, d.held_out_error, d.held_out_error_after);
    println!("  {}", d.words);
    for r in &d.rounds {
        println!("    round {} clusters {} thr {:.3} null {:?}", r.judged_on, r.clusters, r.threshold, r.null_quantiles);
        for c in r.candidates.iter().take(6) {
            println!("      {:28} {:.3} [{:.3} {:.3}] p {:.3} believed {} mdd {:.4} {:?}", c.key, c.held_out_ratio, c.ci95[0], c.ci95[1], c.family_wise_p, c.believed, c.minimum_detectable,
                c.coefficients.iter().chain(&c.nonlinear).map(|e| format!("{:.3}±{:.3}", e.value, e.se)).collect::<Vec<_>>());
        }
    }
}

#[test]
fn look_chain() {
    let lab = lab("chain_a", 0.3e-3, 7);
    let cases: Vec<(&str, Vec<f64>, Vec<(&str, f64)>)> = vec![
        ("", vec![], vec![]),
        ("quadratic_drag", vec![0.01], vec![]),
        ("linear_drag", vec![0.03], vec![]),
        ("gravity_tilt", vec![0.05, -0.03], vec![]),
        ("gravity_scale", vec![0.004], vec![]),
        ("rotational_drag", vec![0.0005], vec![]),
        ("constant_force[link1]", vec![0.05, 0.05, 0.02], vec![]),
        ("tether[link0]", vec![0.3, 0.0], vec![("anchor_x", 1.0), ("anchor_y", 0.5), ("anchor_z", 2.6), ("rest_length", 0.4)]),
        ("crane[link1]", vec![0.1], vec![("pulley_x", 1.0), ("pulley_y", 0.5), ("pulley_z", 2.6)]),
        ("flywheel[link1]", vec![0.002, 0.001, 0.0], vec![]),
        ("thrust[link0]", vec![0.05, 0.05, 0.02, 0.0, 0.0, 0.0], vec![]),
        ("wind", vec![0.01], vec![("wind_x", 3.0), ("wind_y", 1.0)]),
        ("wobbling_mass[link0]", vec![0.1], vec![("frequency", 6.0)]),
    ];
    for (key, theta, set) in cases {
        lab.with(|scene, mut session| {
            println!("== {key} {theta:?} {set:?}");
            if !key.is_empty() {
                let mut choice = Choice::parse(key, scene).unwrap();
                for (name, value) in &set {
                    choice.set(scene, name, *value).unwrap();
                }
                session.inject(&choice, &theta).unwrap();
            }
            let start = Instant::now();
            let d = discover(&session, &catalogue(), &[], &DiscoverOptions::default()).unwrap();
            println!("  {:.2} s", start.elapsed().as_secs_f64());
            print(&d);
        });
    }
}
