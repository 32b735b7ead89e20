//! Speed of decoding bytes in memory to typed markers and channels, MB/s of file.
//!
//! `cargo bench -p aloft-c3d --bench read`: synthetic files in each byte order and storage and, if
//! the folder of recordings is present, its largest ones individually and together.

use std::{hint::black_box, path::Path, time::Duration};

use aloft_c3d::{Analog, ByteOrder, C3dBuilder, C3dFile, Storage};
use criterion::{BenchmarkId, Criterion, Throughput, criterion_group, criterion_main};

/// 50 points and 16 channels of 10 samples over 2,000 frames: 2.9 MB as floats.
fn made(order: ByteOrder, storage: Storage) -> Vec<u8> {
    let frames = 2000;
    let mut builder = C3dBuilder::new(100.0).stored_as(order, storage, 0.125);
    for i in 0..50 {
        let xyz =
            (0..frames).map(|f| if (f + i) % 97 < 3 { [f32::NAN; 3] } else { [f as f32, i as f32, 900.0] }).collect();
        builder = builder.marker(&format!("M{i}"), xyz);
    }
    for i in 0..16 {
        let values = (0..10 * frames).map(|s| ((s * (i + 3)) % 4001) as f64 - 2000.0).collect();
        builder = builder.channel(Analog {
            label: format!("C{i}"),
            unit: "V".into(),
            scale: 1.0,
            values,
            ..Analog::default()
        });
    }
    builder.build().and_then(|f| f.to_bytes()).ok().unwrap_or_default()
}

/// The largest recordings of the data folder.
fn recordings() -> Vec<(String, Vec<u8>)> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../shared/data");
    let mut open = vec![folder];
    let mut found = Vec::new();
    while let Some(next) = open.pop() {
        for path in std::fs::read_dir(next).into_iter().flatten().flatten().map(|e| e.path()) {
            if path.is_dir() {
                open.push(path);
            } else if path.extension().is_some_and(|e| e == "c3d") {
                let size = path.metadata().ok().map_or(0, |m| m.len());
                found.push((size, path));
            }
        }
    }
    found.sort();
    let largest = found.into_iter().rev().take(8);
    largest
        .filter_map(|(_, path)| {
            let folder = path.parent()?.file_name()?.to_string_lossy().into_owned();
            let name = path.file_stem()?.to_string_lossy().into_owned();
            Some((format!("{folder}/{name}"), std::fs::read(&path).ok()?))
        })
        .collect()
}

fn read(criterion: &mut Criterion) {
    let mut group = criterion.benchmark_group("read");
    group.measurement_time(Duration::from_secs(3)).warm_up_time(Duration::from_millis(500));
    for order in [ByteOrder::Intel, ByteOrder::Dec, ByteOrder::Mips] {
        for storage in [Storage::Float, Storage::Integer] {
            let bytes = made(order, storage);
            group.throughput(Throughput::Bytes(bytes.len() as u64));
            let id = BenchmarkId::new("made", format!("{order:?}_{storage:?}"));
            group.bench_with_input(id, &bytes, |b, bytes| {
                b.iter(|| C3dFile::from_bytes(black_box(bytes)).map(|f| f.n_frames))
            });
        }
    }
    let recordings = recordings();
    for (name, bytes) in &recordings {
        group.throughput(Throughput::Bytes(bytes.len() as u64));
        let id = BenchmarkId::new("recorded", name);
        group.bench_with_input(id, bytes, |b, bytes| {
            b.iter(|| C3dFile::from_bytes(black_box(bytes)).map(|f| f.n_frames))
        });
    }
    if !recordings.is_empty() {
        group.throughput(Throughput::Bytes(recordings.iter().map(|(_, b)| b.len() as u64).sum()));
        group.bench_function("recorded/together", |b| {
            b.iter(|| {
                recordings
                    .iter()
                    .map(|(_, b)| C3dFile::from_bytes(black_box(b)).ok().map_or(0, |f| f.n_frames))
                    .sum::<usize>()
            });
        });
    }
    group.finish();
}

fn write(criterion: &mut Criterion) {
    let mut group = criterion.benchmark_group("write");
    group.measurement_time(Duration::from_secs(3)).warm_up_time(Duration::from_millis(500));
    let bytes = made(ByteOrder::Intel, Storage::Float);
    group.throughput(Throughput::Bytes(bytes.len() as u64));
    if let Ok(file) = C3dFile::from_bytes(&bytes) {
        group.bench_function("unchanged/Intel_Float", |b| b.iter(|| black_box(&file).to_bytes().map(|b| b.len())));
    }
    group.finish();
}

criterion_group!(benches, read, write);
criterion_main!(benches);
