//! What plates measure of the contact: a made body with two feet, on plates, beside them, on a
//! chair.
#![allow(clippy::unwrap_used, reason = "helpers of tests, not library code")]

use aloft_body::subject::PriorSd;
use aloft_body::{
    JointSpec, LinkInertia, LinkSpec, Model, ModelMarker, ModelSpec, Motion, PersonFacts, State, Subject,
};
use aloft_flight::{Coverage, TareSource, Unmeasured, coverage, tare};
use aloft_trial::{Markers, Plate, Trial};
use nalgebra::{Matrix3, Vector3};

const RATE_HZ: f64 = 100.0;
const MASS_KG: f64 = 70.0;
const WEIGHT_N: f64 = MASS_KG * 9.80665;

/// A body whose two feet slide forwards on their own.
fn body() -> Subject {
    let link = |name: &str, joint, position_m: [f64; 3]| LinkSpec {
        name: name.to_owned(),
        parent: (name != "body").then(|| "body".to_owned()),
        joint,
        position_m,
        rpy_rad: [0.0; 3],
        inertia: None,
    };
    let forwards = JointSpec::Prismatic([1.0, 0.0, 0.0]);
    let links = vec![
        link("body", JointSpec::Free, [0.0; 3]),
        link("foot_l", forwards, [0.0, 0.15, -1.0]),
        link("foot_r", forwards, [0.0, -0.15, -1.0]),
    ];
    let model = Model::from_spec(&ModelSpec::new("slider".into(), links)).unwrap();
    let marker = |label: &str, link, position_m: [f64; 3]| ModelMarker {
        label: label.into(),
        link,
        position_m: Vector3::from(position_m),
        weight: 1.0,
    };
    let markers = vec![
        marker("TOP", 0, [0.0, 0.0, 0.5]),
        marker("HEEL_L", 1, [-0.1, 0.0, 0.03]),
        marker("TOE_L", 1, [0.12, 0.0, 0.04]),
        marker("HEEL_R", 2, [-0.1, 0.0, 0.03]),
        marker("TOE_R", 2, [0.12, 0.0, 0.04]),
    ];
    let inertia = |mass_kg| LinkInertia { mass_kg, com_m: Vector3::zeros(), inertia_com_kgm2: Matrix3::identity() };
    Subject {
        facts: PersonFacts { name: "slider".into(), sex: None, height_m: None, mass_kg: MASS_KG },
        markers,
        prior: vec![inertia(MASS_KG - 2.0), inertia(1.0), inertia(1.0)],
        prior_sd: vec![PriorSd { mass_rel: 0.1, com_m: 0.01, radius_rel: 0.1, together: 0.0 }; 3],
        static_q: model.neutral(),
        provenance: Vec::new(),
        model,
        estimated: None,
        boxes: Vec::new(),
    }
}

/// One second each: both feet on plates; the right foot beside them, with half of the load; both on
/// plates; on a chair that takes 40 %. `corners` says whether the plates' places are known.
fn recording(subject: &Subject, corners: bool) -> (Trial, Motion) {
    let n = 400;
    let model = &subject.model;
    let right_at = |t: f64| {
        // steps away within 0.2 s, and back
        let step = |from: f64| ((t - from) / 0.2).clamp(0.0, 1.0);
        1.2 * (step(0.9) - step(1.9))
    };
    let mut state = State::new(model);
    let mut q = Vec::new();
    let mut trajectories = vec![Vec::new(); subject.markers.len()];
    for frame in 0..n {
        let t = frame as f64 / RATE_HZ;
        let mut posture = model.neutral();
        posture[2] = 1.0;
        posture[model.links[2].joint.q_offset] = right_at(t);
        state.forward_position(model, &posture);
        for (path, m) in trajectories.iter_mut().zip(&subject.markers) {
            let lift = if m.link == 2 && (0.02..1.18).contains(&right_at(t)) { 0.1 } else { 0.0 };
            path.push(state.point_in_world(m.link, &m.position_m) + Vector3::z() * lift);
        }
        q.extend(posture);
    }
    // plate 1 below the left foot, plate 2 below the right foot at its first place
    let plate = |name: &str, y: f64, load: &dyn Fn(f64) -> f64| {
        let force_n: Vec<Vector3<f64>> =
            (0..10 * n).map(|s| Vector3::z() * load(s as f64 / (10.0 * RATE_HZ))).collect();
        let moment_nm = force_n.iter().map(|f| Vector3::new(0.02, y, 0.0).cross(f)).collect();
        let at = |x: f64, dy: f64| Vector3::new(x, y + dy, 0.0);
        Plate {
            name: name.into(),
            rate_hz: 10.0 * RATE_HZ,
            corners_m: if corners {
                vec![at(0.3, 0.14), at(-0.3, 0.14), at(-0.3, -0.14), at(0.3, -0.14)]
            } else {
                vec![]
            },
            force_n,
            moment_nm,
        }
    };
    let chair = |t: f64| if t >= 3.0 { 0.6 } else { 1.0 };
    let lifted = |t: f64| (0.02..1.18).contains(&right_at(t));
    let left = move |t: f64| WEIGHT_N * if lifted(t) { 1.0 } else { 0.5 * chair(t) };
    let right = move |t: f64| if right_at(t) > 0.02 { 0.0 } else { WEIGHT_N * 0.5 * chair(t) };
    let labels = subject.markers.iter().map(|m| m.label.clone()).collect();
    let trial = Trial {
        name: "made".into(),
        markers: Markers { rate_hz: RATE_HZ, first_frame: 1, n_frames: n, labels, trajectories },
        plates: vec![plate("FP1", 0.15, &left), plate("FP2", -0.15, &right)],
        ..Trial::default()
    };
    let motion = Motion {
        trial: "made".into(),
        rate_hz: RATE_HZ,
        nq: model.nq,
        nv: model.nv,
        q,
        marker_labels: subject.markers.iter().map(|m| m.label.clone()).collect(),
        residual_m: vec![0.0; n * subject.markers.len()],
        ..Motion::default()
    };
    (trial, motion)
}

fn share(found: &Coverage, frames: std::ops::Range<usize>) -> f64 {
    let mask = found.mask();
    frames.clone().filter(|f| mask[*f]).count() as f64 / frames.len() as f64
}

#[test]
fn a_foot_beside_the_plates_and_a_chair_are_left_out() {
    let subject = body();
    for corners in [true, false] {
        let (trial, motion) = recording(&subject, corners);
        let found = coverage(&trial, &subject, &motion, &[], 20.0).unwrap();
        // both feet on plates
        assert!(share(&found, 10..85) == 1.0 && share(&found, 215..280) == 1.0, "{found:?}");
        // the other foot beside them, a chair
        assert!(share(&found, 112..190) == 0.0, "{found:?}");
        assert!(share(&found, 302..395) == 0.0, "{found:?}");
        assert!(found.left_out_s(Unmeasured::FootBeside) > 0.6, "{found:?}");
        assert!((0.95..1.4).contains(&found.left_out_s(Unmeasured::LoadMissing)), "{found:?}");
        let words = found.sentence().unwrap();
        assert!(words.contains("a foot beside the plates") && words.contains("a chair"), "{words}");
    }
}

#[test]
fn a_wrong_mass_is_not_missing_contact() {
    let mut subject = body();
    let (mut trial, motion) = recording(&subject, true);
    let n = trial.markers.n_frames;
    // standing on both plates all the time, with a stated mass that is 12 % too high
    for plate in &mut trial.plates {
        plate.force_n = vec![Vector3::z() * 0.5 * WEIGHT_N; 10 * n];
        plate.moment_nm = vec![Vector3::zeros(); 10 * n];
    }
    for track in trial.markers.trajectories.iter_mut() {
        let first = track[0];
        track.fill(first);
    }
    subject.prior[0].mass_kg *= 1.12;
    let found = coverage(&trial, &subject, &motion, &[], 20.0).unwrap();
    assert!(share(&found, 20..380) == 1.0, "{found:?}");
    assert!((found.load_ratio.unwrap() - 1.0 / 1.12).abs() < 0.01);
    assert_eq!(found.sentence(), None);
}

#[test]
fn an_offset_of_a_plate_that_is_unloaded_for_a_while_is_taken_off_without_any_flight() {
    let subject = body();
    let (mut trial, _) = recording(&subject, true);
    for force in &mut trial.plates[1].force_n {
        force.z += 25.0;
    }
    let found = tare(&mut trial, &[]);
    assert_eq!(found[1].source, TareSource::OwnReadings);
    assert!((found[1].force_n[0].z - 25.0).abs() < 0.1, "{:?}", found[1]);
    let unloaded = &trial.plates[1].force_n[1250..1850];
    assert!(unloaded.iter().all(|f| f.z.abs() < 0.1));
    // the other one carries the body all the time
    assert_eq!(found[0].source, TareSource::None);
}
