//! A laboratory with an OpenSim model: from `init` to the same file with identified inertias.
//! `fixtures/osim` holds flights that OpenSim simulated with another body's inertias.

use crate::support::{aloft, expect, folder, json, repo, unwrapped};
use std::collections::BTreeMap;
use std::fs;
use std::path::Path;

fn lab(at: &Path) {
    for entry in fs::read_dir(repo("fixtures/osim")).unwrap() {
        let path = entry.unwrap().path();
        if path.is_file() {
            let _ = fs::copy(&path, at.join(path.file_name().unwrap())).unwrap();
        }
    }
}

/// Mass and centre of mass of every body of a model.
fn bodies(text: &str) -> BTreeMap<String, (f64, Vec<f64>)> {
    let between = |text: &str, a: &str, b: &str| -> Option<String> {
        let start = text.find(a)? + a.len();
        Some(text[start..start + text[start..].find(b)?].to_owned())
    };
    text.split("<Body name=\"")
        .skip(1)
        .map(|part| {
            let name = part.split('"').next().unwrap().to_owned();
            let mass = between(part, "<mass>", "</mass>").unwrap().trim().parse().unwrap();
            let com = between(part, "<mass_center>", "</mass_center>").unwrap();
            (name, (mass, com.split_whitespace().map(|w| w.parse().unwrap()).collect()))
        })
        .collect()
}

/// Centre of mass of the body in one posture would need the joints: that of the torso stands for
/// it.
fn off(found: &BTreeMap<String, (f64, Vec<f64>)>, truth: &BTreeMap<String, (f64, Vec<f64>)>, body: &str) -> f64 {
    let moment = |b: &(f64, Vec<f64>)| b.1.iter().map(|c| c * b.0).collect::<Vec<f64>>();
    let (a, b) = (moment(&found[body]), moment(&truth[body]));
    a.iter().zip(&b).map(|(a, b)| (a - b).powi(2)).sum::<f64>().sqrt()
}

#[test]
fn an_opensim_model_goes_from_a_folder_to_the_same_file_with_identified_inertias() {
    let dir = folder();
    let data = dir.path().join("lab");
    fs::create_dir(&data).unwrap();
    lab(&data);
    let at = |name: &str| dir.path().join(name).display().to_string();
    let (pipeline, ws, out) = (at("lab.yaml"), at("ws"), at("out"));
    expect(&["init", &data.display().to_string(), "--out", &pipeline], 0);
    let text = fs::read_to_string(&pipeline).unwrap();
    assert!(text.contains("model: body.osim   # 36 of its 36 markers are in the recordings"), "{text}");
    assert!(!text.lines().any(|l| l.starts_with("marker_set:")), "{text}");
    // nothing has to be typed: the mass is the file's
    expect(&["run", &pipeline, "--workspace", &ws], 0);
    let words = |args: &[&str]| json(&[args, &["--workspace", &ws, "--json"]].concat());

    // held-out flights: from the file's inertias to the identified ones, against the noise floor
    let history = words(&["history", &pipeline]);
    let rung = &history["revisions"][0];
    // 42 N with the file's own inertias
    let (error, floor) = (rung["held_out_error"].as_f64().unwrap(), rung["noise_floor"].as_f64().unwrap());
    assert!(error < 2.0 * floor, "{error} N at a floor of {floor} N");
    let found = words(&["parameters", &pipeline]);
    let mass: f64 = found["links"].as_array().unwrap().iter().map(|l| l["mass_kg"].as_f64().unwrap()).sum();
    assert!((mass - 72.0).abs() < 0.01, "{mass}");
    let verdict = words(&["discover", &pipeline]);
    assert_ne!(verdict["verdict"], "supported", "{}", verdict["effects"]);

    // the file comes back with other inertias, nearer to those that were simulated
    expect(&["export", &pipeline, "--workspace", &ws, "--to", &out, "--format", "osim,mot,trc"], 0);
    let original = fs::read_to_string(data.join("body.osim")).unwrap();
    let patched = fs::read_to_string(format!("{out}/Models/body_identified.osim")).unwrap();
    let (before, after) = (bodies(&original), bodies(&patched));
    let truth = bodies(&fs::read_to_string(repo("fixtures/osim/truth/true.osim")).unwrap());
    assert_eq!(before.len(), after.len());
    let sum = |b: &BTreeMap<String, (f64, Vec<f64>)>| b.keys().map(|n| off(b, &truth, n)).sum::<f64>();
    assert!(sum(&after) < 0.8 * sum(&before), "first moments off by {} kg m, {} before", sum(&after), sum(&before));
    let rest = |text: &str| {
        let inertial = |l: &&str| !["<mass>", "<mass_center>", "<inertia>"].iter().any(|e| l.trim().starts_with(e));
        text.lines().filter(inertial).map(str::to_owned).collect::<Vec<_>>()
    };
    let (old, new) = (rest(&original), rest(&patched));
    let comment = new.len() - old.len();
    assert_eq!(old[0], new[0]);
    assert_eq!(old[1..], new[1 + comment..], "something else changed");
    assert!(patched.contains("Inertials identified by aloft"));

    // the motion is in the file's own coordinates, and they are those that were simulated
    let mot = fs::read_to_string(format!("{out}/IK/throw_01_ik.mot")).unwrap();
    let mut lines = mot.lines().skip_while(|l| l.trim() != "endheader").skip(1);
    let names: Vec<&str> = lines.next().unwrap().split('\t').map(str::trim).collect();
    let rows: Vec<Vec<f64>> = lines.map(|l| l.split('\t').map(|w| w.trim().parse().unwrap()).collect()).collect();
    let told = fs::read_to_string(repo("fixtures/osim/truth/throw_01.tsv")).unwrap();
    let mut told = told.lines();
    let true_names: Vec<&str> = told.next().unwrap().split('\t').collect();
    let true_rows: Vec<Vec<f64>> = told.map(|l| l.split('\t').map(|w| w.parse().unwrap()).collect()).collect();
    assert_eq!(rows.len(), true_rows.len());
    for (i, name) in true_names.iter().enumerate().skip(1) {
        let k = names.iter().position(|n| n == name).unwrap();
        let length = name.starts_with("pelvis_t") && name.len() == 9;
        let turn = if length { 1.0 } else { 1.0_f64.to_degrees() };
        let squares = rows.iter().zip(&true_rows).map(|(a, b)| (a[k] - turn * b[i]).powi(2));
        let rms = (squares.sum::<f64>() / rows.len() as f64).sqrt();
        assert!(rms < if length { 0.001 } else { 0.5 }, "{name}: {rms}");
    }

    let (report, _) = expect(&["report", &pipeline, "--workspace", &ws], 0);
    assert!(report.contains("report.html"));
}

#[test]
fn what_does_not_fit_an_opensim_model_is_refused_with_its_place() {
    let dir = folder();
    lab(dir.path());
    let pipeline = dir.path().join("p.yaml").display().to_string();
    let refused = |text: &str| {
        let whole = format!("name: p\ndata: .\n{text}trials:\n  identify: [\"throw*.trc\"]\n");
        fs::write(&pipeline, whole).unwrap();
        let done = aloft(&["check", &pipeline]);
        let said = unwrapped(&done.stderr);
        assert_eq!(done.status.code(), Some(2), "{text}: {said}");
        said
    };
    let said = refused("model: body.osim\nmarker_set: plug-in-gait\n");
    assert!(said.contains("`marker_set` beside the OpenSim model"), "{said}");
    assert!(refused("model: nobody.osim\n").contains("there is no such file"));
    let said = refused("model: body.osim\nsubject: {mass_kg: 30}\n");
    assert!(said.contains("its bodies weigh 72.0 kg, and the subject weighs 30.0 kg"), "{said}");

    let original = fs::read_to_string(dir.path().join("body.osim")).unwrap();
    let put = |name: &str, text: String| fs::write(dir.path().join(name), text).unwrap();
    put(
        "odd.osim",
        original
            .replace("<PinJoint name=\"ankle_r\">", "<ScapulothoracicJoint name=\"ankle_r\">")
            .replacen("</PinJoint>", "</ScapulothoracicJoint>", 1)
            .replace("SimmSpline", "PiecewiseConstantFunction"),
    );
    let said = refused("model: odd.osim\n");
    assert!(said.contains("the joint `ankle_r` of the kind ScapulothoracicJoint"), "{said}");
    assert!(said.contains("PiecewiseConstantFunction in the joint `knee_r`"), "{said}");
    assert!(said.contains("in the joint `knee_l`"), "all parts are named: {said}");
    put("bare.osim", original.split("<MarkerSet").next().unwrap().to_owned() + "</Model></OpenSimDocument>");
    let said = refused("model: bare.osim\n");
    assert!(said.contains("0 markers on its bodies"), "{said}");
    put("cut.osim", original[..original.len() / 2].to_owned());
    assert!(refused("model: cut.osim\n").contains("cut.osim"));
    put("heavy.osim", original.replacen("<mass>", "<mass>-", 1));
    assert!(refused("model: heavy.osim\n").contains("without mass, mass_center or inertia"));
}
