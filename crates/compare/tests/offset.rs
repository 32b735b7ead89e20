//! Plates that were never unloaded: a planted constant is estimated, subtracted and reported;
//! nothing else changes.

#![allow(clippy::unwrap_used, reason = "a test that cannot be set up fails")]

use aloft_body::{BaseParameters, JointSpec, LinkSpec, Model, ModelSpec, Motion, Phi, State};
use aloft_compare::{
    Body, Candidate, CompareOptions, Comparison, GroupedBy, Measured, Noise, TrialInput, WrenchErrors, compare,
};
use aloft_signal::derivative::derivatives_of_run;
use nalgebra::{DMatrix, DVector, Quaternion, UnitQuaternion, Vector3, Vector6};
use rand::SeedableRng;
use rand_distr::{Distribution, StandardNormal};
use std::ops::Range;

const RATE_HZ: f64 = 200.0;
/// One period of the motion, 7.5 s, so that momentum ends as it began.
const N: usize = 1500;
/// Planted offset of the plates.
const PLANTED: [f64; 6] = [0.8, -0.5, 1.1, -0.4, 0.35, 0.2];

fn two_links() -> Model {
    let link = |name: &str, parent: Option<&str>, joint, y| LinkSpec {
        name: name.into(),
        parent: parent.map(Into::into),
        joint,
        position_m: [0.02, y, 0.01],
        rpy_rad: [0.0; 3],
        inertia: None,
    };
    let links = vec![link("trunk", None, JointSpec::Free, 0.0), link("leg", Some("trunk"), JointSpec::RevoluteZ, -0.3)];
    Model::from_spec(&ModelSpec::new("two".into(), links)).unwrap()
}

fn truth() -> Vec<Phi> {
    let phi = |m: f64, c: [f64; 3], i: [f64; 3]| {
        Phi::from_column_slice(&[m, m * c[0], m * c[1], m * c[2], i[0], i[1], i[2], 0.004, -0.002, 0.003])
    };
    vec![phi(40.0, [0.01, 0.15, 0.0], [1.9, 0.6, 2.0]), phi(15.0, [0.03, -0.25, 0.0], [1.2, 0.1, 1.3])]
}

/// An exercise on the spot, 1.5 m and 2 m from the world origin.
fn exercise(model: &Model) -> Motion {
    let q: Vec<f64> = (0..N)
        .flat_map(|k| {
            let t = k as f64 / RATE_HZ;
            let s = |a: f64, turns: f64| a * (std::f64::consts::TAU * turns * t / 7.5).sin();
            let root = UnitQuaternion::from_scaled_axis(Vector3::new(s(0.3, 4.0), s(0.2, 3.0), s(0.25, 5.0)));
            [&[1.5 + s(0.1, 4.0), 2.0 + s(0.08, 5.0), 1.0 + s(0.1, 6.0)], root.coords.as_slice(), &[0.4 + s(0.5, 7.0)]]
                .concat()
        })
        .collect();
    let rates = |x: &[f64], width: usize| {
        let (mut first, mut second) = (vec![0.0; x.len()], vec![0.0; x.len()]);
        (0..width).for_each(|c| derivatives_of_run(x, width, c, RATE_HZ, &mut first, &mut second));
        first
    };
    let q1 = rates(&q, 8);
    let mut v = Vec::with_capacity(7 * N);
    for f in 0..N {
        let (q, q1) = (&q[8 * f..8 * f + 8], &q1[8 * f..8 * f + 8]);
        let quaternion = |x: &[f64]| Quaternion::new(x[6], x[3], x[4], x[5]);
        let linear = UnitQuaternion::from_quaternion(quaternion(q)).inverse() * Vector3::new(q1[0], q1[1], q1[2]);
        let omega = 2.0 * (quaternion(q).conjugate() * quaternion(q1)).vector();
        v.extend([linear.as_slice(), omega.as_slice(), &[q1[7]]].concat());
    }
    let a = rates(&v, 7);
    assert_eq!((model.nq, model.nv), (8, 7));
    Motion { trial: "exercise01".into(), rate_hz: RATE_HZ, nq: 8, nv: 7, q, v, a, ..Motion::default() }
}

/// The wrench of the true model with 2 N and 0.3 N·m of noise (about the root), world axes about
/// the world origin.
fn plates(model: &Model, m: &Motion, offset: &[f64; 6]) -> Measured {
    let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(5);
    let mut state = State::new(model);
    let mut y = DMatrix::zeros(6, 20);
    let phi = DVector::from_iterator(20, truth().iter().flat_map(|p| p.iter().copied().collect::<Vec<_>>()));
    let series: Vec<Vector6<f64>> = (0..m.n_frames())
        .map(|f| {
            state.forward_acceleration(model, m.q(f), m.v(f), m.a(f));
            state.base_wrench_regressor(model, &mut y);
            let mut w = &y * &phi;
            for (i, x) in w.iter_mut().enumerate() {
                let z: f64 = StandardNormal.sample(&mut rng);
                *x += if i < 3 { 2.0 * z } else { 0.3 * z };
            }
            let root = state.world_from_link[0];
            let force = root.rotation * Vector3::new(w[0], w[1], w[2]);
            let moment = root.rotation * Vector3::new(w[3], w[4], w[5]) + root.translation.vector.cross(&force);
            Vector6::new(force.x, force.y, force.z, moment.x, moment.y, moment.z) + Vector6::from(*offset)
        })
        .collect();
    Measured { filtered: series.clone(), unfiltered: series, noise_density: Vector6::zeros() }
}

/// One trial, several models.
fn run(
    candidates: &[(&str, Vec<Phi>)],
    plates: &Measured,
    untared: bool,
    flights: &[Range<usize>],
    mass_kg: Option<f64>,
) -> Comparison {
    let model = two_links();
    let base = BaseParameters::of(&model);
    let motion = exercise(&model);
    let prior = truth();
    let body = Body { model: &model, base: &base, prior: &prior };
    let models: Vec<Candidate> = candidates.iter().map(|(n, phi)| Candidate::links(*n, &base, phi)).collect();
    let trial =
        TrialInput { unfiltered: Some(&motion), measured: Some(plates), untared, ..TrialInput::new(&motion, flights) };
    let options = CompareOptions { mass_kg, ..CompareOptions::default() };
    compare(&body, &models, &[trial], Noise::Unknown, &options).unwrap().0
}

fn recorded(offset: &[f64; 6]) -> Measured {
    let model = two_links();
    plates(&model, &exercise(&model), offset)
}

/// Link parameters with the leg's centre of mass moved and its mass changed.
fn changed(dm_kg: f64, dmc_kgm: f64) -> Vec<Phi> {
    let mut phi = truth();
    phi[1][0] += dm_kg;
    phi[1][2] += dmc_kgm;
    phi
}

fn near(a: &WrenchErrors, b: &WrenchErrors, within: f64) -> bool {
    (a.size() - b.size()).abs() <= within * b.size()
}

#[test]
fn a_planted_offset_is_found_and_the_error_falls_back_to_that_of_tared_plates() {
    let models = [("truth", truth()), ("wrong", changed(0.0, 0.4))];
    let twin = run(&models, &recorded(&[0.0; 6]), false, &[], None);
    let c = run(&models, &recorded(&PLANTED), true, &[], None);
    let trial = &c.first.trials[0];
    let offset = trial.offset.unwrap();
    assert!(trial.untared && offset.frames == N - 20);
    for axis in 0..3 {
        assert!((offset.force_n[axis] - PLANTED[axis]).abs() < 0.2, "{offset:?}");
        // 2 N of noise, 2.5 m away, in 1480 frames
        assert!((offset.moment_nm[axis] - PLANTED[3 + axis]).abs() < 0.4, "{offset:?}");
    }
    assert!(near(&c.first.held_out, &twin.first.held_out, 0.01));
    let (weak, tared) = (&c.first.held_out_weak, &twin.first.held_out_weak);
    let measured = &c.first.held_out_weak_as_measured;
    println!("weak windows: twin {:.3}, tared {:.3}, as measured {:.3}", tared.size(), weak.size(), measured.size());
    assert!(weak.windows > 50 && weak.size() < 1.05 * tared.size() && measured.size() > 3.0 * weak.size());
    assert!(weak.force_n.bias.iter().all(|b| b.abs() < 0.1) && weak.moment_nm.bias.iter().all(|b| b.abs() < 0.05));
    // the figures as measured contain the planted constant, axis by axis
    for axis in 0..3 {
        let grown = measured.force_n.bias[axis] - tared.force_n.bias[axis];
        assert!((grown + PLANTED[axis]).abs() < 1e-6, "{grown}");
    }
    assert!(near(&trial.contact_as_measured, &c.first.held_out_as_measured, 0.0));
    // groups use the error with the offset subtracted
    let contact = c.first.breakdown.iter().find(|g| g.by == GroupedBy::Phase).unwrap();
    assert!(near(&contact.errors, &c.first.held_out, 1e-12));
    assert!(c.words.iter().any(|w| w.contains("exercise01 were never unloaded") && w.contains("would hide")));
    assert!(c.words.iter().any(|w| w.starts_with("As measured")), "{:#?}", c.words);
    // serialisation round trip
    let text = serde_json::to_value(&c).unwrap();
    assert!(text["trials"][0]["offset"]["force_n"][2].is_number());
    assert!(text["held_out_weak_as_measured"]["moment_nm"]["mae"][0].is_number());
    let back: Comparison = serde_json::from_value(text.clone()).unwrap();
    assert!(serde_json::to_value(&back).unwrap() == text);
}

#[test]
fn what_is_planted_does_not_matter_to_any_model() {
    let models = [("truth", truth()), ("wrong", changed(0.5, 0.4))];
    let [a, b] = [[0.0; 6], PLANTED].map(|offset| run(&models, &recorded(&offset), true, &[], None));
    for (a, b) in a.models().zip(b.models()) {
        assert!(near(&a.held_out, &b.held_out, 1e-6));
        assert!((a.held_out_weak.size() - b.held_out_weak.size()).abs() < 1e-6);
        let (x, y) = (a.trials[0].offset.unwrap(), b.trials[0].offset.unwrap());
        for axis in 0..3 {
            assert!((y.force_n[axis] - x.force_n[axis] - PLANTED[axis]).abs() < 1e-6);
            assert!((y.moment_nm[axis] - x.moment_nm[axis] - PLANTED[3 + axis]).abs() < 1e-6);
        }
    }
    // an error that moves with the body remains
    assert!(a.beside[0].held_out_weak.size() > 2.0 * a.first.held_out_weak.size());
}

#[test]
fn tared_trials_and_trials_with_flights_keep_their_constants() {
    let models = [("truth", truth()), ("heavy", changed(0.5, 0.0))];
    let plates = recorded(&PLANTED);
    let flights: Vec<Range<usize>> = std::iter::once(600..700).collect();
    let tared = run(&models, &plates, false, &[], Some(55.0));
    let flying = run(&models, &plates, true, &flights, Some(55.0));
    for c in [&tared, &flying] {
        for m in c.models() {
            assert!(m.trials[0].offset.is_none() && !m.trials[0].untared);
            assert!(m.held_out == m.held_out_as_measured && m.held_out_weak == m.held_out_weak_as_measured);
        }
        assert!(!c.words.iter().any(|w| w.contains("never unloaded")));
    }
    let bias = |m: &aloft_compare::ModelComparison| m.held_out_weak.force_n.bias[2];
    assert!((bias(&tared.first) + PLANTED[2]).abs() < 0.1);
    // a wrong mass remains in the error
    assert!((bias(&tared.beside[0]) - bias(&tared.first) - 0.5 * 9.81).abs() < 0.1, "{}", bias(&tared.beside[0]));
}

#[test]
fn the_mass_from_a_scale_keeps_a_wrong_mass_in_sight() {
    let models = [("heavy", changed(0.5, 0.0)), ("truth", truth()), ("nothing", vec![Phi::zeros(); 2])];
    let plates = recorded(&PLANTED);
    let own = run(&models, &plates, true, &[], None);
    let scale = run(&models, &plates, true, &[], Some(55.0));
    let bias = |m: &aloft_compare::ModelComparison| m.held_out_weak.force_n.bias[2];
    assert!(bias(&own.first).abs() < 0.1, "hidden: {}", bias(&own.first));
    assert!((bias(&scale.first) - 0.5 * 9.81).abs() < 0.1, "{}", bias(&scale.first));
    assert!((scale.first.trials[0].offset.unwrap().force_n[2] - PLANTED[2]).abs() < 0.2);
    assert!(
        own.beside[0].held_out_weak.size() == scale.beside[0].held_out_weak.size(),
        "the right mass: no difference"
    );
    // a model without mass cannot be scaled: its error stays as measured
    let nothing = &scale.beside[1];
    assert!(nothing.trials[0].offset.is_none() && nothing.held_out.force_world_n.bias[2] < -500.0);
}

#[test]
fn missing_frames_and_short_contact() {
    let models = [("truth", truth())];
    let mut plates = recorded(&PLANTED);
    for w in plates.filtered.iter_mut().chain(&mut plates.unfiltered).step_by(97) {
        w[4] = f64::NAN;
    }
    let c = run(&models, &plates, true, &[], None);
    let offset = c.first.trials[0].offset.unwrap();
    assert!(offset.frames < N - 20 && (offset.force_n[2] - PLANTED[2]).abs() < 0.2);
    // less than two seconds: nothing is subtracted, and the words say so
    for w in plates.filtered.iter_mut().skip(350) {
        w.fill(f64::NAN);
    }
    let c = run(&models, &plates, true, &[], None);
    assert!(c.first.trials[0].untared && c.first.trials[0].offset.is_none());
    assert!(c.words.iter().any(|w| w.contains("no constant could be taken off")), "{:#?}", c.words);
}
