//! A small laboratory: two throws of the chain, from forward dynamics to files.
//!
//! `cargo bench -p aloft-simulate`
#![allow(missing_docs, reason = "criterion makes the functions")]

use aloft_simulate::{BodySpec, CaptureSpec, ChainLab, Scenario, ThrowProtocol, simulate};
use criterion::{Criterion, criterion_group, criterion_main};
use std::hint::black_box;

fn laboratory(c: &mut Criterion) {
    let throws = ThrowProtocol { recordings: 1, throws: 2, calibration_s: 1.0, ..ThrowProtocol::default() };
    let scenario = Scenario {
        name: "two_throws".to_owned(),
        seed: 7,
        body: BodySpec::Chain(ChainLab { throws, ..ChainLab::default() }),
        capture: CaptureSpec::default(),
        hidden: Vec::new(),
        trajectories: false,
    };
    let mut group = c.benchmark_group("simulate");
    group.sample_size(10);
    group.bench_function("two throws of the chain", |b| b.iter(|| simulate(black_box(&scenario)).is_ok()));
    group.finish();
}

criterion_group!(benches, laboratory);
criterion_main!(benches);
