//! Tracks and calibrates a folder of recordings and prints the figures.
//!
//! `cargo run --release -p aloft-ik --example measure -- <folder> <marker set> [--motion <out>]
//! [--set option=value]…`
//!
//! The folder holds `static*.c3d` (or `.trc`) and the moving trials. With `--motion`, world
//! positions of all joint centres, frame by frame, are written as text for comparison with other
//! programs.
#![allow(clippy::print_stdout, clippy::unwrap_used, reason = "an example is a program for people at a terminal")]

use aloft_body::{ModelSpec, PersonFacts, Sex, State, Subject};
use aloft_ik::{CalibrateOptions, IkOptions, calibrate, solve};
use aloft_scale::{Anthropometry, PersonInput, ScaleOptions, scale_person};
use aloft_trial::{ImportOptions, MarkerSet, Trial, apply_marker_set};
use std::collections::BTreeMap;
use std::fmt::Write;
use std::path::{Path, PathBuf};
use std::time::Instant;

fn main() {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("../..");
    let read = |path: PathBuf| std::fs::read_to_string(path).unwrap();
    let model: ModelSpec = serde_yaml::from_str(&read(root.join("configs/models/human34.yaml"))).unwrap();
    let set: MarkerSet =
        serde_yaml::from_str(&read(root.join(format!("configs/markersets/{}.yaml", arguments[1])))).unwrap();
    let tables: Anthropometry = serde_yaml::from_str(&read(root.join("configs/anthropometry/de_leva.yaml"))).unwrap();
    let after = |flag: &str| arguments.iter().position(|a| a == flag).map(|i| arguments[i + 1].clone());
    let trials = load(Path::new(&arguments[0]), &set);
    let (statics, moving): (Vec<&Trial>, Vec<&Trial>) = trials.iter().partition(|t| t.name.starts_with("static"));
    let facts = facts(Path::new(&arguments[0]));
    let input =
        PersonInput { facts: &facts, model_spec: &model, marker_set: &set, static_trial: statics[0], frames: None };
    let scaled = scale_person(&input, &tables, &ScaleOptions::default()).unwrap();
    for warning in &scaled.report.warnings {
        println!("  scale: {warning}");
    }
    println!("locked: {:?}", scaled.report.locked);
    let mut ik = IkOptions { locked: scaled.locked.clone(), ..IkOptions::default() };
    let mut options = CalibrateOptions { ik: ik.clone(), ..CalibrateOptions::default() };
    if arguments.iter().any(|a| a == "--scale-priors") {
        for joint in &scaled.report.joints {
            options.joint_sd_m.insert(joint.link.clone(), joint.centre_sd_m);
            if let Some(sd) = joint.axis_sd_rad {
                options.axis_sd_rad.insert(joint.link.clone(), sd);
            }
        }
        println!("joint priors {:?}\naxis priors {:?}", options.joint_sd_m, options.axis_sd_rad);
    }
    let mut held = String::new();
    for setting in arguments.iter().filter_map(|a| a.strip_prefix("--set=")) {
        let (name, value) = setting.split_once(':').unwrap();
        if name == "without" {
            held = value.to_owned();
            continue;
        }
        let number: f64 = value.parse().unwrap();
        match name {
            "frames" => options.frames = number as usize,
            "weight" => options.frame_weight = number,
            "static" => options.static_weight = number,
            "noise" => options.marker_noise_m = number,
            "markers" => options.marker_sd_m = number,
            "axes" => {
                options.axis_sd_rad.clear();
                options.other_axis_sd_rad = number;
            }
            "bridge" => {
                ik.bridge_gaps_s = number;
                options.ik.bridge_gaps_s = number;
            }
            "huber" => options.huber_factor = number,
            "rounds" => options.rounds = number as usize,
            "joints" => options.joint_sd_m.values_mut().for_each(|v| *v *= number),
            "joint_sd" => {
                options.joint_sd_m.clear();
                options.other_joint_sd_m = number;
            }
            _ => println!("unknown setting {name}"),
        }
    }
    let out = after("--motion").map(PathBuf::from);
    let fit = |subject: &Subject, stage: &str| {
        let clock = Instant::now();
        let (mut sum, mut frames) = (0.0, 0);
        for trial in &moving {
            let result = solve(subject, trial, &ik).unwrap();
            let r = &result.report;
            println!(
                "  {:14} {:5} frames, RMS {:6.2} mm, max {:6.1} mm, unsolved {}, unconverged {}, restarts {}, branches {}, {:.1} steps",
                r.trial,
                r.n_frames,
                1e3 * r.rms_m,
                1e3 * r.max_m,
                r.n_unsolved,
                r.n_unconverged,
                r.n_restarts,
                r.n_branch_changes,
                r.mean_iterations
            );
            sum += r.rms_m;
            frames += r.n_frames;
            if let Some(out) = &out {
                write_centres(subject, &result.motion, &out.join(format!("{}_{stage}.txt", trial.name)));
            }
        }
        println!(
            "{stage}: mean RMS {:.2} mm, {:.0} frames/s",
            1e3 * sum / moving.len() as f64,
            frames as f64 / clock.elapsed().as_secs_f64()
        );
    };
    fit(&scaled.subject, "landmarks");
    let used: Vec<&Trial> = moving.iter().copied().filter(|t| held.is_empty() || !t.name.starts_with(&held)).collect();
    let clock = Instant::now();
    let result = calibrate(&scaled.subject, &used, &options).unwrap();
    let r = &result.report;
    println!(
        "calibrated in {:.2} s, {} steps, {} frames: used {:.2} to {:.2} mm, held out {:.2} to {:.2} mm",
        clock.elapsed().as_secs_f64(),
        r.iterations,
        r.frames_used,
        1e3 * r.used_rms_before_m,
        1e3 * r.used_rms_after_m,
        1e3 * r.held_out_rms_before_m,
        1e3 * r.held_out_rms_after_m
    );
    for joint in &r.joints {
        println!(
            "  {:12} moved {:5.1} mm ({:.0} {:.0} {:.0}; sd {:.1}), axis {:.1}° (sd {:.1}°)",
            joint.link,
            1e3 * joint.moved_m,
            1e3 * (joint.calibrated_m.x - joint.landmark_m.x),
            1e3 * (joint.calibrated_m.y - joint.landmark_m.y),
            1e3 * (joint.calibrated_m.z - joint.landmark_m.z),
            1e3 * joint.sd_m,
            joint.axis_turned_rad.unwrap_or(f64::NAN).to_degrees(),
            joint.axis_sd_rad.unwrap_or(f64::NAN).to_degrees()
        );
    }
    if arguments.iter().any(|a| a == "--markers") {
        for marker in &r.markers {
            println!(
                "  {:14} moved {:5.1} mm, RMS {:5.1} to {:5.1} mm",
                marker.label,
                1e3 * marker.moved_m,
                1e3 * marker.rms_before_m,
                1e3 * marker.rms_after_m
            );
        }
    }
    fit(&result.subject, "calibrated");
}

fn load(folder: &Path, set: &MarkerSet) -> Vec<Trial> {
    let mut names: Vec<PathBuf> = std::fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path()).collect();
    names.sort();
    let mut trials = Vec::new();
    for path in names {
        let name = path.file_stem().unwrap_or_default().to_string_lossy().into_owned();
        let mut trial = match path.extension().and_then(|e| e.to_str()) {
            Some("c3d") => Trial::from_c3d(&name, &std::fs::read(&path).unwrap(), &ImportOptions::default()).unwrap(),
            Some("trc") => {
                Trial::from_trc_mot(&name, &std::fs::read_to_string(&path).unwrap(), None, &ImportOptions::default())
                    .unwrap()
            }
            _ => continue,
        };
        apply_marker_set(&mut trial, set, &BTreeMap::new());
        trials.push(trial);
    }
    trials
}

fn facts(folder: &Path) -> PersonFacts {
    let text = std::fs::read_to_string(folder.join("subject.yaml")).ok().unwrap_or_default();
    let value: serde_yaml::Value = serde_yaml::from_str(&text).unwrap();
    PersonFacts {
        name: "person".to_owned(),
        sex: value.get("sex").and_then(|v| v.as_str()).map(|s| if s == "F" { Sex::Female } else { Sex::Male }),
        height_m: value.get("height_m").and_then(serde_yaml::Value::as_f64),
        mass_kg: value.get("mass_kg").and_then(serde_yaml::Value::as_f64).unwrap_or(60.05),
    }
}

fn write_centres(subject: &Subject, motion: &aloft_body::Motion, path: &Path) {
    let mut state = State::new(&subject.model);
    let mut text = String::new();
    for link in &subject.model.links {
        let _ = write!(text, "{} ", link.name);
    }
    text.push('\n');
    for frame in 0..motion.n_frames() {
        if motion.is_valid(frame) {
            state.forward_position(&subject.model, motion.q(frame));
        }
        for pose in &state.world_from_link {
            let p = pose.translation.vector;
            let nan = if motion.is_valid(frame) { 0.0 } else { f64::NAN };
            let _ = write!(text, "{:.6} {:.6} {:.6} ", p.x + nan, p.y + nan, p.z + nan);
        }
        text.push('\n');
    }
    std::fs::write(path, text).unwrap();
}
