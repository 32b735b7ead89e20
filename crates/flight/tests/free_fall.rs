//! Flights whose acceleration differs from the stated gravity: wrong frame rates and units of
//! length, body-weight support, tilted frames, other planets; and movements on the ground that must
//! not be detected as flights.
#![allow(clippy::unwrap_used, clippy::panic, clippy::print_stdout, reason = "helpers of tests, not library code")]

#[path = "../../../tests/shared_data.rs"]
mod shared_data;

use aloft_body::{JointSpec, LinkSpec, Model, ModelSpec, Motion, Phi};
use aloft_flight::{Cause, FlightMethod, FlightOptions, FlightReport, find_flights, from_motion};
use aloft_trial::{ImportOptions, Markers, Plate, Trial};
use nalgebra::{Rotation3, Vector3};

const MASS_KG: f64 = 60.0;

fn model(gravity_mps2: f64) -> (Model, Vec<Phi>) {
    let link = LinkSpec {
        name: "ball".to_owned(),
        parent: None,
        joint: JointSpec::Free,
        position_m: [0.0; 3],
        rpy_rad: [0.0; 3],
        inertia: None,
    };
    let mut model = Model::from_spec(&ModelSpec::new("ball".to_owned(), vec![link])).unwrap();
    model.gravity_mps2 = Vector3::new(0.0, 0.0, -gravity_mps2);
    (model, vec![Phi::from([MASS_KG, 0.0, 0.0, 0.0, 1.0, 1.0, 1.0, 0.0, 0.0, 0.0])])
}

fn motion(path: &[Vector3<f64>], rate_hz: f64) -> Motion {
    let q = path.iter().flat_map(|p| [p.x, p.y, p.z, 0.0, 0.0, 0.0, 1.0]).collect();
    Motion { trial: "case".to_owned(), rate_hz, nq: 7, nv: 6, q, ..Motion::default() }
}

/// Uniform random numbers from −1 to 1.
struct Dice(u64);
impl Dice {
    fn roll(&mut self) -> f64 {
        self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (self.0 >> 11) as f64 / (1_u64 << 52) as f64 - 1.0
    }
}

/// Faults of a recording of jumps.
#[derive(Debug, Clone, Copy)]
struct Fault {
    true_rate_hz: f64,
    stated_rate_hz: f64,
    /// Lengths in the file over true lengths.
    length: f64,
    /// Fraction of body weight carried by a rope.
    support: f64,
    tilt_deg: f64,
    true_gravity_mps2: f64,
    stated_gravity_mps2: f64,
}

const RIGHT: Fault = Fault {
    true_rate_hz: 200.0,
    stated_rate_hz: 200.0,
    length: 1.0,
    support: 0.0,
    tilt_deg: 0.0,
    true_gravity_mps2: 9.81,
    stated_gravity_mps2: 9.81,
};

impl Fault {
    /// Acceleration in the air as recorded in the file, m/s².
    fn shown_mps2(&self) -> f64 {
        (1.0 - self.support) * self.true_gravity_mps2 * self.length * (self.stated_rate_hz / self.true_rate_hz).powi(2)
    }
}

/// Stands, dips, pushes off, flies, lands and stands again, three times. The centre of mass has
/// camera noise (0.1 mm, white: that of many markers) and soft-tissue noise (0.5 mm, a few hertz);
/// the force is on a plate. Returns the frames in the air (end not included).
fn jumps(fault: &Fault, seed: u64) -> (Vec<Vector3<f64>>, Plate, Vec<(usize, usize)>) {
    let mut dice = Dice(seed);
    let air = -(1.0 - fault.support) * fault.true_gravity_mps2;
    let dt = 1.0 / (fault.true_rate_hz * 5.0);
    let mut acceleration: Vec<f64> = vec![0.0; (0.8 / dt) as usize];
    let mut flights = Vec::new();
    // A piece of given length and shape (0 to 1 in time) that changes the velocity by `change`.
    let piece = |out: &mut Vec<f64>, seconds: f64, change: f64, shape: &dyn Fn(f64) -> f64| {
        let n = (seconds / dt).round().max(2.0) as usize;
        let values: Vec<f64> = (0..n).map(|i| shape((i as f64 + 0.5) / n as f64)).collect();
        let sum: f64 = values.iter().sum::<f64>() * dt;
        out.extend(values.iter().map(|v| v * change / sum));
    };
    for _ in 0..3 {
        let takeoff_mps = 2.0 + 0.5 * dice.roll();
        // Plates cannot pull: with a small weight the dip is small too.
        let dip_mps = (0.6 + 0.2 * dice.roll()) * (-air / 6.0).min(1.0);
        piece(&mut acceleration, 0.35, -dip_mps, &|x| (std::f64::consts::PI * x).sin());
        piece(&mut acceleration, 0.3, dip_mps + takeoff_mps, &|x| (std::f64::consts::PI * x.powf(1.5)).sin());
        // The last push decays within 25 ms.
        let last = (0.025 / dt) as usize;
        acceleration.extend((0..last).map(|i| air * (i as f64 + 0.5) / last as f64));
        let lost = -0.5 * air * 0.025;
        let n = (2.0 * (takeoff_mps - lost) / -air / dt) as usize;
        flights.push((acceleration.len(), acceleration.len() + n));
        acceleration.extend(std::iter::repeat_n(air, n));
        let speed: f64 = acceleration.iter().sum::<f64>() * dt;
        piece(&mut acceleration, 0.3, -speed, &|x| if x < 0.06 { x / 0.06 } else { (1.0 - x) / 0.94 });
        acceleration.extend(std::iter::repeat_n(0.0, (0.4 / dt) as usize));
    }
    let phase: Vec<f64> = (0..6).map(|_| 3.0 * dice.roll()).collect();
    let turn = Rotation3::from_axis_angle(&Vector3::x_axis(), fault.tilt_deg.to_radians());
    let (mut z, mut v) = (1.0, 0.0);
    let mut path = Vec::new();
    let mut plate = Plate { name: "FP1".to_owned(), rate_hz: 5.0 * fault.stated_rate_hz, ..Plate::default() };
    for (tick, a) in acceleration.iter().enumerate() {
        if tick % 5 == 0 {
            let t = tick as f64 * dt;
            let tissue =
                Vector3::from_fn(|k, _| 0.0005 * ((12.0 * t + phase[k]).sin() + (23.0 * t + phase[k + 3]).sin()));
            let white = Vector3::from_fn(|_, _| 0.0002 * dice.roll());
            path.push(turn * (Vector3::new(0.1 * t, 0.0, z) + tissue + white) * fault.length);
        }
        z += v * dt + 0.5 * a * dt * dt;
        v += a * dt;
        plate.force_n.push(Vector3::new(0.0, 0.0, MASS_KG * (a - air) + 1.5 * dice.roll()));
        plate.moment_nm.push(Vector3::zeros());
    }
    let frames = flights.iter().map(|(a, b)| (a.div_ceil(5), b / 5)).collect();
    (path, plate, frames)
}

fn search(path: &[Vector3<f64>], plate: Option<Plate>, rate_hz: f64, gravity_mps2: f64) -> FlightReport {
    let (model, phi) = model(gravity_mps2);
    let motion = motion(path, rate_hz);
    let options = FlightOptions::default();
    let Some(plate) = plate else { return from_motion(&model, &phi, &motion, &options).unwrap() };
    let markers = Markers { rate_hz, first_frame: 1, n_frames: path.len(), ..Markers::default() };
    let trial = Trial { name: "case".to_owned(), markers, plates: vec![plate], ..Trial::default() };
    find_flights(&trial, Some((&model, &phi, &motion)), &options).unwrap()
}

/// Fault found in a case; `None` if all is correct.
fn wrong(fault: &Fault, seed: u64, with_plate: bool) -> Option<String> {
    let (path, plate, truth) = jumps(fault, seed);
    let report = search(&path, with_plate.then_some(plate), fault.stated_rate_hz, fault.stated_gravity_mps2);
    let found: Vec<(usize, usize)> = report.flights.iter().map(|f| (f.start, f.end)).collect();
    // Edges within 25 ms in the file's time, 100 ms where a weak acceleration requires a lower
    // cut-off.
    let weak = fault.shown_mps2() < 0.5 * 9.81;
    let near = (if weak { 0.100 } else { 0.025 } * fault.stated_rate_hz).ceil() as usize;
    let apart = |a: usize, b: usize| a.abs_diff(b) > near;
    if found.len() != truth.len() || found.iter().zip(&truth).any(|(f, t)| apart(f.0, t.0) || apart(f.1, t.1)) {
        return Some(format!("flights {found:?}, true {truth:?}"));
    }
    let Some(fall) = &report.free_fall else { return Some("no free fall".to_owned()) };
    if fault.stated_gravity_mps2 == 0.0 {
        return fall.ratio.map(|r| format!("a ratio of {r} to no gravity"));
    }
    let ratio = fault.shown_mps2() / fault.stated_gravity_mps2;
    let (Some(own), Some(ci95)) = (fall.ratio, fall.ratio_ci95) else { return Some("no ratio".to_owned()) };
    if !(ci95[0]..=ci95[1]).contains(&ratio) {
        return Some(format!("ratio {own:.4} in {ci95:.4?}, true {ratio:.4}"));
    }
    let differs = (ratio - 1.0).abs() > 0.03;
    let leans = fault.tilt_deg > 2.0;
    if (leans || fault.tilt_deg <= 1.0) && fall.differs != (differs || leans) {
        return Some(format!("differs: {}, ratio {own:.4} {ci95:.4?}, tilt {:?}", fall.differs, fall.tilt_deg));
    }
    let value = |cause: Cause| fall.explanations.iter().find(|e| e.cause == cause).map_or(f64::NAN, |e| e.value);
    let mut expected = Vec::new();
    if fault.true_rate_hz != fault.stated_rate_hz {
        expected.push((Cause::FrameRate, fault.true_rate_hz, 0.001));
    }
    if fault.length != 1.0 {
        expected.push((Cause::LengthUnit, fault.length, 0.001));
    }
    if fault.support != 0.0 {
        expected.push((Cause::VerticalForce, fault.support, 0.1));
    }
    if fault.true_gravity_mps2 != fault.stated_gravity_mps2 {
        // a value near the gravity of a place where bodies are tested is taken for that one
        let of_a_place = [1.62, 3.71].contains(&fault.true_gravity_mps2);
        expected.push((Cause::Gravity, fault.true_gravity_mps2, if of_a_place { 0.001 } else { 0.006 }));
    }
    if leans {
        expected.push((Cause::Vertical, fault.tilt_deg, 0.15));
    }
    let several = expected.len() > 1;
    expected
        .into_iter()
        // If two faults change the ratio, neither alone has its value.
        .filter(|(cause, ..)| !several || *cause == Cause::Vertical)
        .find(|(cause, x, share)| {
            let off = (value(*cause) / x - 1.0).abs();
            off.is_nan() || off >= *share
        })
        .map(|(cause, x, _)| format!("{cause:?} {} for {x}, of {:?}", value(cause), fall.explanations))
}

fn faults() -> Vec<Fault> {
    let mut all = vec![RIGHT];
    for (stated, real) in
        [(200, 240), (240, 200), (100, 120), (120, 100), (100, 200), (200, 100), (250, 200), (100, 250)]
    {
        all.push(Fault { stated_rate_hz: f64::from(stated), true_rate_hz: f64::from(real), ..RIGHT });
    }
    for rate in [100.0, 200.0, 250.0] {
        all.push(Fault { stated_rate_hz: rate, true_rate_hz: rate * 1.024, ..RIGHT });
    }
    for length in [0.1, 10.0, 0.001, 1000.0, 2.54, 1.0 / 2.54, 0.3048, 25.4, 1.0 / 25.4] {
        all.push(Fault { length, ..RIGHT });
    }
    for support in [0.1, 0.2, 0.3, 0.4, 0.5, 0.6] {
        all.push(Fault { support, ..RIGHT });
    }
    for tilt_deg in [3.0, 5.0, 10.0] {
        all.push(Fault { tilt_deg, ..RIGHT });
        all.push(Fault { tilt_deg, support: 0.4, ..RIGHT });
        all.push(Fault { tilt_deg, true_rate_hz: 240.0, ..RIGHT });
    }
    for g in [1.62, 3.71, 8.87] {
        all.push(Fault { true_gravity_mps2: g, ..RIGHT });
        all.push(Fault { true_gravity_mps2: g, stated_gravity_mps2: g, ..RIGHT });
    }
    all
}

#[test]
fn validate_flights_are_found_and_their_fault_is_named() {
    let mut lost = 0;
    for with_plate in [true, false] {
        let (mut tried, mut failed) = (0, Vec::new());
        for fault in faults() {
            for seed in 1..=12 {
                tried += 1;
                if let Some(problem) = wrong(&fault, seed, with_plate) {
                    failed.push(format!("{fault:?}, seed {seed}: {problem}"));
                }
            }
        }
        println!("plates {with_plate}: {} of {tried} cases as they should be", tried - failed.len());
        for f in failed.iter().take(30) {
            println!("  {f}");
        }
        lost += failed.len();
    }
    assert_eq!(lost, 0);
}

/// A body that floats between pushes, in a pipeline that states zero gravity.
#[test]
fn validate_zero_gravity_is_uniform_motion() {
    for seed in 1..=12 {
        let mut dice = Dice(seed);
        let (mut x, mut v) = (Vector3::zeros(), Vector3::new(0.2, 0.0, 0.1));
        let (mut path, mut truth) = (Vec::new(), Vec::new());
        for k in 0..5 {
            let floats = 1.0 + dice.roll().abs() * 3.0;
            let n = (floats * 200.0) as usize;
            truth.push((path.len(), path.len() + n));
            for _ in 0..n {
                path.push(x + Vector3::from_fn(|_, _| 0.0005 * dice.roll()));
                x += v / 200.0;
            }
            if k == 4 {
                break;
            }
            let push = Vector3::from_fn(|_, _| 6.0 * dice.roll());
            for i in 0..40 {
                path.push(x + Vector3::from_fn(|_, _| 0.0005 * dice.roll()));
                v += push * (std::f64::consts::PI * f64::from(i) / 40.0).sin() / 200.0;
                x += v / 200.0;
            }
        }
        let report = search(&path, None, 200.0, 0.0);
        let found: Vec<_> = report.flights.iter().map(|f| (f.start, f.end)).collect();
        assert_eq!(found.len(), truth.len(), "{found:?} {truth:?}");
        for (f, t) in found.iter().zip(&truth) {
            // Inside the true flight, with at most 200 ms lost at each end.
            assert!(f.0 >= t.0 && f.1 <= t.1 + 2 && f.0 <= t.0 + 40 && f.1 + 40 >= t.1, "{found:?} {truth:?}");
        }
        assert!(report.free_fall.is_some_and(|f| f.ratio.is_none() && !f.differs));
    }
    // a recording that floats from end to end is one flight
    let path: Vec<Vector3<f64>> = (0..3000).map(|i| Vector3::new(0.001 * f64::from(i), 0.0, 1.0)).collect();
    let report = search(&path, None, 200.0, 0.0);
    assert_eq!(report.flights.len(), 1);
    assert!(report.flights[0].n_frames() > 2950);
}

/// Standing, squatting, walking, sitting down: no flights, with and without plates.
#[test]
fn validate_movements_on_the_ground_are_no_flights() {
    let (mut tried, mut failed) = (0, Vec::new());
    for seed in 1..=12 {
        for (name, hz, metres) in [
            ("standing", 0.4, 0.004),
            ("slow squat", 0.3, 0.2),
            ("squat", 0.6, 0.2),
            ("fast squat", 1.0, 0.15),
            ("walking", 1.9, 0.025),
            ("fast walking", 2.4, 0.03),
            ("arm swing", 1.3, 0.04),
        ] {
            let mut dice = Dice(seed);
            let uneven = 0.3 * dice.roll();
            let path: Vec<Vector3<f64>> = (0..1200)
                .map(|i| {
                    let t = f64::from(i) / 200.0;
                    let angle = std::f64::consts::TAU * hz * t + uneven * (0.7 * t).sin();
                    let tissue =
                        Vector3::from_fn(|k, _| 0.001 * (17.0 * t + k as f64 + 3.0 * dice.roll() * 0.01).sin());
                    Vector3::new(0.6 * t, 0.3 * metres * (0.5 * angle).sin(), 1.0 + metres * angle.cos())
                        + tissue
                        + Vector3::from_fn(|_, _| 0.0005 * dice.roll())
                })
                .collect();
            let plate = Plate {
                name: "FP1".to_owned(),
                rate_hz: 1000.0,
                // Stepped on after one second.
                force_n: (0..6000)
                    .map(|i| Vector3::new(0.0, 0.0, if i < 1000 { dice.roll() } else { 600.0 }))
                    .collect(),
                moment_nm: vec![Vector3::zeros(); 6000],
                ..Plate::default()
            };
            for plate in [None, Some(plate)] {
                tried += 1;
                let report = search(&path, plate.clone(), 200.0, 9.81);
                if !report.flights.is_empty() {
                    failed.push(format!("{name}, plates {}, seed {seed}: {:?}", plate.is_some(), report.flights));
                }
            }
        }
    }
    println!("{} of {tried} movements on the ground without a flight", tried - failed.len());
    assert!(failed.is_empty(), "{}\n{}", failed.len(), failed.join("\n"));
}

/// Walks, stances and other real movements on the ground: the centroid of all markers in place of
/// the centre of mass.
#[test]
fn validate_real_movements_on_the_ground_are_no_flights() {
    let Some(root) = shared_data::shared_data("") else { return };
    let names = [
        "real_labs/lasem/FAILT01_static02.c3d",
        "real_labs/lasem/FAILT01_Walk01.c3d",
        "real_labs/lasem/FAILT01_Walk02.c3d",
        "real_labs/lasem/FAILT01_Walk03.c3d",
        "real_labs/opencap_unfiltered/MarkerData/walking2.trc",
        "real_labs/opencap_unfiltered/MarkerData/walking3.trc",
        "real_labs/opencap_unfiltered/MarkerData/walking4.trc",
        "real_drop_jump/markers/static1.trc",
        "real_drop_jump/markers/squats1.trc",
        "real_drop_jump/markers/squatsAsym1.trc",
        "real_landing/aStaticTrial_2.c3d",
        "subject_a/static.c3d",
        "subject_a/exercise01.c3d",
        "subject_a/exercise02.c3d",
        "subject_b/static.c3d",
        "subject_b/exercise01.c3d",
        "subject_b/exercise02.c3d",
        "c3d_samples/sample_26/Walking_Hybrid_1_3.c3d",
        "c3d_samples/sample_26/Walking_Hybrid_1_4.c3d",
        "c3d_samples/sample_26/Walking_Hybrid_1_5.c3d",
        "c3d_samples/sample_26/Walking_Hybrid_2.c3d",
        "c3d_samples/sample_30/admarche2.c3d",
        "c3d_samples/sample_30/marche281.c3d",
        "c3d_samples/sample_00/Innovative_Sports_Training/Gait_with_EMG.c3d",
        "c3d_samples/sample_00/Innovative_Sports_Training/Static_Pose.c3d",
    ];
    let (mut tried, mut failed) = (0, Vec::new());
    for name in names {
        let options = ImportOptions::default();
        let path = root.join(name);
        let trial = if name.ends_with("trc") {
            let Ok(text) = std::fs::read_to_string(&path) else { continue };
            Trial::from_trc_mot(name, &text, None, &options)
        } else {
            let Ok(bytes) = std::fs::read(&path) else { continue };
            Trial::from_c3d(name, &bytes, &options)
        };
        let Ok(trial) = trial else {
            println!("skipped: {name} cannot be read");
            continue;
        };
        let Some(centroid) = centroid(&trial) else {
            println!("skipped: {name} has no five markers together");
            continue;
        };
        let (model, phi) = model(9.81);
        let motion = motion(&centroid, trial.markers.rate_hz);
        let options = FlightOptions::default();
        if trial.markers.rate_hz < 45.0 || centroid.len() < 40 {
            continue;
        }
        tried += 1;
        let mut reports = vec![from_motion(&model, &phi, &motion, &options).unwrap()];
        if !trial.plates.is_empty() {
            reports.push(find_flights(&trial, Some((&model, &phi, &motion)), &options).unwrap());
        }
        for report in reports.iter().filter(|r| !r.flights.is_empty()) {
            failed.push(format!("{name}: {:?}", report.flights));
        }
    }
    println!("{} of {tried} real movements on the ground without a flight", tried - failed.len());
    assert!(failed.is_empty() && tried > 15, "{tried}\n{}", failed.join("\n"));
}

/// Mean per frame of the markers seen in at least half of the frames; NaN if one of them is
/// missing.
fn centroid(trial: &Trial) -> Option<Vec<Vector3<f64>>> {
    let n = trial.markers.n_frames;
    let seen = |t: &[Vector3<f64>]| t.iter().filter(|p| p.x.is_finite()).count();
    let tracks: Vec<&Vec<Vector3<f64>>> =
        trial.markers.trajectories.iter().filter(|t| 2 * seen(t) >= n && n > 0).collect();
    if tracks.len() < 5 {
        return None;
    }
    let whole = |f: usize| tracks.iter().all(|t| t[f].x.is_finite());
    let mean = |f: usize| tracks.iter().map(|t| t[f]).sum::<Vector3<f64>>() / tracks.len() as f64;
    Some((0..n).map(|f| if whole(f) { mean(f) } else { Vector3::repeat(f64::NAN) }).collect())
}

/// A toss of 21 frames that was cut before the impact, with noise of half a millimetre: all of it
/// is a flight. A body that slides as long on the floor has none, at no acceleration.
#[test]
fn a_toss_cut_in_the_air_is_a_flight_from_end_to_end() {
    let mut dice = Dice(7);
    let mut found = [0, 0];
    for _ in 0..40 {
        let mut path = |a: Vector3<f64>| -> Vec<Vector3<f64>> {
            let v = Vector3::new(1.5 * dice.roll(), 1.5 * dice.roll(), 0.8 * dice.roll() * -a.z / 9.81);
            let noise = |dice: &mut Dice| Vector3::new(dice.roll(), dice.roll(), dice.roll()) * (5e-4 * 3f64.sqrt());
            (0..21).map(|i| f64::from(i) / 148.0).map(|t| v * t + a * (0.5 * t * t) + noise(&mut dice)).collect()
        };
        let toss = search(&path(Vector3::new(0.0, 0.0, -9.81)), None, 148.0, 9.81);
        found[0] += usize::from(toss.flights.first().is_some_and(|f| (f.start, f.end) == (0, 21)));
        found[1] += search(&path(Vector3::new(-2.1, 0.3, 0.0)), None, 148.0, 9.81).flights.len();
    }
    assert!(found[0] >= 38 && found[1] == 0, "{found:?}");
}

#[test]
fn stated_flights_are_taken_as_they_are() {
    let (model, phi) = model(9.81);
    let path: Vec<Vector3<f64>> =
        (0..200).map(|i| f64::from(i) / 100.0).map(|t| Vector3::z() * (1.0 - 4.905 * (t - 0.6).powi(2))).collect();
    let mut motion = motion(&path, 100.0);
    motion.q[7 * 60] = f64::NAN;
    let markers = Markers { rate_hz: 100.0, first_frame: 1, n_frames: 200, ..Markers::default() };
    let trial = Trial { name: "case".to_owned(), markers, ..Trial::default() };
    let of = |stated_s: Vec<[f64; 2]>| {
        let options = FlightOptions { method: FlightMethod::Stated, stated_s, ..FlightOptions::default() };
        let report = find_flights(&trial, Some((&model, &phi, &motion)), &options).unwrap();
        assert!(report.flights.iter().all(|f| (f.mean_acceleration_mps2[2] + 9.81).abs() < 1e-6));
        report.flights.iter().map(|f| (f.start, f.end)).collect::<Vec<_>>()
    };
    assert_eq!(of(vec![[0.1, 0.3], [1.0, 99.0]]), [(10, 30), (100, 200)]);
    // where the motion is not solved there is no flight; a frame or two are none, either
    assert_eq!(of(Vec::new()), [(0, 60), (61, 200)]);
    assert_eq!(of(vec![[0.57, 0.80], [5.0, 6.0]]), [(61, 80)]);
}
