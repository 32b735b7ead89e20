//! Kinematics and rows of the 34-DOF human, one frame at a time on one core.
#![allow(clippy::expect_used)] // a bench may stop
#![allow(missing_docs)] // criterion's macros make public items

use aloft_body::{BaseParameters, FrameBatch, JointSpec, LANES, LinkInertia, LinkSpec, Model, ModelSpec, Phi, State};
use criterion::{BenchmarkId, Criterion, Throughput, criterion_group, criterion_main};
use nalgebra::{DMatrix, Matrix3, Vector3};
use std::hint::black_box;

fn human() -> Model {
    let spec: ModelSpec =
        serde_yaml::from_str(include_str!("../../../configs/models/human34.yaml")).expect("the model file is valid");
    let mut model = Model::from_spec(&spec).expect("the model is valid");
    for (i, link) in model.links.iter_mut().enumerate().skip(1) {
        link.joint.parent_from_joint.translation.vector = Vector3::new(0.01, -0.3 + 0.01 * i as f64, 0.1);
    }
    model
}

fn regressor(c: &mut Criterion) {
    let model = human();
    let base = BaseParameters::of(&model);
    let mut q = model.neutral();
    let dv: Vec<f64> = (0..model.nv).map(|i| (0.7 * i as f64).sin()).collect();
    let start = q.clone();
    model.integrate(&start, &dv, &mut q);
    let v: Vec<f64> = (0..model.nv).map(|i| (1.1 * i as f64).cos()).collect();
    let a: Vec<f64> = (0..model.nv).map(|i| (1.7 * i as f64).sin()).collect();
    let phi: Vec<Phi> = (0..model.n_links())
        .map(|_| {
            LinkInertia {
                mass_kg: 4.0,
                com_m: Vector3::new(0.01, -0.15, 0.0),
                inertia_com_kgm2: Matrix3::from_diagonal_element(0.05),
            }
            .to_phi()
        })
        .collect();
    let mut state = State::new(&model);
    let mut full = DMatrix::zeros(6, 10 * model.n_links());
    let mut rows = DMatrix::zeros(6, base.len());
    let mut rows3 = DMatrix::zeros(3, base.len());
    let mut jacobian = DMatrix::zeros(3, model.nv);
    let mut mass = DMatrix::zeros(model.nv, model.nv);
    let mut tau = vec![0.0; model.nv];
    let origin = Vector3::zeros();

    c.bench_function("forward_position", |b| b.iter(|| state.forward_position(&model, black_box(&q))));
    c.bench_function("forward_velocity", |b| b.iter(|| state.forward_velocity(&model, black_box(&q), &v)));
    c.bench_function("forward_acceleration", |b| b.iter(|| state.forward_acceleration(&model, black_box(&q), &v, &a)));
    c.bench_function("base_wrench_regressor", |b| b.iter(|| state.base_wrench_regressor(&model, black_box(&mut full))));
    c.bench_function("base_wrench_rows", |b| b.iter(|| state.base_wrench_rows(&model, &base, black_box(&mut rows))));
    c.bench_function("momentum_rows", |b| b.iter(|| state.momentum_rows(&base, &origin, black_box(&mut rows))));
    c.bench_function("first_moment_rows", |b| {
        b.iter(|| state.first_moment_rows(&base, &origin, black_box(&mut rows3)))
    });
    c.bench_function("frame: accelerations and base-wrench rows", |b| {
        b.iter(|| {
            state.forward_acceleration(&model, black_box(&q), &v, &a);
            state.base_wrench_rows(&model, &base, black_box(&mut rows));
        });
    });
    c.bench_function("frame: velocities and momentum rows", |b| {
        b.iter(|| {
            state.forward_velocity(&model, black_box(&q), &v);
            state.momentum_rows(&base, &origin, black_box(&mut rows));
        });
    });
    let mut batch = FrameBatch::new(&model);
    let mut lanes = vec![[0.0; LANES]; 6 * base.len()];
    let frames: Vec<(Vec<f64>, Vec<f64>, Vec<f64>)> = (0..LANES)
        .map(|k| {
            let step: Vec<f64> = (0..model.nv).map(|i| (0.7 * i as f64 + 0.1 * k as f64).sin()).collect();
            let mut q = model.neutral();
            model.integrate(&start, &step, &mut q);
            (q, v.iter().map(|x| x + 0.1 * k as f64).collect(), a.iter().map(|x| x - 0.1 * k as f64).collect())
        })
        .collect();
    let qs: [&[f64]; LANES] = std::array::from_fn(|k| frames[k].0.as_slice());
    let vs: [&[f64]; LANES] = std::array::from_fn(|k| frames[k].1.as_slice());
    let accelerations: [&[f64]; LANES] = std::array::from_fn(|k| frames[k].2.as_slice());
    let mut group = c.benchmark_group("batch of eight frames");
    group.throughput(Throughput::Elements(LANES as u64));
    group.bench_function("forward_acceleration", |b| {
        b.iter(|| batch.forward_acceleration(&model, black_box(&qs), &vs, &accelerations))
    });
    group.bench_function("accelerations and base-wrench rows", |b| {
        b.iter(|| {
            batch.forward_acceleration(&model, black_box(&qs), &vs, &accelerations);
            batch.base_wrench_rows(&base, black_box(&mut lanes));
        });
    });
    group.bench_function("velocities and momentum rows", |b| {
        b.iter(|| {
            batch.forward_velocity(&model, black_box(&qs), &vs, &origin);
            batch.momentum_rows(&base, black_box(&mut lanes));
        });
    });
    group.finish();
    let foot = model.n_links() - 1;
    c.bench_function("point_jacobian", |b| {
        b.iter(|| state.point_jacobian(&model, foot, &origin, black_box(&mut jacobian)));
    });
    c.bench_function("inverse_dynamics", |b| b.iter(|| state.inverse_dynamics(&model, &phi, black_box(&mut tau))));
    c.bench_function("mass_matrix", |b| b.iter(|| state.mass_matrix(&model, &phi, black_box(&mut mass))));
    c.bench_function("base_parameters", |b| b.iter(|| BaseParameters::of(black_box(&model))));
}

/// Time for the rows of a batch against the number of links of a chain with spherical joints:
/// linear.
fn against_links(c: &mut Criterion) {
    let mut group = c.benchmark_group("base-wrench rows of eight frames against links");
    for n in [2usize, 4, 8, 16, 32, 64] {
        let links = (0..n)
            .map(|i| LinkSpec {
                name: format!("l{i}"),
                parent: (i > 0).then(|| format!("l{}", i - 1)),
                joint: if i == 0 { JointSpec::Free } else { JointSpec::Spherical },
                position_m: [0.0, 0.0, 0.3],
                rpy_rad: [0.0; 3],
                inertia: None,
            })
            .collect();
        let Ok(model) = Model::from_spec(&ModelSpec::new("chain".into(), links)) else { return };
        let base = BaseParameters::of(&model);
        let q: Vec<f64> = (0..model.nq).map(|i| 0.2 + (0.7 * i as f64).sin()).collect();
        let v: Vec<f64> = (0..model.nv).map(|i| (1.1 * i as f64).cos()).collect();
        let (qs, vs) = ([q.as_slice(); LANES], [v.as_slice(); LANES]);
        let mut batch = FrameBatch::new(&model);
        let mut rows = vec![[0.0; LANES]; 6 * base.len()];
        group.throughput(Throughput::Elements(n as u64));
        group.bench_function(BenchmarkId::from_parameter(n), |b| {
            b.iter(|| {
                batch.forward_acceleration(&model, black_box(&qs), &vs, &vs);
                batch.base_wrench_rows(&base, black_box(&mut rows));
            });
        });
    }
    group.finish();
}

criterion_group!(benches, regressor, against_links);
criterion_main!(benches);
