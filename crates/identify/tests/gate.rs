//! The gate decides by the information that motion added to the table, with every estimator.
#![allow(clippy::unwrap_used, reason = "tests")]

#[path = "../../regressor/tests/common/mod.rs"]
mod common;

use aloft_body::LinkInertia;
use aloft_body::subject::PriorSd;
use aloft_identify::{
    ColumnScaling, Determination, Estimator, IdentifyOptions, LinkPrior, Origin, Parameters, Symmetry, identify,
};
use aloft_regressor::{Acting, Factor, WeakOptions, weak_factor};
use common::{Truth, load};

/// A prior that differs from the truth by about its own standard deviations.
fn prior(truth: &Truth) -> LinkPrior {
    let links: Vec<LinkInertia> = truth
        .phi
        .iter()
        .enumerate()
        .map(|(i, phi)| {
            let mut link = LinkInertia::from_phi(phi);
            let by = |k: usize| (1.7 * i as f64 + 2.3 * k as f64).sin();
            link.mass_kg *= 1.0 + 0.1 * by(0);
            link.com_m += 0.015 * nalgebra::Vector3::new(by(1), by(2), by(3));
            link.inertia_com_kgm2 *= 1.0 + 0.2 * by(4);
            link
        })
        .collect();
    let sd = vec![PriorSd { mass_rel: 0.12, com_m: 0.02, radius_rel: 0.15, together: 0.0 }; links.len()];
    LinkPrior::new(&links, &sd, None::<&Symmetry>).unwrap()
}

fn factors(truth: &Truth, prior: &LinkPrior, noise_m: f64, soft_m: f64) -> Vec<Factor> {
    let motion = truth.tracked(noise_m, soft_m, 7);
    let options = WeakOptions::default();
    let of = |s| weak_factor(&truth.model, &truth.base, &prior.phi(), &motion, s, Acting::nothing(), &options, None);
    truth.stretches().iter().map(|s| of(s).unwrap()).collect()
}

fn run(truth: &Truth, prior: &LinkPrior, factors: &[Factor], estimator: Estimator) -> Parameters {
    let flight_error_correlation = if truth.base.len() > 50 { 0.2 } else { 0.0 };
    let options = IdentifyOptions { estimator, flight_error_correlation, ..IdentifyOptions::default() };
    identify(&truth.model, &truth.base, factors, truth.mass(), Some(prior), &options).unwrap().parameters
}

const REGULARISED: Estimator = Estimator::Regularised { weight: None };

#[test]
fn validate_the_gate_turns_with_the_information_that_flights_add() {
    let truth = load("subject_a");
    let prior = prior(&truth);
    // good recordings: one flight cannot be tested against another, three can
    let good = factors(&truth, &prior, 0.3e-3, 0.003);
    let mut removed = Vec::new();
    for n in 1..=good.len() {
        let p = run(&truth, &prior, &good[..n], REGULARISED);
        println!("{n} flights: {:?}, passed {}", p.information, p.gate.passed);
        removed.push((p.information.unwrap().wrench, p.gate.passed));
    }
    assert_eq!(removed[0], (None, false));
    assert!(removed[2].1 && removed[2].0 > removed[1].0, "{removed:?}");
    // with markers that move by centimetres the same flights add almost no information, and the
    // table's body is not a result
    let mut last = 1.0;
    for (noise_m, soft_m, passes) in [(0.3e-3, 0.003, Some(true)), (2e-3, 0.02, None), (10e-3, 0.1, Some(false))] {
        let p = run(&truth, &prior, &factors(&truth, &prior, noise_m, soft_m), REGULARISED);
        let information = p.information.unwrap();
        println!("markers {noise_m} m, soft tissue {soft_m} m: {information:?}, passed {}", p.gate.passed);
        assert!(information.wrench.unwrap() < last + 1e-3);
        last = information.wrench.unwrap();
        if let Some(passes) = passes {
            assert_eq!(p.gate.passed, passes, "{:?}", p.gate);
            assert_eq!(
                p.gate.reasons.iter().any(|r| r.contains("tables' variance") || r.contains("body from tables")),
                !passes,
                "{:?}",
                p.gate
            );
        }
    }
}

#[test]
fn every_estimator_is_judged_by_information() {
    // for estimators without a prior, three flights of a person give too few rows
    let truth = load("subject_a");
    let person = prior(&truth);
    let rows = factors(&truth, &person, 0.3e-3, 0.003);
    for estimator in [Estimator::MassConstrained, Estimator::NullVector(ColumnScaling::None)] {
        let options = IdentifyOptions { estimator, ..IdentifyOptions::default() };
        let found = identify(&truth.model, &truth.base, &rows, truth.mass(), Some(&person), &options);
        if let Ok(found) = found {
            let p = found.parameters;
            assert!(!p.gate.passed, "{estimator:?}: {:?} {:?}", p.information, p.gate);
            assert!(p.information.is_some());
        }
    }
    // for a chain they give enough
    for name in ["chain_p", "chain_a"] {
        let truth = load(name);
        let object = prior(&truth);
        let rows = factors(&truth, &object, 0.3e-3, 0.0);
        for estimator in [REGULARISED, Estimator::MassConstrained] {
            let p = run(&truth, &object, &rows, estimator);
            assert!(p.gate.passed, "{name} {estimator:?}: {:?} {:?}", p.information, p.gate);
            assert!(p.information.unwrap().wrench.unwrap() > 0.99, "{:?}", p.information);
        }
    }
}

#[test]
fn what_motion_did_not_determine_is_from_the_table() {
    let truth = load("subject_a");
    let person = prior(&truth);
    let rows = factors(&truth, &person, 2e-3, 0.02);
    let p = run(&truth, &person, &rows, REGULARISED);
    let count = |origin: Origin| p.base.iter().filter(|b| b.from == origin).count();
    println!("{} from motion, {} from tables", count(Origin::Motion), count(Origin::Table));
    assert!(count(Origin::Table) > 20 && count(Origin::Motion) > 0);
    assert_eq!((count(Origin::Scale), p.base[0].from), (1, Origin::Scale));
    for b in p.base.iter().skip(1) {
        let share = b.se / b.prior_sd.unwrap();
        assert_eq!(b.from == Origin::Table, share >= 0.7, "{}: {share}", b.name);
        assert_eq!(b.determined_by() == "from tables", b.determination == Determination::Hardly, "{}", b.name);
    }
    assert!(p.links.iter().any(|l| l.from.describe() == "from tables"));
    for l in &p.links {
        // `seen` is that of the best-determined value
        assert_eq!(l.from.describe() == "from tables", l.determination == Determination::Hardly, "{}", l.name);
        assert_eq!(l.words.contains("from tables"), !l.from.from_table().is_empty(), "{}", l.words);
    }
    let json = serde_json::to_value(&p).unwrap();
    assert_eq!(json["base"][0]["from"], "scale");
    assert!(json["base"].as_array().unwrap().iter().any(|b| b["from"] == "table"));
    assert!(json["links"][0]["from"]["mass_kg"].is_string() && json["information"]["wrench"].is_number());
    // without a table in the estimate there is no prior value to fall back on
    let options = IdentifyOptions { estimator: Estimator::MassConstrained, ..IdentifyOptions::default() };
    let free = identify(&truth.model, &truth.base, &rows, truth.mass(), None, &options).unwrap().parameters;
    assert!(free.base.iter().all(|b| b.from != Origin::Table));
    assert!(free.base.iter().any(|b| b.from == Origin::NotDetermined));
    // a hinge that does not move: undetermined parameters are never reported as "± 0, well"
    let truth = load("chain_p");
    let mut locked = truth.motion.clone();
    locked.q.chunks_exact_mut(truth.model.nq).for_each(|q| q[7] = 0.1);
    let of = |s| {
        let weak = WeakOptions::default();
        weak_factor(&truth.model, &truth.base, &truth.phi, &locked, s, Acting::nothing(), &weak, None).unwrap()
    };
    let rows: Vec<Factor> = truth.stretches().iter().map(of).collect();
    let found = identify(&truth.model, &truth.base, &rows, truth.mass(), None, &options).unwrap().parameters;
    let nothing: Vec<&str> =
        found.base.iter().filter(|b| b.from == Origin::NotDetermined).map(|b| b.name.as_str()).collect();
    println!("a locked hinge leaves open: {}", nothing.join(", "));
    assert!(nothing.len() >= 6 && !found.gate.passed);
    for b in found.base.iter().skip(1) {
        assert!(b.from == Origin::NotDetermined || b.ci95.is_some_and(|c| c[1] - c[0] < 0.1), "{b:?}");
    }
    // results of an earlier version do not claim an origin that was not tested
    let mut old = json;
    old["base"][5].as_object_mut().unwrap().remove("from");
    let read: Parameters = serde_json::from_value(old).unwrap();
    assert_eq!(read.base[5].from, Origin::NotDetermined);
}
