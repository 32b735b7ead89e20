//! Rows compared with the truth: simulated motions, exact identities, sign and frame conventions.
#![allow(clippy::unwrap_used, reason = "tests")]

mod common;

use aloft_body::inertia::Phi;
use aloft_body::{BaseParameters, JointSpec, LinkSpec, Model, ModelSpec, Motion, State};
use aloft_regressor::{
    AccelerationOptions, AccelerationRows, Acting, CoordinateNoise, EffectColumns, Factor, Noise, Stretch, WeakOptions,
    acceleration_factor, body_windows, weak_factor, weak_rows,
};
use common::{Truth, differentiate, load};
use nalgebra::{DMatrix, DVector, UnitQuaternion, Vector3, Vector6};

fn weak(truth: &Truth, motion: &Motion, stretch: &Stretch, acting: Acting<'_>, options: &WeakOptions) -> Factor {
    weak_factor(&truth.model, &truth.base, &truth.phi, motion, stretch, acting, options, None).unwrap()
}

/// Root mean square row at given parameters and effects.
fn misfit(factor: &Factor, x: &DVector<f64>) -> f64 {
    (factor.sum_of_squares(x) / factor.n_rows as f64).sqrt()
}

#[test]
fn validate_acceleration_rows_vanish_on_simulated_flights() {
    let options = AccelerationOptions { margin_s: 0.0, ..AccelerationOptions::default() };
    for name in ["chain_p", "chain_a"] {
        let truth = load(name);
        let mut motion = truth.motion.clone();
        differentiate(&truth, &mut motion);
        for stretch in truth.stretches() {
            let factor =
                acceleration_factor(&truth.model, &truth.base, &motion, &stretch, Acting::nothing(), &options).unwrap();
            // coordinates are stored to 5e-9: differentiating twice at 200 Hz leaves about 1e-3 N
            // of 10
            let rms = misfit(&factor, &truth.truth());
            assert!(rms < 4e-3, "{name} flight {}: {rms:e} N", stretch.index);
        }
    }
    let truth = load("subject_a");
    let mut rows = AccelerationRows::new(&truth.model, &truth.base);
    let weight = truth.mass() * 9.81;
    for (frame, v, a) in truth.velocities().unwrap() {
        let wrench: DVector<f64> = rows.base_rows(truth.motion.q(frame), &v, &a) * truth.truth();
        assert!(wrench.amax() < 1e-5 * weight, "frame {frame}: {:e} N", wrench.amax());
    }
}

#[test]
fn validate_weak_rows_vanish_on_simulated_flights() {
    for (name, limit) in [("chain_p", 2e-6), ("chain_a", 2e-6), ("subject_a", 2e-5)] {
        let truth = load(name);
        for stretch in truth.stretches() {
            for window_s in [0.2, 0.3, 0.4] {
                let options = WeakOptions { window_s: Some(window_s), ..WeakOptions::default() };
                let factor = weak(&truth, &truth.motion, &stretch, Acting::nothing(), &options);
                let rms = misfit(&factor, &truth.truth());
                assert!(rms < limit, "{name} flight {} window {window_s}: {rms:e} of body weight", stretch.index);
            }
        }
    }
}

/// A rigid body in ballistic flight, spinning about a principal axis, far from the world's origin.
#[test]
fn a_ballistic_body_gives_exact_zeros() {
    let spec = ModelSpec {
        name: "stone".into(),
        links: vec![LinkSpec {
            name: "stone".into(),
            parent: None,
            joint: JointSpec::Free,
            position_m: [0.0; 3],
            rpy_rad: [0.0; 3],
            inertia: None,
        }],
        carries: Default::default(),
    };
    let model = Model::from_spec(&spec).unwrap();
    let base = BaseParameters::of(&model);
    let phi = vec![Phi::from_column_slice(&[2.0, 0.0, 0.0, 0.0, 0.1, 0.2, 0.3, 0.0, 0.0, 0.0])];
    let rate_hz = 100.0;
    let mut q = Vec::new();
    for i in 0..60 {
        let t = f64::from(i) / rate_hz;
        let p = Vector3::new(50.0, -20.0, 1.0) + Vector3::new(3.0, 1.0, 4.0) * t + model.gravity_mps2 * (0.5 * t * t);
        let r = UnitQuaternion::from_scaled_axis(Vector3::new(0.0, 7.0 * t, 0.0));
        q.extend_from_slice(&[p.x, p.y, p.z, r.i, r.j, r.k, r.w]);
    }
    let motion = Motion { trial: "stone".into(), rate_hz, nq: 7, nv: 6, q, ..Motion::default() };
    let stretch = Stretch::flight("stone", 0, 0, 60);
    let factor =
        weak_factor(&model, &base, &phi, &motion, &stretch, Acting::nothing(), &WeakOptions::default(), None).unwrap();
    let rms = misfit(&factor, &base.regroup(&phi));
    assert!(rms < 1e-11, "{rms:e} of body weight");
}

/// A chain moved along a smooth path by a wrench that is computed by inverse dynamics, not
/// integrated.
struct Driven {
    truth: Truth,
    motion: Motion,
    wrench: Vec<Vector6<f64>>,
}

fn driven(rate_hz: f64, n: usize) -> Driven {
    let truth = load("chain_p");
    let model = truth.model.clone();
    let mut q = Vec::new();
    for i in 0..n {
        let t = i as f64 / rate_hz;
        let r = UnitQuaternion::from_scaled_axis(Vector3::new(0.6 * (5.0 * t).sin(), 0.4 * (4.0 * t).cos(), 0.8 * t));
        q.extend_from_slice(&[0.3 * (3.0 * t).sin(), 0.2 * (4.0 * t).cos(), 1.0 + 0.2 * (6.0 * t).sin()]);
        q.extend_from_slice(&[r.i, r.j, r.k, r.w, 0.7 * (6.0 * t).sin()]);
    }
    let mut motion = Motion { trial: "driven".into(), rate_hz, nq: model.nq, nv: model.nv, q, ..Motion::default() };
    let mut shell = Truth { flights: vec![[0, 4, n - 4, n]], ..truth };
    differentiate(&shell, &mut motion);
    shell.motion = motion.clone();
    let mut rows = AccelerationRows::new(&shell.model, &shell.base);
    let wrench = (0..n)
        .map(|f| {
            let local: DVector<f64> = rows.base_rows(motion.q(f), motion.v(f), motion.a(f)) * shell.truth();
            let pose = rows.world_from_root();
            let force = pose.rotation * Vector3::new(local[0], local[1], local[2]);
            let moment =
                pose.rotation * Vector3::new(local[3], local[4], local[5]) + pose.translation.vector.cross(&force);
            Vector6::new(force.x, force.y, force.z, moment.x, moment.y, moment.z)
        })
        .collect();
    Driven { truth: shell, motion, wrench }
}

#[test]
fn contact_rows_balance_a_known_wrench() {
    let d = driven(500.0, 600);
    let stretch = Stretch::contact("driven", 0, 10, 590);
    let acting = Acting { measured: Some(&d.wrench), effects: None };
    for window_s in [0.1, 0.3] {
        let options = WeakOptions { window_s: Some(window_s), ..WeakOptions::default() };
        let rms = misfit(&weak(&d.truth, &d.motion, &stretch, acting, &options), &d.truth.truth());
        assert!(rms < 1e-8, "weak rows, window {window_s}: {rms:e} of body weight");
    }
    let factor = acceleration_factor(
        &d.truth.model,
        &d.truth.base,
        &d.motion,
        &stretch,
        acting,
        &AccelerationOptions::default(),
    )
    .unwrap();
    assert!(misfit(&factor, &d.truth.truth()) < 1e-9);
}

/// A load changes the base parameters: its column is that of the rows themselves, whatever the
/// accelerations of the smoothed motion are.
#[test]
fn an_effect_that_changes_the_inertia_is_a_change_of_parameters() {
    let d = driven(500.0, 600);
    let p = d.truth.base.len();
    let load = d.truth.truth() * 0.1;
    let effects = EffectColumns {
        names: vec!["driver".into(), "load".into()],
        wrench: d.wrench.iter().map(|w| DMatrix::from_fn(6, 2, |i, j| if j == 0 { w[i] } else { 0.0 })).collect(),
        inertia: vec![None, Some(load.clone())],
        ..EffectColumns::none()
    };
    let acting = Acting { measured: None, effects: Some(&effects) };
    let stretch = Stretch::flight("driven", 0, 10, 590);
    let mut x = (d.truth.truth() + 3.0 * load).resize_vertically(p + 2, 0.0);
    (x[p], x[p + 1]) = (1.0, -3.0);
    let options = WeakOptions { window_s: Some(0.3), ..WeakOptions::default() };
    let factor = weak(&d.truth, &d.motion, &stretch, acting, &options);
    assert!(misfit(&factor, &x) < 1e-8, "{:e}", misfit(&factor, &x));
    let options = AccelerationOptions::default();
    let factor = acceleration_factor(&d.truth.model, &d.truth.base, &d.motion, &stretch, acting, &options).unwrap();
    assert!(misfit(&factor, &x) < 1e-8, "{:e}", misfit(&factor, &x));
}

#[test]
fn an_effect_acts_like_a_measured_wrench() {
    let d = driven(500.0, 600);
    let effects = EffectColumns {
        names: vec!["driver".into(), "nothing".into()],
        wrench: d.wrench.iter().map(|w| DMatrix::from_fn(6, 2, |i, j| if j == 0 { 0.5 * w[i] } else { 0.0 })).collect(),
        ..EffectColumns::none()
    };
    let acting = Acting { measured: None, effects: Some(&effects) };
    let stretch = Stretch::flight("driven", 0, 10, 590);
    let mut x = d.truth.truth().resize_vertically(d.truth.base.len() + 2, 0.0);
    x[d.truth.base.len()] = 2.0;
    let options = WeakOptions { window_s: Some(0.3), ..WeakOptions::default() };
    let factor = weak(&d.truth, &d.motion, &stretch, acting, &options);
    assert!(misfit(&factor, &x) < 1e-8, "{:e}", misfit(&factor, &x));
    let factor = acceleration_factor(
        &d.truth.model,
        &d.truth.base,
        &d.motion,
        &stretch,
        acting,
        &AccelerationOptions::default(),
    )
    .unwrap();
    assert!(misfit(&factor, &x) < 1e-9, "{:e}", misfit(&factor, &x));
    let without = factor.with_effects(&["nothing"]).unwrap();
    x.remove_row(d.truth.base.len());
    assert_eq!(without.n_effects(), 1);
    assert!(factor.with_effects(&["unknown"]).is_err());
}

#[test]
fn missing_frames_split_windows_and_spoil_nothing() {
    let truth = load("chain_p");
    let stretch = truth.stretches()[0].clone();
    let options = WeakOptions { window_s: Some(0.2), ..WeakOptions::default() };
    let whole = weak(&truth, &truth.motion, &stretch, Acting::nothing(), &options);
    let mut motion = truth.motion.clone();
    let gap = stretch.first_frame + 60;
    for value in &mut motion.q[gap * truth.model.nq..(gap + 3) * truth.model.nq] {
        *value = f64::NAN;
    }
    let split = weak(&truth, &motion, &stretch, Acting::nothing(), &options);
    assert!(split.n_rows < whole.n_rows && split.n_rows > 0);
    assert!(misfit(&split, &truth.truth()) < 3e-6);
    let nothing = Stretch::flight("chain_p", 0, gap, gap + 3);
    let failed =
        weak_factor(&truth.model, &truth.base, &truth.phi, &motion, &nothing, Acting::nothing(), &options, None);
    assert!(failed.is_err());
    assert!(
        weak_factor(
            &truth.model,
            &truth.base,
            &truth.phi,
            &motion,
            &Stretch::contact("chain_p", 0, 0, 100),
            Acting::nothing(),
            &options,
            None
        )
        .is_err()
    );
    assert!(
        weak_factor(
            &truth.model,
            &truth.base,
            &truth.phi,
            &motion,
            &Stretch::flight("chain_p", 0, 0, 1_000_000),
            Acting::nothing(),
            &options,
            None
        )
        .is_err()
    );
    assert!(
        acceleration_factor(
            &truth.model,
            &truth.base,
            &motion,
            &stretch,
            Acting::nothing(),
            &AccelerationOptions::default()
        )
        .is_err()
    );
}

/// Whitened rows of noisy markers have unit variance at the true parameters: the propagated
/// covariance is correct.
#[test]
fn whitened_rows_have_unit_variance() {
    for name in ["chain_p", "chain_a", "subject_a"] {
        let truth = load(name);
        let sd_m = 0.3e-3;
        let noise = Noise::white(CoordinateNoise::Markers { markers: &truth.markers, sd_m });
        let options = WeakOptions { window_s: Some(0.25), ..WeakOptions::default() };
        let (mut squares, mut rows) = (0.0, 0);
        for seed in 0..if name == "subject_a" { 6 } else { 3 } {
            let motion = truth.noisy(sd_m, seed);
            for stretch in truth.stretches() {
                let factor = weak_factor(
                    &truth.model,
                    &truth.base,
                    &truth.phi,
                    &motion,
                    &stretch,
                    Acting::nothing(),
                    &options,
                    Some(&noise),
                )
                .unwrap();
                squares += factor.sum_of_squares(&truth.truth());
                rows += factor.n_rows;
            }
        }
        let sd = (squares / f64::from(u32::try_from(rows).unwrap())).sqrt();
        println!("{name}: whitened rows of noisy markers have standard deviation {sd:.3}");
        assert!((sd - 1.0).abs() < 0.07, "{name}: standard deviation {sd} over {rows} rows");
    }
}

/// The regressor in the root frame agrees with the momentum form at any rate: two independent
/// derivations.
#[test]
fn the_moment_origin_does_not_matter() {
    let d = driven(500.0, 400);
    let stretch = Stretch::contact("driven", 0, 10, 390);
    let acting = Acting { measured: Some(&d.wrench), effects: None };
    let options = WeakOptions { window_s: Some(0.3), moment_length_m: Some(0.1), ..WeakOptions::default() };
    // a wrong prior moves the origin by decimetres, the balance is unchanged
    let mut wrong = d.truth.phi.clone();
    wrong[0][1] += 0.3;
    wrong[1][2] -= 0.1;
    let factor =
        weak_factor(&d.truth.model, &d.truth.base, &wrong, &d.motion, &stretch, acting, &options, None).unwrap();
    assert!(misfit(&factor, &d.truth.truth()) < 1e-8, "{:e}", misfit(&factor, &d.truth.truth()));
    let mut state = State::new(&d.truth.model);
    state.forward_position(&d.truth.model, d.motion.q(0));
    assert!((state.centre_of_mass(&wrong).1 - state.centre_of_mass(&d.truth.phi).1).norm() > 0.2);
}

#[test]
fn windows_of_a_body_are_its_rows_times_its_parameters() {
    for name in ["chain_p", "subject_a"] {
        let truth = load(name);
        let acts: Vec<Vector6<f64>> = (0..truth.motion.n_frames())
            .map(|f| Vector6::from_fn(|i, _| (0.1 * f as f64 + i as f64).sin() * 3.0))
            .collect();
        for flight in truth.stretches() {
            let contact = Stretch::contact(name, flight.index, flight.first_frame, flight.end_frame);
            let acting = Acting { measured: Some(&acts), effects: None };
            for (stretch, acting) in [(&flight, Acting::nothing()), (&contact, acting)] {
                let options = WeakOptions { window_s: Some(0.25), ..WeakOptions::default() };
                let (model, base, phi) = (&truth.model, &truth.base, &truth.phi);
                let rows = weak_rows(model, base, phi, &truth.motion, stretch, acting, &options).unwrap();
                let found = body_windows(model, phi, phi, &truth.motion, stretch, acting, &options).unwrap();
                assert_eq!(found.centres, rows.centres);
                let x = truth.truth();
                let last = rows.matrix.ncols() - 1;
                for (w, wrench) in found.wrench.iter().enumerate() {
                    for axis in 0..6 {
                        let row = 6 * w + axis;
                        let body: f64 = x.iter().enumerate().map(|(c, x)| rows.matrix[(row, c)] * x).sum();
                        let expected = (body - rows.matrix[(row, last)]) / rows.test.integral_s();
                        assert!((wrench[axis] - expected).abs() < 1e-7, "{name} window {w} axis {axis}");
                    }
                }
            }
        }
    }
}
