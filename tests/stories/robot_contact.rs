//! Contact sensors of a robot: flights end where they say so, and one that says contact in free
//! fall is named and not used.

use crate::robot::copy;
use crate::support::{expect, folder, repo};
use serde_json::Value;
use std::fs;
use std::io::Read as _;
use std::path::Path;

/// By how much earlier than the truth the sensor says that the robot is caught, s.
const EARLIER_S: f64 = 0.06;

fn flights_of(truth: &Value, trial: &str) -> Vec<(f64, f64)> {
    let of = |f: &Value| (f[0].as_f64().unwrap(), f[1].as_f64().unwrap());
    truth["recordings"][trial]["flights_s"].as_array().unwrap().iter().map(of).collect()
}

/// Unpacks a log and writes it with columns of contact.
fn with_contact(data: &Path, trial: &str, flights: &[(f64, f64)]) {
    let packed = data.join(format!("{trial}_robot.csv.gz"));
    let mut text = String::new();
    let bytes = fs::read(&packed).unwrap();
    flate2::read::GzDecoder::new(bytes.as_slice()).read_to_string(&mut text).unwrap();
    let mut lines = text.lines();
    let mut out = format!("{},contact_trunk,force_z_r_lower_n,contact_l_lower,contact_nose\n", lines.next().unwrap());
    for line in lines {
        let t: f64 = line.split(',').next().unwrap().parse().unwrap();
        let air = flights.iter().any(|f| t > f.0 && t < f.1 - EARLIER_S);
        out += &format!("{line},{},{},1,1\n", u8::from(!air), if air { 0.3 } else { 25.0 });
    }
    fs::remove_file(&packed).unwrap();
    fs::write(data.join(format!("{trial}_robot.csv")), out).unwrap();
}

#[test]
fn contact_ends_flights_and_a_stuck_sensor_is_named() {
    let dir = folder();
    let data = dir.path().join("lab");
    copy(Path::new(&repo("fixtures/robot")), &data);
    let truth: Value = serde_json::from_str(&fs::read_to_string(repo("fixtures/robot/truth.json")).unwrap()).unwrap();
    for trial in ["throw_01", "throw_02"] {
        with_contact(&data, trial, &flights_of(&truth, trial));
    }
    let (ws, data) = (dir.path().join("ws").display().to_string(), data.display().to_string());
    let robot = repo("pipelines/robot.yaml");
    let (told, said) = expect(&["run", &robot, "--data", &data, "--workspace", &ws, "--details"], 0);
    let told = crate::support::unwrapped((told + &said).as_bytes());
    assert!(told.contains("`contact_l_lower` says contact in 3 of 3 flights"), "{told}");
    assert!(!told.contains("`contact_trunk` says") && !told.contains("`force_z_r_lower_n` says"), "{told}");
    assert!(told.contains("`contact_nose` names no link"), "{told}");
    for trial in ["throw_01", "throw_02"] {
        let report = fs::read_to_string(format!("{ws}/flight/{trial}/flights.json")).unwrap();
        let report: Value = serde_json::from_str(&report).unwrap();
        let found = report["flights"].as_array().unwrap();
        assert_eq!(found.len(), 3, "{trial}");
        for (flight, (start, end)) in found.iter().zip(flights_of(&truth, trial)) {
            let at = |key: &str| flight[key].as_f64().unwrap() / 250.0;
            assert!(at("start") >= start && (at("end") - (end - EARLIER_S)).abs() < 0.006, "{flight} {end}");
            assert_eq!(flight["landing_source"], "contact");
        }
    }
}
