//! How often 95 % intervals of base parameters hold the truth: simulated robots whose inertias are
//! drawn from the prior that the pipeline states, flights and noise of their own for every seed,
//! through the whole program.

use crate::robot_next::{True, record, truth};
use crate::support::{expect, folder, json, repo};
use aloft_body::{BaseParameters, LinkInertia};
use aloft_robot::RobotModel;
use aloft_robot::next::Wave;
use nalgebra::{Matrix3, Vector3};
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};
use std::fs;
use std::path::Path;

/// Spread of the fixture's pipeline: masses, centres of mass (m), radii of gyration; shears have
/// half of that of radii.
const SPREAD: [f64; 3] = [0.15, 0.012, 0.12];
const FLIGHTS: usize = 3;

pub struct Draws(pub ChaCha8Rng);

impl Draws {
    fn normal(&mut self) -> f64 {
        StandardNormal.sample(&mut self.0)
    }

    fn link(&mut self, nominal: &LinkInertia) -> LinkInertia {
        let mass_kg = nominal.mass_kg * (1.0 + SPREAD[0] * self.normal());
        let com_m = nominal.com_m + Vector3::from_fn(|_, _| SPREAD[1] * self.normal());
        // the mass distribution is stretched and sheared
        let i = nominal.inertia_com_kgm2;
        let spread = Matrix3::identity() * (0.5 * i.trace()) - i;
        let mut t = Matrix3::from_diagonal(&Vector3::from_fn(|_, _| 1.0 + SPREAD[2] * self.normal()));
        for (a, b) in [(0, 1), (0, 2), (1, 2)] {
            let shear = 0.5 * SPREAD[2] * self.normal();
            (t[(a, b)], t[(b, a)]) = (shear, shear);
        }
        let spread = t * spread * t.transpose() * (mass_kg / nominal.mass_kg);
        LinkInertia { mass_kg, com_m, inertia_com_kgm2: Matrix3::identity() * spread.trace() - spread }
    }

    pub fn flight(&mut self, joints: usize) -> (Wave, Vector3<f64>) {
        let control = (0..joints).map(|_| (0..4).map(|_| 0.6 * self.normal()).collect()).collect();
        let wave = Wave { hold: vec![0.1; joints], control, duration_s: 0.5 };
        (wave, Vector3::from_fn(|_, _| 2.0 * self.normal()))
    }
}

/// A robot whose inertias are drawn about the fixture's model, and its laboratory without
/// recordings.
pub fn drawn(draws: &mut Draws, data: &Path) -> True {
    let nominal = fs::read_to_string(repo("fixtures/robot/model/nominal.urdf")).unwrap();
    let nominal = RobotModel::parse("nominal.urdf", &nominal).unwrap();
    let True { robot, model, .. } = truth();
    let links: Vec<LinkInertia> = nominal.spec.links.iter().map(|l| draws.link(&l.inertia.unwrap())).collect();
    let mass: f64 = links.iter().map(|l| l.mass_kg).sum();
    fs::create_dir_all(data.join("model")).unwrap();
    for file in ["model/nominal.urdf", "model/nominal.xml"] {
        let _ = fs::copy(repo(&format!("fixtures/robot/{file}")), data.join(file)).unwrap();
    }
    let described = fs::read_to_string(repo("fixtures/robot/robot.yaml")).unwrap();
    let described = described.replace("total_mass_kg: 5.400", &format!("total_mass_kg: {mass:.6}"));
    fs::write(data.join("robot.yaml"), described).unwrap();
    True { robot, model, phi: links.iter().map(LinkInertia::to_phi).collect() }
}

/// Numbers of intervals that hold the truth, of all intervals, and the sum of squared errors in
/// standard errors.
fn one(seed: u64, recordings: usize) -> (usize, usize, f64) {
    let mut draws = Draws(ChaCha8Rng::seed_from_u64(seed));
    let dir = folder();
    let data = dir.path().join("lab");
    let truth = drawn(&mut draws, &data);
    for k in 0..recordings {
        let flights: Vec<_> = (0..FLIGHTS).map(|_| draws.flight(truth.robot.joints.len())).collect();
        record(&truth, &flights, 1000 * seed + k as u64, &data, &format!("throw_{:02}", k + 1));
    }
    let (robot, lab) = (repo("pipelines/robot.yaml"), data.display().to_string());
    let ws = dir.path().join("ws").display().to_string();
    expect(&["run", &robot, "--data", &lab, "--workspace", &ws], 0);
    let found = json(&["parameters", &robot, "--data", &lab, "--workspace", &ws, "--json"]);
    let values = BaseParameters::of(&truth.model).regroup(&truth.phi);
    let (mut inside, mut count, mut squares) = (0, 0, 0.0);
    for (b, value) in found["base"].as_array().unwrap().iter().zip(values.iter()).skip(1) {
        let of = |v: &serde_json::Value| v.as_f64().unwrap();
        let (low, high) = (of(&b["ci95"][0]), of(&b["ci95"][1]));
        inside += usize::from(low <= *value && *value <= high);
        count += 1;
        squares += ((of(&b["value"]) - value) / of(&b["se"])).powi(2);
    }
    (inside, count, squares)
}

/// Share of intervals that hold the truth, with its standard error from the spread among robots,
/// and the root mean square error in standard errors.
fn coverage(seeds: std::ops::Range<u64>, recordings: usize) -> (f64, f64, f64) {
    let each: Vec<(usize, usize, f64)> = seeds.map(|s| one(s, recordings)).collect();
    let shares: Vec<f64> = each.iter().map(|e| e.0 as f64 / e.1 as f64).collect();
    let n = shares.len() as f64;
    let mean = shares.iter().sum::<f64>() / n;
    let sd = (shares.iter().map(|s| (s - mean).powi(2)).sum::<f64>() / (n - 1.0)).sqrt();
    let z = (each.iter().map(|e| e.2).sum::<f64>() / each.iter().map(|e| e.1).sum::<usize>() as f64).sqrt();
    (mean, sd / n.sqrt(), z)
}

#[test]
fn intervals_of_a_few_robots_hold_the_truth() {
    let (share, error, z) = coverage(500..508, 2);
    println!("{share:.3} ± {error:.3}; errors {z:.2} standard errors");
    assert!(share > 0.88, "{share} of the intervals hold the truth");
}

#[test]
#[ignore = "five minutes; the numbers are in docs/robots.md"]
fn coverage_of_intervals_on_a_hundred_robots() {
    for recordings in [2, 4] {
        let (share, error, z) = coverage(0..100, recordings);
        println!(
            "{} flights: {:.1} ± {:.1} % of the 95 % intervals hold the truth; errors {z:.2} standard errors",
            recordings * FLIGHTS,
            100.0 * share,
            100.0 * error
        );
        assert!((0.93..0.97).contains(&share), "{share} ± {error}");
    }
}

/// The recordings of the coverage are not all of one kind.
#[test]
fn drawn_robots_differ() {
    let nominal = fs::read_to_string(repo("fixtures/robot/model/nominal.urdf")).unwrap();
    let nominal = RobotModel::parse("nominal.urdf", &nominal).unwrap();
    let link = nominal.spec.links[1].inertia.unwrap();
    let masses: Vec<f64> =
        (0..200).map(|s| Draws(ChaCha8Rng::seed_from_u64(s)).link(&link).mass_kg / link.mass_kg - 1.0).collect();
    let sd = (masses.iter().map(|m| m * m).sum::<f64>() / 200.0).sqrt();
    assert!((sd / SPREAD[0] - 1.0).abs() < 0.2, "{sd}");
    assert!(Path::new(&repo("fixtures/robot/robot.yaml")).is_file());
}
