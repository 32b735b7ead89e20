#[path = "../../regressor/tests/common/mod.rs"]
mod common;
use aloft_identify::*;
use aloft_regressor::*;

#[test]
fn look() {
    for name in ["chain_p", "chain_a"] {
        let t = common::load(name);
        println!("{name} n_base {} truth {:?}", t.base.len(), t.truth().as_slice());
        let mut m = t.motion.clone();
        common::differentiate(&t, &mut m);
        let options = AccelerationOptions { margin_s: 0.0, ..Default::default() };
        let f: Vec<Factor> = t.stretches().iter().map(|s| acceleration_factor(&t.model, &t.base, &m, s, Acting::nothing(), &options).unwrap()).collect();
        let merged = Factor::merge(&f).unwrap();
        let n = null_vector(&merged, t.mass(), ColumnScaling::None).unwrap();
        println!("acc exact: {:?} err null {:e} mc {:e}", n.sigma, (&n.parameters - t.truth()).amax(), (mass_constrained(&merged, t.mass()).unwrap() - t.truth()).amax());
        for (label, m) in [("exact", t.motion.clone()), ("noisy", t.noisy(0.3e-3, 1))] {
            for window in [0.2, 0.3, 0.4, 0.5] {
                let options = WeakOptions { window_s: Some(window), ..Default::default() };
                for white in [false, true] {
                let noise = Noise::white(CoordinateNoise::Markers { markers: &t.markers, sd_m: 0.3e-3 });
                let f: Vec<Factor> = t.stretches().iter().map(|s| weak_factor(&t.model, &t.base, &t.phi, &m, s, Acting::nothing(), &options, white.then_some(&noise)).unwrap()).collect();
                let merged = Factor::merge(&f).unwrap();
                let n = null_vector(&merged, t.mass(), ColumnScaling::None).unwrap();
                let u = null_vector(&merged, t.mass(), ColumnScaling::Unit).unwrap();
                let c = mass_constrained(&merged, t.mass()).unwrap();
                let e = |x: &nalgebra::DVector<f64>| { let d = x - t.truth(); (d.rows(1,3).amax().max(d.rows(10,2).amax()) *1e3, d.rows(4,6).amax().max(d.rows(12,5).amax()) * 1e3) };
                println!("{label} {window} white {white} rows {} ratio {:.1} unit {:.1} null {:.4?} unit {:.4?} mc {:.4?} rms {:.3}", merged.n_rows, n.sigma.ratio, u.sigma.ratio, e(&n.parameters), e(&u.parameters), e(&c), (merged.sum_of_squares(&c)/merged.n_rows as f64).sqrt());
                }
            }
        }
    }
}
