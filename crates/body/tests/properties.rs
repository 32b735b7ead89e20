//! Invariants on random trees with every joint type.
#![allow(clippy::unwrap_used, clippy::panic)] // functions shared by tests may stop them

mod common;

use aloft_body::inertia::{phi_from_pseudo_inertia, phi_transform, pseudo_inertia};
use aloft_body::rotation::{left_jacobian, left_jacobian_inverse, quaternion_exp, quaternion_log};
use aloft_body::{BaseParameters, LinkInertia, Model, Phi, State};
use common::{Random, close};
use nalgebra::{DMatrix, DVector, Isometry3, Vector3};
use proptest::prelude::*;

fn stack(phi: &[Phi]) -> DVector<f64> {
    DVector::from_iterator(10 * phi.len(), phi.iter().flat_map(|p| p.iter().copied()))
}

/// State at time `t` of a smooth motion through (q, v, a): on the group, exact to second order.
fn at_time(model: &Model, q: &[f64], v: &[f64], a: &[f64], t: f64) -> (Vec<f64>, Vec<f64>) {
    let step: Vec<f64> = v.iter().zip(a).map(|(v, a)| v * t + 0.5 * a * t * t).collect();
    let mut out = vec![0.0; model.nq];
    model.integrate(q, &step, &mut out);
    // Body velocity of q ⊕ x(t) differs from ẋ by the right Jacobian, −½[x]ẋ to first order in t,
    // where x ∥ ẋ: nothing to first order.
    let velocity = v.iter().zip(a).map(|(v, a)| v + a * t).collect();
    (out, velocity)
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(200))]

    #[test]
    fn prop_regressor_times_parameters_is_newton_euler(seed: u64, n in 1usize..10) {
        let mut random = Random(seed);
        let mut model = random.tree(n);
        model.gravity_mps2 = random.vector(10.0);
        let phi = random.phi(&model);
        let (q, v, a) = (random.q(&model), random.values(model.nv, 5.0), random.values(model.nv, 30.0));
        let mut state = State::new(&model);
        state.forward_acceleration(&model, &q, &v, &a);
        let mut tau = vec![0.0; model.nv];
        state.inverse_dynamics(&model, &phi, &mut tau);
        let mut rows = DMatrix::zeros(6, 10 * n);
        state.base_wrench_regressor(&model, &mut rows);
        close("wrench", (rows * stack(&phi)).as_slice(), &tau[..6], 1e-12);
    }

    #[test]
    fn prop_mass_matrix_is_linear_part_of_newton_euler(seed: u64, n in 1usize..8) {
        let mut random = Random(seed);
        let model = random.tree(n);
        let phi = random.phi(&model);
        let (q, v, a) = (random.q(&model), random.values(model.nv, 5.0), random.values(model.nv, 30.0));
        let mut state = State::new(&model);
        let (mut with, mut without) = (vec![0.0; model.nv], vec![0.0; model.nv]);
        state.forward_acceleration(&model, &q, &v, &a);
        state.inverse_dynamics(&model, &phi, &mut with);
        state.forward_acceleration(&model, &q, &v, &vec![0.0; model.nv]);
        state.inverse_dynamics(&model, &phi, &mut without);
        let mut mass = DMatrix::zeros(model.nv, model.nv);
        state.mass_matrix(&model, &phi, &mut mass);
        let expected: Vec<f64> = with.iter().zip(&without).map(|(w, o)| w - o).collect();
        close("M a", (&mass * DVector::from_column_slice(&a)).as_slice(), &expected, 1e-11);
        prop_assert!(mass.symmetric_eigenvalues().min() > -1e-12);
    }

    #[test]
    fn prop_momentum_changes_by_the_wrench(seed: u64, n in 1usize..8) {
        let mut random = Random(seed);
        let mut model = random.tree(n);
        model.gravity_mps2 = random.vector(10.0);
        let phi = random.phi(&model);
        let phi = stack(&phi);
        let (q, v, a) = (random.q(&model), random.values(model.nv, 2.0), random.values(model.nv, 5.0));
        let origin = random.vector(1.0);
        let mut state = State::new(&model);
        let mut rows = DMatrix::zeros(6, 10 * n);
        let mut moments = DMatrix::zeros(3, 10 * n);
        let h = 1e-5;
        let mut sample = |t: f64| {
            let (q, v) = at_time(&model, &q, &v, &a, t);
            state.forward_velocity(&model, &q, &v);
            state.momentum_regressor(&model, &origin, &mut rows);
            state.first_moment_regressor(&model, &origin, &mut moments);
            (&rows * &phi, &moments * &phi)
        };
        let (after, before) = (sample(h), sample(-h));
        let now = sample(0.0);
        // Linear momentum is the rate of the first moment.
        let rate = (after.1 - before.1) / (2.0 * h);
        close("linear momentum", rate.as_slice(), &now.0.as_slice()[..3], 1e-7);
        // The rate of momentum about a fixed point, minus gravity, is the wrench transferred to
        // that point.
        let rate = (after.0 - before.0) / (2.0 * h);
        let mass: f64 = phi.iter().step_by(10).sum();
        let g = model.gravity_mps2;
        let gravity_moment = Vector3::from_column_slice(now.1.as_slice()).cross(&g);
        state.forward_acceleration(&model, &q, &v, &a);
        let mut wrench_rows = DMatrix::zeros(6, 10 * n);
        state.base_wrench_regressor(&model, &mut wrench_rows);
        let wrench = wrench_rows * &phi;
        let root = state.world_from_link[0];
        let force = root.rotation * Vector3::new(wrench[0], wrench[1], wrench[2]);
        let moment = root.rotation * Vector3::new(wrench[3], wrench[4], wrench[5])
            + (root.translation.vector - origin).cross(&force);
        let expected: Vec<f64> =
            (force + g * mass).iter().chain((moment + gravity_moment).iter()).copied().collect();
        close("rate of momentum", rate.as_slice(), &expected, 1e-6);
    }

    #[test]
    fn prop_jacobian_and_velocities_are_derivatives(seed: u64, n in 1usize..8) {
        let mut random = Random(seed);
        let model = random.tree(n);
        let (q, v, a) = (random.q(&model), random.values(model.nv, 2.0), random.values(model.nv, 5.0));
        let link = random.below(n);
        let point = random.vector(0.3);
        let mut state = State::new(&model);
        state.forward_acceleration(&model, &q, &v, &a);
        let mut jacobian = DMatrix::zeros(3, model.nv);
        state.point_jacobian(&model, link, &point, &mut jacobian);
        let velocity = state.point_velocity_in_world(link, &point);
        let acceleration = state.point_acceleration_in_world(link, &point);
        close("J v", (&jacobian * DVector::from_column_slice(&v)).as_slice(), velocity.as_slice(), 1e-12);
        let h = 1e-5;
        let mut sample = |t: f64| {
            let (q, v) = at_time(&model, &q, &v, &a, t);
            state.forward_velocity(&model, &q, &v);
            (state.point_in_world(link, &point), state.point_velocity_in_world(link, &point))
        };
        let (after, before) = (sample(h), sample(-h));
        close("velocity", ((after.0 - before.0) / (2.0 * h)).as_slice(), velocity.as_slice(), 1e-7);
        close("acceleration", ((after.1 - before.1) / (2.0 * h)).as_slice(), acceleration.as_slice(), 1e-6);
    }

    #[test]
    fn prop_difference_inverts_integrate(seed: u64, n in 1usize..8, scale in 1e-9f64..1.7) {
        let mut random = Random(seed);
        let model = random.tree(n);
        let q = random.q(&model);
        let step = random.values(model.nv, scale);
        let mut other = vec![0.0; model.nq];
        model.integrate(&q, &step, &mut other);
        let mut found = vec![0.0; model.nv];
        model.difference(&q, &other, &mut found);
        for (f, s) in found.iter().zip(&step) {
            prop_assert!((f - s).abs() < 1e-13, "{f:e} {s:e}");
        }
        let negated: Vec<f64> = other
            .iter()
            .enumerate()
            .map(|(k, x)| {
                let quaternion = |j: &aloft_body::Joint| j.quaternion_offset().is_some_and(|o| (o..o + 4).contains(&k));
                if model.links.iter().any(|l| quaternion(&l.joint)) { -x } else { *x }
            })
            .collect();
        let mut again = vec![0.0; model.nv];
        model.difference(&q, &negated, &mut again);
        close("sign of quaternions", &again, &found, 1e-13);
    }

    #[test]
    fn prop_quaternion_of_any_length_is_the_same_pose(seed: u64, n in 1usize..6, factor in -3.0f64..3.0) {
        prop_assume!(factor.abs() > 0.05);
        let mut random = Random(seed);
        let model = random.tree(n);
        let q = random.q(&model);
        let mut stretched = q.clone();
        for link in &model.links {
            if let Some(first) = link.joint.quaternion_offset() {
                stretched[first..first + 4].iter_mut().for_each(|x| *x *= factor);
            }
        }
        let (mut one, mut other) = (State::new(&model), State::new(&model));
        one.forward_position(&model, &q);
        other.forward_position(&model, &stretched);
        for i in 0..n {
            close("rotation", other.rotation(i).as_slice(), one.rotation(i).as_slice(), 1e-13);
        }
        model.normalize(&mut stretched);
        let mut zero = vec![1.0; model.nv];
        model.difference(&q, &stretched, &mut zero);
        prop_assert!(zero.iter().all(|x| x.abs() < 1e-12));
    }

    #[test]
    fn prop_regrouped_rows_predict_the_same(seed: u64, n in 1usize..9) {
        let mut random = Random(seed);
        let model = random.tree(n);
        let base = BaseParameters::of(&model);
        let phi = random.phi(&model);
        let (q, v, a) = (random.q(&model), random.values(model.nv, 5.0), random.values(model.nv, 30.0));
        let origin = random.vector(1.0);
        let mut state = State::new(&model);
        state.forward_acceleration(&model, &q, &v, &a);
        let mut full = DMatrix::zeros(6, 10 * n);
        let mut rows = DMatrix::zeros(6, base.len());
        state.base_wrench_regressor(&model, &mut full);
        state.base_wrench_rows(&model, &base, &mut rows);
        let grouped = base.regroup(&phi);
        close("direct columns", rows.as_slice(), (&full * &base.to_full).as_slice(), 1e-13);
        close("wrench", (&rows * &grouped).as_slice(), (&full * stack(&phi)).as_slice(), 1e-11);
        state.momentum_regressor(&model, &origin, &mut full);
        state.momentum_rows(&base, &origin, &mut rows);
        close("direct columns", rows.as_slice(), (&full * &base.to_full).as_slice(), 1e-13);
        close("momentum", (&rows * &grouped).as_slice(), (&full * stack(&phi)).as_slice(), 1e-11);
        let mut full = DMatrix::zeros(3, 10 * n);
        let mut rows = DMatrix::zeros(3, base.len());
        state.first_moment_regressor(&model, &origin, &mut full);
        state.first_moment_rows(&base, &origin, &mut rows);
        close("direct columns", rows.as_slice(), (&full * &base.to_full).as_slice(), 1e-13);
        close("first moment", (&rows * &grouped).as_slice(), (&full * stack(&phi)).as_slice(), 1e-11);
        let identity = &base.from_full * &base.to_full;
        close("B K", identity.as_slice(), DMatrix::<f64>::identity(base.len(), base.len()).as_slice(), 1e-13);
        prop_assert!((grouped[0] - phi.iter().map(|p| p[0]).sum::<f64>()).abs() < 1e-12);
    }

    #[test]
    fn prop_inertia_round_trips(seed: u64) {
        let mut random = Random(seed);
        let inertia = random.inertia();
        let phi = inertia.to_phi();
        let back = LinkInertia::from_phi(&phi);
        close("com", back.com_m.as_slice(), inertia.com_m.as_slice(), 1e-13);
        close("inertia", back.inertia_com_kgm2.as_slice(), inertia.inertia_com_kgm2.as_slice(), 1e-12);
        let j = pseudo_inertia(&phi);
        prop_assert!(j.symmetric_eigenvalues().min() > 0.0);
        close("pseudo-inertia", phi_from_pseudo_inertia(&j).as_slice(), phi.as_slice(), 1e-14);
        let pose = Isometry3::new(random.vector(1.0), random.vector(3.0));
        let moved = inertia.transformed(&pose).to_phi();
        close("transform", (phi_transform(&pose) * phi).as_slice(), moved.as_slice(), 1e-12);
        close("inverse", (phi_transform(&pose.inverse()) * moved).as_slice(), phi.as_slice(), 1e-11);
    }

    #[test]
    fn prop_rotation_maps_invert(seed: u64, exponent in -12.0f64..0.0) {
        let mut random = Random(seed);
        let direction = random.vector(1.0).normalize();
        // From far below the limit of the series to slightly below half a turn.
        for angle in [std::f64::consts::PI * 10f64.powf(exponent), std::f64::consts::PI * (1.0 - 10f64.powf(exponent))] {
            let omega = direction * angle;
            let q = quaternion_exp(&omega);
            prop_assert!((q.norm() - 1.0).abs() < 4e-16);
            for q in [*q.quaternion(), -*q.quaternion(), q.quaternion() * 3.0] {
                let back = quaternion_log(&q);
                // At exactly half a turn both signs are valid; below it the error stays at rounding
                // level.
                prop_assert!((back - omega).norm() <= 2e-15 * (1.0 + angle) , "{:e}", (back - omega).norm());
            }
            let product = left_jacobian(&omega) * left_jacobian_inverse(&omega);
            prop_assert!((product - nalgebra::Matrix3::identity()).norm() < 1e-13);
        }
    }
}

#[test]
fn missing_coordinates_stay_missing() {
    let model = common::human();
    let mut state = State::new(&model);
    state.forward_acceleration(&model, &vec![f64::NAN; model.nq], &vec![0.0; model.nv], &vec![0.0; model.nv]);
    assert!(state.world_from_link[14].translation.vector.x.is_nan());
}
