//! The thrown chain: no plates, 30 throws, held in the hand between throws. Poses directly from the
//! markers of each link.
#![allow(clippy::unwrap_used, clippy::panic, clippy::print_stdout, reason = "helpers of tests, not library code")]

#[path = "../../../tests/shared_data.rs"]
mod shared_data;

use aloft_body::rigid::fit_pose;
use aloft_body::{JointSpec, LinkSpec, Model, ModelSpec, Motion, Phi};
use aloft_flight::{FlightOptions, FlightReport, from_motion};
use aloft_trial::{GapOptions, ImportOptions, Trial, fill_gaps};
use nalgebra::{Matrix3, Rotation3, UnitQuaternion, Vector3};

const LINK0: [[f64; 3]; 5] =
    [[0.0, 0.0, 0.0], [0.0, 0.235, 0.0], [0.0, 0.105, 0.055], [0.048, 0.17, 0.02], [-0.045, 0.06, -0.018]];
const LINK1: [[f64; 3]; 4] = [[-0.205, 0.0, 0.022], [-0.12, 0.05, 0.01], [-0.065, -0.04, 0.03], [-0.15, -0.045, -0.02]];
const HINGE: [f64; 3] = [0.000_779_512_804_497_189_4, -0.029_984_409_743_910_055, 0.011_988_307_307_932_542];
const HINGE_AXES: [f64; 9] = [
    -0.019_529_812_951_179_098,
    0.015_594_743_507_992_998,
    0.999_687_646_408_122_8,
    0.999_344_800_936_491_6,
    -0.030_169_830_709_694_145,
    0.019_993_752_928_162_457,
    0.030_472_204_503_382_52,
    0.999_423_126_253_274_5,
    -0.014_995_314_696_121_842,
];

/// Frames in which the hand force is exactly zero, end not included.
const CHAIN_A: [[(usize, usize); 6]; 5] = [
    [(461, 620), (1113, 1276), (1720, 1869), (2335, 2492), (2955, 3082), (3576, 3726)],
    [(442, 578), (1066, 1223), (1680, 1832), (2328, 2461), (2936, 3067), (3514, 3646)],
    [(435, 573), (1096, 1239), (1672, 1834), (2307, 2466), (2882, 3029), (3519, 3677)],
    [(462, 606), (1056, 1198), (1672, 1813), (2298, 2427), (2875, 3031), (3480, 3605)],
    [(453, 586), (1100, 1242), (1690, 1850), (2281, 2435), (2875, 3013), (3472, 3605)],
];
const CHAIN_P: [[(usize, usize); 6]; 5] = [
    [(409, 563), (1051, 1190), (1656, 1816), (2312, 2470), (2950, 3102), (3514, 3641)],
    [(467, 596), (1079, 1240), (1769, 1899), (2403, 2559), (3045, 3205), (3638, 3763)],
    [(421, 577), (1062, 1218), (1744, 1893), (2317, 2465), (2876, 3006), (3437, 3573)],
    [(445, 608), (1076, 1219), (1679, 1815), (2291, 2434), (2961, 3089), (3583, 3722)],
    [(405, 567), (1045, 1184), (1659, 1807), (2307, 2459), (2915, 3069), (3490, 3639)],
];

fn model() -> Model {
    let (roll, pitch, yaw) = Rotation3::from_matrix_unchecked(Matrix3::from_row_slice(&HINGE_AXES)).euler_angles();
    let link = |name: &str, parent: Option<&str>, joint| LinkSpec {
        name: name.to_owned(),
        parent: parent.map(str::to_owned),
        joint,
        position_m: if parent.is_some() { HINGE } else { [0.0; 3] },
        rpy_rad: if parent.is_some() { [roll, pitch, yaw] } else { [0.0; 3] },
        inertia: None,
    };
    let links = vec![link("link0", None, JointSpec::Free), link("link1", Some("link0"), JointSpec::RevoluteZ)];
    Model::from_spec(&ModelSpec::new("chain".to_owned(), links)).unwrap()
}

/// A rough guess: half of the mass in each link, at the middle of its markers.
fn prior() -> [Phi; 2] {
    let phi = |markers: &[[f64; 3]]| {
        let middle = markers.iter().map(|m| Vector3::from(*m)).sum::<Vector3<f64>>() / markers.len() as f64;
        let h = middle * 0.4985;
        Phi::from([0.4985, h.x, h.y, h.z, 0.01, 0.01, 0.01, 0.0, 0.0, 0.0])
    };
    [phi(&LINK0), phi(&LINK1)]
}

fn motion(folder: &str, number: usize) -> Option<Motion> {
    let path = shared_data::shared_data(&format!("{folder}/throws_{number:02}.c3d"))?;
    let bytes = std::fs::read(path).unwrap();
    let mut trial = Trial::from_c3d("throws", &bytes, &ImportOptions::default()).unwrap();
    let names = |link: usize, n: usize| (1..=n).map(|k| format!("L{link}_{k}")).collect::<Vec<_>>();
    fill_gaps(&mut trial, &[names(0, 5), names(1, 4)], &GapOptions::default());
    let pose = |labels: &[String], local: &[[f64; 3]], frame: usize| {
        let (mut from, mut to) = (Vec::new(), Vec::new());
        for (label, local) in labels.iter().zip(local) {
            if let Some(p) = trial.markers.position(trial.markers.index(label).unwrap(), frame) {
                from.push(Vector3::from(*local));
                to.push(p);
            }
        }
        fit_pose(&from, &to, 0.01)
    };
    let hinge = UnitQuaternion::from_matrix(&Matrix3::from_row_slice(&HINGE_AXES));
    let mut q = Vec::new();
    for frame in 0..trial.markers.n_frames {
        match (pose(&names(0, 5), &LINK0, frame), pose(&names(1, 4), &LINK1, frame)) {
            (Some(base), Some(link)) => {
                let turn = (base.rotation * hinge).inverse() * link.rotation;
                let (t, r) = (base.translation.vector, base.rotation);
                q.extend([t.x, t.y, t.z, r.i, r.j, r.k, r.w, 2.0 * turn.k.atan2(turn.w)]);
            }
            _ => q.extend([f64::NAN; 8]),
        }
    }
    Some(Motion { trial: format!("{folder} {number}"), rate_hz: 200.0, nq: 8, nv: 7, q, ..Motion::default() })
}

fn find(folder: &str, number: usize, options: &FlightOptions) -> Option<FlightReport> {
    Some(from_motion(&model(), &prior(), &motion(folder, number)?, options).unwrap())
}

#[test]
fn validate_all_throws_are_found_and_no_contact_frame_is_inside() {
    for (folder, truth) in [("chain_a", CHAIN_A), ("chain_p", CHAIN_P)] {
        let mut lost = 0;
        for (index, truth) in truth.iter().enumerate() {
            let Some(report) = find(folder, index + 1, &FlightOptions::default()) else { return };
            assert_eq!(report.flights.len(), 6, "{folder} {}: {report:?}", index + 1);
            for (flight, &(start, end)) in report.flights.iter().zip(truth) {
                assert!(flight.start >= start && flight.end <= end, "{folder} {}: {flight:?} {start} {end}", index + 1);
                assert!(flight.start <= start + 4 && flight.end + 4 >= end, "{folder} {}: {flight:?}", index + 1);
                assert!((flight.mean_acceleration_mps2[2] + 9.81).abs() < 0.15, "{flight:?}");
                lost += end - start - flight.n_frames();
            }
        }
        println!("{folder}: 30 flights, {lost} frames in the air lost at their edges");
    }
}

#[test]
fn regress_chain_with_something_hidden_gives_thirty_flights() {
    let mut count = 0;
    for number in 1..=5 {
        let Some(report) = find("chain_b", number, &FlightOptions::default()) else { return };
        count += report.flights.len();
    }
    assert_eq!(count, 30);
}

#[test]
fn a_margin_shortens_and_a_wrong_motion_is_an_error() {
    let Some(motion) = motion("chain_a", 1) else { return };
    let plain = from_motion(&model(), &prior(), &motion, &FlightOptions::default()).unwrap();
    let options = FlightOptions { margin_frames: 14, ..FlightOptions::default() };
    let trimmed = from_motion(&model(), &prior(), &motion, &options).unwrap();
    for (a, b) in plain.flights.iter().zip(&trimmed.flights) {
        assert_eq!((a.start + 14, a.end - 14), (b.start, b.end));
        assert_eq!(a.frames_within(14), b.frames());
    }
    let error = from_motion(&model(), &prior()[..1], &motion, &options).unwrap_err().to_string();
    assert!(error.starts_with("chain_a 1: ") && !error.contains('\n'), "{error}");
}
