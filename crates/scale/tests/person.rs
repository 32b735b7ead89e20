//! Scaling of people from recordings: simulated with known truth, and real. The recordings may be
//! absent.

#![allow(clippy::unwrap_used, reason = "helpers of tests fail by panicking")]
#![allow(clippy::print_stdout, reason = "tests say what they skip and what they measured")]

#[path = "../../../tests/shared_data.rs"]
mod shared_data;

use aloft_body::{ModelSpec, PersonFacts, Sex, State, Subject};
use aloft_scale::{
    Anthropometry, HipMethod, PersonInput, ScaleOptions, ScaleWarning, Scaled, attach_prior, prior_spread, scale_person,
};
use aloft_trial::{ImportOptions, MarkerSet, Trial, labels::apply_marker_set};
use nalgebra::{Matrix3, Vector3};
use std::collections::BTreeMap;
use std::path::PathBuf;

fn root() -> PathBuf {
    PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../..")
}

fn config<T: serde::de::DeserializeOwned>(path: &str) -> T {
    serde_yaml::from_str(&std::fs::read_to_string(root().join("configs").join(path)).unwrap()).unwrap()
}

fn table(name: &str) -> Anthropometry {
    config(&format!("anthropometry/{name}.yaml"))
}

/// A recording of the data folder; if it is absent, prints what was skipped.
fn recording(path: &str, set: &MarkerSet) -> Option<Trial> {
    let full = shared_data::shared_data(path)?;
    let bytes = std::fs::read(&full).unwrap();
    let stem = full.file_stem().unwrap().to_string_lossy().into_owned();
    let options = ImportOptions::default();
    let mut trial = if path.ends_with(".trc") {
        Trial::from_trc_mot(&stem, std::str::from_utf8(&bytes).unwrap(), None, &options).unwrap()
    } else {
        Trial::from_c3d(&stem, &bytes, &options).unwrap()
    };
    apply_marker_set(&mut trial, set, &BTreeMap::new());
    Some(trial)
}

fn facts(name: &str, sex: Option<Sex>, height_m: Option<f64>, mass_kg: f64) -> PersonFacts {
    PersonFacts { name: name.into(), sex, height_m, mass_kg }
}

struct Case {
    set: MarkerSet,
    trial: Trial,
    facts: PersonFacts,
}

fn case(path: &str, set: &str, facts: PersonFacts) -> Option<Case> {
    let set: MarkerSet = config(&format!("markersets/{set}.yaml"));
    let trial = recording(path, &set)?;
    Some(Case { set, trial, facts })
}

fn scaled(case: &Case, options: &ScaleOptions, frames: Option<std::ops::Range<usize>>) -> Scaled {
    let spec: ModelSpec = config("models/human34.yaml");
    let input =
        PersonInput { facts: &case.facts, model_spec: &spec, marker_set: &case.set, static_trial: &case.trial, frames };
    scale_person(&input, &table("de_leva"), options).unwrap()
}

fn subject_a() -> Option<Case> {
    case("subject_a/static.c3d", "plug-in-gait-35", facts("S01", Some(Sex::Female), Some(1.605), 56.2))
}

fn joint_centres(subject: &Subject) -> BTreeMap<String, Vector3<f64>> {
    let mut state = State::new(&subject.model);
    state.forward_position(&subject.model, &subject.static_q);
    subject
        .model
        .links
        .iter()
        .zip(&state.world_from_link)
        .map(|(l, pose)| (l.name.clone(), pose.translation.vector))
        .collect()
}

#[derive(serde::Deserialize)]
struct TrueLink {
    joint_m: [f64; 3],
    mass_kg: f64,
    com_m: [f64; 3],
    inertia_com_kgm2: [[f64; 3]; 3],
}

fn truth() -> BTreeMap<String, TrueLink> {
    let path = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("tests/fixtures/subject_a_static.json");
    serde_json::from_str(&std::fs::read_to_string(path).unwrap()).unwrap()
}

fn print_report(s: &Scaled) {
    println!("frames {:?} spread {:.2} mm", s.report.frames, 1000.0 * s.report.typical_spread_m);
    for l in &s.report.lengths {
        println!("{:14} {:.3?} {:.3?} expected {:.3?}", l.segment, l.right_m, l.left_m, l.expected_m);
    }
    for w in &s.report.warnings {
        println!("! {w}");
    }
    println!("locked {:?}", s.report.locked);
}

#[test]
fn the_model_at_static_q_reproduces_every_marker() {
    let Some(case) = subject_a() else { return };
    let s = scaled(&case, &ScaleOptions::default(), None);
    print_report(&s);
    let mut state = State::new(&s.subject.model);
    state.forward_position(&s.subject.model, &s.subject.static_q);
    assert_eq!(s.subject.markers.len(), 35);
    for m in &s.subject.markers {
        let i = case.trial.markers.index(&m.label).unwrap();
        let p = state.point_in_world(m.link, &m.position_m);
        let (first, last, _) = s.report.frames;
        let seen: Vec<_> =
            case.trial.markers.trajectories[i][first..=last].iter().filter(|p| p.x.is_finite()).collect();
        let mean = seen.iter().copied().sum::<Vector3<f64>>() / seen.len() as f64;
        assert!((p - mean).norm() < 2e-3, "{} {}", m.label, (p - mean).norm());
    }
    assert!(s.locked.is_empty(), "{:?}", s.report.locked);
    assert!(s.report.missing_markers.is_empty());
}

#[test]
fn validate_joint_centres_of_subject_a_against_the_simulators_truth() {
    let Some(case) = subject_a() else { return };
    let truth = truth();
    for (method, limit_mm) in
        [(HipMethod::Harrington, 13.0), (HipMethod::Bell, 16.0), (HipMethod::Hara, 16.0), (HipMethod::Davis, 18.0)]
    {
        let s = scaled(&case, &ScaleOptions { hip: method, ..ScaleOptions::default() }, None);
        let found = joint_centres(&s.subject);
        let mut sum = 0.0;
        for (link, t) in &truth {
            let error_mm = 1000.0 * (found[link] - Vector3::from(t.joint_m)).norm();
            if method == HipMethod::Harrington {
                println!(
                    "{link:12} {error_mm:5.1} mm {:?}",
                    ((found[link] - Vector3::from(t.joint_m)) * 1000.0).map(|x| x.round()).as_slice()
                );
            }
            sum += error_mm;
        }
        let mean = sum / truth.len() as f64;
        println!("{method:?}: mean joint-centre error {mean:.1} mm");
        assert!(mean < limit_mm, "{method:?}: {mean:.1} mm");
    }
}

#[test]
fn validate_prior_of_subject_a_against_the_simulators_truth() {
    let Some(case) = subject_a() else { return };
    let s = scaled(&case, &ScaleOptions::default(), None);
    let mut subject = s.subject.clone();
    for name in ["de_leva", "dumas", "winter"] {
        let warnings = attach_prior(&mut subject, &table(name), &s.anatomy).unwrap();
        for w in &warnings {
            println!("{name}: {w}");
        }
        let sum: f64 = subject.prior.iter().map(|p| p.mass_kg).sum();
        assert!((sum - 56.2).abs() < 1e-12, "{sum}");
        let mut state = State::new(&subject.model);
        state.forward_position(&subject.model, &subject.static_q);
        let (mut com_error, mut mass_error, mut own, mut whole_true, mut whole) =
            (0.0, 0.0, Vec::new(), Vector3::zeros(), Vector3::zeros());
        for (i, link) in subject.model.links.iter().enumerate() {
            let t = &truth()[&link.name];
            let p = subject.prior[i].transformed(&state.world_from_link[i]);
            com_error += (p.com_m - Vector3::from(t.com_m)).norm();
            mass_error += (p.mass_kg - t.mass_kg).abs();
            whole += p.com_m * p.mass_kg / 56.2;
            whole_true += Vector3::from(t.com_m) * t.mass_kg / 56.2;
            let radius = |m: f64, i: &Matrix3<f64>| (i.trace() / m).sqrt();
            let inertia = Matrix3::from_fn(|r, c| t.inertia_com_kgm2[r][c]);
            own.push(radius(p.mass_kg, &p.inertia_com_kgm2) / radius(t.mass_kg, &inertia));
            println!(
                "  {:12} {:5.2} kg ({:5.2}) com {:4.0} mm radius ×{:.2}",
                link.name,
                p.mass_kg,
                t.mass_kg,
                1e3 * (p.com_m - Vector3::from(t.com_m)).norm(),
                own[i]
            );
            let j = aloft_body::inertia::pseudo_inertia(&subject.prior[i].to_phi());
            assert!(j.symmetric_eigenvalues().min() > 0.0, "{name} {}", link.name);
        }
        let n = subject.model.n_links() as f64;
        println!(
            "{name}: mean |Δmass| {:.2} kg, mean |Δcom| {:.0} mm, whole body {:.0} mm, radii {:.2}…{:.2}",
            mass_error / n,
            1000.0 * com_error / n,
            1000.0 * (whole - whole_true).norm(),
            own.iter().copied().fold(f64::INFINITY, f64::min),
            own.iter().copied().fold(0.0, f64::max)
        );
        let (com_mm, mass_kg) = if name == "de_leva" { (18.0, 0.3) } else { (30.0, 0.8) };
        assert!(1000.0 * com_error / n < com_mm && mass_error / n < mass_kg);
        assert!((whole - whole_true).norm() < 0.03);
    }
    let tables = [table("de_leva"), table("dumas"), table("winter")];
    let spread = prior_spread(&s.subject, &tables.iter().collect::<Vec<_>>(), &s.anatomy).unwrap();
    for (link, sd) in s.subject.model.links.iter().zip(&spread) {
        println!(
            "spread {:12} mass {:3.0} % com {:3.0} mm radius {:3.0} %",
            link.name,
            100.0 * sd.mass_rel,
            1e3 * sd.com_m,
            100.0 * sd.radius_rel
        );
        assert!(sd.mass_rel < 0.5 && sd.com_m < 0.05);
    }
}

#[test]
fn the_prior_follows_a_model_whose_frames_were_turned() {
    let Some(case) = subject_a() else { return };
    let s = scaled(&case, &ScaleOptions::default(), None);
    // Rotate the thigh's link frame: same body, another gauge.
    let mut turned = s.subject.clone();
    let thigh = turned.model.link_index("thigh_r").unwrap();
    let shank = turned.model.link_index("shank_r").unwrap();
    let turn = nalgebra::UnitQuaternion::from_euler_angles(0.1, 0.3, -0.2);
    let at = turned.model.links[thigh].joint.q_offset;
    let q = &turned.static_q[at..at + 4];
    let old = nalgebra::UnitQuaternion::from_quaternion(nalgebra::Quaternion::new(q[3], q[0], q[1], q[2]));
    let new = old * turn.inverse();
    turned.static_q[at..at + 4].copy_from_slice(&[new.i, new.j, new.k, new.w]);
    let joint = &mut turned.model.links[shank].joint.parent_from_joint;
    *joint = nalgebra::Isometry3::from_parts(nalgebra::Translation3::identity(), turn) * *joint;
    attach_prior(&mut turned, &table("de_leva"), &s.anatomy).unwrap();
    let (a, b) = (&s.subject.prior[thigh], &turned.prior[thigh]);
    assert!((turn * a.com_m - b.com_m).norm() < 1e-12);
    assert!((s.subject.prior[shank].com_m - turned.prior[shank].com_m).norm() < 1e-12);
}

#[test]
fn validate_real_drop_jump_static() {
    let mut set_facts = facts("Subject4", None, None, 60.05);
    set_facts.sex = None;
    let Some(case) = case("real_drop_jump/markers/static1.trc", "opencap-47", set_facts) else { return };
    let s = scaled(&case, &ScaleOptions::default(), None);
    print_report(&s);
    // Head: three; each hand: flexion and deviation.
    assert_eq!(s.report.locked, ["head.wx", "head.wy", "head.wz", "hand_r.wx", "hand_r.wz", "hand_l.wx", "hand_l.wz"]);
    assert_eq!(s.subject.markers.len(), 47);
    let hips = s.report.lengths.iter().find(|l| l.segment == "hip_width").unwrap();
    assert!((hips.right_m.unwrap() - 0.190).abs() < 0.002, "{:?}", hips.right_m);
    for (link, p) in s.subject.model.links.iter().zip(&s.subject.prior) {
        println!("{:12} {:.2} kg {:?}", link.name, p.mass_kg, p.com_m.map(|x| (x * 1000.0).round()).as_slice());
    }
    println!("{:?}", s.subject.static_q.iter().map(|x| (x * 100.0).round() / 100.0).collect::<Vec<_>>());
}

#[test]
fn validate_a_jump_without_a_static() {
    let Some(case) = case("real_landing/Sample_Jump2.c3d", "motion-analysis-jump", facts("jumper", None, None, 70.0))
    else {
        return;
    };
    let s = scaled(&case, &ScaleOptions::default(), Some(0..10));
    print_report(&s);
    assert!(s.report.warnings.iter().any(|w| matches!(w, ScaleWarning::HeightEstimated { .. })));
    assert!(s.report.locked.iter().filter(|n| n.starts_with("hand_")).count() == 6, "{:?}", s.report.locked);
}

#[test]
fn validate_a_static_without_arms_and_head() {
    let Some(case) = case("real_landing/aStaticTrial_2.c3d", "motion-analysis-acl", facts("lander", None, None, 70.0))
    else {
        return;
    };
    let s = scaled(&case, &ScaleOptions::default(), None);
    print_report(&s);
    let arms = s.report.locked.iter().filter(|n| n.contains("arm_") || n.contains("hand_")).count();
    assert_eq!(arms, 14, "{:?}", s.report.locked);
}
