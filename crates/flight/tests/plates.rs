//! Flights and tares from plates: simulated subject with known truth, real jumps.
#![allow(clippy::unwrap_used, clippy::panic, clippy::print_stdout, reason = "helpers of tests, not library code")]

#[path = "../../../tests/shared_data.rs"]
mod shared_data;

use aloft_body::{JointSpec, LinkSpec, Model, ModelSpec, Motion, Phi};
use aloft_flight::{
    EdgeSource, FlightMethod, FlightOptions, FlightSource, RejectionReason, TareSource, apply_tare, find_flights,
    from_motion, from_plates, plate_wrench_at_marker_rate, tare, total_wrench,
};
use aloft_signal::LowPass;
use aloft_trial::{ImportOptions, Plate, Trial};
use nalgebra::Vector3;

/// Frames in the air of `subject_a`, end not included.
const SUBJECT_A: [&[(usize, usize)]; 8] = [
    &[(243, 349), (452, 553), (637, 736)],
    &[(229, 329), (421, 524)],
    &[(256, 356), (470, 578), (676, 780)],
    &[(252, 363), (463, 564), (655, 760)],
    &[(258, 357), (449, 553)],
    &[(249, 354), (455, 558), (674, 784)],
    &[(252, 361), (458, 562)],
    &[(227, 330), (411, 519), (610, 721)],
];

fn data(name: &str) -> Option<Vec<u8>> {
    shared_data::shared_data(name).map(|path| std::fs::read(path).unwrap())
}

fn c3d(name: &str) -> Option<Trial> {
    Some(Trial::from_c3d(name, &data(name)?, &ImportOptions::default()).unwrap())
}

fn drop_jump(name: &str) -> Option<Trial> {
    let trc = String::from_utf8(data(&format!("real_drop_jump/markers/{name}.trc"))?).unwrap();
    let mot = String::from_utf8(data(&format!("real_drop_jump/forces/{name}_grf.mot"))?).unwrap();
    Some(Trial::from_trc_mot(name, &trc, Some(&mot), &ImportOptions::default()).unwrap())
}

fn search(trial: &Trial) -> aloft_flight::FlightReport {
    from_plates(trial, trial.markers.n_frames, trial.markers.rate_hz, &FlightOptions::default())
}

#[test]
fn validate_simulated_jumps_from_plates() {
    for (index, truth) in SUBJECT_A.iter().enumerate() {
        let Some(trial) = c3d(&format!("subject_a/jump{:02}.c3d", index + 1)) else { return };
        let report = search(&trial);
        assert_eq!(report.flights.len(), truth.len(), "{report:?}");
        for (flight, &(start, end)) in report.flights.iter().zip(*truth) {
            assert!(flight.start >= start && flight.end <= end, "{}: {flight:?} {start} {end}", index + 1);
            assert!(flight.start <= start + 2 && flight.end + 2 >= end, "{}: {flight:?} {start} {end}", index + 1);
        }
    }
    for name in ["static", "exercise01", "exercise02"] {
        let report = search(&c3d(&format!("subject_a/{name}.c3d")).unwrap());
        assert!(report.flights.is_empty(), "{report:?}");
    }
}

#[test]
fn tare_from_flights_leaves_nothing_in_the_air() {
    let Some(mut trial) = c3d("subject_a/jump01.c3d") else { return };
    // An offset and a drift on one plate, as amplifiers produce them.
    let n = trial.plates[0].force_n.len();
    for sample in 0..n {
        let drift = sample as f64 / n as f64;
        trial.plates[0].force_n[sample] += Vector3::new(4.0, -3.0, 8.0 + 5.0 * drift);
        trial.plates[0].moment_nm[sample] += Vector3::new(1.0, 2.0 * drift, 0.5);
    }
    let report = search(&trial);
    assert_eq!(report.flights.len(), 3);
    let own = &report.tare[0];
    assert!((own.force_n[0].z - 10.5).abs() < 2.0, "{own:?}");
    let before = trial.clone();
    let tares = tare(&mut trial, &report.flights);
    for tare in &tares {
        println!("{}: {:?} N, noise {:.2} N, {} samples", tare.plate, tare.force_n, tare.noise_n, tare.samples);
        assert!((tare.noise_n - 1.0).abs() < 0.15);
    }
    for flight in &report.flights {
        for plate in &trial.plates {
            let samples = (flight.start + 3) * 5..(flight.end - 3) * 5;
            let mean = plate.force_n[samples.clone()].iter().sum::<Vector3<f64>>() / samples.len() as f64;
            let moment = plate.moment_nm[samples.clone()].iter().sum::<Vector3<f64>>() / samples.len() as f64;
            assert!(mean.norm() < 0.3 && moment.norm() < 0.05, "{mean} {moment}");
        }
    }
    // The same values can be applied to another recording of the session; without known flights,
    // the stretches without load serve.
    let mut other = before.clone();
    apply_tare(&mut other, &tares);
    assert!(other.plates == trial.plates);
    let mut still = before.clone();
    let own = tare(&mut still, &[]);
    assert!(own.iter().all(|t| t.source == TareSource::OwnReadings));
    assert!((own[0].force_n[0].z - 10.5).abs() < 2.0, "{own:?}");
    // a plate that is loaded all the time keeps its readings
    let mut loaded = before.clone();
    for force in &mut loaded.plates[1].force_n {
        force.z = 300.0 + 0.1 * force.z;
    }
    assert_eq!(tare(&mut loaded, &[])[1].source, TareSource::None);
}

#[test]
fn validate_plates_at_the_rate_of_the_markers() {
    let Some(trial) = c3d("subject_a/static.c3d") else { return };
    let filter = LowPass { order: 3, cutoff_hz: 10.0, correction: Default::default() };
    let plates = plate_wrench_at_marker_rate(&trial, Some(filter)).unwrap();
    let total = total_wrench(&plates);
    assert_eq!((plates.len(), total.force_n.len()), (2, trial.markers.n_frames));
    let mean = total.force_n.iter().sum::<Vector3<f64>>() / total.force_n.len() as f64;
    assert!((mean.z / 9.81 - 56.2).abs() < 0.3, "{mean}");
    let bare = total_wrench(&plate_wrench_at_marker_rate(&trial, None).unwrap());
    assert!((bare.force_n[100].z - total.force_n[100].z).abs() < 4.0);
    let wrong = LowPass { cutoff_hz: 900.0, ..filter };
    let error = plate_wrench_at_marker_rate(&trial, Some(wrong)).unwrap_err().to_string();
    assert!(error.starts_with("subject_a/static.c3d: plates: "), "{error}");
}

#[test]
fn regress_drop_jumps_have_one_flight_between_plates_and_the_box_is_none() {
    for name in ["DJ1", "DJ2", "DJ3", "DJAsym1", "DJAsym2", "DJAsym3"] {
        let Some(trial) = drop_jump(name) else { return };
        let report = search(&trial);
        let flights: Vec<_> = report.flights.iter().map(|f| (f.start, f.end)).collect();
        println!("{name}: {flights:?} of {} frames, rejected {:?}", trial.markers.n_frames, report.rejected);
        assert_eq!(flights.len(), 1);
        assert!((0.3..0.45).contains(&report.flights[0].duration_s(100.0)));
        assert!(report.rejected.iter().any(|r| r.start == 0 && r.reason == RejectionReason::NotBounded));
    }
    for name in ["squats1", "squatsAsym1", "static1"] {
        let report = search(&drop_jump(name).unwrap());
        assert!(report.flights.is_empty(), "{name}: {report:?}");
    }
}

#[test]
fn regress_real_jump_with_offset_plates() {
    let Some(trial) = c3d("real_landing/Sample_Jump2.c3d") else { return };
    let report = search(&trial);
    println!("{:?}", report.tare);
    let [flight] = &report.flights[..] else { panic!("{report:?}") };
    assert!(
        (flight.start as f64 / 120.0 - 0.71).abs() < 0.02 && (flight.end as f64 / 120.0 - 1.18).abs() < 0.02,
        "{flight:?}"
    );
    assert!(report.tare.iter().any(|t| t.force_n[0].norm() > 15.0));
}

/// A ball that stands on a box, falls onto a plate, jumps, and lands beside the plate; 200 Hz.
fn ball() -> (Model, Vec<Phi>, Motion, Trial) {
    let link = LinkSpec {
        name: "ball".to_owned(),
        parent: None,
        joint: JointSpec::Free,
        position_m: [0.0; 3],
        rpy_rad: [0.0; 3],
        inertia: None,
    };
    let model = Model::from_spec(&ModelSpec::new("ball".to_owned(), vec![link])).unwrap();
    let phi = vec![Phi::from([60.0, 0.0, 0.0, 0.0, 1.0, 1.0, 1.0, 0.0, 0.0, 0.0])];
    let g = 9.80665;
    // Accelerations piece by piece: (frames, upward acceleration in g, plate loaded).
    let pieces = [
        (100, 0.0, false),
        (70, -1.0, false),
        (30, 2.333_333, true),
        (20, 1.5, true),
        (61, -1.0, false),
        (80, 0.762_5, false),
    ];
    let mut trial = Trial { name: "ball".to_owned(), ..Trial::default() };
    let mut plate = Plate { name: "FP1".to_owned(), rate_hz: 1000.0, ..Plate::default() };
    let (mut z, mut v) = (2.0, 0.0);
    let mut q = Vec::new();
    for (frames, a, loaded) in pieces {
        for _ in 0..frames {
            q.extend([0.0, 0.0, z, 0.0, 0.0, 0.0, 1.0]);
            z += v / 200.0 + 0.5 * a * g / 40_000.0;
            v += a * g / 200.0;
            for _ in 0..5 {
                plate.force_n.push(Vector3::new(0.0, 0.0, if loaded { 60.0 * g * (1.0 + a) } else { 0.0 }));
                plate.moment_nm.push(Vector3::zeros());
            }
        }
    }
    let n_frames = q.len() / 7;
    trial.markers.rate_hz = 200.0;
    trial.markers.n_frames = n_frames;
    trial.plates = vec![plate];
    (model, phi, Motion { trial: "ball".to_owned(), rate_hz: 200.0, nq: 7, nv: 6, q, ..Motion::default() }, trial)
}

#[test]
fn motion_and_plates_complete_each_other() {
    let (model, phi, motion, trial) = ball();
    let options = FlightOptions::default();
    // Plates alone detect neither the box nor the landing beside them.
    let plates = search(&trial);
    assert!(plates.flights.is_empty());
    assert_eq!(plates.rejected.len(), 2);
    let both = find_flights(&trial, Some((&model, &phi, &motion)), &options).unwrap();
    let [drop, jump] = &both.flights[..] else { panic!("{both:?}") };
    assert!((100..=106).contains(&drop.start) && (168..=170).contains(&drop.end), "{drop:?}");
    assert_eq!(
        (drop.takeoff_source, drop.landing_source, drop.source),
        (EdgeSource::Motion, EdgeSource::Plates, FlightSource::Both)
    );
    assert!((220..=222).contains(&jump.start) && (277..=281).contains(&jump.end), "{jump:?}");
    assert_eq!((jump.takeoff_source, jump.landing_source), (EdgeSource::Plates, EdgeSource::Motion));
    assert!((jump.mean_acceleration_mps2[2] + 9.80665).abs() < 0.1);
    let alone = find_flights(&trial, None, &FlightOptions { method: FlightMethod::Motion, ..options }).unwrap_err();
    assert_eq!(alone.to_string(), "ball: flights by `motion` need a motion, which this trial does not have");
}

/// The true centre of mass of a simulated person as the motion of a ball; noise of half a
/// millimetre.
#[test]
fn validate_motion_agrees_with_plates_and_truth_within_two_frames() {
    let (model, phi, ..) = ball();
    let goldens =
        [(1, include_str!("golden/subject_a_jump01_com.csv")), (8, include_str!("golden/subject_a_jump08_com.csv"))];
    for (number, text) in goldens {
        let mut q = Vec::new();
        let mut seed = 1_u64;
        let mut noise = || {
            seed = seed.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            ((seed >> 11) as f64 / (1_u64 << 53) as f64 - 0.5) * 0.0005 * 12.0_f64.sqrt()
        };
        for line in text.lines() {
            q.extend(line.split(',').map(|x| x.parse::<f64>().unwrap() + noise()));
            q.extend([0.0, 0.0, 0.0, 1.0]);
        }
        let motion = Motion { trial: "jump".to_owned(), rate_hz: 200.0, nq: 7, nv: 6, q, ..Motion::default() };
        let by_motion = from_motion(&model, &phi, &motion, &FlightOptions::default()).unwrap();
        let truth = SUBJECT_A[number - 1];
        assert_eq!(by_motion.flights.len(), truth.len());
        let plates = c3d(&format!("subject_a/jump{number:02}.c3d")).map(|trial| search(&trial));
        for (index, (flight, &(start, end))) in by_motion.flights.iter().zip(truth).enumerate() {
            println!(
                "jump {number}: start {:+}, end {:+}",
                flight.start as i64 - start as i64,
                flight.end as i64 - end as i64
            );
            assert!(flight.start >= start && flight.end <= end, "{flight:?} {start} {end}");
            assert!(flight.start <= start + 3 && flight.end + 3 >= end, "{flight:?} {start} {end}");
            if let Some(plates) = &plates {
                let other = &plates.flights[index];
                assert!(
                    flight.start.abs_diff(other.start) <= 2 && flight.end.abs_diff(other.end) <= 2,
                    "{flight:?} {other:?}"
                );
            }
        }
    }
}
