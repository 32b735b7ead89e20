//! Tests over the whole catalogue: documentation, bounds, power and sign, finite differences, laws of another author.

use crate::*;
use aloft_body::{JointSpec, LinkInertia, LinkSpec, Model, ModelSpec, Motion, Phi, State};
use aloft_simulate::Hidden;
use aloft_simulate::physics::{Body, ForceField, Wrench};
use nalgebra::{Matrix3, UnitQuaternion, Vector3, Vector6};

fn model(offset: [f64; 3]) -> Model {
    let links = vec![
        LinkSpec {
            name: "base".into(),
            parent: None,
            joint: JointSpec::Free,
            position_m: [0.0; 3],
            rpy_rad: [0.0; 3],
            inertia: None,
        },
        LinkSpec {
            name: "arm".into(),
            parent: Some("base".into()),
            joint: JointSpec::RevoluteZ,
            position_m: offset,
            rpy_rad: [0.3, -0.2, 0.1],
            inertia: None,
        },
    ];
    Model::from_spec(&ModelSpec { name: "two".into(), links }).unwrap()
}

fn phi() -> Vec<Phi> {
    let link = |mass_kg: f64, com: [f64; 3], i: [f64; 3]| {
        LinkInertia { mass_kg, com_m: com.into(), inertia_com_kgm2: Matrix3::from_diagonal(&Vector3::from(i)) }.to_phi()
    };
    vec![link(0.7, [0.01, 0.09, 0.02], [3e-3, 1e-3, 3.5e-3]), link(0.4, [-0.1, 0.0, 0.01], [5e-4, 2e-3, 2.2e-3])]
}

/// Smooth motion in the air with its coordinates as functions of time.
fn motion(model: &Model) -> Motion {
    let rate_hz = 200.0;
    let mut q = Vec::new();
    for f in 0..160 {
        let t = f as f64 / rate_hz;
        q.extend([1.0 + 2.0 * t, 0.3 - 1.5 * t, 1.0 + 3.0 * t - 4.9 * t * t]);
        let turn = UnitQuaternion::from_scaled_axis(Vector3::new(1.5 * t, 2.0 * (2.0 * t).sin(), 0.5 - 3.0 * t));
        q.extend(turn.coords.iter());
        q.push(0.4 * (5.0 * t).sin());
    }
    Motion { trial: "smooth".into(), rate_hz, nq: model.nq, nv: model.nv, q, ..Motion::default() }
}

struct Fixture {
    scene: Scene,
    motion: Motion,
    plates: Vec<PlateSeries>,
    flight: bool,
}

impl Fixture {
    fn new(flight: bool) -> Self {
        let model = model([0.02, 0.18, -0.01]);
        let motion = motion(&model);
        let scene = Scene::new(&model, &phi(), &[Vector3::new(0.2, 0.1, 0.0), Vector3::new(0.8, 0.1, 0.0)])
            .with_volume(&[Vector3::new(1.0, 0.0, 1.0), Vector3::new(2.0, -0.5, 1.4)]);
        let plates = (0..2)
            .map(|p| {
                let at = |f: usize| f as f64 / 200.0 + p as f64;
                let n = motion.n_frames();
                PlateSeries {
                    force_n: (0..n).map(|f| Vector3::new(at(f).sin(), 0.3, 5.0 + 2.0 * (3.0 * at(f)).cos())).collect(),
                    moment_nm: (0..n).map(|f| Vector3::new(0.1, at(f).cos(), 0.2 * at(f))).collect(),
                }
            })
            .collect();
        Self { scene, motion, plates, flight }
    }
    fn with<T>(&self, f: impl FnOnce(&Series<'_>) -> T) -> T {
        let spans = [Span { first_frame: 20, end_frame: 140, flight: self.flight }];
        let plates = if self.flight { &[][..] } else { &self.plates[..] };
        let trial = TrialMotion { motion: &self.motion, spans: &spans, plates, session_time_s: 30.0 };
        let series = Series::new(&self.scene, &trial).unwrap();
        f(&series)
    }
    fn columns(&self, series: &Series<'_>, effect: &dyn Effect, target: Target, p: &[f64]) -> Columns {
        let k = effect.coefficients(&self.scene, target).len();
        let mut out = Columns::zeros(series.len(), k);
        effect.evaluate(series, target, p, &mut out);
        out
    }
}

#[test]
fn prop_every_effect_is_described_and_bounded() {
    let fixture = Fixture::new(true);
    let mut seen = Vec::new();
    for definition in EFFECTS.iter().copied() {
        assert!(!seen.contains(&definition.id), "{} twice", definition.id);
        seen.push(definition.id);
        for heading in ["## Physics", "## Equation", "## Identifiability", "## References"] {
            assert!(definition.documentation.contains(heading), "{}: {heading}", definition.id);
        }
        for other in definition.contains {
            assert!(effect(other).is_ok(), "{} contains `{other}`", definition.id);
        }
        let targets = (definition.targets)(&fixture.scene);
        assert!(!targets.is_empty(), "{}", definition.id);
        assert!(definition.wrench.is_some() || definition.inertia.is_some());
        for target in targets {
            let coefficients = (definition.coefficients)(&fixture.scene, target);
            assert!(!coefficients.is_empty());
            for c in &coefficients {
                assert!(c.lower < c.upper, "{} {}", definition.id, c.name);
                assert!(formula_unit_is_readable(&c.unit), "{} {}", definition.id, c.unit);
            }
            let parameters = (definition.nonlinear)(&fixture.scene, target);
            let starts = (definition.starts)(&fixture.scene, target);
            assert!(!starts.is_empty());
            for start in starts {
                assert_eq!(start.len(), parameters.len(), "{}", definition.id);
                for (x, p) in start.iter().zip(&parameters) {
                    assert!((p.lower..=p.upper).contains(x), "{} {} {x}", definition.id, p.name);
                }
            }
            let key = Choice::new(definition, target, &fixture.scene).key(&fixture.scene);
            assert_eq!(Choice::parse(&key, &fixture.scene).unwrap().target, target, "{key}");
        }
    }
    assert_eq!(seen.len(), 27);
    assert!(matches!(effect("draught"), Err(EffectsError::Unknown { .. })));
}

fn formula_unit_is_readable(unit: &str) -> bool {
    formula::unit_is_readable(unit)
}

#[test]
fn prop_columns_are_finite_for_every_effect_target_and_start() {
    for flight in [true, false] {
        let fixture = Fixture::new(flight);
        fixture.with(|series| {
            for effect in EFFECTS {
                for target in (effect.targets)(&fixture.scene) {
                    for p in (effect.starts)(&fixture.scene, target) {
                        let columns = fixture.columns(series, *effect, target, &p);
                        let acts = if flight { effect.acts.in_flight() } else { effect.acts.in_contact() };
                        let mut size = 0.0;
                        for i in 0..series.len() {
                            for k in 0..columns.k {
                                let sum: f64 = columns.wrench(i, k).iter().map(|x| x.abs()).sum();
                                assert!(sum.is_finite(), "{} {target:?} {p:?}", effect.id);
                                size += sum;
                            }
                        }
                        assert!(acts || size == 0.0, "{} acts where it should not", effect.id);
                    }
                }
            }
        });
    }
}

/// Power of a column on the moving links cannot be told from the total wrench, but that of one link can: freeze the arm.
#[test]
fn prop_drag_takes_energy_and_wheels_do_no_work() {
    let mut fixture = Fixture::new(true);
    let nq = fixture.motion.nq;
    for f in 0..fixture.motion.n_frames() {
        fixture.motion.q[f * nq + 7] = 0.2;
    }
    fixture.with(|series| {
        for (id, sign) in
            [("quadratic_drag", -1.0), ("linear_drag", -1.0), ("rotational_drag", -1.0), ("flywheel[base]", 0.0)]
        {
            let choice = Choice::parse(id, &fixture.scene).unwrap();
            let columns = fixture.columns(series, choice.effect, choice.target, &choice.nonlinear);
            for i in 0..series.len() {
                let body = series.links(i)[0];
                for k in 0..columns.k {
                    let (f, n) = (columns.force(i, k), columns.moment(i, k));
                    let power = f.dot(&body.velocity) + (n - body.origin.cross(&f)).dot(&body.omega);
                    assert!(if sign == 0.0 { power.abs() < 1e-12 } else { power * sign > 0.0 }, "{id} {i} {power}");
                }
            }
        }
    });
}

#[test]
fn prop_velocities_and_accelerations_follow_the_motion() {
    let fixture = Fixture::new(true);
    fixture.with(|series| {
        for i in (0..series.len()).step_by(17) {
            let frame = series.motion_frames()[i];
            let t = frame as f64 / 200.0;
            let link = &series.links(i)[0];
            assert!((link.velocity - Vector3::new(2.0, -1.5, 3.0 - 9.8 * t)).norm() < 1e-9);
            assert!((link.acceleration - Vector3::new(0.0, 0.0, -9.8)).norm() < 1e-6);
            // angular velocity by a fine difference of the rotation itself
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

/// Wrenches of the simulator's laws, which were written without these columns.
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
            let field = ForceField::new(&body, &scene.model, std::slice::from_ref(hidden)).unwrap();
            let choice = Choice::parse(key, scene).unwrap();
            let columns = fixture.columns(series, choice.effect, choice.target, p);
            let mut state = State::new(&scene.model);
            let mut wrenches = vec![Wrench::default(); 2];
            let (mut largest, mut error) = (0.0f64, 0.0f64);
            for i in 0..series.len() {
                let f = series.frame(i);
                state.forward_velocity(&scene.model, f.q, f.v);
                field.evaluate(f.time_s, &scene.model, &state, &[], &mut wrenches, &mut []);
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

/// What the body needs to follow a motion: `Y φ` about the world origin.
fn inverse_dynamics(series: &Series<'_>, phi: &[Phi]) -> Columns {
    let mut out = Columns::zeros(series.len(), 1);
    inertia::add_wrench(series, phi, 1.0, 0, &mut out);
    out
}

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
fn prop_a_displaced_joint_changes_the_wrench_as_its_columns_say() {
    let fixture = Fixture::new(true);
    let step = 1e-4;
    fixture.with(|series| {
        let choice = Choice::parse("joint_centre[arm]", &fixture.scene).unwrap();
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

#[test]
fn prop_a_payload_is_the_wrench_of_its_mass() {
    let fixture = Fixture::new(true);
    let spans = [Span { first_frame: 20, end_frame: 140, flight: true }];
    let trial = TrialMotion { motion: &fixture.motion, spans: &spans, plates: &[], session_time_s: 0.0 };
    let choices = ["payload[arm]", "added_mass[arm]"].map(|k| Choice::parse(k, &fixture.scene).unwrap());
    let all = columns(&fixture.scene, &trial, &choices).unwrap();
    assert_eq!(all.names, ["payload[arm].mass", "added_mass[arm].added_mass"]);
    assert!(all.wrench[0].iter().all(|x| x.is_nan()));
    fixture.with(|series| {
        let com = fixture.scene.link_com_m[1];
        for (i, &frame) in series.motion_frames().iter().enumerate().step_by(11) {
            let a = series.links(i)[1].point_acceleration(&com);
            let force = |c: usize| -> Vector3<f64> { all.wrench[frame].fixed_view::<3, 1>(0, c).into() };
            assert!((force(0) + (a - fixture.scene.model.gravity_mps2)).norm() < 1e-9);
            assert!((force(1) + a).norm() < 1e-9);
        }
    });
}

#[test]
fn prop_a_stiff_wobbling_mass_follows_with_the_delay_of_its_spring() {
    let fixture = Fixture::new(true);
    fixture.with(|series| {
        let choice = Choice::parse("wobbling_mass[arm]", &fixture.scene).unwrap();
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
fn prop_plates_are_corrected_in_the_right_sense() {
    let fixture = Fixture::new(false);
    fixture.with(|series| {
        let one = |key: &str| {
            let c = Choice::parse(key, &fixture.scene).unwrap();
            fixture.columns(series, c.effect, c.target, &[])
        };
        let (delay, drift, origin) =
            (one("plate_time_offset[plate1]"), one("plate_clock_drift"), one("plate_origin[plate2]"));
        let (turn, gain) = (one("plate_rotation[plate1]"), one("plate_gain"));
        for i in (10..series.len() - 10).step_by(9) {
            let f = series.frame(i);
            let t = f.time_s;
            let rate = Vector3::new(t.cos(), 0.0, -6.0 * (3.0 * t).sin());
            assert!((delay.force(i, 0) - rate).norm() < 5e-3);
            let both = f.plates[0].force_rate + f.plates[1].force_rate;
            assert!((drift.force(i, 0) - both * (30.0 + t)).norm() < 1e-9);
            assert!((origin.moment(i, 0) - Vector3::x().cross(&f.plates[1].force_n)).norm() < 1e-12);
            assert!((turn.force(i, 1) - Vector3::y().cross(&f.plates[0].force_n)).norm() < 1e-12);
            assert!((gain.moment(i, 0) - (f.plates[0].moment_nm + f.plates[1].moment_nm)).norm() < 1e-12);
        }
    });
}

/// Round links of any size are the special case of equal areas; carried fluid does no work.
#[test]
fn prop_the_drag_of_a_shape_contains_that_of_round_links() {
    let fixture = Fixture::new(true);
    fixture.with(|series| {
        let of = |key: &str| {
            let c = Choice::parse(key, &fixture.scene).unwrap();
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
                        assert!(power(at(&format!("{what}_{link}_{e}"))) <= 0.0, "{what} {link} {e}");
                    }
                }
                for e in ["xx", "yy", "xy", "xz", "yz", "zz"] {
                    assert!(power(at(&format!("carried_{link}_{e}"))).abs() < 1e-9, "{link} {e}");
                }
            }
        }
    });
}

/// Columns follow the nonlinear parameters smoothly: one-sided differences of two sizes agree, for every effect, target and parameter.
#[test]
fn prop_columns_change_with_their_parameters_as_differences_say() {
    let fixture = Fixture::new(true);
    fixture.with(|series| {
        for effect in EFFECTS.iter().filter(|e| e.wrench.is_some()) {
            for target in (effect.targets)(&fixture.scene) {
                let parameters = (effect.nonlinear)(&fixture.scene, target);
                let Some(start) =
                    (effect.starts)(&fixture.scene, target).into_iter().nth(if effect.id == "wind" { 1 } else { 0 })
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
                    assert!(error <= 0.05 * size + 1e-12, "{} {target:?} {}: {error:e} of {size:e}", effect.id, q.name);
                }
            }
        }
    });
}

fn sail() -> FormulaEffect {
    serde_json::from_str(
        r#"{"id": "sail", "point": {"link": "base", "position_m": [0.1, 0.2, 0.0]},
            "force": ["-c * speed * v_x", "-c*speed*v_y", "-c * speed * v_z"],
            "coefficients": [{"name": "c", "unit": "kg/m", "lower": 0}]}"#,
    )
    .unwrap()
}

#[test]
fn prop_a_formula_gives_the_columns_of_its_law() {
    let fixture = Fixture::new(true);
    let compiled = sail().compile(&fixture.scene).unwrap();
    fixture.with(|series| {
        let columns = fixture.columns(series, &compiled, Target::Body, &[]);
        for i in (0..series.len()).step_by(7) {
            let link = &series.links(i)[0];
            let p = Vector3::new(0.1, 0.2, 0.0);
            let v = link.point_velocity(&p);
            let force = -v * v.norm();
            assert!((columns.force(i, 0) - force).norm() < 1e-12 * force.norm());
            assert!((columns.moment(i, 0) - link.point(&p).cross(&force)).norm() < 1e-9);
        }
    });
}

#[test]
fn prop_formula_errors_point_at_the_character() {
    let fixture = Fixture::new(true);
    let cases = [
        ("-c * speed * v_w", 13, "nothing is called `v_w`"),
        ("-c * speed", 3, "the unit is"),
        ("-c * speed * (v_x + t)", 18, "units differ"),
        ("-c * speed * v_x +", 18, "something is missing"),
        ("-c * (speed * v_x", 5, "never closed"),
        ("-c * speed * v_x)", 16, "closes nothing"),
        ("-c * sin(speed) * v_x", 9, "takes a number without unit"),
        ("-abs(c) * speed * v_x", 5, "not linear"),
        ("-c * speed * v_x - mass * gravity", 1, "no coefficient"),
        ("-c * speed & v_x", 11, "has no meaning"),
        ("-c * speed * v_x ^ t", 19, "an exponent has no unit"),
        ("-c * speed v_x", 11, "an operator is missing"),
        ("-c * root(speed) * v_x", 5, "no function `root`"),
    ];
    for (text, place, words) in cases {
        let mut effect = sail();
        effect.force = Some([text.into(), "0".into(), "-c*speed*v_z".into()]);
        match effect.compile(&fixture.scene) {
            Err(EffectsError::Formula(found)) => {
                assert!(found.problem.contains(words), "{text}: {}", found.problem);
                assert_eq!((found.position, found.entry.as_str()), (place, "force[0]"), "{text}: {}", found.problem);
                let shown = found.to_string();
                assert_eq!(shown.lines().last().and_then(|l| l.find('^')), Some(place + 2), "{shown}");
            }
            other => panic!("{text}: {other:?}"),
        }
    }
}

#[test]
fn prop_formulas_read_as_people_write() {
    let fixture = Fixture::new(true);
    // a minus before a power, powers of powers, link axes, joint angles, a bounded parameter
    let effect: FormulaEffect = serde_json::from_str(
        r#"{"id": "odd", "axes": "link", "point": {"link": "arm"},
            "force": ["-c * v_x^2", "0", "c * speed^2 * sin(q_arm + phase)"], "moment": ["k*omega_x*2^-1", "k * omega_y", "0*k*spin"],
            "coefficients": [{"name": "c", "unit": "kg/m"}, {"name": "k", "unit": "N*m*s/rad"}],
            "parameters": [{"name": "phase", "unit": "rad", "lower": -1, "upper": 1}]}"#,
    )
    .unwrap();
    let compiled = effect.compile(&fixture.scene).unwrap();
    assert_eq!(compiled.starts(&fixture.scene, Target::Body).len(), 5);
    fixture.with(|series| {
        let columns = fixture.columns(series, &compiled, Target::Body, &[0.3]);
        for i in (0..series.len()).step_by(7) {
            let f = series.frame(i);
            let link = &f.links[1];
            let v = link.point_velocity(&fixture.scene.link_com_m[1]);
            let own = link.rotation.tr_mul(&v);
            let force = Vector3::new(-own.x * own.x, 0.0, v.norm_squared() * (f.q[7] + 0.3).sin());
            assert!((columns.force(i, 0) - link.rotation * force).norm() < 1e-9);
            let spin = link.rotation.tr_mul(&link.omega);
            let about = columns.moment(i, 1);
            assert!((about - link.rotation * Vector3::new(0.5 * spin.x, spin.y, 0.0)).norm() < 1e-9);
        }
    });
}

#[test]
fn prop_the_example_configuration_compiles() {
    let folder = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../../configs/effects");
    let mut model = model([0.0, 0.2, 0.0]);
    (model.links[0].name, model.links[1].name) = ("link0".into(), "link1".into());
    let scene = Scene::new(&model, &phi(), &[]);
    let mut count = 0;
    for entry in std::fs::read_dir(folder).unwrap() {
        let text = std::fs::read_to_string(entry.unwrap().path()).unwrap();
        let effect: FormulaEffect = serde_yaml::from_str(&text).unwrap();
        effect.compile(&scene).unwrap();
        count += 1;
    }
    assert!(count > 3);
}

#[test]
fn prop_drag_written_as_a_formula_has_the_columns_of_the_catalogue() {
    let mut fixture = Fixture::new(true);
    for (link, name) in fixture.scene.model.links.iter_mut().zip(["link0", "link1"]) {
        link.name = name.into();
    }
    let folder = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../../configs/effects");
    let read = |name: &str| -> FormulaEffect {
        serde_yaml::from_str(&std::fs::read_to_string(folder.join(name)).unwrap()).unwrap()
    };
    let (body, links) = (read("air_drag.yaml"), read("my_drag.yaml"));
    let (body, links) = (body.compile(&fixture.scene).unwrap(), links.compile(&fixture.scene).unwrap());
    let drag = effect("quadratic_drag").unwrap();
    let centres = (drag.starts)(&fixture.scene, Target::EveryLink).remove(0);
    fixture.with(|series| {
        let pairs = [
            (fixture.columns(series, &body, Target::Body, &[]), fixture.columns(series, drag, Target::Body, &[])),
            (
                fixture.columns(series, &links, Target::Body, &[]),
                fixture.columns(series, drag, Target::EveryLink, &centres),
            ),
        ];
        for (own, built_in) in &pairs {
            for i in 0..series.len() {
                let (a, b) = (own.matrix(i), built_in.matrix(i));
                assert!((&a - &b).norm() < 1e-12 * b.norm(), "{a} {b}");
            }
        }
    });
}

#[test]
fn prop_what_is_wrong_outside_of_formulas_is_told_with_its_place() {
    let fixture = Fixture::new(true);
    type Change = fn(&mut FormulaEffect);
    let cases: [(Change, &str, &str); 8] = [
        (|e| e.id = "tether".into(), "id", "catalogue"),
        (
            |e| e.point.as_mut().unwrap().link = "bse".into(),
            "point.link",
            "there is no link `bse`; there are `base`, `arm`",
        ),
        (|e| e.coefficients[0].unit = "lbf".into(), "coefficients[0].unit", "`lbf` is no SI unit"),
        (|e| e.coefficients[0].upper = Some(-1.0), "coefficients[0].lower", "bounds 0 to -1"),
        (
            |e| {
                e.coefficients.push(FormulaCoefficient { name: "d".into(), unit: "1".into(), lower: None, upper: None })
            },
            "coefficients[1].name",
            "stands in no formula",
        ),
        (|e| e.coefficients[0].name = "speed".into(), "coefficients[0].name", "it is a quantity"),
        (|e| e.point = None, "id", "neither a `point`"),
        (
            |e| e.constants.push(FormulaConstant { name: "c".into(), unit: "1".into(), value: 2.0 }),
            "constants[0].name",
            "two things",
        ),
    ];
    for (change, at, words) in cases {
        let mut effect = sail();
        change(&mut effect);
        match effect.compile(&fixture.scene) {
            Err(EffectsError::Place { place, problem, .. }) => {
                assert_eq!(place, at, "{problem}");
                assert!(problem.contains(words), "{problem}");
            }
            other => panic!("{at}: {other:?}"),
        }
    }
}
