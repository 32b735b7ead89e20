//! Flights of people from inverse kinematics with landmark geometry and a prior from a table,
//! compared with truth and plates.
#![allow(clippy::unwrap_used, clippy::panic, clippy::print_stdout, reason = "helpers of tests, not library code")]

#[path = "../../../tests/shared_data.rs"]
mod shared_data;

use aloft_body::{ModelSpec, Motion, PersonFacts, Sex, Subject};
use aloft_flight::{FlightOptions, FlightReport, FlightSource, FlightWarning, find_flights, from_motion};
use aloft_ik::{IkOptions, solve};
use aloft_scale::{Anthropometry, PersonInput, ScaleOptions, scale_person};
use aloft_trial::{GapOptions, ImportOptions, MarkerSet, Trial, apply_marker_set, fill_gaps};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../..")
}

fn config<T: serde::de::DeserializeOwned>(path: &str) -> T {
    serde_yaml::from_str(&std::fs::read_to_string(root().join("configs").join(path)).unwrap()).unwrap()
}

/// One trial, labels canonical, gaps filled; C3D, or TRC with MOT.
fn read(folder: &str, name: &str, set: &MarkerSet) -> Option<Trial> {
    let data = shared_data::shared_data(folder)?;
    let options = ImportOptions::default();
    let mut trial = if let Ok(bytes) = std::fs::read(data.join(format!("{name}.c3d"))) {
        Trial::from_c3d(name, &bytes, &options).unwrap()
    } else {
        let trc = std::fs::read_to_string(data.join(format!("markers/{name}.trc"))).unwrap();
        let mot = std::fs::read_to_string(data.join(format!("forces/{name}_grf.mot"))).unwrap();
        Trial::from_trc_mot(name, &trc, Some(&mot), &options).unwrap()
    };
    apply_marker_set(&mut trial, set, &BTreeMap::new());
    fill_gaps(&mut trial, &set.segments(), &GapOptions::default());
    Some(trial)
}

/// Subject and its inverse kinematics of some trials.
fn people(
    folder: &str,
    set: &str,
    still: &str,
    facts: PersonFacts,
    names: &[&str],
) -> Option<(Subject, Vec<(Trial, Motion)>)> {
    let set: MarkerSet = config(&format!("markersets/{set}.yaml"));
    let static_trial = read(folder, still, &set)?;
    let (model, table): (ModelSpec, Anthropometry) =
        (config("models/human34.yaml"), config("anthropometry/de_leva.yaml"));
    let input =
        PersonInput { facts: &facts, model_spec: &model, marker_set: &set, static_trial: &static_trial, frames: None };
    let scaled = scale_person(&input, &table, &ScaleOptions::default()).unwrap();
    let options = IkOptions { locked: scaled.locked.clone(), ..IkOptions::default() };
    let solved = names
        .iter()
        .map(|name| {
            let trial = read(folder, name, &set)?;
            let motion = solve(&scaled.subject, &trial, &options).unwrap().motion;
            println!("{name}: marker RMS {:.1} mm", motion.rms_m() * 1e3);
            Some((trial, motion))
        })
        .collect::<Option<Vec<_>>>()?;
    Some((scaled.subject, solved))
}

fn both(subject: &Subject, trial: &Trial, motion: &Motion) -> (FlightReport, FlightReport) {
    let (options, phi) = (FlightOptions::default(), subject.prior_phi());
    let joined = find_flights(trial, Some((&subject.model, &phi, motion)), &options).unwrap();
    (from_motion(&subject.model, &phi, motion, &options).unwrap(), joined)
}

#[test]
fn validate_simulated_jumps_by_inverse_kinematics() {
    let facts = PersonFacts { name: "S01".to_owned(), sex: Some(Sex::Female), height_m: Some(1.605), mass_kg: 56.2 };
    let truth: [&[(usize, usize)]; 8] = [
        &[(243, 349), (452, 553), (637, 736)],
        &[(229, 329), (421, 524)],
        &[(256, 356), (470, 578), (676, 780)],
        &[(252, 363), (463, 564), (655, 760)],
        &[(258, 357), (449, 553)],
        &[(249, 354), (455, 558), (674, 784)],
        &[(252, 361), (458, 562)],
        &[(227, 330), (411, 519), (610, 721)],
    ];
    let names =
        ["jump01", "jump02", "jump03", "jump04", "jump05", "jump06", "jump07", "jump08", "exercise01", "exercise02"];
    let Some((subject, solved)) = people("subject_a", "plug-in-gait-35", "static", facts, &names) else { return };
    for (index, (trial, motion)) in solved.iter().enumerate() {
        let (by_motion, joined) = both(&subject, trial, motion);
        let expected = truth.get(index).copied().unwrap_or_default();
        assert_eq!(
            (by_motion.flights.len(), joined.flights.len()),
            (expected.len(), expected.len()),
            "{by_motion:?} {joined:?}"
        );
        for ((m, j), &(start, end)) in by_motion.flights.iter().zip(&joined.flights).zip(expected) {
            println!(
                "{}: motion {:+} {:+}, joined {:+} {:+}, a {:.2}",
                trial.name,
                m.start as i64 - start as i64,
                m.end as i64 - end as i64,
                j.start as i64 - start as i64,
                j.end as i64 - end as i64,
                m.mean_acceleration_mps2[2]
            );
            assert_eq!(j.source, FlightSource::Both);
            assert!(
                j.start >= start && j.end <= end && j.start <= start + 2 && j.end + 2 >= end,
                "{j:?} {start} {end}"
            );
            assert!(m.start.abs_diff(j.start) <= 2 && m.end.abs_diff(j.end) <= 2, "{m:?} {j:?}");
        }
    }
}

#[test]
fn validate_drop_jumps_have_the_fall_from_the_box_and_the_jump() {
    let facts = PersonFacts { name: "S4".to_owned(), sex: None, height_m: None, mass_kg: 60.05 };
    let names = ["DJ1", "DJ2", "DJ3", "DJAsym1", "DJAsym2", "DJAsym3", "squats1"];
    let Some((subject, solved)) = people("real_drop_jump", "opencap-47", "static1", facts, &names) else { return };
    for (trial, motion) in &solved {
        let (by_motion, joined) = both(&subject, trial, motion);
        assert_eq!(joined.flights.len(), if trial.name == "squats1" { 0 } else { 2 }, "{joined:?}");
        assert!(joined.warnings.iter().all(|w| matches!(w, FlightWarning::NotTared { .. })), "{:?}", joined.warnings);
        for (m, j) in by_motion.flights.iter().zip(&joined.flights) {
            println!(
                "{}: motion {} {}, joined {} {}, a {:.2?}",
                trial.name, m.start, m.end, j.start, j.end, m.mean_acceleration_mps2
            );
            assert!(m.start.abs_diff(j.start) <= 2 && m.end.abs_diff(j.end) <= 2, "{m:?} {j:?}");
            assert!((m.mean_acceleration_mps2[2] + 9.81).abs() < 0.2, "{m:?}");
        }
    }
}
