//! Power and sign of columns, and comparison with independently written laws.

use super::Fixture;
use crate::*;
use aloft_body::State;
use aloft_simulate::physics::{Body, ForceField, Instant, Past, Wrench};
use aloft_simulate::{Hidden, Plate};
use nalgebra::{UnitQuaternion, Vector3, Vector6};

/// The power of a column on moving links does not follow from the total wrench, but that on a
/// single link does, so the arm is frozen.
#[test]
fn drag_takes_energy_and_wheels_do_no_work() {
    let mut fixture = Fixture::new(true);
    let nq = fixture.motion.nq;
    for f in 0..fixture.motion.n_frames() {
        fixture.motion.q[f * nq + 7] = 0.2;
    }
    fixture.with(|series| {
        for (id, sign) in
            [("quadratic_drag", -1.0), ("linear_drag", -1.0), ("rotational_drag", -1.0), ("flywheel[base]", 0.0)]
        {
            let choice = EffectInstance::parse(id, &fixture.scene).unwrap();
            let columns = fixture.columns(series, choice.effect, choice.target, &choice.nonlinear);
            for i in 0..series.len() {
                let body = series.links(i)[0];
                for k in 0..columns.k {
                    let (f, n) = (columns.force(i, k), columns.moment(i, k));
                    let power = f.dot(&body.velocity) + (n - body.origin.cross(&f)).dot(&body.omega);
                    assert!(f.norm() + n.norm() > 0.0, "{id} {i}: a column of zeros");
                    assert!(if sign == 0.0 { power.abs() < 1e-12 } else { power * sign > 0.0 }, "{id} {i} {power}");
                }
            }
        }
    });
}

#[test]
fn velocities_and_accelerations_follow_the_motion() {
    let fixture = Fixture::new(true);
    fixture.with(|series| {
        for i in (0..series.len()).step_by(17) {
            let frame = series.motion_frames()[i];
            let t = frame as f64 / 200.0;
            let link = &series.links(i)[0];
            assert!((link.velocity - Vector3::new(2.0, -1.5, 3.0 - 9.8 * t)).norm() < 1e-9);
            assert!((link.acceleration - Vector3::new(0.0, 0.0, -9.8)).norm() < 1e-6);
            // angular velocity from a small difference of the rotation itself
            let turn =
                |t: f64| UnitQuaternion::from_scaled_axis(Vector3::new(1.5 * t, 2.0 * (2.0 * t).sin(), 0.5 - 3.0 * t));
            let h = 1e-5;
            let omega = |t: f64| (turn(t + h) * turn(t - h).inverse()).scaled_axis() / (2.0 * h);
            assert!((link.omega - omega(t)).norm() < 2e-3 * omega(t).norm(), "{:?}", link.omega);
            let alpha = (omega(t + 1e-3) - omega(t - 1e-3)) / 2e-3;
            assert!((link.alpha - alpha).norm() < 0.05 * (1.0 + alpha.norm()), "{:?} {alpha:?}", link.alpha);
        }
    });
}

/// Comparison with the wrenches of the simulator's laws, which were written independently of these
/// columns.
#[test]
fn validate_columns_against_the_simulator_s_laws() {
    let fixture = Fixture::new(true);
    let scene = &fixture.scene;
    let body = Body { model: scene.model.clone(), phi: scene.phi.clone(), area_m2: scene.area_share.clone() };
    let s = |x: &str| x.to_owned();
    let cases: Vec<(Hidden, &str, Vec<f64>, Vec<f64>)> = vec![
        (Hidden::QuadraticDrag { drag_area_m2: 0.05, air_density_kgpm3: 1.2 }, "quadratic_drag", vec![0.05], vec![]),
        (Hidden::LinearDrag { coefficient_nspm: 0.3 }, "linear_drag", vec![0.3], vec![]),
        (Hidden::RotationalDrag { coefficient_nmsprad: 0.01 }, "rotational_drag", vec![0.01], vec![]),
        (
            Hidden::Wind { velocity_mps: [3.0, -1.0, 0.5], drag_area_m2: 0.05, air_density_kgpm3: 1.2 },
            "wind",
            vec![0.05],
            vec![3.0, -1.0, 0.5],
        ),
        (
            Hidden::Panels {
                plates: vec![
                    Plate { link: s("base"), point_m: Some([0.02, 0.1, 0.0]), normal: [0.0, 0.6, 0.8], area_m2: 0.03 },
                    Plate { link: s("arm"), point_m: Some([0.1, 0.0, 0.05]), normal: [1.0, 0.0, 0.0], area_m2: 0.02 },
                ],
                wind_mps: [1.0, -2.0, 0.3],
                air_density_kgpm3: 1.2,
                normal_coefficient: 1.5,
            },
            "panels[links]",
            vec![0.045, 0.0, 0.0, 0.03, 0.0, 0.0],
            // b of a normal (0, 0.6, 0.8) is 0.6 / 1.8
            vec![1.0, -2.0, 0.3, 0.02, 0.1, 0.0, 0.0, 1.0 / 3.0, 0.1, 0.0, 0.05, 1.0, 0.0],
        ),
        (
            Hidden::ConstantForce { link: s("arm"), point_m: [0.1, 0.0, 0.05], force_n: [1.0, -2.0, 0.5] },
            "constant_force[arm]",
            vec![1.0, -2.0, 0.5],
            vec![0.1, 0.0, 0.05],
        ),
        (
            Hidden::Tether {
                link: s("base"),
                point_m: [0.0, 0.1, 0.0],
                anchor_m: [0.0, 0.0, 3.0],
                rest_length_m: 0.5,
                stiffness_npm: 7.0,
                damping_nspm: 0.4,
            },
            "tether[base]",
            vec![7.0, 0.4],
            vec![0.0, 0.0, 3.0, 0.5, 0.0, 0.1, 0.0],
        ),
        (
            Hidden::Crane { link: s("arm"), point_m: [0.0, 0.1, 0.0], pulley_m: [1.0, 0.0, 4.0], tension_n: 3.0 },
            "crane[arm]",
            vec![3.0],
            vec![1.0, 0.0, 4.0, 0.0, 0.1, 0.0],
        ),
        (
            Hidden::Flywheel { link: s("arm"), momentum_nms: [0.1, 0.2, -0.3] },
            "flywheel[arm]",
            vec![0.1, 0.2, -0.3],
            vec![],
        ),
        (
            Hidden::Rotor { link: s("base"), axis: [0.0, 1.0, 0.0], mean_nms: 0.2, swing_nms: 0.1, frequency_hz: 3.0 },
            "rotor[base]",
            vec![0.0, 0.2, 0.0, 0.0, 0.1, 0.0, 0.0, 0.0, 0.0],
            vec![3.0],
        ),
        (
            Hidden::Thrust {
                link: s("arm"),
                point_m: scene.link_com_m[1].into(),
                force_n: [0.5, 0.2, -0.1],
                period_s: 0.0,
                on_s: 0.0,
            },
            "thrust[arm]",
            vec![0.5, 0.2, -0.1, 0.0, 0.0, 0.0],
            vec![],
        ),
    ];
    fixture.with(|series| {
        for (hidden, key, theta, p) in &cases {
            let field = ForceField::new(&body, &scene.model, &body.phi, std::slice::from_ref(hidden)).unwrap();
            let choice = EffectInstance::parse(key, scene).unwrap();
            let columns = fixture.columns(series, choice.effect, choice.target, p);
            let mut state = State::new(&scene.model);
            let mut wrenches = vec![Wrench::default(); 2];
            let (mut largest, mut error) = (0.0f64, 0.0f64);
            for i in 0..series.len() {
                let f = series.frame(i);
                state.forward_velocity(&scene.model, f.q, f.v);
                let now = Instant {
                    t: f.time_s,
                    since_start: 0.0,
                    model: &scene.model,
                    phi: &body.phi,
                    state: &state,
                    q: f.q,
                    v: f.v,
                };
                field.evaluate(&now, &Past::default(), &[], &mut wrenches, &mut []).unwrap();
                let total = ForceField::total(&wrenches);
                let mut ours = Vector6::zeros();
                for (k, x) in theta.iter().enumerate() {
                    ours += Vector6::from_column_slice(columns.wrench(i, k)) * *x;
                }
                let theirs = Vector6::from_iterator(total.force_n.iter().chain(total.moment_nm.iter()).copied());
                largest = largest.max(theirs.norm());
                error = error.max((ours - theirs).norm());
            }
            assert!(error < 1e-10 * largest && largest > 0.0, "{key}: {error:e} of {largest:e}");
        }
    });
}

#[test]
fn a_payload_is_the_wrench_of_its_mass() {
    let fixture = Fixture::new(true);
    let spans = [Span { first_frame: 20, end_frame: 140, flight: true }];
    let trial = TrialMotion { motion: &fixture.motion, spans: &spans, plates: &[], session_time_s: 0.0 };
    let choices = ["payload[arm]", "added_mass[arm]"].map(|k| EffectInstance::parse(k, &fixture.scene).unwrap());
    let all = columns(&fixture.scene, &trial, &choices).unwrap();
    assert_eq!(all.names, ["payload[arm].mass", "added_mass[arm].added_mass"]);
    assert!(all.wrench[0].iter().all(|x| x.is_nan()));
    fixture.with(|series| {
        let com = fixture.scene.link_com_m[1];
        for (i, &frame) in series.motion_frames().iter().enumerate().step_by(11) {
            let a = series.links(i)[1].point_acceleration(&com);
            let force = |c: usize| -> Vector3<f64> {
                let mut turned = Columns::zeros(series.len(), 1);
                inertia::add_wrench(series, all.inertia[c].as_ref().unwrap(), -1.0, 0, &mut turned);
                let own: Vector3<f64> = all.wrench[frame].fixed_view::<3, 1>(0, c).into();
                own + turned.matrix(i).fixed_view::<3, 1>(0, 0)
            };
            assert!((force(0) + (a - fixture.scene.model.gravity_mps2)).norm() < 1e-9);
            assert!((force(1) + a).norm() < 1e-9);
        }
    });
}

#[test]
fn a_stiff_wobbling_mass_follows_with_the_delay_of_its_spring() {
    let fixture = Fixture::new(true);
    fixture.with(|series| {
        let choice = EffectInstance::parse("wobbling_mass[arm]", &fixture.scene).unwrap();
        let (f, zeta) = (20.0, 0.7);
        let com = fixture.scene.link_com_m[1];
        let columns = fixture.columns(series, choice.effect, choice.target, &[f, zeta, com.x, com.y, com.z]);
        let w = std::f64::consts::TAU * f;
        let fall: Vec<Vector3<f64>> = (0..series.len())
            .map(|i| series.links(i)[1].point_acceleration(&com) - fixture.scene.model.gravity_mps2)
            .collect();
        let second = displacement::rate(&displacement::rate(&fall, 200.0), 200.0);
        let (mut size, mut error) = (0.0f64, 0.0f64);
        for i in 40..series.len() - 20 {
            let expected = second[i] / (w * w);
            size = size.max(expected.norm());
            error = error.max((columns.force(i, 0) - expected).norm());
        }
        assert!(error < 0.35 * size, "{error} of {size}");
    });
}

#[test]
fn plates_are_corrected_in_the_right_sense() {
    let fixture = Fixture::new(false);
    fixture.with(|series| {
        let one = |key: &str| {
            let c = EffectInstance::parse(key, &fixture.scene).unwrap();
            fixture.columns(series, c.effect, c.target, &[])
        };
        let (delay, drift, origin) =
            (one("plate_time_offset[plate1]"), one("plate_clock_drift"), one("plate_origin[plate2]"));
        let (turn, gain) = (one("plate_rotation[plate1]"), one("plate_gain"));
        let (tare, gains) = (one("plate_tare[plate2]"), one("plate_gain[plate2]"));
        let centre = fixture.scene.plate_centres_m[1];
        for i in (10..series.len() - 10).step_by(9) {
            let f = series.frame(i);
            let t = f.time_s;
            let rate = Vector3::new(t.cos(), 0.0, -6.0 * (3.0 * t).sin());
            assert!((delay.force(i, 0) - rate).norm() < 5e-3);
            let both = f.plates[0].force_rate + f.plates[1].force_rate;
            assert!((drift.force(i, 0) - both * (30.0 + t)).norm() < 1e-9);
            assert!((origin.moment(i, 0) - Vector3::x().cross(&f.plates[1].force_n)).norm() < 1e-12);
            assert!((turn.force(i, 1) - Vector3::y().cross(&f.plates[0].force_n)).norm() < 1e-12);
            assert!((tare.moment(i, 1) - centre.cross(&Vector3::y())).norm() < 1e-12 && tare.force(i, 5).norm() == 0.0);
            let sum: Vector6<f64> = (0..6).map(|k| Vector6::from_column_slice(gains.wrench(i, k))).sum();
            assert!((sum.fixed_rows::<3>(0) - f.plates[1].force_n).norm() < 1e-12);
            assert!((sum.fixed_rows::<3>(3) - f.plates[1].moment_nm).norm() < 1e-12);
            assert!((gain.moment(i, 0) - (f.plates[0].moment_nm + f.plates[1].moment_nm)).norm() < 1e-12);
        }
    });
}

/// Round links of any size are the special case of equal areas; entrained fluid does no work.
#[test]
fn the_drag_of_a_shape_contains_that_of_round_links() {
    let fixture = Fixture::new(true);
    fixture.with(|series| {
        let of = |key: &str| {
            let c = EffectInstance::parse(key, &fixture.scene).unwrap();
            let names = c.names(&fixture.scene);
            (fixture.columns(series, c.effect, c.target, &c.nonlinear), names)
        };
        let (shape, names) = of("quadratic_drag[shape]");
        let (links, _) = of("quadratic_drag[links]");
        let at = |name: &str| names.iter().position(|n| n == &format!("quadratic_drag[shape].{name}")).unwrap();
        for i in (0..series.len()).step_by(11) {
            for (l, link) in ["base", "arm"].iter().enumerate() {
                let sum: Vector6<f64> = ["xx", "yy", "zz"]
                    .iter()
                    .map(|e| Vector6::from_column_slice(shape.wrench(i, at(&format!("area_{link}_{e}")))))
                    .sum();
                let round = Vector6::from_column_slice(links.wrench(i, l));
                assert!((sum - round).norm() < 1e-12 * round.norm());
                let body = series.links(i)[l];
                let power = |column: usize| {
                    let (f, n) = (shape.force(i, column), shape.moment(i, column));
                    f.dot(&body.velocity) + (n - body.origin.cross(&f)).dot(&body.omega)
                };
                for e in ["xx", "yy", "zz"] {
                    for what in ["area", "turning"] {
                        assert!(power(at(&format!("{what}_{link}_{e}"))) < 0.0, "{what} {link} {e}");
                    }
                }
                for e in ["xx", "yy", "xy", "xz", "yz", "zz"] {
                    let column = at(&format!("carried_{link}_{e}"));
                    assert!(shape.force(i, column).norm() > 0.0 && power(column).abs() < 1e-9, "{link} {e}");
                }
            }
        }
    });
}
