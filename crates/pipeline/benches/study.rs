//! Runs the demonstration study from recordings to comparison, and a second time with nothing
//! changed.
//!
//! `cargo bench -p aloft-pipeline`
#![allow(missing_docs, reason = "criterion makes the functions")]

use aloft_pipeline::runner::{Selection, Silent, run};
use aloft_study::subject_session::{Overrides, SubjectSession};
use criterion::{Criterion, criterion_group, criterion_main};
use std::path::Path;

fn session(c: &mut Criterion) {
    let pipeline = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../pipelines/demo.yaml");
    let Ok(folder) = tempfile::tempdir() else { return };
    let overrides = Overrides { workspace: Some(folder.path().to_path_buf()), ..Overrides::default() };
    let again = |force: bool| {
        let Ok(session) = SubjectSession::open(&pipeline, &overrides) else { return 0 };
        let selection = Selection { force, ..Selection::default() };
        run(&session, &selection, &Silent).ok().map_or(0, |report| report.ran())
    };
    if again(true) == 0 {
        return;
    }
    let mut group = c.benchmark_group("study");
    group.sample_size(10);
    group.bench_function("demonstration, everything", |b| b.iter(|| again(true)));
    group.bench_function("demonstration, nothing changed", |b| b.iter(|| again(false)));
    group.finish();
}

criterion_group!(benches, session);
criterion_main!(benches);
