//! The estimate in the metric of the rows' noise: the paper's assumption that the rank falls by
//! one, where it holds (a chain) and where it does not (a single rigid body).
#![allow(clippy::unwrap_used, reason = "tests")]

#[path = "../../regressor/tests/common/mod.rs"]
mod common;

use aloft_body::subject::PriorSd;
use aloft_body::{BaseParameters, JointSpec, LinkInertia, LinkSpec, Model, ModelSpec, Motion};
use aloft_identify::{
    Determination, Estimator, Identification, IdentifyError, IdentifyOptions, LinkPrior, identify, mass_constrained,
    point_estimate,
};
use aloft_regressor::{
    Acting, CoordinateNoise, Factor, MatrixNoise, Stretch, WeakOptions, weak_factor, weak_factor_with_noise,
};
use common::{Truth, load};
use nalgebra::{Matrix3, Quaternion, UnitQuaternion, Vector3};
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};

const RATE_HZ: f64 = 150.0;
const FRAMES: usize = 75;
const FLIGHTS: usize = 30;
const MASS_KG: f64 = 0.37;
const POSITION_SD_M: f64 = 3e-4;
const TURN_SD_RAD: f64 = 9e-4;
const INERTIA_KGM2: [f64; 3] = [6.0e-4, 8.1e-4, 10.0e-4];

fn one_link() -> Model {
    let link = LinkSpec {
        name: "body".into(),
        parent: None,
        joint: JointSpec::Free,
        position_m: [0.0; 3],
        rpy_rad: [0.0; 3],
        inertia: None,
    };
    Model::from_spec(&ModelSpec::new("body".into(), vec![link])).unwrap()
}

/// Tumbling flights of a rigid body, by Euler's equations in small steps, with white noise of the
/// poses; `drag` is a force −drag |v| v of which the model knows nothing.
fn tosses(model: &Model, seed: u64, drag_per_kg_m: f64) -> (Motion, Vec<Stretch>) {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let mut normal = || -> f64 { StandardNormal.sample(&mut rng) };
    let inertia = Vector3::from(INERTIA_KGM2);
    let spin = |w: &Vector3<f64>| -w.cross(&w.component_mul(&inertia)).component_div(&inertia);
    let mut q = Vec::new();
    let mut stretches = Vec::new();
    for flight in 0..FLIGHTS {
        let mut place = Vector3::new(0.0, 0.0, 1.0);
        let mut velocity = Vector3::new(normal(), normal(), 3.0);
        let mut turn = UnitQuaternion::from_quaternion(Quaternion::new(normal(), normal(), normal(), normal()));
        let mut w = Vector3::from_fn(|_, _| 6.0 * normal());
        stretches.push(Stretch::flight("tosses", flight, flight * FRAMES, (flight + 1) * FRAMES));
        for _ in 0..FRAMES {
            let seen = turn * UnitQuaternion::from_scaled_axis(Vector3::from_fn(|_, _| TURN_SD_RAD * normal()));
            let at = place + Vector3::from_fn(|_, _| POSITION_SD_M * normal());
            q.extend([at.x, at.y, at.z, seen.i, seen.j, seen.k, seen.w]);
            let h = 1.0 / (RATE_HZ * 20.0);
            for _ in 0..20 {
                let middle = w + spin(&w) * (0.5 * h);
                turn *= UnitQuaternion::from_scaled_axis(middle * h);
                w += spin(&middle) * h;
                let a = model.gravity_mps2 - velocity * (drag_per_kg_m * velocity.norm());
                place += velocity * h + a * (0.5 * h * h);
                velocity += a * h;
            }
        }
    }
    let motion =
        Motion { trial: "tosses".into(), rate_hz: RATE_HZ, nq: model.nq, nv: model.nv, q, ..Motion::default() };
    (motion, stretches)
}

fn rows_with_noise(
    model: &Model,
    prior: &LinkPrior,
    motion: &Motion,
    stretches: &[Stretch],
    noise: &CoordinateNoise<'_>,
) -> Vec<Factor> {
    let base = BaseParameters::of(model);
    let no_effects = |_: &Motion| Ok(None);
    let of_matrix = MatrixNoise::white(*noise, &no_effects);
    let weak = WeakOptions::default();
    stretches
        .iter()
        .map(|s| {
            let acting = Acting::nothing();
            weak_factor_with_noise(model, &base, &prior.phi(), motion, s, acting, &weak, None, &of_matrix).unwrap()
        })
        .collect()
}

/// A table that is 30 % off in size and round where the body is not.
fn table() -> LinkPrior {
    let inertia_com_kgm2 = Matrix3::from_diagonal_element(1.05e-3);
    let link = LinkInertia { mass_kg: MASS_KG, com_m: Vector3::zeros(), inertia_com_kgm2 };
    LinkPrior::new(&[link], &[PriorSd { mass_rel: 0.05, com_m: 0.01, radius_rel: 0.2, together: 0.0 }], None).unwrap()
}

fn identified(model: &Model, factors: &[Factor], estimator: Estimator) -> Identification {
    let options = IdentifyOptions { estimator, ..IdentifyOptions::default() };
    identify(model, &BaseParameters::of(model), factors, MASS_KG, Some(&table()), &options).unwrap()
}

fn inertias(found: &Identification) -> [f64; 3] {
    ["Jxx", "Jyy", "Jzz"].map(|n| found.parameters.base.iter().find(|b| b.name == n).unwrap().value)
}

/// The moments about the centre of mass are homogeneous in the inertia: flight fixes its ratios,
/// the table its size. With least squares the noise shrinks the size instead.
#[test]
fn flights_of_a_rigid_body_give_ratios_of_inertias_and_leave_their_size_to_the_table() {
    let model = one_link();
    let sd = [POSITION_SD_M, POSITION_SD_M, POSITION_SD_M, TURN_SD_RAD, TURN_SD_RAD, TURN_SD_RAD];
    for seed in 1..=4 {
        let (motion, stretches) = tosses(&model, seed, 0.0);
        let factors = rows_with_noise(&model, &table(), &motion, &stretches, &CoordinateNoise::PerCoordinate(&sd));
        let plain = mass_constrained(&Factor::merge(&factors).unwrap(), MASS_KG).unwrap();
        let found = identified(&model, &factors, Estimator::NoiseMetric);
        let units = found.parameters.noise_units.clone().unwrap();
        let size = inertias(&found);
        println!("seed {seed}: σ {:.2?}, {size:?}; least squares {:.2e}", units.sigma, plain[4]);
        assert!(plain[4] < 0.5 * INERTIA_KGM2[0], "least squares shrinks: {}", plain[4]);
        assert_eq!(units.undetermined, 1);
        assert!((0.9..1.15).contains(&units.residual), "{}", units.residual);
        for i in 1..3 {
            let (ratio, truth) = (size[i] / size[0], INERTIA_KGM2[i] / INERTIA_KGM2[0]);
            assert!((ratio / truth - 1.0).abs() < 0.01, "ratio {ratio} for {truth}");
        }
        for (name, truth) in ["Jxx", "Jyy", "Jzz"].into_iter().zip(INERTIA_KGM2) {
            let estimate = found.parameters.base.iter().find(|b| b.name == name).unwrap();
            let [low, high] = estimate.ci95.unwrap();
            assert!(low < truth && truth < high, "{name}: {low} to {high} for {truth}");
            assert_eq!(estimate.determination, Determination::Hardly, "{name}");
        }
        assert!(units.ratios && units.of_table == ["Jxx", "Jyy", "Jzz"], "{:?}", units.of_table);
        // links keep the size, too, and say where it is from
        assert!((found.parameters.links[0].inertia_kgm2[0][0] / size[0] - 1.0).abs() < 0.05);
        assert_eq!(found.parameters.links[0].from.inertia_kgm2, aloft_identify::Origin::Table);
    }
}

/// A force that the model lacks lifts the direction of the mass above the noise; the scale of the
/// inertias stays at it, and is still no result.
#[test]
fn a_missing_force_shows_in_the_residual_and_determines_no_inertia() {
    let model = one_link();
    let sd = [POSITION_SD_M, POSITION_SD_M, POSITION_SD_M, TURN_SD_RAD, TURN_SD_RAD, TURN_SD_RAD];
    let (motion, stretches) = tosses(&model, 9, 0.1);
    let factors = rows_with_noise(&model, &table(), &motion, &stretches, &CoordinateNoise::PerCoordinate(&sd));
    let found = identified(&model, &factors, Estimator::NoiseMetric);
    let units = found.parameters.noise_units.clone().unwrap();
    println!("σ {:.2?}, residual {:.2}", units.sigma, units.residual);
    assert!(units.residual > 2.0, "{}", units.residual);
    assert!(units.sigma[0] < 1.3, "{}", units.sigma[0]);
    assert!(units.undetermined >= 1);
    for name in ["Jxx", "Jyy", "Jzz"] {
        let estimate = found.parameters.base.iter().find(|b| b.name == name).unwrap();
        assert_ne!(estimate.determination, Determination::Well, "{name}");
    }
}

fn chain_factors(truth: &Truth, sd_m: f64, seed: u64) -> Vec<Factor> {
    let motion = truth.noisy(sd_m, seed);
    let base = &truth.base;
    let noise = CoordinateNoise::Markers { markers: &truth.markers, sd_m };
    let no_effects = |_: &Motion| Ok(None);
    let of_matrix = MatrixNoise::white(noise, &no_effects);
    let weak = WeakOptions::default();
    let of = |s: &Stretch| {
        let acting = Acting::nothing();
        weak_factor_with_noise(&truth.model, base, &truth.phi, &motion, s, acting, &weak, None, &of_matrix).unwrap()
    };
    truth.stretches().iter().map(of).collect()
}

/// On a chain exactly one direction is at the level of the noise, and the estimate has no bias
/// towards zero: with markers of 1.5 mm the mean error of the inertias is less than half of that of
/// least squares.
#[test]
fn a_chain_has_one_direction_at_the_noise_and_no_bias() {
    let truth = load("chain_a");
    let exact = truth.truth();
    let inertia: Vec<usize> = (0..exact.len()).filter(|&i| exact[i].abs() > 1e-3 && i >= 4).collect();
    let (mut plain, mut metric) = (0.0, 0.0);
    for seed in 1..=6 {
        let merged = Factor::merge(&chain_factors(&truth, 1.5e-3, seed)).unwrap();
        let of = |estimator| point_estimate(&merged, truth.mass(), None, estimator).unwrap();
        let relative = |x: &nalgebra::DVector<f64>| inertia.iter().map(|&i| x[i] / exact[i] - 1.0).sum::<f64>() / 6.0;
        plain += relative(&of(Estimator::MassConstrained));
        metric += relative(&of(Estimator::NoiseMetric));
    }
    println!("mean relative error: least squares {plain:.2e}, noise metric {metric:.2e}");
    assert!(metric.abs() < 0.5 * plain.abs(), "{metric:e} for {plain:e}");
    let options = IdentifyOptions { estimator: Estimator::NoiseMetric, ..IdentifyOptions::default() };
    let factors = chain_factors(&truth, 3e-4, 1);
    let found = identify(&truth.model, &truth.base, &factors, truth.mass(), None, &options).unwrap();
    let units = found.parameters.noise_units.unwrap();
    println!("σ {:.2?}", units.sigma);
    assert_eq!(units.undetermined, 0);
    assert!((0.85..1.2).contains(&units.sigma[0]) && units.sigma[1] > 3.0, "{:?}", units.sigma);
}

/// Where the motion determines everything but the scale, intervals contain the truth as often as
/// they say.
#[test]
fn intervals_of_a_chain_contain_the_truth() {
    let truth = load("chain_a");
    let exact = truth.truth();
    let (mut inside, mut all) = (0, 0);
    for seed in 11..=22 {
        let options = IdentifyOptions { estimator: Estimator::NoiseMetric, ..IdentifyOptions::default() };
        let factors = chain_factors(&truth, 1e-3, seed);
        let found = identify(&truth.model, &truth.base, &factors, truth.mass(), None, &options).unwrap();
        for (b, exact) in found.parameters.base.iter().zip(exact.iter()).skip(1) {
            let [low, high] = b.ci95.unwrap();
            inside += usize::from(low <= *exact && *exact <= high);
            all += 1;
        }
    }
    println!("{inside} of {all} intervals contain the truth");
    assert!((0.9..=0.99).contains(&(f64::from(inside as u32) / f64::from(all as u32))), "{inside} of {all}");
}

#[test]
fn rows_without_their_noise_are_refused_by_name() {
    let truth = load("chain_a");
    let motion = truth.noisy(3e-4, 1);
    let weak = WeakOptions::default();
    let of = |s: &Stretch| {
        weak_factor(&truth.model, &truth.base, &truth.phi, &motion, s, Acting::nothing(), &weak, None).unwrap()
    };
    let plain: Vec<Factor> = truth.stretches().iter().map(of).collect();
    let refused = point_estimate(&Factor::merge(&plain).unwrap(), truth.mass(), None, Estimator::NoiseMetric);
    assert!(matches!(refused, Err(IdentifyError::Option { option: "estimator", .. })), "{refused:?}");
    // nor do stretches with and without it merge
    let mut mixed = chain_factors(&truth, 3e-4, 1);
    mixed[0] = plain[0].clone();
    assert!(Factor::merge(&mixed).is_err());
}

/// The triangle of the noise follows the rows through everything that is done with them.
#[test]
fn the_noise_scales_merges_and_is_stored_with_its_rows() {
    let truth = load("chain_a");
    let factors = chain_factors(&truth, 3e-4, 2);
    let merged = Factor::merge(&factors).unwrap();
    let gram = |f: &Factor| {
        let t = f.noise().unwrap().dense();
        t.tr_mul(&t)
    };
    let sum = factors.iter().map(&gram).reduce(|a, b| a + b).unwrap();
    assert!((gram(&merged) - &sum).norm() < 1e-9 * sum.norm());
    assert!((gram(&merged.scaled(3.0)) - &sum * 9.0).norm() < 1e-9 * sum.norm());
    let text = serde_json::to_string(&merged).unwrap();
    assert_eq!(serde_json::from_str::<Factor>(&text).unwrap(), merged);
}
