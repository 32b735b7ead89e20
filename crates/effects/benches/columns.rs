//! Unit wrenches of every effect of the catalogue over one flight of 120 frames of a two-link body.
//!
//! `cargo bench -p aloft-effects`
#![allow(missing_docs, reason = "criterion makes the functions")]

use aloft_body::{JointSpec, LinkInertia, LinkSpec, Model, ModelSpec, Motion, Phi};
use aloft_effects::{EFFECTS, EffectInstance, Scene, Span, TrialMotion, columns};
use criterion::{Criterion, criterion_group, criterion_main};
use nalgebra::{Matrix3, UnitQuaternion, Vector3};

fn effects(c: &mut Criterion) {
    let link = |name: &str, parent: Option<&str>, joint| LinkSpec {
        name: name.into(),
        parent: parent.map(Into::into),
        joint,
        position_m: [0.02, 0.18, -0.01],
        rpy_rad: [0.0; 3],
        inertia: None,
    };
    let links = vec![link("base", None, JointSpec::Free), link("arm", Some("base"), JointSpec::RevoluteZ)];
    let Ok(model) = Model::from_spec(&ModelSpec::new("two".into(), links)) else { return };
    let inertia = LinkInertia {
        mass_kg: 0.5,
        com_m: Vector3::new(0.01, 0.09, 0.02),
        inertia_com_kgm2: Matrix3::from_diagonal_element(2e-3),
    };
    let phi: Vec<Phi> = vec![inertia.to_phi(); 2];
    let rate_hz = 200.0;
    let mut q = Vec::new();
    for f in 0..160 {
        let t = f as f64 / rate_hz;
        q.extend([1.0 + 2.0 * t, 0.3 - 1.5 * t, 1.0 + 3.0 * t - 4.9 * t * t]);
        let turn = UnitQuaternion::from_scaled_axis(Vector3::new(1.5 * t, 2.0 * (2.0 * t).sin(), 0.5 - 3.0 * t));
        q.extend(turn.coords.iter());
        q.push(0.4 * (5.0 * t).sin());
    }
    let motion = Motion { trial: "smooth".into(), rate_hz, nq: model.nq, nv: model.nv, q, ..Motion::default() };
    let scene = Scene::new(&model, &phi, &[]);
    let spans = [Span { first_frame: 20, end_frame: 140, flight: true }];
    let trial = TrialMotion { motion: &motion, spans: &spans, plates: &[], session_time_s: 0.0 };
    let mut group = c.benchmark_group("columns");
    for effect in EFFECTS.iter().copied() {
        let targets = effect.targets(&scene);
        let Some(target) = targets.into_iter().next() else { continue };
        let choices = [EffectInstance::new(effect, target, &scene)];
        if columns(&scene, &trial, &choices).is_err() {
            continue;
        }
        group.bench_function(effect.id(), |b| b.iter(|| columns(&scene, &trial, &choices).is_ok()));
    }
    group.finish();
}

criterion_group!(benches, effects);
criterion_main!(benches);
