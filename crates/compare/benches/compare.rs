//! Comparison of models with one held-out trial of 900 frames of a three-link tree.
//!
//! `cargo bench -p aloft-compare`
#![allow(missing_docs, reason = "criterion makes the functions")]

use aloft_body::{BaseParameters, JointSpec, LinkSpec, Model, ModelSpec, Motion, Phi};
use aloft_compare::{Body, Candidate, CompareOptions, Measured, Noise, TrialInput, compare};
use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use nalgebra::{UnitQuaternion, Vector3, Vector6};

fn comparison(c: &mut Criterion) {
    let link = |name: &str, parent: Option<&str>, joint| LinkSpec {
        name: name.into(),
        parent: parent.map(Into::into),
        joint,
        position_m: [0.02, 0.3, 0.01],
        rpy_rad: [0.0; 3],
        inertia: None,
    };
    let links = vec![
        link("trunk", None, JointSpec::Free),
        link("arm", Some("trunk"), JointSpec::Spherical),
        link("leg", Some("trunk"), JointSpec::RevoluteZ),
    ];
    let Ok(model) = Model::from_spec(&ModelSpec::new("tree".into(), links)) else { return };
    let base = BaseParameters::of(&model);
    let phi = vec![Phi::from_column_slice(&[10.0, 0.1, 1.5, 0.0, 0.9, 0.3, 1.0, 0.004, -0.002, 0.003]); 3];
    let n = 900;
    let mut motion =
        Motion { trial: "exercise".into(), rate_hz: 200.0, nq: model.nq, nv: model.nv, ..Motion::default() };
    for f in 0..n {
        let t = f as f64 / 200.0;
        let s = |a: f64, w: f64| a * (w * t).sin();
        let root = UnitQuaternion::from_scaled_axis(Vector3::new(s(0.5, 3.1), s(0.7, 2.3), s(0.3, 4.4)));
        let arm = UnitQuaternion::from_scaled_axis(Vector3::new(s(1.2, 5.0), s(0.3, 3.7), s(0.9, 4.1)));
        motion.q.extend([s(0.2, 2.9), s(0.15, 3.3), 1.0 + s(0.1, 5.2)]);
        motion.q.extend(root.coords.iter().chain(arm.coords.iter()));
        motion.q.push(0.4 + s(0.6, 4.7));
        motion.v.extend((0..model.nv).map(|k| s(1.0, 2.0 + 0.3 * k as f64)));
        motion.a.extend((0..model.nv).map(|k| s(5.0, 2.0 + 0.3 * k as f64)));
    }
    let wrench: Vec<Vector6<f64>> =
        (0..n).map(|f| Vector6::new(1.0, 2.0, 300.0 + (f as f64 * 0.1).sin(), 3.0, 4.0, 5.0)).collect();
    let measured = Measured { filtered: wrench.clone(), unfiltered: wrench, noise_density: Vector6::repeat(1e-3) };
    let body = Body { model: &model, base: &base, prior: &phi };
    let trials = [TrialInput { unfiltered: Some(&motion), measured: Some(&measured), ..TrialInput::new(&motion, &[]) }];
    let candidates = [Candidate::links("prior", &base, &phi)];
    let options = CompareOptions::default();
    if compare(&body, &candidates, &trials, Noise::Unknown, &options).is_err() {
        return;
    }
    let mut group = c.benchmark_group("compare");
    group.throughput(Throughput::Elements(n as u64));
    group.bench_function("900 frames on plates", |b| {
        b.iter(|| compare(&body, &candidates, &trials, Noise::Unknown, &options).is_ok())
    });
    group.finish();
}

criterion_group!(benches, comparison);
criterion_main!(benches);
