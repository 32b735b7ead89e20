//! Rows per second, factor building, merging, leaving out: the 34-DOF simulated person.
//! `tests/peers/identify_bench.py` times Pinocchio and numpy on the same frames.
#![allow(missing_docs, reason = "criterion makes the functions")]

#[path = "../tests/common/mod.rs"]
mod common;

use aloft_regressor::{
    AccelerationOptions, AccelerationRows, Acting, Columns, CoordinateNoise, Factor, Noise, RowKind, WeakOptions,
    acceleration_factor, leave_one_out, weak_factor,
};
use criterion::{Criterion, criterion_group, criterion_main};
use faer::Mat;
use std::hint::black_box;

fn rows(c: &mut Criterion) {
    let truth = common::load("subject_a");
    let recorded = truth.velocities().unwrap_or_default();
    let mut rows = AccelerationRows::new(&truth.model, &truth.base);
    c.bench_function("acceleration rows, one frame, 6 × 128", |b| {
        let mut i = 0;
        b.iter(|| {
            let (frame, v, a) = &recorded[i % recorded.len()];
            i += 1;
            black_box(rows.base_rows(truth.motion.q(*frame), v, a)[(5, 100)])
        });
    });
    let mut motion = truth.motion.clone();
    motion.v = vec![0.1; motion.n_frames() * motion.nv];
    motion.a = vec![0.2; motion.n_frames() * motion.nv];
    let stretch = truth.stretches()[0].clone();
    let whole = AccelerationOptions { margin_s: 0.0, ..AccelerationOptions::default() };
    c.bench_function("acceleration factor, one flight of 104 frames", |b| {
        b.iter(|| acceleration_factor(&truth.model, &truth.base, &motion, &stretch, Acting::nothing(), &whole));
    });
    let options = WeakOptions { window_s: Some(0.25), ..WeakOptions::default() };
    c.bench_function("weak factor, one flight of 104 frames", |b| {
        b.iter(|| {
            weak_factor(&truth.model, &truth.base, &truth.phi, &motion, &stretch, Acting::nothing(), &options, None)
        });
    });
    let noise = Noise::white(CoordinateNoise::Markers { markers: &truth.markers, sd_m: 0.3e-3 });
    c.bench_function("weak factor, whitened, one flight of 104 frames", |b| {
        b.iter(|| {
            weak_factor(
                &truth.model,
                &truth.base,
                &truth.phi,
                &motion,
                &stretch,
                Acting::nothing(),
                &options,
                Some(&noise),
            )
        });
    });
    let Ok(factor) = acceleration_factor(&truth.model, &truth.base, &motion, &stretch, Acting::nothing(), &whole)
    else {
        return;
    };
    let factors: Vec<Factor> = (0..1000).map(|i| factor.scaled(1.0 + 1e-3 * f64::from(i))).collect();
    c.bench_function("merge two factors of 129 columns", |b| b.iter(|| factors[0].merged_with(&factors[1])));
    let mut slow = c.benchmark_group("1000 flights");
    slow.sample_size(10);
    slow.bench_function("merge", |b| b.iter(|| Factor::merge(&factors)));
    slow.bench_function("leave each out", |b| b.iter(|| leave_one_out(&factors, |_, rest| rest.values()[0])));
    slow.finish();
    // 600,000 rows, the same number as `tests/peers/bench_triangle.py` uses for numpy
    let columns =
        Columns { parameters: (1..128).map(|i| format!("p{i}")).collect(), effects: Vec::new(), of_tables: Vec::new() };
    let tall = Mat::from_fn(600_000, 128, |i, j| (((i * 128 + j) as f64 * 12.9898).sin() * 43_758.545_3).fract());
    let mut reduction = c.benchmark_group("600000 x 128 rows to a triangle");
    reduction.sample_size(10);
    for threads in [1, 2] {
        let Ok(pool) = rayon::ThreadPoolBuilder::new().num_threads(threads).build() else { return };
        reduction.bench_function(format!("{threads} threads"), |b| {
            b.iter(|| {
                pool.install(|| Factor::from_rows(&stretch, RowKind::Weak, columns.clone(), black_box(tall.as_ref())))
            });
        });
    }
    reduction.finish();
}

criterion_group!(benches, rows);
criterion_main!(benches);
