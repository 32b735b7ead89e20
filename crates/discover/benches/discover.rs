//! Forty flights of a chain: the whole catalogue, and one more linear effect.
#![allow(missing_docs, clippy::unwrap_used, reason = "a benchmark")]

use aloft_body::{BaseParameters, Motion};
use aloft_discover::{Body, DiscoverOptions, Session, TrialInput, addition, catalogue, discover, scene_of};
use aloft_effects::EffectInstance;
use aloft_regressor::{Stretch, WeakOptions};
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
    let body = Body { model, base: &base, phi, prior: None, mass_kg, plate_centres_m: &[] };
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
    let session = Session::new(&body, &scene, &trials, &weak).unwrap().with_white_noise(&body, &trials, &weak).unwrap();
    let drag = EffectInstance::parse("quadratic_drag", &scene).unwrap();
    let options = DiscoverOptions::default();
    let mut group = c.benchmark_group("40 flights");
    group.sample_size(10);
    group.bench_function("one linear effect", |b| {
        b.iter(|| addition(&session, &[], &drag, &options).unwrap());
    });
    group.bench_function("the whole catalogue", |b| {
        b.iter(|| discover(&session, &catalogue(), &[], &options).unwrap());
    });
    group.finish();
}

criterion_group!(benches, bench);
criterion_main!(benches);
