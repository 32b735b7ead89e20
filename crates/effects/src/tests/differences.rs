//! Columns compared with finite differences: of the recorded motion, and with respect to nonlinear
//! parameters.

use super::{Fixture, inverse_dynamics, model, phi};
use crate::*;
use aloft_body::{Motion, State};
use nalgebra::{Quaternion, UnitQuaternion, Vector3, Vector6};

#[test]
fn validate_the_wrench_of_inertia_against_recursive_newton_euler() {
    let fixture = Fixture::new(true);
    fixture.with(|series| {
        let ours = inverse_dynamics(series, &fixture.scene.phi);
        for i in (0..series.len()).step_by(13) {
            let total = series.frame(i).com_acceleration - fixture.scene.model.gravity_mps2;
            let force = total * fixture.scene.mass_kg;
            assert!((ours.force(i, 0) - force).norm() < 1e-9 * force.norm(), "{i}");
        }
    });
}

#[test]
fn a_displaced_joint_changes_the_wrench_as_its_columns_say() {
    let fixture = Fixture::new(true);
    let step = 1e-4;
    fixture.with(|series| {
        let choice = EffectInstance::parse("joint_centre[arm]", &fixture.scene).unwrap();
        let columns = fixture.columns(series, choice.effect, choice.target, &[]);
        let plain = inverse_dynamics(series, &fixture.scene.phi);
        for axis in 0..3 {
            let mut offset = [0.02, 0.18, -0.01];
            offset[axis] += step;
            let moved = model(offset);
            let scene = Scene::new(&moved, &phi(), &[]);
            let spans = [Span { first_frame: 20, end_frame: 140, flight: true }];
            let trial = TrialMotion { motion: &fixture.motion, spans: &spans, plates: &[], session_time_s: 0.0 };
            let other = Series::new(&scene, &trial).unwrap();
            let changed = inverse_dynamics(&other, &scene.phi);
            // away from the ends of the run, where the derivatives of the columns are one-sided
            let (mut size, mut error) = (0.0f64, 0.0f64);
            for i in 20..series.len() - 20 {
                let by_difference = (Vector6::from_column_slice(changed.wrench(i, 0))
                    - Vector6::from_column_slice(plain.wrench(i, 0)))
                    / step;
                size = size.max(by_difference.norm());
                error = error.max((by_difference - Vector6::from_column_slice(columns.wrench(i, axis))).norm());
            }
            assert!(error < 0.03 * size, "{axis}: {error} of {size}");
        }
    });
}

/// The motion is recorded with a wrong zero of the encoder, and with the base ahead of the joints:
/// what inverse dynamics of the whole tree changes by is the column.
#[test]
fn a_wrong_encoder_and_a_wrong_clock_change_the_wrench_as_their_columns_say() {
    let fixture = Fixture::new(true);
    let (nq, n) = (fixture.motion.nq, fixture.motion.n_frames());
    let with = |q: Vec<f64>| Motion { q, ..fixture.motion.clone() };
    let mut turned = fixture.motion.q.clone();
    turned.chunks_exact_mut(nq).for_each(|q| q[7] += 1e-4);
    // half a frame forward and back: the motion is smooth
    let shifted = |sign: f64| {
        let mut q = fixture.motion.q.clone();
        for i in 1..n - 1 {
            let (other, here) = ((i as f64 + sign) as usize, i * nq);
            for k in 0..7 {
                q[here + k] = fixture.motion.q[other * nq + k];
            }
        }
        q
    };
    let wrench = |motion: &Motion| {
        let spans = [Span { first_frame: 20, end_frame: 140, flight: true }];
        let trial = TrialMotion { motion, spans: &spans, plates: &[], session_time_s: 0.0 };
        inverse_dynamics(&Series::new(&fixture.scene, &trial).unwrap(), &fixture.scene.phi)
    };
    let (earlier, later) = (wrench(&with(shifted(-1.0))), wrench(&with(shifted(1.0))));
    let (plain, moved) = (wrench(&fixture.motion), wrench(&with(turned)));
    let cases = [
        ("encoder_offset[arm]", plain, moved, 1e-4),
        ("base_time_offset", earlier, later, 2.0 / fixture.motion.rate_hz),
    ];
    fixture.with(|series| {
        for (key, before, after, step) in &cases {
            let choice = EffectInstance::parse(key, &fixture.scene).unwrap();
            let columns = fixture.columns(series, choice.effect, choice.target, &[]);
            let (mut size, mut error) = (0.0f64, 0.0f64);
            for i in 20..series.len() - 20 {
                let of = |c: &Columns| Vector6::from_column_slice(c.wrench(i, 0));
                let by_difference = (of(after) - of(before)) / *step;
                size = size.max(by_difference.norm());
                error = error.max((by_difference - of(&columns)).norm());
            }
            assert!(size > 0.0 && error < 0.05 * size, "{key}: {error} of {size}");
        }
    });
}

/// Columns follow the nonlinear parameters smoothly: one-sided differences of two sizes agree, for
/// every effect, target and parameter.
#[test]
fn columns_change_with_their_parameters_as_differences_say() {
    let fixture = Fixture::new(true);
    fixture.with(|series| {
        for effect in EFFECTS.iter().filter(|e| e.has_wrench()) {
            for target in effect.targets(&fixture.scene) {
                let parameters = effect.nonlinear(&fixture.scene, target);
                let Some(start) =
                    effect.starts(&fixture.scene, target).into_iter().nth(if effect.id() == "wind" { 1 } else { 0 })
                else {
                    continue;
                };
                for (k, q) in parameters.iter().enumerate() {
                    let moved = |by: f64| {
                        let mut p = start.clone();
                        p[k] += if p[k] + 0.05 * q.scale > q.upper { -by } else { by };
                        fixture.columns(series, *effect, target, &p)
                    };
                    let (zero, small, large) = (moved(0.0), moved(1e-3 * q.scale), moved(2e-3 * q.scale));
                    let (mut size, mut error) = (0.0f64, 0.0f64);
                    for i in 0..series.len() {
                        for c in 0..zero.k {
                            let of = |x: &Columns| Vector6::from_column_slice(x.wrench(i, c));
                            let (a, b) = (of(&small) - of(&zero), (of(&large) - of(&zero)) * 0.5);
                            size += a.norm();
                            error += (a - b).norm();
                        }
                    }
                    assert!(
                        size > 0.0 && error <= 0.05 * size + 1e-12,
                        "{} {target:?} {}: {error:e} of {size:e}",
                        effect.id(),
                        q.name
                    );
                }
            }
        }
    });
}

/// Momentum of points of the links' masses at displaced positions, by a difference quotient,
/// compared with the columns of displacement fields to first order.
#[test]
fn displaced_links_change_the_momentum_as_their_columns_say() {
    let fixture = Fixture::new(true);
    let (scene, size) = (&fixture.scene, 1e-5);
    type Field = fn(&EffectFrame<'_>, usize, usize) -> Vector3<f64>;
    let warp: Field = |f, column, link| {
        let x = f.links[link].point(&f.scene.link_com_m[link]) - f.scene.volume_centre_m;
        if column == 0 { x * x.norm() } else { Vector3::ith(column - 1, x.norm_squared()) }
    };
    let skin: Field = |f, column, link| f.links[1].rotation.column(column) * if link == 1 { f.q[7] } else { 0.0 };
    fixture.with(|series| {
        for (key, field) in [("camera_warp", warp), ("soft_tissue[arm]", skin)] {
            let choice = EffectInstance::parse(key, scene).unwrap();
            let columns = fixture.columns(series, choice.effect, choice.target, &[]);
            for column in 0..columns.k {
                let momentum = |by: f64| -> [Vec<Vector3<f64>>; 3] {
                    let mut sums = [(); 3].map(|()| vec![Vector3::zeros(); series.len()]);
                    for link in 0..2 {
                        let m = scene.phi[link][0];
                        let places: Vec<Vector3<f64>> = (0..series.len())
                            .map(|i| {
                                let f = series.frame(i);
                                f.links[link].point(&scene.link_com_m[link]) + field(&f, column, link) * by
                            })
                            .collect();
                        let velocities = displacement::rate(&places, series.rate_hz);
                        for i in 0..series.len() {
                            sums[0][i] += velocities[i] * m;
                            sums[1][i] += places[i].cross(&velocities[i]) * m;
                            sums[2][i] += places[i].cross(&scene.model.gravity_mps2) * m;
                        }
                    }
                    sums
                };
                let (plain, moved) = (momentum(0.0), momentum(size));
                let change = |part: usize| -> Vec<Vector3<f64>> {
                    moved[part].iter().zip(&plain[part]).map(|(a, b)| (a - b) / size).collect()
                };
                let force = displacement::rate(&change(0), series.rate_hz);
                let moment = displacement::rate(&change(1), series.rate_hz);
                let weight = change(2);
                let (mut largest, mut error) = (0.0f64, 0.0f64);
                for i in 20..series.len() - 20 {
                    let about = moment[i] - weight[i];
                    largest = largest.max(force[i].norm() + about.norm());
                    error = error.max((columns.force(i, column) - force[i]).norm());
                    error = error.max((columns.moment(i, column) - about).norm());
                }
                assert!(error < 0.02 * largest && largest > 0.0, "{key} {column}: {error} of {largest}");
            }
        }
    });
}

/// Averages of every coordinate over a short window (and of the total centre of mass), compared
/// with the column.
#[test]
fn a_smoothed_motion_lacks_what_the_column_of_a_filter_says() {
    let fixture = Fixture::new(true);
    let (model, nq, half) = (&fixture.scene.model, fixture.motion.nq, 3isize);
    let n = (2 * half + 1) as f64;
    let mut state = State::new(model);
    let mut com = |q: &[f64]| {
        state.forward_position(model, q);
        state.centre_of_mass(&fixture.scene.phi).1
    };
    let mut seen = fixture.motion.clone();
    let frames = fixture.motion.n_frames() as isize;
    for f in half..frames - half {
        let near = || (f - half..=f + half).map(|g| fixture.motion.q(g as usize));
        let here = fixture.motion.q(f as usize);
        let turn = |q: &[f64]| UnitQuaternion::from_quaternion(Quaternion::new(q[6], q[3], q[4], q[5]));
        let mean = near().map(|q| (turn(q) * turn(here).inverse()).scaled_axis()).sum::<Vector3<f64>>() / n;
        let q = &mut seen.q[f as usize * nq..(f as usize + 1) * nq];
        q[3..7].copy_from_slice((UnitQuaternion::from_scaled_axis(mean) * turn(here)).coords.as_slice());
        q[7] = near().map(|q| q[7]).sum::<f64>() / n;
        let shift = near().map(&mut com).sum::<Vector3<f64>>() / n - com(q);
        for k in 0..3 {
            q[k] += shift[k];
        }
    }
    // a mean over n samples changes a signal by half the variance of their times, per unit of its
    // second derivative
    let lag_squared = 0.5 * (n * n - 1.0) / 12.0 / (200.0 * 200.0);
    fixture.with(|series| {
        let choice = EffectInstance::parse("filter_attenuation", &fixture.scene).unwrap();
        let columns = fixture.columns(series, choice.effect, choice.target, &[]);
        let spans = [Span { first_frame: 20, end_frame: 140, flight: true }];
        let trial = TrialMotion { motion: &seen, spans: &spans, plates: &[], session_time_s: 0.0 };
        let other = Series::new(&fixture.scene, &trial).unwrap();
        let (plain, smooth) =
            (inverse_dynamics(series, &fixture.scene.phi), inverse_dynamics(&other, &fixture.scene.phi));
        let (mut largest, mut error) = (0.0f64, 0.0f64);
        for i in 20..series.len() - 20 {
            let at = series.frame(i).com;
            let moment = |c: &Columns| c.moment(i, 0) - at.cross(&c.force(i, 0));
            let lacking = (moment(&smooth) - moment(&plain)) / lag_squared;
            largest = largest.max(lacking.norm());
            error = error.max((moment(&columns) - lacking).norm());
        }
        assert!(error < 0.1 * largest && largest > 0.0, "{error} of {largest}");
    });
}

/// A kilogram of the whole body, and a decaying load on the feet in flight.
#[test]
fn mass_and_edges_are_what_their_coefficients_say() {
    let fixture = Fixture::new(true);
    let mass = effect("body_mass").unwrap();
    let change = mass.inertia(&fixture.scene, Target::Body, &[]).unwrap();
    assert!((change[0].iter().map(|p| p[0]).sum::<f64>() - 1.0).abs() < 1e-12);
    fixture.with(|series| {
        let choice = EffectInstance::parse("residual_contact[arm]", &fixture.scene).unwrap();
        let columns = fixture.columns(series, choice.effect, choice.target, &[]);
        let last = series.len() - 1;
        for k in 0..3 {
            assert!((columns.force(0, k) - Vector3::ith(k, 1.0)).norm() < 1e-12);
            assert!((columns.force(4, k) - Vector3::ith(k, 0.5)).norm() < 1e-12);
            assert!(columns.force(9, k).norm() == 0.0 && columns.force(last, k).norm() == 0.0);
            assert!((columns.force(last, 3 + k) - Vector3::ith(k, 1.0)).norm() < 1e-12);
            let at = series.links(0)[1].point(&fixture.scene.link_com_m[1]);
            assert!((columns.moment(0, k) - at.cross(&Vector3::ith(k, 1.0))).norm() < 1e-12);
        }
    });
}
