//! Whole laboratories: contents of the files, conservation laws, independence of chance and
//! threads.
#![allow(clippy::expect_used, clippy::panic, reason = "helpers of tests stand outside of #[test] functions")]

use aloft_body::{LinkInertia, State, inertia::pseudo_inertia};
use aloft_simulate::{BodySpec, Hidden, Lab, Scenario, SimulateError, simulate};
use nalgebra::Vector3;
use std::path::PathBuf;

fn root() -> PathBuf {
    PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../..")
}

fn load(path: &str) -> Scenario {
    let text = std::fs::read_to_string(root().join(path)).expect("scenario file");
    serde_yaml::from_str(&text).expect("scenario")
}

/// One short jump trial and a short exercise.
fn small_human() -> Scenario {
    let mut scenario = load("fixtures/scenarios/human_small.yaml");
    if let BodySpec::Human(lab) = &mut scenario.body {
        lab.protocol.jumps = 1;
        lab.protocol.flights = [1, 1];
        lab.protocol.exercise_s = 2.0;
        lab.protocol.static_s = 0.5;
    }
    scenario
}

fn small_chain() -> Scenario {
    let mut scenario = load("fixtures/scenarios/chain_small.yaml");
    if let BodySpec::Chain(lab) = &mut scenario.body {
        lab.throws.recordings = 1;
        lab.throws.throws = 2;
        lab.throws.calibration_s = 1.0;
    }
    scenario
}

fn size(lab: &Lab) -> usize {
    lab.files.iter().filter(|f| !f.path.starts_with("truth/")).map(|f| f.bytes.len()).sum()
}

#[test]
fn scenarios_of_the_repository_are_understood() {
    let mut count = 0;
    for folder in ["configs/scenarios", "fixtures/scenarios"] {
        for entry in std::fs::read_dir(root().join(folder)).expect("folder") {
            let path = entry.expect("entry").path();
            if path.extension().is_some_and(|e| e == "yaml") {
                let scenario: Scenario =
                    serde_yaml::from_str(&std::fs::read_to_string(&path).expect("text")).expect("scenario");
                assert_eq!(Some(scenario.name.as_str()), path.file_stem().and_then(|s| s.to_str()));
                count += 1;
            }
        }
    }
    assert!(count >= 10);
}

#[test]
fn regress_fixture_labs_stay_small() {
    for (path, limit) in
        [("fixtures/scenarios/chain_small.yaml", 1_500_000), ("fixtures/scenarios/human_small.yaml", 4_000_000)]
    {
        let lab = simulate(&load(path)).expect("lab");
        assert!(size(&lab) < limit, "{path}: {} bytes", size(&lab));
        let names: Vec<&str> = lab.files.iter().map(|f| f.path.as_str()).collect();
        assert!(names.contains(&"static.c3d") && names.contains(&"truth/truth.json"), "{names:?}");
    }
}

#[test]
fn same_scenario_same_bytes() {
    for scenario in [small_chain(), small_human()] {
        let pool = |n: usize| rayon::ThreadPoolBuilder::new().num_threads(n).build().expect("pool");
        let one = pool(1).install(|| simulate(&scenario)).expect("lab");
        let two = pool(3).install(|| simulate(&scenario)).expect("lab");
        assert!(one.files == two.files);
        let other = simulate(&Scenario { seed: scenario.seed + 1, ..scenario.clone() }).expect("lab");
        assert!(one.files != other.files);
    }
}

#[test]
fn flights_are_free_and_their_centre_of_mass_falls() {
    for scenario in [small_chain(), small_human()] {
        let lab = simulate(&scenario).expect("lab");
        let model = &lab.body.model;
        let mut state = State::new(model);
        for trial in &lab.trials {
            let m = &trial.motion;
            for [first, last] in &m.flights {
                let ticks: Vec<usize> = (*first..=*last).collect();
                let mut com = |k: usize| {
                    state.forward_position(model, m.q(k));
                    state.centre_of_mass(&lab.body.phi).1
                };
                let (start, middle, end) = (com(ticks[0]), com(ticks[ticks.len() / 2]), com(*last));
                let time = |k: usize| (k - first) as f64 * m.tick_s;
                let (t1, t2) = (time(ticks[ticks.len() / 2]), time(*last));
                // a parabola through both ends passes through the middle
                let g = model.gravity_mps2;
                let v = (end - start) / t2 - g * (0.5 * t2);
                let off = (start + v * t1 + g * (0.5 * t1 * t1) - middle).norm();
                println!("{}: centre of mass off its parabola by {off:.1e} m", trial.name);
                assert!(off < 1e-7);
                for k in ticks {
                    assert!(m.contact[k].force_n.norm() < 1e-9 && m.contact[k].moment_nm.norm() < 1e-9);
                }
            }
        }
        assert!(lab.trials.iter().map(|t| t.motion.flights.len()).sum::<usize>() >= 1);
    }
}

/// Velocities and accelerations are the derivatives of the coordinates, across contacts and
/// flights.
#[test]
fn motion_is_consistent_in_time() {
    for scenario in [small_chain(), small_human()] {
        let lab = simulate(&scenario).expect("lab");
        let model = &lab.body.model;
        for trial in &lab.trials {
            let m = &trial.motion;
            let mut dv = vec![0.0; model.nv];
            let edge = |k: usize| m.flights.iter().flatten().any(|e| e.abs_diff(k) < 3);
            for k in (2..m.n_ticks() - 2).filter(|k| !edge(*k)).step_by(7) {
                model.difference(m.q(k - 1), m.q(k + 1), &mut dv);
                for i in 0..model.nv {
                    let rate = dv[i] / (2.0 * m.tick_s);
                    let scale = 1.0 + m.a(k)[i].abs();
                    assert!(
                        (rate - m.v(k)[i]).abs() < 2e-3 * scale,
                        "{} tick {k} v[{i}]: {rate} {}",
                        trial.name,
                        m.v(k)[i]
                    );
                    let accel = (m.v(k + 1)[i] - m.v(k - 1)[i]) / (2.0 * m.tick_s);
                    assert!(
                        (accel - m.a(k)[i]).abs() < 0.04 * scale + 0.6,
                        "{} tick {k} a[{i}]: {accel} {}",
                        trial.name,
                        m.a(k)[i]
                    );
                }
            }
        }
    }
}

#[test]
fn plates_carry_what_the_body_needs() {
    let mut scenario = small_human();
    scenario.capture.plate_noise_n = 0.0;
    scenario.capture.plate_drift_n = 0.0;
    let lab = simulate(&scenario).expect("lab");
    for trial in &lab.trials {
        let recorded = trial.to_trial();
        let per = lab.ticks_per_frame / scenario.capture.analog_per_frame;
        for k in 0..recorded.plates[0].force_n.len() {
            let need = &trial.motion.contact[k * per];
            let force: Vector3<f64> = recorded.plates.iter().map(|p| p.force_n[k]).sum();
            let moment: Vector3<f64> = recorded.plates.iter().map(|p| p.moment_nm[k]).sum();
            assert!((force - need.force_n).norm() < 1e-8 && (moment - need.moment_nm).norm() < 1e-8);
        }
    }
    let still = lab.trial("static").expect("static");
    let load = still.to_trial().plates.iter().map(|p| p.force_n[100].z).sum::<f64>();
    assert!((load - 61.5 * 9.81).abs() < 5.0, "{load}");
}

#[test]
fn files_read_back() {
    for scenario in [small_chain(), small_human()] {
        let lab = simulate(&scenario).expect("lab");
        for trial in &lab.trials {
            let path = format!("{}.c3d", trial.name);
            let bytes = &lab.files.iter().find(|f| f.path == path).expect("file").bytes;
            let file = aloft_c3d::C3dFile::from_bytes(bytes).expect("C3D");
            assert!(file.warnings.is_empty(), "{:?}", file.warnings);
            assert_eq!(file.n_frames, trial.markers.n_frames);
            for (point, (label, trajectory)) in
                file.points.iter().zip(trial.markers.labels.iter().zip(&trial.markers.trajectories))
            {
                assert_eq!(&point.label, label);
                for (got, want) in point.xyz.iter().zip(trajectory) {
                    assert_eq!(got[0].is_nan(), want.x.is_nan());
                    for i in 0..3 {
                        assert!(want.x.is_nan() || (f64::from(got[i]) - 1000.0 * want[i]).abs() < 1e-3);
                    }
                }
            }
            let recorded = trial.to_trial();
            for (plate, want) in recorded.plates.iter().enumerate() {
                let got = file.plate_wrench(plate).expect("plate");
                for (k, force) in got.force_n.iter().enumerate() {
                    assert!((Vector3::from(*force) - want.force_n[k]).norm() < 1e-3);
                    assert!((Vector3::from(got.moment_nm[k]) - want.moment_nm[k]).norm() < 1e-2);
                }
            }
            assert_eq!(file.events.len(), trial.events.len());
        }
    }
}

#[test]
fn bodies_can_exist() {
    for (height_m, mass_kg, sex, seed) in [
        (1.50, 48.0, aloft_body::Sex::Female, 1),
        (1.95, 101.0, aloft_body::Sex::Male, 2),
        (1.7, 70.0, aloft_body::Sex::Male, 3),
    ] {
        let mut scenario = small_human();
        scenario.seed = seed;
        if let BodySpec::Human(lab) = &mut scenario.body {
            (lab.person.height_m, lab.person.mass_kg, lab.person.sex) = (height_m, mass_kg, sex);
        }
        let lab = simulate(&scenario).expect("lab");
        let total: f64 = lab.body.phi.iter().map(|p| p[0]).sum();
        assert!((total - mass_kg).abs() < 1e-9);
        for phi in &lab.body.phi {
            assert!(pseudo_inertia(phi).symmetric_eigenvalues().min() > 0.0);
            let inertia = LinkInertia::from_phi(phi).inertia_com_kgm2.symmetric_eigenvalues();
            assert!(inertia.max() < inertia.sum() - inertia.max());
        }
    }
}

/// A scenario and its twin have the same choreography, noise and gaps; they differ only in the
/// hidden effects.
#[test]
fn twins_differ_in_what_is_hidden_alone() {
    let mut scenario = small_chain();
    scenario.hidden = vec![Hidden::BodyMass { error_kg: 0.01 }];
    let (lab, twin) = (simulate(&scenario).expect("lab"), simulate(&scenario.twin()).expect("twin"));
    for (a, b) in lab.trials.iter().zip(&twin.trials) {
        assert_eq!(a.gaps, b.gaps);
        assert!(a.motion.q == b.motion.q);
    }
    let object = |lab: &Lab| String::from_utf8(lab.files[0].bytes.clone()).expect("text");
    assert!(object(&lab).contains("total_mass_kg: 1.007") && object(&twin).contains("total_mass_kg: 0.997"));
    assert_eq!(lab.truth.effect, "body_mass");
}

fn every_effect() -> Vec<Hidden> {
    let link = || "torso".to_owned();
    vec![
        Hidden::QuadraticDrag { drag_area_m2: 0.5, air_density_kgpm3: 1.2 },
        Hidden::LinearDrag { coefficient_nspm: 2.0 },
        Hidden::RotationalDrag { coefficient_nmsprad: 0.05 },
        Hidden::Wind { velocity_mps: [4.0, 1.0, 0.0], drag_area_m2: 0.5, air_density_kgpm3: 1.2 },
        Hidden::ConstantForce { link: link(), point_m: [0.0, 0.2, 0.0], force_n: [6.0, 3.0, 0.0] },
        Hidden::GravityTilt { about_x_deg: 0.4, about_y_deg: -0.3 },
        Hidden::GravityScale { factor: 1.004 },
        Hidden::TimeBase { true_rate_hz: 200.6 },
        Hidden::LengthScale { factor: 1.003 },
        Hidden::Tether {
            link: link(),
            point_m: [0.0, 0.2, 0.0],
            anchor_m: [0.0, 0.0, 3.0],
            rest_length_m: 1.2,
            stiffness_npm: 60.0,
            damping_nspm: 2.0,
        },
        Hidden::Crane { link: link(), point_m: [0.0, 0.2, 0.0], pulley_m: [0.0, 0.0, 4.0], tension_n: 60.0 },
        Hidden::Flywheel { link: link(), momentum_nms: [0.5, 1.0, 0.5] },
        Hidden::Rotor { link: link(), axis: [0.0, 1.0, 0.0], mean_nms: 1.0, swing_nms: 0.3, frequency_hz: 1.5 },
        Hidden::Payload { link: link(), point_m: [0.1, 0.2, 0.0], mass_kg: 3.0, trials: vec!["jump".into()] },
        Hidden::WobblingMass {
            link: link(),
            point_m: [0.05, 0.1, 0.0],
            mass_kg: 3.0,
            frequency_hz: 8.0,
            damping_ratio: 0.25,
        },
        Hidden::AddedMass { link: link(), point_m: [0.0, 0.2, 0.0], mass_kg: 0.5 },
        Hidden::Thrust { link: link(), point_m: [0.0, 0.2, 0.0], force_n: [5.0, 0.0, 0.0], period_s: 0.4, on_s: 0.2 },
        Hidden::PlateTimeOffset { offset_s: 0.005 },
        Hidden::ClockDrift { rate_ppm: 200.0, spacing_s: 60.0 },
        Hidden::PlateTare { plate: 1, force_n: [3.0, 2.0, -8.0], moment_nm: [0.5, 0.0, 0.0] },
        Hidden::PlateOrigin { plate: 2, shift_m: [0.01, 0.0, 0.0] },
        Hidden::PlateRotation { plate: 1, turn_deg: [1.0, 0.0, 0.0] },
        Hidden::PlateGain { plate: 1, gain: [1.02; 6] },
        Hidden::SoftTissue { link: "thigh_r".into(), amplitude_m: 0.015, along_bone: true },
        Hidden::CameraWarp { amplitude_m: 0.003 },
        Hidden::BodyMass { error_kg: 1.0 },
    ]
}

/// Every effect can be simulated on a person, changes the files, and survives a YAML round trip.
#[test]
fn every_effect_plays() {
    let clean = simulate(&small_human()).expect("lab");
    for effect in every_effect() {
        let text = serde_yaml::to_string(&effect).expect("yaml");
        assert_eq!(serde_yaml::from_str::<Hidden>(&text).expect("effect"), effect, "{text}");
        let scenario = Scenario { hidden: vec![effect.clone()], ..small_human() };
        let lab = simulate(&scenario).unwrap_or_else(|e| panic!("{}: {e}", effect.name()));
        let changed =
            lab.files.iter().zip(&clean.files).any(|(a, b)| !a.path.starts_with("truth") && a.bytes != b.bytes);
        assert!(changed, "{} changed nothing", effect.name());
        for trial in &lab.truth.trials {
            assert!(trial.flight_resid < 1e-9, "{}: {}", effect.name(), trial.flight_resid);
        }
        assert_eq!(lab.truth.effect, effect.name());
    }
}

const ROBOT: &str = "
name: robot
seed: 4
body:
  kind: custom
  joint_damping: 0.002
  joint_friction: 0.001
  model:
    name: robot
    links:
      - {name: trunk, joint: free, inertia: {mass_kg: 2.0, com_m: [0.0, 0.0, 0.05], inertia_com_kgm2: [0.02, 0.0, 0.0, 0.0, 0.03, 0.0, 0.0, 0.0, 0.01]}}
      - {name: arm, parent: trunk, joint: spherical, position_m: [0.0, 0.1, 0.1], inertia: {mass_kg: 0.6, com_m: [0.0, 0.15, 0.0], inertia_com_kgm2: [0.005, 0.0, 0.0, 0.0, 0.001, 0.0, 0.0, 0.0, 0.005]}}
      - {name: slide, parent: trunk, joint: {prismatic: [0.0, 0.0, 1.0]}, inertia: {mass_kg: 0.3, com_m: [0.0, 0.0, 0.0], inertia_com_kgm2: [0.001, 0.0, 0.0, 0.0, 0.001, 0.0, 0.0, 0.0, 0.001]}}
  markers:
    T1: {link: trunk, position_m: [0.1, 0.0, 0.0]}
    T2: {link: trunk, position_m: [0.0, 0.1, 0.0]}
    T3: {link: trunk, position_m: [0.0, 0.0, 0.1]}
    A1: {link: arm, position_m: [0.0, 0.3, 0.0]}
    S1: {link: slide, position_m: [0.05, 0.0, 0.0]}
  throws: {recordings: 1, throws: 2, joint_rate_radps: 1.0, calibration_s: 1.0}
";

/// Any model can be thrown: spherical and sliding joints, custom markers.
#[test]
fn any_model_flies() {
    let scenario: Scenario = serde_yaml::from_str(ROBOT).expect("scenario");
    let lab = simulate(&scenario).expect("lab");
    let thrown = lab.trial("throws_01").expect("throws");
    assert_eq!(thrown.motion.flights.len(), 2);
    assert_eq!(thrown.markers.labels, ["A1", "S1", "T1", "T2", "T3"]);
    assert!(lab.truth.trials.iter().all(|t| t.flight_resid < 1e-10));
    let description = String::from_utf8(lab.files[0].bytes.clone()).expect("text");
    let parsed: serde_yaml::Value = serde_yaml::from_str(&description).expect("yaml");
    assert_eq!(parsed["total_mass_kg"].as_f64(), Some(2.9));
    let truth: serde_json::Value =
        serde_json::from_slice(&lab.files.iter().find(|f| f.path == "truth/truth.json").expect("truth").bytes)
            .expect("json");
    assert_eq!(truth["links"][2]["mass"].as_f64(), Some(0.3));
}

#[test]
fn wrong_scenarios_are_refused_in_words() {
    let with = |hidden: Hidden| simulate(&Scenario { hidden: vec![hidden], ..small_human() }).expect_err("refused");
    let error = with(Hidden::Flywheel { link: "tail".into(), momentum_nms: [1.0, 0.0, 0.0] });
    assert!(matches!(error, SimulateError::UnknownLink { .. }) && error.to_string().contains("forearm_l"), "{error}");
    let error = with(Hidden::PlateGain { plate: 3, gain: [1.0; 6] });
    assert!(matches!(error, SimulateError::UnknownPlate { .. }), "{error}");
    let error = with(Hidden::GravityTilt { about_x_deg: f64::NAN, about_y_deg: 0.0 });
    assert!(error.to_string().contains("gravity_tilt"), "{error}");
    let mut scenario = small_human();
    scenario.capture.point_rate_hz = 0.0;
    assert!(simulate(&scenario).expect_err("refused").to_string().contains("point_rate_hz"));
    let mut scenario = small_chain();
    if let BodySpec::Chain(lab) = &mut scenario.body {
        lab.object.mass_kg = f64::NAN;
    }
    assert!(simulate(&scenario).is_err());
}
