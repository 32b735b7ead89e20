//! Frames per second of inverse kinematics, one thread.
//!
//! `cargo bench -p aloft-ik`

#[path = "../tests/common/mod.rs"]
mod common;

use aloft_ik::{IkOptions, solve};
use criterion::{BenchmarkId, Criterion, Throughput, criterion_group, criterion_main};

fn bench(c: &mut Criterion) {
    let n = 500;
    let mut person45 = common::person();
    // Ten more markers, 45 in total.
    let more: Vec<_> = person45.markers.iter().step_by(3).take(10).cloned().collect();
    for mut marker in more {
        marker.label.push('2');
        marker.position_m *= 0.9;
        person45.markers.push(marker);
    }
    let mut group = c.benchmark_group("solve");
    group.throughput(Throughput::Elements(n as u64));
    for (name, subject) in
        [("chain_9_markers", common::chain()), ("person_35_markers", common::person()), ("person_45_markers", person45)]
    {
        let truth = common::motion(&subject, n, 200.0, 0.3, 1);
        let trial = common::trial(&subject, &truth, 200.0, 1e-3, 1);
        let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build();
        let Ok(pool) = pool else { return };
        group.bench_function(name, |b| b.iter(|| pool.install(|| solve(&subject, &trial, &IkOptions::default()))));
    }
    group.finish();
    against_markers(c);
}

/// Time against the number of markers: linear, plus the constant cost of the tree.
fn against_markers(c: &mut Criterion) {
    let Ok(pool) = rayon::ThreadPoolBuilder::new().num_threads(1).build() else { return };
    let mut group = c.benchmark_group("solve against markers");
    let n = 300;
    group.throughput(Throughput::Elements(n as u64));
    for copies in [1usize, 2, 4, 8] {
        let mut person = common::person();
        let plain = person.markers.clone();
        for copy in 1..copies {
            person.markers.extend(plain.iter().cloned().map(|mut marker| {
                marker.label = format!("{}_{copy}", marker.label);
                marker.position_m *= 1.0 - 0.05 * copy as f64;
                marker
            }));
        }
        let truth = common::motion(&person, n, 200.0, 0.3, 1);
        let trial = common::trial(&person, &truth, 200.0, 1e-3, 1);
        group.bench_function(BenchmarkId::from_parameter(person.markers.len()), |b| {
            b.iter(|| pool.install(|| solve(&person, &trial, &IkOptions::default())))
        });
    }
    group.finish();
}

criterion_group!(benches, bench);
criterion_main!(benches);
