//! Errors that are the same in all recordings, as a comparison draws them, are in the intervals of
//! effects and laws.
#![allow(clippy::unwrap_used, reason = "a test that fails should say where")]

#[path = "../../regressor/tests/common/mod.rs"]
mod common;

use aloft_discover::*;
use aloft_effects::{EffectInstance, FormulaEffect, Target};
use aloft_regressor::WeakOptions;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

const DRAWS: usize = 8;
/// 97.5 % point of Student's t with as many degrees of freedom as draws.
const T975: f64 = 2.306;

/// What an uncertain geometry does in one draw after the other.
#[derive(Default)]
struct Drawn {
    /// Force along x of the world in every window, N.
    force_x_n: [f64; DRAWS],
    /// Change of the zero of the last joint, rad.
    zero_rad: [f64; DRAWS],
}

fn root_mean_square(x: &[f64; DRAWS]) -> f64 {
    (x.iter().map(|x| x * x).sum::<f64>() / DRAWS as f64).sqrt()
}

/// The answer on thirty throws of a chain in which something hidden acts, with draws if there are
/// any.
fn find(law: Option<&FormulaEffect>, effect: Option<(&str, &[f64])>, drawn: Option<&Drawn>) -> (Discovery, f64) {
    let truth = common::load("chain_a");
    let motion = truth.noisy(0.3e-3, 11);
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
    let mut session = Session::new(&body, &scene, &trials, &WeakOptions::default())
        .unwrap()
        .with_white_noise(&body, &trials, &WeakOptions::default())
        .unwrap();
    let quick = DiscoverOptions { null_draws: 60, rounds: 1, ..DiscoverOptions::default() };
    let closed = DiscoverOptions { closed: true, only: vec!["gravity_scale".to_owned()], ..quick.clone() };
    let floor = discover(&session, &catalogue(), &[], &closed).unwrap().held_out_error;
    if let Some((key, theta)) = effect {
        session.inject(&EffectInstance::parse(key, &scene).unwrap(), theta).unwrap();
    }
    if let Some(formula) = law {
        let compiled = formula.compile(&scene).unwrap();
        let choice =
            EffectInstance { effect: &compiled, target: Target::Body, nonlinear: Vec::new(), trials: Vec::new() };
        session.inject(&choice, &[1.0]).unwrap();
    }
    let standing = HeldOutResult {
        held_out_error: discover(&session, &catalogue(), &[], &closed).unwrap().held_out_error,
        noise_floor: floor,
        noise_floor_ci95: Some([0.85 * floor, 1.15 * floor]),
        by_parameters: None,
    };
    session = session.with_model_error(Some(standing), None);
    let centres: Vec<usize> = stretches.iter().flat_map(|s| s.first_frame..s.end_frame).collect();
    let in_flight = vec![true; centres.len()];
    if let Some(drawn) = drawn {
        // beside noise of the size of the floor
        let mut rng = ChaCha8Rng::seed_from_u64(5);
        let mut noise = |i: usize| rng.random_range(-0.5..0.5) * floor * if i % 6 < 3 { 1.0 } else { 0.1 };
        let mut of_draw = |f: &f64| {
            let row = |i: usize| (noise(i) + if i.is_multiple_of(6) { *f } else { 0.0 }) as f32;
            (0..6 * centres.len()).map(row).collect()
        };
        let errors: Vec<Vec<f32>> = drawn.force_x_n.iter().map(&mut of_draw).collect();
        let nv = truth.model.nv;
        let of_joint = |z: &f64| (0..nv).map(|k| if k + 1 == nv { *z as f32 } else { 0.0 }).collect();
        let zeros: Vec<Vec<f32>> = drawn.zero_rad.iter().map(of_joint).collect();
        let draws = TrialDraws {
            trial: &motion.trial,
            centres: &centres,
            in_flight: &in_flight,
            errors: &errors,
            zeros: &zeros,
        };
        session = session.with_draws(&[draws], &[], 0.0);
    }
    (discover(&session, &catalogue(), &[], &quick).unwrap(), truth.mass())
}

fn half(e: &Estimate) -> f64 {
    let [low, high] = e.ci95.unwrap();
    0.5 * (high - low)
}

#[test]
fn a_force_that_all_draws_share_is_in_the_interval_of_a_tilt() {
    let forces = [0.04, -0.02, 0.01, -0.05, 0.03, 0.0, -0.03, 0.02];
    let hidden = Some(("gravity_tilt", &[0.4, -0.3][..]));
    let tilt = |drawn: Option<&Drawn>| {
        let (d, mass_kg) = find(None, hidden, drawn);
        let found = d.found.into_iter().find(|f| f.effect == "gravity_tilt").unwrap();
        (found.coefficients, mass_kg)
    };
    let (plain, mass_kg) = tilt(None);
    let (wider, _) = tilt(Some(&Drawn { force_x_n: forces, ..Drawn::default() }));
    let expected = T975 * root_mean_square(&forces) / mass_kg;
    assert!(half(&plain[0]) < 0.5 * expected, "{} {expected}", half(&plain[0]));
    // beside what all draws share there is noise
    assert!((0.9..1.25).contains(&(half(&wider[0]) / expected)), "{} {expected}", half(&wider[0]));
    // a force along x is no tilt along y
    assert!(half(&wider[1]) < 0.5 * half(&wider[0]), "{} {}", half(&wider[1]), half(&wider[0]));
}

#[test]
fn an_uncertain_zero_of_a_joint_is_in_the_interval_of_a_switch_by_its_angle() {
    let formula: FormulaEffect = serde_yaml::from_str(
        "id: hidden\npoint: {link: link1}\naxes: link\n\
         moment: ['0', '0', 'c*(1+tanh((q_link1-at)/width))/2']\n\
         coefficients: [{name: c, unit: N*m}]\n\
         constants: [{name: at, unit: '1', value: 0.1}, {name: width, unit: '1', value: 0.02}]",
    )
    .unwrap();
    let zeros = [0.05, -0.03, 0.02, -0.06, 0.04, 0.01, -0.02, 0.03];
    let threshold = |drawn: Option<&Drawn>| {
        let (d, _) = find(Some(&formula), None, drawn);
        let law = d.open.unwrap().laws.into_iter().next().unwrap();
        assert_eq!(law.variables, ["q_link1"], "{}", law.text);
        law.parameters.into_iter().find(|p| p.name == "x0").unwrap()
    };
    let plain = threshold(None);
    let wider = threshold(Some(&Drawn { zero_rad: zeros, ..Drawn::default() }));
    let expected = T975 * root_mean_square(&zeros);
    assert!((plain.value - 0.1).abs() < half(&plain) && half(&plain) < 0.3 * expected, "{plain:?}");
    assert!((half(&wider) / expected - 1.0).abs() < 0.15, "{} {expected}", half(&wider));
}
