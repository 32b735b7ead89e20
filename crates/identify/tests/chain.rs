//! The two-link chain: the paper's rows and weak rows compared with the truth; intervals; errors in
//! variables.
//!
//! Set `ALOFT_IDENTIFY_DATA` to a folder written by `tests/peers/identify_goldens.py --recordings 5
//! --jumps 8` to run on all 30 flights.
#![allow(clippy::unwrap_used, reason = "tests")]

#[path = "../../regressor/tests/common/mod.rs"]
mod common;

use aloft_body::Motion;
use aloft_identify::{
    ClusterBy, ColumnScaling, Determination, Estimator, GateLimits, IdentifyError, IdentifyOptions, add_noise,
    balanced, choose_window, identify, mass_constrained, null_vector, simex,
};
use aloft_regressor::{
    AccelerationOptions, Acting, CoordinateNoise, Factor, Noise, Stretch, StretchKind, WeakOptions,
    acceleration_factor, weak_factor,
};
use aloft_signal::{Butterworth, LowPass};
use common::{Truth, differentiate, load};
use nalgebra::DVector;

const MARKER_SD_M: f64 = 0.3e-3;

/// Third-order 10 Hz zero-phase low-pass of every coordinate, then differences, as in the paper.
fn filtered(truth: &Truth, motion: &Motion) -> Motion {
    let mut out = motion.clone();
    let spec = LowPass { order: 3, cutoff_hz: 10.0, correction: aloft_signal::CutoffCorrection::None };
    let filter = Butterworth::design(spec, motion.rate_hz).unwrap();
    for block in &truth.flights {
        for c in 0..motion.nq {
            let mut x: Vec<f64> = (block[0]..block[3]).map(|f| motion.q[f * motion.nq + c]).collect();
            filter.filtfilt(&mut x);
            for (i, value) in x.into_iter().enumerate() {
                out.q[(block[0] + i) * motion.nq + c] = value;
            }
        }
    }
    for q in out.q.chunks_exact_mut(motion.nq) {
        truth.model.normalize(q);
    }
    differentiate(truth, &mut out);
    out
}

fn paper_factors(truth: &Truth, motion: &Motion) -> Vec<Factor> {
    let motion = filtered(truth, motion);
    truth
        .stretches()
        .iter()
        .map(|s| {
            acceleration_factor(
                &truth.model,
                &truth.base,
                &motion,
                s,
                Acting::nothing(),
                &AccelerationOptions::default(),
            )
            .unwrap()
        })
        .collect()
}

fn weak_factors(truth: &Truth, motion: &Motion, window_s: f64, white: bool) -> Vec<Factor> {
    let noise = Noise::white(CoordinateNoise::Markers { markers: &truth.markers, sd_m: MARKER_SD_M });
    let options = WeakOptions { window_s: Some(window_s), ..WeakOptions::default() };
    truth
        .stretches()
        .iter()
        .map(|s| {
            let noise = white.then_some(&noise);
            weak_factor(&truth.model, &truth.base, &truth.phi, motion, s, Acting::nothing(), &options, noise).unwrap()
        })
        .collect()
}

/// Largest error of the mass moments (kg·m) and of the inertias (kg·m²).
fn errors(truth: &Truth, x: &DVector<f64>) -> (f64, f64) {
    let (mut moments, mut inertias) = (0.0f64, 0.0f64);
    for (i, parameter) in truth.base.parameters.iter().enumerate() {
        let error = (x[i] - truth.truth()[i]).abs();
        match parameter.unit {
            "kg·m" => moments = moments.max(error),
            "kg·m²" => inertias = inertias.max(error),
            _ => {}
        }
    }
    (moments, inertias)
}

#[test]
fn validate_exact_motion_gives_exact_parameters() {
    for name in ["chain_p", "chain_a"] {
        let truth = load(name);
        let mut motion = truth.motion.clone();
        differentiate(&truth, &mut motion);
        let options = AccelerationOptions { margin_s: 0.0, ..AccelerationOptions::default() };
        let factors: Vec<Factor> = truth
            .stretches()
            .iter()
            .map(|s| acceleration_factor(&truth.model, &truth.base, &motion, s, Acting::nothing(), &options).unwrap())
            .collect();
        for factors in [factors, weak_factors(&truth, &truth.motion, 0.3, false)] {
            let merged = Factor::merge(&factors).unwrap();
            for scaling in [ColumnScaling::None, ColumnScaling::Unit] {
                let vector = null_vector(&merged, truth.mass(), scaling).unwrap();
                assert!((&vector.parameters - truth.truth()).amax() < 1e-5, "{name} {scaling:?}");
            }
            let x = mass_constrained(&merged, truth.mass()).unwrap();
            assert!((x - truth.truth()).amax() < 1e-5, "{name}");
        }
    }
}

#[test]
fn validate_the_papers_rows_reach_the_papers_figures() {
    // the paper: each parameter within 0.007, σ 1191 / 76 / 18
    for (name, limit) in [("chain_p", 0.0025), ("chain_a", 0.0005)] {
        let truth = load(name);
        let merged = Factor::merge(&paper_factors(&truth, &truth.noisy(MARKER_SD_M, 1))).unwrap();
        let vector = null_vector(&merged, truth.mass(), ColumnScaling::None).unwrap();
        let (moments, inertias) = errors(&truth, &vector.parameters);
        println!("{name}, paper's rows: {moments:.1e} kg·m, {inertias:.1e} kg·m², {:?}", vector.sigma);
        assert!(moments < limit && inertias < limit, "{name}: {moments:e} {inertias:e}");
    }
}

#[test]
fn validate_weak_rows_beat_them_tenfold() {
    for name in ["chain_p", "chain_a"] {
        let truth = load(name);
        for white in [false, true] {
            let merged = Factor::merge(&weak_factors(&truth, &truth.noisy(MARKER_SD_M, 1), 0.4, white)).unwrap();
            let x = mass_constrained(&merged, truth.mass()).unwrap();
            let (moments, inertias) = errors(&truth, &x);
            println!("{name}, weak rows, whitened {white}: {moments:.1e} kg·m, {inertias:.1e} kg·m²");
            assert!(moments < 1e-4 && inertias < 5e-5, "{name}: {moments:e} {inertias:e}");
        }
    }
}

#[test]
fn contact_counts_by_its_own_error() {
    let truth = load("chain_a");
    let motion = truth.noisy(MARKER_SD_M, 11);
    let options = WeakOptions { window_s: Some(0.4), ..WeakOptions::default() };
    // every second flight is treated as contact with plates that should read zero but have a slow
    // error of up to half a newton
    let wrench: Vec<nalgebra::Vector6<f64>> = (0..motion.n_frames())
        .map(|f| nalgebra::Vector6::from_fn(|i, _| 0.5 * (0.011 * f as f64 + 1.7 * i as f64).sin()))
        .collect();
    let factors: Vec<Factor> = truth
        .stretches()
        .iter()
        .enumerate()
        .map(|(i, s)| {
            let contact = Stretch::contact(s.trial.clone(), i, s.first_frame, s.end_frame);
            let (stretch, acting) = if i % 2 == 0 {
                (s, Acting::nothing())
            } else {
                (&contact, Acting { measured: Some(&wrench), effects: None })
            };
            weak_factor(&truth.model, &truth.base, &truth.phi, &motion, stretch, acting, &options, None).unwrap()
        })
        .collect();
    let (scaled, balance) = balanced(&factors, truth.mass(), None).unwrap();
    let balance = balance.unwrap();
    println!("{balance:?}");
    assert!(balance.contact_rms > 10.0 * balance.flight_rms);
    assert!((balance.contact_weight - balance.flight_rms / balance.contact_rms).abs() < 0.02 * balance.contact_weight);
    let error = |f: &[Factor]| {
        let (moments, inertias) = errors(&truth, &mass_constrained(&Factor::merge(f).unwrap(), truth.mass()).unwrap());
        moments.max(inertias)
    };
    let (alike, own) = (error(&factors), error(&scaled));
    println!("largest error: weights alike {alike:.1e}, by own error {own:.1e}");
    assert!(own < 0.2 * alike);
    let found = identify(&truth.model, &truth.base, &factors, truth.mass(), None, &IdentifyOptions::default()).unwrap();
    assert_eq!(found.parameters.contact, Some(balance));
    // the paper's estimator leaves contact out instead of failing on its right-hand side
    let paper = IdentifyOptions { estimator: Estimator::NullVector(ColumnScaling::None), ..IdentifyOptions::default() };
    let found = identify(&truth.model, &truth.base, &factors, truth.mass(), None, &paper).unwrap();
    assert_eq!(found.parameters.n_stretches, factors.iter().filter(|f| f.kind == StretchKind::Flight).count());
    let flights: Vec<Factor> = factors.iter().filter(|f| f.kind == StretchKind::Flight).cloned().collect();
    assert_eq!(balanced(&flights, truth.mass(), None).unwrap().1, None);
}

#[test]
fn bootstrap_and_standard_errors_agree() {
    let truth = load("chain_a");
    let factors = weak_factors(&truth, &truth.noisy(MARKER_SD_M, 3), 0.4, true);
    let options = IdentifyOptions { bootstrap: 400, ..IdentifyOptions::default() };
    let found = identify(&truth.model, &truth.base, &factors, truth.mass(), None, &options).unwrap();
    assert_eq!(found.draws.len(), 400);
    for (i, estimate) in found.parameters.base.iter().enumerate().skip(1) {
        let mean = found.draws.iter().map(|d| d[i]).sum::<f64>() / 400.0;
        let sd = (found.draws.iter().map(|d| (d[i] - mean).powi(2)).sum::<f64>() / 399.0).sqrt();
        assert!(
            sd < 2.5 * estimate.se && estimate.se < 4.0 * sd,
            "{}: bootstrap {sd:e}, standard error {:e}",
            estimate.name,
            estimate.se
        );
        assert_eq!(estimate.determination, Determination::Well);
    }
    let again = identify(&truth.model, &truth.base, &factors, truth.mass(), None, &options).unwrap();
    assert_eq!(found, again);
}

#[test]
fn the_gate_refuses_what_is_not_determined() {
    let truth = load("chain_p");
    let factors = weak_factors(&truth, &truth.noisy(MARKER_SD_M, 3), 0.4, false);
    // a hinge that does not move leaves its link undetermined: one flight, joint frozen
    let mut frozen = truth.motion.clone();
    for q in frozen.q.chunks_exact_mut(truth.model.nq) {
        q[7] = 0.1;
    }
    let stiff = weak_factors(&truth, &frozen, 0.4, false);
    let options =
        IdentifyOptions { estimator: Estimator::NullVector(ColumnScaling::None), ..IdentifyOptions::default() };
    let found = identify(&truth.model, &truth.base, &stiff, truth.mass(), None, &options);
    assert!(found.is_err() || !found.unwrap().parameters.gate.passed);
    let strict = IdentifyOptions {
        estimator: Estimator::NullVector(ColumnScaling::None),
        gate: GateLimits { sigma_ratio: 1e9, ..GateLimits::default() },
        ..IdentifyOptions::default()
    };
    let found = identify(&truth.model, &truth.base, &factors, truth.mass(), None, &strict).unwrap();
    assert!(!found.parameters.gate.passed && found.parameters.gate.reasons[0].contains("σ"));
    assert!(identify(&truth.model, &truth.base, &[], truth.mass(), None, &strict).is_err());
    assert!(identify(&truth.model, &truth.base, &factors, -1.0, None, &IdentifyOptions::default()).is_err());
    let regularised =
        IdentifyOptions { estimator: Estimator::Regularised { weight: None }, ..IdentifyOptions::default() };
    assert!(matches!(
        identify(&truth.model, &truth.base, &factors, truth.mass(), None, &regularised),
        Err(IdentifyError::Option { .. })
    ));
}

#[test]
fn validate_simex_sees_and_removes_the_bias_of_the_papers_rows() {
    let truth = load("chain_p");
    let motion = truth.noisy(MARKER_SD_M, 5);
    let noise = CoordinateNoise::Markers { markers: &truth.markers, sd_m: MARKER_SD_M };
    let run = |weak: bool| {
        simex(&[0.0, 0.5, 1.0, 2.0], 8, |level, replicate| {
            let noisy = add_noise(&truth.model, &motion, &noise, level.sqrt(), 1000 + replicate as u64)?;
            let factors = if weak { weak_factors(&truth, &noisy, 0.4, false) } else { paper_factors(&truth, &noisy) };
            Ok(null_vector(&Factor::merge(&factors)?, truth.mass(), ColumnScaling::None)?.parameters)
        })
        .unwrap()
    };
    let (paper, weak) = (run(false), run(true));
    let (naive, corrected) = (errors(&truth, &paper.naive).1, errors(&truth, &paper.extrapolated).1);
    println!(
        "paper's rows: inertias off by {naive:.1e}, after extrapolation {corrected:.1e}; bias of weak rows {:.1e}",
        weak.bias.amax()
    );
    assert!(corrected < 0.6 * naive, "{naive:e} → {corrected:e}");
    assert!(weak.bias.amax() < 1e-4);
    assert!(simex(&[0.0], 3, |_, _| Ok(DVector::zeros(1))).is_err());
}

#[test]
fn the_window_is_chosen_by_held_out_error() {
    let truth = load("chain_a");
    let motion = truth.noisy(MARKER_SD_M, 7);
    let candidates: Vec<(f64, Vec<Factor>)> =
        [0.1, 0.2, 0.3, 0.4].into_iter().map(|w| (w, weak_factors(&truth, &motion, w, false))).collect();
    let choice = choose_window(&candidates, &candidates[2].1, truth.mass(), None, ClusterBy::Stretch).unwrap();
    println!("{}", choice.words);
    assert!(choice.window_s >= 0.2, "{choice:?}");
    assert_eq!(choice.tried.len(), 4);
    assert!(choose_window(&candidates, &candidates[2].1[..5], truth.mass(), None, ClusterBy::Stretch).is_err());
    assert!(choose_window(&[], &candidates[2].1, truth.mass(), None, ClusterBy::Stretch).is_err());
}
