//! A batch of eight frames gives the same results as each frame alone.
#![allow(clippy::unwrap_used, clippy::panic)] // functions shared by tests may stop them

mod common;

use aloft_body::{BaseParameters, FrameBatch, FrameBlock, LANES, Model, State};
use common::{Random, close, human};
use nalgebra::{DMatrix, Vector3};
use proptest::prelude::*;

/// Rows of one lane as a matrix of `rows` rows.
fn lane_of(rows: usize, values: &[FrameBlock], lane: usize) -> DMatrix<f64> {
    DMatrix::from_fn(rows, values.len() / rows, |i, j| values[rows * j + i][lane])
}

fn compare(model: &Model, random: &mut Random) {
    let base = BaseParameters::of(model);
    let phi = random.phi(model);
    let origin = random.vector(1.0);
    let frames: Vec<(Vec<f64>, Vec<f64>, Vec<f64>)> = (0..LANES)
        .map(|_| {
            let mut q = random.q(model);
            // Quaternions need not have unit length.
            for joint in model.links.iter().map(|link| &link.joint) {
                if let Some(first) = joint.quaternion_offset() {
                    q[first..first + 4].iter_mut().for_each(|x| *x *= 1.7);
                }
            }
            (q, random.values(model.nv, 4.0), random.values(model.nv, 20.0))
        })
        .collect();
    let q: [&[f64]; LANES] = std::array::from_fn(|k| frames[k].0.as_slice());
    let v: [&[f64]; LANES] = std::array::from_fn(|k| frames[k].1.as_slice());
    let a: [&[f64]; LANES] = std::array::from_fn(|k| frames[k].2.as_slice());

    let mut batch = FrameBatch::new(model);
    let mut wrench = vec![[f64::NAN; LANES]; 6 * base.len()];
    let mut momentum = wrench.clone();
    let mut moment = vec![[f64::NAN; LANES]; 3 * base.len()];
    batch.forward_acceleration(model, &q, &v, &a);
    batch.base_wrench_rows(&base, &mut wrench);
    batch.forward_velocity(model, &q, &v, &origin);
    batch.momentum_rows(&base, &mut momentum);
    batch.first_moment_rows(&base, &mut moment);
    let centres = batch.centre_of_mass(&phi);

    let mut state = State::new(model);
    let mut rows = DMatrix::zeros(6, base.len());
    let mut rows3 = DMatrix::zeros(3, base.len());
    for lane in 0..LANES {
        state.forward_acceleration(model, q[lane], v[lane], a[lane]);
        state.base_wrench_rows(model, &base, &mut rows);
        close("base wrench", lane_of(6, &wrench, lane).as_slice(), rows.as_slice(), 1e-14);
        state.momentum_rows(&base, &origin, &mut rows);
        close("momentum", lane_of(6, &momentum, lane).as_slice(), rows.as_slice(), 1e-14);
        state.first_moment_rows(&base, &origin, &mut rows3);
        close("first moment", lane_of(3, &moment, lane).as_slice(), rows3.as_slice(), 1e-14);
        let alone = state.centre_of_mass(&phi).1 - origin;
        close("centre of mass", centres[lane].as_slice(), alone.as_slice(), 1e-14);
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(200))]

    #[test]
    fn prop_a_batch_gives_the_rows_of_each_frame(seed: u64, n in 1usize..14) {
        let mut random = Random(seed);
        let mut model = random.tree(n);
        model.gravity_mps2 = random.vector(10.0);
        compare(&model, &mut random);
    }
}

#[test]
fn a_batch_gives_the_rows_of_each_frame_of_a_person() {
    let mut random = Random(5);
    for _ in 0..20 {
        compare(&human(), &mut random);
    }
}

#[test]
fn a_frame_gives_the_same_numbers_in_any_lane() {
    let model = human();
    let base = BaseParameters::of(&model);
    let mut random = Random(11);
    let (q, v, a) = (random.q(&model), random.values(model.nv, 4.0), random.values(model.nv, 20.0));
    let (other_q, other_v) = (random.q(&model), random.values(model.nv, 4.0));
    let mut batch = FrameBatch::new(&model);
    let mut rows = vec![[0.0; LANES]; 6 * base.len()];
    let mut found: Vec<DMatrix<f64>> = Vec::new();
    for lane in 0..LANES {
        let (mut qs, mut vs) = ([other_q.as_slice(); LANES], [other_v.as_slice(); LANES]);
        (qs[lane], vs[lane]) = (&q, &v);
        batch.forward_acceleration(&model, &qs, &vs, &[a.as_slice(); LANES]);
        batch.base_wrench_rows(&base, &mut rows);
        found.push(lane_of(6, &rows, lane));
        batch.forward_velocity(&model, &qs, &vs, &Vector3::zeros());
        batch.momentum_rows(&base, &mut rows);
        found.push(lane_of(6, &rows, lane));
    }
    for pair in found.chunks(2) {
        assert_eq!(pair, &found[..2]);
    }
}
