//! Identification without gravity (in orbit) and with low gravity (on the moon): from C3D files to
//! base parameters, compared with the truth of the simulation.
//!
//! The flights are taken from the truth: this test is about rows and estimates, not about finding
//! flights.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic, reason = "tests fail by panicking")]

use aloft_body::{BaseParameters, Subject};
use aloft_identify::{IdentifyOptions, LinkPrior, identify};
use aloft_pipeline::runner::{Selection, Silent, run};
use aloft_regressor::{
    AccelerationOptions, Acting, CoordinateNoise, Factor, Noise, Stretch, WeakOptions, acceleration_factor, weak_factor,
};
use aloft_simulate::{Scenario, simulate};
use aloft_study::subject_session::{Overrides, SubjectSession};
use aloft_workspace::artifact::load_motion;
use aloft_workspace::manifest::WHOLE_STUDY;
use aloft_workspace::workspace::Workspace;
use std::path::Path;

/// Writes a laboratory with this gravity to disk and runs its pipeline until the motion is
/// filtered; returns the study and its truth.
fn laboratory(gravity_mps2: f64, folder: &Path) -> (SubjectSession, serde_json::Value) {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("../..");
    let text = std::fs::read_to_string(root.join("fixtures/scenarios/demo.yaml")).unwrap();
    let mut scenario: Scenario = aloft_study::ranges::parse_yaml("scenario", &text).unwrap();
    scenario.hidden.clear();
    scenario.seed = 77;
    scenario.capture.gravity_mps2 = gravity_mps2;
    let lab = simulate(&scenario).unwrap();
    for file in &lab.files {
        let path = folder.join("lab").join(&file.path);
        std::fs::create_dir_all(path.parent().unwrap()).unwrap();
        std::fs::write(path, &file.bytes).unwrap();
    }
    let overrides =
        Overrides { data: Some(folder.join("lab")), workspace: Some(folder.join("ws")), ..Overrides::default() };
    let session = SubjectSession::open(&root.join("pipelines/chain.yaml"), &overrides).unwrap();
    assert_eq!(session.facts.gravity_mps2, gravity_mps2, "gravity of the laboratory's own description");
    run(&session, &Selection { until: Some("filter".into()), ..Selection::default() }, &Silent).unwrap();
    let truth = std::fs::read_to_string(folder.join("lab/truth/truth.json")).unwrap();
    (session, serde_json::from_str(&truth).unwrap())
}

#[test]
fn validate_a_chain_is_identified_at_any_gravity() {
    let mut found = Vec::new();
    for gravity_mps2 in [0.0, 0.02, 1.62, 9.81] {
        let folder = tempfile::tempdir().unwrap();
        let (session, truth) = laboratory(gravity_mps2, folder.path());
        let ws = Workspace::open(&session.workspace);
        let text = std::fs::read_to_string(ws.place("calibrate", WHOLE_STUDY).join("subject.json")).unwrap();
        let subject: Subject = serde_json::from_str(&text).unwrap();
        assert_eq!(subject.model.gravity_mps2.norm(), gravity_mps2);
        let base = BaseParameters::of(&subject.model);
        let (phi, prior) = (subject.prior_phi(), LinkPrior::of_subject(&subject).unwrap());
        let noise = Noise::white(CoordinateNoise::Markers { markers: &subject.markers, sd_m: 3e-4 });
        let (mut weak, mut whitened, mut paper) = (Vec::<Factor>::new(), Vec::new(), Vec::new());
        for (name, recording) in truth["recordings"].as_object().unwrap() {
            let (motion, filtered) =
                (load_motion(&ws.place("ik", name)).unwrap(), load_motion(&ws.place("filter", name)).unwrap());
            for (i, flight) in recording["flight_intervals"].as_array().unwrap().iter().enumerate() {
                let frame = |k: usize| flight[k].as_u64().unwrap() as usize;
                // two frames shorter than the true flight at both ends, as detection would leave it
                let stretch = Stretch::flight(name.clone(), i, frame(0) + 2, frame(1) - 1);
                let options = WeakOptions::default();
                let of = |noise: Option<&Noise<'_>>| {
                    let (model, acting) = (&subject.model, Acting::nothing());
                    weak_factor(model, &base, &phi, &motion, &stretch, acting, &options, noise).unwrap()
                };
                weak.push(of(None));
                whitened.push(of(Some(&noise)));
                let options = AccelerationOptions::default();
                let acting = Acting::nothing();
                paper.push(acceleration_factor(&subject.model, &base, &filtered, &stretch, acting, &options).unwrap());
            }
        }
        assert_eq!(weak.len(), 18);
        for (what, factors, limit) in [("weak", &weak, 1e-4), ("whitened", &whitened, 1e-4), ("paper", &paper, 5e-3)] {
            let mass = subject.facts.mass_kg;
            let options = IdentifyOptions::default();
            let result = identify(&subject.model, &base, factors, mass, Some(&prior), &options).unwrap().parameters;
            let truths: Vec<f64> =
                truth["base"].as_array().unwrap().iter().map(|b| b["value"].as_f64().unwrap()).collect();
            assert_eq!(truths.len(), result.base.len());
            let error = result.base.iter().zip(&truths).map(|(b, t)| (b.value - t).abs()).fold(0.0, f64::max);
            println!(
                "g = {gravity_mps2} m/s², {what} rows: largest error of a base parameter {error:.1e}, gate {}, {:?}",
                result.gate.passed, result.information
            );
            assert!(error < limit, "{gravity_mps2} {what}: {error:e}");
            assert!(result.base.iter().all(|b| b.se.is_finite() && b.value.is_finite()));
            assert!(result.row_rms.is_finite() && result.row_rms > 0.0 && result.sigma.ratio.is_finite());
            if what == "weak" {
                assert!(result.gate.passed, "{gravity_mps2}: {:?}", result.gate);
                found.push((gravity_mps2, result.row_rms));
            }
        }
    }
    // rows are scaled by a unit that does not vanish with gravity
    assert!((found[0].1 / found[1].1 - 1.0).abs() < 0.5, "{found:?}");
}
