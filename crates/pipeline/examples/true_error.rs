//! Prints the error that a model with the true parameters leaves on a simulated laboratory, over
//! the windows of the stage `compare`: markers as measured, geometry, marker places and link
//! parameters of `truth/truth.json`.
//!
//! `cargo run --release -p aloft-pipeline -p aloft-cli --example true_error -- PIPELINE DATA
//! WORKSPACE`, after `aloft run PIPELINE --data DATA --workspace WORKSPACE`. Used by
//! `benches/floor.py`.
#![allow(clippy::print_stdout, reason = "an example is a program for people at a terminal")]

use aloft_body::{BaseParameters, JointKind, LinkInertia, Motion, Phi, Subject};
use aloft_compare::{Body, Candidate, CompareOptions, Noise, compare};
use aloft_filter::smooth;
use aloft_pipeline::results::Results;
use aloft_pipeline::stages::compare::{ComparedTrial, HeldOut, Params, compare_options, has_validation};
use aloft_pipeline::stages::filter::low_pass;
use aloft_pipeline::stages::ik::track;
use aloft_pipeline::trial_rows::TrialRows;
use aloft_study::calendar::Calendar;
use aloft_study::subject_session::{Overrides, SubjectSession};
use aloft_workspace::workspace::Workspace;
use nalgebra::{Isometry3, Quaternion, Translation3, UnitQuaternion, Vector3};
use rayon::prelude::*;
use serde_json::{Value, json};
use std::error::Error;
use std::path::{Path, PathBuf};

/// Places in [`Phi`] of the truth's ten numbers.
const ORDER: [usize; 10] = [0, 1, 2, 3, 4, 9, 5, 8, 7, 6];

fn numbers<const N: usize>(value: &Value) -> Result<[f64; N], Box<dyn Error>> {
    let all: Vec<f64> = serde_json::from_value(value.clone())?;
    all.try_into().map_err(|v: Vec<f64>| format!("{} numbers instead of {N}", v.len()).into())
}

/// The subject with the geometry, the marker places and the link parameters of the truth.
fn with_truth(mut subject: Subject, truth: &Value) -> Result<(Subject, Vec<Phi>), Box<dyn Error>> {
    let links = truth["links"].as_array().ok_or("no links in the truth")?;
    let mut phi = Vec::new();
    for link in &mut subject.model.links {
        let known =
            links.iter().find(|l| l["name"] == *link.name).ok_or(format!("`{}` is not in the truth", link.name))?;
        if link.parent.is_some() {
            let [x, y, z, w] = numbers(&known["rotation_xyzw"])?;
            let turn = UnitQuaternion::from_quaternion(Quaternion::new(w, x, y, z));
            link.joint.parent_from_joint =
                Isometry3::from_parts(Translation3::from(numbers::<3>(&known["offset"])?), turn);
        }
        if let (JointKind::Revolute(_), Some("revolute_z")) = (&link.joint.kind, known["joint"].as_str()) {
            link.joint.kind = JointKind::Revolute(Vector3::z_axis());
        }
        let mut own = Phi::zeros();
        numbers::<10>(&known["phi"])?.iter().zip(ORDER).for_each(|(x, place)| own[place] = *x);
        phi.push(own);
    }
    for marker in &mut subject.markers {
        let (link, place): (String, [f64; 3]) = serde_json::from_value(truth["markers"][&marker.label].clone())?;
        marker.link = subject.model.links.iter().position(|l| l.name == link).ok_or("a marker on an unknown link")?;
        marker.position_m = Vector3::from(place);
    }
    subject.prior = phi.iter().map(LinkInertia::from_phi).collect();
    Ok((subject, phi))
}

fn main() -> Result<(), Box<dyn Error>> {
    let arguments: Vec<PathBuf> = std::env::args_os().skip(1).map(PathBuf::from).collect();
    let [pipeline, data, workspace] = arguments.as_slice() else { return Err("PIPELINE DATA WORKSPACE".into()) };
    let overrides = Overrides { data: Some(data.clone()), workspace: Some(workspace.clone()), ..Overrides::default() };
    let session = SubjectSession::open(pipeline, &overrides)?;
    let ws = Workspace::open(&session.workspace);
    let results = Results::of(&ws);
    let params = Params::of(&session);
    let truth: Value = serde_json::from_slice(&std::fs::read(Path::new(data).join("truth/truth.json"))?)?;
    let (subject, phi) = with_truth(results.load_subject("calibrate").map_err(|e| e.problem)?, &truth)?;
    let base = BaseParameters::of(&subject.model);
    let wanted = |name: &str| ws.usable("regressor", name).is_ok_and(|m| m.is_some());
    let entries: Vec<_> = session.included().filter(|t| t.role.is_dynamic() && wanted(&t.name)).collect();
    let names: Vec<String> = entries.iter().map(|t| t.name.clone()).collect();
    let zeros = aloft_pipeline::plate_zeros::SessionZeros::new(results, &names);
    let filter = low_pass(&params.filter);
    let again = |m: &Motion| smooth(&subject.model, m, Some(filter)).ok();
    let trials = entries
        .par_iter()
        .map(|entry| {
            let ik = session.ik_of(Some(entry));
            let (_, motion, ..) = track(ik, results, subject.clone(), &entry.name).map_err(|e| e.problem)?;
            let filtered = again(&motion);
            let calendar = || Ok(std::sync::Arc::new(Calendar::of(&session, &ws)?));
            let rows =
                TrialRows::of(results, Some(&params.filter), &calendar, &entry.name, subject.clone(), motion, filtered)
                    .map_err(|e| e.problem)?;
            ComparedTrial::of(&params, results, entry.role, &entry.name, &zeros, rows).map_err(|e| e.problem)
        })
        .collect::<Result<Vec<_>, String>>()?;
    let validation = has_validation(&trials);
    let left_out = vec![true; trials.len()];
    let inputs: Vec<_> =
        trials.iter().enumerate().map(|(i, t)| t.input(i, HeldOut::Validation, validation, Some(&left_out))).collect();
    let body = Body { model: &subject.model, base: &base, prior: &phi };
    let options = CompareOptions { noise_draws: 0, ..compare_options(&params, &subject) };
    let (found, _) = compare(&body, &[Candidate::links("true", &base, &phi)], &inputs, Noise::Unknown, &options)?;
    let of = |kind: &str| {
        let entry = found.against_floor.iter().find(|a| a.judged_on == kind);
        entry.map(|a| json!({"true": a.held_out_error, "windows": a.windows}))
    };
    println!("{}", json!({"flight": of("flight"), "contact": of("contact")}));
    Ok(())
}
