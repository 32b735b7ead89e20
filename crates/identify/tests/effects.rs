//! Effect columns that the rows do not determine: zero, repeated, or combinations of the body's own
//! columns. No other result may change.
#![allow(clippy::unwrap_used, reason = "tests")]

#[path = "../../regressor/tests/common/mod.rs"]
mod common;

use aloft_body::LinkInertia;
use aloft_body::subject::PriorSd;
use aloft_identify::{
    Estimator, IdentifyOptions, LinkPrior, Parameters, Unseen, Visible, balanced, choose_window, consistent_links,
    identify, mass_constrained, point_estimate,
};
use aloft_regressor::{Acting, Columns, Factor, RowKind, Stretch, StretchKind, WeakOptions, weak_factor};
use common::{Truth, load};
use faer::Mat;
use nalgebra::DVector;

/// Kind of column that the rows cannot determine.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Hidden {
    Zero,
    /// Rounding error instead of exact zeros.
    NearlyZero,
    /// Half of an effect that is already in the model.
    Repeated,
    /// That effect plus some of the body's columns.
    RepeatedWithBody,
    /// A combination of the body's columns.
    Body,
}

const ALL: [Hidden; 5] = [Hidden::Zero, Hidden::NearlyZero, Hidden::Repeated, Hidden::RepeatedWithBody, Hidden::Body];

/// Rows of the flights with effect columns: `None` is a column that the rows determine, `Some` a
/// hidden one. A third of the flights is treated as contact if `contact` is true.
fn factors(truth: &Truth, effects: &[Option<Hidden>], contact: bool) -> Vec<Factor> {
    let motion = truth.noisy(0.3e-3, 5);
    // enough rows in a person's three flights to exceed the number of parameters
    let (window, hop) = if truth.base.len() > 50 { (0.25, 0.08) } else { (0.3, 0.25) };
    let options = WeakOptions { window_s: Some(window), hop, ..WeakOptions::default() };
    let wrench = vec![nalgebra::Vector6::zeros(); motion.n_frames()];
    truth
        .stretches()
        .iter()
        .enumerate()
        .map(|(i, s)| {
            let as_contact = contact && i % 3 == 0;
            let stretch =
                if as_contact { Stretch::contact(s.trial.clone(), i, s.first_frame, s.end_frame) } else { s.clone() };
            let acting = if as_contact { Acting { measured: Some(&wrench), effects: None } } else { Acting::nothing() };
            let plain =
                weak_factor(&truth.model, &truth.base, &truth.phi, &motion, &stretch, acting, &options, None).unwrap();
            let dense = plain.dense();
            let (h, p) = (dense.nrows(), plain.n_parameters());
            let own = DVector::from_fn(h, |r, _| 1e-3 * (1.0 + (0.7 * (r + 13 * i) as f64).sin()));
            // the mass column is not fitted, because the mass is known
            let mix = DVector::from_fn(p, |j, _| if j == 0 { 0.0 } else { 0.1 * (1.3 * j as f64).cos() });
            let body = dense.columns(0, p) * mix;
            let column = |kind: Option<Hidden>| match kind {
                None => own.clone(),
                Some(Hidden::Zero) => DVector::zeros(h),
                Some(Hidden::NearlyZero) => &own * 1e-17,
                Some(Hidden::Repeated) => &own * 0.5,
                Some(Hidden::RepeatedWithBody) => &own * 0.5 + &body,
                Some(Hidden::Body) => body.clone(),
            };
            let k = effects.len();
            // from the last row to the first, so that triangularisation has work to do
            let rows = Mat::from_fn(h, p + k + 1, |r, c| {
                let r = h - 1 - r;
                if c < p {
                    dense[(r, c)]
                } else if c < p + k {
                    column(effects[c - p])[r]
                } else {
                    dense[(r, p)] + 0.02 * own[r]
                }
            });
            let columns = Columns {
                parameters: plain.columns.parameters.clone(),
                effects: effects
                    .iter()
                    .enumerate()
                    .map(|(e, kind)| kind.map_or("own.size".to_owned(), |kind| format!("{kind:?}{e}.size")))
                    .collect(),
                of_tables: Vec::new(),
            };
            Factor::from_rows(&stretch, RowKind::Weak, columns, rows.as_ref()).unwrap()
        })
        .collect()
}

fn prior(truth: &Truth) -> LinkPrior {
    let links: Vec<LinkInertia> = truth
        .phi
        .iter()
        .map(|phi| {
            let mut link = LinkInertia::from_phi(phi);
            link.com_m *= 1.05;
            link.inertia_com_kgm2 *= 1.1;
            link
        })
        .collect();
    let sd = vec![PriorSd { mass_rel: 0.12, com_m: 0.02, radius_rel: 0.15, together: 0.0 }; links.len()];
    LinkPrior::new(&links, &sd, None).unwrap()
}

/// Largest difference of values and standard errors, relative to the value or its standard error,
/// whichever is larger.
fn moved(a: &Parameters, b: &Parameters) -> f64 {
    let mut all = Vec::new();
    for (x, y) in a.base.iter().zip(&b.base) {
        let size = x.value.abs().max(x.se);
        all.extend([(x.value - y.value).abs() / size, (x.se - y.se).abs() / size]);
    }
    for (x, y) in a.links.iter().zip(&b.links) {
        all.push((x.mass_kg - y.mass_kg).abs() / x.mass_kg);
        all.extend((0..3).map(|k| (x.com_m[k] - y.com_m[k]).abs() / x.sd.com_m[k].max(1e-3)));
    }
    assert!(all.iter().all(|x| x.is_finite()), "{all:?}");
    all.into_iter().fold(0.0, f64::max)
}

/// Models with hidden columns in every position around the determined one (or without one), and the
/// position of that one.
fn models() -> Vec<Vec<Option<Hidden>>> {
    let mut out = Vec::new();
    for kind in ALL {
        let repeats = matches!(kind, Hidden::Repeated | Hidden::RepeatedWithBody);
        if !repeats {
            out.push(vec![Some(kind)]);
            out.push(vec![Some(kind), None]);
            out.push(vec![Some(kind), Some(Hidden::Zero), None]);
        }
        // an effect that comes first in the model is determined; one that repeats it is not
        out.push(vec![None, Some(kind)]);
        out.push(vec![None, Some(kind), Some(kind)]);
    }
    out
}

#[test]
fn effects_that_rows_cannot_see_move_nothing() {
    // rounding error only: the largest over all cases, people with their prior included
    const BOUND: f64 = 1e-9;
    let mut worst = 0.0f64;
    for (name, estimators) in [
        ("chain_p", vec![Estimator::MassConstrained]),
        ("subject_a", vec![Estimator::Regularised { weight: Some(1.0) }]),
    ] {
        let truth = load(name);
        let prior = prior(&truth);
        for contact in [false, true] {
            let plain = [factors(&truth, &[], contact), factors(&truth, &[None], contact)];
            for estimator in &estimators {
                let options = IdentifyOptions { estimator: *estimator, bootstrap: 5, ..IdentifyOptions::default() };
                let run = |factors: &[Factor]| {
                    identify(&truth.model, &truth.base, factors, truth.mass(), Some(&prior), &options).unwrap()
                };
                let expected = [run(&plain[0]), run(&plain[1])];
                // an effect that the rows do determine changes the results by far more
                assert!(moved(&expected[0].parameters, &expected[1].parameters) > 1e4 * BOUND);
                for model in models() {
                    let own = model.iter().position(Option::is_none);
                    let expected = &expected[usize::from(own.is_some())];
                    let rows = factors(&truth, &model, contact);
                    let found = run(&rows);
                    let case = format!("{name}, {model:?}, contact {contact}, {estimator:?}");
                    worst = worst.max(moved(&expected.parameters, &found.parameters));
                    assert!(moved(&expected.parameters, &found.parameters) < BOUND, "{case}: {worst:e}");
                    assert_eq!(found.parameters.effects.len(), model.len(), "{case}");
                    for (effect, kind) in found.parameters.effects.iter().zip(&model) {
                        let json = serde_json::to_value(effect).unwrap();
                        match kind {
                            None => {
                                let (a, b) = (effect, &expected.parameters.effects[0]);
                                assert!((a.value - b.value).abs() < BOUND * b.value.abs().max(b.se), "{case}");
                                assert!((a.se - b.se).abs() < 1e-8 * b.se, "{case}: {} {}", a.se, b.se);
                                assert_eq!(a.not_determined, None, "{case}");
                            }
                            Some(_) => {
                                assert!(json["value"].is_null() && json["se"].is_null(), "{case}: {json}");
                                assert!(effect.not_determined.is_some(), "{case}");
                            }
                        }
                    }
                    // the matrices for other stages have a place for every column
                    let width = truth.base.len() + model.len();
                    assert_eq!(found.covariance.nrows(), width, "{case}");
                    assert!(found.draws.iter().all(|d| d.len() == width), "{case}");
                    assert!(found.parameters.coefficients().iter().all(|c| c.1.is_finite()), "{case}");
                    assert_eq!(found.parameters.gate.passed, expected.parameters.gate.passed, "{case}");
                    let back: Parameters =
                        serde_json::from_value(serde_json::to_value(&found.parameters).unwrap()).unwrap();
                    assert_eq!(back.effects.len(), model.len());
                }
            }
        }
    }
    println!("largest movement of a parameter or of its error: {worst:.1e} of its size");
}

#[test]
fn every_estimator_of_merged_rows_leaves_hidden_columns_out() {
    let truth = load("chain_a");
    let prior = prior(&truth);
    let base_prior = prior.base(&truth.base).unwrap();
    let plain = factors(&truth, &[None], true);
    let merged = Factor::merge(&plain).unwrap();
    let regularised = Estimator::Regularised { weight: Some(2.0) };
    let p = truth.base.len();
    for model in models().into_iter().filter(|m| m.contains(&None)) {
        let rows = factors(&truth, &model, true);
        let all = Factor::merge(&rows).unwrap();
        let own = p + model.iter().position(Option::is_none).unwrap();
        let same = |a: &DVector<f64>, b: &DVector<f64>| {
            let close = |x: f64, y: f64| (x - y).abs() < 1e-9 * y.abs().max(1e-3);
            assert!((0..p).all(|i| close(a[i], b[i])) && close(a[own], b[p]), "{model:?}\n{a}\n{b}");
            assert!((p..a.len()).filter(|i| *i != own).all(|i| a[i] == 0.0), "{model:?}");
        };
        same(&mass_constrained(&all, truth.mass()).unwrap(), &mass_constrained(&merged, truth.mass()).unwrap());
        let of = |f: &Factor| point_estimate(f, truth.mass(), Some(&base_prior), regularised).unwrap();
        same(&of(&all), &of(&merged));
        // the choice of window and the weight of contact do not change either
        let choice = |f: &[Factor]| {
            let candidates = [(0.3, f.to_vec()), (0.2, f.to_vec())];
            choose_window(&candidates, f, truth.mass(), None, aloft_identify::ClusterBy::Stretch).unwrap().tried[0]
        };
        let (a, b) = (choice(&rows).held_out_rms, choice(&plain).held_out_rms);
        assert!((a - b).abs() < 1e-8 * b, "{model:?}: {a} {b}");
        let visible = Visible::of(&all, false);
        let reduced = visible.reduce_all(&rows).unwrap();
        let weight = |f: &[Factor]| balanced(f, truth.mass(), None).unwrap().1.unwrap().contact_weight;
        assert!((weight(&reduced) - weight(&plain)).abs() < 1e-6 * weight(&plain), "{model:?}");
        // unreduced rows cause an error there, never a number
        let links =
            aloft_identify::LinkOptions { row_variance: 1e-6, prior_weight: 1.0, box_weight: 0.3, moment_errors: None };
        let raw = consistent_links(&all, &truth.base, truth.mass(), &prior, &links);
        let through = consistent_links(&visible.reduce(&all).unwrap(), &truth.base, truth.mass(), &prior, &links);
        let expected = consistent_links(&merged, &truth.base, truth.mass(), &prior, &links).unwrap();
        let gap = (&through.unwrap().effects - &expected.effects).amax();
        assert!(gap < 1e-8, "{model:?}: {gap:e}");
        if model.iter().any(|k| matches!(k, Some(Hidden::Zero))) {
            assert!(raw.is_err(), "{model:?}");
        }
    }
}

#[test]
fn the_reason_names_what_a_column_repeats() {
    let truth = load("chain_p");
    for (model, expected) in [
        (vec![None, Some(Hidden::Zero)], Unseen::Zero),
        (vec![None, Some(Hidden::NearlyZero)], Unseen::Zero),
        (vec![None, Some(Hidden::Repeated)], Unseen::Repeats(vec!["own.size".into()])),
        (vec![None, Some(Hidden::RepeatedWithBody)], Unseen::Repeats(vec!["own.size".into()])),
    ] {
        let visible = Visible::among(&factors(&truth, &model, false), false).unwrap();
        assert_eq!(visible.why(0), None, "{model:?}");
        assert_eq!(visible.why(1), Some(&expected), "{model:?}");
        assert!(!expected.describe().is_empty());
    }
    let visible = Visible::among(&factors(&truth, &[Some(Hidden::Body)], false), false).unwrap();
    assert!(matches!(visible.why(0), Some(Unseen::Body(names)) if !names.is_empty()));
    // with a locked hinge the rows contain fewer of the body's columns; an effect there keeps its
    // own column
    let mut rows = factors(&truth, &[None, Some(Hidden::Repeated)], false);
    rows.truncate(2);
    let few = Factor::merge(&rows).unwrap();
    assert!(few.kind == StretchKind::Flight && Visible::of(&few, true).why(0).is_none());
}

#[test]
fn rows_of_a_locked_hinge_keep_the_effect() {
    let truth = load("chain_p");
    let mut locked = truth.motion.clone();
    for q in locked.q.chunks_exact_mut(truth.model.nq) {
        q[7] = 0.1;
    }
    let options = WeakOptions { window_s: Some(0.3), ..WeakOptions::default() };
    let rows: Vec<Factor> = truth
        .stretches()
        .iter()
        .map(|s| {
            let acting = Acting::nothing();
            let plain = weak_factor(&truth.model, &truth.base, &truth.phi, &locked, s, acting, &options, None).unwrap();
            let dense = plain.dense();
            let (h, p) = (dense.nrows(), plain.n_parameters());
            let own = |r: usize| 1e-3 * (1.0 + (0.7 * r as f64).sin());
            let rows = Mat::from_fn(h, p + 2, |r, c| match c.cmp(&p) {
                std::cmp::Ordering::Less => dense[(r, c)],
                std::cmp::Ordering::Equal => own(r),
                // measured side: an effect of size 0.02 and the true body
                std::cmp::Ordering::Greater => (dense.columns(0, p) * truth.truth()).row(r)[0] + 0.02 * own(r),
            });
            let columns = Columns {
                parameters: plain.columns.parameters.clone(),
                effects: vec!["own.size".into()],
                of_tables: Vec::new(),
            };
            Factor::from_rows(s, RowKind::Weak, columns, rows.as_ref()).unwrap()
        })
        .collect();
    let x = mass_constrained(&Factor::merge(&rows).unwrap(), truth.mass()).unwrap();
    assert!((x[truth.base.len()] - 0.02).abs() < 1e-8, "{}", x[truth.base.len()]);
}
