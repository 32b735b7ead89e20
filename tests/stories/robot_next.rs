//! A robot's next flights: planned from two recordings, followed by the true robot in a simulation,
//! and the standard errors that were promised. Also how often intervals hold the truth.

use crate::support::{expect, folder, json, repo, unwrapped};
use aloft_body::{BaseParameters, LinkInertia, Model, Phi};
use aloft_robot::next::{Rehearsal, Wave};
use aloft_robot::{Imu, RobotModel, SensorNoise};
use nalgebra::{Matrix3, Vector3};
use std::fs;
use std::path::Path;

/// The fixture's robot as it truly is.
pub struct True {
    pub robot: RobotModel,
    pub model: Model,
    pub phi: Vec<Phi>,
}

pub const IMU: [f64; 3] = [0.02, -0.01, 0.03];
pub const NOISE: SensorNoise = SensorNoise {
    position_m: 0.0003,
    orientation_deg: 0.05,
    dq_rad_s: 0.02,
    torque_nm: 0.05,
    gyro_rad_s: 0.004,
    acc_m_s2: 0.04,
};

pub fn truth() -> True {
    let text = fs::read_to_string(repo("fixtures/robot/model/nominal.urdf")).unwrap();
    let mut robot = RobotModel::parse("nominal.urdf", &text).unwrap();
    let told: serde_json::Value =
        serde_json::from_str(&fs::read_to_string(repo("fixtures/robot/truth.json")).unwrap()).unwrap();
    let of = |v: &serde_json::Value| v.as_f64().unwrap();
    let three = |v: &serde_json::Value| Vector3::new(of(&v[0]), of(&v[1]), of(&v[2]));
    for link in &mut robot.spec.links {
        let own = &told["links"][&link.name];
        link.inertia = Some(LinkInertia {
            mass_kg: of(&own["mass_kg"]),
            com_m: three(&own["com_m"]),
            inertia_com_kgm2: Matrix3::from_diagonal(&three(&own["inertia_kgm2"])),
        });
    }
    for joint in &mut robot.joints {
        let own = &told["joints"][&joint.name];
        (joint.armature, joint.damping, joint.friction) =
            (of(&own["armature"]), of(&own["damping"]), of(&own["friction"]));
    }
    let mut model = Model::from_spec(&robot.spec).unwrap();
    model.gravity_mps2 = Vector3::new(0.0, 0.0, -9.81);
    let phi = robot.spec.links.iter().map(|l| l.inertia.unwrap().to_phi()).collect();
    True { robot, model, phi }
}

/// Writes a recording of flights as the true robot would log them.
pub fn record(truth: &True, flights: &[(Wave, Vector3<f64>)], seed: u64, data: &Path, name: &str) {
    let imu = Imu { link: None, position_m: IMU, rpy_rad: [0.0; 3] };
    let rehearsal = Rehearsal {
        robot: &truth.robot,
        model: &truth.model,
        phi: &truth.phi,
        imu: &imu,
        noise: NOISE,
        rate_hz: 250.0,
        base_hz: 100.0,
        offset_s: 0.0037,
    };
    let (log, base, _) = rehearsal.record(flights, seed);
    fs::write(data.join(format!("{name}_robot.csv")), log.csv(&truth.robot)).unwrap();
    fs::write(data.join(format!("{name}_base.csv")), base.csv()).unwrap();
}

/// Standard errors and values of the base parameters, the mass left out.
fn base_of(found: &serde_json::Value) -> Vec<(String, f64, f64)> {
    let base = found["base"].as_array().unwrap().iter().skip(1);
    base.map(|b| (b["name"].as_str().unwrap().to_owned(), b["value"].as_f64().unwrap(), b["se"].as_f64().unwrap()))
        .collect()
}

fn middle(values: impl Iterator<Item = f64>) -> f64 {
    let logs: Vec<f64> = values.map(f64::ln).collect();
    (logs.iter().sum::<f64>() / logs.len() as f64).exp()
}

#[test]
fn planned_flights_keep_the_limits_and_give_the_errors_that_were_promised() {
    let dir = folder();
    let data = dir.path().join("lab");
    super::robot::copy(Path::new(&repo("fixtures/robot")), &data);
    let ws = dir.path().join("ws").display().to_string();
    let (robot, lab) = (repo("pipelines/robot.yaml"), data.display().to_string());
    let asked = ["--data", &lab, "--workspace", &ws];
    let with = |words: &[&str]| -> Vec<String> { words.iter().chain(&asked).map(|w| (*w).to_owned()).collect() };
    let call = |words: &[&str]| {
        let words = with(words);
        expect(&words.iter().map(String::as_str).collect::<Vec<_>>(), 0)
    };
    call(&["run", &robot]);
    let out = dir.path().join("play");
    let out_dir = out.display().to_string();
    let (told, _) = call(&["parameters", &robot, "--assess", "--next-flights", &out_dir]);
    assert!(told.contains("flights to record next") && told.contains("flight_3.csv"), "{told}");
    let words = with(&["parameters", &robot, "--json"]);
    let before = json(&words.iter().map(String::as_str).collect::<Vec<_>>());
    let plan = &before["assessment"]["next_flights"];
    let of = |v: &serde_json::Value| v.as_f64().unwrap();
    let worst = plan["worst"].as_u64().unwrap() as usize;
    let parameters = plan["parameters"].as_array().unwrap();
    let promised = middle(parameters[..worst].iter().map(|p| of(&p["then"]) / of(&p["now"])));
    let repeated = middle(parameters[..worst].iter().map(|p| of(&p["repeated"]) / of(&p["now"])));
    assert!(promised < 0.8 * repeated, "{promised} against {repeated} by repetition");

    // the file to play is what was planned, and keeps the limits of the model file
    let truth = truth();
    let mut flights = Vec::new();
    for flight in plan["flights"].as_array().unwrap() {
        let wave: Wave = serde_json::from_value(flight["wave"].clone()).unwrap();
        let text = fs::read_to_string(out.join(flight["file"].as_str().unwrap())).unwrap();
        let head: Vec<String> = truth.robot.joints.iter().map(|j| format!("q_{}_rad", j.name)).collect();
        assert_eq!(text.lines().next().unwrap(), format!("time_s,{}", head.join(",")));
        for line in text.lines().skip(1) {
            let row: Vec<f64> = line.split(',').map(|x| x.parse().unwrap()).collect();
            let (q, dq) = wave.at(row[0]);
            for j in 0..4 {
                assert!((q[j] - row[1 + j]).abs() < 1e-6 && q[j].abs() < 2.5 && dq[j].abs() < 16.0, "{line}");
            }
        }
        let turn = Vector3::from_iterator(flight["turn_rad_s"].as_array().unwrap().iter().map(of));
        flights.push((wave, turn));
    }

    // the true robot follows it, with noise of its own
    record(&truth, &flights, 77, &data, "throw_03");
    call(&["run", &robot]);
    let words = with(&["parameters", &robot, "--json"]);
    let after = json(&words.iter().map(String::as_str).collect::<Vec<_>>());
    assert_eq!(after["n_stretches"], 9);
    let base = BaseParameters::of(&truth.model);
    let values = base.regroup(&truth.phi);
    let found = base_of(&after);
    let se = |name: &str| found.iter().find(|f| f.0 == name).unwrap().2;
    let names = || parameters[..worst].iter().map(|p| (p["name"].as_str().unwrap(), of(&p["then"])));
    let reported = middle(names().map(|(name, then)| se(name) / then));
    // the information of the rows that were recorded, in the measure of the plan
    call(&["parameters", &robot, "--assess"]);
    let words = with(&["parameters", &robot, "--json"]);
    let again = json(&words.iter().map(String::as_str).collect::<Vec<_>>());
    let now = again["assessment"]["next_flights"]["parameters"].as_array().unwrap();
    let row_sd = of(&after["row_sd"]) / of(&before["row_sd"]);
    let delivered =
        middle(names().map(|(name, then)| of(&now.iter().find(|p| p["name"] == name).unwrap()["now"]) / then));
    println!(
        "promised {promised:.3} of the present errors (repetition {repeated:.3}); delivered {delivered:.2} times that, \
         {:.2} with the noise that was known before; reported {reported:.2} times",
        delivered / row_sd
    );
    assert!(
        (0.75..1.35).contains(&delivered),
        "expected errors after the flights are {delivered} times the promised ones"
    );
    // reported errors come from the spread among nine flights
    assert!((0.6..2.0).contains(&reported), "reported standard errors are {reported} times the promised ones");
    // and the errors are as small as their standard errors say
    let square: f64 = found.iter().enumerate().map(|(i, f)| ((f.1 - values[i + 1]) / f.2).powi(2)).sum();
    let size = (square / found.len() as f64).sqrt();
    assert!((0.5..1.6).contains(&size), "errors are {size} standard errors");

    // a flight that is too short for rows is no plan, and the message says so
    let short = dir.path().join("short.yaml");
    let text =
        fs::read_to_string(&robot).unwrap().replace("radius_rel: 0.12", "radius_rel: 0.12\n  next_flight_s: 0.1");
    fs::write(&short, text).unwrap();
    let short = short.display().to_string();
    let words = with(&["parameters", &short, "--assess", "--next-flights", &format!("{out_dir}/short")]);
    let (_, said) = expect(&words.iter().map(String::as_str).collect::<Vec<_>>(), 2);
    assert!(unwrapped(said.as_bytes()).contains("long enough for rows (flights of 0.10 s)"), "{said}");

    // nothing is overwritten, and people have no joints to move
    let words = with(&["parameters", &robot, "--assess", "--next-flights", &out_dir]);
    let (_, said) = expect(&words.iter().map(String::as_str).collect::<Vec<_>>(), 2);
    assert!(said.contains("is there already"), "{said}");
    let (_, said) = expect(&["parameters", &repo("pipelines/demo.yaml"), "--assess", "--next-flights", &out_dir], 2);
    assert!(unwrapped(said.as_bytes()).contains("has no `robot`"), "{said}");
}
