//! Synthetic subjects and trials: the geometry of a simulated person, a two-link chain, smooth
//! motions.
#![allow(dead_code, clippy::unwrap_used, reason = "test support: each test file uses a part of it, and may panic")]

use aloft_body::subject::PriorSd;
use aloft_body::{JointSpec, LinkInertia, LinkSpec, Model, ModelMarker, ModelSpec, PersonFacts, State, Subject};
use aloft_trial::{Markers, Trial};
use nalgebra::{Matrix3, Vector3};
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, Normal};

fn vector(value: &serde_json::Value) -> [f64; 3] {
    [0, 1, 2].map(|i| value[i].as_f64().unwrap())
}

fn subject(name: &str, spec: &ModelSpec, markers: Vec<ModelMarker>) -> Subject {
    let model = Model::from_spec(spec).unwrap();
    let n = model.n_links();
    let inertia = LinkInertia { mass_kg: 1.0, com_m: Vector3::zeros(), inertia_com_kgm2: Matrix3::identity() * 0.01 };
    let static_q = model.neutral();
    Subject {
        facts: PersonFacts { name: name.to_owned(), sex: None, height_m: None, mass_kg: n as f64 },
        markers,
        prior: vec![inertia; n],
        prior_sd: vec![PriorSd { mass_rel: 0.1, com_m: 0.01, radius_rel: 0.1, together: 0.0 }; n],
        static_q,
        provenance: Vec::new(),
        model,
        estimated: None,
        boxes: Vec::new(),
    }
}

/// The 34-joint-coordinate person with 35 markers; the resting posture has slightly bent elbows and
/// knees.
pub fn person() -> Subject {
    let text = include_str!("../data/human34.json");
    let data: serde_json::Value = serde_json::from_str(text).unwrap();
    let links = data["links"].as_array().unwrap().iter().map(|link| LinkSpec {
        name: link["name"].as_str().unwrap().to_owned(),
        parent: link["parent"].as_str().map(str::to_owned),
        joint: match link["joint"].as_str().unwrap() {
            "free" => JointSpec::Free,
            "spherical" => JointSpec::Spherical,
            _ => JointSpec::RevoluteZ,
        },
        position_m: vector(&link["position_m"]),
        rpy_rad: [0.0; 3],
        inertia: None,
    });
    let spec = ModelSpec::new("human34".to_owned(), links.collect());
    let index = |name: &str| spec.links.iter().position(|l| l.name == name).unwrap();
    let markers = data["markers"].as_array().unwrap().iter().map(|m| ModelMarker {
        label: m["label"].as_str().unwrap().to_owned(),
        link: index(m["link"].as_str().unwrap()),
        position_m: Vector3::from(vector(&m["position_m"])),
        weight: 1.0,
    });
    let mut subject = subject("person", &spec, markers.collect());
    // Upright in a Z-up world, limbs slightly bent.
    let up = nalgebra::UnitQuaternion::from_axis_angle(&Vector3::x_axis(), std::f64::consts::FRAC_PI_2);
    subject.static_q[2] = 0.85;
    subject.static_q[3..7].copy_from_slice(up.coords.as_slice());
    for link in &subject.model.links {
        let bend = match link.name.split('_').next() {
            Some("forearm") => 0.25,
            Some("shank") => -0.2,
            _ => continue,
        };
        subject.static_q[link.joint.q_offset] = bend;
    }
    subject
}

/// Two links with one hinge, five and four markers.
pub fn chain() -> Subject {
    let link = |name: &str, parent: Option<&str>, joint, position_m| LinkSpec {
        name: name.to_owned(),
        parent: parent.map(str::to_owned),
        joint,
        position_m,
        rpy_rad: [0.0, 0.9, 0.3],
        inertia: None,
    };
    let spec = ModelSpec {
        name: "two_link".to_owned(),
        links: vec![
            link("link0", None, JointSpec::Free, [0.0; 3]),
            link("link1", Some("link0"), JointSpec::RevoluteZ, [0.001, -0.03, 0.012]),
        ],
        carries: Default::default(),
    };
    let places = [
        (0, [0.0, 0.0, 0.0]),
        (0, [0.0, 0.25, 0.0]),
        (0, [0.0, 0.1, 0.08]),
        (0, [0.05, 0.05, -0.04]),
        (0, [-0.06, 0.2, 0.03]),
        (1, [-0.1, 0.0, 0.0]),
        (1, [-0.2, 0.05, 0.02]),
        (1, [-0.15, -0.06, -0.03]),
        (1, [-0.05, 0.03, 0.06]),
    ];
    let markers = places.iter().enumerate().map(|(i, (link, at))| ModelMarker {
        label: format!("M{i}"),
        link: *link,
        position_m: Vector3::from(*at),
        weight: 1.0,
    });
    subject("chain", &spec, markers.collect())
}

/// A smooth motion about the resting posture: one q per frame. `size` scales the joint angles.
pub fn motion(subject: &Subject, n_frames: usize, rate_hz: f64, size: f64, seed: u64) -> Vec<Vec<f64>> {
    let model = &subject.model;
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let normal = Normal::new(0.0, 1.0).unwrap();
    let waves: Vec<[f64; 4]> = (0..model.nv).map(|_| [0; 4].map(|_| normal.sample(&mut rng))).collect();
    (0..n_frames)
        .map(|frame| {
            let t = frame as f64 / rate_hz;
            let mut dv: Vec<f64> = waves
                .iter()
                .map(|w| size * (w[0] * (3.0 * t + w[1]).sin() + 0.5 * w[2] * (5.0 * t + w[3]).sin()))
                .collect();
            for link in &model.links {
                let side = match link.name.split('_').next() {
                    Some("forearm") => 1.0,
                    Some("shank") => -1.0,
                    _ => continue,
                };
                // Limbs bend in one direction.
                dv[link.joint.v_offset] = side * (dv[link.joint.v_offset].abs() + 0.05);
            }
            let mut q = vec![0.0; model.nq];
            model.integrate(&subject.static_q, &dv, &mut q);
            q
        })
        .collect()
}

/// Marker recordings of a motion, with white noise.
pub fn trial(subject: &Subject, motion: &[Vec<f64>], rate_hz: f64, noise_m: f64, seed: u64) -> Trial {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let normal = Normal::new(0.0, 1.0).unwrap();
    let mut state = State::new(&subject.model);
    let mut trajectories = vec![Vec::with_capacity(motion.len()); subject.markers.len()];
    for q in motion {
        state.forward_position(&subject.model, q);
        for (marker, trajectory) in subject.markers.iter().zip(&mut trajectories) {
            let noise = Vector3::from_fn(|_, _| noise_m * normal.sample(&mut rng));
            trajectory.push(state.point_in_world(marker.link, &marker.position_m) + noise);
        }
    }
    let labels = subject.markers.iter().map(|m| m.label.clone()).collect();
    Trial {
        name: "made".to_owned(),
        markers: Markers { rate_hz, first_frame: 1, n_frames: motion.len(), labels, trajectories },
        ..Trial::default()
    }
}

/// Largest difference of two postures in the tangent space.
pub fn distance(subject: &Subject, a: &[f64], b: &[f64]) -> f64 {
    let mut dv = vec![0.0; subject.model.nv];
    subject.model.difference(a, b, &mut dv);
    dv.iter().fold(0.0, |m: f64, x| m.max(x.abs()))
}
