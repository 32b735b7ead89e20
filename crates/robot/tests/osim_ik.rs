//! Inverse kinematics in an OpenSim model's own coordinates, and the rigid tree that dynamics uses.
#![allow(clippy::unwrap_used, clippy::print_stdout, reason = "tests fail by panicking and print what they measured")]

#[path = "../../../tests/shared_data.rs"]
mod shared_data;

use aloft_body::{LinkInertia, PersonFacts, State, Subject};
use aloft_robot::PriorSpread;
use aloft_robot::osim::patch::patch;
use aloft_robot::osim::{OsimIk, OsimModel, RigidTree};
use nalgebra::{UnitQuaternion, Vector3};
use std::collections::BTreeMap;

const BODY: &str = include_str!("../../../fixtures/osim/body.osim");

fn subject_of(osim: &OsimModel, tree: &RigidTree) -> Subject {
    let facts = PersonFacts { name: "s".into(), sex: None, height_m: None, mass_kg: tree.mass_kg() };
    let spread = PriorSpread { mass_rel: 0.1, com_m: 0.02, radius_rel: 0.1 };
    tree.subject(osim, facts, Vector3::new(0.0, 0.0, -9.81), spread)
}

fn upright() -> UnitQuaternion<f64> {
    UnitQuaternion::from_axis_angle(&Vector3::x_axis(), std::f64::consts::FRAC_PI_2)
}

/// Markers of the exact tree at values of the coordinates, world.
fn markers(osim: &OsimModel, values: &BTreeMap<String, f64>) -> Vec<Vector3<f64>> {
    let mut state = State::new(&osim.model);
    state.forward_position(&osim.model, &osim.posture(values, &upright()));
    osim.markers.iter().map(|m| state.point_in_world(m.link, &m.position_m)).collect()
}

fn posture(k: usize) -> BTreeMap<String, f64> {
    let t = 0.02 * k as f64;
    [
        ("pelvis_tilt", 0.2 + 0.3 * t),
        ("pelvis_list", -0.1 * t),
        ("pelvis_rotation", 2.5 + 0.2 * t),
        ("pelvis_tx", 0.4 * t),
        ("pelvis_ty", 1.0 + 2.0 * t - 4.9 * t * t),
        ("pelvis_tz", -3.0),
        ("hip_flexion_r", 0.4 * (3.0 * t).sin()),
        ("hip_adduction_r", -0.1),
        ("hip_rotation_l", 0.2),
        ("knee_angle_r", 0.5 + 0.4 * (4.0 * t).cos()),
        ("knee_angle_l", 0.3),
        ("ankle_angle_r", -0.2),
        ("arm_flex_r", 0.8 * t),
        ("arm_add_l", -0.3),
    ]
    .map(|(k, v)| (k.to_owned(), v))
    .into()
}

#[test]
fn coordinates_come_back_from_the_markers_that_they_made() {
    let osim = OsimModel::parse("body.osim", BODY).unwrap();
    let tree = RigidTree::of(&osim, None).unwrap();
    let subject = subject_of(&osim, &tree);
    let solver = OsimIk::new(&osim, &tree, &subject.markers, 0.002);
    let seen: Vec<Vec<Vector3<f64>>> = (0..40).map(|k| markers(&osim, &posture(k))).collect();
    let found = solver.track("t", 100.0, 40, &|m, f| (!(m == 3 && f > 20)).then(|| seen[f][m]));
    assert_eq!(found.unsolved, 0);
    assert!(found.rms_m < 1e-6, "{}", found.rms_m);
    let n = osim.all_coordinates().len();
    for k in 0..40 {
        for (name, value) in posture(k) {
            let i = osim.all_coordinates().iter().position(|c| c.name == name).unwrap();
            let off = found.values[k * n + i] - value;
            assert!(off.abs() < 1e-4, "{name} in frame {k}: off by {off}");
        }
    }
    // the rigid tree strays from the file's by no more than it states
    let mut state = State::new(&tree.model);
    let mut worst = 0.0_f64;
    for (k, places) in seen.iter().enumerate() {
        state.forward_position(&tree.model, found.motion.q(k));
        for (marker, place) in subject.markers.iter().zip(places) {
            worst = worst.max((state.point_in_world(marker.link, &marker.position_m) - place).norm());
        }
    }
    println!("rigid tree off by {:.2} mm; {:?}", 1e3 * worst, tree.remarks);
    assert!(worst < 0.004, "{worst}");
}

#[test]
fn bodies_that_cannot_move_on_their_own_ride_and_get_their_inertia_back() {
    let osim = OsimModel::parse("body.osim", BODY).unwrap();
    let tree = RigidTree::of(&osim, None).unwrap();
    let why: Vec<(&str, &str)> = tree.merged.iter().map(|m| (m.body.as_str(), m.why.as_str())).collect();
    println!("{why:?}");
    assert!(why.iter().any(|w| w.0 == "patella_r" && w.1.starts_with("it follows another joint")));
    assert!(why.iter().any(|w| w.0 == "hand_r" && w.1 == "welded"));
    assert!(why.iter().any(|w| w.0 == "toes_r" && w.1.contains("locked")));
    assert!((tree.mass_kg() - osim.mass_kg()).abs() < 1e-9);
    // without the markers of a foot nothing is beyond the ankle
    let of_foot = |name: &str| ["R_FOOT", "R_HEE", "R_TOE"].contains(&name);
    let seen: Vec<String> = osim.markers.iter().map(|m| m.name.clone()).filter(|m| !of_foot(m)).collect();
    let less = RigidTree::of(&osim, Some(&seen)).unwrap();
    assert!(less.merged.iter().any(|m| m.body == "foot_r" && m.link == "shank_r" && m.why.starts_with("no marker")));
    assert!((less.mass_kg() - osim.mass_kg()).abs() < 1e-9);

    let subject = subject_of(&osim, &tree);
    let same = patch(BODY, &osim, &tree, &subject.prior, 1.0, "the same").unwrap();
    let again = OsimModel::parse("again.osim", &same.text).unwrap();
    for (a, b) in osim.inertias.iter().zip(&again.inertias) {
        assert!((a.to_phi() - b.to_phi()).amax() < 1e-9);
    }
    let heavier: Vec<LinkInertia> = subject
        .prior
        .iter()
        .map(|i| LinkInertia { mass_kg: 1.1 * i.mass_kg, inertia_com_kgm2: 1.1 * i.inertia_com_kgm2, ..*i })
        .collect();
    let patched = patch(BODY, &osim, &tree, &heavier, 1.1, "identified -- by a test").unwrap();
    let again = OsimModel::parse("again.osim", &patched.text).unwrap();
    assert!((again.mass_kg() - 1.1 * osim.mass_kg()).abs() < 1e-6);
    // nothing else changed: the lines that differ are inertials
    let (old, new): (Vec<&str>, Vec<&str>) = (BODY.lines().collect(), patched.text.lines().collect());
    assert_eq!(old.len() + 1, new.len());
    let differ: Vec<&str> = old[1..].iter().zip(&new[2..]).filter(|(a, b)| a != b).map(|(a, _)| *a).collect();
    assert!(differ.len() > 10);
    for line in differ {
        assert!(["<mass>", "<mass_center>", "<inertia>"].iter().any(|e| line.trim().starts_with(e)), "{line}");
    }
    let broken: Vec<LinkInertia> = heavier.iter().map(|i| LinkInertia { mass_kg: -1.0, ..*i }).collect();
    assert!(patch(BODY, &osim, &tree, &broken, 1.0, "").unwrap_err().to_string().contains("not that of any body"));
}

#[test]
fn parts_that_a_pipeline_cannot_use_are_named() {
    let slides = BODY.replace("<PinJoint name=\"ankle_r\">", "<SliderJoint name=\"ankle_r\">");
    let at = slides.find("<SliderJoint name=\"ankle_r\">").unwrap();
    let end = at + slides[at..].find("</PinJoint>").unwrap();
    let slides = format!("{}</SliderJoint>{}", &slides[..end], &slides[end + "</PinJoint>".len()..]);
    let osim = OsimModel::parse("slides.osim", &slides).unwrap();
    let refused = RigidTree::of(&osim, None).unwrap_err().to_string();
    assert!(refused.contains("`ankle_r`, which slides without turning"), "{refused}");
}

/// Columns of a tab-separated table after its header.
fn table(text: &str, after: &str) -> (Vec<String>, Vec<Vec<f64>>) {
    let mut lines = text.lines().skip_while(|l| !l.starts_with(after));
    let names = lines.next().unwrap().split('\t').map(|s| s.trim().to_owned()).collect();
    let rows = lines
        .map(|l| l.split('\t').map(|w| w.trim().parse().unwrap_or(f64::NAN)).collect::<Vec<f64>>())
        .filter(|r: &Vec<f64>| r.len() > 3 && r[1].is_finite())
        .collect();
    (names, rows)
}

#[test]
fn validate_rajagopals_model_on_published_recordings() {
    let read = |p: &str| {
        let path = shared_data::shared_data(&format!("real_labs/opencap_unfiltered/{p}"))?;
        Some(std::fs::read_to_string(path).unwrap())
    };
    let Some(model) = read("Models/final.osim") else { return };
    let osim = OsimModel::parse("final.osim", &model).unwrap();
    let (names, rows) = table(&read("MarkerData/DJ4.trc").unwrap(), "Frame#");
    let seen: Vec<String> = osim.markers.iter().map(|m| m.name.clone()).filter(|m| names.contains(m)).collect();
    let tree = RigidTree::of(&osim, Some(&seen)).unwrap();
    println!("{} links; {:#?} {:#?}", tree.model.n_links(), tree.merged, tree.remarks);
    let mut subject = subject_of(&osim, &tree);
    subject.markers.retain(|m| seen.contains(&m.label));
    let solver = OsimIk::new(&osim, &tree, &subject.markers, 0.002);
    let columns: Vec<usize> = solver.labels().iter().map(|l| names.iter().position(|n| n == l).unwrap()).collect();
    let start = std::time::Instant::now();
    let found = solver.track("DJ4", 100.0, rows.len(), &|m, f| {
        // the first two columns are frame and time; a label stands above the first of three
        let at = columns[m];
        let p = Vector3::new(rows[f][at], rows[f][at + 1], rows[f][at + 2]);
        Some(upright() * p)
    });
    println!(
        "{} frames in {:.2} s: RMS {:.2} mm, max {:.1} mm, unsolved {}, unconverged {}, at range {:?}",
        rows.len(),
        start.elapsed().as_secs_f64(),
        1e3 * found.rms_m,
        1e3 * found.max_m,
        found.unsolved,
        found.unconverged,
        found.at_range
    );
    assert!(found.rms_m < 0.02 && found.unsolved == 0);
    let (theirs, values) = table(&read("IK/DJ4_ik.mot").unwrap(), "time");
    let n = osim.all_coordinates().len();
    for (i, c) in osim.all_coordinates().iter().enumerate() {
        let Some(k) = theirs.iter().position(|t| *t == c.name) else { continue };
        let off: Vec<f64> = (0..rows.len()).map(|f| found.values[f * n + i] - values[f][k]).collect();
        let rms = (off.iter().map(|x| x * x).sum::<f64>() / off.len() as f64).sqrt();
        println!("  {} {:.2}", c.name, if c.is_angle { rms.to_degrees() } else { 1e3 * rms });
    }
}
