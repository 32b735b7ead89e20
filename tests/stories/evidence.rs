//! What is missing, by one marginal likelihood.

use crate::support::{expect, folder, json, repo};
use nalgebra::{Quaternion, UnitQuaternion, Vector3};
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};
use std::fmt::Write;

#[test]
fn drag_is_named_and_can_be_added_and_nothing_where_nothing_is_hidden() {
    let dir = folder();
    let at = |name: &str| dir.path().join(name).display().to_string();
    let (demo, twin, ws, of_twin) = (repo("pipelines/demo.yaml"), repo("fixtures/demo_twin"), at("ws"), at("twin"));
    let words = [demo.as_str(), "--workspace", &ws];
    expect(&[&["run"], &words[..]].concat(), 0);
    let found = json(&[&["discover"], &words[..], &["--json"]].concat());
    assert_eq!(found["verdict"], "supported", "{}", found["words"]);
    assert_eq!(found["effects"], serde_json::json!(["quadratic_drag"]));
    let noise = |key: &str| found["evidence"][key].as_f64().unwrap();
    assert!(noise("residual_before") > 4.0 && (0.8..1.2).contains(&noise("residual_after")), "{}", found["evidence"]);
    let of = |i: usize| found["candidates"][i]["evidence"]["ln_odds"].as_f64().unwrap();
    assert!(of(0) > 100.0 && of(0) > of(1) + 3.0, "{} {}", of(0), of(1));
    // the answer can be read, added and reported as any other
    let (said, next) = expect(&[&["discover"], &words[..], &["--details"]].concat(), 0);
    assert!(said.contains("question 1: ") && said.contains("odds of 10^"), "{said}");
    assert!(next.contains("effect add") && !said.contains("NaN"), "{next}{said}");
    expect(&["effect", "add", &demo, found["found"][0]["key"].as_str().unwrap(), "--workspace", &ws], 0);
    let after = json(&[&["discover"], &words[..], &["--json"]].concat());
    assert_eq!(after["verdict"], "nothing_missing", "{}", after["words"]);
    expect(&[&["report"], &words[..]].concat(), 0);
    let page = std::fs::read_to_string(dir.path().join("ws/report.html")).unwrap();
    assert!(page.contains("one marginal likelihood"));
    // in a table; scripts and packed recordings may spell it
    assert!(![">NaN", "(NaN"].iter().any(|nan| page.contains(nan)));

    let words = [demo.as_str(), "--data", &twin, "--workspace", &of_twin];
    expect(&[&["run"], &words[..]].concat(), 0);
    let found = json(&[&["discover"], &words[..], &["--json"]].concat());
    assert_eq!(found["verdict"], "nothing_missing", "{}", found["words"]);
    assert!(found["evidence"]["nothing"].as_f64().unwrap() > 0.5, "{}", found["evidence"]);
}

/// A load of minus the body has no noise either: rows that it empties fit perfectly, which is no
/// evidence.
#[test]
fn a_body_without_mass_explains_nothing() {
    let dir = folder();
    let file = |name: &str| dir.path().join(name);
    std::fs::write(
        file("brick.urdf"),
        "<robot name=\"brick\"><link name=\"body\"><inertial><origin xyz=\"0 0 0\"/><mass value=\"0.4\"/>\
         <inertia ixx=\"0.0006\" iyy=\"0.0008\" izz=\"0.001\" ixy=\"0\" ixz=\"0\" iyz=\"0\"/></inertial></link></robot>",
    )
    .unwrap();
    std::fs::write(
        file("robot.yaml"),
        "name: brick\ntotal_mass_kg: 0.4\nmodel: {urdf: brick.urdf}\nnoise: {position_m: 0.0003, orientation_deg: 0.05}\n",
    )
    .unwrap();
    let pipeline = file("brick.yaml");
    std::fs::write(
        &pipeline,
        "name: brick\ndata: .\nrobot: {description: robot.yaml, mass_rel: 0.15, com_m: 0.012, radius_rel: 0.12}\n\
         trials: {static: [], calibration: [], identify: [\"toss_*_robot.csv\"], validate: []}\n\
         regressor: {weighting: whitened}\nfilter: {order: 3, cutoff_hz: 30.0}\nflight: {min_duration_s: 0.06}\n",
    )
    .unwrap();
    for k in 0..20 {
        std::fs::write(file(&format!("toss_{k:03}_robot.csv")), toss(k)).unwrap();
    }
    let ws = file("ws").display().to_string();
    let words = [pipeline.to_str().unwrap(), "--workspace", &ws];
    expect(&[&["run"], &words[..]].concat(), 0);
    let found = json(&[&["discover"], &words[..], &["--json"]].concat());
    assert!(found["found"].as_array().unwrap().is_empty(), "{}", found["words"]);
    assert_ne!(found["verdict"], "supported", "{}", found["words"]);
}

/// Pose of a tumbling brick in free fall, 200 Hz, 0.3 s, with noise.
fn toss(seed: u64) -> String {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let mut normal = || -> f64 { StandardNormal.sample(&mut rng) };
    let j = Vector3::new(0.0006, 0.0008, 0.001);
    let (mut rate, mut turned) = (Vector3::from_fn(|_, _| 6.0 * normal()), UnitQuaternion::identity());
    let (from, speed) = (Vector3::from_fn(|_, _| normal()), Vector3::new(normal(), normal(), 1.5));
    let mut out = "time_s,x_m,y_m,z_m,qw,qx,qy,qz\n".to_owned();
    for frame in 0..60 {
        let t = 0.005 * f64::from(frame);
        let place = from + speed * t - Vector3::z() * (0.5 * 9.81 * t * t) + Vector3::from_fn(|_, _| 3e-4 * normal());
        let seen = turned * UnitQuaternion::from_scaled_axis(Vector3::from_fn(|_, _| 8.7e-4 * normal()));
        let q: &Quaternion<f64> = seen.quaternion();
        writeln!(out, "{t},{},{},{},{},{},{},{}", place.x, place.y, place.z, q.w, q.i, q.j, q.k).unwrap();
        // Euler's equations, in small steps about the middle of each
        for _ in 0..50 {
            let change = |w: &Vector3<f64>| {
                let l = j.component_mul(w);
                l.cross(w).component_div(&j)
            };
            let middle = rate + change(&rate) * 5e-5;
            turned *= UnitQuaternion::from_scaled_axis(middle * 1e-4);
            rate += change(&middle) * 1e-4;
        }
    }
    out
}
