//! Zero-phase filter, order 3: 105 channels × 100,000 samples, and the scalar version on one
//! channel.
//!
//! `cargo bench -p aloft-signal --bench filtfilt`; the peer on the same input is
//! `tests/peers/bench_filtfilt.py`.
#![allow(missing_docs)]

use aloft_signal::{Butterworth, CutoffCorrection, LowPass};
use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use std::hint::black_box;

const CHANNELS: usize = 105;
const SAMPLES: usize = 100_000;

fn filtfilt(criterion: &mut Criterion) {
    let spec = LowPass { order: 3, cutoff_hz: 10.0, correction: CutoffCorrection::None };
    let Ok(filter) = Butterworth::design(spec, 200.0) else { return };
    let mut data: Vec<f64> = (0..CHANNELS * SAMPLES).map(|i| (i as f64 * 0.37).sin()).collect();
    let mut group = criterion.benchmark_group("filtfilt");
    group.sample_size(10);
    group.throughput(Throughput::Elements((CHANNELS * SAMPLES) as u64));
    group.bench_function("channel-major 105 x 100000", |b| {
        b.iter(|| filter.filtfilt_channels(black_box(&mut data), SAMPLES))
    });
    group.bench_function("frame-major 105 x 100000", |b| {
        b.iter(|| filter.filtfilt_interleaved(black_box(&mut data), CHANNELS))
    });
    group.throughput(Throughput::Elements(SAMPLES as u64));
    group.bench_function("plain 1 x 100000", |b| b.iter(|| filter.filtfilt(black_box(&mut data[..SAMPLES]))));
    group.finish();
}

criterion_group!(benches, filtfilt);
criterion_main!(benches);
