//! A frame allocates nothing: positions, velocities, accelerations, Jacobian, forces, inertia
//! matrix and rows.
#![allow(clippy::unwrap_used, clippy::panic)] // functions shared by tests may stop them

mod common;

use aloft_body::{BaseParameters, FrameBatch, LANES, Model, State};
use common::{Random, human};
use nalgebra::{DMatrix, Vector3};

fn count(model: &Model) -> u64 {
    let mut random = Random(7);
    let base = BaseParameters::of(model);
    let phi = random.phi(model);
    let (q, v, a) = (random.q(model), random.values(model.nv, 3.0), random.values(model.nv, 10.0));
    let mut state = State::new(model);
    let mut full = DMatrix::zeros(6, 10 * model.n_links());
    let mut full3 = DMatrix::zeros(3, 10 * model.n_links());
    let mut rows = DMatrix::zeros(6, base.len());
    let mut rows3 = DMatrix::zeros(3, base.len());
    let mut jacobian = DMatrix::zeros(3, model.nv);
    let mut mass = DMatrix::zeros(model.nv, model.nv);
    let (mut tau, mut out) = (vec![0.0; model.nv], vec![0.0; model.nq]);
    let origin = Vector3::zeros();
    let last = model.n_links() - 1;
    let mut batch = FrameBatch::new(model);
    let mut lanes = vec![[0.0; LANES]; 6 * base.len()];
    let mut lanes3 = vec![[0.0; LANES]; 3 * base.len()];
    let (qs, vs, accelerations) = ([q.as_slice(); LANES], [v.as_slice(); LANES], [a.as_slice(); LANES]);
    let info = allocation_counter::measure(|| {
        batch.forward_acceleration(model, &qs, &vs, &accelerations);
        batch.base_wrench_rows(&base, &mut lanes);
        batch.forward_velocity(model, &qs, &vs, &origin);
        batch.momentum_rows(&base, &mut lanes);
        batch.first_moment_rows(&base, &mut lanes3);
        batch.centre_of_mass(&phi);
        state.forward_acceleration(model, &q, &v, &a);
        state.point_jacobian(model, last, &origin, &mut jacobian);
        state.inverse_dynamics(model, &phi, &mut tau);
        state.mass_matrix(model, &phi, &mut mass);
        state.base_wrench_regressor(model, &mut full);
        state.base_wrench_rows(model, &base, &mut rows);
        state.momentum_regressor(model, &origin, &mut full);
        state.momentum_rows(&base, &origin, &mut rows);
        state.first_moment_regressor(model, &origin, &mut full3);
        state.first_moment_rows(&base, &origin, &mut rows3);
        state.centre_of_mass(&phi);
        model.integrate(&q, &v, &mut out);
        model.difference(&q, &out, &mut tau);
        model.normalize(&mut out);
    });
    info.count_total
}

#[test]
fn no_allocation_in_a_frame() {
    assert_eq!(count(&human()), 0);
    assert_eq!(count(&Random(3).tree(12)), 0);
    assert!(allocation_counter::measure(|| drop(State::new(&human()))).count_total > 0, "the counter counts");
}
