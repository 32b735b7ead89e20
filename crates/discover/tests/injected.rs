//! Effects added to true motions with marker noise are named; without an effect none is named; the
//! run is quick.
#![allow(clippy::unwrap_used, clippy::print_stdout, reason = "a test that fails should say where")]
#![allow(clippy::type_complexity, reason = "tables of cases are read once, beside their use")]

#[path = "../../regressor/tests/common/mod.rs"]
mod common;

#[path = "added/compass.rs"]
mod compass;

use aloft_discover::*;
use aloft_effects::{EFFECTS, Effect, EffectInstance, EffectKind, FormulaEffect, Scene, Separation};
use aloft_regressor::WeakOptions;

/// An effect, its coefficients, its nonlinear parameters.
type Hidden<'h> = (&'h str, &'h [f64], &'h [(&'h str, f64)]);

struct Lab {
    truth: common::Truth,
    motion: aloft_body::Motion,
    stretches: Vec<aloft_regressor::Stretch>,
}

fn lab() -> Lab {
    let truth = common::load("chain_a");
    let motion = truth.noisy(0.3e-3, 7);
    let stretches = truth.stretches();
    Lab { truth, motion, stretches }
}

impl Lab {
    fn body(&self) -> Body<'_> {
        Body {
            model: &self.truth.model,
            base: &self.truth.base,
            phi: &self.truth.phi,
            prior: None,
            mass_kg: self.truth.mass(),
            plate_centres_m: &[],
        }
    }
    fn trials(&self) -> [TrialInput<'_>; 1] {
        [TrialInput {
            motion: &self.motion,
            stretches: &self.stretches,
            measured: None,
            plates: &[],
            group: None,
            session_time_s: 0.0,
        }]
    }
    fn with<T>(&self, f: impl FnOnce(&Scene, Session<'_>) -> T) -> T {
        let (body, trials) = (self.body(), self.trials());
        let scene = scene_of(&body, &trials);
        let session = Session::new(&body, &scene, &trials, &WeakOptions::default())
            .unwrap()
            .with_white_noise(&body, &trials, &WeakOptions::default())
            .unwrap();
        f(&scene, session)
    }
    fn find(&self, hidden: &[Hidden<'_>], options: &DiscoverOptions) -> Discovery {
        self.with(|scene, mut session| {
            for (key, theta, set) in hidden {
                let mut choice = EffectInstance::parse(key, scene).unwrap();
                for (name, value) in *set {
                    choice.set(scene, name, *value).unwrap();
                }
                session.inject(&choice, theta).unwrap();
            }
            discover(&session, &catalogue(), &[], options).unwrap()
        })
    }
}

fn only(names: &[&str]) -> DiscoverOptions {
    DiscoverOptions { only: names.iter().map(|n| (*n).to_owned()).collect(), null_draws: 60, ..Default::default() }
}

#[test]
fn nothing_is_claimed_where_nothing_is() {
    let d = lab().find(&[], &DiscoverOptions::default());
    assert_eq!(d.verdict, Verdict::NothingMissing, "{}", d.words);
    assert!(d.effects.is_empty() && d.found.is_empty());
    assert!(d.noise_floor.is_nan(), "no comparison, no floor");
    assert!(d.candidates.iter().all(|c| c.held_out_ratio > 0.9), "{}", d.candidates[0].key);
}

#[test]
fn errors_and_floor_are_those_of_the_comparison() {
    let ci = Some([0.8, 1.45]);
    let standing =
        |held_out_error| HeldOutResult { held_out_error, noise_floor: 1.0, noise_floor_ci95: ci, by_parameters: None };
    // one round: with a floor known, rounds end where the error reaches it
    let options = DiscoverOptions { rounds: 1, ..only(&["quadratic_drag", "gravity_scale"]) };
    let run = |standing: Option<HeldOutResult>, size: f64| {
        lab().with(|scene, mut session| {
            session.inject(&EffectInstance::parse("quadratic_drag", scene).unwrap(), &[size]).unwrap();
            discover(&session.with_model_error(standing, None), &catalogue(), &[], &options).unwrap()
        })
    };
    for size in [0.0, 0.01] {
        let (bare, stated) = (run(None, size), run(Some(standing(1.4)), size));
        // errors in newtons come from the comparison; verdict and gain do not change
        assert!((stated.held_out_error - 1.4).abs() < 1e-12 && stated.noise_floor == 1.0);
        assert!(stated.noise_floor_ci95 == ci);
        assert_eq!((stated.verdict, &stated.effects), (bare.verdict, &bare.effects));
        let gain = |d: &Discovery| d.held_out_error_after / d.held_out_error;
        assert!((gain(&stated) - gain(&bare)).abs() < 1e-12);
    }
    // nothing is missing only where the error is at its floor; beyond the interval nothing is known
    let beyond = run(Some(standing(1.46)), 0.0);
    assert_eq!((beyond.verdict, beyond.effects.len()), (Verdict::NotDetectable, 0), "{}", beyond.words);
    assert!(beyond.words.contains("a complete model would leave more than"), "{}", beyond.words);
    let above = run(Some(standing(1.6)), 0.0);
    assert_eq!((above.verdict, above.effects.len()), (Verdict::Unexplained, 0), "{}", above.words);
}

#[test]
fn effects_are_named_with_their_size() {
    let lab = lab();
    let options = DiscoverOptions { rounds: 1, ..Default::default() };
    let cases: [Hidden<'_>; 6] = [
        ("quadratic_drag", &[0.01], &[]),
        ("gravity_tilt", &[0.05, -0.03], &[]),
        ("gravity_scale", &[0.004], &[]),
        ("flywheel[link1]", &[0.002, 0.001, 0.0], &[]),
        ("thrust[link0]", &[0.05, 0.05, 0.02, 0.0, 0.0, 0.0], &[]),
        (
            "tether[link0]",
            &[0.3, 0.0],
            &[("anchor_x", 1.0), ("anchor_y", 0.5), ("anchor_z", 2.6), ("rest_length", 0.4)],
        ),
    ];
    for case in cases {
        let d = lab.find(&[case], &options);
        let id = case.0.split('[').next().unwrap();
        assert_eq!((d.verdict, d.effects.as_slice()), (Verdict::Supported, &[id.to_owned()][..]), "{}", d.words);
        let c = d.candidates.iter().find(|c| c.effect == id).unwrap();
        assert!(c.believed && c.ci95[0] <= c.held_out_ratio && c.held_out_ratio <= c.ci95[1]);
        assert!(c.minimum_detectable < 0.6 * case.1.iter().map(|x| x * x).sum::<f64>().sqrt(), "{}", c.key);
        // drag may have been found as one area per link
        let value: f64 =
            if id == "quadratic_drag" { c.coefficients.iter().map(|e| e.value).sum() } else { c.coefficients[0].value };
        let se = c.coefficients[0].se;
        assert!((value - case.1[0]).abs() < (4.0 * se).max(0.1 * case.1[0].abs()), "{}: {value} ± {se}", c.key);
        // the one is the share of rows in units of their noise, the other that of held-out rows
        assert!((d.held_out_error_after / d.held_out_error - c.held_out_ratio).abs() < 0.1);
    }
}

/// A rope to a distant pulley does the same as a constant force: the simpler one is named, alone or
/// first; a pulley nearby stays a crane.
#[test]
fn a_limit_of_a_richer_effect_is_named_by_the_simpler_one() {
    let lab = lab();
    let options = DiscoverOptions { rounds: 1, ..only(&["constant_force", "crane", "tether", "wind", "gravity_tilt"]) };
    let point: &[(&str, f64)] = &[("point_x", -0.1), ("point_y", 0.02), ("point_z", 0.0)];
    let far = lab.find(&[("constant_force[link1]", &[0.024, -0.024, 0.02], point)], &options);
    assert_eq!(far.effects.first().map(String::as_str), Some("constant_force"), "{}", far.words);
    let pulley: &[(&str, f64)] = &[("pulley_x", 1.0), ("pulley_y", -0.6), ("pulley_z", 2.4)];
    let near = lab.find(&[("crane[link0]", &[0.2], pulley)], &options);
    assert!(near.effects.iter().any(|e| e == "crane"), "{}", near.words);
}

/// A weak effect is ranked at starting values of its place. Once it is named, the place is fitted,
/// and the intervals hold what the recordings do not show of it.
#[test]
fn the_place_of_a_weak_tether_is_fitted_and_uncertain() {
    const TRUTH: [(&str, f64); 4] = [("anchor_x", 1.1), ("anchor_y", -0.8), ("anchor_z", 2.7), ("rest_length", 0.5)];
    let options = DiscoverOptions { rounds: 1, ..only(&["constant_force", "crane", "tether"]) };
    let (mut inside, mut all, mut at_start) = (0, 0, 0);
    for seed in 1..=8 {
        let mut lab = lab();
        lab.motion = lab.truth.noisy(0.3e-3, seed);
        for stiffness in [0.012, 0.016] {
            let d = lab.find(&[("tether[link0]", &[stiffness, 0.0], &TRUTH)], &options);
            assert!(d.effects.iter().any(|e| e == "tether"), "{}", d.words);
            let Some(found) = d.found.iter().find(|f| f.effect == "tether") else { continue };
            at_start += usize::from(found.nonlinear.iter().any(|e| e.at_bound));
            for (name, value) in TRUTH.iter().chain(&[("stiffness", stiffness), ("damping", 0.0)]) {
                let of = found.nonlinear.iter().chain(&found.coefficients).find(|e| e.name == *name).unwrap();
                let Some([low, high]) = of.ci95 else { continue };
                assert!(high - low > 1e-4 && high - low < 4.0, "{of:?}");
                inside += usize::from((low..=high).contains(value));
                all += 1;
            }
        }
    }
    // intervals of first order, and each noise counts twice
    assert!(all >= 80 && inside * 5 >= all * 4, "{inside} of {all} within their intervals");
    assert!(at_start <= 2, "{at_start} of 16 at starting values");
}

/// Anchor position and length of a tether compensate each other: the intervals have to show it.
#[test]
fn intervals_of_a_tether_hold_the_truth() {
    const TRUTH: [(&str, f64); 4] = [("anchor_x", 1.0), ("anchor_y", 0.5), ("anchor_z", 2.6), ("rest_length", 0.4)];
    let (mut inside, mut all, mut widest) = (0, 0, 0.0f64);
    for seed in 0..6 {
        let mut lab = lab();
        lab.motion = lab.truth.noisy(0.3e-3, 70 + seed);
        let options = DiscoverOptions { rounds: 1, ..only(&["tether"]) };
        let d = lab.find(&[("tether[link0]", &[0.15, 0.0], &TRUTH)], &options);
        let Some(found) = d.found.iter().find(|f| f.key == "tether[link0]") else { continue };
        let truth = TRUTH.iter().chain(&[("stiffness", 0.15), ("damping", 0.0)]);
        for (name, value) in truth {
            let of = found.nonlinear.iter().chain(&found.coefficients).find(|e| e.name == *name).unwrap();
            println!("{seed} {name}: {:.4} ± {:.4}, truth {value}", of.value, of.se);
            assert!(of.se.is_finite(), "{of:?}");
            inside += usize::from((of.value - value).abs() <= 2.0 * of.se + 1e-9);
            all += 1;
            if name.starts_with("anchor") {
                widest = widest.max(of.se);
            }
        }
    }
    assert!(all >= 24 && inside * 10 >= all * 9, "{inside} of {all} within two standard errors");
    // and the intervals are narrow enough to be useful
    assert!(widest < 3.0, "{widest} m");
}

/// Weak linear drag is hardly another force than weak quadratic drag; where both are named, what
/// tells them apart is said.
#[test]
fn linear_drag_is_named_alone_or_beside_quadratic_with_what_separates_them() {
    let d = lab().find(&[("linear_drag", &[0.006], &[])], &only(&["linear_drag", "quadratic_drag", "gravity_tilt"]));
    assert!(d.effects.iter().any(|e| e == "linear_drag"), "{}", d.words);
    let told = d.advice.iter().any(|a| a.contains("speeds"));
    assert!(d.effects.len() == 1 || told, "{:?}", d.advice);
}

#[test]
fn two_effects_are_found_one_after_the_other() {
    let d = lab().find(
        &[("gravity_tilt", &[0.05, -0.03], &[]), ("flywheel[link1]", &[0.001, 0.0005, 0.0], &[])],
        &only(&["gravity_tilt", "flywheel", "quadratic_drag", "linear_drag"]),
    );
    let mut names = d.effects.clone();
    names.sort();
    assert_eq!(names, ["flywheel", "gravity_tilt"], "{}", d.words);
    let tilt = d.found.iter().find(|f| f.effect == "gravity_tilt").unwrap();
    assert!((tilt.coefficients[0].value - 0.05).abs() < 4e-3);
}

#[test]
fn a_user_s_formula_is_ranked_like_the_catalogue() {
    let lab = lab();
    let sail: FormulaEffect = serde_json::from_str(
        r#"{"id": "sail", "point": {"link": "link1"}, "force": ["-c*speed*v_x", "-c*speed*v_y", "-c*speed*v_z"],
            "coefficients": [{"name": "c", "unit": "kg/m", "lower": 0}]}"#,
    )
    .unwrap();
    lab.with(|scene, mut session| {
        let compiled = sail.compile(scene).unwrap();
        let choice = EffectInstance::new(&compiled, aloft_effects::Target::Body, scene);
        assert_eq!(choice.names(scene), ["sail.c"]);
        session.inject(&choice, &[0.02]).unwrap();
        let mut effects = catalogue();
        effects.push(&compiled);
        let options = only(&["sail", "gravity_tilt", "rotational_drag", "flywheel"]);
        let d = discover(&session, &effects, &[], &options).unwrap();
        assert_eq!((d.verdict, d.effects.as_slice()), (Verdict::Supported, &["sail".to_owned()][..]), "{}", d.words);
        assert_eq!(d.candidates[0].kind, EffectKind::Physics);
        assert!((d.found[0].coefficients[0].value - 0.02).abs() < 2e-3);
        // with the effect in the model nothing more is missing
        let after = discover(&session, &effects, &[choice], &options).unwrap();
        assert_eq!(after.verdict, Verdict::NothingMissing, "{}", after.words);
    });
}

/// A new effect needs one file and one entry in the list: its declarations are all that discovery
/// needs to find and report it.
#[test]
fn an_effect_added_in_one_file_is_found_like_the_others() {
    let effects: Vec<&dyn Effect> = [EFFECTS, &[&compass::Compass]].concat();
    let torque = [0.02, -0.01, 0.015];
    lab().with(|scene, mut session| {
        let choice = EffectInstance::among("compass[link1]", scene, &effects).unwrap();
        session.inject(&choice, &torque).unwrap();
        let options = only(&["compass", "gravity_tilt", "rotational_drag", "flywheel", "thrust"]);
        let d = discover(&session, &effects, &[], &options).unwrap();
        assert_eq!((d.verdict, d.effects.as_slice()), (Verdict::Supported, &["compass".to_owned()][..]), "{}", d.words);
        assert_eq!(d.found[0].key, "compass[link1]");
        for (found, truth) in d.found[0].coefficients.iter().zip(torque) {
            assert!(found.se > 0.0 && (found.value - truth).abs() < (4.0 * found.se).max(1e-3), "{found:?}, {truth}");
        }
        // advice on separating it from others comes from its own file
        let about = |id: &str| effects.iter().find(|e| e.id() == id).unwrap().about();
        for (other, recording) in [
            ("flywheel", "the same motion with the magnet taken out"),
            ("thrust", Separation::TurnedLaboratory.describe()),
            ("gravity_scale", Separation::KnownFall.describe()),
        ] {
            assert_eq!(about(other).told_apart_by(&about("compass")), recording);
        }
    });
}

#[test]
fn a_self_test_hits_at_twice_the_detectable_size() {
    let lab = lab();
    lab.with(|_, session| {
        let discover = only(&["gravity_tilt", "rotational_drag", "flywheel", "gravity_scale"]);
        let heard = std::sync::atomic::AtomicUsize::new(0);
        let options = SelfTestOptions { discover, ..Default::default() };
        let table = self_test(&session, &catalogue(), &[], &options, &|p| {
            assert!(p.done <= p.of && !p.last.outcome.is_empty());
            heard.fetch_add(1, std::sync::atomic::Ordering::Relaxed);
        })
        .unwrap();
        assert_eq!(heard.into_inner(), table.injections.len());
        assert_eq!(table.summary.len(), 3);
        let twice = &table.summary[2];
        assert_eq!((twice.multiple, twice.injections), (2.0, 4));
        assert!(twice.right >= 0.75 && twice.wrong == 0.0, "{table:?}");
        assert!(table.summary[0].wrong == 0.0);
    });
}

/// Adding one effect gives the same result as the ranking; the ladder consists
/// of such steps.
#[test]
fn an_addition_says_what_the_ranking_says() {
    let lab = lab();
    lab.with(|scene, mut session| {
        let drag = EffectInstance::parse("quadratic_drag", scene).unwrap();
        let tilt = EffectInstance::parse("gravity_tilt", scene).unwrap();
        session.inject(&drag, &[0.01]).unwrap();
        session.inject(&tilt, &[0.04, -0.02]).unwrap();
        let options = only(&["gravity_tilt", "rotational_drag"]);
        let ranked = discover(
            &session,
            &catalogue(),
            std::slice::from_ref(&drag),
            &DiscoverOptions { rounds: 1, ..options.clone() },
        )
        .unwrap();
        let steps = ladder(&session, &[drag.clone(), tilt], &options).unwrap();
        let of = ranked.candidates.iter().find(|c| c.effect == "gravity_tilt").unwrap();
        assert_eq!((steps.len(), steps[1].key.as_str(), steps[1].judged_on.as_str()), (2, "gravity_tilt", "flight"));
        // rows in their fixed weights, and in units of their noise
        assert!(steps[1].ratio < 0.25 && of.held_out_ratio < 0.25, "{} {}", steps[1].ratio, of.held_out_ratio);
        assert!((steps[1].held_out_error_before - steps[0].held_out_error).abs() < 1e-9 * steps[0].held_out_error);
        assert!((steps[1].coefficients[0].value - 0.04).abs() < 3e-3);
        assert!(steps[0].ratio < 1.0 && steps[1].ratio < 0.5 && steps[1].ci95[1] < 1.0);
        let tare = EffectInstance::parse("added_mass[link1]", scene).unwrap();
        assert!(addition(&session, &[drag], &tare, &options).unwrap().ratio > 0.9);
    });
}

#[test]
fn the_answer_does_not_depend_on_the_number_of_threads() {
    let lab = lab();
    let options = only(&["quadratic_drag", "tether", "flywheel"]);
    let run = |threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        let d = pool.install(|| lab.find(&[("quadratic_drag", &[0.004], &[])], &options));
        serde_json::to_string(&d).unwrap()
    };
    assert_eq!(run(1), run(3));
}

#[test]
fn too_little_is_said_to_be_too_little() {
    let mut lab = lab();
    lab.stretches.truncate(1);
    let (body, trials) = (lab.body(), lab.trials());
    let scene = scene_of(&body, &trials);
    let session = Session::new(&body, &scene, &trials, &WeakOptions::default())
        .unwrap()
        .with_white_noise(&body, &trials, &WeakOptions::default())
        .unwrap();
    assert!(matches!(
        discover(&session, &catalogue(), &[], &DiscoverOptions::default()),
        Err(DiscoverError::TooFew { .. })
    ));
    let json = serde_json::to_value(Verdict::NotDetectable).unwrap();
    assert_eq!(json, "not_detectable");
}
