//! Flights from plates: 1,000 frames at 200 Hz, two plates at 1000 Hz, three flights.
//!
//! `cargo bench -p aloft-flight`
#![allow(missing_docs, reason = "criterion makes the functions")]

use aloft_flight::{FlightOptions, from_plates, plate_wrench_at_marker_rate, total_wrench};
use aloft_trial::{Markers, Plate, Trial};
use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use nalgebra::Vector3;
use std::hint::black_box;

fn flights(c: &mut Criterion) {
    let n_frames = 1000;
    let samples = 5 * n_frames;
    let force = |i: usize| {
        let second = i as f64 / 1000.0;
        let loaded = (second % 1.5) < 1.0;
        let noise = (i as f64 * 12.9898).sin() * 0.5;
        Vector3::new(noise, -noise, if loaded { 300.0 + 50.0 * (9.0 * second).sin() } else { noise })
    };
    let plate = |k: usize| Plate {
        name: format!("FP{k}"),
        rate_hz: 1000.0,
        corners_m: Vec::new(),
        force_n: (0..samples).map(force).collect(),
        moment_nm: (0..samples).map(|i| force(i) * 0.1).collect(),
    };
    let trial = Trial {
        name: "jumps".to_owned(),
        markers: Markers { rate_hz: 200.0, first_frame: 1, n_frames, ..Markers::default() },
        plates: vec![plate(1), plate(2)],
        ..Trial::default()
    };
    let mut group = c.benchmark_group("flight");
    group.throughput(Throughput::Elements(n_frames as u64));
    group.bench_function("from plates", |b| {
        b.iter(|| from_plates(black_box(&trial), n_frames, 200.0, &FlightOptions::default()))
    });
    group.bench_function("plate wrench at the marker rate", |b| {
        b.iter(|| plate_wrench_at_marker_rate(black_box(&trial), None).map(|each| total_wrench(&each)))
    });
    group.finish();
}

criterion_group!(benches, flights);
criterion_main!(benches);
