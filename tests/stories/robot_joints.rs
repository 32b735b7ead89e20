//! Laws of a robot's joints: hidden in simulated logs they are named with the joint, added, and
//! gone; clean logs show none.

use crate::robot::copy;
use crate::robot_coverage::Draws;
use crate::robot_next::{IMU, NOISE, True, truth};
use crate::shared::shared_data;
use crate::support::{expect, folder, json, repo};
use aloft_robot::Imu;
use aloft_robot::next::Rehearsal;
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use serde_json::Value;
use std::fs;
use std::path::Path;

const RECORDINGS: u64 = 3;
const FLIGHTS: usize = 4;

/// Torque that a hidden law takes at a coordinate and rate.
pub type Hidden = Option<(&'static str, fn(f64, f64) -> f64)>;

/// A laboratory with three recordings of four flights. The drives follow their motion, so that a
/// hidden law is in the torques.
pub fn laboratory(data: &Path, seed: u64, hidden: Hidden) {
    copy(Path::new(&repo("fixtures/robot/model")), &data.join("model"));
    fs::copy(repo("fixtures/robot/robot.yaml"), data.join("robot.yaml")).unwrap();
    let True { robot, model, phi } = truth();
    let mut draws = Draws(ChaCha8Rng::seed_from_u64(seed));
    for k in 0..RECORDINGS {
        let flights: Vec<_> = (0..FLIGHTS).map(|_| draws.flight(robot.joints.len())).collect();
        let imu = Imu { link: None, position_m: IMU, rpy_rad: [0.0; 3] };
        let rehearsal = Rehearsal {
            robot: &robot,
            model: &model,
            phi: &phi,
            imu: &imu,
            noise: NOISE,
            rate_hz: 250.0,
            base_hz: 100.0,
            offset_s: 0.0037,
        };
        let (mut log, base, _) = rehearsal.record(&flights, 100 * seed + k);
        if let Some((name, law)) = hidden {
            let joint = robot.joints.iter().position(|j| j.name == name).unwrap();
            for i in 0..log.time_s.len() {
                log.torque[joint][i] += law(log.q[joint][i], log.dq[joint][i]);
            }
        }
        fs::write(data.join(format!("throw_0{}_robot.csv", k + 1)), log.csv(&robot)).unwrap();
        fs::write(data.join(format!("throw_0{}_base.csv", k + 1)), base.csv()).unwrap();
    }
}

fn number(v: &Value) -> f64 {
    v.as_f64().unwrap()
}

struct Lab {
    _dir: tempfile::TempDir,
    data: String,
    ws: String,
}

impl Lab {
    fn new(seed: u64, hidden: Hidden) -> Self {
        let dir = folder();
        let data = dir.path().join("lab");
        laboratory(&data, seed, hidden);
        let ws = dir.path().join("ws").display().to_string();
        Self { data: data.display().to_string(), ws, _dir: dir }
    }

    fn words<'a>(&'a self, words: &[&'a str]) -> Vec<&'a str> {
        [words, &["--data", &self.data, "--workspace", &self.ws]].concat()
    }

    fn call(&self, words: &[&str]) -> String {
        expect(&self.words(words), 0).0
    }

    fn json(&self, words: &[&str]) -> Value {
        json(&self.words(&[words, &["--json"]].concat()))
    }
}

/// Errors of a joint in units of its floor.
fn times_floor(joint: &Value) -> f64 {
    number(&joint["held_out_error"]) / number(&joint["noise_floor"])
}

fn joint<'a>(found: &'a Value, name: &str) -> &'a Value {
    found["joints"]["joints"].as_array().unwrap().iter().find(|j| j["joint"] == name).unwrap()
}

#[test]
fn a_hidden_stribeck_friction_is_named_with_its_joint_added_and_gone() {
    let lab = Lab::new(11, Some(("l_elbow", |_, v| 0.6 * (-(v / 0.8).powi(2)).exp() * v.signum())));
    let robot = repo("pipelines/robot.yaml");
    lab.call(&["run", &robot]);
    let told = lab.call(&["discover", &robot]);
    assert!(told.contains("stribeck[l_elbow]") && told.contains("missing: the held-out torque error falls"), "{told}");
    let found = lab.json(&["discover", &robot]);
    assert_eq!(found["verdict"], "nothing_missing", "{}", found["words"]);
    let of = &found["joints"];
    assert_eq!(of["verdict"], "supported", "{}", of["words"]);
    assert_eq!(of["found"].as_array().unwrap().len(), 1, "{}", of["words"]);
    assert_eq!(of["found"][0]["key"], "stribeck[l_elbow]");
    let extra = &of["found"][0]["coefficients"][0];
    assert!((number(&extra["value"]) - 0.6).abs() < 0.09, "{extra}");
    let speed = &of["found"][0]["nonlinear"][0];
    assert!((number(&speed["value"]) - 0.8).abs() < 0.16, "{speed}");
    let before = joint(&found, "l_elbow");
    assert!(times_floor(before) > 2.0, "{before}");
    assert!(number(&before["held_out_error_after"]) < 1.5 * number(&before["noise_floor"]), "{before}");

    // added, the error of the torque falls, and that of the body stays
    let told = lab.call(&["effect", "add", &robot, "stribeck[l_elbow]"]);
    assert!(told.contains("torques held out, revision 1") && told.contains("l_elbow"), "{told}");
    let ladder = lab.json(&["history", &robot]);
    let rungs = ladder["revisions"].as_array().unwrap();
    let rung = &rungs[1]["joints"][0];
    assert_eq!(rung["joint"], "l_elbow");
    assert!(number(&rung["held_out_error"]) < 0.6 * number(&rung["held_out_error_before"]), "{rung}");
    assert!(number(&rung["times_floor"]) < 1.5, "{rung}");
    assert_eq!(rungs[0]["held_out_error"], rungs[1]["held_out_error"]);
    let law = rungs[1]["coefficients"].as_array().unwrap().iter().find(|c| c["name"] == "stribeck[l_elbow].extra");
    assert!((number(&law.unwrap()["value"]) - 0.6).abs() < 0.12, "{law:?}");
    let again = lab.json(&["discover", &robot]);
    assert_eq!(again["joints"]["verdict"], "nothing_missing", "{}", again["joints"]["words"]);
    let report = format!("{}/report.html", lab.ws);
    lab.call(&["report", &robot, "--out", &report]);
    assert!(fs::read_to_string(&report).unwrap().contains("The torques of the joints"));
    lab.call(&["effect", "remove", &robot, "stribeck[l_elbow]"]);
}

#[test]
fn a_hidden_asymmetric_friction_is_named_with_its_joint() {
    let lab = Lab::new(12, Some(("r_elbow", |_, v| if v > 0.0 { 0.5 } else { 0.0 })));
    let robot = repo("pipelines/robot.yaml");
    lab.call(&["run", &robot]);
    let found = lab.json(&["discover", &robot, "--closed"]);
    let of = joint(&found, "r_elbow");
    // an offset of the torque is the same as long as the joint never rests
    let named: Vec<&str> = of["effects"].as_array().unwrap().iter().map(|e| e.as_str().unwrap()).collect();
    assert!(named.contains(&"asymmetric_friction") && named.len() <= 2, "{}", of["words"]);
    for other in ["l_shoulder", "l_elbow", "r_shoulder"] {
        assert_eq!(joint(&found, other)["verdict"], "nothing_missing", "{}", found["joints"]["words"]);
    }
}

#[test]
fn clean_logs_show_no_law_of_joints() {
    let robot = repo("pipelines/robot.yaml");
    for seed in 21..24 {
        let lab = Lab::new(seed, None);
        lab.call(&["run", &robot]);
        let found = lab.json(&["discover", &robot, "--closed"]);
        let of = &found["joints"];
        assert_eq!(of["verdict"], "nothing_missing", "{seed}: {}", of["words"]);
        assert!(of["joints"].as_array().unwrap().iter().all(|j| (0.5..1.5).contains(&times_floor(j))), "{of}");
    }
}

#[test]
fn logs_without_torques_say_nothing_of_joints() {
    let lab = Lab::new(31, None);
    let robot = repo("pipelines/robot.yaml");
    for k in 1..=RECORDINGS {
        let path = format!("{}/throw_0{k}_robot.csv", lab.data);
        let text = fs::read_to_string(&path).unwrap().replace("tau_meas_", "other_");
        fs::write(&path, text).unwrap();
    }
    lab.call(&["run", &robot]);
    let found = lab.json(&["discover", &robot, "--closed"]);
    assert!(found["joints"].is_null());
    let (_, said) = expect(&lab.words(&["effect", "add", &robot, "stribeck[l_elbow]"]), 2);
    assert!(said.contains("no torques are used"), "{said}");
}

/// The simulated robots of real size in which nothing is hidden.
#[test]
fn validate_robots_of_real_size_without_hidden_laws_show_none() {
    for (name, error, joints) in [("robot_h_a", 0.635, 22), ("robot_q_a", 0.0826, 12)] {
        let Some(data) = shared_data(name) else { return };
        let dir = folder();
        let (data, ws) = (data.display().to_string(), dir.path().join("ws").display().to_string());
        let robot = repo("pipelines/robot.yaml");
        expect(&["run", &robot, "--data", &data, "--workspace", &ws], 0);
        let found = json(&["discover", &robot, "--data", &data, "--workspace", &ws, "--closed", "--json"]);
        let flight = &found["errors"].as_array().unwrap().iter().find(|e| e["judged_on"] == "flight").unwrap();
        assert!((number(&flight["held_out_error"]) - error).abs() < 5e-4, "{flight}");
        assert_eq!(found["joints"]["verdict"], "nothing_missing", "{}", found["joints"]["words"]);
        let all = found["joints"]["joints"].as_array().unwrap();
        assert!(all.len() == joints && all.iter().all(|j| times_floor(j) < 1.3), "{}", found["joints"]["words"]);
    }
}
