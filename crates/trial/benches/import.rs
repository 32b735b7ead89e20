//! From the bytes of a recording to a trial in SI units with short gaps filled: first recording of
//! the demonstration.
//!
//! `cargo bench -p aloft-trial`
#![allow(missing_docs, reason = "criterion makes the functions")]

use aloft_trial::{ArtefactOptions, GapOptions, ImportOptions, MarkerSet, Trial};
use aloft_trial::{apply_marker_set, fill_gaps, find_artefacts};
use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use std::collections::BTreeMap;
use std::hint::black_box;

fn import(c: &mut Criterion) {
    let bytes: &[u8] = include_bytes!("../../../fixtures/demo/throws_01.c3d");
    let set: Result<MarkerSet, _> =
        serde_yaml::from_str(include_str!("../../../configs/markersets/two-link-chain.yaml"));
    let (Ok(set), Ok(trial)) = (set, Trial::from_c3d("throws_01", bytes, &ImportOptions::default())) else { return };
    let segments = set.segments();
    let mut group = c.benchmark_group("import");
    group.throughput(Throughput::Elements(trial.markers.n_frames as u64));
    group.bench_function("C3D to trial", |b| {
        b.iter(|| Trial::from_c3d("throws_01", black_box(bytes), &ImportOptions::default()))
    });
    group.bench_function("labels, artefacts and gaps", |b| {
        b.iter(|| {
            let mut trial = trial.clone();
            apply_marker_set(&mut trial, &set, &BTreeMap::new());
            let findings = find_artefacts(&mut trial, &segments, &ArtefactOptions::default());
            (findings.len(), fill_gaps(&mut trial, &segments, &GapOptions::default()).len())
        })
    });
    group.finish();
}

criterion_group!(benches, import);
criterion_main!(benches);
