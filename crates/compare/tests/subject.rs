//! Comparison on a subject simulated by another simulator (`tests/peers/compare_subject.py`): its
//! true parameters must predict its wrench, and the smoothed motion must reproduce its velocities
//! and accelerations.

#![allow(clippy::unwrap_used, reason = "a golden that cannot be read fails the test")]

use aloft_body::{BaseParameters, JointSpec, LinkSpec, Model, ModelSpec, Motion, Phi};
use aloft_compare::{Body, Candidate, CompareOptions, Measured, Noise, TrialInput, compare};
use aloft_filter::smooth;
use nalgebra::Vector6;
use serde_json::Value;
use std::ops::Range;

fn numbers(v: &Value) -> Vec<f64> {
    v.as_array().unwrap().iter().map(|x| x.as_f64().unwrap()).collect()
}

struct Stretch {
    motion: Motion,
    flights: Vec<Range<usize>>,
    wrench: Vec<Vector6<f64>>,
}

fn golden() -> (Model, Vec<Phi>, Vec<Stretch>) {
    let path = format!("{}/../../fixtures/goldens/compare_subject.json", env!("CARGO_MANIFEST_DIR"));
    let golden: Value = serde_json::from_str(&std::fs::read_to_string(path).unwrap()).unwrap();
    let links = golden["links"].as_array().unwrap();
    let specs = links.iter().map(|l| LinkSpec {
        name: l["name"].as_str().unwrap().into(),
        parent: l["parent"].as_str().map(Into::into),
        joint: match l["joint"].as_str().unwrap() {
            "free" => JointSpec::Free,
            "spherical" => JointSpec::Spherical,
            _ => JointSpec::Revolute([0.0, 1.0, 0.0]),
        },
        position_m: numbers(&l["position_m"]).try_into().unwrap(),
        rpy_rad: [0.0; 3],
        inertia: None,
    });
    let mut model = Model::from_spec(&ModelSpec::new("subject".into(), specs.collect())).unwrap();
    model.gravity_mps2.z = -9.81;
    let phi = links.iter().map(|l| Phi::from_column_slice(&numbers(&l["phi"]))).collect();
    let stretches = golden["stretches"].as_array().unwrap().iter().map(|s| Stretch {
        motion: Motion {
            trial: s["trial"].as_str().unwrap().into(),
            rate_hz: s["rate_hz"].as_f64().unwrap(),
            nq: model.nq,
            nv: model.nv,
            q: numbers(&s["q"]),
            v: numbers(&s["v"]),
            a: numbers(&s["a"]),
            ..Motion::default()
        },
        flights: s["flights"]
            .as_array()
            .unwrap()
            .iter()
            .map(|f| {
                let f = numbers(f);
                f[0] as usize..f[1] as usize
            })
            .collect(),
        wrench: numbers(&s["wrench"]).chunks_exact(6).map(Vector6::from_column_slice).collect(),
    });
    let stretches = stretches.collect();
    (model, phi, stretches)
}

#[test]
fn validate_true_parameters_give_the_wrench_of_another_simulator() {
    let (model, phi, stretches) = golden();
    let base = BaseParameters::of(&model);
    assert_eq!(base.len(), 128);
    let plates: Vec<Measured> = stretches
        .iter()
        .map(|s| Measured { filtered: s.wrench.clone(), unfiltered: s.wrench.clone(), noise_density: Vector6::zeros() })
        .collect();
    let trials: Vec<TrialInput> = stretches
        .iter()
        .zip(&plates)
        .map(|(s, w)| TrialInput {
            measured: Some(w),
            unfiltered: Some(&s.motion),
            ..TrialInput::new(&s.motion, &s.flights)
        })
        .collect();
    let body = Body { model: &model, base: &base, prior: &phi };
    let candidates = [Candidate::links("truth", &base, &phi)];
    let options = CompareOptions { end_margin_frames: 2, ..CompareOptions::default() };
    let (c, _) = compare(&body, &candidates, &trials, Noise::Unknown, &options).unwrap();
    for t in &c.first.trials {
        println!(
            "{}: contact {} frames {:.5} N {:.5} N·m, windows {} {:.5} {:.5}; flight {} frames {:.5} {:.5}, windows {} {:.5} {:.5}",
            t.trial,
            t.contact.frames,
            t.contact.force_n.norm_rms(),
            t.contact.moment_nm.norm_rms(),
            t.contact_weak.windows,
            t.contact_weak.force_n.norm_rms(),
            t.contact_weak.moment_nm.norm_rms(),
            t.flight.frames,
            t.flight.force_n.norm_rms(),
            t.flight.moment_nm.norm_rms(),
            t.flight_weak.windows,
            t.flight_weak.force_n.norm_rms(),
            t.flight_weak.moment_nm.norm_rms(),
        );
    }
    let (exercise, jump) = (&c.first.trials[0], &c.first.trials[1]);
    assert!(exercise.contact.size() < 0.01 && exercise.contact_weak.size() < 0.2);
    assert!(jump.flight.frames > 50 && jump.flight.size() < 0.05 && jump.flight_weak.size() < 0.2);
}

#[test]
fn validate_derivatives_of_the_motion_are_those_of_another_simulator() {
    let (model, _, stretches) = golden();
    for s in &stretches {
        let raw = Motion { v: Vec::new(), a: Vec::new(), ..s.motion.clone() };
        let m = smooth(&model, &raw, None).unwrap();
        let n = m.n_frames();
        // inside the flight if there is one, because landing is not a smooth motion
        let frames = s.flights.first().map_or(10..n - 10, |f| f.start + 4..f.end - 4);
        let rms = |x: &[f64], y: &[f64]| {
            let inner = frames.start * model.nv..frames.end * model.nv;
            let sum: f64 = inner.clone().map(|i| (x[i] - y[i]).powi(2)).sum();
            (sum / inner.len() as f64).sqrt()
        };
        let zero = vec![0.0; n * model.nv];
        let (v, a) =
            (rms(&m.v, &s.motion.v) / rms(&zero, &s.motion.v), rms(&m.a, &s.motion.a) / rms(&zero, &s.motion.a));
        println!("{}: velocities {v:.2e}, accelerations {a:.2e} of their size", s.motion.trial);
        assert!(v < 1e-3 && a < 2e-2);
    }
}
