//! Delays of torques against encoders: no whole number of the log's intervals, drives that hold
//! their torque, friction that turns over a short way.

#![allow(clippy::unwrap_used, clippy::panic, reason = "tests fail by panicking")]

use aloft_body::{BaseParameters, LinkInertia, Model, Phi};
use aloft_effects::Scene;
use aloft_identify::Prior;
use aloft_regressor::{Acting, Factor, Stretch, WeakOptions, weak_factor};
use aloft_robot::joint_fit::{JointEstimate, JointRows, joint_fit};
use aloft_robot::next::{Rehearsal, Wave};
use aloft_robot::torque::{TorqueEffects, TorqueSource, Torques, torque_factor};
use aloft_robot::{FuseInput, Imu, RobotModel, SensorNoise, fuse};
use nalgebra::{DMatrix, DVector, Vector3};
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};

const NOISE: SensorNoise = SensorNoise {
    position_m: 0.0003,
    orientation_deg: 0.05,
    dq_rad_s: 0.02,
    torque_nm: 0.05,
    gyro_rad_s: 0.004,
    acc_m_s2: 0.04,
};
/// Rows of the simulation for each row of the log: delays are whole milliseconds of its four.
const EVERY: usize = 4;
/// Way over which dry friction changes its sign, and step of the encoders (14 bit).
const SLID_RAD: f64 = 2e-4;
const ENCODER_RAD: f64 = std::f64::consts::TAU / 16_384.0;
const KINDS: [&str; 5] = ["armature", "damping", "friction", "gain", "delay_s"];

/// How the log gets the torque.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Sensor {
    /// The value at one instant.
    Sampled,
    /// The mean over the interval that follows: a drive that holds its torque.
    Held,
}

/// What is found of one robot's joints, with the truth: twelve flights in four recordings.
fn one(seed: u64, sensor: Sensor) -> Vec<(JointEstimate, [f64; 5])> {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let mut normal = || -> f64 { StandardNormal.sample(&mut rng) };
    let text =
        std::fs::read_to_string(format!("{}/../../fixtures/robot/model/nominal.urdf", env!("CARGO_MANIFEST_DIR")));
    let nominal = RobotModel::parse("nominal.urdf", &text.unwrap()).unwrap();
    let mut robot = nominal.clone();
    let mut model = Model::from_spec(&robot.spec).unwrap();
    model.gravity_mps2 = Vector3::new(0.0, 0.0, -9.81);
    let links: Vec<LinkInertia> = robot.spec.links.iter().map(|l| l.inertia.unwrap()).collect();
    let phi: Vec<Phi> = links.iter().map(LinkInertia::to_phi).collect();
    let mut truth = Vec::new();
    for joint in &mut robot.joints {
        for value in [&mut joint.armature, &mut joint.damping, &mut joint.friction] {
            *value *= (1.0 + 0.25 * normal()).max(0.3);
        }
        let late = (3.0 * normal()).round().clamp(-7.0, 7.0);
        let shown = if sensor == Sensor::Held { late - 1.5 } else { late };
        truth.push(([joint.armature, joint.damping, joint.friction, 1.0 + 0.02 * normal(), shown * 1e-3], late as i64));
    }
    let base_parameters = BaseParameters::of(&model);
    let scene = Scene::new(&model, &phi, &[]);
    let (mut base_rows, mut rows, mut noise): (Vec<Factor>, Vec<Factor>, Vec<Vec<f64>>) = Default::default();
    for k in 0..4 {
        let flights: Vec<(Wave, Vector3<f64>)> = (0..3)
            .map(|_| {
                let control = (0..robot.joints.len()).map(|_| (0..4).map(|_| 0.6 * normal()).collect()).collect();
                (
                    Wave { hold: vec![0.1; robot.joints.len()], control, duration_s: 0.5 },
                    Vector3::from_fn(|_, _| 2.0 * normal()),
                )
            })
            .collect();
        let imu = Imu { link: None, position_m: [0.02, -0.01, 0.03], rpy_rad: [0.0; 3] };
        let rehearsal = Rehearsal {
            robot: &robot,
            model: &model,
            phi: &phi,
            imu: &imu,
            noise: SensorNoise { dq_rad_s: 0.0, torque_nm: 0.0, ..NOISE },
            rate_hz: 250.0 * EVERY as f64,
            base_hz: 100.0,
            offset_s: 0.0037,
        };
        let (mut log, base, times) = rehearsal.record(&flights, 1000 * seed + k as u64);
        for (j, (truth, late)) in truth.iter().enumerate() {
            let mut friction = 0.0;
            let mut slide = |v: f64| {
                let step = v * 1e-3 / SLID_RAD;
                friction = (friction + step) / (1.0 + step.abs());
                friction
            };
            let torque: Vec<f64> = log.torque[j]
                .iter()
                .zip(&log.dq[j])
                .map(|(t, v)| t + truth[2] * (slide(*v) - (v / 0.05).tanh()))
                .collect();
            log.q[j].iter_mut().for_each(|q| *q = (*q / ENCODER_RAD).round() * ENCODER_RAD);
            let last = torque.len() as i64 - 1;
            let at = |i: i64| torque[i.clamp(0, last) as usize];
            for (i, t) in log.torque[j].iter_mut().enumerate() {
                let i = i as i64 - late;
                let value = match sensor {
                    Sensor::Sampled => at(i),
                    Sensor::Held => (0..4).map(|k| at(i + k)).sum::<f64>() / 4.0,
                };
                *t = truth[3] * value + NOISE.torque_nm * normal();
            }
        }
        let kept: Vec<usize> = (0..log.time_s.len()).step_by(EVERY).collect();
        let of = |values: &[f64]| kept.iter().map(|&i| values[i]).collect::<Vec<f64>>();
        log.dq.clear();
        log.dq.resize(robot.joints.len(), Vec::new());
        (log.q, log.torque) = (log.q.iter().map(|v| of(v)).collect(), log.torque.iter().map(|v| of(v)).collect());
        for sensor in [&mut log.gyro, &mut log.acc] {
            *sensor = sensor.take().map(|values| kept.iter().map(|&i| values[i]).collect());
        }
        log.time_s = of(&log.time_s);
        let name = format!("r{k}");
        let input = FuseInput {
            trial: &name,
            model: &model,
            log: &log,
            base: Some(&base),
            imu: Some(&imu),
            noise: NOISE,
            bridged_s: 0.0,
        };
        let (motion, _) = fuse(&input).unwrap();
        let torques = log.torques_at_frames().unwrap().unwrap();
        let white = vec![NOISE.torque_nm; robot.joints.len()];
        let given = Torques { values: &torques, sd_nm: NOISE.torque_nm, white_nm: &white };
        let frame = |t: f64| ((t - log.time_s[0]) * 250.0).round() as usize;
        for (i, (start, end)) in times.iter().enumerate() {
            let stretch = Stretch::flight(&name, i, frame(*start) + 3, frame(*end) - 3);
            let source = TorqueSource { scene: &scene, motion: &motion, stretch: &stretch, torques: given };
            let (factor, of_flight) =
                torque_factor(&nominal, &base_parameters, source, TorqueEffects::default()).unwrap();
            rows.push(factor);
            noise.push(of_flight);
            let acting = Acting { measured: None, effects: None };
            let options = WeakOptions::default();
            base_rows
                .push(weak_factor(&model, &base_parameters, &phi, &motion, &stretch, acting, &options, None).unwrap());
        }
    }
    // the body is nearly known: what its rows say is another test's matter
    let stacked = DVector::from_iterator(10 * phi.len(), phi.iter().flat_map(|p| p.iter().copied()));
    let mean = &base_parameters.from_full * stacked;
    let covariance = DMatrix::from_diagonal(&mean.map(|m| (0.003 * m.abs() + 1e-5).powi(2)));
    let prior = Prior { mean, covariance };
    let mass_kg = links.iter().map(|l| l.mass_kg).sum();
    let fit = JointRows { base: &base_rows, torque: &rows, noise: &noise, base_row_sd: 1e6, prior: &prior, mass_kg };
    let fit = joint_fit(&nominal, &fit).unwrap();
    fit.joints.into_iter().zip(truth.into_iter().map(|t| t.0)).collect()
}

/// Share of the intervals of each unknown that hold the truth, and mean error in standard errors.
fn coverage(seeds: std::ops::Range<u64>, sensor: Sensor) -> Vec<(f64, f64)> {
    let found: Vec<(JointEstimate, [f64; 5])> = seeds.flat_map(|seed| one(seed, sensor)).collect();
    let n = found.len() as f64;
    let of = |kind: usize| {
        let each = found.iter().map(|(j, truth)| {
            let e = [j.armature, j.damping, j.friction, j.gain, j.delay_s][kind];
            (e.value - truth[kind], 0.5 * (e.ci95[1] - e.ci95[0]))
        });
        let inside = each.clone().filter(|(off, half)| off.abs() <= *half).count() as f64;
        (inside / n, each.map(|(off, half)| 1.96 * off / half).sum::<f64>() / n)
    };
    (0..KINDS.len()).map(of).collect()
}

#[test]
fn intervals_hold_the_truth_for_delays_between_samples() {
    // 32 joints: a mean of standard errors of 0.18, shares of 0.04
    for (sensor, first) in [(Sensor::Sampled, 100), (Sensor::Held, 200)] {
        for ((share, bias), kind) in coverage(first..first + 8, sensor).into_iter().zip(KINDS) {
            assert!(share > 0.8, "{sensor:?}, {kind}: {share} of the intervals hold the truth");
            assert!(bias.abs() < 0.7, "{sensor:?}, {kind}: bias of {bias} standard errors");
        }
    }
}

#[test]
#[ignore = "minutes; the numbers are in docs/robots.md"]
fn coverage_of_delays_on_a_hundred_robots() {
    let first = std::env::var("ALOFT_FIRST_SEED").ok().and_then(|v| v.parse().ok()).unwrap_or(1000);
    for sensor in [Sensor::Sampled, Sensor::Held] {
        for ((share, bias), kind) in coverage(first..first + 100, sensor).into_iter().zip(KINDS) {
            println!("{sensor:?} {kind:9}: {:.1} % hold the truth, bias {bias:+.2} standard errors", 100.0 * share);
        }
    }
}
