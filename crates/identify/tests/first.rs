//! study
#[path = "../../regressor/tests/common/mod.rs"]
mod common;
use aloft_body::*;
use aloft_body::subject::PriorSd;
use aloft_identify::*;
use aloft_regressor::*;
use nalgebra::DVector;
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
    let drawn: Vec<LinkInertia> = (0..links.len()).map(|i| LinkInertia::from_phi(&links::clipped(&(phi.fixed_rows::<10>(10*i) * (t.mass()/total)).into(), 0.03))).collect();
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
    for (q, v, a) in ex { let w: DVector<f64> = r.base_rows(q, v, a) * &d; for i in 0..3 { f += w[i].abs(); m += w[3+i].abs(); } }
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
                let options = WeakOptions { window_s: Some(window), moment_length_m: Some(if w == 3 { 0.3 } else { 0.1 }), ..Default::default() };
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

fn filtered(t: &common::Truth, m: &Motion, cutoff: f64, order: usize) -> Motion {
    let mut out = m.clone();
    let design = aloft_signal::Butterworth::design(aloft_signal::LowPass { order, cutoff_hz: cutoff, correction: Default::default() }, m.rate_hz).unwrap();
    for b in &t.flights {
        for c in 0..m.nq {
            let mut x: Vec<f64> = (b[0]..b[3]).map(|f| m.q[f * m.nq + c]).collect();
            design.filtfilt(&mut x);
            for (i, f) in (b[0]..b[3]).enumerate() { out.q[f * m.nq + c] = x[i]; }
        }
    }
    for f in out.q.chunks_exact_mut(m.nq) { t.model.normalize(f); }
    common::differentiate(t, &mut out);
    out
}

fn split(t: &common::Truth, x: &DVector<f64>) -> (f64, f64) { let d = x - t.truth(); (d.rows(1,3).amax().max(d.rows(10,2).amax()) *1e3, d.rows(4,6).amax().max(d.rows(12,5).amax()) * 1e3) }

#[test]
fn paper() {
    for name in ["chain_p", "chain_a"] {
        let t = common::load(name);
        for seed in 1..3 { for cut in [6.0, 8.0, 10.0, 14.0, 20.0] { for margin in [0.0, 0.035, 0.05, 0.07, 0.1] {
            let m = filtered(&t, &t.noisy(0.3e-3, seed), cut, 3);
            let options = AccelerationOptions { margin_s: margin, ..Default::default() };
            let f: Vec<Factor> = t.stretches().iter().map(|s| acceleration_factor(&t.model, &t.base, &m, s, Acting::nothing(), &options).unwrap()).collect();
            let merged = Factor::merge(&f).unwrap();
            let n = null_vector(&merged, t.mass(), ColumnScaling::None).unwrap();
            let u = null_vector(&merged, t.mass(), ColumnScaling::Unit).unwrap();
            let c = mass_constrained(&merged, t.mass()).unwrap();
            println!("{name} {seed} {cut} margin {margin} s {:.1} {:.2} {:.3} null {:.3?} unit {:.3?} mc {:.3?}", n.sigma.max, n.sigma.second, n.sigma.min, split(&t, &n.parameters), split(&t, &u.parameters), split(&t, &c));
        } } }
    }
}

#[test]
fn coverage() {
    for name in ["chain_p", "chain_a"] {
        let t = common::load(name);
        let (mut hit, mut all, mut worst) = (0, 0, 0.0f64);
        let mut per = vec![0; 17];
        for seed in 0..40 {
            let m = t.noisy(0.3e-3, 100 + seed);
            let noise = Noise::white(CoordinateNoise::Markers { markers: &t.markers, sd_m: 0.3e-3 });
            let f: Vec<Factor> = t.stretches().iter().map(|s| weak_factor(&t.model, &t.base, &t.phi, &m, s, Acting::nothing(), &WeakOptions { window_s: Some(0.4), ..Default::default() }, Some(&noise)).unwrap()).collect();
            let id = identify(&t.model, &t.base, &f, t.mass(), None, &IdentifyOptions::default()).unwrap();
            let truth = t.truth();
            for (i, b) in id.parameters.base.iter().enumerate().skip(1) { all += 1; if b.ci95[0] <= truth[i] && truth[i] <= b.ci95[1] { hit += 1; per[i] += 1; } worst = worst.max((b.value - truth[i]).abs()); }
            if seed == 0 { println!("{} gate {:?} {:?}", id.parameters.se_from, id.parameters.gate, id.parameters.sigma); for b in &id.parameters.base { println!("{} {:.6} ± {:.6} {:?} {:.1e}", b.name, b.value, b.se, b.seen, b.value - truth[id.parameters.base.iter().position(|c| c.name == b.name).unwrap()]); } }
        }
        println!("{name} coverage {:.3} worst {:.2e} {:?}", hit as f64 / all as f64, worst, per);
    }
}

#[test]
fn linksandadvice() {
    let t = common::load("subject_a");
    let ex = exercise(&t);
    let prior = prior_of(&t, 5);
    println!("radius {}", body_radius_m(&t.model, &prior.phi()));
    let m = t.tracked(0.3e-3, 0.003, 1);
    let mut candidates = vec![];
    for w in [0.15, 0.2, 0.25, 0.3, 0.35, 0.4] {
        let options = WeakOptions { window_s: Some(w), ..Default::default() };
        let f: Vec<Factor> = t.stretches().iter().map(|s| weak_factor(&t.model, &t.base, &prior.phi(), &m, s, Acting::nothing(), &options, None).unwrap()).collect();
        let id = identify(&t.model, &t.base, &f, t.mass(), Some(&prior), &IdentifyOptions { estimator: Estimator::Regularised { weight: Some(1.0) }, ..Default::default() }).unwrap();
        println!("{w} fixed {:.3?}", wrench_error(&t, &ex, &id.parameters.base_values()));
        candidates.push((w, f));
    }
    let bp = prior.base(&t.base).unwrap();
    println!("{:?}", choose_window(&candidates, &candidates[3].1, t.mass(), Some(&bp), ClusterBy::Stretch).unwrap());
    let noise = Noise { coordinates: CoordinateNoise::Markers { markers: &t.markers, sd_m: 0.3e-3 }, slow: 5.0, slow_time_s: 0.1 };
    let weak = WeakOptions { window_s: Some(0.3), ..Default::default() };
    let f: Vec<Factor> = t.stretches().iter().map(|s| weak_factor(&t.model, &t.base, &prior.phi(), &m, s, Acting::nothing(), &weak, Some(&noise)).unwrap()).collect();
    for (n, f) in [(3, f[..3].to_vec()), (21, f.clone())] {
        for est in [Estimator::Regularised { weight: Some(1.0) }, Estimator::Regularised { weight: Some(10.0) }] {
        let start = std::time::Instant::now();
        let id = identify(&t.model, &t.base, &f, t.mass(), Some(&prior), &IdentifyOptions { estimator: est, bootstrap: 200, ..Default::default() }).unwrap();
        let el = start.elapsed();
        let p = &id.parameters;
        let phi: Vec<Phi> = p.links.iter().map(|l| l.inertia().to_phi()).collect();
        let b = t.base.regroup(&phi);
        println!("flights {n} {:?} {:?} base err {:.3?} links err {:.3?} mass {} z-dist {:.3?} mineig {:.2e}", est, el, wrench_error(&t, &ex, &p.base_values()), wrench_error(&t, &ex, &b), phi.iter().map(|p| p[0]).sum::<f64>() - t.mass(),
            p.base.iter().zip(b.iter()).skip(1).map(|(e, v)| ((e.value - v) / e.se).abs()).fold(0.0, f64::max), phi.iter().map(|p| inertia::pseudo_inertia(p).symmetric_eigenvalues().min()).fold(1.0, f64::min));
        let truth = t.truth();
        let z: Vec<f64> = p.base.iter().zip(truth.iter()).skip(1).map(|(e, v)| (e.value - v) / e.se).collect();
        println!("  cover {:.3} rms z {:.2}; {:?}", p.base.iter().zip(truth.iter()).skip(1).filter(|(e, v)| e.ci95[0] <= **v && **v <= e.ci95[1]).count() as f64 / 127.0, (z.iter().map(|z| z*z).sum::<f64>() / 127.0).sqrt(), p.gate);
        for (l, t) in p.links.iter().zip(&t.phi) { println!("  {} {} | truth {:.3} prior {:.3}", l.name, l.words, t[0], l.prior.mass_kg); }
        }
    }
    let ff = &candidates[3].1;
    let id = identify(&t.model, &t.base, &ff[..3], t.mass(), Some(&prior), &IdentifyOptions { estimator: Estimator::Regularised { weight: Some(1.0) }, ..Default::default() }).unwrap();
    let start = std::time::Instant::now();
    let a = excitation_advice(&t.model, &t.base, &ff[..3], t.mass(), &prior, t.motion.q(5), id.parameters.row_sd, &weak, &AdviceOptions::default()).unwrap();
    println!("{:?}", start.elapsed());
    for a in a.iter().take(8).chain(a.iter().rev().take(2)) { println!("{a:?}"); }
}
