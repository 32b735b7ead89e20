//! study
#[path = "../../regressor/tests/common/mod.rs"]
mod common;
use aloft_body::*;
use aloft_body::subject::PriorSd;
use aloft_identify::*;
use aloft_regressor::*;
use nalgebra::{DMatrix, DVector};
use rand::SeedableRng;
use rand_distr::{Distribution, StandardNormal};

pub fn prior_of(t: &common::Truth, seed: u64) -> LinkPrior {
    let sd = vec![PriorSd { mass_rel: 0.12, com_m: 0.02, radius_rel: 0.15 }; t.phi.len()];
    let links: Vec<LinkInertia> = t.phi.iter().map(LinkInertia::from_phi).collect();
    let names: Vec<&str> = t.model.links.iter().map(|l| l.name.as_str()).collect();
    let mut pairs = vec![]; let mut mid = vec![];
    for (i, n) in names.iter().enumerate() {
        if let Some(stem) = n.strip_prefix('r') { if let Some(j) = names.iter().position(|m| m.strip_prefix('l') == Some(stem)) { pairs.push((i, j)); } }
        else if !n.starts_with('l') { mid.push(i); }
    }
    let sym = (t.phi.len() > 2).then(|| Symmetry { pairs, midline: mid, axis: 1, correlation: 0.9 });
    let exact = LinkPrior::new(&links, &sd, sym.as_ref()).unwrap();
    // draw
    let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(seed);
    let e = exact.covariance.clone().symmetric_eigen();
    let z = DVector::from_fn(exact.mean.len(), |_, _| { let x: f64 = StandardNormal.sample(&mut rng); x });
    let phi = &exact.mean + &e.eigenvectors * e.eigenvalues.map(|l| l.max(0.0).sqrt()).component_mul(&z);
    let total: f64 = (0..links.len()).map(|i| phi[10*i]).sum();
    let drawn: Vec<LinkInertia> = (0..links.len()).map(|i| LinkInertia::from_phi(&links::clipped(&(phi.fixed_rows::<10>(10*i) * (t.mass()/total)).into(), 0.003))).collect();
    LinkPrior::new(&drawn, &sd, sym.as_ref()).unwrap()
}

fn exercise(t: &common::Truth) -> Vec<(Vec<f64>, Vec<f64>, Vec<f64>)> {
    let raw = std::fs::read("/tmp/idstudy/exercise.f32").unwrap();
    let v: Vec<f64> = raw.chunks_exact(4).map(|b| f64::from(f32::from_le_bytes(b.try_into().unwrap()))).collect();
    let (q, n) = (t.model.nq, t.model.nv);
    v.chunks_exact(q + 2 * n).map(|c| (c[..q].to_vec(), c[q..q+n].to_vec(), c[q+n..].to_vec())).collect()
}

fn wrench_error(t: &common::Truth, ex: &[(Vec<f64>, Vec<f64>, Vec<f64>)], x: &DVector<f64>) -> (f64, f64) {
    let d = x - t.truth();
    let mut r = AccelerationRows::new(&t.model, &t.base);
    let (mut f, mut m) = (0.0, 0.0);
    for (q, v, a) in ex { let w: DMatrix<f64> = r.base_rows(q, v, a) * &d; for i in 0..3 { f += w[i].abs(); m += w[3+i].abs(); } }
    (f / ex.len() as f64 / 3.0, m / ex.len() as f64 / 3.0)
}

#[test]
fn human() {
    let t = common::load("subject_a");
    let ex = exercise(&t);
    let prior = prior_of(&t, 5);
    println!("prior error {:.3?}", wrench_error(&t, &ex, &prior.base(&t.base).unwrap().mean));
    let soft = 0.003;
    for (label, m) in [("noise", t.noisy(0.3e-3, 1)), ("soft", t.tracked(0.3e-3, soft, 1))] {
        for window in [0.2, 0.25, 0.3, 0.35, 0.4] {
            for (wl, w) in [("fixed .1", 0), ("fixed .3", 3), ("white", 1), ("white+slow", 2), ("slow2", 4)] {
                let options = WeakOptions { window_s: Some(window), moment_length_m: if w == 3 { 0.3 } else { 0.1 }, ..Default::default() };
                let noise = Noise { coordinates: CoordinateNoise::Markers { markers: &t.markers, sd_m: 0.3e-3 }, slow: match w { 2 => 5.0, 4 => 10.0, _ => 0.0 }, slow_time_s: if w == 4 { 0.05 } else { 0.1 } };
                let start = std::time::Instant::now();
                let f: Vec<Factor> = t.stretches().iter().map(|s| weak_factor(&t.model, &t.base, &prior.phi(), &m, s, Acting::nothing(), &options, [1,2,4].contains(&w).then_some(&noise)).unwrap()).collect();
                let el = start.elapsed();
                let start = std::time::Instant::now();
                let merged = Factor::merge(&f).unwrap();
                let n = null_vector(&merged, t.mass(), ColumnScaling::None).unwrap();
                let c = mass_constrained(&merged, t.mass()).unwrap();
                print!("{label} {window} {wl:10} rows {} ratio {:.1} null {:.2?} mc {:.2?} ", merged.n_rows, n.sigma.ratio, wrench_error(&t, &ex, &n.parameters), wrench_error(&t, &ex, &c));
                for weight in [Some(1.0), Some(3.0), Some(10.0), Some(100.0), None] {
                    let id = identify(&t.model, &t.base, &f, t.mass(), Some(&prior), &IdentifyOptions { estimator: Estimator::Regularised { weight }, ..Default::default() }).unwrap();
                    print!(" {:?} {:.2?}", weight.or(Some(-id.parameters.prior_weight)).unwrap(), wrench_error(&t, &ex, &id.parameters.base_values()));
                    if weight.is_none() { print!(" s {:.2e} rms {:.2e} tries {:?}", id.parameters.row_sd, id.parameters.row_rms, id.parameters.weights_tried.iter().map(|w| (w.weight, w.held_out_rms)).collect::<Vec<_>>()); }
                }
                println!(" {:?} {:?}", el, start.elapsed());
            }
        }
    }
}
