//! Columns of kinematic errors: every link appears displaced by a small field `e(t)`.
//!
//! If link i appears displaced by `θ e_i` in the recording, the rows formed from it contain the
//! effect of the displacement on the momentum balance. To first order in θ this is a wrench
//!
//! ```text
//! f = d²/dt² Σ m_i e_i        n₀ = d/dt Σ m_i (e_i × v_i + c_i × ė_i) − Σ m_i e_i × g
//! ```
//!
//! with the links' centres of mass c_i, velocities v_i and masses m_i. If links also appear
//! rotated, by small rotation vectors `θ a_i`, the moment gains `d/dt Σ (a_i × h_i + J_i ȧ_i)` with
//! the links' inertias J_i about their centres and angular momenta h_i = J_i ω_i; fields without
//! rotations omit that term.

use crate::{Columns, EffectFrame, Series};
use aloft_body::{LinkInertia, Model};
use nalgebra::Vector3;

/// First derivative of a sampled vector in a run by a local cubic over up to nine samples.
pub(crate) fn rate(values: &[Vector3<f64>], rate_hz: f64) -> Vec<Vector3<f64>> {
    let n = values.len();
    (0..n)
        .map(|i| {
            let h = i.min(n - 1 - i).min(4);
            if h >= 1 {
                // least-squares line over a symmetric window: exact for quadratics
                let sum: f64 = (1..=h).map(|k| 2.0 * (k * k) as f64).sum();
                let slope: Vector3<f64> = (1..=h).map(|k| (values[i + k] - values[i - k]) * k as f64).sum();
                slope * (rate_hz / sum)
            } else if n >= 3 {
                let (a, b, c, sign) = if i == 0 {
                    (values[0], values[1], values[2], 1.0)
                } else {
                    (values[n - 1], values[n - 2], values[n - 3], -1.0)
                };
                (b * 4.0 - a * 3.0 - c) * (0.5 * rate_hz * sign)
            } else {
                Vector3::zeros()
            }
        })
        .collect()
}

/// Which links a link carries, itself included.
pub(crate) fn carried(model: &Model, link: usize) -> Vec<bool> {
    let mut out = vec![false; model.n_links()];
    for i in 0..out.len() {
        out[i] = i == link || model.links[i].parent.is_some_and(|p| out[p]);
    }
    out
}

/// Adds the column of apparent rotations: `field(frame, link)` is the world rotation vector by
/// which a link appears rotated, rad per unit.
pub(crate) fn add_turns(
    series: &Series<'_>,
    column: usize,
    out: &mut Columns,
    field: impl Fn(&EffectFrame<'_>, usize) -> Vector3<f64>,
) {
    let scene = series.scene;
    let inertias: Vec<LinkInertia> = scene.phi.iter().map(LinkInertia::from_phi).collect();
    for run in series.runs() {
        let frames: Vec<EffectFrame<'_>> = run.clone().map(|i| series.frame(i)).collect();
        let mut spin = vec![Vector3::zeros(); frames.len()];
        for (link, own) in inertias.iter().enumerate() {
            let turn: Vec<Vector3<f64>> = frames.iter().map(|f| field(f, link)).collect();
            let turn_dot = rate(&turn, series.rate_hz);
            for (i, f) in frames.iter().enumerate() {
                let r = f.links[link].rotation;
                let inertia = r * own.inertia_com_kgm2 * r.transpose();
                spin[i] += turn[i].cross(&(inertia * f.links[link].omega)) + inertia * turn_dot[i];
            }
        }
        for (at, moment) in run.zip(rate(&spin, series.rate_hz)) {
            out.couple(at, column, &moment);
        }
    }
}

/// Adds the columns of displacement fields: `field(frame, column, link)` is the world displacement
/// of a link's centre of mass, m per unit.
pub(crate) fn add_columns(
    series: &Series<'_>,
    out: &mut Columns,
    field: impl Fn(&EffectFrame<'_>, usize, usize) -> Vector3<f64>,
) {
    let scene = series.scene;
    let n_links = scene.model.n_links();
    for run in series.runs() {
        let frames: Vec<EffectFrame<'_>> = run.clone().map(|i| series.frame(i)).collect();
        for column in 0..out.k {
            let zero = vec![Vector3::zeros(); frames.len()];
            let (mut first, mut angular, mut weight) = (zero.clone(), zero.clone(), zero.clone());
            for link in 0..n_links {
                let m = scene.phi[link][0];
                let e: Vec<Vector3<f64>> = frames.iter().map(|f| field(f, column, link)).collect();
                if e.iter().all(|x| x.norm_squared() == 0.0) {
                    continue;
                }
                let e_dot = rate(&e, series.rate_hz);
                for (i, f) in frames.iter().enumerate() {
                    let c = f.links[link].point(&scene.link_com_m[link]);
                    let v = f.links[link].point_velocity(&scene.link_com_m[link]);
                    first[i] += e[i] * m;
                    angular[i] += (e[i].cross(&v) + c.cross(&e_dot[i])) * m;
                    weight[i] += e[i].cross(&scene.model.gravity_mps2) * m;
                }
            }
            let force = rate(&rate(&first, series.rate_hz), series.rate_hz);
            let moment = rate(&angular, series.rate_hz);
            for (i, at) in run.clone().enumerate() {
                out.add(at, column, &force[i], &(moment[i] - weight[i]));
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_rate_of_a_parabola_is_exact() {
        let x: Vec<Vector3<f64>> = (0..20).map(|i| Vector3::new(1.0, i as f64, (i * i) as f64)).collect();
        for (i, v) in rate(&x, 1.0).iter().enumerate() {
            assert!((v - Vector3::new(0.0, 1.0, 2.0 * i as f64)).norm() < 1e-9, "{i} {v:?}");
        }
    }
}
