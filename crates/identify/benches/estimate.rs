//! Singular values, estimators, consistent links on the factors of a simulated person.
#![allow(missing_docs, reason = "criterion makes the functions")]

#[path = "../../regressor/tests/common/mod.rs"]
mod common;

use aloft_body::LinkInertia;
use aloft_body::subject::PriorSd;
use aloft_identify::{ColumnScaling, Estimator, IdentifyOptions, LinkPrior, identify, mass_constrained, null_vector};
use aloft_regressor::{Acting, Factor, WeakOptions, weak_factor};
use criterion::{Criterion, criterion_group, criterion_main};

fn estimate(c: &mut Criterion) {
    let truth = common::load("subject_a");
    let links: Vec<LinkInertia> = truth.phi.iter().map(LinkInertia::from_phi).collect();
    let sd = vec![PriorSd { mass_rel: 0.12, com_m: 0.02, radius_rel: 0.15, together: 0.0 }; links.len()];
    let Ok(prior) = LinkPrior::new(&links, &sd, None) else { return };
    let options = WeakOptions { window_s: Some(0.25), ..WeakOptions::default() };
    let factors: Vec<Factor> = (0..7)
        .flat_map(|seed| {
            let motion = truth.noisy(0.3e-3, seed);
            truth
                .stretches()
                .iter()
                .filter_map(|s| {
                    weak_factor(&truth.model, &truth.base, &truth.phi, &motion, s, Acting::nothing(), &options, None)
                        .ok()
                })
                .collect::<Vec<_>>()
        })
        .collect();
    let Ok(merged) = Factor::merge(&factors) else { return };
    c.bench_function("singular vector of a 128-column factor", |b| {
        b.iter(|| null_vector(&merged, truth.mass(), ColumnScaling::None));
    });
    c.bench_function("mass-constrained least squares", |b| b.iter(|| mass_constrained(&merged, truth.mass())));
    let mut whole = c.benchmark_group("21 flights, 128 parameters");
    whole.sample_size(10);
    let chosen = IdentifyOptions { estimator: Estimator::Regularised { weight: None }, ..IdentifyOptions::default() };
    whole.bench_function("regularised, weight chosen, intervals, consistent links", |b| {
        b.iter(|| identify(&truth.model, &truth.base, &factors, truth.mass(), Some(&prior), &chosen));
    });
    let drawn = IdentifyOptions { bootstrap: 500, ..IdentifyOptions::default() };
    whole.bench_function("mass-constrained, 500 bootstrap draws", |b| {
        b.iter(|| identify(&truth.model, &truth.base, &factors, truth.mass(), None, &drawn));
    });
    whole.finish();
}

criterion_group!(benches, estimate);
criterion_main!(benches);
