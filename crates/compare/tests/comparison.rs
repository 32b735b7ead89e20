//! The comparison on a three-link tree whose parameters and wrench are known.

#![allow(clippy::unwrap_used, reason = "a test that cannot be set up fails")]

use aloft_body::{BaseParameters, JointSpec, LinkSpec, Model, ModelSpec, Motion, Phi, State};
use aloft_compare::{
    Body, Candidate, CompareOptions, Comparison, Filtering, GroupedBy, Measured, Noise, TrialInput, compare,
};
use aloft_regressor::EffectColumns;
use aloft_signal::{Butterworth, CutoffCorrection, LowPass, derivative::derivatives_of_run};
use nalgebra::{DMatrix, DVector, UnitQuaternion, Vector3, Vector6};
use rand::SeedableRng;
use rand_distr::{Distribution, StandardNormal};

const RATE_HZ: f64 = 200.0;
const N: usize = 900;
const FILTER: LowPass = LowPass { order: 3, cutoff_hz: 10.0, correction: CutoffCorrection::None };

fn tree() -> Model {
    let link = |name: &str, parent: Option<&str>, joint, y| LinkSpec {
        name: name.into(),
        parent: parent.map(Into::into),
        joint,
        position_m: [0.02, y, 0.01],
        rpy_rad: [0.0; 3],
        inertia: None,
    };
    let links = vec![
        link("trunk", None, JointSpec::Free, 0.0),
        link("arm", Some("trunk"), JointSpec::Spherical, 0.4),
        link("leg", Some("trunk"), JointSpec::RevoluteZ, -0.3),
    ];
    Model::from_spec(&ModelSpec::new("tree".into(), links)).unwrap()
}

fn truth() -> Vec<Phi> {
    let phi = |m: f64, c: [f64; 3], i: [f64; 3]| {
        Phi::from_column_slice(&[m, m * c[0], m * c[1], m * c[2], i[0], i[1], i[2], 0.004, -0.002, 0.003])
    };
    vec![
        phi(30.0, [0.01, 0.15, 0.0], [1.9, 0.6, 2.0]),
        phi(4.0, [0.0, -0.2, 0.02], [0.3, 0.03, 0.31]),
        phi(12.0, [0.03, -0.25, 0.0], [1.2, 0.1, 1.3]),
    ]
}

/// A lively motion: coordinates in closed form.
fn coordinates(k: usize, phase: f64) -> Vec<f64> {
    let t = k as f64 / RATE_HZ + phase;
    let s = |a: f64, w: f64| a * (w * t).sin();
    let root = UnitQuaternion::from_scaled_axis(Vector3::new(s(0.5, 3.1), s(0.7, 2.3), s(0.3, 4.4)));
    let arm = UnitQuaternion::from_scaled_axis(Vector3::new(s(1.2, 5.0), s(0.3, 3.7), s(0.9, 4.1)));
    let p = [s(0.2, 2.9), s(0.15, 3.3), 1.0 + s(0.1, 5.2)];
    [&p[..], root.coords.as_slice(), arm.coords.as_slice(), &[0.4 + s(0.6, 4.7)]].concat()
}

fn with_rates(model: &Model, mut m: Motion) -> Motion {
    let n = m.n_frames();
    let rates = |x: &[f64], width: usize| -> (Vec<f64>, Vec<f64>) {
        let (mut first, mut second) = (vec![0.0; x.len()], vec![0.0; x.len()]);
        for c in 0..width {
            derivatives_of_run(x, width, c, RATE_HZ, &mut first, &mut second);
        }
        (first, second)
    };
    m.v = vec![0.0; n * model.nv];
    let (q1, _) = rates(&m.q, model.nq);
    for f in 0..n {
        let (q, q1) = (&m.q[f * 12..], &q1[f * 12..]);
        let quaternion = |x: &[f64], at: usize| nalgebra::Quaternion::new(x[at + 3], x[at], x[at + 1], x[at + 2]);
        let omega = |at: usize| 2.0 * (quaternion(q, at).conjugate() * quaternion(q1, at)).vector();
        let linear = UnitQuaternion::from_quaternion(quaternion(q, 3)).inverse() * Vector3::new(q1[0], q1[1], q1[2]);
        let v = [linear.as_slice(), omega(3).as_slice(), omega(7).as_slice(), &[q1[11]]].concat();
        m.v[f * 10..(f + 1) * 10].copy_from_slice(&v);
    }
    m.a = rates(&m.v, model.nv).0;
    m
}

fn smooth(model: &Model, m: &Motion) -> Motion {
    let mut q = m.q.clone();
    Butterworth::design(FILTER, RATE_HZ).unwrap().filtfilt_interleaved(&mut q, 12);
    q.chunks_exact_mut(12).for_each(|q| model.normalize(q));
    with_rates(model, Motion { q, ..m.clone() })
}

fn motion(model: &Model, phase: f64) -> Motion {
    let q = (0..N).flat_map(|k| coordinates(k, phase)).collect();
    with_rates(
        model,
        Motion { trial: format!("exercise{phase}"), rate_hz: RATE_HZ, nq: 12, nv: 10, q, ..Motion::default() },
    )
}

/// The wrench that causes this motion, world axes about the world origin, with a quadratic drag
/// force of the air on the arm.
fn wrench(model: &Model, phi: &[Phi], m: &Motion, drag: f64) -> (Vec<Vector6<f64>>, EffectColumns) {
    let mut state = State::new(model);
    let mut y = DMatrix::zeros(6, 10 * model.n_links());
    let stacked = DVector::from_iterator(30, phi.iter().flat_map(|p| p.iter().copied()));
    let mut columns = EffectColumns { names: vec!["drag".into()], ..EffectColumns::none() };
    let measured = (0..m.n_frames())
        .map(|f| {
            state.forward_acceleration(model, m.q(f), m.v(f), m.a(f));
            state.base_wrench_regressor(model, &mut y);
            let w = &y * &stacked;
            let root = state.world_from_link[0];
            let force = root.rotation * Vector3::new(w[0], w[1], w[2]);
            let moment = root.rotation * Vector3::new(w[3], w[4], w[5]) + root.translation.vector.cross(&force);
            let place = Vector3::new(0.0, -0.2, 0.02);
            let p = state.point_in_world(1, &place);
            let v = state.point_velocity_in_world(1, &place);
            let air = -v * v.norm();
            let about = p.cross(&air);
            let unit = Vector6::new(air.x, air.y, air.z, about.x, about.y, about.z);
            columns.wrench.push(DMatrix::from_column_slice(6, 1, unit.as_slice()));
            Vector6::new(force.x, force.y, force.z, moment.x, moment.y, moment.z) - unit * drag
        })
        .collect();
    (measured, columns)
}

fn measured(series: Vec<Vector6<f64>>) -> Measured {
    Measured { filtered: series.clone(), unfiltered: series, noise_density: Vector6::zeros() }
}

#[test]
fn the_true_model_has_no_error_and_a_wrong_one_shows_where() {
    let model = tree();
    let base = BaseParameters::of(&model);
    let truth = truth();
    let mut wrong = truth.clone();
    wrong[1][0] += 0.5;
    wrong[1][2] -= 0.15;
    let motions = [motion(&model, 0.0), motion(&model, 7.3)];
    let plates: Vec<Measured> = motions.iter().map(|m| measured(wrench(&model, &truth, m, 0.0).0)).collect();
    let body = Body { model: &model, base: &base, prior: &wrong };
    let trials: Vec<TrialInput> = motions
        .iter()
        .zip(&plates)
        .map(|(m, w)| TrialInput { unfiltered: Some(m), measured: Some(w), ..TrialInput::new(m, &[]) })
        .collect();
    let candidates = [Candidate::links("wrong", &base, &wrong), Candidate::links("truth", &base, &truth)];
    let (c, series) = compare(&body, &candidates, &trials, Noise::Unknown, &CompareOptions::default()).unwrap();
    let right = &c.beside[0];
    assert_eq!(c.first.held_out.frames, 2 * (N - 20));
    assert!(right.held_out.size() < 1e-9, "{}", right.held_out.size());
    assert!(right.held_out_weak.windows > 50 && right.held_out_weak.size() < 0.02, "{}", right.held_out_weak.size());
    assert!(c.first.held_out.size() > 5.0 && c.first.held_out_weak.size() > 5.0);
    assert_eq!(c.first.segments[0].link, "arm");
    assert!(c.first.segments[0].inertia_share > 0.999);
    // the estimated change corrects the wrong model, as far as the motion determines it
    let mut healed = wrong.clone();
    healed[1] += Phi::from_column_slice(&c.first.segments[0].inertia_change);
    let (a, b) = (base.regroup(&healed), base.regroup(&truth));
    assert!((a - b).amax() < 1e-8);
    for group in c.first.breakdown.iter().filter(|g| g.by == GroupedBy::Speed) {
        assert!(group.errors.frames >= 2 * (N - 20) / 4 - 2);
    }
    assert!(c.words.iter().any(|w| w.contains("An error of the mass or inertia of arm alone")), "{:#?}", c.words);
    for (f, w) in series[0].measured.iter().enumerate() {
        assert!((w - series[0].predicted[1][f]).amax() < 1e-9);
    }
}

#[test]
fn effects_of_a_model_are_taken_into_account_and_drag_is_attributed() {
    let model = tree();
    let base = BaseParameters::of(&model);
    let truth = truth();
    let m = motion(&model, 0.0);
    let (series, columns) = wrench(&model, &truth, &m, 2.5);
    let plates = measured(series);
    let body = Body { model: &model, base: &base, prior: &truth };
    let trial = TrialInput {
        unfiltered: Some(&m),
        measured: Some(&plates),
        effects: Some(&columns),
        ..TrialInput::new(&m, &[])
    };
    let candidates = [
        Candidate::links("without", &base, &truth),
        Candidate::links("with", &base, &truth).with_effects([("drag".to_owned(), 2.5)]),
    ];
    let (c, _) = compare(&body, &candidates, &[trial], Noise::Unknown, &CompareOptions::default()).unwrap();
    assert!(c.first.held_out.size() > 1.0 && c.first.held_out_weak.size() > 0.3);
    assert!(c.beside[0].held_out.size() < 1e-9 && c.beside[0].held_out_weak.size() < 0.02);
    let arm = c.first.segments.iter().find(|s| s.link == "arm").unwrap();
    assert!((arm.drag_coefficient - 2.5).abs() < 1e-9 && arm.drag_share > 0.999_999);
}

#[test]
fn flights_masks_and_parameters_of_each_trial() {
    let model = tree();
    let base = BaseParameters::of(&model);
    let truth = truth();
    let motions = [motion(&model, 0.0), motion(&model, 7.3)];
    let plates: Vec<Measured> = motions.iter().map(|m| measured(wrench(&model, &truth, m, 0.0).0)).collect();
    let body = Body { model: &model, base: &base, prior: &truth };
    let flights = vec![std::ops::Range { start: 300, end: 420 }];
    let mut complete = vec![true; N];
    complete[500..].fill(false);
    let mut first = TrialInput::new(&motions[0], &flights);
    first.measured = Some(&plates[0]);
    first.complete = Some(&complete);
    first.held_out_contact = false;
    let mut second = TrialInput::new(&motions[1], &[]);
    second.measured = Some(&plates[1]);
    let (phi, nothing) = (base.regroup(&truth), DVector::zeros(base.len()));
    let candidates = [Candidate::per_trial("each", vec![phi.clone(), nothing]), Candidate::base("all", phi)];
    let (c, series) =
        compare(&body, &candidates, &[first, second], Noise::Unknown, &CompareOptions::default()).unwrap();
    // only the second trial is held out in contact, and there the first model predicts zero
    assert_eq!(c.first.held_out.frames, N - 20);
    assert!(c.first.held_out.force_world_n.mae[2] > 300.0 && c.beside[0].held_out.size() < 1e-9);
    let trial = &c.first.trials[0];
    assert_eq!(trial.contact.frames, 290 - 10 + (500 - 430));
    assert!(trial.contact.size() < 1e-9);
    // this motion is not ballistic: the wrench predicted in flight is the error
    assert_eq!(c.first.flight.frames, 120 - 28);
    let mean: f64 = (314..406).map(|f| series[0].predicted[0][f][0].abs()).sum::<f64>() / 92.0;
    assert!((c.first.flight.residual_force_n.mae[0] - mean).abs() < 1e-9);
    assert_eq!(c.first.breakdown.iter().filter(|g| g.by == GroupedBy::TimeInFlight).count(), 5);
    assert!(c.first.breakdown.iter().any(|g| g.by == GroupedBy::Flight && g.name == "exercise0 #1"));
}

#[test]
fn the_noise_floor_is_the_error_that_noise_makes() {
    let model = tree();
    let base = BaseParameters::of(&model);
    let truth = truth();
    let clean = motion(&model, 0.0);
    let (series, _) = wrench(&model, &truth, &clean, 0.0);
    let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(11);
    let mut q = clean.q.clone();
    for f in 0..N {
        let dv: Vec<f64> = (0..10)
            .map(|i| {
                let z: f64 = StandardNormal.sample(&mut rng);
                if i < 3 { 2e-4 * z } else { 1e-3 * z }
            })
            .collect();
        model.integrate(clean.q(f), &dv, &mut q[f * 12..(f + 1) * 12]);
    }
    let raw = Motion { q, v: Vec::new(), a: Vec::new(), ..clean.clone() };
    let filtered = smooth(&model, &raw);
    // plates: the true wrench, filtered like the motion, so that noise is the only error
    let mut flat: Vec<f64> = series.iter().flat_map(|w| <[f64; 6]>::from(*w)).collect();
    Butterworth::design(FILTER, RATE_HZ).unwrap().filtfilt_interleaved(&mut flat, 6);
    let plates = Measured {
        filtered: flat.chunks_exact(6).map(Vector6::from_column_slice).collect(),
        unfiltered: series,
        noise_density: Vector6::zeros(),
    };
    let body = Body { model: &model, base: &base, prior: &truth };
    let trial = TrialInput { unfiltered: Some(&raw), measured: Some(&plates), ..TrialInput::new(&filtered, &[]) };
    let candidates = [Candidate::links("truth", &base, &truth)];
    let again = |m: &Motion| Ok(smooth(&model, m));
    let filtering = Filtering { filter: Some(FILTER), smooth: &again };
    let options = CompareOptions { noise_draws: 4, frame_draws: 4, end_margin_frames: 60, ..CompareOptions::default() };
    let (c, _) = compare(&body, &candidates, &[trial], Noise::Drawn { filtering, of: None }, &options).unwrap();
    let floor = c.noise_floor.as_ref().unwrap();
    let ratio = c.first.held_out.size() / floor.contact.size();
    let weak = c.first.held_out_weak.size() / floor.contact_weak.size();
    assert!((0.85..1.15).contains(&ratio), "frames: {} {}", c.first.held_out.size(), floor.contact.size());
    assert!((0.7..1.3).contains(&weak), "windows: {} {}", c.first.held_out_weak.size(), floor.contact_weak.size());
    assert!(floor.contact_weak.size() < 0.35 * floor.contact.size());
    // one floor with its interval, the same everywhere
    let one = floor.contact_floor.unwrap();
    assert!((one.noise_floor / floor.contact_weak.size() - 1.0).abs() < 0.1 && one.draws == 4);
    let ci95 = one.ci95.unwrap();
    assert!(ci95[0] < one.noise_floor && one.noise_floor < ci95[1]);
    // a spread between bodies makes it wider, and nothing else
    let spread = CompareOptions { floor_spread: 0.2, ..options };
    let (wider, _) = compare(&body, &candidates, &[trial], Noise::Drawn { filtering, of: None }, &spread).unwrap();
    let wider = wider.noise_floor.unwrap().contact_floor.unwrap();
    let (before, after) = ((ci95[1] / one.noise_floor).ln(), (wider.ci95.unwrap()[1] / one.noise_floor).ln());
    assert!(wider.noise_floor == one.noise_floor && after > before.max(1.96 * 0.2), "{before} {after}");
    let against = &c.against_floor[0];
    assert!(against.judged_on == "contact" && against.at_floor == Some(true), "{against:?}");
    assert!((against.times_floor.unwrap() - c.first.held_out_weak.size() / one.noise_floor).abs() < 1e-12);
    // every group and every axis has a floor, and a floor taken from an earlier comparison is the
    // same
    for group in &c.first.breakdown {
        let own = group.floor(c.noise_floor.as_ref()).unwrap();
        assert!(own.errors.frames == 4 * group.errors.frames, "{}", group.name);
        assert!((0.6..1.6).contains(&(group.errors.size() / own.errors.size())), "{:?} {}", group.by, group.name);
        assert!(group.explainable(c.noise_floor.as_ref()).0.unwrap() < 0.65);
    }
    assert_eq!(c.axes.len(), 6);
    assert!(c.axes.iter().all(|a| a.explainable.iter().all(|e| e.is_some_and(|e| e < 0.5))));
    let (taken_over, _) = compare(&body, &candidates, &[trial], Noise::Known(floor), &options).unwrap();
    assert!(serde_json::to_value(&taken_over).unwrap() == serde_json::to_value(&c).unwrap());
    // contact that only identifies is drawn as well, and is no part of the floor
    let identifying = TrialInput { held_out_contact: false, ..trial };
    let noise = Noise::Drawn { filtering, of: None };
    let (both, _) = compare(&body, &candidates, &[trial, identifying], noise, &options).unwrap();
    let drawn = both.noise_floor.unwrap();
    assert_eq!((drawn.contact_floor, &drawn.groups.len()), (floor.contact_floor, &floor.groups.len()));
    let in_contact = |d: &aloft_compare::TrialDraws| d.in_flight.iter().filter(|flying| !**flying).count();
    let [held_out, identifies] = &drawn.draws[..] else { panic!("{} trials drawn", drawn.draws.len()) };
    assert!(held_out.held_out_contact && !identifies.held_out_contact);
    assert!(in_contact(identifies) > 0 && in_contact(identifies) == in_contact(held_out));
    assert!(identifies.errors.len() == 4 && identifies.errors[0].iter().any(|e| *e != 0.0));
    // the numbers are the same on every run, and after serialisation
    let (again, _) = compare(&body, &candidates, &[trial], Noise::Drawn { filtering, of: None }, &options).unwrap();
    let text = serde_json::to_value(&c).unwrap();
    assert!(serde_json::to_value(&again).unwrap() == text);
    for key in ["held_out", "flight"] {
        assert!(text[key].is_object());
    }
    assert!(text["held_out"]["force_n"]["mae"][0].is_number() && text["held_out"]["moment_nm"]["rmse"][2].is_number());
    assert!(text["flight"]["residual_force_n"]["rms"][0].is_null(), "no flight, no figure");
    let back: Comparison = serde_json::from_value(text.clone()).unwrap();
    assert!(serde_json::to_value(&back).unwrap() == text);
}

#[test]
fn input_that_does_not_fit_is_refused() {
    let model = tree();
    let base = BaseParameters::of(&model);
    let truth = truth();
    let m = motion(&model, 0.0);
    let body = Body { model: &model, base: &base, prior: &truth };
    let good = Candidate::links("truth", &base, &truth);
    let options = CompareOptions::default();
    let error = |candidates: &[Candidate], trial: TrialInput| {
        compare(&body, candidates, &[trial], Noise::Unknown, &options).unwrap_err().to_string()
    };
    let trial = TrialInput::new(&m, &[]);
    assert!(error(&[], trial).contains("no model"));
    assert!(error(&[Candidate::base("short", DVector::zeros(3))], trial).contains("short: base parameters: expected"));
    let raw = Motion { v: Vec::new(), ..m.clone() };
    assert!(error(std::slice::from_ref(&good), TrialInput::new(&raw, &[])).contains("no velocities"));
    let few = measured(vec![Vector6::zeros(); 3]);
    let trial = TrialInput { measured: Some(&few), ..trial };
    assert!(error(std::slice::from_ref(&good), trial).contains("expected 900, found 3"));
    let (nothing, _) = compare(&body, &[good], &[], Noise::Unknown, &options).unwrap();
    assert_eq!(nothing.first.held_out.frames, 0);
}
