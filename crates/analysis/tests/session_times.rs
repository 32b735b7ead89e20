//! A clock drift over a session is found from the files alone: by their dates, or by order and
//! lengths if they state no dates.
#![allow(
    clippy::unwrap_used,
    clippy::expect_used,
    clippy::panic,
    clippy::print_stdout,
    reason = "tests fail by panicking"
)]

use aloft_analysis::discover::{discover, options};
use aloft_c3d::{C3dFile, Parameter};
use aloft_pipeline::runner::{Selection, Silent, run_all};
use aloft_simulate::{Scenario, simulate};
use aloft_study::calendar::Calendar;
use aloft_study::data_set::DataSet;
use aloft_study::subject_session::Overrides;
use aloft_trial::SessionSource;
use aloft_workspace::workspace::Workspace;
use std::fs;
use std::path::Path;

const TRIALS: &str = "protocol: {jumps: 6, flights: [2, 2], exercises: 1, static_s: 3.0, exercise_s: 4.0}";

/// A session in a folder; `stamp(k)` is the date written into the k-th recording.
fn laboratory(folder: &Path, ppm: f64, spacing_s: f64, stamp: impl Fn(usize) -> Option<String>) -> Vec<(String, f64)> {
    let text = format!(
        "name: drift\nseed: 5\nbody:\n  kind: human\n  person: {{sex: F, height_m: 1.68, mass_kg: 61.0}}\n  {TRIALS}\n\
         hidden: [{{effect: clock_drift, rate_ppm: {ppm}, spacing_s: {spacing_s}}}]\n"
    );
    let scenario: Scenario = aloft_study::ranges::parse_yaml("drift", &text).unwrap();
    let lab = simulate(&scenario).unwrap();
    let starts = lab.trials.iter().enumerate().map(|(k, t)| (t.name.clone(), spacing_s * k as f64)).collect();
    for file in lab.files.iter().filter(|f| !f.path.starts_with("truth")) {
        let path = folder.join(&file.path);
        fs::create_dir_all(path.parent().unwrap()).unwrap();
        let stem = path.file_stem().unwrap().to_string_lossy().into_owned();
        let index = lab.trials.iter().position(|t| t.name == stem);
        let bytes = match index.and_then(&stamp) {
            Some(date) => {
                let mut c3d = C3dFile::from_bytes(&file.bytes).unwrap();
                c3d.groups.set("TRIAL", Parameter::text("CREATION_DATE", &date));
                c3d.to_bytes().unwrap()
            }
            None => file.bytes.clone(),
        };
        fs::write(path, bytes).unwrap();
    }
    starts
}

/// Runs the stages and looks for a drift; returns the true starts, the calendar and the
/// coefficient.
fn drift(
    ppm: f64,
    spacing_s: f64,
    stamp: impl Fn(usize) -> Option<String>,
) -> (Vec<(String, f64)>, Calendar, f64, f64) {
    let dir = tempfile::tempdir().unwrap();
    let (data, ws) = (dir.path().join("lab"), dir.path().join("ws"));
    let starts = laboratory(&data, ppm, spacing_s, stamp);
    let pipeline = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../pipelines/human.yaml");
    let overrides = Overrides { data: Some(data), workspace: Some(ws.clone()), ..Overrides::default() };
    let set = DataSet::open(&pipeline, &overrides).unwrap();
    let done = run_all(&set, &Selection::default(), &Silent).unwrap();
    assert!(!done.has_trouble(), "{:#?}", done.runs);
    let found =
        discover(&set.members[0], &options(vec!["plate_clock_drift".to_owned()], Vec::new(), true, None), &|_| {})
            .unwrap()
            .discovery;
    let candidate = found.candidates.iter().find(|c| c.effect == "plate_clock_drift").unwrap();
    let calendar = Calendar::of(&set.members[0], &Workspace::open(&ws)).unwrap();
    let summary = fs::read_to_string(ws.join("regressor/jump03/manifest.json")).unwrap();
    assert!(summary.contains("session_time_source"), "{summary}");
    (starts, calendar, candidate.coefficients[0].value, candidate.held_out_ratio)
}

/// Coefficient expected for a calendar whose times differ from the true ones; the delays follow the
/// true times.
fn expected(ppm: f64, starts: &[(String, f64)], calendar: &Calendar) -> f64 {
    let jumps = starts.iter().filter(|s| s.0.starts_with("jump"));
    let (cross, square) = jumps.fold((0.0, 0.0), |s, (name, start)| {
        // landings lie near the middle of a recording of three to four seconds
        let (real, own) = (start + 2.0, calendar.start_s(name) + 2.0);
        (s.0 + real * own, s.1 + own * own)
    });
    1e-6 * ppm * cross / square
}

#[test]
fn validate_a_drift_is_recovered_with_dates() {
    let (ppm, spacing_s) = (100.0, 40.0);
    let stamp = |k: usize| {
        let s = 55 + k * 40;
        Some(format!("2024-05-17 {:02}:{:02}:{:02}", 9 + (58 * 60 + s) / 3600, (58 + s / 60) % 60, s % 60))
    };
    let (starts, calendar, coefficient, ratio) = drift(ppm, spacing_s, stamp);
    println!("dates: {coefficient:.3e} for {:.3e}, held-out ratio {ratio:.2}, {}", 1e-6 * ppm, calendar.words);
    assert_eq!(calendar.source, SessionSource::Dates);
    for (name, start) in &starts {
        assert!((calendar.start_s(name) - start).abs() < 1e-6, "{name}: {}", calendar.start_s(name));
    }
    assert!((coefficient / (1e-6 * ppm) - 1.0).abs() < 0.15 && ratio < 0.8, "{coefficient:e} {ratio}");
}

#[test]
fn validate_a_drift_is_recovered_with_order_and_lengths() {
    let (ppm, spacing_s) = (1000.0, 4.0);
    let (starts, calendar, coefficient, ratio) = drift(ppm, spacing_s, |_| None);
    let expected = expected(ppm, &starts, &calendar);
    println!(
        "order: {coefficient:.3e} for {expected:.3e} ({:.3e} true), held-out ratio {ratio:.2}, {}",
        1e-6 * ppm,
        calendar.words
    );
    assert_eq!(calendar.source, SessionSource::OrderAndLengths);
    // the order of subject.yaml, in which the exercise comes last
    assert!(
        calendar.start_s("jump01") < calendar.start_s("jump06")
            && calendar.start_s("jump06") < calendar.start_s("exercise01")
    );
    assert!((coefficient / expected - 1.0).abs() < 0.15 && ratio < 0.8, "{coefficient:e} {expected:e} {ratio}");
    // recordings back to back, each about as long as the spacing: the drift of the clock is found
    // to within a third
    assert!((coefficient / (1e-6 * ppm) - 1.0).abs() < 0.35, "{coefficient:e}");
}
