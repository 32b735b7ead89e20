//! A simulated person: prior, regularised estimate, consistent links, advice.
#![allow(clippy::unwrap_used, reason = "tests")]

#[path = "../../regressor/tests/common/mod.rs"]
mod common;

use aloft_body::inertia::pseudo_inertia;
use aloft_body::subject::PriorSd;
use aloft_body::{LinkInertia, Phi};
use aloft_identify::links::clipped;
use aloft_identify::{
    AdviceOptions, ClusterBy, Determination, Estimator, IdentifyOptions, LinkPrior, Parameters, Symmetry,
    excitation_advice, identify,
};
use aloft_regressor::{AccelerationRows, Acting, CoordinateNoise, Factor, Noise, WeakOptions, weak_factor};
use common::{Truth, load};
use nalgebra::DVector;
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};

/// Left and right links of the simulated subjects, whose frames have y to the left.
fn symmetry(truth: &Truth) -> Symmetry {
    let names: Vec<&str> = truth.model.links.iter().map(|l| l.name.as_str()).collect();
    let (mut pairs, mut midline) = (Vec::new(), Vec::new());
    for (i, name) in names.iter().enumerate() {
        let left = name.strip_prefix('r').and_then(|stem| names.iter().position(|n| n.strip_prefix('l') == Some(stem)));
        match left {
            Some(j) => pairs.push((i, j)),
            None if !name.starts_with('l') => midline.push(i),
            None => {}
        }
    }
    Symmetry { pairs, midline, axis: 1, correlation: 0.9 }
}

/// A prior drawn around the truth with its stated spread.
fn prior(truth: &Truth, seed: u64) -> LinkPrior {
    let sd = vec![PriorSd { mass_rel: 0.12, com_m: 0.02, radius_rel: 0.15, together: 0.0 }; truth.phi.len()];
    let links: Vec<LinkInertia> = truth.phi.iter().map(LinkInertia::from_phi).collect();
    let exact = LinkPrior::new(&links, &sd, Some(&symmetry(truth))).unwrap();
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let eigen = exact.covariance.clone().symmetric_eigen();
    let unit = DVector::from_fn(exact.mean.len(), |_, _| StandardNormal.sample(&mut rng));
    let phi = &exact.mean + &eigen.eigenvectors * eigen.eigenvalues.map(|l| l.max(0.0).sqrt()).component_mul(&unit);
    let total: f64 = (0..links.len()).map(|i| phi[10 * i]).sum();
    let drawn: Vec<LinkInertia> = (0..links.len())
        .map(|i| {
            let own: Phi = phi.fixed_rows::<10>(10 * i) * (truth.mass() / total);
            LinkInertia::from_phi(&clipped(&own, 0.03))
        })
        .collect();
    LinkPrior::new(&drawn, &sd, Some(&symmetry(truth))).unwrap()
}

fn weak_factors(truth: &Truth, prior: &LinkPrior, seed: u64, soft_m: f64, white: bool) -> Vec<Factor> {
    let motion = truth.tracked(0.3e-3, soft_m, seed);
    let noise = Noise { slow: 5.0, ..Noise::white(CoordinateNoise::Markers { markers: &truth.markers, sd_m: 0.3e-3 }) };
    let options = WeakOptions { window_s: Some(0.25), ..WeakOptions::default() };
    truth
        .stretches()
        .iter()
        .map(|s| {
            let noise = white.then_some(&noise);
            weak_factor(&truth.model, &truth.base, &prior.phi(), &motion, s, Acting::nothing(), &options, noise)
                .unwrap()
        })
        .collect()
}

/// Mean absolute error of the force (N) and moment (N·m) predicted for other motion: postures of
/// the recording combined with accelerations of other frames, which no flight contains.
fn wrench_error(truth: &Truth, x: &DVector<f64>) -> (f64, f64) {
    let difference = x - truth.truth();
    let recorded = truth.velocities().unwrap();
    let mut rows = AccelerationRows::new(&truth.model, &truth.base);
    let (mut force, mut moment) = (0.0, 0.0);
    for (i, (frame, v, _)) in recorded.iter().enumerate() {
        let a = &recorded[(i * 7 + 11) % recorded.len()].2;
        let wrench: DVector<f64> = rows.base_rows(truth.motion.q(*frame), v, a) * &difference;
        force += wrench.rows(0, 3).abs().sum() / 3.0;
        moment += wrench.rows(3, 3).abs().sum() / 3.0;
    }
    (force / recorded.len() as f64, moment / recorded.len() as f64)
}

fn regularised(weight: Option<f64>) -> IdentifyOptions {
    IdentifyOptions { estimator: Estimator::Regularised { weight }, ..IdentifyOptions::default() }
}

#[test]
fn validate_three_flights_and_a_prior_find_the_person() {
    let truth = load("subject_a");
    let prior = prior(&truth, 5);
    let before = wrench_error(&truth, &prior.base(&truth.base).unwrap().mean);
    for (soft_m, white) in [(0.0, false), (0.0, true), (0.003, true)] {
        let factors = weak_factors(&truth, &prior, 1, soft_m, white);
        let found =
            identify(&truth.model, &truth.base, &factors, truth.mass(), Some(&prior), &regularised(Some(1.0))).unwrap();
        let after = wrench_error(&truth, &found.parameters.base_values());
        println!("soft tissue {soft_m} m, whitened {white}: prior {before:.2?}, identified {after:.2?} N, N·m");
        let gain = if soft_m > 0.0 { 0.3 } else { 0.1 };
        assert!(after.0 < gain * before.0 && after.1 < gain * before.1);
        // noise only: intervals cover the truth
        if soft_m == 0.0 && white {
            let covered = found
                .parameters
                .base
                .iter()
                .zip(truth.truth().iter())
                .filter(|(b, t)| b.ci95.is_some_and(|c| c[0] <= **t && **t <= c[1]))
                .count();
            println!("intervals cover {covered} of {}", truth.base.len());
            assert!(covered as f64 > 0.85 * truth.base.len() as f64);
        }
    }
}

#[test]
fn links_are_consistent_keep_the_mass_and_the_base_parameters() {
    let truth = load("subject_a");
    let prior = prior(&truth, 5);
    for soft_m in [0.0, 0.003] {
        let factors = weak_factors(&truth, &prior, 2, soft_m, true);
        let found =
            identify(&truth.model, &truth.base, &factors, truth.mass(), Some(&prior), &regularised(Some(1.0))).unwrap();
        let p: &Parameters = &found.parameters;
        assert_eq!(p.links.len(), 15);
        let phi: Vec<Phi> = p.links.iter().map(|l| l.inertia().to_phi()).collect();
        for (link, phi) in p.links.iter().zip(&phi) {
            assert!(pseudo_inertia(phi).cholesky().is_some(), "{} is not consistent", link.name);
            assert!(link.sd.mass_kg > 0.0 && link.sd.mass_kg < 2.0);
            assert!(link.words.contains("kg"));
        }
        let total: f64 = phi.iter().map(|p| p[0]).sum();
        assert!((total - truth.mass()).abs() < 1e-9);
        // they explain the flights about as well as the base parameters do, and other motion far
        // better than the prior
        let merged = Factor::merge(&factors).unwrap();
        let (free, held) = (p.base_values(), truth.base.regroup(&phi));
        let rms = |x: &DVector<f64>| (merged.sum_of_squares(x) / merged.n_rows as f64).sqrt();
        let (before, base, links) = (
            wrench_error(&truth, &prior.base(&truth.base).unwrap().mean),
            wrench_error(&truth, &free),
            wrench_error(&truth, &held),
        );
        println!(
            "soft tissue {soft_m} m: residual of the flights {:.2} and {:.2} with consistent links; wrench error prior {before:.2?}, base parameters {base:.2?}, consistent links {links:.2?}",
            rms(&free),
            rms(&held)
        );
        assert!(rms(&held) < 1.3 * rms(&free));
        assert!(links.0 < 0.35 * before.0 && links.1 < 0.35 * before.1);
    }
}

#[test]
fn repeating_errors_widen_intervals_and_more_motion_narrows_them() {
    let truth = load("subject_a");
    let prior = prior(&truth, 6);
    let factors = weak_factors(&truth, &prior, 1, 0.0, true);
    let run = |factors: &[Factor], repeat: f64| {
        let options = IdentifyOptions { flight_error_correlation: repeat, ..regularised(Some(1.0)) };
        identify(&truth.model, &truth.base, factors, truth.mass(), Some(&prior), &options).unwrap().parameters
    };
    let mean = |p: &Parameters| p.base.iter().skip(1).map(|b| (b.se / b.prior_sd.unwrap()).ln()).sum::<f64>();
    let (one, three, repeating) = (run(&factors[..1], 0.0), run(&factors, 0.0), run(&factors, 0.5));
    assert!(mean(&three) < mean(&one));
    assert!(mean(&repeating) > mean(&three));
    assert!(three.base.iter().all(|b| b.se <= 1.05 * b.prior_sd.unwrap() || b.name == "M"));
    let chosen = identify(&truth.model, &truth.base, &factors, truth.mass(), Some(&prior), &regularised(None))
        .unwrap()
        .parameters;
    assert_eq!(chosen.weights_tried.len(), 3);
    assert!([1.0, 3.0, 10.0].contains(&chosen.prior_weight));
    let trial = identify(
        &truth.model,
        &truth.base,
        &factors,
        truth.mass(),
        Some(&prior),
        &IdentifyOptions { cluster: ClusterBy::Trial, ..regularised(None) },
    )
    .unwrap()
    .parameters;
    assert!(trial.se_from.contains("too few"));
    let json = serde_json::to_value(&chosen).unwrap();
    for path in [
        "/base/0/value",
        "/base/0/se",
        "/base/0/unit",
        "/links/3/mass_kg",
        "/links/3/prior",
        "/sigma/max",
        "/sigma/second",
        "/sigma/min",
    ] {
        assert!(json.pointer(path).is_some(), "{path}");
    }
    let back: Parameters = serde_json::from_value(json).unwrap();
    assert_eq!(back.base.len(), chosen.base.len());
}

#[test]
fn advice_names_a_motion_that_helps() {
    let truth = load("subject_a");
    let prior = prior(&truth, 5);
    let factors = weak_factors(&truth, &prior, 1, 0.0, false);
    let weak = WeakOptions { window_s: Some(0.25), ..WeakOptions::default() };
    let options = AdviceOptions::default();
    let found = identify(&truth.model, &truth.base, &factors[..1], truth.mass(), Some(&prior), &regularised(Some(1.0)))
        .unwrap();
    let advice = excitation_advice(
        &truth.model,
        &truth.base,
        &factors[..1],
        truth.mass(),
        &prior,
        truth.motion.q(5),
        found.parameters.row_sd,
        &weak,
        &options,
    )
    .unwrap();
    println!("{}: {:.0} %", advice[0].motion, 100.0 * advice[0].gain);
    assert!(advice[0].gain > 0.0);
    assert!(advice.windows(2).all(|w| w[0].gain >= w[1].gain));
    // the recommended motion moves a link that is hardly observed
    let worst = &advice[0].link;
    let seen =
        found.parameters.base.iter().filter(|b| b.name.starts_with(worst.as_str())).map(|b| b.determination).max();
    assert!(seen == Some(Determination::Hardly) || seen == Some(Determination::Partly), "{worst} {seen:?}");
    let bad =
        excitation_advice(&truth.model, &truth.base, &factors, truth.mass(), &prior, &[0.0], 1.0, &weak, &options);
    assert!(bad.is_err());
}

#[test]
fn a_prior_states_the_spread_it_was_given() {
    let truth = load("subject_a");
    let links: Vec<LinkInertia> = truth.phi.iter().map(LinkInertia::from_phi).collect();
    let sd = vec![PriorSd { mass_rel: 0.1, com_m: 0.01, radius_rel: 0.1, together: 0.0 }; links.len()];
    let plain = LinkPrior::new(&links, &sd, None).unwrap();
    let mirrored = LinkPrior::new(&links, &sd, Some(&symmetry(&truth))).unwrap();
    for (i, link) in links.iter().enumerate() {
        let mass_sd = plain.covariance[(10 * i, 10 * i)].sqrt();
        assert!((mass_sd - 0.1 * link.mass_kg).abs() < 1e-12);
    }
    let (i, j) = symmetry(&truth).pairs[0];
    let correlation =
        |p: &LinkPrior, a: usize, b: usize| p.covariance[(a, b)] / (p.covariance[(a, a)] * p.covariance[(b, b)]).sqrt();
    assert!((correlation(&mirrored, 10 * i, 10 * j) - 0.9).abs() < 1e-9);
    assert!(correlation(&plain, 10 * i, 10 * j).abs() < 1e-12);
    // lateral first moments of mirrored limbs are negatively correlated
    assert!(correlation(&mirrored, 10 * i + 2, 10 * j + 2) < -0.5);
    assert!(LinkPrior::new(&links, &sd[..3], None).is_err());
    let twice = Symmetry { pairs: vec![(1, 1)], midline: vec![], axis: 1, correlation: 0.5 };
    assert!(LinkPrior::new(&links, &sd, Some(&twice)).is_err());
}
