//! Forty flights of a chain: the whole catalogue, and one more linear effect from stored factors
//! and from rows.
#![allow(missing_docs, clippy::unwrap_used, reason = "a benchmark")]

use aloft_body::{BaseParameters, Motion};
use aloft_discover::{Body, DiscoverOptions, Session, TrialInput, addition, catalogue, discover, scene_of};
use aloft_effects::{EffectInstance, Span, TrialMotion, columns};
use aloft_regressor::{Acting, EffectColumns, Stretch, WeakOptions, weak_factor};
use aloft_simulate::{Scenario, simulate, truth::flight_frames};
use criterion::{Criterion, criterion_group, criterion_main};

fn bench(c: &mut Criterion) {
    let scenario: Scenario = serde_json::from_str(
        r#"{"name": "bench", "seed": 5, "body": {"kind": "chain", "throws": {"recordings": 8, "throws": 5}},
            "hidden": [{"effect": "quadratic_drag", "drag_area_m2": 0.02}]}"#,
    )
    .unwrap();
    let lab = simulate(&scenario).unwrap();
    let model = &lab.body.model;
    let mut motions = Vec::new();
    let mut stretches = Vec::new();
    for trial in lab.trials.iter().filter(|t| !t.motion.flights.is_empty()) {
        let n = trial.markers.n_frames;
        let at = |f: usize| (f * lab.ticks_per_frame).min(trial.motion.n_ticks() - 1);
        let q = (0..n).flat_map(|f| trial.motion.q(at(f)).to_vec()).collect();
        motions.push(Motion {
            trial: trial.name.clone(),
            rate_hz: scenario.capture.point_rate_hz,
            nq: model.nq,
            nv: model.nv,
            q,
            ..Motion::default()
        });
        let flights = flight_frames(&trial.motion, lab.ticks_per_frame);
        let of = |(i, f): (usize, &[usize; 2])| Stretch::flight(trial.name.clone(), i, f[0] + 2, f[1] - 1);
        stretches.push(flights.iter().enumerate().map(of).collect::<Vec<_>>());
    }
    assert_eq!(stretches.iter().map(Vec::len).sum::<usize>(), 40);
    let base = BaseParameters::of(model);
    let phi = &lab.body.phi;
    let mass_kg = phi.iter().map(|p| p[0]).sum();
    let body = Body { model, base: &base, phi, prior: None, mass_kg, plate_centers_m: &[] };
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
    let weak = WeakOptions::default();
    let session = Session::new(&body, &scene, &trials, &weak).unwrap();
    let drag = EffectInstance::parse("quadratic_drag", &scene).unwrap();
    let mut factors = Vec::new();
    for (motion, stretches) in motions.iter().zip(&stretches) {
        let spans: Vec<Span> = stretches
            .iter()
            .map(|s| Span { first_frame: s.first_frame, end_frame: s.end_frame, flight: true })
            .collect();
        let trial = TrialMotion { motion, spans: &spans, plates: &[], session_time_s: 0.0 };
        let made = columns(&scene, &trial, std::slice::from_ref(&drag)).unwrap();
        let effects = EffectColumns { names: made.names, wrench: made.wrench, ..EffectColumns::none() };
        for s in stretches {
            let acting = Acting { measured: None, effects: Some(&effects) };
            factors.push(weak_factor(model, &base, phi, motion, s, acting, &weak, None).unwrap());
        }
    }
    let options = DiscoverOptions::default();
    let mut group = c.benchmark_group("40 flights");
    group.sample_size(10);
    group.bench_function("one linear effect from stored factors", |b| {
        b.iter(|| {
            let stored = Session::from_factors(&body, &scene, &factors).unwrap();
            addition(&stored, &[], &drag, &options).unwrap()
        });
    });
    group.bench_function("one linear effect from rows", |b| {
        b.iter(|| addition(&session, &[], &drag, &options).unwrap());
    });
    group.bench_function("the whole catalogue", |b| {
        b.iter(|| discover(&session, &catalogue(), &[], &options).unwrap());
    });
    group.finish();
}

criterion_group!(benches, bench);
criterion_main!(benches);
