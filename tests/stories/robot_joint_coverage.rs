//! How often 95 % intervals of the joints' unknowns hold the truth: simulated robots whose
//! inertias, friction, reflected inertia, gains and delays are drawn anew for every seed, through
//! the whole program.

use crate::robot_coverage::{Draws, drawn};
use crate::robot_next::{IMU, NOISE, True};
use crate::support::{expect, folder, repo};
use aloft_robot::next::Rehearsal;
use aloft_robot::{Imu, SensorNoise};
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};
use serde_json::Value;
use std::fs;

const FLIGHTS: usize = 3;
/// Rows of the simulation for each row of the log: delays are whole milliseconds.
const EVERY: usize = 4;
const KINDS: [&str; 5] = ["armature", "damping", "friction", "gain", "delay_s"];
/// Spread of friction and reflected inertia about the model file, and of gains about 1.
const SPREAD: f64 = 0.25;
const GAINS: f64 = 0.02;
/// Way over which dry friction changes its sign, rad, and step of the encoders (14 bit).
const SLID_RAD: f64 = 2e-4;
const ENCODER_RAD: f64 = std::f64::consts::TAU / 16_384.0;

/// Estimate, half of its interval and truth.
type Found = [f64; 3];

/// What the program says of every joint of one robot, by kind of unknown.
fn one(seed: u64, recordings: usize) -> [Vec<Found>; 5] {
    let mut draws = Draws(ChaCha8Rng::seed_from_u64(seed));
    let dir = folder();
    let data = dir.path().join("lab");
    let True { mut robot, model, phi } = drawn(&mut draws, &data);
    let mut normal = || -> f64 { StandardNormal.sample(&mut draws.0) };
    let mut truth = Vec::new();
    for joint in &mut robot.joints {
        for value in [&mut joint.armature, &mut joint.damping, &mut joint.friction] {
            *value *= (1.0 + SPREAD * normal()).max(0.3);
        }
        // from −2 to 2 rows of the simulation
        let late = (1.2 * normal()).round().clamp(-2.0, 2.0);
        truth.push([joint.armature, joint.damping, joint.friction, 1.0 + GAINS * normal(), late * 1e-3]);
    }
    for k in 0..recordings {
        let flights: Vec<_> = (0..FLIGHTS).map(|_| draws.flight(robot.joints.len())).collect();
        let imu = Imu { link: None, position_m: IMU, rpy_rad: [0.0; 3] };
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
        let (mut log, base, _) = rehearsal.record(&flights, 1000 * seed + k as u64);
        for (j, truth) in truth.iter().enumerate() {
            // dry friction: of constant size in motion, elastic until the joint has slid (Dahl);
            // then gain, delay and noise of the sensor
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
            let late = (1e3 * truth[4]).round() as i64;
            for (i, t) in log.torque[j].iter_mut().enumerate() {
                let noise: f64 = StandardNormal.sample(&mut draws.0);
                *t = truth[3] * torque[(i as i64 - late).clamp(0, last) as usize] + NOISE.torque_nm * noise;
            }
        }
        let rows: Vec<usize> = (0..log.time_s.len()).step_by(EVERY).collect();
        let of = |values: &[f64]| rows.iter().map(|&i| values[i]).collect::<Vec<f64>>();
        log.dq.clear();
        log.dq.resize(robot.joints.len(), Vec::new());
        (log.q, log.torque) = (log.q.iter().map(|v| of(v)).collect(), log.torque.iter().map(|v| of(v)).collect());
        for sensor in [&mut log.gyro, &mut log.acc] {
            *sensor = sensor.take().map(|values| rows.iter().map(|&i| values[i]).collect());
        }
        log.time_s = of(&log.time_s);
        fs::write(data.join(format!("throw_0{}_robot.csv", k + 1)), log.csv(&robot)).unwrap();
        fs::write(data.join(format!("throw_0{}_base.csv", k + 1)), base.csv()).unwrap();
    }
    let ws = dir.path().join("ws").display().to_string();
    expect(&["run", &repo("pipelines/robot.yaml"), "--data", &data.display().to_string(), "--workspace", &ws], 0);
    let fit: Value =
        serde_json::from_str(&fs::read_to_string(format!("{ws}/identify/_study/joints.json")).unwrap()).unwrap();
    std::array::from_fn(|kind| {
        let of = |(joint, truth): (&Value, &[f64; 5])| {
            let (value, ci) = (&joint[KINDS[kind]]["value"], &joint[KINDS[kind]]["ci95"]);
            let number = |v: &Value| v.as_f64().unwrap();
            [number(value), 0.5 * (number(&ci[1]) - number(&ci[0])), truth[kind]]
        };
        fit["joints"].as_array().unwrap().iter().zip(&truth).map(of).collect()
    })
}

/// Figures of one kind of unknown.
struct Kind {
    /// Share of intervals that hold the truth, and its standard error.
    share: f64,
    error: f64,
    /// Mean error in units of the stated deviation.
    bias: f64,
    /// The figures in words.
    words: String,
}

/// Coverage and bias of every kind.
fn coverage(seeds: std::ops::Range<u64>, recordings: usize) -> Vec<Kind> {
    let threads = 2;
    let all: Vec<[Vec<Found>; 5]> = std::thread::scope(|scope| {
        let seeds: Vec<u64> = seeds.collect();
        let size = seeds.len().div_ceil(threads);
        let parts: Vec<_> = seeds
            .chunks(size)
            .map(|part| part.to_vec())
            .map(|part| scope.spawn(move || part.into_iter().map(|s| one(s, recordings)).collect::<Vec<_>>()))
            .collect();
        parts.into_iter().flat_map(|p| p.join().unwrap()).collect()
    });
    let mut out = Vec::new();
    for (kind, name) in KINDS.iter().enumerate() {
        let inside = |f: &&Found| (f[0] - f[2]).abs() <= f[1];
        let shares: Vec<f64> =
            all.iter().map(|r| r[kind].iter().filter(inside).count() as f64 / r[kind].len() as f64).collect();
        let n = shares.len() as f64;
        let share = shares.iter().sum::<f64>() / n;
        let error = (shares.iter().map(|s| (s - share).powi(2)).sum::<f64>() / (n - 1.0) / n).sqrt();
        let found: Vec<&Found> = all.iter().flat_map(|r| &r[kind]).collect();
        let count = found.len() as f64;
        let mean = |of: &dyn Fn(&Found) -> f64| found.iter().map(|f| of(f)).sum::<f64>() / count;
        let (off, size) = (mean(&|f| f[0] - f[2]), mean(&|f| f[2].abs()));
        let rms = mean(&|f| (f[0] - f[2]).powi(2)).sqrt();
        let bias = off / (mean(&|f| f[1]) / 1.96);
        let words = format!(
            "{} robots, {} flights each: {name:10} {:5.1} ± {:.1} % hold the truth; bias {:+.2} % of the size, {bias:+.2} deviations; error {:.2} %, \
             interval ±{:.2} %",
            all.len(),
            recordings * FLIGHTS,
            100.0 * share,
            100.0 * error,
            100.0 * off / size,
            100.0 * rms / size,
            100.0 * mean(&|f| f[1]) / size
        );
        out.push(Kind { share, error, bias, words });
    }
    out
}

#[test]
fn intervals_of_the_joints_of_a_few_robots_hold_the_truth() {
    let found = coverage(300..306, 3);
    let share = found.iter().map(|k| k.share).sum::<f64>() / found.len() as f64;
    assert!(share > 0.85, "{share} of the intervals hold the truth");
}

#[test]
#[ignore = "minutes; the numbers are in docs/robots.md"]
fn coverage_of_joints_on_a_hundred_robots() {
    let number = |name: &str, default: u64| std::env::var(name).ok().and_then(|v| v.parse().ok()).unwrap_or(default);
    let first = number("ALOFT_FIRST_SEED", 7000);
    let seeds = first..first + number("ALOFT_ROBOTS", 100);
    let found: Vec<Vec<Kind>> = [2, 4].map(|recordings| coverage(seeds.clone(), recordings)).into();
    found.iter().flatten().for_each(|kind| println!("{}", kind.words));
    for (kind, name) in found.iter().flat_map(|of| of.iter().zip(KINDS)) {
        assert!(kind.share + 2.0 * kind.error > 0.93, "{name}: {} ± {}", kind.share, kind.error);
        assert!(kind.bias.abs() < 0.3, "{name}: bias of {} stated deviations", kind.bias);
    }
}
