//! Tests whether nominal 95 % intervals of an effect's coefficients contain the truth in 95 % of
//! simulated sets: a drag of known size acts on the true motion of a chain, whose markers have
//! noise drawn anew for each set.
//!
//! `ALOFT_COVERAGE_DRAWS=200` runs more sets than the default test, `ALOFT_COVERAGE_SEED` sets the
//! first seed.
#![allow(clippy::unwrap_used, clippy::print_stdout, reason = "tests that print what they measured")]

#[path = "../../regressor/tests/common/mod.rs"]
mod common;

use aloft_discover::{Body, DiscoverOptions, Estimate, Session, TrialInput, catalogue, discover, scene_of};
use aloft_effects::EffectInstance;
use aloft_regressor::WeakOptions;

const MARKER_SD_M: f64 = 0.3e-3;
/// Keys with their coefficients (drag areas, m²) and nonlinear parameters (centres of the links'
/// areas, m). The areas of the links differ so much that one area for the whole body does not do.
const DRAGS: [Drag; 2] = [
    ("quadratic_drag", &[0.01], &[]),
    (
        "quadratic_drag[links]",
        &[0.03, 0.004],
        &[
            ("centre_link0_x", 0.02),
            ("centre_link0_y", 0.10),
            ("centre_link0_z", 0.01),
            ("centre_link1_x", -0.12),
            ("centre_link1_y", 0.01),
            ("centre_link1_z", -0.01),
        ],
    ),
];

type Drag = (&'static str, &'static [f64], &'static [(&'static str, f64)]);

/// Coefficients that a discovery found in one set; `None` if it named another effect.
fn one(truth: &common::Truth, (key, size, set): Drag, seed: u64) -> Option<Vec<Estimate>> {
    let motion = truth.noisy(MARKER_SD_M, seed);
    let stretches = truth.stretches();
    let body = Body {
        model: &truth.model,
        base: &truth.base,
        phi: &truth.phi,
        prior: None,
        mass_kg: truth.mass(),
        plate_centres_m: &[],
    };
    let trials = [TrialInput {
        motion: &motion,
        stretches: &stretches,
        measured: None,
        plates: &[],
        group: None,
        session_time_s: 0.0,
    }];
    let scene = scene_of(&body, &trials);
    let options = DiscoverOptions {
        only: vec!["quadratic_drag".to_owned()],
        null_draws: 20,
        resamples: 2,
        rounds: 1,
        ..DiscoverOptions::default()
    };
    let mut session = Session::new(&body, &scene, &trials, &WeakOptions::default())
        .unwrap()
        .with_white_noise(&body, &trials, &WeakOptions::default())
        .unwrap();
    let mut choice = EffectInstance::parse(key, &scene).unwrap();
    for (name, value) in set {
        choice.set(&scene, name, *value).unwrap();
    }
    session.inject(&choice, size).unwrap();
    let answer = discover(&session, &catalogue(), &[], &options).unwrap();
    answer.found.into_iter().next().filter(|f| f.key == key).map(|f| f.coefficients)
}

fn number(name: &str, usual: u64) -> u64 {
    std::env::var(name).ok().and_then(|s| s.parse().ok()).unwrap_or(usual)
}

#[test]
fn validate_intervals_of_effect_coefficients() {
    let (draws, seed) = (number("ALOFT_COVERAGE_DRAWS", 12), number("ALOFT_COVERAGE_SEED", 60_000));
    let (mut all_hits, mut all) = (0, 0);
    for set in ["chain_a", "chain_p"] {
        let truth = common::load(set);
        for drag in DRAGS {
            let mut hits = vec![0u32; drag.1.len()];
            let mut squares = vec![0.0; drag.1.len()];
            let mut sets = 0u32;
            for found in (0..draws).filter_map(|draw| one(&truth, drag, seed + draw)) {
                sets += 1;
                for (k, (e, truth)) in found.iter().zip(drag.1).enumerate() {
                    let [low, high] = e.ci95.unwrap();
                    hits[k] += u32::from(low <= *truth && *truth <= high);
                    squares[k] += ((e.value - truth) / (0.5 * (high - low))).powi(2);
                }
            }
            // another target is an error of the ranking, counted elsewhere
            assert!(10 * u64::from(sets) >= 9 * draws, "{}: named in {sets} of {draws} sets", drag.0);
            for (k, hits) in hits.iter().enumerate() {
                let (share, rms) = (f64::from(*hits) / f64::from(sets), (squares[k] / f64::from(sets)).sqrt());
                println!("{set}, {}, coefficient {k}: {:.1} % of {sets} sets, at {rms:.2}", drag.0, 100.0 * share);
                let low = 0.85 - 3.0 * (0.85 * 0.15 / f64::from(sets)).sqrt();
                assert!(share >= low, "{set}, {}, coefficient {k}: {share:.3}", drag.0);
            }
            all_hits += hits.iter().sum::<u32>();
            all += sets * hits.len() as u32;
        }
    }
    let share = f64::from(all_hits) / f64::from(all);
    let margin = |p: f64| 3.0 * (p * (1.0 - p) / f64::from(all)).sqrt();
    println!("all: {:.1} % of {all}", 100.0 * share);
    assert!(share >= 0.93 - margin(0.93) && share <= 0.97 + margin(0.97), "{share:.3} of {all}");
}
