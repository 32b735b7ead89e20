//! A robot: from logs and a model file with wrong inertias to the same file with identified ones.

use crate::support::{aloft, expect, folder, json, repo, unwrapped};
use std::fs;
use std::io::Read as _;
use std::path::{Path, PathBuf};
use std::process::Output;
use tempfile::TempDir;

pub fn copy(from: &Path, to: &Path) {
    fs::create_dir_all(to).unwrap();
    for entry in fs::read_dir(from).unwrap() {
        let path = entry.unwrap().path();
        let target = to.join(path.file_name().unwrap());
        if path.is_dir() {
            copy(&path, &target)
        } else {
            let _ = fs::copy(&path, &target).unwrap();
        }
    }
}

/// The laboratory of the robot in a folder of its own, in which a test may change files.
struct Lab {
    dir: TempDir,
    data: PathBuf,
}

impl Lab {
    fn new() -> Self {
        let dir = folder();
        let data = dir.path().join("lab");
        copy(Path::new(&repo("fixtures/robot")), &data);
        Self { dir, data }
    }
    fn workspace(&self) -> PathBuf {
        self.dir.path().join("ws")
    }
    /// Words of a command about this laboratory: the pipeline comes after the verb.
    fn words(&self, verb: &[&str], rest: &[&str]) -> Vec<String> {
        let (data, ws) = (self.data.display().to_string(), self.workspace().display().to_string());
        let places = ["--data", &data, "--workspace", &ws];
        [verb, &[&repo("pipelines/robot.yaml")], rest, &places].concat().iter().map(|w| (*w).to_owned()).collect()
    }
    fn try_to(&self, verb: &[&str], rest: &[&str]) -> Output {
        let words = self.words(verb, rest);
        aloft(&words.iter().map(String::as_str).collect::<Vec<_>>())
    }
    /// What a command told on both streams; it ends with `code`.
    fn call(&self, verb: &[&str], rest: &[&str], code: i32) -> String {
        let words = self.words(verb, rest);
        let (told, said) = expect(&words.iter().map(String::as_str).collect::<Vec<_>>(), code);
        told + &said
    }
    fn json(&self, verb: &[&str]) -> serde_json::Value {
        let words = self.words(verb, &["--json"]);
        json(&words.iter().map(String::as_str).collect::<Vec<_>>())
    }
    /// A result in the workspace.
    fn result(&self, file: &str) -> String {
        fs::read_to_string(self.workspace().join(file)).unwrap()
    }
    /// Rewrites a recording's log, unpacked.
    fn rewrite_log(&self, trial: &str, change: &dyn Fn(&str) -> String) {
        let packed = self.data.join(format!("{trial}_robot.csv.gz"));
        let mut text = String::new();
        let bytes = fs::read(&packed).unwrap();
        flate2::read::GzDecoder::new(bytes.as_slice()).read_to_string(&mut text).unwrap();
        fs::remove_file(&packed).unwrap();
        fs::write(self.data.join(format!("{trial}_robot.csv")), change(&text)).unwrap();
    }
    /// Changes the values of a recording's log: `change` gets the column and the value.
    fn change_log(&self, trial: &str, change: &dyn Fn(&str, f64) -> f64) {
        self.rewrite_log(trial, &|text| changed(text, change));
    }
    /// The same for the recording of the base.
    fn change_base(&self, trial: &str, change: &dyn Fn(&str, f64) -> f64) {
        let file = self.data.join(format!("{trial}_base.csv"));
        fs::write(&file, changed(&fs::read_to_string(&file).unwrap(), change)).unwrap();
    }
    /// Replaces a text in the robot's description.
    fn describe(&self, from: &str, to: &str) {
        let file = self.data.join("robot.yaml");
        let text = fs::read_to_string(&file).unwrap();
        assert!(text.contains(from));
        fs::write(&file, text.replacen(from, to, 1)).unwrap();
    }
}

fn changed(text: &str, change: &dyn Fn(&str, f64) -> f64) -> String {
    let head: Vec<&str> = text.lines().next().unwrap().split(',').collect();
    let rows = text.lines().enumerate().map(|(i, line)| {
        let fields = line.split(',').zip(&head).map(|(f, name)| match f.parse::<f64>() {
            Ok(x) if i > 0 => {
                let y = change(name, x);
                if y == x { f.to_owned() } else { format!("{y:.9}") }
            }
            _ => f.to_owned(),
        });
        fields.collect::<Vec<_>>().join(",") + "\n"
    });
    rows.collect()
}

#[test]
fn a_robot_goes_from_logs_to_a_patched_model_file() {
    let dir = folder();
    let ws = dir.path().join("ws").display().to_string();
    let robot = repo("pipelines/robot.yaml");
    expect(&["run", &robot, "--workspace", &ws], 0);
    let truth: serde_json::Value =
        serde_json::from_str(&fs::read_to_string(repo("fixtures/robot/truth.json")).unwrap()).unwrap();

    // flights and clocks, which nobody told
    for trial in ["throw_01", "throw_02"] {
        let told = &truth["recordings"][trial];
        let read = |file: &str| -> serde_json::Value {
            serde_json::from_str(&fs::read_to_string(format!("{ws}/{file}")).unwrap()).unwrap()
        };
        let fusion = read(&format!("ik/{trial}/fusion.json"));
        let offset = fusion["clock_offset_s"].as_f64().unwrap();
        assert!((offset - told["clock_offset_s"].as_f64().unwrap()).abs() < 1e-4, "{trial}: {offset}");
        let report = read(&format!("flight/{trial}/flights.json"));
        let flights = report["flights"].as_array().unwrap();
        assert_eq!(flights.len(), 3);
        for (flight, true_flight) in flights.iter().zip(told["flights_s"].as_array().unwrap()) {
            let at = |key: &str| flight[key].as_f64().unwrap() / 250.0;
            let (start, end) = (true_flight[0].as_f64().unwrap(), true_flight[1].as_f64().unwrap());
            assert!(at("start") >= start && at("end") <= end + 0.004 && at("end") - at("start") > 0.4, "{flight}");
        }
    }

    let found = json(&["parameters", &robot, "--workspace", &ws, "--json"]);
    for link in found["links"].as_array().unwrap() {
        let (name, of) = (link["name"].as_str().unwrap(), |v: &serde_json::Value| v.as_f64().unwrap());
        let told = &truth["links"][name];
        let mass = of(&told["mass_kg"]);
        let ci = &link["ci95"]["mass_kg"];
        assert!(of(&ci[0]) < mass && mass < of(&ci[1]), "{name}: {mass} kg outside {ci}");
        let distance = |com: &serde_json::Value| -> f64 {
            (0..3).map(|k| (of(&com[k]) - of(&told["com_m"][k])).powi(2)).sum::<f64>().sqrt()
        };
        let (now, before) = (distance(&link["com_m"]), distance(&link["prior"]["com_m"]));
        assert!(now < 0.006 && now < before, "{name}: centre of mass {now} m off, {before} m before");
    }

    // model against motion: the nominal model's error falls by more than ten times
    let compared = json(&["compare", &robot, "--workspace", &ws, "--json"]);
    assert!(compared["flight"]["residual_force_n"]["rms"][0].is_number());
    let ladder = json(&["history", &robot, "--workspace", &ws, "--json"]);
    let rung = &ladder["revisions"][0];
    let (error, floor) = (rung["held_out_error"].as_f64().unwrap(), rung["noise_floor"].as_f64().unwrap());
    assert!(error < 3.0 * floor, "{error} N at a floor of {floor} N");

    // the joints: friction, reflected inertia and gains from the torques
    let joints: serde_json::Value =
        serde_json::from_str(&fs::read_to_string(format!("{ws}/identify/_study/joints.json")).unwrap()).unwrap();
    for joint in joints["joints"].as_array().unwrap() {
        let name = joint["name"].as_str().unwrap();
        let value = |key: &str| joint[key]["value"].as_f64().unwrap();
        let told = |key: &str| truth["joints"][name][key].as_f64().unwrap();
        assert!((value("armature") / told("armature") - 1.0).abs() < 0.15, "{joint}");
        assert!((value("damping") - told("damping")).abs() < 0.03, "{joint}");
        assert!((value("friction") - told("friction")).abs() < 0.04, "{joint}");
        assert!((value("gain") - truth["gains"][name].as_f64().unwrap()).abs() < 0.03, "{joint}");
    }

    let out = dir.path().join("out");
    expect(&["export", &robot, "--workspace", &ws, "--format", "urdf,mjcf", "--out", &out.display().to_string()], 0);
    for end in ["urdf", "xml"] {
        let before = fs::read_to_string(repo(&format!("fixtures/robot/model/nominal.{end}"))).unwrap();
        let after = fs::read_to_string(out.join(format!("Models/nominal_identified.{end}"))).unwrap();
        assert!(after.contains("<!-- inertias from drawings -->") && after.contains("6 flights in 2 recordings"));
        // lines without inertials are those of the file
        let quiet = |text: &str| -> Vec<String> {
            let keep = |l: &&str| !l.contains("inertial") && !l.contains(" kg");
            text.lines().filter(keep).map(str::to_owned).collect()
        };
        let left: Vec<String> = quiet(&after).into_iter().filter(|l| quiet(&before).contains(l)).collect();
        assert_eq!(left, quiet(&before));
    }
}

#[test]
fn init_writes_the_pipeline_of_a_robot() {
    let lab = Lab::new();
    let out = lab.dir.path().join("mine.yaml").display().to_string();
    let data = lab.data.display().to_string();
    let _ = expect(&["init", &data, "--out", &out], 0);
    let (told, said) = expect(&["run", &out, "--workspace", &lab.workspace().display().to_string()], 0);
    assert!((told + &said).contains("6 flights in 2 trials"));
    // logs without a description: what to write, with the model file that is there
    fs::remove_file(lab.data.join("robot.yaml")).unwrap();
    let (_, said) = expect(&["init", &data, "--out", &lab.dir.path().join("other.yaml").display().to_string()], 2);
    let said = unwrapped(said.as_bytes());
    assert!(said.contains("nothing says which robot") && said.contains("total_mass_kg"), "{said}");
    assert!(said.contains("model/"), "{said}");
}

#[test]
fn a_log_without_a_joint_fails_with_one_line_that_names_it() {
    let lab = Lab::new();
    let rows: String = (0..20).map(|i| format!("{},0,0,0\n", 0.004 * f64::from(i))).collect();
    let head = "time_s,q_l_shoulder_rad,q_l_elbow_rad,q_r_shoulder_rad";
    lab.rewrite_log("throw_01", &|_| format!("{head}\n{rows}"));
    let told = lab.call(&["run"], &[], 1);
    let told: Vec<&str> = told.lines().filter(|l| l.contains("r_elbow")).collect();
    assert!(!told.is_empty() && told[0].contains("throw_01_robot.csv"), "{told:?}");
}

/// Each fault is one line that names file, what was found and what was expected; the other
/// recording goes on.
#[test]
fn units_and_a_stuck_encoder_are_named() {
    type Change = fn(&str, f64) -> f64;
    let faults: [(bool, Change, &str); 6] = [
        (true, |n, x| if n == "time_s" { 1e3 * x } else { x }, "`time_s` steps by 4 from row to row, expected seconds"),
        (true, |n, x| if n == "time_s" { 1e9 * x } else { x }, "from row to row, expected seconds"),
        (false, |n, x| if n == "time_s" { 1e3 * x } else { x }, "throw_01_base.csv: `time_s` steps by"),
        (
            true,
            |n, x| if n == "q_l_elbow_rad" { 0.3 } else { x },
            "the position of the joint `l_elbow` stays within 0.0e0 while its rate reaches",
        ),
        (true, |n, x| if n.starts_with("acc_") { x / 9.81 } else { x }, "in g, expected m/s²"),
        (
            false,
            |n, x| if n.ends_with("_m") { 1e3 * x } else { x },
            "expected at most 500 m in one recording: millimetres?",
        ),
    ];
    for (in_log, change, expected) in faults {
        let lab = Lab::new();
        if in_log {
            lab.change_log("throw_01", &change)
        } else {
            lab.change_base("throw_01", &change)
        }
        let told = unwrapped(lab.call(&["run"], &[], 1).as_bytes());
        assert!(told.contains(expected) && told.contains("failed: import throw_01"), "expected {expected}: {told}");
    }
}

#[test]
fn slips_in_the_description_are_named() {
    for (from, to, expected) in [
        ("total_mass_kg", "total_mas_kg", "unknown key `total_mas_kg`"),
        ("acc_m_s2", "acc_ms2", "unknown key `acc_ms2` in `noise`"),
        (
            "imu: {link: trunk",
            "imu: {link: chest",
            "the inertial unit is on the link `chest`, which is not in the model",
        ),
    ] {
        let lab = Lab::new();
        lab.describe(from, to);
        let said = lab.try_to(&["run"], &[]);
        let told = unwrapped(&[said.stdout, said.stderr].concat());
        assert!(!said.status.success() && told.contains(expected), "expected {expected}: {told}");
    }
    // what the laboratory notes for itself is its own business
    let lab = Lab::new();
    lab.describe("total_mass_kg", "operator: Ann\nbattery_v: 48\ntotal_mass_kg");
    lab.call(&["run"], &[], 0);
}

/// Inertias of a model that the recordings contradict are not handed on as if they were good.
#[test]
fn inertias_of_a_contradicted_model_are_marked() {
    let lab = Lab::new();
    // left and right exchanged in every column of both shoulders
    let swap = |s: &str| s.replace("l_shoulder", "#").replace("r_shoulder", "l_shoulder").replace('#', "r_shoulder");
    for trial in ["throw_01", "throw_02"] {
        lab.rewrite_log(trial, &|text| {
            let (head, rows) = text.split_once('\n').unwrap();
            format!("{}\n{rows}", swap(head))
        });
    }
    lab.call(&["run"], &[], 0);
    let out = lab.dir.path().join("out");
    lab.call(&["export"], &["--format", "urdf", "--out", &out.display().to_string()], 0);
    let written = fs::read_to_string(out.join("Models/nominal_identified.urdf")).unwrap();
    assert!(written.contains("CAUTION: the held-out error in flight is"), "{written}");
}

/// A recording without a column for a joint has a reason of its own, and a base whose vertical is
/// not z is an error of one line.
#[test]
fn a_missing_joint_and_another_vertical_are_named() {
    let lab = Lab::new();
    lab.rewrite_log("throw_01", &|text| text.replace("q_l_elbow_rad", "angle_7"));
    let told = lab.call(&["run"], &["--details"], 1);
    assert!(told.contains("no column for the joint `l_elbow`"), "{told}");
    let table = lab.result("summary.csv");
    assert!(table.contains("missing_joint") && !table.contains("unreadable_file"), "{table}");
    for (text, axis) in [("time_s,x_m,z_m,y_m", "−y"), ("time_s,z_m,y_m,x_m", "−x")] {
        let lab = Lab::new();
        for trial in ["throw_01", "throw_02"] {
            let file = lab.data.join(format!("{trial}_base.csv"));
            let base = fs::read_to_string(&file).unwrap();
            assert!(base.contains("time_s,x_m,y_m,z_m"), "{}", &base[..60]);
            fs::write(&file, base.replace("time_s,x_m,y_m,z_m", text)).unwrap();
        }
        let told = lab.call(&["run"], &["--details"], 1);
        let expected = format!("m/s² towards {axis}, expected towards −z: the vertical is not z");
        assert!(unwrapped(told.as_bytes()).contains(&expected), "{told}");
    }
}

#[test]
fn torques_in_other_units_and_a_wrong_mass_are_named() {
    for (factor, expected) in [
        (1000.0, "those that the motion needs, expected N·m"),
        (-1.0, "the torques have the opposite sign of those that the motion needs"),
    ] {
        let lab = Lab::new();
        for trial in ["throw_01", "throw_02"] {
            lab.change_log(trial, &|name, x| if name.starts_with("tau") { x * factor } else { x });
        }
        let told = lab.call(&["run"], &["--details"], 0);
        assert!(told.contains(expected), "{factor}: {told}");
        // the base rows need no torque
        assert!(!lab.workspace().join("identify/_study/joints.json").exists());
    }
    let lab = Lab::new();
    lab.describe("total_mass_kg: 5.400", "total_mass_kg: 5400");
    let told = lab.call(&["run"], &["--details"], 1);
    assert!(told.contains("weighs 5400 kg, and the links of model/nominal.urdf weigh 5.42 kg together"), "{told}");
    // a quarter too heavy: the torques do not agree
    lab.describe("total_mass_kg: 5400", "total_mass_kg: 6.75");
    let told = lab.call(&["run"], &["--details"], 0);
    assert!(told.contains("too small for a robot of 6.75 kg"), "{told}");
}

/// The encoder of one shoulder reads 0.05 rad too much in every recording: the search names it and
/// its size.
#[test]
fn an_encoder_with_a_wrong_zero_is_found() {
    let lab = Lab::new();
    for trial in ["throw_01", "throw_02"] {
        lab.change_log(trial, &|name, x| if name == "q_l_shoulder_rad" { x + 0.05 } else { x });
    }
    lab.call(&["run"], &[], 0);
    let found = lab.json(&["discover"]);
    assert_eq!(found["found"][0]["key"], "encoder_offset[l_upper]", "{}", found["words"]);
    let ranked = found["candidates"].as_array().unwrap();
    assert_eq!(ranked[0]["key"], "encoder_offset[l_upper]", "{}", ranked[0]);
    let (share, next) = (&ranked[0]["held_out_ratio"], &ranked[1]["held_out_ratio"]);
    assert!(share.as_f64().unwrap() < 0.6 && next.as_f64().unwrap() > 0.85, "{share} {next}");
    let coefficient = &ranked[0]["coefficients"][0];
    let value = coefficient["value"].as_f64().unwrap();
    assert!((value - 0.05).abs() < 0.01, "{coefficient}");
}

/// ∫ (h² − (y − c)²) dm along the y axis of a link, kg·m²: positive for mass inside a box of half
/// width `h` about `c`.
fn inside(link: &serde_json::Value, centre_m: f64, half_m: f64) -> f64 {
    let of = |v: &serde_json::Value| v.as_f64().unwrap();
    let (mass, y) = (of(&link["mass_kg"]), of(&link["com_m"][1]) - centre_m);
    let moment = |k: usize| of(&link["inertia_kgm2"][k][k]);
    let about_com = 0.5 * (moment(0) + moment(2) - moment(1));
    mass * (half_m * half_m - y * y) - about_com
}

#[test]
fn inertias_stay_inside_the_collision_geometry() {
    let dir = folder();
    let data = dir.path().join("data");
    copy(Path::new(&repo("fixtures/robot")), &data);
    let pipeline = dir.path().join("robot.yaml");
    let text = fs::read_to_string(repo("pipelines/robot.yaml")).unwrap().replace("../fixtures/robot", "data");
    fs::write(&pipeline, &text).unwrap();
    let model = data.join("model/nominal.urdf");
    let plain = fs::read_to_string(&model).unwrap();
    // a box that the nominal lower arm fits into and the identified one does not; one that the
    // nominal upper arm does not fit into; a mesh
    let (centre, half) = (0.013, 0.0162);
    let solid = |y: f64, size: &str| {
        format!("<collision><origin xyz=\"0.02 {y} -0.1\"/><geometry><box size=\"{size}\"/></geometry></collision>")
    };
    let mesh = "<collision><geometry><mesh filename=\"arm.stl\"/></geometry></collision>".to_owned();
    let mut with = plain;
    for (link, shape) in [
        ("l_lower", solid(centre, &format!("0.2 {} 0.4", 2.0 * half))),
        ("l_upper", solid(0.0, "0.1 0.1 0.02")),
        ("r_upper", mesh),
        ("trunk", solid(0.0, "0.6 0.6 0.9")),
    ] {
        let head = format!("<link name=\"{link}\">");
        assert!(with.contains(&head));
        with = with.replace(&head, &format!("{head}{shape}"));
    }
    fs::write(&model, with).unwrap();
    let path = pipeline.display().to_string();
    let links = |workspace: &str| {
        let ws = dir.path().join(workspace).display().to_string();
        expect(&["run", &path, "--workspace", &ws], 0);
        json(&["parameters", &path, "--workspace", &ws, "--json"])["links"].clone()
    };
    let of = |links: &serde_json::Value, name: &str| {
        links.as_array().unwrap().iter().find(|l| l["name"] == name).unwrap().clone()
    };
    let free = links("free");
    assert!(inside(&of(&free, "l_lower"), centre, half) < 0.0, "{}", of(&free, "l_lower"));

    let limits = "\nrobot:\n  inertia_limits: collision\n  limits_margin_m: 0.0\n";
    fs::write(&pipeline, text.replacen("\nrobot:\n", limits, 1)).unwrap();
    let limited = links("limited");
    let arm = of(&limited, "l_lower");
    assert!(inside(&arm, centre, half) > 0.0, "{arm}");
    // a limit on one link changes the others little: motion determines them
    let mass = |l: &serde_json::Value| l["mass_kg"].as_f64().unwrap();
    for other in ["trunk", "r_lower"] {
        let (a, b) = (mass(&of(&free, other)), mass(&of(&limited, other)));
        assert!((a / b - 1.0).abs() < 0.05, "{other}: {a} {b}");
    }
    let manifest = fs::read_to_string(dir.path().join("limited/scale/_study/manifest.json")).unwrap();
    let told = "the inertia in nominal.urdf does not fit into the collision geometry of l_upper: no limit is set there";
    let shown = manifest.replace("model/nominal.urdf", "nominal.urdf");
    assert!(shown.contains(told), "{manifest}");
    assert!(manifest.contains("\"links_with_limits\": 2"), "{manifest}");
}

/// A couple on the root passes through no joint: the joints are still identified beside it. A joint
/// whose torque has the wrong sign is named.
#[test]
fn joints_are_identified_beside_a_flywheel_in_the_root() {
    let lab = Lab::new();
    for trial in ["throw_01", "throw_02"] {
        lab.change_log(trial, &|name, x| if name == "tau_meas_l_elbow_nm" { -x } else { x });
    }
    lab.call(&["run"], &[], 0);
    let manifest = lab.result("identify/_study/manifest.json");
    let told = "the torque of the joint `l_elbow` has the opposite sign of what its motion needs";
    assert!(manifest.contains(told) && manifest.matches("opposite sign").count() == 1, "{manifest}");
    lab.call(&["effect", "add"], &["flywheel[trunk]"], 0);
    let fit: serde_json::Value = serde_json::from_str(&lab.result("identify/_study/joints.json")).unwrap();
    assert_eq!(fit["joints"].as_array().unwrap().len(), 4);
    let friction = fit["joints"][0]["friction"]["value"].as_f64().unwrap();
    assert!((friction - 0.12).abs() < 0.05, "{friction}");
}
